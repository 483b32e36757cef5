"""What happens to two IMUs that are watched, and the schedule by which they are, in the language in force."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from PySide6.QtCore import QCoreApplication, QPointF, QRectF, QSize, Qt
from PySide6.QtGui import QColor, QPainter, QPaintEvent, QPen
from PySide6.QtWidgets import QSizePolicy, QWidget

from calstation.gui.logs.methods.figures import three_digits
from calstation.gui.text import duration_text, on_language_change, show
from calstation.gui.widgets import draw_state, state_colour, theme
from calstation.physics import DEGREE_PER_HOUR, MICRO_G
from calstation.results import PairProgress
from calstation.results.plots import PairEvent

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


def short_happening(h: PairEvent) -> str:
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
    reasons = [h.values["why"] for h in followed.happened if h.kind == "given_up"]
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
            painter.drawText(QRectF(left + 22, row.top(), verdicts, _ROW), Qt.AlignmentFlag.AlignVCenter, bar.verdict)

    def _open_end(self, painter: QPainter, right: float, middle: float) -> None:
        """The bar goes on: two slanted cuts near its end."""
        painter.setPen(QPen(QColor(theme.colours().panel), 3))
        for x in (right - 16, right - 9):
            painter.drawLine(QPointF(x - 3, middle + 9), QPointF(x + 3, middle - 9))


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
