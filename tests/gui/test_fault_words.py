"""Faults as they were told in rehearsals can be said in Chinese, reason and mend."""

import re

import pytest
from PySide6.QtWidgets import QApplication

from calstation.devices.imu import framed_imu, modbus_imu, vectornav_imu
from calstation.devices.interfaces import UNTOLD
from calstation.devices.links import modbus_link
from calstation.gui.text import language
from calstation.gui.text.fault_wording import known, phrase, resettable, word_fault
from calstation.gui.text.wording import word_message
from calstation.runs import engine
from calstation.sequencer.guard import latched

OLD = "the unit was restarted and holds its old registers"
TOLD = [
    "table: does not settle at outer 360.0°, inner 0.0°; look at the drive's tuning and for what shakes the table",
    "table: stands 2.1° away from outer 360.0°, inner 0.0°; look for an obstacle, at encoder and drive, then home the"
    " table",
    "table: registers 17-63 cannot be read: the device cannot do it in its present state (Modbus exception 4);"
    " look at the drive's display",
    "table: registers 17-63 cannot be read on tcp://127.0.0.1:34393 (no answer); check cable, power and unit number",
    "table: it and the IMU are exchanged, its port /dev/ttyUSB0 is the IMU's; exchange table.port and imu.port in the"
    " station file",
    "table: on /dev/ttyUSB0 'bench-table' answers as unit 3, not as unit 7; correct table.unit in the station file",
    "table: asked for its model as unit 7 on tcp://10.0.0.4:502, it refuses: the device cannot do it in its present"
    " state (Modbus exception 4); check the unit number, then look at the drive's display",
    "table: nothing answers in Modbus on tcp://10.0.0.4:502 as unit 7; check cable, power and unit number, and whether"
    " it is the table that is connected there",
    "table: nothing answers in Modbus on /dev/ttyUSB0 as unit 7; check cable, power, baud, parity and unit number, and"
    " whether it is the table that is connected there",
    "table: port tcp://plc:502 cannot be opened: nobody knows this host; correct its name in the station file, or give"
    " its IP address",
    "table: port tcp://10.0.0.4:502 cannot be opened: the host is there but serves nothing at this port; correct the"
    " port number in the station file, see that the device's server is on",
    "table: port tcp://10.0.0.4:502 cannot be opened: no answer within 0.5 s; check power, network cable and the IP"
    " address in the station file",
    "table: model 'WRONGPLC' answers, the profile is for 'bench-table'; choose the right table profile in the station"
    " file",
    "IMU: model 'other' answers, the profile is for 'bench-imu'; choose the right IMU profile in the product file",
    "port tcp://10.0.0.4:502 is in use by another calstation (process 4711 of li, since 2026-11-21 17:23:43); wait for"
    " its end, or end it there",
    "/home/registers/SN-1.jsonl, line 3: does not read as it was written, so it is not known what was written to unit"
    " 'SN-1'; compare the unit's registers with those of its last result (Engineer page), then move this file away",
    "IMU: unit 'SN-1' has had its flash written 10 times of the 10 that IMU profile 'N' allows (flash_cycles_max); take"
    " it out of service, or correct the profile where its data sheet allows more",
    "transfer 20261121T19-ab to unit 'SN-1' was by IMU profile 'MEMS' (product 'C'), this product's is 'nav';"
    " choose a product with that profile (--product)",
    "transfer 20261121T19-ab to unit 'SN-1' has other parameters than the registers of IMU profile 'nav'; choose"
    " the product of its unit (--product)",
    "transfer 20261121T19-ab to unit 'SN-1': the registers of IMU profile 'nav' mean something else now than then;"
    " bring the profile's earlier version back (page Station)",
    "IMU: transfer 20261121T19-ab was to a 'VN-100' of serial number 'SN-1', but a 'VN-110' answers; put that unit"
    " into the fixture",
    "the result is of a unit with IMU profile 'bench_mems', product 'A' has 'bench_nav'; choose the result's own"
    " product, 'C'",
    "/runs/SN-1.h5: its run is still going; stop it first",
    "/runs/SN-1.h5: was carried on in SN-2.h5 and has reached its end there; start a new run",
    "engine: its process ended unexpectedly (exit code -9); the table's watchdog stops the table and stays latched,"
    " where it has one: look at the table, reset its fault ('Reset the fault' in the window, or calstation table"
    " reset), then start again or resume the run at its last finished stage",
    "engine: it gives no sign of life any more; the table's watchdog stops the table and stays latched, where it has"
    " one: look at the table, reset its fault ('Reset the fault' in the window, or calstation table reset), then start"
    " again or resume the run at its last finished stage",
    "/runs/SN-1.h5: began on the virtual bench, but station 'line 3' is hardware now; start a new run",
    "/runs/SN-1.h5: began on station 'line 3', this is 'virtual bench'; give its station file with --station",
    "IMU: port usb:A9XYZ was lost (device reports readiness to read but returned no data); check cable and power",
    "IMU: port usb:A9XYZ: no USB adapter with this serial number is plugged in; plug it in, or correct the port in the"
    " station file; adapters found: none",
    "IMU: the output is no number again and again; switch the unit off and on, check the IMU profile",
    "IMU: no data any more though it was told to stream; switch it off and on, then check cable, power and port",
    "IMU: no data any more, and the unit does not answer either; check its power, cable and port",
    "IMU: not ready 60 s after its restart; switch it off and on",
    "IMU: it restarts again and again; check its supply, plug and cable, then start again",
    "IMU: it restarted while its output was looked at; check its supply, plug and cable, then start again",
    "IMU: it restarted while its new registers were looked at; check its supply, plug and cable, then start again and"
    " finish or restore them",
    "IMU: no rest without a gap within 60 s of its restart; check cable, power and port",
    f"IMU: no answer on socket://127.0.0.1:38315 within 1 s though samples come; check the transmit line and the IMU"
    f" profile; {OLD}",
    "IMU: no answer on socket://127.0.0.1:36813 within 1 s though samples come; check the transmit line and the IMU"
    " profile; the unit holds new registers, not yet proved: calstation registers finish (or restore) SN-000042",
    f"IMU: register 3 (gyro_scale_x) reads back 0 instead of 5.53673053e-05 before the commit; look at the unit's"
    f" supply and write protection, then check type, orders and tolerance of this register in the IMU profile; {OLD}",
    "IMU: register 3 (gyro_scale_x) reads back 0 instead of 1 after the restart; look at the unit's supply and write"
    " protection, then check type, orders and tolerance of this register in the IMU profile; the unit holds neither old"
    " nor new registers: calstation registers finish (or restore) SN-000042",
    "IMU: register 118 is refused: no such register (Modbus exception 2); look at its supply (a unit that restarts"
    f" forgets its page), then check the registers in the IMU profile; {OLD}",
    "IMU: command 'write' was refused: the value is refused; check type, scale and range of the registers in the IMU"
    " profile; what the unit's flash holds will be seen at the next start",
    "IMU: 'VNWRG,84,1,0' was refused: not enough parameters; compare this line with the unit's manual, and correct the"
    " IMU profile",
    "IMU: register 25 answers '1,2', not 12 numbers; compare it with the unit's manual, and correct address or"
    " parameters in the IMU profile",
    "IMU: register 3 answers with 5 bytes, not 15; check its type and parameters in the IMU profile",
    "IMU: register 3 was not taken, nothing was committed; look at the unit's supply and write protection, then check"
    " this register in the IMU profile",
    "IMU: the commit was not done within 5 s; leave its power on until it is, then start again",
    "IMU: page 1 register 100-117 takes no value, so a restart could not be told; look at the unit's write protection",
    "IMU: reading /dev/ttyUSB0 failed (KeyError: 3); start again, and send this text to whoever looks after calstation"
    " where it comes back",
    "table: fault, it tells no cause; read its display, look at cover, limits and drives, remove the cause, then reset"
    " it: 'Reset the fault' in the window, or calstation table reset",
    "table: register 22 of unit 2 cannot be written: the device is busy (Modbus exception 6); wait until it is done,"
    " then start again",
    "table: register 22 of unit 2 cannot be written on /dev/ttyUSB0 (the port was lost: no power); check cable, power"
    " and unit number",
    "table: registers 0-7 cannot be read: the answer has another length; compare op read_words of the IMU profile with"
    " the unit's manual",
    "table: '1SRV1' is refused with 'ERROR 7'; look at the table's display, then compare this line of the table profile"
    " with the controller's manual",
    "table: 'AERO 4000,SN78' answers on tcp://10.0.0.4:7 where 'AERO 4000,SN77' did; nothing was told to it; check"
    " which adapter is plugged in where",
    "IMU: with its new registers earth_rate_up measures 4.61028e-05 rad/s, expected 4.10404e-05 within 4.1e-07; its old"
    " registers were put back; look whether the table was disturbed, whether latitude and gravity in the station file"
    " are right, and whether the IMU profile's registers mean what the unit makes of them; then run again",
    "/runs/SN-1.h5: its disk is nearly full, less than 32 MB are left; make room on it, then resume the run",
    "/runs/SN-1.h5: the log cannot be written any more (No such file or directory); make room on its disk, or bring its"
    " folder back, then resume the run",
    "IMU: gyro x measures 2 °/s at rest, expected -0.959 to 0.959 °/s; replace the unit, or correct prior.gyro_bias"
    " in the IMU profile",
    "site.latitude_deg = 32.25 in the station file, but the unit's gyros see the earth turn as at 34.21° (sigma 0.08°);"
    " correct latitude and gravity of the place, or look at the gyros where another unit agrees with the file",
    "/s.toml: site.gravity_mps2 = 9.8 does not belong to latitude 34.25° and height 400 m, where normal gravity is"
    " 9.79547; correct gravity, latitude or height",
    "/s.toml: site.confirmed_on is missing, not 'pc-1: 34.25 108.9 400.0 9.79547': nobody has said at this computer"
    " that the station stands at latitude 34.25°, longitude 108.9°, height 400 m; make sure of them and of gravity,"
    " then confirm the place on the station page or add 'pc-1: 34.25 108.9 400.0 9.79547' to site.confirmed_on",
    "/s.toml: site.confirmed_on names pc-7: 1.0 2.0 3.0 normal; pc-8: 1.0 2.0 3.0 normal, not 'pc-1: -34.25 108.9 400.0"
    " 9.79547': nobody has said at this computer that the station stands at latitude -34.25°, longitude 108.9°, height"
    " 400 m; make sure of them and of gravity, then confirm the place on the station page or add 'pc-1: -34.25 108.9"
    " 400.0 9.79547' to site.confirmed_on",
]


CODES = [
    *(f"{meaning} (Modbus exception {code})" for code, meaning in modbus_link.MEANINGS.items()),
    *modbus_link.MENDS.values(),
    *modbus_imu.MENDS.values(),
    *framed_imu.ERRORS.values(),
    *framed_imu.MENDS.values(),
    *vectornav_imu.ERRORS.values(),
    *vectornav_imu.MENDS.values(),
    UNTOLD,
]


@pytest.mark.parametrize("words", CODES)
def test_what_a_code_means_and_its_mend_are_said_in_chinese(qapp: QApplication, words: str) -> None:
    language.use("zh_CN")
    try:
        assert not any(
            "a" <= letter <= "z"
            for letter in re.sub(r"Modbus|IMU|\w+\.\w+|\[\w+\]|type|scale|range", "", phrase(words))
        )
    finally:
        language.use("en")


@pytest.mark.parametrize("fault", ["drive", UNTOLD])
def test_a_latched_fault_may_be_reset_from_the_window(fault: str) -> None:
    assert resettable(str(latched(fault)))
    assert resettable(str(latched(fault, " is latched")))
    assert "Reset the fault" in word_fault("DeviceFaultError", str(latched(fault))).mend


@pytest.mark.parametrize("text", TOLD)
def test_a_fault_of_a_rehearsal_is_said_in_chinese(qapp: QApplication, text: str) -> None:
    assert known(text)
    language.use("zh_CN")
    try:
        said = word_fault("DeviceFaultError", text)
    finally:
        language.use("en")
    for words in (said.reason, said.mend):
        assert any("\u4e00" <= letter <= "\u9fff" for letter in words), words


def test_what_a_dead_engine_leaves_latched_can_be_reset(qapp: QApplication) -> None:
    text = f"engine: its process ended unexpectedly (exit code -9); {engine.MEND}"
    assert resettable(text)
    assert "“Reset the fault”" in word_fault("DeviceFaultError", text).mend
    assert not resettable(f"engine: it gives no sign of life any more; {engine.MEND}"), (
        "it may still own the table"
    )


def test_what_a_safe_stop_could_not_do_is_said_in_chinese(qapp: QApplication) -> None:
    text = "table: register 22 cannot be written on tcp://10.0.0.4:502 (no answer); check cable, power and unit number"
    assert word_message("safe_stop_incomplete", {"text": text}).endswith(text)
    language.use("zh_CN")
    try:
        said = word_message("safe_stop_incomplete", {"text": text})
    finally:
        language.use("en")
    assert said.endswith("转台：写不进 tcp://10.0.0.4:502 上的寄存器 22（没有应答）；请检查电缆、电源和站号")
