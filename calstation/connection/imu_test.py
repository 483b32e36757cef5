"""What an IMU answers and sends on its open link: who it is, its registers, its stream for a second, gravity."""

import re
from collections.abc import Iterator

import numpy as np

from calstation.config.resolved import ResolvedConfiguration
from calstation.connection.clock import BenchClock
from calstation.connection.devices import Endpoints
from calstation.connection.identify import has_frames
from calstation.devices.codecs.packets import quoted
from calstation.devices.imu.frames import FrameDecoder
from calstation.devices.imu.streamed_imu import ImuRefusalError, StreamedImu
from calstation.devices.imu.text_frames import TextFrame
from calstation.devices.interfaces import OtherModelError, SampleBatch
from calstation.devices.links.opening import host_and_port
from calstation.devices.links.serial_link import PortLostError
from calstation.devices.profiles.frame import CHANNELS, FrameSection
from calstation.devices.profiles.imu import ImuProfile
from calstation.devices.profiles.serial_settings import SerialSettings
from calstation.errors import DeviceFaultError
from calstation.estimation.common.context import ImuModel
from calstation.jobs.queue import ProgressCallback
from calstation.messages.finding import Finding, Value
from calstation.physics.earth import normal_gravity
from calstation.sequencer.acquisition import to_si
from calstation.sequencer.task import PreflightLimits

_BAUDS = (9600, 19200, 38400, 57600, 115200, 230400, 460800, 921600)
#: Station time that a unit has to say that it is ready, s.
_READY_WITHIN = 3.0
#: Station time over which the stream is watched, s.
_STREAM = 1.0
_SLICE = 0.1
_RATE_TOLERANCE = 0.05
#: Share of the bytes in frames with a wrong check from which the check is what is wrong.
_MOSTLY_CHECKS = 0.3


def ask(
    imu: StreamedImu,
    setup: ResolvedConfiguration,
    at: Endpoints,
    settings: SerialSettings,
    tell: ProgressCallback,
) -> Iterator[Finding]:
    """Findings of an open IMU, up to the first that makes the rest meaningless."""
    tell(0.3, note="asking")
    try:
        identity = imu.identify()
        imu.start()
    except OtherModelError as exc:
        yield Finding("wrong_model", "wrong", {"found": exc.found, "expected": exc.expected})
        return
    except ImuRefusalError as exc:
        yield Finding("command_refused", "wrong", {"words": str(exc)})
        return
    except PortLostError as exc:
        yield Finding("lost", "wrong", {"words": str(exc)})
        return
    except DeviceFaultError as exc:
        yield _unanswered(imu, setup, at.imu, settings, str(exc))
        return
    if setup.imu.protocol == "stream":
        yield Finding("cannot_tell", "told")
    else:
        yield Finding(
            "identified",
            "ok",
            {"model": identity.model, "serial": identity.serial, "firmware": identity.firmware},
        )
        pattern = setup.product.serial_pattern
        if setup.station.bench is None and not re.fullmatch(pattern, identity.serial):
            yield Finding("serial_unlike", "look", {"serial": identity.serial, "pattern": pattern})
    try:
        registers = imu.read_registers()
    except DeviceFaultError as exc:
        yield Finding("registers_unread", "wrong", {"words": str(exc)})
    else:
        yield Finding("registers", "ok" if registers else "told", {"count": len(registers)})
    try:
        yield from _stream(imu, setup, at, settings, tell)
    except PortLostError as exc:
        yield Finding("lost", "wrong", {"words": str(exc)})
    except DeviceFaultError as exc:
        yield _unanswered(imu, setup, at.imu, settings, str(exc))


def _stream(
    imu: StreamedImu,
    setup: ResolvedConfiguration,
    at: Endpoints,
    settings: SerialSettings,
    tell: ProgressCallback,
) -> Iterator[Finding]:
    """Wait until the unit is ready, then watch what it sends."""
    clock, profile = at.clock, setup.imu
    yield Finding("judged_as", "told", {"product": setup.product.name, "profile": profile.name})
    if isinstance(clock, BenchClock):
        clock.attach(lambda: imu.received)
    masks = profile.status
    begin = clock.now()
    status = 0
    while clock.now() - begin < _READY_WITHIN:
        clock.sleep(_SLICE)
        early = imu.read()
        status = int(early.status[-1]) if len(early) else status
        if len(early) and (not masks.ready or status & masks.ready):
            break
    before, begin, parts = imu.stats, clock.now(), []
    while (passed := clock.now() - begin) < _STREAM:
        clock.sleep(_SLICE)
        parts.append(imu.read())
        tell(0.5 + 0.5 * min(1.0, passed / _STREAM), note="listening")
    elapsed = clock.now() - begin
    seq = np.concatenate([part.seq for part in parts])
    expected = profile.stream.sample_rate_hz
    values: dict[str, Value] = {"expected": expected, "measured": len(seq) / elapsed}
    if not len(seq):
        if setup.imu.protocol != "stream":
            yield Finding("no_stream", "wrong", values)
        elif not imu.stats.frames:
            yield _unanswered(imu, setup, at.imu, settings, "")
        else:
            yield Finding("no_samples", "wrong", {**values, "frames": imu.stats.frames})
        return
    missing = int(seq[-1] - seq[0]) + 1 - len(seq)
    errors = imu.stats.crc_errors - before.crc_errors
    allowed = max(_RATE_TOLERANCE * expected, 2.0 / elapsed) + max(missing, 0) / elapsed
    slow = abs(len(seq) / elapsed - expected) > allowed
    yield Finding("wrong_rate" if slow else "rate", "wrong" if slow else "ok", values)
    gaps = imu.stats.gaps - before.gaps
    if gaps or errors:
        yield Finding("gaps", "wrong", {"gaps": gaps, "missing": missing, "errors": errors})
    else:
        yield Finding("no_gaps", "ok", {"count": len(seq)})
    yield from _content(parts, setup)


def _content(parts: list[SampleBatch], setup: ResolvedConfiguration) -> Iterator[Finding]:
    """What the samples say: status bits, temperature, and gravity, which tells wrong counts or bytes."""
    profile, masks = setup.imu, setup.imu.status
    status = np.concatenate([part.status for part in parts])
    if np.any(status & masks.failed):
        yield Finding("self_test_failed", "look")
    if np.any(status & masks.saturated):
        yield Finding("saturated", "look")
    if masks.ready and not status[-1] & masks.ready:
        yield Finding("not_ready", "look", {"seconds": _READY_WITHIN})
    heat = np.concatenate([part.temperature for part in parts])
    if np.any(np.isfinite(heat)):
        yield Finding("temperature", "told", {"celsius": float(np.nanmean(heat))})
    model = ImuModel(
        "",
        profile.stream.sample_rate_hz,
        profile.stream.output,
        profile.stream.gyro_lsb,
        profile.stream.accel_lsb,
        profile.noise.gyro_arw,
        profile.noise.accel_vrw,
    )
    mean = np.concatenate([part.counts for part in parts]).mean(axis=0) * to_si(model)
    measured = float(np.linalg.norm(mean[3:]))
    site = setup.station.site
    gravity = site.gravity_mps2 or normal_gravity(float(np.deg2rad(site.latitude_deg)), site.height_m)
    sound = abs(measured / gravity - 1.0) <= PreflightLimits.gravity_tolerance
    yield Finding(
        "gravity" if sound else "wrong_gravity",
        "ok" if sound else "wrong",
        {"measured": measured, "expected": gravity, "tolerance": PreflightLimits.gravity_tolerance},
    )


def _unanswered(
    imu: StreamedImu, setup: ResolvedConfiguration, port: str, settings: SerialSettings, words: str
) -> Finding:
    """Why no reply came, by the bytes and frames that did."""
    stats, profile = imu.stats, setup.imu
    values: dict[str, Value] = {
        "words": words,
        "bytes": stats.bytes,
        "frames": stats.frames,
        "errors": stats.crc_errors,
        "profile": profile.name,
        "line": profile.link.line,
    }
    if host_and_port(port) is None:
        values |= {"baud": settings.baud, "parity": settings.parity, "stop_bits": settings.stop_bits}
    if stats.bytes == 0:
        return Finding("silent", "wrong", values)
    if stats.frames:
        return Finding("one_way", "wrong", values)
    size = FrameDecoder(profile.frame, profile.commands).size
    if stats.crc_errors * size > _MOSTLY_CHECKS * stats.bytes:
        return Finding("wrong_checks", "wrong", {**values, "kind": profile.frame.crc.kind})
    return Finding("no_frames", "wrong", values)


def find_baud_rate(
    port: str, settings: SerialSettings, profile: ImuProfile, tell: ProgressCallback
) -> Iterator[Finding]:
    """The baud at which the same bytes are frames, where there is one. Only listens."""
    others = [baud for baud in _BAUDS if baud != settings.baud]
    for i, baud in enumerate(others):
        tell(0.4 + 0.6 * i / len(others), note="trying_bauds")
        if has_frames(port, settings.model_copy(update={"baud": baud}), profile):
            yield Finding("other_baud", "told", {"baud": settings.baud, "found": baud})
            return


#: Share of printable bytes from which what came is text.
_MOSTLY_TEXT = 0.9
_PRINTABLE = frozenset(b"\t" + bytes(range(0x20, 0x7F)))
#: Characters of a line that are shown.
_SHOWN = 120


def diagnose_text(frame: FrameSection, heard: bytes) -> Finding | None:
    """What is wrong with the lines in these bytes; None where they are no lines, or are samples.

    frame : of text
    """
    tail = frame.tail_bytes
    lines = [line for line in heard.split(tail)[1:-1] if line]
    printable = sum(byte in _PRINTABLE for line in lines for byte in line)
    if not lines or printable < _MOSTLY_TEXT * sum(map(len, lines)):
        return None
    own = [line for line in lines if line.startswith(frame.sync_bytes)]
    if not own:
        return Finding("line_sync", "wrong", {"sync": frame.sync, "line": _shown(lines[-1])})
    kind = TextFrame(frame)
    for line in own:
        packet = line + tail
        found = _check(frame, kind, packet) or _numbers(frame, kind, packet)
        if found is None:
            return None
    return found


def _check(frame: FrameSection, kind: TextFrame, packet: bytes) -> Finding | None:
    if kind.is_valid(packet):
        return None
    line = packet[: -len(frame.tail_bytes)]
    body, mark, told = line.rpartition(frame.mark.encode())
    if not mark:
        return Finding("line_mark", "wrong", {"mark": frame.mark, "line": _shown(line)})
    right = frame.crc.function()(body[frame.crc.start :])
    values: dict[str, Value] = {
        "line": _shown(line),
        "told": quoted(told),
        "kind": frame.crc.kind,
        "start": frame.crc.start,
        "right": f"{right:0{2 * frame.crc.size}X}",
    }
    return Finding("line_check", "wrong", values)


def _numbers(frame: FrameSection, kind: TextFrame, packet: bytes) -> Finding | None:
    """The first field of a sample that the columns of a sound line do not hold."""
    line = packet[: -len(frame.tail_bytes)]
    values: dict[str, Value] = {"line": _shown(line)}
    if not kind.is_sample(packet):
        return Finding(
            "line_separator", "wrong", {**values, "sync": frame.sync, "separator": frame.separator}
        )
    present = kind.columns([packet]).present
    row = line.rpartition(frame.mark.encode())[0][len(frame.sync_bytes) + 1 :]
    texts = row.decode("ascii", "replace").split(frame.separator)
    for name in ("counter", *CHANNELS):
        if frame.field(name) is None or bool(present[name][0]):
            continue
        column = kind.places[name]
        values |= {"field": name, "column": column}
        if column >= len(texts):
            return Finding("line_short", "wrong", {**values, "count": len(texts)})
        return Finding(
            "line_column", "wrong", {**values, "text": quoted(texts[column].encode("ascii", "replace"))}
        )
    return None


def _shown(line: bytes) -> str:
    return quoted(line, _SHOWN)
