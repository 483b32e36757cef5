"""Process capability of every parameter with limits, and the distribution of the selected one."""

from collections.abc import Sequence

import numpy as np
import pyqtgraph as pg
from PySide6.QtWidgets import QAbstractItemView, QWidget

from calstation.gui.text import bind, on_language_change, parameter_text, say
from calstation.gui.widgets import CellTable, ThemedPlot, column, dashed, label, split, theme
from calstation.messages import Text
from calstation.physics import display, number
from calstation.quality import Interval, ParameterQuality

#: Smallest capability index that is usually required.
_REQUIRED = 1.33
#: Half width of the drawn normal distribution, in standard deviations.
_DRAWN = 4.0


class CapabilityView(QWidget):
    """Shows the capability indices of the parameters of runs relative to the limits of their product."""

    def __init__(self) -> None:
        super().__init__()
        self._found: dict[str, ParameterQuality] = {}
        self.table = table = CellTable("capability_table", grouped=True)
        self.plot = Histogram()
        bind(table.setAccessibleName, "quality.capability_by_parameter")
        table.setSelectionMode(QAbstractItemView.SelectionMode.SingleSelection)
        text = table.column
        table.parameters.set_columns(
            (
                text("quality.mean", "mean"),
                text("quality.sigma_within", "within"),
                text("quality.sigma_overall", "overall"),
                text("common.unit", "unit", number=False),
                text("quality.cp", "cp", hint=self._hint),
                text("quality.cpk", "cpk", hint=self._hint),
                text("quality.pp", "pp", hint=self._hint),
                text("quality.ppk", "ppk", hint=self._hint),
                text("quality.outside", "outside"),
                text("quality.normal", "normal", number=False, hint=self._hint),
            )
        )
        table.selectionModel().currentRowChanged.connect(lambda current, _: self._choose(current.row()))
        note = label(Text.of("quality.about_capability", required=_REQUIRED), kind="muted", wrap=True)
        column(
            note,
            (split((table, 2), (self.plot, 1), handle=2 * theme.GRID), 1),
            on=self,
            margins=(0, theme.GRID, 0, 0),
        )
        on_language_change(self, self._fill)

    def show_charts(self, charts: Sequence[ParameterQuality]) -> None:
        """Show the capability of quantities that have limits."""
        self._found = {each.parameter: each for each in charts if each.capability is not None}
        self._fill()
        if self._found:
            self.table.selectRow(0)

    @property
    def empty(self) -> bool:
        """Return whether there is nothing to show."""
        return not self._found

    def _fill(self) -> None:
        cells = {}
        for name, charts in self._found.items():
            found = charts.capability
            assert found is not None
            size, unit = display(name, 1.0)
            digits = size * found.sigma_overall
            cells[name] = {
                "mean": number(size * found.mean, digits),
                "within": number(size * found.sigma_within, digits),
                "overall": number(digits, digits),
                "unit": unit,
                "cp": _index(found.cp),
                "cpk": _index(found.cpk),
                "pp": _index(found.pp),
                "ppk": _index(found.ppk),
                "outside": str(found.outside),
                "normal": say("quality.yes" if found.normal else "quality.no"),
            }
        self.table.show_cells(cells, ("mean", "within", "overall"))

    def _hint(self, name: str) -> str:
        found = self._found[name].capability
        assert found is not None
        indices = (("Cp", found.cp), ("Cpk", found.cpk), ("Pp", found.pp), ("Ppk", found.ppk))
        lines = [f"{key}: {i.low:.2f} … {i.value:.2f} … {i.high:.2f}" for key, i in indices]
        return "\n".join([*lines, say("quality.normality", probability=found.normality_p)])

    def _choose(self, line: int) -> None:
        names = list(self._found)
        if 0 <= line < len(names):
            self.plot.show_charts(self._found[names[line]])


class Histogram(ThemedPlot):
    """Histogram of a parameter with its limits and the normal distribution of its mean and scatter."""

    def __init__(self) -> None:
        super().__init__()
        self._shown: ParameterQuality | None = None
        theme.on_appearance_change(self, self._draw)

    def show_charts(self, charts: ParameterQuality) -> None:
        """Show the values of a quantity with limits."""
        self._shown = charts
        self._draw()

    def _draw(self) -> None:
        if self._shown is None or self._shown.capability is None:
            return
        name, found = self._shown.parameter, self._shown.capability
        c = theme.colours()
        self.getPlotItem().clear()
        size, unit = display(name, 1.0)
        values, mean, sigma = size * self._shown.values, size * found.mean, size * found.sigma_overall
        self.setLabel("bottom", f"{parameter_text(name)}, {unit}")
        self.setLabel("left", say("quality.axis_runs"))
        counts, edges = np.histogram(values, bins="auto" if len(values) < 5000 else 60)
        width = edges[1] - edges[0]
        bars = pg.BarGraphItem(x0=edges[:-1], width=width, height=counts, brush=theme.faint(c.accent, 110), pen=c.line)
        self.addItem(bars)
        x = np.linspace(mean - _DRAWN * sigma, mean + _DRAWN * sigma, 200)
        density = np.exp(-0.5 * ((x - mean) / sigma) ** 2) / (sigma * np.sqrt(2.0 * np.pi)) * len(values) * width
        self.addItem(pg.PlotDataItem(x, density, pen=pg.mkPen(c.text, width=1)))
        for limit in (found.low, found.high):
            self.addItem(pg.InfiniteLine(size * limit, 90, pen=dashed(c.bad)))
            self.addItem(pg.PlotDataItem([size * limit], [0.0], pen=pg.mkPen(None)))


def _index(index: Interval) -> str:
    return f"{index.value:.2f}"
