"""Guides who carries a unit from position to position: still, moving, enough, or again because it moved too soon.

Judged in quarters of a second by the stream itself: what is the quietest so far is the noise at rest, and a window
much louder, or whose mean rate is not the one at rest, moves. Whatever the solver later takes for a rest lasted here.
"""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from calstation.estimation.context import ImuModel
from calstation.estimation.samples import SampleBlock, joined
from calstation.estimation.stage_data import REST_MARGIN, REST_WINDOW
from calstation.physics.arrays import FloatArray

WINDOW = 0.25
LOUD = 3.0
"""A window so many times as noisy as the quietest moves."""
LOUDEST = np.deg2rad(1.0)
"""And every window with more gyro noise than this, rad/s rms."""
RATE = np.deg2rad(0.3)
"""A mean rate further from that at rest moves, rad/s."""
LEARNING = 8
"""Windows before anything is said to rest."""

State = Literal["waiting", "moving", "still", "enough", "repeat"]


@dataclass(frozen=True)
class Guidance:
    """What to tell the operator.

    state : waiting (for the first rest), moving, still (rest on), enough (go on), repeat (it moved too soon)
    rest, wanted : how long it has rested here, and how long it is to rest, s
    up : measured direction of gravity in b, shape (3,); positions : that of every position done, shape (k, 3)
    """

    state: State
    rest: float
    wanted: float
    up: FloatArray
    positions: FloatArray


@dataclass
class _Position:
    """The rest that is going on: windows so far and the sum of their mean forces."""

    windows: int = 0
    force: FloatArray = field(default_factory=lambda: np.zeros(3))


class PositionGuide:
    """Follows the stream of one unit.

    Parameters
    ----------
    imu : its stream; wanted : rest at each position, s; first : rest at the first one, s
    """

    def __init__(self, imu: ImuModel, wanted: float, first: float) -> None:
        per_count = imu.sample_rate if imu.output == "increment" else 1.0
        self._scale = np.repeat([imu.gyro_lsb, imu.accel_lsb], 3) * per_count
        self._width = max(round(WINDOW * imu.sample_rate), 4)
        self._seconds = self._width / imu.sample_rate
        # the solver judges in windows of its own and cuts both ends of what it finds
        self._wanted, self._first = (seconds + 2.0 * REST_MARGIN + REST_WINDOW for seconds in (wanted, first))
        self._waiting: list[SampleBlock] = []
        self._noise: list[float] = []
        self._rates: list[FloatArray] = []
        self._here = _Position()
        self._done: list[FloatArray] = []
        self._state: State = "waiting"
        self._up = np.array([0.0, 0.0, 1.0])

    @property
    def now(self) -> Guidance:
        """Where things stand."""
        return Guidance(
            self._state,
            self._here.windows * self._seconds,
            self._target,
            self._up,
            np.array(self._done).reshape(-1, 3),
        )

    @property
    def _target(self) -> float:
        return self._wanted if self._done else self._first

    def feed(self, block: SampleBlock) -> Guidance:
        """Take further samples; blocks may come in any size."""
        self._waiting.append(block)
        if sum(map(len, self._waiting)) >= self._width:
            whole = joined(self._waiting)
            last = len(whole) // self._width * self._width
            for start in range(0, last, self._width):
                part = whole.part(start, start + self._width)
                self._window(part.counts * self._scale, bool(part.valid.all()))
            self._waiting = [whole.part(last, len(whole))]
        return self.now

    def _window(self, values: FloatArray, valid: bool) -> None:
        gyro, force = values[:, :3], values[:, 3:].mean(axis=0)
        noise = float(np.sqrt(gyro.var(axis=0, ddof=1).mean()))
        rate = gyro.mean(axis=0)
        self._up = force / max(float(np.linalg.norm(force)), 1e-12)
        self._noise.append(noise)
        quiet = valid and noise < min(LOUD * float(np.quantile(self._noise, 0.1)), LOUDEST)
        if quiet:
            self._rates.append(rate)
        if len(self._noise) < LEARNING:
            return
        at_rest = np.median(self._rates, axis=0) if self._rates else rate
        still = quiet and float(np.abs(rate - at_rest).max()) < RATE + 3.0 * noise / np.sqrt(self._width)
        if still and not (self._here.windows and self._elsewhere(force)):
            self._rests(force)
        else:
            self._moves()

    def _elsewhere(self, force: FloatArray) -> bool:
        """Whether this force is that of another position than the one that rests."""
        mean = self._here.force / self._here.windows
        return bool(np.linalg.norm(force - mean) > 0.05 * np.linalg.norm(mean))

    def _rests(self, force: FloatArray) -> None:
        self._here.windows += 1
        self._here.force = self._here.force + force
        if self._state != "enough":
            self._state = "still"
        if self._state == "still" and self._here.windows * self._seconds >= self._target:
            self._state = "enough"
            self._done.append(self._here.force / np.linalg.norm(self._here.force))

    def _moves(self) -> None:
        too_soon = self._state == "still" and self._here.windows * self._seconds > REST_WINDOW
        if too_soon or (self._state == "repeat" and not self._here.windows):
            self._state = "repeat"
        elif self._state != "waiting":
            self._state = "moving"
        self._here = _Position()
