"""Compensation of raw IMU output with the error-model parameters, and composition of successive corrections."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from calstation.physics.arrays import FloatArray
from calstation.physics.further_parameters import EFFECT_PARAMETERS
from calstation.physics.parameters import NAMES, PARAMETERS, group_matrix, group_vector


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

    Without gyros (output NaN), the specific force is computed as if the unit did not rotate. Three fixed-point
    iterations for the second-order term reduce its relative error from K2 f to 8 (K2 f)⁴.

    Parameters
    ----------
    c : constants of the compensation; see `compensation`
    gyro, accel : raw mean rates, rad/s, and raw mean specific forces, m/s², shape (n, 3)
    """
    omega = (gyro - c.gyro_bias) @ c.gyro_inverse.T
    linear = accel - c.accel_bias
    force = linear @ c.accel_inverse.T
    for _ in range(3):
        force = (linear - c.quadratic * force**2) @ c.accel_inverse.T
    square = np.nan_to_num(omega) ** 2
    return omega, force + c.inner_lever * (square.sum(axis=1, keepdims=True) - square)


def parameter_vector(values: Mapping[str, float]) -> FloatArray:
    """Return the parameters, SI, shape (30,); 0 for those not in `values`."""
    return np.array([values.get(name, 0.0) for name in NAMES])


def compose(old: Mapping[str, float], solved: Mapping[str, float]) -> dict[str, float]:
    """Combine register values with a solution from output corrected by them into all 30 parameters, by name, SI.

    Missing values count as 0. Values of effects in the solution are added to those in the registers and appended.

    With raw = (I + M_old) y + b_old and y = (I + M) ω + b, the raw output is (I + M_old)(I + M) ω + (I + M_old) b +
    b_old. Second-order terms and levers, which act on the specific force itself, are added, which is correct to first
    order. The accelerometer matrix stays lower triangular, as a product of lower triangular matrices.
    """
    old_vector, solved_vector = parameter_vector(old), parameter_vector(solved)
    result = old_vector + solved_vector
    for sensor in ("gyro", "accel"):
        groups = (f"{sensor}_scale", f"{sensor}_misalign")
        old_matrix = np.eye(3) + group_matrix(old_vector, *groups)
        matrix = old_matrix @ (np.eye(3) + group_matrix(solved_vector, *groups)) - np.eye(3)
        bias = old_matrix @ group_vector(solved_vector, f"{sensor}_bias") + group_vector(old_vector, f"{sensor}_bias")
        for i, parameter in enumerate(PARAMETERS):
            if parameter.group in groups:
                result[i] = matrix[parameter.row, parameter.column]
            elif parameter.group == f"{sensor}_bias":
                result[i] = bias[parameter.row]
    effects = {p.name: old.get(p.name, 0.0) + solved[p.name] for p in EFFECT_PARAMETERS if p.name in solved}
    return dict(zip(NAMES, result.tolist(), strict=True)) | effects


def composition(old: Mapping[str, float]) -> tuple[FloatArray, FloatArray]:
    """Return offset, shape (30,), and matrix, shape (30, 30), of `compose`, which is linear in the solution, SI."""
    offset = parameter_vector(compose(old, {}))
    return offset, np.column_stack([parameter_vector(compose(old, {name: 1.0})) - offset for name in NAMES])
