"""Blocks of samples, which the sequencer passes to the log and the solver."""

from dataclasses import dataclass, field, fields

import numpy as np

from calstation.physics import BoolArray, FloatArray, IntArray

#: Resolution of encoder angles, rad (2e-7″), coarse enough for angles stored in degrees to be read back exactly.
ANGLE_STEP = 2.0**-40

#: Largest magnitude of a value in a sample; no device sends larger values, and their powers would overflow.
LARGEST_VALUE = 1e20


@dataclass(frozen=True)
class SampleBlock:
    """Consecutive IMU samples of one stage."""

    stage: str  #: Name of the stage, "" between stages.
    seq: IntArray  #: Unwrapped sample counter, shape (n,).
    time: FloatArray  #: IMU clock at the end of each sample, s, shape (n,).
    counts: FloatArray  #: Raw output, gyro x y z then accel x y z, counts, shape (n, 6).
    #: Outer and inner encoder angle at the end of each sample, rad, cumulative, NaN between polls, shape (n, 2).
    angles: FloatArray
    step: IntArray  #: Number of the move that each sample belongs to, shape (n,).
    valid: BoolArray  #: False for an invalid sample, shape (n,).
    temperature: FloatArray  #: Temperature, °C, NaN if unknown, shape (n,).
    #: Raw output of the k secondary IMUs on the same body, as `counts`, NaN where missing, shape (n, k, 6).
    others: FloatArray = field(default_factory=lambda: np.empty((0, 0, 6)))
    #: Angles x, y, z of a gimbal's joints, rad, NaN between polls, shape (n, 3); (n, 0) without a gimbal.
    joints: FloatArray = field(default_factory=lambda: np.empty((0, 0)))
    #: Station time at which a sample was read, s, shape (n, 1); NaN except for the last sample of each read; (n, 0) if
    #: unknown.
    station: FloatArray = field(default_factory=lambda: np.empty((0, 0)))
    #: Temperature of the chamber's air, °C, NaN except for some samples, shape (n, 1); (n, 0) without a chamber.
    chamber: FloatArray = field(default_factory=lambda: np.empty((0, 0)))

    def __post_init__(self) -> None:
        """Give missing optional columns the number of rows of the block."""
        for name, shape in (("others", (0, 6)), ("joints", (0,)), ("station", (0,)), ("chamber", (0,))):
            if getattr(self, name).shape[1] == 0:
                object.__setattr__(self, name, np.empty((len(self.seq), *shape)))

    def __len__(self) -> int:
        return len(self.seq)

    @classmethod
    def without_table(
        cls, stage: str, seq: IntArray, time: FloatArray, counts: FloatArray, **columns: np.ndarray
    ) -> "SampleBlock":
        """Return a block of valid samples without moves, encoder angles and temperatures except those in `columns`.

        Parameters
        ----------
        stage : name of the stage
        seq, time, counts : as the attributes, shape (n,), (n,) and (n, 6)
        columns : other columns of the block by name
        """
        n = len(seq)
        defaults = {
            "angles": np.full((n, 2), np.nan),
            "step": np.zeros(n, np.int64),
            "valid": np.ones(n, np.bool_),
            "temperature": np.full(n, np.nan),
        }
        return cls(stage, seq, time, counts, **{**defaults, **columns})

    def part(self, start: int, stop: int) -> "SampleBlock":
        """Return samples `start` to `stop` as a block of array views."""
        return SampleBlock(self.stage, *(getattr(self, name)[start:stop] for name in COLUMNS))

    def where(self, chosen: BoolArray) -> "SampleBlock":
        """Return the samples for which `chosen`, shape (n,), is true as a block."""
        return SampleBlock(self.stage, *(getattr(self, name)[chosen] for name in COLUMNS))


_EMPTY = SampleBlock.without_table("", np.empty(0, np.int64), np.empty(0), np.empty((0, 6)))
#: Names of the columns of a block, the optional ones last.
COLUMNS = tuple(f.name for f in fields(SampleBlock) if f.name != "stage")


def has_gyros(output: FloatArray) -> bool:
    """Return whether the output, shape (n, 6), contains gyro values, which are NaN in a unit without gyros."""
    return not (np.isnan(output[:, :3]).all() and np.isfinite(output[:, 3:]).any())


def join_blocks(blocks: list[SampleBlock]) -> SampleBlock:
    """Join consecutive blocks into one with the stage of the first; a single block is returned unchanged."""
    if len(blocks) <= 1:
        return blocks[0] if blocks else _EMPTY
    return SampleBlock(blocks[0].stage, *(np.concatenate([getattr(b, name) for b in blocks]) for name in COLUMNS))


def blocks_from(blocks: list[SampleBlock], seq: int) -> list[SampleBlock]:
    """Return the part of successive blocks from sequence number `seq` on."""
    remaining = [b for b in blocks if len(b) and b.seq[-1] >= seq]
    if remaining:
        remaining[0] = remaining[0].part(int(remaining[0].seq.searchsorted(seq)), len(remaining[0]))
    return remaining


def snap_angles(angles: FloatArray) -> FloatArray:
    """Round angles in rad, of any shape, to `ANGLE_STEP`; NaN is preserved.

    Drivers, logs and file readers all use this grid, so a solution does not depend on whether the angles were stored in
    degrees in a file.
    """
    return np.round(np.asarray(angles) / ANGLE_STEP) * ANGLE_STEP
