"""Gimbal method: joint drifts give the gyro misalignment with consistent sigmas; the gain determines convergence."""

from dataclasses import replace

import numpy as np
import pytest
from gimbal_recordings import recorded, solved, unit
from scipy.stats import chi2

from calstation.errors import ConfigurationError, InputError, InsufficientDataError
from calstation.estimation.gimbal import GimbalIteration, Motion, contraction, drift_matrix, largest_gain
from calstation.estimation.gimbal.iteration import gimbal_attitude, gimbal_joints
from calstation.physics import INDEX, TableGeometry, rotation_matrix
from procedures import method
from procedures.gimbal import ESTIMATED
from tests.helpers import raises_code

PLACES = [INDEX[name] for name in ESTIMATED]


@pytest.fixture(scope="module")
def loop():
    imu = unit(11)
    iteration, block = recorded(imu, 11)
    return imu, iteration, block


@pytest.mark.long
@pytest.mark.parametrize(
    ("grade", "seeds"),
    [
        pytest.param("mems", 10, marks=pytest.mark.exhaustive),
        pytest.param("tactical", 6, marks=pytest.mark.exhaustive),
        ("nav", 6),
    ],
)
def test_errors_of_many_gimbals_agree_with_their_sigmas(grade, seeds):
    iterated, at_once = [], []
    for seed in range(seeds):
        imu = unit(50 + seed, grade)
        solution = solved(recorded(imu, seed)[1], imu, grade)
        truth = imu.parameters[PLACES]
        iterated.append((solution.posterior.mean[PLACES] - truth) / solution.posterior.sigma[PLACES])
        squares = [solution.details["least_squares"][name] for name in ESTIMATED]
        at_once.append([(s["value"] - t) / s["sigma"] for s, t in zip(squares, truth, strict=True)])
    low, high = chi2.ppf([0.0005, 0.9995], 6 * seeds) / (6 * seeds)
    assert low < np.mean(np.square(iterated)) < high
    assert low < np.mean(np.square(at_once)) < high


@pytest.mark.long
def test_return_to_zero_does_not_affect_the_previous_rotation():
    # the return by 71 arcsec occurs during a rest and must not contribute to the mean of the gyros at rest
    imu = unit(11, "nav")
    iteration, block = recorded(imu, 11)
    axes = solved(block, imu, "nav").details["axes"]
    assert [axis["turns"] for axis in axes] == [len(course.drifts) for course in iteration.courses]


def test_replayed_recording_gives_the_applied_corrections(loop):
    imu, iteration, block = loop
    solution = solved(block, imu)
    for axis, course in zip(solution.details["axes"], iteration.courses, strict=True):
        assert axis["corrections"] == [k.tolist() for k in course.corrections]
        assert axis["angles"] == pytest.approx(course.angles, abs=np.deg2rad(2.0))
    assert solution.estimated == ESTIMATED
    assert solution.messages == ()


def test_drifts_converge_as_predicted_and_agree_with_least_squares(loop):
    imu, _, block = loop
    solution = solved(block, imu)
    for axis in solution.details["axes"]:
        size = [np.linalg.norm(d) for d in axis["drifts"]]
        assert size[-1] < 0.3 * size[0]
        assert 0.15 < axis["contraction"] < 0.35
        assert axis["turns"] < 10
    for name, i in zip(ESTIMATED, PLACES, strict=True):
        at_once = solution.details["least_squares"][name]
        assert at_once["sigma"] < solution.posterior.sigma[i]
        apart = solution.posterior.mean[i] - at_once["value"]
        assert abs(apart) < 4.0 * np.hypot(solution.posterior.sigma[i], at_once["sigma"])


@pytest.mark.parametrize("angle", [10.0, 30.0, 60.0])
def test_stable_gain_range_matches_the_closed_form(angle):
    A = np.deg2rad(angle)
    for order in ("zxy", "xyz", "yzx", "zyx"):
        first, middle, last = ("xyz".index(name) for name in order)
        for axis in (first, last):
            assert largest_gain(order, axis, A) == pytest.approx(1.0 / np.tan(A / 2.0), rel=1e-6)
            best = 0.5 / np.tan(A / 2.0)
            assert contraction(order, axis, A, best) == pytest.approx(np.sin(A / 2.0), rel=1e-6)
        # the axes of the other joints approach each other as the middle joint turns
        worst = (np.sin(A) + 1.0 - np.cos(A)) / np.cos(A)
        assert largest_gain(order, middle, A) == pytest.approx(2.0 / worst, rel=1e-6)
    assert largest_gain("zxy", 2, np.pi) == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(("share", "converges"), [(0.8, True), (1.3, False)])
def test_iteration_converges_within_the_gain_range_and_diverges_beyond(share, converges):
    imu = unit(12, "tactical")
    most = largest_gain("zxy", 2, np.deg2rad(30.0))
    iteration, _ = recorded(imu, 12, gain=share * most, iterations=6, threshold_arcsec=0.0)
    sizes = [np.linalg.norm(d) for d in iteration.courses[2].drifts]
    factor = (sizes[-1] / sizes[0]) ** (1.0 / (len(sizes) - 1))
    assert factor == pytest.approx(contraction("zxy", 2, np.deg2rad(30.0), share * most), abs=0.1)
    assert (factor < 1.0) == converges


def test_unstable_gain_is_reported(loop):
    imu = unit(13, "tactical")
    _, block = recorded(imu, 13, gain=3.0, iterations=4)
    solution = solved(block, imu, "tactical", gain=3.0, iterations=4)
    unstable = [values for key, values in solution.messages if key == "gimbal_unstable"]
    assert [t["axis"] for t in unstable] == ["x"]  # the middle joint's range ends at 2.73, the others' at 3.73


def test_axes_are_calibrated_in_turn_until_the_count_or_threshold():
    iteration = GimbalIteration(1.0, 0.5, 3, 1e-4)
    command = iteration.next_turn()
    assert (command.axis, command.angle, command.home) == (0, 0.5, False)
    iteration.add_drift(0, 0.5, np.array([-2e-3, 1e-3]))
    assert iteration.correction[1:, 0] == pytest.approx([2e-3, -1e-3])
    command = iteration.next_turn()
    assert (command.angle, command.home) == (-0.5, False)  # a turn back, without a return to zero
    iteration.add_drift(0, -0.5, np.array([-5e-4, 0.0]))
    assert iteration.correction[1:, 0] == pytest.approx([1.5e-3, -1e-3])
    iteration.add_drift(0, 0.5, np.array([5e-3, 0.0]))
    command = iteration.next_turn()
    assert (command.axis, command.home) == (1, True)  # the count is reached
    iteration.at_zero()
    iteration.add_drift(1, 0.5, np.array([5e-5, -5e-5]))
    assert iteration.next_turn().axis == 2  # below the threshold
    iteration.add_drift(2, 0.5, np.array([0.0, 0.0]))
    assert iteration.next_turn() is None
    assert iteration.done


def test_one_way_rotations_return_to_zero_before_the_travel_limit():
    iteration = GimbalIteration(1.0, np.deg2rad(30.0), 5, 0.0, alternate=False)
    homes = []
    for _ in range(5):
        command = iteration.next_turn()
        homes.append(command.home)
        if command.home:
            iteration.at_zero()
        iteration.add_drift(0, command.angle, np.zeros(2))
    assert homes == [False, False, True, False, True]


@pytest.mark.parametrize("order", ["zxy", "xyz"])
def test_drift_does_not_depend_on_the_start_angles_of_a_rotation(order):
    tilt, bias, angle, seconds = np.array([2e-4, -1e-4, 3e-4]), np.array([1e-5, -2e-5, 1e-5]), -0.5, 1.0
    for axis in range(3):
        for begin in (-0.6, 0.0, 0.9):
            start = np.array([3e-3, -2e-3, 4e-3])
            start[axis] = begin
            turn = rotation_matrix(angle * (np.eye(3)[axis] + tilt) + bias * seconds)
            after = gimbal_joints(order, gimbal_attitude(order, start) @ turn)
            later = gimbal_joints(order, gimbal_attitude(order, start) @ rotation_matrix(1e-3 * bias))
            motion = Motion(0, 1, start, after, (later - start) / 1e-3, 3.0, seconds, (0, 1), np.zeros(3))
            expected = drift_matrix(order, axis, angle) @ np.delete(tilt, axis)
            assert motion.joint_drift(axis, order) == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("grade", [pytest.param("nav", marks=pytest.mark.long), "mems"])
@pytest.mark.parametrize(
    ("sequence", "turns"),
    [
        ({"iterations": 6}, 6),
        ({"iterations": 5}, 5),  # the last return starts away from zero
        ({"iterations": 5, "alternate": False}, 5),
    ],
)
def test_every_rotation_of_a_series_is_used(sequence, turns, grade):
    imu = unit(21, grade)
    settings = {"threshold_arcsec": 0.0, **sequence}
    iteration, block = recorded(imu, 21, **settings)
    solution = solved(block, imu, grade, **settings)
    assert [axis["turns"] for axis in solution.details["axes"]] == [turns] * 3
    for axis, course in zip(solution.details["axes"], iteration.courses, strict=True):
        assert axis["corrections"] == [k.tolist() for k in course.corrections]
    error = (solution.posterior.mean - imu.parameters)[PLACES] / solution.posterior.sigma[PLACES]
    assert np.abs(error).max() < 4.0


def test_replay_with_another_gain_is_refused():
    imu = unit(22)
    imu.parameters[PLACES] = 2e-3
    _, block = recorded(imu, 22, iterations=4, threshold_arcsec=0.0)
    with raises_code(InputError, "recording.gimbal_disagrees"):
        solved(block, imu, gain=1.0, iterations=4, threshold_arcsec=0.0)


def test_rotation_without_rests_is_reported_as_missing():
    imu = unit(23)
    _, block = recorded(imu, 23, iterations=3, threshold_arcsec=0.0, alternate=False, angle_deg=25.0)
    cut = np.flatnonzero(np.diff(block.step) == 1)[1] + 1  # the second turn begins
    spoilt = block.valid.copy()
    spoilt[cut - 10 : cut + 10] = False
    with raises_code(InputError, "recording.joint_turn_lost"):
        solved(altered(block, valid=spoilt), imu, iterations=3, threshold_arcsec=0.0, alternate=False, angle_deg=25.0)


def test_joint_angles_and_attitudes_convert_in_both_directions():
    joints = np.array([0.3, -0.4, 0.7])
    for order in ("xyz", "zxy", "yzx", "zyx", "xzy", "yxz"):
        assert gimbal_joints(order, gimbal_attitude(order, joints)) == pytest.approx(joints)
    assert drift_matrix("zxy", 2, 1e-3) == pytest.approx(1e-3 * np.eye(2), abs=1e-6)


def altered(block, **columns):
    return replace(block, **columns)


def test_unusable_recordings_are_refused_with_their_fault(loop):
    imu, _, block = loop
    joints = block.joints
    with raises_code(InputError, "recording.no_joint_angles"):
        solved(altered(block, joints=np.empty((len(block), 0))), imu)
    stuck = joints.copy()
    stuck[:, 1] = 0.0
    with raises_code(InputError, "recording.frozen_joint") as caught:
        solved(altered(block, joints=stuck), imu)
    assert caught.value.values == {"channel": "joint_y"}
    with raises_code(InputError, "recording.joint_axes_swapped"):
        solved(altered(block, joints=joints[:, [1, 0, 2]]), imu)
    with raises_code(InputError, "recording.joint_unit"):
        solved(altered(block, joints=0.5 * joints), imu)
    with raises_code(InputError, "recording.joint_sign"):
        solved(altered(block, joints=-joints), imu)
    frozen = block.counts.copy()
    frozen[3000:6000, 2] = frozen[3000, 2]
    with raises_code(InputError, "recording.frozen") as caught:
        solved(altered(block, counts=frozen), imu)
    assert caught.value.values["channel"] == "gyro_z"
    with raises_code(InsufficientDataError, "recording.no_joint_turn"):
        solved(block.part(0, 900), imu)


def test_uncorrected_rates_are_refused():
    imu = unit(14)
    _, block = recorded(imu, 14, corrected=False, iterations=5)
    with raises_code(InputError, "recording.rates_not_corrected"):
        solved(block, imu, iterations=5)


def test_polled_joint_angles_are_sufficient(loop):
    imu, _, block = loop
    polled = block.joints.copy()
    polled[np.arange(len(polled)) % 5 > 0] = np.nan
    solution = solved(altered(block, joints=polled), imu)
    error = (solution.posterior.mean - imu.parameters)[PLACES] / solution.posterior.sigma[PLACES]
    assert np.abs(error).max() < 4.0


def test_rate_table_is_refused_as_a_gimbal():
    chosen = method("gimbal")
    with raises_code(ConfigurationError, "plan.needs_gimbal"):
        list(chosen.plan(TableGeometry(), chosen.schedule()))
    with pytest.raises(ValueError, match="must name x, y and z once each"):
        chosen.schedule(order="zzy")
