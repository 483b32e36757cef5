"""Yield of stored runs: by day, product, station and operator, first-pass yield, and the checks that failed."""

import math
from bisect import bisect_right
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from datetime import date
from statistics import NormalDist
from typing import TypeVar

import numpy as np

from calstation.physics import BoolArray, FloatArray
from calstation.quality.runs import partial_failures, production_runs
from calstation.records import Categories, CheckId, RunColumns, Verdict

#: Probability of the intervals.
_CONFIDENCE = 0.95

K = TypeVar("K", str, date)


@dataclass(frozen=True)
class Share:
    """A number of runs or units that passed, with Wilson's confidence interval of 95 % for its share.

    E. B. Wilson, *Probable Inference, the Law of Succession, and Statistical Inference*, Journal of the American
    Statistical Association 22, 1927, 209-212.
    """

    passed: int
    count: int
    low: float
    high: float

    @classmethod
    def of(cls, passed: int, count: int) -> "Share":
        """Return the share of `count` runs, at least one."""
        share, z = passed / count, NormalDist().inv_cdf(0.5 + _CONFIDENCE / 2.0)
        middle = (share + z**2 / (2 * count)) / (1.0 + z**2 / count)
        half = z / (1.0 + z**2 / count) * math.sqrt(share * (1.0 - share) / count + (z / (2 * count)) ** 2)
        return cls(passed, count, max(0.0, middle - half), min(1.0, middle + half))

    @property
    def value(self) -> float:
        """Fraction that passed."""
        return self.passed / self.count


@dataclass(frozen=True)
class FailedCheck:
    """A check that failed in some runs."""

    id: CheckId
    runs: int
    #: Fraction of the failed runs that failed this check or a more frequent one.
    cumulative: float

    def to_json(self) -> dict[str, str | int | float]:
        """Return JSON data."""
        return {"name": self.id.name, "runs": self.runs, "cumulative": self.cumulative}


@dataclass(frozen=True)
class Yields:
    """Yield of the runs that ended with PASS or FAIL, without partial runs."""

    overall: Share | None  #: Runs that passed; None without runs.
    units: Share | None  #: Units whose last run passed; None without units.
    first_pass: Share | None  #: Units whose first run passed; None without units.
    days: Mapping[str, Share]  #: By date on this computer, ISO 8601, in order.
    products: Mapping[str, Share]  #: By name, sorted, without runs that have no product.
    stations: Mapping[str, Share]
    operators: Mapping[str, Share]
    failed_checks: tuple[FailedCheck, ...]  #: The most frequent first (Pareto).
    partial_failed: int = 0  #: Number of partial runs that failed, which nothing else includes.
    missing: int = 0  #: Number of the runs whose files are missing.


def count_yields(runs: RunColumns, since: float = -math.inf, excluded: Collection[str] = ()) -> Yields:
    """Return the yield of the runs that started at `since` or later, s since 1970 in UTC.

    Runs whose files are missing count, so that deleting files does not raise the yield. Earlier runs only determine
    which units had their first run before. Runs of check standards and of the units `excluded` are omitted. A run that
    failed several checks counts for each of them.
    """
    judged = production_runs(runs, excluded, missing=True)
    units = runs.products.codes[judged] * len(runs.serials.values) + runs.serials.codes[judged]
    first = judged[np.unique(units, return_index=True)[1]]
    last = judged[len(judged) - 1 - np.unique(units[::-1], return_index=True)[1]]
    selected, first, last = (rows[runs.started[rows] >= since] for rows in (judged, first, last))
    passed = runs.verdicts.isin((Verdict.PASSED,))
    days: dict[date, Share] = _by(_days(runs.started[selected]), passed[selected])
    products, stations, operators = (
        _by(column.take(selected), passed[selected]) for column in (runs.products, runs.stations, runs.operators)
    )
    failed = selected[~passed[selected]]
    partial = partial_failures(runs, excluded)
    return Yields(
        overall=_share(passed[selected]),
        units=_share(passed[last]),
        first_pass=_share(passed[first]),
        days={day.isoformat(): share for day, share in days.items()},
        products=products,
        stations=stations,
        operators=operators,
        failed_checks=_pareto([runs.failed_checks[k] for k in failed.tolist()]),
        partial_failed=int(np.count_nonzero(runs.started[partial] >= since)),
        missing=int(np.count_nonzero(runs.missing[selected])),
    )


def _days(started: FloatArray) -> Categories[date | None]:
    """Return the local dates of chronological times, s since 1970."""
    days: list[date | None] = []
    codes = np.empty(len(started), dtype=np.int64)
    first = 0
    while first < len(started):
        day = date.fromtimestamp(started[first])
        stop = bisect_right(started, day, first, key=date.fromtimestamp)
        codes[first:stop] = len(days)
        days.append(day)
        first = stop
    return Categories(tuple(days), codes)


def _share(passed: BoolArray) -> Share | None:
    return Share.of(int(np.count_nonzero(passed)), len(passed)) if len(passed) else None


def _by(groups: Categories[K | None], passed: BoolArray) -> dict[K, Share]:
    """Return the share that passed in each group, sorted by group; `groups` contains the group of each run."""
    counts, passed_counts = (
        np.bincount(codes, minlength=len(groups.values)) for codes in (groups.codes, groups.codes[passed])
    )
    totals = {name: (int(passed_counts[k]), int(counts[k])) for k, name in enumerate(groups.values) if counts[k]}
    return {name: Share.of(*totals[name]) for name in sorted(name for name in totals if name is not None)}


def _pareto(failed: Sequence[tuple[CheckId, ...]]) -> tuple[FailedCheck, ...]:
    counts = Counter(check for checks in failed for check in set(checks))
    order = sorted(counts, key=lambda check: (-counts[check], check.name))
    rank = {check: k for k, check in enumerate(order)}
    leading_runs = Counter(min(rank[check] for check in checks) for checks in failed if checks)
    covered_runs, rows = 0, []
    for k, check in enumerate(order):
        covered_runs += leading_runs[k]
        rows.append(FailedCheck(check, counts[check], covered_runs / len(failed)))
    return tuple(rows)
