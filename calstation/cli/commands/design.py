"""`design`: searches for the shortest schedule that meets the limits of a product, or shortens its stages."""

import errno
import os
import sys
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from calstation.cli.options import JsonOption, ProductOption, StationOption, command_group, document_file
from calstation.cli.show import emit, job_progress, new_table, plain_console, show_line
from calstation.cli.text import say
from calstation.config import load_product, read_text
from calstation.designer import (
    Design,
    DesignRequest,
    ShorterStages,
    TemperatureDesign,
    design_schedule,
    design_temperature,
    designed_product,
    shorten_stages,
    shorter_product,
    temperature_product,
    unit_properties,
)
from calstation.errors import ConfigurationError
from calstation.jobs import on_stop_signals
from calstation.messages import os_reason
from calstation.physics import GROUPS, NAMES, display, display_by_unit, group_indices
from calstation.records import open_log, write_atomic

#: Code of the text for each step of the search; the note of any other step is the best result so far.
_STEPS = {"checking": "cli.design_checking", "present": "cli.design_present", "": ""}
#: Width of the tables over temperature, characters.
_TABLE_WIDTH = 100

app = command_group()


@app.command()
def design(
    out: Annotated[Path, typer.Option("-o", "--out", metavar="FILE.toml", parser=document_file)],
    product: ProductOption = None,
    station: StationOption = None,
    margin: Annotated[float, typer.Option(min=0.05, max=1.0)] = 0.8,
    duration: Annotated[float | None, typer.Option(min=20.0)] = None,
    as_present: Annotated[bool, typer.Option("--as-present")] = False,
    keep_stages: Annotated[bool, typer.Option("--keep-stages")] = False,
    rate: Annotated[float | None, typer.Option(min=1.0)] = None,
    acceleration: Annotated[float | None, typer.Option(min=1.0)] = None,
    time_limit: Annotated[float | None, typer.Option(min=1.0)] = None,
    seed: Annotated[int, typer.Option(min=0)] = 0,
    time_constant: Annotated[float | None, typer.Option(min=1.0, max=20_000.0)] = None,
    self_heating: Annotated[float | None, typer.Option(min=0.0, max=50.0)] = None,
    measured: Annotated[Path | None, typer.Option(metavar="LOG")] = None,
    json: JsonOption = None,
) -> int:
    """Design a schedule or shorten the present stages, and write the product with the new schedule.

    For a product with `[temperature]`, the schedule covers the temperature range.

    Ctrl-C ends the search with the best schedule found so far. Returns 1 if a sigma exceeds its limit, which can
    happen if the duration is given, or if the moves do not determine a parameter. Raises ConfigurationError.
    """
    request = DesignRequest(station, product, margin, duration, as_present, time_limit, seed, rate, acceleration)
    if duration is not None and as_present:
        raise ConfigurationError("design.one_goal")
    if keep_stages:
        _refuse({"--duration": duration, "--time-limit": time_limit}, "design.with_stages")
    _check_writable(out)
    path, content = load_product(product)
    present = read_text(path)
    options = {"--time-constant": time_constant, "--self-heating": self_heating, "--measured": measured}
    if content.temperature is not None:
        given = {"--duration": duration, "--as-present": as_present or None, "--keep-stages": keep_stages or None}
        _refuse(given, "design.with_temperature")
        unit = unit_properties(None if measured is None else open_log(measured), time_constant, self_heating)
        with job_progress(say("cli.designing"), _step) as progress:
            design = design_temperature(progress, request, *unit)
        write_atomic(out, temperature_product(present, design))
        emit(design.to_json(), json, ())
        if json != "-":
            _show_over_temperature(design, out)
        return 0
    _refuse(options, "design.without_temperature")
    if keep_stages:
        with job_progress(say("cli.designing"), _step) as progress:
            stages = shorten_stages(progress, request)
        write_atomic(out, shorter_product(present, stages))
        emit(stages.to_json(), json, _shorter_lines(stages, out))
        return 1 if stages.undetermined else 0
    with tempfile.TemporaryDirectory(prefix="calstation-design-") as folder:
        stop = Path(folder) / "stop"
        with job_progress(say("cli.designing"), _step) as progress, on_stop_signals(stop.touch):
            designed = design_schedule(progress, replace(request, stop=stop))
    write_atomic(out, designed_product(present, designed))
    emit(designed.to_json(), json, _lines(designed, out))
    return 0 if designed.worst <= 1.0 and not designed.undetermined else 1


def _refuse(options: Mapping[str, object], code: str) -> None:
    """Raise ConfigurationError if one of the options is given."""
    for option, value in options.items():
        if value is not None:
            raise ConfigurationError(code, option=option)


def _check_writable(out: Path) -> None:
    """Raise ConfigurationError, before a long search, if the file cannot be written."""
    try:
        if out.is_dir():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(out))
        with tempfile.TemporaryFile(dir=out.parent):
            pass
    except OSError as exc:
        raise ConfigurationError("result.unwritable", file=out, reason=os_reason(exc)) from exc


def _step(note: str) -> str:
    """Return the description of a step of the search."""
    code = _STEPS.get(note, "cli.design_best")
    return say(code, best=note) if code else ""


def _lines(design: Design, out: Path) -> Iterator[str]:
    """Yield the lines that summarise a design."""
    yield say(
        "design.found", seconds=design.duration, moves=design.planned, worst=design.worst, parameter=design.limiting
    )
    if design.undetermined:
        yield say("engineer.undetermined", names=design.undetermined)
    if not design.searched:
        yield say("design.not_searched")
    if design.present is not None:
        yield say("design.present", seconds=design.present)
    if design.longest > design.duration:
        yield say("design.reserve", seconds=design.longest, moves=len(design.moves))
    for variation in design.variations:
        code = "design.varied" if variation.duration is not None else "design.varied_unreached"
        yield say(code, condition=variation.name, seconds=variation.duration or 0.0, worst=variation.worst)
    yield say("design.hidden")
    for limit in design.hidden:
        size, unit = display_by_unit(limit.unit, limit.size)
        name = " ".join(filter(None, (limit.cause, limit.component, limit.parameter)))
        moved = say("cli.design_moves", sigmas=limit.move, parameter=limit.moved)
        yield f"  {name:<40} {size:>10.3g} {unit:<16} {moved}"
    yield say("design.written", path=out)


def _shorter_lines(shorter: ShorterStages, out: Path) -> Iterator[str]:
    yield say(
        "design.shorter",
        seconds=shorter.duration,
        present=shorter.present,
        worst=shorter.worst,
        parameter=shorter.limiting,
    )
    if shorter.undetermined:
        yield say("engineer.undetermined", names=shorter.undetermined)
    for stage, values in shorter.schedule.items():
        yield f"  {stage}: " + ", ".join(f"{name} = {value:g}" for name, value in values.items())
    yield say("design.written", path=out)


def _show_over_temperature(design: TemperatureDesign, out: Path) -> None:
    """Show the schedules side by side, and the largest sigma over the range for every limit."""
    console, thermal, chosen = plain_console(file=sys.stdout, width=_TABLE_WIDTH), design.thermal, design.chosen
    values = {"minutes": chosen.course.duration / 60.0, "worst": chosen.worst, "parameter": chosen.limiting}
    if design.is_ramp:
        show_line(console, say("design.ramp_found", rate=chosen.schedule["ramp_c_per_min"], **values))
    else:
        show_line(console, say("design.soaks_found", count=chosen.temperatures, **values))
    seconds, heating = thermal.time_constant, thermal.self_heating
    show_line(console, say("design.thermal", seconds=seconds, heating=heating, rate=60.0 * thermal.rate))
    orders = (f"{group} {order}" for group, order in design.model.order.items())
    show_line(console, say("design.orders", orders=", ".join(orders)))
    table = new_table(
        say("cli.design_schedules"),
        *("", "cli.column_minutes", "cli.column_soak", "cli.column_cycles", "cli.column_worst", "cli.column_parameter"),
    )
    for name, each in design.rows:
        if each is None:
            table.add_row(say(f"cli.design_{name}"), *["–"] * 5)
            continue
        minutes = (f"{seconds / 60.0:.0f}" for seconds in (each.course.duration, each.course.longest_soak))
        table.add_row(say(f"cli.design_{name}"), *minutes, str(each.cycles), f"{each.worst:.2f}", each.limiting)
    console.print(table)
    table = new_table(
        say("cli.design_sigmas"),
        *("cli.column_parameter", "cli.column_unit", "cli.column_sigma_limit"),
        *("cli.column_soaked", "cli.column_at", "cli.column_ramped", "cli.column_at"),
    )
    for group in GROUPS:
        i = max(group_indices(group), key=lambda k: float(chosen.ratios[k]))
        if chosen.ratios[i] > 0.0:
            size, unit = display(NAMES[i], 1.0)
            cells = [f"{size * design.soak.limits[i]:.3g}"]
            for each in (design.soak, design.ramp):
                cells += [f"{size * each.sigma[i]:.3g}", f"{each.at[i]:.0f}"]
            table.add_row(NAMES[i], unit, *cells)
    console.print(table)
    if not design.is_ramp and design.ramp.course.duration < design.soak.course.duration:
        show_line(console, say("design.ramp_not_stated"))
    show_line(console, say("design.written", path=out))
