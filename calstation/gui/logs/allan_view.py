"""The Allan deviation of a range of a log at rest, and the derived noise, which can be stored in the IMU profile."""

import csv
from functools import partial
from pathlib import Path

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QWidget

from calstation.config import Version, computer_user, save_noise
from calstation.gui.logs.methods import MethodPlot
from calstation.gui.state import Page
from calstation.gui.text import duration_text, say, term
from calstation.gui.widgets import (
    Choice,
    Column,
    EmptyState,
    JobRow,
    ParameterModel,
    ParameterTable,
    align_columns,
    button,
    column,
    enable,
    label,
    row,
    stack,
    theme,
)
from calstation.messages import Text
from calstation.physics import CHANNELS, DEGREE_PER_HOUR, MICRO_G, NOISE_DISPLAY, FloatArray
from calstation.results.plots import FLOOR, AllanCurve, AllanDeviation, allan_deviation

#: Unit of the deviation of each sensor, and its size in SI.
_UNITS = {"gyro": ("°/h", DEGREE_PER_HOUR), "accel": ("µg", MICRO_G)}
#: Entries of `[noise]` of each sensor: its random walk and its bias instability.
_ENTRIES = {
    "gyro": ("gyro_arw", "gyro_bias_instability"),
    "accel": ("accel_vrw", "accel_bias_instability"),
}


class AllanPlot(MethodPlot):
    """The Allan deviations of the three axes of a sensor with their 95 % bands, and the profile's noise."""

    def __init__(self, sensor: str) -> None:
        super().__init__(log=True, log_x=True)
        self._sensor = sensor
        self._shown: AllanDeviation | None = None

    def show_deviation(self, found: AllanDeviation) -> None:
        """Draw the deviations."""
        self._shown = found
        self.empty()
        unit, size = _UNITS[self._sensor]
        c, walk, instability = theme.colours(), *(found.noise[name] / size for name in _ENTRIES[self._sensor])
        curves = self._curves()
        for axis, curve in curves.items():
            low, high = (
                pg.PlotCurveItem(np.log10(curve.tau), np.log10(bound / size)) for bound in (curve.low, curve.high)
            )
            self.addItem(pg.FillBetweenItem(low, high, brush=theme.faint(theme.AXIS_COLOURS[axis], 40)))
        for axis, curve in curves.items():
            self.line(curve.tau, curve.deviation / size, theme.AXIS_COLOURS[axis])
        if curves:
            tau = next(iter(curves.values())).tau
            step = found.quantisation[self._sensor == "accel"] / size
            for name, values, at, anchor in (
                (say("logs.random_walk_line"), walk / np.sqrt(tau), -1, (1.0, 0.0)),
                (say("logs.bias_instability_line"), np.full(len(tau), FLOOR * instability), 0, (0.0, 1.0)),
                (say("logs.quantisation"), step / (2.0 * tau), len(tau) // 2, (1.0, 0.0)),
            ):
                if values[0] > 0.0:
                    self._profile_line(name, tau, values, at, anchor)
            self.span(np.array([walk / np.sqrt(tau[-1]), FLOOR * instability]))
        self.setLabel("left", unit)
        self.setLabel("bottom", say("logs.averaging_time"))
        title = say("logs.gyro" if self._sensor == "gyro" else "logs.accel")
        letters = [(f"<b>{axis}</b>", theme.axis_text(axis)) for axis in curves]
        self.finish([(title, c.text), *letters, (say("logs.profile_line"), c.muted)])

    def write_csv(self, target: Path) -> None:
        """Write the deviations and their bounds, SI, in one row per averaging time."""
        curves = self._curves()
        names = ("deviation", "low", "high")
        with target.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(["tau_s", *(f"{self._sensor}_{axis}_{name}" for axis in curves for name in names)])
            columns = [getattr(curve, name) for curve in curves.values() for name in names]
            writer.writerows(np.column_stack([next(iter(curves.values())).tau, *columns]).tolist())

    def _curves(self) -> dict[str, AllanCurve]:
        assert self._shown is not None
        found = {axis: self._shown.curves.get(f"{self._sensor}_{axis}") for axis in "xyz"}
        return {axis: curve for axis, curve in found.items() if curve is not None}

    def _profile_line(
        self, name: str, tau: FloatArray, values: FloatArray, at: int, anchor: tuple[float, float]
    ) -> None:
        """Draw a line of the profile with its name at one of its points."""
        colour = theme.colours().muted
        pen = pg.mkPen(colour, width=1, style=Qt.PenStyle.DashLine)
        self.addItem(pg.PlotDataItem(tau, values, pen=pen, name=name))
        text = pg.TextItem(name, color=colour, anchor=anchor)
        text.setFont(theme.font(11))
        text.setPos(float(np.log10(tau[at])), float(np.log10(values[at])))
        self.addItem(text, ignoreBounds=True)


class AllanView(QWidget):
    """Computes and shows Allan deviations; `closed` is emitted by its Back button."""

    closed = Signal()

    def __init__(self, page: Page) -> None:
        super().__init__()
        self._app, self._notice = page.app, page.notice
        self.found: AllanDeviation | None = None
        self._cells: dict[str, dict[str, str]] = {}
        close = self.closed.emit
        self.watch = page.job(
            allan_deviation, self._show, failure="logs.no_allan_deviation", failed=lambda _: close(), cancelled=close
        )
        self.saving = page.job(
            save_noise, self._saved, failure="logs.values_not_saved", then=self.setFocus, cancellable=False
        )
        self._plots = AllanPlot("gyro"), AllanPlot("accel")
        self._about = label(wrap=True, name="allan_label")
        hint = label("logs.about_missing_noise", "muted", wrap=True)
        self._table = self._make_table()
        self._take_button = button("take_noise_button", "logs.take_values", self._ask)
        copy = button("copy_noise_button", "common.copy_table", self._table.copy)
        back = button("allan_back_button", "logs.back", self.closed)
        job = JobRow(self.watch, "allan_cancel_button")
        content, self._working = QWidget(), EmptyState(job, title="logs.computing_allan_deviation")
        column(
            row((self._about, 1), copy, self._take_button, back),
            (row(*((plot, 1) for plot in self._plots)), 1),
            self._table,
            hint,
            on=content,
        )
        self._stack = stack(content, self._working)
        column(self._stack, on=self, margins=(theme.GRID, 0, 0, 0))
        self.saving.busy_changed.connect(self._update)
        self._app.role.changed.connect(lambda _: self._update())
        self._app.engine_link.running_changed.connect(lambda _: self._update())
        theme.on_appearance_change(self, self._refresh)

    def compute(self, path: Path, first_seq: int, last_seq: int) -> None:
        """Compute the Allan deviations of a range of a log."""
        self._stack.setCurrentWidget(self._working)
        self.watch.start(path, first_seq, last_seq)

    def _make_table(self) -> ParameterTable:
        def cell(heading: str, key: str, number: bool = True) -> Column:
            return Column(heading, lambda name: self._cells[name][key], number)

        columns = [Column("logs.channel", self._channel_text, number=False)]
        for number, heading in enumerate(("logs.random_walk", "logs.bias_instability")):
            columns.append(cell(heading, f"value{number}"))
            columns.append(cell("logs.profile", f"profile{number}", number=False))
        table = ParameterTable(ParameterModel(columns))
        table.setObjectName("allan_table")
        table.verticalHeader().hide()
        table.verticalHeader().setDefaultSectionSize(3 * theme.GRID)
        return table

    def _channel_text(self, channel: str) -> str:
        sensor, _, axis = channel.partition("_")
        return say(f"logs.{sensor}_axis", axis=axis)

    def _show(self, found: AllanDeviation) -> None:
        self.found = found
        self._cells = {name: _cells(found, name, curve) for name, curve in found.curves.items()}
        align_columns(self._cells, ("value0", "value1"))
        self._table.parameters.set_names([name for name in CHANNELS if name in found.curves])
        header = self._table.horizontalHeader().sizeHint().height()
        self._table.setFixedHeight(header + 3 * theme.GRID * len(found.curves) + theme.GRID // 2)
        self._stack.setCurrentIndex(0)
        self._refresh()

    def _refresh(self) -> None:
        found = self.found
        if found is not None:
            for plot in self._plots:
                plot.show_deviation(found)
            duration = duration_text(found.seconds)
            values = {"serial": found.serial, "duration": duration, "first": found.first_seq, "last": found.last_seq}
            self._about.setText(say("logs.rest", **values))
        self._update()

    # ---- values for the profile

    @property
    def _values(self) -> dict[str, float]:
        """The entries of `[noise]` determined by all three axes: the largest value of each, SI."""
        found = self.found
        if found is None:
            return {}
        values = {}
        for sensor, names in _ENTRIES.items():
            curves = [found.curves[f"{sensor}_{axis}"] for axis in "xyz" if f"{sensor}_{axis}" in found.curves]
            for name, key in zip(names, ("random_walk", "instability"), strict=True):
                measured = [getattr(curve, key) for curve in curves]
                if measured and None not in measured:
                    values[name] = max(measured)
        return values

    def _why_not_take(self) -> str:
        if not self._app.role.engineer:
            return say("engineer.new_pin_needed" if self._app.role.new else "engineer.pin_needed")
        if self._app.engine_link.running or self.saving.busy:
            return say("window.busy_job")
        if self.found is None or self.found.profile is None:
            return say("logs.no_profile_named")
        return "" if self._values else say("logs.rest_too_short")

    def _update(self) -> None:
        enable(self._take_button, self._why_not_take(), say("logs.take_tip"))

    def _change_text(self) -> str:
        """Return the values before and after the change, and the unchanged ones."""
        assert self.found is not None
        parts = []
        for name, value in self._values.items():
            _, unit, size = NOISE_DISPLAY[name]
            parts.append(f"{term('form', name)} {self.found.noise[name] / size:.3g} → {value / size:.3g} {unit}")
        text = "; ".join(parts) + "\n" + say("logs.largest_of_axes")
        kept = [term("form", name) for name in NOISE_DISPLAY if name not in self._values]
        return text + (" " + say("logs.kept_values", names=", ".join(kept)) if kept else "")

    def _ask(self) -> None:
        found = self.found
        assert found is not None
        save = partial(self._save, found, self._values)
        self._notice.ask(
            "caution",
            Text.of("logs.ask_profile_version", profile=found.profile),
            self._change_text,
            (
                Choice("cancel_noise_button", "common.cancel", self.setFocus),
                Choice("save_noise_button", "common.save", save, primary=True),
            ),
        )

    def _save(self, found: AllanDeviation, values: dict[str, float]) -> None:
        assert found.profile is not None
        author = str(self._app.settings.value("author", "")).strip() or computer_user() or "engineer"
        source = f"Allan deviation of {found.serial}, {found.seconds:.0f} s"
        self.saving.start(found.profile, values, source, author)

    def _saved(self, version: Version) -> None:
        self._app.product_changed.emit()
        self._notice.inform(
            "good",
            Text.of("logs.profile_saved", number=version.number, profile=version.name),
            "logs.about_saved_profile",
            self.setFocus,
        )


def _cells(found: AllanDeviation, channel: str, curve: AllanCurve) -> dict[str, str]:
    """Return the texts of a channel's row: each derived value, and the profile's value with the unit."""
    cells = {}
    bound = f"≤ {curve.largest_instability / _UNITS[channel.partition('_')[0]][1]:.2g}"
    for number, (name, value, other) in enumerate(
        zip(_ENTRIES[channel.partition("_")[0]], (curve.random_walk, curve.instability), ("–", bound), strict=True)
    ):
        _, unit, size = NOISE_DISPLAY[name]
        cells[f"value{number}"] = other if value is None else f"{value / size:.3g}"
        cells[f"profile{number}"] = f"{found.noise[name] / size:.3g} {unit}" if found.noise[name] else f"– {unit}"
    return cells
