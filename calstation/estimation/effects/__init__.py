"""Score tests for effects outside the error model, one added effect at a time."""

from calstation.estimation.effects.evidence import (
    MAX_EXCESS,
    NO_SINGLE_EFFECT,
    EffectEvidence,
    StateEvidence,
    effect_tests,
)
from calstation.estimation.effects.plausible import plausible_changes
from calstation.estimation.effects.priors import EffectPrior, known_effects, possible_signs
from calstation.estimation.effects.score import EffectEstimate, EffectLimit, EffectTests, ModelledEffects
from calstation.estimation.effects.sensitivity import (
    Sensitivity,
    StageEffects,
    drifts_before_end,
    effect_errors,
    last_turns,
    mean_errors,
    mean_regressors,
    parameter_changes,
    velocity_errors,
)
