"""Units in other orientations and off the platform centre are calibrated in their own axes."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from simulated_stages import block_of, context_of, errors_in_sigma, prior_of, simulate, solved

from calstation.bench import BenchConfig
from calstation.bench.truth import BenchTruth, Simulator
from calstation.estimation.common import PlannedSamples, Posterior, SolveContext
from calstation.physics import (
    COUNT,
    DEFAULT_ORIENTATION,
    INDEX,
    ORIENTATIONS,
    TableGeometry,
    group_indices,
    orientation_matrix,
    rotation_matrix,
    rotation_vector,
)
from procedures import method
from tests.helpers import sampled

STAGES = ("rate", "six_position", "excitation", "azimuth_flip")


def unit(orientation: str, **bench: object) -> tuple[BenchTruth, SolveContext]:
    """Return a tactical unit in an orientation with a mounting error, and the context of its solvers."""
    truth = BenchConfig(grade="tactical", seed=31, sample_rate_hz=100.0, **bench).truth()
    turned = np.array(orientation_matrix(orientation))
    mount = rotation_vector(rotation_matrix(np.asarray(truth.table.mount)) @ turned)
    truth = replace(truth, table=replace(truth.table, mount=(mount[0], mount[1], mount[2])))
    context = context_of(truth)
    return truth, replace(context, table=replace(context.table, orientation=orientation_matrix(orientation)))


def calibrated(truth: BenchTruth, context: SolveContext, prior: Posterior, stages: tuple[str, ...]) -> SimpleNamespace:
    """Return the posterior after the stages and the solution of every stage."""
    simulator, posterior, solutions = Simulator(truth, 131), prior, {}
    for stage in stages:
        solutions[stage] = solved(truth, posterior, [block_of(simulate(simulator, truth, stage))], context)
        posterior = solutions[stage].posterior
    return SimpleNamespace(posterior=posterior, solutions=solutions)


@pytest.fixture(scope="module")
def aligned() -> SimpleNamespace:
    """The unit in the default orientation after all stages."""
    truth, context = unit(DEFAULT_ORIENTATION)
    return calibrated(truth, context, prior_of(truth), STAGES)


@pytest.mark.long
@pytest.mark.parametrize("orientation", sampled(8, ORIENTATIONS))
def test_reoriented_unit_is_calibrated_as_accurately_as_an_aligned_unit(
    aligned: SimpleNamespace, orientation: str
) -> None:
    truth, context = unit(orientation)
    solution = calibrated(truth, context, prior_of(truth), STAGES)
    errors = errors_in_sigma(solution.posterior, truth)
    assert np.abs(errors).max() < 4.0
    assert np.sqrt(np.mean(errors**2)) < 1.5
    for stage in ("excitation", "azimuth_flip"):
        consistency = solution.solutions[stage].consistency
        assert consistency.nis_low < consistency.nis_mean < consistency.nis_high
    # the orientation permutes the axes of the unit on the platform, whose motion differs between axes
    ratio = solution.posterior.sigma / aligned.posterior.sigma
    assert ratio.min() > 0.5
    assert ratio.max() < 2.0


@pytest.mark.long
@pytest.mark.parametrize("orientation", ORIENTATIONS)
def test_rotations_and_positions_are_found_in_every_orientation(orientation: str) -> None:
    truth, context = unit(orientation)
    prior = prior_of(truth)
    solution = calibrated(truth, context, prior, ("rate", "six_position"))
    assert np.abs(errors_in_sigma(solution.posterior, truth)).max() < 4.0
    for group in ("gyro_scale", "accel_scale", "accel_bias"):
        assert np.all(solution.posterior.sigma[group_indices(group)] < 0.3 * prior.sigma[group_indices(group)]), group


@pytest.mark.parametrize("orientation", ["+x+z", "-y+z", "+z-x"])
def test_rotations_without_encoders_are_assigned_to_the_correct_joint(orientation: str) -> None:
    truth, context = unit(orientation)
    block = block_of(simulate(Simulator(truth, 131), truth, "rate"))
    blind = replace(block, angles=np.full_like(block.angles, np.nan))
    with_encoders = solved(truth, prior_of(truth), [block], context)
    without = solved(truth, prior_of(truth), [blind], context)
    joints = [[turn["joint"] for turn in s.details["turns"]] for s in (with_encoders, without)]
    angles = [[turn["angle"] for turn in s.details["turns"]] for s in (with_encoders, without)]
    assert joints[0] == joints[1]
    assert angles[0] == pytest.approx(angles[1], abs=1e-2)


@pytest.mark.parametrize("orientation", ORIENTATIONS)
def test_preview_of_a_reoriented_unit_is_the_platform_motion_in_unit_axes(orientation: str) -> None:
    matrix, lever = np.array(orientation_matrix(orientation)), np.array([0.1, -0.2, 0.3])
    samples = []
    for name, arm in ((DEFAULT_ORIENTATION, lever), (orientation, matrix.T @ lever)):
        _, context = unit(name)
        parameters = np.zeros(COUNT)
        parameters[group_indices("outer_lever")] = arm
        planned = PlannedSamples(context, parameters, np.array([0.01, -0.02, 0.03]))
        steps = list(method("rate").plan(TableGeometry(), method("rate").schedule(turns=1)))[:5]
        blocks = [b for step in steps for b in planned.run(step, 2.0, "rate")]
        samples.append(np.vstack([block.counts for block in blocks]).reshape(-1, 2, 3))
    platform, body = samples
    assert body == pytest.approx(platform @ matrix, rel=1e-9, abs=1e-6 * np.abs(platform).max())


@pytest.mark.long
def test_a_large_nominal_lever_arm_is_solved_with_its_usual_sigma() -> None:
    truth, context = unit("-y+z")
    lever = group_indices("outer_lever")
    nominal = np.array([0.3, -0.25, 0.1])
    parameters = truth.parameters.copy()
    parameters[lever] += nominal
    truth = replace(truth, imu=replace(truth.imu, parameters=parameters))
    prior = prior_of(truth)
    mean = prior.mean.copy()
    mean[lever] = nominal
    solution = calibrated(truth, context, Posterior(mean, prior.covariance), STAGES)
    assert np.abs(errors_in_sigma(solution.posterior, truth)).max() < 4.0
    assert np.abs(solution.posterior.mean - parameters)[INDEX["outer_lever_x"]] < 2e-3
