"""Corrected output of IMUs on one body: JSON lines for other programs, and plot data of the last minute of a watch.

See docs/reference/corrected-data.md. The primary is corrected for its own errors, a secondary for its stored errors
relative to the primary and then for the primary's errors. Each line specifies the IMU whose output is valid.
"""

import json
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from calstation.estimation.common import SampleBlock
from calstation.estimation.pairs import PairWatch, SecondaryCorrection, WatchEvent
from calstation.messages import values_to_json
from calstation.physics import FloatArray, compensate, compensation
from calstation.records import LogMeta, context_from_meta, prior_from_meta

SCHEMA = "calstation.corrected/1"
#: Longest time covered by one line, s.
FRAME = 0.05
PRIMARY = "primary"
#: Decimal places of rates, rad/s, and forces, m/s²: far below the noise of a sample.
_RATE_PLACES, _FORCE_PLACES = 10, 8
#: Displayed duration, and averaging time of a point, s.
DURATION, _AVERAGING_TIME = 60.0, 0.25


class CorrectedStream:
    """Corrects the samples of a watch, block by block."""

    def __init__(self, meta: LogMeta) -> None:
        context = context_from_meta(meta)
        self._imu, self._primary = context.imu, compensation(prior_from_meta(meta).mean)
        self.secondaries = {s.number: SecondaryCorrection(s, self._primary) for s in context.secondaries}
        self.source: str | None = None  #: Name of the IMU whose output is valid; None if there is none.
        self.switch_overs = 0
        self.calibrations: dict[int, int] = {}  #: Number of the calibration in use, from 0, by IMU.
        self.unaligned: frozenset[int] = frozenset()  #: IMUs whose samples are not aligned with those of the primary.

    def update(self, watch: PairWatch) -> list[tuple[str, int, dict[str, Any]]]:
        """Update the state from the watch; return the changes as kind, number of the IMU or 0, and values."""
        changes: list[tuple[str, int, dict[str, Any]]] = []
        started, self.unaligned = bool(self.calibrations), watch.unaligned
        for number, secondary in self.secondaries.items():
            stored = watch.stored[number]
            if number not in self.calibrations or secondary.stored is not stored:
                secondary.use(stored)
                self.calibrations[number] = self.calibrations.get(number, -1) + 1
                changes.append(("calibration", number, self.in_use()[f"imu{number}"]))
        before, (source, reason) = self.source, self._valid(watch)
        if source != before or not started:
            self.source = source
            self.switch_overs += started
            values = {"from": before, "to": source, "reason": reason, "count": self.switch_overs}
            changes.append(("switch_over" if started else "source", 0, values))
        return changes

    def in_use(self) -> dict[str, dict[str, Any]]:
        """Return the number and values of the calibration in use, by name of the IMU."""
        return {
            f"imu{number}": {"calibration": count, "values": dict(self.secondaries[number].stored.values)}
            for number, count in self.calibrations.items()
        }

    def _valid(self, watch: PairWatch) -> tuple[str | None, str]:
        """Return the name of the IMU whose corrected output is valid, or None, and the reason."""
        if 0 in watch.silent:
            reason = "primary_silent"
        elif watch.primary_off:
            reason = "primary_off"
        else:
            return PRIMARY, "primary_valid"
        for number in self.secondaries:
            verdicts = watch.verdicts.get(number)
            if verdicts and "out_of_tolerance" not in verdicts.values() and number not in watch.silent:
                return f"imu{number}", reason
        return None, reason

    def corrected(self, block: SampleBlock) -> dict[str, tuple[FloatArray, FloatArray]]:
        """Return rate, rad/s, and specific force, m/s², of every IMU by name, shape (n, 3), NaN where missing."""
        raw = np.where(block.valid[:, None], block.counts, np.nan) * self._imu.count_size
        output = {PRIMARY: compensate(self._primary, raw[:, :3], raw[:, 3:])}
        for index, (number, secondary) in enumerate(self.secondaries.items()):
            output[f"imu{number}"] = secondary.correct(block.others[:, index])
        return output


class CorrectedOutput:
    """A `PairConsumer` that writes every line to all `sinks`.

    If a block changes a calibration or the state of the primary, the change applies to the whole block.
    """

    def __init__(self, meta: LogMeta, sinks: Sequence[Callable[[str], object]]) -> None:
        self._stream, self._sinks = CorrectedStream(meta), sinks
        self._rows = max(1, round(FRAME * meta.imu.sample_rate_hz))
        self._head = {
            "type": "start",
            "schema": SCHEMA,
            "sample_rate_hz": meta.imu.sample_rate_hz,
            PRIMARY: {"serial": meta.imu.serial},
            **{f"imu{number}": {"serial": section.serial} for number, section in meta.secondaries.items()},
        }
        self.greeting = self._greeting()  #: First line for a new reader, with the current state.
        self._write(self.greeting)

    def feed(self, block: SampleBlock, watch: PairWatch, events: Sequence[WatchEvent]) -> None:
        """Write the events, then the samples with the state after the events."""
        time = float(block.time[-1]) if len(block) else None
        for event in events:
            self._emit(event.kind, event.time, event.number, values_to_json(event.values))
        for kind, number, values in self._stream.update(watch):
            self._emit(kind, time, number, values)
        self.greeting = self._greeting()
        for start in range(0, len(block), self._rows):
            self._write_frame(block.part(start, min(start + self._rows, len(block))))
        if not len(block):
            self._write(_line({"type": "end"}))

    def _greeting(self) -> str:
        return _line({**self._head, **self._state(), "calibrations": self._stream.in_use()})

    def _state(self) -> dict[str, Any]:
        return {"source": self._stream.source, "switch_overs": self._stream.switch_overs}

    def _write(self, line: str) -> None:
        for sink in self._sinks:
            sink(line)

    def _emit(self, kind: str, time: float | None, number: int, values: Mapping[str, Any]) -> None:
        imu = {"imu": f"imu{number}"} if number else {}
        self._write(_line({"type": "event", "kind": kind, "time_s": time, **imu, **values}))

    def _write_frame(self, block: SampleBlock) -> None:
        frame: dict[str, Any] = {
            "type": "data",
            "seq": int(block.seq[0]),
            "count": len(block),
            "time_s": block.time.tolist(),
            **self._state(),
            **{name: _rows(*samples) for name, samples in self._stream.corrected(block).items()},
        }
        for number, calibration in self._stream.calibrations.items():
            state = {
                "calibration": calibration,
                "clock_offset_s": self._stream.secondaries[number].clock_offset,
                "aligned": number not in self._stream.unaligned,
            }
            frame[f"imu{number}"] = {**state, **frame[f"imu{number}"]}
        self._write(_line(frame))


def _rows(rate: FloatArray, force: FloatArray) -> dict[str, list[list[float] | None]]:
    """Return one row per sample and sensor, None for missing values."""
    missing = np.flatnonzero(np.isnan(np.hstack([rate, force])).any(axis=1)).tolist()
    columns: dict[str, list[list[float] | None]] = {
        "gyro": np.round(rate, _RATE_PLACES).tolist(),
        "accel": np.round(force, _FORCE_PLACES).tolist(),
    }
    for rows in columns.values():
        for k in missing:
            rows[k] = None
    return columns


def _line(content: Mapping[str, Any]) -> str:
    return json.dumps(content, separators=(",", ":"), allow_nan=False) + "\n"


@dataclass(frozen=True)
class CorrectedTrace:
    """Corrected output of every IMU by name (``primary``, ``imu2``, ...), NaN where missing."""

    source: str | None  #: Name of the IMU whose output is valid; None if there is none.
    switch_overs: int
    time: FloatArray  #: Time relative to the newest sample, s, ≤ 0, shape (k,).
    force: Mapping[str, FloatArray]  #: Magnitude of the mean force minus gravity, m/s², shape (k,) each.
    rate: Mapping[str, FloatArray]  #: Magnitude of the mean rate, rad/s, shape (k,) each.


class CorrectedTraceBuilder:
    """A `PairConsumer` that keeps the means of the last `DURATION` s."""

    def __init__(self, meta: LogMeta) -> None:
        self._stream, self._gravity = CorrectedStream(meta), context_from_meta(meta).site.local_gravity
        self._count = max(1, round(_AVERAGING_TIME * meta.imu.sample_rate_hz))
        self._parts: dict[str, list[FloatArray]] = {}
        self._samples = 0
        count = round(DURATION / _AVERAGING_TIME)
        self._points: deque[tuple[float, dict[str, tuple[float, float]]]] = deque(maxlen=count)

    def feed(self, block: SampleBlock, watch: PairWatch, events: Sequence[WatchEvent]) -> None:
        """Add the samples of a block."""
        self._stream.update(watch)
        for name, samples in self._stream.corrected(block).items():
            self._parts.setdefault(name, []).append(np.hstack(samples))
        self._samples += len(block)
        if self._samples >= self._count:
            self._points.append((float(block.time[-1]), {name: self._sizes(p) for name, p in self._parts.items()}))
            self._parts, self._samples = {}, 0

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
