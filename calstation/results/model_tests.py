"""Tests of the error model along a chain of stages, and the effects that the model of a unit contains."""

from collections.abc import Sequence
from dataclasses import replace

from calstation.estimation import Estimate, Misfit, ModelTest, Solution
from calstation.estimation.common import Belief, stage_agreement
from calstation.estimation.effects import EffectFound, EffectTests

#: A change of the posterior less probable than this contradicts the stages before.
LEAST_PROBABILITY = 1e-6
#: A score test fails if its χ² exceeds its degrees of freedom by more than this and the effect moves a parameter by
#: more than `LEAST_MOVE` of its sigmas. One that moves less is harmless, but it explains other failures.
MOST_EXCESS, LEAST_MOVE = 30.0, 3.0
#: An effect whose χ² is smaller than that of the likeliest one by more than this is not the cause.
_AS_LIKELY = 10.0


class ModelTests:
    """Adds the tests of the model, and the effects in it, to the solution of every stage."""

    def __init__(self, prior: Belief, states: Sequence[str]) -> None:
        self._effects = EffectTests(prior.sigma, states)
        self._states = bool(states)

    def tested(self, solution: Solution, before: Sequence[Solution], posterior: Belief) -> Solution:
        """Return a solution with its tests; `before` are the stages before, and `posterior` is that of the last one."""
        tests = [*solution.tests, *_convergence(solution)]
        if solution.sensitivity is not None:
            self._effects.add(solution.stage, solution.sensitivity, solution.estimated)
            solution = self._with_effects(replace(solution, sensitivity=None))
            harmful, harmless = self._effects_outside(solution.belief)
            solution = replace(solution, explanation=harmless)
            tests += harmful
        tests += _agreement(solution, before, posterior)
        return replace(solution, tests=tuple(tests))

    def _with_effects(self, solution: Solution) -> Solution:
        """Return a solution whose model contains the effects of the IMU profile."""
        if not self._states:
            return solution
        known, c = self._effects.estimated(), solution.consistency
        sizes = zip(known.names, known.size, known.covariance.diagonal() ** 0.5, known.units, strict=True)
        found = {name: Estimate(float(size), float(sigma), unit) for name, size, sigma, unit in sizes}
        nis = c.nis_mean - known.explained / c.count if c.count else c.nis_mean
        return replace(
            solution,
            belief=known.corrected(solution.belief),
            consistency=replace(c, nis_mean=max(nis, 0.0)),
            found={**solution.found, **found},
        )

    def _effects_outside(self, belief: Belief) -> tuple[list[ModelTest], ModelTest | None]:
        """Test for effects outside the error model with all stages so far; also return a significant, harmless one."""
        found = self._effects.found(belief)
        likely = (f for f in found if f.excess > found[0].excess - _AS_LIKELY)
        harmful = next((f for f in likely if f.largest_move > LEAST_MOVE), None)
        if harmful is not None:
            return [_effect_test(harmful)], None
        return [], _effect_test(found[0]) if found[0].excess > MOST_EXCESS else None


def _effect_test(found: EffectFound) -> ModelTest:
    values = {"component": found.component, "parameter": found.parameter, "during": found.stage}
    misfit = Misfit(found.cause, found.size, found.sigma, found.unit, found.moves, values)
    return ModelTest("effects", found.excess, MOST_EXCESS, "1", misfit)


def _convergence(solution: Solution) -> list[ModelTest]:
    """Fail a solution whose iteration has not converged: it may be anywhere."""
    passes = [values["passes"] for code, values in solution.messages if code == "not_settled"]
    return [ModelTest("convergence", n, n - 1, "1", Misfit("not_settled", values={"passes": n})) for n in passes]


def _agreement(solution: Solution, before: Sequence[Solution], posterior: Belief) -> list[ModelTest]:
    """Test whether a stage agrees with those before it."""
    last = {name: s.stage for s in before for name in s.estimated}
    found = stage_agreement(posterior, solution.belief, [name for name in solution.estimated if name in last])
    if found is None:
        return []
    values = {"other": last[next(iter(found.moves))], "group": found.group, "probability": found.probability}
    misfit = Misfit("stages_disagree", moves=found.moves, values=values)
    return [ModelTest("agreement", found.probability, (LEAST_PROBABILITY, 1.0), "1", misfit)]
