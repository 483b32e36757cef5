"""Excitation and azimuth flips of simulated units: agreement with the truth, benefit of the flips, gyro z."""

import numpy as np
import pytest
from simulated_stages import block_of, errors_in_sigma, prior_of, solved

from calstation.estimation.common import Posterior
from calstation.physics import NAMES, group_indices
from procedures.azimuth_flip import ESTIMATED

BIASES = [NAMES.index(name) for name in ESTIMATED]
OTHERS = [i for i in range(30) if i not in BIASES]
Z = NAMES.index("gyro_bias_z")


@pytest.mark.parametrize("stage", ["excitation", "azimuth_flip"])
def test_every_parameter_of_every_grade_agrees_with_the_truth(chain, stage):
    errors = errors_in_sigma(chain.solutions[stage].posterior, chain.truth)
    assert np.abs(errors).max() < 4.0
    assert chain.solutions[stage].consistency.passed
    assert not chain.solutions[stage].consistency.warning
    assert chain.solutions[stage].gaps == 0


def test_short_excitation_approaches_the_accuracy_of_a_long_one(nav_chain):
    solution = dict(zip(NAMES, nav_chain.solutions["excitation"].posterior.sigma, strict=True))
    # a stage of 11 to 14 min reaches 0.4 ppm, 0.3″, 0.6 µg, 0.4 ppm, 0.2″, 0.15 mm; this one lasts 5.4 min
    assert 0.2e-6 < solution["gyro_scale_x"] < 2e-6
    assert 0.5e-6 < solution["gyro_misalign_xy"] < 4e-6
    assert 3e-6 < solution["accel_bias_x"] < 3e-5
    assert 0.2e-6 < solution["accel_scale_x"] < 2e-6
    assert 0.5e-6 < solution["accel_misalign_yx"] < 4e-6
    assert 0.5e-4 < solution["outer_lever_x"] < 4e-4


def test_excitation_reduces_every_sigma(nav_chain):
    before, after = nav_chain.priors["excitation"].sigma, nav_chain.solutions["excitation"].posterior.sigma
    assert np.all(after < before)


def test_flips_never_increase_a_bias_sigma(chain):
    before, after = (chain.solutions[s].posterior.sigma for s in ("excitation", "azimuth_flip"))
    assert np.all(after[BIASES] <= before[BIASES] * (1.0 + 1e-9))


def test_flips_determine_mostly_the_horizontal_gyros(nav_chain):
    before, after = (nav_chain.solutions[s].posterior.sigma for s in ("excitation", "azimuth_flip"))
    # the horizontal gyros gain by far the most
    assert np.all(after[:2] < 0.8 * before[:2])


def test_gyro_z_keeps_the_value_of_the_excitation(chain):
    before, after = (chain.solutions[s].posterior for s in ("excitation", "azimuth_flip"))
    assert abs(after.mean[Z] - before.mean[Z]) < before.sigma[Z]


def test_flips_alone_determine_gyro_z_poorly(nav_chain):
    alone = solved(nav_chain.truth, prior_of(nav_chain.truth), [block_of(nav_chain.samples["azimuth_flip"])])
    assert np.abs(errors_in_sigma(alone.posterior, nav_chain.truth)).max() < 4.0
    assert alone.posterior.sigma[Z] > 10.0 * nav_chain.solutions["azimuth_flip"].posterior.sigma[Z]


def test_flips_do_not_change_consider_parameters(chain):
    before, after = (chain.solutions[s].posterior for s in ("excitation", "azimuth_flip"))
    assert np.array_equal(after.mean[OTHERS], before.mean[OTHERS])
    assert after.sigma[OTHERS] == pytest.approx(before.sigma[OTHERS], rel=1e-12)
    correlation = after.covariance / np.outer(after.sigma, after.sigma)
    assert np.linalg.eigvalsh(correlation).min() > -1e-9


def test_consider_parameters_stay_correlated_with_the_biases(nav_chain):
    after = nav_chain.solutions["azimuth_flip"].posterior
    correlation = after.covariance / np.outer(after.sigma, after.sigma)
    assert np.abs(correlation[np.ix_(BIASES, OTHERS)]).max() > 0.1


def test_ignoring_consider_parameters_would_make_the_biases_overconfident(nav_chain):
    fixed = nav_chain.priors["azimuth_flip"].covariance.copy()
    fixed[OTHERS, :] = fixed[:, OTHERS] = 0.0
    sure = solved(
        nav_chain.truth,
        Posterior(nav_chain.priors["azimuth_flip"].mean, fixed + np.diag(np.full(30, 1e-30))),
        [block_of(nav_chain.samples["azimuth_flip"])],
    )
    honest = nav_chain.solutions["azimuth_flip"].posterior.sigma
    accel = group_indices("accel_bias")
    assert np.all(sure.posterior.sigma[accel] < honest[accel])
