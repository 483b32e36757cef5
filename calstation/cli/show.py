"""Display of results and messages on the terminal: a table in display units, and JSON on request."""

import json as json_module
import math
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any, NoReturn

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table
from rich.text import Text as RichText

from calstation.cli.text import say, sentence, term
from calstation.escaping import for_terminal
from calstation.jobs import ProgressCallback
from calstation.judgement import Check, Where
from calstation.messages import Text, known
from calstation.physics import (
    DEGREE,
    compared_number,
    display,
    display_by_unit,
    limit_numbers,
    number,
    unit_of_parameter,
)
from calstation.records import Verdict
from calstation.results import PositionResidual, Result, value_decisions, write_json

#: Mark of a rest or move by its state: "!" for notable residuals, "!!" for residuals that contradict the model.
_STATE_MARKS = {"good": "", "caution": "!", "bad": "!!"}
#: Headings of text columns, which are left-aligned.
_TEXT_COLUMNS = (
    *("", "cli.column_parameter", "cli.column_unit", "cli.column_verdict", "cli.column_rest", "cli.column_group"),
    *("cli.column_stored_as", "cli.column_serial", "cli.column_product", "cli.column_station", "cli.column_operator"),
    *("cli.column_month", "cli.column_start", "cli.column_before", "cli.column_after", "cli.column_failed_checks"),
    *("cli.column_check", "cli.column_normal", "cli.column_fault"),
)
#: Largest width of the table of residuals, characters.
_TABLE_WIDTH = 200


class _PlainConsole(Console):
    def render_str(self, text: str, **options: Any) -> RichText:
        return super().render_str(for_terminal(text), **options)

    def on_broken_pipe(self) -> NoReturn:
        """Raise the BrokenPipeError that is being handled, because the command defines the exit code."""
        raise


def plain_console(*, stderr: bool = False, file: IO[str] | None = None, width: int | None = None) -> Console:
    """Return a console on which brackets, as in ``[imu]``, and control characters have no special meaning."""
    return _PlainConsole(stderr=stderr, file=file, width=width, markup=False, emoji=False, highlight=False)


def show_line(console: Console, text: str) -> None:
    """Print a line without wrapping or formatting it."""
    console.print(text, soft_wrap=True)


def ignore_progress(fraction: float, remaining_s: float | None = None, note: str = "") -> None:
    """Ignore the progress of a job that takes a few seconds."""


@contextmanager
def job_progress(text: str, describe: Callable[[str], str] = lambda note: "") -> Iterator[ProgressCallback]:
    """Show the progress of a job and its notes, which `describe` converts to text."""
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TimeElapsedColumn(),
        TextColumn("{task.fields[note]}", markup=False),
    )
    console = plain_console(stderr=True)
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task(text, total=1.0, note="")

        def show(fraction: float, remaining_s: float | None = None, note: str = "") -> None:
            bar.update(task, completed=fraction, note=describe(note))

        yield show


def emit_json(result: Mapping[str, Any] | Sequence[Mapping[str, Any]], target: str | None) -> None:
    """Write a result as JSON to a file or, if `target` is ``-``, to standard output; do nothing if it is None."""
    if target == "-":
        sys.stdout.write(json_module.dumps(result, indent=1, allow_nan=False) + "\n")
        sys.stdout.flush()
    elif target is not None:
        write_json(Path(target), result)


def emit(result: Mapping[str, Any], target: str | None, lines: Iterable[str]) -> None:
    """Write a result as JSON, see `emit_json`, and print the lines unless the JSON is written to standard output."""
    emit_json(result, target)
    if target != "-":
        console = plain_console(file=sys.stdout)
        for line in lines:
            show_line(console, line)


def on_line(line: str, action: Callable[[], object]) -> None:
    """Call `action` each time the user enters `line`, until the program ends; standard input must be a terminal."""

    def listen() -> None:
        # os.read does not lock sys.stdin, which the interpreter could not release at exit.
        with suppress(OSError):
            while entered := os.read(sys.stdin.fileno(), 1024):
                if entered.strip().lower() == line.encode():
                    action()

    if sys.stdin.isatty():
        if sys.platform != "win32":  # reading in the background would suspend the engine too
            signal.signal(signal.SIGTTIN, signal.SIG_IGN)
        threading.Thread(target=listen, name="keyboard", daemon=True).start()


def new_table(title: str, *columns: str | Text, **style: Any) -> Table:
    """Create a table with left-aligned text columns; `columns` are the headings: codes, messages, or "" for none."""
    created = Table(title=title, title_justify="left", box=SIMPLE_HEAD, **{"padding": (0, 1), **style})
    for column in columns:
        heading = sentence(column) if isinstance(column, Text) else column and say(column)
        created.add_column(heading, justify="left" if column in _TEXT_COLUMNS else "right", no_wrap=True)
    return created


def three_digits(value: float) -> str:
    """Format a number with three significant digits."""
    return f"{value:.0f}" if abs(value) >= 100.0 else f"{value:.3g}"


def interval(low: str, high: str) -> str:
    """Return the text of an interval."""
    return say("cli.interval", low=low, high=high)


def result_table(console: Console, result: Result) -> None:
    """Show every parameter with its sigma, limit and verdict, then the other checks and the decision rule."""
    has_acceptance = any(check.acceptance for check in result.checks)  # shown instead of limits; the JSON has both
    limit_column = "cli.column_accepted" if has_acceptance else "cli.column_limit"
    columns = "cli.column_parameter", "cli.column_value", "cli.column_sigma", "cli.column_unit", limit_column
    title = say("cli.unit_title", serial=result.serial)
    table = new_table(title, *columns, "cli.column_sigma_limit", "cli.column_verdict")
    limits = {(c.kind, c.subject): c for c in result.checks if c.kind in ("within", "sigma_below")}
    for name, row in result.compared.items():
        (value, unit), sigma = display(name, row.value), display(name, row.sigma)[0]
        within, below = limits.pop(("within", name), None), limits.pop(("sigma_below", name), None)
        size = unit_of_parameter(name)[1]
        limit, sigma_limit = (None if check is None else check.compared_with for check in (within, below))
        limits_text = "" if limit is None else _interval_text(limit, size, row.value)
        largest_sigma = "" if sigma_limit is None else limit_numbers(sigma_limit, size, row.sigma)[-1]
        value_text = compared_number(number(value, sigma), size, row.value, limit)
        sigma_text = compared_number(f"{sigma:.2g}", size, row.sigma, sigma_limit)
        parameter_checks = [c for c in (within, below) if c is not None]
        verdict = _verdict_text(name in result.undetermined, parameter_checks)
        if not verdict and name in result.not_compared:
            verdict = say("cli.verdict_unjudged")
        table.add_row(name, value_text, sigma_text, unit, limits_text, largest_sigma, verdict)
    for column in (*table.columns[:3], table.columns[-1]):  # only the other columns may become narrower
        column.min_width = max((len(str(cell)) for cell in column.cells), default=0)
    if result.parameters:
        console.print(table)
    if has_acceptance:
        console.print(say("common.acceptance_limit_about"), soft_wrap=True)
    if result.temperature is not None:
        low, high = result.temperature.range_c
        console.print(say("cli.worst_over_range", low=low, high=high), soft_wrap=True)
    for check in result.checks:
        if check.kind not in ("within", "sigma_below") or (check.kind, check.subject) in limits:
            console.print(_check_line(check))
        if cause := check.cause_text:
            console.print(f"  {sentence(cause)}")
    if result.conformity is not None and (decisions := value_decisions(result)):
        worst, conformity = max(decisions.items(), key=lambda each: each[1].probability)
        code = "cli.conformity_accept" if conformity.accepted else "cli.conformity_reject"
        text = say(code, rule=result.conformity.rule, name=worst, probability=conformity.probability)
        console.print(text, soft_wrap=True)


def residual_table(stage: str, rows: Sequence[PositionResidual]) -> None:
    """Show the residuals of every rest and move of a stage, in sigmas."""
    if not rows:
        return
    table = new_table(
        term("stage", stage),
        *("", "cli.column_rest", "cli.column_seconds", "cli.column_excess", "cli.column_mean", "cli.column_error"),
        *("cli.column_error_sigma", "cli.column_force", "cli.column_vertical", "cli.column_horizontal"),
    )
    for row in rows:
        component = term("residual", row.component_name)
        table.add_row(
            _STATE_MARKS[row.state],
            sentence(row.text),
            f"{row.duration:.1f}",
            _sigmas_text(row.excess),
            "" if math.isnan(row.mean) else f"{component} {row.mean:+.1f}",
            _channel_error_text(row),
            "" if row.channel is None else _sigmas_text(row.error / row.error_sigma),
            *(_sigmas_text(value) for value in (row.force, row.vertical_rate, row.horizontal_rate)),
        )
    plain_console(file=sys.stdout, width=_TABLE_WIDTH).print(table)


def _channel_error_text(row: PositionResidual) -> str:
    if row.channel is None:
        return ""
    value, unit = display_by_unit(row.error_unit, row.error)
    sigma, _ = display_by_unit(row.error_unit, row.error_sigma)
    return f"{term('residual', row.channel_name)} {number(value, sigma)} {unit}"


def _sigmas_text(value: float) -> str:
    return "" if math.isnan(value) else f"{value:+.1f}"


#: Display unit of some kinds of checks, and its size in the unit of the check.
_CHECK_UNITS = {"latitude": ("°", DEGREE), "sample_clock": ("ppm", 1e-6)}


def _check_line(check: Check) -> str:
    verdict = "cli.verdict_outside" if not check.passed else "cli.verdict_near" if check.near_miss else "cli.verdict_ok"
    unit, size = _CHECK_UNITS.get(check.kind, (check.unit, 1.0))
    if check.parameter:
        unit, size = unit_of_parameter(check.parameter)
    if check.kind == "clipping":
        unit = say("common.samples_unit")
    unit = "" if unit == "1" else f" {unit}"
    location = say("cli.at_where", where=_location_text(check.where)) if str(check.where) else ""
    code = f"cli.check_{check.kind}"
    name = say(code) if known(code) else check.name
    low, high = limit_numbers(check.compared_with, size, check.value)
    value = compared_number(f"{check.value / size:.4g}", size, check.value, check.compared_with)
    what = say("common.limit_column" if check.acceptance is None else "common.acceptance_limit_column")
    values = {"name": name, "value": f"{value}{unit}", "where": location}
    values |= {"verdict": say(verdict, limit=what), "what": what}
    limit = interval(low, high) if isinstance(check.compared_with, tuple) else high
    return say("cli.checked", **values, limit=f"{limit}{unit}")


def _location_text(where: Where) -> str:
    if where.rests is None:
        return where.parameter
    return f"{term('stage', where.stage).lower()} {say(where.rests.code, **where.rests.values)}"


def _interval_text(limit: float | tuple[float, float], size: float, value: float) -> str:
    bounds = limit if isinstance(limit, tuple) else (-math.inf, limit)
    if bounds[0] > bounds[1]:  # the guard band leaves no acceptance interval
        return "–"
    low, high = limit_numbers(limit, size, value)
    return f"±{high}" if bounds[0] == -bounds[1] else interval(low, high)


def _verdict_text(unobservable: bool, checks: list[Check]) -> str:
    if unobservable:
        return say("cli.verdict_lost")
    if not checks:
        return ""
    return say("cli.verdict_ok" if all(check.passed for check in checks) else "cli.verdict_outside")


def result_notes(result: Result) -> list[str]:
    """Return notes on what a partial run lacked or did not judge, and on stages that the operator ended."""
    notes = [say("advice.uncalibrated", stages=result.stages)] if result.lacks_calibration else []
    if result.passed and result.partial and result.unjudged:
        notes.append(say("advice.not_judged", names=result.unjudged))
    if result.ended_by_hand:
        notes.append(say("advice.ended_by_hand", stages=result.ended_by_hand))
        if result.verdict is Verdict.FAILED and result.advice == "repeat":
            notes.append(say("advice.repeat_in_full"))
    return notes
