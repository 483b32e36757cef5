"""Tests of the model against the data, diagnoses of failed tests, and the agreement of a stage with earlier ones.

If the model is correct, the change of an optimal estimate by new data has the covariance P_before − P_after and is
uncorrelated with the error of the new estimate (J. A. Hausman, *Specification tests in econometrics*, Econometrica
46(6), 1978).
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.special import gammaincc

from calstation.estimation.common.context import Posterior
from calstation.messages import Text, values_from_json
from calstation.physics import NAMES, PARAMETERS, display, display_by_unit

#: Largest number of parameters listed in the message about a failed test.
_MAX_SHIFTS = 3
#: Smallest relative decrease of the variance in a direction in which the change is tested.
_MIN_DECREASE = 1e-4


@dataclass(frozen=True)
class Diagnosis:
    """Diagnosis of a failed model test: the cause, its size, and its effect on the result."""

    cause: str  #: Code of the cause in the message catalogue, without the family ``cause``.
    size: float = math.nan  #: Estimated size, in `unit`; NaN if there is none.
    sigma: float = math.nan  #: Standard deviation of `size`.
    unit: str = "1"  #: SI
    #: Shift of each parameter due to the cause, estimate minus truth, in sigmas, by name; for a test that compares two
    #: estimates, their difference.
    parameter_shift: Mapping[str, float] = field(default_factory=dict)
    values: Mapping[str, Any] = field(default_factory=dict)  #: Further values of the message, JSON values.

    def text(self, stage: str) -> Text:
        """Return the message about the cause in a stage."""
        parameter = self.values.get("parameter", "")
        (size, unit), (sigma, _) = (
            display(parameter, value) if parameter else display_by_unit(self.unit, value)
            for value in (self.size, self.sigma)
        )
        shifts = self.parameter_shift
        largest = sorted(shifts, key=lambda name: -abs(shifts[name]))[:_MAX_SHIFTS]
        shift_texts = [Text.of("cause.move", parameter=name, sigmas=shifts[name]) for name in largest]
        size_values = {"size": size, "sigma": sigma, "unit": unit, "moves": shift_texts, "stage": stage}
        text = Text(f"cause.{self.cause}", {**size_values, **values_from_json(self.values)})
        other = self.values.get("nearly_as_likely")
        return Text.of("cause.nearly_as_likely", cause=text, other=other) if other else text

    def to_json(self) -> dict[str, Any]:
        """Return the entries of a check in the result JSON."""
        size, sigma = (None if math.isnan(value) else value for value in (self.size, self.sigma))
        entries = {"cause": self.cause, "size": size, "sigma": sigma, "size_unit": self.unit}
        return {**entries, "moves": dict(self.parameter_shift), "values": dict(self.values)}

    @classmethod
    def from_json(cls, row: Mapping[str, Any]) -> "Diagnosis":
        """Read the entries that `to_json` returns from a check in a result JSON."""
        size, sigma = (math.nan if row[key] is None else row[key] for key in ("size", "sigma"))
        return cls(row["cause"], size, sigma, row["size_unit"], row["moves"], row["values"])


@dataclass(frozen=True)
class ModelTest:
    """A test of the model against the data of a stage, and the diagnosis if it fails."""

    kind: str  #: Kind of the check in the result, see `calstation.records.CheckKind`.
    value: float
    limit: float | tuple[float, float]  #: Largest value, or (lowest, highest).
    unit: str
    diagnosis: Diagnosis

    @property
    def passed(self) -> bool:
        """Whether the value is within its limit."""
        low, high = self.limit if isinstance(self.limit, tuple) else (-math.inf, self.limit)
        return low <= self.value <= high


@dataclass(frozen=True)
class Agreement:
    """The parameter group for which a stage agrees least with the earlier stages."""

    group: str
    probability: float  #: Probability of a change at least as large as this one.
    parameter_shift: dict[str, float]  #: Change of each parameter of the group, in standard deviations of that change.


def stage_agreement(before: Posterior, after: Posterior, names: Sequence[str]) -> Agreement | None:
    """Return the least probable change of a parameter group; None if no group has become more accurate.

    `names` are the parameters that both the stage and an earlier one have estimated.
    """
    agreements = []
    for group in dict.fromkeys(PARAMETERS[NAMES.index(name)].group for name in names):
        i = [k for k, p in enumerate(PARAMETERS) if p.group == group and p.name in names]
        scale = before.sigma[i]
        change = (after.mean[i] - before.mean[i]) / scale
        variance = (before.covariance - after.covariance)[np.ix_(i, i)] / np.outer(scale, scale)
        size, direction = np.linalg.eigh(0.5 * (variance + variance.T))
        determined = size > _MIN_DECREASE
        if not determined.any():
            continue
        total = float(np.sum((direction[:, determined].T @ change) ** 2 / size[determined]))
        probability = float(gammaincc(0.5 * determined.sum(), 0.5 * total))
        variances = np.maximum(np.diag(variance), _MIN_DECREASE)
        shift = {NAMES[k]: float(m) for k, m in zip(i, change / np.sqrt(variances), strict=True)}
        agreements.append(Agreement(group, probability, shift))
    return min(agreements, key=lambda a: a.probability, default=None)
