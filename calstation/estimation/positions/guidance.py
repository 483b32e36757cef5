"""Guides who carries a unit from position to position: still, moving, enough, or again because it moved too soon.

Judged in quarters of a second by the stream itself: what is the quietest so far is the noise at rest, and a window
much louder, or whose mean rate is not the one at rest, moves. Whatever the solver later takes for a rest lasted here.
A rest counts as another position only where the unit has turned since the last one: a knock makes no position.
"""

from collections import deque
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from calstation.estimation.common.context import ImuModel
from calstation.estimation.common.samples import SampleBlock, joined
from calstation.estimation.common.stage_data import REST_MARGIN, REST_WINDOW
from calstation.physics.arrays import FloatArray
from calstation.physics.rotation import rotation_matrix, rotation_vector

WINDOW = 0.25
#: A window so many times as noisy as the quietest moves.
LOUD = 3.0
#: And every window with more gyro noise than this, rad/s rms.
LOUDEST = np.deg2rad(1.0)
#: A mean rate further from that at rest moves, rad/s.
RATE = np.deg2rad(0.3)
#: Windows before anything is said to rest.
LEARNING = 8
#: Windows, 20 minutes of them, that tell noise and rate at rest: a night at one position must not slow a run.
REMEMBERED = 4800

#: A unit that has turned by less since its last rest still lies at the same position, rad.
SAME = np.deg2rad(10.0)
#: Positions suffice once the worst known combination of accelerometer errors shows so strongly in a mean one, where
#: directions all over the sphere would reach 0.26.
SPREAD = 0.1
#: And once the unit has turned so far about every axis, rad, root of the sum of squares over its motions.
TURNED = 2.0

State = Literal["waiting", "moving", "still", "enough", "repeat"]


@dataclass(frozen=True)
class Guidance:
    """What to tell the operator.

    state : waiting (for the first rest), moving, still (rest on), enough (go on), repeat (it moved too soon)
    rest, wanted : how long it has rested here, and how long it is to rest, s
    up : measured direction of gravity in b, shape (3,); positions : that of every position done, shape (k, 3)
    suffices : whether what is done tells all that can be told: well spread, and turned about every axis
    """

    state: State
    rest: float
    wanted: float
    up: FloatArray
    positions: FloatArray
    suffices: bool


@dataclass
class _Position:
    """The rest that is going on: windows so far and the sum of their mean forces."""

    windows: int = 0
    force: FloatArray = field(default_factory=lambda: np.zeros(3))


class PositionGuide:
    """Follows the stream of one unit.

    Parameters
    ----------
    imu : its stream; wanted : rest at each position, s
    """

    def __init__(self, imu: ImuModel, wanted: float) -> None:
        per_count = imu.sample_rate if imu.output == "increment" else 1.0
        self._scale = np.repeat([imu.gyro_lsb, imu.accel_lsb], 3) * per_count
        self._width = max(round(WINDOW * imu.sample_rate), 4)
        self._seconds = self._width / imu.sample_rate
        self.ask(wanted)
        self._waiting: list[SampleBlock] = []
        self._noise: deque[float] = deque(maxlen=REMEMBERED)
        self._rates: deque[FloatArray] = deque(maxlen=REMEMBERED)
        self._here = _Position()
        self._done: list[FloatArray] = []
        self._state: State = "waiting"
        self._up = np.array([0.0, 0.0, 1.0])
        self._last_seq: int | None = None
        self._turn: FloatArray | None = np.eye(3)  # since the last position; None where samples are missing
        self._turns = np.zeros((3, 3))  # sum of the motions' outer products
        self._suffices = False

    def ask(self, rest: float) -> None:
        """From now on positions are to rest so long, s."""
        # the solver judges in windows of its own and cuts both ends of what it finds
        self._wanted = rest + 2.0 * REST_MARGIN + REST_WINDOW

    @property
    def now(self) -> Guidance:
        """Where things stand."""
        return Guidance(
            self._state,
            self._here.windows * self._seconds,
            self._wanted,
            self._up,
            np.array(self._done).reshape(-1, 3),
            self._suffices,
        )

    def feed(self, block: SampleBlock) -> Guidance:
        """Take further samples; blocks may come in any size."""
        self._waiting.append(block)
        if sum(map(len, self._waiting)) >= self._width:
            whole = joined(self._waiting)
            last = len(whole) // self._width * self._width
            for start in range(0, last, self._width):
                part = whole.part(start, start + self._width)
                whole_part = self._follows(part)
                self._window(part.counts * self._scale, whole_part and bool(part.valid.all()))
            self._waiting = [whole.part(last, len(whole))]
        return self.now

    def _follows(self, part: SampleBlock) -> bool:
        """Whether no sample is missing before or in a window."""
        first = int(part.seq[0]) if self._last_seq is None else self._last_seq + 1
        self._last_seq = int(part.seq[-1])
        whole = self._last_seq - first + 1 == len(part)
        if not whole:
            self._turn = None
        return whole

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
            if self._turn is not None:
                self._turn = self._turn @ rotation_matrix((rate - at_rest) * self._seconds)

    def _elsewhere(self, force: FloatArray) -> bool:
        """Whether this force is that of another position than the one that rests."""
        mean = self._here.force / self._here.windows
        return bool(np.linalg.norm(force - mean) > 0.05 * np.linalg.norm(mean))

    def _rests(self, force: FloatArray) -> None:
        self._here.windows += 1
        self._here.force = self._here.force + force
        if self._state == "enough" or self._still_there():
            self._state = "enough"
        elif self._here.windows * self._seconds >= self._wanted:
            self._count()
        else:
            self._state = "still"

    def _still_there(self) -> bool:
        """Whether this is the position counted last."""
        if not self._done:
            return False
        tilt = np.arccos(np.clip(self._up @ self._done[-1], -1.0, 1.0))
        turned = 0.0 if self._turn is None else np.linalg.norm(rotation_vector(self._turn))
        return bool(max(tilt, turned) < SAME)

    def _count(self) -> None:
        """This position is done."""
        self._state = "enough"
        if self._done and self._turn is not None:
            turn = rotation_vector(self._turn)
            self._turns += np.outer(turn, turn)
        self._turn = np.eye(3)
        self._done.append(self._here.force / np.linalg.norm(self._here.force))
        self._suffices = bool(
            np.linalg.eigvalsh(self._turns)[0] >= TURNED**2 and spread(np.array(self._done)) >= SPREAD
        )

    def _moves(self) -> None:
        too_soon = self._state == "still" and self._here.windows * self._seconds > REST_WINDOW
        if too_soon or (self._state == "repeat" and not self._here.windows):
            self._state = "repeat"
        elif self._state != "waiting":
            self._state = "moving"
        self._here = _Position()


def spread(up: FloatArray) -> float:
    """How well directions of gravity in b tell nine accelerometer errors apart by its length alone.

    Parameters
    ----------
    up : unit vectors, shape (k, 3)

    Returns
    -------
    Root mean square that the worst combination of errors, of length 1 in units of g, shows over the positions.
    """
    x, y, z = up.T
    shown = np.column_stack([x * x, x * y, y * y, x * z, y * z, z * z, x, y, z])
    if len(shown) < shown.shape[1]:
        return 0.0
    return float(np.linalg.svd(shown, compute_uv=False)[-1] / np.sqrt(len(shown)))
