"""Panel with the temperatures of chamber and units, what a run over temperature waits for, and its time left."""

import time

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Qt
from PySide6.QtGui import QColor, QShowEvent
from PySide6.QtWidgets import QFrame

from calstation.gui.state import RunStatus, chamber_reason, thing_text
from calstation.gui.text import bind, duration_text, say, with_minus
from calstation.gui.widgets import (
    PANEL,
    LineLabel,
    LineLabels,
    PlainLabel,
    StateIcon,
    ThemedPlot,
    column,
    grid,
    label,
    row,
    theme,
)
from calstation.sequencer import ChamberChanged

#: Minimum host time between two updates, s.
_DRAW_INTERVAL = 0.25
#: Minimum difference between set point and target during a ramp, K, minimum span of the temperature axis, K, and the
#: margin of this axis as a fraction of the span.
_RAMP, _MIN_SPAN, _MARGIN = 0.05, 5.0, 0.06
#: Axes whose colours are used for the air and the selected unit.
_AIR, _UNIT = "x", "y"


class TemperaturePanel(QFrame):
    """Shows the chamber of a run over temperature, and hides itself during other runs."""

    def __init__(self, run: RunStatus, prefix: str = "") -> None:
        super().__init__()
        self.setProperty("kind", "panel")
        self.setObjectName(f"{prefix}temperature_panel")
        self._run = run
        self._updated_at = 0.0
        self._icon, self.words = StateIcon(20), label(name=f"{prefix}temperature_words", wrap=True)
        self._names = [label(), label(), label(), label(), label()]
        #: Temperatures of air, set point and unit, rate of the unit, and time left.
        self.values = [PlainLabel() for _ in self._names]
        figures = grid(across=2 * theme.GRID, down=0)
        for number, (name, value) in enumerate(zip(self._names, self.values, strict=True)):
            value.setAlignment(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
            value.setFont(theme.font(bold=True))
            figures.addWidget(name, number, 0)
            figures.addWidget(value, number, 1)
        self._plot = ThemedPlot()
        self._plot.getAxis("left").setWidth(5 * theme.GRID)
        bind(self._plot.setAccessibleName, "common.over_temperature")
        self._air, self._set_point = (pg.PlotCurveItem(name=name) for name in ("air", "set_point"))
        for curve in (self._set_point, self._air):
            self._plot.addItem(curve)
        box = self._plot.getViewBox()
        box.sigTransformChanged.connect(self._label_lines)
        box.sigResized.connect(self._label_lines)
        self._units: dict[str, pg.PlotCurveItem] = {}
        self._labels = LineLabels(10 * theme.GRID)
        column(
            row((self._icon, 0, Qt.AlignmentFlag.AlignTop), (self.words, 1)),
            (row(column(figures, None), (self._plot, 1), self._labels, spacing=0), 1),
            on=self,
            spacing=theme.GRID // 2,
            margins=PANEL,
        )
        self.hide()
        theme.on_appearance_change(self, self.refresh)

    def start(self) -> None:
        """Prepare for a new run."""
        for curve in self._units.values():
            self._plot.removeItem(curve)
        self._units = {}
        self.hide()

    def add(self) -> None:
        """Show the latest temperatures of the chamber, at most four times per second."""
        self.show()
        if self.isVisible() and time.monotonic() - self._updated_at >= _DRAW_INTERVAL:
            self.refresh()

    def showEvent(self, event: QShowEvent) -> None:
        """Draw what was added while the panel was hidden."""
        super().showEvent(event)
        self.refresh()

    def refresh(self) -> None:
        """Show the state of the chamber in figures, words and curves."""
        latest = self._run.chamber.latest
        if latest is None:
            return
        self._updated_at = time.monotonic()
        kind, words = self._activity(latest)
        self._icon.set_kind(kind)
        self.words.setText(words)
        self._show_figures(latest)
        self._draw()

    def _activity(self, latest: ChamberChanged) -> tuple[str, str]:
        """Return the badge shape and the sentence for what the run waits for."""
        run, target = self._run, latest.target_c
        if run.chamber.must_stay_closed:
            return "caution", chamber_reason(run)
        if run.chamber.access == "open":
            return "good", say("operator.chamber_open")
        slowest = self._slowest(latest)
        if latest.limit is None:
            if abs(latest.set_point_c - target) < _RAMP:
                return "active", say("operator.chamber_moves", target=target)
            return "active", say("operator.chamber_ramp", target=target)
        if slowest is None:
            return "waiting", say("operator.chamber_soak_air", target=target, air=latest.air_c)
        slot, rate = slowest
        values = {"target": target, "unit": _unit_text(slot), "rate": abs(rate), "limit": latest.limit}
        steady = abs(rate) <= latest.limit
        return "waiting", say("operator.chamber_soak_steady" if steady else "operator.chamber_soak", **values)

    def _slowest(self, latest: ChamberChanged) -> tuple[str, float] | None:
        """Return the slot and the rate, K/min, of the unit that changes fastest, for which the others wait."""
        return max(latest.rates.items(), key=lambda item: abs(item[1]), default=None)

    def _show_figures(self, latest: ChamberChanged) -> None:
        slot = self._run.unit.slot
        unit, slowest = latest.units.get(slot), self._slowest(latest)
        names = [thing_text(None), say("operator.chamber_set_point"), thing_text(slot)]
        values = [_celsius(latest.air_c), _celsius(latest.set_point_c), "–" if unit is None else _celsius(unit)]
        names.append(say("operator.chamber_rate"))
        values.append("–")
        if slowest is not None:
            values[-1] = with_minus(f"{slowest[1]:.2f} °C/min")
            if slowest[0]:
                names[-1] = say("operator.chamber_rate_of", unit=_unit_text(slowest[0]))
        pace = self._run.pace
        names.append(say("operator.chamber_left"))
        waiting = pace is not None and self._run.chamber.access in ("", "closed") and latest.remaining > 0.0
        values.append(duration_text(latest.remaining / pace) if waiting and pace is not None else "–")
        for widgets, texts in ((self._names, names), (self.values, values)):
            for widget, text in zip(widgets, texts, strict=True):
                widget.setText(text)

    def _draw(self) -> None:
        track, c, selected = self._run.chamber.track, theme.colours(), self._run.unit.slot
        if not track.times:
            return
        minutes = (np.array(track.times) - track.times[0]) / 60.0
        self._air.setPen(theme.pen(theme.AXIS_COLOURS[_AIR], 1))
        self._set_point.setPen(theme.pen(c.text, 1, Qt.PenStyle.DashLine))
        self._air.setData(minutes, np.array(track.air))
        self._set_point.setData(minutes, np.array(track.set_point))
        for slot, values in track.units.items():
            if slot not in self._units:
                self._units[slot] = pg.PlotCurveItem(name=f"unit {slot}".strip(), connect="finite")
                self._plot.addItem(self._units[slot])
            is_selected = slot == selected
            self._units[slot].setPen(theme.pen(theme.AXIS_COLOURS[_UNIT] if is_selected else c.line, 1 + is_selected))
            self._units[slot].setZValue(is_selected)
            self._units[slot].setData(minutes, np.array(values))
        everything = np.concatenate([track.air, track.set_point, *track.units.values()])
        low, high = float(np.nanmin(everything)), float(np.nanmax(everything))
        margin = _MARGIN * max(high - low, _MIN_SPAN) + 0.5 * max(_MIN_SPAN - (high - low), 0.0)
        self._plot.setYRange(low - margin, high + margin, padding=0.0)
        self._plot.setXRange(0.0, max(0.1, float(minutes[-1])), padding=0.0)
        self._plot.setLabel("bottom", say("engineer.axis_time_min"))
        self._label_lines()

    def _label_lines(self) -> None:
        track, slot = self._run.chamber.track, self._run.unit.slot
        if not track.times:
            return
        box, c = self._plot.getViewBox(), theme.colours()
        ends = [
            (track.air[-1], thing_text(None), QColor(theme.axis_text(_AIR))),
            (track.set_point[-1], say("operator.chamber_set_point"), QColor(c.text)),
        ]
        if slot in track.units:
            ends.append((track.units[slot][-1], thing_text(slot), QColor(theme.axis_text(_UNIT))))
        self._labels.show_labels(
            [
                LineLabel(float(box.mapViewToScene(pg.Point(0.0, value)).y()), text, colour)
                for value, text, colour in ends
                if np.isfinite(value)
            ]
        )


def _unit_text(slot: str) -> str:
    """Return the unit within a sentence."""
    return say("operator.slot", slot=slot) if slot else say("operator.chamber_the_unit")


def _celsius(value: float) -> str:
    return with_minus(f"{value:.1f} °C")
