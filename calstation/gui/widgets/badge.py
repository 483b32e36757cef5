"""A state as a shape and a word; its colour only repeats them."""

from functools import cache

from PySide6.QtCore import QPointF, QRectF, QSize, Qt
from PySide6.QtGui import QColor, QIcon, QPainter, QPaintEvent, QPen, QPixmap, QPolygonF
from PySide6.QtWidgets import QHBoxLayout, QLabel, QSizePolicy, QWidget

from calstation.gui.widgets import theme

#: Ring, ring with a dot, filled triangle, tick, cross, triangle with a mark, two bars, square.
KINDS = ("none", "waiting", "active", "good", "bad", "caution", "paused", "stopped")


def state_colour(kind: str) -> QColor:
    """The colour that repeats what a state's shape says."""
    c = theme.colours()
    return QColor(
        {"good": c.good, "bad": c.bad, "caution": c.caution, "active": c.accent, "paused": c.caution}.get(
            kind, c.muted
        )
    )


def draw_state(painter: QPainter, kind: str, box: QRectF, colour: QColor | None = None) -> None:
    """Draw a state's shape into a square box."""
    colour = colour or state_colour(kind)
    side = min(box.width(), box.height())
    box = QRectF(box.center().x() - side / 2, box.center().y() - side / 2, side, side)
    painter.save()
    painter.setRenderHint(QPainter.RenderHint.Antialiasing)
    pen = QPen(colour, side * 0.11)
    pen.setCapStyle(Qt.PenCapStyle.RoundCap)
    pen.setJoinStyle(Qt.PenJoinStyle.RoundJoin)
    painter.setPen(pen)

    def at(x: float, y: float) -> QPointF:
        return QPointF(box.left() + x * side, box.top() + y * side)

    if kind == "good":
        painter.drawPolyline(QPolygonF([at(0.14, 0.54), at(0.40, 0.80), at(0.88, 0.22)]))
    elif kind == "bad":
        painter.drawLine(at(0.18, 0.18), at(0.82, 0.82))
        painter.drawLine(at(0.82, 0.18), at(0.18, 0.82))
    elif kind == "caution":
        painter.drawPolygon(QPolygonF([at(0.5, 0.1), at(0.94, 0.88), at(0.06, 0.88)]))
        painter.drawLine(at(0.5, 0.40), at(0.5, 0.58))
        painter.drawPoint(at(0.5, 0.74))
    elif kind == "active":
        painter.setBrush(colour)
        painter.drawPolygon(QPolygonF([at(0.26, 0.14), at(0.86, 0.5), at(0.26, 0.86)]))
    elif kind == "paused":
        painter.setBrush(colour)
        for x in (0.24, 0.62):
            painter.drawRect(QRectF(at(x, 0.16), at(x + 0.14, 0.84)))
    elif kind == "stopped":
        painter.setBrush(colour)
        painter.drawRect(QRectF(at(0.18, 0.18), at(0.82, 0.82)))
    else:
        painter.drawEllipse(QRectF(at(0.16, 0.16), at(0.84, 0.84)))
        if kind == "waiting":
            painter.setBrush(colour)
            painter.drawEllipse(QRectF(at(0.42, 0.42), at(0.58, 0.58)))
    painter.restore()


def state_icon(kind: str, size: int = theme.BODY) -> QIcon:
    """A state's shape for cells and menus, sharp on fine screens and seen on a selected row."""
    return _drawn_icon(kind, size, theme.current())


@cache
def _drawn_icon(kind: str, size: int, shown_in: str) -> QIcon:
    """Drawn once in each theme `shown_in`: a table asks for it at every repaint."""
    icon = QIcon()
    on_selected = QColor(theme.colours().on_accent)
    for mode, colour in ((QIcon.Mode.Normal, None), (QIcon.Mode.Selected, on_selected)):
        picture = QPixmap(2 * size, 2 * size)
        picture.setDevicePixelRatio(2)
        picture.fill(Qt.GlobalColor.transparent)
        painter = QPainter(picture)
        draw_state(painter, kind, QRectF(0, 0, size, size), colour)
        painter.end()
        icon.addPixmap(picture, mode)
    return icon


class StateIcon(QWidget):
    """A state's shape alone, for places where its word stands beside it."""

    def __init__(self, size: int = 20, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._kind = "none"
        self.setFixedSize(QSize(size, size))

    def set_kind(self, kind: str) -> None:
        """Show another state."""
        if kind != self._kind:
            self._kind = kind
            self.update()

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw the shape."""
        draw_state(QPainter(self), self._kind, QRectF(self.rect()).adjusted(1, 1, -1, -1))


class StateBadge(QWidget):
    """Shape and word side by side."""

    def __init__(self, size: int = theme.BODY, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._icon = StateIcon(size + 6)
        self._word = QLabel()
        self._word.setFont(theme.font(size, bold=True))
        layout = QHBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(theme.GRID)
        layout.addWidget(self._icon)
        layout.addWidget(self._word)
        self.setSizePolicy(QSizePolicy.Policy.Maximum, QSizePolicy.Policy.Fixed)

    def show_state(self, kind: str, word: str) -> None:
        """Show a state by its kind and word."""
        self._icon.set_kind(kind)
        self._word.setText(word)
        self.setAccessibleName(word)

    def set_size(self, size: int) -> None:
        """Another size of its word, px."""
        self._icon.setFixedSize(QSize(size + 6, size + 6))
        self._word.setFont(theme.font(size, bold=True))

    def text(self) -> str:
        """The word shown."""
        return self._word.text()
