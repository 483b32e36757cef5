"""Chooses the columns of a log that a view of a given width draws, and the single samples worth fetching for it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calstation.results.plots import BINS, Columns, LogIndex, MinMaxPyramid, Values, group_of, joined


@dataclass(frozen=True)
class Wanted:
    """Rows `start` to `stop` of a log in at most `count` columns; they hold sequence numbers `first` to `last`."""

    first: int
    last: int
    start: int
    stop: int
    count: int


class LogColumns:
    """A log's min-max pyramid, with the single samples fetched last."""

    def __init__(self, log_index: LogIndex) -> None:
        self._facts = log_index.facts
        self._pyramid = MinMaxPyramid(log_index.folder)
        self._fine: tuple[Wanted, Columns] | None = None

    def keep(self, wanted: Wanted, columns: Columns) -> None:
        """Keep the single samples that were wanted."""
        self._fine = (wanted, columns)

    def view(self, first: int, last: int, count: int) -> tuple[Columns, Wanted | None]:
        """At most `count` columns over a range of sequence numbers; samples that would show more of it, or None."""
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
    """Sequence numbers, lowest and highest values; NaN interrupts the lines if more than `wide` samples are missing.

    A joined column with such a gap may hold samples from before and after it, and is left out.
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
    """The columns that hold a range, joined to at most `count`."""
    start = max(0, int(columns.seq.searchsorted(first, side="right")) - 1)
    stop = int(columns.seq.searchsorted(last, side="right")) + 1
    k = slice(start, stop)
    group = group_of(len(columns.seq[k]), count)
    return joined(columns.seq[k], columns.low[k], columns.high[k], group, columns.samples)
