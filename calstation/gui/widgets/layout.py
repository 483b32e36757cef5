"""Builds layouts, labels and buttons in one call each; their texts follow the language."""

from collections.abc import Callable
from typing import Any, TypeVar

from PySide6.QtCore import SignalInstance
from PySide6.QtWidgets import QBoxLayout, QHBoxLayout, QLabel, QLayout, QPushButton, QVBoxLayout, QWidget

from calstation.gui.text import bind
from calstation.gui.widgets import theme

#: Gives a text in the current language.
Words = Callable[[], str]

#: A widget or layout, alone or with its stretch and alignment; a distance in px; None for a stretch.
Item = QWidget | QLayout | tuple[Any, ...] | int | None

#: Left, top, right and bottom, px.
Margins = tuple[int, int, int, int]

Box = TypeVar("Box", bound=QBoxLayout)


def column(
    *items: Item, on: QWidget | None = None, spacing: int = theme.GRID, margins: Margins = (0, 0, 0, 0)
) -> QVBoxLayout:
    """Lay out items one below the other.

    Parameters
    ----------
    items : see `Item`
    on : the widget that gets the layout
    spacing : between items, px
    margins : left, top, right and bottom, px
    """
    return _filled(QVBoxLayout(), items, on, spacing, margins)


def row(
    *items: Item, on: QWidget | None = None, spacing: int = theme.GRID, margins: Margins = (0, 0, 0, 0)
) -> QHBoxLayout:
    """Lay out items side by side; parameters as for `column`."""
    return _filled(QHBoxLayout(), items, on, spacing, margins)


def label(words: Words | None = None, kind: str = "", *, name: str = "", wrap: bool = False) -> QLabel:
    """Make a label.

    Parameters
    ----------
    words : its text; None where the caller sets it
    kind : of the style sheet, such as ``muted`` or ``section``
    name : object name
    wrap : whether long texts take several lines
    """
    made = QLabel()
    made.setObjectName(name)
    made.setWordWrap(wrap)
    if kind:
        made.setProperty("kind", kind)
    if words is not None:
        bind(made, words)
    return made


def button(
    name: str,
    words: Words | None = None,
    pressed: Callable[..., Any] | SignalInstance | None = None,
    *,
    kind: str = "",
) -> QPushButton:
    """Make a button.

    Parameters
    ----------
    name : object name
    words : its text; None where the caller sets it
    pressed : called, or emitted if it is a signal, at each click
    kind : of the style sheet, such as ``primary``
    """
    made = QPushButton()
    made.setObjectName(name)
    if kind:
        made.setProperty("kind", kind)
    if words is not None:
        bind(made, words)
    if pressed is not None:
        made.clicked.connect(pressed)
    return made


def enable(widget: QWidget, why_not: str, tip: str = "") -> None:
    """Enable a widget, or disable it with the reason as its tooltip; `tip` is the tooltip while it is enabled."""
    widget.setEnabled(not why_not)
    widget.setToolTip(why_not or tip)


def _filled(box: Box, items: tuple[Item, ...], on: QWidget | None, spacing: int, margins: Margins) -> Box:
    box.setSpacing(spacing)
    box.setContentsMargins(*margins)
    for item in items:
        if item is None:
            box.addStretch(1)
        elif isinstance(item, int):
            box.addSpacing(item)
        else:
            content, *where = item if isinstance(item, tuple) else (item,)
            if isinstance(content, QLayout):
                box.addLayout(content, *where)
            else:
                box.addWidget(content, *where)
    if on is not None:
        on.setLayout(box)
    return box
