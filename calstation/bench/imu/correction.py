"""Correction of the sensor output by a unit's registers, according to the documentation of each unit."""

from dataclasses import dataclass, field

import numpy as np

from calstation.physics import FloatArray

#: Iterations for the second-order term; each reduces its error by a factor of about 10^-5.
_ROUNDS = 4


@dataclass(frozen=True)
class Correction:
    """rate = gyro · (measured − before) + after; force = accel · (measured − bias − Q force² − K force³) + size effect.

    Q and K are `quadratic` and `cubic`.
    Matrices have shape (3, 3), vectors shape (3,), SI. `levers` are the accelerometers' offsets along their own axes.
    """

    gyro: FloatArray
    before: FloatArray
    after: FloatArray
    accel: FloatArray
    bias: FloatArray
    quadratic: FloatArray
    levers: FloatArray
    cubic: FloatArray = field(default_factory=lambda: np.zeros(3))

    def applied(self, measured: FloatArray) -> FloatArray:
        """Return the corrected rate (rad/s) and force (m/s²) of measured samples; both arrays have shape (n, 6)."""
        rate = _times(self.gyro, measured[:, :3] - self.before) + self.after
        straight = measured[:, 3:] - self.bias
        force = _times(self.accel, straight)
        for _ in range(_ROUNDS):
            force = _times(self.accel, straight - self.quadratic * force * force - self.cubic * force**3)
        # An accelerometer displaced along its own axis senses the centripetal acceleration about the two others.
        squares = rate * rate
        outwards = squares[:, [1, 2, 0]] + squares[:, [2, 0, 1]]
        return np.hstack([rate, force + self.levers * outwards])


def _times(matrix: FloatArray, rows: FloatArray) -> FloatArray:
    """Multiply each row by a matrix with results that, unlike BLAS, do not depend on the length of the block."""
    return np.asarray((rows[:, None, :] * matrix).sum(axis=2))


class Requantiser:
    """Converts corrected output to the unit's counts; the rounding remainder of an increment is carried to the next."""

    def __init__(self) -> None:
        self._remainder = np.zeros(6)

    def counts(self, values: FloatArray, scale: FloatArray, *, carry: bool) -> FloatArray:
        """Convert `values`, shape (n, 6), to whole counts; `scale`, shape (6,), is the size of a count."""
        exact = values / scale
        if not carry or not len(exact):
            return np.asarray(np.floor(exact + 0.5))
        finite = np.isfinite(exact)
        numbers = np.where(finite, exact, 0.0)
        base = np.floor(numbers)  # only fractions are summed, because the rounding error of a large sum would grow
        total = self._remainder + np.cumsum(numbers - base, axis=0)
        rounded = np.floor(total + 0.5)
        whole = base + np.diff(rounded, axis=0, prepend=0.0)
        self._remainder = total[-1] - rounded[-1]
        return np.where(finite, whole, exact)
