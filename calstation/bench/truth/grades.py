"""Grades of units, with the magnitudes of their errors and noise, and random units of a grade."""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from calstation.bench.truth.imu import ImuTruth
from calstation.physics import COUNT, INDEX, PARAMETERS, FloatArray, group_indices

GradeName = Literal["nav", "tactical", "mems"]

_DEGREE_PER_HOUR = np.deg2rad(1.0) / 3600.0
_MICRO_G = 9.80665e-6
_ARW_UNIT = np.deg2rad(1.0) / 60.0  # °/√h in rad/√s
_VRW_UNIT = 9.8e-6  # µg/√Hz in m/s/√s

#: Limit of the drawn parameters, in sigmas of the grade.
_MAX_SIGMAS = 2.5


@dataclass(frozen=True)
class Grade:
    """Magnitudes of one grade, SI; LSBs refer to increment output.

    `sigma` is the sigma of a unit's parameters, and `repeatability` the sigma of their changes from one power-up to the
    next, by group.
    """

    sigma: dict[str, float]
    repeatability: dict[str, float]
    gyro_lsb: float
    accel_lsb: float
    gyro_arw: float
    accel_vrw: float
    gyro_bias_instability: float
    accel_bias_instability: float
    gyro_range: float
    accel_range: float


#: Sigma of a unit's parameters by group, for each `GradeName`.
_SIGMAS: dict[str, tuple[float, float, float]] = {
    "gyro_bias": (1.0 * _DEGREE_PER_HOUR, 10.0 * _DEGREE_PER_HOUR, np.deg2rad(0.1)),
    "gyro_scale": (5e-4, 7e-4, 1.2e-3),
    "gyro_misalign": (4e-4, 7e-4, 1.2e-3),
    "accel_bias": (250.0 * _MICRO_G, 600.0 * _MICRO_G, 800.0 * _MICRO_G),
    "accel_scale": (3e-4, 6e-4, 1e-3),
    "accel_misalign": (3e-4, 5e-4, 8e-4),
    "accel_quadratic": (1e-6, 3e-6, 6e-6),
    "inner_lever": (0.008, 0.015, 0.03),
    "outer_lever": (0.05, 0.08, 0.1),
}

#: Repeatability from power-up to power-up by group, for each `GradeName`; the levers do not change.
_REPEATABILITIES: dict[str, tuple[float, float, float]] = {
    "gyro_bias": (0.002 * _DEGREE_PER_HOUR, 0.1 * _DEGREE_PER_HOUR, 1.0 * _DEGREE_PER_HOUR),
    "gyro_scale": (1e-6, 1e-5, 5e-5),
    "gyro_misalign": (1e-6, 5e-6, 2e-5),
    "accel_bias": (2.0 * _MICRO_G, 8.0 * _MICRO_G, 30.0 * _MICRO_G),
    "accel_scale": (1e-6, 5e-6, 2e-5),
    "accel_misalign": (1e-6, 5e-6, 2e-5),
}

#: Other values of `Grade`, for each `GradeName`.
_OUTPUTS: dict[str, tuple[float, float, float]] = {
    "gyro_lsb": (np.deg2rad(0.01 / 3600.0), 2e-7, 1e-6),
    "accel_lsb": (1e-6, 4e-6, 2e-5),
    "gyro_arw": (0.001 * _ARW_UNIT, 0.02 * _ARW_UNIT, 0.15 * _ARW_UNIT),
    "accel_vrw": (5.0 * _VRW_UNIT, 20.0 * _VRW_UNIT, 60.0 * _VRW_UNIT),
    "gyro_bias_instability": (0.001 * _DEGREE_PER_HOUR, 0.1 * _DEGREE_PER_HOUR, 1.0 * _DEGREE_PER_HOUR),
    "accel_bias_instability": (0.3 * _MICRO_G, 3.0 * _MICRO_G, 10.0 * _MICRO_G),
    "gyro_range": (np.deg2rad(400.0), np.deg2rad(490.0), np.deg2rad(450.0)),
    "accel_range": (200.0, 300.0, 98.0),
}

GRADES: dict[GradeName, Grade] = {
    name: Grade(
        sigma={group: values[i] for group, values in _SIGMAS.items()},
        repeatability={group: values[i] for group, values in _REPEATABILITIES.items()},
        **{field: values[i] for field, values in _OUTPUTS.items()},
    )
    for i, name in enumerate(get_args(GradeName))
}


def draw_imu(
    grade: GradeName,
    random: np.random.Generator,
    *,
    sample_rate: float,
    output: Literal["increment", "rate"] = "increment",
    outer_lever: str = "estimated",
    instability: bool = True,
    out_of_limits: bool = False,
) -> ImuTruth:
    """Draw one unit of a grade.

    Parameters
    ----------
    grade, random : grade and generator of the draw
    sample_rate : sample rate, Hz, by which LSBs are multiplied for output "rate" (rad/s, m/s²)
    output : increments or mean rates
    outer_lever : "estimated", or "fixed" at 0
    instability : whether the biases drift
    out_of_limits : whether the x gyro bias and the y accelerometer scale factor are twenty sigmas
    """
    size = GRADES[grade]
    per_count = sample_rate if output == "rate" else 1.0
    normal = np.clip(random.standard_normal(COUNT), -_MAX_SIGMAS, _MAX_SIGMAS)
    sigma = np.array([size.sigma[p.group] for p in PARAMETERS])
    if outer_lever == "fixed":
        sigma[group_indices("outer_lever")] = 0.0
    parameters = np.asarray(normal * sigma, dtype=np.float64)
    if out_of_limits:
        for name in ("gyro_bias_x", "accel_scale_y"):
            parameters[INDEX[name]] = 20.0 * size.sigma[PARAMETERS[INDEX[name]].group]
    return ImuTruth(
        parameters=parameters,
        sample_rate=sample_rate,
        output=output,
        gyro_lsb=size.gyro_lsb * per_count,
        accel_lsb=size.accel_lsb * per_count,
        gyro_arw=size.gyro_arw,
        accel_vrw=size.accel_vrw,
        gyro_bias_instability=size.gyro_bias_instability if instability else 0.0,
        accel_bias_instability=size.accel_bias_instability if instability else 0.0,
        gyro_range=size.gyro_range,
        accel_range=size.accel_range,
    )


def draw_power_ups(grade: GradeName, random: np.random.Generator, count: int) -> FloatArray:
    """Draw the change of a unit's parameters over `count` power-ups, SI, shape (30,)."""
    size = GRADES[grade].repeatability
    sigma = np.array([size.get(p.group, 0.0) for p in PARAMETERS])
    return np.asarray(sigma * random.standard_normal((count, COUNT)).sum(axis=0), dtype=np.float64)
