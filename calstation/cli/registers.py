"""`registers`: what a unit holds, what was written into units, interrupted transfers finished or taken back."""

import sys
from collections.abc import Iterator
from pathlib import Path

import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from calstation.cli.run import Display, complain, interrupt_stops, run_request
from calstation.cli.show import check_json, emit_json
from calstation.cli.usage import said_as_typed
from calstation.cli.wording import PROOFS
from calstation.config.library import site_folder
from calstation.config.request import RegisterOperation, RunRequest
from calstation.config.station import load_station
from calstation.devices.imu.transfer import Step
from calstation.errors import DeviceFaultError, StoppedError
from calstation.physics.units import display
from calstation.registers.journal import Kind, Transfer
from calstation.registers.listing import UnitTransfers, largest_change, transfers
from calstation.registers.operation import moves_table
from calstation.registers.unit_registers import UnitRegisters, read_unit
from calstation.runs.engine import Engine
from calstation.sequencer.events import Fault, Settled

CLOSINGS = {
    None: "OPEN: interrupted, finish or restore it",
    "done": "done, proved",
    "kept": "not done: the unit kept its registers",
    "restored": "taken back",
}
_CLOSED = {"done": "new registers", "kept": "nothing was written: old registers", "restored": "old registers"}
_KINDS: dict[Kind, str] = {
    "hardware": "on hardware",
    "virtual": "on the virtual bench",
    "unknown": "(written before its station was noted: it counts for hardware and the virtual bench)",
}
_PROOFS = {
    Step.TURNED: "with a turn",
    Step.AT_REST: "at rest",
    Step.READ_BACK: "by reading back alone",
}


def list_command(runs: Path, serial: str | None, json: str | None) -> int:
    """Show the transfers to one unit, or to every unit that the site or the folder of runs knows."""
    check_json(json)
    known = transfers(runs, serial)
    said: dict[str, dict[str, object]] = {}
    for unit in known:
        rows = [_json(transfer, unit.kind) for transfer in unit.transfers]
        said.setdefault(unit.serial, {})[unit.kind] = {"flash_cycles": unit.cycles, "transfers": rows}
    emit_json(said, json)
    if json == "-":
        return 0
    console = Console(file=sys.stdout)
    if not known:
        console.print(f"no transfer is known in {runs} or {site_folder()}", highlight=False, markup=False)
    for unit in known:
        for line in _lines(unit):
            console.print(line, highlight=False, markup=False, soft_wrap=True)
    return 0


def read_command(request: RunRequest, json: str | None) -> int:
    """Show what a unit holds now; nothing moves, nothing is written."""
    check_json(json)
    unit = read_unit(_untold, request, request.out)
    if unit.serial != request.serial:
        raise DeviceFaultError(
            f"IMU: unit '{unit.serial}' is in the fixture, not '{request.serial}'; give its own serial number,"
            " or change the unit"
        )
    emit_json(unit.to_json(), json)
    if json == "-":
        return 0
    console = Console(file=sys.stdout)
    place = "virtual bench" if unit.virtual else "hardware"
    console.print(
        f"unit {unit.serial}, {unit.model}, firmware {unit.firmware} ({place});"
        f" flash cycles known here: {unit.commits}",
        highlight=False,
        markup=False,
        soft_wrap=True,
    )
    if not unit.registers:
        console.print("its IMU profile names no registers", highlight=False)
        return 0
    table = Table(box=SIMPLE_HEAD, padding=(0, 1))
    for heading in ("register", "parameter", "value", "unit", "stored as"):
        table.add_column(
            heading, justify="right" if heading in ("register", "value") else "left", no_wrap=True
        )
    for row in unit.registers:
        value, name = display(row.parameter, row.value)
        table.add_row(str(row.address), row.parameter, f"{value:.4f}", name, row.raw)
    console.print(table)
    return 0


def finish_command(request: RunRequest, json: str | None, *, at_rest: bool, yes: bool, debug: bool) -> int:
    """Bring a unit's interrupted transfer to its end."""
    errand = RegisterOperation(request, "finish", at_rest=at_rest)
    what = "Its new registers are written, where they are not there yet, and proved."
    return _do(errand, what, json, yes=yes, debug=debug)


def restore_command(
    request: RunRequest, ident: str | None, json: str | None, *, at_rest: bool, yes: bool, debug: bool
) -> int:
    """Put earlier registers back into a unit."""
    errand = RegisterOperation(request, "restore", transfer=ident, at_rest=at_rest)
    what = "Registers that it held before are written into it and proved."
    return _do(errand, what, json, yes=yes, debug=debug)


def unit_request(serial: str, station: Path | None, product: Path | None, out: Path) -> RunRequest:
    """The request that names a unit and where it is."""
    return run_request(None, station, product, serial, None, None, out)


def _do(errand: RegisterOperation, what: str, json: str | None, *, yes: bool, debug: bool) -> int:
    """Say what is going to happen, have it done, and show the answer."""
    check_json(json)
    _confirm(errand, what, yes)
    console = Console(stderr=True)
    settled: Settled | None = None
    fault: Fault | None = None
    with (
        said_as_typed(errand.request),
        Engine.start(errand) as engine,
        interrupt_stops(engine),
        Display(console) as display,
    ):
        for event in engine.events():
            display.show(event)
            if isinstance(event, Settled):
                settled = event
            elif isinstance(event, Fault):
                fault = event
    if fault is not None:
        return complain(fault, errand.request, debug=debug)
    if settled is None or settled.closing == "stopped":
        raise StoppedError("stopped")
    _show(settled, json)
    return 0


def _confirm(errand: RegisterOperation, what: str, yes: bool) -> None:
    """No motion that was not announced, and none on hardware that nobody has agreed to."""
    turns = moves_table(errand)
    _, station = load_station(errand.request.station)
    serial = errand.request.serial
    if not turns:
        what += " Nothing moves: at rest hardly anything of the gyros can be proved."
        place = f"unit {serial} in the fixture of '{station.name}', at rest"
    else:
        what += (
            f" For that the table of '{station.name}' is going to move: home, whole turns of both axes before"
            " and after the write, load angle; Ctrl-C stops it, --at-rest leaves it alone."
        )
        place = f"everybody clear of it, and unit {serial} tight in its fixture"
    Console(stderr=True).print(what, highlight=False, markup=False, soft_wrap=True)
    if station.bench is None and not yes and not typer.confirm(f"Is {place}?", err=True):
        raise StoppedError("not confirmed; nothing was written and nothing has moved")


def _show(settled: Settled, json: str | None) -> None:
    held = UnitRegisters.of(settled.unit)
    emit_json(
        {
            "serial": settled.serial,
            "closing": settled.closing,
            "proof": settled.proof or None,
            "registers": held.values,
        },
        json,
    )
    if json != "-":
        proof = f", proved {PROOFS[settled.proof]}" if settled.proof else ""
        Console(file=sys.stdout).print(
            f"{settled.serial}: {_CLOSED[settled.closing]}{proof}", highlight=False, soft_wrap=True
        )


def _untold(fraction: float, remaining_s: float | None = None, note: str = "") -> None:
    """It takes seconds."""


def _lines(unit: UnitTransfers) -> Iterator[str]:
    """A transfer's own name on a line that no terminal cuts, what it was below."""
    yield f"unit {unit.serial} {_KINDS[unit.kind]}, {unit.cycles} flash cycles by this station"
    for t in unit.transfers:
        yield f"  {t.id}  {_closing(t)}"
        yield f"    {t.utc}{f', by {t.by}' if t.by else ''}, for {t.why} {t.source}".rstrip()
        if t.sort.profile:
            yield f"    a {t.sort.model}, by IMU profile '{t.sort.profile}' of product '{t.sort.product}'"
        yield f"    largest change: {_change(t)}"


def _closing(transfer: Transfer) -> str:
    """How it ended, and by what its output was found right, where that was noted."""
    proofs = [words for step, words in _PROOFS.items() if step in transfer.steps]
    if transfer.closing is None or not proofs:
        return CLOSINGS[transfer.closing]
    proved = "" if transfer.closing == "done" else ", proved"
    return f"{CLOSINGS[transfer.closing]}{proved} {proofs[-1]}"


def _change(transfer: Transfer) -> str:
    name = largest_change(transfer)
    if name is None:
        return "none"
    (before, unit), (after, _) = display(name, transfer.old.get(name, 0.0)), display(name, transfer.new[name])
    return f"{name} {before:.4g} → {after:.4g} {unit}".rstrip()


def _json(transfer: Transfer, kind: Kind) -> dict[str, object]:
    return {
        "id": transfer.id,
        "utc": transfer.utc,
        "by": transfer.by,
        "why": transfer.why,
        "source": transfer.source,
        "station": kind,
        "model": transfer.sort.model,
        "profile": transfer.sort.profile,
        "product": transfer.sort.product,
        "old": dict(transfer.old),
        "new": dict(transfer.new),
        "steps": list(transfer.steps),
        "closing": transfer.closing,
    }
