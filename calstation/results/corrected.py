"""Corrected output of IMUs on one body as JSON lines for other programs, see docs/reference/corrected-data.md.

The primary is corrected by its own errors, a secondary by its stored errors relative to the primary and then by those
of the primary. Each line says which of them is valid.
"""

import json
from collections.abc import Callable, Mapping, Sequence
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


class CorrectedOutput:
    """A `PairConsumer` that passes every line on to all `sinks`.

    A calibration or a state of the primary that a block of the watch brings about applies to that whole block.
    """

    def __init__(self, meta: LogMeta, sinks: Sequence[Callable[[str], object]]) -> None:
        context = context_from_meta(meta)
        self._sinks, self._imu = sinks, context.imu
        self._own = compensation(prior_from_meta(meta).mean)
        self._secondaries = {s.number: SecondaryCorrection(s, self._own) for s in context.secondaries}
        self._rows = max(1, round(FRAME * context.imu.sample_rate))
        self._source: str | None = None
        self._switch_overs = -1  # the first source is no switch-over
        self._calibrations: dict[int, int] = {}
        self._head = {
            "type": "start",
            "schema": SCHEMA,
            "sample_rate_hz": context.imu.sample_rate,
            PRIMARY: {"serial": context.imu.serial},
            **{f"imu{s.number}": {"serial": s.imu.serial} for s in context.secondaries},
        }
        self.greeting = _line({**self._head, **self._state()})  #: First line for a reader, with the present state.
        self._write(self.greeting)

    def feed(self, block: SampleBlock, watch: PairWatch, events: Sequence[WatchEvent]) -> None:
        """Write the events, then the samples with the state after them."""
        time = float(block.time[-1]) if len(block) else None
        for event in events:
            self._tell(event.kind, event.time, event.number, values_to_json(event.values))
        for number, secondary in self._secondaries.items():
            stored = watch.stored[number]
            if number not in self._calibrations or secondary.stored is not stored:
                secondary.use(stored)
                self._calibrations[number] = self._calibrations.get(number, -1) + 1
                values = {"calibration": self._calibrations[number], "values": dict(stored.values)}
                self._tell("calibration", time, number, values)
        source, reason = self._valid(watch)
        if source != self._source or self._switch_overs < 0:
            before, self._source = self._source, source
            self._switch_overs += 1
            values = {"from": before, "to": source, "reason": reason, "count": self._switch_overs}
            self._tell("switch_over" if self._switch_overs else "source", time, 0, values)
        self.greeting = _line({**self._head, **self._state()})
        for start in range(0, len(block), self._rows):
            self._write_frame(block.part(start, min(start + self._rows, len(block))))
        if not len(block):
            self._write(_line({"type": "end"}))

    def _state(self) -> dict[str, Any]:
        return {"source": self._source, "switch_overs": max(self._switch_overs, 0)}

    def _write(self, line: str) -> None:
        for sink in self._sinks:
            sink(line)

    def _tell(self, kind: str, time: float | None, number: int, values: Mapping[str, Any]) -> None:
        imu = {"imu": f"imu{number}"} if number else {}
        self._write(_line({"type": "event", "kind": kind, "time_s": time, **imu, **values}))

    def _valid(self, watch: PairWatch) -> tuple[str | None, str]:
        """Return the IMU whose corrected output is valid, None without one, and why."""
        if watch.primary_silent:
            reason = "primary_silent"
        elif watch.primary_off:
            reason = "primary_off"
        else:
            return PRIMARY, "primary_valid"
        for number in self._secondaries:
            if "out_of_tolerance" not in watch.verdicts.get(number, {}).values():
                return f"imu{number}", reason
        return None, reason

    def _write_frame(self, block: SampleBlock) -> None:
        raw = np.where(block.valid[:, None], block.counts, np.nan) * self._imu.count_size
        frame = {
            "type": "data",
            "seq": int(block.seq[0]),
            "count": len(block),
            "time_s": block.time.tolist(),
            **self._state(),
            PRIMARY: _rows(*compensate(self._own, raw[:, :3], raw[:, 3:])),
        }
        for place, (number, secondary) in enumerate(self._secondaries.items()):
            rows = _rows(*secondary.corrected(block.others[:, place]))
            used = {"calibration": self._calibrations[number], "clock_offset_s": secondary.clock_offset}
            frame[f"imu{number}"] = {**used, **rows}
        self._write(_line(frame))


def _rows(rate: FloatArray, force: FloatArray) -> dict[str, list[list[float] | None]]:
    """Return one row per sample and sensor, None where it is missing."""
    missing = np.flatnonzero(np.isnan(np.hstack([rate, force])).any(axis=1)).tolist()
    found: dict[str, list[list[float] | None]] = {
        "gyro": np.round(rate, _RATE_PLACES).tolist(),
        "accel": np.round(force, _FORCE_PLACES).tolist(),
    }
    for rows in found.values():
        for k in missing:
            rows[k] = None
    return found


def _line(content: Mapping[str, Any]) -> str:
    return json.dumps(content, separators=(",", ":"), allow_nan=False) + "\n"
