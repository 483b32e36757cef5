"""Innovations of a stage in units of their sigmas, against ±3, and the mean NIS of every stage with its band."""

from functools import partial

import numpy as np
import pyqtgraph as pg

from calstation.gui.engineer.cell_table import ROW, CellTable
from calstation.gui.engineer.stacked_plots import StackedPlots, dashed, name_axis
from calstation.gui.engineer.stage_combo import StageCombo
from calstation.gui.text import on_language_change, say, term
from calstation.gui.widgets import Column, column, label, row, theme
from calstation.results import Diagnostics, StageDiagnostics

#: Largest number of observations inside ±3 σ drawn in each plot; more are thinned out.
_MOST = 1500
_BOUND = 3.0
#: With fewer observations, a mean below its band is not significant.
_FEW = 100
#: Least range of a plot, sigmas either way.
_LEAST_RANGE = 5.0


class InnovationsView(StackedPlots):
    """One plot for each component, and below them one line for each stage."""

    def __init__(self) -> None:
        super().__init__(3, 7 * theme.GRID)
        self._diagnostics: Diagnostics | None = None
        self._stage_combo = StageCombo("innovation_stage_combo")
        self._stage_combo.currentIndexChanged.connect(self.refresh)
        caption = label(lambda: self.tr("Stage"))
        caption.setBuddy(self._stage_combo)
        self._beyond = label()
        self._nis = table = CellTable("nis_table")
        table.verticalHeader().hide()
        table.set_columns(
            (
                Column(lambda: self.tr("Stage"), partial(term, "stage"), number=False),
                table.column(lambda: self.tr("Mean NIS"), "mean"),
                table.column(lambda: self.tr("99.9 % band"), "band"),
                Column(
                    lambda: self.tr("Verdict"),
                    lambda name: say(f"engineer.nis_{table.cells[name]['verdict']}"),
                    number=False,
                    state=lambda name: table.cells[name]["state"],
                ),
            )
        )
        column(
            row(caption, self._stage_combo, 2 * theme.GRID, (self._beyond, 1)),
            *((plot, 1) for plot in self.plots),
            table,
            on=self,
            spacing=theme.GRID // 2,
            margins=(0, theme.GRID, 0, 0),
        )
        on_language_change(self, self._nis.refresh)

    def show_diagnostics(self, diagnostics: Diagnostics) -> None:
        """Show diagnostics, starting with the stage that has most innovations."""
        self._diagnostics = diagnostics
        sizes = {s.stage: len(s.innovations.seq) for s in diagnostics.stages if s.innovations is not None}
        longest = max(sizes, key=lambda stage: sizes[stage], default="")
        self._stage_combo.offer(list(sizes), longest)
        self._nis.show_cells({stage.stage: _nis_cells(stage) for stage in diagnostics.stages})
        header = self._nis.horizontalHeader().sizeHint().height()
        self._nis.setFixedHeight(header + ROW * len(diagnostics.stages) + theme.GRID // 2)
        self.refresh()

    def draw(self) -> None:
        """Draw the innovations of the chosen stage."""
        stage = self._stage(self._stage_combo.stage)
        if stage is None or stage.innovations is None:
            self._beyond.setText("")
            return
        c = theme.colours()
        innovations = stage.innovations
        minutes = (innovations.seq - stage.first_seq) / stage.sample_rate / 60.0
        size = 3 if len(innovations.seq) > 100 else 8
        for number, (plot, name) in enumerate(zip(self.plots, self._components(stage), strict=True)):
            values = innovations.normalised[:, number]
            beyond = np.abs(values) > _BOUND
            inside = np.flatnonzero(~beyond)[:: -(-len(values) // _MOST)]
            for drawn, colour, grow in ((inside, c.accent, 0), (np.flatnonzero(beyond), c.bad, 2)):
                dots = pg.ScatterPlotItem(
                    minutes[drawn], values[drawn], size=size + grow, pen=None, brush=pg.mkBrush(colour)
                )
                self.add(plot, dots)
            for level in (-_BOUND, 0.0, _BOUND):
                pen = pg.mkPen(c.line) if level == 0.0 else dashed(c.muted)
                self.add(plot, pg.InfiniteLine(level, 0, pen=pen))
            reach = max(_LEAST_RANGE, float(np.abs(values).max(initial=0.0)) * 1.05)
            plot.setYRange(-reach, reach, padding=0.0)
            name_axis(plot, "left", name)
        name_axis(self.plots[2], "bottom", self.tr("time in the stage, min"))
        self.plots[0].setXRange(0.0, max(float(minutes.max(initial=0.0)), 1e-3), padding=0.02)
        share = 100.0 * float(np.mean(np.abs(innovations.normalised) > _BOUND))
        self._beyond.setText(
            self.tr("{0} observations, {1:.2f} % beyond ±3 σ (0.27 % expected)").format(len(innovations.seq), share)
        )

    def _stage(self, name: str) -> StageDiagnostics | None:
        stages = () if self._diagnostics is None else self._diagnostics.stages
        return next((stage for stage in stages if stage.stage == name), None)

    def _components(self, stage: StageDiagnostics) -> tuple[str, str, str]:
        """Names of the components: velocity in the level frame, or along the unit's axes."""
        if stage.details.get("turns") or stage.details.get("positions"):
            return "x, σ", "y, σ", "z, σ"
        return self.tr("east, σ"), self.tr("north, σ"), self.tr("up, σ")


def _nis_cells(stage: StageDiagnostics) -> dict[str, str]:
    """The mean NIS of a stage, its band, and a state and the name of its words."""
    c = stage.consistency
    state, verdict = "good", "inside"
    if not c.passed:
        state, verdict = "bad", "above"
    elif c.warning:
        state, verdict = "none" if c.count < _FEW else "caution", "below"
    return {
        "mean": f"{c.nis_mean:.3f}",
        "band": f"{c.nis_low:.3f} – {c.nis_high:.3f}",
        "state": state,
        "verdict": verdict,
    }
