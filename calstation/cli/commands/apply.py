"""`apply`: shows the data of a recording or of the connected unit before and after a calibration."""

import sys
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.console import Console

from calstation.cli.options import JsonOption, ProductOption, StationOption, command_group, document_file
from calstation.cli.show import emit_json, ignore_progress, new_table, plain_console, show_line, three_digits
from calstation.cli.text import say, term
from calstation.connection import OtherUnit, read_unit
from calstation.errors import ConfigurationError
from calstation.physics import DEGREE_PER_HOUR, MICRO_G, NAMES, FloatArray
from calstation.records import export_corrected, open_log, prior_from_meta
from calstation.results import find_log, load_run_result
from calstation.results.plots import Applied, before_and_after, read_recording

#: JSON name of each quantity in the table of results at rest, and the size of its display unit.
_QUANTITIES = (("force", MICRO_G), ("rate", DEGREE_PER_HOUR))
#: Width of the column of rests, in which the names of stages are wrapped.
_STAGE_WIDTH = 10


app = command_group()


@app.command()
def apply(
    result_file: Annotated[Path, typer.Argument(metavar="RESULT.json")],
    log: Annotated[Path | None, typer.Argument(metavar="LOG")] = None,
    station: StationOption = None,
    product: ProductOption = None,
    out: Annotated[Path | None, typer.Option("-o", "--out", metavar="FILE.csv", parser=document_file)] = None,
    json: JsonOption = None,
) -> int:
    """Apply a result to a recording or to the output of the connected unit, and compare every rest before and after.

    Raises ConfigurationError if both a recording and a station are given or if another unit is connected, and the
    errors of reading the data.
    """
    if log is not None and station is not None:
        raise ConfigurationError("cli.apply_to_one")
    result = load_run_result(result_file)
    solved_log = find_log(result, result_file)
    values_before = registers = result.registers.old if result.registers is not None else {}
    if solved_log is not None:
        meta = open_log(solved_log).meta
        values_before, registers = dict(zip(NAMES, prior_from_meta(meta).mean.tolist(), strict=True)), meta.registers
    before, values_after = before_and_after(values_before, result.parameters)
    if np.array_equal(before, values_after):
        raise ConfigurationError("cli.apply_nothing", file=result_file)
    if log is not None:
        output = read_recording(log, registers)
    else:
        unit = read_unit(ignore_progress, result.serial, solved_log, station, product)
        if isinstance(unit, OtherUnit):
            raise ConfigurationError("applied.other_unit", connected=unit.serial, serial=result.serial)
        output = unit
    every, over = output, result.temperature
    if over is not None:
        output = every.covered(over)
    applied = output.applied(before, values_after, over)
    cautions = _warnings(applied, result.serial)
    if over is not None and (count := len(every) - len(output)):
        low, high = over.range_c
        cautions.append(say("applied.beyond", count=count, samples=len(every), low=low, high=high))
    for caution in cautions:
        show_line(plain_console(stderr=True), caution)
    if out is not None:
        correct = output.correction(values_after, over)
        export_corrected(output.path, output.meta, output.blocks, correct, out)
        show_line(plain_console(stderr=True), str(out))
    errors = np.stack([applied.rest_length, applied.rest_rate - applied.earth])
    emit_json(_json(applied, errors), json)
    if json != "-":
        _show(plain_console(file=sys.stdout), applied, errors)
    return 0


def _warnings(applied: Applied, serial: str) -> list[str]:
    """Return warnings about the unit that produced the samples."""
    if applied.serial != serial:
        return [say("applied.other_recording", recorded=applied.serial, serial=serial)]
    corrected = [say("applied.corrected")] if applied.corrected else []
    return corrected + ([] if applied.named else [say("applied.unnamed", serial=serial)])


def _summary(errors: FloatArray) -> dict[str, FloatArray]:
    """Return the rms and the largest magnitude over the rests, both of shape (2, 2): quantity, before and after."""
    return {"rms": np.sqrt(np.mean(errors**2, axis=1)), "max": np.abs(errors).max(axis=1)}


def _json(applied: Applied, errors: FloatArray) -> dict[str, object]:
    """Return `errors`, shape (2, rests, 2), as JSON in SI units."""

    def row(values: FloatArray) -> dict[str, float]:
        names = [f"{quantity[0]}_{when}" for quantity in _QUANTITIES for when in ("before", "after")]
        return dict(zip(names, values.ravel().tolist(), strict=True))

    return {
        "serial": applied.serial,
        "corrected": applied.corrected,
        "rests": [
            {**applied.where[k].to_json(), "start_s": start, "end_s": end, **row(errors[:, k])}
            for k, (start, end) in enumerate(applied.rests.tolist())
        ],
        **{name: row(values) for name, values in _summary(errors).items()},
    }


def _show(out: Console, applied: Applied, errors: FloatArray) -> None:
    table = new_table(
        say("cli.unit_at_rest", serial=applied.serial),
        *("cli.column_rest_number", "cli.column_from", "cli.column_to"),
        *(f"cli.column_{quantity}_{when}" for quantity, _ in _QUANTITIES for when in ("before", "after")),
        padding=(0, 1, 0, 0),
    )
    table.columns[0].no_wrap, table.columns[0].min_width = False, _STAGE_WIDTH

    def cells(values: FloatArray) -> list[str]:
        sizes = np.array([[size] for _, size in _QUANTITIES])
        return [three_digits(value) for value in (values / sizes).ravel()]

    stage = ""
    for k, (start, end) in enumerate(applied.rests.tolist()):
        where = applied.where[k]
        if where.stage != stage:
            stage = where.stage
            table.add_section()
            table.add_row(term("stage", stage))
        table.add_row(where.number, f"{start:.1f}", f"{end:.1f}", *cells(errors[:, k]))
    table.add_section()
    for name, values in _summary(errors).items():
        table.add_row(say(f"cli.{name}_at_rest"), "", "", *cells(values))
    out.print(table)
