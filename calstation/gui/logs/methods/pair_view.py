"""The views of IMUs on one body: check at rest, replay, stored calibrations, and residuals."""

from collections.abc import Mapping
from typing import Any

from PySide6.QtCore import QSignalBlocker, Signal
from PySide6.QtWidgets import QWidget

from calstation.gui.logs.methods.pair_parts import CheckBar, CheckBars, Timeline
from calstation.gui.logs.methods.plots import SENSOR_UNITS, Figure, MethodPlot, three_digits
from calstation.gui.text import on_language_change, say, term, with_minus
from calstation.gui.widgets import button, column, combo_box, label, panel, row, show_text, theme
from calstation.messages import Text, local_time
from calstation.physics import DEGREE, display, number, pair_name
from calstation.results import PairCheckResult, PairProgress, Parameter
from calstation.results.plots import PairPlotData, PairResiduals, SecondaryPlotData, StoredPairFile

_SENSORS = ("gyro", "accel")


def unit_bars(number: int, check: Mapping[str, Any] | None, after: Mapping[str, float | None]) -> list[CheckBar]:
    """Return the rows of a unit (0 is the primary); `after` contains the deviations after the calibration by sensor."""
    name = say("logs.imu" if number else "logs.primary", number=number)
    unit_check = check and check["secondary" if number else "primary"]
    return [_bar(name, s, unit_check and unit_check[s], after.get(s)) for s in _SENSORS]


def _bar(unit: str, sensor: str, check: Mapping[str, Any] | None, after: float | None) -> CheckBar:
    """Return the row of a sensor; `after` is its deviation after a calibration, if any."""
    name = f"{unit}  {term('sensor', sensor)}"
    if check is None:
        return CheckBar(name, 0.0, "–", "", say("logs.no_rest_to_check"), "none")
    verdict = say("logs.within" if check["within"] else "logs.out_of_tolerance")
    state = "good" if check["within"] else "bad"
    if not check["within"] and after is not None:
        good = after <= check["limit"]
        verdict = say("logs.calibrated_now" if good else "logs.calibrated_still", value=_deviation(sensor, after))
        state = "good" if good else "caution"
    limit = say("logs.at_most", limit=_deviation(sensor, check["limit"]))
    return CheckBar(name, check["value"] / check["limit"], _deviation(sensor, check["value"]), limit, verdict, state)


def stored_text(stored: StoredPairFile) -> str:
    """Return a description of a stored calibration, or of a secondary that has none."""
    if not stored.utc:
        return say("logs.nothing_stored", number=stored.number, serial=stored.serial)
    return say(
        "logs.last_calibrated",
        number=stored.number,
        serial=stored.serial,
        time=local_time(stored.utc),
        values=stored.values,
        file=stored.file,
    )


class PairCheckView(QWidget):
    """A view of the check at rest, the replay and the stored calibrations, which emits `check_requested()`."""

    check_requested = Signal()

    def __init__(self) -> None:
        super().__init__()
        self._data: PairPlotData | None = None
        self._schedule: Mapping[str, Any] = {}
        self._checked: PairCheckResult | None = None
        self.schedule_label, self._why = label(wrap=True), label(kind="caution", wrap=True)
        self._stored = label(name="pair_stored_label", wrap=True)
        self.bars, self.timeline = CheckBars(), Timeline()
        self.check_button = button("check_button", "logs.check_now", self.check_requested, tip="logs.replay_tip")
        self._explanation = label("logs.about_check_now", "muted", wrap=True)
        head = row(label("logs.monitoring", "section"), None, self.check_button)
        stored = row(label("logs.stored", "section"), (self._stored, 1), spacing=2 * theme.GRID)
        column(
            self.schedule_label,
            panel(label("logs.check_at_rest", "section"), self.bars),
            panel(head, self._explanation, self.timeline, self._why),
            stored,
            None,
            on=self,
            margins=(0, theme.GRID, 0, 0),
        )
        on_language_change(self, self._refresh)

    def show_data(self, data: PairPlotData, schedule: Mapping[str, Any]) -> None:
        """Show the check at rest of a solved recording, and the events of its triggers, if any."""
        self._data, self._schedule, self._checked = data, schedule, None
        end = PairProgress(data.duration, data.duration, "waiting", 0.0, data.events)
        self.timeline.show_progress(end if data.events else None)
        self._refresh()

    def show_progress(self, progress: PairProgress | None) -> None:
        """Show the progress of the replay."""
        self.timeline.show_progress(progress)
        self._explanation.setVisible(progress is None)
        self.timeline.setVisible(progress is not None)
        reasons = [] if progress is None else [h.values["why"] for h in progress.events if h.kind == "given_up"]
        show_text(self._why, say("logs.abandoned", reason=say(reasons[-1])) if reasons else "")

    def show_checked(self, checked: PairCheckResult) -> None:
        """Show the result of the replay."""
        self._checked = checked
        self.timeline.show_progress(checked.progress)
        self._refresh()

    def _refresh(self) -> None:
        if self._data is not None:
            self.schedule_label.setText(schedule_text(self._schedule))
            self.bars.show_bars(self._bars(self._data))
            stored = self._data.stored if self._checked is None else self._checked.stored
            self._stored.setText("\n".join(map(stored_text, stored)))
        self.show_progress(self.timeline.progress)

    def _bars(self, data: PairPlotData) -> list[CheckBar]:
        """Return the rows of all secondaries and of the primary from the last check."""
        bars = []
        check: Mapping[str, Any] | None = None
        events = data.events if self._checked is None else self._checked.progress.events
        calibrated = {(h.number, s) for h in events if h.kind == "calibrated" for s in h.values["sensors"]}
        for k, secondary in enumerate(data.secondaries):
            check, static = secondary.check, secondary.static
            if self._checked is not None:
                check = self._checked.checks.get(secondary.number, check)
                static = self._checked.stored[k].static
            after = {s: value for s, value in static.items() if (secondary.number, s) in calibrated}
            bars += unit_bars(secondary.number, check, after)
        return bars + unit_bars(0, check, {})


def _deviation(sensor: str, value: float) -> str:
    """Format a deviation at rest in its display unit."""
    unit, size = SENSOR_UNITS[sensor]
    return f"{three_digits(value / size)} {unit}"


def schedule_text(schedule: Mapping[str, Any]) -> str:
    """Return the trigger, the fitted terms and the thresholds of a schedule as a sentence."""
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
    fixed = _deviation(sensor, rule["fixed"])
    if rule.get("offset") is not None:
        return Text.of("pair.limit_offset", offset=_deviation(sensor, rule["offset"]), fixed=fixed)
    if rule.get("ratio") is not None:
        return Text.of("pair.limit_ratio", ratio=three_digits(rule["ratio"]), fixed=fixed)
    return Text.of("pair.limit_fixed", fixed=fixed)


class PairResidualsView(QWidget):
    """A view of the residuals of a secondary with respect to the primary, its clock offset and its lever arm."""

    def __init__(self) -> None:
        super().__init__()
        self._parameters: Mapping[str, Parameter] = {}
        self._calibrated: list[SecondaryPlotData] = []
        self.figures = [Figure(theme.SECTION) for _ in range(4)]
        self._plots = {sensor: MethodPlot(log=True) for sensor in _SENSORS}
        self._plots["accel"].setXLink(self._plots["gyro"])
        self.secondary_combo = combo_box("secondary_combo")
        self.secondary_combo.currentIndexChanged.connect(self._refresh)
        top = row(*self.figures, None, self.secondary_combo, spacing=3 * theme.GRID)
        column(top, *((plot, 1) for plot in self._plots.values()), on=self, margins=(0, theme.GRID, 0, 0))
        theme.on_appearance_change(self, self._refresh)

    def show_data(self, data: PairPlotData, parameters: Mapping[str, Parameter]) -> None:
        """Show the first calibrated secondary; the user can select the others."""
        self._parameters = parameters
        self._calibrated = [s for s in data.secondaries if s.residuals]
        with QSignalBlocker(self.secondary_combo):
            self.secondary_combo.clear()
            self.secondary_combo.addItems([f"{s.number}: {s.serial}" for s in self._calibrated])
        self.secondary_combo.setVisible(len(self._calibrated) > 1)
        self._refresh()

    def _refresh(self) -> None:
        self.secondary_combo.setAccessibleName(say("logs.secondary_shown"))
        for plot in self._plots.values():
            plot.empty()
        if not self._calibrated:
            for figure in self.figures:
                figure.show_text("", "")
            note = say("logs.nothing_calibrated"), theme.colours().muted
            self._plots["gyro"].finish([note])
            return
        secondary = self._calibrated[max(self.secondary_combo.currentIndex(), 0)]
        rates, forces = secondary.residuals["gyro"], secondary.residuals["accel"]
        self._draw("gyro", rates, say("logs.gyro_residual", number=secondary.number), DEGREE)
        self._draw("accel", forces, say("logs.accel_residual", number=secondary.number), 1.0)
        gyro, accel, clock, lever = self.figures
        gyro.show_change(say("logs.gyro_residual_rms"), rates.rms[0] / DEGREE, rates.rms[1] / DEGREE, "°/s")
        accel.show_change(say("logs.accel_residual_rms"), forces.rms[0], forces.rms[1], "m/s²")
        clock.show_text(say("logs.clock_offset"), self._values(["clock_offset"], secondary.number))
        levers = [f"secondary_lever_{axis}" for axis in "xyz"]
        lever.show_text(say("logs.lever_arm"), self._values(levers, secondary.number))

    def _draw(self, sensor: str, residuals: PairResiduals, title: str, size: float) -> None:
        plot, c = self._plots[sensor], theme.colours()
        plot.line(residuals.time, residuals.before / size, c.caution)
        plot.line(residuals.time, residuals.after / size, c.accent)
        legend = (say("logs.before"), c.caution), (say("logs.after"), c.accent), (say("logs.axis_from_start"), c.muted)
        plot.finish([(title, c.text), *legend])

    def _values(self, names: list[str], imu: int) -> str:
        """Format values with their unit, and a single value with its sigma; a missing value results in a dash."""
        texts, unit = [], ""
        for name in names:
            estimate = self._parameters.get(pair_name(name, imu))
            if estimate is None:
                return "–"
            value, unit = display(name, estimate.value)
            sigma = display(name, estimate.sigma)[0]
            with_sigma = with_minus(f"{number(value, sigma)} ± {number(sigma, sigma)}")
            texts.append(with_sigma if len(names) == 1 else three_digits(value))
        return f"{', '.join(texts)} {unit}"
