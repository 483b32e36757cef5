"""What both passes of the 39-state filter over a stage have in common: states, start at rest, observations.

The states are φ, δv, δp, the errors of the 30 parameters and, if the profile specifies bias instability, the drift of
the six biases about their constants. The observation is the velocity of the table's centre of rotation,
`v − C (ω_nb × outer_lever)`, which is zero except for vibration of the base (Groves, *Principles of GNSS, Inertial and
Multisensor Integrated Navigation Systems*, 2nd ed., ch. 3, 14; resets: Savage, *Strapdown Analytics*, 2nd ed., ch. 15).

The 12 states of azimuth flips are φ, δv and the biases; the other parameters are consider states of the same filter.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from calstation.estimation.common import BIAS_DRIFT_TIME, Posterior, SolveContext, StageData, Start, filter_noise
from calstation.estimation.navigation.group_update import State
from calstation.estimation.navigation.velocity_group import BIAS, Setting, VelocityGroup, observation, velocity_group
from calstation.physics import (
    NAVIGATION,
    OUTER_LEVER,
    PARAMETER_STATES,
    PHI,
    STATES,
    FloatArray,
    Increments,
    IntArray,
    compensation,
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


class NavigationPass(ABC):
    """One pass over a stage: processes groups of observations in order; provides `posterior`, `history` and `attitude`.

    `point` contains the parameters of the linearisation, SI, shape (30,).
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
        self._moved: tuple[StageData, Increments] | None = None
        self._history: list[tuple[FloatArray | IntArray, ...]] = [
            (np.empty(0, np.int64), np.empty((0, 3, 3)), np.empty((0, 3)), np.empty((0, 3)))
        ]
        #: Number of observations in a group.
        self.group_size = max(round(GROUP_TIME / (self.stride * self.dt)), 1)
        self._groups: dict[int, VelocityGroup] = {}
        #: The last group of observations.
        self.group: VelocityGroup
        self._has_drift = bool(np.any(self.noise.bias_drift))
        size = STATES + len(BIAS) if self._has_drift else STATES
        x, P = np.zeros(size), np.zeros((size, size))
        x[PARAMETER_STATES] = prior.mean - point
        P[PARAMETER_STATES, PARAMETER_STATES] = prior.covariance
        if self._has_drift:
            bias_drift = np.arange(STATES, size)
            P[bias_drift, bias_drift] = self.noise.bias_drift**2
        self.state = State(x, P)
        lever = float(np.sum((point[OUTER_LEVER]) ** 2))
        variance = self.noise.velocity + lever * self.noise.end_rate
        self.setting = Setting(
            self.earth, self.gravity, self.dt, self.stride, self.noise.rate, self.noise.force, variance
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
        """Start or restart at rest: reset the navigation states and keep the parameters.

        `attitude` is the C_bn of the linearisation.
        """

    @abstractmethod
    def observe(self, data: StageData, first: int, count: int, groups: int = 1) -> None:
        """Process groups of `count` observations from sample `first`."""

    def run(self, data: StageData, start: Start, attitude: FloatArray) -> None:
        """Process a whole segment, see `steps`."""
        for _ in self.steps(data, start, attitude):
            pass

    def steps(self, data: StageData, start: Start, attitude: FloatArray, together: int = 200) -> Iterator[int]:
        """Process a whole segment in intervals of the stride; a remainder shorter than an interval is omitted.

        Yields 0 after the start, and then the number of groups that were processed, `together` or fewer.

        Parameters
        ----------
        data, start : samples of the stage, and start of the segment
        attitude : C_bn of the linearisation at the start, shape (3, 3)
        together : number of groups that are processed at a time
        """
        self.begin(data, start, attitude)
        yield 0
        observations = (start.end - start.begin) // self.stride
        done = 0
        while done < observations:
            count = min(self.group_size, observations - done)
            groups = min(together, (observations - done) // count)
            self.observe(data, start.begin + done * self.stride, count, groups)
            done += groups * count
            yield groups

    def _reset(self, start: Start, attitude: FloatArray) -> None:
        """Reset the navigation states to the prior of a start, relative to the attitude of the linearisation."""
        x, P = self.state
        x[NAVIGATION] = 0.0
        x[PHI] = rotation_vector(start.prior @ attitude.T)
        P[NAVIGATION, :] = 0.0
        P[:, NAVIGATION] = 0.0
        variances = [*start.prior_sigma**2, *[START_VELOCITY_SIGMA**2] * 3, *[POSITION_SIGMA**2] * 3]
        P[NAVIGATION, NAVIGATION] = np.diag(variances)
        self.work.attitude[:] = attitude
        self.work.velocity[:] = 0.0

    def _observe_start(self, data: StageData, begin: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Observe the velocity at rest; return Jacobian, Cholesky factor of the innovations and gain, as in `Updates`.

        The velocity is initially unknown and is observed immediately. Assuming zero would ignore the effect of the gyro
        bias uncertainty on the velocity of the lever arm.
        """
        x, P = self.state
        propagate(
            self.constants, self.earth, self.gravity, self.dt, self._motion(data), begin, begin, self.work
        )  # fmt: skip
        z, H = np.zeros(3), np.zeros((3, len(x)))
        self.arm_velocity[:] = observation(self.work, self.earth, self.constants, z, H)
        if self._has_drift:
            H[:, STATES:] = H[:, BIAS]
        # Joseph form, because the observation is much more accurate than the velocity before it
        R = np.eye(3) * self.setting.variance
        root = np.asarray(np.linalg.cholesky(H @ P @ H.T + R))
        gain = np.asarray(np.linalg.solve(root, H @ P))
        K = np.linalg.solve(root.T, gain).T
        x += K @ (z - H @ x)
        I_KH = np.eye(len(x)) - K @ H
        P[:] = I_KH @ P @ I_KH.T + K @ R @ K.T
        return H, root, gain

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
