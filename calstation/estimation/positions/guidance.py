"""Guidance for an operator who moves a unit from position to position.

The solver also finds every rest that is accepted here. A rest is a new position only if the unit has rotated since the
last position, so a knock has no effect.
"""

from collections import deque
from dataclasses import dataclass
from typing import Literal

import numpy as np

from calstation.estimation.common import REST_MARGIN, REST_WINDOW, ImuModel, SampleBlock, join_blocks
from calstation.physics import FloatArray, rotation_matrix, rotation_vector

#: Duration of a window, s.
WINDOW = 0.25
#: Largest gyro noise of a window at rest, relative to the quietest windows, and absolute, rad/s rms.
NOISE_RATIO, MAX_NOISE = 3.0, np.deg2rad(1.0)
#: Largest difference of a window's mean rate from the rate at rest, rad/s.
MAX_RATE_DIFFERENCE = np.deg2rad(0.3)
#: Number of windows before the first decision.
MIN_WINDOWS = 8
#: Largest number of windows (20 minutes) from which noise and rate at rest are computed, to limit the computing time.
MAX_WINDOWS = 4800
#: Largest rotation since the last rest at which the unit is still in the same position, rad.
MAX_SAME_POSITION_ROTATION = np.deg2rad(10.0)
#: Sufficient `spread` of the positions; directions distributed over the whole sphere have about 0.26.
MIN_SPREAD = 0.1
#: Sufficient rotation about every axis, root of the sum of squares over the motions, rad.
MIN_ROTATION = 2.0

State = Literal["waiting", "moving", "still", "enough", "repeat"]


@dataclass(frozen=True)
class Guidance:
    """Instruction for the operator."""

    #: ``waiting`` (for the first rest), ``moving``, ``still`` (too short), ``enough`` or ``repeat`` (moved too soon).
    state: State
    rest: float  #: Time at rest so far, s.
    required: float  #: Required time at rest, s.
    up: FloatArray  #: Measured direction of up (of the specific force at rest) in b, unit vector, shape (3,).
    positions: FloatArray  #: Directions of up in b at the completed positions, shape (k, 3).
    suffices: bool  #: Whether the positions are well distributed and the unit has rotated about every axis.


class PositionGuide:
    """Monitors the stream of one unit; `required` is the required rest at each position, s."""

    def __init__(self, imu: ImuModel, required: float) -> None:
        self._scale = imu.count_size
        self._width = max(round(WINDOW * imu.sample_rate), 4)
        self._window_duration = self._width / imu.sample_rate
        self.set_required_rest(required)
        self._pending: list[SampleBlock] = []
        self._noise: deque[float] = deque(maxlen=MAX_WINDOWS)
        self._rates: deque[FloatArray] = deque(maxlen=MAX_WINDOWS)
        #: Number of windows of the current rest, and the sum of their mean forces.
        self._windows, self._force = 0, np.zeros(3)
        self._positions: list[FloatArray] = []
        self._state: State = "waiting"
        self._up = np.array([0.0, 0.0, 1.0])
        self._last_seq: int | None = None
        self._turn: FloatArray | None = np.eye(3)  # rotation since the last position; None if samples are missing
        self._turns = np.zeros((3, 3))  # sum of the outer products of the rotation vectors
        self._suffices = False

    def set_required_rest(self, rest: float) -> None:
        """Set the required rest at all following positions, s."""
        # the solver uses different windows and omits both ends of a rest
        self._required = rest + 2.0 * REST_MARGIN + REST_WINDOW

    @property
    def now(self) -> Guidance:
        """The current instruction."""
        return Guidance(
            self._state,
            self._windows * self._window_duration,
            self._required,
            self._up,
            np.array(self._positions).reshape(-1, 3),
            self._suffices,
        )

    def feed(self, block: SampleBlock) -> Guidance:
        """Add samples, in blocks of any length, and return the current instruction."""
        self._pending.append(block)
        if sum(map(len, self._pending)) >= self._width:
            joined = join_blocks(self._pending)
            last = len(joined) // self._width * self._width
            for start in range(0, last, self._width):
                part = joined.part(start, start + self._width)
                complete = self._check_sequence(part)
                self._process_window(part.counts * self._scale, complete and bool(part.valid.all()))
            self._pending = [joined.part(last, len(joined))]
        return self.now

    def _check_sequence(self, part: SampleBlock) -> bool:
        """Return whether no sample is missing before or within a window; otherwise discard the rotation."""
        first = int(part.seq[0]) if self._last_seq is None else self._last_seq + 1
        self._last_seq = int(part.seq[-1])
        complete = self._last_seq - first + 1 == len(part)
        if not complete:
            self._turn = None
        return complete

    def _process_window(self, values: FloatArray, valid: bool) -> None:
        gyro, force = values[:, :3], values[:, 3:].mean(axis=0)
        noise = float(np.sqrt(gyro.var(axis=0, ddof=1).mean()))
        rate = gyro.mean(axis=0)
        self._up = force / max(float(np.linalg.norm(force)), 1e-12)
        self._noise.append(noise)
        quiet = valid and noise < min(NOISE_RATIO * float(np.quantile(self._noise, 0.1)), MAX_NOISE)
        if quiet:
            self._rates.append(rate)
        if len(self._noise) < MIN_WINDOWS:
            return
        at_rest = np.median(self._rates, axis=0) if self._rates else rate
        still = quiet and float(np.abs(rate - at_rest).max()) < MAX_RATE_DIFFERENCE + 3.0 * noise / np.sqrt(self._width)
        mean = self._force / max(self._windows, 1)
        if still and not (self._windows and np.linalg.norm(force - mean) > 0.05 * np.linalg.norm(mean)):
            self._add_rest_window(force)
        else:
            self._add_moving_window()
            if self._turn is not None:
                self._turn = self._turn @ rotation_matrix((rate - at_rest) * self._window_duration)

    def _add_rest_window(self, force: FloatArray) -> None:
        self._windows += 1
        self._force = self._force + force
        if self._state == "enough" or self._is_last_position():
            self._state = "enough"
        elif self._windows * self._window_duration >= self._required:
            self._add_position()
        else:
            self._state = "still"

    def _is_last_position(self) -> bool:
        """Return whether the unit is still at the last completed position."""
        if not self._positions:
            return False
        tilt = np.arccos(np.clip(self._up @ self._positions[-1], -1.0, 1.0))
        rotation = 0.0 if self._turn is None else np.linalg.norm(rotation_vector(self._turn))
        return bool(max(tilt, rotation) < MAX_SAME_POSITION_ROTATION)

    def _add_position(self) -> None:
        """Add the current rest to the completed positions."""
        self._state = "enough"
        if self._positions and self._turn is not None:
            turn = rotation_vector(self._turn)
            self._turns += np.outer(turn, turn)
        self._turn = np.eye(3)
        self._positions.append(self._force / np.linalg.norm(self._force))
        self._suffices = bool(
            np.linalg.eigvalsh(self._turns)[0] >= MIN_ROTATION**2 and spread(np.array(self._positions)) >= MIN_SPREAD
        )

    def _add_moving_window(self) -> None:
        too_soon = self._state == "still" and self._windows * self._window_duration > REST_WINDOW
        if too_soon or (self._state == "repeat" and not self._windows):
            self._state = "repeat"
        elif self._state != "waiting":
            self._state = "moving"
        self._windows, self._force = 0, np.zeros(3)


def spread(up: FloatArray) -> float:
    """Return the observability of nine accelerometer errors from directions of up in b, shape (k, 3).

    It is the rms effect on the magnitude of gravity, in g, of the least observable combination of errors with norm 1 g;
    0 for fewer than nine directions.
    """
    x, y, z = up.T
    effects = np.column_stack([x * x, x * y, y * y, x * z, y * z, z * z, x, y, z])
    if len(effects) < effects.shape[1]:
        return 0.0
    return float(np.linalg.svd(effects, compute_uv=False)[-1] / np.sqrt(len(effects)))
