"""Correction of the sensors' output by a unit's registers, after the documentation of each unit."""

from dataclasses import dataclass

import numpy as np

from calstation.physics import FloatArray

#: Iterations for the second-order term; each reduces its error by a factor of about 10^-5.
_ROUNDS = 4


@dataclass(frozen=True)
class Correction:
    """rate = gyro · (measured − before) + after; force = accel · (measured − bias − quadratic force²) + size effect.

    Matrices of shape (3, 3) and vectors of shape (3,), SI. `levers` displace each accelerometer along its own axis.
    """

    gyro: FloatArray
    before: FloatArray
    after: FloatArray
    accel: FloatArray
    bias: FloatArray
    quadratic: FloatArray
    levers: FloatArray

    def applied(self, measured: FloatArray) -> FloatArray:
        """Rate (rad/s) and force (m/s²) of samples of both, shape (n, 6)."""
        result = np.empty_like(measured)
        for n, sample in enumerate(measured):
            w = self.gyro @ (sample[:3] - self.before) + self.after
            straight = sample[3:] - self.bias
            f = self.accel @ straight
            for _ in range(_ROUNDS):
                f = self.accel @ (straight - self.quadratic * f * f)
            # An accelerometer displaced along its own axis senses the centripetal acceleration about the two others.
            outwards = np.array([w[1] ** 2 + w[2] ** 2, w[2] ** 2 + w[0] ** 2, w[0] ** 2 + w[1] ** 2])
            result[n, :3], result[n, 3:] = w, f + self.levers * outwards
        return result


class Requantiser:
    """Converts corrected output to the unit's counts; the remainder of an increment is carried to the next."""

    def __init__(self) -> None:
        self._left = np.zeros(6)

    def counts(self, values: FloatArray, scale: FloatArray, *, carry: bool) -> FloatArray:
        """Whole counts of `values`, shape (n, 6); `scale` is a count in the same units, shape (6,)."""
        exact = values / scale
        if not carry:
            return np.asarray(np.floor(exact + 0.5))
        whole = np.empty_like(exact)
        for n, row in enumerate(exact):
            wanted = row + self._left
            whole[n] = np.floor(wanted + 0.5)
            self._left = np.where(np.isfinite(wanted), wanted - whole[n], 0.0)
        return whole
