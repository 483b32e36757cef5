"""How two IMUs are watched: what happened along the recording's time, and the motion collected so far."""

from PySide6.QtCore import QPointF, QRectF, QSize, Qt
from PySide6.QtGui import QColor, QPainter, QPaintEvent, QPen
from PySide6.QtWidgets import QSizePolicy, QWidget

from calstation.gui.logs.methods.pair_wording import short_happening, word_state
from calstation.gui.text import duration_text, on_language_change
from calstation.gui.widgets import draw_state, theme
from calstation.results import PairProgress

_TOP, _MARK, _LANE = 26.0, 16.0, 22.0
_LANES = 2
#: The shape of each happening (`badge.KINDS`); what tells more comes later.
_STATES = {
    "triggered": "waiting",
    "checked": "none",
    "calibrating": "active",
    "primary_off": "caution",
    "calibrated": "good",
    "given_up": "bad",
}


class Timeline(QWidget):
    """A line of time with a mark and a word at everything that happened; those that would touch stand together."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._followed: PairProgress | None = None
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)
        on_language_change(self, self.update)

    @property
    def followed(self) -> PairProgress | None:
        """What is shown."""
        return self._followed

    def sizeHint(self) -> QSize:
        """Room for the line and its words."""
        return QSize(80 * theme.GRID, round(_TOP + _MARK + _LANES * _LANE))

    def show_followed(self, followed: PairProgress | None) -> None:
        """Show how far a recording has been followed."""
        self._followed = followed
        self.update()

    def paintEvent(self, event: QPaintEvent) -> None:
        """Line, marks, words, and the motion collected while it runs."""
        f = self._followed
        if f is None:
            return
        c = theme.colours()
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.setFont(theme.font())
        metrics = painter.fontMetrics()
        left, right = 1.5 * theme.GRID, self.width() - 1.5 * theme.GRID
        line = _TOP + _MARK / 2

        def at(time: float) -> float:
            return left + (right - left) * min(max(time / max(f.duration, 1e-9), 0.0), 1.0)

        painter.setPen(QPen(QColor(c.line), 4))
        painter.drawLine(QPointF(left, line), QPointF(right, line))
        painter.setPen(QPen(QColor(c.accent), 4))
        painter.drawLine(QPointF(left, line), QPointF(at(f.time), line))
        painter.setPen(QColor(c.muted))
        top = QRectF(0, 0, self.width(), _TOP - 4)
        side = Qt.AlignmentFlag.AlignVCenter
        painter.drawText(top, side | Qt.AlignmentFlag.AlignRight, duration_text(f.duration))
        running = f.time < f.duration
        if running:
            painter.setPen(QColor(c.text))
            painter.drawText(top, side | Qt.AlignmentFlag.AlignLeft, word_state(f))
        else:
            painter.drawText(top, side | Qt.AlignmentFlag.AlignLeft, duration_text(0.0))
        taken: list[float] = []
        for x, kind, text in _gathered([(at(h.time), h.kind, short_happening(h)) for h in f.happened]):
            width = metrics.horizontalAdvance(text) + theme.GRID
            begin = min(max(x - _MARK / 2, 0.0), self.width() - width)
            lane = next((k for k, end in enumerate(taken) if begin >= end), len(taken))
            lane = min(lane, _LANES - 1)
            taken[lane : lane + 1] = [begin + width]
            y = _TOP + _MARK + lane * _LANE
            box = QRectF(x - _MARK / 2, line - _MARK / 2, _MARK, _MARK)
            painter.setPen(Qt.PenStyle.NoPen)
            painter.setBrush(QColor(c.panel))
            painter.drawEllipse(box.adjusted(-2, -2, 2, 2))
            painter.setBrush(Qt.BrushStyle.NoBrush)
            draw_state(painter, _STATES.get(kind, "none"), box)
            painter.setPen(QColor(c.text))
            painter.drawText(QRectF(begin, y + 2, width, _LANE), side, text)


def _gathered(marks: list[tuple[float, str, str]]) -> list[tuple[float, str, str]]:
    """Marks that would touch as one, in the shape of what tells most: place, kind, words."""
    gathered: list[tuple[float, str, str]] = []
    for x, kind, text in marks:
        if gathered and x - gathered[-1][0] < 1.5 * _MARK:
            first, before, said = gathered[-1]
            tells = max((before, kind), key=list(_STATES).index)
            gathered[-1] = (first, tells, f"{said}  ·  {text}")
        else:
            gathered.append((x, kind, text))
    return gathered
