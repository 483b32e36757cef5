"""Plan of a study of repeatability and reproducibility, in a random order, and its evaluation from the stored runs."""

import json
from bisect import bisect
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from itertools import product
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import AwareDatetime, BaseModel, ConfigDict, Field

from calstation.config import known_products, load_product
from calstation.errors import ConfigurationError, InputError
from calstation.jobs import ProgressCallback
from calstation.messages import os_reason
from calstation.parsing import MAX_JSON, read_limited
from calstation.physics import NAMES, FloatArray, IntArray, further_parameter
from calstation.quality.gauge import GaugeStudy, check_size, crossed, gauge_study, ranges_beyond
from calstation.quality.runs import NOT_SIMULATED, SimulatedRuns, judged_runs, product_runs
from calstation.quality.summary import limit_interval
from calstation.records import Categories, RunColumns, RunFilter, write_atomic
from calstation.results import History

SCHEMA: Literal["calstation.gauge_plan/2"] = "calstation.gauge_plan/2"


class Measurement(BaseModel):
    """A run of the study."""

    model_config = ConfigDict(frozen=True)

    trial: int  #: From 1.
    unit: str  #: Serial number.
    operator: str | None = None  #: None if the operators are not a factor of the study.
    station: str | None = None

    @property
    def appraiser(self) -> str:
        """Operator or station of the measurement."""
        return ", ".join(filter(None, (self.operator, self.station)))


class GaugePlan(BaseModel):
    """Plan of a study, stored as JSON: units of a product crossed with operators, with stations, or with both."""

    model_config = ConfigDict(frozen=True, populate_by_name=True)

    schema_name: Literal["calstation.gauge_plan/2"] = Field(default=SCHEMA, alias="schema")
    product: str  #: Name of the product of the units; runs of other products are ignored.
    units: tuple[str, ...]
    operators: tuple[str, ...] = ()  #: Empty if the operators are not a factor of the study.
    stations: tuple[str, ...] = ()
    trials: int
    seed: int
    created_utc: AwareDatetime  #: Earlier runs are ignored.
    order: tuple[Measurement, ...]

    @classmethod
    def random(
        cls,
        product: str,
        units: Sequence[str],
        operators: Sequence[str],
        stations: Sequence[str],
        trials: int,
        seed: int,
        created_utc: datetime,
    ) -> "GaugePlan":
        """Return a plan in random order: in every trial, each appraiser measures all units in a separate random order.

        An appraiser is an operator, a station, or an operator at a station if both are factors. AIAG, *Measurement
        Systems Analysis*, 4th ed., chapter III section B.

        Parameters
        ----------
        product : name of the product
        units : serial numbers
        operators, stations : their names; empty if they are not a factor of the study
        trials : number of runs of each unit by each appraiser
        seed : seed of the random order
        created_utc : time of the plan; earlier runs are ignored

        Raises
        ------
        InputError : if there are fewer than two units, trials or levels of a factor, if there is no factor, or if a
            name is repeated
        """
        factors = {"unit": units, **{k: v for k, v in (("operator", operators), ("station", stations)) if v}}
        repeated = [name for names in factors.values() for name, count in Counter(names).items() if count > 1]
        if repeated:
            raise InputError("quality.named_twice", names=", ".join(repeated))
        if len(factors) == 1:
            raise InputError("quality.no_appraisers")
        check_size({name: len(names) for name, names in factors.items()}, trials)
        generator = np.random.default_rng(seed)
        appraisers = [(operator, station) for operator in operators or (None,) for station in stations or (None,)]
        order = [
            Measurement(trial=trial, unit=units[k], operator=appraisers[a][0], station=appraisers[a][1])
            for trial in range(1, trials + 1)
            for a in generator.permutation(len(appraisers))
            for k in generator.permutation(len(units))
        ]
        return cls(
            product=product,
            units=tuple(units),
            operators=tuple(operators),
            stations=tuple(stations),
            trials=trials,
            seed=seed,
            created_utc=created_utc,
            order=tuple(order),
        )

    @property
    def factors(self) -> tuple[str, ...]:
        """Names of the factors, the units first."""
        return ("unit", *(["operator"] if self.operators else []), *(["station"] if self.stations else []))

    @classmethod
    def load(cls, path: Path) -> "GaugePlan":
        """Read a plan. Raises InputError."""
        try:
            return cls.model_validate_json(read_limited(path, MAX_JSON))
        except OSError as exc:
            raise InputError("result.unreadable", file=path, reason=os_reason(exc)) from exc
        except ValueError as exc:
            raise InputError("quality.not_a_plan", file=path, schema=SCHEMA) from exc

    def save(self, path: Path) -> None:
        """Write the plan. Raises ConfigurationError."""
        try:
            write_atomic(
                path, json.dumps(self.model_dump(by_alias=True, mode="json"), indent=1, ensure_ascii=False) + "\n"
            )
        except OSError as exc:
            raise ConfigurationError("result.unwritable", file=path, reason=os_reason(exc)) from exc

    @property
    def appraisers(self) -> tuple[str, ...]:
        """Operators, stations, or operators at stations, as in `Measurement.appraiser` and in the order of `values`."""
        return tuple(", ".join(names) for names in product(*filter(None, (self.operators, self.stations))))

    def remaining(self, runs: RunColumns) -> list[Measurement]:
        """Return the runs of the plan that are missing in the stored runs, in the order of the plan."""
        counts = Counter(key for key, _ in self._measurements(runs))
        missing = []
        for each in self.order:
            key = self._key(each)
            counts[key] -= 1
            if counts[key] < 0:
                missing.append(each)
        return missing

    def out_of_order(self, runs: RunColumns) -> int:
        """Return the smallest number of stored runs that must be moved to obtain the planned order."""
        planned: dict[tuple[str, ...], list[int]] = {}
        for number, each in enumerate(self.order):
            planned.setdefault(self._key(each), []).append(number)
        positions = [planned[key].pop(0) for key, _ in self._measurements(runs)]
        ends: list[int] = []  # last elements of the longest increasing sequences, by length
        for position in positions:
            at = bisect(ends, position)
            ends[at : at + 1] = [position]
        return len(positions) - len(ends)

    def check_complete(self, missing: Sequence[Measurement]) -> None:
        """Raise InputError if runs of the plan are missing."""
        if missing:
            next_run = f"{missing[0].unit}, {missing[0].appraiser}"
            raise InputError("quality.study_incomplete", missing=len(missing), runs=len(self.order), next=next_run)

    def values(self, runs: RunColumns) -> Mapping[str, FloatArray]:
        """Return the measured values by parameter, SI, shape (number of levels of each factor, trials).

        The levels are in the order of the plan, and the trials in chronological order.
        A parameter that is missing in a run of the study is omitted. Raises InputError while runs of the plan are
        missing.
        """
        self.check_complete(self.remaining(runs))
        levels = self.units, *filter(None, (self.operators, self.stations))
        ranks = [{name: k for k, name in enumerate(names)} for names in levels]
        rows = sorted(
            self._measurements(runs), key=lambda row: [rank[name] for rank, name in zip(ranks, row[0], strict=True)]
        )
        by_parameter = {}
        for name, column in runs.values.items():
            values = [(key, float(column[k])) for key, k in rows]
            if not np.isnan([value for _, value in values]).any():
                by_parameter[name] = crossed(self.factors, values)[1]
        return by_parameter

    def _key(self, each: Measurement) -> tuple[str, ...]:
        return tuple(getattr(each, factor) for factor in self.factors)

    def count(self, runs: RunColumns) -> int:
        """Return the number of complete, judged runs of the study, including surplus runs and runs without files."""
        return len(self._rows(runs, missing=True))

    def _rows(self, runs: RunColumns, *, missing: bool = False) -> IntArray:
        """Return the indices of the complete, judged runs of the study; `missing` includes runs without files."""
        rows = judged_runs(runs, missing=missing)
        rows = rows[(runs.started[rows] >= self.created_utc.timestamp()) & runs.products.isin((self.product,))[rows]]
        for factor in self.factors:
            rows = rows[self._columns(runs)[factor].isin(getattr(self, f"{factor}s"))[rows]]
        return rows

    @staticmethod
    def _columns(runs: RunColumns) -> dict[str, Categories[Any]]:
        return {"unit": runs.serials, "operator": runs.operators, "station": runs.stations}

    def _measurements(self, runs: RunColumns) -> list[tuple[tuple[str, ...], int]]:
        """Return factor levels and index of the first complete, judged runs of the study, in chronological order."""
        columns = self._columns(runs)
        counts: Counter[tuple[str, ...]] = Counter()
        measurements = []
        for k in self._rows(runs).tolist():
            key = tuple(str(columns[factor][k]) for factor in self.factors)
            if counts[key] < self.trials:
                counts[key] += 1
                measurements.append((key, k))
        return measurements


@dataclass(frozen=True)
class StudyState:
    """A plan and its evaluation from the stored runs."""

    plan: GaugePlan
    missing: tuple[Measurement, ...]  #: Runs in the plan that were not made or whose files are missing, in order.
    out_of_order: int  #: Number of runs that were not made in the planned order.
    studies: Mapping[str, GaugeStudy]  #: By parameter, SI; empty while runs are missing.
    values: Mapping[str, FloatArray]  #: By parameter, SI; see `GaugePlan.values`.
    lost: tuple[Measurement, ...] = ()  #: Measurements in `missing` that were made, but whose files are missing.
    simulated: SimulatedRuns = NOT_SIMULATED

    def by_appraiser(self, name: str) -> FloatArray:
        """Return the values of a parameter, SI, shape (units, appraisers, trials)."""
        return self.values[name].reshape(len(self.plan.units), -1, self.plan.trials)

    def beyond(self, name: str) -> int:
        """Return the number of ranges of a parameter beyond their control limits."""
        return int(ranges_beyond(self.by_appraiser(name)).sum())


def evaluate_study(report: ProgressCallback, folder: Path, path: Path, product: Path | None) -> StudyState:
    """Job: read a plan, update the index of a folder of runs, and evaluate the plan from them.

    The tolerances are the widths of the limits of the plan's product, from the file `product` or by default from the
    known product with this name; an unknown product has none. Simulated runs are left out, unless all runs of the study
    are simulated. Raises InputError or ConfigurationError if the plan or the product cannot be used, or if the plan is
    for another product.
    """
    plan = GaugePlan.load(path)
    config = dict(known_products()).get(plan.product) if product is None else load_product(product)[1]
    if config is not None and config.name != plan.product:
        raise InputError("quality.study_other_product", product=config.name, plan=plan.product)
    History(folder).refresh()
    runs = product_runs(folder, plan.product, measured=True)
    bench_runs = History(folder).columns(RunFilter(product=plan.product, simulated=True, missing=None))
    simulated = SimulatedRuns(count := plan.count(bench_runs), only=count > 0 and not plan.count(runs))
    if simulated.only:
        runs = bench_runs
    missing = tuple(plan.remaining(runs))
    studies = {}
    values: Mapping[str, FloatArray] = {} if missing else plan.values(runs)
    for done, (name, of_levels) in enumerate(values.items(), 1):
        if name in NAMES or further_parameter(name) is not None:
            interval = None if config is None else limit_interval(config, name)
            tolerance = None if interval is None else interval[1] - interval[0]
            studies[name] = gauge_study(plan.factors, of_levels, tolerance)
        report(done / len(values))
    known = replace(runs, missing=np.zeros(len(runs.names), dtype=bool))
    lost = Counter(missing) - Counter(plan.remaining(known))
    return StudyState(plan, missing, plan.out_of_order(runs), studies, values, tuple(lost.elements()), simulated)
