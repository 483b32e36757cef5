"""Table drivers command absolute angles and repeat lost commands literally, so motions never add up."""

import struct
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from itertools import groupby
from pathlib import Path
from queue import Empty, SimpleQueue

import numpy as np
import pytest

from calstation.bench import BenchConfig
from calstation.bench.imu import UNITS
from calstation.bench.table import (
    LANGUAGES,
    Axes,
    Clocks,
    Drive,
    Power,
    TableLimits,
    TableMachine,
    TableRegisters,
    drives,
)
from calstation.bench.truth import EncoderTruth, TableDrive
from calstation.devices.imu import FramedImu
from calstation.devices.profiles import TableProfile, load_imu_profile, load_table_profile
from calstation.devices.table import ModbusTable, RegisterTable, SharedTable, TextTable
from tests.connection.fake_links import server, tcp_pdu

DATA = Path(__file__).parents[2] / "data"
DRIVEN = ["bench", "cia402_drives", "indexing_unit", "aerosmith_atl", "acutronic_acl", "mn_ascii"]
#: Host time after which a request without a reply is repeated, s.
TIMEOUT = 0.2

FROM = [(0.0, 0.0), (np.deg2rad(30.0), np.deg2rad(-20.0))]
TO = (np.deg2rad(-95.5), np.deg2rad(370.25))
RATE = (np.deg2rad(20.0), np.deg2rad(40.0))


class FakeDevice:
    """The simulated table at a fixed time, with one of its protocols.

    Attributes
    ----------
    requests : all received requests in order, without transaction numbers
    loses : whether the reply to every motion command is lost
    """

    def __init__(self, start: tuple[float, float], loses: bool) -> None:
        limits = TableLimits(low=(-20.0, -20.0), high=(20.0, 20.0))
        self.machine = TableMachine(TableDrive(EncoderTruth(0.0, 0.0, (0.0, 0.0), 0.0), start), limits)
        self.machine.set_zero()
        self.clocks = Clocks(lambda: 0.0, lambda: 0.0, lambda: 0.0)
        for word in (0x06, 0x07, 0x0F):
            self.machine.control(word, 0.0, 0.0)
        assert self.machine.power is Power.ENABLED
        self.requests: list[bytes] = []
        self.loses, self._going = loses, self.targets()

    def respond(self, request: bytes, reply: bytes) -> bytes:
        """Record a request; return its reply, or nothing if the reply is lost."""
        self.requests.append(request)
        if not self.loses or not reply or self._going == self.targets():
            return reply
        self._going = self.targets()
        return b""

    def targets(self) -> list[float]:
        """Return the target angles of the joints, rad."""
        return [profile.target for profile in self.machine.drive.profiles]

    def registers(self) -> TableRegisters:
        """Return the table as Modbus registers."""
        return TableRegisters(self.machine, self.clocks, "bench-table", "T-1")

    def drives(self) -> dict[int, Drive]:
        """Return the table as two drives, both enabled."""
        both = drives(self.machine, self.clocks, "T-1")
        for drive in both.values():
            drive.write(20, [0x0F])
        return both


def text(device: FakeDevice, language: str) -> Callable[[bytes], bytes]:
    controller = LANGUAGES[language](Axes(device.machine, device.clocks), "T-1")
    device.machine.power = Power.ENABLED

    def answer(received: bytes) -> bytes:
        lines = received.splitlines(keepends=True)
        return b"".join(device.respond(line, b"".join(controller.feed(line))) for line in lines)

    return answer


def modbus(device: FakeDevice, separate_drives: bool) -> Callable[[bytes], bytes]:
    units = device.drives() if separate_drives else {1: device.registers()}

    def answer(received: bytes) -> bytes:
        registers, request = units[received[6]], received[7:]
        address, value = struct.unpack(">HH", request[1:5])
        values = [value] if request[0] == 6 else list(struct.unpack(f">{value}H", request[6:]))
        registers.write(address, values)
        return device.respond(received[6:], tcp_pdu(received, request[:5]))

    return answer


class Line:
    """A link to a simulated unit whose own axes are the table."""

    port = "LINE"
    received_at = property(lambda link: time.monotonic())

    def __init__(self, device: FakeDevice) -> None:
        self._device = device
        unit = UNITS["framed"](BenchConfig(serial="SN-1"))
        unit.axes = device.registers()
        self._parse = unit.new_parser()
        self._replies: SimpleQueue[bytes] = SimpleQueue()

    def read(self, wait: float) -> bytes:
        try:
            return self._replies.get(timeout=wait)
        except Empty:
            return b""

    def write(self, data: bytes) -> None:
        if reply := self._device.respond(data, b"".join(self._parse(data, 0.0))):
            self._replies.put(reply)

    def close(self) -> None:
        return


@contextmanager
def driver(name: str, device: FakeDevice) -> Iterator[RegisterTable | TextTable]:
    """Run the driver of the profile on a link to `device`."""
    profile = load_table_profile(DATA / "tables" / f"{name}.toml")
    if profile.protocol == "imu_link":
        imu_profile = load_imu_profile(DATA / "imus" / "bench_nav.toml").with_commands(timeout_s=TIMEOUT)
        table: RegisterTable | TextTable = SharedTable(
            FramedImu(Line(device), imu_profile),  # type: ignore[arg-type]
            profile,
            owned=True,
        )
        yield table
        table.close()
        return
    answer = modbus(device, profile.two_drives) if profile.protocol == "modbus" else text(device, profile.protocol)
    with server(answer) as address:
        port = f"tcp://{address}"
        quick = with_short_timeout(profile)
        table = ModbusTable(port, quick) if profile.protocol == "modbus" else TextTable(port, quick)
        yield table
        table.close()


def with_short_timeout(profile: TableProfile) -> TableProfile:
    """Return the profile with a short reply timeout."""
    section = profile.modbus or profile.text
    assert section is not None
    name = "modbus" if profile.modbus is not None else "text"
    return profile.model_copy(update={name: section.model_copy(update={"timeout_s": TIMEOUT})})


@cache
def moved(name: str, start: tuple[float, float], loses: bool = False) -> tuple[list[bytes], list[float]]:
    """Return the requests for a move from `start`, and the resulting targets."""
    device = FakeDevice(start, loses)
    with driver(name, device) as table:
        table.move(*TO, *RATE)
    return device.requests, device.targets()


def test_every_shipped_profile_of_a_motorised_table_is_tested() -> None:
    shipped = {path.stem for path in (DATA / "tables").glob("*.toml")}
    protocols = {name: load_table_profile(DATA / "tables" / f"{name}.toml").protocol for name in shipped}
    driven = {name for name, protocol in protocols.items() if protocol not in ("hand", "gimbal")}
    assert driven == set(DRIVEN)


@pytest.mark.parametrize("name", DRIVEN)
def test_move_commands_absolute_angles(name: str) -> None:
    requests, targets = zip(*(moved(name, start) for start in FROM), strict=True)
    assert requests[0] == requests[1]
    np.testing.assert_allclose(targets, [TO, TO], atol=1e-6)


#: Queries with which a driver identifies the table after it has opened the connection again.
IDENTITY_QUERIES = (b"IDN\r\n", b"*IDN?\n", b"$MNCHK*D6\r\n")


@pytest.mark.long
@pytest.mark.parametrize("name", DRIVEN)
def test_move_with_a_lost_reply_is_repeated_literally_without_extra_motion(name: str) -> None:
    clean, _ = moved(name, FROM[1])
    requests, targets = moved(name, FROM[1], loses=True)
    assert len(requests) > len(clean)
    assert [request for request, _ in groupby(r for r in requests if r not in IDENTITY_QUERIES)] == clean
    np.testing.assert_allclose(targets, TO, atol=1e-6)
