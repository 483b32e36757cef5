"""The rate stage: scale factors agree with the sigma given by the encoder; missing rotations are reported."""

from dataclasses import replace

import numpy as np
import pytest
from simulated_stages import SCHEDULES, block_of, context_of, errors_in_sigma, solved

from calstation.errors import InsufficientDataError
from calstation.physics import NAMES, group_indices, rotation_matrix
from tests.helpers import raises_code

SCALE = group_indices("gyro_scale")


def moves(chain):
    """Return the step numbers of the stage in order: positioning, forward, back, for x, y and z."""
    return sorted({int(s) for s in chain.samples["rate"].step if s > 0})


def without(chain, *steps):
    """Return the stage without the samples of some steps."""
    samples = chain.samples["rate"]
    return block_of(samples, ~np.isin(samples.step, steps))


def test_scale_factors_agree_with_their_sigma(chain):
    errors = errors_in_sigma(chain.solutions["rate"].posterior, chain.truth)
    assert np.abs(errors).max() < 4.0
    assert chain.solutions["rate"].consistency.passed


def test_sigma_is_the_encoder_sigma_over_the_angle(nav_chain):
    encoder, angle = np.deg2rad(0.05), 2.0 * np.pi * SCHEDULES["rate"]["turns"]
    # from rests 0, 1, 2: ((e1 − e0) − (e2 − e1)) over both ways' angle
    by_encoder = np.sqrt(6.0) * encoder / (2.0 * angle)
    prior = nav_chain.prior.sigma[SCALE]
    expected = 1.0 / np.sqrt(1.0 / by_encoder**2 + 1.0 / prior**2)
    assert nav_chain.solutions["rate"].posterior.sigma[SCALE] == pytest.approx(expected, rel=0.1)


def test_better_encoder_gives_a_better_scale_factor(nav_chain):
    context = context_of(nav_chain.truth)
    fine = replace(context, table=replace(context.table, encoder_sigma=np.deg2rad(0.005)))
    block = block_of(nav_chain.samples["rate"])
    better = solved(nav_chain.truth, nav_chain.prior, [block], fine).posterior.sigma[SCALE]
    assert better == pytest.approx(nav_chain.solutions["rate"].posterior.sigma[SCALE] / 10.0, rel=0.3)


def test_all_other_parameters_are_consider_parameters(chain):
    others = [i for i, name in enumerate(NAMES) if i not in SCALE]
    solution = chain.solutions["rate"]
    assert np.array_equal(solution.posterior.mean[others], chain.prior.mean[others])
    assert np.array_equal(solution.posterior.sigma[others], chain.prior.sigma[others])
    assert solution.estimated == tuple(NAMES[i] for i in SCALE)
    assert (
        np.linalg.eigvalsh(
            solution.posterior.covariance / np.outer(solution.posterior.sigma, solution.posterior.sigma)
        ).min()
        > -1e-9
    )


def test_six_rotations_are_found_with_their_joints_and_angles(nav_chain):
    turns = nav_chain.solutions["rate"].details["turns"]
    assert [turn["joint"] for turn in turns] == ["outer"] * 4 + ["inner"] * 2
    assert np.rad2deg([turn["angle"] for turn in turns]) == pytest.approx([360.0, -360.0] * 3, abs=0.3)


def test_without_encoders_rotations_are_assumed_whole_turns_and_reported(nav_chain):
    block = block_of(nav_chain.samples["rate"])
    blind = replace(block, angles=np.full_like(block.angles, np.nan))
    solution = solved(nav_chain.truth, nav_chain.prior, [blind])
    assert [key for key, _ in solution.messages] == ["turns_assumed_whole"]
    assert np.abs(errors_in_sigma(solution.posterior, nav_chain.truth)).max() < 4.0
    assert solution.posterior.sigma[SCALE] == pytest.approx(nav_chain.solutions["rate"].posterior.sigma[SCALE], rel=0.2)


def blind_block(chain):
    """Return the stage without encoder angles."""
    block = block_of(chain.samples["rate"])
    return replace(block, angles=np.full_like(block.angles, np.nan))


def test_without_encoders_an_incomplete_turn_is_refused(nav_chain):
    block, counts = blind_block(nav_chain), block_of(nav_chain.samples["rate"]).counts.copy()
    after = block.step > moves(nav_chain)[1]  # from the second turn on, as if the first had ended 4° early
    counts[after, 3:] = counts[after, 3:] @ rotation_matrix(np.array([np.deg2rad(4.0), 0.0, 0.0])).T
    with raises_code(InsufficientDataError, "solve.turn_against_gravity") as caught:
        solved(nav_chain.truth, nav_chain.prior, [replace(block, counts=counts)])
    assert caught.value.values["away_deg"] == pytest.approx(4.0, abs=0.3)


def test_without_encoders_a_vertical_rotation_must_agree_with_the_prior(nav_chain):
    block = blind_block(nav_chain)
    counts = block.counts.copy()
    counts[:, 2] *= 0.92  # 3.68 turns taken for 4
    with raises_code(InsufficientDataError, "solve.turn_unproven") as caught:
        solved(nav_chain.truth, nav_chain.prior, [replace(block, counts=counts)])
    assert caught.value.values["turns"] == pytest.approx(0.92, abs=0.003)
    assert caught.value.values["away_deg"] == pytest.approx(360.0 * 0.08, abs=1.0)


def test_without_encoders_a_vertical_rotation_requires_a_tight_prior(nav_chain):
    wide = nav_chain.prior.covariance.copy()
    wide[SCALE[2], SCALE[2]] = 0.2**2
    with raises_code(InsufficientDataError, "solve.turn_unproven"):
        solved(nav_chain.truth, replace(nav_chain.prior, covariance=wide), [blind_block(nav_chain)])


@pytest.mark.parametrize(("lost", "missing"), [((1,), ["+x", "-x"]), ((5,), ["-y"]), ((7, 8), ["+z", "-z"])])
def test_missing_rotation_is_reported_and_missing_rest_invalidates_both_neighbours(nav_chain, lost, missing):
    steps = [moves(nav_chain)[i] for i in lost]
    with raises_code(InsufficientDataError, "solve.no_whole_turn") as caught:
        solved(nav_chain.truth, nav_chain.prior, [without(nav_chain, *steps)])
    assert caught.value.values["missing"] == missing


def test_stage_without_samples_reports_every_rotation_missing(nav_chain):
    with raises_code(InsufficientDataError, "solve.no_whole_turn") as caught:
        solved(nav_chain.truth, nav_chain.prior, [without(nav_chain, *moves(nav_chain), 0)])
    assert caught.value.values["missing"] == ["+x", "-x", "+y", "-y", "+z", "-z"]
    assert "(0 turns found)" in str(caught.value)
