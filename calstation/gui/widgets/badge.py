"""Widgets that show a state as a symbol and a word, and icons of the top bar; colours only support the symbols."""

from collections.abc import Callable
from functools import cache, partial

from PySide6.QtCore import QPointF, QRectF, QSize, Qt
from PySide6.QtGui import QColor, QIcon, QPainter, QPaintEvent, QPen, QPixmap, QPolygonF
from PySide6.QtWidgets import QSizePolicy, QWidget

from calstation.gui.widgets import theme
from calstation.gui.widgets.layout import ElidedLabel, PlainLabel, lay_out, row

#: Kinds of states, with the symbols ring, ring with a dot, filled triangle, tick, half-filled ring, cross, triangle
#: with an exclamation mark, two bars, square, and a tick that makes no statement about quality.
KINDS = ("none", "waiting", "active", "good", "partial", "bad", "caution", "paused", "stopped", "done")

#: Size of the icons of the top bar, px, and device pixels per px.
_SIZE, _RATIO = 24, 2


def state_colour(kind: str) -> QColor:
    """Return the colour of a kind of state in the current theme."""
    c = theme.colours()
    colours = {"good": c.good, "partial": c.partial, "bad": c.bad, "caution": c.caution, "paused": c.caution}
    return QColor({**colours, "active": c.accent}.get(kind, c.muted))


def draw_state(painter: QPainter, kind: str, box: QRectF, colour: QColor | None = None) -> None:
    """Draw the symbol of one of `KINDS`, by default in the colour of the state, as large as possible in a box."""
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

    if kind in ("good", "done"):
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
        if kind == "partial":
            painter.setBrush(colour)
            painter.drawChord(QRectF(at(0.16, 0.16), at(0.84, 0.84)), 90 * 16, 180 * 16)
        elif kind == "waiting":
            painter.setBrush(colour)
            painter.drawEllipse(QRectF(at(0.42, 0.42), at(0.58, 0.58)))
    painter.restore()


def state_icon(kind: str) -> QIcon:
    """Return the symbol of a state as an icon for cells and menus, with a variant for selected rows."""
    return _state_icon(kind, theme.current())


@cache
def _state_icon(kind: str, theme_name: str) -> QIcon:
    """Return an icon, cached per theme because tables request it at every repaint."""
    icon, box = QIcon(), QRectF(0, 0, theme.BODY, theme.BODY)
    on_selected = QColor(theme.colours().on_accent)
    for mode, colour in ((QIcon.Mode.Normal, None), (QIcon.Mode.Selected, on_selected)):
        draw = partial(draw_state, kind=kind, box=box, colour=colour)
        icon.addPixmap(painted_pixmap(theme.BODY, draw), mode)
    return icon


def padlock_icon(*, closed: bool) -> QIcon:
    """Return a padlock icon: closed for the operator, open for the engineer."""

    def draw(painter: QPainter) -> None:
        painter.setBrush(QColor(theme.colours().text))
        painter.drawRoundedRect(QRectF(5, 11, 14, 10), 2, 2)
        painter.setBrush(Qt.BrushStyle.NoBrush)
        if closed:
            painter.drawArc(QRectF(8, 3, 8, 12), 0, 180 * 16)
            painter.drawLine(QPointF(8, 9), QPointF(8, 11))
            painter.drawLine(QPointF(16, 9), QPointF(16, 11))
        else:
            painter.drawArc(QRectF(12, 2, 8, 12), 0, 180 * 16)
            painter.drawLine(QPointF(12, 8), QPointF(12, 11))

    return _text_icon(draw)


def theme_icon() -> QIcon:
    """Return the icon for switching the theme, a disc that is half light and half dark."""

    def draw(painter: QPainter) -> None:
        painter.drawEllipse(QRectF(4, 4, 16, 16))
        painter.setBrush(QColor(theme.colours().text))
        painter.drawChord(QRectF(4, 4, 16, 16), 90 * 16, 180 * 16)

    return _text_icon(draw)


def _text_icon(draw: Callable[[QPainter], None]) -> QIcon:
    def draw_lines(painter: QPainter) -> None:
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.setPen(QPen(QColor(theme.colours().text), 1.8))
        draw(painter)

    return QIcon(painted_pixmap(_SIZE, draw_lines))


def painted_pixmap(size: int, draw: Callable[[QPainter], None]) -> QPixmap:
    """Return a transparent square on which `draw` paints, at twice the resolution for high-DPI screens."""
    pixmap = QPixmap(_RATIO * size, _RATIO * size)
    pixmap.setDevicePixelRatio(_RATIO)
    pixmap.fill(Qt.GlobalColor.transparent)
    painter = QPainter(pixmap)
    draw(painter)
    painter.end()
    return pixmap


class StateIcon(QWidget):
    """The symbol of a state, without a word."""

    def __init__(self, size: int = 20) -> None:
        super().__init__()
        self._kind = "none"
        self.setFixedSize(QSize(size, size))

    def set_kind(self, kind: str) -> None:
        """Show another state."""
        if kind != self._kind:
            self._kind = kind
            self.update()

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw the symbol."""
        draw_state(QPainter(self), self._kind, QRectF(self.rect()).adjusted(1, 1, -1, -1))


class StateBadge(QWidget):
    """The symbol and the word of a state, side by side.

    If there is not enough space, the word takes several lines if `wrap`, and is shortened if `elided`.
    """

    def __init__(self, size: int = theme.BODY, name: str = "", *, wrap: bool = False, elided: bool = False) -> None:
        super().__init__()
        self.setObjectName(name)
        self._icon, self._word = StateIcon(), ElidedLabel() if elided else PlainLabel()
        self._word.setSizePolicy(QSizePolicy.Policy.Preferred, QSizePolicy.Policy.Preferred)
        self._word.setWordWrap(wrap)
        self.set_size(size)
        row(self._icon, (self._word, 1 if wrap else 0), on=self)
        if not wrap:
            self.setSizePolicy(QSizePolicy.Policy.Maximum, QSizePolicy.Policy.Fixed)

    def show_state(self, kind: str, word: str) -> None:
        """Show a state by its kind and word."""
        self._icon.set_kind(kind)
        if word != self._word.text():
            self._word.setText(word)
            lay_out(self)
        self.setAccessibleName(word)

    def set_size(self, size: int) -> None:
        """Change the size of the word, px."""
        self._icon.setFixedSize(QSize(size + 6, size + 6))
        self._word.setFont(theme.font(size, bold=True))

    def text(self) -> str:
        """Return the word."""
        return self._word.text()
