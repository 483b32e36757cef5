"""One pass of the 39-state filter: Kalman algebra, noise, innovations at the truth, gaps."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm
from simulated_stages import block_of, errors_in_sigma, solved

from calstation.estimation.common.alignment import starts
from calstation.estimation.common.context import Belief
from calstation.estimation.common.least_squares import nis_consistency
from calstation.estimation.common.stage import stage_data
from calstation.estimation.navigation import filter as navigation
from calstation.estimation.navigation.filter import NavigationFilter
from calstation.physics.parameters import COUNT, PARAMETERS
from calstation.physics.rotation import skew


@pytest.fixture(scope="module")
def data(nav_stage):
    """The stage's samples as arrays."""
    return stage_data([nav_stage.block], nav_stage.context.imu)


def begun(stage, data, prior=None):
    """A filter at the start of the stage, closed loop."""
    prior = prior or stage.prior
    run = NavigationFilter(stage.context, prior, prior.mean)
    (start,) = starts(data, stage.context, prior)
    run.begin(data, start, start.attitude)
    return run, start


def test_group_of_one_equals_textbook_predict_and_update(nav_stage, data):
    run, start = begun(nav_stage, data)
    stride = run.stride
    for k in range(start.begin, start.begin + 60 * stride, stride):
        run.observe(data, k, 1)
    before = run.kf.P.copy()
    run.observe(data, start.begin + 60 * stride, 1)
    F, Q, H, R = run.kf.F, run.kf.Q, run.kf.H, run.kf.R
    assert not run.kf.M.any()
    predicted = F @ before @ F.T + Q
    S = H @ predicted @ H.T + R
    K = predicted @ H.T @ np.linalg.inv(S)
    left = np.eye(39) - K @ H
    expected = left @ predicted @ left.T + K @ R @ K.T
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert np.abs((run.kf.P - expected) / scale).max() < 1e-6
    assert run.history.nis[-1] == pytest.approx(run.kf.y @ np.linalg.solve(S, run.kf.y))


@pytest.mark.parametrize("together", [0.4, 1.1])
def test_grouped_observations_equal_single_ones(nav_stage, data, monkeypatch, together):
    (start,) = starts(data, nav_stage.context, nav_stage.prior)
    noisy = replace(nav_stage.context.imu, gyro_arw=1e-4, accel_vrw=1e-3)
    runs = []
    for seconds in (0.1, together):
        monkeypatch.setattr(navigation, "GROUP_TIME", seconds)
        run = NavigationFilter(replace(nav_stage.context, imu=noisy), nav_stage.prior, nav_stage.truth.parameters)
        run.run(data, start, start.attitude, smooth=True)
        runs.append(run)
    single, group = runs
    assert (single.group_size, group.group_size) == (1, round(together / 0.1))
    sigma = single.belief.sigma
    assert np.abs((single.belief.mean - group.belief.mean) / sigma).max() < 1e-5
    assert group.belief.sigma == pytest.approx(sigma, rel=1e-6)
    assert group.history.innovation == pytest.approx(single.history.innovation, abs=1e-5)
    assert np.array_equal(group.history.index, single.history.index)


def test_the_covariance_stays_symmetric_and_positive(nav_stage, data):
    run, start = begun(nav_stage, data)
    samples = run.group_size * run.stride
    for k in range(start.begin, len(data) - samples, samples):
        run.observe(data, k, run.group_size)
    P = run.kf.P
    scale = np.sqrt(np.diag(P))
    correlation = P / np.outer(scale, scale)
    assert np.abs(correlation - correlation.T).max() < 1e-9
    assert np.linalg.eigvalsh(0.5 * (correlation + correlation.T)).min() > -1e-9


def test_process_noise_is_van_loans_for_a_resting_body(nav_stage, data):
    run, start = begun(nav_stage, data)
    run.observe(data, start.begin, 1)
    T, noise = run.stride * run.dt, run.noise
    F = np.zeros((9, 9))
    F[3:6, 0:3] = -skew(run.work.force)
    F[6:9, 3:6] = np.eye(3)
    G = np.diag([noise.rate] * 3 + [noise.force] * 3 + [0.0] * 3)
    # C. F. van Loan, Computing integrals involving the matrix exponential, IEEE TAC 23(3), 1978
    block = expm(np.block([[-F, G], [np.zeros((9, 9)), F.T]]) * T)
    exact = block[9:, 9:].T @ block[:9, 9:]
    scale = np.sqrt(np.outer(np.diag(exact), np.diag(exact)))
    # φ and δv, on which observations depend; what reaches δp from the rates is of higher order
    assert np.abs((run.kf.Q[:9, :9] - exact) / scale)[:6, :6].max() < 1e-6
    assert np.diag(run.kf.Q)[:9] == pytest.approx(np.diag(exact), rel=0.02)


def test_bias_drifts_about_a_constant_that_stays_known(nav_stage, data):
    imu = replace(nav_stage.context.imu, gyro_bias_instability=1e-7, accel_bias_instability=1e-4)
    run = NavigationFilter(replace(nav_stage.context, imu=imu), nav_stage.prior, nav_stage.prior.mean)
    assert np.diag(run.kf.P)[39:] == pytest.approx(run.noise.bias_drift**2)
    (start,) = starts(data, nav_stage.context, nav_stage.prior)
    run.begin(data, start, start.attitude)
    run.observe(data, start.begin, run.group_size)
    assert not np.diag(run.kf.Q)[9:39].any()
    # stationary: decayed and driven variances add to the same again
    decayed = np.diag(run.kf.F)[39:] ** 2 * run.noise.bias_drift**2
    assert decayed + np.diag(run.kf.Q)[39:] == pytest.approx(run.noise.bias_drift**2)


def test_innovations_at_the_truth_agree_with_their_sigmas(nav_stage, data):
    known = Belief(nav_stage.truth.parameters, np.diag((1e-3 * nav_stage.prior.sigma) ** 2))
    run = NavigationFilter(nav_stage.context, known, known.mean)
    (start,) = starts(data, nav_stage.context, known)
    run.run(data, start, start.attitude, smooth=False)
    nis = run.history.nis
    consistency = nis_consistency(sum(nis), len(nis), 3)
    assert consistency.passed
    assert not consistency.warning


def test_innovations_reveal_a_wrong_velocity_noise(nav_stage, data):
    known = Belief(nav_stage.truth.parameters, np.diag((1e-3 * nav_stage.prior.sigma) ** 2))
    table = replace(nav_stage.context.table, velocity_sigma=0.7e-3)
    run = NavigationFilter(replace(nav_stage.context, table=table), known, known.mean)
    (start,) = starts(data, nav_stage.context, known)
    run.run(data, start, start.attitude, smooth=False)
    assert not nis_consistency(sum(run.history.nis), len(run.history.nis), 3).passed


def test_attitude_error_of_a_pass_agrees_with_its_sigma(nav_stage, data):
    known = Belief(nav_stage.truth.parameters, np.diag((1e-3 * nav_stage.prior.sigma) ** 2))
    run = NavigationFilter(nav_stage.context, known, known.mean)
    (start,) = starts(data, nav_stage.context, known)
    run.run(data, start, start.attitude, smooth=False)
    # the plan ends at rest: up as the unit feels it is up as the filter says
    up_b = data.accel[-200:].mean(axis=0) - known.mean[[p.group == "accel_bias" for p in PARAMETERS]]
    tilt = np.cross(run.attitude @ up_b / np.linalg.norm(up_b), [0.0, 0.0, 1.0])
    # scale and misalignment of the uncompensated force add up to 1e-3
    assert np.linalg.norm(tilt) < 2e-3
    assert run.kf.P[0, 0] ** 0.5 < 1e-4


def test_navigation_restarts_after_a_gap_and_parameters_continue(nav_stage):
    keep = np.ones(len(nav_stage.block), dtype=bool)
    turning = np.flatnonzero(nav_stage.block.step == 9)
    keep[turning[100] : turning[100] + 400] = False
    whole = solved(nav_stage.truth, nav_stage.prior, [nav_stage.block])
    broken = solved(nav_stage.truth, nav_stage.prior, [block_of(nav_stage.samples, keep)])
    assert (whole.gaps, broken.gaps) == (0, 1)
    assert (whole.details["segments"], broken.details["segments"]) == (1, 2)
    assert np.abs(errors_in_sigma(broken.belief, nav_stage.truth)).max() < 4.0
    assert broken.consistency.passed
    # one turn less leaves a little less known, and of nothing more
    ratio = broken.belief.sigma / whole.belief.sigma
    assert ratio.min() > 0.99
    assert ratio.max() < 2.5
    assert len(ratio) == COUNT
