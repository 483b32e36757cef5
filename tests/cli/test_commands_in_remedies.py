"""Remedies contain complete commands that can be entered as printed."""

import shlex
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from rich.console import Console

from calstation.cli.errors import command_options, complete_commands
from calstation.cli.run import _Display, print_fault
from calstation.config import RunRequest
from calstation.errors import CalstationError, DeviceFaultError
from calstation.messages import Text
from calstation.sequencer import Fault

HERE = RunRequest("SN-1", Path("line 3.toml"), Path("unit.toml"), out=Path("today"))
STATION = "--station 'line 3.toml' --product unit.toml"


def printed(error: CalstationError, request: RunRequest, capsys: pytest.CaptureFixture[str]) -> str:
    """Return the error line printed for a fault."""
    assert print_fault(Fault.of(error), request, debug=False) == error.exit_code
    return capsys.readouterr().err


LATCHED = DeviceFaultError("table.latched_watchdog", fault="watchdog")


def test_remedy_for_a_latched_fault_names_its_station(capsys: pytest.CaptureFixture[str]) -> None:
    assert f"calstation table reset {STATION}, or" in printed(LATCHED, HERE, capsys)
    assert "calstation table reset, or" in printed(LATCHED, RunRequest("SN-1"), capsys)


def test_remedy_of_a_nested_cause_names_its_station(capsys: pytest.CaptureFixture[str]) -> None:
    outer = DeviceFaultError("transfer.at_rest_possible_after_reset", cause=LATCHED.as_text)
    shown = printed(outer, HERE, capsys)
    assert f"calstation table reset {STATION}, or" in shown
    assert shown.endswith("Or leave the table alone: --at-rest.\n")


def test_remedy_for_an_interrupted_transfer_names_station_and_folder(capsys: pytest.CaptureFixture[str]) -> None:
    open_ = DeviceFaultError("transfer.interrupted", serial="SN-1", utc="", holds="new")
    shown = printed(open_, HERE, capsys)
    command = shown.partition(": calstation ")[2].partition(", or ")[0]
    unit = ["registers", "finish", "SN-1"]
    where = ["--station", "line 3.toml", "--product", "unit.toml", "--out", "today"]
    assert shlex.split(command) == unit + where
    assert "calstation registers finish SN-1, or restore" in printed(open_, RunRequest("SN-1"), capsys)


def test_remedy_for_an_interrupted_transfer_names_the_slot(capsys: pytest.CaptureFixture[str]) -> None:
    open_ = DeviceFaultError("transfer.interrupted", serial="SN-1", utc="", holds="new")
    command = f"calstation registers finish SN-1 {STATION} --out today --slot A2"
    assert f"{command}, or restore SN-1." in printed(open_, replace(HERE, slot="A2"), capsys)
    new = DeviceFaultError("imu.holds_new", serial="SN-1", cause=LATCHED.as_text)
    assert f"{command} (or restore SN-1)." in printed(new, replace(HERE, slot="A2"), capsys)
    options = command_options(HERE.station, HERE.product, HERE.out)
    display = _Display(Console(file=sys.stderr, width=70), options)
    display.show(replace(Fault.of(open_), slot="A2"))
    err = capsys.readouterr().err
    assert err.startswith("slot A2: ")
    assert f"{command}, or restore SN-1." in err


def test_remedy_for_an_error_of_the_command_names_its_station() -> None:
    options = command_options(HERE.station, HERE.product, HERE.out)
    with pytest.raises(DeviceFaultError) as raised, complete_commands(options):
        raise DeviceFaultError("transfer.at_rest_possible", cause=Text("table.latched_stall", {"fault": "stall"}))
    assert f"calstation table reset {STATION}, or" in str(raised.value)


def test_remedy_outside_the_command_line_contains_no_options() -> None:
    assert "calstation table reset, or" in str(LATCHED)
