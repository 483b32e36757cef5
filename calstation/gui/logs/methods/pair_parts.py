"""Widgets of the pair check: deviations against their thresholds, and the events of a replayed recording over time."""

from collections.abc import Sequence
from dataclasses import dataclass

from PySide6.QtCore import QPointF, QRectF, Qt
from PySide6.QtGui import QColor, QPainter, QPaintEvent, QPen
from PySide6.QtWidgets import QGridLayout, QWidget

from calstation.estimation.pairs import WatchEvent
from calstation.gui.logs.methods.figures import three_digits
from calstation.gui.text import duration_text, on_language_change, show
from calstation.gui.widgets import draw_state, state_colour, theme
from calstation.physics import DEGREE_PER_HOUR, MICRO_G
from calstation.results import PairProgress

SENSORS = ("gyro", "accel")
_UNITS = {"gyro": ("°/h", DEGREE_PER_HOUR), "accel": ("µg", MICRO_G)}


def word_sensor(sensor: str) -> str:
    """Gyro or accelerometer."""
    return (
        QCoreApplication.translate("pairs", "gyro")
        if sensor == "gyro"
        else QCoreApplication.translate("pairs", "accelerometer")
    )


def shown(sensor: str, value: float) -> str:
    """What a sensor shows at rest, in the unit people read."""
    unit, size = _UNITS[sensor]
    return f"{three_digits(value / size)} {unit}"


def word_state(followed: PairProgress) -> str:
    """What is waited for now."""
    if followed.state == "checking":
        return QCoreApplication.translate("pairs", "waiting for a rest to check at")
    if followed.state == "calibrating" and followed.motion >= 1.0:
        return QCoreApplication.translate("pairs", "waiting for motion about all axes")
    if followed.state == "calibrating":
        return QCoreApplication.translate("pairs", "waiting for motion: {0} % collected").format(
            f"{100.0 * followed.motion:.0f}"
        )
    return QCoreApplication.translate("pairs", "following the recording")


def short_happening(h: WatchEvent) -> str:
    """What happened, in a few words."""
    name = QCoreApplication.translate("pairs", "IMU {0}").format(h.number)
    said = {
        "triggered": QCoreApplication.translate("pairs", "triggered"),
        "checked": QCoreApplication.translate("pairs", "{0} checked").format(name),
        "primary_off": QCoreApplication.translate("pairs", "primary off itself"),
        "calibrating": QCoreApplication.translate("pairs", "off: waiting for motion"),
        "calibrated": QCoreApplication.translate("pairs", "{0} calibrated").format(name),
        "given_up": QCoreApplication.translate("pairs", "given up"),
    }
    return said.get(h.kind, h.kind.replace("_", " "))


def why_given_up(followed: PairProgress) -> str:
    """Why the last calibration was given up, "" where none was."""
    reasons = [h.values["why"] for h in followed.events if h.kind == "given_up"]
    return show(reasons[-1]) if reasons else ""


def word_schedule(schedule: Mapping[str, Any]) -> str:
    """The schedule in force as sentences."""
    when = {
        "command": QCoreApplication.translate("pairs", "Checked by command"),
        "start_up": QCoreApplication.translate("pairs", "Checked at start-up"),
        "period": QCoreApplication.translate("pairs", "Checked at start-up and every {0} s").format(
            f"{schedule['period_s']:g}"
        ),
    }[schedule["trigger"]]
    which = {
        "all": QCoreApplication.translate("pairs", "then all of a secondary that is off is calibrated"),
        "triggering": QCoreApplication.translate("pairs", "then only the sensor that is off is calibrated"),
    }[schedule["sensors"]]
    fitted = {
        "bias": QCoreApplication.translate("pairs", "bias"),
        "scale": QCoreApplication.translate("pairs", "bias and scale factors"),
        "full": QCoreApplication.translate("pairs", "bias and full matrix"),
    }[schedule["model"]]
    more = [fitted]
    if schedule["lever"] and schedule["model"] == "full":
        more.append(QCoreApplication.translate("pairs", "lever arm"))
    if schedule["clock_offset"]:
        more.append(QCoreApplication.translate("pairs", "clock offset"))
    motion = QCoreApplication.translate("pairs", "from {0} s of motion").format(f"{schedule['motion_s']:g}")
    first = QCoreApplication.translate("pairs", "{0} at a rest of {1} s; {2} ({3}), {4}.").format(
        when, f"{schedule['static_s']:g}", which, QCoreApplication.translate("pairs", ", ").join(more), motion
    )
    limits = QCoreApplication.translate("pairs", "; ").join(
        QCoreApplication.translate("pairs", "{0} {1} (primary {2})").format(
            word_sensor(s),
            _threshold(s, schedule[f"secondary_{s}"]),
            _threshold(s, schedule[f"primary_{s}"]),
        )
        for s in SENSORS
    )
    return QCoreApplication.translate("pairs", "{0} Off is beyond: {1}.").format(first, limits)


def _threshold(sensor: str, rule: Mapping[str, Any]) -> str:
    fixed = shown(sensor, rule["fixed"])
    if rule.get("offset") is not None:
        return QCoreApplication.translate(
            "pairs", "what it showed after the last calibration + {0}, at first {1}"
        ).format(shown(sensor, rule["offset"]), fixed)
    if rule.get("ratio") is not None:
        return QCoreApplication.translate(
            "pairs", "{0} times what it showed after the last calibration, at first {1}"
        ).format(three_digits(rule["ratio"]), fixed)
    return fixed


_ROW = 30.0
#: Share of a bar's width at which its threshold lies; a longer bar ends in an open end.
_LIMIT_AT = 0.5


@dataclass(frozen=True)
class CheckBar:
    """The deviation of one sensor; share : of its threshold; state : shape of the verdict (`badge.KINDS`)."""

    name: str
    share: float
    value: str
    limit: str
    verdict: str
    state: str


class CheckBars(QWidget):
    """A row for each sensor; the thresholds are at the same position in all bars."""

    def __init__(self) -> None:
        super().__init__()
        self.bars: Sequence[CheckBar] = ()
        self._grid = QGridLayout(self)
        self._grid.setContentsMargins(0, 0, 0, 0)
        self._grid.setHorizontalSpacing(2 * theme.GRID)
        self._grid.setColumnStretch(1, 1)

    def show_bars(self, bars: Sequence[CheckBar]) -> None:
        """Show these rows."""
        self.bars = bars
        self.setAccessibleName("; ".join(f"{b.name}: {b.value} ({b.limit}), {b.verdict}" for b in bars))
        clear(self._grid)
        right = Qt.AlignmentFlag.AlignRight
        for line, bar in enumerate(bars):
            name, value, limit, verdict = label(), label(), label(kind="muted"), StateBadge()
            for text, made in ((bar.name, name), (bar.value, value), (bar.limit, limit)):
                made.setText(text)
            verdict.show_state(bar.state, bar.verdict)
            self._grid.addWidget(name, line, 0)
            self._grid.addWidget(_Bar(bar.share), line, 1)
            self._grid.addWidget(value, line, 2, right)
            self._grid.addWidget(limit, line, 3, right)
            self._grid.addWidget(verdict, line, 4)


class _Bar(QWidget):
    """A bar of a share of the threshold, which is a vertical line."""

    def __init__(self, share: float) -> None:
        super().__init__()
        self._share = share
        self.setMinimumSize(8 * theme.GRID, 26)

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw track, bar and threshold; two slanted cuts mark a bar that is too long."""
        c, width, middle = theme.colours(), float(self.width()), self.height() / 2.0
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        length = max(min(self._share * _LIMIT_AT, 1.0) * width, 2.0)
        painter.fillRect(QRectF(0, middle - 7, width, 14), QColor(c.line))
        painter.fillRect(QRectF(0, middle - 7, length, 14), state_colour("bad" if self._share > 1.0 else "good"))
        painter.setPen(QPen(QColor(c.text), 2))
        painter.drawLine(QPointF(_LIMIT_AT * width, 2), QPointF(_LIMIT_AT * width, self.height() - 2))
        if self._share * _LIMIT_AT > 1.0:
            painter.setPen(QPen(QColor(c.panel), 3))
            for x in (width - 16, width - 9):
                painter.drawLine(QPointF(x - 3, middle + 9), QPointF(x + 3, middle - 9))


_TOP, _MARK, _LANE = 26.0, 16.0, 22.0
_LANES = 2
#: The shape of each event (`badge.KINDS`), in ascending order of importance.
_STATES = {
    "triggered": "waiting",
    "checked": "none",
    "calibrating": "active",
    "primary_off": "caution",
    "calibrated": "good",
    "given_up": "bad",
}


class Timeline(QWidget):
    """A line of time with a mark and a text at every event; marks that would touch are joined."""

    def __init__(self) -> None:
        super().__init__()
        self.progress: PairProgress | None = None
        self.setFixedHeight(round(_TOP + _MARK + _LANES * _LANE))
        on_language_change(self, self.update)

    def show_progress(self, progress: PairProgress | None) -> None:
        """Show how far a recording has been replayed."""
        self.progress = progress
        self.update()

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw line, marks, texts, and the motion collected during the replay."""
        p = self.progress
        if p is None:
            return
        c = theme.colours()
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.setFont(theme.font())
        left, line = 1.5 * theme.GRID, _TOP + _MARK / 2
        length = self.width() - 2.0 * left
        scale = length / max(p.duration, 1e-9)
        for colour, time in ((c.line, p.duration), (c.accent, min(p.time, p.duration))):
            painter.setPen(QPen(QColor(colour), 4))
            painter.drawLine(QPointF(left, line), QPointF(left + scale * time, line))
        top, middle = QRectF(0, 0, self.width(), _TOP - 4), Qt.AlignmentFlag.AlignVCenter
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
        for x, kind, text in _gathered([(at(h.time), h.kind, short_happening(h)) for h in f.events]):
            width = metrics.horizontalAdvance(text) + theme.GRID
            begin = min(max(x - _MARK / 2, 0.0), self.width() - width)
            lane = next((k for k, end in enumerate(ends) if begin >= end), _LANES - 1)
            ends[lane] = begin + width
            box = QRectF(x - _MARK / 2, line - _MARK / 2, _MARK, _MARK)
            painter.setPen(Qt.PenStyle.NoPen)
            painter.setBrush(QColor(c.panel))
            painter.drawEllipse(box.adjusted(-2, -2, 2, 2))
            painter.setBrush(Qt.BrushStyle.NoBrush)
            draw_state(painter, _STATES[kind], box)
            painter.setPen(QColor(c.text))
            painter.drawText(QRectF(begin, _TOP + _MARK + lane * _LANE + 2, width, _LANE), middle, text)


def _state_text(progress: PairProgress) -> str:
    """What the replay waits for now."""
    state = "axes" if progress.state == "calibrating" and progress.motion >= 1.0 else progress.state
    return term("pair", f"state_{state}", percent=100.0 * progress.motion)


def _joined(marks: list[tuple[float, str, str]]) -> list[tuple[float, str, str]]:
    """Positions, kinds and texts, with marks that would touch joined in the shape of the most important."""
    joined: list[tuple[float, str, str]] = []
    for x, kind, text in marks:
        if joined and x - joined[-1][0] < 1.5 * _MARK:
            first, before, texts = joined[-1]
            important = max((before, kind), key=list(_STATES).index)
            joined[-1] = (first, important, f"{texts}  ·  {text}")
        else:
            joined.append((x, kind, text))
    return joined
