"""Rotation functions agree with SciPy and with their definitions."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from calstation.physics import axis_rotation, level_attitude, rotation_matrix, rotation_vector, skew
from calstation.physics.rotation import angle_about

COMPONENT = st.floats(-10.0, 10.0)
VECTORS = st.tuples(COMPONENT, COMPONENT, COMPONENT).map(np.array)
DIRECTIONS = VECTORS.filter(lambda v: np.linalg.norm(v) > 1e-3).map(lambda v: v / np.linalg.norm(v))
SMALL_TO_LARGE = st.floats(-9.0, 0.0).map(lambda e: np.pi * 10.0**e)


@given(DIRECTIONS, SMALL_TO_LARGE)
def test_rotation_vector_survives_conversion_to_a_matrix(axis, angle):
    assume(angle < np.pi - 1e-6)
    vector = axis * angle
    assert rotation_vector(rotation_matrix(vector)) == pytest.approx(vector, abs=1e-9, rel=1e-9)


@given(DIRECTIONS, st.floats(0.0, 1e-7))
def test_rotation_vector_near_180_degrees_survives_conversion_to_a_matrix(axis, short_of_half):
    matrix = rotation_matrix(axis * (np.pi - short_of_half))
    assert rotation_matrix(rotation_vector(matrix)) == pytest.approx(matrix, abs=5e-7)


@given(VECTORS)
def test_matrices_agree_with_scipy_and_are_proper_rotations(vector):
    matrix = rotation_matrix(vector)
    assert matrix == pytest.approx(Rotation.from_rotvec(vector).as_matrix(), abs=1e-12)
    assert matrix @ matrix.T == pytest.approx(np.eye(3), abs=1e-12)
    assert np.linalg.det(matrix) == pytest.approx(1.0, abs=1e-12)


@given(VECTORS, VECTORS)
def test_skew_is_the_cross_product(a, b):
    assert skew(a) @ b == pytest.approx(np.cross(a, b), abs=1e-12)


@given(DIRECTIONS, VECTORS, st.floats(-3.1, 3.1))
def test_angle_about_recovers_the_rotation(axis, start, angle):
    assume(np.linalg.norm(np.cross(axis, start)) > 1e-2)
    assert angle_about(axis, start, axis_rotation(axis, angle) @ start) == pytest.approx(angle, abs=1e-8)


@given(DIRECTIONS, st.floats(0.1, 20.0))
def test_level_attitude_aligns_the_given_direction_with_up(up, length):
    matrix = level_attitude(up * length)
    assert matrix @ up == pytest.approx([0.0, 0.0, 1.0], abs=1e-12)
    assert matrix @ matrix.T == pytest.approx(np.eye(3), abs=1e-12)
    assert np.linalg.det(matrix) == pytest.approx(1.0, abs=1e-12)
