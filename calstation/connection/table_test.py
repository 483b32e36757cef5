"""Test of a table on its open link: identity, polling times, status, travel and watchdog."""

import math
import time
from collections.abc import Iterator

import numpy as np

from calstation.connection.identify import is_text, line_values
from calstation.devices import LOCAL_CONTROL, UNKNOWN_FAULT, OtherModelError, TableStatus
from calstation.devices.codecs import check_bytes, quote
from calstation.devices.links import (
    SOCKETS,
    ModbusRefusalError,
    NoAnswerError,
    PortLostError,
    TextRefusalError,
    UnexpectedReplyError,
    host_and_port,
)
from calstation.devices.profiles import JOINTS, SerialSettings, TableProfile
from calstation.devices.table import ModbusTable, RegisterTable, TextTable
from calstation.errors import DeviceFaultError
from calstation.jobs import ProgressCallback
from calstation.messages import Finding, Value, known
from calstation.sequencer import MAX_POLL_DURATION

_POLLS = 20
_READ_HOLDING = 3
#: Registered port of Modbus TCP.
_MODBUS_PORT = 502
#: Size of an RTU read request, bytes.
_REQUEST_SIZE = 8
#: Shortest time to wait for a late reply, s.
_LATE_REPLY = 1.0
#: Tolerance for comparing the travel set in the table with the profile's travel, degrees.
_TRAVEL_TOLERANCE = 0.01


def query_table(
    table: RegisterTable | TextTable,
    profile: TableProfile,
    settings: SerialSettings,
    port: str,
    progress: ProgressCallback,
) -> Iterator[Finding]:
    """Yield the findings on an open table up to the first one that makes further findings meaningless."""
    progress(0.5, note="asking")
    try:
        identity = table.identify()
        times: list[float] = []
        for i in range(_POLLS):
            begin = time.perf_counter()
            status = table.status()
            times.append(time.perf_counter() - begin)
            progress(0.5 + 0.5 * (i + 1) / _POLLS, note="asking")
    except OtherModelError as exc:
        yield Finding("wrong_model", "error", {"found": exc.found, "expected": exc.expected})
    except ModbusRefusalError as exc:
        entry = f"exception_{exc.exception}"
        values: dict[str, Value] = {"code": exc.exception, "unit": exc.unit}
        yield Finding("exception", "error", values, entry if known(f"finding.{entry}") else "")
    except TextRefusalError as exc:
        yield Finding("line_refused", "error", {"words": exc.as_text})
    except UnexpectedReplyError as exc:
        if is_text(table.received):
            yield Finding("unlike_answer", "error", {"words": exc.as_text})
        else:
            yield _text_finding(table.received, profile, settings, port, exc)
    except PortLostError as exc:
        yield Finding("lost", "error", {"words": exc.as_text})
    except NoAnswerError as exc:
        # If a second drive does not reply, the bytes received before are those of the first drive.
        received = table.received if exc.unit == profile.unit else b""
        yield _deviation_finding(table, profile, exc) or _modbus_finding(received, profile, settings, port, exc)
    except DeviceFaultError as exc:
        if isinstance(table, ModbusTable):
            yield Finding("no_number", "error", {"words": exc.as_text})
        else:
            yield _text_finding(table.received, profile, settings, port, exc)
    else:
        yield Finding("identified", "ok", {"model": identity.model, "serial": identity.serial})
        seconds = {"typical": float(np.median(times)), "worst": max(times), "limit": MAX_POLL_DURATION}
        values = {**seconds, "count": _POLLS, **{f"{name}_ms": 1e3 * value for name, value in seconds.items()}}
        is_slow = seconds["worst"] > MAX_POLL_DURATION
        yield Finding("round_trip", "warning" if is_slow else "ok", values, "round_trip_slow" if is_slow else "")
        yield from _status_findings(status, profile)


def _status_findings(status: TableStatus, profile: TableProfile) -> Iterator[Finding]:
    stops_after = profile.link_loss_stop_s if math.isinf(status.watchdog) else status.watchdog
    if stops_after:
        yield Finding("watchdog", "ok", {"seconds": stops_after})
    elif math.isinf(status.watchdog):
        yield Finding("no_watchdog", "info")
    else:
        yield Finding("watchdog_off", "error")
    if status.fault == LOCAL_CONTROL:
        yield Finding("local_control", "warning")
    elif status.fault == UNKNOWN_FAULT:
        yield Finding("fault_untold", "warning")
    elif status.fault is not None:
        yield Finding("fault", "warning", {"fault": status.fault})
    yield Finding("interlock", "ok") if status.interlock_closed else Finding("interlock_open", "warning")
    angles = np.rad2deg(status.angles).tolist()
    if status.joints is None:
        yield Finding("angles", "info", {"outer": angles[0], "inner": angles[1]})
    else:
        joints = np.rad2deg(status.joints).tolist()
        yield Finding("joints", "info", {"x": joints[0], "y": joints[1], "z": joints[2]})
    if status.moving:
        yield Finding("moving", "warning")
    if not status.homed:
        yield Finding("not_homed", "info")
    if status.joints is not None:  # the travel is checked before every turn and at every poll
        return
    for joint, name in enumerate(JOINTS):
        section = (profile.outer, profile.inner)[joint]
        low, high = np.rad2deg(status.limits.low[joint]), np.rad2deg(status.limits.high[joint])
        travel: dict[str, Value] = {"profile_low": section.low_deg, "profile_high": section.high_deg}
        values: dict[str, Value] = {"joint": name, "low": float(low), "high": float(high), **travel}
        inside = section.low_deg - _TRAVEL_TOLERANCE <= angles[joint] <= section.high_deg + _TRAVEL_TOLERANCE
        if not inside:
            entry = "" if status.homed else "outside_travel_unhomed"
            yield Finding("outside_travel", "warning" if entry else "error", {**values, "angle": angles[joint]}, entry)
        elif low > section.low_deg + _TRAVEL_TOLERANCE or high < section.high_deg - _TRAVEL_TOLERANCE:
            yield Finding("travel_narrower", "warning", values)
        else:
            yield Finding("travel", "ok", values)


def _deviation_finding(table: RegisterTable | TextTable, profile: TableProfile, error: NoAnswerError) -> Finding | None:
    """Return the finding on a unit whose replies violate Modbus or are too late, or None."""
    if not isinstance(table, RegisterTable):
        return None
    values: dict[str, Value] = {"unit": error.unit, "timeout": profile.timeout_s}
    if table.deviation is not None:
        return Finding(f"gateway_{table.deviation}", "error", values)
    delay = table.reply_time(error.unit, max(_LATE_REPLY, 3.0 * profile.timeout_s))
    if delay is None or delay < profile.timeout_s:
        return None
    return Finding("late_reply", "error", {**values, "seconds": delay})


def _modbus_finding(
    received: bytes, profile: TableProfile, settings: SerialSettings, port: str, error: NoAnswerError
) -> Finding:
    unit = error.unit
    values: dict[str, Value] = {"unit": unit, "seconds": profile.timeout_s, "words": error.as_text}
    if port.startswith("tcp://"):
        values["count"] = len(received)
        if not received:
            return Finding("silent_tcp", "error", values)
        usual = (host_and_port(port) or ("", 0))[1] == _MODBUS_PORT
        return Finding("not_modbus", "error", values, "not_modbus_502" if usual else "")
    line = line_values(port, settings)
    values |= {**line, "line": profile.serial.line}
    if not received:
        return Finding("silent_rtu", "error", values, "" if line else "silent_rtu_server")
    values["count"] = len(received)
    if len(received) >= _REQUEST_SIZE and _has_valid_crc(received[:_REQUEST_SIZE]) and received[2] != _REQUEST_SIZE - 5:
        return Finding("echo", "error", values)
    if _has_valid_crc(received) and received[0] != unit:
        return Finding("other_unit", "error", {**values, "found": received[0]})
    if received[0] == unit and len(received) > 1 and received[1] & 0x7F == _READ_HOLDING:
        return Finding("crc", "error", values)
    return Finding("garbled", "error", values, "" if line else "garbled_server")


def _text_finding(
    received: bytes, profile: TableProfile, settings: SerialSettings, port: str, error: DeviceFaultError
) -> Finding:
    line = line_values(port, settings)
    values: dict[str, Value] = {"seconds": profile.timeout_s, "words": error.as_text, "count": len(received), **line}
    if not received:
        return Finding("silent_host" if port.startswith(SOCKETS) else "silent_text", "error", values)
    if not is_text(received):
        values["line"] = profile.serial.line
        return Finding("garbled_text", "error", values, "" if line else "garbled_text_server")
    return Finding("unlike_text", "error", {**values, "said": quote(received.strip())})


def _has_valid_crc(frame: bytes) -> bool:
    return len(frame) > 3 and check_bytes("crc16_modbus", frame[:-2], "little") == frame[-2:]
