"""Joint trajectories: endpoints, limits, continuity and settling of the closed form."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calstation.bench.truth import EncoderTruth, TableDrive
from calstation.bench.truth.kinematics import DRIVE_FREQUENCY, SETTLED_AMPLITUDE, JointProfile

RATE, ACCELERATION = np.deg2rad(20.0), np.deg2rad(50.0)


def test_trapezoidal_profile_reaches_its_target_in_the_textbook_time():
    profile = JointProfile.rest(0.3).move(2.0, 0.3 + np.pi, RATE, ACCELERATION)
    assert profile.target == 0.3 + np.pi
    assert profile.end == pytest.approx(2.0 + np.pi / RATE + RATE / ACCELERATION, abs=1e-12)
    states = profile.states(np.array([0.0, 1.9, profile.rest_time, profile.rest_time + 100.0]))
    assert states[:2, 0] == pytest.approx(0.3, abs=0.0)
    assert states[2:, 0] == pytest.approx(0.3 + np.pi, abs=0.0)
    assert np.all(states[:, 1:] == 0.0)


def test_short_move_has_a_triangular_profile_below_the_maximum_rate():
    profile = JointProfile.rest(0.0).move(0.0, -0.01, RATE, ACCELERATION)
    assert profile.end == pytest.approx(2.0 * np.sqrt(0.01 / ACCELERATION), rel=1e-12)
    rates = profile.states(np.linspace(0.0, profile.end, 500))[:, 1]
    assert np.max(np.abs(rates)) < RATE


@given(target=st.floats(-15.0, 15.0), rate=st.floats(0.01, 3.0), acceleration=st.floats(0.05, 5.0))
def test_rate_and_acceleration_are_the_derivatives_of_the_angle(target, rate, acceleration):
    profile = JointProfile.rest(0.0).move(0.5, target, rate, acceleration)
    times = np.linspace(0.5, min(profile.settling_time(1e-9), 6.0), 200) + 1e-3
    step = 1e-5
    near = np.array([profile.states(times + k * step) for k in (-1, 0, 1)])
    # The second derivative of the angle is continuous, and the third is at most a·ω.
    bound = 4.0 * acceleration * DRIVE_FREQUENCY
    assert near[1, :, 1] == pytest.approx((near[2, :, 0] - near[0, :, 0]) / (2 * step), abs=bound * step**2 + 1e-9)
    assert near[1, :, 2] == pytest.approx((near[2, :, 1] - near[0, :, 1]) / (2 * step), abs=bound * step + 1e-8)


def test_joint_oscillates_after_a_move_and_then_settles():
    profile = JointProfile.rest(0.0).move(0.0, 1.0, RATE, ACCELERATION)
    ringing = profile.states(np.linspace(profile.end, profile.end + 0.2, 200))[:, 0] - 1.0
    assert ringing.max() > 1e-5
    assert ringing.min() < -1e-5
    settled = profile.settling_time(SETTLED_AMPLITUDE)
    assert profile.end < settled < profile.end + 1.0
    assert np.max(np.abs(profile.states(np.linspace(settled, settled + 1.0, 500))[:, 0] - 1.0)) <= SETTLED_AMPLITUDE


def test_a_stop_is_continuous_and_decelerates_as_commanded():
    moving = JointProfile.rest(0.0).move(0.0, 10.0, 1.0, 0.5)
    stopped = moving.stop(4.0, 0.25)
    assert stopped.end == pytest.approx(4.0 + 1.0 / 0.25)
    assert stopped.target == pytest.approx(moving.command(4.0)[0] + 0.5 / 0.25)
    assert stopped.states(np.array([4.0])) == pytest.approx(moving.states(np.array([4.0])), abs=1e-12)
    assert stopped.states(np.array([3.99])) == pytest.approx(moving.states(np.array([3.99])), abs=1e-12)


def test_moving_joint_rejects_a_second_move():
    moving = JointProfile.rest(0.0).move(0.0, 1.0, RATE, ACCELERATION)
    with pytest.raises(ValueError, match="moving"):
        moving.move(1.0, 0.0, RATE, ACCELERATION)


def test_joints_start_together_and_follow_their_own_profiles():
    drive = TableDrive(EncoderTruth())
    drive.move(1.0, (0.5, -2.0), (0.1, 0.4), (1.0, 0.8))
    assert drive.profiles[0].end == pytest.approx(1.0 + 0.5 / 0.1 + 0.1)
    assert drive.profiles[1].end == pytest.approx(1.0 + 2.0 / 0.4 + 0.5)
    assert drive.end == max(profile.end for profile in drive.profiles)


def test_encoder_repeatability_error_is_redrawn_at_every_stop():
    sigma, periodic, white = 1e-3, 1e-4, 1e-6
    drive = TableDrive(EncoderTruth(sigma, periodic, (0.0, 0.0), white), seed=5)
    errors, time = [], 0.0
    for target in np.arange(1, 401) * 2.0 * np.pi:
        drive.move(time, (target, -target), (50.0, 50.0), (500.0, 500.0))
        time = drive.settled
        reading = drive.readings(np.array([time, time + 1.0]))
        assert reading[0] == pytest.approx(reading[1], abs=10 * white + 2 * SETTLED_AMPLITUDE)
        errors.append(reading[1] - drive.states(time)[:, 0])
    scatter = np.std(errors, axis=0) / sigma
    assert scatter == pytest.approx(1.0, abs=4.0 / np.sqrt(2 * 400))
    assert np.corrcoef(np.array(errors)[:-1, 0], np.array(errors)[1:, 0])[0, 1] == pytest.approx(0.0, abs=0.2)


def test_periodic_encoder_error_has_the_configured_amplitude():
    drive = TableDrive(EncoderTruth(0.0, 1e-3, (0.7, 0.0), 0.0))
    drive.move(0.0, (2.0 * np.pi, 0.0), (0.5, 0.5), (1.0, 1.0))
    times = np.linspace(0.0, drive.settled, 50)
    errors = drive.readings(times)[:, 0] - [drive.states(t)[0, 0] for t in times]
    angles = np.array([drive.states(t)[0, 0] for t in times])
    assert errors == pytest.approx(1e-3 * np.sin(angles + 0.7), abs=1e-12)
