"""`SampleBlock`: the one form in which samples travel from driver or file to log and solver."""

import tempfile
import weakref
from collections.abc import Iterator
from dataclasses import dataclass, field, fields

import numpy as np

from calstation.physics.arrays import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class SampleBlock:
    """Consecutive IMU samples of one stage.

    Attributes
    ----------
    stage : name of the stage, "" between stages
    seq : unwrapped sample counter, shape (n,)
    time : IMU clock at the end of each sample, s, shape (n,)
    counts : raw output, gyro x y z then accel x y z, counts, shape (n, 6)
    angles : encoder angles outer, inner at the end of the sample, rad, cumulative, NaN between polls,
        shape (n, 2)
    step : number of the move the sample belongs to, shape (n,)
    valid : False marks a spoilt sample, shape (n,)
    temperature : °C, NaN where unknown, shape (n,)
    others : raw output of further IMUs on the same body, counts as `counts`, NaN where a sample of theirs is missing,
        shape (n, k, 6), k = 0 where the unit is alone
    joints : angles of a gimbal's joints x, y, z at the end of the sample, rad, NaN between polls, shape (n, 3), or
        (n, 0) where there is no gimbal
    """

    stage: str
    seq: IntArray
    time: FloatArray
    counts: FloatArray
    angles: FloatArray
    step: IntArray
    valid: BoolArray
    temperature: FloatArray
    others: FloatArray = field(default_factory=lambda: np.empty((0, 0, 6)))
    joints: FloatArray = field(default_factory=lambda: np.empty((0, 0)))

    def __post_init__(self) -> None:
        """Where a block has no further columns, as many rows of none."""
        if self.others.shape[1] == 0:
            object.__setattr__(self, "others", np.empty((len(self.seq), 0, 6)))
        if self.joints.shape[1] == 0:
            object.__setattr__(self, "joints", np.empty((len(self.seq), 0)))

    def __len__(self) -> int:
        return len(self.seq)

    def part(self, start: int, stop: int) -> "SampleBlock":
        """Samples start to stop as a block of their own (views)."""
        s = slice(start, stop)
        return SampleBlock(
            self.stage,
            self.seq[s],
            self.time[s],
            self.counts[s],
            self.angles[s],
            self.step[s],
            self.valid[s],
            self.temperature[s],
            self.others[s],
            self.joints[s],
        )


def joined(blocks: list[SampleBlock]) -> SampleBlock:
    """Consecutive blocks as one, of the first one's stage."""
    columns = {
        f.name: np.concatenate([getattr(b, f.name) for b in blocks])
        for f in fields(SampleBlock)
        if f.name != "stage"
    }
    return SampleBlock(blocks[0].stage, **columns)


def since(blocks: list[SampleBlock], seq: int) -> list[SampleBlock]:
    """The blocks from sequence number `seq` on, the first cut to it."""
    kept = [b for b in blocks if len(b) and b.seq[-1] >= seq]
    if kept:
        kept[0] = kept[0].part(int(kept[0].seq.searchsorted(seq)), len(kept[0]))
    return kept


#: Grid of encoder angles, rad (2e-7″), so coarse that degrees written in a file read back the same.
ANGLE_STEP = 2.0**-40


def snap_angles(angles: FloatArray) -> FloatArray:
    """Angles in rad rounded to `ANGLE_STEP`, any shape; NaN stays.

    Drivers, logs and file readers all hand out angles on this grid, so a solution does not depend on whether
    its angles went through a file in degrees.
    """
    return np.round(np.asarray(angles) / ANGLE_STEP) * ANGLE_STEP


#: Columns of every block; those that some have besides come after them.
_ROW = [
    ("seq", np.int64),
    ("time", np.float64),
    ("counts", np.float64, 6),
    ("angles", np.float64, 2),
    ("step", np.int64),
    ("valid", np.bool_),
    ("temperature", np.float64),
]
#: Rows read back at a time.
_CHUNK = 65_536


class Spool:
    """Samples of one stage in the order they came; the file goes with the object."""

    def __init__(self) -> None:
        self._file = tempfile.TemporaryFile(prefix="calstation-")  # noqa: SIM115 - lives as long as the spool
        weakref.finalize(self, self._file.close)
        self._stage = ""
        self._row = np.dtype(_ROW)
        self._empty = True

    def append(self, block: SampleBlock) -> None:
        """Put further samples aside, all with the same columns. Raises OSError where the disk is full."""
        if self._empty:
            self._row, self._empty = _row_of(block), False
        rows = np.empty(len(block), self._row)
        for name in self._row.names or ():
            rows[name] = getattr(block, name)
        self._stage = block.stage
        self._file.write(rows.tobytes())

    def blocks(self) -> Iterator[SampleBlock]:
        """All samples put aside so far."""
        self._file.seek(0)
        while data := self._file.read(_CHUNK * self._row.itemsize):
            rows = np.frombuffer(data, self._row)
            columns = {name: np.ascontiguousarray(rows[name]) for name in self._row.names or ()}
            yield SampleBlock(self._stage, **columns)


def _row_of(block: SampleBlock) -> np.dtype:
    """The columns that a block has."""
    more = [
        (name, np.float64, values.shape[1:])
        for name, values in (("others", block.others), ("joints", block.joints))
        if values.shape[1]
    ]
    return np.dtype([*_ROW, *more])
