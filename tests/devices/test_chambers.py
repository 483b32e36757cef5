"""Chamber drivers tested with request and reply bytes: Simserv, F4T, F4 and 8800, and mistakes in their profiles."""

import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import tomli_w

from calstation.devices import Chamber, OtherModelError
from calstation.devices.chamber import open_chamber
from calstation.devices.profiles import ChamberProfile, load_chamber_profile
from calstation.errors import ConfigurationError, DeviceFaultError
from tests.connection.fake_links import server
from tests.devices.editing import edited
from tests.devices.scripted import ScriptedDevice
from tests.helpers import error_code, raises_code

CHAMBERS = Path(__file__).parents[2] / "data" / "chambers"
NAMES = sorted(path.stem for path in CHAMBERS.glob("*.toml"))
Pairs = list[tuple[bytes, bytes]]


def profile(name: str) -> ChamberProfile:
    return load_chamber_profile(CHAMBERS / f"{name}.toml").at_station(0.3)


@contextmanager
def chamber(name: str, pairs: Pairs) -> Iterator[Chamber]:
    device, used = ScriptedDevice(pairs), profile(name)
    answer = device.answer_modbus if used.protocol == "modbus" else device.answer
    with server(answer, device.connected) as address:
        driver = open_chamber(f"tcp://{address}", used)
        try:
            yield driver
        finally:
            driver.close()
    assert device.finished


def read(address: int, value: int) -> tuple[bytes, bytes]:
    return struct.pack(">BHH", 3, address, 1), struct.pack(">BBh", 3, 2, value)


def write(address: int, value: int) -> tuple[bytes, bytes]:
    request = struct.pack(">BHh", 6, address, value)
    return request, request


SIMSERV: Pairs = [
    (b"11004\xb61\xb61\r", b"1\xb6-39.87\r\n"),
    (b"11002\xb61\xb61\r", b"1\xb6-40.0\r\n"),
    (b"14003\xb61\xb61\r", b"1\xb61\r\n"),
    (b"10012\xb61\r", b"1\xb63\r\n"),
]
SIMSERV_NAME = (b"99997\xb61\xb61\r", b"1\xb6LabEvent T/110/40/3\r\n")
F4T_POLL: Pairs = [
    (b":SOURCE:CLOOP1:PVALUE?\n", b"-39.9\n"),
    (b":SOURCE:CLOOP1:SPOINT?\n", b"-40.0\n"),
    (b":OUTPUT1:STATE?\n", b"ON\n"),
    (b":SOURCE:CLOOP1:ERROR?\n", b"NONE\n"),
]
F4T_NAME = (b"*IDN?\n", b"WATLOW ELECTRIC,F4T1L1,1234,4.07\n")
F4_POLL: Pairs = [read(100, -399), read(300, -400), read(2000, 1)]
TT_POLL: Pairs = [(b"PVAR1?\r\n", b"-39.900\r\n"), (b"SETP1?\r\n", b"-40.000\r\n"), (b"SCOD?\r\n", b"1\r\n")]
TT_NAME = (b"IDEN?\r\n", b"8800\xb0 CM2\r\n")


@pytest.mark.parametrize(
    ("name", "pairs"),
    [
        (
            "simserv",
            [
                SIMSERV_NAME,
                *SIMSERV,
                (b"11001\xb61\xb61\xb6-12.5\r", b"1\r\n"),
                (b"14001\xb61\xb61\xb61\r", b"1\r\n"),
                (b"14001\xb61\xb61\xb60\r", b"1\r\n"),
            ],
        ),
        (
            "watlow_f4t",
            [
                F4T_NAME,
                (b":UNIT:TEMPERATURE?\n", b"C\n"),
                *F4T_POLL,
                (b":SOURCE:CLOOP1:SPOINT -12.5\n", b""),
                F4T_POLL[1],
                (b":SOURCE:CLOOP1:RACTION OFF\n", b""),
                F4T_POLL[1],
                (b":OUTPUT1:STATE ON\n", b""),
                F4T_POLL[1],
                (b":OUTPUT1:STATE OFF\n", b""),
                F4T_POLL[1],
            ],
        ),
        (
            "watlow_f4",
            [
                read(606, 1),
                read(901, 1),
                *F4_POLL,
                write(300, -125),
                write(1217, 1),
                write(2000, 1),
                write(2000, 0),
            ],
        ),
        (
            "thermotron_8800",
            [TT_NAME, *TT_POLL, (b"SETP1,-12.5\r\n", b"0\r\n"), (b"RUNM\r\n", b"0\r\n"), (b"STOP\r\n", b"0\r\n")],
        ),
    ],
)
def test_requests_match_the_protocol(name: str, pairs: Pairs) -> None:
    with chamber(name, pairs) as driver:
        driver.identify()
        status = driver.status()
        assert status.air_c == pytest.approx(-39.9, abs=0.05)
        assert (status.set_point_c, status.running, status.door_open, status.alarm) == (-40.0, True, None, None)
        driver.set_point(-12.5)
        driver.start()
        driver.stop()


def test_door_and_alarm_of_simserv() -> None:
    poll = [*SIMSERV[:3], (b"10012\xb61\r", b"1\xb611\r\n"), (b"15002\xb61\xb61\r", b"1\xb61\r\n")]
    with chamber("virtual_chamber", poll) as driver:
        status = driver.status()
    assert (status.door_open, status.alarm) == (True, "code 11")


@pytest.mark.parametrize(
    ("name", "pairs", "running", "alarm"),
    [
        ("thermotron_8800", [*TT_POLL[:2], (b"SCOD?\r\n", b"5\r\n")], False, None),
        ("thermotron_8800", [*TT_POLL[:2], (b"SCOD?\r\n", b"10\r\n")], False, "Therm-Alarm"),
        ("watlow_f4t", [*F4T_POLL[:2], (b":OUTPUT1:STATE?\n", b"OFF\n"), F4T_POLL[3]], False, None),
        ("watlow_f4t", [*F4T_POLL[:3], (b":SOURCE:CLOOP1:ERROR?\n", b"ERROR\n")], True, "input error"),
        ("watlow_f4", [*F4_POLL[:2], read(2000, 0)], False, None),
    ],
)
def test_states_and_alarms(name: str, pairs: Pairs, running: bool, alarm: str | None) -> None:
    with chamber(name, pairs) as driver:
        status = driver.status()
    assert (status.running, status.alarm) == (running, alarm)


def test_a_chamber_in_fahrenheit_or_whole_degrees_is_refused() -> None:
    fahrenheit = [F4T_NAME, (b":UNIT:TEMPERATURE?\n", b"F\n")]
    with chamber("watlow_f4t", fahrenheit) as driver, raises_code(DeviceFaultError, "chamber.link"):
        driver.identify()
    for pairs in ([read(606, 0)], [read(606, 1), read(901, 0)]):
        with chamber("watlow_f4", pairs) as driver, raises_code(DeviceFaultError, "chamber.unlike_profile"):
            driver.identify()


def test_another_model_a_refused_command_and_a_number_that_is_none_are_errors() -> None:
    with chamber("virtual_chamber", [SIMSERV_NAME]) as driver, raises_code(OtherModelError, "chamber.other_model"):
        driver.identify()
    refused = [(b"11001\xb61\xb61\xb620.0\r", b"-6\r\n")]
    with chamber("simserv", refused) as driver, raises_code(DeviceFaultError, "chamber.link"):
        driver.set_point(20.0)
    no_number = [(SIMSERV[0][0], b"1\xb6-\r\n"), *SIMSERV[1:]]
    with chamber("simserv", no_number) as driver, raises_code(DeviceFaultError, "chamber.link"):
        driver.status()


@pytest.mark.parametrize("name", ["simserv", "watlow_f4"])
def test_a_silent_chamber_is_an_error_of_the_chamber(name: str) -> None:
    silent = ScriptedDevice([])
    with server(lambda data: b"", silent.connected) as address:
        driver = open_chamber(f"tcp://{address}", profile(name))
        with raises_code(DeviceFaultError, "chamber.link") as caught:
            driver.status()
        driver.close()
    assert str(caught.value).startswith("Chamber: ")


def test_a_port_that_nothing_serves_is_an_error_of_the_chamber() -> None:
    with raises_code(DeviceFaultError, "chamber.link"):
        open_chamber("tcp://127.0.0.1:1", profile("simserv"))


@pytest.mark.parametrize("name", NAMES)
def test_shipped_profiles_can_be_read(name: str) -> None:
    found = profile(name)
    assert found.range_c[0] < -40.0
    assert found.max_rate == pytest.approx(found.max_rate_c_per_min / 60.0)
    assert "http" in (CHAMBERS / f"{name}.toml").read_text() or name == "virtual_chamber", "its source is named"


@pytest.mark.parametrize(
    ("name", "changes", "words"),
    [
        ("simserv", {"range_c": [10.0, 10.0]}, "range_c profile.range_order"),
        ("simserv", {"protocol": "modbus"}, "modbus profile.needed_by"),
        ("simserv", {"text/queries/air": None}, "text.queries.air entry.missing"),
        ("simserv", {"text/queries/air/answer": "^1¶(?P<x>.)"}, "text.queries.air.answer profile.group_missing"),
        ("simserv", {"text/commands/set_point": ["11001"]}, "text.commands.set_point profile.value_not_sent"),
        ("simserv", {"text/commands/start": ["{temperature}"]}, "text.commands.start[1] profile.unknown_brace"),
        ("simserv", {"text/commands/start": ["停"]}, "text.commands.start[1] profile.line_not_latin"),
        ("simserv", {"text/flags/running/query": "x"}, "text.flags.running profile.no_such_query"),
        ("simserv", {"text/flags/alarm": {"always": False}}, "text.flags.alarm profile.flag_cannot_be_constant"),
        ("watlow_f4", {"modbus/registers/air": None}, "modbus.registers.air entry.missing"),
        ("watlow_f4", {"modbus/registers/running": None}, "modbus.commands.start profile.needs_register"),
        ("watlow_f4", {"modbus/registers/celsius": None}, "modbus.expected profile.needs_register"),
        ("watlow_f4", {"max_rate_c_per_min": 0.0}, "max_rate_c_per_min entry.greater_than"),
    ],
)
def test_invalid_profiles_are_refused(tmp_path: Path, name: str, changes: dict[str, object], words: str) -> None:
    path = tmp_path / "profile.toml"
    path.write_bytes(tomli_w.dumps(edited(CHAMBERS / f"{name}.toml", changes)).encode())
    with pytest.raises(ConfigurationError) as caught:
        load_chamber_profile(path)
    assert error_code(caught.value) == words
