"""A scroll area whose lower edge does not cut through a line of text."""

from collections.abc import Iterator

from PySide6.QtCore import QEvent, QObject, QPoint, QSize, Qt, QTimer
from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import QFrame, QLabel, QScrollArea, QVBoxLayout, QWidget


class TextArea(QScrollArea):
    """A scroll area whose lower edge is between two lines of text, because half a line cannot be read."""

    def __init__(self) -> None:
        super().__init__()
        self.verticalScrollBar().valueChanged.connect(lambda _: self._end_between_lines())

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Find the lower edge for the new size."""
        super().resizeEvent(event)
        self._end_between_lines()

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Find the lower edge again after the contents have been laid out."""
        ended = super().eventFilter(watched, event)
        if watched is self.widget() and event.type() in (QEvent.Type.LayoutRequest, QEvent.Type.Resize):
            self._end_between_lines()
        return ended

    def _end_between_lines(self) -> None:
        bar = self.horizontalScrollBar()
        space = self.height() - (bar.height() if bar.isVisible() else 0)
        end = lowest = self.verticalScrollBar().value() + space
        for top, bottom in sorted(self._lines(), reverse=True):
            if top < end < bottom:
                end = top
        content = self.widget()
        # where all of the text fits, a cut would show the scroll bar, without which the text fits again, and so on
        scrolls = content is not None and content.height() > space
        cut = lowest - end if scrolls and lowest - end < space // 2 else 0
        if cut != self.viewportMargins().bottom():
            self.setViewportMargins(0, 0, 0, cut)

    def _lines(self) -> Iterator[tuple[int, int]]:
        """Yield the top and the bottom of each line of the labels."""
        content = self.widget()
        if content is None:
            return
        for each in content.findChildren(QLabel):
            if not (each.text() and each.isVisibleTo(content)):
                continue
            height = each.heightForWidth(each.width()) if each.wordWrap() else each.sizeHint().height()
            count = max(1, height // each.fontMetrics().lineSpacing())  # a line may be higher by a pixel
            top = each.mapTo(content, QPoint(0, 0)).y()
            if not each.alignment() & Qt.AlignmentFlag.AlignTop:
                top += max(0, each.height() - height) // 2
            for number in range(count):
                yield top + number * height // count, top + (number + 1) * height // count


class ShrinkingText(TextArea):
    """A text area as high as its text, which scrolls if its layout has less space; the caller hides an empty one."""

    #: Number of lines for which there is always space.
    _MIN_LINES = 2

    def __init__(self, text: QLabel) -> None:
        super().__init__()
        self._text, content = text, QWidget()
        layout = QVBoxLayout(content)
        layout.setContentsMargins(0, 0, 0, 0)
        text.setAlignment(Qt.AlignmentFlag.AlignTop)
        layout.addWidget(text)
        self.setFrameShape(QFrame.Shape.NoFrame)
        self.setProperty("kind", "clear")
        self.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.setWidgetResizable(True)
        self.setWidget(content)

    def sizeHint(self) -> QSize:
        """Return a size for all lines at the current width."""
        return QSize(self._text.sizeHint().width(), max(0, self._text.heightForWidth(self.width())))

    def minimumSizeHint(self) -> QSize:
        """Return a size for the first lines."""
        lines = self._MIN_LINES * self._text.fontMetrics().lineSpacing()
        return QSize(self._text.minimumSizeHint().width(), min(lines, self.sizeHint().height()))

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Adapt the height to the new width."""
        super().resizeEvent(event)
        if event.size().width() != event.oldSize().width():
            self.updateGeometry()

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Adapt the height to a new text or font."""
        if watched is self.widget() and event.type() == QEvent.Type.LayoutRequest:
            self.updateGeometry()
            QTimer.singleShot(0, self, self._end_between_lines)  # after the text has been laid out
        return super().eventFilter(watched, event)
