"""Score tests along a chain of stages: evidence in the innovations for each effect outside the model.

The test of one additional effect of size θ requires only the estimate without it: χ² = Uᵀ I⁻¹ U with the score U = Σ Jᵀ
S⁻¹ ν and the information I = Σ Jᵀ S⁻¹ J (C. R. Rao, *Proc. Cambridge Phil. Soc.* 44, 1948; for jumps in state-space
models: P. de Jong, J. Penzer, *Diagnosing shocks in time series*, JASA 93(442), 1998). The estimated size is I⁻¹ U, and
the resulting errors of the parameters are D I⁻¹ U, with D the errors per unit of size.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from calstation.estimation.common import Diagnosis, ModelTest, Posterior
from calstation.estimation.effects.priors import EffectPrior, plausible
from calstation.estimation.effects.sensitivity import Sensitivity, drift_functions
from calstation.physics import AXES, COUNT, EFFECTS, INDEX, Effect, FloatArray, IntArray

#: A score test fails if its χ² exceeds its degrees of freedom by more than `MAX_EXCESS` and the effect shifts a
#: parameter by more than `MIN_SHIFT` sigmas. Any other significant effect is harmless, but may explain other failures.
MAX_EXCESS, MIN_SHIFT = 30.0, 3.0
#: Largest difference between the χ² of the likeliest effect and that of another possible cause.
_MAX_CHI2_DIFFERENCE = 10.0
#: Parameter groups that are tested for jumps between two stages.
_JUMP_GROUPS = ("gyro_bias", "gyro_scale", "accel_bias", "accel_scale")


@dataclass(frozen=True)
class EffectEvidence:
    """Evidence in the data for one effect."""

    cause: str
    component: str  #: The most significant component.
    parameter: str  #: Parameter that changed; "" for a constant effect.
    stage: str  #: Stage during or before which it changed; "" for a constant effect or a drift throughout the run.
    excess: float  #: χ² minus its degrees of freedom.
    size: float  #: Estimated size of the component, in `unit`.
    sigma: float
    unit: str
    parameter_shift: dict[str, float]  #: Error of each estimated parameter due to the effect, in its sigmas.

    @property
    def largest_shift(self) -> float:
        """Largest of `parameter_shift`."""
        return max((abs(shift) for shift in self.parameter_shift.values()), default=0.0)


def effect_tests(evidence: Sequence[EffectEvidence]) -> tuple[ModelTest | None, ModelTest | None]:
    """Return the tests of a harmful and of a significant but harmless effect outside the error model.

    `evidence` contains all effects, the likeliest first. An effect nearly as likely as the first may be the harmful
    one. Either test is None if there is no such effect; only the first test can pass.
    """
    if not evidence:
        return None, None
    significant = evidence[0].excess > MAX_EXCESS
    likely = (
        effect
        for effect in evidence
        if effect.excess > evidence[0].excess - _MAX_CHI2_DIFFERENCE and (effect.excess > MAX_EXCESS) == significant
    )
    harmful = next((effect for effect in likely if effect.largest_shift > MIN_SHIFT), None)
    if harmful is not None:
        return _test(harmful), None
    return None, _test(evidence[0]) if significant else None


def _test(evidence: EffectEvidence) -> ModelTest:
    values = {"component": evidence.component, "parameter": evidence.parameter, "during": evidence.stage}
    diagnosis = Diagnosis(
        evidence.cause, evidence.size, evidence.sigma, evidence.unit, evidence.parameter_shift, values
    )
    return ModelTest("effects", evidence.excess, MAX_EXCESS, "1", diagnosis)


@dataclass(frozen=True)
class EffectLimit:
    """Detection limit of a schedule for one component of an effect."""

    cause: str
    component: str
    parameter: str  #: As in `EffectEvidence`.
    stage: str  #: As in `EffectEvidence`.
    size: float  #: Size at which χ² reaches its limit, in `unit`; infinite if the innovations do not depend on it.
    unit: str
    moved: str  #: Estimated parameter that this size shifts most.
    move: float  #: Error of this parameter due to this size, in its sigmas.


@dataclass
class _EffectTest:
    """Score, information and accumulated parameter error of an effect."""

    effect: Effect
    stage: str
    score: FloatArray
    information: FloatArray
    cross: FloatArray  #: Cross information with the components of `EFFECTS`, shape (k, components).
    error: FloatArray

    @classmethod
    def initial(cls, effect: Effect, stage: str, constants: int) -> "_EffectTest":
        """Return a test before any stage."""
        k = len(effect.components)
        return cls(effect, stage, np.zeros(k), np.zeros((k, k)), np.zeros((k, constants)), np.zeros((COUNT, k)))

    def add_stage(self, s: Sensitivity, constant: FloatArray, direct: FloatArray | None = None) -> None:
        """Add a stage.

        `direct` maps the sizes of the effect to the columns of `s` after those of the parameters and of `EFFECTS`.
        `constant` maps the components of `EFFECTS` to the parameters and to their own columns.
        """
        both, error = len(constant), self.error
        if direct is not None:
            error = np.vstack([error, np.zeros((both - COUNT, len(self.score))), direct])
        n = len(error)
        self.score = self.score + error.T @ s.score[:n]
        self.information = self.information + error.T @ s.information[:n, :n] @ error
        self.cross = self.cross + error.T @ s.information[:n, :both] @ constant
        self.error = s.error[:, :n] @ error

    def add_to_parameters(self, change_per_size: FloatArray | float) -> None:
        """Add the errors `change_per_size`, shape (k,), that a unit of each size causes in the parameter it changes."""
        self.error[[INDEX[name] for name in self.effect.parameters], range(len(self.score))] += change_per_size

    def in_units_of(self, sizes: FloatArray) -> "_EffectTest":
        """Return the same test with its sizes in units of `sizes`, shape (k,)."""
        information = self.information * np.outer(sizes, sizes)
        scaled = self.score * sizes, information, self.cross * sizes[:, None], self.error * sizes
        return _EffectTest(self.effect, self.stage, *scaled)

    def limits(self, chi_square: float, sigma: FloatArray, names: Sequence[str]) -> Iterator[EffectLimit]:
        """Yield the limit of each component."""
        c = self.effect
        for k, component in enumerate(c.components):
            information = float(self.information[k, k])
            size = float(np.sqrt(chi_square / information)) if information > 0.0 else np.inf
            moves = {name: abs(float(self.error[INDEX[name], k])) / float(sigma[INDEX[name]]) for name in names}
            largest = max(moves, key=moves.__getitem__)
            shift = size * moves[largest] if moves[largest] > 0.0 else 0.0
            yield EffectLimit(c.cause, component, c.parameter_of(k), self.stage, size, c.unit, largest, shift)

    def evaluate(
        self, model_effects: "EffectEstimate", before: FloatArray, sigma: FloatArray, names: Sequence[str]
    ) -> EffectEvidence:
        """Evaluate the test jointly with the effects in the model; `before` and `sigma` have the shape (30,)."""
        shared = self.cross[:, model_effects.columns]
        score = self.score - shared @ model_effects.size
        information = self.information - shared @ model_effects.covariance @ shared.T
        error = self.error - model_effects.error @ model_effects.covariance @ shared.T
        changed = [before[INDEX[name]] for name in self.effect.parameters]
        plausible = np.diag(changed or len(score) * [self.effect.plausible])
        covariance = plausible @ np.linalg.inv(plausible @ information @ plausible + np.eye(len(score))) @ plausible
        size, sigmas = covariance @ score, np.sqrt(np.diag(covariance))
        freedom = float(np.sum(covariance * information))
        best, indices = int(np.argmax(np.abs(size) / sigmas)), [INDEX[name] for name in names]
        shift = error @ size / np.where(sigma > 0.0, sigma, np.inf)
        c = self.effect
        return EffectEvidence(
            c.cause, c.components[best], c.parameter_of(best), self.stage, float(score @ size) - freedom,
            float(size[best]), float(sigmas[best]), c.unit, dict(zip(names, shift[indices].tolist(), strict=True)),
        )  # fmt: skip


@dataclass(frozen=True)
class EffectEstimate:
    """Estimate of the effects in the model."""

    columns: IntArray  #: Indices of the components within `EFFECTS`, shape (k,).
    names: tuple[str, ...]  #: Names of the components, as in a result.
    units: tuple[str, ...]
    reported: tuple[bool, ...]  #: Whether a component is a parameter of the result.
    size: FloatArray  #: Shape (k,).
    covariance: FloatArray  #: Shape (k, k).
    error: FloatArray  #: Parameter error due to each effect per unit of its size, shape (30, k).
    explained: float  #: Part of the last stage's sum of squared innovations explained by the effects.

    def correct(self, posterior: Posterior) -> Posterior:
        """Return the posterior of the parameters with the effects in the model."""
        mean = posterior.mean + self.error @ self.size
        return Posterior(mean, posterior.covariance + self.error @ self.covariance @ self.error.T)


class EffectTests:
    """Tests for all effects over the stages so far, and the estimate of the effects in the unit's model.

    The stages are solved without effects. The size of an effect and the corrected parameters follow from its
    contributions to innovations and parameters, without solving again (B. Friedland, *Treatment of bias in recursive
    filtering*, IEEE TAC 14(4), 1969).
    """

    def __init__(
        self,
        before: FloatArray,
        states: Sequence[str] = (),
        priors: Mapping[str, EffectPrior] = MappingProxyType({}),
    ) -> None:
        """Create the tests.

        Parameters
        ----------
        before : sigmas of the parameters before calibration, shape (30,)
        states : effects that are estimated without a test
        priors : sizes of effects that are known before the calibration, by cause; effects that are not in `states` are
            then tested for a deviation from them
        """
        self._before = before
        causes = [(effect, k) for effect in EFFECTS for k in range(len(effect.components))]
        self._states, self._priors = tuple(states), priors
        self._columns = np.array(
            [i for i, (effect, _) in enumerate(causes) if effect.cause in states or effect.cause in priors], np.int64
        )
        chosen = [causes[i] for i in self._columns]
        known = [priors.get(effect.cause) or plausible(effect) for effect, _ in chosen]
        self._names = tuple(effect.names[k] for effect, k in chosen)
        self._units = tuple(effect.unit for effect, _ in chosen)
        self._mean = np.array([p.mean[k] for p, (_, k) in zip(known, chosen, strict=True)], np.float64)
        self._prior_sigma = np.array([p.sigma[k] for p, (_, k) in zip(known, chosen, strict=True)], np.float64)
        self._reported = tuple(
            effect.cause in states and sigma > 0.0
            for (effect, _), sigma in zip(chosen, self._prior_sigma.tolist(), strict=True)
        )
        count = len(causes)
        self._score, self._information = np.zeros(count), np.zeros((count, count))
        self._last, self._noise_ratio = (self._score, self._information), 1.0
        self._error = np.zeros((COUNT, count))
        self._changes: list[_EffectTest] = []
        #: Drifts throughout the run in units of their time functions; `_elapsed` is the time since the start, s.
        self._drifts: list[_EffectTest] = []
        self._begin = self._elapsed = 0.0
        self._parameters: dict[str, None] = {}

    def add(self, stage: str, s: Sensitivity, estimated: Sequence[str]) -> None:
        """Add a stage and the parameters that it estimated."""
        count = len(self._score)
        prior, constant = slice(0, COUNT), slice(COUNT, COUNT + count)
        response = np.vstack([self._error, np.eye(count)])
        both = slice(0, COUNT + count)
        self._last = response.T @ s.score[both], response.T @ s.information[both, both] @ response
        self._noise_ratio = s.noise_ratio
        self._score = self._score + self._last[0]
        self._information = self._information + self._last[1]
        self._error = s.error[:, prior] @ self._error + s.error[:, constant]
        if self._parameters:  # before the first stage, a jump is an error of the prior
            self._changes += [_jump_before(stage, group, count) for group in _JUMP_GROUPS]
        for change in self._changes:
            change.add_stage(s, response)
        self._add_changing(stage, s, response)
        self._parameters |= dict.fromkeys(estimated)

    def _add_changing(self, stage: str, s: Sensitivity, response: FloatArray) -> None:
        """Add the tests for changes within a stage, and continue those for drifts throughout the run."""
        changes, duration = s.effects.parameter_changes, s.effects.duration
        widths = [len(effect.components) for effect in changes]
        units = np.split(np.eye(sum(widths)), np.cumsum(widths)[:-1], axis=1)
        count = len(self._score)
        for effect, unit in zip(changes, units, strict=True):
            test = _EffectTest.initial(effect, stage, count)
            test.add_stage(s, response, unit)
            test.add_to_parameters(1.0)
            self._changes.append(test)
        drifts = [(effect, unit) for effect, unit in zip(changes, units, strict=True) if effect.cause == "drift"]
        if not self._drifts:
            self._begin = s.effects.begin
            self._drifts = [_EffectTest.initial(replace(e, cause="drift_throughout"), "", count) for e, _ in drifts]
        start = max(s.effects.begin - self._begin, self._elapsed)
        last, first, end = drift_functions(np.array([self._elapsed, start, start + duration]))
        for test, (_, unit) in zip(self._drifts, drifts, strict=True):
            test.add_to_parameters(np.tile(first - last, 3))
            test.add_stage(s, response, unit * np.tile(end - first, 3))
            test.add_to_parameters(np.tile(end - first, 3))
        self._elapsed = start + duration

    def estimate(self) -> EffectEstimate:
        """Return the estimate of the effects in the model."""
        at, prior = self._columns, np.diag(self._prior_sigma)
        information = self._information[np.ix_(at, at)]
        covariance = np.asarray(
            prior @ np.linalg.inv(prior @ information @ prior + np.eye(len(at))) @ prior, np.float64
        )
        size = np.asarray(self._mean + covariance @ (self._score[at] - information @ self._mean), np.float64)
        score, last = self._last[0][at], self._last[1][np.ix_(at, at)]
        explained = self._noise_ratio * float(2.0 * score @ size - size @ last @ size)
        named = self._names, self._units, self._reported
        return EffectEstimate(at, *named, size, covariance, self._error[:, at], explained)

    @property
    def models_effects(self) -> bool:
        """Whether the model contains effects."""
        return len(self._columns) > 0

    def evidence(self, posterior: Posterior) -> list[EffectEvidence]:
        """Return the evidence for every effect outside the model, the likeliest first.

        `posterior` is the latest one. There are many tests for changes, several in every stage for each parameter
        group, so a chance result is more likely among them; their likelihood is divided by their number.
        """
        model_effects, names = self.estimate(), tuple(self._parameters)
        evidence = [t.evaluate(model_effects, self._before, posterior.sigma, names) for t in self._tests()]
        chances = 2.0 * np.log(max(len(self._changes), 1))
        return sorted(evidence, key=lambda f: (chances if f.stage else 0.0) - f.excess)

    def limits(self, posterior: Posterior, chi_square: float) -> list[EffectLimit]:
        """Return the size of each effect outside the model at which its test is expected to reach `chi_square`."""
        names = tuple(self._parameters)
        fixed = [name for name, sigma in zip(self._names, self._prior_sigma, strict=True) if sigma == 0.0]
        limits = (limit for t in self._tests() for limit in t.limits(chi_square, posterior.sigma, names))
        return [limit for limit in limits if f"{limit.cause}_{limit.component}" not in fixed]

    def _tests(self) -> Iterator[_EffectTest]:
        """Yield the tests for effects outside the model."""
        at = 0
        for effect in EFFECTS:
            columns = slice(at, at := at + len(effect.components))
            parts = (
                self._score[columns],
                self._information[columns, columns],
                self._information[columns],
                self._error[:, columns],
            )
            if effect.cause not in self._states:
                yield _EffectTest(effect, "", *parts)
        at_end = np.tile(drift_functions(np.array([self._elapsed]))[0], 3)
        yield from (drift.in_units_of(1.0 / at_end) for drift in self._drifts)
        yield from self._changes


def _jump_before(stage: str, group: str, count: int) -> _EffectTest:
    """Return the test for a jump of a group's parameters before a stage."""
    unit = {"gyro_bias": "rad/s", "accel_bias": "m/s²"}.get(group, "1")
    names = tuple(f"{group}_{axis}" for axis in AXES)
    effect = Effect("jump_before", unit, None, 3 * ("",), lambda motion: np.empty((0, 0)), (), parameters=names)
    test = _EffectTest.initial(effect, stage, count)
    test.add_to_parameters(1.0)
    return test
