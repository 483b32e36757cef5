"""Every registered effect is complete: regressors, texts, documentation and an independent truth of the bench."""

from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from calstation.messages import entry, known
from calstation.physics import (
    DISPLAY,
    EFFECT_PARAMETERS,
    EFFECT_STATES,
    EFFECTS,
    Effect,
    EffectName,
    Motion,
    OuterTurn,
    further_parameter,
)
from tests.outside import grid

DOCS = Path(__file__).parents[2] / "docs"
every_effect = pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.cause)


@every_effect
def test_effect_has_an_error_for_every_component_and_none_without_input(effect: Effect) -> None:
    random = np.random.default_rng(1)
    moving = Motion(*random.normal(size=(4, 50, 3)), np.arange(50.0))
    moving.rate[::3] = 0.0
    errors, still = effect.errors(moving), np.zeros((50, 3))
    assert errors.shape == (50, 6, len(effect.components))
    assert not effect.errors(Motion.steady(still, still, np.arange(50.0))).any()
    if effect.velocity is not None:
        assert not errors.any()
        angle = random.normal(size=51)
        inner = np.stack([np.zeros(51), np.sin(angle), np.cos(angle)], axis=1)
        axis, durations = np.broadcast_to(np.eye(3)[0], (50, 3)), np.full(50, 0.5)
        errors = effect.velocity(OuterTurn(axis, inner[:-1], inner[1:], durations))
        assert errors.shape == (50, 3, len(effect.components))
        assert not effect.velocity(OuterTurn(axis, inner[1:], inner[1:], durations)).any()
    assert np.abs(errors).max(axis=(0, 1)).min() > 0.0
    assert effect.plausible is not None


@every_effect
def test_effect_is_described_in_both_languages(effect: Effect) -> None:
    for code in (f"cause.{effect.cause}", f"group.{effect.cause}"):
        assert known(code), code
        assert entry(code).zh, code
    assert (f"Add the state {effect.cause} " in entry(f"cause.{effect.cause}").remedy) == effect.is_state


@every_effect
def test_effect_has_an_independent_truth_on_the_bench_whose_detection_is_tested(effect: Effect) -> None:
    assert any(effect.cause in causes for _, causes in grid.EFFECTS.values())


@pytest.mark.parametrize("page", ["contract.md", "reference/profiles.md"])
def test_documented_states_are_the_registered_ones(page: str) -> None:
    text = (DOCS / page).read_text(encoding="utf-8")
    assert all(f'"{state}"' in text for state in EFFECT_STATES)
    assert get_args(EffectName) == EFFECT_STATES


def test_sizes_of_states_are_parameters_with_a_display_unit() -> None:
    assert [p.group for p in EFFECT_PARAMETERS] == [e.cause for e in EFFECTS if e.is_state for _ in e.components]
    for parameter in EFFECT_PARAMETERS:
        assert further_parameter(parameter.name) is parameter
        assert DISPLAY[parameter.group][1] > 0.0
