"""Plot data of the corrected output of IMUs on one body: the last minute of a watch."""

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calstation.estimation.common import SampleBlock
from calstation.estimation.pairs import PairWatch, WatchEvent
from calstation.physics import FloatArray
from calstation.records import LogMeta, context_from_meta
from calstation.results.corrected import CorrectedStream

#: Displayed duration, and averaging time of a point, s.
SHOWN, _MEAN_OVER = 60.0, 0.25


@dataclass(frozen=True)
class CorrectedTrace:
    """Corrected output of every IMU by name (``primary``, ``imu2``, ...), NaN where missing."""

    source: str | None  #: Name of the IMU whose output is valid; None if there is none.
    switch_overs: int
    time: FloatArray  #: Time relative to the newest sample, s, ≤ 0, shape (k,).
    force: Mapping[str, FloatArray]  #: Magnitude of the mean force minus gravity, m/s², shape (k,) each.
    rate: Mapping[str, FloatArray]  #: Magnitude of the mean rate, rad/s, shape (k,) each.


class CorrectedTraceBuilder:
    """A `PairConsumer` that keeps the means of the last `SHOWN` s."""

    def __init__(self, meta: LogMeta) -> None:
        self._stream, self._gravity = CorrectedStream(meta), context_from_meta(meta).site.local_gravity
        self._count = max(1, round(_MEAN_OVER * meta.imu.sample_rate_hz))
        self._parts: dict[str, list[FloatArray]] = {}
        self._taken = 0
        self._points: deque[tuple[float, dict[str, tuple[float, float]]]] = deque(maxlen=round(SHOWN / _MEAN_OVER))

    def feed(self, block: SampleBlock, watch: PairWatch, events: Sequence[WatchEvent]) -> None:
        """Add the samples of a block."""
        self._stream.update(watch)
        for name, samples in self._stream.corrected(block).items():
            self._parts.setdefault(name, []).append(np.hstack(samples))
        self._taken += len(block)
        if self._taken >= self._count:
            self._points.append((float(block.time[-1]), {name: self._sizes(p) for name, p in self._parts.items()}))
            self._parts, self._taken = {}, 0

    def _sizes(self, parts: list[FloatArray]) -> tuple[float, float]:
        rows = np.vstack(parts)
        rows = rows[~np.isnan(rows).any(axis=1)]
        if not len(rows):
            return np.nan, np.nan
        mean = rows.mean(axis=0)
        return float(np.linalg.norm(mean[:3])), float(np.linalg.norm(mean[3:])) - self._gravity

    def trace(self) -> CorrectedTrace:
        """Return the points so far."""
        time = np.array([at for at, _ in self._points])
        names = self._points[-1][1] if self._points else {}
        rate, force = ({n: np.array([row[n][k] for _, row in self._points]) for n in names} for k in (0, 1))
        last = time[-1] if len(time) else 0.0
        return CorrectedTrace(self._stream.source, self._stream.switch_overs, time - last, force, rate)
