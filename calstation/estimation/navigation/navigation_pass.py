"""Passes of the 39-state filter over a stage: in closed loop with filterpy, or compiled along a smoothed trajectory.

The states are φ, δv, δp, the errors of the 30 parameters and, if the profile specifies bias instability, the drift of
the six biases about their constants. The observation is the mean of the velocity of the table's centre of rotation,
`v − C (ω_nb × outer_lever)`, over an interval, which is zero except for vibration of the base (Groves, *Principles of
GNSS, Inertial and Multisensor Integrated Navigation Systems*, 2nd ed., ch. 3, 14; resets: Savage, *Strapdown
Analytics*, 2nd ed., ch. 15).

The 12 states of azimuth flips are φ, δv and the biases; the other parameters are consider states of the same filter.

The trajectory is computed by a six-state filter (φ, δv) and a Rauch-Tung-Striebel smoother. It follows the gyro noise
without the jumps of a filter, so that the passes are Gauss-Newton steps (Bell, *The iterated Kalman smoother as a
Gauss-Newton method*, SIAM J. Optim. 4(3), 1994).
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from calstation.estimation.common import BIAS_DRIFT_TIME, Posterior, SolveContext, StageData, Start, filter_noise
from calstation.estimation.navigation.group_update import State, Updates, process, updates
from calstation.estimation.navigation.small_matrices import backward, cholesky, forward
from calstation.estimation.navigation.velocity_group import (
    BIAS,
    OBSERVED,
    Reference,
    Setting,
    VelocityGroup,
    arm_motion,
    observation,
    observe,
    velocity_group,
    write_attitude_columns,
)
from calstation.physics import (
    DV,
    NAVIGATION,
    PARAMETER_STATES,
    PHI,
    STATES,
    Compensation,
    FloatArray,
    Increments,
    IntArray,
    IntervalWork,
    compensation,
    increments,
    interval_work,
    kernel,
    propagate,
    rotate,
    rotation_matrix,
    rotation_rate,
    rotation_vector,
)

#: Initial sigma of δp, m; no observation depends on it.
POSITION_SIGMA = 1e-3
#: Initial sigma of δv before the first observation, m/s.
START_VELOCITY_SIGMA = 1.0
#: Variance of the velocity at a sample relative to that of its mean over an interval; larger than for any vibration.
START_RATIO = 100.0
#: Duration of a group of observations that are processed together, s.
GROUP_TIME = 0.5
#: Empty reference for the closed loop, which follows no reference.
_NO_REFERENCE = Reference(np.empty((0, 3, 3)), np.empty((0, 3)))
#: Prior sigma of the initial heading, rad: small, because the parameters may be too inaccurate for gyrocompassing.
HEADING_SIGMA = 1e-4


@dataclass(frozen=True)
class History:
    """The m observations of a pass, used for consistency tests, observability analysis, residuals and plots."""

    index: IntArray  #: Number of samples before each observation, shape (m,).
    attitude: FloatArray  #: C_bn about which the pass linearises, shape (m, 3, 3).
    rate: FloatArray  #: Angular rate, rad/s, shape (m, 3).
    innovation: FloatArray  #: Decorrelated innovations in units of their sigmas, shape (m, 3).

    @property
    def nis(self) -> FloatArray:
        """Normalised innovation squared, shape (m,)."""
        return np.asarray(np.sum(self.innovation**2, axis=1))


class NavigationPass(ABC):
    """A pass over a stage, which processes groups of observations in order.

    `point` contains the parameters about which the pass linearises, SI, shape (30,).
    """

    def __init__(self, context: SolveContext, prior: Posterior, point: FloatArray) -> None:
        site = context.site
        self.noise = filter_noise(context)
        self.earth = rotation_rate(site.latitude)
        self.gravity = site.local_gravity
        self.dt = 1.0 / context.imu.sample_rate
        self.stride = max(round(self.noise.interval / self.dt), 1)
        self.point = point
        self.constants = compensation(point)
        self.work = interval_work()
        #: C (ω_nb × outer_lever) at the last observation, m/s, shape (3,).
        self.arm_velocity = np.zeros(3)
        self._increments: tuple[StageData, Increments] | None = None
        self._history: list[tuple[FloatArray | IntArray, ...]] = [
            (np.empty(0, np.int64), np.empty((0, 3, 3)), np.empty((0, 3)), np.empty((0, 3)))
        ]
        #: Number of observations in a group.
        self.group_size = max(round(GROUP_TIME / (self.stride * self.dt)), 1)
        self._groups: dict[int, VelocityGroup] = {}
        #: The last group of observations.
        self.group: VelocityGroup
        #: Number of the last processed sample.
        self._last_seq: int | None = None
        self._has_drift = bool(np.any(self.noise.bias_drift))
        size = STATES + len(BIAS) if self._has_drift else STATES
        x, P = np.zeros(size), np.zeros((size, size))
        x[PARAMETER_STATES] = prior.mean - point
        P[PARAMETER_STATES, PARAMETER_STATES] = prior.covariance
        if self._has_drift:
            bias_drift = np.arange(STATES, size)
            P[bias_drift, bias_drift] = self.noise.bias_drift**2
        self.state = State(x, P)
        self.setting = Setting(
            self.earth, self.gravity, self.dt, self.stride, self.noise.rate, self.noise.force, self.noise.velocity
        )

    @property
    def posterior(self) -> Posterior:
        """Current posterior of the parameters."""
        P = self.state.P[PARAMETER_STATES, PARAMETER_STATES]
        return Posterior(self.point + self.state.x[PARAMETER_STATES], P.copy())

    @property
    def history(self) -> History:
        """All observations so far."""
        return History(*(np.concatenate(columns) for columns in zip(*self._history, strict=True)))

    def take_history(self) -> History:
        """Return and discard the observations since the last call."""
        history = self.history
        del self._history[1:]
        return history

    @property
    def attitude(self) -> FloatArray:
        """Current estimate of C_bn, shape (3, 3)."""
        return np.asarray(rotation_matrix(self.state.x[PHI]) @ self.work.attitude)

    @abstractmethod
    def begin(self, data: StageData, start: Start, attitude: FloatArray) -> None:
        """Start or restart at rest: reset the navigation states about C_bn `attitude`, and keep the parameters."""

    @abstractmethod
    def observe(self, data: StageData, first: int, count: int, groups: int = 1) -> None:
        """Process groups of `count` observations from sample `first`."""

    def steps(self, data: StageData, start: Start, attitude: FloatArray, batch: int = 200) -> Iterator[int]:
        """Process a whole segment in intervals of the stride; omit a remainder that is shorter than an interval.

        Yield 0 after the start, and then the number of groups processed, at most `batch`.

        Parameters
        ----------
        data, start : samples of the stage, and start of the segment
        attitude : C_bn at the start about which the pass linearises, shape (3, 3)
        batch : number of groups to process at a time
        """
        self.begin(data, start, attitude)
        yield 0
        observations = (start.end - start.begin) // self.stride
        processed = 0
        while processed < observations:
            count = min(self.group_size, observations - processed)
            groups = min(batch, (observations - processed) // count)
            self.observe(data, start.begin + processed * self.stride, count, groups)
            processed += groups * count
            yield groups

    def _reset(self, data: StageData, start: Start, attitude: FloatArray) -> FloatArray:
        """Reset the navigation states to the prior of a start, relative to the linearisation's attitude.

        The bias drift continues; return its decay since the last processed sample, shape (6,), or (0,) without drift.
        """
        x, P = self.state
        decay = np.ones(len(x) - STATES)
        if self._has_drift and self._last_seq is not None:
            drift = np.arange(STATES, len(x))
            decay *= np.exp(-(int(data.seq[start.begin]) - self._last_seq) * self.dt / BIAS_DRIFT_TIME)
            x[drift] *= decay
            P[drift, :] *= decay[:, None]
            P[:, drift] *= decay
            P[drift, drift] += self.noise.bias_drift**2 * (1.0 - decay**2)
        x[NAVIGATION] = 0.0
        x[PHI] = rotation_vector(start.prior @ attitude.T)
        P[NAVIGATION, :] = 0.0
        P[:, NAVIGATION] = 0.0
        variances = [*start.prior_sigma**2, *[START_VELOCITY_SIGMA**2] * 3, *[POSITION_SIGMA**2] * 3]
        P[NAVIGATION, NAVIGATION] = np.diag(variances)
        self.work.attitude[:] = attitude
        self.work.velocity[:] = 0.0
        return decay

    def _observe_start(self, data: StageData, begin: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Observe the velocity at rest; return Jacobian, Cholesky factor and gain as in `Updates`.

        The velocity is initially unknown and is observed immediately. If it were assumed to be zero, the effect of the
        gyro bias uncertainty on the velocity of the lever arm would be ignored.
        """
        x, P = self.state
        propagate(self.constants, self.earth, self.gravity, self.dt, self._motion(data), begin, begin, self.work)
        z, H = np.zeros(3), np.zeros((3, len(x)))
        self.arm_velocity[:] = observation(self.work, self.earth, self.constants, z, H)
        if self._has_drift:
            H[:, STATES:] = H[:, BIAS]
        # Joseph form, because the observation is much more accurate than the velocity before it
        R = np.eye(3) * (START_RATIO * self.setting.variance)
        root = np.asarray(np.linalg.cholesky(H @ P @ H.T + R))
        gain = np.asarray(np.linalg.solve(root, H @ P))
        K = np.linalg.solve(root.T, gain).T
        x += K @ (z - H @ x)
        I_KH = np.eye(len(x)) - K @ H
        P[:] = I_KH @ P @ I_KH.T + K @ R @ K.T
        return H, root, gain

    def _motion(self, data: StageData) -> Increments:
        """Return the increments of all samples; they are computed once for the same data."""
        if self._increments is None or self._increments[0] is not data:
            self._increments = data, increments(self.constants, self.dt, data.gyro, data.accel)
        return self._increments[1]

    def _group(self, count: int) -> VelocityGroup:
        """Return the arrays for a group of `count` observations, including the decay of bias drift over the group."""
        if count not in self._groups:
            group = velocity_group(count, len(self.state.x))
            if self._has_drift:
                bias_drift = np.arange(STATES, len(self.state.x))
                decay = np.exp(-count * self.stride * self.dt / BIAS_DRIFT_TIME)
                group.transition[bias_drift, bias_drift] = decay
                group.noise[bias_drift, bias_drift] = self.noise.bias_drift**2 * (1.0 - decay**2)
            self._groups[count] = group
        return self._groups[count]


if TYPE_CHECKING:
    from filterpy.kalman import KalmanFilter


class ClosedLoopFilter(NavigationPass):
    """A pass in closed loop, which feeds back the corrections from the observations, but not the mean of the prior.

    The mean x is the sum of an offset and a correction. The offset is the mean that would result if every observation
    agreed with the linearisation point; it remains in x and decays with each observation. Only the correction is
    applied to the strapdown solution, which therefore remains near the level start attitude from the first sample on.
    """

    def begin(self, data: StageData, start: Start, attitude: FloatArray) -> None:
        """Start or restart at rest: reset the navigation states and keep the parameters."""
        self._reset(data, start, attitude)
        self._offset = self.state.x.copy()
        self._observe_start(data, start.begin)

    def observe(self, data: StageData, first: int, count: int, groups: int = 1) -> None:
        """Process groups of `count` observations from sample `first`: strapdown, prediction, update and feedback."""
        self.group = group = self._group(count)
        for g in range(groups):
            start = first + g * count * self.stride
            motion = self._motion(data)
            observe(self.constants, self.setting, motion, start, _NO_REFERENCE, self.arm_velocity, self.work, group)
            innovation = self._update(group)
            index = start + self.stride * np.arange(1, count + 1)
            self._last_seq = int(data.seq[index[-1] - 1])
            self._history.append((index, group.attitude.copy(), group.rate.copy(), innovation.reshape(-1, 3)))

    @cached_property
    def _kalman(self) -> "KalmanFilter":
        # the import takes 0.8 s, mostly scipy.stats, and only a pass in closed loop needs it
        from filterpy.kalman import KalmanFilter

        return KalmanFilter(dim_x=len(self.state.x), dim_z=3 * self.group_size)

    def _update(self, group: VelocityGroup) -> FloatArray:
        """Predict and update the mean and covariance, and close the loop; return the decorrelated innovations, (r,).

        `update_correlated` implements

            S = H P Hᵀ + H M + Mᵀ Hᵀ + R,   K = (P Hᵀ + M) S⁻¹,   P⁺ = P − K (H P + Mᵀ)

        where M is the covariance of the noise of the observations with the process noise of the interval that *ends*
        with them, which `predict` has just added, not of the interval that follows (Y. Bar-Shalom, X. R. Li, T.
        Kirubarajan, *Estimation with Applications to Tracking and Navigation*, 2001, section 8.3).

        The method inverts S, does not keep P symmetric, and does not check shapes: with a column x and a flat z, the
        innovation would become a matrix. Therefore x and z are flat, P is made symmetric, and the observations are
        decorrelated first, so that S is the identity; a condition number of S up to 1e5 in the first groups would cost
        four digits.
        """
        kalman, (x, P) = self._kalman, self.state
        kalman.x, kalman.P = x, P
        kalman.predict(F=group.transition, Q=group.noise)
        shared = group.H @ group.M
        S = group.H @ kalman.P @ group.H.T + shared + shared.T + group.R
        root, size = np.empty_like(S), len(x)
        cholesky(S, root)
        white = np.hstack([group.H, group.M.T, group.z[:, None], group.R])
        forward(root, white)
        H, R = white[:, :size], np.ascontiguousarray(white[:, 2 * size + 1 :].T)
        forward(root, R)
        kalman.M = white[:, size : 2 * size].T
        kalman.update_correlated(white[:, 2 * size], R, H)
        x[:], P[:] = kalman.x, 0.5 * (kalman.P + kalman.P.T)
        # feedback
        offset = group.transition @ self._offset
        self._offset = offset - kalman.K @ (H @ offset)
        correction = x - self._offset
        self.work.velocity[:] += correction[DV]
        rotate(correction[PHI], self.work.attitude)
        x[:OBSERVED] = self._offset[:OBSERVED]
        return np.asarray(kalman.y)


@kernel
def smoothed_reference(
    c: Compensation,
    s: Setting,
    variance: float,
    motion: Increments,
    span: tuple[int, int],
    tilt_sigma: float,
    work: IntervalWork,
) -> Reference:
    """Compute the smoothed trajectory of a segment with fixed parameters by a closed-loop filter and an RTS smoother.

    Parameters
    ----------
    c, s : constants of the assumed parameters and of the pass
    variance : variance of the table's velocity, (m/s)²
    motion : increments of all samples with these parameters
    span : index of the first sample, and index after the last
    tilt_sigma : prior sigma of the tilt at the start, rad
    work : attitude at the start, whose heading is kept; overwritten

    Returns
    -------
    Trajectory at the start and at the ends of the intervals
    """
    begin, count, T = span[0], (span[1] - span[0]) // s.stride, s.stride * s.dt
    P = np.zeros((6, 6))
    P[0, 0] = P[1, 1] = tilt_sigma**2
    P[2, 2] = HEADING_SIGMA**2
    P[3, 3] = P[4, 4] = P[5, 5] = variance
    work.velocity[:] = 0.0
    attitudes, velocities = np.empty((count + 1, 3, 3)), np.empty((count + 1, 3))
    gains = np.empty((count, 6, 6))
    corrections = np.zeros((count + 1, 6))
    predicted, L, S, root = np.empty((6, 6)), np.empty((6, 6)), np.empty((3, 3)), np.empty((3, 3))
    H, K, z, d = np.zeros((3, 6)), np.empty((3, 6)), np.empty((3, 1)), np.empty(6)
    H[0, 3] = H[1, 4] = H[2, 5] = 1.0
    propagate(c, s.earth, s.gravity, s.dt, motion, begin, begin, work, False)
    work.velocity[:] = arm_motion(work, s.earth, c.outer_lever)[1]
    attitudes[0], velocities[0] = work.attitude, work.velocity
    for k in range(count):
        first = begin + k * s.stride
        propagate(c, s.earth, s.gravity, s.dt, motion, first, first + s.stride, work, False)
        F, gain = work.transition, gains[k]
        gain[:] = 0.0
        for i in range(6):
            for m in range(6):
                for j in range(6):
                    gain[i, j] += F[i, m] * P[m, j]
        for i in range(6):
            for j in range(6):
                t = 0.0
                for m in range(6):
                    t += gain[i, m] * F[j, m]
                predicted[i, j] = t
        for i in range(3):
            predicted[i, i] += s.rate_noise * T
            predicted[3 + i, 3 + i] += s.force_noise * T
        cholesky(predicted, L)
        forward(L, gain)
        backward(L, gain)
        u = arm_motion(work, s.earth, c.outer_lever)[1]
        write_attitude_columns(u, H)
        for i in range(3):
            z[i, 0] = u[i] - work.velocity[i]
            for j in range(6):
                K[i, j] = predicted[3 + i, j]
                for m in range(3):
                    K[i, j] += H[i, m] * predicted[m, j]
            for j in range(i + 1):
                S[i, j] = K[i, 3 + j]
                for m in range(3):
                    S[i, j] += K[i, m] * H[j, m]
            S[i, i] += variance
        cholesky(S, root)
        forward(root, K)
        forward(root, z)
        for i in range(6):
            d[i] = K[0, i] * z[0, 0] + K[1, i] * z[1, 0] + K[2, i] * z[2, 0]
            corrections[k + 1, i] = d[i]
            for j in range(i + 1):
                P[i, j] = predicted[i, j] - K[0, i] * K[0, j] - K[1, i] * K[1, j] - K[2, i] * K[2, j]
                P[j, i] = P[i, j]
        rotate(d, work.attitude)
        for i in range(3):
            work.velocity[i] += d[3 + i]
        attitudes[k + 1], velocities[k + 1] = work.attitude, work.velocity
    smoothed = np.zeros((count + 1, 6))
    for k in range(count - 1, -1, -1):
        for m in range(6):
            t = corrections[k + 1, m] + smoothed[k + 1, m]
            for i in range(6):
                smoothed[k, i] += gains[k, m, i] * t
    for k in range(count + 1):
        rotate(smoothed[k], attitudes[k])
        for i in range(3):
            velocities[k, i] += smoothed[k, 3 + i]
    return Reference(attitudes, velocities)


class ReferencePass(NavigationPass):
    """A pass in open loop about a smoothed trajectory.

    If the trajectory jumped at every observation, the unobservable directions of its transitions would differ by the
    size of the jumps, and a bias and a tilt of which only the sum is observable would appear to be separately
    observable (Huang, Mourikis, Roumeliotis, *Observability-based rules for designing consistent EKF SLAM estimators*,
    IJRR 29(5), 2010).
    """

    #: The updates made by the last call of `observe`.
    last_updates: Updates
    _reference: Reference
    _first_sample: int

    def __init__(self, context: SolveContext, prior: Posterior, point: FloatArray) -> None:
        super().__init__(context, prior, point)
        #: All updates of the pass, in order.
        self.updates: list[Updates] = []

    def begin(self, data: StageData, start: Start, attitude: FloatArray) -> None:
        """Compute the reference of the segment, and start as in `NavigationPass.begin`."""
        self._first_sample = start.begin
        self.work.attitude[:] = attitude
        self._reference = smoothed_reference(
            self.constants, self.setting, self.noise.velocity, self._motion(data),
            (start.begin, start.end), float(start.prior_sigma[0]), self.work,
        )  # fmt: skip
        decay = self._reset(data, start, self._reference.attitude[0])
        H, root, gain = self._observe_start(data, start.begin)
        none = np.empty((1, 0, 0))
        self.updates.append(Updates(none, decay, H[None], root[None], gain[None], none[0], none, none[0]))

    def observe(self, data: StageData, first: int, count: int, groups: int = 1) -> None:
        """Process groups of `count` observations from sample `first`: strapdown, prediction and update."""
        self.group = group = self._group(count)
        self.last_updates = updates(groups, count, np.diag(group.transition)[STATES:].copy())
        begin = (first - self._first_sample) // self.stride + 1
        reference = Reference(*(values[begin : begin + groups * count] for values in self._reference))
        process(
            self.constants, self.setting, self._motion(data), first, reference, self.arm_velocity, self.work, group,
            self.state, self.last_updates,
        )  # fmt: skip
        self.updates.append(self.last_updates)
        index = first + self.stride * np.arange(1, groups * count + 1)
        self._last_seq = int(data.seq[index[-1] - 1])
        self._history.append(
            (index, self.last_updates.attitude, self.last_updates.rate, self.last_updates.innovation.reshape(-1, 3))
        )
