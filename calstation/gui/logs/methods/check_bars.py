"""What each sensor shows at rest against its threshold, as bars with value, limit and verdict."""

from collections.abc import Sequence
from dataclasses import dataclass

from PySide6.QtCore import QPointF, QRectF, QSize, Qt
from PySide6.QtGui import QColor, QPainter, QPaintEvent, QPen
from PySide6.QtWidgets import QSizePolicy, QWidget

from calstation.gui.widgets import draw_state, state_colour, theme

_ROW = 30.0
#: Share of a bar's width at which its threshold lies; a longer bar ends in an open end.
_LIMIT_AT = 0.5


@dataclass(frozen=True)
class CheckBar:
    """One sensor; share : of its threshold; state : shape of the verdict (`badge.KINDS`)."""

    name: str
    share: float
    value: str
    limit: str
    verdict: str
    state: str


class CheckBars(QWidget):
    """A row for each sensor; the thresholds stand in one line."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._bars: Sequence[CheckBar] = ()
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)

    @property
    def bars(self) -> Sequence[CheckBar]:
        """What is shown."""
        return self._bars

    def sizeHint(self) -> QSize:
        """As high as its rows."""
        return QSize(80 * theme.GRID, round(_ROW * max(len(self._bars), 1)))

    def minimumSizeHint(self) -> QSize:
        """Rows are never cut."""
        return QSize(60 * theme.GRID, self.sizeHint().height())

    def show_bars(self, bars: Sequence[CheckBar]) -> None:
        """Show these."""
        self._bars = bars
        said = "; ".join(f"{b.name}: {b.value} ({b.limit}), {b.verdict}" for b in bars)
        self.setAccessibleName(said)
        self.updateGeometry()
        self.update()

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw all rows, columns as wide as their longest word."""
        if not self._bars:
            return
        c = theme.colours()
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.setFont(theme.font())
        metrics = painter.fontMetrics()

        def widest(texts: Sequence[str]) -> float:
            return max(metrics.horizontalAdvance(text) for text in texts) + 2.0 * theme.GRID

        names = widest([b.name for b in self._bars])
        values, limits = widest([b.value for b in self._bars]), widest([b.limit for b in self._bars])
        verdicts = widest([b.verdict for b in self._bars]) + 3.0 * theme.GRID
        width = max(self.width() - names - values - limits - verdicts, 8.0 * theme.GRID)
        for k, bar in enumerate(self._bars):
            row = QRectF(0, k * _ROW, self.width(), _ROW)
            middle, colour = row.center().y(), state_colour(bar.state)
            painter.setPen(QColor(c.text))
            painter.drawText(QRectF(0, row.top(), names, _ROW), Qt.AlignmentFlag.AlignVCenter, bar.name)
            track = QRectF(names, middle - 7, width, 14)
            painter.fillRect(track, QColor(c.line))
            length = min(bar.share * _LIMIT_AT, 1.0) * width
            measured = state_colour("bad" if bar.share > 1.0 else "good")
            painter.fillRect(QRectF(names, middle - 7, max(length, 2.0), 14), measured)
            at = names + _LIMIT_AT * width
            painter.setPen(QPen(QColor(c.text), 2))
            painter.drawLine(QPointF(at, row.top() + 2), QPointF(at, row.bottom() - 2))
            if bar.share * _LIMIT_AT > 1.0:
                self._open_end(painter, names + width, middle)
            painter.setPen(QColor(c.text))
            right = names + width
            side = Qt.AlignmentFlag.AlignVCenter | Qt.AlignmentFlag.AlignRight
            painter.drawText(QRectF(right, row.top(), values, _ROW), side, bar.value)
            painter.setPen(QColor(c.muted))
            painter.drawText(QRectF(right + values, row.top(), limits, _ROW), side, bar.limit)
            left = right + values + limits + theme.GRID
            draw_state(painter, bar.state, QRectF(left, middle - 8, 16, 16))
            painter.setPen(colour)
            painter.drawText(
                QRectF(left + 22, row.top(), verdicts, _ROW), Qt.AlignmentFlag.AlignVCenter, bar.verdict
            )

    def _open_end(self, painter: QPainter, right: float, middle: float) -> None:
        """The bar goes on: two slanted cuts near its end."""
        painter.setPen(QPen(QColor(theme.colours().panel), 3))
        for x in (right - 16, right - 9):
            painter.drawLine(QPointF(x - 3, middle + 9), QPointF(x + 3, middle - 9))
