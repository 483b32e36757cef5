"""Rows of samples of a recording by column, as the readers of all formats deliver them."""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calstation.estimation.common import LARGEST_VALUE, AngleUnwrapper, SampleBlock, snap_angles
from calstation.physics import CHANNELS, BoolArray, FloatArray, IntArray
from calstation.records.columns import ANGLES, CHAMBER, JOINTS, STATION, further_channels
from calstation.records.meta import FURTHER_IMUS

_FloatOrInt = FloatArray | IntArray

#: Columns of whole numbers.
INTEGERS = ("seq", "step", "valid")
#: Columns in which every row must have a finite number.
_REQUIRED = ("time_s", *CHANNELS, *INTEGERS)
#: Largest magnitude of a whole number, which a float64 represents exactly.
_MAX_INTEGER = 2**53


def damages(name: str, values: FloatArray) -> BoolArray:
    """Return the mask of the values of a column, shape (n,), that are not permitted in it and damage their rows."""
    if name in INTEGERS:
        return np.asarray(~np.isfinite(values) | (values != np.rint(values)))
    return ~np.isfinite(values) if name in _REQUIRED else np.isinf(values)


def is_excessive(name: str, values: _FloatOrInt) -> BoolArray:
    """Return the mask of the values of a column, shape (n,), that are too large for the computations."""
    limit = _MAX_INTEGER if name in INTEGERS else LARGEST_VALUE
    return np.asarray((values > limit) | (values < -limit))


@dataclass(frozen=True)
class SampleTable:
    """Intact rows of a part of a recording; all columns have the shape (n,) and the units of the CSV format."""

    columns: Mapping[str, _FloatOrInt]  #: Numbers by column; `seq`, `step` and `valid` are integers.
    stages: Sequence[str]  #: Stage of each row.
    lines: IntArray  #: Line of each row in the file, or number of its message, from 1.
    rows: IntArray  #: Number of each row, from 0; damaged rows are counted.
    damaged: IntArray  #: Numbers of the damaged rows, which are left out.

    def __len__(self) -> int:
        return len(self.lines)

    def __contains__(self, name: str) -> bool:
        return name in self.columns

    def floats(self, name: str) -> FloatArray:
        """Return a column, shape (n,); NaN if the recording does not contain it."""
        return np.asarray(self.columns.get(name, np.full(len(self), np.nan)), np.float64)

    def integers(self, name: str, default: int = 0) -> IntArray:
        """Return a column of integers, shape (n,); `default` if the recording does not contain it."""
        return np.asarray(self.columns.get(name, np.full(len(self), default)), np.int64)

    def select(self, keep: BoolArray) -> "SampleTable":
        """Return the rows for which `keep`, shape (n,), is true."""
        if keep.all():
            return self
        return replace(
            self,
            columns={name: values[keep] for name, values in self.columns.items()},
            stages=list(itertools.compress(self.stages, keep.tolist())),
            lines=self.lines[keep],
            rows=self.rows[keep],
        )

    @property
    def valid(self) -> BoolArray:
        """Mask of the rows that are not marked as invalid, shape (n,)."""
        return np.asarray(self.integers("valid", 1) != 0)

    def counts(self) -> FloatArray:
        """Return the raw output, counts, shape (n, 6); NaN for sensors that the recording does not contain."""
        return np.column_stack([self.floats(name) for name in CHANNELS]) + 0.0

    def angles(self) -> FloatArray:
        """Return the recorded encoder angles, rad, shape (n, 2)."""
        return np.deg2rad(np.column_stack([self.floats(name) for name in ANGLES]))

    def blocks(
        self, seq: IntArray, time: FloatArray, counts: FloatArray, unwrapper: AngleUnwrapper, secondaries: int
    ) -> Iterator[SampleBlock]:
        """Yield the samples in blocks of one stage.

        Parameters
        ----------
        seq, time : unwrapped counter, and clock, s, shape (n,)
        counts : raw output, shape (n, 6)
        unwrapper : makes the encoder angles cumulative
        secondaries : number of secondary IMUs
        """
        n = len(self)
        angles = np.full((n, 2), np.nan)
        if ANGLES[0] in self:
            angles = snap_angles(unwrapper.feed(time, self.angles()))
        names = [name for number in FURTHER_IMUS[:secondaries] for name in further_channels(number)]
        others = np.column_stack([*(self.floats(name) for name in names), np.empty((n, 0))]) + 0.0
        joints = np.empty((n, 0))
        if JOINTS[0] in self:
            joints = snap_angles(np.deg2rad(np.column_stack([self.floats(name) for name in JOINTS])))
        station, chamber = (
            self.floats(name)[:, None] if name in self else np.empty((n, 0)) for name in (STATION, CHAMBER)
        )
        block = SampleBlock(
            "",
            seq,
            time,
            counts,
            angles,
            self.integers("step"),
            self.valid,
            self.floats("temp_c"),
            others.reshape(n, secondaries, 6),
            joints,
            station,
            chamber,
        )
        changes = [k for k in range(1, n) if self.stages[k] != self.stages[k - 1]] if len(set(self.stages)) > 1 else []
        for a, b in itertools.pairwise([0, *changes, n]):
            if b > a:
                yield replace(block.part(a, b), stage=self.stages[a])
