"""Sentences, terms and names in the language of the window, and the binding of texts to widgets."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from PySide6.QtCore import QObject
from PySide6.QtWidgets import QAbstractButton, QGroupBox, QLabel

from calstation.config import library, load_product
from calstation.errors import CalstationError
from calstation.gui.text import language
from calstation.gui.text.language import languages
from calstation.messages import Rendered, Text, known, rendering, step_text
from calstation.messages import with_minus as with_minus
from calstation.sequencer import Fault

#: Source of a text: a code of the catalogue, a message, or a function that returns the text; "" for no text.
Words = str | Text | Callable[[], str]

#: Messages that name a file or an entry of a file before the message `what`.
_ABOUT_FILES = frozenset(
    f"{family}.{name}"
    for family, names in {
        "entry": ("at", "in_file", "in_file_and_more"),
        "configuration": ("line", "line_and_more"),
    }.items()
    for name in names
)

#: Messages about a site that an engineer has to verify and confirm.
_UNCONFIRMED = ("site.not_confirmed", "site.confirmed_elsewhere")

#: Badge shape (`widgets.badge.KINDS`) of each state and outcome of a run.
KINDS = {
    "idle": "none",
    "not_ready": "caution",
    "in_use": "active",
    "monitoring": "active",
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
    "altered": "caution",
    "missing": "caution",
    "unconfirmed": "caution",
    "incomplete": "waiting",
}


def say(words: Words, /, **values: Any) -> str:
    """Return a text in the current language; `values` are the values for a code.

    Raises KeyError if the catalogue does not contain the code.
    """
    if isinstance(words, str):
        return say(Text(words, values)) if words else ""
    return rendered(words).sentences if isinstance(words, Text) else words()


def rendered(message: Text, *, engineer: bool = True) -> Rendered:
    """Render a message in the current language; the `remedy` of a question is its explanation.

    Unless the message is for an `engineer`, its remedy does not name entries of profiles or files.
    """
    return rendering.render(message.code, message.values, language.current(), window=True, operator=not engineer)


def term(family: str, name: str, **values: Any) -> str:
    """Return a term of a catalogue family, such as ``rate`` of the family ``stage``, in the current language."""
    return rendering.term(family, name, language.current(), **values)


def about(kind: str, name: str) -> str:
    """Return the explanation of a ``stage``, a ``check`` or a table ``column``, or "" if the catalogue has none."""
    codes = (f"about.{kind}_{name}", f"certificate.{kind}_{name}")
    return next((say(code) for code in codes if known(code)), "")


def step_sentence(kind: str, label: tuple[str | float, ...]) -> str:
    """Return a description of a step, which for a dwell includes the position if its move has a label."""
    if kind == "dwell" and label:
        return f"{say(step_text('move', label))}  ·  {say(step_text(kind, ()))}"
    return say(step_text(kind, label))


def fault_text(fault: Fault, *, engineer: bool = True) -> Rendered:
    """Render the fault of a run; a fault without a code, such as a programming error, keeps its text.

    Unless the text is for an `engineer`, it does not name files or keys.
    """
    if not fault.code:
        return Rendered("", fault.text, "", language.current())
    message = Text(fault.code, fault.values)
    plain = None if engineer else for_operator(message)
    if plain is None:
        return rendered(message, engineer=engineer)
    return replace(rendered(plain), remedy=say(engineer_corrects(message)))


def for_operator(message: Text) -> Text | None:
    """Return a message about an entry of a file without the file and its key; None for any other message.

    The name of the field in the window, if it has one, replaces the key.
    """
    if message.code not in _ABOUT_FILES:
        return None
    while message.code in _ABOUT_FILES and isinstance(what := message.values["what"], Text):
        field = str(message.values.get("field", ""))
        name = f"setting.{field.rpartition('.')[2]}"
        if field and what.code not in _ABOUT_FILES:
            return Text.of("entry.at", field=Text(name) if known(name) else field, what=what)
        message = what
    return message


def engineer_corrects(message: Text) -> Text:
    """Return the remedy for a message about a file entry: an engineer corrects the file, or confirms the site."""
    what = message
    while what.code in _ABOUT_FILES and isinstance(inner := what.values["what"], Text):
        what = inner
    if what.code in _UNCONFIRMED:
        return Text("advice.engineer_confirms_site")
    file = Path(str(message.values.get("file", "")))
    if file.parent.name == "products":
        return Text.of("advice.engineer_corrects_product", product=file.stem)
    return Text("advice.engineer_corrects")


def without_minus(text: str) -> str:
    """Return a number with hyphens instead of minus signs, as files and `float` require."""
    return text.replace("−", "-")


def duration_text(seconds: float, *, tenths: bool = False) -> str:
    """Format a duration, s, as ``m:ss`` or ``h:mm:ss``, optionally with `tenths` of a second."""
    count = max(0, round(10.0 * seconds if tenths else seconds))
    whole, tenth = divmod(count, 10) if tenths else (count, 0)
    minutes, rest = divmod(whole, 60)
    hours, minutes = divmod(minutes, 60)
    text = f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"
    return f"{text}.{tenth}" if tenths else text


def schedule_text(name: str, stage: str) -> str:
    """Return the display name of an entry of a stage's schedule."""
    return rendering.schedule_name(name, language.current(), stage=stage)


def sigmas_text(sigmas: float) -> str:
    """Format a difference in sigmas with its sign; a difference that is rounded to zero has no sign."""
    text = f"{sigmas:+.2f}"
    return text if float(text) else text[1:]


def product_text(name: str) -> str:
    """Return the display name of a product from the name in its file; names of shipped products are translated."""
    return rendering.product_name(name, language.current())


def station_text(name: str) -> str:
    """Return the display name of a station from the name in its file; names of shipped stations are translated."""
    return rendering.station_name(name, language.current())


def offered_products() -> list[tuple[str, Path]]:
    """Return the display name and the file of each product in the library; equal names include the file name."""
    files = [library.find("products", stem) for stem in library.names("products")]
    names = [_product_name(file) for file in files]
    return [
        (product_text(name) if names.count(name) == 1 else f"{product_text(name)} ({file.stem})", file)
        for name, file in zip(names, files, strict=True)
    ]


def _product_name(file: Path) -> str:
    """Return the name in a product file, or the name of the file if it cannot be read."""
    try:
        return load_product(file)[1].name
    except CalstationError:
        return file.stem


class _Binding(QObject):
    """Calls `show` at once and after each change of language, until its owner is destroyed."""

    def __init__(self, owner: QObject, show: Callable[[], Any]) -> None:
        super().__init__(owner)
        self._show = show
        self.apply()
        languages.changed.connect(self.apply)

    def apply(self) -> None:
        """Show the text in the current language."""
        self._show()


def bind(target: QLabel | QAbstractButton | QGroupBox | Callable[[str], Any], words: Words) -> None:
    """Show a text in the current language, and again after each change of language.

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
    """Call `show` now and after each change of language, until `owner` is destroyed."""
    _Binding(owner, show)
