"""`registers`: reads registers, lists transfers, completes an interrupted transfer, and restores earlier values."""

import sys
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path
from typing import Annotated, Any

import typer

from calstation.cli.confirmation import ask_people
from calstation.cli.options import (
    ByOption,
    ConfirmedByOption,
    JsonOption,
    ProductOption,
    StationOption,
    YesOption,
    command_group,
)
from calstation.cli.run import engine_events, print_fault
from calstation.cli.show import emit, ignore_progress, new_table, plain_console, show_line
from calstation.cli.text import say, term
from calstation.config import (
    RegisterOperation,
    RunRequest,
    computer_user,
    confirm,
    confirmation_required,
    library,
    load_product,
    load_station,
    site_folder,
)
from calstation.devices.imu import TransferStep
from calstation.devices.profiles import load_imu_profile
from calstation.errors import ConfigurationError, DeviceFaultError, StoppedError
from calstation.physics import PARAMETERS, display
from calstation.registers import Transfer, UnitRegisters, journal, moves_table, read_unit
from calstation.sequencer import Fault, Settled

_VERIFICATIONS = {
    TransferStep.VERIFIED_ROTATING: "turn",
    TransferStep.VERIFIED_AT_REST: "rest",
    TransferStep.READ_BACK: "read_back",
}

SerialArgument = Annotated[str, typer.Argument(metavar="SERIAL")]
JournalOption = Annotated[Path, typer.Option("--out")]
SlotOption = Annotated[str | None, typer.Option(metavar="NAME")]
AtRestOption = Annotated[bool, typer.Option("--at-rest")]

app = command_group()


@dataclass(frozen=True)
class _UnitTransfers:
    """Transfers to one unit at one kind of station, the oldest first."""

    serial: str
    kind: str  #: ``hardware`` or ``virtual``.
    transfers: list[Transfer]

    @property
    def cycles(self) -> int:
        """Number of flash cycles used by the transfers."""
        return sum(transfer.cycles for transfer in self.transfers)


@app.command("list")
def list_transfers(
    serial: Annotated[str | None, typer.Argument(metavar="SERIAL")] = None,
    out: JournalOption = Path("runs"),
    json: JsonOption = None,
) -> None:
    """Show the transfers to one unit, or to every unit with a journal in the site's folder or the runs folder."""
    site = site_folder()
    serials = sorted({*journal.serials(out), *journal.serials(site)})
    units = [
        _UnitTransfers(name, kind, transfers)
        for name in serials
        if serial in (None, name)
        for kind, folder in (("hardware", site), ("virtual", out))
        if (transfers := journal.history(folder, name))
    ]
    rows: dict[str, dict[str, Any]] = {}
    for unit in units:
        content = [_json(transfer, unit.kind) for transfer in unit.transfers]
        rows.setdefault(unit.serial, {})[unit.kind] = {"flash_cycles": unit.cycles, "transfers": content}
    lines = [line for unit in units for line in _lines(unit)]
    emit(rows, json, lines or [say("cli.no_transfers", runs=out, site=site)])


@app.command()
def read(
    serial: SerialArgument,
    station: StationOption = None,
    product: ProductOption = None,
    out: JournalOption = Path("runs"),
    slot: SlotOption = None,
    json: JsonOption = None,
) -> None:
    """Show the current registers of a unit; nothing moves and nothing is written."""
    request = _request(serial, station, product, out, slot)
    unit = read_unit(ignore_progress, request, request.out)
    if unit.serial != request.serial:
        raise DeviceFaultError("cli.other_serial", found=unit.serial, expected=request.serial)
    code = "cli.virtual_unit" if unit.virtual else "cli.hardware_unit"
    values = {"serial": unit.serial, "model": unit.model, "firmware": unit.firmware, "cycles": unit.commits}
    lines = [say(code, **values)]
    emit(unit.to_json(), json, lines if unit.registers else [*lines, say("cli.no_registers")])
    if json != "-" and unit.registers:
        columns = "cli.column_register", "cli.column_parameter", "cli.column_value", "cli.column_unit"
        table = new_table("", *columns, "cli.column_stored_as")
        for row in unit.registers:
            value, name = display(row.parameter, row.value)
            table.add_row(str(row.address), row.parameter, f"{value:.4f}", name, row.raw)
        plain_console(file=sys.stdout).print(table)


@app.command()
def finish(
    context: typer.Context,
    serial: SerialArgument,
    station: StationOption = None,
    product: ProductOption = None,
    out: JournalOption = Path("runs"),
    slot: SlotOption = None,
    json: JsonOption = None,
    yes: YesOption = False,
    at_rest: AtRestOption = False,
    by: ByOption = None,
    confirmed_by: ConfirmedByOption = None,
) -> int:
    """Complete a unit's interrupted transfer and verify it."""
    operation = RegisterOperation(_request(serial, station, product, out, slot), "finish", at_rest=at_rest)
    return _run_operation(operation, by, confirmed_by, json, yes=yes, debug=bool(context.obj))


@app.command()
def restore(
    context: typer.Context,
    serial: SerialArgument,
    transfer: Annotated[str | None, typer.Option(metavar="ID")] = None,
    station: StationOption = None,
    product: ProductOption = None,
    out: JournalOption = Path("runs"),
    slot: SlotOption = None,
    json: JsonOption = None,
    yes: YesOption = False,
    at_rest: AtRestOption = False,
    by: ByOption = None,
    confirmed_by: ConfirmedByOption = None,
) -> int:
    """Restore the registers that a unit had before a transfer, by default the latest, and verify them."""
    request = _request(serial, station, product, out, slot)
    operation = RegisterOperation(request, "restore", transfer=transfer, at_rest=at_rest)
    return _run_operation(operation, by, confirmed_by, json, yes=yes, debug=bool(context.obj))


def _request(serial: str, station: Path | None, product: Path | None, out: Path, slot: str | None) -> RunRequest:
    """Return the request for a unit. Raises ConfigurationError if the station has slots and none is named."""
    path, config = load_station(station)
    if config.slot_names and slot is None:
        raise ConfigurationError("cli.slot_missing", path=path, slots=config.slot_names)
    return RunRequest(serial, station, product, out=out, operator=computer_user(), slot=slot)


def _run_operation(
    operation: RegisterOperation, by: str | None, confirmed_by: str | None, json: str | None, *, yes: bool, debug: bool
) -> int:
    """Announce a register operation, run it in the engine, and show its result; two people confirm it if required."""
    _announce_and_confirm(operation, yes)
    operation = _with_people(operation, by, confirmed_by)
    settled = fault = None
    for event in engine_events(operation.request, operation):
        settled = event if isinstance(event, Settled) else settled
        fault = event if isinstance(event, Fault) else fault
    if fault is not None:
        return print_fault(fault, operation.request, debug=debug)
    if settled is None or settled.closing == "stopped":
        raise StoppedError("cli.stopped")
    proof = settled.proof or None
    registers = UnitRegisters.of(settled.unit).values
    row = {"serial": settled.serial, "closing": settled.closing, "proof": proof, "registers": registers}
    verified = f", {term('proof', proof)}" if proof else ""
    emit(row, json, [f"{settled.serial}: {say(f'cli.closed_{settled.closing}')}{verified}"])
    return 0


def _with_people(operation: RegisterOperation, by: str | None, confirmed_by: str | None) -> RegisterOperation:
    """Return a register operation with the responsible persons. Raises ConfigurationError."""
    station, product = load_station(operation.request.station)[1], load_product(operation.request.product)[1]
    required = confirmation_required("registers", product, station)
    first, second = ask_people(by, confirmed_by, operation.request.operator or "", pin=required.pin)
    people = confirm("registers", product, station, first, second)
    return replace(operation, request=replace(operation.request, operator=first.badge), people=people)


def _announce_and_confirm(operation: RegisterOperation, yes: bool) -> None:
    """Announce the operation and, on hardware, request confirmation. Raises StoppedError if the user declines."""
    moves = moves_table(operation)
    _, station = load_station(operation.request.station)
    values = {"station": station.name, "serial": operation.request.serial}
    announcement = say(f"cli.operate_{operation.what}")
    effect = say("cli.moves" if moves else "cli.at_rest", **values)
    show_line(plain_console(stderr=True), f"{announcement} {effect}")
    question = say("cli.confirm_moves" if moves else "cli.confirm_at_rest", **values)
    if station.bench is None and not yes and not typer.confirm(question, err=True):
        raise StoppedError("cli.not_confirmed_nor_written")


def _lines(unit: _UnitTransfers) -> Iterator[str]:
    """Yield the lines that describe a unit's transfers, each id on a separate short line."""
    yield say(f"cli.transfers_{unit.kind}", serial=unit.serial, cycles=unit.cycles)
    for t in unit.transfers:
        yield f"  {t.id}  {_closing_text(t)}"
        by_values = t.why == "hand" and t.source
        reason = say(f"cli.transfer_{t.why}{'_from' if by_values else ''}", source=t.source)
        yield "    " + say("cli.transfer_by" if t.by else "cli.transfer_at", utc=t.utc, by=t.by, reason=reason)
        if t.unit_type.profile:
            yield "    " + say("cli.transfer_unit", **asdict(t.unit_type))
        yield "    " + say("cli.largest_change", change=_change_text(t))


def _closing_text(transfer: Transfer) -> str:
    """Return how the transfer ended and, if recorded, how the output was verified."""
    closing = say(f"cli.registers_{transfer.closing or 'open'}")
    verifications = [name for step, name in _VERIFICATIONS.items() if step in transfer.steps]
    if transfer.closing is None or not verifications:
        return closing
    return f"{closing}, {term('proof', verifications[-1])}"


def _change_text(transfer: Transfer) -> str:
    name = largest_change(transfer)
    if name is None:
        return say("cli.none")
    (before, unit), (after, _) = display(name, transfer.old.get(name, 0.0)), display(name, transfer.new[name])
    return f"{name} {before:.4g} → {after:.4g} {unit}".rstrip()


def largest_change(transfer: Transfer) -> str | None:
    """Return the parameter with the largest change relative to its prior sigma in the profile, or None."""
    sigmas = {p.name: p.prior_sigma for p in PARAMETERS} | _prior_sigmas(transfer.unit_type.profile)
    changes = {
        name: abs(value - transfer.old.get(name, 0.0)) / sigmas[name]
        for name, value in transfer.new.items()
        if sigmas.get(name)
    }
    return max(changes, key=lambda name: changes[name]) if any(changes.values()) else None


@cache
def _prior_sigmas(profile: str) -> dict[str, float]:
    for name in library.names("imus"):
        try:
            candidate = load_imu_profile(library.find("imus", name))
        except ConfigurationError:
            continue
        if candidate.name == profile:
            return candidate.prior_sigmas()
    return {}


def _json(transfer: Transfer, kind: str) -> dict[str, object]:
    unit = transfer.unit_type
    return {
        **{name: getattr(transfer, name) for name in ("id", "utc", "by", "why", "source")},
        **{"station": kind, "model": unit.model, "profile": unit.profile, "product": unit.product},
        **{"old": dict(transfer.old), "new": dict(transfer.new)},
        **{"steps": list(transfer.steps), "closing": transfer.closing},
    }
