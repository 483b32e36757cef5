"""Stored runs of a product, and selection of the runs for statistics."""

from collections.abc import Collection
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import lru_cache
from pathlib import Path

import numpy as np

from calstation.messages import Text
from calstation.physics import BoolArray, IntArray
from calstation.records import RunColumns, RunFilter, Verdict
from calstation.results import History


@dataclass(frozen=True)
class SimulatedRuns:
    """The simulated runs among stored runs; statistics leave them out, unless all runs are simulated."""

    count: int = 0
    only: bool = False  #: Whether all runs are simulated.

    @classmethod
    def among(cls, folder: Path, product: str, station: str = "", since: datetime | None = None) -> "SimulatedRuns":
        """Count the simulated runs of a product and a station in a folder, "" for all of them, from `since` on.

        Whether all runs are simulated does not depend on `since`.
        """
        history, runs = History(folder), RunFilter(product=product, station=station, missing=None)
        simulated = replace(runs, simulated=True)
        only = history.count(simulated) > 0 and not history.count(replace(runs, simulated=False))
        start = "" if since is None else f"{since.astimezone(UTC):%Y-%m-%dT%H:%M:%S}"
        return cls(history.count(replace(simulated, since=start)), only)

    @property
    def text(self) -> Text | None:
        """Sentence about the runs that the statistics leave out, if any, or that all runs are simulated."""
        if not self.count:
            return None
        return Text("quality.all_simulated") if self.only else Text.of("quality.simulated_left_out", count=self.count)

    def to_json(self) -> dict[str, int | bool]:
        """Return JSON data."""
        return {"left_out": 0 if self.only else self.count, "only": self.only}


#: No simulated runs.
NOT_SIMULATED = SimulatedRuns()


def product_runs(folder: Path, product: str, station: str = "", *, measured: bool) -> RunColumns:
    """Return the runs of a product and a station in a folder, "" for all of them, from the folder's index.

    If `measured`, simulated runs are left out (`SimulatedRuns` decides this for statistics of a folder). Runs whose
    files are missing are included. The runs are read again only if the index has changed or the last calls were for
    other runs, so that repeated statistics of 100,000 runs do not read them again.
    """
    return _columns(folder, product, station, History(folder).mark(), measured)


@lru_cache(maxsize=3)
def _columns(folder: Path, product: str, station: str, mark: str | None, measured: bool) -> RunColumns:
    return History(folder, measured=measured).columns(RunFilter(product=product, station=station, missing=None))


def judged_runs(runs: RunColumns, *, missing: bool = False) -> IntArray:
    """Return the indices of the complete runs that ended with PASS or FAIL; `missing` includes runs without files."""
    judged = ~runs.partial & runs.verdicts.isin((Verdict.PASSED, Verdict.FAILED))
    return np.flatnonzero(judged if missing else judged & ~runs.missing)


def production_runs(runs: RunColumns, excluded: Collection[str], *, missing: bool = False) -> IntArray:
    """Return the indices of `judged_runs` without runs of check standards and of the units `excluded`."""
    judged = judged_runs(runs, missing=missing)
    return judged[~_of_standards(runs, excluded)[judged]]


def partial_failures(runs: RunColumns, excluded: Collection[str]) -> IntArray:
    """Return the indices of partial runs that failed, without the runs that `production_runs` excludes."""
    failed = runs.partial & runs.verdicts.isin((Verdict.FAILED,))
    return np.flatnonzero(failed & ~_of_standards(runs, excluded))


def _of_standards(runs: RunColumns, excluded: Collection[str]) -> BoolArray:
    return np.asarray(runs.check_standard | runs.serials.isin(excluded))


def first_of_each_unit(runs: RunColumns, rows: IntArray) -> IntArray:
    """Return the first run of each unit, in order; later runs do not change it. `rows` are runs of one product."""
    _, first = np.unique(runs.serials.codes[rows], return_index=True)
    return np.sort(rows[first])


def last_of_each_unit(runs: RunColumns, rows: IntArray) -> IntArray:
    """Return the last run of each unit, in order; a repeated unit counts once. `rows` are runs of one product."""
    _, last = np.unique(runs.serials.codes[rows][::-1], return_index=True)
    return np.sort(rows[::-1][last])
