"""The filter in closed loop: corrections of attitude and velocity are fed back after every group of observations.

It serves the live display of a stage, a first pass whose linearisation point is far from the solution, and covariance
analysis. Its Kalman algebra is filterpy's.
"""

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from calstation.estimation.common import StageData, Start
from calstation.estimation.navigation.navigation_pass import NavigationPass
from calstation.estimation.navigation.small_matrices import cholesky, forward
from calstation.estimation.navigation.velocity_group import OBSERVED, Reference, VelocityGroup, observe
from calstation.physics import DV, PHI, FloatArray, rotate

if TYPE_CHECKING:
    from filterpy.kalman import KalmanFilter

#: The closed loop follows no reference.
_NONE = Reference(np.empty((0, 3, 3)), np.empty((0, 3)))


class ClosedLoopFilter(NavigationPass):
    """A pass that closes the loop on the observations only, not on the mean of the prior.

    The mean x is the sum of an offset and a correction. The offset is the mean that would result if every observation
    agreed with the linearisation point; it remains in x and decays with each observation. Only the correction is
    applied to the strapdown solution, which therefore stays near the levelled start from the first sample on.
    """

    def begin(self, data: StageData, start: Start, attitude: FloatArray) -> None:
        """Start or restart at rest: reset the navigation states and keep the parameters."""
        self._reset(start, attitude)
        self._offset = self.state.x.copy()
        self._observe_start(data, start.begin)

    def observe(self, data: StageData, first: int, count: int, groups: int = 1) -> None:
        """Process groups of `count` observations from sample `first`: strapdown, prediction, update and feedback."""
        self.group = group = self._group(count)
        for g in range(groups):
            start = first + g * count * self.stride
            motion = self._motion(data)
            observe(self.constants, self.setting, motion, start, _NONE, self.arm_velocity, self.work, group)
            innovation = self._update(group)
            index = start + self.stride * np.arange(1, count + 1)
            self._history.append((index, group.attitude.copy(), group.rate.copy(), innovation.reshape(-1, 3)))

    @cached_property
    def _kalman(self) -> "KalmanFilter":
        # the import takes 0.8 s, mostly scipy.stats, and only a pass that closes the loop needs it
        from filterpy.kalman import KalmanFilter

        return KalmanFilter(dim_x=len(self.state.x), dim_z=3 * self.group_size)

    def _update(self, group: VelocityGroup) -> FloatArray:
        """Predict and update the mean and covariance, and close the loop; return the decorrelated innovations, (r,).

        `update_correlated` implements

            S = H P Hᵀ + H M + Mᵀ Hᵀ + R,   K = (P Hᵀ + M) S⁻¹,   P⁺ = P − K (H P + Mᵀ)

        where M is the covariance of the noise of the observations with the process noise of the interval that *ends*
        with them, which `predict` has just added (Y. Bar-Shalom, X. R. Li, T. Kirubarajan, *Estimation with
        Applications to Tracking and Navigation*, 2001, section 8.3), not with that of the interval that follows.

        It inverts S, does not keep P symmetric, and does not check shapes: with a column x and a flat z, the innovation
        would become a matrix. Therefore x and z are flat, P is made symmetric, and the observations are decorrelated
        first, so that S is the identity: its condition number of up to 1e5 in the first groups would cost four digits.
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
        # the loop
        offset = group.transition @ self._offset
        self._offset = offset - kalman.K @ (H @ offset)
        correction = x - self._offset
        self.work.velocity[:] += correction[DV]
        rotate(correction[PHI], self.work.attitude)
        x[:OBSERVED] = self._offset[:OBSERVED]
        return np.asarray(kalman.y)
