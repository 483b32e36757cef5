"""`fleet`: solves many logs again on many cores, and compares the solutions of two versions."""

import json as json_module
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import nullcontext
from datetime import datetime
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table

from calstation.cli.options import (
    JsonOption,
    ParametersOnlyOption,
    StagesOption,
    command_group,
    document_file,
    parsed_stages,
)
from calstation.cli.show import emit_json, job_progress, new_table, plain_console, show_line
from calstation.cli.text import say
from calstation.fleet import (
    UNCHANGED,
    Comparison,
    FleetRequest,
    FleetSummary,
    Selection,
    export_version,
    resolve_fleet,
    solved_results,
)
from calstation.fleet import compare as compare_versions
from calstation.jobs import on_stop_signals

#: Width of the tables, characters.
_WIDTH = 150
#: Largest number of changed verdicts listed; the JSON contains all.
_MAX_CHANGES = 30
#: Interval of the progress lines that are shown instead of a bar without a terminal, s.
_LINE_INTERVAL = 60.0

DatabaseOption = Annotated[str, typer.Option(metavar="URL")]
VersionOption = Annotated[str, typer.Option()]
DayOption = Annotated[datetime | None, typer.Option(formats=["%Y-%m-%d"], metavar="YYYY-MM-DD")]

app = command_group()


@app.command()
def resolve(
    sources: Annotated[list[str], typer.Argument(metavar="SOURCE...")],
    database: DatabaseOption,
    scheduler: Annotated[str, typer.Option(metavar="local[:N]|tcp://HOST:PORT")] = "local",
    station: Annotated[str | None, typer.Option(metavar="NAME")] = None,
    product: Annotated[str | None, typer.Option(metavar="NAME")] = None,
    since: DayOption = None,
    until: DayOption = None,
    patch: Annotated[Path | None, typer.Option(metavar="FILE.toml")] = None,
    label: str | None = None,
    first: Annotated[int | None, typer.Option("--from", metavar="SEQ")] = None,
    last: Annotated[int | None, typer.Option("--to", metavar="SEQ")] = None,
    stages: StagesOption = None,
    parameters_only: ParametersOnlyOption = False,
    retry_failed: Annotated[bool, typer.Option("--retry-failed")] = False,
    compare_with: Annotated[str | None, typer.Option(metavar="unchanged|online|VERSION")] = None,
    json: JsonOption = None,
) -> int:
    """Solve many logs again, except those already in the database; after Ctrl-C, the finished solutions are kept."""
    chosen, diagnostics = parsed_stages(stages), not parameters_only
    days = (None if day is None else day.date() for day in (since, until))
    request = FleetRequest(
        tuple(sources), database, scheduler, patch, label, chosen, first, last, diagnostics,
        Selection(station, product, *days), retry_failed,
    )  # fmt: skip
    baseline = None if compare_with is None else request.baseline(compare_with)
    console = plain_console(stderr=True)
    requests = [request.unchanged, request] if compare_with == UNCHANGED else [request]
    for each in requests:
        summary = _solve(console, each)
        if summary.stopped:
            break
    comparison = None
    if baseline is not None and summary.solutions and not summary.stopped:
        with job_progress(say("cli.reading_solutions")) as progress:
            comparison = compare_versions(progress, database, baseline, summary.version, summary.solutions)
    if json is not None:
        with nullcontext(sys.stdout) if json == "-" else Path(json).open("w", encoding="utf-8") as stream:
            stream.writelines(_json_parts(request, summary, comparison))
    if comparison is not None and json != "-":
        _show(comparison)
    if parameters_only:
        show_line(console, say("cli.resolved_parameters"))
    return 4 if summary.stopped else 1 if summary.failed else 0


def _solve(console: Console, request: FleetRequest) -> FleetSummary:
    """Solve the logs of a request, show the progress and the failures, and return the summary."""
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
    with Progress(*columns, console=console, disable=not console.is_terminal) as bar, on_stop_signals(interrupt):
        task = bar.add_task("", total=None, rate="")
        start: tuple[float, int] | None = None
        last_line = time.monotonic()

        def show(summary: FleetSummary) -> None:
            nonlocal start, last_line
            now = time.monotonic()
            start = start or (now, summary.done)
            speed = (summary.done - start[1]) / max(now - start[0], 1e-3)
            rate = say("cli.fleet_rate", rate=speed, failed=summary.failed)
            bar.update(task, completed=summary.done, total=summary.total, rate=rate)
            if not console.is_terminal and now - last_line >= _LINE_INTERVAL:
                last_line = now
                remaining = summary.total - summary.done
                show_line(console, say("cli.fleet_progress", left=remaining, rate=speed, failed=summary.failed))

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


def _json_parts(request: FleetRequest, summary: FleetSummary, comparison: Comparison | None) -> Iterator[str]:
    """Yield the JSON in parts, because the results of many logs do not fit into memory."""
    begin = '{"results": [\n'
    for text in solved_results(request.database, summary):
        yield begin + text
        begin = ",\n"
    steps = {step: seconds / summary.processed for step, seconds in summary.seconds.items()}
    counts = ("solved_now", "already_there", "failed", "not_selected", "unchanged", "duration_s", "version", "stopped")
    rest = {
        **{name: getattr(summary, name) for name in counts},
        "copies": summary.copies,
        "seconds_per_log": steps,
        **({} if comparison is None else {"comparison": comparison.to_json()}),
    }
    yield ("" if begin == ",\n" else begin) + "],\n" + json_module.dumps(rest)[1:] + "\n"


@app.command()
def compare(database: DatabaseOption, before: VersionOption, after: VersionOption, json: JsonOption = None) -> None:
    """Show the verdicts that differ between two versions, and the change of each parameter in sigmas."""
    with job_progress(say("cli.reading_solutions")) as progress:
        comparison = compare_versions(progress, database, before, after)
    emit_json(comparison.to_json(), json)
    if json != "-":
        _show(comparison)


@app.command()
def export(
    database: DatabaseOption,
    version: VersionOption,
    out: Annotated[Path, typer.Option("-o", "--out", metavar="FILE.parquet", parser=document_file)],
) -> None:
    """Write the solutions of a version to a Parquet file, which DuckDB, pandas and other programs can read."""
    with job_progress(say("cli.reading_solutions")) as progress:
        count = export_version(progress, database, version, out)
    show_line(plain_console(stderr=True), say("cli.solutions_written", file=out, count=count))


def _show(comparison: Comparison) -> None:
    """Show the changed verdicts, the changes of the parameters, and the groups."""
    console = plain_console(file=sys.stdout, width=_WIDTH)

    def section(title: str, *columns: str) -> Table:
        return new_table(title, *(f"cli.column_{name}" for name in columns), padding=(0, 1, 0, 0))

    numbers = {"logs": comparison.logs, "only_before": comparison.only_before, "only_after": comparison.only_after}
    show_line(console, say("cli.fleet_compared", before=comparison.before, after=comparison.after, **numbers))
    verdicts = section(say("cli.verdicts"), "before", "after", "logs")
    for was, row in comparison.verdicts.items():
        for now, count in row.items():
            verdicts.add_row(was, now, str(count))
    console.print(verdicts)
    if comparison.changes:
        listed = comparison.changes[:_MAX_CHANGES]
        title = say("cli.changed_verdicts", shown=len(listed), count=len(comparison.changes))
        changes = section(title, "serial", "product", "station", "start", "before", "after", "failed_checks")
        for each in listed:
            failed = each.failed_after or each.failed_before
            start = (each.started_utc or "")[:16]
            changes.add_row(each.serial, each.product or "", each.station or "", start, each.before, each.after, failed)
        console.print(changes)
    moves = section(say("cli.moves_of_parameters"), "parameter", "median", "percentile", "largest", "largest_unit")
    for name, shift in comparison.moves.items():
        moves.add_row(name, *(f"{x:.3g}" for x in (shift.median, shift.percentile_95, shift.largest)), shift.serial)
    console.print(moves)
    for kind, members in comparison.groups.items():
        columns = kind, "logs", "pass_to_fail", "fail_to_pass", "largest_move", "sigmas"
        groups = section(say(f"cli.by_{kind}"), *columns)
        for group in members:
            worst = max(group.moves, key=lambda name: group.moves[name].percentile_95, default="")
            far = group.moves[worst].percentile_95 if worst else 0.0
            worst, size = (worst, f"{far:.3g}") if far else ("", "0")
            groups.add_row(group.name, str(group.logs), str(group.pass_to_fail), str(group.fail_to_pass), worst, size)
        console.print(groups)
