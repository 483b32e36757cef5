"""`show`: shows a result in the terminal, with bars for the share of its limit that each parameter uses."""

import sys
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.console import Console

from calstation.cli.options import command_group
from calstation.cli.show import new_table, plain_console, result_notes, result_table, show_line
from calstation.cli.text import say, sentence
from calstation.judgement import Check
from calstation.physics import FloatArray, display, number
from calstation.results import Result, TemperatureResult, result_of, run_outcome, solved_offline

#: Length of a bar whose share of the limit is 1, characters.
_BAR = 16
#: Block characters of a curve over temperature, from low to high, and the number of characters of a curve.
_BARS, _COURSE = "".join(map(chr, range(0x2581, 0x2589))), 16

app = command_group()


@app.command()
def show(result_file: Annotated[Path, typer.Argument(metavar="RESULT.json|LOG")]) -> None:
    """Show parameters, checks and verdict of a result, and how much of its limits every parameter uses.

    For a result over temperature, also show the curve of every parameter.
    """
    result = result_of(result_file)
    out = plain_console(file=sys.stdout)
    result_table(out, result)
    if result.temperature is not None:
        _show_courses(out, result, result.temperature)
    _show_bars(out, result)
    for note in result_notes(result):
        show_line(out, note)
    texts = [sentence(text) for text in (run_outcome(result), solved_offline(result)) if text is not None]
    show_line(out, f"{result.serial}: {say('common.comma').join(texts)}")


def _show_courses(out: Console, result: Result, over: TemperatureResult) -> None:
    """Show the values at the ends of the range, and the curve, of every parameter that depends on temperature."""
    low, high = over.range_c
    columns = ("cli.column_parameter", "cli.column_unit", "cli.column_low", "cli.column_course", "cli.column_high")
    table = new_table(say("cli.courses_title", low=low, high=high), *columns, "cli.column_largest_sigma")
    temperatures = np.linspace(low, high, _COURSE)
    for name in over.largest_changes:
        values, sigmas = result.curve(name, temperatures)
        (first, unit), last = display(name, float(values[0])), display(name, float(values[-1]))[0]
        sigma = display(name, float(sigmas.max()))[0]
        texts = number(first, sigma), _course(values), number(last, sigma), f"{sigma:.2g}"
        table.add_row(name, unit, *texts)
    if table.row_count:
        out.print(table)


def _course(values: FloatArray) -> str:
    """Return a line of bars from the lowest to the highest value."""
    span = float(np.ptp(values)) or 1.0
    return "".join(_BARS[round((len(_BARS) - 1) * float(v - values.min()) / span)] for v in values)


def _show_bars(out: Console, result: Result) -> None:
    """Show value and sigma of every parameter with a limit as bars, as shares of the limit."""
    checks = {(check.kind, check.subject): check for check in result.checks}
    table = new_table(
        say("cli.shares_title"), *("cli.column_parameter", "cli.column_value_share", "cli.column_sigma_share")
    )
    for name in result.parameters:
        within, below = (checks.get((kind, name)) for kind in ("within", "sigma_below"))
        if within is not None or below is not None:
            table.add_row(name, _bar(within), _bar(below))
    if table.row_count:
        out.print(table)


def _bar(check: Check | None) -> str:
    """Return a bar and a percentage for the share of the limit that a value uses."""
    if check is None:
        return ""
    if isinstance(check.limit, tuple):
        low, high = check.limit
        share = abs(2.0 * check.value - low - high) / (high - low)
    else:
        share = abs(check.value) / check.limit
    length = round(_BAR * min(share, 1.0))
    return f"{'#' * length}{'·' * (_BAR - length)} {share:>5.0%}"
