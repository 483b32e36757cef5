"""Views of the innovations of a stage, and of the residuals of all rests and moves."""

from collections.abc import Sequence
from itertools import groupby

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QEvent, QPointF
from PySide6.QtGui import QResizeEvent

from calstation.gui.engineer.observability_view import StageCombo
from calstation.gui.text import on_language_change, say, term, with_minus
from calstation.gui.widgets import (
    ROW,
    Band,
    Cell,
    CellTable,
    ElidedLabel,
    StackedPlots,
    ThemedPlot,
    column,
    dashed,
    label,
    row,
    theme,
)
from calstation.physics import DEGREE_PER_HOUR, MICRO_G, FloatArray, display_by_unit
from calstation.results import CREEP, EXCESSIVE, NOTABLE, Diagnostics, PositionResidual, StageDiagnostics

#: Maximum number of observations within ±3 σ drawn in a plot; more are decimated.
_MAX_POINTS = 1500
#: Normalised innovation above which an observation is drawn as an outlier.
_OUTLIER_LIMIT = 3.0
#: Minimum number of observations for a mean below its band to be significant.
_MIN_COUNT = 100
#: Minimum half range of a plot, in sigmas.
_MIN_HALF_RANGE = 5.0
_NIS_COLUMNS = (
    Cell("engineer.stage", "stage", number=False),
    Cell("engineer.mean_nis", "mean"),
    Cell("engineer.expected_band", "band"),
    Cell("common.verdict", "verdict", number=False, state="state"),
)


class InnovationsView(StackedPlots[Diagnostics]):
    """A plot for each component of the innovations of a stage, and a table with the consistency of all stages."""

    def __init__(self) -> None:
        super().__init__(3, 7 * theme.GRID)
        self._stage_combo = StageCombo("innovation_stage_combo")
        self._stage_combo.currentIndexChanged.connect(self.refresh)
        caption = label("engineer.stage", buddy=self._stage_combo)
        self._outlier_label = label(wrap=True)
        self._nis = CellTable("nis_table", columns=_NIS_COLUMNS, named=False)
        column(
            row(caption, self._stage_combo, 2 * theme.GRID, (self._outlier_label, 1)),
            *((plot, 1) for plot in self.plots),
            self._nis,
            on=self,
            spacing=theme.GRID // 2,
            margins=(0, theme.GRID, 0, 0),
        )

    def show_data(self, diagnostics: Diagnostics) -> None:
        """Show diagnostics, starting with the stage that has the most innovations."""
        sizes = {s.stage: len(s.innovations.seq) for s in diagnostics.stages if s.innovations is not None}
        longest = max(sizes, key=lambda stage: sizes[stage], default="")
        self._stage_combo.offer(list(sizes), longest)
        header = self._nis.horizontalHeader().sizeHint().height()
        self._nis.setFixedHeight(header + ROW * len(diagnostics.stages) + theme.GRID // 2)
        super().show_data(diagnostics)

    def draw(self, diagnostics: Diagnostics) -> None:
        """Draw the innovations of the selected stage, and fill the table."""
        self._nis.show_cells({stage.stage: _nis_cells(stage) for stage in diagnostics.stages})
        stage = next((stage for stage in diagnostics.stages if stage.stage == self._stage_combo.stage), None)
        if stage is None or stage.innovations is None:
            self._outlier_label.setText("")
            return
        c = theme.colours()
        innovations = stage.innovations
        minutes = (innovations.seq - stage.first_seq) / stage.sample_rate / 60.0
        size = 3 if len(innovations.seq) > 100 else 8
        for number, (plot, name) in enumerate(zip(self.plots, self._components(stage), strict=True)):
            values = innovations.normalised[:, number]
            outliers = np.flatnonzero(np.abs(values) > _OUTLIER_LIMIT)
            inside = np.flatnonzero(np.abs(values) <= _OUTLIER_LIMIT)[:: -(-len(values) // _MAX_POINTS)]
            for drawn, colour, enlarged in ((inside, c.accent, 0), (outliers, c.bad, 2)):
                style = {"size": size + enlarged, "pen": None, "brush": pg.mkBrush(colour)}
                self.add(plot, pg.ScatterPlotItem(minutes[drawn], values[drawn], **style))
            for level in (-_OUTLIER_LIMIT, 0.0, _OUTLIER_LIMIT):
                pen = theme.pen(c.line) if level == 0.0 else dashed(c.muted)
                self.add(plot, pg.InfiniteLine(level, 0, pen=pen))
            reach = max(_MIN_HALF_RANGE, float(np.nan_to_num(np.abs(values)).max(initial=0.0)) * 1.05)
            plot.setYRange(-reach, reach, padding=0.0)
            plot.setLabel("left", name)
        self.plots[2].setLabel("bottom", say("engineer.axis_time_in_stage"))
        self.plots[0].setXRange(0.0, max(float(minutes.max(initial=0.0)), 1e-3), padding=0.02)
        tested = np.abs(innovations.normalised[np.isfinite(innovations.normalised)])
        if not len(tested):
            self._outlier_label.setText(say("engineer.nis_untested"))
            return
        share, count = 100.0 * float(np.mean(tested > _OUTLIER_LIMIT)), len(innovations.seq)
        said = {"count": count, "components": len(tested), "percent": share}
        self._outlier_label.setText(say("engineer.observations", **said))

    def _components(self, stage: StageDiagnostics) -> tuple[str, str, str]:
        """Return the axis labels: east, north and up, or the axes of the unit for a stage without navigation."""
        if stage.details.get("turns") or stage.details.get("positions"):
            return "x, σ", "y, σ", "z, σ"
        return say("engineer.east_sigma"), say("engineer.north_sigma"), say("engineer.up_sigma")


def _nis_cells(stage: StageDiagnostics) -> dict[str, str]:
    """Return the texts in the row of a stage: its mean NIS, the expected band, and the verdict with its badge shape."""
    c = stage.consistency
    state, verdict = "good", "inside"
    if not c.count:
        state, verdict = "none", "untested"
    elif not c.passed:
        state, verdict = "bad", "above"
    elif c.warning:
        state, verdict = "none" if c.count < _MIN_COUNT else "caution", "below"
    return {
        "stage": term("stage", stage.stage),
        "mean": f"{c.nis_mean:.3f}" if c.count else "–",
        "band": f"{c.nis_low:.3f} – {c.nis_high:.3f}" if c.count else "–",
        "verdict": say(f"engineer.nis_{verdict}"),
        "state": state,
    }


#: Width of the left axes of the plots of residuals, px.
_AXIS_WIDTH = 9 * theme.GRID
#: Relative heights of the plots of residuals; the last two have long labels, the last also a horizontal axis.
_SHARES = 8, 8, 10, 13
#: Smallest range of the plot of the tests in units of `EXCESSIVE`, with space for the names of stages and the caption.
_HEADROOM = 2.0
#: Width of the bars of rests and moves, in units of the distance between rests.
_BAR = {"rest": 0.4, "move": 0.16}


class ResidualsView(StackedPlots[Diagnostics]):
    """Plots of the tests and residuals of all rests and moves; a label describes the item under the pointer."""

    def __init__(self) -> None:
        super().__init__(4, _AXIS_WIDTH)
        #: Stage of each drawn rest, and its index within the stage.
        self._rests: list[tuple[StageDiagnostics, int]] = []
        #: Stage, residual and horizontal position of each drawn rest and move.
        self._rows: list[tuple[StageDiagnostics, PositionResidual, float]] = []
        self._rest_label = ElidedLabel()
        self._rest_label.setObjectName("rest_label")
        for plot in self.plots:
            plot.scene().sigMouseMoved.connect(lambda at, of=plot: self._describe_rest(of, at))
        column(
            self._rest_label,
            *zip(self.plots, _SHARES, strict=True),
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
        self._rows = _positioned(stages)
        self.plots[0].setLabel("left", say("engineer.test_sigma"))
        self._draw_tests(self.plots[0])
        titles = (say("engineer.gravity_ug"), say("engineer.vertical_rate"), say("engineer.horizontal_rate"))
        for plot, title, (values, sigmas) in zip(self.plots[1:], titles, _columns(stages), strict=True):
            plot.setLabel("left", title)
            self._draw_column(plot, values, sigmas)
        self.plots[-1].setLabel("bottom", say("engineer.axis_rest"))
        self.plots[0].setXRange(-0.5, max(len(self._rests) - 0.5, 0.5), padding=0.01)
        self._name_ticks()

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Label as many rests as the width permits."""
        super().resizeEvent(event)
        self._name_ticks()

    def leaveEvent(self, event: QEvent) -> None:
        """Show the explanation of the plots again."""
        self._explain()
        super().leaveEvent(event)

    def _draw_tests(self, plot: ThemedPlot) -> None:
        """Draw the worst test of each rest (wide bar) and move (narrow bar); symbols mark large values."""
        c = theme.colours()
        for state, colour, symbol in (("good", c.accent, ""), ("caution", c.caution, "t1"), ("bad", c.bad, "x")):
            drawn = [
                (x, row.worst, _BAR[row.kind])
                for _, row, x in self._rows
                if row.state == state and np.isfinite(row.worst)
            ]
            if not drawn:
                continue
            x, height, width = np.array(drawn).T
            brush = pg.mkBrush(colour)
            self.add(plot, pg.BarGraphItem(x=x, height=height, width=width, brush=brush, pen=None), scaled=False)
            if symbol:
                marks = pg.ScatterPlotItem(x, height, size=11, symbol=symbol, pen=None, brush=brush)
                self.add(plot, marks, scaled=False)
        words = say("engineer.test_levels", notable=NOTABLE, excessive=EXCESSIVE)
        caption = {"position": 0.99, "anchors": [(1, 1), (1, 1)], "color": c.muted, "fill": theme.faint(c.panel, 200)}
        upper = pg.InfiniteLine(EXCESSIVE, 0, pen=dashed(c.muted), label=words, labelOpts=caption)
        upper.label.setFont(theme.font())
        for line in (pg.InfiniteLine(NOTABLE, 0, pen=dashed(c.muted)), upper):
            self.add(plot, line, scaled=False)
        largest = max((row.worst for _, row, _ in self._rows if np.isfinite(row.worst)), default=0.0)
        plot.setYRange(0.0, max(1.15 * largest, _HEADROOM * EXCESSIVE), padding=0.0)

    def _draw_column(self, plot: ThemedPlot, values: FloatArray, sigmas: FloatArray) -> None:
        """Draw a value with its sigma for each rest, both of shape (n,)."""
        c = theme.colours()
        number = np.arange(len(values), dtype=np.float64)
        bars = pg.ErrorBarItem(x=number, y=values, height=2.0 * sigmas, beam=0.25, pen=theme.pen(c.muted))
        self.add(plot, pg.InfiniteLine(0.0, 0, pen=theme.pen(c.text)), scaled=False)
        self.add(plot, bars, scaled=False)
        self.add(plot, pg.ScatterPlotItem(number, values, size=7, pen=None, brush=pg.mkBrush(c.accent)))
        reach = float(np.max(np.abs(values) + sigmas, initial=0.0)) * 1.1 or 1.0
        plot.setYRange(-reach, reach, padding=0.0)

    def _name_ticks(self) -> None:
        """Label as many rests as the width permits."""
        ticks = [(k, with_minus(stage.rests.axis(i))) for k, (stage, i) in enumerate(self._rests)]
        widest = max((self.fontMetrics().horizontalAdvance(name) for _, name in ticks), default=0)
        room = max(1, (self.plots[-1].width() - _AXIS_WIDTH) // (widest + theme.GRID))
        self.plots[-1].getAxis("bottom").setTicks([ticks[:: -(-max(len(ticks), 1) // room)]])

    def _explain(self) -> None:
        self._describe(say("engineer.about_rests", creep=CREEP), "muted")

    def _describe(self, text: str, kind: str = "") -> None:
        theme.set_kind(self._rest_label, kind)
        self._rest_label.setText(text)

    def _describe_rest(self, plot: ThemedPlot, at: QPointF) -> None:
        """Describe the item of a plot that is nearest to a scene position."""
        view = plot.getPlotItem().getViewBox()
        if not self._rests or not view.sceneBoundingRect().contains(at):
            return
        at_x = view.mapSceneToView(at).x()
        if plot is self.plots[0]:
            self._describe_row(at_x)
            return
        k = min(max(round(at_x), 0), len(self._rests) - 1)
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
        self._describe(text)

    def _describe_row(self, at: float) -> None:
        """Describe the rest or move nearest to a horizontal position."""
        if not self._rows:
            return
        stage, row, _ = min(self._rows, key=lambda item: abs(item[2] - at))
        text = say("engineer.residual", stage=stage.stage, row=row.text)
        if row.channel is not None:
            error, unit = display_by_unit(row.error_unit, row.error)
            sigma, _ = display_by_unit(row.error_unit, row.error_sigma)
            values = {"channel": row.channel_name, "error": error, "sigma": sigma, "unit": unit}
            text += say("engineer.residual_error", **values, ratio=row.error / row.error_sigma)
        if row.freedom:
            text += say("engineer.residual_test", excess=row.excess, component=row.component_name, mean=row.mean)
        self._describe(text)


def _positioned(stages: Sequence[StageDiagnostics]) -> list[tuple[StageDiagnostics, PositionResidual, float]]:
    """Return the stage, residual and horizontal position of all rests and moves; moves are between the rests."""
    items: list[tuple[StageDiagnostics, PositionResidual, float]] = []
    first = 0
    for stage in stages:
        last = first - 1
        for is_move, group in groupby(stage.residuals, lambda residual: residual.kind == "move"):
            residuals = list(group)
            for number, residual in enumerate(residuals, 1):
                last = last if is_move else first + residual.number - 1
                items.append((stage, residual, last + number / (len(residuals) + 1) if is_move else last))
        first += len(stage.rests)
    return items


def _columns(stages: Sequence[StageDiagnostics]) -> list[tuple[FloatArray, FloatArray]]:
    """Return the values and sigmas of each plot in display units, both of shape (rests,)."""

    def column(name: str, unit: float) -> FloatArray:
        return np.concatenate([np.empty(0), *(getattr(stage.rests, name) for stage in stages)]) / unit

    rate_sigma = column("rate_sigma", DEGREE_PER_HOUR)
    return [
        (column("force", MICRO_G), column("force_sigma", MICRO_G)),
        (column("vertical_rate", DEGREE_PER_HOUR), rate_sigma),
        (column("horizontal_rate", DEGREE_PER_HOUR), rate_sigma),
    ]
