"""The Modbus table driver tested with request and response bytes, including exceptions, silence and wrong responses."""

import struct
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calstation.devices.profiles import ModbusRegister, TableProfile, load_table_profile
from calstation.devices.table import ModbusTable
from calstation.errors import ConfigurationError, DeviceFaultError
from tests.connection.fake_links import server
from tests.devices.scripted import ScriptedDevice
from tests.helpers import raises_code

SHIPPED = Path(__file__).parents[2] / "data" / "tables" / "bench.toml"
PROFILE = load_table_profile(SHIPPED)
MOVE, STOP, HOME = 1, 2, 3


def quick(gap: int = 16) -> TableProfile:
    modbus = PROFILE.modbus.model_copy(update={"timeout_s": 0.4, "gap": gap})
    return PROFILE.model_copy(update={"modbus": modbus})


@contextmanager
def table(
    pairs: list[tuple[bytes, bytes | None]], profile: TableProfile | None = None
) -> Iterator[tuple[ModbusTable, ScriptedDevice]]:
    device = ScriptedDevice(pairs)
    with server(device.answer_modbus, device.connected) as address:
        device.port = f"tcp://{address}"
        driver = ModbusTable(device.port, profile or quick())
        try:
            yield driver, device
        finally:
            driver.close()
    assert device.finished


def read(address: int, words: list[int]) -> tuple[bytes, bytes]:
    reply = struct.pack(f">BB{len(words)}H", 3, 2 * len(words), *words)
    return struct.pack(">BHH", 3, address, len(words)), reply


def write(address: int, *words: int) -> tuple[bytes, bytes]:
    if len(words) == 1:
        request = struct.pack(">BHH", 6, address, words[0])
        return request, request
    head = struct.pack(">BHH", 16, address, len(words))
    return head + struct.pack(f">B{len(words)}H", 2 * len(words), *words), head


def two_words(value: int) -> list[int]:
    return list(struct.unpack(">HH", struct.pack(">i", value)))


def image(status: int = 0x1627, fault: int = 0) -> list[int]:
    words = [0] * 64
    words[17:21] = [status, fault, 1, 1500]
    for joint, (position, rate) in zip((30, 50), ((-4500000, 123456), (36000001, -20000)), strict=True):
        words[joint : joint + 4] = two_words(position) + two_words(rate)
        words[joint + 10 : joint + 14] = two_words(-108000000) + two_words(108000000)
    return words


def test_identity_requests_match_the_protocol() -> None:
    def text(value: bytes) -> list[int]:
        return list(struct.unpack(">8H", value.ljust(16, b"\0")))

    with table([read(0, text(b"bench-table")), read(8, text(b"T-0001"))]) as (driver, _):
        identity = driver.identify()
        assert (identity.model, identity.serial) == ("bench-table", "T-0001")
    with (
        table([read(0, text(b"other")), read(8, text(b"T"))]) as (driver, _),
        raises_code(DeviceFaultError, "table.other_model"),
    ):
        driver.identify()


def test_status_is_read_in_one_transfer_if_gaps_may_be_read() -> None:
    with table([read(17, image()[17:64])]) as (driver, _):
        status = driver.status()
    np.testing.assert_allclose(status.angles, np.deg2rad([-45.0, 360.00001]), atol=1e-12)
    np.testing.assert_allclose(status.rates, np.deg2rad([12.3456, -2.0]))
    assert (status.enabled, status.homed, status.moving, status.settled) == (True, True, False, True)
    assert status.fault is None
    assert status.interlock_closed
    assert status.watchdog == 1.5
    np.testing.assert_allclose(status.limits.high, np.deg2rad([1080.0, 1080.0]))
    np.testing.assert_allclose(status.limits.rate, np.deg2rad([120.0, 120.0]))


def test_status_is_read_in_blocks_if_gaps_must_not_be_read() -> None:
    words = image(0x0248, 2)
    pairs = [read(a, words[a:b]) for a, b in ((17, 21), (30, 34), (40, 44), (50, 54), (60, 64))]
    with table(pairs, quick(gap=0)) as (driver, _):
        status = driver.status()
    assert status.fault == "watchdog"
    assert not status.enabled
    words = image(0x0008, 77)
    with table([read(17, words[17:64])]) as (driver, _):
        assert driver.status().fault == "code 77"


def test_commands_match_the_protocol() -> None:
    pairs = [
        *(write(16, word) for word in (0x06, 0x07, 0x0F)),
        write(22, HOME),
        write(34, *two_words(-9000000), *two_words(200000), *two_words(400000)),
        write(54, *two_words(72000000), *two_words(200000), *two_words(400000)),
        write(22, MOVE),
        write(21, 1),
        write(22, STOP),
        write(16, 0x06),
        *(write(16, word) for word in (0x06, 0x86, 0x06)),
    ]
    with table(pairs) as (driver, _):
        driver.enable()
        driver.home()
        driver.move(*np.deg2rad([-90.0, 720.0, 20.0, 40.0]))
        driver.heartbeat()
        driver.stop()
        driver.disable()
        driver.reset_fault()


def test_a_command_that_a_tripped_watchdog_refuses_is_reported_as_the_watchdog() -> None:
    tripped = image(0x0248, 2)[17:64]
    for number, calls in ((21, "heartbeat"), (22, "home")):
        refused = (write(number, 1 if calls == "heartbeat" else HOME)[0], bytes([0x86, 4]))
        with (
            table([refused, read(17, tripped)]) as (driver, _),
            raises_code(DeviceFaultError, "table.latched_watchdog"),
        ):
            getattr(driver, calls)()


@pytest.mark.parametrize(
    ("number", "meaning"),
    [(2, "modbus.exception_2"), (3, "modbus.exception_3"), (4, "modbus.exception_4"), (99, "modbus.exception_other")],
)
def test_exception_is_reported_with_its_meaning_and_the_request_not_repeated(number: int, meaning: str) -> None:
    with table([(write(22, STOP)[0], bytes([0x86, number]))]) as (driver, _):
        with raises_code(DeviceFaultError, "table.write_refused") as caught:
            driver.stop()
        assert caught.value.values["number"] == number
        assert caught.value.values["reason"].code == meaning


def test_request_with_a_lost_response_is_repeated_except_homing() -> None:
    request, reply = write(22, STOP)
    with table([(request, None), (request, None), (request, reply)]) as (driver, _):
        driver.stop()
    with table([(write(22, HOME)[0], None)]) as (driver, _), raises_code(DeviceFaultError, "table.write_unanswered"):
        driver.home()


def test_next_request_after_a_lost_response_uses_a_new_connection() -> None:
    stop = write(22, STOP)
    with table([(write(22, HOME)[0], None), stop]) as (driver, device):
        with raises_code(DeviceFaultError, "table.write_unanswered"):
            driver.home()
        driver.stop()
        assert device.connections == 2


def test_unresponsive_or_lost_table_is_reported() -> None:
    request = read(17, image()[17:64])[0]
    with table([(request, None)] * 3) as (driver, _), raises_code(DeviceFaultError, "table.read_unanswered"):
        driver.status()
    with server(ScriptedDevice([]).answer_modbus) as address:
        driver = ModbusTable(f"tcp://{address}", quick())
    with raises_code(DeviceFaultError, "table.read_unanswered"):
        driver.status()
    driver.close()


def test_table_that_stops_responding_is_reported_once() -> None:
    """A reopened link requests the identity first; a missing response is reported for the original request."""
    model, serial = (
        read(address, struct.unpack(">8H", text.ljust(16, b"\0")))
        for address, text in ((0, b"bench-table"), (8, b"T-1"))
    )
    request, silent = read(17, image()[17:64])[0], (model[0], None)
    with table([model, serial, (request, None), silent, silent]) as (driver, device):
        driver.identify()
        with raises_code(DeviceFaultError, "table.read_unanswered") as caught:
            driver.status()
    assert str(caught.value) == (
        f"Table: Registers 17-63 cannot be read on {device.port} (no response). Check cable, power and unit number."
    )


def test_response_of_the_wrong_length_is_discarded() -> None:
    request = read(17, image()[17:64])[0]
    short = read(17, image()[17:60])[1]
    with table([(request, short)] * 3) as (driver, _), raises_code(DeviceFaultError, "table.read_unanswered"):
        driver.status()


def test_invalid_ports_are_reported() -> None:
    for port in ("tcp://nohost", "tcp://:1", "tcp://x:99999"):
        with raises_code(ConfigurationError, "link.not_an_address"):
            ModbusTable(port, quick())
    with raises_code(DeviceFaultError, "link.no_such_port"):
        ModbusTable("/dev/ttyNONE7", quick())


def test_value_out_of_range_is_reported_before_sending() -> None:
    with table([]) as (driver, _), raises_code(ConfigurationError, "table.value_beyond_register"):
        driver.move(1000.0, 0.0, 0.1, 0.1)


@given(kind=st.sampled_from(["u16", "i16", "u32", "i32"]), part=st.floats(0, 1))
def test_register_values_survive_encoding_and_decoding(kind: str, part: float) -> None:
    register = ModbusRegister(address=0, type=kind, scale=1e-5)  # type: ignore[arg-type]
    low, high = register.bounds
    raw = round(low + part * (high - low))
    words = register.encode(raw * register.scale, "x")
    assert len(words) == register.count
    assert all(0 <= word <= 0xFFFF for word in words)
    assert register.decode(words) == raw * register.scale


def test_optional_registers_and_status_bits_may_be_absent() -> None:
    """The table has no watchdog, interlock, serial number or travel, and no status bits for moving or homed."""
    content = tomllib.loads(SHIPPED.read_text(encoding="utf-8"))
    for name in ("serial", "interlock", "watchdog", "heartbeat", "outer_low", "outer_high", "inner_low", "inner_high"):
        del content["registers"][name]
    del content["status_bits"]["moving"]
    content["status_bits"]["homed"] = {"always": True}
    content["modbus"] |= {"timeout_s": 0.4, "gap": 0}
    profile = TableProfile.model_validate(content)
    words = image(status=0x0627)

    def polled() -> list[tuple[bytes, bytes | None]]:
        return [read(a, words[a:b]) for a, b in ((17, 19), (30, 34), (50, 54))]

    model = list(struct.unpack(">8H", b"bench-table".ljust(16, b"\0")))
    with table([read(0, model), *polled()], profile) as (driver, _):
        assert driver.identify().serial == ""
        status = driver.status()
        driver.heartbeat()  # nothing is sent, because there is no watchdog
    assert status.interlock_closed
    assert status.homed
    assert status.moving  # derived from the rate
    assert status.watchdog == np.inf
    np.testing.assert_allclose(status.limits.low, np.deg2rad([-1080.0, -1080.0]))
    words[32:34] = words[52:54] = [0, 0]
    with table(polled(), profile) as (driver, _):
        assert not driver.status().moving
