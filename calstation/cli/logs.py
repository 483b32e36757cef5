"""`resolve`, `import` and `export`: what is done with stored logs."""

import json
import sys
from pathlib import Path
from typing import Any, cast, get_args

from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from calstation.cli.show import check_json, emit_json, result_table
from calstation.cli.wording import NOT_ALL, RESOLVED, word
from calstation.config.library import pair_folder
from calstation.errors import ConfigurationError, InsufficientDataError
from calstation.estimation.pairs.static import SENSORS
from calstation.estimation.pairs.watch import WatchEvent
from calstation.physics.units import DEGREE, DEGREE_PER_HOUR, MICRO_G
from calstation.records.convert import export_csv, import_csv
from calstation.records.log import truth_path
from calstation.records.raw_log import SUFFIX
from calstation.results.pairs import watch_log
from calstation.results.resolve import resolve
from calstation.simulation.bench_recordings import GradeName, Kind, make_recording


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
    emit_json(resolved.result_json, json)
    if json != "-":
        out = Console(file=sys.stdout)
        result_table(out, resolved.result_json)
        passed = resolved.result.passed
        verdict = NOT_ALL if resolved.missing_data and passed is None else RESOLVED[passed]
        out.print(verdict, highlight=False)
    if resolved.missing_data:
        named = ",".join(resolved.result.stages)
        raise InsufficientDataError(
            f"{log}: {'; '.join(resolved.missing_data)}; solved without it, as --stages {named} does"
        )
    return 1 if resolved.result.passed is False else 0


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


def record_command(kind: str, target: Path, grade: str, seed: int) -> int:
    """Write the raw log `target` and its truth as NAME.truth.json."""
    for option, value, known in (("KIND", kind, get_args(Kind)), ("--grade", grade, get_args(GradeName))):
        if value not in known:
            raise ConfigurationError(f"{option} '{value}' is unknown; choose from {', '.join(known)}")
    if target.suffix != SUFFIX:
        raise ConfigurationError(f"{target}: a raw log's name ends in {SUFFIX}; rename the target")
    facts, truth = make_recording(cast(Kind, kind), target, cast(GradeName, grade), seed)
    beside = truth_path(target)
    try:
        beside.write_text(json.dumps(truth, indent=1) + "\n", encoding="utf-8")
    except OSError as exc:
        raise ConfigurationError(f"{beside}: cannot be written ({exc.strerror or exc})") from exc
    Console(stderr=True).print(
        f"{target}: {facts.samples} samples; truth in {beside}", highlight=False, markup=False
    )
    return 0


_SAID = {
    "triggered": "a check is due; waiting for a rest",
    "checked": "imu{number} checked",
    "primary_off": "the primary is off itself ({sensors}); imu{number} is not calibrated against it",
    "calibrating": "off: {secondaries}; waiting for motion",
    "calibrated": "imu{number} calibrated; what was found is kept",
    "given_up": "given up: {why}",
}


def watch_command(log: Path, folder: Path | None, command: bool) -> int:
    """Follow `log`; 0 where every secondary is within its thresholds at the end or has been calibrated, 1 otherwise."""
    out = Console(file=sys.stdout)

    def tell(event: WatchEvent) -> None:
        said = _SAID[event.kind].format(
            number=event.number, **{k: _words(v) for k, v in event.values.items()}
        )
        out.print(f"{event.time:9.1f} s  {said}", highlight=False, markup=False)

    watched = watch_log(log, folder or pair_folder(), command, tell)
    calibrated = {e.number for e in watched.events if e.kind == "calibrated"}
    good = True
    for number, check in watched.checks.items():
        for sensor in SENSORS:
            shown = check.secondary[sensor]
            verdict = "within" if shown.within else "calibrated" if number in calibrated else "OFF"
            good = good and verdict != "OFF"
            size, unit = _unit(sensor, shown.limit)
            out.print(
                f"imu{number} {sensor}: {_plain(shown.value / size)} {unit} at rest"
                f" (threshold {_plain(shown.limit / size)} {unit})  {verdict}",
                highlight=False,
                markup=False,
            )
    if not watched.checks:
        out.print("no rest to check at", highlight=False)
    return 0 if good and watched.checks else 1


def _unit(sensor: str, limit: float) -> tuple[float, str]:
    """SI size and name of the unit in which a threshold is read easily."""
    if sensor == "gyro":
        return (DEGREE_PER_HOUR, "°/h") if limit < 0.1 * DEGREE else (DEGREE, "°/s")
    return (MICRO_G, "µg") if limit < 10_000 * MICRO_G else (1.0, "m/s²")


def _words(value: Any) -> Any:
    """Lists as words, numbers of IMUs with their name."""
    if not isinstance(value, list | tuple):
        return value
    return ", ".join(f"imu{item}" if isinstance(item, int) else str(item) for item in value)


def _plain(value: float) -> str:
    """Three digits, never as a power of ten."""
    return f"{value:.0f}" if abs(value) >= 100.0 else f"{value:.3g}"
