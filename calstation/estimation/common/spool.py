"""Samples of a stage until it is solved, in memory and, of a long stage, in a temporary file."""

import pickle
import tempfile
import weakref
from collections import deque

import numpy as np

from calstation.estimation.common.context import ImuModel
from calstation.estimation.common.samples import SampleBlock, joined
from calstation.estimation.common.stage import StageData, stage_data

#: Number of samples that are joined, because many small blocks are slow, and number of such blocks kept in memory:
#: 44 minutes at 200 Hz in 60 MB, since the file takes several percent of the time of a solution.
_TOGETHER, _IN_MEMORY = 16_384, 32
_NOTHING = SampleBlock(
    "",
    np.empty(0, np.int64),
    np.empty(0),
    np.empty((0, 6)),
    np.empty((0, 2)),
    np.empty(0, np.int64),
    np.empty(0, np.bool_),
    np.empty(0),
)


class Spool:
    """Samples of one stage, in order; of a long stage, all but the latest are in a file deleted with the object."""

    def __init__(self, imu: ImuModel) -> None:
        self._imu = imu
        self._file = tempfile.TemporaryFile(prefix="calstation-")  # noqa: SIM115 - open for the spool's life
        weakref.finalize(self, self._file.close)
        self._written = 0  # number of blocks in the file
        self._latest: deque[SampleBlock] = deque()
        self._waiting: list[SampleBlock] = []
        self._waiting_samples = 0
        self._block: SampleBlock | None = None
        self._data: StageData | None = None

    def append(self, block: SampleBlock) -> None:
        """Append samples; all blocks need the same columns. Raises OSError if the disk is full."""
        self._block = self._data = None
        self._waiting.append(block)
        self._waiting_samples += len(block)
        if self._waiting_samples >= _TOGETHER:
            self._latest.append(joined(self._waiting))
            self._waiting, self._waiting_samples = [], 0
        if len(self._latest) > _IN_MEMORY:
            pickle.dump(self._latest.popleft(), self._file, pickle.HIGHEST_PROTOCOL)
            self._written += 1

    def block(self) -> SampleBlock:
        """Return all samples stored so far; the same object until more are stored."""
        if self._block is None:
            self._file.seek(0)
            written = [pickle.load(self._file) for _ in range(self._written)]
            self._block = joined([*written, *self._latest, *self._waiting] or [_NOTHING])
        return self._block

    def data(self) -> StageData:
        """Return the valid samples stored so far in physical units; the same object until more are stored."""
        if self._data is None:
            self._data = stage_data([self.block()], self._imu)
        return self._data
