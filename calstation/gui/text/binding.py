"""Text bindings: a bound text is updated whenever the language changes."""

from collections.abc import Callable
from functools import partial
from typing import Any

from PySide6.QtCore import QObject
from PySide6.QtWidgets import QAbstractButton, QGroupBox, QLabel

from calstation.gui.text.language import languages
from calstation.gui.text.messages import Words, say


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
