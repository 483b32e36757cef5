"""Simulated units with the protocols of other manufacturers: documented replies, and their drivers."""

import struct
from pathlib import Path

import numpy as np
import pytest
from fastcrc import crc16

from calstation.bench import BenchConfig
from calstation.bench.imu import UNITS
from calstation.bench.imu.units.vectornav import SAMPLES, check_line
from calstation.bench.truth import StreamOutput
from calstation.devices.imu import ImuRefusalError, RegisterMap, open_imu
from calstation.devices.links import SerialLink
from calstation.devices.profiles import load_imu_profile
from tests.devices.powered_unit import shipped

IMUS = Path(__file__).parents[2] / "data" / "imus"
PLAIN = "1,0,0,0,1,0,0,0,1,0,0,0"


def rtu_checksum(data):
    return crc16.modbus(data).to_bytes(2, "little")


class Unit:
    """A unit with one connection and its own time."""

    def __init__(self, kind, **changes):
        self.unit = kind(BenchConfig(serial="SN-7", warm_up_c=0.0, **changes))
        self.time = 1.0
        self._hear = self.unit.new_parser()

    def __call__(self, data):
        return b"".join(self._hear(data, self.time))

    def lines(self, *words):
        sent = "".join(f"${w}*{check_line(w):02X}\r\n" for w in words)
        return [line.split("*")[0][1:] for line in self(sent.encode()).decode().split("\r\n")[:-1]]

    def rtu(self, *body):
        return self(bytes(body) + rtu_checksum(bytes(body)))


def test_checksums_match_the_manufacturers_examples():
    assert check_line("VNERR,03") == 0x72
    assert check_line("VNRRG,30,0,0,0,0,1,0,1") == 0x6C
    assert crc16.xmodem(b"123456789") == 0x31C3
    assert rtu_checksum(b"123456789") == b"\x37\x4b"


def test_vectornav_replies_match_the_protocol():
    unit = Unit(UNITS["vectornav"])
    assert unit.lines("VNRRG,1", "VNRRG,03") == ["VNRRG,01,VN-100T", "VNRRG,03,SN-7"]
    ones = ",".join(f"{float(v):+.6E}" for v in PLAIN.split(","))
    assert unit.lines("VNRRG,25", "VNRRG,84") == [f"VNRRG,25,{ones}", f"VNRRG,84,{ones}"]
    assert unit.lines("VNFOO", "VNRRG", "VNRRG,99", "VNWRG,84,1,2", f"VNWRG,84,{PLAIN},0", "VNWRG,1,x") == [
        "VNERR,04", "VNERR,05", "VNERR,08", "VNERR,05", "VNERR,06", "VNERR,09",
    ]  # fmt: skip
    divisors = [f"VNWRG,75,1,{divisor},05,0001,001C" for divisor in (7, 0, -4)]
    assert unit.lines(f"VNWRG,84,{PLAIN.replace('0', 'x')}", "VNWRG,6,14", *divisors) == ["VNERR,07"] * 5
    assert unit(b"$VNRRG,1*00\r\n$VNRRG,1*XX\r\nnoise\r\n").count(b"VNERR,03") == 1


def test_vectornav_registers_survive_a_reset_only_after_a_commit():
    unit = Unit(UNITS["vectornav"])
    write = "VNWRG,84,1.00012345,0.5,0,0,1,0,0,0,1,1E-3,-2E-3,3E-3"
    assert unit.lines(write) == [write]
    unit.lines("VNRST")
    assert unit.lines("VNRRG,84")[0].endswith("+0.000000E+00")
    assert unit.lines(write, "VNWNV", "VNRST")[1:] == ["VNWNV", "VNRST"]
    assert unit.lines("VNRRG,84")[0].startswith("VNRRG,84,+1.000124E+00,+5.000000E-01")
    assert unit.unit.flash.cycles == 1


def test_vectornav_sample_frame_matches_the_protocol():
    unit = Unit(UNITS["vectornav"])
    unit.unit.scale = np.array([1e-3] * 3 + [1e-2] * 3)
    output = StreamOutput(np.array([[1.0, 2, 3, 4, 5, 981]]), np.array([False]))
    assert unit.unit.frames(output, np.array([1.0])) == b"", "silent until commanded to stream"
    unit.lines("VNWRG,75,1,4,05,0001,001C")
    frame = unit.unit.frames(output, np.array([1.005]))
    assert len(frame) == SAMPLES.itemsize == 44
    assert frame[:6].hex() == "fa0501001c00"
    nanoseconds, *values = struct.unpack("<Q7f", frame[6:42])
    assert nanoseconds == 1_005_000_000
    np.testing.assert_allclose(values, [0.04, 0.05, 9.81, 1e-3, 2e-3, 3e-3, 23.0], rtol=1e-6)
    assert crc16.xmodem(frame[1:]) == 0, "a check high byte first leaves nothing"


def test_dsp_replies_match_the_protocol():
    unit = Unit(UNITS["modbus"])
    assert unit.rtu(1, 3, 0, 0, 0, 8)[3:19] == b"bench-dsp".ljust(16, b"\0")
    assert unit.rtu(1, 3, 0, 100, 0, 1)[:3] == b"\x01\x83\x02", "page 0 has no registers there"
    assert unit.rtu(1, 6, 0, 23, 0, 1)[:6] == b"\x01\x06\x00\x17\x00\x01"
    assert unit.rtu(1, 16, 0, 100, 0, 2, 4, 1, 2, 3, 4)[:6] == b"\x01\x10\x00\x64\x00\x02"
    assert unit.rtu(1, 3, 0, 100, 0, 2)[3:7] == b"\x01\x02\x03\x04"
    assert unit.rtu(1, 16, 0, 129, 0, 2, 4, 1, 2, 3, 4)[:3] == b"\x01\x90\x02"
    assert unit.rtu(1, 6, 0, 21, 0, 1)[:3] == b"\x01\x86\x03"
    assert unit(b"\x01\x03noise\x02\x03\x00" * 3) == b""
    assert unit.rtu(2, 3, 0, 0, 0, 8) == b"", "another unit's"


def test_dsp_registers_survive_a_reset_only_after_a_commit(tmp_path):
    file = tmp_path / "flash.bin"
    unit = Unit(UNITS["modbus"], flash_file=file)
    for body in ((1, 6, 0, 23, 0, 1), (1, 6, 0, 100, 7, 7)):
        unit.rtu(*body)
    unit.rtu(1, 6, 0, 22, 0xA5, 0xA5)
    unit.rtu(1, 6, 0, 23, 0, 1)
    assert unit.rtu(1, 3, 0, 100, 0, 1)[3:5] == b"\0\0"
    unit.rtu(1, 6, 0, 100, 7, 7)
    unit.rtu(1, 6, 0, 21, 0x5A, 0x5A)
    assert [unit.rtu(1, 3, 0, 21, 0, 1)[3:5] for _ in range(2)] == [b"\x5a\x5a", b"\0\0"]
    again = Unit(UNITS["modbus"], flash_file=file)
    again.rtu(1, 6, 0, 23, 0, 1)
    assert again.rtu(1, 3, 0, 100, 0, 1)[3:5] == b"\x07\x07"


@pytest.mark.parametrize("kind", UNITS.values(), ids=UNITS)
def test_unit_survives_arbitrary_bytes(kind):
    unit = Unit(kind)
    random = np.random.default_rng(5)
    for _ in range(300):
        unit(bytes(random.integers(0, 256, 50, dtype=np.uint8)) + b"\x01\x10\x00$VN*\r\n,\x01\x03")


@pytest.mark.long
@pytest.mark.parametrize("protocol", UNITS)
@pytest.mark.parametrize("transport", ["socket", "pty"])
def test_driver_reads_and_writes_registers_and_streams(start_bench, protocol, transport):
    profile = shipped(protocol).with_commands(timeout_s=2.0)
    output = profile.stream.output
    entries = RegisterMap(tuple(profile.registers))
    settings = {"grade": "mems", "imu_protocol": protocol, "imu_transport": transport, "output": output}
    with start_bench(serial="SN-000042", clock_drift_ppm=0.0, **settings) as bench:
        imu = open_imu(SerialLink(bench.endpoints["imu"], profile.link, "imu"), profile, "")
        try:
            imu.start()
            assert imu.identify().serial == "SN-000042"
            assert set(imu.read_registers().values()) == {0.0}
            bench.advance(1.0)
            report = bench.advance(1.0)
            for _ in range(500):
                if imu.received >= report["bytes"][0]:
                    break
                bench.ask(now=None)
            batch = imu.read()
            assert len(batch) > 300
            assert np.all(np.diff(batch.seq) == 1)
            assert imu.stats.crc_errors == imu.stats.skipped == 0
            force = batch.counts[:, 3:] * profile.stream.accel_lsb * (1 if output == "rate" else 200.0)
            assert np.linalg.norm(force.mean(axis=0)) == pytest.approx(9.8, abs=0.1)
            wanted = entries.rounded({n: 1e-4 * (1 + i / 7) for i, n in enumerate(entries.parameters)})
            imu.write_registers(wanted)
            assert entries.differing_parameters(wanted, imu.read_registers()) == []
            imu.reset()
            assert set(imu.read_registers().values()) == {0.0}, "not committed"
            imu.write_registers(wanted)
            imu.commit()
            imu.reset()
            assert entries.differing_parameters(wanted, imu.read_registers()) == []
        finally:
            imu.close()


def test_error_reply_of_the_vectornav_unit_is_reported(start_bench):
    profile = load_imu_profile(IMUS / "vectornav_vn100.toml")
    section = profile.vectornav.model_copy(update={"start": ["VNWRG,75,1,5,05,0001,001C"]})
    profile = profile.model_copy(update={"vectornav": section})
    with start_bench(grade="mems", imu_protocol="vectornav", output="rate") as bench:
        imu = open_imu(SerialLink(bench.endpoints["imu"], profile.link, "imu"), profile, "")
        try:
            with pytest.raises(ImuRefusalError, match="invalid parameter"):
                imu.start()
        finally:
            imu.close()
