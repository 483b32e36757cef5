"""`resolve`, `import`, `export` and `record`: operations on logs and recordings."""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import cast, get_args

from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from calstation.cli.show import check_json, emit_json, residual_table, result_table, show_line
from calstation.cli.text import say, sentence
from calstation.config import load_station
from calstation.connection import import_capture
from calstation.errors import ConfigurationError, InputError, InsufficientDataError
from calstation.messages import event_text
from calstation.physics import EffectName
from calstation.records import SUFFIX, export_csv, open_log, truth_path, write_log
from calstation.results import resolve, write_json
from calstation.simulation import GradeName, Kind, make_recording


def resolve_command(
    log: Path,
    stages: tuple[str, ...] | None,
    first: int | None,
    last: int | None,
    json: str | None,
    *,
    residuals: bool,
    states: Sequence[str] = (),
    diagnostics: bool = True,
) -> int:
    """Solve a log again, or selected stages between two sequence numbers, and show the result.

    With `residuals`, also show the residuals of every rest and move, or add them to the JSON. `states` are added to the
    model. Without `diagnostics`, only the parameters are solved, and there is no verdict.

    Returns 1 if it is outside the limits. Raises InsufficientDataError after showing the result if a stage lacks data.
    """
    check_json(json)
    if residuals and not diagnostics:
        raise ConfigurationError("cli.residuals_without_tests")
    for state in states:
        _check_choice("--state", state, get_args(EffectName))
    added = cast(tuple[EffectName, ...], tuple(states))
    console = Console(stderr=True)
    columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task(say("cli.reading_log", file=log.name))

        def show(stage: str, seq: int, done: float) -> None:
            share = f", {done:.0%}" if done else ""
            bar.update(task, description=say("cli.solving_stage", stage=stage, seq=seq) + share)

        resolved = resolve(log, stages, first, last, show, residuals=residuals, states=added, diagnostics=diagnostics)
    for event_id, values in resolved.messages:
        console.print(sentence(event_text(event_id, values)), highlight=False, markup=False)
    by_stage = {stage: [row.to_json() for row in rows] for stage, rows in resolved.residuals.items()}
    emit_json({**resolved.result.to_json(), **({"residuals": by_stage} if residuals else {})}, json)
    passed = resolved.result.passed
    if json != "-":
        out = Console(file=sys.stdout)
        for stage, rows in resolved.residuals.items():
            residual_table(stage, rows)
        result_table(out, resolved.result)
        without = "without_limits" if diagnostics else "parameters"
        unjudged = "in_part" if resolved.missing_data else without
        inside = "partial" if resolved.result.partial else "passed"
        ending = unjudged if passed is None else inside if passed else "failed"
        out.print(say(f"cli.resolved_{ending}", stages=resolved.result.stages), highlight=False)
    if resolved.missing_data:
        raise InsufficientDataError(
            "cli.stages_lacking",
            log=log,
            lacking="; ".join(map(sentence, resolved.missing_data)),
            stages=",".join(resolved.result.stages),
        )
    return 1 if passed is False else 0


def import_command(source: Path, target: Path, meta: Path | None, imu: Path | None, station: Path | None) -> int:
    """Write the raw log `target` from a CSV, or from a raw capture with the profile `imu`."""
    console = Console(stderr=True)
    if imu is None:
        log = open_log(source, meta)
        facts = write_log(target, log.meta, log.blocks())
        notes = [say("cli.import_jitter", jitter=1e3 * log.jitter)] if log.jitter else []
    else:
        there = load_station(station)[1]
        found = import_capture(source, target, imu, meta, there.site.place)
        facts = found.facts
        notes = [say("cli.import_damaged", packets=found.failed, bytes=found.skipped)]
        notes += [] if found.has_site else [say("cli.import_site", station=there.name)]
    text = say("cli.imported", file=target, samples=facts.samples, gaps=facts.gaps)
    show_line(console, ", ".join([text, *notes]))
    return 0


def export_command(log: Path, target: Path) -> int:
    """Write `target` and its TOML from a raw log."""
    facts = export_csv(log, target)
    code = "cli.exported_damaged" if facts.damaged else "cli.exported"
    show_line(Console(stderr=True), say(code, file=target, samples=facts.samples, damaged=facts.damaged))
    return 0


def record_command(kind: str, target: Path, grade: str, seed: int) -> int:
    """Write a recording of the virtual bench as the raw log `target`, and its true values as NAME.truth.json."""
    for option, value, choices in (
        ("KIND", kind, get_args(Kind)),
        ("--grade", grade, get_args(GradeName)),
    ):
        _check_choice(option, value, choices)
    if target.suffix != SUFFIX:
        raise InputError("csv.import_name", file=target, suffix=SUFFIX)
    facts, truth = make_recording(cast(Kind, kind), target, cast(GradeName, grade), seed)
    beside = truth_path(target)
    write_json(beside, truth)
    show_line(Console(stderr=True), say("cli.recorded", file=target, samples=facts.samples, truth=beside))
    return 0


def _check_choice(option: str, value: str, choices: tuple[str, ...]) -> None:
    if value not in choices:
        raise ConfigurationError("cli.unknown_choice", option=option, value=value, choices=choices)
