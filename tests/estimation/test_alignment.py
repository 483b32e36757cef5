"""The start attitude of a stage: prior sigmas, levelling and gyrocompassing at rest."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calstation.estimation.common import (
    FREE_AZIMUTH_SIGMA,
    ImuModel,
    Posterior,
    Site,
    SolveContext,
    StageData,
    Start,
    TableModel,
    start_tests,
    starts,
)
from calstation.estimation.common.alignment import FREE_TILT_SIGMA, gyrocompass
from calstation.physics import (
    COUNT,
    RATE,
    TableGeometry,
    axis_rotation,
    group_indices,
    rotation_matrix,
    rotation_rate,
    rotation_vector,
)

LATITUDE = np.deg2rad(40.0)
CONTEXT = SolveContext(
    Site(LATITUDE, 0.0, 0.0, azimuth=0.8),
    ImuModel("S", 100.0, "rate", 1e-12, 1e-12, 1e-9, 1e-9),
    TableModel(),
)
BIAS_SIGMA = 1e-6


def posterior(bias=0.0, bias_sigma=BIAS_SIGMA):
    mean, sigma = np.zeros(COUNT), np.full(COUNT, 1e-6)
    mean[group_indices("gyro_bias")] = bias
    sigma[group_indices("gyro_bias")] = bias_sigma
    return Posterior(mean, np.diag(sigma**2))


def at_rest(attitude, count=1000, angles=(np.nan, np.nan), segments=None, bias=0.0):
    """Return the data of a body at rest in `attitude` on the rotating earth."""
    ones = np.ones((count, 1))
    return StageData(
        dt=0.01,
        seq=np.arange(count),
        time=(np.arange(count) + 1) * 0.01,
        gyro=ones * (attitude.T @ rotation_rate(LATITUDE) + bias),
        accel=ones * (attitude.T @ [0.0, 0.0, 9.8]),
        angles=ones * np.array(angles),
        step=np.zeros(count, dtype=np.int64),
        segments=segments or ((0, count),),
        gaps=0,
    )


def without_azimuth():
    return replace(CONTEXT, site=replace(CONTEXT.site, azimuth=None))


ANGLES = (0.4, -1.3)
NOMINAL = TableGeometry().body_to_level(*ANGLES, 0.8)
TURNED = rotation_matrix(np.array([0.01, -0.015, 0.02])) @ NOMINAL


def test_prior_attitude_comes_from_encoders_and_azimuth_with_the_tables_sigmas():
    (start,) = starts(at_rest(TURNED, angles=ANGLES), CONTEXT, posterior())
    assert start.prior == pytest.approx(NOMINAL, abs=1e-12)
    mount, tilt, encoder, azimuth = np.deg2rad([1.0, 0.2, 0.05, 0.5])
    level = np.sqrt(mount**2 + tilt**2 + encoder**2)
    heading = np.sqrt(azimuth**2 + mount**2 + encoder**2)
    assert start.prior_sigma == pytest.approx([level, level, heading])
    assert start.azimuth_sigma is None
    assert (start.begin, start.end) == (0, 1000)


def test_linearisation_point_is_levelled_and_keeps_the_prior_heading():
    (start,) = starts(at_rest(TURNED, angles=ANGLES), CONTEXT, posterior())
    up_b = TURNED.T @ [0.0, 0.0, 1.0]
    assert start.attitude @ up_b == pytest.approx([0.0, 0.0, 1.0], abs=1e-9)
    assert abs(rotation_vector(start.attitude @ start.prior.T)[2]) < 1e-4


def test_unknown_azimuth_is_gyrocompassed_with_a_free_prior():
    (start,) = starts(at_rest(TURNED, angles=ANGLES), without_azimuth(), posterior())
    assert rotation_vector(start.attitude @ TURNED.T) == pytest.approx(np.zeros(3), abs=0.02)
    assert start.attitude @ (TURNED.T @ [0.0, 0.0, 1.0]) == pytest.approx([0.0, 0.0, 1.0], abs=1e-9)
    assert start.prior_sigma[2] == FREE_AZIMUTH_SIGMA
    assert start.azimuth_sigma == pytest.approx(BIAS_SIGMA / (RATE * np.cos(LATITUDE)))


VECTORS = st.tuples(*[st.floats(-3.0, 3.0)] * 3).map(np.array)


@given(VECTORS)
def test_attitude_without_encoders_is_found_from_gravity_and_earth_rate(vector):
    attitude = rotation_matrix(vector)
    (start,) = starts(at_rest(attitude, count=200), CONTEXT, posterior())
    assert rotation_vector(start.attitude @ attitude.T) == pytest.approx(np.zeros(3), abs=1e-6)
    assert start.prior_sigma.tolist() == [FREE_TILT_SIGMA, FREE_TILT_SIGMA, FREE_AZIMUTH_SIGMA]
    assert start.azimuth_sigma == pytest.approx(BIAS_SIGMA / (RATE * np.cos(LATITUDE)))


def test_known_gyro_bias_is_removed_before_gyrocompassing():
    attitude = axis_rotation((0.0, 0.0, 1.0), 1.0)
    bias = np.array([3e-5, -2e-5, 1e-5])
    (start,) = starts(at_rest(attitude, bias=bias), without_azimuth(), posterior(bias))
    assert rotation_vector(start.attitude @ attitude.T) == pytest.approx(np.zeros(3), abs=1e-6)


def test_east_gyro_bias_rotates_the_heading_by_its_ratio_to_earth_rate():
    attitude = np.eye(3)
    level_rate, up = rotation_rate(LATITUDE), np.array([0.0, 0.0, 9.8])
    north = RATE * np.cos(LATITUDE)
    result, sigma = gyrocompass(level_rate + np.array([1e-6, 0.0, 0.0]), up, LATITUDE, posterior())
    assert rotation_vector(result @ attitude.T)[2] == pytest.approx(1e-6 / north, rel=1e-3)
    assert sigma == pytest.approx(1e-6 / north)


def test_heading_is_ambiguous_at_the_pole():
    _, sigma = gyrocompass(np.array([0.0, 0.0, RATE]), np.array([0.0, 0.0, 9.8]), np.pi / 2, posterior())
    assert sigma > 1e3


def test_every_long_segment_is_aligned_one_sample_from_each_gap():
    data = at_rest(TURNED, angles=ANGLES, segments=((0, 400), (400, 420), (420, 1000)))
    result = starts(data, CONTEXT, posterior())
    assert [(s.begin, s.end) for s in result] == [(0, 399), (421, 1000)]


def test_segments_without_rest_are_not_aligned():
    data = at_rest(TURNED, angles=ANGLES)
    spinning = replace(data, gyro=data.gyro + 0.3)
    assert starts(spinning, CONTEXT, posterior()) == []


@pytest.mark.parametrize(
    ("turn", "cause", "values"),
    [
        ((0.0, 0.0, -np.deg2rad(45.0)), "heading_unlike", {"measured": 0.8 + np.deg2rad(45.0), "expected": 0.8}),
        ((np.deg2rad(6.0), 0.0, 0.01), "mount_unlike", {"measured": np.deg2rad(6.0)}),
    ],
)
def test_start_attitude_that_contradicts_its_prior_fails_with_the_measured_angle(turn, cause, values):
    """A rotation of the unit by −45° about the vertical is a heading 45° farther clockwise."""
    prior, sigma = TableGeometry().body_to_level(0.1, 0.2, 0.8), np.deg2rad([1.0, 1.0, 1.2])
    start = Start(0, 100, prior, sigma, prior, None)
    attitude = rotation_matrix(np.array(turn)) @ prior
    (test,) = start_tests([start], [attitude], CONTEXT.site)
    assert test.value > test.limit == 5.0
    assert test.diagnosis.cause == cause
    assert {name: test.diagnosis.values[name] for name in values} == pytest.approx(
        {name: np.rad2deg(angle) for name, angle in values.items()}
    )
    (within,) = start_tests([start], [rotation_matrix(np.deg2rad([2.0, 1.0, 4.0])) @ prior], CONTEXT.site)
    assert within.value == pytest.approx(4.0 / 1.2, rel=0.1)
    assert within.value < within.limit


def test_heading_matches_the_direction_of_the_site_azimuth():
    """The solved attitude of a table whose heading is 0.3 rad larger names this heading."""
    prior, moved = (TableGeometry().body_to_level(0.1, 0.2, azimuth) for azimuth in (0.8, 1.1))
    start = Start(0, 100, prior, np.full(3, 0.01), prior, None)
    (test,) = start_tests([start], [moved], CONTEXT.site)
    assert test.diagnosis.values["measured"] == pytest.approx(np.rad2deg(1.1))
