"""`study`: units against truth and bound, as a table of every case and parameter group."""

import sys
from collections.abc import Mapping
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from calstation.cli.show import check_json, emit_json
from calstation.errors import ConfigurationError
from calstation.physics.units import DISPLAY
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
