"""The process capability of the parameters with limits, and the distribution of the selected parameter."""

from collections.abc import Sequence

import numpy as np
import pyqtgraph as pg
from PySide6.QtWidgets import QWidget

from calstation.gui.text import on_language_change, parameter_text, say
from calstation.gui.widgets import (
    Cell,
    CellTable,
    DataView,
    ThemedPlot,
    column,
    dashed,
    label,
    set_subject,
    split,
    theme,
)
from calstation.messages import Text
from calstation.physics import display, number
from calstation.quality import ParameterQuality

#: Capability index that is usually required, and below which values are expected outside the limits.
_REQUIRED_INDEX, _MIN_INDEX = 1.33, 1.0
#: Half the width of the normal distribution in the plot, in standard deviations.
_HALF_WIDTH = 4.0
_COLUMNS = (
    Cell("quality.mean", "mean"),
    Cell("quality.sigma_within", "within"),
    Cell("quality.sigma_overall", "overall"),
    Cell("common.unit", "unit", number=False),
    Cell("quality.cp", "cp", hint="hint"),
    Cell("quality.cpk", "cpk", state="kind", hint="hint"),
    Cell("quality.pp", "pp", hint="hint"),
    Cell("quality.ppk", "ppk", hint="hint"),
    Cell("quality.outside", "outside"),
    Cell("quality.normal", "normal", number=False, hint="hint"),
)


class CapabilityView(QWidget):
    """A view of the capability indices of parameters relative to the limits of the product."""

    def __init__(self) -> None:
        super().__init__()
        self._charts: dict[str, ParameterQuality] = {}
        self.table = table = CellTable(
            "capability_table", "quality.capability_by_parameter", _COLUMNS, grouped=True, single=True
        )
        self.plot = Histogram()
        table.selectionModel().currentRowChanged.connect(lambda *_: self._draw())
        note = label(Text.of("quality.about_capability", required=_REQUIRED_INDEX), kind="muted", wrap=True)
        parts = split((table, 2), (self.plot, 1), handle=2 * theme.GRID)
        column(note, (parts, 1), on=self, margins=(0, theme.GRID, 0, 0))
        on_language_change(self, self._fill)

    def show_charts(self, charts: Sequence[ParameterQuality]) -> None:
        """Show the capability of the parameters that have limits."""
        self._charts = {each.parameter: each for each in charts if each.capability is not None}
        self._fill()
        if self._charts:
            self.table.selectRow(0)

    @property
    def empty(self) -> bool:
        """Whether there is nothing to show."""
        return not self._charts

    def _fill(self) -> None:
        cells = {}
        for name, charts in self._charts.items():
            capability = charts.capability
            if capability is None:
                continue
            size, unit = display(name, 1.0)
            digits = size * capability.sigma_overall
            indices = {"cp": capability.cp, "cpk": capability.cpk, "pp": capability.pp, "ppk": capability.ppk}
            lines = [f"{key.title()}: {i.low:.2f} … {i.value:.2f} … {i.high:.2f}" for key, i in indices.items()]
            cells[name] = {
                "mean": number(size * capability.mean, digits),
                "within": number(size * capability.sigma_within, digits),
                "overall": number(digits, digits),
                "unit": unit,
                **{key: f"{index.value:.2f}" for key, index in indices.items()},
                "kind": cpk_state(capability.cpk.value),
                "outside": str(capability.outside),
                "normal": say("quality.yes" if capability.normal else "quality.no"),
                "hint": "\n".join([*lines, say("quality.normality", probability=capability.normality_p)]),
            }
        self.table.show_cells(cells, ("mean", "within", "overall"))

    def _draw(self) -> None:
        if self.table.current_name:
            self.plot.show_data(self._charts[self.table.current_name])


def cpk_state(cpk: float) -> str:
    """Return the symbol of a capability index, "" if it is sufficient."""
    if cpk < _MIN_INDEX:
        return "bad"
    return "caution" if cpk < _REQUIRED_INDEX else ""


class Histogram(ThemedPlot, DataView[ParameterQuality]):
    """A histogram of a parameter with its limits and a normal distribution of equal mean and standard deviation."""

    def __init__(self) -> None:
        super().__init__(counts="left")
        theme.on_appearance_change(self, self.refresh)

    def draw(self, data: ParameterQuality) -> None:
        """Draw the values of a parameter with limits."""
        name, capability = data.parameter, data.capability
        if capability is None:
            return
        c = theme.colours()
        set_subject(self, name)
        self.getPlotItem().clear()
        size, unit = display(name, 1.0)
        values, mean, sigma = size * data.last_values, size * capability.mean, size * capability.sigma_overall
        self.setLabel("bottom", f"{parameter_text(name)}, {unit}")
        self.setLabel("left", say("quality.axis_runs"))
        counts, edges = np.histogram(values, bins="auto" if len(values) < 5000 else 60)
        width = edges[1] - edges[0]
        bars = pg.BarGraphItem(x0=edges[:-1], width=width, height=counts, brush=theme.faint(c.accent, 110), pen=c.line)
        self.addItem(bars)
        x = np.linspace(mean - _HALF_WIDTH * sigma, mean + _HALF_WIDTH * sigma, 200)
        density = np.exp(-0.5 * ((x - mean) / sigma) ** 2) / (sigma * np.sqrt(2.0 * np.pi)) * len(values) * width
        self.addItem(pg.PlotDataItem(x, density, pen=theme.pen(c.text, 1)))
        for limit in (capability.low, capability.high):
            self.addItem(pg.InfiniteLine(size * limit, 90, pen=dashed(c.bad)))
            self.addItem(pg.PlotDataItem([size * limit], [0.0], pen=pg.mkPen(None)))
