"""What a table answers on its open link: who it is, how it stands, what it says of limits and watchdog."""

import math
import time
from collections.abc import Iterator

import numpy as np

from calstation.devices.codecs.frame_checks import check_bytes
from calstation.devices.codecs.packets import quoted
from calstation.devices.interfaces import LOCAL_CONTROL, UNTOLD, OtherModelError, TableStatus
from calstation.devices.links.modbus_link import ModbusRefusalError, NoAnswerError
from calstation.devices.links.opening import SOCKETS, host_and_port
from calstation.devices.links.serial_link import PortLostError
from calstation.devices.links.text_link import TextRefusalError, UnlikeAnswerError
from calstation.devices.profiles.serial_settings import SerialSettings
from calstation.devices.profiles.table import TableProfile
from calstation.devices.profiles.table_registers import JOINTS
from calstation.devices.table.modbus_table import ModbusTable
from calstation.devices.table.register_table import RegisterTable
from calstation.devices.table.text_table import TextTable
from calstation.errors import DeviceFaultError
from calstation.jobs.queue import ProgressCallback
from calstation.messages.finding import Finding, State, Value
from calstation.sequencer.acquisition import SLOWEST_POLL

_POLLS = 20
_READ_HOLDING = 3
#: Bytes of a request to read over RTU.
_REQUEST = 8
_PRINTABLE = frozenset(b"\r\n\t" + bytes(range(0x20, 0x7F)))
#: Share of printable bytes from which what came is text.
_MOSTLY_TEXT = 0.9
#: Characters of an unlike answer that are shown.
_QUOTED = 40
#: Travel of table and profile that differs by less, degrees, is the same.
_ALIKE = 0.01


def ask(
    table: RegisterTable | TextTable,
    profile: TableProfile,
    settings: SerialSettings,
    port: str,
    tell: ProgressCallback,
) -> Iterator[Finding]:
    """Findings of an open table, up to the first that makes the rest meaningless."""
    tell(0.5, note="asking")
    try:
        identity = table.identify()
        times: list[float] = []
        for i in range(_POLLS):
            begin = time.perf_counter()
            status = table.status()
            times.append(time.perf_counter() - begin)
            tell(0.5 + 0.5 * (i + 1) / _POLLS, note="asking")
    except OtherModelError as exc:
        yield Finding("wrong_model", "wrong", {"found": exc.found, "expected": exc.expected})
    except ModbusRefusalError as exc:
        yield Finding("exception", "wrong", {"code": exc.exception, "unit": exc.unit})
    except TextRefusalError as exc:
        yield Finding("line_refused", "wrong", {"words": str(exc)})
    except UnlikeAnswerError as exc:
        if _is_text(table.heard):
            yield Finding("unlike_answer", "wrong", {"words": str(exc)})
        else:
            yield _no_text(table.heard, profile, settings, port, str(exc))
    except PortLostError as exc:
        yield Finding("lost", "wrong", {"words": str(exc)})
    except NoAnswerError as exc:
        # What was heard before another drive fell silent was the first one's.
        heard = table.heard if exc.unit == profile.unit else b""
        yield _no_modbus(heard, profile, settings, port, str(exc), exc.unit)
    except DeviceFaultError as exc:
        if isinstance(table, ModbusTable):
            yield Finding("no_number", "wrong", {"words": str(exc)})
        else:
            yield _no_text(table.heard, profile, settings, port, str(exc))
    else:
        yield Finding("identified", "ok", {"model": identity.model, "serial": identity.serial})
        worst = max(times)
        state: State = "ok" if worst <= SLOWEST_POLL else "look"
        typical = float(np.median(times))
        yield Finding(
            "round_trip", state, {"typical": typical, "worst": worst, "count": _POLLS, "limit": SLOWEST_POLL}
        )
        yield from _standing(status, profile)


def _standing(status: TableStatus, profile: TableProfile) -> Iterator[Finding]:
    stops_after = profile.link_loss_stop_s if math.isinf(status.watchdog) else status.watchdog
    if stops_after:
        yield Finding("watchdog", "ok", {"seconds": stops_after})
    elif math.isinf(status.watchdog):
        yield Finding("no_watchdog", "told")
    else:
        yield Finding("watchdog_off", "wrong")
    if status.fault == LOCAL_CONTROL:
        yield Finding("local_control", "look")
    elif status.fault == UNTOLD:
        yield Finding("fault_untold", "look")
    elif status.fault is not None:
        yield Finding("fault", "look", {"fault": status.fault})
    yield Finding("interlock", "ok") if status.interlock_closed else Finding("interlock_open", "look")
    outer, inner = np.rad2deg(status.angles)
    yield Finding("angles", "told", {"outer": float(outer), "inner": float(inner)})
    if status.moving:
        yield Finding("moving", "look")
    if not status.homed:
        yield Finding("not_homed", "told")
    for joint, name in enumerate(JOINTS):
        section = (profile.outer, profile.inner)[joint]
        low, high = np.rad2deg(status.limits.low[joint]), np.rad2deg(status.limits.high[joint])
        values: dict[str, Value] = {
            "joint": name,
            "low": float(low),
            "high": float(high),
            "profile_low": section.low_deg,
            "profile_high": section.high_deg,
        }
        angle = float(np.rad2deg(status.angles[joint]))
        if status.homed and not section.low_deg - _ALIKE <= angle <= section.high_deg + _ALIKE:
            yield Finding("outside_travel", "wrong", {**values, "angle": angle})
        elif low > section.low_deg + _ALIKE or high < section.high_deg - _ALIKE:
            yield Finding("travel_narrower", "look", values)
        else:
            yield Finding("travel", "ok", values)


def _no_modbus(
    heard: bytes, profile: TableProfile, settings: SerialSettings, port: str, words: str, unit: int
) -> Finding:
    """Why nothing that makes sense came, by the bytes that did."""
    values: dict[str, Value] = {"unit": unit, "seconds": profile.timeout_s, "words": words}
    if port.startswith("tcp://"):
        return Finding("not_modbus" if heard else "silent_tcp", "wrong", {**values, "count": len(heard)})
    if host_and_port(port) is None:
        values |= {"baud": settings.baud, "parity": settings.parity, "stop_bits": settings.stop_bits}
    values["line"] = profile.serial.line
    if not heard:
        return Finding("silent_rtu", "wrong", values)
    values["count"] = len(heard)
    if len(heard) >= _REQUEST and _sound(heard[:_REQUEST]) and heard[2] != _REQUEST - 5:
        return Finding("echo", "wrong", values)
    if _sound(heard) and heard[0] != unit:
        return Finding("other_unit", "wrong", {**values, "found": heard[0]})
    if heard[0] == unit and len(heard) > 1 and heard[1] & 0x7F == _READ_HOLDING:
        return Finding("crc", "wrong", values)
    return Finding("garbled", "wrong", values)


def _no_text(heard: bytes, profile: TableProfile, settings: SerialSettings, port: str, words: str) -> Finding:
    """The same of a table that is commanded in lines of text."""
    values: dict[str, Value] = {"seconds": profile.timeout_s, "words": words, "count": len(heard)}
    if host_and_port(port) is None:
        values |= {"baud": settings.baud, "parity": settings.parity, "stop_bits": settings.stop_bits}
    if not heard:
        return Finding("silent_host" if port.startswith(SOCKETS) else "silent_text", "wrong", values)
    if not _is_text(heard):
        return Finding("garbled_text", "wrong", {**values, "line": profile.serial.line})
    return Finding("unlike_text", "wrong", {**values, "said": quoted(heard.strip(), _QUOTED)})


def _is_text(heard: bytes) -> bool:
    """Whether what came is text for the most part."""
    return sum(byte in _PRINTABLE for byte in heard) >= _MOSTLY_TEXT * len(heard)


def _sound(frame: bytes) -> bool:
    """Whether an RTU frame's check is right."""
    return len(frame) > 3 and check_bytes("crc16_modbus", frame[:-2], "little") == frame[-2:]
