"""What a unit's processor makes of its sensors' output by its registers, as each unit's own documentation has it."""

from dataclasses import dataclass

import numpy as np

from calstation.physics.arrays import FloatArray

#: In which the second-order term is worked off: its share of itself is some 10^-5.
_ROUNDS = 4


@dataclass(frozen=True)
class Correction:
    """rate = gyro · (measured − before) + after; force = accel · (measured − bias − quadratic force²) + size effect.

    Attributes
    ----------
    gyro, accel : shape (3, 3); before, after : rad/s, shape (3,)
    bias : m/s², shape (3,); quadratic : s²/m, shape (3,)
    levers : displacement of each accelerometer along its own axis, m, shape (3,)
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
            # An accelerometer out on its own axis feels what pulls it outwards about the two others.
            outwards = np.array([w[1] ** 2 + w[2] ** 2, w[2] ** 2 + w[0] ** 2, w[0] ** 2 + w[1] ** 2])
            result[n, :3], result[n, 3:] = w, f + self.levers * outwards
        return result


class Requantiser:
    """Puts corrected output into the unit's counts again; of increments what is left over goes into the next."""

    def __init__(self) -> None:
        self._left = np.zeros(6)

    def counts(self, values: FloatArray, scale: FloatArray, *, carry: bool) -> FloatArray:
        """Whole counts of `values` (rad/s and m/s²), shape (n, 6); `scale` : of a count, in the same, shape (6,)."""
        exact = values / scale
        if not carry:
            return np.asarray(np.floor(exact + 0.5))
        whole = np.empty_like(exact)
        for n, row in enumerate(exact):
            wanted = row + self._left
            whole[n] = np.floor(wanted + 0.5)
            self._left = np.where(np.isfinite(wanted), wanted - whole[n], 0.0)
        return whole
