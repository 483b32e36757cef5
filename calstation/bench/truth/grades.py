"""Grades of units: sizes of their errors and noise, and the random draw of one unit."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from calstation.bench.truth.imu import ImuTruth
from calstation.physics import COUNT, PARAMETERS, FloatArray

GradeName = Literal["nav", "tactical", "mems"]

_DEGREE_PER_HOUR = np.deg2rad(1.0) / 3600.0
_MICRO_G = 9.80665e-6
_ARW_UNIT = np.deg2rad(1.0) / 60.0  # °/√h in rad/√s
_VRW_UNIT = 9.8e-6  # µg/√Hz in m/s/√s

#: Largest drawn parameter, in sigmas of its grade.
_CUT = 2.5


@dataclass(frozen=True)
class Grade:
    """Sizes of one grade, SI: `sigma` of a unit's parameters per group; counts are those of increment output."""

    sigma: dict[str, float]
    gyro_lsb: float
    accel_lsb: float
    gyro_arw: float
    accel_vrw: float
    gyro_bias_instability: float
    accel_bias_instability: float
    gyro_range: float
    accel_range: float


GRADES: dict[GradeName, Grade] = {
    "nav": Grade(
        sigma={
            "gyro_bias": 1.0 * _DEGREE_PER_HOUR,
            "gyro_scale": 5e-4,
            "gyro_misalign": 4e-4,
            "accel_bias": 250.0 * _MICRO_G,
            "accel_scale": 3e-4,
            "accel_misalign": 3e-4,
            "accel_quadratic": 1e-6,
            "inner_lever": 0.008,
            "outer_lever": 0.05,
        },
        gyro_lsb=np.deg2rad(0.01 / 3600.0),
        accel_lsb=1e-6,
        gyro_arw=0.001 * _ARW_UNIT,
        accel_vrw=5.0 * _VRW_UNIT,
        gyro_bias_instability=0.001 * _DEGREE_PER_HOUR,
        accel_bias_instability=0.3 * _MICRO_G,
        gyro_range=np.deg2rad(400.0),
        accel_range=200.0,
    ),
    "tactical": Grade(
        sigma={
            "gyro_bias": 10.0 * _DEGREE_PER_HOUR,
            "gyro_scale": 7e-4,
            "gyro_misalign": 7e-4,
            "accel_bias": 600.0 * _MICRO_G,
            "accel_scale": 6e-4,
            "accel_misalign": 5e-4,
            "accel_quadratic": 3e-6,
            "inner_lever": 0.015,
            "outer_lever": 0.08,
        },
        gyro_lsb=2e-7,
        accel_lsb=4e-6,
        gyro_arw=0.02 * _ARW_UNIT,
        accel_vrw=20.0 * _VRW_UNIT,
        gyro_bias_instability=0.1 * _DEGREE_PER_HOUR,
        accel_bias_instability=3.0 * _MICRO_G,
        gyro_range=np.deg2rad(490.0),
        accel_range=300.0,
    ),
    "mems": Grade(
        sigma={
            "gyro_bias": np.deg2rad(0.1),
            "gyro_scale": 1.2e-3,
            "gyro_misalign": 1.2e-3,
            "accel_bias": 800.0 * _MICRO_G,
            "accel_scale": 1e-3,
            "accel_misalign": 8e-4,
            "accel_quadratic": 6e-6,
            "inner_lever": 0.03,
            "outer_lever": 0.1,
        },
        gyro_lsb=1e-6,
        accel_lsb=2e-5,
        gyro_arw=0.15 * _ARW_UNIT,
        accel_vrw=60.0 * _VRW_UNIT,
        gyro_bias_instability=1.0 * _DEGREE_PER_HOUR,
        accel_bias_instability=10.0 * _MICRO_G,
        gyro_range=np.deg2rad(450.0),
        accel_range=98.0,
    ),
}


def draw_parameters(grade: GradeName, random: np.random.Generator, outer_lever: str) -> FloatArray:
    """True parameters of one unit, shape (30,), SI; the outer lever is 0 where it is "fixed"."""
    normal = np.clip(random.standard_normal(COUNT), -_CUT, _CUT)
    sigma = np.array([GRADES[grade].sigma[p.group] for p in PARAMETERS])
    if outer_lever == "fixed":
        sigma[[i for i, p in enumerate(PARAMETERS) if p.group == "outer_lever"]] = 0.0
    return np.asarray(normal * sigma, dtype=np.float64)


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
    """One unit of a grade.

    Parameters
    ----------
    grade, random, sample_rate : of the draw; Hz
    output : "rate" counts the same lsb times the sample rate, rad/s and m/s²
    outer_lever : "estimated" or "fixed"
    instability : False leaves out the bias instability
    out_of_limits : set the x gyro's bias and the y accelerometer's scale factor to twenty sigmas
    """
    size = GRADES[grade]
    per_count = sample_rate if output == "rate" else 1.0
    parameters = draw_parameters(grade, random, outer_lever)
    if out_of_limits:
        for i, p in enumerate(PARAMETERS):
            if p.name in ("gyro_bias_x", "accel_scale_y"):
                parameters[i] = 20.0 * size.sigma[p.group]
    imu = ImuTruth(
        parameters=parameters,
        sample_rate=sample_rate,
        output=output,
        gyro_lsb=size.gyro_lsb * per_count,
        accel_lsb=size.accel_lsb * per_count,
        gyro_arw=size.gyro_arw,
        accel_vrw=size.accel_vrw,
        gyro_bias_instability=size.gyro_bias_instability,
        accel_bias_instability=size.accel_bias_instability,
        gyro_range=size.gyro_range,
        accel_range=size.accel_range,
    )
    return imu if instability else replace(imu, gyro_bias_instability=0.0, accel_bias_instability=0.0)
