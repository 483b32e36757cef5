"""What a test of the IMU's link may find: a sentence each, and the mend."""

from calstation.messages.marked import QT_TRANSLATE_NOOP

IMU = {
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
            "Make sure of latitude, height and gravity, then confirm the place: in the section Site, or by "
            "“{entry}” in site.confirmed_on of the station file.",
        ),
    ),
    "gravity_missing": (
        QT_TRANSLATE_NOOP(
            "station_finding",
            "Surveyed gravity is missing, and these gyros do not feel the earth turn: a wrong latitude would show "
            "nowhere.",
        ),
        QT_TRANSLATE_NOOP(
            "station_finding",
            "Give site.gravity_mps2 as surveyed at the place, from a gravity net or a gravimeter.",
        ),
    ),
    "gravity_unlike": (
        QT_TRANSLATE_NOOP(
            "station_finding",
            "site.gravity_mps2 = {gravity:g} does not belong to latitude {latitude:g}° and height {height:g} m, where"
            " normal gravity is {normal:.5f} m/s².",
        ),
        QT_TRANSLATE_NOOP("station_finding", "Correct gravity, latitude or height."),
    ),
    "needs_drive": (
        QT_TRANSLATE_NOOP(
            "station_finding",
            "“{rig}” is turned by hand, but stages of “{product}” need a table that is driven.",
        ),
        QT_TRANSLATE_NOOP(
            "station_finding", "Choose a product that is carried by hand (manual = true), or another station."
        ),
    ),
    "needs_hands": (
        QT_TRANSLATE_NOOP(
            "station_finding",
            "“{rig}” is driven, but stages of “{product}” are carried by hand (manual = true).",
        ),
        QT_TRANSLATE_NOOP(
            "station_finding", "Choose another product, or a station with rails turned by hand."
        ),
    ),
    "judged_as": (
        QT_TRANSLATE_NOOP(
            "station_finding", "Looked at as a unit of “{product}”, by the profile “{profile}”."
        ),
        "",
    ),
    "wrong_gravity": (
        QT_TRANSLATE_NOOP(
            "station_finding", "It measures {measured:.3f} m/s², gravity here is {expected:.3f} m/s²."
        ),
        QT_TRANSLATE_NOOP(
            "station_finding",
            "If it stands still: correct accel_lsb, output or the frame's fields in the IMU profile, or choose another"
            " product.",
        ),
    ),
}
