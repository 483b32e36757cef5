"""Results as people read them: a table in human units, and the JSON where it was asked for."""

import json as json_module
import os
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from calstation.cli.wording import CHECKS
from calstation.config.site_check import LATITUDE
from calstation.errors import ConfigurationError
from calstation.physics.units import DEGREE, display, number
from calstation.results.result import write_json


def check_json(target: str | None) -> None:
    """Refuse a result file that cannot be written, before the work is done. Raises ConfigurationError."""
    if target is None or target == "-":
        return
    path = Path(target)
    if path.is_dir() or not os.access(path if path.exists() else path.parent, os.W_OK):
        raise ConfigurationError(f"--json {path}: cannot be written; choose another file or folder")


def emit_json(result: Mapping[str, Any], target: str | None) -> None:
    """Write the JSON to a file or, for ``-``, to standard output; nothing for None."""
    if target == "-":
        sys.stdout.write(json_module.dumps(result, indent=1, allow_nan=False) + "\n")
        sys.stdout.flush()
    elif target is not None:
        write_json(Path(target), result)


def result_table(console: Console, result: Mapping[str, Any]) -> None:
    """Show every parameter with sigma, unit, limit and verdict, then the other checks."""
    parameters: Mapping[str, Any] = result["parameters"]
    checks = {check["name"]: check for check in result["checks"]}
    table = Table(
        title=f"unit {result['unit']['serial']}", title_justify="left", box=SIMPLE_HEAD, padding=(0, 1)
    )
    table.add_column("parameter", no_wrap=True, min_width=19)
    for heading in ("value", "sigma", "unit", "limit", "≤ sigma"):
        table.add_column(heading, justify="left" if heading == "unit" else "right", no_wrap=True)
    table.add_column("verdict")
    for name, row in parameters.items():
        value, unit = display(name, row["value"])
        sigma, _ = display(name, row["sigma"])
        within = checks.pop(f"{name} within", None)
        below = checks.pop(f"{name} sigma below", None)
        table.add_row(
            name,
            number(value, sigma),
            f"{sigma:.2g}",
            unit,
            "" if within is None else _interval(name, within["limit"]),
            "" if below is None else f"{display(name, below['limit'])[0]:.3g}",
            _verdict(name in result["unobservable"], [c for c in (within, below) if c is not None]),
        )
    if parameters:
        console.print(table)
    for check in checks.values():
        verdict = "OUTSIDE" if not check["passed"] else "ok, near its limit" if check["near_miss"] else "ok"
        unit, size = ("°", DEGREE) if check["name"] == LATITUDE else (check["unit"], 1.0)
        unit = "" if unit == "1" else f" {unit}"
        where = f" at {check['where']}" if "where" in check else ""
        name = CHECKS.get(check["name"], check["name"])
        limit = check["limit"]
        bounds = limit if isinstance(limit, list) else [limit]
        shown = " to ".join(f"{bound / size:.4g}" for bound in bounds)
        console.print(
            f"{name}: {check['value'] / size:.4g}{unit}{where} (limit {shown}{unit})  {verdict}",
            highlight=False,
        )


def _interval(name: str, limit: list[float]) -> str:
    low, high = (display(name, bound)[0] for bound in limit)
    return f"±{high:.4g}" if low == -high else f"{low:.4g} to {high:.4g}"


def _verdict(unobservable: bool, checks: list[Mapping[str, Any]]) -> str:
    if unobservable:
        return "not determined"
    if not checks:
        return ""
    return "ok" if all(check["passed"] for check in checks) else "OUTSIDE"
