"""A late Modbus response is never taken for the response to the next request."""

import socket
import struct
import sys
import threading
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
import pytest

from calstation.devices.imu.drivers.modbus import ModbusImu
from calstation.devices.links import ModbusLink, ModbusRefusalError, RtuRequest, SerialLink
from calstation.devices.links.modbus_rtu import RefusedError, RtuLine, RtuUnit
from calstation.devices.profiles import ImuProfile, SerialSettings, load_table_profile
from calstation.devices.table import ModbusTable
from calstation.errors import DeviceFaultError
from tests.devices.rtu_server import RtuServer
from tests.helpers import raises_code

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals on Windows")

DATA = Path(__file__).parents[2] / "data"
TIMEOUT = 0.3
LATE = TIMEOUT + 0.03


@contextmanager
def link(late: Mapping[int, float | None], **server: object) -> Iterator[tuple[ModbusLink, RtuServer]]:
    device = RtuServer(late, **server)  # type: ignore[arg-type]
    opened = ModbusLink(device.port, 1, TIMEOUT, SerialSettings())
    try:
        yield opened, device
    finally:
        opened.close()
        device.close()


@pytest.mark.long
@pytest.mark.parametrize(
    "late",
    [{1: LATE}, {1: LATE, 2: 0.02}, {1: 2 * TIMEOUT}, {1: LATE, 2: LATE}, {1: None}, {1: None, 2: LATE}],
    ids=str,
)
def test_read_returns_the_requested_block_or_fails(late: Mapping[int, float | None]) -> None:
    with link(late) as (table, _):
        for address in (10, 20, 30, 40, 50, 60):
            try:
                found = table.read(address, 4)
            except DeviceFaultError:
                continue
            assert found == [address, address + 1, address + 2, address + 3]
        assert table.read(70, 4) == [70, 71, 72, 73], "and the line is in order again"


@pytest.mark.long
def test_consistently_late_device_is_a_fault_and_gives_no_wrong_values() -> None:
    with link(dict.fromkeys(range(1, 9), TIMEOUT + 0.15)) as (table, _):
        assert table.read(10, 4) == [10, 11, 12, 13]
        with raises_code(DeviceFaultError, "table.read_unanswered"):
            table.read(20, 4)
        for address in (30, 40, 50, 60):
            try:
                assert table.read(address, 4)[0] == address
            except DeviceFaultError:
                continue
        assert table.read(70, 4)[0] == 70


def test_stop_is_sent_and_repeated_immediately_while_a_response_is_pending() -> None:
    with link({0: None, 1: None, 2: None, 3: None}) as (table, device):
        with raises_code(DeviceFaultError, "table.read_unanswered"):
            table.read(10, 4)
        asked = len(device.requests)
        table.write(22, [2])
        assert set(device.requests[asked:]) == {(6, 22, 2)}
        assert table.read(10, 4)[0] == 10


def test_new_target_is_not_confirmed_by_a_late_echo() -> None:
    with link({0: None, 1: None, 2: LATE}) as (table, device):
        with raises_code(DeviceFaultError, "table.write_unanswered"):
            table.write(34, [1, 2])
        table.write(34, [3, 4])
        assert [device.words[34], device.words[35]] == [3, 4]
        asked = device.requests.index((3, 0, 1))
        assert device.requests[asked + 1 :] == [(16, 34, 2)], "the answer to another transaction does not count"


def test_exception_of_an_older_request_is_discarded() -> None:
    class Forbidding(RtuServer):
        def value_of(self, address: int) -> int | None:
            return None if address == 99 else address

    device = Forbidding({0: LATE})
    table = ModbusLink(device.port, 1, TIMEOUT, SerialSettings())
    try:
        with raises_code(ModbusRefusalError, "table.read_refused"):
            table.read(99, 1)
        assert table.read(20, 2) == [20, 21]
    finally:
        table.close()
        device.close()


def test_late_responses_do_not_mix_up_angles_and_limits() -> None:
    profile = load_table_profile(DATA / "tables" / "bench.toml").at_station(TIMEOUT, None)
    assert profile.modbus is not None
    profile = profile.model_copy(update={"modbus": profile.modbus.model_copy(update={"gap": 0})})
    clean, hurt = [], []
    for late, seen in (({}, clean), ({1: LATE, 2: 0.02}, hurt)):
        device = RtuServer(late)
        table = ModbusTable(device.port, profile, SerialSettings())
        try:
            seen += [table.status() for _ in range(3)]
        finally:
            table.close()
            device.close()
    for status in hurt:
        np.testing.assert_array_equal(status.angles, clean[0].angles)
        assert status.limits == clean[0].limits


GROUPS = ("gyro_bias", "gyro_scale", "accel_bias", "accel_scale", "accel_quadratic", "inner_lever")


def pageless() -> ImuProfile:
    """Return a unit with six register groups of equal size on one page, so that all responses look alike."""
    content = tomllib.loads((DATA / "imus" / "dsp_modbus.toml").read_text(encoding="utf-8"))
    del content["modbus"]["page"]
    content["modbus"] |= {"timeout_s": TIMEOUT, "stream": {"address": 20, "on": 1}}
    content["registers"] = [
        {"address": 100 + 10 * i, "parameters": [group], "range": [-50.0, 50.0]} for i, group in enumerate(GROUPS)
    ]
    content["without_register"] = ["gyro_misalign", "accel_misalign"]
    content["prior"] = {group: {"sigma": 1.0} for group in GROUPS}
    return ImuProfile.model_validate(content)


@pytest.mark.long
@pytest.mark.parametrize("late", [{0: LATE}, {0: LATE, 1: 0.02}, {2: LATE, 3: LATE}, {1: None}], ids=str)
def test_late_responses_do_not_mix_up_registers(late: Mapping[int, float | None]) -> None:
    words: dict[int, int] = {}
    for i in range(len(GROUPS)):
        for k, word in enumerate(struct.unpack(">6H", struct.pack(">3f", *[i + 1.0] * 3))):
            words[100 + 10 * i + k] = word
    profile = pageless()
    device = RtuServer(late, words)
    imu = ModbusImu(SerialLink(device.port, profile.link, "imu"), profile)
    try:
        for _ in range(2):
            try:
                found = imu.read_registers()
            except DeviceFaultError:
                continue
            assert found == {f"{group}_{axis}": i + 1.0 for i, group in enumerate(GROUPS) for axis in "xyz"}
        assert len(found) == 18
    finally:
        imu.close()
        device.close()


def test_tcp_response_with_another_transaction_number_is_discarded() -> None:
    def serve() -> None:
        older = b""
        with suppress(OSError):
            while True:
                peer, _ = server.accept()
                with peer:
                    while len(head := peer.recv(12)) == 12:
                        words = struct.pack(">B2H", 4, *(int.from_bytes(head[8:10], "big") + i for i in range(2)))
                        answer = head[:4] + struct.pack(">HBB", 7, head[6], 3) + words
                        peer.sendall(older + answer)
                        older = answer

    with socket.create_server(("127.0.0.1", 0)) as server:
        threading.Thread(target=serve, daemon=True).start()
        table = ModbusLink(f"tcp://127.0.0.1:{server.getsockname()[1]}", 1, TIMEOUT, SerialSettings())
        assert [table.read(address, 2) for address in (10, 20, 30)] == [[10, 11], [20, 21], [30, 31]]
        table.close()
        server.shutdown(socket.SHUT_RDWR)


def test_synchronising_read_has_a_distinct_length() -> None:
    unit = RtuUnit(RtuLine("NONE", TIMEOUT, SerialSettings()), 1)
    unit.lengths |= {4: 17, 8: 0}
    waiting = unit.dialogue.unanswered
    waiting.append(RtuRequest.read(1, 30, 4).transaction(RefusedError).signature)
    seen = []
    for _ in range(20):
        transaction = unit.dialogue.other_transaction()
        assert transaction is not None
        assert transaction.signature not in waiting
        waiting.append(transaction.signature)
        seen.append(transaction.signature[1][0] // 2)
    assert seen[:8] == [8, 1, 2, 3, 5, 6, 7, 4], "all lengths before one is used again"
    assert len(waiting) == 8
