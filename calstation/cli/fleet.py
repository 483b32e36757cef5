"""`fleet`: many logs solved again on many cores, and the solutions of two versions compared."""

import json as json_module
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import IO, TYPE_CHECKING, Annotated

import typer

from calstation.cli.options import JsonOption, StagesOption, parsed_stages

if TYPE_CHECKING:
    from calstation.fleet import FleetRequest, FleetSummary

fleet = typer.Typer(help="Many logs: solve them again on many cores, compare the solutions of two versions.")

DatabaseOption = Annotated[
    str, typer.Option(help="postgresql+psycopg://USER@HOST/NAME or sqlite:////PATH.", metavar="URL")
]


@fleet.command()
def resolve(
    sources: Annotated[
        list[str], typer.Argument(metavar="SOURCE...", help="Logs, folders or URLs; archive: that of the database.")
    ],
    database: DatabaseOption,
    scheduler: Annotated[
        str,
        typer.Option(help="local: workers on this computer, or a Dask cluster.", metavar="local[:N]|tcp://HOST:PORT"),
    ] = "local",
    patch: Annotated[
        Path | None, typer.Option(help="Changes to the stored configuration of the logs.", metavar="FILE.toml")
    ] = None,
    label: Annotated[str | None, typer.Option(help="Name of the changes; default: that of their file.")] = None,
    first: Annotated[int | None, typer.Option("--from", help="First sequence number.", metavar="SEQ")] = None,
    last: Annotated[int | None, typer.Option("--to", help="Last sequence number.", metavar="SEQ")] = None,
    stages: StagesOption = None,
    json: JsonOption = None,
) -> None:
    """Solve many logs again; what the database already has is not solved again. Ctrl-C stops, what is done stays."""
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    from calstation.cli.show import check_json, on_interrupt, say, show_line
    from calstation.fleet import FleetRequest, resolve_fleet

    check_json(json)
    request = FleetRequest(tuple(sources), database, scheduler, patch, label, parsed_stages(stages), first, last)
    stop = threading.Event()
    console = Console(stderr=True)
    columns = (
        TextColumn("solving logs"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[rate]}"),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console, disable=not console.is_terminal) as bar, on_interrupt(stop.set):
        task = bar.add_task("", total=None, rate="")

        def show(summary: "FleetSummary") -> None:
            speed = bar.tasks[0].speed
            rate = "" if speed is None else f"{speed:.1f} per s, {summary.failed} failed"
            bar.update(task, completed=summary.done, total=summary.total, rate=rate)

        summary = resolve_fleet(request, show, stop)
    if json is not None:
        with _target(json) as stream:
            stream.writelines(_json_parts(request, summary))
    for status in summary.failures:
        show_line(console, f"{status.location}: {status.error['error']}")
    code = "cli.fleet_stopped" if summary.stopped else "cli.fleet_done"
    numbers = {name: getattr(summary, name) for name in ("version", "total", "solved_now", "already_there", "failed")}
    show_line(console, say(code, **numbers, left=summary.total - summary.done, seconds=summary.duration_s))
    raise typer.Exit(4 if summary.stopped else 1 if summary.failed else 0)


def _target(json: str) -> IO[str]:
    return open(sys.stdout.fileno(), "w", closefd=False) if json == "-" else Path(json).open("w", encoding="utf-8")


def _json_parts(request: "FleetRequest", summary: "FleetSummary") -> Iterator[str]:
    """Yield the JSON of the contract; the results of many logs are never in memory together."""
    from calstation.fleet import solved_results

    begin = '{"results": [\n'
    for text in solved_results(request.database, summary):
        yield begin + text
        begin = ",\n"
    steps = {step: seconds / summary.answered for step, seconds in summary.seconds.items()}
    rest = {
        "solved_now": summary.solved_now,
        "already_there": summary.already_there,
        "failed": summary.failed,
        "duration_s": summary.duration_s,
        "version": summary.version,
        "stopped": summary.stopped,
        "seconds_per_log": steps,
    }
    yield ("" if begin == ",\n" else begin) + "],\n" + json_module.dumps(rest)[1:] + "\n"
