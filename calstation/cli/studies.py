"""`study` and `soak`: Monte Carlo studies of simulated units, and calibrations with random faults."""

import sys
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, cast, get_args

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table

from calstation.cli.errors import complain
from calstation.cli.show import check_json, emit_json, on_interrupt, show_line
from calstation.errors import ConfigurationError, StoppedError
from calstation.physics import DISPLAY
from calstation.simulation import SEEDS, GradeName, Soak, run_method_study, run_study, soak

#: Default number of units per grade in the study of a method.
_METHOD_SEEDS = 30

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


def study_command(grade: str | None, seeds: int | None, json: str | None) -> int:
    """Run the study; return 0 if every statistic is within its band, 1 otherwise."""
    _check_options(grade, seeds, tuple(SEEDS))
    check_json(json)
    with _units_bar() as bar:
        study = run_study(cast(GradeName | None, grade), seeds, _follow(bar, "units"))
    emit_json(study, json)
    if json != "-":
        console = Console(file=sys.stdout)
        for row in study["rows"]:
            title = f"{row['grade']}: {row['case']}, {row['units']} units"
            _show_groups(console, title, row)
            nees = row["nees"]
            console.print(
                f"NEES {nees['mean']:.3f} ({nees['low']:.3f} to {nees['high']:.3f}), "
                f"error over bound {row['bound_ratio']:.3f} (limit {row['bound_limit']:.3f}): "
                f"{'passed' if row['passed'] else 'FAILED'}",
                highlight=False,
            )
    return 0 if study["passed"] else 1


def method_study_command(method: str, grade: str | None, seeds: int | None, json: str | None) -> int:
    """Run the study of one method; return 0 if every statistic is within its band, 1 otherwise."""
    grades = get_args(GradeName)
    _check_options(grade, seeds, grades)
    check_json(json)
    with _units_bar() as bar:
        rows = [
            run_method_study(method, cast(GradeName, each), seeds or _METHOD_SEEDS, _follow(bar, each))
            for each in (grades if grade is None else (grade,))
        ]
    passed = all(row["passed"] for row in rows)
    emit_json({"rows": rows, "passed": passed}, json)
    if json != "-":
        for row in rows:
            title = f"{row['method']}: {row['grade']}, {row['units']} units, consistency {row['consistency']:.2f}"
            _show_groups(Console(file=sys.stdout), title, row)
    return 0 if passed else 1


def soak_command(runs: int, seed: int, json: str | None, *, full: bool, keep: Path | None) -> int:
    """Run calibrations with random faults and show the outcome.

    Returns 0 if no verdict was wrong and nothing was lost, unsafe or hung, else 1; 4 if Ctrl-C ended it early.
    """
    check_json(json)
    interrupted: list[bool] = []

    def stop() -> None:
        interrupted.append(True)
        complain("ending after this run")

    with tempfile.TemporaryDirectory(prefix="calstation-soak-") as temporary, on_interrupt(stop):
        done = _soak(runs, seed, Path(temporary) if keep is None else keep, full, interrupted)
    counts = {"seed": seed, "full": full, **done.counts()}
    emit_json(counts, json)
    _show_soak(Console(stderr=json == "-"), counts)
    if len(done.runs) < runs:
        return StoppedError.exit_code
    return 0 if done.sound else 1


def _check_options(grade: str | None, seeds: int | None, grades: tuple[str, ...]) -> None:
    if grade is not None and grade not in grades:
        raise ConfigurationError("cli.unknown_choice", option="--grade", value=grade, choices=grades)
    if seeds is not None and seeds < 1:
        raise ConfigurationError("cli.too_small", option="--seeds", value=seeds, least=1, program="calstation study")


def _units_bar() -> Progress:
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    return Progress(*columns, console=Console(stderr=True), transient=True)


def _follow(bar: Progress, name: str) -> Callable[[int, int], None]:
    task = bar.add_task(name, total=None)
    return lambda done, count: bar.update(task, completed=done, total=count)


def _show_groups(console: Console, title: str, row: Mapping[str, Any]) -> None:
    table = Table(title=title, title_justify="left", box=SIMPLE_HEAD, padding=(0, 1))
    table.add_column("group", no_wrap=True)
    more = [key for key in ("largest", "cost") if all(key in group for group in row["groups"].values())]
    for heading in ("sigma", "error/sigma", "band", *more):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("verdict", no_wrap=True)
    for name, group in row["groups"].items():
        unit, size = DISPLAY[name]
        table.add_row(
            name,
            f"{group['sigma'] / size:.3g} {unit}",
            f"{group['rms']:.3f}",
            f"{group['low']:.3f} to {group['high']:.3f}",
            *(f"{group[key]:.2f}" for key in more),
            "ok" if group["passed"] else "OUTSIDE",
        )
    console.print(table)


def _soak(runs: int, seed: int, folder: Path, full: bool, interrupted: list[bool]) -> Soak:
    console = Console(stderr=True)
    text, now = TextColumn("{task.description}"), TextColumn("{task.fields[now]}")
    columns = (text, BarColumn(30), MofNCompleteColumn(), TimeElapsedColumn(), now)
    with Progress(*columns, console=console, disable=not console.is_terminal) as bar:
        task = bar.add_task("soak", total=runs, now="")

        def on_run(done: Soak) -> None:
            last = done.runs[-1]
            what = ", ".join(last.injected) or "no fault"
            bar.update(task, advance=1, now=f"{last.outcome} ({what})")
            how = f"{last.outcome} in {last.seconds:.0f} s ({last.planned.devices})"
            if not console.is_terminal:
                show_line(console, f"{last.planned.number + 1}/{runs} {how}: {what}")
            for text in (*last.wrong, *last.lost, *(["the table was not left safe"] if last.unsafe else [])):
                console.print(f"run {last.planned.number + 1}, seed {last.planned.seed}: {text}", markup=False)

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
