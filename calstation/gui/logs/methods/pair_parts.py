"""Widgets for the check of a pair: bars that compare deviations with thresholds, and a timeline of events."""

from collections.abc import Sequence
from dataclasses import dataclass

from PySide6.QtCore import QPointF, QRectF, Qt
from PySide6.QtGui import QColor, QPaintEvent, QPen
from PySide6.QtWidgets import QGridLayout, QWidget

from calstation.gui.text import duration_text, on_language_change, term
from calstation.gui.widgets import PlainLabel, StateBadge, clear, draw_state, label, state_colour, theme
from calstation.results import PairProgress, WatchEvent

#: Position of the threshold as a fraction of the full width of the bars; longer bars are clipped.
_THRESHOLD_AT = 0.5


@dataclass(frozen=True)
class CheckBar:
    """The deviation of a sensor: `share` is its ratio to the threshold, and `state` is its symbol (`badge.KINDS`)."""

    name: str
    share: float
    value: str
    limit: str
    verdict: str
    state: str


class CheckBars(QWidget):
    """A bar for each sensor, with aligned thresholds."""

    def __init__(self) -> None:
        super().__init__()
        self.bars: Sequence[CheckBar] = ()
        self._grid = QGridLayout(self)
        self._grid.setContentsMargins(0, 0, 0, 0)
        self._grid.setHorizontalSpacing(2 * theme.GRID)
        self._grid.setColumnStretch(1, 1)

    def show_bars(self, bars: Sequence[CheckBar]) -> None:
        """Show these rows."""
        if bars == self.bars:
            return
        self.bars = bars
        self.setAccessibleName("; ".join(f"{b.name}: {b.value} ({b.limit}), {b.verdict}" for b in bars))
        clear(self._grid)
        right = Qt.AlignmentFlag.AlignRight
        for line, bar in enumerate(bars):
            limit, verdict = label(kind="muted"), StateBadge()
            limit.setText(bar.limit)
            verdict.show_state(bar.state, bar.verdict)
            self._grid.addWidget(PlainLabel(bar.name), line, 0)
            self._grid.addWidget(_Bar(bar.share), line, 1)
            self._grid.addWidget(PlainLabel(bar.value), line, 2, right)
            self._grid.addWidget(limit, line, 3, right)
            self._grid.addWidget(verdict, line, 4)


class _Bar(QWidget):
    """A bar as long as the deviation, with a vertical line at the threshold."""

    def __init__(self, share: float) -> None:
        super().__init__()
        self._share = share
        self.setMinimumSize(8 * theme.GRID, 26)

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw the track, the bar and the threshold; two slanted lines mark a clipped bar."""
        c, width, middle = theme.colours(), float(self.width()), self.height() / 2.0
        painter = theme.painter(self)
        length = max(min(self._share * _THRESHOLD_AT, 1.0) * width, 2.0)
        painter.fillRect(QRectF(0, middle - 7, width, 14), QColor(c.track))
        painter.fillRect(QRectF(0, middle - 7, length, 14), state_colour("bad" if self._share > 1.0 else "good"))
        painter.setPen(QPen(QColor(c.text), 2))
        painter.drawLine(QPointF(_THRESHOLD_AT * width, 2), QPointF(_THRESHOLD_AT * width, self.height() - 2))
        if self._share * _THRESHOLD_AT > 1.0:
            painter.setPen(QPen(QColor(c.panel), 3))
            for x in (width - 16, width - 9):
                painter.drawLine(QPointF(x - 3, middle + 9), QPointF(x + 3, middle - 9))


_TOP, _MARK, _LANE = 26.0, 16.0, 22.0
_LANES = 2
#: Symbol of each kind of event (`badge.KINDS`); the last kind is the most important.
_STATES = {
    "triggered": "waiting",
    "checked": "none",
    "calibrating": "active",
    "primary_valid": "good",
    "primary_resumed": "good",
    "secondary_resumed": "good",
    "primary_off": "caution",
    "primary_silent": "caution",
    "secondary_silent": "caution",
    "alignment_lost": "caution",
    "calibrated": "good",
    "given_up": "bad",
    "not_stored": "bad",
}


class Timeline(QWidget):
    """A timeline with a symbol and a text for each event, in which overlapping items are merged or omitted."""

    def __init__(self) -> None:
        super().__init__()
        self.progress: PairProgress | None = None
        self.setFixedHeight(round(_TOP + _MARK + _LANES * _LANE))
        on_language_change(self, self.update)

    def show_progress(self, progress: PairProgress | None) -> None:
        """Show the progress of a replay."""
        self.progress = progress
        self.update()

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw the line, the symbols and texts of the events, and the state of the replay."""
        p = self.progress
        if p is None:
            return
        c = theme.colours()
        painter = theme.painter(self)
        painter.setFont(theme.font())
        left, line = 1.5 * theme.GRID, _TOP + _MARK / 2
        length = self.width() - 2.0 * left
        scale = length / max(p.duration, 1e-9)
        for colour, time in ((c.track, p.duration), (c.accent, min(p.time, p.duration))):
            painter.setPen(QPen(QColor(colour), 4))
            painter.drawLine(QPointF(left, line), QPointF(left + scale * time, line))
        top, middle = QRectF(0, 0, self.width(), _TOP - 4), Qt.AlignmentFlag.AlignVCenter
        painter.setPen(QColor(c.muted))
        painter.drawText(top, middle | Qt.AlignmentFlag.AlignRight, duration_text(p.duration))
        painter.setPen(QColor(c.text if p.time < p.duration else c.muted))
        painter.drawText(top, middle, _state_text(p) if p.time < p.duration else duration_text(0.0))
        ends = [0.0] * _LANES
        events = [(left + scale * h.time, h.kind, event_sentence(h)) for h in p.events]
        for x, kind, text in _merge_overlapping(events):
            width = painter.fontMetrics().horizontalAdvance(text) + theme.GRID
            begin = min(max(x - _MARK / 2, 0.0), self.width() - width)
            lane = next((k for k, end in enumerate(ends) if begin >= end), None)
            box = QRectF(x - _MARK / 2, line - _MARK / 2, _MARK, _MARK)
            painter.setPen(Qt.PenStyle.NoPen)
            painter.setBrush(QColor(c.panel))
            painter.drawEllipse(box.adjusted(-2, -2, 2, 2))
            painter.setBrush(Qt.BrushStyle.NoBrush)
            draw_state(painter, _STATES[kind], box)
            if lane is not None:
                ends[lane] = begin + width
                painter.setPen(QColor(c.text))
                painter.drawText(QRectF(begin, _TOP + _MARK + lane * _LANE + 2, width, _LANE), middle, text)


def event_sentence(event: WatchEvent) -> str:
    """Return the text of an event; a calibration names its sensors, and those that lack a reference in the primary."""
    code = "event_calibrated_partly" if event.values.get("skipped") else f"event_{event.kind}"
    return term("pair", code, number=event.number, **event.values)


def _state_text(progress: PairProgress) -> str:
    """Return the text of the current state of a replay."""
    state = "axes" if progress.state == "calibrating" and progress.motion >= 1.0 else progress.state
    return term("pair", f"state_{state}", percent=100.0 * progress.motion)


def _merge_overlapping(marks: list[tuple[float, str, str]]) -> list[tuple[float, str, str]]:
    """Merge overlapping marks (position, kind, text) into a mark with the most important of their kinds."""
    merged: list[tuple[float, str, str]] = []
    for x, kind, text in marks:
        if merged and x - merged[-1][0] < 1.5 * _MARK:
            first, before, texts = merged[-1]
            important = max((before, kind), key=list(_STATES).index)
            merged[-1] = (first, important, f"{texts}  ·  {text}")
        else:
            merged.append((x, kind, text))
    return merged
