"""Gravity and earth rate agree with published values and with the independent equations of the bench."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calstation.bench.truth import table as earth_truth
from calstation.physics import RATE, normal_gravity, rotation_rate
from calstation.physics.earth import EQUATOR_GRAVITY, FLATTENING, POLE_GRAVITY, SEMI_MAJOR_AXIS

LATITUDES = st.floats(-np.pi / 2, np.pi / 2)


def test_gravity_on_the_ellipsoid_equals_the_published_value():
    assert normal_gravity(0.0, 0.0) == pytest.approx(9.7803253359, abs=1e-10)
    assert normal_gravity(np.pi / 2, 0.0) == pytest.approx(9.8321849378, abs=1e-10)
    assert normal_gravity(-np.pi / 2, 0.0) == pytest.approx(9.8321849378, abs=1e-10)
    # Moritz, Geodetic Reference System 1980; WGS-84 is smaller by 1.4e-6 m/s² there
    assert normal_gravity(np.pi / 4, 0.0) == pytest.approx(9.806199203, abs=2e-6)


def test_mean_gravity_over_the_ellipsoid_equals_the_published_value():
    latitude = np.linspace(-np.pi / 2, np.pi / 2, 20001)
    e2 = FLATTENING * (2.0 - FLATTENING)
    area = np.cos(latitude) / (1.0 - e2 * np.sin(latitude) ** 2) ** 2
    gravity = np.array([normal_gravity(float(angle), 0.0) for angle in latitude])
    # TR8350.2, table 3.4: mean value (theoretical) of normal gravity
    assert np.sum(gravity * area) / np.sum(area) == pytest.approx(9.7976432222, abs=2e-9)


@pytest.mark.parametrize("latitude", [0.0, np.pi / 4, np.pi / 2])
def test_gravity_decreases_with_height_as_published(latitude):
    fall = normal_gravity(latitude, 0.0) - normal_gravity(latitude, 1000.0)
    # Heiskanen and Moritz, Physical Geodesy, 2-124, in gal and km
    published = 0.30877 - 0.00045 * np.sin(latitude) ** 2 - 0.000072
    assert fall == pytest.approx(published * 1e-2, rel=1e-4)


def test_height_formula_equals_the_contract():
    sin2, height = np.sin(0.6) ** 2, 2500.0
    m = RATE**2 * SEMI_MAJOR_AXIS**3 * (1.0 - FLATTENING) / 3.986004418e14
    linear = 2.0 * (1.0 + FLATTENING + m - 2.0 * FLATTENING * sin2) * height / SEMI_MAJOR_AXIS
    factor = 1.0 - linear + 3.0 * height**2 / SEMI_MAJOR_AXIS**2
    assert normal_gravity(0.6, height) == pytest.approx(normal_gravity(0.6, 0.0) * factor, rel=1e-14)


@given(LATITUDES, st.floats(-500.0, 9000.0))
def test_gravity_agrees_with_the_bench_everywhere(latitude, height):
    assert normal_gravity(latitude, height) == pytest.approx(earth_truth.normal_gravity(latitude, height), abs=1e-9)
    assert EQUATOR_GRAVITY - 0.03 < normal_gravity(latitude, height) < POLE_GRAVITY + 0.002


@given(LATITUDES)
def test_earth_rotates_once_per_sidereal_day_about_the_pole(latitude):
    east, north, up = rotation_rate(latitude)
    assert east == 0.0
    assert np.hypot(north, up) == pytest.approx(2.0 * np.pi / 86164.0989, rel=1e-7)
    assert np.arctan2(up, north) == pytest.approx(latitude, abs=1e-12)
