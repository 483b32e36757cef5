"""Sentences and terms of the message catalogue in the language of the window, and their binding to widgets."""

from collections.abc import Callable
from functools import partial
from typing import Any

from PySide6.QtCore import QObject
from PySide6.QtWidgets import QAbstractButton, QGroupBox, QLabel

from calstation.gui.text import language
from calstation.gui.text.language import languages
from calstation.messages import Rendered, Text, rendering, step_text
from calstation.messages import with_minus as with_minus
from calstation.sequencer import Fault

#: A text of the window: a code of the catalogue ("" for no text), a message, or a function that returns a text.
Words = str | Text | Callable[[], str]

#: Badge shape (`widgets.badge.KINDS`) of each state and outcome of a run.
KINDS = {
    "idle": "none",
    "not_ready": "caution",
    "starting": "waiting",
    "preparing": "active",
    "running": "active",
    "writing": "active",
    "pausing": "paused",
    "paused": "paused",
    "stopping": "stopped",
    "stopped": "stopped",
    "fault": "caution",
    "passed": "good",
    "partial": "partial",
    "failed": "bad",
    "released": "bad",
    "incomplete": "waiting",
}


def say(words: Words, /, **values: Any) -> str:
    """Return a text in the current language; `values` are those of a code. Raises KeyError for an unknown code."""
    if isinstance(words, str):
        return say(Text(words, values)) if words else ""
    return rendered(words).sentences if isinstance(words, Text) else words()


def rendered(message: Text) -> Rendered:
    """Render a message in the current language; a question has its title as `text`, its explanation as `remedy`."""
    return rendering.render(message.code, message.values, language.current(), window=True)


def term(family: str, name: str, **values: Any) -> str:
    """Return a term of a catalogue family, such as the stage ``rate``."""
    return rendering.term(family, name, language.current(), **values)


def step_sentence(kind: str, label: tuple[str | float, ...]) -> str:
    """Return the description of a step; for a dwell after a labelled move, the position is included."""
    if kind == "dwell" and label:
        return f"{say(step_text('move', label))}  ·  {say(step_text(kind, ()))}"
    return say(step_text(kind, label))


def fault_text(fault: Fault) -> Rendered:
    """Render a run's fault; one without a code, such as a programming error, is shown unchanged."""
    if fault.code:
        return rendered(Text(fault.code, fault.values))
    return Rendered("", fault.text, "", language.current())


def without_minus(text: str) -> str:
    """Return a typed or copied number with a hyphen instead of a minus sign, as files and `float` require."""
    return text.replace("−", "-")


def duration_text(seconds: float) -> str:
    """Format a duration, s, as ``m:ss`` or ``h:mm:ss``."""
    minutes, rest = divmod(max(0, round(seconds)), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"


class _Binding(QObject):
    """Calls `show` when created and after each language change until its owner is destroyed."""

    def __init__(self, owner: QObject, show: Callable[[], Any]) -> None:
        super().__init__(owner)
        self._show = show
        self.apply()
        languages.changed.connect(self.apply)

    def apply(self) -> None:
        """Show the text in the current language."""
        self._show()


def bind(target: QLabel | QAbstractButton | QGroupBox | Callable[[str], Any], words: Words) -> None:
    """Show a text, such as ``"operator.load_unit"``, in the current language and after each change of it.

    `target` is a label, button or group box, or a bound setter of any Qt object, such as ``button.setToolTip`` or
    ``partial(combo.setItemText, 0)``.
    """
    if isinstance(target, QGroupBox):
        target = target.setTitle
    elif isinstance(target, QLabel | QAbstractButton):
        target = target.setText
    setter = target
    owner = getattr(setter.func if isinstance(setter, partial) else setter, "__self__", None)
    if not isinstance(owner, QObject):
        raise TypeError("bind needs a widget or a bound method of a Qt object")
    _Binding(owner, lambda: setter(say(words)))


def on_language_change(owner: QObject, show: Callable[[], Any]) -> None:
    """Call `show` now and after each language change until `owner` is destroyed; meant for views built from data."""
    _Binding(owner, show)
