"""Every sentence of a run's faults, for the translators: `fault_wording` knows each by its pattern."""

from calstation.messages.marked import QT_TRANSLATE_NOOP

#: The sentences of a run's faults, values in numbered braces.
SENTENCES: tuple[str, ...] = (
    QT_TRANSLATE_NOOP(
        "faults", "table: it is under local control; switch it to remote control, then start again"
    ),
    QT_TRANSLATE_NOOP("faults", "table: it was switched to local control; switch it back, then start again"),
    QT_TRANSLATE_NOOP("faults", "table: the interlock is open; close the cover and start again"),
    QT_TRANSLATE_NOOP("faults", "table: the interlock was opened; close the cover and start again"),
    QT_TRANSLATE_NOOP(
        "faults",
        "table: the watchdog is off (0); set its timeout in the drive, e.g. 1000 ms, before any run",
    ),
    QT_TRANSLATE_NOOP("faults", "table: the axes are not enabled; check the drive's enable input"),
    QT_TRANSLATE_NOOP("faults", "table: the axes are not homed; home the table first"),
    QT_TRANSLATE_NOOP("faults", "table: the drive switched the axes off; look at the drive's display"),
    QT_TRANSLATE_NOOP("faults", "table: the drive does not enable its axes"),
    QT_TRANSLATE_NOOP("faults", "table: does not come to rest after a stop command"),
    QT_TRANSLATE_NOOP("faults", "table: homing did not end within {0} s; check the home switches"),
    QT_TRANSLATE_NOOP(
        "faults",
        "table: did not reach outer {0}°, inner {1}° in time; look for an obstacle or a stalled drive",
    ),
    QT_TRANSLATE_NOOP(
        "faults", "table: port {0} cannot be opened; check cable, power and the port in the station file"
    ),
    QT_TRANSLATE_NOOP(
        "faults",
        "table: it and the IMU are exchanged, its port {0} is the IMU's; exchange table.port and imu.port in the"
        " station file",
    ),
    QT_TRANSLATE_NOOP(
        "faults",
        "table: on {0} '{1}' answers as unit {2}, not as unit {3}; correct table.unit in the station file",
    ),
    QT_TRANSLATE_NOOP(
        "faults",
        "table: asked for its model as unit {0} on {1}, it refuses: {2} (Modbus exception {3}); check the unit"
        " number, then look at the drive's display",
    ),
    QT_TRANSLATE_NOOP(
        "faults",
        "table: nothing answers in Modbus on {0} as unit {1}; check cable, power and unit number, and whether it is"
        " the table that is connected there",
    ),
    QT_TRANSLATE_NOOP(
        "faults",
        "table: nothing answers in Modbus on {0} as unit {1}; check cable, power, baud, parity and unit number, and"
        " whether it is the table that is connected there",
    ),
    QT_TRANSLATE_NOOP(
        "faults",
        "table: port {0} cannot be opened: nobody knows this host; correct its name in the station file, or give its"
        " IP address",
    ),
    QT_TRANSLATE_NOOP(
        "faults",
        "table: port {0} cannot be opened: the host is there but serves nothing at this port; correct the port number"
        " in the station file, see that the device's server is on",
    ),
    QT_TRANSLATE_NOOP(
        "faults",
        "table: port {0} cannot be opened: no answer within {1} s; check power, network cable and the IP address in"
        " the station file",
    ),
    QT_TRANSLATE_NOOP("faults", "table: port {0} cannot be opened ({1}); {2}"),
    QT_TRANSLATE_NOOP(
        "faults",
        "table: model '{0}' answers, the profile is for '{1}'; choose the right table profile in the station file",
    ),
    QT_TRANSLATE_NOOP(
        "faults",
        "IMU: model '{0}' answers, the profile is for '{1}'; choose the right IMU profile in the product file",
    ),
    QT_TRANSLATE_NOOP("faults", "IMU: no data; check port, baud and power"),
    QT_TRANSLATE_NOOP(
        "faults",
        "IMU: {0} shows the same value all the time; "
        "switch the unit off and on, replace it where that does not help",
    ),
    QT_TRANSLATE_NOOP("faults", "IMU: no data any more; check cable, power and port"),
    QT_TRANSLATE_NOOP("faults", "IMU: no data during a turn; check cable, power and port"),
    QT_TRANSLATE_NOOP(
        "faults",
        "IMU: samples are lost again and again; check cable, baud and the load of this computer",
    ),
    QT_TRANSLATE_NOOP(
        "faults",
        "IMU: the output saturates in this step; lower the rate in the product's schedule",
    ),
    QT_TRANSLATE_NOOP(
        "faults", "IMU: {0} s of data did not come in time; check the link and the sample rate"
    ),
    QT_TRANSLATE_NOOP(
        "faults",
        "IMU: no data any more though it was told to stream; switch it off and on, then check cable, power and port",
    ),
    QT_TRANSLATE_NOOP(
        "faults",
        "IMU: no data any more, and the unit does not answer either; check its power, cable and port",
    ),
    QT_TRANSLATE_NOOP("faults", "IMU: not ready {0} s after its restart; switch it off and on"),
    QT_TRANSLATE_NOOP(
        "faults", "IMU: it restarts again and again; check its supply, plug and cable, then start again"
    ),
    QT_TRANSLATE_NOOP(
        "faults",
        "IMU: it restarted while its output was looked at; check its supply, plug and cable, then start again",
    ),
    QT_TRANSLATE_NOOP(
        "faults",
        "IMU: it restarted while its new registers were looked at; check its supply, plug and cable, then start again"
        " and finish or restore them",
    ),
    QT_TRANSLATE_NOOP(
        "faults",
        "IMU: no rest without a gap within {0} s of its restart; check cable, power and port",
    ),
    QT_TRANSLATE_NOOP(
        "faults",
        "IMU: the unit answers to serial number '{0}', not '{1}'; "
        "check the unit in the fixture and the number given",
    ),
    QT_TRANSLATE_NOOP("faults", "IMU: not ready after {0} s; check power, port, baud and parity"),
    QT_TRANSLATE_NOOP("faults", "IMU: the unit reports a failed self-test; replace the unit"),
    QT_TRANSLATE_NOOP(
        "faults",
        "IMU: gyro {0} measures {1} °/s at rest, expected {2} to {3} °/s; replace the unit, or correct prior.gyro_bias"
        " in the IMU profile",
    ),
    QT_TRANSLATE_NOOP(
        "faults",
        "IMU: temperature still drifts by {0} °C/min after {1} s; "
        "wait, or allow more in the product's warm_up",
    ),
    QT_TRANSLATE_NOOP("faults", "IMU: data have gaps already at rest; check cable, baud and sample rate"),
    QT_TRANSLATE_NOOP(
        "faults",
        "IMU: gravity measures {0} m/s², expected {1} m/s²; "
        "check the IMU profile's accel_lsb and output, and the unit",
    ),
    QT_TRANSLATE_NOOP(
        "faults",
        "IMU: gravity points {0}° away from the declared mounting; "
        "check how the unit is mounted and the table profile's axes",
    ),
    QT_TRANSLATE_NOOP(
        "faults",
        "IMU: a turn of the {0} axis measures {1}° away from the declared axis; "
        "check how the unit is mounted and the table profile's axes",
    ),
    QT_TRANSLATE_NOOP(
        "faults",
        "IMU: a turn of {0}° of the {1} axis measures {2}° about it; check axes, mounting and gyro_lsb",
    ),
    QT_TRANSLATE_NOOP("faults", "IMU: port {0} cannot be opened ({1}); {2}"),
    QT_TRANSLATE_NOOP(
        "faults", "IMU: no answer on {0} within {1} s, not a byte came; check power, cable and port"
    ),
    QT_TRANSLATE_NOOP(
        "faults",
        "IMU: bytes come on {0} but no frame is recognised; "
        "check baud, parity, stop bits and the IMU profile",
    ),
    QT_TRANSLATE_NOOP("faults", "IMU: {0} = {1} does not fit register {2} ({3} to {4}); nothing was written"),
    QT_TRANSLATE_NOOP(
        "faults", "IMU: the unit refused to commit its registers; power it off and on, try again"
    ),
    QT_TRANSLATE_NOOP(
        "faults",
        "table: does not settle at outer {0}°, inner {1}°; look at the drive's tuning and for what shakes the"
        " table",
    ),
    QT_TRANSLATE_NOOP(
        "faults",
        "table: stands {0}° away from outer {1}°, inner {2}°; look for an obstacle, at encoder and drive, then home the"
        " table",
    ),
    QT_TRANSLATE_NOOP("faults", "table: port {0} was lost ({1}); check cable and power"),
    QT_TRANSLATE_NOOP(
        "faults",
        "table: '{0}' is not answered on {1} within {2} s; check cable, power, baud and the table profile",
    ),
    QT_TRANSLATE_NOOP(
        "faults",
        "table: port {0}: no USB adapter with this serial number is plugged in; plug it in, or correct the "
        "port in the station file; adapters found: {1}",
    ),
    QT_TRANSLATE_NOOP(
        "faults",
        "IMU: port {0}: no USB adapter with this serial number is plugged in; plug it in, or correct the port"
        " in the station file; adapters found: {1}",
    ),
    QT_TRANSLATE_NOOP("faults", "IMU: port {0} was lost ({1}); check cable and power"),
    QT_TRANSLATE_NOOP(
        "faults",
        "IMU: the output is no number again and again; switch the unit off and on, check the IMU profile",
    ),
    QT_TRANSLATE_NOOP(
        "faults",
        "IMU: the output is no number; switch the unit off and on, check the IMU profile",
    ),
    QT_TRANSLATE_NOOP(
        "faults",
        "IMU: the output saturates though the table rests or turns slowly; look for what shakes the unit, "
        "check the IMU profile",
    ),
    QT_TRANSLATE_NOOP(
        "faults",
        "IMU: samples are lost or spoilt again and again; check cable, baud and the load of this computer",
    ),
    QT_TRANSLATE_NOOP(
        "faults",
        "IMU: no answer on {0} within {1} s, the bytes that come are no frames; check baud, parity and the "
        "IMU profile",
    ),
    QT_TRANSLATE_NOOP(
        "faults",
        "IMU: no answer on {0} within {1} s though samples come; check the transmit line and the IMU profile",
    ),
    QT_TRANSLATE_NOOP(
        "faults",
        "IMU: its old registers are back, but with them {0} measures {1}, expected {2} within {3}; calibrate the unit"
        " before it is used",
    ),
    QT_TRANSLATE_NOOP(
        "faults",
        "table: its {0} axis cannot turn by {1}° to either side, so no turn can prove the unit's output; widen its"
        " travel",
    ),
    QT_TRANSLATE_NOOP(
        "faults",
        "IMU: unit '{0}' is in the fixture, the values are for '{1}'; nothing was written; change the unit or open"
        " its own result",
    ),
    QT_TRANSLATE_NOOP(
        "faults",
        "IMU: the unit makes of its new registers something else than they mean: {0} {1}, at most {2}; its old"
        " registers were put back; look whether the table was disturbed, and correct the IMU profile's convention,"
        " sign, order and places of the registers; then run again",
    ),
    QT_TRANSLATE_NOOP(
        "faults",
        "IMU: with its new registers {0} measures {1}, expected {2} within {3}; its old registers were put "
        "back; look whether the table was disturbed, whether latitude and gravity in the station file are "
        "right, and whether the IMU profile's registers mean what the unit makes of them; then run again",
    ),
    QT_TRANSLATE_NOOP(
        "faults",
        "{0}: its disk is nearly full, less than {1} MB are left; make room on it, then resume the run",
    ),
    QT_TRANSLATE_NOOP(
        "faults",
        "{0}: the log cannot be written any more ({1}); make room on its disk, or bring its folder back, then"
        " resume the run",
    ),
    QT_TRANSLATE_NOOP(
        "faults",
        "site.latitude_deg = {0} in the station file, but the unit's gyros see the earth turn as at {1}° (sigma {2}°);"
        " correct latitude and gravity of the place, or look at the gyros where another unit agrees with the file",
    ),
    QT_TRANSLATE_NOOP(
        "faults",
        "{0}: site.gravity_mps2 is missing, and gyros of this grade do not feel the earth turn: a wrong latitude"
        " would show nowhere; add the gravity surveyed at the place, from a gravity net or a gravimeter",
    ),
    QT_TRANSLATE_NOOP(
        "faults",
        "{0}: site.gravity_mps2 = {1} does not belong to latitude {2}° and height {3} m, where normal gravity is {4};"
        " correct gravity, latitude or height",
    ),
    QT_TRANSLATE_NOOP(
        "faults",
        "table: registers {0}-{1} cannot be read on {2} ({3}); check cable, power and unit number",
    ),
    QT_TRANSLATE_NOOP(
        "faults",
        "table: register {0} cannot be written on {1} ({2}); check cable, power and unit number",
    ),
    QT_TRANSLATE_NOOP("faults", "table: registers {0}-{1} cannot be read: {2}; {3}"),
    QT_TRANSLATE_NOOP("faults", "table: register {0} cannot be written: {1}; {2}"),
    QT_TRANSLATE_NOOP(
        "faults",
        "table: registers.{0} ({1}) holds no number; check its address, type and word_order in the table profile",
    ),
    QT_TRANSLATE_NOOP(
        "faults",
        "table: '{0}' is refused with '{1}'; look at the table's display, then compare this line of the table profile"
        " with the controller's manual",
    ),
    QT_TRANSLATE_NOOP(
        "faults",
        "table: '{0}' answers on {1} where '{2}' did; nothing was told to it; check which adapter is plugged in where",
    ),
    QT_TRANSLATE_NOOP(
        "faults",
        "table: '{0}' is answered with '{1}', which queries.{2} of the profile does not expect; correct its answer",
    ),
    QT_TRANSLATE_NOOP("faults", "table: '{0}' is no number; correct the query's answer in the table profile"),
    QT_TRANSLATE_NOOP("faults", "table: '{0}' is no number of base {1}; correct the flags"),
    QT_TRANSLATE_NOOP("faults", "IMU: register {0} is refused: {1}; {2}"),
    QT_TRANSLATE_NOOP("faults", "IMU: command '{0}' was refused: {1}; {2}"),
    QT_TRANSLATE_NOOP("faults", "IMU: '{0}' was refused: {1}; {2}"),
    QT_TRANSLATE_NOOP(
        "faults",
        "IMU: register {0} answers '{1}', not {2} numbers; compare it with the unit's manual, and correct address or"
        " parameters in the IMU profile",
    ),
    QT_TRANSLATE_NOOP(
        "faults",
        "IMU: register {0} answers with {1} bytes, not {2}; check its type and parameters in the IMU profile",
    ),
    QT_TRANSLATE_NOOP(
        "faults",
        "IMU: register {0} was not taken, nothing was committed; look at the unit's supply and write protection, then"
        " check this register in the IMU profile",
    ),
    QT_TRANSLATE_NOOP(
        "faults",
        "IMU: register {0} ({1}) reads back {2} instead of {3} {4}; look at the unit's supply and write protection,"
        " then check type, orders and tolerance of this register in the IMU profile",
    ),
    QT_TRANSLATE_NOOP(
        "faults",
        "IMU: reading {0} failed ({1}); start again, and send this text to whoever looks after calstation where it"
        " comes back",
    ),
    QT_TRANSLATE_NOOP(
        "faults",
        "IMU: the unit's accelerometer matrix is not lower triangular, so it is not from this program and cannot be"
        " calibrated upon; restore the unit's factory settings first",
    ),
    QT_TRANSLATE_NOOP("faults", "IMU: identity '{0}' is not 'model;serial;firmware'; choose another profile"),
    QT_TRANSLATE_NOOP(
        "faults",
        "IMU: the {0} was not done within {1} s; leave its power on until it is, then start again",
    ),
    QT_TRANSLATE_NOOP(
        "faults",
        "IMU: the unit's flash is still busy {0} s after its commit; leave its power on until it is done, then start"
        " again",
    ),
    QT_TRANSLATE_NOOP(
        "faults",
        "IMU: {0} takes no value, so a restart could not be told; look at the unit's write protection",
    ),
    QT_TRANSLATE_NOOP(
        "faults",
        "IMU: the unit answers but has not restarted within {0} s of its reset, so what its flash holds is not known;"
        " switch its power off and on, then start again",
    ),
    QT_TRANSLATE_NOOP("faults", "virtual bench: its process has ended; start the run again"),
    QT_TRANSLATE_NOOP("faults", "virtual bench: lost ({0}); start the run again"),
    QT_TRANSLATE_NOOP("faults", "{0}: was carried on in {1} and has reached its end there; start a new run"),
    QT_TRANSLATE_NOOP(
        "faults",
        "transfer {0} to unit '{1}': the registers of IMU profile '{2}' mean something else now than then; bring the "
        "profile's earlier version back (page Station)",
    ),
    QT_TRANSLATE_NOOP(
        "faults",
        "IMU: transfer {0} was to a '{1}' of serial number '{2}', but a '{3}' answers; put that unit into the fixture",
    ),
    QT_TRANSLATE_NOOP(
        "faults",
        "the result is of a unit with IMU profile '{0}', product '{1}' has '{2}'; choose the result's own product, "
        "'{3}'",
    ),
    QT_TRANSLATE_NOOP(
        "faults",
        "serial number '{0}' does not fit the product's pattern '{1}'; "
        "choose the product that belongs to the unit",
    ),
)
