"""A product's limits, which read as a sentence (value within, sigma below), and the checks they lead to."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydantic import Field, field_validator

from calstation.estimation.common.context import Belief
from calstation.estimation.method import Estimate, Solution
from calstation.physics.parameters import (
    GROUPS,
    INDEX,
    NAMES,
    PAIR_PARAMETERS,
    PARAMETERS,
    pair_parameter,
)
from calstation.schema import StrictModel, suggestion

PAIR_GROUPS = tuple(dict.fromkeys(p.group for p in PAIR_PARAMETERS))
#: A value that takes more than this share of its limit is a near-miss, where the product says nothing else.
NEAR = 0.8
#: A posterior sigma above this share of the prior's means that the data did not determine the parameter.
OBSERVABLE_RATIO = 0.9


class Limit(StrictModel):
    """Limits of one parameter or group, SI.

    within : largest magnitude, or [low, high]; sigma_below : largest standard deviation
    sigma_below_after : the same where the named stage was the last to estimate the parameter, so that part of a
        calibration is judged by what that part can do
    """

    within: float | list[float] | None = None
    sigma_below: float | None = Field(default=None, gt=0)
    sigma_below_after: dict[str, float] = Field(default_factory=dict)

    @field_validator("within")
    @classmethod
    def _ordered(cls, within: float | list[float] | None) -> float | list[float] | None:
        if isinstance(within, list):
            if len(within) != 2 or within[0] >= within[1]:
                raise ValueError(f"within = {within} must be [low, high] with low below high")
        elif within is not None and within <= 0:
            raise ValueError(f"within = {within} must be positive or a list [low, high]")
        return within

    @field_validator("sigma_below_after")
    @classmethod
    def _positive(cls, limits: dict[str, float]) -> dict[str, float]:
        for stage, limit in limits.items():
            if not limit > 0:
                raise ValueError(f"sigma_below_after.{stage} = {limit} must be positive")
        return limits

    def sigma_limit(self, stage: str) -> float | None:
        """Largest standard deviation of a parameter that `stage` estimated last, or None where it is free."""
        return self.sigma_below_after.get(stage, self.sigma_below)

    @property
    def interval(self) -> tuple[float, float] | None:
        """Lowest and highest value allowed, or None where the value is free."""
        if self.within is None:
            return None
        if isinstance(self.within, list):
            return self.within[0], self.within[1]
        return -self.within, self.within


def check_limit_names(limits: Mapping[str, Limit]) -> None:
    """Raise ValueError for a key that is neither a parameter nor a group."""
    known = (*NAMES, *GROUPS, *(p.name for p in PAIR_PARAMETERS), *PAIR_GROUPS)
    for name in limits:
        if name not in known and pair_parameter(name) is None:
            raise ValueError(
                f"limits.{name} is no parameter or group{suggestion(name, known) or '; remove it'}"
            )


@dataclass(frozen=True)
class Check:
    """One comparison with a limit; `limit` is a number or (low, high).

    near : a value inside that takes more than this share of its limit is marked; where : what the value is of
    """

    name: str
    value: float
    limit: float | tuple[float, float]
    unit: str
    passed: bool
    near: float = NEAR
    where: str = ""

    @property
    def margin(self) -> float:
        """How far the value is from its limit, in its unit; negative outside."""
        if isinstance(self.limit, tuple):
            return min(self.value - self.limit[0], self.limit[1] - self.value)
        return self.limit - self.value

    @property
    def near_miss(self) -> bool:
        """Inside, but not by much."""
        low, high = self.limit if isinstance(self.limit, tuple) else (-abs(self.limit), abs(self.limit))
        room = 0.5 * (high - low)
        return self.passed and 0.0 < room < np.inf and self.margin < (1.0 - self.near) * room

    def to_json(self) -> dict[str, Any]:
        """The check as the result JSON holds it."""
        limit = list(self.limit) if isinstance(self.limit, tuple) else self.limit
        told = {
            "name": self.name,
            "value": self.value,
            "limit": limit,
            "unit": self.unit,
            "passed": self.passed,
            "margin": self.margin,
            "near_miss": bool(self.near_miss),
        }
        return {**told, "where": self.where} if self.where else told


def estimated_stage(solutions: Sequence[Solution]) -> dict[str, str]:
    """The last stage that estimated each parameter, in the order of the parameter table."""
    last = {name: solution.stage for solution in solutions for name in solution.estimated}
    return {name: last[name] for name in NAMES if name in last}


def unobservable(prior: Belief, solutions: Sequence[Solution]) -> list[str]:
    """Parameters that a stage was asked for and the data did not determine: sigma over 0.9 of its prior's."""
    if not solutions:
        return []
    before, after = prior.sigma, solutions[-1].belief.sigma
    lost = [
        name
        for name in estimated_stage(solutions)
        if after[INDEX[name]] > OBSERVABLE_RATIO * before[INDEX[name]] and before[INDEX[name]] > 0
    ]
    return lost + [name for s in solutions for name, e in s.found.items() if not e.determined]


def not_compared(limits: Mapping[str, Limit], solutions: Sequence[Solution]) -> list[str]:
    """Parameters with a limit that no stage estimated: part of a calibration is judged by that part alone."""
    estimated = estimated_stage(solutions)
    return [p.name for p in PARAMETERS if (p.name in limits or p.group in limits) and p.name not in estimated]


def check_limits(
    limits: Mapping[str, Limit], prior: Belief, solutions: Sequence[Solution], near: float = NEAR
) -> list[Check]:
    """Compare a chain's answer with its product's limits.

    A limit of a parameter's own name goes before its group's. Only parameters that a stage estimated are
    compared; the innovations of every stage and the absence of unobservable parameters are checked besides. A value
    that takes more than `near` of its limit is marked; a mean of innovations varies within its band and never is.
    """
    if not solutions:
        return []
    belief = solutions[-1].belief
    sigma = belief.sigma
    checks = []
    for name, stage in estimated_stage(solutions).items():
        i = INDEX[name]
        limit = limits.get(name, limits.get(PARAMETERS[i].group))
        if limit is None:
            continue
        value, unit = float(belief.mean[i]), PARAMETERS[i].unit
        if limit.interval is not None:
            low, high = limit.interval
            checks.append(Check(f"{name} within", value, (low, high), unit, bool(low <= value <= high), near))
        largest = limit.sigma_limit(stage)
        if largest is not None:
            within = bool(sigma[i] <= largest and np.isfinite(sigma[i]))
            checks.append(Check(f"{name} sigma below", float(sigma[i]), largest, unit, within, near))
    for s in solutions:
        for name, estimate in s.found.items():
            checks += _of_pair(name, estimate, limits, near)
    for s in solutions:
        c = s.consistency
        checks.append(Check(f"{s.stage} consistency", c.nis_mean, c.nis_high, "1", bool(c.passed), 1.0))
    lost = unobservable(prior, solutions)
    checks.append(Check("unobservable parameters", float(len(lost)), 0.0, "1", not lost))
    return checks


def _of_pair(name: str, estimate: Estimate, limits: Mapping[str, Limit], near: float) -> list[Check]:
    """Checks of a pair parameter; a limit of its own name goes before that of its group."""
    parameter = pair_parameter(name)
    limit = limits.get(name, limits.get(parameter.group if parameter else ""))
    checks = []
    if limit is not None and limit.interval is not None:
        low, high = limit.interval
        inside = bool(low <= estimate.value <= high)
        checks.append(Check(f"{name} within", estimate.value, (low, high), estimate.unit, inside, near))
    if limit is not None and limit.sigma_below is not None:
        below = bool(estimate.sigma <= limit.sigma_below)
        checks.append(
            Check(f"{name} sigma below", estimate.sigma, limit.sigma_below, estimate.unit, below, near)
        )
    return checks
