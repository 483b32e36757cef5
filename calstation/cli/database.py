"""`database`: manual or continuous exchange with the shared database; its tables; its state."""

import signal
import sys
import threading
from contextlib import suppress
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console

from calstation.cli.options import JsonOption, StationOption, existing_folder
from calstation.cli.text import say, sentence

if TYPE_CHECKING:
    from calstation.database import ExchangeState

database = typer.Typer(help="The database that stations share.", no_args_is_help=True)

OutOption = Annotated[Path, typer.Option("--out", help="Folder of the runs.", callback=existing_folder)]


@database.command()
def exchange(
    station: StationOption = None,
    out: OutOption = Path("runs"),
    watch: Annotated[bool, typer.Option("--watch", help="Go on until Ctrl-C.")] = False,
) -> None:
    """Send the runs of a folder to the shared database and receive the runs of other stations."""
    from calstation.cli.show import show_line
    from calstation.database import Exchange, LogArchiver, exchange_once, read_state
    from calstation.errors import CalstationError
    from calstation.messages import event_text

    url, name, archive = _database_of(station)
    if watch:
        _watch(out, url, name, archive)
        return
    made = Exchange(out, url, name)
    try:
        exchange_once(made, out)
        if archive is not None:
            archiver = LogArchiver(out, archive)
            with suppress(CalstationError):  # the error is part of the state
                while archiver.copy_next():
                    pass
            exchange_once(made, out)
    finally:
        made.close()
    state = read_state(out)
    console = Console(stderr=True)
    for line in _lines(state):
        show_line(console, line)
    for claim in state.claims:
        show_line(console, sentence(event_text(claim.message.id, claim.message.values)))
    if state.refusal is not None or (state.logs_pending and state.archive_error is not None):
        raise typer.Exit(CalstationError.exit_code)


def _watch(out: Path, url: str, name: str, archive: str | None) -> None:
    """Exchange a folder until a signal to end, and show each change of its state in a line."""
    from calstation.cli.show import show_line
    from calstation.database import read_state, watch

    stop, console, shown = threading.Event(), Console(stderr=True), list[str]()

    def wait(seconds: float) -> bool:
        lines = _lines(read_state(out))
        for line in lines:
            if line not in shown:
                show_line(console, line)
        shown[:] = lines
        return stop.wait(seconds)

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    watch(out, url, name, wait, archive=archive)


def _lines(state: "ExchangeState") -> list[str]:
    """Return the obstacles to the exchange of runs and the copying of logs, or that all runs are exchanged."""

    errors = (state.error_text, state.refusal_text, state.archive_error_text)
    lines = [sentence(error) for error in errors if error is not None]
    if not state.pending and state.error is None and state.refusal is None:
        lines.insert(0, say("cli.exchanged"))
    return lines


@database.command()
def upgrade(
    url: Annotated[
        str | None, typer.Argument(metavar="[URL]", help="Database, with its owner as user; default: the station's.")
    ] = None,
    station: StationOption = None,
) -> None:
    """Create the tables of the shared database, or upgrade them to this version; requires the database owner."""
    from calstation.cli.show import show_line
    from calstation.database import upgrade as upgrade_tables

    url = url or _database_of(station)[0]
    code = "cli.tables_upgraded" if upgrade_tables(url) else "cli.tables_unchanged"
    show_line(Console(stderr=True), say(code, database=url))


@database.command()
def adopt(
    out: OutOption = Path("runs"),
    copy: Annotated[bool, typer.Option("--copy", help="The folder is a copy, and the original stays in use.")] = False,
) -> None:
    """Exchange a folder of runs that was moved, at its current location."""
    from calstation.cli.show import show_line
    from calstation.database import adopt_folder

    adopt_folder(out, copied=copy)
    show_line(Console(stderr=True), say("cli.copy_adopted" if copy else "cli.folder_adopted", folder=out))


@database.command()
def status(out: OutOption = Path("runs"), json: JsonOption = None) -> None:
    """Show what is pending for the shared database and the last contact. Does not use the network."""
    from calstation.cli.show import check_json, emit_json, show_line
    from calstation.database import read_state
    from calstation.messages import local_time

    check_json(json)
    state = read_state(out)
    emit_json(state.to_json(), json)
    if json == "-":
        return
    console = Console()
    contact = "-" if state.contact_utc is None else local_time(state.contact_utc.isoformat())
    show_line(console, say("cli.exchange_state", pending=state.pending, logs=state.logs_pending, contact=contact))
    for error in (state.error_text, state.refusal_text, state.archive_error_text):
        if error is not None:
            show_line(console, sentence(error))


@database.command()
def roles() -> None:
    """Print the SQL of the roles with minimal rights, to be executed by the database owner."""
    sys.stdout.write(resources.files("calstation.database").joinpath("roles.sql").read_text(encoding="utf-8"))


def _database_of(station: Path | None) -> tuple[str, str, str | None]:
    """Return the URL of a station's database, its name and its archive. Raises ConfigurationError if it has none."""
    from calstation.config import load_station
    from calstation.errors import ConfigurationError

    path, config = load_station(station)
    if config.records.database is None:
        raise ConfigurationError("database.not_named", path=path)
    return config.records.database, config.name, config.records.archive
