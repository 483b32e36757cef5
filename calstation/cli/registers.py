"""`registers`: what was written into units, and interrupted transfers finished or taken back."""

import sys
from pathlib import Path

import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from calstation.cli.run import run_request
from calstation.cli.show import check_json, emit_json
from calstation.errors import StoppedError
from calstation.physics.units import display
from calstation.station import register_journal
from calstation.station.config import load_station
from calstation.station.register_journal import Transfer
from calstation.station.request import RunRequest
from calstation.station.unfinished import Settled, finish_transfer, restore_registers

CLOSINGS = {
    None: "OPEN: interrupted, finish or restore it",
    "done": "done, proved",
    "kept": "not done: the unit kept its registers",
    "restored": "taken back",
}


def list_command(runs: Path, serial: str | None, json: str | None) -> int:
    """Show the transfers to one unit, or to every unit that the folder knows."""
    check_json(json)
    serials = register_journal.serials(runs) if serial is None else [serial]
    known = {name: register_journal.history(runs, name) for name in serials}
    emit_json(
        {
            name: {
                "flash_cycles": sum(t.cycles for t in transfers),
                "transfers": [_json(t) for t in transfers],
            }
            for name, transfers in known.items()
        },
        json,
    )
    if json == "-":
        return 0
    console = Console(file=sys.stdout)
    if not any(known.values()):
        console.print(f"no transfer is known in {runs}", highlight=False, markup=False)
    for name, transfers in known.items():
        if transfers:
            console.print(_table(name, transfers))
    return 0


def finish_command(request: RunRequest, json: str | None, *, yes: bool) -> int:
    """Bring a unit's interrupted transfer to its end."""
    _confirm(request, "Its new registers are written, where they are not there yet, and proved at rest.", yes)
    return _show(finish_transfer(_tell, request, request.out), json)


def restore_command(request: RunRequest, ident: str | None, json: str | None, *, yes: bool) -> int:
    """Put earlier registers back into a unit."""
    _confirm(request, "Registers that it held before are written into it.", yes)
    return _show(restore_registers(_tell, request, request.out, request.operator, ident), json)


def unit_request(serial: str, station: Path | None, product: Path | None, out: Path) -> RunRequest:
    """The request that names a unit and where it is."""
    return run_request(None, station, product, serial, None, None, out)


def _confirm(request: RunRequest, what: str, yes: bool) -> None:
    _, station = load_station(request.station)
    question = f"{what} Is unit {request.serial} in the fixture of '{station.name}', at rest?"
    if station.bench is None and not yes and not typer.confirm(question, err=True):
        raise StoppedError("not confirmed; nothing was written")


def _show(settled: Settled, json: str | None) -> int:
    emit_json(
        {"serial": settled.serial, "closing": settled.closing, "registers": dict(settled.registers)}, json
    )
    if json != "-":
        Console(file=sys.stdout).print(
            f"{settled.serial}: {CLOSINGS[settled.closing]}; it holds {len(settled.registers)} registers",
            highlight=False,
        )
    return 0


def _table(serial: str, transfers: list[Transfer]) -> Table:
    count = sum(t.cycles for t in transfers)
    table = Table(
        title=f"unit {serial}, {count} flash cycles by this station", title_justify="left", box=SIMPLE_HEAD
    )
    for heading in ("transfer", "UTC", "by", "for", "largest change", "ended"):
        table.add_column(heading)
    for t in transfers:
        table.add_row(t.id, t.utc, t.by or "", f"{t.why} {t.source}", _change(t), CLOSINGS[t.closing])
    return table


def _change(transfer: Transfer) -> str:
    """The parameter that changes most, by the share of its own size."""
    changes = {name: abs(value - transfer.old.get(name, 0.0)) for name, value in transfer.new.items()}
    sizes = {name: abs(value) + abs(transfer.old.get(name, 0.0)) for name, value in transfer.new.items()}
    shares = {name: changes[name] / size for name, size in sizes.items() if size > 0.0}
    if not any(shares.values()):
        return "none"
    name = max(shares, key=lambda n: shares[n])
    (before, unit), (after, _) = display(name, transfer.old.get(name, 0.0)), display(name, transfer.new[name])
    return f"{name} {before:.4g} → {after:.4g} {unit}"


def _json(transfer: Transfer) -> dict[str, object]:
    return {
        "id": transfer.id,
        "utc": transfer.utc,
        "by": transfer.by,
        "why": transfer.why,
        "source": transfer.source,
        "old": dict(transfer.old),
        "new": dict(transfer.new),
        "steps": list(transfer.steps),
        "closing": transfer.closing,
    }


def _tell(fraction: float, remaining_s: float | None = None, note: str = "") -> None:
    """Nothing is shown of works that take seconds."""
