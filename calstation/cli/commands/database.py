"""`database`: exchanges runs with the shared database, manages its tables and shows the state of the exchange."""

import sys
import threading
from contextlib import suppress
from importlib import resources
from pathlib import Path
from typing import Annotated

import typer

from calstation.cli.options import JsonOption, RunsOption, StationOption, command_group
from calstation.cli.show import emit, plain_console, show_line
from calstation.cli.text import say, sentence
from calstation.database import (
    Exchange,
    ExchangeState,
    LogArchiver,
    adopt_folder,
    database_of,
    exchange_once,
    read_state,
)
from calstation.database import upgrade as upgrade_tables
from calstation.database import watch as exchange_continuously
from calstation.errors import CalstationError
from calstation.jobs import on_stop_signals
from calstation.messages import event_text, local_time

app = command_group()


@app.command()
def exchange(
    station: StationOption = None,
    out: RunsOption = Path("runs"),
    watch: Annotated[bool, typer.Option("--watch")] = False,
) -> int:
    """Send the runs of a folder to the shared database and receive the runs of other stations."""
    url, config = database_of(station)
    name, archive = config.name, config.records.archive
    if watch:
        _watch(out, url, name, archive)
        return 0
    exchange_now = Exchange(out, url, name)
    try:
        exchange_once(exchange_now, out)
        if archive is not None:
            archiver = LogArchiver(out, archive)
            with suppress(CalstationError):  # the error is part of the state
                while archiver.copy_next():
                    pass
            exchange_once(exchange_now, out)
    finally:
        exchange_now.close()
    state = read_state(out)
    console = plain_console(stderr=True)
    for line in _lines(state):
        show_line(console, line)
    for claim in state.claims:
        show_line(console, sentence(event_text(claim.message.id, claim.message.values)))
    failed = state.refusal is not None or (state.logs_pending and state.archive_error is not None)
    return CalstationError.exit_code if failed else 0


def _watch(out: Path, url: str, name: str, archive: str | None) -> None:
    """Exchange the runs of a folder until the process receives a signal to end; show each change of the state."""
    stop, console, previous = threading.Event(), plain_console(stderr=True), list[str]()

    def wait(seconds: float) -> bool:
        lines = _lines(read_state(out))
        for line in lines:
            if line not in previous:
                show_line(console, line)
        previous[:] = lines
        return stop.wait(seconds)

    with on_stop_signals(stop.set):
        exchange_continuously(out, url, name, wait, archive=archive)


def _lines(state: ExchangeState) -> list[str]:
    """Return the errors of the exchange and of the archive, and a line if all runs have been exchanged."""
    errors = (state.error, state.refusal, state.archive_error)
    lines = [sentence(error) for error in errors if error is not None]
    if not state.pending and state.error is None and state.refusal is None:
        lines.insert(0, say("cli.exchanged"))
    return lines


@app.command()
def upgrade(
    url: Annotated[str | None, typer.Argument(metavar="[URL]")] = None,
    station: StationOption = None,
) -> None:
    """Create the tables of the shared database, or upgrade them to this version; requires the database owner."""
    url = url or database_of(station)[0]
    code = "cli.tables_upgraded" if upgrade_tables(url) else "cli.tables_unchanged"
    show_line(plain_console(stderr=True), say(code, database=url))


@app.command()
def adopt(
    out: RunsOption = Path("runs"),
    copy: Annotated[bool, typer.Option("--copy")] = False,
) -> None:
    """Continue the exchange of a folder of runs that was moved or copied."""
    adopt_folder(out, copied=copy)
    show_line(plain_console(stderr=True), say("cli.copy_adopted" if copy else "cli.folder_adopted", folder=out))


@app.command()
def status(out: RunsOption = Path("runs"), json: JsonOption = None) -> None:
    """Show the pending runs and logs and the last contact with the shared database, without using the network."""
    state = read_state(out)
    contact = "-" if state.contact_utc is None else local_time(state.contact_utc.isoformat())
    errors = (state.error, state.refusal, state.archive_error)
    lines = [say("cli.exchange_state", pending=state.pending, logs=state.logs_pending, contact=contact)]
    emit(state.to_json(), json, [*lines, *(sentence(error) for error in errors if error is not None)])


@app.command()
def roles() -> None:
    """Print the SQL of the roles with minimal rights, to be executed by the database owner."""
    sys.stdout.write(resources.files("calstation.database").joinpath("roles.sql").read_text(encoding="utf-8"))
