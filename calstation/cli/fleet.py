"""`fleet`: re-solving of many logs on many cores, and comparison of the solutions of two versions."""

import json as json_module
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, nullcontext
from datetime import datetime
from pathlib import Path
from typing import IO, TYPE_CHECKING, Annotated, Any

import typer

from calstation.cli.options import JsonOption, ParametersOnlyOption, StagesOption, parsed_stages
from calstation.cli.text import say

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from calstation.fleet import Comparison, FleetRequest, FleetSummary

fleet = typer.Typer(help="Many logs: solve them again on many cores, compare the solutions of two versions.")

#: Width of the tables, characters.
_WIDTH = 150
#: Largest number of changed verdicts listed; the JSON contains all.
_MOST_CHANGES = 30
#: Interval of progress lines without a terminal for a bar, s.
_LINE_EVERY = 60.0

DatabaseOption = Annotated[
    str, typer.Option(help="postgresql+psycopg://USER@HOST/NAME or sqlite:////PATH.", metavar="URL")
]


def _day(text: str) -> Any:
    """Return the option for a day."""
    return typer.Option(help=text, formats=["%Y-%m-%d"], metavar="YYYY-MM-DD")


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
    station: Annotated[str | None, typer.Option(help="Only logs of this station.", metavar="NAME")] = None,
    product: Annotated[str | None, typer.Option(help="Only logs of this product.", metavar="NAME")] = None,
    since: Annotated[datetime | None, _day("Only logs from this day on, UTC.")] = None,
    until: Annotated[datetime | None, _day("Only logs up to this day, UTC.")] = None,
    patch: Annotated[
        Path | None, typer.Option(help="Changes to the stored configuration of the logs.", metavar="FILE.toml")
    ] = None,
    label: Annotated[str | None, typer.Option(help="Name of the changes; default: that of their file.")] = None,
    first: Annotated[int | None, typer.Option("--from", help="First sequence number.", metavar="SEQ")] = None,
    last: Annotated[int | None, typer.Option("--to", help="Last sequence number.", metavar="SEQ")] = None,
    stages: StagesOption = None,
    parameters_only: ParametersOnlyOption = False,
    retry_failed: Annotated[bool, typer.Option("--retry-failed", help="Solve logs again that failed before.")] = False,
    compare_with: Annotated[
        str | None,
        typer.Option(
            help="Then compare: unchanged (own configuration, solved too), online (results of the runs) or a version.",
            metavar="unchanged|online|VERSION",
        ),
    ] = None,
    json: JsonOption = None,
) -> None:
    """Solve many logs again, except those already in the database. Ctrl-C stops and keeps finished solutions."""
    from rich.console import Console

    from calstation.cli.show import check_json, job_progress, show_line
    from calstation.fleet import UNCHANGED, FleetRequest, Selection
    from calstation.fleet import compare as compare_versions

    check_json(json)
    chosen, diagnostics = parsed_stages(stages), not parameters_only
    days = (None if day is None else day.date() for day in (since, until))
    request = FleetRequest(
        tuple(sources), database, scheduler, patch, label, chosen, first, last, diagnostics,
        Selection(station, product, *days), retry_failed,
    )  # fmt: skip
    before = None if compare_with is None else request.baseline(compare_with)
    console = Console(stderr=True)
    requests = [request.unchanged, request] if compare_with == UNCHANGED else [request]
    for each in requests:
        summary = _solve(console, each)
        if summary.stopped:
            break
    comparison = None
    if before is not None and summary.solutions and not summary.stopped:
        with job_progress(say("cli.reading_solutions")) as progress:
            comparison = compare_versions(progress, database, before, summary.version, summary.solutions)
    if json is not None:
        with _target(json) as stream:
            stream.writelines(_json_parts(request, summary, comparison))
    if comparison is not None and json != "-":
        _show(comparison)
    if parameters_only:
        show_line(console, say("cli.resolved_parameters"))
    raise typer.Exit(4 if summary.stopped else 1 if summary.failed else 0)


def _solve(console: "Console", request: "FleetRequest") -> "FleetSummary":
    """Solve the logs of a request, show progress, failures and counts, and return the summary."""
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    from calstation.cli.show import on_interrupt, show_line
    from calstation.fleet import resolve_fleet

    stop = threading.Event()

    def interrupt() -> None:
        if stop.is_set():
            raise KeyboardInterrupt
        stop.set()

    columns = (
        TextColumn(say("cli.solving_logs")),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[rate]}"),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console, disable=not console.is_terminal) as bar, on_interrupt(interrupt):
        task = bar.add_task("", total=None, rate="")
        begin: tuple[float, int] | None = None
        shown = time.monotonic()

        def show(summary: "FleetSummary") -> None:
            nonlocal begin, shown
            now = time.monotonic()
            begin = begin or (now, summary.done)
            speed = (summary.done - begin[1]) / max(now - begin[0], 1e-3)
            rate = say("cli.fleet_rate", rate=speed, failed=summary.failed)
            bar.update(task, completed=summary.done, total=summary.total, rate=rate)
            if not console.is_terminal and now - shown >= _LINE_EVERY:
                shown = now
                left = summary.total - summary.done
                show_line(console, say("cli.fleet_progress", left=left, rate=speed, failed=summary.failed))

        summary = resolve_fleet(request, show, stop)
    for status in summary.failures:
        text = status.error["error"]
        show_line(console, text if text.startswith(status.location) else f"{status.location}: {text}")
    code = "cli.fleet_stopped" if summary.stopped else "cli.fleet_done"
    names = ("version", "total", "solved_now", "already_there", "failed", "not_selected")
    numbers = {name: getattr(summary, name) for name in names}
    show_line(console, say(code, **numbers, left=summary.total - summary.done, seconds=summary.duration_s))
    if summary.copies:
        show_line(console, say("cli.fleet_copies", count=len(summary.copies)))
    if summary.unchanged:
        show_line(console, say("cli.fleet_unchanged", count=summary.unchanged))
    return summary


def _target(json: str) -> AbstractContextManager[IO[str]]:
    return nullcontext(sys.stdout) if json == "-" else Path(json).open("w", encoding="utf-8")


def _json_parts(request: "FleetRequest", summary: "FleetSummary", comparison: "Comparison | None") -> Iterator[str]:
    """Yield the JSON of the contract; the results of many logs are never in memory together."""
    from calstation.fleet import solved_results

    begin = '{"results": [\n'
    for text in solved_results(request.database, summary):
        yield begin + text
        begin = ",\n"
    steps = {step: seconds / summary.answered for step, seconds in summary.seconds.items()}
    counts = ("solved_now", "already_there", "failed", "not_selected", "unchanged", "duration_s", "version", "stopped")
    rest = {
        **{name: getattr(summary, name) for name in counts},
        "copies": summary.copies,
        "seconds_per_log": steps,
        **({} if comparison is None else {"comparison": comparison.to_json()}),
    }
    yield ("" if begin == ",\n" else begin) + "],\n" + json_module.dumps(rest)[1:] + "\n"


VersionOption = Annotated[str, typer.Option(help="A version, e.g. 0.1.0+label; online: the results of the runs.")]


@fleet.command()
def compare(database: DatabaseOption, before: VersionOption, after: VersionOption, json: JsonOption = None) -> None:
    """Show the verdicts that differ between two versions, and the change of each parameter in sigmas."""
    from calstation.cli.show import check_json, emit_json, job_progress
    from calstation.fleet import compare as compare_versions

    check_json(json)
    with job_progress(say("cli.reading_solutions")) as progress:
        found = compare_versions(progress, database, before, after)
    emit_json(found.to_json(), json)
    if json != "-":
        _show(found)


@fleet.command()
def export(
    database: DatabaseOption,
    version: VersionOption,
    out: Annotated[Path, typer.Option("-o", "--out", help="File to write.", metavar="FILE.parquet")],
) -> None:
    """Write the solutions of a version to a Parquet file, for DuckDB, pandas and others."""
    from rich.console import Console

    from calstation.cli.show import job_progress, show_line
    from calstation.fleet import export_version

    with job_progress(say("cli.reading_solutions")) as progress:
        count = export_version(progress, database, version, out)
    show_line(Console(stderr=True), say("cli.solutions_written", file=out, count=count))


def _show(found: "Comparison") -> None:
    """Show the changed verdicts, the changes of the parameters, and the groups."""
    from rich.console import Console

    from calstation.cli.show import show_line, table

    console = Console(file=sys.stdout, width=_WIDTH)

    def made(title: str, *columns: str) -> "Table":
        return table(title, *(f"cli.column_{name}" for name in columns), padding=(0, 1, 0, 0))

    numbers = {"logs": found.logs, "only_before": found.only_before, "only_after": found.only_after}
    show_line(console, say("cli.fleet_compared", before=found.before, after=found.after, **numbers))
    verdicts = made(say("cli.verdicts"), "before", "after", "logs")
    for was, row in found.verdicts.items():
        for now, count in row.items():
            verdicts.add_row(was, now, str(count))
    console.print(verdicts)
    if found.changes:
        shown = found.changes[:_MOST_CHANGES]
        title = say("cli.changed_verdicts", shown=len(shown), count=len(found.changes))
        changes = made(title, "serial", "product", "station", "start", "before", "after", "failed_checks")
        for each in shown:
            failed = each.failed_after or each.failed_before
            start = (each.started_utc or "")[:16]
            changes.add_row(each.serial, each.product or "", each.station or "", start, each.before, each.after, failed)
        console.print(changes)
    moves = made(say("cli.moves_of_parameters"), "parameter", "median", "percentile", "largest", "largest_unit")
    for name, move in found.moves.items():
        moves.add_row(name, *(f"{x:.3g}" for x in (move.median, move.percentile_95, move.largest)), move.serial)
    console.print(moves)
    for kind, members in found.groups.items():
        columns = kind, "logs", "pass_to_fail", "fail_to_pass", "largest_move", "sigmas"
        groups = made(say(f"cli.by_{kind}"), *columns)
        for group in members:
            worst = max(group.moves, key=lambda name: group.moves[name].percentile_95, default="")
            far = group.moves[worst].percentile_95 if worst else 0.0
            worst, size = (worst, f"{far:.3g}") if far else ("", "0")
            groups.add_row(group.name, str(group.logs), str(group.pass_to_fail), str(group.fail_to_pass), worst, size)
        console.print(groups)
