"""Piece-wise constant observability: ranks from theory, and the rotation that makes each state observable."""

import json
from itertools import pairwise

import numpy as np
import pytest
from simulated_stages import SCHEDULES, block_of, cut, geometry_of, solved

from calstation.estimation.common import stage_data, starts
from calstation.estimation.navigation import ClosedLoopFilter
from calstation.estimation.navigation.observability import (
    MAX_PIECE_ANGLE,
    STATE_NAMES,
    ObservabilityAnalysis,
    pieces,
)
from calstation.estimation.navigation.stage import LiveFilter
from calstation.judgement import unobservable
from calstation.physics import NAMES, Move
from procedures import method


@pytest.fixture(scope="module")
def passed(nav_stage):
    """Samples, history of one pass over the stage, and its observability analysis."""
    data = stage_data([nav_stage.block], nav_stage.context.imu)
    run = ClosedLoopFilter(nav_stage.context, nav_stage.prior, nav_stage.prior.mean)
    (start,) = starts(data, nav_stage.context, nav_stage.prior)
    list(run.steps(data, start, start.attitude))
    analysis = ObservabilityAnalysis(nav_stage.context, nav_stage.prior, nav_stage.prior.mean)
    analysis.add(data, run.history)
    return data, run.history, analysis.result()


@pytest.fixture(scope="module")
def labels(nav_stage):
    """Labels of the stage's steps by number."""
    excitation = method("excitation")
    schedule = excitation.schedule(**SCHEDULES["excitation"])
    last = int(nav_stage.block.step[-1])
    moves = (s.label for s in excitation.plan(geometry_of(nav_stage.truth), schedule) if isinstance(s, Move))
    return {number: next(moves) for number in range(1, last + 1)}


def first_turn_about(labels, axis):
    """Return the step that first rotates about a body axis, apart from positioning moves."""
    return min(number for number, label in labels.items() if label[:2] == ("turn_about", axis))


def test_eight_directions_are_observable_at_rest(passed):
    _, _, output = passed
    # velocity (3), force against tilt and bias (3), rate across gravity (2); a bias and a tilt only as their sum
    assert output["segments"][0]["rank"] == 8


def test_rank_grows_with_the_rotations_and_never_decreases(passed):
    _, _, output = passed
    ranks = [segment["rank"] for segment in output["segments"]]
    assert ranks == sorted(ranks)
    assert ranks[-1] == 36
    strongest = [segment["singular_values"][0] for segment in output["segments"]]
    assert strongest == sorted(strongest)


def test_segments_are_the_steps_of_the_stage_in_order(passed, labels):
    data, _, output = passed
    assert [segment["step"] for segment in output["segments"]] == list(labels)
    seqs = [(segment["first_seq"], segment["last_seq"]) for segment in output["segments"]]
    assert all(a <= b for a, b in seqs)
    assert all(b < c for (_, b), (c, _) in pairwise(seqs))
    for segment in output["segments"]:
        assert data.step[data.seq == segment["last_seq"]] == segment["step"]


@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_gyro_scale_factor_becomes_observable_by_rotation_about_its_axis(passed, labels, axis):
    _, _, output = passed
    # the inner axis also turns, about z, to point x and y along the outer axis
    turns = [n for n, label in labels.items() if label[0] == "into_place" and axis == "z"]
    first = first_turn_about(labels, axis)
    last = first + (abs(labels[first][2]) < 90.0)  # half a quarter turn shows too little
    strengths = output["states"][f"gyro_scale_{axis}"]["by_step"]
    assert strengths[min([first, *turns]) - 2] < 1.5
    assert strengths[last - 1] > 5.0


def test_information_from_rotations_between_rests_is_included(passed, nav_stage):
    _, _, output = passed
    gained = nav_stage.prior.sigma / solved(nav_stage.truth, nav_stage.prior, [nav_stage.block]).posterior.sigma
    for name, gain in zip(NAMES, gained, strict=True):
        if name.startswith(("gyro_scale", "gyro_misalign")):
            assert output["states"][name]["strength"] > 0.3 * gain, name


def test_gravity_parameters_are_observable_in_the_first_step(passed):
    _, _, output = passed
    states = output["states"]
    assert all(states[f"velocity_error_{a}"]["step"] == 1 for a in ("east", "north", "up"))
    assert states["accel_bias_z"]["step"] == 1
    assert states["accel_bias_x"]["step"] > 1
    assert all(states[f"outer_lever_{a}"]["step"] > 1 for a in "xyz")


def test_position_states_are_unobservable(passed):
    _, _, output = passed
    assert all(output["states"][f"position_error_{a}"]["step"] is None for a in ("east", "north", "up"))


def test_every_parameter_is_observable_in_a_full_excitation(passed):
    _, _, output = passed
    assert all(output["states"][name]["step"] is not None for name in NAMES)
    assert all(output["states"][name]["strength"] > 1.0 for name in NAMES)
    assert tuple(output["states"]) == STATE_NAMES


def test_observability_never_decreases_from_step_to_step(passed):
    _, _, output = passed
    for state in output["states"].values():
        assert np.all(np.diff(state["by_step"]) >= -2e-3 * np.array(state["by_step"][1:]))


def test_pieces_cover_every_observation_and_rotate_at_most_five_degrees(passed):
    data, history, _ = passed
    output = list(pieces(data, history))
    assert output[0][0] == 0
    assert output[-1][1] == len(history.index)
    assert all(b == c for (_, b), (c, _) in pairwise(output))
    rate = np.linalg.norm(history.rate, axis=1)
    interval = 0.1
    for a, b in output:
        turned = np.sum(rate[a + 1 : b]) * interval
        assert turned <= MAX_PIECE_ANGLE + 1e-6 or rate[a:b].max() <= np.deg2rad(0.5)


def test_observability_of_a_solution_can_be_written_as_json(nav_stage):
    output = solved(nav_stage.truth, nav_stage.prior, [nav_stage.block]).observability
    assert json.loads(json.dumps(output, allow_nan=False)) == output


def test_live_observability_converges_to_the_observability_of_the_solution(nav_stage, passed):
    live = LiveFilter(nav_stage.context, nav_stage.prior)
    assert live.observability.ranking() is None
    block, ranks = nav_stage.block, {}
    edges = np.flatnonzero(np.diff(block.step)) + 1
    for piece in cut(block, [int(e) for e in edges]):
        live.feed(piece)
        live.sigma()
        ranking = live.observability.ranking()
        assert ranking is not None
        ranks[ranking.step] = ranking
    _, _, output = passed
    assert list(ranks) == [segment["step"] for segment in output["segments"]]
    assert ranks[1].rank == 8
    last = ranks[max(ranks)]
    assert last.rank == 36
    assert tuple(last.strength) == STATE_NAMES
    for name in NAMES:
        # the live filter linearises at the prior, and half a second at the end still waits for its group
        assert last.strength[name] == pytest.approx(output["states"][name]["strength"], rel=0.15), name


def test_live_filter_keeps_no_history(nav_stage):
    live = LiveFilter(nav_stage.context, nav_stage.prior)
    for piece in cut(nav_stage.block, [5000]):
        live.feed(piece)
        live.sigma()
        assert len(live._filter.history.index) == 0


def test_parameters_excited_by_rotation_are_unobservable_at_rest(nav_stage):
    first = nav_stage.block.step == nav_stage.block.step[0]
    output = solved(nav_stage.truth, nav_stage.prior, [block_of(nav_stage.samples, first)])
    lost = unobservable(nav_stage.prior, [output])
    assert {n for n in NAMES if n.startswith(("gyro_scale", "gyro_misalign", "inner_lever", "outer_lever"))} <= set(
        lost
    )
    assert "accel_bias_z" not in lost
