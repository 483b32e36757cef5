"""Innovations of a stage with the mean NIS of every stage, and the residuals of every rest after compensation."""

from collections.abc import Sequence
from functools import partial

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QEvent, QPointF
from PySide6.QtGui import QResizeEvent

from calstation.gui.engineer.controls import ROW, CellTable, StageCombo
from calstation.gui.engineer.stacked_plots import Band, StackedPlots, dashed, name_axis
from calstation.gui.text import on_language_change, say, term
from calstation.gui.widgets import Column, ElidedLabel, ThemedPlot, column, label, row, theme
from calstation.physics import DEGREE_PER_HOUR, MICRO_G, FloatArray
from calstation.results import Diagnostics, StageDiagnostics

#: Largest number of observations inside ±3 σ drawn in each plot; more are thinned out.
_MOST = 1500
_BOUND = 3.0
#: With fewer observations, a mean below its band is not significant.
_FEW = 100
#: Least range of a plot, sigmas either way.
_LEAST_RANGE = 5.0


class InnovationsView(StackedPlots[Diagnostics]):
    """One plot for each component, and below them one line for each stage."""

    def __init__(self) -> None:
        super().__init__(3, 7 * theme.GRID)
        self._stage_combo = StageCombo("innovation_stage_combo")
        self._stage_combo.currentIndexChanged.connect(self.refresh)
        caption = label(lambda: self.tr("Stage"), buddy=self._stage_combo)
        self._beyond = label()
        self._nis = table = CellTable("nis_table")
        table.verticalHeader().hide()
        table.parameters.set_columns(
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
        on_language_change(self, table.parameters.refresh)

    def show_data(self, diagnostics: Diagnostics) -> None:
        """Show diagnostics, starting with the stage that has most innovations."""
        sizes = {s.stage: len(s.innovations.seq) for s in diagnostics.stages if s.innovations is not None}
        longest = max(sizes, key=lambda stage: sizes[stage], default="")
        self._stage_combo.offer(list(sizes), longest)
        self._nis.show_cells({stage.stage: _nis_cells(stage) for stage in diagnostics.stages})
        header = self._nis.horizontalHeader().sizeHint().height()
        self._nis.setFixedHeight(header + ROW * len(diagnostics.stages) + theme.GRID // 2)
        super().show_data(diagnostics)

    def draw(self, diagnostics: Diagnostics) -> None:
        """Draw the innovations of the chosen stage."""
        stage = next((stage for stage in diagnostics.stages if stage.stage == self._stage_combo.stage), None)
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
                style = {"size": size + grow, "pen": None, "brush": pg.mkBrush(colour)}
                self.add(plot, pg.ScatterPlotItem(minutes[drawn], values[drawn], **style))
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


_LEFT = 9 * theme.GRID
#: A rest is named by the axis that is within this angle (its cosine) of up.
_UPWARD = np.cos(np.deg2rad(30.0))


class ResidualsView(StackedPlots[Diagnostics]):
    """Three plots over the rests of all stages; the rest under the pointer is described."""

    def __init__(self) -> None:
        super().__init__(3, _LEFT)
        #: Each rest drawn, as its stage and its number in it.
        self._rests: list[tuple[StageDiagnostics, int]] = []
        self._rest_label = ElidedLabel()
        self._rest_label.setObjectName("rest_label")
        for plot in self.plots:
            plot.scene().sigMouseMoved.connect(lambda at, of=plot: self._describe_rest(of, at))
        column(
            self._rest_label,
            *((plot, 1) for plot in self.plots),
            on=self,
            spacing=theme.GRID // 2,
            margins=(0, theme.GRID, 0, 0),
        )
        on_language_change(self, self._explain)

    def draw(self, diagnostics: Diagnostics) -> None:
        """Draw the rests of all stages."""
        stages = [stage for stage in diagnostics.stages if len(stage.rests)]
        self._rests = [(stage, k) for stage in stages for k in range(len(stage.rests))]
        bands: list[Band] = []
        begin = -0.5
        for stage in stages:
            bands.append((term("stage", stage.stage), begin, begin + len(stage.rests)))
            begin += len(stage.rests)
        self.add_bands(bands)
        titles = (self.tr("gravity, µg"), self.tr("vertical rate, °/h"), self.tr("horizontal rate, °/h"))
        for plot, title, (values, sigmas) in zip(self.plots, titles, _columns(stages), strict=True):
            name_axis(plot, "left", title)
            self._draw_column(plot, values, sigmas)
        name_axis(self.plots[2], "bottom", self.tr("rest, by the axis that is up"))
        self.plots[0].setXRange(-0.5, max(len(self._rests) - 0.5, 0.5), padding=0.01)
        self._name_ticks()

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Name as many rests as the width allows."""
        super().resizeEvent(event)
        self._name_ticks()

    def leaveEvent(self, event: QEvent) -> None:
        """Explain the plots again."""
        self._explain()
        super().leaveEvent(event)

    def _draw_column(self, plot: ThemedPlot, values: FloatArray, sigmas: FloatArray) -> None:
        c = theme.colours()
        number = np.arange(len(values), dtype=np.float64)
        bars = pg.ErrorBarItem(x=number, y=values, height=2.0 * sigmas, beam=0.25, pen=pg.mkPen(c.muted))
        self.add(plot, pg.InfiniteLine(0.0, 0, pen=pg.mkPen(c.text)), scaled=False)
        self.add(plot, bars, scaled=False)
        self.add(plot, pg.ScatterPlotItem(number, values, size=7, pen=None, brush=pg.mkBrush(c.accent)))
        reach = float(np.max(np.abs(values) + sigmas, initial=0.0)) * 1.1 or 1.0
        plot.setYRange(-reach, reach, padding=0.0)

    def _name_ticks(self) -> None:
        ticks = [(k, upward_axis(stage.rests.up[i])) for k, (stage, i) in enumerate(self._rests)]
        room = max(1, (self.plots[2].width() - _LEFT) // (4 * theme.GRID))
        self.plots[2].getAxis("bottom").setTicks([ticks[:: -(-max(len(ticks), 1) // room)]])

    def _explain(self) -> None:
        theme.set_kind(self._rest_label, "muted")
        self._rest_label.setText(say("engineer.about_rests"))

    def _describe_rest(self, plot: ThemedPlot, at: QPointF) -> None:
        view = plot.getPlotItem().getViewBox()
        if not self._rests or not view.sceneBoundingRect().contains(at):
            return
        k = min(max(round(view.mapSceneToView(at).x()), 0), len(self._rests) - 1)
        stage, i = self._rests[k]
        rests = stage.rests
        up = dict(zip("xyz", rests.up[i].tolist(), strict=True))
        text = say("engineer.rest", stage=stage.stage, number=i + 1, **up)
        if np.isfinite(rests.angles[i]).all():
            outer, inner = np.rad2deg(rests.angles[i]).tolist()
            text += say("engineer.rest_angles", outer=outer, inner=inner)
        text += say(
            "engineer.rest_residuals",
            force=float(rests.force[i] / MICRO_G),
            vertical=float(rests.vertical_rate[i] / DEGREE_PER_HOUR),
            horizontal=float(rests.horizontal_rate[i] / DEGREE_PER_HOUR),
        )
        theme.set_kind(self._rest_label, "")
        self._rest_label.setText(text)


def upward_axis(up: FloatArray) -> str:
    """The axis within 30° of up, "" if there is none; `up` in the body, shape (3,)."""
    axis = int(np.argmax(np.abs(up)))
    if abs(up[axis]) < _UPWARD:
        return ""
    return ("+" if up[axis] > 0.0 else "−") + "xyz"[axis]


def _columns(stages: Sequence[StageDiagnostics]) -> list[tuple[FloatArray, FloatArray]]:
    """Values and sigmas of each plot, in the units shown."""

    def column(name: str, unit: float) -> FloatArray:
        return np.concatenate([np.empty(0), *(getattr(stage.rests, name) for stage in stages)]) / unit

    rate_sigma = column("rate_sigma", DEGREE_PER_HOUR)
    return [
        (column("force", MICRO_G), column("force_sigma", MICRO_G)),
        (column("vertical_rate", DEGREE_PER_HOUR), rate_sigma),
        (column("horizontal_rate", DEGREE_PER_HOUR), rate_sigma),
    ]
