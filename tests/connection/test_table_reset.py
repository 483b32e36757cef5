"""A latched table fault is reset only on request, without motion; a fault that persists is reported."""

import struct
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
import tomli_w

from calstation.bench import BenchClock, BenchHost
from calstation.cli.app import run_app
from calstation.connection import (
    LinkTestRequest,
    TableReset,
    TableState,
    link_test_configuration,
    read_table,
    reset_table,
    table_reset,
)
from calstation.connection.devices import open_table
from calstation.errors import DeviceFaultError
from calstation.sequencer import check_power
from tests.connection.fake_links import SITE, FakeTable, order, server, tcp_pdu
from tests.helpers import ignore_progress, raises_code
from tests.sequencer.fakes import FakeClock
from tests.sequencer.fakes import FakeTable as SequencerTable

_REMOTE = 1 << 9


class Bench:
    """A table that keeps its state between connections, like a real table."""

    def __init__(self, host: BenchHost) -> None:
        site_folder, _, port = host.endpoints["clock"].rpartition(":")
        self.clock = BenchClock((site_folder, int(port)), 0.0)
        self.order: LinkTestRequest = order(table={"port": f"tcp://{host.endpoints['table']}", "timeout_s": 5.0})

    def inject(self, kind: str, value: float = 0.0) -> None:
        """Inject or clear a fault."""
        self.clock.inject({"order": kind, "value": value})

    def reset(self) -> TableReset:
        """The reset under test."""
        return reset_table(ignore_progress, self.order)

    def standing(self) -> TableState:
        """Return the status of the table."""
        return read_table(ignore_progress, self.order)

    def check_power(self) -> None:
        """Run the check that a run performs before it switches the axes on."""
        setup = link_test_configuration(self.order)
        assert self.order.station.table.port is not None
        table = open_table(setup, self.order.station.table.port)
        try:
            check_power(table.status())
        finally:
            table.close()


@pytest.fixture(scope="module")
def host() -> Iterator[BenchHost]:
    with closing(BenchHost.start({"speed": 0.0, "start_deg": [3.0, -2.0]})) as made:
        yield made


@pytest.fixture(scope="module")
def shared(host: BenchHost) -> Iterator[Bench]:
    made = Bench(host)
    yield made
    made.clock.close()


@pytest.fixture
def bench(shared: Bench, monkeypatch: pytest.MonkeyPatch) -> Bench:
    """The table at rest without a latched fault."""
    monkeypatch.setattr(table_reset, "_CLEAR_TIMEOUT", 0.2)
    shared.inject("interlock", 1)
    shared.clock.sleep(1.0)
    shared.reset()
    assert shared.standing().fault is None
    return shared


@pytest.mark.parametrize(
    ("kind", "name"),
    [("drive_fault", "drive"), ("limit_fault", "limit"), ("stall", "stall"), ("trip_watchdog", "watchdog")],
)
def test_latched_fault_is_reset_and_a_run_can_start_again(bench: Bench, kind: str, name: str) -> None:
    bench.inject(kind)
    with raises_code(DeviceFaultError, f"table.latched_{name}"):
        bench.check_power()
    before = bench.standing()
    assert bench.reset() == TableReset("cleared", name, None)
    bench.check_power()
    after = bench.standing()
    assert (before.fault, after.fault) == (name, None)
    assert not after.enabled
    assert not after.moving
    assert not after.homed, "nobody homed it"
    bench.clock.sleep(2.0)
    later = bench.standing()
    assert (later.outer_deg, later.inner_deg) == pytest.approx((before.outer_deg, before.inner_deg), abs=0.5)


def test_nothing_is_sent_if_nothing_is_latched(bench: Bench) -> None:
    assert bench.reset() == TableReset("nothing", None, None)
    fake = FakeTable({})
    fake.words[17] = _REMOTE
    with server(fake.answer) as address:
        assert reset_table(ignore_progress, order(table={"port": f"tcp://{address}"})).outcome == "nothing"
    assert set(fake.functions) == {3}, "something was written to the table"


def test_nothing_is_reset_while_the_interlock_is_open(bench: Bench) -> None:
    bench.inject("interlock", 0)
    assert bench.reset() == TableReset("interlock_open", "interlock", "interlock")
    assert bench.standing().fault == "interlock"
    bench.inject("interlock", 1)
    bench.clock.sleep(1.0)
    assert bench.standing().fault == "interlock", "closing the cover alone resets nothing"
    assert bench.reset() == TableReset("cleared", "interlock", None)


def test_a_moving_table_is_not_reset(bench: Bench) -> None:
    bench.inject("never_settle", 5.0)
    bench.inject("drive_fault")
    assert bench.reset() == TableReset("moving", "drive", "drive")
    bench.clock.sleep(6.0)
    assert bench.reset().outcome == "cleared"


def test_a_moving_table_without_a_latched_fault_is_not_safe() -> None:
    table = SequencerTable(FakeClock(), target=(1.0, 0.0))
    assert table_reset.reset(table) == TableReset("still_moving", None, None)
    assert not table_reset.reset(table).clear
    assert table.commands == []


class Stubborn(FakeTable):
    """A table that accepts every write but keeps its fault, or rejects the controlword."""

    def __init__(self, *, fault: int, refuses: bool) -> None:
        super().__init__({})
        self.words[17], self.words[18] = _REMOTE | 1 << 3, fault
        self.refuses = refuses
        self.written: list[tuple[int, int]] = []

    def answer(self, heard: bytes) -> bytes:
        if heard[7] == 3:
            return super().answer(heard)
        (address,) = struct.unpack(">H", heard[8:10])
        if self.refuses:
            return tcp_pdu(heard, bytes([heard[7] | 0x80, 4]))
        self.written.append((address, struct.unpack(">H", heard[-2:])[0]))
        return tcp_pdu(heard, heard[7:12])


@pytest.mark.parametrize(("refuses", "outcome"), [(False, "stays"), (True, "refused")])
def test_a_fault_whose_cause_persists_is_reported(refuses: bool, outcome: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(table_reset, "_CLEAR_TIMEOUT", 0.2)
    fake = Stubborn(fault=4, refuses=refuses)
    with server(fake.answer) as address:
        result = reset_table(ignore_progress, order(table={"port": f"tcp://{address}"}))
    assert (result.outcome, result.latched, result.left, result.clear) == (outcome, "drive", "drive", False)
    assert ("current state" in result.words) == refuses
    assert fake.written == ([] if refuses else [(16, 0x06), (16, 0x86), (16, 0x06)]), "nothing else is written"


def test_nothing_is_reset_under_local_control() -> None:
    fake = FakeTable({})
    with server(fake.answer) as address:
        result = reset_table(ignore_progress, order(table={"port": f"tcp://{address}"}))
    assert (result.outcome, set(fake.functions)) == ("local_control", {3})


def test_table_of_another_model_is_never_written_to() -> None:
    fake = Stubborn(fault=4, refuses=False)
    fake.words[0:8] = [0x4142] * 8
    with (
        server(fake.answer) as address,
        raises_code(DeviceFaultError, "table.other_model"),
    ):
        reset_table(ignore_progress, order(table={"port": f"tcp://{address}"}))
    assert fake.written == []


def test_command_line_asks_for_confirmation_and_resets(
    bench: Bench, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    link: dict[str, Any] = {"profile": "bench", "port": bench.order.station.table.port, "timeout_s": 5.0}
    imu = {"port": "/dev/ttyNONE9"}
    station = tmp_path / "line.toml"
    station.write_text(tomli_w.dumps({"name": "line", "site": SITE, "table": link, "imu": imu}), encoding="utf-8")

    def table_command(command: str) -> tuple[int, str]:
        code = run_app(["table", command, "--station", str(station)])
        return code, capsys.readouterr().out

    bench.inject("drive_fault")
    code, text = table_command("status")
    assert code == 3
    assert "fault      drive" in text
    assert table_command("reset") == (0, "Table of 'line': The fault 'drive' was reset; nothing is latched now.\n")
    code, text = table_command("status")
    assert code == 0
    assert "station    line" in text
    assert table_command("reset")[0] == 0
    bench.inject("interlock", 0)
    code, text = table_command("reset")
    assert code == 3
    assert "interlock is open. Close the cover" in text
