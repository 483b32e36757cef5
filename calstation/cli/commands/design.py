"""`design`: searches for the shortest schedule that meets the limits of a product, or shortens its stages."""

import errno
import os
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from calstation.cli.options import JsonOption, ProductOption, StationOption, command_group
from calstation.cli.show import emit, job_progress
from calstation.cli.text import say
from calstation.config import DEFAULT_PRODUCT, library, read_text
from calstation.designer import (
    Design,
    DesignRequest,
    ShorterStages,
    design_schedule,
    designed_product,
    shorten_stages,
    shorter_product,
)
from calstation.errors import ConfigurationError
from calstation.jobs import on_stop_signals
from calstation.messages import os_reason
from calstation.physics import display_by_unit
from calstation.records import write_atomic

#: Code of the text for each step of the search; the note of any other step is the best result so far.
_STEPS = {"checking": "cli.design_checking", "present": "cli.design_present", "": ""}


app = command_group()


@app.command()
def design(
    out: Annotated[Path, typer.Option("-o", "--out", metavar="FILE.toml")],
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
    json: JsonOption = None,
) -> int:
    """Design a schedule or shorten the present stages, and write the product with the new schedule.

    Ctrl-C ends the search with the best schedule found so far. Returns 1 if a sigma exceeds its limit, which can
    happen if the duration is given. Raises ConfigurationError.
    """
    request = DesignRequest(station, product, margin, duration, as_present, time_limit, seed, rate, acceleration)
    if duration is not None and as_present:
        raise ConfigurationError("design.one_goal")
    for option, value in (("--duration", duration), ("--time-limit", time_limit)) if keep_stages else ():
        if value is not None:
            raise ConfigurationError("design.with_stages", option=option)
    _check_writable(out)
    present = read_text(product or library.find("products", DEFAULT_PRODUCT))
    with (
        tempfile.TemporaryDirectory(prefix="calstation-design-") as folder,
        job_progress(say("cli.designing"), _step) as progress,
    ):
        if keep_stages:
            stages = shorten_stages(progress, request)
        else:
            stop = Path(folder) / "stop"
            with on_stop_signals(stop.touch):
                designed = design_schedule(progress, replace(request, stop=stop))
    if keep_stages:
        write_atomic(out, shorter_product(present, stages))
        emit(stages.to_json(), json, _shorter_lines(stages, out))
        return 0
    write_atomic(out, designed_product(present, designed))
    emit(designed.to_json(), json, _lines(designed, out))
    return 0 if designed.worst <= 1.0 else 1


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
    for stage, values in shorter.schedule.items():
        yield f"  {stage}: " + ", ".join(f"{name} = {value:g}" for name, value in values.items())
    yield say("design.written", path=out)
