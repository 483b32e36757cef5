"""Summary of the samples of a log (range, gaps, temperature, sha256, invalid and paused samples).

The summary does not depend on the block sizes.
"""

import hashlib
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from calstation.estimation.common import SampleBlock
from calstation.physics import IntArray
from calstation.records.meta import LogMeta

_ROW = np.dtype(
    [
        ("seq", "<i8"),
        ("time", "<f8"),
        ("counts", "<f8", (6,)),
        ("angles", "<f8", (2,)),
        ("step", "<i8"),
        ("temperature", "<f8"),
        ("valid", "u1"),
    ]
)


@dataclass(frozen=True)
class LogFacts:
    """Summary of the samples of a log."""

    first_seq: int  #: First sequence number, unwrapped; 0 without samples.
    last_seq: int  #: Last sequence number, unwrapped; -1 without samples.
    samples: int  #: Number of samples.
    gaps: int  #: Number of gaps.
    temperature: tuple[float, float, float] | None  #: Mean, lowest and highest temperature, °C; None if unknown.
    sha256: str  #: Digest of the sample rows and the configuration.
    damaged: int = 0  #: Number of rows that could not be read.


class FactsBuilder:
    """Accumulates `LogFacts` from consecutive blocks."""

    def __init__(self, meta: LogMeta) -> None:
        # the original of an exported log has events instead of this entry, and its digest does not include events
        self._configuration = meta.model_copy(update={"pauses": []}).to_json()
        self._rows = hashlib.sha256()
        self._stages = hashlib.sha256()
        self._more_columns = hashlib.sha256()
        self._has_more_columns = False
        self._stage: str | None = None
        self._first = 0
        self._last = -1
        self._samples = 0
        self._gaps = 0
        self._temperature_sum = 0.0
        self._temperature_count = 0
        self._lowest = math.inf
        self._highest = -math.inf

    def add(self, block: SampleBlock) -> None:
        """Add the next block."""
        count = len(block)
        if count == 0:
            return
        if block.stage != self._stage:
            self._stages.update(f"{self._samples}:{block.stage}\n".encode())
            self._stage = block.stage
        rows = np.empty(count, _ROW)
        rows["seq"], rows["time"], rows["counts"] = block.seq, block.time, block.counts
        rows["angles"] = np.where(np.isnan(block.angles), np.nan, block.angles)
        rows["step"], rows["valid"] = block.step, block.valid
        rows["temperature"] = np.where(np.isnan(block.temperature), np.nan, block.temperature)
        self._rows.update(rows.data)
        more_columns = [
            v.reshape(count, -1) for v in (block.others, block.joints, block.station, block.chamber) if v.shape[1]
        ]
        if more_columns:
            self._has_more_columns = True
            columns = np.hstack(more_columns)
            self._more_columns.update(np.where(np.isnan(columns), np.nan, columns).astype("<f8").data)
        if self._samples == 0:
            self._first = int(block.seq[0])
        elif int(block.seq[0]) != self._last + 1:
            self._gaps += 1
        self._gaps += int(np.count_nonzero(np.diff(block.seq) != 1))
        self._last = int(block.seq[-1])
        self._samples += count
        temperature = block.temperature[~np.isnan(block.temperature)]
        if len(temperature):
            self._temperature_sum += float(temperature.sum())
            self._temperature_count += len(temperature)
            self._lowest = min(self._lowest, float(temperature.min()))
            self._highest = max(self._highest, float(temperature.max()))

    def facts(self) -> LogFacts:
        """Return the summary of the blocks added so far."""
        digest = hashlib.sha256()
        for part in (self._rows.digest(), self._stages.digest(), self._configuration.encode()):
            digest.update(part)
        if self._has_more_columns:  # logs without these columns keep their digest
            digest.update(self._more_columns.digest())
        temperature = None
        if self._temperature_count:
            temperature = (round(self._temperature_sum / self._temperature_count, 3), self._lowest, self._highest)
        return LogFacts(self._first, self._last, self._samples, self._gaps, temperature, digest.hexdigest())


class UnusedSamples:
    """Finds the ranges of samples that a log marks as invalid, and whether they were recorded during a pause.

    Samples of a pause are intact, but no step uses them. A pause includes the return to the start of the interrupted
    step. Pauses are unknown in a log without arrival times, in a log without events and stated pauses, and in a log
    that begins with stages copied from another run, whose events and clock are not copied.
    """

    def __init__(self, events: Iterable[Mapping[str, Any]], meta: LogMeta) -> None:
        self._pauses = [(start, *end, math.inf) for start, *end in pauses_of(events, meta)]
        #: The latest range, which the next block may continue, shape (0, 4) or (1, 4).
        self._latest = np.empty((0, 4), np.int64)
        self.invalid = 0  #: Number of invalid samples outside pauses, in the completed ranges.
        self.paused = 0  #: Number of samples of pauses, in the completed ranges.

    def add(self, block: SampleBlock) -> IntArray:
        """Add the next block, and return the completed ranges, shape (n, 4).

        Their columns are the first and last sequence number, the number of samples, and 1 for a pause.
        """
        edges = np.diff(np.concatenate([[False], ~block.valid, [False]]).astype(np.int8))
        starts, stops = np.flatnonzero(edges > 0), np.flatnonzero(edges < 0)
        in_pause = np.zeros(len(block), np.bool_)
        if block.station.shape[1]:
            for start, stop, *_ in self._pauses:
                in_pause |= (block.station[:, 0] >= start) & (block.station[:, 0] <= stop)
        count = np.concatenate([[0], np.cumsum(in_pause)])
        ranges = np.column_stack(
            [block.seq[starts], block.seq[stops - 1], stops - starts, count[stops] > count[starts]]
        ).astype(np.int64)
        latest = self._latest
        if len(latest) and len(ranges) and latest[0, 1] + 1 == ranges[0, 0]:
            ranges[0, 0], ranges[0, 2] = latest[0, 0], latest[0, 2] + ranges[0, 2]
            ranges[0, 3] |= latest[0, 3]
            latest = latest[:0]
        ranges = np.concatenate([latest, ranges])
        open_from = len(ranges) - int(len(block) > 0 and len(ranges) > 0 and not block.valid[-1])
        self._latest = ranges[open_from:]
        return self._counted(ranges[:open_from])

    def close(self) -> IntArray:
        """Return the range at the end of the log, shape (0, 4) or (1, 4), as `add` does."""
        latest, self._latest = self._latest, self._latest[:0]
        return self._counted(latest)

    def _counted(self, ranges: IntArray) -> IntArray:
        paused = ranges[:, 3] != 0
        self.paused += int(ranges[paused, 2].sum())
        self.invalid += int(ranges[~paused, 2].sum())
        return ranges


def pauses_of(events: Iterable[Mapping[str, Any]], meta: LogMeta) -> list[list[float]]:
    """Return the station times of the start and the end of each pause of a log, s; only the start if it did not end.

    The times come from the events of a run, or from the configuration of an exported log, which has no events.
    """
    if meta.run is not None and meta.run.resumed_from is not None:
        return []
    pauses: list[list[float]] = []
    was_paused = False
    for event in events:
        if event.get("event") != "StateChanged" or event.get("station_time") is None:
            continue
        paused = event.get("state") in ("pausing", "paused")
        if paused and not was_paused:
            pauses.append([float(event["station_time"])])
        elif was_paused and not paused:
            pauses[-1].append(float(event["station_time"]))
        was_paused = paused
    return pauses or meta.pauses
