"""Tests of the error model along a chain of stages, and the effects in a unit's model."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

from calstation.estimation import Diagnosis, Estimate, ModelTest, Solution
from calstation.estimation.common import Posterior, stage_agreement
from calstation.estimation.effects import EffectPrior, EffectTests, StateEvidence, effect_tests
from calstation.physics import FloatArray

#: Smallest probability of a change of the posterior that agrees with the earlier stages.
MIN_PROBABILITY = 1e-6


class ModelTests:
    """Adds the tests of the model, and the effects in the unit's model, to the solution of every stage."""

    def __init__(
        self,
        changes: FloatArray,
        states: Sequence[str],
        priors: Mapping[str, EffectPrior] = MappingProxyType({}),
        signs: Mapping[str, int] = MappingProxyType({}),
    ) -> None:
        """Create the tests, see `EffectTests`."""
        #: Tests of effects over the stages so far.
        self.effects = EffectTests(changes, states, priors, signs)
        self._states = tuple(states)
        self._reported: list[tuple[str, dict[str, str]]] = []  # messages about states that were returned before
        #: Whether a stage was tested for effects outside the model.
        self.effects_tested = False

    def with_states(self, solution: Solution) -> Solution:
        """Return the solution of a stage with the effects in the unit's model, without tests."""
        if solution.sensitivity is None:
            return solution
        self.effects.add(solution.stage, solution.sensitivity, solution.estimated)
        return self._with_effects(replace(solution, sensitivity=None))

    def add_tests(self, solution: Solution, before: Sequence[Solution], posterior: Posterior) -> Solution:
        """Return a solution with its tests; `before` are the earlier solutions, `posterior` is their posterior."""
        tests = [*solution.tests, *_convergence(solution)]
        if solution.sensitivity is not None:
            self.effects_tested = True
            solution = self.with_states(solution)
            harmful, harmless = effect_tests(self.effects.evidence(solution.posterior))
            solution = replace(solution, explanation=harmless)
            tests += [harmful] if harmful else []
            states = self.effects.state_evidence(solution.posterior)
            different = [test for state in states if (test := state.test) is not None]
            tests += sorted(different, key=lambda test: -test.value)[:1]
            remarks = [remark for remark in self._remarks(states) if remark not in self._reported]
            self._reported += remarks
            solution = replace(solution, messages=(*solution.messages, *remarks))
        tests += _agreement(solution, before, posterior)
        return replace(solution, tests=tuple(tests))

    def _remarks(self, states: Sequence[StateEvidence]) -> list[tuple[str, dict[str, str]]]:
        """Return messages about effects and lever arms that the data do not distinguish from the model's states."""
        gauge = [("lever_gauge", {"state": state}) for state in self._states if state == "accel_off_axis"]
        alike = {(row.state.cause, other.cause) for row in states for other in row.alike}
        return gauge + [("state_alike", {"state": state, "other": other}) for state, other in sorted(alike)]

    def _with_effects(self, solution: Solution) -> Solution:
        """Return a solution corrected for the effects in the unit's model."""
        if not self.effects.models_effects:
            return solution
        effects, c = self.effects.estimate(), solution.consistency
        sigmas = effects.covariance.diagonal() ** 0.5
        sizes = zip(effects.names, effects.reported, effects.size, sigmas, effects.units, strict=True)
        estimates = {
            name: Estimate(float(size), float(sigma), unit) for name, named, size, sigma, unit in sizes if named
        }
        nis = c.nis_mean - effects.explained / c.count if c.count else c.nis_mean
        return replace(
            solution,
            posterior=effects.correct(solution.posterior),
            consistency=replace(c, nis_mean=max(nis, 0.0)),
            estimates={**solution.estimates, **estimates},
        )


def _convergence(solution: Solution) -> list[ModelTest]:
    """Return a failed test if the iteration of a solution did not converge, because the error is then unknown."""
    passes = [values["passes"] for code, values in solution.messages if code == "not_converged"]
    return [ModelTest("convergence", n, n - 1, "1", Diagnosis("not_converged", values={"passes": n})) for n in passes]


def _agreement(solution: Solution, before: Sequence[Solution], posterior: Posterior) -> list[ModelTest]:
    """Test whether a stage agrees with the earlier ones."""
    last = {name: s.stage for s in before for name in s.estimated}
    worst = stage_agreement(posterior, solution.posterior, [name for name in solution.estimated if name in last])
    if worst is None:
        return []
    values = {"other": last[next(iter(worst.parameter_shift))], "group": worst.group, "probability": worst.probability}
    diagnosis = Diagnosis("stages_disagree", parameter_shift=worst.parameter_shift, values=values)
    return [ModelTest("agreement", worst.probability, (MIN_PROBABILITY, 1.0), "1", diagnosis)]
