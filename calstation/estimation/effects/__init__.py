"""Tests for effects outside the error model, one added effect at a time (score tests)."""

from calstation.estimation.effects.priors import table_priors
from calstation.estimation.effects.score import MAX_EXCESS, EffectEvidence, EffectLimit, EffectTests, effect_tests
from calstation.estimation.effects.sensitivity import (
    Sensitivity,
    StageEffects,
    effect_errors,
    mean_errors,
    mean_regressors,
    parameter_changes,
    velocity_errors,
)
