"""Min-max pyramid of a log: files with the lowest and highest values of its channels in bins of samples.

Three levels of bins are stored, and bins are merged while reading, so that at most 16 times the drawn data are read for
a log of any length.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from calstation.physics import CHANNELS as IMU_CHANNELS
from calstation.physics import JOINTS, IntArray

#: Columns of every array of values, in °/s, m/s², ° and °C.
CHANNELS = (*IMU_CHANNELS, *JOINTS, "temperature")
FACTOR = 16
#: Samples in a bin of each level.
BINS = (16, 256, 4096)
SAMPLE = np.dtype([("seq", "<i8"), ("values", "<f4", (len(CHANNELS),))])
Values = NDArray[np.float32]
_SAMPLES = "samples"


@dataclass(frozen=True)
class Columns:
    """Lowest and highest values of consecutive columns of samples."""

    seq: IntArray  #: First sequence number of each column, shape (k,).
    low: Values  #: Lowest values in the units of `CHANNELS`, NaN if unknown, shape (k, 9).
    high: Values  #: Highest values in the units of `CHANNELS`, NaN if unknown, shape (k, 9).
    samples: int  #: Number of samples in a column; the last may have fewer.

    def __len__(self) -> int:
        return len(self.seq)


def merge_columns(seq: IntArray, low: Values, high: Values, group: int, samples: int) -> Columns:
    """Merge groups of bins into columns.

    Parameters
    ----------
    seq : first sequence number of each of n bins, shape (n,)
    low, high : lowest and highest values of the bins in the units of `CHANNELS`, shape (n, 9) each
    group, samples : number of bins in a column, and of samples in a bin
    """
    if group == 1 or len(seq) == 0:
        return Columns(seq, low, high, samples)
    complete = len(seq) // group * group
    shape = (-1, group, low.shape[1])
    lows = [np.fmin.reduce(low[:complete].reshape(shape), axis=1)]
    highs = [np.fmax.reduce(high[:complete].reshape(shape), axis=1)]
    if complete < len(seq):
        lows.append(np.fmin.reduce(low[complete:], axis=0)[np.newaxis])
        highs.append(np.fmax.reduce(high[complete:], axis=0)[np.newaxis])
    return Columns(seq[::group].copy(), np.concatenate(lows), np.concatenate(highs), group * samples)


def bins_per_column(bins: int, count: int) -> int:
    """Return the number of bins per column, a power of two, for at most `count` and at least half as many columns."""
    return 1 << max(0, -(-bins // max(count, 1)) - 1).bit_length()


class _Level:
    """Merges columns into bins of `FACTOR` and appends them to two files."""

    def __init__(self, folder: Path, samples: int) -> None:
        self._values: BinaryIO = (folder / f"{samples}.values").open("wb")
        self._seq: BinaryIO = (folder / f"{samples}.seq").open("wb")
        self._samples = samples
        self._remainder: list[Columns] = []
        self._count = 0

    def add(self, columns: Columns) -> Columns | None:
        """Add columns; return the bins completed by them."""
        self._remainder.append(columns)
        self._count += len(columns)
        return self._take(self._count // FACTOR * FACTOR)

    def close(self) -> Columns | None:
        """Close the files; return the last, incomplete bin."""
        last = self._take(self._count)
        self._values.close()
        self._seq.close()
        return last

    def _take(self, count: int) -> Columns | None:
        if count == 0:
            return None
        seq = np.concatenate([c.seq for c in self._remainder])
        low = np.concatenate([c.low for c in self._remainder])
        high = np.concatenate([c.high for c in self._remainder])
        samples = self._remainder[0].samples
        bins = merge_columns(seq[:count], low[:count], high[:count], FACTOR, samples)
        self._remainder = [Columns(seq[count:], low[count:], high[count:], samples)]
        self._count -= count
        self._values.write(np.stack([bins.low, bins.high], axis=1).astype("<f4").tobytes())
        self._seq.write(bins.seq.astype("<i8").tobytes())
        return bins


class PyramidWriter:
    """Writes the files of consecutive samples and, with `keep_samples`, the samples themselves for random access."""

    def __init__(self, folder: Path, keep_samples: bool) -> None:
        self._levels = [_Level(folder, samples) for samples in BINS]
        self._samples = (folder / _SAMPLES).open("wb") if keep_samples else None

    def add(self, seq: IntArray, values: Values) -> None:
        """Add samples: sequence numbers, shape (n,), and values in the units of `CHANNELS`, shape (n, 9)."""
        if self._samples is not None:
            rows = np.empty(len(seq), SAMPLE)
            rows["seq"], rows["values"] = seq, values
            self._samples.write(rows.tobytes())
        self._pass_on(0, Columns(seq, values, values, 1))

    def close(self) -> None:
        """Write the incomplete bins of every level."""
        for k, level in enumerate(self._levels):
            last = level.close()
            if last is not None:
                self._pass_on(k + 1, last)
        if self._samples is not None:
            self._samples.close()

    def _pass_on(self, level: int, columns: Columns | None) -> None:
        while columns is not None and level < len(self._levels):
            columns = self._levels[level].add(columns)
            level += 1


class MinMaxPyramid:
    """Reads the files of a pyramid."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._bins = {n: (folder / f"{n}.seq").stat().st_size // 8 for n in BINS}
        self._coarse = self._seq(BINS[-1], 0, self._bins[BINS[-1]])

    def columns(self, first_seq: int, last_seq: int, count: int) -> Columns:
        """Read at most `count` columns from `first_seq` to `last_seq`, plus one on either side.

        If there are fewer than `count` // 2 columns, the finest bins are too wide; `samples` then gives more detail.
        """
        level = len(BINS) - 1
        start, stop = self._range(level, first_seq, last_seq)
        while level > 0 and stop - start < count:
            level -= 1
            start, stop = self._range(level, first_seq, last_seq)
        group = bins_per_column(stop - start, count)
        start = max(0, (start - 1) // group * group)  # the columns do not change while a view is dragged
        stop = min(self._bins[BINS[level]], stop + group)
        seq, values = self._seq(BINS[level], start, stop), self._values(BINS[level], start, stop)
        return merge_columns(seq, values[:, 0], values[:, 1], group, BINS[level])

    def rows(self, first_seq: int, last_seq: int) -> tuple[int, int]:
        """Return the range (start, stop) of the log's rows with these sequence numbers, extended to whole bins."""
        start, stop = self._range(0, first_seq, last_seq)
        return start * BINS[0], stop * BINS[0]

    def samples(self, start: int, stop: int) -> np.ndarray:
        """Read the stored samples of a range of rows; the dtype is `SAMPLE`."""
        return np.fromfile(self.folder / _SAMPLES, SAMPLE, stop - start, offset=start * SAMPLE.itemsize)

    def _range(self, level: int, first_seq: int, last_seq: int) -> tuple[int, int]:
        return self._find(level, first_seq), self._find(level, last_seq) + 1

    def _find(self, level: int, seq: int) -> int:
        """Return the last bin of a level that starts at or before `seq`, or 0, searching from the coarsest level."""
        at = max(0, int(self._coarse.searchsorted(seq, side="right")) - 1)
        for samples in reversed(BINS[level:-1]):
            at *= FACTOR
            below = self._seq(samples, at, min(at + FACTOR, self._bins[samples]))
            at += max(0, int(below.searchsorted(seq, side="right")) - 1)
        return at

    def _seq(self, samples: int, start: int, stop: int) -> IntArray:
        return np.fromfile(self.folder / f"{samples}.seq", "<i8", stop - start, offset=8 * start)

    def _values(self, samples: int, start: int, stop: int) -> Values:
        width = 2 * len(CHANNELS)
        file = self.folder / f"{samples}.values"
        flat: Values = np.fromfile(file, "<f4", (stop - start) * width, offset=4 * width * start)
        return flat.reshape(-1, 2, len(CHANNELS))
