"""Recordings by hand of consumer MEMS without a profile: the default prior is so wide that it does not count."""

from dataclasses import replace

import numpy as np
import pytest
from hand_recordings import QUICK, block_of, context_of, solved, unit

from calstation.bench.truth import ImuTruth, record
from calstation.estimation import Solution
from calstation.estimation.common import Posterior
from calstation.physics import COUNT, INDEX, NAMES, PARAMETERS
from procedures.multi_position import ESTIMATED

DEFAULT = Posterior(np.zeros(COUNT), np.diag([p.prior_sigma**2 for p in PARAMETERS]))
MASK = np.array([name in ESTIMATED for name in NAMES])
MG = 9.80665e-3
ERRORS = {
    "accel_bias_x": -112.0 * MG,
    "accel_bias_y": 60.0 * MG,
    "accel_bias_z": 90.0 * MG,
    "accel_scale_x": 0.03,
    "accel_scale_z": -0.04,
    "gyro_bias_x": np.deg2rad(4.0),
    "gyro_bias_y": np.deg2rad(-2.0),
    "gyro_scale_x": 0.05,
    "gyro_scale_y": -0.04,
    "gyro_misalign_xy": 0.02,
}
QUARTER = 0.5 * np.pi
#: Six faces, and inclinations of up to 60°, which hardly separate biases from scale factors.
FACES = [(0.0, QUARTER), (0.0, 2 * QUARTER), (0.0, 3 * QUARTER), (QUARTER, 3 * QUARTER), (-QUARTER, 3 * QUARTER)]
INCLINED = [(0.5, 0.0), (0.5, 0.5), (-0.5, 0.5), (-0.5, -0.5), (0.0, -1.0)]


def consumer_unit(seed: int) -> ImuTruth:
    imu = unit("mems", seed)
    parameters = imu.parameters.copy()
    parameters[[INDEX[name] for name in ERRORS]] = list(ERRORS.values())
    return replace(imu, parameters=parameters, gyro_arw=3.0 * imu.gyro_arw, accel_vrw=3.0 * imu.accel_vrw)


def solution_of(imu: ImuTruth, poses: list[tuple[float, float]], seed: int) -> Solution:
    return solved(block_of(record(imu, QUICK, poses, seed)[0]), context_of(imu), DEFAULT)


def errors(imu: ImuTruth, solution: Solution) -> np.ndarray:
    """Return the errors of the estimated parameters in their sigmas."""
    return ((solution.posterior.mean - imu.parameters) / solution.posterior.sigma)[MASK]


@pytest.mark.parametrize("seed", [1, 2])
def test_bias_of_112_mg_is_determined_by_six_faces(seed: int) -> None:
    imu = consumer_unit(seed)
    solution = solution_of(imu, FACES, seed)
    assert np.abs(errors(imu, solution)).max() < 4.0
    assert solution.posterior.sigma[INDEX["accel_bias_x"]] < 1.0 * MG


@pytest.mark.parametrize("seed", [1, 2])
def test_default_prior_does_not_pull_what_the_recording_leaves_open(seed: int) -> None:
    """With a prior of 0.2 m/s² and 2 %, the biases are -57 ± 17, 17 ± 18 and 47 ± 15 mg."""
    imu = consumer_unit(seed)
    solution = solution_of(imu, INCLINED, seed)
    assert np.abs(errors(imu, solution)).max() < 3.0
    assert solution.posterior.sigma[INDEX["accel_bias_x"]] > 10.0 * MG
