"""The posterior includes the gravity uncertainty: a gravity error changes a solution as predicted."""

from dataclasses import replace

import numpy as np
import pytest
from simulated_stages import block_of, context_of, solved

from calstation.estimation.common import Posterior, Site, gravity_sensitivity, with_gravity
from calstation.estimation.common.gravity import force_scaling
from calstation.physics import COUNT, NAMES, group_indices, group_matrix, group_vector

SCALE = list(group_indices("accel_scale"))


def test_scaling_forces_and_parameters_leaves_the_output_unchanged():
    p = 1e-3 * np.arange(1.0, COUNT + 1.0)
    f, step = np.array([3.0, -5.0, 8.0]), 1e-6
    q = p + step * force_scaling(p)

    def output(parameters, force):
        M = np.eye(3) + group_matrix(parameters, "accel_scale", "accel_misalign")
        K2, bias = group_vector(parameters, "accel_quadratic"), group_vector(parameters, "accel_bias")
        return M @ force + K2 * force**2 + bias

    assert output(q, (1.0 + step) * f) == pytest.approx(output(p, f), abs=1e-9)


@pytest.mark.long
@pytest.mark.parametrize("tight", [1.0, 0.01])
def test_wrong_gravity_changes_the_solution_as_predicted(nav_chain, tight):
    # the tight prior of the scale factors (9 ppm) resists the error
    prior = Posterior(nav_chain.prior.mean, tight**2 * nav_chain.prior.covariance)
    context, block, off = context_of(nav_chain.truth), block_of(nav_chain.samples["six_position"]), 5e-6
    right = solved(nav_chain.truth, prior, [block], context)
    site = replace(context.site, gravity=(1.0 + off) * context.site.local_gravity)
    wrong = solved(nav_chain.truth, prior, [block], replace(context, site=site)).posterior.mean
    predicted = gravity_sensitivity(prior, right.posterior, right.estimated, np.zeros(COUNT))
    assert (wrong - right.posterior.mean) / off == pytest.approx(predicted, rel=1e-2, abs=1e-3)
    share = np.abs(predicted[SCALE])
    assert np.all(share > 0.99) if tight == 1.0 else np.all(share < 0.99)
    assert np.flatnonzero(predicted).size == 6  # what the stage estimates


def test_gravity_error_is_common_to_scale_factors_and_not_averaged_out(nav_chain):
    posterior, sensitivity = nav_chain.prior, np.zeros(COUNT)
    for stage in ("rate", "six_position", "excitation"):
        solution = nav_chain.solutions[stage]
        sensitivity = gravity_sensitivity(posterior, solution.posterior, solution.estimated, sensitivity)
        posterior = solution.posterior
    assert sensitivity[SCALE] == pytest.approx(-1.0, abs=2e-3)
    assert np.abs(sensitivity[[NAMES.index("gyro_bias_x"), NAMES.index("accel_bias_z")]]).max() < 1e-3
    whole = with_gravity(posterior, sensitivity, 51e-6)
    variance = whole.covariance[np.ix_(SCALE, SCALE)]
    assert whole.sigma[SCALE] == pytest.approx(51e-6, rel=0.02)
    assert variance / np.outer(whole.sigma[SCALE], whole.sigma[SCALE]) == pytest.approx(1.0, abs=0.03)


def test_gravity_sigma_is_taken_from_the_site():
    normal = Site(0.6, 1.9, 400.0)
    for site, sigma in (
        (normal, 5e-4),
        (replace(normal, gravity=9.79547), 1e-6),
        (replace(normal, gravity=9.79547, gravity_sigma=2e-5), 2e-5),
        (replace(normal, gravity_sigma=2e-4), 2e-4),
    ):
        assert site.relative_gravity_sigma == pytest.approx(sigma / site.local_gravity)
