"""The 39-state filter: one pass over a stage, linear in the parameters, closed loop in attitude and velocity.

The states are φ, δv, δp, the errors of the 30 parameters and, if the profile specifies bias instability, the drift of
the six biases about their constants. The observation is the velocity of the table's centre of rotation,
`v − C (ω_nb × outer_lever)`, which is zero except for vibration of the base (Groves, *Principles of GNSS, Inertial and
Multisensor Integrated Navigation Systems*, 2nd ed., ch. 3, 14; resets: Savage, *Strapdown Analytics*, 2nd ed., ch. 15).
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from calstation.estimation.common import BIAS_DRIFT_TIME, Belief, SolveContext, StageData, Start, filter_noise
from calstation.estimation.navigation.reference import smoothed_reference
from calstation.estimation.navigation.velocity_group import (
    BIAS,
    Setting,
    VelocityGroup,
    inverse_of_positive,
    make_symmetric,
    observation,
    observe,
    velocity_group,
    whitened,
)
from calstation.physics import (
    PARAMETER_START,
    STATES,
    FloatArray,
    IntArray,
    compensation,
    group_indices,
    interval_work,
    propagate,
    rotation_matrix,
    rotation_rate,
    rotation_vector,
)

#: Initial sigma of δp, m; no observation depends on it.
POSITION_SIGMA = 1e-3
#: Initial sigma of δv before the first observation, m/s.
START_VELOCITY_SIGMA = 1.0
#: Duration of a group of observations that are processed together, s.
GROUP_TIME = 0.5


@dataclass(frozen=True)
class History:
    """The m observations of a pass, used for consistency tests, observability analysis, residuals and plots."""

    index: IntArray  #: Number of samples before each observation, shape (m,).
    attitude: FloatArray  #: Attitude C_bn of the linearisation, shape (m, 3, 3).
    rate: FloatArray  #: Angular rate, rad/s, shape (m, 3).
    innovation: FloatArray  #: Decorrelated innovations in units of their sigmas, shape (m, 3).

    @property
    def nis(self) -> FloatArray:
        """Normalised innovation squared, shape (m,)."""
        return np.asarray(np.sum(self.innovation**2, axis=1))


class Update(NamedTuple):
    """A group of observations as it was processed, for r rows and n states."""

    transition: FloatArray  #: Transition of φ, δv and δp over the group, shape (9, n).
    decay: FloatArray  #: Decay of the bias drift over the group, shape (n − 39,).
    H: FloatArray  #: Jacobian of the observations, shape (r, n).
    gain: FloatArray  #: Shape (n, r).
    covariance: FloatArray  #: Covariance of the innovations, shape (r, r).
    innovation: FloatArray  #: Shape (r,); empty for the observation at a start, after φ, δv and δp were reset.


#: Empty reference, with which the loop is closed.
_FREE = (np.empty((0, 3, 3)), np.empty((0, 3)))


class NavigationFilter:
    """One pass over a stage: processes groups of observations in order; provides `belief`, `history` and `attitude`.

    `point` contains the parameters of the linearisation, SI, shape (30,).

    The first pass and the live display close the loop: corrections of attitude and velocity are fed back immediately.
    A later pass follows a smoothed `Reference` instead. The transitions along a reference that jumps at every
    observation have unobservable directions that differ by the size of the jumps, so a bias and a tilt of which only
    the sum is observable would appear to be observable separately (Huang, Mourikis, Roumeliotis, *Observability-based
    rules for designing consistent EKF SLAM estimators*, IJRR 29(5), 2010).
    """

    def __init__(self, context: SolveContext, prior: Belief, point: FloatArray) -> None:
        site = context.site
        self.noise = filter_noise(context)
        self.earth = rotation_rate(site.latitude)
        self.gravity = site.local_gravity
        self.dt = 1.0 / context.imu.sample_rate
        self.stride = max(round(self.noise.interval / self.dt), 1)
        self.point = point
        self.constants = compensation(point)
        self.work = interval_work()
        self._history: list[tuple[FloatArray | IntArray, ...]] = [
            (np.empty(0, np.int64), np.empty((0, 3, 3)), np.empty((0, 3)), np.empty((0, 3)))
        ]
        #: Every update of a pass that follows a reference.
        self.updates: list[Update] = []
        #: Number of observations in a group.
        self.group_size = max(round(GROUP_TIME / (self.stride * self.dt)), 1)
        self._groups: dict[int, VelocityGroup] = {}
        self._arm_velocity = np.zeros(3)
        self._has_drift = bool(np.any(self.noise.bias_drift))
        size = STATES + len(BIAS) if self._has_drift else STATES
        from filterpy.kalman import KalmanFilter  # imports scipy.stats, which takes half a second

        kf = KalmanFilter(dim_x=size, dim_z=3)
        kf.x = np.zeros(size)
        kf.x[PARAMETER_START:STATES] = prior.mean - point
        kf.P = np.zeros((size, size))
        kf.P[PARAMETER_START:STATES, PARAMETER_START:STATES] = prior.covariance
        kf.inv = inverse_of_positive
        if self._has_drift:
            bias_drift = np.arange(STATES, size)
            kf.P[bias_drift, bias_drift] = self.noise.bias_drift**2
        self.kf = kf
        self._offset = kf.x.copy()
        lever = float(np.sum((point[group_indices("outer_lever")]) ** 2))
        variance = self.noise.velocity + lever * self.noise.end_rate
        self.setting = Setting(
            self.earth, self.gravity, self.dt, self.stride, self.noise.rate, self.noise.force, variance
        )

    @property
    def belief(self) -> Belief:
        """Current posterior of the parameters."""
        s = slice(PARAMETER_START, STATES)
        return Belief(self.point + self.kf.x[s], self.kf.P[s, s].copy())

    @property
    def history(self) -> History:
        """All observations so far."""
        return History(*(np.concatenate(columns) for columns in zip(*self._history, strict=True)))

    def take_history(self) -> History:
        """Return the observations since the last call and forget them."""
        found = self.history
        del self._history[1:]
        return found

    def begin(self, data: StageData, start: Start, attitude: FloatArray) -> None:
        """Start or restart at rest: reset the navigation states and keep the parameters.

        `attitude` is the C_bn of the linearisation. The velocity is initially unknown and is observed immediately.
        Assuming zero would ignore the effect of the gyro bias uncertainty on the velocity of the lever arm.
        """
        kf = self.kf
        kf.x[:PARAMETER_START] = 0.0
        kf.x[:3] = rotation_vector(start.prior @ attitude.T)
        kf.P[:PARAMETER_START, :] = 0.0
        kf.P[:, :PARAMETER_START] = 0.0
        variances = [*start.prior_sigma**2, *[START_VELOCITY_SIGMA**2] * 3, *[POSITION_SIGMA**2] * 3]
        kf.P[range(PARAMETER_START), range(PARAMETER_START)] = variances
        self._offset = kf.x.copy()
        self.work.attitude[:] = attitude
        self.work.velocity[:] = 0.0
        propagate(
            self.constants, self.earth, self.gravity, self.dt, data.gyro, data.accel, start.begin,
            start.begin, self.work,
        )  # fmt: skip
        z, H = np.zeros(3), np.zeros((3, len(kf.x)))
        self._arm_velocity[:] = observation(self.work, self.earth, self.constants, z, H)
        if self._has_drift:
            H[:, STATES:] = H[:, BIAS]
        kf.update(z, np.eye(3) * self.setting.variance, H)
        self.updates.append(Update(np.empty((0, 0)), np.empty(0), H, kf.K, kf.S, np.empty(0)))

    def observe(
        self, data: StageData, start: int, count: int, follow: tuple[FloatArray, FloatArray] | None = None
    ) -> None:
        """Process a group of `count` observations: strapdown, prediction, update and feedback.

        `follow` contains the attitudes, shape (count, 3, 3), and velocities, m/s, shape (count, 3), of the reference;
        None closes the loop.
        """
        kf, work = self.kf, self.work
        group = self._group(count)
        attitudes, velocities = follow or _FREE
        observe(
            self.constants, self.setting, data.gyro, data.accel, start, attitudes, velocities,
            self._arm_velocity, work, group,
        )  # fmt: skip
        kf.F, kf.Q, kf.H, kf.R, kf.M = group.transition, group.noise, group.H, group.R, group.M
        kf.predict()
        if follow is not None:
            kf.x[:PARAMETER_START] += group.shift
        kf.update_correlated(group.z, kf.R, kf.H)
        make_symmetric(kf.P)
        index = start + self.stride * np.arange(1, count + 1)
        innovation = whitened(kf.S, kf.y).reshape(count, 3)
        self._history.append((index, group.attitude.copy(), group.rate.copy(), innovation))
        if follow is None:
            self._feed_back()
        else:
            decay = np.diag(kf.F)[STATES:].copy()
            self.updates.append(Update(kf.F[:PARAMETER_START].copy(), decay, kf.H.copy(), kf.K, kf.S, kf.y))

    def _group(self, count: int) -> VelocityGroup:
        """Return the arrays for a group of `count` observations, including the decay of bias drift over the group."""
        if count not in self._groups:
            group = velocity_group(count, len(self.kf.x))
            if self._has_drift:
                bias_drift = np.arange(STATES, len(self.kf.x))
                decay = np.exp(-count * self.stride * self.dt / BIAS_DRIFT_TIME)
                group.transition[bias_drift, bias_drift] = decay
                group.noise[bias_drift, bias_drift] = self.noise.bias_drift**2 * (1.0 - decay**2)
            self._groups[count] = group
        return self._groups[count]

    def _feed_back(self) -> None:
        """Close the loop on the observations, not on the mean of the prior.

        x = offset + correction: the offset is the filter mean that would result if every observation agreed with the
        linearisation point. It remains in x and decays with each observation. Only the correction is applied to the
        reference, which therefore stays near the levelled start from the first sample on.
        """
        kf, work = self.kf, self.work
        predicted = kf.F @ self._offset
        self._offset = predicted - kf.K @ (kf.H @ predicted)
        correction = kf.x[:6] - self._offset[:6]
        work.attitude[:] = rotation_matrix(correction[:3]) @ work.attitude
        work.velocity[:] = work.velocity + correction[3:]
        kf.x[:6] = self._offset[:6]

    @property
    def attitude(self) -> FloatArray:
        """Current estimate of C_bn, shape (3, 3)."""
        return np.asarray(rotation_matrix(self.kf.x[:3]) @ self.work.attitude)

    def run(
        self,
        data: StageData,
        start: Start,
        attitude: FloatArray,
        smooth: bool,
        watch: Callable[["NavigationFilter"], None] | None = None,
    ) -> None:
        """Process a whole segment in intervals of the stride; a remainder shorter than an interval is omitted.

        `attitude` is the C_bn of the linearisation at the start. With `smooth` the pass follows a smoothed reference
        and does not close the loop. `watch` is called after the start and after every group.
        """
        span = (start.begin, start.end, self.stride)
        reference = None
        if smooth:
            reference = smoothed_reference(
                self.constants, self.earth, self.gravity, self.noise, data, span, attitude,
                float(start.prior_sigma[0]),
            )  # fmt: skip
            attitude = reference.attitude[0]
        self.begin(data, start, attitude)
        if watch is not None:
            watch(self)
        observations = (start.end - start.begin) // self.stride
        for done in range(0, observations, self.group_size):
            count = min(self.group_size, observations - done)
            ends = slice(done + 1, done + count + 1)
            follow = reference and (reference.attitude[ends], reference.velocity[ends])
            self.observe(data, start.begin + done * self.stride, count, follow)
            if watch is not None:
                watch(self)
