"""`resolve`, `import` and `export`: what is done with stored logs."""

import sys
from pathlib import Path

from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from calstation.cli.show import check_json, emit_json, result_table
from calstation.cli.wording import NOT_ALL, RESOLVED, word
from calstation.errors import InsufficientDataError
from calstation.records.convert import export_csv, import_csv
from calstation.results.resolve import resolve


def resolve_command(
    log: Path, stages: tuple[str, ...] | None, first: int | None, last: int | None, json: str | None
) -> int:
    """Solve `log` again and show the answer; 0 within the limits or without any, 1 outside.

    Raises InsufficientDataError, once the others are shown, where a stage of the log lacks data.
    """
    check_json(json)
    console = Console(stderr=True)
    columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task(f"reading {log.name}")
        resolved = resolve(
            log,
            stages,
            first,
            last,
            lambda stage, seq, done: bar.update(
                task, description=f"solving {stage}, sample {seq}{f', {done:.0%}' if done else ''}"
            ),
        )
    for key, values in resolved.messages:
        console.print(word(key, values), highlight=False, markup=False)
    emit_json(resolved.result, json)
    if json != "-":
        out = Console(file=sys.stdout)
        result_table(out, resolved.result)
        passed = resolved.result["passed"]
        verdict = NOT_ALL if resolved.lacking and passed is None else RESOLVED[passed]
        out.print(verdict, highlight=False)
    if resolved.lacking:
        named = ",".join(resolved.result["stages"])
        raise InsufficientDataError(
            f"{log}: {'; '.join(resolved.lacking)}; solved without it, as --stages {named} does"
        )
    return 1 if resolved.result["passed"] is False else 0


def import_command(source: Path, target: Path, meta: Path | None) -> int:
    """Write the raw log `target` from a CSV."""
    facts = import_csv(source, target, meta)
    Console(stderr=True).print(
        f"{target}: {facts.samples} samples, {facts.gaps} gaps", highlight=False, markup=False
    )
    return 0


def export_command(log: Path, target: Path) -> int:
    """Write `target` and its TOML from a raw log."""
    facts = export_csv(log, target)
    left_out = f", {facts.damaged} damaged rows left out" if facts.damaged else ""
    Console(stderr=True).print(f"{target}: {facts.samples} samples{left_out}", highlight=False, markup=False)
    return 0
