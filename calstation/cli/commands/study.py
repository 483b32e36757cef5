"""`study`: runs a Monte Carlo study of simulated units."""

import sys
from collections.abc import Callable, Mapping
from typing import Any, cast, get_args

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from calstation.cli.options import JsonOption, check_choice, command_group
from calstation.cli.show import emit_json, interval, new_table, plain_console
from calstation.cli.text import say
from calstation.errors import ConfigurationError
from calstation.physics import DISPLAY
from calstation.simulation import SEEDS, GradeName, grades_of, run_method_study, run_study

#: Default number of units per grade in the study of a method.
_METHOD_SEEDS = 30

#: Statistics that a study over temperature adds.
_OVER_TEMPERATURE = ("held_out", "minutes", "worst_sigma_over_limit", "within_limits", "tested")

app = command_group()


@app.command()
def study(
    grade: str | None = None,
    seeds: int | None = None,
    json: JsonOption = None,
    method: str | None = None,
) -> int:
    """Run the study of the stages or of one method; return 0 if every statistic is within its band, otherwise 1."""
    check_choice("--grade", grade, get_args(GradeName) if method else tuple(SEEDS))
    if seeds is not None and seeds < 1:
        raise ConfigurationError("cli.too_small", option="--seeds", value=seeds, least=1, program="calstation study")
    if method is not None:
        return _study_method(method, grade, seeds, json)
    with _units_bar() as bar:
        statistics = run_study(cast(GradeName | None, grade), seeds, _follow(bar, say("cli.simulated_units")))
    emit_json(statistics, json)
    if json != "-":
        console = plain_console(file=sys.stdout)
        for row in statistics["rows"]:
            _show_groups(console, say("cli.study_title", grade=row["grade"], case=row["case"], units=row["units"]), row)
            bound = {"ratio": row["bound_ratio"], "limit": row["bound_limit"]}
            text = say("cli.study_passed" if row["passed"] else "cli.study_failed", **row["nees"], **bound)
            console.print(text)
    return 0 if statistics["passed"] else 1


def _study_method(method: str, grade: str | None, seeds: int | None, json: str | None) -> int:
    grades = grades_of(method) if grade is None else (grade,)
    with _units_bar() as bar:
        rows = [
            run_method_study(method, cast(GradeName, each), seeds or _METHOD_SEEDS, _follow(bar, each))
            for each in grades
        ]
    passed = all(row["passed"] for row in rows)
    emit_json({"rows": rows, "passed": passed}, json)
    if json != "-":
        for row in rows:
            values = {name: row[name] for name in ("method", "grade", "units", "consistency")}
            console = plain_console(file=sys.stdout)
            _show_groups(console, say("cli.method_study_title", **values), row)
            if "minutes" in row:
                text = say("cli.temperature_study", **{name: row[name] for name in _OVER_TEMPERATURE}, **row["nees"])
                console.print(text)
    return 0 if passed else 1


def _units_bar() -> Progress:
    columns = (TextColumn("{task.description}", markup=False), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    return Progress(*columns, console=plain_console(stderr=True), transient=True)


def _follow(bar: Progress, name: str) -> Callable[[int, int], None]:
    task = bar.add_task(name, total=None)
    return lambda done, count: bar.update(task, completed=done, total=count)


def _show_groups(console: Console, title: str, row: Mapping[str, Any]) -> None:
    optional = [key for key in ("largest", "in_use", "cost") if all(key in group for group in row["groups"].values())]
    columns = "cli.column_group", "cli.column_sigma", "cli.column_error_ratio", "cli.column_band"
    table = new_table(title, *columns, *(f"cli.column_{key}" for key in optional), "cli.column_verdict")
    for name, group in row["groups"].items():
        unit, size = DISPLAY[name]
        table.add_row(
            name,
            f"{group['sigma'] / size:.3g} {unit}",
            f"{group['rms']:.3f}",
            interval(f"{group['low']:.3f}", f"{group['high']:.3f}"),
            *(f"{group[key]:.2f}" for key in optional),
            say("cli.verdict_ok" if group["passed"] else "cli.verdict_outside"),
        )
    console.print(table)
