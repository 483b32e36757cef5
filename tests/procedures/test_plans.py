"""The geometry of plans: faces point up, rotations have the correct axis and sign, and moves stay within limits."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

import procedures
from calstation.errors import ConfigurationError
from calstation.physics import UP, Dwell, JointLimits, Move, RoundEnd, TableGeometry, rotation_vector
from procedures import DEFAULT_STAGES, method
from tests.helpers import joint_axis, raises_code

TABLES = [
    TableGeometry(),
    TableGeometry((0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
    TableGeometry((0.0, -1.0, 0.0), (1.0, 0.0, 0.0)),
]
IDS = ["outer x inner z", "outer y inner z", "outer -y inner x"]
BODY = dict(zip("xyz", np.eye(3), strict=True))


def steps_of(stage, table, rounds=None, **schedule):
    """Return the steps of a plan, of an unlimited plan up to the end of `rounds`."""
    chosen = method(stage)
    steps = []
    for step in chosen.plan(table, chosen.schedule(**schedule)):
        steps.append(step)
        if rounds is not None and isinstance(step, RoundEnd) and step.rounds == rounds:
            break
    return steps


def moves_of(steps):
    return [step for step in steps if isinstance(step, Move)]


def turned(table, before, after):
    """Return the rotation vector in body axes from one pose to the next."""
    C0, C1 = table.body_to_home(before.outer, before.inner), table.body_to_home(after.outer, after.inner)
    return rotation_vector(C0.T @ C1)


@st.composite
def limits(draw):
    """Draw a travel of at least half a turn in both directions from home."""
    low = tuple(-draw(st.floats(np.pi, 12.0)) for _ in range(2))
    high = tuple(draw(st.floats(np.pi, 12.0)) for _ in range(2))
    return JointLimits(low=low, high=high)


def assert_within(result, steps):
    for move in moves_of(steps):
        assert result.within(0, move.outer)
        assert result.within(1, move.inner)


def test_every_procedure_file_defines_a_method_of_its_name():
    names = {path.stem for path in Path(procedures.__file__).parent.glob("*.py")} - {"__init__"}
    assert set(DEFAULT_STAGES) <= names
    assert all(method(name).name == name for name in names)


def test_error_for_an_unknown_stage_lists_the_known_stages():
    with raises_code(ConfigurationError, "plan.no_such_stage") as caught:
        method("rates")
    assert caught.value.values["stage"] == "rates"
    assert set(DEFAULT_STAGES) <= set(caught.value.values["known"])


@pytest.mark.parametrize("stage", DEFAULT_STAGES)
def test_schedule_refuses_unknown_keys_and_invalid_values(stage):
    schedule = method(stage).schedule
    with pytest.raises(ValidationError, match="extra"):
        schedule(dwel_s=10.0)
    for wrong in ({"dwell_s": 0.0}, {"rate_dps": 0.0}, {"acceleration_dps2": -1.0}):
        with pytest.raises(ValidationError):
            schedule(**wrong)


@pytest.mark.parametrize("stage", DEFAULT_STAGES)
def test_every_move_is_followed_by_its_rest(stage):
    steps = [s for s in steps_of(stage, TableGeometry(), 1, dwell_s=7.0) if not isinstance(s, RoundEnd)]
    pairs = list(zip(steps[::2], steps[1::2], strict=True))
    assert all(isinstance(a, Move) and isinstance(b, Dwell) for a, b in pairs)
    durations = {b.duration for a, b in pairs if a.label[0] not in ("into_place", "oblique")}
    assert durations == {"six_position": {7.0, 10.0}, "excitation": {7.0, 5.0}}.get(stage, {7.0})


@pytest.mark.parametrize("table", TABLES, ids=IDS)
def test_six_positions_point_each_face_up_once_and_repeat_the_first(table):
    result = [move for move in moves_of(steps_of("six_position", table)) if move.label[0] == "face_up"]
    faces = [move.label[1] for move in result]
    assert faces == ["+z", "-z", "+y", "-y", "+x", "-x", "+z"]
    for move, face in zip(result, faces, strict=True):
        up = table.body_to_home(move.outer, move.inner).T @ UP
        assert up == pytest.approx(BODY[face[1]] * (1.0 if face[0] == "+" else -1.0), abs=1e-9)


@pytest.mark.parametrize("table", TABLES, ids=IDS)
def test_oblique_positions_cancel_biases_and_misalignments(table):
    steps = steps_of("six_position", table)
    result = [move for move in moves_of(steps) if move.label[0] == "oblique"]
    up = np.array([table.body_to_home(move.outer, move.inner).T @ UP for move in result])
    assert np.abs(up) == pytest.approx(np.full((4, 3), 3.0**-0.5), abs=1e-9)
    assert up.sum(axis=0) == pytest.approx(np.zeros(3), abs=1e-9)
    assert up.T @ up == pytest.approx(4.0 / 3.0 * np.eye(3), abs=1e-9)
    assert [step.duration for step in steps[-9::2]] == [10.0] * 5


@given(limits())
def test_six_positions_fit_any_travel_of_half_a_turn_in_both_directions(travel):
    assert_within(travel, steps_of("six_position", TableGeometry(limits=travel)))


def test_table_with_a_vertical_outer_axis_cannot_reach_the_faces():
    with raises_code(ConfigurationError, "plan.direction_not_upward"):
        steps_of("six_position", TableGeometry((0.0, 0.0, 1.0), (1.0, 0.0, 0.0)))


@pytest.mark.parametrize("table", TABLES, ids=IDS)
def test_excitation_rotates_about_y_x_z_z_x_y_and_then_reverses(table):
    turns = [pair for pair in pairwise(moves_of(steps_of("excitation", table, 2))) if pair[1].label[0] == "turn_about"]
    order = "".join(after.label[1] for _, after in turns)
    assert order == 2 * "yyyyxxxxxzzzzzzzzzxxxxyyyyy"
    angles = [abs(after.label[2]) for _, after in turns]
    assert angles == 2 * 3 * [90.0, 90.0, 90.0, 90.0, 45.0, 90.0, 90.0, 90.0, 45.0]
    rates = np.rad2deg([after.rate for _, after in turns])
    assert rates == pytest.approx(2 * 3 * [20.0, 10.0, 20.0, 10.0, 20.0, 10.0, 20.0, 10.0, 20.0])
    ways = ([], [])
    for before, after in turns:
        _, axis, angle = after.label
        assert turned(table, before, after) == pytest.approx(np.deg2rad(angle) * BODY[axis], abs=1e-9)
        way = np.array([after.outer - before.outer, after.inner - before.inner])
        joint = int(np.argmax(np.abs(way)))
        ways[joint].append(way[joint])
    for joint in ways:
        assert np.abs(np.cumsum(joint)).max() == pytest.approx(2.0 * np.pi)


@pytest.mark.parametrize("table", TABLES, ids=IDS)
def test_excitation_rests_between_body_axes_in_every_second_revolution(table):
    result = moves_of(steps_of("excitation", table, 1))
    up = np.abs([table.body_to_home(move.outer, move.inner).T @ UP for move in result if move.label[0] == "turn_about"])
    between = np.isclose(np.sort(up, axis=1), [0.0, 0.5**0.5, 0.5**0.5], atol=1e-9).all(axis=1)
    assert between.tolist() == 3 * [False, False, False, False, True, True, True, True, False]


@pytest.mark.parametrize("table", TABLES[:2], ids=IDS[:2])
def test_excitation_rotates_about_every_axis_in_both_directions(table):
    ways = {axis: set() for axis in "xyz"}
    for move in moves_of(steps_of("excitation", table, 1)):
        if move.label[0] == "turn_about":
            ways[move.label[1]].add(np.sign(move.label[2]))
    assert set(map(frozenset, ways.values())) == {frozenset({-1.0, 1.0})}


@pytest.mark.parametrize("table", TABLES, ids=IDS)
def test_excitation_angles_do_not_accumulate(table):
    angles = np.array([(move.outer, move.inner) for move in moves_of(steps_of("excitation", table, 5))])
    assert np.abs(angles).max() <= 3.0 * np.pi + 1e-9


def test_excitation_rotates_about_the_inner_axis_while_horizontal():
    for before, after in pairwise(moves_of(steps_of("excitation", TableGeometry(), 1))):
        if after.label[:2] == ("turn_about", "z"):
            z_n = TableGeometry().body_to_home(before.outer, before.inner)[:, 2]
            assert z_n @ UP == pytest.approx(0.0, abs=1e-9)


@given(limits())
def test_excitation_fits_any_travel_of_half_a_turn_in_both_directions(travel):
    table = TableGeometry(limits=travel)
    steps = steps_of("excitation", table, 2)
    assert_within(travel, steps)
    for before, after in pairwise(moves_of(steps)):
        if after.label[0] == "turn_about":
            angle = np.deg2rad(after.label[2])
            assert turned(table, before, after) == pytest.approx(angle * BODY[after.label[1]], abs=1e-9)


@pytest.mark.parametrize("low", [-10.0, -350.0, -137.0])
def test_excitation_fits_any_travel_of_one_revolution(low):
    outer = np.deg2rad([low, low + 360.0])
    travel = JointLimits((outer[0], -4.0), (outer[1], 4.0))
    steps = steps_of("excitation", TableGeometry(limits=travel), 2)
    assert_within(travel, steps)


def test_excitation_refuses_a_travel_below_one_revolution():
    with raises_code(ConfigurationError, "plan.revolution_exceeds_travel") as caught:
        steps_of("excitation", TableGeometry(limits=JointLimits((-1.0, -4.0), (5.2, 4.0))), 1)
    assert caught.value.values["axis"] == "outer"


@given(limits(), st.integers(1, 2))
def test_whole_turns_stay_within_the_travel_or_are_refused(travel, turns):
    table = TableGeometry(limits=travel)
    room = min(high - low for low, high in zip(travel.low, travel.high, strict=True))
    if room < 2.0 * np.pi * turns:
        with raises_code(ConfigurationError, "plan.turns_exceed_travel") as caught:
            steps_of("rate", table, turns=turns)
        assert f"{turns} whole turn{'s' * (turns > 1)} needs {360 * turns}° of travel" in str(caught.value)
    else:
        assert_within(travel, steps_of("rate", table, turns=turns))


def test_whole_turns_start_within_a_short_travel():
    table = TableGeometry(limits=JointLimits(np.deg2rad([-200.0, -200.0]), np.deg2rad([200.0, 200.0])))
    ends = {move.label[1]: [] for move in moves_of(steps_of("rate", table, turns=1))}
    for move in moves_of(steps_of("rate", table, turns=1)):
        ends[move.label[1]].append(np.rad2deg(move.inner if move.label[1] == "z" else move.outer))
    assert ends["x"] == pytest.approx([-160.0, 200.0, -160.0])
    assert ends["z"] == pytest.approx([-160.0, 200.0, -160.0])


@pytest.mark.parametrize("table", TABLES, ids=IDS)
@pytest.mark.parametrize("turns", [1, 3])
def test_rate_stage_rotates_each_axis_by_whole_turns_in_both_directions(table, turns):
    result = moves_of(steps_of("rate", table, turns=turns))
    seen = {}
    for before, after in pairwise(result):
        if after.label[0] == "whole_turns":
            way = np.array([after.outer - before.outer, after.inner - before.inner])
            joint = int(np.argmax(np.abs(way)))
            assert way[1 - joint] == 0.0
            axis_b = joint_axis(table, joint, before.inner) * way[joint]
            seen.setdefault(after.label[1], []).append(axis_b @ BODY[after.label[1]])
            assert np.rad2deg(axis_b @ BODY[after.label[1]]) == pytest.approx(after.label[2])
    assert sorted(seen) == ["x", "y", "z"]
    for ways in seen.values():
        assert sorted(ways) == pytest.approx([-2.0 * np.pi * turns, 2.0 * np.pi * turns])


@pytest.mark.parametrize("table", TABLES[:2], ids=IDS[:2])
def test_azimuth_flips_alternate_half_turns_about_the_vertical(table):
    steps = steps_of("azimuth_flip", table, 2)
    result = moves_of(steps)[1:]
    ways = []
    for before, after in pairwise(moves_of(steps)):
        way = np.array([after.outer - before.outer, after.inner - before.inner])
        joint = int(np.argmax(np.abs(way)))
        axis_n = table.body_to_home(before.outer, before.inner) @ joint_axis(table, joint, before.inner)
        assert axis_n * way[joint] == pytest.approx([0.0, 0.0, after.label[1] * np.pi / 180.0], abs=1e-9)
        ways.append(after.label[1])
    assert ways == [180.0, -180.0, -180.0, 180.0] * 2
    assert (result[-1].outer, result[-1].inner) == pytest.approx((moves_of(steps)[0].outer, moves_of(steps)[0].inner))


def test_azimuth_flips_require_half_a_turn_in_both_directions():
    narrow = TableGeometry(limits=JointLimits((-4.0, -3.0), (4.0, 3.0)))
    with raises_code(ConfigurationError, "plan.flips_exceed_travel") as caught:
        steps_of("azimuth_flip", narrow, 1)
    assert "on the inner axis" in str(caught.value)


@given(limits())
def test_azimuth_flips_stay_within_the_travel(travel):
    assert_within(travel, steps_of("azimuth_flip", TableGeometry(limits=travel), 2))
