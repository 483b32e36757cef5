"""Notices and questions whose texts are entries of the catalogue families ``question`` and ``answer``."""

from collections.abc import Callable, Mapping, Sequence

from calstation.gui.text import rendered
from calstation.gui.widgets import Choice, NoticeBar
from calstation.messages import Text


def ask(
    bar: NoticeBar,
    kind: str,
    question: Text,
    answers: Mapping[str, Callable[[], None]],
    *,
    primary: str = "",
    others: Sequence[Choice] = (),
) -> None:
    """Ask a question in a notice bar, or show a notice if there are no answers; `kind` is a state of `badge.KINDS`.

    `answers` maps names of the catalogue family ``answer`` to their actions, and `primary` names the one that receives
    the focus. `others` are additional choices with their own texts, which are shown first.
    """
    choices = [
        Choice(f"{name}_choice", Text(f"answer.{name}", question.values), act, name == primary)
        for name, act in answers.items()
    ]
    bar.ask(kind, lambda: rendered(question).text, lambda: rendered(question).remedy, [*others, *choices])
