"""Drivers never take a late Modbus RTU response for the response to another request."""

import sys
from pathlib import Path

import numpy as np
import pytest

from calstation.devices.imu import RegisterMap, open_imu
from calstation.devices.links import SerialLink
from calstation.devices.profiles import SerialSettings, load_imu_profile, load_table_profile
from calstation.devices.table import ModbusTable

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals on Windows")

DATA = Path(__file__).resolve().parents[2] / "data"
TIMEOUT = 0.5
LATE, NEXT = TIMEOUT + 0.05, 0.1


@pytest.mark.long
def test_late_table_response_is_not_taken_for_limits_or_angles(start_bench):
    profile = load_table_profile(DATA / "tables" / "bench.toml").at_station(TIMEOUT, None)
    profile = profile.model_copy(update={"modbus": profile.modbus.model_copy(update={"gap": 0})})
    settings = {"low_deg": [-400.0, -500.0], "high_deg": [600.0, 700.0], "start_deg": [3.0, -4.0]}
    with start_bench(table_transport="rtu", **settings) as bench:
        table = ModbusTable(bench.endpoints["table"], profile, SerialSettings())
        try:
            first = table.status()
            np.testing.assert_allclose(np.rad2deg(first.limits.low), [-400.0, -500.0])
            for _ in range(3):
                for late in (LATE, NEXT):
                    bench.ask(order="slow_table", value=late)
                for _ in range(3):
                    status = table.status()
                    assert status.limits == first.limits
                    np.testing.assert_allclose(status.angles, first.angles, atol=1e-3)
        finally:
            table.close()


@pytest.mark.long
@pytest.mark.parametrize("transport", ["socket", "pty"])
def test_late_imu_response_is_not_taken_for_other_registers(start_bench, transport):
    profile = load_imu_profile(DATA / "imus" / "dsp_modbus.toml").with_commands(timeout_s=TIMEOUT)
    entries = RegisterMap(tuple(profile.registers))
    wanted = entries.rounded({n: 1e-4 * (1 + i / 7) for i, n in enumerate(entries.parameters)})
    with start_bench(grade="mems", imu_protocol="modbus", imu_transport=transport, serial="SN-000042") as bench:
        imu = open_imu(SerialLink(bench.endpoints["imu"], profile.link, "imu"), profile, "")
        try:
            imu.write_registers(wanted)
            for alignment in (0, 3, 6):
                for late in (*[0.0] * alignment, LATE, NEXT):
                    bench.ask(order="slow_imu", value=late)
                assert entries.differing_parameters(wanted, imu.read_registers()) == []
                assert imu.identify().serial == "SN-000042"
        finally:
            imu.close()
