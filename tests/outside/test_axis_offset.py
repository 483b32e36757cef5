"""The axes of a table that do not meet: estimated within the bounds of the profile, or named."""

from typing import Any, Literal

import numpy as np
import pytest

from calstation.physics import EFFECTS, OuterTurn
from tests.outside.sweep import Case, Outcome, run

SIMULATORS = pytest.mark.parametrize("simulator", ["bench", "plain"])
Simulator = Literal["bench", "plain"]


def outcome(simulator: Simulator, offset: Any, states: tuple[str, ...] = (), **table_entries: Any) -> Outcome:
    """Calibrate a MEMS unit with a designed schedule on a table whose axes are `offset` mm apart."""
    case = Case("none", 0.0, 2, "mems", "profile", simulator, 100.0, {"axis_offset_mm": offset}, "mems_c_fast")
    return run(Case(**{**vars(case), "table_entries": table_entries, "states": states}))


def test_velocity_is_that_of_a_point_on_the_outer_body() -> None:
    effect = next(e for e in EFFECTS if e.cause == "axis_offset")
    assert effect.velocity is not None
    axis, inner, turned = np.array([[1.0, 0.0, 0.0]]), np.array([[0.0, 0.6, 0.8]]), 1e-6
    after = np.array([[0.0, np.cos(turned) * 0.6 - np.sin(turned) * 0.8, np.sin(turned) * 0.6 + np.cos(turned) * 0.8]])
    velocity = effect.velocity(OuterTurn(axis, inner, after, np.array([0.5 * turned])))[0]
    hinge = np.array([0.0, -0.8, 0.6])
    np.testing.assert_allclose(velocity, 2.0 * np.cross(axis[0], np.stack([hinge, inner[0]])).T, atol=1e-5)


@SIMULATORS
def test_offset_within_the_bound_of_the_profile_is_absorbed(simulator: Simulator) -> None:
    found = outcome(simulator, [2.0, -1.0])
    assert found.passed, (found.failed, found.cause)
    assert found.worst < 4.5
    assert not found.estimates


@SIMULATORS
def test_offset_that_contradicts_the_profile_is_named(simulator: Simulator) -> None:
    found = outcome(simulator, 2.0, axis_offset_sigma_mm=0.02)
    assert (found.passed, found.cause) == (False, "designed effects: axis_offset")


@SIMULATORS
def test_known_offset_is_corrected(simulator: Simulator) -> None:
    found = outcome(simulator, [2.0, 0.7], axis_offset_mm=(2.0, 0.7), axis_offset_sigma_mm=0.01)
    assert found.passed, (found.failed, found.cause)
    assert found.worst < 4.5


@SIMULATORS
def test_offset_is_estimated_as_a_state(simulator: Simulator) -> None:
    found = outcome(simulator, 4.0, ("axis_offset",))
    assert found.passed, (found.failed, found.cause)
    assert found.worst < 4.5
    assert set(found.estimates) == {"axis_offset_hinge"}
    size, sigma = found.estimates["axis_offset_hinge"]
    assert abs(size - 4e-3) < 4.5 * sigma
    assert sigma < 2e-4


def test_offset_along_the_inner_axis_counts_where_the_lever_arm_is_fixed() -> None:
    settings = {"axis_offset_mm": [0.0, 2.0], "outer_lever": "fixed"}
    case = Case("none", 0.0, 2, "mems", "profile", "bench", 100.0, settings, "mems_c_fast", {"outer_lever": "fixed"})
    found = run(Case(**{**vars(case), "states": ("axis_offset",)}))
    size, sigma = found.estimates["axis_offset_inner"]
    assert abs(size - 2e-3) < 4.5 * sigma < 1e-3
