"""Functions and classes for layouts, labels, buttons, inputs and tabs, whose texts change with the language."""

from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Any, Generic, TypeVar

from PySide6.QtCore import QEvent, QObject, QSignalBlocker, QSize, Qt, SignalInstance
from PySide6.QtGui import QPainter, QPaintEvent, QResizeEvent
from PySide6.QtGui import Qt as QtText
from PySide6.QtWidgets import (
    QBoxLayout,
    QComboBox,
    QFrame,
    QGridLayout,
    QHBoxLayout,
    QLabel,
    QLayout,
    QLineEdit,
    QProgressBar,
    QPushButton,
    QScrollArea,
    QSizePolicy,
    QSplitter,
    QStackedWidget,
    QTabBar,
    QVBoxLayout,
    QWidget,
)

from calstation.gui.text import Words, bind, on_language_change, say
from calstation.gui.widgets import theme
from calstation.gui.widgets.text_area import TextArea

#: An item of a layout: a widget or layout, alone or in a tuple with its stretch and alignment, a distance in px, or
#: None for a stretch.
Item = QWidget | QLayout | tuple[Any, ...] | int | None

#: Left, top, right and bottom, px.
Margins = tuple[int, int, int, int]

#: Margins in a panel.
PANEL: Margins = (2 * theme.GRID, theme.GRID, 2 * theme.GRID, theme.GRID)

#: Steps of a progress bar.
STEPS = 1000

Box = TypeVar("Box", bound=QBoxLayout)
Data = TypeVar("Data")


class PlainLabel(QLabel):
    """A label that shows its text unchanged, even if the text looks like rich text."""

    def __init__(self, text: str = "") -> None:
        super().__init__()
        self.setTextFormat(Qt.TextFormat.PlainText)
        self.setText(text)


def plain_tip(text: str) -> str:
    """Return a tooltip that Qt shows as plain text."""
    return QtText.convertFromPlainText(text) if QtText.mightBeRichText(text) else text


def column(
    *items: Item, on: QWidget | None = None, spacing: int = theme.GRID, margins: Margins = (0, 0, 0, 0)
) -> QVBoxLayout:
    """Lay out items vertically, in the widget `on` if it is given; distances are in px."""
    return _filled(QVBoxLayout(), items, on, spacing, margins)


def row(
    *items: Item, on: QWidget | None = None, spacing: int = theme.GRID, margins: Margins = (0, 0, 0, 0)
) -> QHBoxLayout:
    """Lay out items horizontally, with the same arguments as `column`."""
    return _filled(QHBoxLayout(), items, on, spacing, margins)


def box(*items: Item, spacing: int = theme.GRID, margins: Margins = (0, 0, 0, 0)) -> QWidget:
    """Create a widget with items laid out vertically."""
    widget = QWidget()
    column(*items, on=widget, spacing=spacing, margins=margins)
    return widget


def grid(
    on: QWidget | None = None, *, across: int = theme.GRID, down: int = theme.GRID, stretch: int | None = None
) -> QGridLayout:
    """Create a grid layout, in the widget `on` if it is given; the column `stretch` takes the remaining width."""
    layout = QGridLayout()
    layout.setContentsMargins(0, 0, 0, 0)
    layout.setHorizontalSpacing(across)
    layout.setVerticalSpacing(down)
    if stretch is not None:
        layout.setColumnStretch(stretch, 1)
    if on is not None:
        on.setLayout(layout)
    return layout


def panel(*items: Item) -> QFrame:
    """Lay out items vertically in a framed panel."""
    frame = QFrame()
    frame.setProperty("kind", "panel")
    column(*items, on=frame, margins=PANEL)
    return frame


def scroll_area(content: QWidget, *, wide: bool = True, texts: bool = False) -> QScrollArea:
    """Create a frameless scroll area for contents that may be too high and, if `wide`, too wide.

    With `texts`, no line of text is cut at its lower edge.
    """
    area = TextArea() if texts else QScrollArea()
    area.setWidgetResizable(True)
    area.setFrameShape(QFrame.Shape.NoFrame)
    area.setProperty("kind", "clear")
    area.setWidget(content)
    if not wide:
        area.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
    return area


def stack(*pages: QWidget) -> QStackedWidget:
    """Create a stack of widgets, of which one is visible at a time."""
    stacked = QStackedWidget()
    for page in pages:
        stacked.addWidget(page)
    return stacked


def split(
    *parts: tuple[QWidget, int], handle: int = theme.GRID, along: Qt.Orientation = Qt.Orientation.Horizontal
) -> QSplitter:
    """Create a splitter, in which the user can change the sizes of the widgets."""
    splitter = QSplitter(along)
    splitter.setChildrenCollapsible(False)
    splitter.setHandleWidth(handle)
    for index, (widget, share) in enumerate(parts):
        splitter.addWidget(widget)
        splitter.setStretchFactor(index, share)
    splitter.setSizes([100 * share for _, share in parts])
    return splitter


class DataView(Generic[Data]):
    """Mixin for a widget that draws data; the widget must register `refresh` for changes of language or theme."""

    data: Data | None = None

    def show_data(self, data: Data) -> None:
        """Show new data."""
        self.data = data
        self.refresh()

    def refresh(self) -> None:
        """Draw the current data again, if any."""
        if self.data is not None:
            self.draw(self.data)

    def draw(self, data: Data) -> None:
        """Draw the data."""
        raise NotImplementedError


class ViewTabs(QTabBar):
    """A bar of tabs above the views of a page."""

    def __init__(self, name: str, *titles: Words) -> None:
        super().__init__()
        self.setObjectName(name)
        self.setProperty("kind", "views")
        self.setDrawBase(False)
        self.setExpanding(False)
        for title in titles:
            self.add(title)

    def add(self, title: Words) -> int:
        """Add a tab, and return its index."""
        index = self.addTab("")
        bind(partial(self.setTabText, index), title)
        return index

    def setTabVisible(self, index: int, visible: bool) -> None:
        """Show or hide a tab, and adapt the width of the bar."""
        super().setTabVisible(index, visible)
        self.updateGeometry()


def label(
    words: Words = "",
    kind: str = "",
    *,
    name: str = "",
    wrap: bool = False,
    buddy: QWidget | None = None,
    selectable: bool = False,
) -> PlainLabel:
    """Create a label.

    Parameters
    ----------
    words
        Text; "" if the caller sets it.
    kind
        Style, see `theme.set_kind`.
    name
        Object name.
    wrap, selectable
        Whether the text is wrapped, and whether it can be copied with the mouse.
    buddy
        The labelled input.
    """
    text_label = PlainLabel()
    text_label.setObjectName(name)
    text_label.setWordWrap(wrap)
    if kind:
        text_label.setProperty("kind", kind)
    if buddy is not None:
        text_label.setBuddy(buddy)
    if selectable:
        text_label.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
    if words:
        bind(text_label, words)
    return text_label


def button(
    name: str,
    words: Words = "",
    pressed: Callable[..., Any] | SignalInstance | None = None,
    *,
    kind: str = "",
    tip: Words = "",
) -> QPushButton:
    """Create a button; `words` is its text ("" if the caller sets it), and a click calls or emits `pressed`."""
    push_button = QPushButton()
    push_button.setObjectName(name)
    if kind:
        push_button.setProperty("kind", kind)
    if words:
        bind(push_button, words)
    if tip:
        bind(push_button.setToolTip, tip)
    if pressed is not None:
        push_button.clicked.connect(pressed)
    return push_button


def line_edit(
    name: str, changed: Callable[..., Any] | None = None, *, width: int = 0, longest: int = 0, hint: Words = ""
) -> QLineEdit:
    """Create a text input.

    Parameters
    ----------
    name
        Object name.
    changed
        Called on every edit by the user.
    width, longest
        Width, px, and maximum number of characters; 0 for the default.
    hint
        Text shown while the input is empty.
    """
    edit = QLineEdit()
    edit.setObjectName(name)
    if changed is not None:
        edit.textEdited.connect(changed)
    if width:
        edit.setFixedWidth(width)
    if longest:
        edit.setMaxLength(longest)
    if hint:
        bind(edit.setPlaceholderText, hint)
    return edit


def combo_box(name: str, items: Mapping[Any, Words] = {}, *, fit: bool = False, characters: int = 0) -> QComboBox:
    """Create a combo box; `items` maps the data of its items to their texts.

    The box is as wide as its longest item if `fit`, otherwise as wide as that number of `characters` unless this is 0.
    """
    combo = QComboBox()
    combo.setObjectName(name)
    combo.setMinimumContentsLength(characters)
    if fit:
        combo.setSizeAdjustPolicy(QComboBox.SizeAdjustPolicy.AdjustToContents)
    elif characters:
        combo.setSizeAdjustPolicy(QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon)
    for index, (data, words) in enumerate(items.items()):
        combo.addItem("", data)
        bind(partial(combo.setItemText, index), words)
    return combo


def fill_combo(combo: QComboBox, items: Iterable[tuple[str, Any]], current: Any = None) -> None:
    """Replace the items (text, data) without emitting signals, and select `current`, by default the current item."""
    current = combo.currentData() if current is None else current
    with QSignalBlocker(combo):
        combo.clear()
        for text, data in items:
            combo.addItem(text, data)
            if data == current:
                combo.setCurrentIndex(combo.count() - 1)


def progress_bar(height: int, name: str = "") -> QProgressBar:
    """Create a progress bar with `STEPS` steps and without a text."""
    bar = QProgressBar()
    bar.setObjectName(name)
    bar.setRange(0, STEPS)
    bar.setTextVisible(False)
    bar.setFixedHeight(height)
    return bar


def show_text(target: QLabel, text: str) -> None:
    """Show a text on a label, which is hidden while the text is empty."""
    target.setText(text)
    target.setVisible(bool(text))


def lay_out(*widgets: QWidget) -> None:
    """Activate the layouts of widgets, inner ones first, then those of the parents of the last widget.

    Otherwise, new texts would briefly be shown in the space of the previous texts.
    """
    for widget in widgets:
        around: QWidget | None = widget
        while around is not None:
            if (layout := around.layout()) is not None:
                layout.activate()
            around = around.parentWidget() if widget is widgets[-1] and not around.isWindow() else None


def clear(layout: QLayout) -> None:
    """Remove all items of a layout, and delete their widgets."""
    while (item := layout.takeAt(0)) is not None:
        widget = item.widget()
        if widget is not None:
            widget.hide()  # otherwise a widget that has not been shown yet would be shown as a window of its own
            widget.setParent(None)
            widget.deleteLater()


def enable(widget: QWidget, why_not: str, tip: str = "") -> None:
    """Enable a widget, or disable it with the reason as its tooltip; `tip` is the tooltip while it is enabled."""
    widget.setEnabled(not why_not)
    widget.setToolTip(plain_tip(why_not or tip))


#: Width that may remain free at the end of a line because the next word does not fit, px.
_WORD_WIDTH = 10 * theme.GRID


class ElidedLabel(PlainLabel):
    """A line of text that is shortened as `mode` states if it is too long; the tooltip shows the whole text.

    With word wrap, the text takes up to two lines before it is shortened.
    """

    def __init__(self, kind: str = "", mode: Qt.TextElideMode = Qt.TextElideMode.ElideRight) -> None:
        super().__init__()
        self._mode = mode
        if kind:
            self.setProperty("kind", kind)
        self.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred)

    def minimumSizeHint(self) -> QSize:
        """Return a size without a minimum width."""
        return QSize(0, super().minimumSizeHint().height())

    def setText(self, text: str) -> None:
        """Set the text and the tooltip."""
        if text != self.text():
            super().setText(text)
            self.setToolTip(plain_tip(text))

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw as much of the text as fits."""
        painter = QPainter(self)
        painter.setPen(self.palette().color(self.foregroundRole()))
        wrap = int(Qt.TextFlag.TextWordWrap) if self.wordWrap() else 0
        painter.drawText(self.rect(), int(self.alignment()) | wrap, self.shortened())

    def heightForWidth(self, width: int) -> int:
        """Return the height of one line or, with word wrap, of up to two lines."""
        return min(super().heightForWidth(width), 2 * self.fontMetrics().lineSpacing())

    def shortened(self) -> str:
        """Return as much of the text as fits."""
        metrics, width = self.fontMetrics(), self.width()
        if self.wordWrap() and self.height() >= 2 * metrics.lineSpacing():
            if super().heightForWidth(width) <= self.height():
                return self.text()
            width = 2 * width - _WORD_WIDTH
        return metrics.elidedText(self.text(), self._mode, width)


class PageArea(QScrollArea):
    """A scroll area filled by its contents, which scroll only if the area is smaller than their minimum size."""

    def __init__(self, content: QWidget) -> None:
        super().__init__()
        self.setFrameShape(QFrame.Shape.NoFrame)
        self.setProperty("kind", "clear")
        self._content = content
        self.setWidget(content)

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Fit the contents into the area."""
        super().resizeEvent(event)
        self._fit()

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Fit the contents again when their minimum size may have changed."""
        if watched is self._content and event.type() == QEvent.Type.LayoutRequest:
            self._fit()
        return super().eventFilter(watched, event)

    def _fit(self) -> None:
        available, minimum = self.maximumViewportSize(), self._content.minimumSizeHint()
        bar = self.verticalScrollBar().sizeHint().width()
        if minimum.height() > available.height():
            available.setWidth(available.width() - bar)
        if minimum.width() > available.width():
            available.setHeight(available.height() - bar)
        self._content.resize(available.expandedTo(minimum))


class EmptyState(QWidget):
    """A placeholder for an empty page, with a centred title, a short explanation, and widgets below them."""

    def __init__(self, *widgets: QWidget, title: Words = "", text: Words = "") -> None:
        super().__init__()
        self._title, self._text = label(kind="section", wrap=True), label(kind="muted", wrap=True)
        for each in (self._title, self._text):
            each.setAlignment(Qt.AlignmentFlag.AlignHCenter)
        middle = QWidget()
        middle.setFixedWidth(70 * theme.GRID)
        below = [(widget, 0, Qt.AlignmentFlag.AlignHCenter) for widget in widgets]
        box = column(self._title, self._text, *below, on=middle, spacing=2 * theme.GRID)
        box.insertStretch(0, 2)
        box.addStretch(3)
        row(None, middle, None, on=self)
        self._words = title, text
        on_language_change(self, self._refresh)

    @property
    def title(self) -> str:
        """The title."""
        return self._title.text()

    def say(self, title: Words, text: Words = "") -> None:
        """Show a title and a text, also after a change of language; an empty text is hidden."""
        self._words = title, text
        self._refresh()

    def _refresh(self) -> None:
        title, text = self._words
        self._title.setText(say(title))
        show_text(self._text, say(text))


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
