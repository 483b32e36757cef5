"""Selection of the columns to draw for a view of a log, and of single samples when more detail is needed."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calstation.results.plots import BINS, Columns, LogIndex, MinMaxPyramid, Values, group_of, joined


@dataclass(frozen=True)
class Wanted:
    """A request for rows `start` to `stop`, sequence numbers `first` to `last`, in at most `count` columns."""

    first: int
    last: int
    start: int
    stop: int
    count: int


class LogColumns:
    """The min-max pyramid of a log, and the single samples fetched last."""

    def __init__(self, log_index: LogIndex) -> None:
        self._facts = log_index.facts
        self._pyramid = MinMaxPyramid(log_index.folder)
        self._fine: tuple[Wanted, Columns] | None = None

    def keep(self, wanted: Wanted, columns: Columns) -> None:
        """Store the single samples fetched for a request."""
        self._fine = (wanted, columns)

    def view(self, first: int, last: int, count: int) -> tuple[Columns, Wanted | None]:
        """Return at most `count` columns over a range of sequence numbers, and a request for finer samples or None."""
        columns = self._pyramid.columns(first, last, count)
        if columns.samples > BINS[0] or len(columns) >= count // 2:
            return columns, None
        if self._fine is not None:
            wanted, fine = self._fine
            inside = wanted.first <= first and last <= wanted.last
            if inside and fine.samples <= max(1, (last - first) // count):
                return _between(fine, first, last, count), None
        width = last - first
        reach = max(self._facts.first_seq, first - width), min(self._facts.last_seq, last + width)
        return columns, Wanted(*reach, *self._pyramid.rows(*reach), 8 * count)


def split_at_gaps(columns: Columns, wide: float) -> tuple[NDArray[np.float64], Values, Values]:
    """Return sequence numbers, minima and maxima, with NaN to break the line if more than `wide` samples are missing.

    A merged column with such a gap may contain samples from before and after it, and is omitted.
    """
    gaps = np.flatnonzero(np.diff(columns.seq) - columns.samples > wide)
    seq, low, high = columns.seq.astype(np.float64), columns.low, columns.high
    if len(gaps) and columns.samples == 1:
        seq = np.insert(seq, gaps + 1, np.nan)
        low, high = (np.insert(values, gaps + 1, np.nan, axis=0) for values in (low, high))
    else:
        seq[gaps] = np.nan
    return seq, low, high


def _between(columns: Columns, first: int, last: int, count: int) -> Columns:
    """Return the columns that cover a range, merged into at most `count`."""
    start = max(0, int(columns.seq.searchsorted(first, side="right")) - 1)
    stop = int(columns.seq.searchsorted(last, side="right")) + 1
    k = slice(start, stop)
    group = group_of(len(columns.seq[k]), count)
    return joined(columns.seq[k], columns.low[k], columns.high[k], group, columns.samples)
