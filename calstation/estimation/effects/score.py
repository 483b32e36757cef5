"""Score tests along a chain of stages: evidence in the innovations for each effect outside the model.

The test of one additional effect of size θ requires only the estimate without it: χ² = Uᵀ I⁻¹ U with the score U = Σ Jᵀ
S⁻¹ ν and the information I = Σ Jᵀ S⁻¹ J (C. R. Rao, *Proc. Cambridge Phil. Soc.* 44, 1948; for jumps in state-space
models: P. de Jong, J. Penzer, *Diagnosing shocks in time series*, JASA 93(442), 1998). The estimated size is I⁻¹ U, and
the resulting errors of the parameters, truth minus estimate, are D I⁻¹ U with the errors D per unit of size.
"""

from collections.abc import Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from calstation.estimation.common import Posterior
from calstation.estimation.effects.evidence import MAX_EXCESS, EffectEvidence, StateEvidence, likeliest
from calstation.estimation.effects.priors import EffectPrior, plausible
from calstation.estimation.effects.sensitivity import Sensitivity, drift_functions
from calstation.physics import AXES, CHANGING_GROUPS, COUNT, EFFECTS, INDEX, Effect, FloatArray, IntArray


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
    move: float  #: Shift of this parameter due to this size, in its sigmas.


@dataclass(frozen=True)
class _Candidate:
    """A tested effect and its columns in the arrays of `EffectTests`."""

    effect: Effect
    stage: str
    columns: slice


class _Solution(NamedTuple):
    """Joint estimate of the sizes of effects."""

    columns: IntArray  #: Shape (k,).
    size: FloatArray  #: In units of the columns, shape (k,).
    covariance: FloatArray  #: Shape (k, k).


@dataclass(frozen=True)
class EffectEstimate:
    """Estimate of the effects in the model."""

    names: tuple[str, ...]  #: Names of the components, as in a result.
    units: tuple[str, ...]
    reported: tuple[bool, ...]  #: Whether a component is a parameter of the result.
    size: FloatArray  #: Shape (k,).
    covariance: FloatArray  #: Shape (k, k).
    error: FloatArray  #: Parameter error due to each effect per unit of its size, shape (30, k).
    explained: float  #: Part of the last stage's sum of squared innovations explained by the effects.
    #: Additional covariance of lever arms that the data cannot distinguish from the effects, shape (30, 30).
    gauge: FloatArray

    def correct(self, posterior: Posterior) -> Posterior:
        """Return the posterior of the parameters with the effects in the model."""
        mean = posterior.mean + self.error @ self.size
        return Posterior(mean, posterior.covariance + self.error @ self.covariance @ self.error.T + self.gauge)


@dataclass(frozen=True)
class ModelledEffects:
    """Contributions of the effects in the model, relative to their prior means, to a solution without effects."""

    change: FloatArray  #: Change of the parameters due to the prior means, shape (30,).
    error: FloatArray  #: Parameter error due to each effect per prior sigma of its size, shape (30, k).
    score: FloatArray  #: Score of the sizes in prior sigmas, shape (k,).
    information: FloatArray  #: Information about these sizes, shape (k, k).

    def explained(self, size: FloatArray) -> float:
        """Return the part of the sum of squared innovations explained by effects of `size`, in prior sigmas, (k,)."""
        return float(2.0 * self.score @ size - size @ self.information @ size)


class EffectTests:
    """Tests for all effects over the stages so far, and the estimate of the effects in the unit's model.

    The stages are solved without effects. The size of an effect and the corrected parameters are computed from its
    contributions to innovations and parameters, without solving again (B. Friedland, *Treatment of bias in recursive
    filtering*, IEEE TAC 14(4), 1969).
    """

    def __init__(
        self,
        changes: FloatArray,
        states: Sequence[str] = (),
        priors: Mapping[str, EffectPrior] = MappingProxyType({}),
        signs: Mapping[str, int] = MappingProxyType({}),
    ) -> None:
        """Create the tests.

        Parameters
        ----------
        changes : prior sigmas of the parameters' changes within a run, shape (30,), see `plausible_changes`
        states : effects that are estimated without a test
        priors : prior sizes of effects, by cause; effects that are not in `states` are tested for a deviation from them
        signs : see `possible_signs`
        """
        self._changes, self._states, self._priors, self._signs = changes, tuple(states), priors, signs
        self._candidates: list[_Candidate] = []
        self._score, self._information, self._error = np.zeros(0), np.zeros((0, 0)), np.zeros((COUNT, 0))
        self._append([(effect, "") for effect in EFFECTS])
        self._last, self._noise_ratio = (self._score, self._information), 1.0
        #: Drifts throughout the run in units of their time functions; `_elapsed` is the time since the start, s.
        self._drifts: list[_Candidate] = []
        self._begin = self._elapsed = 0.0
        self._parameters: dict[str, None] = {}

    def _append(self, effects: Sequence[tuple[Effect, str]]) -> list[_Candidate]:
        """Append columns for effects, each with its stage, without evidence so far."""
        first, candidates = len(self._score), []
        for effect, stage in effects:
            candidates.append(_Candidate(effect, stage, slice(first, first := first + len(effect.components))))
        added = first - len(self._score)
        self._score = np.pad(self._score, (0, added))
        self._information = np.pad(self._information, (0, added))
        self._error = np.pad(self._error, ((0, 0), (0, added)))
        self._candidates = self._candidates + candidates
        return candidates

    def _change(self, candidate: _Candidate, change_per_size: FloatArray | float) -> None:
        """Add the errors per unit of size, shape (k,), that a change causes in the parameters that it changes."""
        at = range(candidate.columns.start, candidate.columns.stop)
        self._error[[INDEX[name] for name in candidate.effect.parameters], at] += change_per_size

    def add(self, stage: str, s: Sensitivity, estimated: Sequence[str]) -> None:
        """Add a stage and the parameters that it estimated."""
        if self._parameters:  # before the first stage, a jump is an error of the prior
            for candidate in self._append([(_jump_before(group), stage) for group in CHANGING_GROUPS]):
                self._change(candidate, 1.0)
        changes = self._append([(effect, stage) for effect in s.effects.parameter_changes])
        drifts = [c for c in changes if c.effect.cause == "drift"]
        if not self._drifts:
            self._begin = s.effects.begin
            self._drifts = self._append([(replace(c.effect, cause="drift_throughout"), "") for c in drifts])
        start = max(s.effects.begin - self._begin, self._elapsed)
        times = np.array([self._elapsed, start, start + s.effects.duration])
        last, first, end = np.tile(drift_functions(times), 3)
        for candidate in self._drifts:
            self._change(candidate, first - last)
        constants, within_stage = _constants(), slice(changes[0].columns.start, changes[-1].columns.stop)
        response = np.zeros((len(s.score), len(self._score)))
        response[:COUNT] = self._error
        response[COUNT : COUNT + constants, :constants] = np.eye(constants)
        response[COUNT + constants :, within_stage] = np.eye(within_stage.stop - within_stage.start)
        for candidate, within in zip(self._drifts, drifts, strict=True):
            response[:, candidate.columns] += response[:, within.columns] * (end - first)
        self._last = response.T @ s.score, response.T @ s.information @ response
        self._noise_ratio = s.noise_ratio
        self._score = self._score + self._last[0]
        self._information = self._information + self._last[1]
        self._error = s.error @ response
        for candidate in changes:
            self._change(candidate, 1.0)
        for candidate in self._drifts:
            self._change(candidate, end - first)
        self._elapsed = start + s.effects.duration
        self._parameters = self._parameters | dict.fromkeys(estimated)

    def with_stage(self, stage: str, s: Sensitivity, estimated: Sequence[str]) -> "EffectTests":
        """Return tests that include another stage."""
        tests = copy(self)  # `add` changes no attribute in place
        tests.add(stage, s, estimated)
        return tests

    def estimate(self) -> EffectEstimate:
        """Return the estimate of the effects in the model."""
        model = self._model
        at, size, covariance = self._solve(model)
        score, last = self._last[0][at], self._last[1][np.ix_(at, at)]
        explained = self._noise_ratio * float(2.0 * score @ size - size @ last @ size)
        names = tuple(name for c in model for name in c.effect.names)
        units = tuple(c.effect.unit for c in model for _ in c.effect.names)
        sigmas = (s for c in model for s in self._prior(c).sigma)
        stated = (c.effect.cause in self._states for c in model for _ in c.effect.names)
        reported = tuple(is_state and sigma > 0.0 for is_state, sigma in zip(stated, sigmas, strict=True))
        gauge = _gauge(names, size, covariance)
        return EffectEstimate(names, units, reported, size, covariance, self._error[:, at], explained, gauge)

    def modelled(self) -> ModelledEffects:
        """Return the contributions of the effects in the model, for a joint estimate with other solutions."""
        at, priors = self._solve(self._model).columns, [self._prior(candidate) for candidate in self._model]
        mean = np.array([value for prior in priors for value in prior.mean])
        sigma = np.array([value for prior in priors for value in prior.sigma])
        error, information = self._error[:, at], self._information[np.ix_(at, at)]
        score = sigma * (self._score[at] - information @ mean)
        return ModelledEffects(error @ mean, error * sigma, score, information * np.outer(sigma, sigma))

    @property
    def models_effects(self) -> bool:
        """Whether the model contains effects."""
        return bool(self._model)

    @property
    def _model(self) -> list[_Candidate]:
        """The effects in the model, which are states or have a prior."""
        constants = self._candidates[: len(EFFECTS)]
        return [c for c in constants if c.effect.cause in self._states or c.effect.cause in self._priors]

    def evidence(self, posterior: Posterior) -> list[EffectEvidence]:
        """Return the evidence for every effect outside the model, the likeliest first.

        `posterior` is the latest posterior. Every stage has several tests for changes of each parameter group, so a
        chance result is more likely among them; their likelihood is divided by their number. The likeliest effect is
        included in the model to test what remains. If it is a change, all changes of the same parameter group are
        included, because the tested drifts and jumps only approximate the time of a change.
        """
        model, outside = self._model, self._outside
        ranked = self._ranked(outside, model, posterior.sigma)
        evidence = [e for e, _ in ranked]
        chosen = likeliest(evidence)
        if chosen is None or chosen.excess <= MAX_EXCESS:
            return evidence
        k = next(k for k, e in enumerate(evidence) if e is chosen)
        same = [e is chosen or (chosen.group != "" and e.group == chosen.group) for e in evidence]
        included = [c for (_, c), inside in zip(ranked, same, strict=True) if inside]
        others = [c for (_, c), inside in zip(ranked, same, strict=True) if not inside]
        evidence[k] = replace(chosen, remaining=self._ranked(others, model, posterior.sigma, included)[0][0])
        return evidence

    def state_evidence(self, posterior: Posterior) -> list[StateEvidence]:
        """Return the evidence for each state of the model, and for the effects outside the model instead of it."""
        model, outside = self._model, self._outside
        rows = []
        for state in (c for c in model if c.effect.cause in self._states):
            others, sigma = [c for c in model if c is not state], posterior.sigma
            (evidence, _), ranked = self._ranked([state], others, sigma)[0], self._ranked(outside, others, sigma)
            likelihoods = [replace(e, excess=e.excess - _rarity(c, self._chances)) for e, c in ranked]
            rows.append(StateEvidence(evidence, likelihoods))
        return rows

    @property
    def _chances(self) -> float:
        """Expected χ² of the best of all changes within a stage by chance."""
        return 2.0 * float(np.log(max(sum(bool(c.stage) for c in self._candidates), 1)))

    @property
    def _outside(self) -> list[_Candidate]:
        """All tested effects: constant effects, drifts throughout the run, then changes by stage."""
        drifts, constants = self._drifts, len(EFFECTS)
        changes = [c for c in self._candidates[constants:] if c not in drifts]
        return [c for c in (*self._candidates[:constants], *drifts, *changes) if c.effect.cause not in self._states]

    def _ranked(
        self,
        tests: Sequence[_Candidate],
        model: Sequence[_Candidate],
        sigma: FloatArray,
        added: Sequence[_Candidate] = (),
    ) -> list[tuple[EffectEvidence, _Candidate]]:
        """Return the evidence for effects in addition to a model and to `added` effects, the likeliest first."""
        solution, chances = self._solve(model, added), self._chances
        ranked = [(self._evaluate(c, solution, sigma), c) for c in tests]
        return sorted(ranked, key=lambda row: _rarity(row[1], chances) - row[0].excess)

    def limits(self, posterior: Posterior, chi_square: float) -> list[EffectLimit]:
        """Return the size of each effect outside the model at which its test is expected to reach `chi_square`."""
        names, sigma = tuple(self._parameters), posterior.sigma
        fixed = {
            name for c in self._model for name, s in zip(c.effect.names, self._prior(c).sigma, strict=True) if s == 0.0
        }
        limits = (limit for c in self._outside for limit in self._limits(c, chi_square, sigma, names))
        return [limit for limit in limits if f"{limit.cause}_{limit.component}" not in fixed]

    def _limits(
        self, candidate: _Candidate, chi_square: float, sigma: FloatArray, names: Sequence[str]
    ) -> Iterator[EffectLimit]:
        """Yield the limit of each component of an effect."""
        effect, first, in_units = candidate.effect, candidate.columns.start, self._in_units(candidate)
        for k, component in enumerate(effect.components):
            information = float(self._information[first + k, first + k]) * in_units[k] ** 2
            size = float(np.sqrt(chi_square / information)) if information > 0.0 else np.inf
            error = np.abs(self._error[:, first + k]) * in_units[k]
            shifts = {name: float(error[INDEX[name]]) / float(sigma[INDEX[name]]) for name in names}
            largest = max(shifts, key=shifts.__getitem__)
            shift = size * shifts[largest] if shifts[largest] > 0.0 else 0.0
            at = effect.cause, component, effect.parameter_of(k), candidate.stage
            yield EffectLimit(*at, size, effect.unit, largest, shift)

    def _in_units(self, candidate: _Candidate) -> FloatArray:
        """Return the factors from public sizes to columns, shape (k,); the size of a drift is its change at the end."""
        if candidate.effect.cause != "drift_throughout":
            return np.ones(len(candidate.effect.components))
        return np.tile(1.0 / drift_functions(np.array([self._elapsed]))[0], 3)

    def _plausible(self, candidate: _Candidate) -> FloatArray:
        """Return the prior sigmas of the sizes of a tested effect, shape (k,); 0 for a component that is not tested."""
        effect = candidate.effect
        if effect.plausible is None:
            return self._changes[[INDEX[name] for name in effect.parameters]]
        known = self._priors.get(effect.cause)
        fixed = np.array(known.sigma) == 0.0 if known is not None else False
        return np.where(fixed, 0.0, np.full(len(effect.components), effect.plausible))

    def _prior(self, candidate: _Candidate) -> EffectPrior:
        """Return the prior of an effect in the model."""
        return self._priors.get(candidate.effect.cause) or plausible(candidate.effect)

    def _solve(self, model: Sequence[_Candidate], added: Sequence[_Candidate] = ()) -> _Solution:
        """Return the columns, sizes and covariance of effects of the model, and of effects added to it for a test."""
        at = np.array([k for c in (*model, *added) for k in range(c.columns.start, c.columns.stop)], dtype=np.int64)
        priors = [(np.array(p.mean), np.array(p.sigma)) for p in map(self._prior, model)]
        priors += [(np.zeros(len(s)), s) for s in (self._plausible(c) * self._in_units(c) for c in added)]
        mean, sigma = (np.concatenate([np.zeros(0), *(p[k] for p in priors)]) for k in (0, 1))
        information = self._information[np.ix_(at, at)]
        covariance = _covariance(information, sigma)
        return _Solution(at, mean + covariance @ (self._score[at] - information @ mean), covariance)

    def _evaluate(self, candidate: _Candidate, given: _Solution, sigma: FloatArray) -> EffectEvidence:
        """Evaluate the test of an effect in addition to `given` effects; `sigma` contains the parameters' sigmas."""
        columns, (at, given_size, given_covariance) = candidate.columns, given
        in_units, effect = self._in_units(candidate), candidate.effect
        shared = self._information[columns, at] * in_units[:, None]
        score = self._score[columns] * in_units - shared @ given_size
        information = (
            self._information[columns, columns] * np.outer(in_units, in_units) - shared @ given_covariance @ shared.T
        )
        error = self._error[:, columns] * in_units - self._error[:, at] @ given_covariance @ shared.T
        plausible = self._plausible(candidate)
        covariance = _covariance(information, plausible)
        size, sums = covariance @ score, _sums(effect)
        total, sigmas = sums @ size, np.sqrt(np.diag(sums @ covariance @ sums.T))
        freedom, sign = float(np.sum(covariance * information)), self._signs.get(effect.cause)
        tested = plausible > 0.0
        if sign is not None:
            size = np.where(sign * size > 0.0, size, 0.0)
            total = sums @ size
        k = int(np.argmax(np.abs(total) / np.where(sums @ tested > 0.0, sigmas, np.inf)))
        best, names = int(np.argmax(sums[k])), tuple(self._parameters)
        shift = -(error @ size / np.where(sigma > 0.0, sigma, np.inf))[[INDEX[name] for name in names]]
        largest = float(np.max(np.abs(size) / np.where(tested, plausible, np.inf)))
        return EffectEvidence(
            effect.cause, effect.components[best], effect.parameter_of(best), candidate.stage,
            float(score @ size) - freedom, float(total[k]), float(sigmas[k]), effect.unit,
            dict(zip(names, shift.tolist(), strict=True)), largest,
        )  # fmt: skip


def _sums(effect: Effect) -> FloatArray:
    """Return the matrix that sums the time functions of each changed parameter, shape (parameters, components).

    For a constant effect, it is the identity.
    """
    changed = effect.parameters or effect.names
    return np.array([[name == each for each in changed] for name in dict.fromkeys(changed)], dtype=np.float64)


def _gauge(names: Sequence[str], size: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the covariance of the lever arms due to the unknown mean displacement of two accelerometers, (30, 30).

    Only the difference of two displacements along an axis is a state. Their mean adds to the outer lever arm and
    subtracts from the inner lever arm. For independent displacements, it has half the sigma of the difference.
    """
    gauge = np.zeros((COUNT, COUNT))
    at = [names.index(f"accel_off_axis_{axis}") for axis in AXES if f"accel_off_axis_{axis}" in names]
    if at:
        mean = 0.25 * float(np.mean(size[at] ** 2 + np.diag(covariance)[at]))
        for axis in AXES:
            direction = np.zeros(COUNT)
            direction[INDEX[f"outer_lever_{axis}"]], direction[INDEX[f"inner_lever_{axis}"]] = 1.0, -1.0
            gauge += mean * np.outer(direction, direction)
    return gauge


def _rarity(candidate: _Candidate, chances: float) -> float:
    """Return the χ² by which an effect must exceed others; `chances` applies to changes within a stage."""
    return chances if candidate.stage else candidate.effect.rarity


def _constants() -> int:
    """Return the number of components of `EFFECTS`."""
    return sum(len(effect.components) for effect in EFFECTS)


def _covariance(information: FloatArray, plausible: FloatArray) -> FloatArray:
    """Return the covariance of sizes with the prior sigmas `plausible`, shape (k,)."""
    sizes, directions = np.linalg.eigh(information * np.outer(plausible, plausible))
    root = plausible[:, None] * directions / np.sqrt(1.0 + np.maximum(sizes, 0.0))  # negative only by rounding
    return np.asarray(root @ root.T)


def _jump_before(group: str) -> Effect:
    """Return the jump of a group's parameters before a stage."""
    unit = {"gyro_bias": "rad/s", "accel_bias": "m/s²"}.get(group, "1")
    names = tuple(f"{group}_{axis}" for axis in AXES)
    return Effect("jump_before", unit, None, 3 * ("",), lambda motion: np.empty((0, 0)), (), parameters=names)
