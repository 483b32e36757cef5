"""Compensation of raw IMU output with the parameters of the error model."""

from typing import NamedTuple

import numpy as np

from calstation.physics.arrays import FloatArray
from calstation.physics.parameters import group_matrix, group_vector


class Compensation(NamedTuple):
    """Constants that convert raw output to angular rate and specific force at the reference point of the IMU."""

    gyro_inverse: FloatArray  #: (I + M_g)⁻¹, shape (3, 3)
    gyro_bias: FloatArray  #: rad/s, shape (3,)
    accel_inverse: FloatArray  #: (I + M_a)⁻¹, shape (3, 3)
    accel_bias: FloatArray  #: m/s², shape (3,)
    quadratic: FloatArray  #: K2, s²/m, shape (3,)
    inner_lever: FloatArray  #: m, shape (3,)
    outer_lever: FloatArray  #: m, shape (3,)


def compensation(parameters: FloatArray) -> Compensation:
    """Compute the compensation constants of a parameter vector, SI, shape (30,)."""
    return Compensation(
        _inverse(parameters, "gyro_scale", "gyro_misalign"),
        group_vector(parameters, "gyro_bias"),
        _inverse(parameters, "accel_scale", "accel_misalign"),
        group_vector(parameters, "accel_bias"),
        group_vector(parameters, "accel_quadratic"),
        group_vector(parameters, "inner_lever"),
        group_vector(parameters, "outer_lever"),
    )


def _inverse(parameters: FloatArray, *groups: str) -> FloatArray:
    return np.asarray(np.linalg.inv(np.eye(3) + group_matrix(parameters, *groups)), dtype=np.float64)


def compensate(c: Compensation, gyro: FloatArray, accel: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return angular rate, rad/s, and specific force, m/s², at the reference point from raw mean rates, shape (n, 3).

    The second-order term is found by three fixed-point iterations, whose relative error is (2 K2 f)³.
    """
    omega = (gyro - c.gyro_bias) @ c.gyro_inverse.T
    linear = accel - c.accel_bias
    force = linear @ c.accel_inverse.T
    for _ in range(3):
        force = (linear - c.quadratic * force**2) @ c.accel_inverse.T
    square = omega**2
    return omega, force + c.inner_lever * (square.sum(axis=1, keepdims=True) - square)
