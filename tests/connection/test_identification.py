"""No command is sent to a device before it is identified; other devices on its port are detected."""

import struct
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import tomli_w
from serial.tools import list_ports

from calstation.config import RunRequest, library
from calstation.connection import check_imu_link, check_table_link, read_table, reset_table, table_reset
from calstation.devices.links import SerialLink
from calstation.devices.profiles import SerialSettings
from calstation.errors import ConfigurationError, DeviceFaultError
from calstation.messages import Report
from calstation.runs import execute
from calstation.sequencer import Command, Control, Event, Fault, Finalized
from tests.connection.fake_links import FakeImu, FakeTable, order, rtu, server, silent, tcp_pdu, terminal
from tests.helpers import ignore_progress, raises_code
from tests.site_folder import PRODUCT, STATION

needs_terminals = pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals on Windows")
READ = 3


class Bus:
    """Modbus units on a serial line that respond to reads like a `FakeTable` and record the requests.

    Attributes
    ----------
    functions : Modbus functions that came, to whatever unit
    """

    def __init__(self, unit: int = 1, model: bytes = b"bench-table") -> None:
        self.unit = unit
        self.functions: list[int] = []
        self._table = FakeTable({})
        self._table.words[0:8] = struct.unpack(">8H", model.ljust(16, b"\0"))

    def answer(self, heard: bytes) -> bytes:
        """Return the response to the first request, or nothing for another unit."""
        if len(heard) < 8 or rtu(heard[:6]) != heard[:8]:
            return b""
        self.functions.append(heard[1])
        if heard[0] != self.unit:
            return b""
        start, count = struct.unpack(">HH", heard[2:6])
        values = struct.pack(f">{count}H", *self._table.words[start : start + count])
        return rtu(bytes([self.unit, READ, len(values)]) + values)


def asked(folder: Path, table: str, imu: str, **section: Any) -> RunRequest:
    """Request a run on hardware at these ports."""
    product, station = folder / "product.toml", folder / "station.toml"
    product.write_text(tomli_w.dumps(PRODUCT), encoding="utf-8")
    links = {
        "table": {"profile": "bench", "port": table, "timeout_s": 0.1, **section},
        "imu": {"port": imu, "timeout_s": 0.2},
    }
    station.write_text(tomli_w.dumps({**STATION, **links}), encoding="utf-8")
    return RunRequest("SN-000042", station, product, ("rate",), folder / "runs", "tester")


@pytest.fixture
def run(tmp_path: Path) -> Callable[..., Fault]:
    """Run on hardware at these ports and return the resulting fault."""

    def fault(table: str, imu: str, **section: Any) -> Fault:
        events: list[Event] = []
        execute(asked(tmp_path, table, imu, **section), events.append, Control())
        ended = events[-1]
        assert isinstance(ended, Finalized)
        assert ended.verdict == "fault"
        (found,) = [event for event in events if isinstance(event, Fault)]
        return found

    return fault


@pytest.fixture
def imu() -> Iterator[str]:
    """The port of a fault-free unit."""
    unit = FakeImu()
    with terminal(unit.answer, unit.sends) as port:
        yield port


# A device that is not a table receives no command


@needs_terminals
def test_run_sends_no_command_to_a_device_of_another_model(run: Callable[..., Fault], imu: str) -> None:
    plc = FakeTable({})
    plc.words[0:8] = struct.unpack(">8H", b"WRONGPLC".ljust(16, b"\0"))
    with server(plc.answer) as address:
        fault = run(f"tcp://{address}", imu)
    assert "Model 'WRONGPLC' responds, but the profile is for 'bench-table'" in fault.text
    assert set(plc.functions) == {READ}


@needs_terminals
@pytest.mark.parametrize("code", [2, 4])
def test_run_sends_no_command_to_a_device_that_does_not_report_its_model(
    run: Callable[..., Fault], imu: str, code: int
) -> None:
    functions: list[int] = []

    def refuse(heard: bytes) -> bytes:
        functions.append(heard[7])
        return tcp_pdu(heard, bytes([heard[7] | 0x80, code]))

    with server(refuse) as address:
        fault = run(f"tcp://{address}", imu, unit=7)
    if code == 4:
        assert fault.code == "connection.refused"
        assert (fault.values["unit"], fault.values["exception"]) == (7, 4)
    else:
        assert f"(Modbus exception {code})" in fault.text
    assert set(functions) == {READ}


@needs_terminals
def test_no_command_is_sent_if_the_imu_is_not_identified(run: Callable[..., Fault]) -> None:
    table, unit = FakeTable({}), FakeImu(mute=True)
    with server(table.answer) as address, terminal(unit.answer, unit.sends) as port:
        assert run(f"tcp://{address}", port).code == "imu.streams_without_answer"
    assert set(table.functions) == {READ}


@pytest.mark.long
@needs_terminals
def test_stop_request_ends_identification(tmp_path: Path, imu: str) -> None:
    others: list[int] = []
    control = Control()

    def nobody(heard: bytes) -> bytes:
        if len(heard) == 8 and heard[0] != 7:
            others.append(heard[0])
            control.send(Command.STOP)
        return b""

    events: list[Event] = []
    with terminal(nobody) as line:
        execute(asked(tmp_path, line, imu, unit=7), events.append, control)
    ended = events[-1]
    assert isinstance(ended, Finalized)
    assert ended.verdict == "stopped"
    assert set(others) == {1}, "further numbers were asked after Stop"


@pytest.mark.parametrize("work", [reset_table, read_table])
def test_device_of_another_model_is_not_reset(work: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(table_reset, "_CLEAR_TIMEOUT", 0.1)
    plc = FakeTable({})
    plc.words[0:8] = struct.unpack(">8H", b"WRONGPLC".ljust(16, b"\0"))
    plc.words[17] |= 1 << 3
    with (
        server(plc.answer) as address,
        raises_code(DeviceFaultError, "table.other_model"),
    ):
        work(ignore_progress, order(table={"port": f"tcp://{address}"}))
    assert set(plc.functions) == {READ}


# Other devices than expected


@needs_terminals
def test_swapped_ports_are_reported(run: Callable[..., Fault], imu: str) -> None:
    bus = Bus()
    with terminal(bus.answer) as line:
        assert run(imu, line).code == "connection.swapped"
    assert set(bus.functions) <= {READ}


@needs_terminals
def test_swapped_ports_are_reported_for_a_unit_that_streams_on_command(
    run: Callable[..., Fault],
) -> None:
    bus, unit = Bus(), FakeImu(rate=0.0)
    with terminal(bus.answer) as line, terminal(unit.answer, unit.sends) as port:
        assert run(port, line).code == "connection.swapped"


@pytest.mark.long
@needs_terminals
def test_responding_unit_number_is_reported(run: Callable[..., Fault], imu: str) -> None:
    bus = Bus(unit=3)
    with terminal(bus.answer) as line:
        fault = run(line, imu, unit=7)
    assert fault.code == "connection.other_unit"
    assert fault.values["model"] == "bench-table"
    assert (fault.values["found"], fault.values["unit"]) == (3, 7)
    assert set(bus.functions) == {READ}


@pytest.mark.long
@needs_terminals
def test_unresponsive_table_is_reported_with_its_unit_number(run: Callable[..., Fault], imu: str) -> None:
    other = Bus(unit=3, model=b"pump")  # another device on the line is not what the profile is for
    with terminal(other.answer) as line:
        fault = run(line, imu, unit=7)
    assert fault.code == "connection.silent_line"
    assert fault.values["unit"] == 7


@needs_terminals
def test_link_tests_report_swapped_ports(imu: str) -> None:
    bus = Bus()
    with terminal(bus.answer) as line:
        crossed = {
            "table": {"port": imu},
            "imu": {"port": line},
        }
        table = check_table_link(ignore_progress, order(**crossed))
        assert (table.state, table.findings[-1].id) == ("error", "imus_line")
        found = check_imu_link(ignore_progress, order(**crossed))
    assert (found.state, found.findings[-1].id) == ("error", "tables_line")


@needs_terminals
def test_table_test_reports_the_responding_unit_number() -> None:
    bus = Bus(unit=3)
    with terminal(bus.answer) as line:
        report = check_table_link(ignore_progress, order(table={"port": line, "unit": 7}))
    assert [f.id for f in report.findings] == ["opened", "silent_rtu", "unit_heard"]
    assert report.findings[-1].values == {"found": 3, "model": "bench-table", "unit": 7}
    with server(lambda heard: tcp_pdu(heard, bytes([0x83, 4]))) as address:
        report = check_table_link(ignore_progress, order(table={"port": f"tcp://{address}", "unit": 7}))
    assert [f.id for f in report.findings] == ["connected", "exception"]


@contextmanager
def bench_table_as_unit(number: int) -> Iterator[tuple[FakeTable, Callable[..., Report]]]:
    """Run the bench's table under a unit number; yield it and a function that tests its link."""
    bench = FakeTable({})

    def answer(heard: bytes) -> bytes:
        return bench.answer(heard) if heard[6] == number else tcp_pdu(heard, bytes([0x83, 4]))

    with server(answer) as address:
        yield (
            bench,
            lambda **table: check_table_link(ignore_progress, order(table={"port": f"tcp://{address}", **table})),
        )


def test_table_that_matches_another_profile_is_reported_with_that_profile() -> None:
    with bench_table_as_unit(1) as (bench, tested):
        report = tested(profile="cia402_drives")
        assert [f.id for f in report.findings] == ["connected", "exception", "profile_heard"]
        assert report.findings[-1].values == {"found": 1, "model": "bench-table", "profile": "bench"}
        bench.words[0:8] = [0x4C41, 0x5448, 0x4500] + [0] * 5
        report = tested(unit=7)
    assert report.findings[-1].values == {"units": "1 (“LATHE”)"}


def test_profile_with_an_inner_drive_of_that_unit_number_is_skipped(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(library, "names", lambda kind: ["cia402_drives", "bench"])
    with bench_table_as_unit(2) as (_, tested):
        report = tested(profile="cia402_drives")
    assert report.findings[-1].values == {"found": 2, "model": "bench-table", "profile": "bench"}


@pytest.mark.long
@needs_terminals
def test_reset_reports_swapped_ports(imu: str) -> None:
    bus = Bus()
    with (
        terminal(bus.answer) as line,
        raises_code(DeviceFaultError, "connection.swapped"),
    ):
        reset_table(ignore_progress, order(table={"port": imu}, imu={"port": line}))
    with (
        terminal(Bus(unit=3).answer) as line,
        raises_code(DeviceFaultError, "connection.other_unit"),
    ):
        read_table(ignore_progress, order(table={"port": line, "unit": 7}))


# Failed connections


@pytest.mark.parametrize("work", [read_table, reset_table])
def test_reason_for_a_failed_connection_is_reported(work: Any) -> None:
    with server(silent) as address:
        pass
    with raises_code(DeviceFaultError, "link.refused"):
        work(ignore_progress, order(table={"port": f"tcp://{address}"}))
    with raises_code(DeviceFaultError, "link.unknown_host"):
        work(ignore_progress, order(table={"port": "tcp://no-such-host.invalid:502"}))


@needs_terminals
@pytest.mark.parametrize("work", [read_table, reset_table])
def test_reason_for_a_failed_serial_port_is_reported(work: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(list_ports, "comports", lambda: [])
    with terminal(silent) as port:
        other = SerialLink(port, SerialSettings(), "imu")
        with raises_code(DeviceFaultError, "link.in_use"):
            work(ignore_progress, order(table={"port": port}))
        other.close()
    with raises_code(DeviceFaultError, "link.no_such_port"):
        work(ignore_progress, order(table={"port": "/dev/ttyNONE7"}))


def test_wrong_address_scheme_is_reported_with_the_correct_one() -> None:
    with pytest.raises(ConfigurationError, match=r"Write socket://10\.0\.0\.7:4001 for a serial server"):
        order(imu={"port": "tcp://10.0.0.7:4001"})
