"""`study`: units against truth and bound, as a table of every case and parameter group."""

import signal
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any, cast, get_args

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Table

from calstation.cli.show import check_json, emit_json
from calstation.errors import ConfigurationError, StoppedError
from calstation.physics.units import DISPLAY
from calstation.simulation.bench_recordings import GradeName
from calstation.simulation.method_study import run_method_study
from calstation.simulation.soak import Soak, soak
from calstation.simulation.study import SEEDS, run_study


def study_command(grade: str | None, seeds: int | None, json: str | None) -> int:
    """Run the study; 0 where every number is inside its band, 1 otherwise."""
    if grade is not None and grade not in SEEDS:
        raise ConfigurationError(f"--grade '{grade}' is unknown; choose from {', '.join(SEEDS)}")
    if seeds is not None and seeds < 1:
        raise ConfigurationError(f"--seeds {seeds} must be at least 1")
    check_json(json)
    columns = (TextColumn("units"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("units", total=None)
        study = run_study(
            grade,
            seeds,
            lambda done, count: bar.update(task, completed=done, total=count),
        )
    emit_json(study, json)
    if json != "-":
        console = Console(file=sys.stdout)
        for row in study["rows"]:
            _show(console, row)
    return 0 if study["passed"] else 1


def _show(console: Console, row: Mapping[str, Any]) -> None:
    """One case: a line per group, then NEES and the error over the bound."""
    title = f"{row['grade']}: {row['case']}, {row['units']} units"
    table = Table(title=title, title_justify="left", box=SIMPLE_HEAD)
    table.add_column("group", no_wrap=True)
    for heading in ("sigma", "error/sigma", "band", "verdict"):
        table.add_column(heading, justify="left" if heading == "verdict" else "right", no_wrap=True)
    for name, group in row["groups"].items():
        unit, size = DISPLAY[name]
        table.add_row(
            name,
            f"{group['sigma'] / size:.3g} {unit}",
            f"{group['rms']:.3f}",
            f"{group['low']:.3f} to {group['high']:.3f}",
            "ok" if group["passed"] else "OUTSIDE",
        )
    console.print(table)
    nees = row["nees"]
    console.print(
        f"NEES {nees['mean']:.3f} ({nees['low']:.3f} to {nees['high']:.3f}), "
        f"error over bound {row['bound_ratio']:.3f} (limit {row['bound_limit']:.3f}): "
        f"{'passed' if row['passed'] else 'FAILED'}",
        highlight=False,
    )


METHOD_SEEDS = 30


def method_study_command(method: str, grade: str | None, seeds: int | None, json: str | None) -> int:
    """Run the study of one method; 0 where every number is inside its band, 1 otherwise."""
    grades = get_args(GradeName) if grade is None else (grade,)
    if grade is not None and grade not in get_args(GradeName):
        raise ConfigurationError(
            f"--grade '{grade}' is unknown; choose from {', '.join(get_args(GradeName))}"
        )
    if seeds is not None and seeds < 1:
        raise ConfigurationError(f"--seeds {seeds} must be at least 1")
    check_json(json)
    columns = (TextColumn("units"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    rows = []
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        for each in grades:
            rows.append(
                run_method_study(method, cast(GradeName, each), seeds or METHOD_SEEDS, _follow(bar, each))
            )
    passed = all(row["passed"] for row in rows)
    emit_json({"rows": rows, "passed": passed}, json)
    if json != "-":
        console = Console(file=sys.stdout)
        for row in rows:
            _show_method(console, row)
    return 0 if passed else 1


def _follow(bar: Progress, grade: str) -> Callable[[int, int], None]:
    """Shows the units of one grade that are done."""
    task = bar.add_task(grade, total=None)
    return lambda done, count: bar.update(task, completed=done, total=count)


def _show_method(console: Console, row: dict[str, Any]) -> None:
    title = f"{row['method']}: {row['grade']}, {row['units']} units, consistency {row['consistency']:.2f}"
    table = Table(title=title, title_justify="left", box=SIMPLE_HEAD, padding=(0, 1))
    table.add_column("group", no_wrap=True)
    for heading in ("sigma", "error/sigma", "band", "largest", "verdict"):
        table.add_column(heading, justify="left" if heading == "verdict" else "right", no_wrap=True)
    for name, group in row["groups"].items():
        unit, size = DISPLAY[name]
        table.add_row(
            name,
            f"{group['sigma'] / size:.3g} {unit}",
            f"{group['rms']:.3f}",
            f"{group['low']:.3f} to {group['high']:.3f}",
            f"{group['largest']:.2f}",
            "ok" if group["passed"] else "OUTSIDE",
        )
    console.print(table)


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
    _show_soak(Console(stderr=json == "-"), counts)
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


def _show_soak(console: Console, counts: dict[str, Any]) -> None:
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
