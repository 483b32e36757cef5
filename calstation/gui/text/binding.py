"""Text bindings: a bound text is updated whenever the language changes."""

from collections.abc import Callable
from typing import Any

from PySide6.QtCore import QObject, Signal
from PySide6.QtWidgets import QAbstractButton, QGroupBox, QLabel


class _Languages(QObject):
    changed = Signal()


#: Emits `changed` after another language has been installed (`language.use`).
languages = _Languages()


class _Binding(QObject):
    """Calls `show` when created and after each language change until its owner is destroyed."""

    def __init__(self, owner: QObject, show: Callable[[], Any]) -> None:
        super().__init__(owner)
        self._show = show
        languages.changed.connect(self.apply)
        self.apply()

    def apply(self) -> None:
        """Show the text in the current language."""
        self._show()


def bind(target: QLabel | QAbstractButton | QGroupBox | Callable[[str], Any], text: Callable[[], str]) -> None:
    """Show `text`, such as ``lambda: self.tr("Load the unit")``, in the current language and after each change of it.

    `target` is a label, button or group box, or a bound setter of any Qt object such as ``button.setToolTip``.
    """
    if isinstance(target, QGroupBox):
        target = target.setTitle
    elif isinstance(target, QLabel | QAbstractButton):
        target = target.setText
    setter = target
    owner = getattr(setter, "__self__", None)
    if not isinstance(owner, QObject):
        raise TypeError("bind needs a widget or a bound method of a Qt object")
    _Binding(owner, lambda: setter(text()))


def on_language_change(owner: QObject, show: Callable[[], Any]) -> None:
    """Call `show` now and after each language change until `owner` is destroyed; meant for views built from data."""
    _Binding(owner, show)
