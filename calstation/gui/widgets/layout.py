"""Builds layouts, labels and buttons in one call each; their texts follow the language."""

from collections.abc import Callable
from typing import Any, TypeVar

from PySide6.QtCore import SignalInstance
from PySide6.QtWidgets import (
    QBoxLayout,
    QFrame,
    QHBoxLayout,
    QLabel,
    QLayout,
    QPushButton,
    QScrollArea,
    QStackedWidget,
    QTabBar,
    QVBoxLayout,
    QWidget,
)

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
    """Lay out items one below the other, `on` a widget if given; distances in px."""
    return _filled(QVBoxLayout(), items, on, spacing, margins)


def row(
    *items: Item, on: QWidget | None = None, spacing: int = theme.GRID, margins: Margins = (0, 0, 0, 0)
) -> QHBoxLayout:
    """Lay out items side by side, as `column` does."""
    return _filled(QHBoxLayout(), items, on, spacing, margins)


def panel(*items: Item) -> QFrame:
    """Frame items, one below the other."""
    frame = QFrame()
    frame.setProperty("kind", "panel")
    column(*items, on=frame, margins=(2 * theme.GRID, theme.GRID, 2 * theme.GRID, theme.GRID))
    return frame


def scroll_area(content: QWidget) -> QScrollArea:
    """A frameless area with scroll bars that appear if the content is too large."""
    area = QScrollArea()
    area.setWidgetResizable(True)
    area.setFrameShape(QFrame.Shape.NoFrame)
    area.setProperty("kind", "clear")
    area.setWidget(content)
    return area


def stack(*pages: QWidget) -> QStackedWidget:
    """Lay out widgets of which one is visible at a time."""
    stacked = QStackedWidget()
    for page in pages:
        stacked.addWidget(page)
    return stacked


class ViewTabs(QTabBar):
    """A bar of tabs above the views of a page."""

    def __init__(self, name: str) -> None:
        super().__init__()
        self.setObjectName(name)
        self.setProperty("kind", "views")
        self.setDrawBase(False)
        self.setExpanding(False)


def label(
    words: Words | None = None, kind: str = "", *, name: str = "", wrap: bool = False, buddy: QWidget | None = None
) -> QLabel:
    """Make a label.

    Parameters
    ----------
    words : its text; None if the caller sets it
    kind : of the style sheet, such as ``muted`` or ``section``
    name : object name
    wrap : whether long texts take several lines
    buddy : the input that the label names
    """
    made = QLabel()
    made.setObjectName(name)
    made.setWordWrap(wrap)
    if kind:
        made.setProperty("kind", kind)
    if words is not None:
        bind(made, words)
    if buddy is not None:
        made.setBuddy(buddy)
    return made


def button(
    name: str,
    words: Words | None = None,
    pressed: Callable[..., Any] | SignalInstance | None = None,
    *,
    kind: str = "",
    tip: Words | None = None,
) -> QPushButton:
    """Make a button.

    Parameters
    ----------
    name : object name
    words : its text; None if the caller sets it
    pressed : called, or emitted if it is a signal, at each click
    kind : of the style sheet, such as ``primary``
    tip : its tooltip
    """
    made = QPushButton()
    made.setObjectName(name)
    if kind:
        made.setProperty("kind", kind)
    if words is not None:
        bind(made, words)
    if tip is not None:
        bind(made.setToolTip, tip)
    if pressed is not None:
        made.clicked.connect(pressed)
    return made


def clear(layout: QLayout) -> None:
    """Remove all items of a layout, and delete their widgets."""
    while (item := layout.takeAt(0)) is not None:
        widget = item.widget()
        if widget is not None:
            widget.setParent(None)
            widget.deleteLater()


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
