"""Test of an IMU on its open link: its identity, registers and stream, the gravity it measures, and lines of text."""

import re
from collections.abc import Iterator
from dataclasses import asdict, dataclass

import numpy as np

from calstation.config import RunConfiguration
from calstation.connection.devices import Endpoints
from calstation.connection.identify import has_frames, is_text, line_values
from calstation.devices import OtherModelError, SampleBatch
from calstation.devices.codecs import quote
from calstation.devices.imu import FrameDecoder, ImuRefusalError, StreamedImu, TextFrame
from calstation.devices.links import PortLostError
from calstation.devices.profiles import CHANNELS, FrameSection, ImuProfile, SerialSettings
from calstation.errors import DeviceFaultError
from calstation.estimation.common import ImuModel
from calstation.jobs import ProgressCallback
from calstation.messages import Finding, Value
from calstation.physics import normal_gravity
from calstation.sequencer import PreflightLimits

_BAUDS = (9600, 19200, 38400, 57600, 115200, 230400, 460800, 921600)
#: Timeout for a unit to report that it is ready, station time, s.
_READY_TIMEOUT = 3.0
#: Station time over which the stream is observed, s.
_STREAM_TIME = 1.0
#: Maximum number of these observations while a converter forwards stored samples faster than the sample rate.
_BACKLOGS = 4
_SLICE = 0.1
#: Station time between two reads of the stream, s; it limits the error of the time at which a burst of samples ends.
_BURST_SLICE = 0.02
_LINE_ENDS = (b"\r\n", b"\n", b"\r")
_RATE_TOLERANCE = 0.05
#: Fraction of bytes in frames with a wrong checksum above which the checksum of the profile is considered wrong.
_MAX_WRONG_CHECKS = 0.3
#: Largest number of characters of a line that are shown.
_MAX_SHOWN = 120


@dataclass
class ImuTest:
    """The test of an open IMU; `settings` are its serial port settings."""

    imu: StreamedImu
    setup: RunConfiguration
    ports: Endpoints
    settings: SerialSettings
    progress: ProgressCallback

    def findings(self) -> Iterator[Finding]:
        """Yield the findings up to the first one that makes further findings meaningless."""
        imu, setup = self.imu, self.setup
        self.progress(0.3, note="asking")
        try:
            identity = imu.identify()
            imu.start()
        except DeviceFaultError as exc:
            yield self._fault_finding(exc)
            return
        if not setup.imu.has_commands:
            yield Finding("cannot_tell", "info")
        else:
            yield Finding("identified", "ok", asdict(identity))
            pattern = setup.product.serial_pattern
            if setup.station.bench is None and not re.fullmatch(pattern, identity.serial):
                yield Finding("serial_unlike", "warning", {"serial": identity.serial, "pattern": pattern})
        try:
            count = len(imu.read_registers())
        except DeviceFaultError as exc:
            yield Finding("registers_unread", "error", {"words": exc.as_text})
        else:
            yield Finding("registers", "ok" if count else "info", {"count": count}, "" if count else "no_registers")
        try:
            yield from self._stream()
        except DeviceFaultError as exc:
            yield self._fault_finding(exc)

    def _stream(self) -> Iterator[Finding]:
        """Wait until the unit is ready, and yield the findings on its stream."""
        imu, clock, profile = self.imu, self.ports.clock, self.setup.imu
        yield Finding("judged_as", "info", {"product": self.setup.product.name, "profile": profile.name})
        clock.attach(lambda: {0: imu.received})
        begin = clock.now()
        while clock.now() - begin < _READY_TIMEOUT:
            clock.sleep(_SLICE)
            early = imu.read()
            if len(early) and (not profile.status.ready or early.status[-1] & profile.status.ready):
                break
        expected, before = profile.stream.sample_rate_hz, imu.stats
        for _ in range(_BACKLOGS):
            before, parts, elapsed, measured = imu.stats, *self._listen()
            if measured < (1.0 + _RATE_TOLERANCE) * expected:
                break  # otherwise a converter may still be forwarding stored samples
        seq = np.concatenate([np.empty(0, np.int64), *(part.seq for part in parts)])
        values: dict[str, Value] = {"expected": expected, "measured": measured}
        if not len(seq):
            if profile.has_commands:
                yield Finding("no_stream", "error", values)
            elif not imu.stats.frames:
                yield self._silence_finding("")
            else:
                yield Finding("no_samples", "error", {**values, "frames": imu.stats.frames})
            return
        missing = int(seq[-1] - seq[0]) + 1 - len(seq)
        errors = imu.stats.crc_errors - before.crc_errors
        allowed = max(_RATE_TOLERANCE * expected, 2.0 / elapsed) + max(missing, 0) / elapsed
        slow = abs(measured - expected) > allowed
        yield Finding("wrong_rate" if slow else "rate", "error" if slow else "ok", values)
        gaps = imu.stats.gaps - before.gaps
        if gaps or errors:
            yield Finding("gaps", "error", {"gaps": gaps, "missing": missing, "errors": errors})
        else:
            yield Finding("no_gaps", "ok", {"count": len(seq)})
        yield from self._content(parts)

    def _listen(self) -> tuple[list[SampleBatch], float, float]:
        """Return the batches that arrive within `_STREAM_TIME`, the time that passed, s, and the rate, samples/s."""
        clock, begin, parts, arrivals = self.ports.clock, self.ports.clock.now(), list[SampleBatch](), list[float]()
        while (passed := clock.now() - begin) < _STREAM_TIME:
            clock.sleep(_BURST_SLICE)
            if len(part := self.imu.read()):
                parts.append(part)
                arrivals.append(clock.now())
            self.progress(0.5 + 0.5 * min(1.0, passed / _STREAM_TIME), note="listening")
        elapsed, counts = clock.now() - begin, [len(part) for part in parts]
        if len(parts) > 2:  # samples may arrive in bursts: only complete bursts count
            return parts, elapsed, sum(counts[1:]) / (arrivals[-1] - arrivals[0])
        return parts, elapsed, sum(counts) / elapsed

    def _content(self, parts: list[SampleBatch]) -> Iterator[Finding]:
        """Yield the findings on status bits, temperature and gravity, which reveal wrong scales or frame fields."""
        profile, masks = self.setup.imu, self.setup.imu.status
        status = np.concatenate([part.status for part in parts])
        if np.any(status & masks.failed):
            yield Finding("self_test_failed", "warning")
        if np.any(status & masks.saturated):
            yield Finding("saturated", "warning")
        if masks.ready and not status[-1] & masks.ready:
            yield Finding("not_ready", "warning", {"seconds": _READY_TIMEOUT})
        temperature = np.concatenate([part.temperature for part in parts])
        if np.any(np.isfinite(temperature)):
            yield Finding("temperature", "info", {"celsius": float(np.nanmean(temperature))})
        stream, noise = profile.stream, profile.noise
        scale = (stream.sample_rate_hz, stream.output, stream.gyro_lsb, stream.accel_lsb)
        model = ImuModel("", *scale, noise.gyro_arw, noise.accel_vrw)
        mean = np.concatenate([part.counts for part in parts]).mean(axis=0) * model.count_size
        measured = float(np.linalg.norm(mean[3:]))
        site = self.setup.station.site
        gravity = site.gravity_mps2 or normal_gravity(float(np.deg2rad(site.latitude_deg)), site.height_m)
        tolerance = PreflightLimits.gravity_tolerance
        values: dict[str, Value] = {"measured": measured, "expected": gravity, "tolerance": tolerance}
        if abs(measured / gravity - 1.0) <= tolerance:
            yield Finding("gravity", "ok", values)
        else:
            yield Finding("wrong_gravity", "error", values)

    def _fault_finding(self, error: DeviceFaultError) -> Finding:
        if isinstance(error, OtherModelError):
            return Finding("wrong_model", "error", {"found": error.found, "expected": error.expected})
        if isinstance(error, ImuRefusalError):
            return Finding("command_refused", "error", {"words": error.as_text})
        if isinstance(error, PortLostError):
            return Finding("lost", "error", {"words": error.as_text})
        return self._silence_finding(error.as_text)

    def _silence_finding(self, words: Value) -> Finding:
        stats, profile = self.imu.stats, self.setup.imu
        line = line_values(self.ports.imu, self.settings)
        counts = {"bytes": stats.bytes, "frames": stats.frames, "errors": stats.crc_errors}
        values = {"words": words, "profile": profile.name, "line": profile.link.line, **counts, **line}
        if stats.bytes == 0:
            return Finding("silent", "error", values)
        if stats.frames:
            return Finding("one_way", "error", values)
        size = FrameDecoder(profile.frame).size
        if stats.crc_errors * size > _MAX_WRONG_CHECKS * stats.bytes:
            return Finding("wrong_checks", "error", {**values, "kind": profile.frame.crc.kind})
        return Finding("no_frames", "error", values, "" if line else "no_frames_server")


def find_baud_rate(
    port: str, settings: SerialSettings, profile: ImuProfile, progress: ProgressCallback
) -> Iterator[Finding]:
    """Yield a finding if frames of a profile arrive at another baud rate; nothing is sent."""
    others = [baud for baud in _BAUDS if baud != settings.baud]
    for i, baud in enumerate(others):
        progress(0.4 + 0.6 * i / len(others), note="trying_bauds")
        if has_frames(port, settings.model_copy(update={"baud": baud}), profile):
            yield Finding("other_baud", "info", {"baud": settings.baud, "found": baud})
            return


def diagnose_text(frame: FrameSection, received: bytes) -> Finding | None:
    """Return the reason why received lines of text are not samples; None if they are, or if the bytes are not text."""
    tail = frame.tail_bytes
    ending = next((end for end in _LINE_ENDS if end in received), b"")
    if ending and ending != tail and (tail not in received or ending.endswith(tail)) and is_text(received):
        shown = {"found": ending.hex(" ").upper(), "tail": tail.hex(" ").upper()}
        return Finding("line_tail", "error", {**shown, "line": _quote(received.split(ending)[-2])})
    lines = [line for line in received.split(tail)[1:-1] if line]
    if not lines or not is_text(b"".join(lines)):
        return None
    samples = [line for line in lines if line.startswith(frame.sync_bytes)]
    if not samples:
        return Finding("line_sync", "error", {"sync": frame.sync, "line": _quote(lines[-1])})
    kind = TextFrame(frame)
    for line in samples:
        packet = line + tail
        problem = _checksum_finding(frame, kind, packet) or _column_finding(frame, kind, packet)
        if problem is None:
            return None
    return problem


def _checksum_finding(frame: FrameSection, kind: TextFrame, packet: bytes) -> Finding | None:
    if kind.is_valid(packet):
        return None
    line = packet[: -len(frame.tail_bytes)]
    body, mark, stated = line.rpartition(frame.mark.encode())
    if not mark:
        return Finding("line_mark", "error", {"mark": frame.mark, "line": _quote(line)})
    right = frame.crc.function()(body[frame.crc.start :])
    values: dict[str, Value] = {
        "line": _quote(line),
        "told": quote(stated),
        "kind": frame.crc.kind,
        "start": frame.crc.start,
        "right": f"{right:0{2 * frame.crc.size}X}",
    }
    return Finding("line_check", "error", values)


def _column_finding(frame: FrameSection, kind: TextFrame, packet: bytes) -> Finding | None:
    """Return a finding on the separator or the first missing or invalid field of a line with a correct checksum."""
    line = packet[: -len(frame.tail_bytes)]
    values: dict[str, Value] = {"line": _quote(line)}
    if not kind.is_sample(packet):
        values |= {"sync": frame.sync, "separator": frame.separator}
        return Finding("line_separator", "error", values)
    present = kind.columns([packet]).present
    row = line.rpartition(frame.mark.encode())[0][len(frame.sync_bytes) + 1 :]
    texts = row.decode("ascii", "replace").split(frame.separator)
    for name in ("counter", *CHANNELS):
        if frame.field(name) is None or bool(present[name][0]):
            continue
        column = kind.column_of[name]
        values |= {"field": name, "column": column}
        if column >= len(texts):
            return Finding("line_short", "error", {**values, "count": len(texts)})
        text = quote(texts[column].encode("ascii", "replace"))
        return Finding("line_column", "error", {**values, "text": text})
    return None


def _quote(line: bytes) -> str:
    return quote(line, _MAX_SHOWN)
