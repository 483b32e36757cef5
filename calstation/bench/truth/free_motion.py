"""Free motion in closed form, with rotations about arbitrary axes and vibration of the reference point.

An attitude is a chain of constant rotations and turns about constant axes; the angle of each turn is a sum of pulses. A
pulse rises smoothly (minimum jerk; Flash and Hogan, J. Neurosci. 5, 1985) from 0 to its amount and may have a tremor, a
sum of sines multiplied by a window with flat ends. All have exact first and second derivatives, so that rate and
angular acceleration follow from the links as in `truth.table`, without integration:

    ω' = Rᵀω + a θ',    ω'' = Rᵀω'' − θ' a × (Rᵀω) + a θ''
"""

from dataclasses import dataclass

import numpy as np

from calstation.physics import FloatArray


@dataclass(frozen=True)
class Pulse:
    """A change from 0 to `amount` between `start` and `start + duration`, s, with a tremor.

    tremor : rows (amplitude, frequency Hz, phase rad), in the unit of `amount`, shape (k, 3)
    """

    start: float
    duration: float
    amount: float
    tremor: FloatArray

    def states(self, times: FloatArray) -> FloatArray:
        """Return the value and its first two derivatives at `times` (s, shape (n,)), shape (3, n)."""
        s = np.clip((times - self.start) / self.duration, 0.0, 1.0)
        inside = (s > 0.0) & (s < 1.0)
        first, second = 1.0 / self.duration, 1.0 / self.duration**2
        course = np.array(
            [
                s**3 * (10.0 - 15.0 * s + 6.0 * s**2),
                30.0 * s**2 * (1.0 - s) ** 2 * first,
                60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) * second,
            ]
        )
        result = self.amount * course
        if len(self.tremor):
            u, v = s * (1.0 - s), 1.0 - 2.0 * s
            window = 64.0 * np.array([u**3, 3.0 * u**2 * v * first, (6.0 * u * v**2 - 6.0 * u**2) * second])
            amplitude, omega, phase = (self.tremor[:, k, None] for k in range(3))
            omega = 2.0 * np.pi * omega
            angle = omega * times + phase
            sine = np.sum(amplitude * np.sin(angle), axis=0)
            cosine = np.sum(amplitude * omega * np.cos(angle), axis=0)
            curved = -np.sum(amplitude * omega**2 * np.sin(angle), axis=0)
            shaken = np.array(
                [
                    window[0] * sine,
                    window[1] * sine + window[0] * cosine,
                    window[2] * sine + 2.0 * window[1] * cosine + window[0] * curved,
                ]
            )
            result = result + shaken * inside
        return result


@dataclass(frozen=True)
class Course:
    """A quantity with the initial value `offset`, which is changed by pulses."""

    pulses: tuple[Pulse, ...] = ()
    offset: float = 0.0

    def states(self, times: FloatArray) -> FloatArray:
        """Return the value and its first two derivatives at `times` (s, shape (n,)), shape (3, n)."""
        total = np.zeros((3, len(times)))
        total[0] = self.offset
        for pulse in self.pulses:
            # a pulse is zero before its start and constant after its end, so it is evaluated only in between
            begin, end = np.searchsorted(times, [pulse.start, pulse.start + pulse.duration])
            total[:, begin:end] += pulse.states(times[begin:end])
            total[0, end:] += pulse.amount
        return total


@dataclass(frozen=True)
class Link:
    """A constant rotation (matrix, shape (3, 3)) followed by a turn about a constant unit axis."""

    before: FloatArray
    axis: tuple[float, float, float]
    course: Course


@dataclass(frozen=True)
class FreeMotion:
    """The motion of a body, C_b^n = Π before_j R(axis_j, θ_j(t)) · mount, and of its reference point.

    links : links from the outermost to the innermost
    mount : last rotation, shape (3, 3)
    shake : three courses whose second derivatives are the acceleration of the reference point in n, m/s²
    """

    links: tuple[Link, ...]
    mount: FloatArray
    shake: tuple[Course, Course, Course] = (Course(), Course(), Course())

    def states(
        self, times: FloatArray, up_force: FloatArray, earth: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return specific force at the point, m/s², ω_ib, rad/s, and its derivative, rad/s², in b, each (n, 3).

        Parameters
        ----------
        times : increasing times, s, shape (n,)
        up_force, earth : specific force at rest, m/s², and earth rate, rad/s, in n, shape (3,)
        """
        force = np.array([course.states(times)[2] for course in self.shake]).T + up_force
        rate = np.tile(earth, (len(times), 1))
        acceleration = np.zeros_like(rate)
        for link in self.links:
            axis = np.asarray(link.axis, dtype=np.float64)
            angle, first, second = link.course.states(times)
            force, rate, acceleration = (
                _rotate_back(axis, angle, v @ link.before) for v in (force, rate, acceleration)
            )
            acceleration = acceleration - first[:, None] * np.cross(axis, rate) + second[:, None] * axis
            rate = rate + first[:, None] * axis
        return force @ self.mount, rate @ self.mount, acceleration @ self.mount


def _rotate_back(axis: FloatArray, angle: FloatArray, vectors: FloatArray) -> FloatArray:
    """Return R(axis, angle)ᵀ v for each row v of `vectors`, shape (n, 3)."""
    sine, cosine = np.sin(angle)[:, None], np.cos(angle)[:, None]
    along = (vectors @ axis)[:, None] * axis
    return np.asarray(along + (vectors - along) * cosine - np.cross(axis, vectors) * sine)


def tremor(random: np.random.Generator, size: float) -> FloatArray:
    """Draw the sines of a hand tremor, 2 to 9 Hz, with total rms `size`, shape (4, 3); (0, 3) if `size` is 0."""
    if size == 0.0:
        return np.empty((0, 3))
    frequencies = random.uniform(2.0, 9.0, 4)
    weights = random.uniform(0.5, 1.0, 4) / frequencies
    amplitudes = size * weights / np.sqrt(0.5 * np.sum(weights**2))
    return np.column_stack([amplitudes, frequencies, random.uniform(0.0, 2.0 * np.pi, 4)])
