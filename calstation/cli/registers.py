"""`registers`: what was written into units, and interrupted transfers finished or taken back."""

import sys
from collections.abc import Iterator
from pathlib import Path

import typer
from rich.console import Console

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
        for line in _lines(name, transfers) if transfers else ():
            console.print(line, highlight=False, markup=False, soft_wrap=True)
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


def _lines(serial: str, transfers: list[Transfer]) -> Iterator[str]:
    """A transfer's own name on a line that no terminal cuts, what it was below."""
    count = sum(t.cycles for t in transfers)
    yield f"unit {serial}, {count} flash cycles by this station"
    for t in transfers:
        yield f"  {t.id}  {CLOSINGS[t.closing]}"
        yield f"    {t.utc}{f', by {t.by}' if t.by else ''}, for {t.why} {t.source}".rstrip()
        yield f"    largest change: {_change(t)}"


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
