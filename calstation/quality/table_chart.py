"""EWMA charts of the table's geometry: every run measures it, regardless of the unit on the table.

Center and standard deviation come from a fixed baseline: the first runs after the table's latest calibration. Only
later runs are tested. `docs/how-to/check-standards.md` gives the measured probabilities.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime, time, timedelta

import numpy as np

from calstation.config import StationConfig
from calstation.estimation.positions import TABLE_QUANTITIES
from calstation.physics import FloatArray
from calstation.quality.charts import BASELINE, EwmaChart, restarted_ewma_chart
from calstation.quality.runs import judged_runs
from calstation.records import RunColumns

#: Weight of the newest value (lambda), and distance of the limits in sigmas of the average (L). The limits are wider
#: than for a known center and sigma, because errors of the baseline would otherwise cause most alarms.
WEIGHT, WIDTH = 0.1, 4.1

#: Smallest number of runs for a chart.
_MIN_RUNS = 2


@dataclass(frozen=True)
class TableChart:
    """Chart of one quantity of the table since its latest calibration, in chronological order."""

    names: tuple[str, ...]  #: File names of the logs of the runs, without suffix.
    started: FloatArray  #: Start times of the runs, s since 1970 in UTC, shape (n,).
    values: FloatArray  #: rad, shape (n,).
    center: float  #: Mean of the baseline, rad.
    sigma: float  #: Standard deviation of the baseline from run to run, rad.
    baseline: int  #: Number of runs in the baseline, which are not tested; `BASELINE` if it is complete.
    alarms: tuple[int, ...]  #: Indices of the runs for which the chart raises an alarm.

    @classmethod
    def of(cls, names: tuple[str, ...], started: FloatArray, values: FloatArray) -> "TableChart":
        """Return the chart of values, rad, shape (n,), at least two."""
        baseline = values[:BASELINE]
        center, sigma, length = float(baseline.mean()), float(baseline.std(ddof=1)), len(baseline)
        indices = tuple(length + k for k in alarms(values[length:], center, sigma))
        return cls(names, started, values, center, sigma, length, indices)

    @property
    def ewma(self) -> EwmaChart:
        """The chart of the runs after the baseline."""
        return table_ewma(self.values[self.baseline :], self.center, self.sigma)


def table_ewma(values: FloatArray, center: float, sigma: float) -> EwmaChart:
    """Return the EWMA chart of values, shape (n,), restarted after each alarm."""
    return restarted_ewma_chart(values, center, sigma, weight=WEIGHT, width=WIDTH)


def alarms(values: FloatArray, center: float, sigma: float) -> tuple[int, ...]:
    """Return the indices at which the chart of values, shape (n,), raises an alarm."""
    return tuple(table_ewma(values, center, sigma).signals.tolist())


def table_charts(station: StationConfig, runs: RunColumns) -> Mapping[str, TableChart]:
    """Return the charts of the table's quantities over the runs of a product that were made at a station.

    The charts contain the runs after the date of the table's latest calibration, or all runs if the station has no such
    date. The first `BASELINE` of them are the baseline. Runs of one product have one schedule and therefore equal
    standard deviations.
    """
    rows = judged_runs(runs)
    rows = rows[runs.stations.isin((station.name,))[rows]]
    calibrated = [each.calibrated for each in station.instruments if each.kind == "table" and each.calibrated]
    if calibrated:
        start = datetime.combine(max(calibrated) + timedelta(days=1), time.min).timestamp()
        rows = rows[runs.started[rows] >= start]
    charts = {}
    for name in TABLE_QUANTITIES:
        measured = rows[~np.isnan(runs.table[name][rows])] if name in runs.table else rows[:0]
        if len(measured) >= _MIN_RUNS:
            names = tuple(runs.names[k] for k in measured.tolist())
            charts[name] = TableChart.of(names, runs.started[measured], runs.table[name][measured])
    return charts
