"""`resolve`, `import`, `export`, `record` and `watch`: operations on logs and recordings."""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, cast, get_args

from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from calstation.cli.show import check_json, emit_json, result_table, say, show_line
from calstation.config import pair_folder
from calstation.errors import ConfigurationError, InputError, InsufficientDataError
from calstation.estimation.common import SampleBlock
from calstation.estimation.pairs import SENSORS, PairWatch, RestDeviation, WatchEvent
from calstation.messages import event_text, sentence
from calstation.physics import DEGREE, DEGREE_PER_HOUR, MICRO_G
from calstation.records import SUFFIX, export_csv, import_csv, truth_path
from calstation.results import PairWatchResult, resolve, watch_log, write_json
from calstation.simulation import GradeName, Kind, make_recording

#: Thresholds below these are shown in °/h and µg, SI.
_SMALL_RATE, _SMALL_FORCE = 0.1 * DEGREE, 10_000 * MICRO_G


def resolve_command(
    log: Path, stages: tuple[str, ...] | None, first: int | None, last: int | None, json: str | None
) -> int:
    """Solve a log again, or selected stages between two sequence numbers, and show the result.

    Returns 1 if it is outside the limits. Raises InsufficientDataError after showing the result if a stage lacks data.
    """
    check_json(json)
    console = Console(stderr=True)
    columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task(f"reading {log.name}")

        def show(stage: str, seq: int, done: float) -> None:
            share = f", {done:.0%}" if done else ""
            bar.update(task, description=f"solving {stage}, sample {seq}{share}")

        resolved = resolve(log, stages, first, last, show)
    for event_id, values in resolved.messages:
        console.print(sentence(event_text(event_id, values)), highlight=False, markup=False)
    emit_json(resolved.result.to_json(), json)
    passed = resolved.result.passed
    if json != "-":
        out = Console(file=sys.stdout)
        result_table(out, resolved.result)
        unjudged = "in_part" if resolved.missing_data else "without_limits"
        ending = unjudged if passed is None else "passed" if passed else "failed"
        out.print(say(f"cli.resolved_{ending}"), highlight=False)
    if resolved.missing_data:
        raise InsufficientDataError(
            "cli.stages_lacking",
            log=log,
            lacking="; ".join(map(sentence, resolved.missing_data)),
            stages=",".join(resolved.result.stages),
        )
    return 1 if passed is False else 0


def import_command(source: Path, target: Path, meta: Path | None) -> int:
    """Write the raw log `target` from a CSV."""
    facts = import_csv(source, target, meta)
    show_line(Console(stderr=True), f"{target}: {facts.samples} samples, {facts.gaps} gaps")
    return 0


def export_command(log: Path, target: Path) -> int:
    """Write `target` and its TOML from a raw log."""
    facts = export_csv(log, target)
    left_out = f", {facts.damaged} damaged rows left out" if facts.damaged else ""
    show_line(Console(stderr=True), f"{target}: {facts.samples} samples{left_out}")
    return 0


def record_command(kind: str, target: Path, grade: str, seed: int) -> int:
    """Write a recording of the virtual bench as the raw log `target`, and its true values as NAME.truth.json."""
    for option, value, choices in (("KIND", kind, get_args(Kind)), ("--grade", grade, get_args(GradeName))):
        if value not in choices:
            raise ConfigurationError("cli.unknown_choice", option=option, value=value, choices=choices)
    if target.suffix != SUFFIX:
        raise InputError("csv.import_name", file=target, suffix=SUFFIX)
    facts, truth = make_recording(cast(Kind, kind), target, cast(GradeName, grade), seed)
    beside = truth_path(target)
    write_json(beside, truth)
    show_line(Console(stderr=True), f"{target}: {facts.samples} samples; truth in {beside}")
    return 0


def watch_command(log: Path, folder: Path | None, command: bool) -> int:
    """Follow a log of IMUs on one body, calibrate the IMUs that are out of tolerance, and store the results.

    Returns 0 if every sensor of every IMU is within its threshold at the last check or has been calibrated, else 1.
    """
    out = Console(file=sys.stdout)
    watched = watch_log(log, folder or pair_folder(), command, [_Shown(out)])
    _show_checks(out, watched)
    return 0 if watched.within else 1


class _Shown:
    """Prints the events of a watch."""

    def __init__(self, out: Console) -> None:
        self._out = out

    def feed(self, block: SampleBlock, watch: PairWatch, events: Sequence[WatchEvent]) -> None:
        for event in events:
            values = {name: _imus(value) for name, value in event.values.items()}
            text = say(f"cli.watch_{event.kind}", **{"number": event.number, **values})
            show_line(self._out, f"{event.time:9.1f} s  {text}")


def _show_checks(out: Console, watched: PairWatchResult) -> None:
    """Print the last check of every sensor and its verdict."""
    for number, check in watched.checks.items():
        for sensor in SENSORS:
            verdict = {"out_of_tolerance": "OFF"}.get(
                watched.verdicts[number][sensor], watched.verdicts[number][sensor]
            )
            _show_check(out, f"imu{number} {sensor}", sensor, check.secondary[sensor], verdict)
        for sensor in check.primary_out_of_tolerance:
            _show_check(out, f"primary {sensor}", sensor, check.primary[sensor], "OFF")
    if not watched.checks:
        show_line(out, say("cli.no_rest"))


def _show_check(out: Console, name: str, sensor: str, shown: RestDeviation, verdict: str) -> None:
    size, unit = _unit(sensor, shown.limit)
    value, limit = (f"{_plain(x / size)} {unit}" for x in (shown.value, shown.limit))
    show_line(out, f"{name}: {value} at rest (threshold {limit})  {verdict}")


def _unit(sensor: str, limit: float) -> tuple[float, str]:
    """Return the SI size and the name of a readable unit for a threshold."""
    if sensor == "gyro":
        return (DEGREE_PER_HOUR, "°/h") if limit < _SMALL_RATE else (DEGREE, "°/s")
    return (MICRO_G, "µg") if limit < _SMALL_FORCE else (1.0, "m/s²")


def _imus(value: Any) -> Any:
    """Replace IMU numbers in a list by IMU names."""
    if not isinstance(value, list | tuple):
        return value
    return [f"imu{item}" if isinstance(item, int) else str(item) for item in value]


def _plain(value: float) -> str:
    """Format a number with three significant digits."""
    return f"{value:.0f}" if abs(value) >= 100.0 else f"{value:.3g}"
