"""`soak`: runs one calibration after another on the virtual bench with random faults."""

import tempfile
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from calstation.cli.errors import print_error
from calstation.cli.options import JsonOption, command_group
from calstation.cli.show import emit_json, new_table, plain_console, show_line
from calstation.cli.text import say
from calstation.errors import StoppedError
from calstation.jobs import on_stop_signals
from calstation.simulation import Soak
from calstation.simulation import soak as run_soak

#: JSON keys of the totals of a soak test.
_TOTALS = (
    *("runs", "faults_injected", "recovered", "stopped_safely", "wrong_verdicts"),
    *("unsafe", "hung", "lost_records", "samples", "samples_lost"),
)

app = command_group()


@app.command()
def soak(
    runs: Annotated[int, typer.Option(min=1)] = 20,
    seed: Annotated[int, typer.Option(min=0)] = 1,
    json: JsonOption = None,
    full: Annotated[bool, typer.Option("--full")] = False,
    keep: Annotated[Path | None, typer.Option(metavar="DIR")] = None,
) -> int:
    """Run calibrations with random faults, and show the outcomes.

    Returns 0 if no verdict was wrong, no data were lost, and no run was unsafe or hung, otherwise 1; 4 after Ctrl-C.
    """
    interrupted: list[bool] = []

    def stop() -> None:
        interrupted.append(True)
        print_error(say("cli.soak_ending"))

    with tempfile.TemporaryDirectory(prefix="calstation-soak-") as temporary, on_stop_signals(stop):
        done = _soak(runs, seed, Path(temporary) if keep is None else keep, full, interrupted)
    counts = {"seed": seed, "full": full, **done.counts()}
    emit_json(counts, json)
    _show_soak(plain_console(stderr=json == "-"), counts)
    if len(done.runs) < runs:
        return StoppedError.exit_code
    return 0 if done.passed else 1


def _soak(runs: int, seed: int, folder: Path, full: bool, interrupted: list[bool]) -> Soak:
    console = plain_console(stderr=True)
    text, now = TextColumn("{task.description}"), TextColumn("{task.fields[now]}")
    columns = (text, BarColumn(30), MofNCompleteColumn(), TimeElapsedColumn(), now)
    with Progress(*columns, console=console, disable=not console.is_terminal) as bar:
        task = bar.add_task(say("cli.soak"), total=runs, now="")

        def on_run(done: Soak) -> None:
            last = done.runs[-1]
            what = ", ".join(last.injected) or say("cli.soak_no_fault")
            bar.update(task, advance=1, now=f"{last.outcome} ({what})")
            values = {"number": last.planned.number + 1, "seed": last.planned.seed, "devices": last.planned.devices}
            if not console.is_terminal:
                outcome = {"outcome": last.outcome, "seconds": last.seconds, "runs": runs, "faults": what}
                show_line(console, say("cli.soak_run", **values, **outcome))
            for text in (
                *last.verdict_errors,
                *last.record_defects,
                *([say("cli.soak_unsafe_run")] if last.unsafe else []),
            ):
                console.print(say("cli.soak_problem", **values, problem=text))

        return run_soak(runs, seed, folder, full=full, on_run=on_run, stopping=lambda: bool(interrupted))


def _show_soak(console: Console, counts: dict[str, Any]) -> None:
    columns = "cli.column_fault", "cli.column_injected", "cli.column_recovered", "cli.column_stopped_safely"
    table = new_table(say("cli.soak_title", seed=counts["seed"]), *columns)
    for kind, row in counts["faults"].items():
        table.add_row(kind, *(str(row[name]) for name in ("injected", "recovered", "stopped_safely")))
    console.print(table)
    totals = Table(box=None, show_header=False)
    totals.add_column()
    totals.add_column(justify="right")
    for name in _TOTALS:
        totals.add_row(say(f"cli.soak_{name}"), f"{counts[name]}")
    for name in ("engine_memory_mb", "parent_memory_mb"):
        totals.add_row(say(f"cli.soak_{name}"), "{first:.0f} → {last:.0f} MB".format(**counts[name]))
    totals.add_row(say("cli.soak_seconds"), f"{counts['seconds_per_run']:.1f} s")
    console.print(totals)
