"""`study` and `soak`: Monte Carlo studies of simulated units, and calibrations with random faults."""

import sys
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, cast, get_args

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table

from calstation.cli.errors import complain
from calstation.cli.show import check_json, emit_json, interval, on_interrupt, show_line, table
from calstation.cli.text import say
from calstation.errors import ConfigurationError, StoppedError
from calstation.physics import DISPLAY
from calstation.simulation import SEEDS, GradeName, Soak, run_method_study, run_study, soak

#: Default number of units per grade in the study of a method.
_METHOD_SEEDS = 30

#: Totals of a soak test: keys of the JSON.
_TOTALS = (
    *("runs", "faults_injected", "recovered", "stopped_safely", "wrong_verdicts"),
    *("unsafe", "hung", "lost_records", "samples", "samples_lost"),
)


def study_command(grade: str | None, seeds: int | None, json: str | None) -> int:
    """Run the study; return 0 if every statistic is within its band, 1 otherwise."""
    _check_options(grade, seeds, tuple(SEEDS))
    check_json(json)
    with _units_bar() as bar:
        study = run_study(cast(GradeName | None, grade), seeds, _follow(bar, say("cli.simulated_units")))
    emit_json(study, json)
    if json != "-":
        console = Console(file=sys.stdout)
        for row in study["rows"]:
            _show_groups(console, say("cli.study_title", grade=row["grade"], case=row["case"], units=row["units"]), row)
            bound = {"ratio": row["bound_ratio"], "limit": row["bound_limit"]}
            text = say("cli.study_passed" if row["passed"] else "cli.study_failed", **row["nees"], **bound)
            console.print(text, highlight=False)
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
            values = {name: row[name] for name in ("method", "grade", "units", "consistency")}
            _show_groups(Console(file=sys.stdout), say("cli.method_study_title", **values), row)
    return 0 if passed else 1


def soak_command(runs: int, seed: int, json: str | None, *, full: bool, keep: Path | None) -> int:
    """Run calibrations with random faults and show the outcome.

    Returns 0 if no verdict was wrong and nothing was lost, unsafe or hung, else 1; 4 if Ctrl-C ended it early.
    """
    check_json(json)
    interrupted: list[bool] = []

    def stop() -> None:
        interrupted.append(True)
        complain(say("cli.soak_ending"))

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
    more = [key for key in ("largest", "cost") if all(key in group for group in row["groups"].values())]
    columns = "cli.column_group", "cli.column_sigma", "cli.column_error_ratio", "cli.column_band"
    shown = table(title, *columns, *(f"cli.column_{key}" for key in more), "cli.column_verdict")
    for name, group in row["groups"].items():
        unit, size = DISPLAY[name]
        shown.add_row(
            name,
            f"{group['sigma'] / size:.3g} {unit}",
            f"{group['rms']:.3f}",
            interval(f"{group['low']:.3f}", f"{group['high']:.3f}"),
            *(f"{group[key]:.2f}" for key in more),
            say("cli.verdict_ok" if group["passed"] else "cli.verdict_outside"),
        )
    console.print(shown)


def _soak(runs: int, seed: int, folder: Path, full: bool, interrupted: list[bool]) -> Soak:
    console = Console(stderr=True)
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
            for text in (*last.wrong, *last.lost, *([say("cli.soak_unsafe_run")] if last.unsafe else [])):
                console.print(say("cli.soak_problem", **values, problem=text), markup=False)

        return soak(runs, seed, folder, full=full, on_run=on_run, stopping=lambda: bool(interrupted))


def _show_soak(console: Console, counts: dict[str, Any]) -> None:
    columns = "cli.column_fault", "cli.column_injected", "cli.column_recovered", "cli.column_stopped_safely"
    shown = table(say("cli.soak_title", seed=counts["seed"]), *columns)
    for kind, row in counts["faults"].items():
        shown.add_row(kind, *(str(row[name]) for name in ("injected", "recovered", "stopped_safely")))
    console.print(shown)
    totals = Table(box=None, show_header=False)
    totals.add_column()
    totals.add_column(justify="right")
    for name in _TOTALS:
        totals.add_row(say(f"cli.soak_{name}"), f"{counts[name]}")
    for name in ("engine_memory_mb", "parent_memory_mb"):
        totals.add_row(say(f"cli.soak_{name}"), "{first:.0f} → {last:.0f} MB".format(**counts[name]))
    totals.add_row(say("cli.soak_seconds"), f"{counts['seconds_per_run']:.1f} s")
    console.print(totals)
