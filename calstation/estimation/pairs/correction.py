"""Live correction of a secondary's samples: its stored errors, the primary's errors, and the lever arm."""

import numpy as np

from calstation.estimation.common import Secondary, StoredPair
from calstation.estimation.pairs.calibration import compensate_secondary, pair_vector
from calstation.estimation.pairs.filtering import lever_matrix
from calstation.estimation.pairs.fit import LEVER, OFFSET
from calstation.physics import Compensation, FloatArray

#: Time over which a parabola is fitted to the rates for the angular acceleration of the lever-arm term, s.
SLOPE_TIME = 0.02


class SecondaryCorrection:
    """Corrects a secondary with its stored calibration and then with the primary's errors `primary`."""

    def __init__(self, secondary: Secondary, primary: Compensation) -> None:
        self._size, self._dt, self._primary = secondary.imu.count_size, 1.0 / secondary.imu.sample_rate, primary
        self._width = max(2, round(SLOPE_TIME / self._dt))
        ago = np.arange(-self._width, 1) * self._dt
        self._slope = np.linalg.pinv(np.vander(ago, 3, increasing=True))[1]  # slope of the parabola at its end
        self._before = np.empty((0, 3))  # the last rates, at most `_width`
        self.use(secondary.stored)

    def use(self, stored: StoredPair) -> None:
        """Replace the calibration for the following samples."""
        self.stored, self._pair = stored, pair_vector(stored)

    @property
    def clock_offset(self) -> float:
        """Time to add to a sample's time to obtain the time of the motion it measures, s."""
        return float(self._pair[OFFSET])

    def corrected(self, counts: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the next samples as rate, rad/s, and specific force, m/s², at the primary, NaN where missing.

        `counts` are raw, shape (n, 6). Without a fitted lever arm, the force refers to the secondary's location. The
        angular acceleration is found from the last `SLOPE_TIME`, so that no sample is delayed; it is 0 next to missing
        samples.
        """
        raw = counts * self._size
        omega, force = compensate_secondary(self._pair, self._primary, raw[:, :3], raw[:, 3:])
        lever = self._pair[LEVER]
        if lever.any() and len(omega):
            earlier = self._before if len(self._before) else omega[:1]
            earlier = np.vstack([np.repeat(earlier[:1], self._width - len(earlier), axis=0), earlier])
            rates = np.vstack([earlier, omega])
            alpha = np.nan_to_num(
                np.lib.stride_tricks.sliding_window_view(rates, self._width + 1, axis=0) @ self._slope
            )
            force = force - lever_matrix(omega, alpha, self._dt) @ lever
            self._before = rates[-self._width :]
        return omega, force
