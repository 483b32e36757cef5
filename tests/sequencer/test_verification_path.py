"""The verification path on any table excites all axes, stays within the travel and returns to its start."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calstation.errors import ConfigurationError
from calstation.physics import JointLimits, TableGeometry
from calstation.sequencer import check_limits
from calstation.sequencer.guard import check_travel
from calstation.sequencer.verification_path import VerificationPath, verification_path
from tests.helpers import joint_axis, raises_code

DEG = np.pi / 180.0
WIDE = JointLimits((-19.0, -19.0), (19.0, 19.0), (3.0, 3.0), (3.0, 3.0))


def poses(path: VerificationPath) -> list[tuple[float, float]]:
    """Return the pose at each rest of a reference."""
    return [path.start, *((leg.move.outer, leg.move.inner) for leg in path.legs if leg.rest)]


def axes(path: VerificationPath, geometry: TableGeometry) -> np.ndarray:
    """Return the axes of the rotations in body axes."""
    found = []
    for number, turn in enumerate(path.turns):
        leg = next(leg for leg in path.legs if leg.turn == number)
        found.append(joint_axis(geometry, turn.joint, leg.move.inner))
    return np.array(found)


@pytest.mark.parametrize(
    ("outer", "inner", "directions"),
    [
        ((1.0, 0, 0), (0, 0, 1.0), 3),
        ((0, 1.0, 0), (0, 0, 1.0), 3),
        ((0, 0, 1.0), (1.0, 0, 0), 2),  # nothing brings x upwards there
    ],
)
@pytest.mark.parametrize("compared", [False, True])
def test_path_rotates_about_three_axes_and_rests_in_every_direction(
    outer: tuple[float, float, float], inner: tuple[float, float, float], directions: int, compared: bool
) -> None:
    geometry = TableGeometry(outer, inner, WIDE)
    path = verification_path((0.1, -0.2), geometry, WIDE, compared=compared)
    size = np.pi if compared else 2.0 * np.pi
    assert [abs(turn.amount) for turn in path.turns] == pytest.approx([size] * 3)
    assert [turn.is_full for turn in path.turns] == [not compared] * 3
    assert abs(np.linalg.det(axes(path, geometry))) > 0.99
    ups = np.array([geometry.body_to_home(*pose)[2] for pose in poses(path)])
    assert (np.linalg.svd(ups)[1] > 0.9).sum() == directions
    (opposite,) = (leg.move for leg in path.legs if leg.opposite)
    assert (ups @ geometry.body_to_home(opposite.outer, opposite.inner)[2]).min() < -0.99


@given(
    start=st.tuples(*[st.floats(-3.0, 3.0)] * 2),
    low=st.tuples(*[st.floats(0.0, 12.0)] * 2),
    high=st.tuples(*[st.floats(0.0, 12.0)] * 2),
    tilt=st.floats(-0.5, 0.5),
    compared=st.booleans(),
)
def test_every_move_is_within_the_travel_and_the_path_returns_to_its_start(
    start: tuple[float, float], low: tuple[float, float], high: tuple[float, float], tilt: float, compared: bool
) -> None:
    bounds = (
        (start[0] - low[0], start[1] - low[1]),
        (start[0] + high[0], start[1] + high[1]),
    )
    limits = JointLimits(*bounds, (1.0, 2.0), (1.5, 1.0))
    geometry = TableGeometry((np.cos(tilt), 0.0, np.sin(tilt)), (0.0, 0.0, 1.0), limits)
    if max(low[0], high[0]) < 30 * DEG or max(low[1], high[1]) < 30 * DEG:
        with raises_code(ConfigurationError, "motion.no_turn"):
            verification_path(start, geometry, limits, compared=compared)
        return
    path = verification_path(start, geometry, limits, compared=compared)
    here = start
    sizes = [0.0] * len(path.turns)
    for leg in path.legs:
        check_limits(limits, leg.move)
        check_travel(limits, leg.move)
        to = leg.move.outer, leg.move.inner
        assert to != here
        if leg.turn is not None:
            assert (to[0] == here[0]) != (to[1] == here[1]), "one joint at a time"
            joint = path.turns[leg.turn].joint
            sizes[leg.turn] += to[joint] - here[joint]
        here = to
    assert here == pytest.approx(start, abs=1e-9)
    assert sizes == pytest.approx([turn.amount for turn in path.turns])
    rests = poses(path)
    for number, turn in enumerate(path.turns):
        leg = next(leg for leg in path.legs if leg.turn == number)
        other = 1 - turn.joint
        apart = (rests[turn.rest][other] - (leg.move.outer, leg.move.inner)[other]) / (2 * np.pi)
        assert apart == pytest.approx(round(apart), abs=1e-6)


def test_gyros_with_a_small_range_are_rotated_slowly() -> None:
    path = verification_path((0.0, 0.0), TableGeometry(limits=WIDE), WIDE, max_rate=0.5)
    assert {leg.move.rate for leg in path.legs} == {0.5}
