"""Limits of a product (value `within`, sigma `below`), and the checks against them."""

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import numpy as np
from pydantic import Field, field_validator

from calstation.estimation import Diagnosis, Estimate, ModelTest, Solution
from calstation.estimation.common import Posterior
from calstation.physics import (
    EFFECT_PARAMETERS,
    GROUPS,
    INDEX,
    NAMES,
    OBSERVABLE,
    PAIR_PARAMETERS,
    PARAMETERS,
    entry_of,
    further_parameter,
)
from calstation.schema import EntryError, StrictModel, near_miss

_FURTHER = (*PAIR_PARAMETERS, *EFFECT_PARAMETERS)
FURTHER_GROUPS = tuple(dict.fromkeys(p.group for p in _FURTHER))
#: A value above this fraction of its limit is a near miss, unless the product specifies another fraction.
NEAR = 0.8
#: Decision rule: accept a value within the limits, or within the limits narrowed by its expanded uncertainty.
Rule = Literal["simple", "guard_band"]
#: Coverage factor of the expanded uncertainty.
COVERAGE_FACTOR = 2.0
#: Change of a parameter, in its standard deviations, beyond which the unit no longer matches its calibration.
_CHANGED = 6.0
#: Smallest relative decrease of a variance that is not due to rounding.
_RESOLVED = 1e-6


class Limit(StrictModel):
    """Limits of a parameter or group, SI."""

    within: float | list[float] | None = None  #: Largest magnitude, or [low, high].
    sigma_below: float | None = Field(default=None, gt=0)  #: Largest standard deviation.
    #: Largest standard deviation by the last stage that estimated the parameter, for partial runs.
    sigma_below_after: dict[str, float] = Field(default_factory=dict)

    @field_validator("within")
    @classmethod
    def _ordered(cls, within: float | list[float] | None) -> float | list[float] | None:
        if isinstance(within, list):
            if len(within) != 2 or within[0] >= within[1]:
                raise EntryError("limits.interval", value=str(within))
        elif within is not None and within <= 0:
            raise EntryError("limits.magnitude", value=within)
        return within

    @field_validator("sigma_below_after")
    @classmethod
    def _positive(cls, limits: dict[str, float]) -> dict[str, float]:
        for stage, limit in limits.items():
            if not limit > 0:
                raise EntryError("limits.not_positive", stage, value=limit)
        return limits

    def sigma_limit(self, stage: str) -> float | None:
        """Return the largest standard deviation of a parameter last estimated by `stage`, or None without a limit."""
        return self.sigma_below_after.get(stage, self.sigma_below)

    @property
    def interval(self) -> tuple[float, float] | None:
        """Lowest and highest permitted value, or None without a limit."""
        if self.within is None:
            return None
        if isinstance(self.within, list):
            return self.within[0], self.within[1]
        return -self.within, self.within

    def about(self, nominal: float) -> "Limit":
        """Return the limits of a parameter whose nominal value is not 0."""
        if self.interval is None:
            return self
        return self.model_copy(update={"within": [end + nominal for end in self.interval]})


def acceptance_interval(limits: tuple[float, float], sigma: float, rule: Rule) -> tuple[float, float]:
    """Return the lowest and highest accepted value; nothing is accepted if the lowest is above the highest.

    Simple acceptance, JCGM 106:2012, 8.2, or guarded acceptance with a guard band of the expanded uncertainty on each
    side, 8.3.2 and ILAC-G8:09/2019, 4.2.

    Parameters
    ----------
    limits : lowest and highest permitted true value
    sigma : standard uncertainty of the value
    rule : decision rule
    """
    guard = COVERAGE_FACTOR * sigma if rule == "guard_band" else 0.0
    return limits[0] + guard, limits[1] - guard


def check_limit_names(names: Iterable[str]) -> None:
    """Raise EntryError for a name that is neither a parameter nor a group."""
    known = (*NAMES, *GROUPS, *(p.name for p in _FURTHER), *FURTHER_GROUPS)
    for name in names:
        if name not in known and further_parameter(name) is None:
            raise EntryError("entry.unknown_parameter", name, name=name, remedy=near_miss(name, known))


#: Kind of a check. ``within`` and ``sigma_below`` apply to a parameter, ``consistency`` to a stage, ``previous`` to a
#: parameter or group; ``other`` is a check of another program version; the rest apply to the whole result.
CheckKind = Literal[
    "within",
    "sigma_below",
    "consistency",
    "unobservable",
    "latitude",
    "gravity_at_rest",
    "improvement_at_rest",
    "improvement_at_rest_floor",
    "level_horizontal",
    "level_vertical",
    "motion_angle",
    "motion_improvement",
    "motion_improvement_floor",
    "offline_online",
    "previous",
    "excitation",
    "change",
    "agreement",
    "halves",
    "effects",
    "table_noise",
    "imu_noise",
    "clipping",
    "sample_clock",
    "temperature",
    "convergence",
    "other",
]

#: Kinds of the model tests, one per stage each; if one fails, the following may fail as a consequence.
MODEL_KINDS: tuple[CheckKind, ...] = (
    "clipping",
    "sample_clock",
    "convergence",
    "imu_noise",
    "effects",
    "halves",
    "agreement",
    "table_noise",
    "temperature",
)

#: Names in the result JSON that differ from the kind; the braces are replaced by the subject.
_NAMES: dict[CheckKind, str] = {
    "within": "{} within",
    "sigma_below": "{} sigma below",
    "consistency": "{} consistency",
    "unobservable": "unobservable parameters",
    "previous": "previous {}",
    "change": "change since calibration",
    **{kind: f"{{}} {kind.replace('_', ' ')}" for kind in MODEL_KINDS},
    "other": "{}",
}


@dataclass(frozen=True)
class Where:
    """Origin of the worst value of a check: a parameter, a rest of a stage, or the motions between two rests."""

    parameter: str = ""  #: Name of the parameter, or "".
    stage: str = ""  #: Stage of the rests, or "".
    rest: int | None = None  #: Number of the rest, from 0.
    to: int | None = None  #: Number of the rest after the motions.

    def __str__(self) -> str:
        """Return the text used in the result JSON."""
        if self.rest is None:
            return self.parameter
        return f"{self.stage} rest {self.rest}" + ("" if self.to is None else f" to {self.to}")

    @classmethod
    def from_json(cls, text: str) -> "Where":
        """Parse the text that `str` returns."""
        match text.split(" "):
            case [stage, "rest", rest] if rest.isdecimal():
                return cls(stage=stage, rest=int(rest))
            case [stage, "rest", rest, "to", to] if (rest + to).isdecimal():
                return cls(stage=stage, rest=int(rest), to=int(to))
        return cls(text)


@dataclass(frozen=True)
class Check:
    """A comparison of a value with a limit."""

    kind: CheckKind
    subject: str  #: Parameter, group or stage that is checked; "" for a check of the whole result.
    value: float  #: Compared value, in `unit`; NaN if unknown.
    limit: float | tuple[float, float]  #: Largest value, or (lowest, highest); infinite if unknown.
    unit: str
    passed: bool
    near_miss: bool = False  #: Whether the value is within the limit, but with little margin.
    where: Where = Where()  #: Origin of the value.
    diagnosis: Diagnosis | None = None  #: Meaning of the failure of a model test.
    #: Lowest and highest accepted value if the decision rule narrows the limit.
    acceptance: tuple[float, float] | None = None

    @classmethod
    def of_model(cls, stage: str, test: ModelTest) -> "Check":
        """Return the check for a test of the model against the data of a stage."""
        kind = next(kind for kind in MODEL_KINDS if kind == test.kind)
        check = cls.compare(kind, test.value, test.limit, test.unit, subject=stage, near=1.0)
        return check if check.passed else replace(check, diagnosis=test.diagnosis)

    @classmethod
    def compare(
        cls,
        kind: CheckKind,
        value: float,
        limit: float | tuple[float, float],
        unit: str,
        *,
        subject: str = "",
        near: float = NEAR,
        where: Where | None = None,
        acceptance: tuple[float, float] | None = None,
    ) -> "Check":
        """Compare a value with its limit, or with `acceptance` if the decision rule narrows the limit.

        A value within it but above its fraction `near` is a near miss.
        """
        accepted = acceptance or limit
        low, high = accepted if isinstance(accepted, tuple) else (-math.inf, accepted)
        passed = bool(low <= value <= high)
        width = 0.5 * (high - low) if isinstance(accepted, tuple) else abs(accepted)
        near_miss = bool(passed and 0.0 < width < math.inf and _margin(value, accepted) < (1.0 - near) * width)
        return cls(kind, subject, value, limit, unit, passed, near_miss, where or Where(), acceptance=acceptance)

    @property
    def name(self) -> str:
        """Name in the result JSON."""
        return _NAMES.get(self.kind, self.kind).format(self.subject)

    @property
    def compared_with(self) -> float | tuple[float, float]:
        """The limit, or the acceptance limits if the decision rule narrows it."""
        return self.acceptance or self.limit

    @property
    def margin(self) -> float:
        """Distance of the value from `compared_with`, in `unit`; negative if exceeded."""
        return _margin(self.value, self.compared_with)

    def to_json(self) -> dict[str, Any]:
        """Return the check as a row of the result JSON."""
        row = {
            "name": self.name,
            "value": self.value,
            "limit": list(self.limit) if isinstance(self.limit, tuple) else self.limit,
            "unit": self.unit,
            "passed": self.passed,
            "margin": self.margin,
            "near_miss": self.near_miss,
        }
        if where := str(self.where):
            row["where"] = where
        if self.acceptance is not None:
            row["acceptance"] = list(self.acceptance)
        if self.diagnosis is not None:
            row |= self.diagnosis.to_json()
        return row

    @classmethod
    def from_json(cls, row: Mapping[str, Any]) -> "Check":
        """Read a check from a result JSON of any version of the program."""
        kind, subject = _kind_and_subject(row["name"])
        limit, acceptance = row["limit"], row.get("acceptance")
        return cls(
            kind,
            subject,
            math.nan if row["value"] is None else row["value"],
            (limit[0], limit[1]) if isinstance(limit, list) else math.inf if limit is None else limit,
            row["unit"],
            bool(row["passed"]),
            bool(row.get("near_miss")),
            Where.from_json(row.get("where", "")),
            Diagnosis.from_json(row) if "cause" in row else None,
            None if acceptance is None else (acceptance[0], acceptance[1]),
        )


def _margin(value: float, limit: float | tuple[float, float]) -> float:
    if isinstance(limit, tuple):
        return min(value - limit[0], limit[1] - value)
    return limit - value


def _kind_and_subject(name: str) -> tuple[CheckKind, str]:
    """Return the kind and subject from which `Check.name` was formed."""
    for kind in get_args(CheckKind):
        before, braces, after = _NAMES.get(kind, kind).partition("{}")
        if braces and name.startswith(before) and name.endswith(after):
            return kind, name.removeprefix(before).removesuffix(after)
        if name == before:
            return kind, ""
    return "other", name


def estimated_stage(solutions: Sequence[Solution]) -> dict[str, str]:
    """Return the last stage that estimated each parameter, in the order of the parameter table."""
    last = {name: solution.stage for solution in solutions for name in solution.estimated}
    return {name: last[name] for name in NAMES if name in last}


def unobservable(prior: Posterior, solutions: Sequence[Solution]) -> list[str]:
    """Return estimated parameters that the data do not determine.

    Their sigma is above 0.9 of the prior sigma, or they lie in the unobservable subspace of every stage that estimated
    them, so that only a prior correlation has reduced their sigma.
    """
    if not solutions:
        return []
    before, after = prior.sigma, solutions[-1].posterior.sigma
    lost = [
        name
        for name in estimated_stage(solutions)
        if before[INDEX[name]] > 0
        and (after[INDEX[name]] > OBSERVABLE * before[INDEX[name]] or _not_observed(name, solutions))
    ]
    return lost + [name for s in solutions for name, e in s.found.items() if not e.determined]


def undetermined(prior: Posterior, solutions: Sequence[Solution], calibrated: Collection[str]) -> list[str]:
    """Return unobservable parameters that are not known from the current calibration either.

    The parameters in `calibrated` are known from it if the data determine at least half of the parameters; a run with
    less information, such as a stage ended at its first rest, is not a calibration.
    """
    lost, estimated = unobservable(prior, solutions), estimated_stage(solutions)
    known = calibrated if 2 * sum(name in lost for name in estimated) <= len(estimated) else ()
    return [name for name in lost if name not in known]


def _not_observed(name: str, solutions: Sequence[Solution]) -> bool:
    """Return whether all stages that estimated a parameter have observability analyses without it."""
    states = [s.observability.get("states", {}).get(name) for s in solutions if name in s.estimated]
    return all(state is not None and state["step"] is None for state in states)


def not_compared(limits: Mapping[str, Limit], prior: Posterior, solutions: Sequence[Solution]) -> list[str]:
    """Return parameters with a limit that no stage estimated, or that the data do not determine.

    A partial run is judged only by its own stages, and makes no statement about parameters that its data do not
    determine.
    """
    estimated, lost = estimated_stage(solutions), unobservable(prior, solutions)
    limited = [p.name for p in PARAMETERS if p.name in limits or p.group in limits]
    return [name for name in limited if name not in estimated or name in lost]


def check_limits(
    limits: Mapping[str, Limit],
    prior: Posterior,
    solutions: Sequence[Solution],
    near: float = NEAR,
    calibrated: Collection[str] = (),
    rule: Rule = "simple",
) -> list[Check]:
    """Compare the result of a chain of stages with the limits of its product by a decision rule.

    A value above the fraction `near` of its limit is a near miss. A parameter's limit overrides the limit of its group;
    only parameters that were estimated and determined by the data are compared. Innovations, if a stage had any to
    test, and undetermined parameters are checked without near misses. The change of the parameters in `calibrated`,
    whose prior is the current calibration, is compared with its sigma.
    """
    if not solutions:
        return []
    posterior = solutions[-1].posterior
    sigma, lost = posterior.sigma, unobservable(prior, solutions)
    checks = []
    for name, stage in estimated_stage(solutions).items():
        if name in lost:
            continue
        i = INDEX[name]
        limit = entry_of(limits, name)
        if limit is not None:
            estimate = Estimate(float(posterior.mean[i]), float(sigma[i]), PARAMETERS[i].unit)
            checks += _check_estimate(name, estimate, limit, limit.sigma_limit(stage), near, rule)
    for s in solutions:
        for name, estimate in s.found.items():
            limit = entry_of(limits, name)
            if limit is not None:
                checks += _check_estimate(name, estimate, limit, limit.sigma_below, near, rule)
    last = solutions[-1]  # the last solution's test for effects uses all stages
    model = [
        Check.of_model(s.stage, test) for s in solutions for test in s.tests if test.kind != "effects" or s is last
    ]
    checks += sorted(model, key=lambda check: [*MODEL_KINDS].index(check.kind))
    for s in solutions:
        c = s.consistency
        if c.count:
            diagnosis = None if c.passed else s.diagnosis
            checks.append(
                Check("consistency", s.stage, c.nis_mean, c.nis_high, "1", bool(c.passed), diagnosis=diagnosis)
            )
    unknown = undetermined(prior, solutions, calibrated)
    checks.append(Check("unobservable", "", float(len(unknown)), 0.0, "1", not unknown))
    changes = _changes(prior, posterior, [n for n in estimated_stage(solutions) if n in calibrated])
    if changes:
        worst = max(changes, key=lambda name: changes[name])
        checks.append(Check.compare("change", changes[worst], _CHANGED, "sigma", near=1.0, where=Where(worst)))
    return checks


def _changes(prior: Posterior, found: Posterior, names: Sequence[str]) -> dict[str, float]:
    """Return the change of each parameter by the data, in standard deviations of the change expected from the prior.

    The variance of the change is the decrease of the parameter's variance.
    """
    before, after = np.diag(prior.covariance), np.diag(found.covariance)
    found_changes = {}
    for name in names:
        i = INDEX[name]
        variance = before[i] - after[i]
        if variance > _RESOLVED * before[i]:
            found_changes[name] = float(abs(found.mean[i] - prior.mean[i]) / np.sqrt(variance))
    return found_changes


def _check_estimate(
    name: str, estimate: Estimate, limit: Limit, sigma_limit: float | None, near: float, rule: Rule
) -> list[Check]:
    checks, unit = [], estimate.unit
    if limit.interval is not None:
        accepted = None if rule == "simple" else acceptance_interval(limit.interval, estimate.sigma, rule)
        check = Check.compare(
            "within", estimate.value, limit.interval, unit, subject=name, near=near, acceptance=accepted
        )
        if accepted is not None and accepted[0] > accepted[1]:
            guard = COVERAGE_FACTOR * estimate.sigma
            check = replace(check, diagnosis=Diagnosis("guard_band", guard, unit=unit, values={"parameter": name}))
        checks.append(check)
    if sigma_limit is not None:
        checks.append(Check.compare("sigma_below", estimate.sigma, sigma_limit, unit, subject=name, near=near))
    return checks
