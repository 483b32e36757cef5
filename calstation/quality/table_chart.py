"""EWMA charts of the table's geometry: every run measures it, whichever unit is on the table.

The three charts together alarm about once in 1600 runs without a shift; a shift of one standard deviation is alarmed
after 14 runs in the median. `docs/how-to/check-standards.md` gives the measured probabilities.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from calstation.config import ProductConfig, StationConfig
from calstation.errors import InputError
from calstation.estimation.positions import TABLE_QUANTITIES
from calstation.physics import FloatArray
from calstation.quality.charts import ewma_chart
from calstation.records import RunFilter
from calstation.results import History

#: Weight of the newest value (lambda), and distance of the limits in sigmas of the average (L).
WEIGHT, WIDTH = 0.1, 3.6

#: Fewest runs from which center and sigma are estimated, and most of them.
LEAST_BASELINE, BASELINE = 20, 500


@dataclass(frozen=True)
class TableChart:
    """Chart of one quantity of the table, in the order of time."""

    started_utc: tuple[str, ...]  #: Start of each run, ISO 8601.
    values: FloatArray  #: rad, shape (n,).
    center: float  #: Mean of the baseline, rad.
    sigma: float  #: Standard deviation of the baseline from run to run, rad.
    alarms: tuple[int, ...]  #: Indices of the runs at which the chart alarms.


def alarms(values: FloatArray, center: float, sigma: float) -> tuple[int, ...]:
    """Return the indices at which the chart of values, shape (n,), alarms; it starts again after each alarm."""
    found: list[int] = []
    first = 0
    while first < len(values):
        chart = ewma_chart(values[first:], weight=WEIGHT, width=WIDTH, center=center, sigma=sigma)
        if not len(chart.signals):
            break
        found.append(first + int(chart.signals[0]))
        first = found[-1] + 1
    return tuple(found)


def table_charts(station: StationConfig, product: ProductConfig, history: History) -> Mapping[str, TableChart]:
    """Return the charts of the table's quantities over the runs of a product at a station.

    The baseline is the first `BASELINE` runs, or as many as there are; a quantity with fewer than `LEAST_BASELINE` runs
    has no chart. Runs of one product have one schedule and therefore equal standard deviations.
    """
    runs = history.runs(RunFilter(station=station.name, product=product.name), limit=None)
    rows: dict[str, list[tuple[str, float]]] = {name: [] for name in TABLE_QUANTITIES}
    for run in reversed(runs):
        if run.partial or run.outcome not in ("passed", "failed"):
            continue
        try:
            table = history.result(run).table
        except InputError:
            continue
        for name, row in table.items():
            rows.setdefault(name, []).append((run.started_utc, row.value))
    charts = {}
    for name, found in rows.items():
        if len(found) >= LEAST_BASELINE:
            values = np.array([value for _, value in found])
            center, sigma = float(values[:BASELINE].mean()), float(values[:BASELINE].std(ddof=1))
            times = tuple(time for time, _ in found)
            charts[name] = TableChart(times, values, center, sigma, alarms(values, center, sigma))
    return charts
