"""Rows of numbers in a temporary file, for steps that read a long recording more than once."""

import tempfile
from collections.abc import Iterator
from types import TracebackType

import numpy as np

from calstation.errors import InputError
from calstation.messages import os_reason

#: Size up to which the rows stay in memory, bytes.
_MEMORY = 2**22


class TemporaryRows:
    """Rows of a dtype that are appended once and then read in parts; `close` removes the file."""

    part_rows = 2**16  #: Number of rows that are read at once.

    def __init__(self, dtype: np.dtype) -> None:
        self._dtype = dtype
        self._file = tempfile.SpooledTemporaryFile(_MEMORY)  # noqa: SIM115
        self._count = 0

    def __len__(self) -> int:
        return self._count

    def __enter__(self) -> "TemporaryRows":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, tb: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """Remove the file."""
        self._file.close()

    def append(self, rows: np.ndarray) -> None:
        """Append rows before any are read. Raises InputError if the disk of temporary files is full."""
        try:
            self._file.write(rows.tobytes())
        except OSError as exc:
            raise InputError("log.not_written", file=tempfile.gettempdir(), reason=os_reason(exc)) from exc
        self._count += len(rows)

    def read(self, first: int, count: int) -> np.ndarray:
        """Return up to `count` rows, starting with the row `first`."""
        self._file.seek(first * self._dtype.itemsize)
        return np.frombuffer(self._file.read(count * self._dtype.itemsize), self._dtype)

    def parts(self, first: int = 0, rows: int | None = None) -> Iterator[np.ndarray]:
        """Yield all rows, starting with the row `first`, `rows` (by default `part_rows`) at a time."""
        rows = rows or self.part_rows
        for start in range(first, self._count, rows):
            yield self.read(start, rows)
