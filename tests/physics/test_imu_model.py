"""Compensation inverts the error model of the contract, which is implemented independently here."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calstation.physics import INDEX, PARAMETERS, compensate, compensation

LARGEST = {
    "gyro_bias": 0.05,
    "gyro_scale": 0.02,
    "gyro_misalign": 0.02,
    "accel_bias": 0.5,
    "accel_scale": 0.02,
    "accel_misalign": 0.02,
    "accel_quadratic": 5e-5,
    "inner_lever": 0.1,
    "outer_lever": 0.5,
}
PARAMETER_VECTORS = st.tuples(*[st.floats(-LARGEST[p.group], LARGEST[p.group]) for p in PARAMETERS]).map(np.array)


def vectors(limit):
    return st.tuples(*[st.floats(-limit, limit)] * 3).map(np.array)


def forward(parameters, omega, force):
    """Return the raw output at rate omega and specific force at the reference point, by the contract."""
    p = {name: parameters[i] for name, i in INDEX.items()}
    gyro = np.array(
        [
            omega[i]
            + p[f"gyro_scale_{a}"] * omega[i]
            + sum(p[f"gyro_misalign_{a}{b}"] * omega[j] for j, b in enumerate("xyz") if j != i)
            + p[f"gyro_bias_{a}"]
            for i, a in enumerate("xyz")
        ]
    )
    # displacement along its own axis: e_i · (ω × (ω × l e_i)) = −l (|ω|² − ω_i²), and none from ω̇ × l e_i
    sensed = np.array([force[i] - p[f"inner_lever_{a}"] * (omega @ omega - omega[i] ** 2) for i, a in enumerate("xyz")])
    accel = np.array(
        [
            sensed[i]
            + p[f"accel_scale_{a}"] * sensed[i]
            + sum(p[f"accel_misalign_{a}{b}"] * sensed[j] for j, b in enumerate("xyz") if j < i)
            + p[f"accel_quadratic_{a}"] * sensed[i] ** 2
            + p[f"accel_bias_{a}"]
            for i, a in enumerate("xyz")
        ]
    )
    return gyro, accel


@given(PARAMETER_VECTORS, vectors(7.0), vectors(30.0))
def test_compensation_inverts_the_error_model(parameters, omega, force):
    gyro, accel = forward(parameters, omega, force)
    found_omega, found_force = compensate(compensation(parameters), gyro[None], accel[None])
    assert found_omega[0] == pytest.approx(omega, abs=1e-12)
    # three steps of the iteration leave (2 K2 f)³ of the second-order term K2 f²
    rest = (2.0 * 5e-5 * 31.0) ** 3 * 5e-5 * 31.0**2 * 2.0
    assert found_force[0] == pytest.approx(force, abs=rest + 1e-12)


def test_every_sample_is_compensated_independently():
    parameters = 0.5 * np.array([LARGEST[p.group] for p in PARAMETERS])
    gyro, accel = np.random.default_rng(1).normal(0.0, 3.0, (2, 5, 3))
    together = compensate(compensation(parameters), gyro, accel)
    for k in range(5):
        alone = compensate(compensation(parameters), gyro[k : k + 1], accel[k : k + 1])
        assert together[0][k] == pytest.approx(alone[0][0], abs=1e-13)
        assert together[1][k] == pytest.approx(alone[1][0], abs=1e-13)
