"""The 39-state filter: one pass over a stage, linear in the parameters, closed loop in attitude and velocity.

States: φ, δv, δp and the errors of the 30 parameters relative to the point the pass is linearised about; with a
profile that states bias instability also the wander of the six biases about their constants.
Observed: the velocity of the table's centre of rotation, which is zero but for the base's vibration, at rest
and through rotations: `v − C (ω_nb × outer_lever)`. Kalman algebra is filterpy's.

References
----------
P. D. Groves, *Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems*, 2nd ed., ch. 3, 14.
P. G. Savage, *Strapdown Analytics*, 2nd ed., ch. 15 (closed-loop error resets).
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numba as nb
import numpy as np
from filterpy.kalman import KalmanFilter

from calstation.estimation.alignment import Start
from calstation.estimation.context import Belief, SolveContext
from calstation.estimation.noise import WANDER_TIME, filter_noise
from calstation.estimation.reference import smoothed_reference
from calstation.estimation.stage_data import StageData
from calstation.physics.arrays import FloatArray
from calstation.physics.earth import normal_gravity, rotation_rate
from calstation.physics.imu_model import Compensation, compensation
from calstation.physics.parameters import group_indices
from calstation.physics.rotation import rotation_matrix, rotation_vector
from calstation.physics.strapdown import (
    PARAMETER_START,
    STATES,
    IntervalWork,
    interval_work,
    propagate,
    write_navigation_block,
)

POSITION_SIGMA = 1e-3
"""Start of δp, m: the table holds the unit; no observation depends on it."""

BIAS = [PARAMETER_START + i for i in (*group_indices("gyro_bias"), *group_indices("accel_bias"))]
"""The biases' places in the state; where they are unstable, as many further states follow how far they wander."""
START_VELOCITY_SIGMA = 1.0
"""Start of δv before the first observation, m/s."""


@dataclass
class History:
    """What a pass saw, one entry per observation: for observability, residuals and plots."""

    index: list[int] = field(default_factory=list)
    attitude: list[FloatArray] = field(default_factory=list)
    rate: list[FloatArray] = field(default_factory=list)
    innovation: list[FloatArray] = field(default_factory=list)
    nis: list[float] = field(default_factory=list)


class NavigationFilter:
    """One pass. Feed it intervals in order; read `belief`, `history` and `attitude`.

    Parameters
    ----------
    context : site, IMU and table
    prior : of the parameters
    point : parameter values to linearise about, SI, shape (30,)

    Notes
    -----
    The first pass and the live display close the loop: what the observations say of attitude and velocity is fed
    back at once. A later pass follows a smoothed `Reference` instead. It must: transitions along a reference that
    jumps with every observation disagree by the size of the jumps about which direction is still unknown, and a
    bias and a tilt that only their sum betrays would seem to be known apart (Huang, Mourikis, Roumeliotis,
    *Observability-based rules for designing consistent EKF SLAM estimators*, IJRR 29(5), 2010).
    """

    def __init__(self, context: SolveContext, prior: Belief, point: FloatArray) -> None:
        site = context.site
        self.noise = filter_noise(context)
        self.earth = rotation_rate(site.latitude)
        self.gravity = site.gravity or normal_gravity(site.latitude, site.height)
        self.dt = 1.0 / context.imu.sample_rate
        self.stride = max(round(self.noise.interval / self.dt), 1)
        self.point = point
        self.constants = compensation(point)
        self.work = interval_work()
        self.history = History()
        self._arm_velocity = np.zeros(3)
        self._wanders = bool(np.any(self.noise.wander))
        size = STATES + len(BIAS) if self._wanders else STATES
        kf = KalmanFilter(dim_x=size, dim_z=3)
        kf.x = np.zeros(size)
        kf.x[PARAMETER_START:STATES] = prior.mean - point
        kf.P = np.zeros((size, size))
        kf.P[PARAMETER_START:STATES, PARAMETER_START:STATES] = prior.covariance
        kf.F = np.eye(size) if self._wanders else self.work.transition
        kf.H = np.zeros((3, size))
        kf.inv = _inverse
        kf.Q = np.zeros((size, size))
        if self._wanders:
            decay = np.exp(-self.stride * self.dt / WANDER_TIME)
            wander = np.arange(STATES, size)
            kf.P[wander, wander] = self.noise.wander**2
            kf.F[wander, wander] = decay
            kf.Q[wander, wander] = self.noise.wander**2 * (1.0 - decay**2)
        self.kf = kf
        self._offset = kf.x.copy()
        lever = float(np.sum((point[group_indices("outer_lever")]) ** 2))
        kf.R = np.eye(3) * (self.noise.velocity + lever * self.noise.end_rate)

    @property
    def belief(self) -> Belief:
        """Posterior of the parameters so far."""
        s = slice(PARAMETER_START, STATES)
        return Belief(self.point + self.kf.x[s], self.kf.P[s, s].copy())

    def begin(self, data: StageData, start: Start, attitude: FloatArray) -> None:
        """Start (again) at rest: navigation states afresh about `attitude`, parameters carry on.

        The velocity starts unknown and is observed at once: a velocity assumed zero would deny that the rate,
        hence the lever's velocity, is only as well known as the gyro bias.
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
            self.constants,
            self.earth,
            self.gravity,
            self.dt,
            data.gyro,
            data.accel,
            start.begin,
            start.begin,
            self.work,
        )
        self.kf.update(self._measure(), self.kf.R, self.kf.H)

    def interval(
        self, data: StageData, start: int, stop: int, follow: tuple[FloatArray, FloatArray] | None = None
    ) -> None:
        """One observation interval: strapdown over samples start to stop, predict, observe, feed back.

        follow : attitude and velocity of the reference at `stop`, None to close the loop instead

        What φ does to velocity is written with the force that reference and lever arm demand, gravity and the
        change of the arm's velocity, not with the one measured: the measured one shakes with the base, and a
        regressor that shakes as much as the observation would seem to tell the azimuth to 1/√(2N) rad.
        """
        kf, work = self.kf, self.work
        propagate(self.constants, self.earth, self.gravity, self.dt, data.gyro, data.accel, start, stop, work)
        _process_noise(work.force, self.noise.rate, self.noise.force, (stop - start) * self.dt, kf.Q)
        shift = self._go_over(*follow) if follow is not None else None
        before, z = self._arm_velocity, self._measure()
        T = (stop - start) * self.dt
        force_sum = self._arm_velocity - before
        force_sum[2] += self.gravity * T
        write_navigation_block(work.transition, self.earth, force_sum, 0.5 * T * force_sum, T)
        if self._wanders:
            kf.F[:STATES, :STATES] = work.transition
            kf.F[:PARAMETER_START, STATES:] = work.transition[:PARAMETER_START, BIAS]
        kf.predict()
        if shift is not None:
            kf.x[:6] -= shift
        kf.update(z, kf.R, kf.H)
        history = self.history
        history.index.append(stop)
        history.attitude.append(work.attitude.copy())
        history.rate.append(work.rate.copy())
        history.innovation.append(kf.y.copy())
        history.nis.append(float(kf.y @ kf.SI @ kf.y))
        if follow is None:
            self._feed_back()

    def _measure(self) -> FloatArray:
        """The observation at the reference, its Jacobian into the filter, the arm's velocity kept."""
        z = np.empty(3)
        self._arm_velocity = _observation(self.work, self.earth, self.constants, z, self.kf.H)
        if self._wanders:
            self.kf.H[:, STATES:] = self.kf.H[:, BIAS]
        return z

    def _go_over(self, attitude: FloatArray, velocity: FloatArray) -> FloatArray:
        """Go over to another reference; how much less the errors φ, δv become, shape (6,)."""
        work = self.work
        shift = np.concatenate([rotation_vector(attitude @ work.attitude.T), velocity - work.velocity])
        work.attitude[:] = attitude
        work.velocity[:] = velocity
        return shift

    def _feed_back(self) -> None:
        """Close the loop on what the observations said, not on where the prior's mean lies.

        x = offset + correction: the offset is the mean the filter would have, had every observation agreed with
        the point linearised about. It stays in x and dies away as data come; only the correction turns the
        reference, which so stays near the levelled start from the first sample on.
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
        """Best attitude C_bn now, shape (3, 3)."""
        return np.asarray(rotation_matrix(self.kf.x[:3]) @ self.work.attitude)

    def run(
        self,
        data: StageData,
        start: Start,
        attitude: FloatArray,
        smooth: bool,
        watch: Callable[["NavigationFilter"], None] | None = None,
    ) -> None:
        """The whole of a segment, in intervals of the stride; the rest shorter than one is left.

        smooth : follow a smoothed reference from `attitude`, rather than close the loop
        watch : called after the start and after every observation
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
        for number, k in enumerate(range(start.begin, start.end - self.stride + 1, self.stride), 1):
            follow = reference and (reference.attitude[number], reference.velocity[number])
            if watch is not None:
                watch(self)
            self.interval(data, k, k + self.stride, follow)
        if watch is not None:
            watch(self)


@nb.njit(cache=True)
def _inverse(S: FloatArray) -> FloatArray:
    """Inverse of a 3×3 matrix by its adjugate."""
    A = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            a, b, c, d = (j + 1) % 3, (j + 2) % 3, (i + 1) % 3, (i + 2) % 3
            A[i, j] = S[a, c] * S[b, d] - S[a, d] * S[b, c]
    A /= S[0, 0] * A[0, 0] + S[0, 1] * A[1, 0] + S[0, 2] * A[2, 0]
    return A


@nb.njit(cache=True)
def _process_noise(force: FloatArray, rate_q: float, force_q: float, T: float, Q: FloatArray) -> None:
    """Covariance of white rate and force noise over an interval of constant specific force (Groves 14.80)."""
    fx, fy, fz = force[0], force[1], force[2]
    A = np.zeros((3, 3))
    A[0, 1], A[0, 2], A[1, 2] = fz, -fy, fx
    A[1, 0], A[2, 0], A[2, 1] = -fz, fy, -fx
    for i in range(3):
        Q[i, i] = rate_q * T
        Q[6 + i, 6 + i] = force_q * T**3 / 3.0
        Q[3 + i, 6 + i] = force_q * T**2 / 2.0
        Q[6 + i, 3 + i] = Q[3 + i, 6 + i]
        for j in range(3):
            Q[3 + i, j] = A[i, j] * rate_q * T**2 / 2.0
            Q[j, 3 + i] = Q[3 + i, j]
            s = 0.0
            for k in range(3):
                s += A[i, k] * A[j, k]
            Q[3 + i, 3 + j] = s * rate_q * T**3 / 3.0
        Q[3 + i, 3 + i] += force_q * T


@nb.njit(cache=True)
def _observation(
    work: IntervalWork, earth: FloatArray, c: Compensation, z: FloatArray, H: FloatArray
) -> FloatArray:
    """Arm velocity u = C(ω_nb × r), returned; z = u − v, and its Jacobian H.

    H of φ: [u×], δv: I, gyro parameters: C [r×] ∂ω, outer lever: −C [ω_nb×].
    """
    C, r = work.attitude, c.outer_lever
    w = np.empty(3)
    for i in range(3):
        w[i] = work.rate[i]
        for j in range(3):
            w[i] -= C[j, i] * earth[j]
    arm = np.array([w[1] * r[2] - w[2] * r[1], w[2] * r[0] - w[0] * r[2], w[0] * r[1] - w[1] * r[0]])
    u = C @ arm
    for i in range(3):
        z[i] = u[i] - work.velocity[i]
        H[i, 3 + i] = 1.0
        H[i, 36] = -(C[i, 1] * w[2] - C[i, 2] * w[1])
        H[i, 37] = -(C[i, 2] * w[0] - C[i, 0] * w[2])
        H[i, 38] = -(C[i, 0] * w[1] - C[i, 1] * w[0])
        lever = np.array(
            [
                C[i, 1] * r[2] - C[i, 2] * r[1],
                C[i, 2] * r[0] - C[i, 0] * r[2],
                C[i, 0] * r[1] - C[i, 1] * r[0],
            ]
        )
        for p in range(12):
            s = 0.0
            for j in range(3):
                s += lever[j] * work.rate_jacobian[j, p]
            H[i, 9 + p] = s
    H[0, 1], H[0, 2], H[1, 2] = -u[2], u[1], -u[0]
    H[1, 0], H[2, 0], H[2, 1] = u[2], -u[1], u[0]
    return np.asarray(u)
