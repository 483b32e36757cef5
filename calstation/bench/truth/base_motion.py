"""Motion of the table's base beyond its white vibration: sway, slow motion, rocking, and creep after a move."""

from dataclasses import dataclass, field

import numpy as np
from pydantic import BaseModel, ConfigDict

from calstation.bench.truth.effects import NonNegative, Positive
from calstation.physics import FloatArray


class TableMotion(BaseModel):
    """Settings of the motion of the table; `docs/reference/bench.md` explains every entry."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    sway_mm_s: NonNegative = 0.0
    sway_hz: Positive = 8.0
    slow_mm_s: NonNegative = 0.0
    slow_s: Positive = 1.0
    rocking_urad: NonNegative = 0.0
    rocking_hz: Positive = 3.0
    creep_urad: float = 0.0
    creep_s: Positive = 10.0


@dataclass
class BaseMotion:
    """The motion of the base, which is continuous over successive calls.

    The sway, with the rms velocity `sway_mm_s` along each horizontal axis of n, and the rocking, with the amplitude
    `rocking_urad` about each horizontal axis, are sinusoidal. The slow motion is a moving mean over `slow_s` of white
    velocity noise, with the rms `slow_mm_s` along each axis. After every move, the table turns by `creep_urad` about
    the east axis with the time constant `creep_s`, in alternating directions.
    """

    settings: TableMotion
    interval: float  #: True duration of a sample, s.
    random: np.random.Generator
    _white: FloatArray = field(init=False)
    _phase: FloatArray = field(init=False)
    #: End of the last move, s, sum of the earlier creep, and amplitude of the current creep, rad.
    _rest: float = -np.inf
    _angle: float = 0.0
    _creep: float = 0.0

    def __post_init__(self) -> None:
        self._width = max(round(self.settings.slow_s / self.interval), 1)
        self._white = self.random.standard_normal((self._width, 3))
        self._phase = self.random.uniform(0.0, 2.0 * np.pi, (2, 2))

    @property
    def is_tilting(self) -> bool:
        """Whether the base rotates."""
        return bool(self.settings.rocking_urad or self.settings.creep_urad)

    def velocity(self, first: int, count: int) -> FloatArray:
        """Return the velocity in n at the borders of `count` samples from number `first` on, m/s, shape (n + 1, 3)."""
        s, velocity = self.settings, np.zeros((count + 1, 3))
        velocity[:, :2] += 1e-3 * s.sway_mm_s * np.sqrt(2.0) * self._sines(s.sway_hz, self._phase[0], first, count)
        if s.slow_mm_s:
            white = np.vstack([self._white, self.random.standard_normal((count, 3))])
            total = np.cumsum(np.vstack([np.zeros((1, 3)), white]), axis=0)
            velocity += 1e-3 * s.slow_mm_s * (total[self._width :] - total[: -self._width]) / np.sqrt(self._width)
            self._white = white[-self._width :]
        return velocity

    def tilt(self, first: int, count: int, rest_time: float) -> FloatArray:
        """Return the rotation vector of the base at the borders of samples, rad, shape (n + 1, 3).

        `rest_time` is the time at which the last move ends, s.
        """
        s, tilt = self.settings, np.zeros((count + 1, 3))
        tilt[:, :2] = 1e-6 * s.rocking_urad * self._sines(s.rocking_hz, self._phase[1], first, count)
        times = (first + np.arange(count + 1)) * self.interval
        if rest_time != self._rest:
            self._angle += self._creep * float(-np.expm1(-max(times[0] - self._rest, 0.0) / s.creep_s))
            self._rest, self._creep = rest_time, -np.copysign(1e-6 * s.creep_urad, self._creep)
        tilt[:, 0] += self._angle - self._creep * np.expm1(-np.maximum(times - self._rest, 0.0) / s.creep_s)
        return tilt

    def _sines(self, frequency: float, phase: FloatArray, first: int, count: int) -> FloatArray:
        times = (first + np.arange(count + 1))[:, None] * self.interval
        return np.asarray(np.sin(2.0 * np.pi * frequency * times + phase))
