"""Notices and questions whose texts are entries of the catalogue families ``question`` and ``answer``."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial

from calstation.gui.text import language, show
from calstation.gui.widgets import Choice, NoticeBar
from calstation.messages import Rendered, Text, render


def rendered(message: Text) -> Rendered:
    """A message in the language of the window: a title as its text, an explanation as its remedy."""
    return render(message.code, message.values, language.current(), window=True)


def ask(
    bar: NoticeBar,
    kind: str,
    question: Text,
    answers: Mapping[str, Callable[[], None]],
    *,
    primary: str = "",
    others: Sequence[Choice] = (),
) -> None:
    """Ask a question in a bar with a state of `badge.KINDS`, or show a notice if it has no answers.

    `answers` says what each answer of the family ``answer`` does, `primary` which one has the focus; `others`, with
    texts of their own, come first.
    """
    choices = [
        Choice(f"{name}_choice", partial(show, Text(f"answer.{name}", question.values)), act, name == primary)
        for name, act in answers.items()
    ]
    bar.ask(kind, lambda: rendered(question).text, lambda: rendered(question).remedy, [*others, *choices])
