"""Plan of a study of repeatability and reproducibility: which unit is measured by whom in which order."""

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import AwareDatetime, BaseModel, ConfigDict, Field

from calstation.errors import ConfigurationError, InputError
from calstation.messages import os_reason
from calstation.physics import FloatArray
from calstation.quality.gauge import crossed
from calstation.records import RunColumns, write_atomic

SCHEMA: Literal["calstation.gauge_plan/1"] = "calstation.gauge_plan/1"


class Measurement(BaseModel):
    """A run of the study."""

    model_config = ConfigDict(frozen=True)

    trial: int  #: From 1.
    appraiser: str  #: Operator or station.
    unit: str  #: Serial number.


class GaugePlan(BaseModel):
    """Plan of a study, stored as JSON."""

    model_config = ConfigDict(frozen=True, populate_by_name=True)

    schema_name: Literal["calstation.gauge_plan/1"] = Field(default=SCHEMA, alias="schema")
    by: Literal["operator", "station"]  #: What the appraisers are.
    units: tuple[str, ...]
    appraisers: tuple[str, ...]
    trials: int
    seed: int
    created_utc: AwareDatetime  #: Earlier runs do not count.
    order: tuple[Measurement, ...]

    @classmethod
    def random(
        cls,
        by: Literal["operator", "station"],
        units: Sequence[str],
        appraisers: Sequence[str],
        trials: int,
        seed: int,
        created_utc: datetime,
    ) -> "GaugePlan":
        """Return a plan in random order: in every trial, each appraiser measures all units in an order of their own.

        AIAG, *Measurement Systems Analysis*, 4th ed., chapter III section B. Raises InputError for a plan with fewer
        than two units, appraisers or trials, or with a unit or appraiser that is named twice.
        """
        twice = [name for names in (units, appraisers) for name, count in Counter(names).items() if count > 1]
        if twice:
            raise InputError("quality.named_twice", names=", ".join(twice))
        if min(len(units), len(appraisers), trials) < 2:
            raise InputError("quality.small_study", parts=len(units), appraisers=len(appraisers), trials=trials)
        generator = np.random.default_rng(seed)
        order = [
            Measurement(trial=trial, appraiser=appraisers[who], unit=units[k])
            for trial in range(1, trials + 1)
            for who in generator.permutation(len(appraisers))
            for k in generator.permutation(len(units))
        ]
        return cls(
            by=by,
            units=tuple(units),
            appraisers=tuple(appraisers),
            trials=trials,
            seed=seed,
            created_utc=created_utc,
            order=tuple(order),
        )

    @classmethod
    def load(cls, path: Path) -> "GaugePlan":
        """Read a plan. Raises InputError."""
        try:
            return cls.model_validate_json(path.read_text(encoding="utf-8"))
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

    def remaining(self, runs: RunColumns) -> list[Measurement]:
        """Return the runs of the plan that are not among the stored runs, in order."""
        done = Counter(key for key, _ in self._measurements(runs))
        left = []
        for each in self.order:
            key = (each.unit, each.appraiser)
            done[key] -= 1
            if done[key] < 0:
                left.append(each)
        return left

    def check_complete(self, left: Sequence[Measurement]) -> None:
        """Raise InputError if runs of the plan are left."""
        if left:
            following = f"{left[0].unit}, {left[0].appraiser}"
            raise InputError("quality.study_incomplete", missing=len(left), runs=len(self.order), next=following)

    def values(self, runs: RunColumns) -> Mapping[str, FloatArray]:
        """Return the measured values by parameter, SI, shape (units, appraisers, trials).

        A parameter that a run of the study lacks is left out. Raises InputError while runs of the plan are missing.
        """
        self.check_complete(self.remaining(runs))
        rows = self._measurements(runs)
        found = {}
        for name, column in runs.values.items():
            values = [(unit, who, float(column[k])) for (unit, who), k in rows]
            if not np.isnan([value for *_, value in values]).any():
                found[name] = crossed(values)[2]
        return found

    def products(self, runs: RunColumns) -> set[str | None]:
        """Return the products of the stored runs of the plan."""
        return {runs.products[k] for _, k in self._measurements(runs)}

    def _measurements(self, runs: RunColumns) -> list[tuple[tuple[str, str], int]]:
        """Return unit and appraiser, and the index, of the first full runs of the study that were judged."""
        appraisers = runs.operators if self.by == "operator" else runs.stations
        taken: Counter[tuple[str, str]] = Counter()
        found = []
        for k in np.flatnonzero((runs.started >= self.created_utc.timestamp()) & ~runs.partial):
            key = (runs.serials[k], appraisers[k] or "")
            wanted = key[0] in self.units and key[1] in self.appraisers and runs.verdicts[k] in ("passed", "failed")
            if wanted and taken[key] < self.trials:
                taken[key] += 1
                found.append((key, int(k)))
        return found
