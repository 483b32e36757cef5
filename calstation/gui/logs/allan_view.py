"""The Allan deviation of a log at rest, and the noise derived from it, which can be saved in the IMU profile."""

import csv
from functools import partial
from pathlib import Path

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Signal
from PySide6.QtWidgets import QWidget

from calstation.config import Version, save_noise
from calstation.gui.logs.methods import SENSOR_UNITS, MethodPlot
from calstation.gui.state import Page
from calstation.gui.text import duration_text, say, term
from calstation.gui.widgets import (
    Cell,
    CellTable,
    Choice,
    DataView,
    EmptyState,
    JobRow,
    box,
    button,
    column,
    dashed,
    enable,
    label,
    row,
    stack,
    theme,
)
from calstation.messages import Text, plain_number
from calstation.physics import CHANNELS, NOISE_DISPLAY, FloatArray
from calstation.results.plots import FLOOR, AllanCurve, AllanDeviation, allan_deviation

#: Entries of `[noise]` for the random walk and the bias instability of each sensor.
_ENTRIES = {"gyro": ("gyro_arw", "gyro_bias_instability"), "accel": ("accel_vrw", "accel_bias_instability")}
_COLUMNS = (
    Cell("logs.channel", "channel", number=False),
    Cell("logs.random_walk", "value0"),
    Cell("logs.profile", "profile0", number=False),
    Cell("logs.bias_instability", "value1"),
    Cell("logs.profile", "profile1", number=False),
)


class AllanPlot(MethodPlot, DataView[AllanDeviation]):
    """A plot of the Allan deviations of the axes of a sensor, their 95 % bands, and the noise in the profile."""

    def __init__(self, sensor: str) -> None:
        super().__init__(log=True, log_x=True)
        self._sensor = sensor

    def draw(self, data: AllanDeviation) -> None:
        """Draw the deviations."""
        self.empty()
        unit, size = SENSOR_UNITS[self._sensor]
        c, walk, instability = theme.colours(), *(data.noise[name] / size for name in _ENTRIES[self._sensor])
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
            step = data.quantisation[self._sensor == "accel"] / size
            self.span(np.array([walk / np.sqrt(tau[-1]), FLOOR * instability]))
            low, high = self.limits
            quantisation = step / (2.0 * tau)
            visible = np.flatnonzero((quantisation >= low) & (quantisation <= high))
            middle = int(visible[len(visible) // 2]) if len(visible) else None
            for name, values, at, anchor in (
                (say("logs.random_walk_line"), walk / np.sqrt(tau), -1, (1.0, 0.0)),
                (say("logs.bias_instability_line"), np.full(len(tau), FLOOR * instability), 0, (0.0, 1.0)),
                (say("logs.quantisation"), quantisation, middle, (0.0, 1.0)),
            ):
                if values[0] > 0.0:
                    self._profile_line(name, tau, values, at, anchor)
        self.setLabel("left", unit)
        self.setLabel("bottom", say("logs.averaging_time"))
        title = say("logs.gyro" if self._sensor == "gyro" else "logs.accel")
        letters = [(f"<b>{axis}</b>", theme.axis_text(axis)) for axis in curves]
        self.finish([(title, c.text), *letters, (say("logs.profile_line"), c.muted)])

    def write_csv(self, target: Path) -> None:
        """Write the deviations and their bounds in SI, one row per averaging time."""
        curves = self._curves()
        names = ("deviation", "low", "high")
        with target.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(["tau_s", *(f"{self._sensor}_{axis}_{name}" for axis in curves for name in names)])
            columns = [getattr(curve, name) for curve in curves.values() for name in names]
            writer.writerows(np.column_stack([next(iter(curves.values())).tau, *columns]).tolist())

    def _curves(self) -> dict[str, AllanCurve]:
        curves = {} if self.data is None else self.data.curves
        return {axis: curves[f"{self._sensor}_{axis}"] for axis in "xyz" if f"{self._sensor}_{axis}" in curves}

    def _profile_line(
        self, name: str, tau: FloatArray, values: FloatArray, at: int | None, anchor: tuple[float, float]
    ) -> None:
        """Draw a line for a value in the profile, with its name at the point with index `at` unless that is None."""
        colour = theme.colours().muted
        self.addItem(pg.PlotDataItem(tau, values, pen=dashed(colour), name=name))
        if at is None:
            return
        text = pg.TextItem(name, color=colour, anchor=anchor)
        text.setFont(theme.font(11))
        text.setPos(float(np.log10(tau[at])), float(np.log10(values[at])))
        self.addItem(text, ignoreBounds=True)


class AllanView(QWidget, DataView[AllanDeviation]):
    """A view that computes and shows the Allan deviations of a range of a log; its Back button emits `closed`."""

    closed = Signal()

    def __init__(self, page: Page) -> None:
        super().__init__()
        self._app, self._notice = page.app, page.notice
        close = self.closed.emit
        self.watch = page.job(
            allan_deviation,
            self.show_data,
            failure="logs.no_allan_deviation",
            failed=lambda _: close(),
            cancelled=close,
        )
        self.saving = page.job(
            save_noise, self._show_saved, failure="logs.values_not_saved", then=self.setFocus, cancellable=False
        )
        self._plots = AllanPlot("gyro"), AllanPlot("accel")
        self._about = label(wrap=True, name="allan_label")
        hint = label("logs.about_missing_noise", "muted", wrap=True)
        self._table = CellTable("allan_table", columns=_COLUMNS, grouped=True, named=False, row=3 * theme.GRID)
        self._save_button = button("take_noise_button", "logs.take_values", self._ask_save)
        copy = button("copy_noise_button", "common.copy_table", self._table.copy)
        back = button("allan_back_button", "logs.back", self.closed)
        job = JobRow(self.watch, "allan_cancel_button")
        self._working = EmptyState(job, title="logs.computing_allan_deviation")
        head, plots = row((self._about, 1), copy, self._save_button, back), row(*((plot, 1) for plot in self._plots))
        self._stack = stack(box(head, (plots, 1), self._table, hint), self._working)
        column(self._stack, on=self, margins=(theme.GRID, 0, 0, 0))
        self.saving.busy_changed.connect(self._update)
        self._app.role.changed.connect(lambda _: self._update())
        self._app.engine_link.running_changed.connect(lambda _: self._update())
        theme.on_appearance_change(self, self.refresh)

    def compute(self, path: Path, first_seq: int, last_seq: int) -> None:
        """Compute the Allan deviations of a range of a log."""
        self._stack.setCurrentWidget(self._working)
        self.watch.start(path, first_seq, last_seq)

    def draw(self, data: AllanDeviation) -> None:
        """Draw the deviations and list the derived noise."""
        for plot in self._plots:
            plot.show_data(data)
        cells = {name: _cells(data, name, data.curves[name]) for name in CHANNELS if name in data.curves}
        self._table.show_cells(cells, ("value0", "value1"))
        header = self._table.horizontalHeader().sizeHint().height()
        self._table.setFixedHeight(header + 3 * theme.GRID * len(cells) + theme.GRID // 2)
        self._stack.setCurrentIndex(0)
        values = {"serial": data.serial, "first": data.first_seq, "last": data.last_seq}
        self._about.setText(say("logs.rest", duration=duration_text(data.seconds), **values))
        self._update()

    # ---- values for the profile

    @property
    def _values(self) -> dict[str, float]:
        """The entries of `[noise]` that all three axes determine, each the largest value of the axes, SI."""
        data = self.data
        if data is None:
            return {}
        values = {}
        for sensor, names in _ENTRIES.items():
            curves = [data.curves[f"{sensor}_{axis}"] for axis in "xyz" if f"{sensor}_{axis}" in data.curves]
            for name, key in zip(names, ("random_walk", "instability"), strict=True):
                measured = [getattr(curve, key) for curve in curves]
                if measured and None not in measured:
                    values[name] = max(measured)
        return values

    def _why_not_save(self) -> str:
        if not self._app.role.engineer:
            return say("engineer.new_pin_needed" if self._app.role.new else "engineer.pin_needed")
        if self._app.engine_link.running or self.saving.busy:
            return say("window.busy_job")
        if self.data is None or self.data.profile is None:
            return say("logs.no_profile_named")
        return "" if self._values else say("logs.rest_too_short")

    def _update(self) -> None:
        enable(self._save_button, self._why_not_save(), say("logs.take_tip"))

    def _change_text(self, data: AllanDeviation) -> str:
        """Return a text that lists the changed values before and after the change, and the unchanged ones."""
        parts = []
        for name, value in self._values.items():
            _, unit, size = NOISE_DISPLAY[name]
            before, after = (plain_number(each / size, ".3g") for each in (data.noise[name], value))
            parts.append(f"{term('form', name)} {before} → {after} {unit}")
        text = "; ".join(parts) + "\n" + say("logs.largest_of_axes")
        unchanged = [term("form", name) for name in NOISE_DISPLAY if name not in self._values]
        return text + (" " + say("logs.kept_values", names=", ".join(unchanged)) if unchanged else "")

    def _ask_save(self) -> None:
        data = self.data
        if data is None or data.profile is None:
            return
        save = partial(self._save, data, self._values)
        self._notice.ask(
            "caution",
            Text.of("logs.ask_profile_version", profile=data.profile),
            partial(self._change_text, data),
            (
                Choice("cancel_noise_button", "common.cancel", self.setFocus),
                Choice("save_noise_button", "common.save", save, primary=True),
            ),
        )

    def _save(self, data: AllanDeviation, values: dict[str, float]) -> None:
        source = f"Allan deviation of {data.serial}, {data.seconds:.0f} s"
        self.saving.start(data.profile, values, source, self._app.author)

    def _show_saved(self, version: Version) -> None:
        self._app.product_changed.emit()
        self._notice.inform(
            "good",
            Text.of("logs.profile_saved", number=version.number, profile=version.name),
            "logs.about_saved_profile",
            self.setFocus,
        )


def _cells(data: AllanDeviation, channel: str, curve: AllanCurve) -> dict[str, str]:
    """Return the cells of a channel: the derived values, and the values in the profile with their units."""
    sensor, _, axis = channel.partition("_")
    cells = {"channel": say(f"logs.{sensor}_axis", axis=axis)}
    bound = f"≤ {plain_number(curve.largest_instability / SENSOR_UNITS[sensor][1], '.2g')}"
    for number, (name, value, fallback) in enumerate(
        zip(_ENTRIES[sensor], (curve.random_walk, curve.instability), ("–", bound), strict=True)
    ):
        _, unit, size = NOISE_DISPLAY[name]
        cells[f"value{number}"] = fallback if value is None else plain_number(value / size, ".3g")
        stated = plain_number(data.noise[name] / size, ".3g") if data.noise[name] else "–"
        cells[f"profile{number}"] = f"{stated} {unit}"
    return cells
