"""A pass of a solution: the filter along a smoothed trajectory with fixed parameters, compiled.

A six-state filter (φ, δv) and a Rauch-Tung-Striebel pass track the effect of gyro noise without the jumps of a filter,
so that the passes are Gauss-Newton steps (Bell, *The iterated Kalman smoother as a Gauss-Newton method*, SIAM J.
Optim. 4(3), 1994).
"""

import numba as nb
import numpy as np

from calstation.estimation.common import Posterior, SolveContext, StageData, Start
from calstation.estimation.navigation.group_update import Updates, process, updates
from calstation.estimation.navigation.navigation_pass import NavigationPass
from calstation.estimation.navigation.small_matrices import backward, cholesky, forward
from calstation.estimation.navigation.velocity_group import Reference, Setting, arm_motion, write_attitude_columns
from calstation.physics import STATES, Compensation, FloatArray, Increments, IntervalWork, propagate, rotate

#: Prior sigma of the initial heading, rad: small, because the parameters may be too inaccurate for gyrocompassing.
HEADING_SIGMA = 1e-4


@nb.njit(cache=True)
def smoothed_reference(
    c: Compensation,
    s: Setting,
    variance: float,
    motion: Increments,
    span: tuple[int, int],
    tilt_sigma: float,
    work: IntervalWork,
) -> Reference:
    """Compute the smoothed trajectory of a segment with fixed parameters, by a closed-loop filter and an RTS pass.

    Parameters
    ----------
    c, s : constants of the assumed parameters and of the pass
    variance : variance of the table's velocity, (m/s)²
    motion : increments of all samples with these parameters
    span : index of the first sample, and index after the last
    tilt_sigma : prior sigma of the tilt at the start, rad
    work : attitude at the start, whose heading is retained; overwritten

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
    """A pass that follows a smoothed trajectory and does not close the loop.

    The transitions along a trajectory that jumps at every observation have unobservable directions that differ by the
    size of the jumps, so a bias and a tilt of which only the sum is observable would appear to be observable separately
    (Huang, Mourikis, Roumeliotis, *Observability-based rules for designing consistent EKF SLAM estimators*, IJRR 29(5),
    2010).
    """

    #: How the last call of `observe` processed its groups.
    last: Updates
    _reference: Reference
    _begin: int  # index of its first sample

    def __init__(self, context: SolveContext, prior: Posterior, point: FloatArray) -> None:
        super().__init__(context, prior, point)
        #: All updates, in order.
        self.updates: list[Updates] = []

    def begin(self, data: StageData, start: Start, attitude: FloatArray) -> None:
        """Compute the reference of the segment, and start at rest: reset the navigation states, keep the parameters."""
        self._begin = start.begin
        self.work.attitude[:] = attitude
        self._reference = smoothed_reference(
            self.constants, self.setting, self.noise.velocity, self._motion(data),
            (start.begin, start.end), float(start.prior_sigma[0]), self.work,
        )  # fmt: skip
        self._reset(start, self._reference.attitude[0])
        H, root, gain = self._observe_start(data, start.begin)
        none = np.empty((1, 0, 0))
        self.updates.append(Updates(none, np.empty(0), H[None], root[None], gain[None], none[0], none, none[0]))

    def observe(self, data: StageData, first: int, count: int, groups: int = 1) -> None:
        """Process groups of `count` observations from sample `first`: strapdown, prediction and update."""
        self.group = group = self._group(count)
        self.last = updates(groups, count, np.diag(group.transition)[STATES:].copy())
        done = (first - self._begin) // self.stride + 1
        reference = Reference(*(values[done : done + groups * count] for values in self._reference))
        process(
            self.constants, self.setting, self._motion(data), first, reference, self.arm_velocity, self.work, group,
            self.state, self.last,
        )  # fmt: skip
        self.updates.append(self.last)
        index = first + self.stride * np.arange(1, groups * count + 1)
        self._history.append((index, self.last.attitude, self.last.rate, self.last.innovation.reshape(-1, 3)))
