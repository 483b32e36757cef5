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
    """Ask a question, or show a notice if it has no answers.

    Parameters
    ----------
    bar : shows the question
    kind : state of the notice, one of `badge.KINDS`
    question : its text is the title, its remedy the explanation
    answers : what each answer of the family ``answer`` does, from left to right
    primary : the answer that has the focus
    others : answers with texts of their own, shown first
    """
    choices = [
        Choice(f"{name}_choice", partial(show, Text(f"answer.{name}", question.values)), act, name == primary)
        for name, act in answers.items()
    ]
    bar.ask(kind, lambda: rendered(question).text, lambda: rendered(question).remedy, [*others, *choices])
