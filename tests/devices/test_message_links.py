"""IMUs over UDP and CAN by their profile, with the times at which the kernel or the interface received the messages."""

import socket
import struct
import sys
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from calstation.config.slots import DeviceSection
from calstation.devices.imu import open_imu as imu_on
from calstation.devices.interfaces import Imu, SampleBatch
from calstation.devices.links import can_port, open_link, udp_address
from calstation.devices.profiles import ImuProfile, SerialSettings, load_imu_profile
from calstation.errors import CalstationError, ConfigurationError, DeviceFaultError
from tests.helpers import raises_code

PROFILE = """
name = "Messages"
model = "M"
protocol = "stream"
[link]
baud = 500000
[stream]
sample_rate_hz = 100.0
output = "rate"
gyro_lsb = 1e-4
accel_lsb = 1e-3
order = "before_registers"
[noise]
gyro_arw = 4e-5
accel_vrw = 1e-3
[frame]
sync = "00 00 01 01"
byte_order = "little"
crc = { kind = "sum8", start = 0 }
fields = [
    { name = "counter", type = "u16" },
    { name = "gyro_x", type = "i16" }, { name = "gyro_y", type = "i16" }, { name = "gyro_z", type = "i16" },
    { name = "accel_x", type = "i16" }, { name = "accel_y", type = "i16" }, { name = "accel_z", type = "i16" },
    { name = "status", type = "u16" },
]
"""
VALUES = (1, -2, 3, 400, -500, 600)


@pytest.fixture
def profile(tmp_path: Path) -> ImuProfile:
    (tmp_path / "imu.toml").write_text(PROFILE)
    return load_imu_profile(tmp_path / "imu.toml")


def data_of(counter: int) -> bytes:
    return struct.pack("<H6hH", counter, *VALUES, 0)


def packet_of(counter: int) -> bytes:
    packet = b"\0\0\1\1" + data_of(counter)
    return packet + bytes([sum(packet) & 0xFF])


def free_port() -> int:
    with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def batch_of(imu: Imu, count: int) -> SampleBatch:
    """Wait for samples, and return them."""
    deadline = time.monotonic() + 5.0
    while imu.stats.frames < count and time.monotonic() < deadline:
        time.sleep(0.005)
    return imu.read()


def test_udp_samples_are_read_by_profile(profile: ImuProfile) -> None:
    number = free_port()
    link, sender = open_link(f"udp://127.0.0.1:{number}", profile.link), socket.socket(type=socket.SOCK_DGRAM)
    with closing(imu_on(link, profile, "SN-1")) as imu, closing(sender) as unit:
        for k in (0, 1, 2, 4):
            unit.sendto(packet_of(k), ("127.0.0.1", number))
        batch = batch_of(imu, 4)
    np.testing.assert_array_equal(batch.seq, [0, 1, 2, 4])
    np.testing.assert_array_equal(batch.counts, [VALUES] * 4)
    assert imu.stats.gaps == 1


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux stamps datagrams")
def test_udp_times_are_those_of_the_kernel() -> None:
    number = free_port()
    with closing(open_link(f"udp://:{number}", SerialSettings())) as link:
        with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as unit:
            delays = []
            while not delays or (delays[-1] > 0.05 and len(delays) < 20):  # the kernel begins to stamp a little later
                sent = time.monotonic()
                unit.sendto(b"late", ("127.0.0.1", number))
                time.sleep(0.15)
                assert link.read(1.0) == b"late"
                delays.append(link.received_at - sent)
            assert -0.01 < delays[-1] < 0.05, delays
            link.write(b"reply")
            unit.settimeout(2.0)
            assert unit.recv(100) == b"reply"
        assert link.read(0.01) == b""


def test_udp_datagrams_of_other_computers_are_ignored() -> None:
    number = free_port()
    with closing(open_link(f"udp://127.0.0.2:{number}", SerialSettings())) as link:
        with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as unit:
            unit.sendto(b"foreign", ("127.0.0.1", number))
        assert link.read(0.2) == b""


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux has all addresses 127.0.0.x")
def test_only_the_first_computer_is_read_if_the_port_names_none() -> None:
    number = free_port()
    with closing(open_link(f"udp://:{number}", SerialSettings())) as link:
        for sender, received in (("127.0.0.1", b"127.0.0.1"), ("127.0.0.2", b""), ("127.0.0.1", b"127.0.0.1")):
            with closing(socket.socket(type=socket.SOCK_DGRAM)) as unit:
                unit.bind((sender, 0))
                unit.sendto(sender.encode(), ("127.0.0.1", number))
            assert link.read(0.2) == received


@pytest.fixture
def unit_bus() -> Iterator[object]:
    can = pytest.importorskip("can", reason="python-can is not installed")
    bus = can.Bus(interface="virtual", channel="imu-test")
    yield bus
    bus.shutdown()


def send(bus: object, number: int, data: bytes) -> None:
    import can

    bus.send(can.Message(arbitration_id=number, data=data, is_extended_id=number > 0x7FF))  # type: ignore[attr-defined]


def test_can_samples_are_read_by_profile(profile: ImuProfile, unit_bus: object) -> None:
    with closing(imu_on(open_link("can://virtual/imu-test/101,1F0", profile.link), profile, "SN-1")) as imu:
        for k in (0, 1, 2, 4):
            send(unit_bus, 0x101, data_of(k)[:8])
            send(unit_bus, 0x333, b"other")
            if k != 2:  # a lost message loses its sample
                send(unit_bus, 0x1F0, data_of(k)[8:])
        batch = batch_of(imu, 3)
    np.testing.assert_array_equal(batch.seq, [0, 1, 4])
    np.testing.assert_array_equal(batch.counts, [VALUES] * 3)
    assert imu.stats.crc_errors == imu.stats.skipped == 0


def test_requests_of_other_nodes_are_no_messages(unit_bus: object) -> None:
    import can

    with closing(open_link("can://virtual/imu-test/101", SerialSettings())) as link:
        unit_bus.send(can.Message(arbitration_id=0x101, is_remote_frame=True, is_extended_id=False))  # type: ignore[attr-defined]
        assert link.read(0.1) == b""


def test_can_times_are_those_of_the_interface(unit_bus: object) -> None:
    with closing(open_link("can://virtual/imu-test/18FF0101", SerialSettings())) as link:
        sent = time.monotonic()
        send(unit_bus, 0x18FF0101, b"\1\2")
        stamped = time.monotonic()
        time.sleep(0.3)
        packet = b"\x18\xff\1\1\1\2"
        assert link.read(1.0) == packet + bytes([sum(packet) & 0xFF])
        assert sent - 0.1 < link.received_at < stamped + 0.1
        link.write(b"\0\0\1\x23go")
        message = unit_bus.recv(2.0)  # type: ignore[attr-defined]
        assert (message.arbitration_id, bytes(message.data)) == (0x123, b"go")


@pytest.mark.parametrize(
    ("port", "error", "code"),
    [
        ("udp://host", ConfigurationError, "link.bad_address"),
        ("udp://host.invalid:5000", DeviceFaultError, "link.nothing_served"),
        (f"udp://{70 * 'a'}:5000", DeviceFaultError, "link.nothing_served"),
        ("can://socketcan/can0", ConfigurationError, "link.bad_can_port"),
        ("can://socketcan/can0/20000000", ConfigurationError, "link.bad_can_port"),
        ("can://nosuch/can0/101", DeviceFaultError, "link.nothing_served"),
    ],
)
def test_ports_that_cannot_be_opened_are_named(port: str, error: type[CalstationError], code: str) -> None:
    if port.startswith("can://nosuch"):
        pytest.importorskip("can", reason="python-can is not installed")
    with raises_code(error, code) as caught:
        open_link(port, SerialSettings())
    assert port in str(caught.value)


def test_missing_library_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "can", None)
    with raises_code(ConfigurationError, "link.no_can") as caught:
        open_link("can://virtual/x/1", SerialSettings())
    assert 'pip install "calstation[can]"' in str(caught.value)


def test_station_entries_are_checked() -> None:
    assert udp_address("udp://:70000") is None
    assert can_port("can://pcan/PCAN_USBBUS1/1ff,200") == ("pcan", "PCAN_USBBUS1", (0x1FF, 0x200))
    for port in ("udp://10.0.0.7:4001", "can://socketcan/can0/101,102"):
        assert DeviceSection(port=port).port == port
    for port, text in (("udp://10.0.0.7", "udp://host:port"), ("can://can0", "can://interface/channel/ids")):
        with pytest.raises(ValueError, match=text):
            DeviceSection(port=port)


def test_unit_without_a_counter_is_told_what_to_do(tmp_path: Path) -> None:
    (tmp_path / "imu.toml").write_text(PROFILE.replace('    { name = "counter", type = "u16" },\n', ""))
    with pytest.raises(ConfigurationError, match="record its data and import them"):
        load_imu_profile(tmp_path / "imu.toml")
