"""Score tests along a chain of stages: what the innovations say about each effect outside the model.

The test of one added effect of size θ needs only the estimate without it: χ² = Uᵀ I⁻¹ U with the score U = Σ Jᵀ S⁻¹ ν
and the information I = Σ Jᵀ S⁻¹ J (C. R. Rao, *Proc. Cambridge Phil. Soc.* 44, 1948; for jumps in state-space models:
P. de Jong, J. Penzer, *Diagnosing shocks in time series*, JASA 93(442), 1998). Its size is I⁻¹ U, and it leaves the
errors D I⁻¹ U in the parameters.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calstation.estimation.common import Belief
from calstation.estimation.effects.candidates import CONSTANT, Candidate
from calstation.estimation.effects.sensitivity import Sensitivity
from calstation.physics import COUNT, INDEX, NAMES, FloatArray

#: Jumps between two stages are looked for in these groups.
_JUMPING = ("gyro_bias", "gyro_scale", "accel_bias", "accel_scale")


@dataclass(frozen=True)
class EffectFound:
    """What the data say about one effect."""

    cause: str
    component: str  #: The most significant component.
    parameter: str  #: Parameter that changed; "" for a constant effect.
    stage: str  #: Stage during or before which it changed; "" for a constant effect.
    excess: float  #: χ² minus its degrees of freedom.
    size: float  #: Estimated size of the component, in `unit`.
    sigma: float
    unit: str
    moves: dict[str, float]  #: Error that the effect leaves in each estimated parameter, in its sigmas.

    @property
    def largest_move(self) -> float:
        """Largest of `moves`."""
        return max((abs(move) for move in self.moves.values()), default=0.0)


@dataclass
class _Tested:
    """A candidate with its score, information and the error that it leaves so far."""

    candidate: Candidate
    stage: str
    score: FloatArray
    information: FloatArray
    error: FloatArray

    def found(self, before: FloatArray, sigma: FloatArray, names: Sequence[str]) -> EffectFound:
        """Evaluate the test with the standard deviations of the 30 parameters before calibration, and now."""
        plausible = self.candidate.plausible or float(before[INDEX[self.candidate.parameter]])
        covariance = np.linalg.inv(plausible**2 * self.information + np.eye(len(self.score))) * plausible**2
        size, own = covariance @ self.score, np.sqrt(np.diag(covariance))
        freedom = float(np.sum(covariance * self.information))
        best = int(np.argmax(np.abs(size) / own))
        moved = self.error @ size / np.where(sigma > 0.0, sigma, np.inf)
        c = self.candidate
        return EffectFound(
            c.cause, c.components[best], c.parameter, self.stage, float(self.score @ size) - freedom,
            float(size[best]), float(own[best]), c.unit, {name: float(moved[INDEX[name]]) for name in names},
        )  # fmt: skip


class EffectTests:
    """The tests of all effects over the stages so far."""

    def __init__(self, before: FloatArray) -> None:
        """Begin with the standard deviations of the 30 parameters before calibration, shape (30,)."""
        self._before = before
        count = sum(len(c.components) for c in CONSTANT)
        self._score, self._information = np.zeros(count), np.zeros((count, count))
        self._error = np.zeros((COUNT, count))
        self._changes: list[_Tested] = []
        self._names: dict[str, None] = {}

    def add(self, stage: str, s: Sensitivity, estimated: Sequence[str]) -> None:
        """Add a stage that estimated some parameters."""
        count = len(self._score)
        prior, constant = slice(0, COUNT), slice(COUNT, COUNT + count)
        into = np.vstack([self._error, np.eye(count)])
        both = slice(0, COUNT + count)
        self._score += into.T @ s.score[both]
        self._information += into.T @ s.information[both, both] @ into
        self._error = s.error[:, prior] @ self._error + s.error[:, constant]
        if self._names:  # before the first stage, a jump is an error of the prior
            self._changes += [_before(stage, name) for name in NAMES if name.rpartition("_")[0] in _JUMPING]
        for change in self._changes:
            change.score = change.score + change.error.T @ s.score[prior]
            change.information = change.information + change.error.T @ s.information[prior, prior] @ change.error
            change.error = s.error[:, prior] @ change.error
        at = COUNT + count
        for candidate in s.changing:
            own = slice(at, at := at + len(candidate.components))
            error = s.error[:, own].copy()
            error[INDEX[candidate.parameter]] += candidate.change(s.duration)
            self._changes.append(_Tested(candidate, stage, s.score[own], s.information[own, own], error))
        self._names |= dict.fromkeys(estimated)

    def found(self, belief: Belief) -> list[EffectFound]:
        """Return what the data say about every effect, the most significant first; `belief` is the latest posterior."""
        tests, at = list(self._changes), 0
        for c in CONSTANT:
            own = slice(at, at := at + len(c.components))
            tests.append(_Tested(c, "", self._score[own], self._information[own, own], self._error[:, own]))
        names = tuple(self._names)
        return sorted((t.found(self._before, belief.sigma, names) for t in tests), key=lambda f: -f.excess)


def _before(stage: str, name: str) -> _Tested:
    """Return the test for a jump of a parameter before a stage."""
    unit = {"gyro_bias": "rad/s", "accel_bias": "m/s²"}.get(name.rpartition("_")[0], "1")
    candidate = Candidate("jump_before", unit, None, ("",), lambda motion: np.empty(0), name)
    return _Tested(candidate, stage, np.zeros(1), np.zeros((1, 1)), np.eye(COUNT)[:, [INDEX[name]]])
