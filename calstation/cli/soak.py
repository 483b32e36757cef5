"""`soak`: runs back to back with random faults, and a table of what came of them."""

import signal
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from calstation.cli.show import check_json, emit_json
from calstation.errors import StoppedError
from calstation.simulation.soak import Soak, soak

#: What is done where no number is given.
RUNS = 20

_TOTALS = (
    ("runs", "runs"),
    ("faults injected", "faults_injected"),
    ("runs recovered", "recovered"),
    ("runs stopped safely", "stopped_safely"),
    ("wrong verdicts", "wrong_verdicts"),
    ("table not left safe", "unsafe"),
    ("hung", "hung"),
    ("lost records", "lost_records"),
    ("samples", "samples"),
    ("samples lost", "samples_lost"),
)


def soak_command(runs: int | None, seed: int, json: str | None, *, full: bool, keep: Path | None) -> int:
    """Soak and show; 0 where nothing was wrong, lost, unsafe or hung, else 1; 4 where Ctrl-C ended it early."""
    check_json(json)
    runs = RUNS if runs is None else runs
    with tempfile.TemporaryDirectory(prefix="calstation-soak-") as temporary, _interrupts() as interrupted:
        folder = Path(temporary) if keep is None else keep
        done = _run(runs, seed, folder, full, interrupted)
    counts = {"seed": seed, "full": full, **done.counts()}
    emit_json(counts, json)
    _show(Console(stderr=json == "-"), counts)
    if len(done.runs) < runs:
        return StoppedError.exit_code
    return 0 if done.sound else 1


def _run(runs: int, seed: int, folder: Path, full: bool, interrupted: list[bool]) -> Soak:
    console = Console(stderr=True)
    columns = (
        TextColumn("{task.description}"),
        BarColumn(30),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("{task.fields[now]}"),
    )
    with Progress(*columns, console=console, disable=not console.is_terminal) as bar:
        task = bar.add_task("soak", total=runs, now="")

        def on_run(soak_: Soak) -> None:
            last = soak_.runs[-1]
            what = ", ".join(last.injected) or "no fault"
            bar.update(task, advance=1, now=f"{last.outcome} ({what})")
            how = f"{last.outcome} in {last.seconds:.0f} s ({last.planned.devices})"
            line = f"{last.planned.number + 1}/{runs} {how}: {what}"
            if not console.is_terminal:
                console.print(line, highlight=False, markup=False, soft_wrap=True)
            for text in (*last.wrong, *last.lost, *(["the table was not left safe"] if last.unsafe else [])):
                console.print(
                    f"run {last.planned.number + 1}, seed {last.planned.seed}: {text}", markup=False
                )

        return soak(runs, seed, folder, full=full, on_run=on_run, stopping=lambda: bool(interrupted))


def _show(console: Console, counts: dict[str, Any]) -> None:
    table = Table(title=f"soak, seed {counts['seed']}", title_justify="left", box=SIMPLE_HEAD)
    table.add_column("fault")
    for heading in ("injected", "runs recovered", "stopped safely"):
        table.add_column(heading, justify="right")
    for kind, row in counts["faults"].items():
        table.add_row(kind, *(str(row[name]) for name in ("injected", "recovered", "stopped_safely")))
    console.print(table)
    totals = Table(box=None, show_header=False)
    totals.add_column()
    totals.add_column(justify="right")
    for label, name in _TOTALS:
        totals.add_row(label, f"{counts[name]}")
    for label, name in (("engine memory", "engine_memory_mb"), ("parent memory", "parent_memory_mb")):
        totals.add_row(f"{label}, first tenth → last", "{first:.0f} → {last:.0f} MB".format(**counts[name]))
    totals.add_row("a run", f"{counts['seconds_per_run']:.1f} s")
    console.print(totals)


@contextmanager
def _interrupts() -> Iterator[list[bool]]:
    """Ctrl-C ends the soak behind the run in hand; filled where it came."""
    came: list[bool] = []

    def note(number: int, frame: FrameType | None) -> None:
        came.append(True)
        sys.stderr.write("calstation: ending behind this run\n")

    before = signal.signal(signal.SIGINT, note)
    try:
        yield came
    finally:
        signal.signal(signal.SIGINT, before)
