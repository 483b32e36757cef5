"""Rows of a raw log that do not read as they were written: left out as a gap, and told."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Hole:
    """Rows that are left out.

    Attributes
    ----------
    row, count : the first of them, counted from 0, and how many
    after, before : sequence numbers of the good samples around them, None where there is none
    """

    row: int
    count: int
    after: int | None
    before: int | None

    @property
    def values(self) -> Mapping[str, int | str]:
        """What is told of it."""
        return {
            "first_row": self.row,
            "last_row": self.row + self.count - 1,
            "after": "the start" if self.after is None else self.after,
            "before": "the end" if self.before is None else self.before,
        }


def without(holes: NDArray[np.int64], start: int, stop: int) -> Iterator[tuple[int, int]]:
    """Stored rows of the good rows `start` to `stop`, in stretches.

    holes : first row and number of rows of each, shape (n, 2), rising
    """
    row = good = 0
    for first, count in [*holes.tolist(), (None, 0)]:
        length = stop - good if first is None else first - row
        a, b = max(start, good), min(stop, good + length)
        if a < b:
            yield row + a - good, row + b - good
        if first is None or good + length >= stop:
            return
        good, row = good + length, first + count
