"""`Spool`: a stage's samples put aside in a temporary file until the stage is solved.

A stage is solved by several passes over all of it, and may last for hours at 2 kHz. What waits for its end waits on
disk, so that a station's memory does not grow while it records.
"""

import tempfile
import weakref
from collections.abc import Iterator

import numpy as np

from calstation.estimation.common.samples import SampleBlock

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
