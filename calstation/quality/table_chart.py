"""EWMA charts of the table's geometry: every run measures it, whichever unit is on the table.

Center and standard deviation are those of a baseline that stays as it is: the first runs after the table's latest
calibration. Only later runs are tested. `docs/how-to/check-standards.md` gives the measured probabilities.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, time, timedelta

import numpy as np

from calstation.config import ProductConfig, StationConfig
from calstation.errors import InputError
from calstation.estimation.positions import TABLE_QUANTITIES
from calstation.physics import FloatArray
from calstation.quality.charts import ewma_chart
from calstation.records import RunFilter
from calstation.results import History

#: Weight of the newest value (lambda), and distance of the limits in sigmas of the average (L). The limits are wider
#: than for known center and sigma, as their errors from the baseline would otherwise cause most alarms.
WEIGHT, WIDTH = 0.1, 4.1

#: Number of runs of the baseline.
BASELINE = 100

#: Fewest runs that are shown.
_LEAST = 2


@dataclass(frozen=True)
class TableChart:
    """Chart of one quantity of the table since its latest calibration, in the order of time."""

    started_utc: tuple[str, ...]  #: Start of each run, ISO 8601.
    values: FloatArray  #: rad, shape (n,).
    center: float  #: Mean of the baseline, rad.
    sigma: float  #: Standard deviation of the baseline from run to run, rad.
    baseline: int  #: Number of first runs that are the baseline, `BASELINE` once it is complete; they are not tested.
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

    Runs after the day of the table's latest calibration count, all if the station has no such date. Their first
    `BASELINE` are the baseline. Runs of one product have one schedule and therefore equal standard deviations.
    """
    calibrated = [each.calibrated for each in station.instruments if each.kind == "table" and each.calibrated]
    since = ""
    if calibrated:
        following = datetime.combine(max(calibrated) + timedelta(days=1), time.min)
        since = f"{following.astimezone(UTC):%Y-%m-%dT%H:%M:%S}"
    runs = history.runs(RunFilter(station=station.name, product=product.name, since=since), limit=None)
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
    return {name: _chart(found) for name, found in rows.items() if len(found) >= _LEAST}


def _chart(rows: Sequence[tuple[str, float]]) -> TableChart:
    """Return the chart of starts and values in the order of time."""
    values = np.array([value for _, value in rows])
    known = values[:BASELINE]
    center, sigma = float(known.mean()), float(known.std(ddof=1))
    found = tuple(len(known) + k for k in alarms(values[len(known) :], center, sigma))
    return TableChart(tuple(start for start, _ in rows), values, center, sigma, len(known), found)
