"""Passes of the 39-state filter: Kalman equations, closed loop and reference, noise, innovations at the truth, gaps."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from scipy.linalg import expm
from simulated_stages import block_of, errors_in_sigma, solved

from calstation.estimation.common import (
    ImuModel,
    PlannedSamples,
    Posterior,
    Site,
    SolveContext,
    TableModel,
    nis_consistency,
    stage_data,
    starts,
)
from calstation.estimation.navigation import ClosedLoopFilter, ReferencePass, navigation_pass
from calstation.estimation.navigation.group_update import State, predict, update
from calstation.estimation.navigation.velocity_group import Reference
from calstation.physics import COUNT, PARAMETERS, Dwell, Move, interval_work, propagate, skew


@pytest.fixture(scope="module")
def data(nav_stage):
    """The samples of the stage as arrays."""
    return stage_data([nav_stage.block], nav_stage.context.imu)


def begun(stage, data, kind=ClosedLoopFilter):
    """Return a pass at the start of the stage."""
    run = kind(stage.context, stage.prior, stage.prior.mean)
    (start,) = starts(data, stage.context, stage.prior)
    run.begin(data, start, start.attitude)
    return run, start


@pytest.mark.parametrize("count", [1, 5])
@pytest.mark.parametrize("drift", [0.0, 1.0], ids=["39 states", "with bias drift"])
def test_compiled_prediction_and_update_agree_with_filterpy(nav_stage, data, count, drift):
    noise = {"gyro_bias_instability": 1e-7 * drift, "accel_bias_instability": 1e-4 * drift}
    imu = replace(nav_stage.context.imu, **noise)
    context, prior = replace(nav_stage.context, imu=imu), nav_stage.prior
    (start,) = starts(data, context, prior)
    run = ReferencePass(context, prior, prior.mean)
    run.begin(data, start, start.attitude)
    done = start.begin + 20 * 5 * run.stride
    run.observe(data, start.begin, 5, groups=20)
    size = len(run.state.x)
    kf = KalmanFilter(dim_x=size, dim_z=3 * count)
    kf.x, kf.P = run.state.x.copy(), run.state.P.copy()
    run.observe(data, done, count)
    group, last = run.group, run.last_updates
    kf.F, kf.Q, kf.M = group.transition, group.noise, group.M
    assert group.M.any()
    kf.predict()
    kf.x[:9] += group.shift
    kf.update_correlated(group.z, group.R, group.H)
    scale = np.sqrt(np.diag(kf.P))
    assert np.abs((run.state.P - kf.P) / np.outer(scale, scale)).max() < 1e-6
    assert np.abs((run.state.x - kf.x) / scale).max() < 1e-6
    assert last.root[0] @ last.root[0].T == pytest.approx(kf.S, rel=1e-9)
    assert run.history.nis[-count:].sum() == pytest.approx(kf.y @ np.linalg.solve(kf.S, kf.y))
    K = np.linalg.solve(last.root[0].T, last.gain[0]).T
    assert np.abs((K - kf.K) / scale[:, None]).max() < 1e-6 * np.abs(kf.K / scale[:, None]).max()
    # Joseph's form, with correlated noise, agrees
    left = np.eye(size) - kf.K @ group.H
    shared = left @ group.M @ kf.K.T
    joseph = left @ kf.P_prior @ left.T + kf.K @ group.R @ kf.K.T - shared - shared.T
    assert np.abs((run.state.P - joseph) / np.outer(scale, scale)).max() < 1e-6


@pytest.mark.long
@pytest.mark.parametrize("drift", [0.0, 1.0], ids=["39 states", "with bias drift"])
def test_closed_loop_agrees_with_a_compiled_pass_along_its_trajectory_over_a_whole_stage(
    nav_stage, data, monkeypatch, drift
):
    noise = {"gyro_bias_instability": 1e-7 * drift, "accel_bias_instability": 1e-4 * drift}
    context = replace(nav_stage.context, imu=replace(nav_stage.context.imu, **noise))
    known = Posterior(nav_stage.truth.parameters, np.diag((1e-2 * nav_stage.prior.sigma) ** 2))
    (start,) = starts(data, context, known)
    closed = ClosedLoopFilter(context, known, known.mean)
    steps = closed.steps(data, start, start.attitude, batch=1)
    states = [[x.copy() for x in closed.work[1:3]] for _ in steps]
    # attitude and velocity at every observation, before the feedback that follows it
    trajectory, work, edges = [states[0]], interval_work(), [start.begin, *closed.history.index]
    for k, (first, last) in enumerate(pairwise(edges)):
        if k % closed.group_size == 0:
            work.attitude[:], work.velocity[:] = states[k // closed.group_size]
        propagate(
            closed.constants, closed.earth, closed.gravity, data.dt, closed._motion(data), first, last, work, False
        )
        trajectory.append([work.attitude.copy(), work.velocity.copy()])
    reference = Reference(*(np.array(x) for x in zip(*trajectory, strict=True)))
    np.testing.assert_array_equal(reference.attitude[1:], closed.history.attitude)
    monkeypatch.setattr(navigation_pass, "smoothed_reference", lambda *arguments: reference)
    along = ReferencePass(context, known, known.mean)
    list(along.steps(data, start, start.attitude))
    assert len(closed.state.x) == len(along.state.x) == (45 if drift else 39)
    assert along.posterior.sigma == pytest.approx(closed.posterior.sigma, rel=2e-4)
    # the feedback is not linear: differences of second order in its corrections remain
    assert np.abs((along.posterior.mean - closed.posterior.mean) / closed.posterior.sigma).max() < 1e-1
    assert along.history.innovation == pytest.approx(closed.history.innovation, abs=0.05)


@pytest.mark.parametrize("drift", [0.0, 1.0], ids=["39 states", "with bias drift"])
def test_filterpy_agrees_with_the_compiled_algebra_over_a_whole_stage(nav_stage, data, drift):
    noise = {"gyro_bias_instability": 1e-7 * drift, "accel_bias_instability": 1e-4 * drift}
    context = replace(nav_stage.context, imu=replace(nav_stage.context.imu, **noise))
    run = ClosedLoopFilter(context, nav_stage.prior, nav_stage.prior.mean)
    (start,) = starts(data, context, nav_stage.prior)
    steps = run.steps(data, start, start.attitude, batch=1)
    next(steps)
    state, innovations = State(run.state.x.copy(), run.state.P.copy()), []
    for _ in steps:
        rows, size = run.group.H.shape
        innovations.append(np.empty(rows))
        predict(run.group, state, np.empty((9, size)))
        update(run.group, state, np.empty((rows, rows)), np.empty((rows, size)), innovations[-1])
        state.x[:6] = run.state.x[:6]  # the same feedback
    scale = np.sqrt(np.diag(state.P))
    assert np.abs((run.state.P - state.P) / np.outer(scale, scale)).max() < 1e-8
    assert np.abs((run.state.x - state.x) / scale).max() < 1e-6
    assert np.concatenate(innovations) == pytest.approx(run.history.innovation.ravel(), abs=1e-7)


@pytest.mark.parametrize("kind", [ClosedLoopFilter, ReferencePass])
def test_groups_processed_together_equal_groups_one_by_one(nav_stage, data, kind):
    runs = []
    for together in (1, 30):
        run, start = begun(nav_stage, data, kind)
        for k in range(0, 30, together):
            run.observe(data, start.begin + k * run.group_size * run.stride, run.group_size, groups=together)
        runs.append(run)
    one, all_ = runs
    assert np.array_equal(one.state.P, all_.state.P)
    assert np.array_equal(one.posterior.mean, all_.posterior.mean)
    assert np.array_equal(one.history.innovation, all_.history.innovation)


@pytest.mark.parametrize("together", [0.4, 1.1])
def test_grouped_observations_equal_single_observations(nav_stage, data, monkeypatch, together):
    (start,) = starts(data, nav_stage.context, nav_stage.prior)
    noisy = replace(nav_stage.context.imu, gyro_arw=1e-4, accel_vrw=1e-3)
    runs = []
    for seconds in (0.1, together):
        monkeypatch.setattr(navigation_pass, "GROUP_TIME", seconds)
        run = ReferencePass(replace(nav_stage.context, imu=noisy), nav_stage.prior, nav_stage.truth.parameters)
        list(run.steps(data, start, start.attitude))
        runs.append(run)
    single, group = runs
    assert (single.group_size, group.group_size) == (1, round(together / 0.1))
    sigma = single.posterior.sigma
    assert np.abs((single.posterior.mean - group.posterior.mean) / sigma).max() < 1e-5
    assert group.posterior.sigma == pytest.approx(sigma, rel=1e-6)
    assert group.history.innovation == pytest.approx(single.history.innovation, abs=1e-5)
    assert np.array_equal(group.history.index, single.history.index)


@pytest.mark.long
def test_covariance_in_closed_loop_stays_symmetric_and_positive_definite_for_an_hour(nav_stage):
    context = replace(nav_stage.context, imu=replace(nav_stage.context.imu, sample_rate=20.0))
    prior = Posterior(np.zeros(COUNT), np.diag([p.prior_sigma**2 for p in PARAMETERS]))
    samples, blocks, joints = PlannedSamples(context, prior.mean, np.full(3, 0.005)), [], np.zeros(2)
    while sum(map(len, blocks)) < 3600 * 20:
        joints[samples.step % 2] += 0.5 * np.pi
        blocks += samples.run(Dwell(10.0), 10.0, "excitation")
        blocks += samples.run(Move(*joints, 0.4, 0.4), 6.0, "excitation")
    hour = stage_data(blocks, context.imu)
    (start,) = starts(hour, context, prior)
    run, groups = ClosedLoopFilter(context, prior, prior.mean), 0
    for groups, _ in enumerate(run.steps(hour, start, start.attitude, batch=1)):
        P = run.state.P
        assert np.array_equal(P, P.T)
        if groups % 20 == 0:
            scale = np.sqrt(np.diag(P))
            assert np.linalg.eigvalsh(P / np.outer(scale, scale))[0] > 1e-10
    assert groups > 7000


def test_process_noise_at_rest_agrees_with_van_loan(nav_stage, data):
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
    assert np.abs((run.group.noise[:9, :9] - exact) / scale).max() < 1e-6


def test_noise_of_grouped_observations_agrees_with_its_propagation():
    # gyro noise so large that the lever arm's share of it exceeds the noise of the velocity
    imu = ImuModel("", 100.0, "increment", 1e-9, 1e-9, 2e-3, 1e-3)
    context = SolveContext(Site(0.6, 1.9, 0.0, azimuth=0.0), imu, TableModel(velocity_sigma=1e-4))
    prior = Posterior(np.zeros(COUNT), np.diag([p.prior_sigma**2 for p in PARAMETERS]))
    rest = stage_data(list(PlannedSamples(context, prior.mean, np.zeros(3)).run(Dwell(20.0), 20.0, "excitation")), imu)
    point = prior.mean.copy()
    point[27:30] = [0.1, -0.15, 0.2]
    run = ReferencePass(context, prior, point)
    (start,) = starts(rest, context, prior)
    run.begin(rest, start, start.attitude)
    run.observe(rest, start.begin, 5, groups=4)
    group, T, n = run.group, run.stride * run.dt, 5
    # errors of φ, δv and the displacement since the last observation, driven interval by interval
    arm, F = run.work.attitude @ point[27:30], np.zeros((9, 9))
    F[3:6, 0:3], F[6:9, 3:6] = -skew(run.work.force), np.eye(3)
    G = np.diag([run.noise.rate] * 3 + [run.noise.force] * 3 + [0.0] * 3)
    block = expm(np.block([[-F, G], [np.zeros((9, 9)), F.T]]) * T)
    Phi, Q = block[9:, 9:].T, block[9:, 9:].T @ block[:9, 9:]
    reset, rows, state = np.diag([1.0] * 6 + [0.0] * 3), [], np.zeros((9, 9 * n))
    for k in range(n):
        before = state[:3].copy()
        state = Phi @ reset @ state
        state[:, 9 * k : 9 * k + 9] += np.eye(9)
        rows.append((skew(arm) @ (state[:3] - before) + state[6:9]) / T)
    driving, observed = np.kron(np.eye(n), Q), np.vstack(rows)
    # the observations refer to the state at the end: noise = (z − H x_end), whose part from the state cancels
    noise = observed - group.H[:, :6] @ state[:6]
    R = noise @ driving @ noise.T + np.eye(3 * n) * run.noise.velocity
    M = state @ driving @ noise.T
    scale = np.sqrt(np.diag(R))
    assert np.abs((group.R - R) / np.outer(scale, scale)).max() < 1e-3
    spread = np.sqrt(np.diag(group.noise)[:6])
    assert np.abs((group.M[:6] - M[:6]) / np.outer(spread, scale)).max() < 1e-3


def test_bias_drifts_about_a_known_constant(nav_stage, data):
    imu = replace(nav_stage.context.imu, gyro_bias_instability=1e-7, accel_bias_instability=1e-4)
    run = ClosedLoopFilter(replace(nav_stage.context, imu=imu), nav_stage.prior, nav_stage.prior.mean)
    assert np.diag(run.state.P)[39:] == pytest.approx(run.noise.bias_drift**2)
    (start,) = starts(data, nav_stage.context, nav_stage.prior)
    run.begin(data, start, start.attitude)
    run.observe(data, start.begin, run.group_size)
    assert not np.diag(run.group.noise)[9:39].any()
    # stationary: decayed and driven variances add to the same again
    decayed = np.diag(run.group.transition)[39:] ** 2 * run.noise.bias_drift**2
    assert decayed + np.diag(run.group.noise)[39:] == pytest.approx(run.noise.bias_drift**2)


@pytest.mark.parametrize("kind", [ClosedLoopFilter, ReferencePass])
def test_bias_drift_continues_across_a_gap(nav_stage, data, kind):
    """After a gap longer than its correlation time, the drift is known no better than before the stage."""
    imu = replace(nav_stage.context.imu, gyro_bias_instability=1e-7, accel_bias_instability=1e-4)
    run = kind(replace(nav_stage.context, imu=imu), nav_stage.prior, nav_stage.prior.mean)
    (start,) = starts(data, nav_stage.context, nav_stage.prior)
    list(run.steps(data, replace(start, end=start.begin + 50 * run.stride), start.attitude))
    known = run.state.P.copy()
    later = replace(data, seq=data.seq + round(2000.0 / data.dt))
    run._reset(later, start, start.attitude)
    assert np.diag(run.state.P)[39:] == pytest.approx(run.noise.bias_drift**2, rel=1e-6)
    assert np.abs(run.state.P[39:, 9:39]).max() < 1e-4 * np.abs(known[39:, 9:39]).max()
    assert np.array_equal(run.state.P[9:39, 9:39], known[9:39, 9:39])


def test_innovations_at_the_truth_agree_with_their_sigmas(nav_stage, data):
    known = Posterior(nav_stage.truth.parameters, np.diag((1e-3 * nav_stage.prior.sigma) ** 2))
    run = ClosedLoopFilter(nav_stage.context, known, known.mean)
    (start,) = starts(data, nav_stage.context, known)
    list(run.steps(data, start, start.attitude))
    nis = run.history.nis
    consistency = nis_consistency(sum(nis), len(nis), 3)
    assert consistency.passed
    assert not consistency.warning


def test_innovations_reveal_incorrect_velocity_noise(nav_stage, data):
    known = Posterior(nav_stage.truth.parameters, np.diag((1e-3 * nav_stage.prior.sigma) ** 2))
    table = replace(nav_stage.context.table, velocity_sigma=0.7e-3)
    run = ClosedLoopFilter(replace(nav_stage.context, table=table), known, known.mean)
    (start,) = starts(data, nav_stage.context, known)
    list(run.steps(data, start, start.attitude))
    assert not nis_consistency(sum(run.history.nis), len(run.history.nis), 3).passed


def test_attitude_error_of_a_pass_agrees_with_its_sigma(nav_stage, data):
    known = Posterior(nav_stage.truth.parameters, np.diag((1e-3 * nav_stage.prior.sigma) ** 2))
    run = ClosedLoopFilter(nav_stage.context, known, known.mean)
    (start,) = starts(data, nav_stage.context, known)
    list(run.steps(data, start, start.attitude))
    # the plan ends at rest, where the measured specific force points up in the attitude of the filter
    up_b = data.accel[-200:].mean(axis=0) - known.mean[[p.group == "accel_bias" for p in PARAMETERS]]
    tilt = np.cross(run.attitude @ up_b / np.linalg.norm(up_b), [0.0, 0.0, 1.0])
    # scale and misalignment of the uncompensated force add up to 1e-3
    assert np.linalg.norm(tilt) < 2e-3
    assert run.state.P[0, 0] ** 0.5 < 1e-4


def test_navigation_restarts_after_a_gap_and_parameters_continue(nav_stage):
    keep = np.ones(len(nav_stage.block), dtype=bool)
    turning = np.flatnonzero(nav_stage.block.step == 9)
    keep[turning[100] : turning[100] + 400] = False
    whole = solved(nav_stage.truth, nav_stage.prior, [nav_stage.block])
    broken = solved(nav_stage.truth, nav_stage.prior, [block_of(nav_stage.samples, keep)])
    assert (whole.gaps, broken.gaps) == (0, 1)
    assert (whole.details["segments"], broken.details["segments"]) == (1, 2)
    assert np.abs(errors_in_sigma(broken.posterior, nav_stage.truth)).max() < 4.0
    assert broken.consistency.passed
    # without one of the turns, some sigmas are larger and none is smaller
    ratio = broken.posterior.sigma / whole.posterior.sigma
    assert ratio.min() > 0.99
    assert ratio.max() < 2.5
    assert len(ratio) == COUNT
