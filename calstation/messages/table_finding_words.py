"""What a test of the table's link may find: a sentence each, and the mend."""

from calstation.messages.marked import QT_TRANSLATE_NOOP

TABLE = {
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
    "profile_heard": (
        QT_TRANSLATE_NOOP("station_finding", "“{model}” answers as unit {found}."),
        QT_TRANSLATE_NOOP(
            "station_finding", "The table profile is another's: choose {profile}, unit number {found}."
        ),
    ),
    "units_heard": (
        QT_TRANSLATE_NOOP("station_finding", "Unit numbers that answer: {units}."),
        QT_TRANSLATE_NOOP("station_finding", "Correct the unit number, or choose another table profile."),
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
    "fault_untold": (
        QT_TRANSLATE_NOOP("station_finding", "A fault is latched, and the table does not tell its cause."),
        QT_TRANSLATE_NOOP(
            "station_finding", "Read the table's display, remove the cause, then press “Reset the fault”."
        ),
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
