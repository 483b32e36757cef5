"""IMUs on one body: the check at rest against thresholds, the replay, what is stored, and the residuals."""

from collections.abc import Mapping
from datetime import datetime
from typing import Any

from PySide6.QtCore import QSignalBlocker, Signal
from PySide6.QtWidgets import QComboBox, QWidget

from calstation.gui.logs.methods.figures import Figure, three_digits
from calstation.gui.logs.methods.pair_parts import CheckBar, CheckBars, Timeline
from calstation.gui.logs.methods.plots import MethodPlot
from calstation.gui.text import on_language_change, say, show, term
from calstation.gui.widgets import button, column, label, panel, row, theme
from calstation.messages import Text
from calstation.physics import DEGREE, DEGREE_PER_HOUR, MICRO_G, display, number, pair_name
from calstation.results import PairCheckResult, PairProgress, Parameter
from calstation.results.plots import PairPlotData, PairResiduals, SecondaryPlotData, StoredPairFile

_SENSORS = ("gyro", "accel")
#: Unit of a deviation at rest.
_UNITS = {"gyro": ("°/h", DEGREE_PER_HOUR), "accel": ("µg", MICRO_G)}


class PairCheckView(QWidget):
    """The check at rest, the replay and what is stored. `check_wanted()`: the button was pressed."""

    check_wanted = Signal()

    def __init__(self) -> None:
        super().__init__()
        self._data: PairPlotData | None = None
        self._schedule: Mapping[str, Any] = {}
        self._checked: PairCheckResult | None = None
        self.schedule_label, self._why = label(wrap=True), label(kind="caution", wrap=True)
        self._stored = label(name="pair_stored_label", wrap=True)
        self.bars, self.timeline = CheckBars(), Timeline()
        self.check_button = button(
            "check_button",
            lambda: self.tr("Check now"),
            self.check_wanted,
            tip=lambda: self.tr("Replays the recording: IMUs out of tolerance are calibrated, the results are stored"),
        )
        self._explanation = label(
            lambda: self.tr(
                "Check now replays this recording as if it were live: it checks at the first rest, and calibrates what "
                "is out of tolerance from the motion after it."
            ),
            "muted",
            wrap=True,
        )
        head = row(label(lambda: self.tr("Monitoring"), "section"), None, self.check_button)
        stored = row(label(lambda: self.tr("Stored"), "section"), (self._stored, 1), spacing=2 * theme.GRID)
        column(
            self.schedule_label,
            panel(label(lambda: self.tr("Check at rest"), "section"), self.bars),
            panel(head, self._explanation, self.timeline, self._why),
            stored,
            None,
            on=self,
            margins=(0, theme.GRID, 0, 0),
        )
        on_language_change(self, self._refresh)

    def show_answer(self, answer: MethodAnswer) -> None:
        """Show what a solved recording says at rest, and what its triggers led to where it has any."""
        self._answer, self._checked = answer, None
        picture = answer.picture
        assert isinstance(picture, PairPlotData)
        end = PairProgress(picture.duration, picture.duration, "waiting", 0.0, picture.events)
        self.timeline.show_followed(end if picture.events else None)
        self.retranslate()

    def show_progress(self, progress: PairProgress | None) -> None:
        """Show how far the replay is."""
        self.timeline.show_progress(progress)
        self._explanation.setVisible(progress is None)
        self.timeline.setVisible(progress is not None)
        reasons = [] if progress is None else [h.values["why"] for h in progress.happened if h.kind == "given_up"]
        self._why.setText(self.tr("Abandoned: {0}").format(show(reasons[-1])) if reasons else "")
        self._why.setVisible(bool(reasons))

    def show_checked(self, checked: PairCheckResult) -> None:
        """Show the end of the replay."""
        self._checked = checked
        self.timeline.show_followed(checked.progress)
        self.retranslate()

    @property
    def kept(self) -> tuple[StoredPairFile, ...]:
        """What is kept of the pairs at hand."""
        if self._checked is not None:
            return self._checked.stored
        picture = None if self._answer is None else self._answer.picture
        return picture.stored if isinstance(picture, PairPlotData) else ()

    def retranslate(self) -> None:
        """Say everything again in the language in force."""
        texts = self.tr("Check at rest"), self.tr("Watch"), self.tr("Kept")
        for head, text in zip(self._heads, texts, strict=True):
            head.setText(text)
        self.check_button.setText(self.tr("Check now"))
        self.check_button.setToolTip(
            self.tr("Follows the recording as if it were live: what is off is calibrated and kept")
        )
        self._unwatched.setText(
            self.tr(
                "Check now follows this recording as it would be followed live: a check at the first rest, and "
                "for what is off a calibration from the motion after it."
            )
        )
        if self._answer is not None:
            self.schedule_label.setText(word_schedule(self._answer.schedule))
            self.bars.show_bars(self._bars())
        self._kept.setText("\n".join(self._word_kept(kept) for kept in self.kept))
        self._show_watch(self.timeline.followed)

    def _show_watch(self, followed: PairProgress | None) -> None:
        self._unwatched.setVisible(followed is None)
        self.timeline.setVisible(followed is not None)
        why = "" if followed is None else why_given_up(followed)
        self._why.setText(self.tr("Given up: {0}").format(why) if why else "")
        self._why.setVisible(bool(why))

    def _bars(self) -> list[CheckBar]:
        assert self._answer is not None
        picture = self._answer.picture
        assert isinstance(picture, PairPlotData)
        bars: list[CheckBar] = []
        by_trigger = {h.number for h in picture.events if h.kind == "calibrated"}
        for place, secondary in enumerate(picture.secondaries):
            check: Mapping[str, Any] | None = secondary.check
            calibrated: Mapping[str, float | None] = {}
            if secondary.number in by_trigger:
                calibrated = secondary.static
            if self._checked is not None:
                check, calibrated = self._checked.checks.get(secondary.number, check), {}
                if secondary.number in self._checked.calibrated:
                    calibrated = self._checked.stored[place].static
            name = self.tr("IMU {0}").format(secondary.number)
            bars += [self._bar(name, s, check and check["secondary"][s], after.get(s)) for s in _SENSORS]
        return bars + [self._bar(self.tr("primary"), s, check and check["primary"][s], None) for s in _SENSORS]

    def _bar(self, unit: str, sensor: str, check: Mapping[str, Any] | None, after: float | None) -> CheckBar:
        """The row of a sensor; `after` is its deviation after a calibration."""
        name = f"{unit}  {term('sensor', sensor)}"
        if check is None:
            return CheckBar(name, 0.0, "–", "", self.tr("no rest to check at"), "none")
        verdict, state = (self.tr("within"), "good") if check["within"] else (self.tr("out of tolerance"), "bad")
        if not check["within"] and after is not None:
            good = after <= check["limit"]
            text = self.tr("calibrated: now {0}") if good else self.tr("calibrated, still {0}")
            verdict, state = text.format(_shown(sensor, after)), "good" if good else "caution"
        limit = self.tr("at most {0}").format(_shown(sensor, check["limit"]))
        return CheckBar(name, check["value"] / check["limit"], _shown(sensor, check["value"]), limit, verdict, state)

    def _stored_text(self, stored: StoredPairFile) -> str:
        if not stored.utc:
            return self.tr("IMU {0}, {1}: nothing is stored yet.").format(stored.number, stored.serial)
        when = datetime.fromisoformat(stored.utc).astimezone().strftime("%Y-%m-%d %H:%M")
        return self.tr("IMU {0}, {1}: last calibrated on {2}, {3} values in {4}").format(
            stored.number, stored.serial, when, stored.values, stored.file
        )


def _shown(sensor: str, value: float) -> str:
    """A deviation at rest in the unit people read."""
    unit, size = _UNITS[sensor]
    return f"{three_digits(value / size)} {unit}"


def _schedule_text(schedule: Mapping[str, Any]) -> str:
    """The schedule of checks and calibrations as sentences."""
    fitted = [Text(f"pair.model_{schedule['model']}")]
    if schedule["lever"] and schedule["model"] == "full":
        fitted.append(Text("pair.lever"))
    if schedule["clock_offset"]:
        fitted.append(Text("pair.clock_offset"))
    limits = []
    for s in _SENSORS:
        secondary, primary = (_threshold(s, schedule[f"{unit}_{s}"]) for unit in ("secondary", "primary"))
        limits.append(Text.of("pair.limit", sensor=s, secondary=secondary, primary=primary))
    return say(
        "pair.schedule",
        when=Text(f"pair.trigger_{schedule['trigger']}", {"period": schedule["period_s"]}),
        static=schedule["static_s"],
        which=Text(f"pair.sensors_{schedule['sensors']}"),
        fitted=fitted,
        motion=schedule["motion_s"],
        limits=limits,
    )


def _threshold(sensor: str, rule: Mapping[str, Any]) -> Text:
    fixed = _shown(sensor, rule["fixed"])
    if rule.get("offset") is not None:
        return Text.of("pair.limit_offset", offset=_shown(sensor, rule["offset"]), fixed=fixed)
    if rule.get("ratio") is not None:
        return Text.of("pair.limit_ratio", ratio=three_digits(rule["ratio"]), fixed=fixed)
    return Text.of("pair.limit_fixed", fixed=fixed)


class PairResidualsView(QWidget):
    """Residuals of a secondary against the primary over the recording, its clock offset and its lever arm."""

    def __init__(self) -> None:
        super().__init__()
        self._parameters: Mapping[str, Parameter] = {}
        self._calibrated: list[SecondaryPlotData] = []
        self.figures = [Figure(theme.SECTION) for _ in range(4)]
        self._plots = {sensor: MethodPlot(log=True) for sensor in _SENSORS}
        self._plots["accel"].setXLink(self._plots["gyro"])
        self.secondary_combo = QComboBox()
        self.secondary_combo.setObjectName("secondary_combo")
        self.secondary_combo.currentIndexChanged.connect(self._refresh)
        top = row(*self.figures, None, self.secondary_combo, spacing=3 * theme.GRID)
        column(top, *((plot, 1) for plot in self._plots.values()), on=self, margins=(0, theme.GRID, 0, 0))
        theme.on_appearance_change(self, self._refresh)

    def show_answer(self, answer: MethodAnswer) -> None:
        """Draw it, the first secondary that was calibrated; the others can be chosen."""
        self._answer = answer
        picture = answer.picture
        assert isinstance(picture, PairPlotData)
        self._calibrated = [s for s in picture.secondaries if s.residuals]
        with QSignalBlocker(self.secondary_combo):
            self.secondary_combo.clear()
            self.secondary_combo.addItems([f"{s.number}: {s.serial}" for s in self._calibrated])
        self.secondary_combo.setVisible(len(self._calibrated) > 1)
        self._refresh()

    def _refresh(self) -> None:
        self.secondary_combo.setAccessibleName(self.tr("Secondary shown"))
        for plot in self._plots.values():
            plot.empty()
        if not self._calibrated:
            for figure in self.figures:
                figure.show_text("", "")
            note = self.tr("Nothing was calibrated in this recording"), theme.colours().muted
            self._plots["gyro"].finish([note])
            return
        name = self.tr("IMU {0}").format(of.number)
        self._draw(
            self.gyro_plot, of.residuals["gyro"], self.tr("{0} gyro against the primary, °/s").format(name), _RATE
        )
        self._draw(
            self.accel_plot,
            of.residuals["accel"],
            self.tr("{0} accelerometer against the primary, m/s²").format(name),
            _FORCE,
        )
        gyro, accel, clock, lever = self.figures
        (before, after), (force, left) = of.residuals["gyro"].rms, of.residuals["accel"].rms
        gyro.show_change(self.tr("gyro left, rms"), before / _RATE, after / _RATE, "°/s")
        accel.show_change(self.tr("accelerometer left, rms"), force / _FORCE, left / _FORCE, "m/s²")
        clock.show_text(self.tr("clock offset"), self._told(answer, ["clock_offset"], of.number))
        levers = [f"secondary_lever_{axis}" for axis in "xyz"]
        lever.show_text(self.tr("lever arm x, y, z"), self._values(levers, secondary.number))

    def _draw(self, sensor: str, residuals: PairResiduals, title: str, size: float) -> None:
        plot, c = self._plots[sensor], theme.colours()
        plot.line(residuals.time, residuals.before / size, c.caution)
        plot.line(residuals.time, residuals.after / size, c.accent)
        legend = (self.tr("before"), c.caution), (self.tr("after"), c.accent), (self.tr("s from the start"), c.muted)
        plot.finish([(title, c.text), *legend])

    def _values(self, names: list[str], imu: int) -> str:
        """Values with their unit; one value alone with its sigma; a dash if they were not fitted."""
        texts, unit = [], ""
        for name in names:
            fitted = self._parameters.get(pair_name(name, imu))
            if fitted is None:
                return "–"
            value, unit = display(name, fitted.value)
            sigma = display(name, fitted.sigma)[0]
            alone = f"{number(value, sigma)} ± {number(sigma, sigma)}".replace("-", "−")
            texts.append(alone if len(names) == 1 else three_digits(value))
        return f"{', '.join(texts)} {unit}"
