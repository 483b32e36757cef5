"""Evidence for effects outside the error model, and the cause that follows from it."""

from collections.abc import Sequence
from dataclasses import dataclass

from calstation.estimation.common import Diagnosis, ModelTest

#: A score test fails if its χ² exceeds its degrees of freedom by more than `MAX_EXCESS` and the effect shifts a
#: parameter by more than `MIN_SHIFT` sigmas. Any other significant effect is harmless, but may explain other failures.
MAX_EXCESS, MIN_SHIFT = 30.0, 3.0
#: Largest difference between the χ² of the likeliest effect and that of another possible cause.
MAX_CHI2_DIFFERENCE = 10.0
#: Largest size of an effect that is named as a cause, in prior sigmas.
MAX_SIZE = 10.0
#: Cause if the likeliest effect does not explain the data.
NO_SINGLE_EFFECT = "no_single_effect"
#: Largest fraction of the excess that may remain with a constant effect, or a change, in the model, because the
#: linearisation is approximate, and the tested drifts and jumps only approximate the time course of a change.
_MAX_REMAINING = (0.02, 0.1)


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
    #: Shift of each estimated parameter due to the effect, estimate minus truth, in sigmas.
    parameter_shift: dict[str, float]
    largest_size: float  #: Largest size of a component, in its prior sigmas.
    remaining: "EffectEvidence | None" = None  #: The likeliest other effect in addition to this one, if it was tested.

    @property
    def group(self) -> str:
        """Group of the parameter that changed; "" for a constant effect."""
        return self.parameter.rpartition("_")[0]

    @property
    def largest_shift(self) -> float:
        """Largest of `parameter_shift`."""
        return max((abs(shift) for shift in self.parameter_shift.values()), default=0.0)

    @property
    def is_harmful(self) -> bool:
        """Whether the effect, or another that remains with it in the model, shifts a parameter significantly."""
        harmful_rest = self.remaining is not None and self.remaining.largest_shift > MIN_SHIFT
        return self.largest_shift > MIN_SHIFT or (self._remains and harmful_rest)

    @property
    def explains(self) -> bool:
        """Whether the effect has a plausible size and nothing significant remains with it in the model."""
        return self.largest_size <= MAX_SIZE and not self._remains

    @property
    def _remains(self) -> bool:
        """Whether another significant effect remains with this one in the model."""
        share = _MAX_REMAINING[bool(self.parameter)]
        return self.remaining is not None and self.remaining.excess > max(MAX_EXCESS, share * self.excess)


def likeliest(evidence: Sequence[EffectEvidence]) -> EffectEvidence | None:
    """Return the likeliest harmful effect, otherwise the likeliest effect if it is significant, or None.

    `evidence` contains all effects, the likeliest first. A harmful effect nearly as likely as the first is preferred.
    """
    if not evidence:
        return None
    significant = evidence[0].excess > MAX_EXCESS
    likely = (
        effect
        for effect in evidence
        if effect.excess > evidence[0].excess - MAX_CHI2_DIFFERENCE and (effect.excess > MAX_EXCESS) == significant
    )
    harmful = next((effect for effect in likely if effect.largest_shift > MIN_SHIFT), None)
    return evidence[0] if harmful is None and significant else harmful


def effect_tests(evidence: Sequence[EffectEvidence]) -> tuple[ModelTest | None, ModelTest | None]:
    """Return the tests of a harmful and of a significant but harmless effect outside the error model.

    `evidence` contains all effects, the likeliest first. Either test is None if there is no such effect; only the
    first test can pass.
    """
    effect = likeliest(evidence)
    if effect is None:
        return None, None
    near = (
        other.cause
        for other in evidence
        if not (other.parameter or other.cause == effect.cause or other.excess < effect.excess - MAX_CHI2_DIFFERENCE)
    )
    test = ModelTest("effects", effect.excess, MAX_EXCESS, "1", _diagnosis(effect, next(near, "")))
    return (test, None) if effect.is_harmful else (None, test)


@dataclass(frozen=True)
class StateEvidence:
    """Evidence for a state of the model, and for the effects outside the model instead of it, the likeliest first."""

    state: EffectEvidence
    others: Sequence[EffectEvidence]

    @property
    def alike(self) -> list[EffectEvidence]:
        """Effects that are nearly as likely or likelier, and yield the same parameters."""
        return [other for other in self._likely if self._shift(other) <= MIN_SHIFT]

    @property
    def test(self) -> ModelTest | None:
        """Test of the likeliest effect that yields other parameters; None if the state is not significant.

        If this effect is nearly as likely as the state, the data do not show which parameters are correct.
        """
        others = [other for other in self.others if self._shift(other) > MIN_SHIFT]
        if self.state.excess <= MAX_EXCESS or not others:
            return None
        other = others[0]
        values = {"state": self.state.cause, "other": other.cause, "parameter": other.parameter}
        diagnosis = Diagnosis("state_not_unique", parameter_shift=self._shifts(other), values=values)
        return ModelTest("alternatives", other.excess - self.state.excess, -MAX_CHI2_DIFFERENCE, "1", diagnosis)

    @property
    def _likely(self) -> list[EffectEvidence]:
        if self.state.excess <= MAX_EXCESS:
            return []
        return [other for other in self.others if other.excess > self.state.excess - MAX_CHI2_DIFFERENCE]

    def _shifts(self, other: EffectEvidence) -> dict[str, float]:
        """Return the parameters with the other effect in the model minus those with the state, in sigmas."""
        return {name: shift - other.parameter_shift[name] for name, shift in self.state.parameter_shift.items()}

    def _shift(self, other: EffectEvidence) -> float:
        return max(map(abs, self._shifts(other).values()), default=0.0)


def _diagnosis(effect: EffectEvidence, nearly_as_likely: str) -> Diagnosis:
    """Return the effect as the cause, or that no single effect explains the data.

    `nearly_as_likely` is the cause of another effect, or "".
    """
    if effect.explains:
        values = {"component": effect.component, "parameter": effect.parameter, "during": effect.stage}
        if nearly_as_likely:
            values["nearly_as_likely"] = nearly_as_likely
        return Diagnosis(effect.cause, effect.size, effect.sigma, effect.unit, effect.parameter_shift, values)
    why = "implausible_size" if effect.largest_size > MAX_SIZE else "innovations_remain"
    values = {"likeliest": effect.cause, "why": why}
    return Diagnosis(NO_SINGLE_EFFECT, parameter_shift=effect.parameter_shift, values=values)
