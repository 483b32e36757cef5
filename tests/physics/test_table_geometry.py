"""Two-axis geometry: closed forms of the contract, and properties of arbitrary pairs of axes."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from calstation.errors import ConfigurationError
from calstation.physics import (
    ALIGNED,
    DEFAULT_ORIENTATION,
    INNER,
    ORIENTATIONS,
    OUTER,
    UP,
    JointLimits,
    TableGeometry,
    orientation_matrix,
    rotation_vector,
)
from tests.helpers import raises_code

ANGLES = st.floats(-7.0, 7.0)
COMPONENT = st.floats(-1.0, 1.0)
DIRECTIONS = (
    st.tuples(COMPONENT, COMPONENT, COMPONENT)
    .map(np.array)
    .filter(lambda v: np.linalg.norm(v) > 0.1)
    .map(lambda v: v / np.linalg.norm(v))
)
SKEWS = st.floats(np.deg2rad(60.0), np.deg2rad(120.0))
AXIS_VECTORS = {s + a: (1.0 if s == "+" else -1.0) * np.eye(3)[i] for s in "+-" for i, a in enumerate("xyz")}
BODY_AXES = [sign * row for row in np.eye(3) for sign in (1.0, -1.0)]


def angle_between(a, b):
    return float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))


@st.composite
def tables(draw):
    """Draw two axes with 60° to 120° between them."""
    outer, towards = draw(DIRECTIONS), draw(DIRECTIONS)
    hinge = np.cross(outer, towards)
    assume(np.linalg.norm(hinge) > 0.1)
    inner = Rotation.from_rotvec(hinge / np.linalg.norm(hinge) * draw(SKEWS)).apply(outer)
    return TableGeometry(tuple(outer), tuple(inner))


@st.composite
def travels(draw):
    """Draw limits that contain the home position and at least one full turn of both joints."""
    low = tuple(-draw(st.floats(np.pi, 8.0)) for _ in range(2))
    high = tuple(draw(st.floats(np.pi, 8.0)) for _ in range(2))
    return JointLimits(low=low, high=high)


@given(ANGLES, ANGLES, ANGLES)
def test_default_table_is_the_product_of_rotations_in_the_contract(outer, inner, azimuth):
    expected = Rotation.from_euler("ZXZ", [-azimuth, outer, inner]).as_matrix()
    assert TableGeometry().body_to_level(outer, inner, azimuth) == pytest.approx(expected, abs=1e-12)


def test_azimuth_is_the_heading_of_y_clockwise_from_north():
    y_axis_n = TableGeometry().body_to_level(0.0, 0.0, np.deg2rad(90.0)) @ [0.0, 1.0, 0.0]
    assert y_axis_n == pytest.approx([1.0, 0.0, 0.0], abs=1e-15)


@pytest.mark.parametrize(
    ("direction", "pose"),
    [
        ((0, 0, 1), (0.0, 0.0)),
        ((0, 0, -1), (np.pi, 0.0)),
        ((0, 1, 0), (np.pi / 2, 0.0)),
        ((0, -1, 0), (-np.pi / 2, 0.0)),
        ((1, 0, 0), (np.pi / 2, np.pi / 2)),
        ((-1, 0, 0), (np.pi / 2, -np.pi / 2)),
    ],
)
def test_default_table_points_every_face_up(direction, pose):
    result = TableGeometry().pose_up(np.array(direction, dtype=float), pose)
    assert result == pytest.approx(pose, abs=1e-9)


@given(tables(), DIRECTIONS, ANGLES, ANGLES)
def test_pose_up_points_the_axis_up_or_is_refused(table, direction, near_outer, near_inner):
    try:
        outer, inner = table.pose_up(direction, (near_outer, near_inner))
    except ConfigurationError:
        # unreachable: with this angle between the axes, directions near them never point up
        w1, w2 = np.array(table.outer_axis), np.array(table.inner_axis)
        polar = [angle_between(w1, UP), angle_between(w2, direction), angle_between(w1, w2)]
        low = max(abs(polar[2] - polar[1]), 0.0)
        high = min(polar[2] + polar[1], 2.0 * np.pi - polar[2] - polar[1])
        assert not low + 1e-6 < polar[0] < high - 1e-6
        return
    assert angle_between(table.body_to_home(outer, inner) @ direction, UP) < np.deg2rad(5.0) + 1e-9


@given(DIRECTIONS, ANGLES, ANGLES)
def test_orthogonal_table_with_a_level_outer_axis_points_any_direction_up(direction, near_outer, near_inner):
    table = TableGeometry()
    outer, inner = table.pose_up(direction, (near_outer, near_inner))
    off = angle_between(table.body_to_home(outer, inner) @ direction, UP)
    # a direction within 0.5° of the inner axis is regarded as parallel to it, and the inner joint does not move
    along = min(angle_between(direction, UP), angle_between(direction, -UP))
    assert off < 1e-7 or (off <= along < np.deg2rad(0.5) and inner == near_inner)
    assert abs(outer - near_outer) <= np.pi + 1e-9
    assert abs(inner - near_inner) <= np.pi + 1e-9


@pytest.mark.parametrize("axis", BODY_AXES, ids=str)
@given(near=ANGLES, outer=ANGLES, azimuth=ANGLES, turn=st.floats(0.01, 3.0))
def test_body_turn_rotates_the_body_about_its_axis_with_the_correct_sign(axis, near, outer, azimuth, turn):
    table = TableGeometry()
    result = table.body_turn(axis, near)
    inner = near if result.inner is None else result.inner
    after = [outer, inner]
    after[result.joint] += result.sign * turn
    C0, C1 = table.body_to_level(outer, inner, azimuth), table.body_to_level(*after, azimuth)
    # C1 = C0 Exp(turn · axis): a positive turn is right-handed about the body axis
    assert rotation_vector(C0.T @ C1) == pytest.approx(axis * turn, abs=1e-9)
    assert abs(inner - near) <= np.pi / 2 + 1e-9


@given(tables(), DIRECTIONS, ANGLES, st.floats(0.01, 3.0))
def test_body_turn_works_for_any_reachable_axes(table, axis, near, turn):
    try:
        result = table.body_turn(axis, near)
    except ConfigurationError:
        w1, w2 = np.array(table.outer_axis), np.array(table.inner_axis)
        # the inner joint moves the axis on a cone about w2 that contains neither +w1 nor −w1
        reach = [abs(angle_between(w2, axis) - angle_between(w2, sign * w1)) for sign in (1.0, -1.0)]
        assert min(reach) > np.deg2rad(5.0) - 1e-6
        assert min(angle_between(w2, axis), np.pi - angle_between(w2, axis)) > np.deg2rad(0.5) - 1e-6
        return
    inner = near if result.inner is None else result.inner
    after = [0.3, inner]
    after[result.joint] += result.sign * turn
    turned = rotation_vector(table.body_to_home(0.3, inner).T @ table.body_to_home(*after))
    assert np.linalg.norm(turned) == pytest.approx(turn, abs=1e-9)
    assert angle_between(turned, axis) < np.deg2rad(5.0) + 1e-9


@pytest.mark.parametrize("near", [-3.0, 0.1, 4.0])
def test_body_turn_chooses_the_nearer_inner_angle(near):
    result = TableGeometry().body_turn(np.array([0.0, 1.0, 0.0]), near)
    both = [abs(near - (s * np.pi / 2 + 2 * np.pi * k)) for s in (1, -1) for k in (-1, 0, 1)]
    assert abs(result.inner - near) == pytest.approx(min(both), abs=1e-9)


@given(travels(), st.integers(0, 1), ANGLES, ANGLES)
def test_nearest_angle_is_the_closest_equivalent_angle_within_the_travel(limits, joint, angle, near):
    result = TableGeometry(limits=limits).nearest(joint, angle, near)
    assert limits.within(joint, result)
    turns = (result - angle) / (2.0 * np.pi)
    assert turns == pytest.approx(round(turns), abs=1e-9)
    others = [angle + 2.0 * np.pi * k for k in range(-5, 6)]
    allowed = [o for o in others if limits.low[joint] <= o <= limits.high[joint]]
    assert abs(result - near) <= min(abs(o - near) for o in allowed) + 1e-9


def test_nearest_angle_lies_within_the_travel_from_any_distance():
    table = TableGeometry(limits=JointLimits((-3.5, -3.5), (3.5, 3.5)))
    assert table.nearest(OUTER, 1.0, 100.0) == pytest.approx(1.0)


def test_an_angle_outside_the_travel_is_refused_in_degrees():
    table = TableGeometry(limits=JointLimits((-1.0, -1.0), (1.0, 1.0)))
    with raises_code(ConfigurationError, "plan.angle_out_of_travel") as caught:
        table.nearest(OUTER, np.pi / 2, 0.0)
    assert re.search(r"outer axis cannot reach 90\.0°.*-57° to 57°", str(caught.value))
    with raises_code(ConfigurationError, "plan.angle_out_of_travel") as caught:
        table.nearest(INNER, 2.0, 0.0)
    assert caught.value.values["axis"] == "inner"


@given(tables(), DIRECTIONS)
def test_poses_stay_within_limits(table, direction):
    limits = JointLimits((-np.pi, -np.pi), (np.pi, np.pi))
    bounded = TableGeometry(table.outer_axis, table.inner_axis, limits)
    try:
        pose = bounded.pose_up(direction, (0.0, 0.0))
    except ConfigurationError:
        return
    assert all(limits.within(joint, pose[joint]) for joint in (OUTER, INNER))


def test_parallel_axes_cannot_rotate_about_other_axes():
    vertical = TableGeometry((0.0, 0.0, 1.0), (0.0, 0.0, 1.0))
    with raises_code(ConfigurationError, "plan.no_axis_along"):
        vertical.body_turn(np.array([1.0, 0.0, 0.0]), 0.0)


@given(tables(), ANGLES, ANGLES)
def test_level_inner_makes_the_inner_axis_horizontal_if_possible(table, outer, inner):
    result = table.level_inner((outer, inner))
    w1, w2 = np.array(table.outer_axis), np.array(table.inner_axis)
    height = (table.body_to_home(result, inner) @ w2)[2]
    # the vertical component of the inner axis ranges between cos(polar ± between); it can be 0 if their signs differ
    polar, between = angle_between(w1, UP), angle_between(w1, w2)
    sweep = np.cos(polar + between), np.cos(polar - between)
    if sweep[0] < -1e-6 and sweep[1] > 1e-6:
        assert height == pytest.approx(0.0, abs=1e-9)
        assert abs(result - outer) <= np.pi + 1e-9
    elif sweep[0] * sweep[1] > 1e-6:
        assert result == outer


def test_level_inner_of_the_default_table_is_the_nearer_quarter_turn():
    assert TableGeometry().level_inner((0.0, 0.0)) == pytest.approx(np.pi / 2)
    assert TableGeometry().level_inner((-1.0, 0.0)) == pytest.approx(-np.pi / 2)
    assert TableGeometry().level_inner((4.0, 0.0)) == pytest.approx(1.5 * np.pi)


@pytest.mark.parametrize(
    "axes",
    [
        ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
        ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0)),
        ((0.0, 1.0, 0.0), (1.0, 0.0, 0.0)),
    ],
)
def test_vertical_joint_rotates_the_body_about_the_vertical(axes):
    table = TableGeometry(*axes)
    joint, pose = table.vertical_joint((0.2, 0.0) if axes[0][2] else (0.0, 0.0))
    after = list(pose)
    after[joint] += 1.0
    C0, C1 = table.body_to_home(*pose), table.body_to_home(*after)
    assert rotation_vector(C1 @ C0.T) == pytest.approx(UP, abs=1e-9)


def test_all_24_orientations_are_distinct_rotations():
    matrices = [np.array(orientation_matrix(name)) for name in ORIENTATIONS]
    assert len({m.tobytes() for m in matrices}) == 24
    for matrix in matrices:
        assert matrix @ matrix.T == pytest.approx(np.eye(3), abs=0.0)
        assert np.linalg.det(matrix) == pytest.approx(1.0)


@pytest.mark.parametrize("name", ORIENTATIONS)
def test_orientation_gives_the_body_axes_along_platform_x_and_z(name):
    along_x, along_z = (AXIS_VECTORS[axis] for axis in (name[:2], name[2:]))
    matrix = np.array(orientation_matrix(name))
    assert matrix @ along_x == pytest.approx([1.0, 0.0, 0.0])
    assert matrix @ along_z == pytest.approx([0.0, 0.0, 1.0])


def test_unit_in_the_default_orientation_is_aligned_with_the_platform():
    assert orientation_matrix(DEFAULT_ORIENTATION) == ALIGNED
    assert TableGeometry() == TableGeometry(orientation=orientation_matrix(DEFAULT_ORIENTATION))


@given(tables(), st.sampled_from(ORIENTATIONS), ANGLES, ANGLES, DIRECTIONS)
def test_unit_in_another_orientation_moves_with_the_platform(table, name, outer, inner, direction):
    unit, matrix = replace(table, orientation=orientation_matrix(name)), np.array(orientation_matrix(name))
    on_platform = table.body_to_home(outer, inner) @ matrix @ direction
    assert unit.body_to_home(outer, inner) @ direction == pytest.approx(on_platform, abs=1e-12)


@pytest.mark.parametrize("name", ORIENTATIONS)
def test_poses_and_rotations_of_a_reoriented_unit_are_about_its_own_axes(name):
    unit = TableGeometry(orientation=orientation_matrix(name))
    assert unit.vertical_joint((0.3, 0.4)) == TableGeometry().vertical_joint((0.3, 0.4))
    for axis in BODY_AXES:
        outer, inner = unit.pose_up(axis, (0.0, 0.0))
        assert unit.body_to_home(outer, inner) @ axis == pytest.approx(UP, abs=1e-9)
        turn = unit.body_turn(axis, 0.0)
        start = [0.0, turn.inner or 0.0]
        end = list(start)
        end[turn.joint] += 0.3 * turn.sign
        turned = unit.body_to_home(*start).T @ unit.body_to_home(*end)
        assert rotation_vector(turned) == pytest.approx(0.3 * axis, abs=1e-9)
