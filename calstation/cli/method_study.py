"""`study --method`: a method that needs no table against truth, as a table of its parameter groups."""

import sys
from collections.abc import Callable
from typing import Any, cast, get_args

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from calstation.cli.show import check_json, emit_json
from calstation.errors import ConfigurationError
from calstation.physics.units import DISPLAY
from calstation.simulation.bench_recordings import GradeName
from calstation.simulation.method_study import run_method_study

SEEDS = 30


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
            rows.append(run_method_study(method, cast(GradeName, each), seeds or SEEDS, _follow(bar, each)))
    passed = all(row["passed"] for row in rows)
    emit_json({"rows": rows, "passed": passed}, json)
    if json != "-":
        console = Console(file=sys.stdout)
        for row in rows:
            _show(console, row)
    return 0 if passed else 1


def _follow(bar: Progress, grade: str) -> Callable[[int, int], None]:
    """Shows the units of one grade that are done."""
    task = bar.add_task(grade, total=None)
    return lambda done, count: bar.update(task, completed=done, total=count)


def _show(console: Console, row: dict[str, Any]) -> None:
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
