"""Rows of a raw log that do not read as they were written: left out as a gap, and told."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

#: Holes of which a message says where they are.
_TOLD = 6


@dataclass(frozen=True)
class DamagedRows:
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
    def missing(self) -> str:
        """Sequence numbers that are missing, the first and last, without the one that nobody knows."""
        first = "" if self.after is None else f"{self.after + 1}"
        last = "" if self.before is None else f"{self.before - 1}"
        return f"{first}…{last}"


def told(holes: Sequence[DamagedRows]) -> dict[str, int | str]:
    """What a message says of holes: rows in all, and where the first of them are."""
    places = [hole.missing for hole in holes[:_TOLD]] + ["…"] * (len(holes) > _TOLD)
    return {"rows": sum(hole.count for hole in holes), "where": ", ".join(places)}


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
