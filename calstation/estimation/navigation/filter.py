"""The 39-state filter: one pass over a stage, linear in the parameters, closed loop in attitude and velocity.

The states are φ, δv, δp, the errors of the 30 parameters and, if the profile specifies bias instability, the drift of
the six biases about their constants. The observation is the velocity of the table's centre of rotation,
`v − C (ω_nb × outer_lever)`, which is zero except for vibration of the base (Groves, *Principles of GNSS, Inertial and
Multisensor Integrated Navigation Systems*, 2nd ed., ch. 3, 14; resets: Savage, *Strapdown Analytics*, 2nd ed., ch. 15).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from calstation.estimation.common import BIAS_DRIFT_TIME, Belief, SolveContext, StageData, Start, filter_noise
from calstation.estimation.navigation.group_update import State, Updates, process, updates
from calstation.estimation.navigation.reference import smoothed_reference
from calstation.estimation.navigation.velocity_group import BIAS, Setting, VelocityGroup, observation, velocity_group
from calstation.physics import (
    PARAMETER_START,
    STATES,
    FloatArray,
    Increments,
    IntArray,
    compensation,
    group_indices,
    increments,
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


#: Empty reference, which selects closed-loop operation.
_FREE = (np.empty((0, 3, 3)), np.empty((0, 3)))
#: Number of groups that are processed between two progress reports.
_TOGETHER = 200


class NavigationFilter:
    """One pass over a stage: processes groups of observations in order; provides `belief`, `history` and `attitude`.

    `point` contains the parameters of the linearisation, SI, shape (30,).

    The live display closes the loop: corrections of attitude and velocity are fed back immediately. A pass of a
    solution follows a smoothed `Reference` instead, and closes the loop only far from the solution. The transitions
    along a reference that jumps at every observation have unobservable directions that differ by the size of the jumps,
    so a bias and a tilt of which only the sum is observable would appear to be observable separately (Huang, Mourikis,
    Roumeliotis, *Observability-based rules for designing consistent EKF SLAM estimators*, IJRR 29(5), 2010).
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
        self._moved: tuple[StageData, Increments] | None = None
        self._history: list[tuple[FloatArray | IntArray, ...]] = [
            (np.empty(0, np.int64), np.empty((0, 3, 3)), np.empty((0, 3)), np.empty((0, 3)))
        ]
        #: All updates of a pass that follows a reference.
        self.updates: list[Updates] = []
        #: Number of observations in a group.
        self.group_size = max(round(GROUP_TIME / (self.stride * self.dt)), 1)
        self._groups: dict[int, VelocityGroup] = {}
        #: The last group of observations, and how the last call of `observe` processed its groups.
        self.group: VelocityGroup
        self.last: Updates
        self._has_drift = bool(np.any(self.noise.bias_drift))
        size = STATES + len(BIAS) if self._has_drift else STATES
        x, P = np.zeros(size), np.zeros((size, size))
        x[PARAMETER_START:STATES] = prior.mean - point
        P[PARAMETER_START:STATES, PARAMETER_START:STATES] = prior.covariance
        if self._has_drift:
            bias_drift = np.arange(STATES, size)
            P[bias_drift, bias_drift] = self.noise.bias_drift**2
        self.state = State(x, P, x.copy(), np.zeros(3))
        lever = float(np.sum((point[group_indices("outer_lever")]) ** 2))
        variance = self.noise.velocity + lever * self.noise.end_rate
        self.setting = Setting(
            self.earth, self.gravity, self.dt, self.stride, self.noise.rate, self.noise.force, variance
        )

    @property
    def belief(self) -> Belief:
        """Current posterior of the parameters."""
        s = slice(PARAMETER_START, STATES)
        return Belief(self.point + self.state.x[s], self.state.P[s, s].copy())

    @property
    def history(self) -> History:
        """All observations so far."""
        return History(*(np.concatenate(columns) for columns in zip(*self._history, strict=True)))

    def take_history(self) -> History:
        """Return and discard the observations since the last call."""
        found = self.history
        del self._history[1:]
        return found

    def begin(self, data: StageData, start: Start, attitude: FloatArray) -> None:
        """Start or restart at rest: reset the navigation states and keep the parameters.

        `attitude` is the C_bn of the linearisation. The velocity is initially unknown and is observed immediately.
        Assuming zero would ignore the effect of the gyro bias uncertainty on the velocity of the lever arm.
        """
        x, P = self.state.x, self.state.P
        x[:PARAMETER_START] = 0.0
        x[:3] = rotation_vector(start.prior @ attitude.T)
        P[:PARAMETER_START, :] = 0.0
        P[:, :PARAMETER_START] = 0.0
        variances = [*start.prior_sigma**2, *[START_VELOCITY_SIGMA**2] * 3, *[POSITION_SIGMA**2] * 3]
        P[range(PARAMETER_START), range(PARAMETER_START)] = variances
        self.state.offset[:] = x
        self.work.attitude[:] = attitude
        self.work.velocity[:] = 0.0
        propagate(
            self.constants, self.earth, self.gravity, self.dt, self._motion(data), start.begin, start.begin, self.work,
        )  # fmt: skip
        z, H = np.zeros(3), np.zeros((3, len(x)))
        self.state.arm_velocity[:] = observation(self.work, self.earth, self.constants, z, H)
        if self._has_drift:
            H[:, STATES:] = H[:, BIAS]
        # Joseph form, because the observation is much more accurate than the velocity before it
        R = np.eye(3) * self.setting.variance
        root = np.asarray(np.linalg.cholesky(H @ P @ H.T + R))
        gain = np.asarray(np.linalg.solve(root, H @ P))
        K = np.linalg.solve(root.T, gain).T
        x += K @ (z - H @ x)
        left = np.eye(len(x)) - K @ H
        P[:] = left @ P @ left.T + K @ R @ K.T
        none = np.empty((1, 0, 0))
        self.updates.append(Updates(none, np.empty(0), H[None], root[None], gain[None], none[0], none, none[0]))

    def observe(
        self,
        data: StageData,
        start: int,
        count: int,
        follow: tuple[FloatArray, FloatArray] | None = None,
        groups: int = 1,
    ) -> None:
        """Process groups of `count` observations: strapdown, prediction, update and feedback.

        `follow` contains the attitudes, shape (groups count, 3, 3), and velocities, m/s, shape (groups count, 3), of
        the reference; None closes the loop.
        """
        group = self._group(count)
        found = updates(groups, count, np.diag(group.transition)[STATES:].copy())
        process(
            self.constants, self.setting, self._motion(data), start, *(follow or _FREE), self.work, group, self.state,
            found,
        )  # fmt: skip
        index = start + self.stride * np.arange(1, groups * count + 1)
        self._history.append((index, found.attitude, found.rate, found.innovation.reshape(-1, 3)))
        self.group, self.last = group, found
        if follow is not None:
            self.updates.append(found)

    def _motion(self, data: StageData) -> Increments:
        """Return the increments of all samples, computed once for the same data."""
        if self._moved is None or self._moved[0] is not data:
            self._moved = data, increments(self.constants, self.dt, data.gyro, data.accel)
        return self._moved[1]

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

    @property
    def attitude(self) -> FloatArray:
        """Current estimate of C_bn, shape (3, 3)."""
        return np.asarray(rotation_matrix(self.state.x[:3]) @ self.work.attitude)

    def run(
        self,
        data: StageData,
        start: Start,
        attitude: FloatArray,
        smooth: bool,
        watch: Callable[["NavigationFilter"], None] | None = None,
        progress: Callable[[int], None] = lambda groups: None,
    ) -> None:
        """Process a whole segment in intervals of the stride; a remainder shorter than an interval is omitted.

        `attitude` is the C_bn of the linearisation at the start. With `smooth` the pass follows a smoothed reference
        and does not close the loop. `watch` is called after the start and after every group, `progress` periodically
        with the number of groups processed since its last call.
        """
        span = (start.begin, start.end, self.stride)
        reference = None
        if smooth:
            reference = smoothed_reference(
                self.constants, self.earth, self.gravity, self.noise, self._motion(data), self.dt, span, attitude,
                float(start.prior_sigma[0]),
            )  # fmt: skip
            attitude = reference.attitude[0]
        self.begin(data, start, attitude)
        if watch is not None:
            watch(self)
        observations = (start.end - start.begin) // self.stride
        done = 0
        while done < observations:
            count = min(self.group_size, observations - done)
            groups = 1 if watch is not None else min(_TOGETHER, (observations - done) // count)
            ends = slice(done + 1, done + groups * count + 1)
            follow = reference and (reference.attitude[ends], reference.velocity[ends])
            self.observe(data, start.begin + done * self.stride, count, follow, groups)
            done += groups * count
            progress(groups)
            if watch is not None:
                watch(self)
