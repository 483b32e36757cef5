"""The last stretch of a stream in a fixed amount of memory."""

import numpy as np

from calstation.physics.arrays import FloatArray


class RingBuffer:
    """Keeps the newest `capacity` rows of `columns` numbers; reading gives them in order without copying twice."""

    def __init__(self, capacity: int, columns: int) -> None:
        self._capacity = capacity
        self._rows = np.zeros((2 * capacity, columns))
        self._end = 0
        self.written = 0

    def append(self, rows: FloatArray) -> None:
        """Take new rows, shape (n, columns)."""
        rows = rows[-self._capacity :]
        count = len(rows)
        if self._end + count > len(self._rows):
            kept = min(self._end, self._capacity)
            self._rows[:kept] = self._rows[self._end - kept : self._end]
            self._end = kept
        self._rows[self._end : self._end + count] = rows
        self._end += count
        self.written += count

    def latest(self) -> FloatArray:
        """A view of the rows kept, oldest first, shape (n, columns); valid until the next `append`."""
        return self._rows[max(0, self._end - self._capacity) : self._end]

    def clear(self) -> None:
        """Forget everything."""
        self._end = 0
        self.written += 1
