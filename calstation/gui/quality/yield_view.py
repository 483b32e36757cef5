"""The yield of the runs by day, product, station and operator, and the most frequent failed checks."""

from collections.abc import Mapping, Sequence
from datetime import UTC, date, datetime, timedelta

import numpy as np
import pyqtgraph as pg
from pyqtgraph.graphicsItems.DateAxisItem import MONTH_SPACING
from PySide6.QtCore import QLocale
from PySide6.QtWidgets import QWidget

from calstation.gui.text import language, on_language_change, product_text, say
from calstation.gui.widgets import (
    Cell,
    CellTable,
    DataView,
    EmptyState,
    ThemedPlot,
    box,
    column,
    label,
    row,
    show_text,
    split,
    stack,
    theme,
)
from calstation.judgement import short_names
from calstation.quality import FailedCheck, Share, Yields

#: Maximum number of failed checks in the plot.
_MAX_CHECKS = 7
#: Maximum number of days that are plotted individually; more days are plotted by week.
_MAX_DAYS = 60
#: Smallest span of the time axis, s.
_MIN_SPAN = 7 * 86_400.0
#: Lower end of the yield axis if no yield is smaller.
_MIN_SHARE = 0.5
_COLUMNS = (
    Cell("quality.by", "by", number=False),
    Cell("quality.name", "name", number=False),
    Cell("quality.passed", "passed"),
    Cell("quality.runs", "count"),
    Cell("quality.yield", "share"),
    Cell("quality.interval", "interval"),
)


class YieldView(QWidget, DataView[Yields]):
    """A view of the yield of the selected runs."""

    def __init__(self) -> None:
        super().__init__()
        self.overall_label = label(kind="section", name="yield_overall_label")
        self.first_label = label(name="yield_first_label")
        self.days, self.pareto = DailyYield(), Pareto()
        self.table = CellTable("yield_table", "quality.yield_table", _COLUMNS, named=False)
        titles = label("quality.yield_by_day", "muted"), label("quality.failed_checks", "muted")
        self.others_label = label(kind="muted", name="yield_others_label")
        self._no_failures = EmptyState()
        self._failures = stack(self.pareto, self._no_failures)
        plots = box(
            titles[0], (self.days, 4), titles[1], (self._failures, 5), self.others_label, spacing=theme.GRID // 2
        )
        head = row(self.overall_label, 2 * theme.GRID, self.first_label, None)
        body = split((plots, 5), (self.table, 4), handle=2 * theme.GRID)
        column(head, (body, 1), on=self, margins=(0, theme.GRID, 0, 0))
        on_language_change(self, self.refresh)

    def show_data(self, data: Yields) -> None:
        """Show the yield of runs."""
        self.days.show_data(data.days if len(data.days) <= _MAX_DAYS else _by_week(data.days))
        self.pareto.show_data(data.failed_checks[:_MAX_CHECKS])
        self._failures.setCurrentWidget(self.pareto if data.failed_checks else self._no_failures)
        super().show_data(data)

    def draw(self, data: Yields) -> None:
        """Show the yields."""
        self._no_failures.say("chart.no_failed_checks")
        others = len(data.failed_checks[_MAX_CHECKS:])
        show_text(self.others_label, say("quality.other_checks", count=others) if others else "")
        if data.overall is None or data.units is None:
            return
        # the yield and the first-pass yield count units, so that repeated runs of a unit do not lower only one of them
        first, runs = data.first_pass, say("quality.runs_passed", percent=_text(data.overall))
        self.overall_label.setText(say("quality.overall_yield", percent=_text(data.units)))
        first_pass = "" if first is None else say("quality.first_pass", percent=_text(first))
        self.first_label.setText("  ·  ".join(filter(None, (first_pass, runs))))
        groups = (
            (say("common.product"), {product_text(name): share for name, share in data.products.items()}),
            (say("common.station"), data.stations),
            (say("common.operator"), data.operators),
        )
        cells = {
            f"{by} {name}": {
                "by": by,
                "name": name,
                "passed": str(share.passed),
                "count": str(share.count),
                "share": f"{100 * share.value:.1f} %",
                "interval": f"{100 * share.low:.1f} … {100 * share.high:.1f} %",
            }
            for by, shares in groups
            for name, share in shares.items()
        }
        self.table.show_cells(cells)


class DayAxis(pg.DateAxisItem):  # type: ignore[misc]
    """A time axis with the names of months in the current language."""

    def tickStrings(self, values: Sequence[float], scale: float, spacing: float) -> list[str]:
        """Return the labels of ticks."""
        if spacing != MONTH_SPACING:
            return list(super().tickStrings(values, scale, spacing))
        locale = QLocale(language.current())
        months = (datetime.fromtimestamp(value, UTC).month for value in values)
        return [locale.monthName(month, QLocale.FormatType.ShortFormat) for month in months]


class DailyYield(ThemedPlot, DataView[Mapping[str, Share]]):
    """A plot of the yield per day or week with its confidence interval."""

    def __init__(self) -> None:
        super().__init__()
        self.setAxisItems({"bottom": DayAxis("bottom", utcOffset=0)})
        self.getAxis("left").setWidth(8 * theme.GRID)
        self.showGrid(y=True, alpha=0.2)
        self.apply_theme()
        theme.on_appearance_change(self, self.refresh)

    def draw(self, data: Mapping[str, Share]) -> None:
        """Draw the yields."""
        self.setLabel("left", say("quality.yield_percent"))
        self.getAxis("bottom").setStyle(tickFont=theme.font())  # the axis redraws the names of the months
        self.getPlotItem().clear()
        if not data:
            return
        c = theme.colours()
        noon = [date.fromisoformat(day).toordinal() - date(1970, 1, 1).toordinal() + 0.5 for day in data]
        x = 86_400.0 * np.array(noon)
        value, low, high = (100.0 * np.array([getattr(s, k) for s in data.values()]) for k in ("value", "low", "high"))
        bars = pg.ErrorBarItem(x=x, y=value, top=high - value, bottom=value - low, beam=0.0, pen=theme.pen(c.line))
        symbol = {"symbol": "o", "symbolSize": 6, "symbolBrush": c.accent, "symbolPen": None}
        self.addItem(bars)
        self.addItem(pg.PlotDataItem(x, value, pen=theme.pen(c.accent, 1), **symbol))
        self.setYRange(min(100.0 * _MIN_SHARE, float(low.min())), 100.0)
        margin = max(0.0, _MIN_SPAN - (x[-1] - x[0])) / 2.0  # otherwise, the labels for a single day would be hours
        self.setXRange(x[0] - margin, x[-1] + margin)


class Pareto(ThemedPlot, DataView[tuple[FailedCheck, ...]]):
    """A plot of the failed checks, the most frequent first, with their cumulative share of the failed runs."""

    def __init__(self) -> None:
        super().__init__(counts="bottom")
        self.getAxis("left").setWidth(30 * theme.GRID)
        self.getViewBox().invertY(True)
        theme.on_appearance_change(self, self.refresh)

    def draw(self, data: tuple[FailedCheck, ...]) -> None:
        """Draw the checks."""
        self.setLabel("bottom", say("quality.axis_runs"))
        self.getPlotItem().clear()
        c = theme.colours()
        rows = np.arange(len(data))
        runs = [check.runs for check in data]
        self.addItem(pg.BarGraphItem(x0=0, y=rows, height=0.7, width=runs, brush=theme.faint(c.bad, 110), pen=c.line))
        names = short_names([check.id for check in data])
        self.getAxis("left").setTicks([list(enumerate(map(say, names)))])
        for k, check in enumerate(data):
            text = pg.TextItem(f"{check.runs}   {100 * check.cumulative:.0f} %", color=c.text, anchor=(0, 0.5))
            text.setFont(theme.font())
            text.setPos(check.runs, k)
            self.addItem(text)
        self.setYRange(-0.5, max(len(rows), 4) - 0.5)
        self.setXRange(0, 1.3 * max(runs, default=1), padding=0)


def _by_week(days: Mapping[str, Share]) -> dict[str, Share]:
    """Return the yields by week, keyed by the date of Monday."""
    weeks: dict[str, list[Share]] = {}
    for day, share in days.items():
        local = date.fromisoformat(day)
        weeks.setdefault((local - timedelta(days=local.weekday())).isoformat(), []).append(share)
    return {
        monday: Share.of(sum(s.passed for s in shares), sum(s.count for s in shares))
        for monday, shares in weeks.items()
    }


def _text(share: Share) -> str:
    return f"{100 * share.value:.1f} % ({share.passed}/{share.count})"
