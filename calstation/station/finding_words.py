"""What a connection test found, in words that the window translates: what it is and, where it is wrong, the mend."""

from collections.abc import Callable
from typing import Any

from calstation.station.finding import Finding


def QT_TRANSLATE_NOOP(context: str, text: str) -> str:
    """Marks a text for the translators under the name that lupdate looks for."""
    return text


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
_TABLE = {
    "silent_tcp": (
        QT_TRANSLATE_NOOP("station_finding", "The connection stands, but nobody answers as unit {unit}."),
        QT_TRANSLATE_NOOP("station_finding", "Correct the unit number; see that Modbus TCP is switched on."),
    ),
    "not_modbus": (
        QT_TRANSLATE_NOOP("station_finding", "Something answers, but not in Modbus TCP."),
        QT_TRANSLATE_NOOP("station_finding", "Correct the port number: Modbus TCP is usually 502."),
    ),
    "silent_rtu": (
        QT_TRANSLATE_NOOP("station_finding", "Nobody answers as unit {unit} at {baud} baud."),
        QT_TRANSLATE_NOOP(
            "station_finding",
            "Check power, unit number, baud and parity, and whether the two wires are swapped.",
        ),
    ),
    "garbled": (
        QT_TRANSLATE_NOOP("station_finding", "{count} bytes came, but they are no Modbus answer."),
        QT_TRANSLATE_NOOP(
            "station_finding",
            "Baud or parity is wrong (set here: {baud} baud, parity {parity}), or another device is connected there,"
            " perhaps the IMU.",
        ),
    ),
    "garbled_server": (
        QT_TRANSLATE_NOOP("station_finding", "{count} bytes came, but they are no Modbus answer."),
        QT_TRANSLATE_NOOP(
            "station_finding",
            "Set the baud and parity in the serial server (the profile says {line}); or another device is connected"
            " there, perhaps the IMU.",
        ),
    ),
    "silent_rtu_server": (
        QT_TRANSLATE_NOOP(
            "station_finding", "The serial server is there, but nobody answers as unit {unit}."
        ),
        QT_TRANSLATE_NOOP(
            "station_finding",
            "Check power and unit number, and the baud and parity set in the serial server (the profile says {line}).",
        ),
    ),
    "unit_heard": (
        QT_TRANSLATE_NOOP("station_finding", "“{model}” answers as unit {found}."),
        QT_TRANSLATE_NOOP("station_finding", "Set the unit number to {found} instead of {unit}."),
    ),
    "imus_line": (
        QT_TRANSLATE_NOOP("station_finding", "Frames of “{profile}” come here: this is the IMU's line."),
        QT_TRANSLATE_NOOP("station_finding", "Exchange the ports of table and IMU."),
    ),
    "crc": (
        QT_TRANSLATE_NOOP("station_finding", "The answer's check (CRC) is wrong: bytes are lost or spoilt."),
        QT_TRANSLATE_NOOP(
            "station_finding",
            "Check shielding, grounding and the termination of the line; then the stop bits.",
        ),
    ),
    "echo": (
        QT_TRANSLATE_NOOP("station_finding", "Only the question itself comes back."),
        QT_TRANSLATE_NOOP(
            "station_finding", "Switch the adapter's echo off; see that the table is connected and on."
        ),
    ),
    "other_unit": (
        QT_TRANSLATE_NOOP("station_finding", "Unit {found} answers instead of unit {unit}."),
        QT_TRANSLATE_NOOP("station_finding", "Set the unit number to {found}, or correct it at the table."),
    ),
    "silent_text": (
        QT_TRANSLATE_NOOP("station_finding", "Nothing answers at {baud} baud within {seconds:g} s."),
        QT_TRANSLATE_NOOP(
            "station_finding", "Check power, cable, baud and parity; the table may be under local control."
        ),
    ),
    "silent_host": (
        QT_TRANSLATE_NOOP(
            "station_finding", "The connection stands, but nothing answers within {seconds:g} s."
        ),
        QT_TRANSLATE_NOOP("station_finding", "Check the port number, and [text] in the table profile."),
    ),
    "garbled_text": (
        QT_TRANSLATE_NOOP("station_finding", "{count} bytes came, but they are no text."),
        QT_TRANSLATE_NOOP(
            "station_finding",
            "Baud or parity is wrong (set here: {baud} baud, parity {parity}), or another device is connected there,"
            " perhaps the IMU.",
        ),
    ),
    "garbled_text_server": (
        QT_TRANSLATE_NOOP("station_finding", "{count} bytes came, but they are no text."),
        QT_TRANSLATE_NOOP(
            "station_finding",
            "Set the baud and parity in the serial server, where there is one (the profile says {line}); or another"
            " device is connected there, perhaps the IMU.",
        ),
    ),
    "unlike_text": (
        QT_TRANSLATE_NOOP("station_finding", "Something answers, but not as the profile says: “{said}”."),
        QT_TRANSLATE_NOOP("station_finding", "Compare [text] in the table profile with the table's manual."),
    ),
    "unlike_answer": (
        QT_TRANSLATE_NOOP("station_finding", "An answer does not look as the profile says."),
        QT_TRANSLATE_NOOP("station_finding", "Correct its pattern under [text.queries] ({words})."),
    ),
    "no_number": (
        QT_TRANSLATE_NOOP("station_finding", "A register does not hold what the profile says."),
        QT_TRANSLATE_NOOP("station_finding", "Correct its entry under [registers] ({words})."),
    ),
    "line_refused": (
        QT_TRANSLATE_NOOP("station_finding", "The table refuses a question ({words})."),
        QT_TRANSLATE_NOOP("station_finding", "Correct [text.queries] in the table profile."),
    ),
    "no_watchdog": (
        QT_TRANSLATE_NOOP(
            "station_finding",
            "The profile knows no watchdog of it: only moves to angles are made, which end by themselves.",
        ),
        "",
    ),
    "exception": (QT_TRANSLATE_NOOP("station_finding", "The table refuses to be read: {meaning}."), ""),
    "round_trip": (
        QT_TRANSLATE_NOOP(
            "station_finding",
            "{count} polls answered: {typical_ms:.1f} ms as a rule, {worst_ms:.1f} ms at worst.",
        ),
        QT_TRANSLATE_NOOP(
            "station_finding", "More than {limit_ms:.0f} ms counts as lost: look for load on the line."
        ),
    ),
    "watchdog": (
        QT_TRANSLATE_NOOP("station_finding", "Its watchdog stops it after {seconds:g} s without a word."),
        "",
    ),
    "watchdog_off": (
        QT_TRANSLATE_NOOP(
            "station_finding", "Its watchdog is off (0): nothing would stop it if this computer died."
        ),
        QT_TRANSLATE_NOOP(
            "station_finding",
            "Set the watchdog's time in the drive, 1000 ms for example; no run starts without.",
        ),
    ),
    "fault": (
        QT_TRANSLATE_NOOP("station_finding", "The fault “{fault}” is latched."),
        QT_TRANSLATE_NOOP("station_finding", "Remove its cause, then press “Reset the fault”."),
    ),
    "local_control": (
        QT_TRANSLATE_NOOP("station_finding", "The table is under local control."),
        QT_TRANSLATE_NOOP("station_finding", "Switch it to remote control at its panel."),
    ),
    "interlock": (QT_TRANSLATE_NOOP("station_finding", "The interlock is closed."), ""),
    "interlock_open": (
        QT_TRANSLATE_NOOP("station_finding", "The interlock is open."),
        QT_TRANSLATE_NOOP("station_finding", "Close the cover before a run."),
    ),
    "angles": (QT_TRANSLATE_NOOP("station_finding", "Outer {outer:.3f}°, inner {inner:.3f}°."), ""),
    "moving": (
        QT_TRANSLATE_NOOP("station_finding", "The table is moving, though nothing here has asked it to."),
        QT_TRANSLATE_NOOP("station_finding", "Find out who else commands it before a run."),
    ),
    "not_homed": (
        QT_TRANSLATE_NOOP("station_finding", "Not homed since power-on; a run homes it first, slowly."),
        "",
    ),
    "outside_travel": (
        QT_TRANSLATE_NOOP(
            "station_finding",
            "The {joint} axis says {angle:.1f}°, outside the profile's {profile_low:g}° to {profile_high:g}°.",
        ),
        QT_TRANSLATE_NOOP(
            "station_finding", "Correct the register's scale or address, or the travel, in the table profile."
        ),
    ),
    "travel_narrower": (
        QT_TRANSLATE_NOOP(
            "station_finding",
            "The {joint} axis allows {low:g}° to {high:g}°, the profile {profile_low:g}° to {profile_high:g}°.",
        ),
        QT_TRANSLATE_NOOP(
            "station_finding", "Make the profile's travel no wider than the table's, or widen the table's."
        ),
    ),
    "travel": (
        QT_TRANSLATE_NOOP(
            "station_finding", "The {joint} axis allows {low:g}° to {high:g}°, as the profile needs."
        ),
        "",
    ),
}
_IMU = {
    "silent": (
        QT_TRANSLATE_NOOP("station_finding", "Not a byte comes from the unit."),
        QT_TRANSLATE_NOOP(
            "station_finding", "Check power, cable and port; transmit and receive may be swapped."
        ),
    ),
    "no_frames": (
        QT_TRANSLATE_NOOP(
            "station_finding", "{bytes} bytes came, but no frame of “{profile}” is among them."
        ),
        QT_TRANSLATE_NOOP(
            "station_finding",
            "Baud or parity is wrong (set here: {baud} baud, parity {parity}), or the profile is another unit's.",
        ),
    ),
    "no_frames_server": (
        QT_TRANSLATE_NOOP(
            "station_finding", "{bytes} bytes came, but no frame of “{profile}” is among them."
        ),
        QT_TRANSLATE_NOOP(
            "station_finding",
            "Set the baud and parity in the serial server (the profile says {line}), or choose the unit's own profile.",
        ),
    ),
    "tables_line": (
        QT_TRANSLATE_NOOP("station_finding", "The table answers here: this is its line."),
        QT_TRANSLATE_NOOP("station_finding", "Exchange the ports of table and IMU."),
    ),
    "other_baud": (
        QT_TRANSLATE_NOOP("station_finding", "At {found} baud the frames are right."),
        QT_TRANSLATE_NOOP("station_finding", "Set the baud to {found} instead of {baud}."),
    ),
    "wrong_checks": (
        QT_TRANSLATE_NOOP("station_finding", "Frames begin, but the check of every one ({kind}) is wrong."),
        QT_TRANSLATE_NOOP(
            "station_finding",
            "Correct the frame's fields and check in the IMU profile; then parity and stop bits.",
        ),
    ),
    "line_sync": (
        QT_TRANSLATE_NOOP("station_finding", "Lines come, but none begins with “{sync}”: “{line}”."),
        QT_TRANSLATE_NOOP("station_finding", "Correct sync in [frame] of the IMU profile."),
    ),
    "line_mark": (
        QT_TRANSLATE_NOOP(
            "station_finding", "Lines come, but without “{mark}” and a check behind it: “{line}”."
        ),
        QT_TRANSLATE_NOOP("station_finding", "Correct mark and crc in [frame] of the IMU profile."),
    ),
    "line_check": (
        QT_TRANSLATE_NOOP(
            "station_finding",
            "Lines come, but their check is wrong: “{line}” says {told}, {kind} from byte {start} on is {right}.",
        ),
        QT_TRANSLATE_NOOP("station_finding", "Correct crc.kind or crc.start in [frame] of the IMU profile."),
    ),
    "line_separator": (
        QT_TRANSLATE_NOOP("station_finding", "Behind “{sync}” no separator “{separator}” stands: “{line}”."),
        QT_TRANSLATE_NOOP(
            "station_finding",
            "Correct sync, which ends before the first separator, or separator, in [frame] of the IMU profile.",
        ),
    ),
    "line_column": (
        QT_TRANSLATE_NOOP("station_finding", "Column {column} is “{text}”, no number for {field}: “{line}”."),
        QT_TRANSLATE_NOOP(
            "station_finding",
            "Correct the fields in [frame] of the IMU profile; columns count from 0 behind the first separator.",
        ),
    ),
    "line_short": (
        QT_TRANSLATE_NOOP(
            "station_finding", "There is no column {column} for {field}; the line has {count}: “{line}”."
        ),
        QT_TRANSLATE_NOOP(
            "station_finding",
            "Correct the fields in [frame] of the IMU profile; columns count from 0 behind the first separator.",
        ),
    ),
    "no_samples": (
        QT_TRANSLATE_NOOP(
            "station_finding", "{frames} frames came, but none with the counter and all six channels."
        ),
        QT_TRANSLATE_NOOP(
            "station_finding",
            "Correct the fields in [frame] of the IMU profile, or what the unit is set to send.",
        ),
    ),
    "one_way": (
        QT_TRANSLATE_NOOP("station_finding", "{frames} samples came, but no command is answered."),
        QT_TRANSLATE_NOOP(
            "station_finding",
            "Check the wire that transmits to the unit; then [commands] in the IMU profile.",
        ),
    ),
    "command_refused": (
        QT_TRANSLATE_NOOP("station_finding", "The unit refuses a command ({words})."),
        QT_TRANSLATE_NOOP("station_finding", "Correct [commands] in the IMU profile."),
    ),
    "cannot_tell": (
        QT_TRANSLATE_NOOP(
            "station_finding", "The unit only streams and cannot say who it is; its number is typed in."
        ),
        "",
    ),
    "serial_unlike": (
        QT_TRANSLATE_NOOP(
            "station_finding", "Serial number {serial} does not fit the product's pattern {pattern}."
        ),
        QT_TRANSLATE_NOOP(
            "station_finding", "Choose the product that belongs to the unit, or correct its pattern."
        ),
    ),
    "registers": (QT_TRANSLATE_NOOP("station_finding", "{count} calibration registers read."), ""),
    "no_registers": (
        QT_TRANSLATE_NOOP(
            "station_finding", "The profile names no calibration registers; nothing will be written."
        ),
        "",
    ),
    "registers_unread": (
        QT_TRANSLATE_NOOP("station_finding", "The calibration registers cannot be read."),
        QT_TRANSLATE_NOOP("station_finding", "Correct [[registers]] in the IMU profile ({words})."),
    ),
    "rate": (QT_TRANSLATE_NOOP("station_finding", "{measured:.1f} samples per second, as expected."), ""),
    "wrong_rate": (
        QT_TRANSLATE_NOOP(
            "station_finding", "{measured:.1f} samples per second, the profile says {expected:g}."
        ),
        QT_TRANSLATE_NOOP(
            "station_finding", "Set the unit's rate, or correct sample_rate_hz in the IMU profile."
        ),
    ),
    "no_stream": (
        QT_TRANSLATE_NOOP("station_finding", "The unit answers, but sends no samples."),
        QT_TRANSLATE_NOOP("station_finding", "Switch its output on; check [frame] in the IMU profile."),
    ),
    "no_gaps": (QT_TRANSLATE_NOOP("station_finding", "{count} samples without a gap."), ""),
    "gaps": (
        QT_TRANSLATE_NOOP(
            "station_finding", "{gaps} gaps, {missing} samples missing, {errors} frames with a wrong check."
        ),
        QT_TRANSLATE_NOOP(
            "station_finding", "Check the cable; raise the baud if it is too low for the rate."
        ),
    ),
    "self_test_failed": (
        QT_TRANSLATE_NOOP("station_finding", "The unit reports a failed self-test."),
        QT_TRANSLATE_NOOP("station_finding", "Replace the unit, or correct [status] in the IMU profile."),
    ),
    "saturated": (
        QT_TRANSLATE_NOOP("station_finding", "The unit reports a saturated output."),
        QT_TRANSLATE_NOOP("station_finding", "Let it stand still and test again."),
    ),
    "not_ready": (
        QT_TRANSLATE_NOOP("station_finding", "The unit is not ready after {seconds:g} s."),
        QT_TRANSLATE_NOOP("station_finding", "Wait and test again, or correct [status] in the IMU profile."),
    ),
    "temperature": (QT_TRANSLATE_NOOP("station_finding", "Its temperature is {celsius:.1f} °C."), ""),
    "gravity": (
        QT_TRANSLATE_NOOP(
            "station_finding", "It measures {measured:.3f} m/s², gravity here is {expected:.3f} m/s²."
        ),
        "",
    ),
    "example_site": (
        QT_TRANSLATE_NOOP(
            "station_finding",
            "The site is still the example's: {latitude:g}°, {longitude:g}°, {height:g} m.",
        ),
        QT_TRANSLATE_NOOP("station_finding", "Put in the site of this station, unless it stands just there."),
    ),
    "place_not_confirmed": (
        QT_TRANSLATE_NOOP(
            "station_finding",
            "Nobody has said at this computer ({computer}) that the station stands where its file says.",
        ),
        QT_TRANSLATE_NOOP(
            "station_finding",
            "Make sure of latitude, height and gravity, then confirm the place in the section Site.",
        ),
    ),
    "wrong_gravity": (
        QT_TRANSLATE_NOOP(
            "station_finding", "It measures {measured:.3f} m/s², gravity here is {expected:.3f} m/s²."
        ),
        QT_TRANSLATE_NOOP(
            "station_finding",
            "If it stands still: correct accel_lsb, output or the frame's fields in the IMU profile.",
        ),
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
        QT_TRANSLATE_NOOP("station_finding", "Correct the unit number; then look at the table."),
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
_SERVER = {
    "silent_rtu": "silent_rtu_server",
    "garbled": "garbled_server",
    "garbled_text": "garbled_text_server",
    "no_frames": "no_frames_server",
}
"""Findings whose mend is another one behind a serial server, which has the baud in settings of its own."""

_HINTS = ("example_site", "other_baud", "unit_heard", "imus_line", "tables_line")
"""What is told beside what is wrong, with a mend of its own."""

WORDED: dict[str, tuple[str, str]] = {**_OPENING, **_TABLE, **_IMU}
"""Every finding's sentence and mend."""


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
