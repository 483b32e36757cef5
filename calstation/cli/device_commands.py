"""The commands `registers` and `table`, each a group of commands."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from calstation.cli.options import ByOption, ConfirmedByOption, JsonOption, ProductOption, StationOption
from calstation.errors import ConfigurationError

if TYPE_CHECKING:
    from calstation.config import RunRequest

registers = typer.Typer(
    help="Registers of units: read them, list what was written, finish an interrupted write, restore earlier values.",
    no_args_is_help=True,
)

SerialArgument = Annotated[str, typer.Argument(metavar="SERIAL", help="Serial number of the unit.")]
RunsOption = Annotated[Path, typer.Option("--out", help="Folder of the runs; a virtual unit's journal is there.")]
YesOption = Annotated[bool, typer.Option("--yes", help="Do not ask before writing.")]
SlotOption = Annotated[str | None, typer.Option(help="Slot of the unit, at a station with several.", metavar="NAME")]
AtRestOption = Annotated[bool, typer.Option("--at-rest", help="Leave the table alone: verify at rest, without a turn.")]


@registers.command("list")
def list_(
    serial: Annotated[str | None, typer.Argument(metavar="SERIAL", help="One unit; default: all.")] = None,
    out: RunsOption = Path("runs"),
    json: JsonOption = None,
) -> None:
    """Show the register writes to units with time and person, and open transfers; --json shows all values."""
    from calstation.cli.registers import list_command

    raise typer.Exit(list_command(out, serial, json))


@registers.command()
def read(
    serial: SerialArgument,
    station: StationOption = None,
    product: ProductOption = None,
    out: RunsOption = Path("runs"),
    slot: SlotOption = None,
    json: JsonOption = None,
) -> None:
    """Show the current registers of a unit. Nothing moves, nothing is written."""
    from calstation.cli.registers import read_command

    raise typer.Exit(read_command(_unit(serial, station, product, out, slot), json))


@registers.command()
def finish(
    context: typer.Context,
    serial: SerialArgument,
    station: StationOption = None,
    product: ProductOption = None,
    out: RunsOption = Path("runs"),
    slot: SlotOption = None,
    json: JsonOption = None,
    yes: YesOption = False,
    at_rest: AtRestOption = False,
    by: ByOption = None,
    confirmed_by: ConfirmedByOption = None,
) -> None:
    """Complete a unit's interrupted transfer. The table turns to verify it."""
    from calstation.cli.registers import operate_command
    from calstation.config import RegisterOperation

    operation = RegisterOperation(_unit(serial, station, product, out, slot), "finish", at_rest=at_rest)
    raise typer.Exit(operate_command(operation, by, confirmed_by, json, yes=yes, debug=bool(context.obj)))


@registers.command()
def restore(
    context: typer.Context,
    serial: SerialArgument,
    transfer: Annotated[
        str | None, typer.Option(help="As before this transfer of the list; default: the latest.", metavar="ID")
    ] = None,
    station: StationOption = None,
    product: ProductOption = None,
    out: RunsOption = Path("runs"),
    slot: SlotOption = None,
    json: JsonOption = None,
    yes: YesOption = False,
    at_rest: AtRestOption = False,
    by: ByOption = None,
    confirmed_by: ConfirmedByOption = None,
) -> None:
    """Restore the registers that a unit had before a transfer. The table turns to verify them."""
    from calstation.cli.registers import operate_command
    from calstation.config import RegisterOperation

    request = _unit(serial, station, product, out, slot)
    operation = RegisterOperation(request, "restore", transfer=transfer, at_rest=at_rest)
    raise typer.Exit(operate_command(operation, by, confirmed_by, json, yes=yes, debug=bool(context.obj)))


def _unit(serial: str, station: Path | None, product: Path | None, out: Path, slot: str | None) -> "RunRequest":
    from calstation.config import RunRequest, computer_user, load_station

    path, found = load_station(station)
    if found.slot_names and slot is None:
        raise ConfigurationError("cli.slot_missing", path=path, slots=found.slot_names)
    return RunRequest(serial, station, product, out=out, operator=computer_user(), slot=slot)


table = typer.Typer(
    help="The table alone: its state, and the reset of a fault that it has latched. Nothing moves.",
    no_args_is_help=True,
)


@table.command()
def status(station: StationOption = None, product: ProductOption = None, json: JsonOption = None) -> None:
    """Show the table's state and its latched fault; exit code 3 while a fault is latched."""
    from calstation.cli.devices import status_command

    raise typer.Exit(status_command(station, product, json))


@table.command()
def reset(station: StationOption = None, product: ProductOption = None, json: JsonOption = None) -> None:
    """Reset a latched fault after its cause was removed; exit code 3 if it persists. No axis is switched on."""
    from calstation.cli.devices import reset_command

    raise typer.Exit(reset_command(station, product, json))
