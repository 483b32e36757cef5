"""The six-position stage: accelerometer scale factors and biases from the magnitude of gravity."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from simulated_stages import block_of, context_of, errors_in_sigma, solved

from calstation.errors import InsufficientDataError
from calstation.estimation.common import Posterior
from calstation.physics import INDEX, NAMES, group_indices
from calstation.records import open_log
from calstation.results import solve
from tests.helpers import raises_code

SCALE, BIAS = group_indices("accel_scale"), group_indices("accel_bias")
MISALIGN = group_indices("accel_misalign")
G, X = 9.8, np.array([1.0, 0.0, 0.0])
QUADRATIC = group_indices("accel_quadratic")
RECORDING = Path(__file__).parents[3] / "shared" / "data" / "real" / "hand_six_position" / "session.csv.gz"


def without_face(chain, place):
    samples = chain.samples["six_position"]
    steps = sorted({int(s) for s in samples.step})
    again = steps[-1] if place == 0 else steps[place]  # the first face is also the last
    return block_of(samples, ~np.isin(samples.step, [steps[place], again]))


def faces_only(chain):
    """Return the samples up to the end of the sixth face, as in logs of earlier versions."""
    samples = chain.samples["six_position"]
    return block_of(samples, samples.step < sorted({int(s) for s in samples.step})[6])


def with_force_error(chain, error):
    """Return the samples with an accelerometer error, m/s², that depends on the specific force."""
    block, size = block_of(chain.samples["six_position"]), context_of(chain.truth).imu.count_size[3:]
    counts = block.counts.astype(float)
    counts[:, 3:] += error(counts[:, 3:] * size) / size
    return replace(block, counts=counts)


def test_six_faces_alone_have_no_redundancy(nav_chain):
    prior = nav_chain.priors["six_position"]
    solution = solved(nav_chain.truth, prior, [faces_only(nav_chain)])
    assert solution.consistency.count == 0
    wrong = with_force_error(nav_chain, lambda f: 5e-4 * G * (f / G) ** 3)
    unseen = solved(nav_chain.truth, prior, [wrong.part(0, len(faces_only(nav_chain)))])
    assert unseen.consistency.count == 0


def test_oblique_positions_test_the_magnitude_of_gravity(chain):
    assert chain.solutions["six_position"].consistency.count == 2


def test_oblique_positions_detect_a_cubic_term(chain):
    large = {"nav": 1e-4, "tactical": 2e-4, "mems": 5e-4}[chain.truth.grade]
    wrong = with_force_error(chain, lambda f: large * G * (f / G) ** 3)
    assert not solved(chain.truth, chain.priors["six_position"], [wrong]).consistency.passed


def test_oblique_positions_detect_a_scale_asymmetry_with_other_errors_known(nav_chain):
    prior = nav_chain.priors["six_position"]
    known = np.isin(np.arange(30), (*MISALIGN, *QUADRATIC))
    keep = np.where(known, 0.003, 1.0)
    accurate = Posterior(
        np.where(known, nav_chain.truth.parameters, prior.mean), prior.covariance * np.outer(keep, keep)
    )
    sound, wrong = (
        solved(nav_chain.truth, accurate, [with_force_error(nav_chain, lambda f, s=size: s * np.abs(f) * X)])
        for size in (0.0, 1e-3)
    )
    assert sound.consistency.count == 5
    assert sound.consistency.passed
    assert not wrong.consistency.passed


def test_scale_factor_and_bias_agree_with_their_sigma(chain):
    errors = errors_in_sigma(chain.solutions["six_position"].posterior, chain.truth)
    assert np.abs(errors).max() < 4.0
    assert chain.solutions["six_position"].consistency.passed


def test_scale_factor_and_bias_sigmas_decrease_strongly(chain):
    before, after = (chain.priors["six_position"].sigma, chain.solutions["six_position"].posterior.sigma)
    assert np.all(after[SCALE] < 0.05 * before[SCALE])
    assert np.all(after[BIAS] < 0.5 * before[BIAS])


def test_bias_keeps_the_uncertainty_of_the_second_order_term(nav_chain):
    # up and down, K2 g² is the same as a bias
    solution, gravity = nav_chain.solutions["six_position"].posterior, 9.797
    prior = nav_chain.priors["six_position"]
    doubt = prior.sigma[QUADRATIC] * gravity**2
    assert np.all(solution.sigma[BIAS] > 0.99 * doubt)
    assert solution.sigma[BIAS] == pytest.approx(np.hypot(doubt, 5e-5), rel=0.05)
    known = prior.covariance.copy()
    known[QUADRATIC, :] = known[:, QUADRATIC] = 0.0
    sharper = Posterior(np.where(np.isin(np.arange(30), QUADRATIC), nav_chain.truth.parameters, prior.mean), known)
    certain = solved(nav_chain.truth, sharper, [block_of(nav_chain.samples["six_position"])])
    assert np.all(certain.posterior.sigma[BIAS] < 0.3 * solution.sigma[BIAS])
    assert np.abs(errors_in_sigma(certain.posterior, nav_chain.truth)[BIAS]).max() < 4.0


def test_mounting_error_of_one_degree_does_not_affect_the_scale_factor(solve_chain):
    tilted = solve_chain("nav", 33, instability=False, mount_deg=(0.99, 1.0))
    errors = errors_in_sigma(tilted.solutions["six_position"].posterior, tilted.truth)
    assert np.abs(errors[SCALE]).max() < 4.0
    # a nominal direction would have cost 1 − cos 1° = 150 ppm
    assert np.abs(errors * tilted.solutions["six_position"].posterior.sigma)[SCALE].max() < 5e-5


def test_six_positions_are_solved_without_encoder_angles(nav_chain):
    block = block_of(nav_chain.samples["six_position"])
    blind = replace(block, angles=np.full_like(block.angles, np.nan))
    solution = solved(nav_chain.truth, nav_chain.priors["six_position"], [blind])
    assert np.abs(errors_in_sigma(solution.posterior, nav_chain.truth)).max() < 4.0
    assert np.all(solution.posterior.sigma[SCALE] < 0.1 * nav_chain.prior.sigma[SCALE])


def test_wrong_gravity_changes_the_scale_factor_one_to_one(nav_chain):
    context, block = context_of(nav_chain.truth), block_of(nav_chain.samples["six_position"])
    heavy = replace(context, site=replace(context.site, gravity=9.8))
    light = replace(context, site=replace(context.site, gravity=9.8 * (1.0 - 1e-4)))
    a, b = (solved(nav_chain.truth, nav_chain.priors["six_position"], [block], c).posterior for c in (heavy, light))
    assert (b.mean - a.mean)[SCALE] == pytest.approx(1e-4, rel=0.02)


def test_all_other_parameters_are_consider_parameters(chain):
    others = [i for i in range(30) if i not in SCALE + BIAS]
    before, solution = chain.priors["six_position"], chain.solutions["six_position"]
    assert np.array_equal(solution.posterior.mean[others], before.mean[others])
    assert solution.posterior.sigma[others] == pytest.approx(before.sigma[others], rel=1e-12)
    assert set(solution.estimated) == {NAMES[i] for i in SCALE + BIAS}


@pytest.mark.parametrize(("place", "face"), [(0, "+z"), (1, "-z"), (2, "+y"), (3, "-y"), (4, "+x"), (5, "-x")])
def test_missing_face_is_reported(nav_chain, place, face):
    with raises_code(InsufficientDataError, "solve.missing_faces") as caught:
        solved(nav_chain.truth, nav_chain.prior, [without_face(nav_chain, place)])
    assert caught.value.values["missing"] == [face]


@pytest.fixture(scope="module")
def recording():
    """The real recording, solved."""
    if not RECORDING.exists():
        pytest.skip(f"{RECORDING} is not there: the real recordings are not part of the project")
    log = open_log(RECORDING)
    return solve(log.blocks, log.meta).posterior


@pytest.mark.parametrize(
    ("scale", "bias"),
    [
        ((-1.227e-3, -4.232e-3, 2.861e-2), (-0.0290, -0.2310, -0.1413)),
        ((-1.399e-3, -4.007e-3, 2.848e-2), (-0.0288, -0.2312, -0.1387)),
    ],
    ids=["by modulus", "faces assumed exact"],
)
def test_manual_recording_agrees_with_its_authors(recording, scale, bias):
    assert recording.mean[SCALE] == pytest.approx(scale, abs=5e-4)
    assert recording.mean[BIAS] == pytest.approx(bias, abs=5e-3)


def test_sigmas_of_the_manual_recording_cover_its_authors_result(recording):
    published = {"accel_scale_x": -1.227e-3, "accel_scale_y": -4.232e-3, "accel_bias_x": -0.0290}
    for name, value in published.items():
        assert abs(recording.mean[INDEX[name]] - value) < 3.0 * recording.sigma[INDEX[name]]
        assert recording.sigma[INDEX[name]] < 0.01
