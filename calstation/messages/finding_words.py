"""What a connection test found, in words that the window translates: what it is and, where it is wrong, the mend."""

from collections.abc import Callable
from typing import Any

from calstation.messages.finding import Finding
from calstation.messages.imu_finding_words import IMU
from calstation.messages.marked import QT_TRANSLATE_NOOP
from calstation.messages.table_finding_words import TABLE

_OPENING = {
    "connected": (QT_TRANSLATE_NOOP("station_finding", "Connected to {host}, port {port}."), ""),
    "opened": (QT_TRANSLATE_NOOP("station_finding", "Port {port} opened."), ""),
    "opened_as": (QT_TRANSLATE_NOOP("station_finding", "Port {port} opened, now {device}."), ""),
    "by_hand": (
        QT_TRANSLATE_NOOP("station_finding", "“{name}” is turned by hand: there is no link to test."),
        "",
    ),
    "no_port": (
        QT_TRANSLATE_NOOP("station_finding", "There is no port {port}."),
        QT_TRANSLATE_NOOP(
            "station_finding", "Plug the adapter in, or choose another port. Found now: {found}."
        ),
    ),
    "no_adapter": (
        QT_TRANSLATE_NOOP("station_finding", "No USB adapter for {port} is plugged in, or several are."),
        QT_TRANSLATE_NOOP("station_finding", "Plug it in, or choose another port. Found now: {found}."),
    ),
    "no_permission": (
        QT_TRANSLATE_NOOP("station_finding", "This user may not use port {port}."),
        QT_TRANSLATE_NOOP(
            "station_finding",
            "Allow it (on Linux: add the user to the group dialout, then log in again).",
        ),
    ),
    "busy": (
        QT_TRANSLATE_NOOP("station_finding", "Port {port} is in use."),
        QT_TRANSLATE_NOOP("station_finding", "Close the other program that has it open, then test again."),
    ),
    "bad_settings": (
        QT_TRANSLATE_NOOP(
            "station_finding", "Port {port} refuses {baud} baud, parity {parity}, {stop_bits:g} stop bits."
        ),
        QT_TRANSLATE_NOOP("station_finding", "Choose settings that the adapter can do ({words})."),
    ),
    "bad_address": (
        QT_TRANSLATE_NOOP("station_finding", "“{port}” is no address."),
        QT_TRANSLATE_NOOP("station_finding", "Give host and port number."),
    ),
    "unknown_host": (
        QT_TRANSLATE_NOOP("station_finding", "Nobody knows the host “{host}”."),
        QT_TRANSLATE_NOOP("station_finding", "Correct its name, or give its IP address."),
    ),
    "refused": (
        QT_TRANSLATE_NOOP("station_finding", "{host} is there, but serves nothing at port {number}."),
        QT_TRANSLATE_NOOP("station_finding", "Correct the port number; see that the device's server is on."),
    ),
    "unreachable": (
        QT_TRANSLATE_NOOP("station_finding", "{host} does not answer within {seconds:g} s."),
        QT_TRANSLATE_NOOP("station_finding", "Check power, network cable and IP address ({words})."),
    ),
    "other": (
        QT_TRANSLATE_NOOP("station_finding", "Port {port} cannot be opened."),
        QT_TRANSLATE_NOOP("station_finding", "The system says: {words}."),
    ),
    "lost": (
        QT_TRANSLATE_NOOP("station_finding", "The link was lost during the test."),
        QT_TRANSLATE_NOOP("station_finding", "Check cable and power ({words})."),
    ),
    "identified": (QT_TRANSLATE_NOOP("station_finding", "{model}, serial number {serial}."), ""),
    "wrong_model": (
        QT_TRANSLATE_NOOP("station_finding", "“{found}” answers, the profile is for “{expected}”."),
        QT_TRANSLATE_NOOP("station_finding", "Choose the profile that belongs to the device."),
    ),
}
_EXCEPTIONS = {
    1: (
        QT_TRANSLATE_NOOP("station_finding", "it does not know holding registers"),
        QT_TRANSLATE_NOOP("station_finding", "See in its manual how its registers are read."),
    ),
    2: (
        QT_TRANSLATE_NOOP("station_finding", "no such register"),
        QT_TRANSLATE_NOOP(
            "station_finding", "Correct the addresses in the table profile; they count from 0."
        ),
    ),
    4: (
        QT_TRANSLATE_NOOP("station_finding", "the device cannot do it now, or is not unit {unit}"),
        QT_TRANSLATE_NOOP(
            "station_finding",
            "Correct the unit number or choose another table profile; then look at the table.",
        ),
    ),
    6: (
        QT_TRANSLATE_NOOP("station_finding", "it is busy"),
        QT_TRANSLATE_NOOP("station_finding", "Wait and test again."),
    ),
    10: (
        QT_TRANSLATE_NOOP("station_finding", "the gateway knows no way to unit {unit}"),
        QT_TRANSLATE_NOOP("station_finding", "Correct the unit number, or the gateway's table."),
    ),
    11: (
        QT_TRANSLATE_NOOP("station_finding", "behind the gateway nobody answers as unit {unit}"),
        QT_TRANSLATE_NOOP("station_finding", "Correct the unit number; check the line behind the gateway."),
    ),
}
_OTHER_EXCEPTION = (
    QT_TRANSLATE_NOOP("station_finding", "Modbus exception {code}"),
    QT_TRANSLATE_NOOP("station_finding", "See the table's manual."),
)
_JOINTS = {
    "outer": QT_TRANSLATE_NOOP("station_finding", "outer"),
    "inner": QT_TRANSLATE_NOOP("station_finding", "inner"),
}
_NOTES = {
    "starting_bench": QT_TRANSLATE_NOOP("station_finding", "Starting the virtual bench."),
    "opening": QT_TRANSLATE_NOOP("station_finding", "Opening the port."),
    "asking": QT_TRANSLATE_NOOP("station_finding", "Asking."),
    "listening": QT_TRANSLATE_NOOP("station_finding", "Listening to the stream."),
    "trying_bauds": QT_TRANSLATE_NOOP("station_finding", "Listening at other bauds."),
    "trying_units": QT_TRANSLATE_NOOP("station_finding", "Asking other unit numbers."),
    "listening_around": QT_TRANSLATE_NOOP("station_finding", "Looking whether the two ports are exchanged."),
}
#: Findings whose mend is another one behind a serial server, which has the baud in settings of its own.
_SERVER = {
    "silent_rtu": "silent_rtu_server",
    "garbled": "garbled_server",
    "garbled_text": "garbled_text_server",
    "no_frames": "no_frames_server",
}

#: What is told beside what is wrong, with a mend of its own.
_HINTS = (
    "example_site",
    "other_baud",
    "unit_heard",
    "units_heard",
    "profile_heard",
    "imus_line",
    "tables_line",
)

#: Every finding's sentence and mend.
WORDED: dict[str, tuple[str, str]] = {**_OPENING, **TABLE, **IMU}


def as_written(text: str) -> str:
    """A sentence that nobody translates."""
    return text


def word_finding(finding: Finding, say: Callable[[str], str] = as_written) -> tuple[str, str]:
    """What was found, and the mend ("" where there is nothing to mend).

    say : puts a sentence into the listener's language
    """
    values: dict[str, Any] = dict(finding.values)
    name = finding.id
    if name == "opened" and values["device"] != values["port"]:
        name = "opened_as"
    if name == "registers" and not values["count"]:
        name = "no_registers"
    if name in _SERVER and "baud" not in values:
        name = _SERVER[name]
    if values.get("found") == "":
        values["found"] = say(QT_TRANSLATE_NOOP("station_finding", "nothing"))
    if "joint" in values:
        values["joint"] = say(_JOINTS[str(values["joint"])])
    values |= {f"{key}_ms": 1e3 * values[key] for key in ("typical", "worst", "limit") if key in values}
    text, mend = WORDED[name]
    if name == "exception":
        meaning, mend = _EXCEPTIONS.get(int(values["code"]), _OTHER_EXCEPTION)
        values["meaning"] = say(meaning).format(**values)
    shows_mend = finding.state in ("look", "wrong") or name in _HINTS
    return say(text).format(**values), say(mend).format(**values) if mend and shows_mend else ""


def word_note(note: str, say: Callable[[str], str] = as_written) -> str:
    """What a running test is doing."""
    return say(_NOTES[note]) if note in _NOTES else ""
