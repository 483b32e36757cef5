"""`design`: the shortest schedule that meets a product's limits, or shorter stages."""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from calstation.cli.show import check_json, on_interrupt, report
from calstation.cli.text import say
from calstation.config import DEFAULT_PRODUCT, library, read_text
from calstation.design import (
    Design,
    DesignRequest,
    ShorterStages,
    design_schedule,
    designed_product,
    shorten_stages,
    shorter_product,
)
from calstation.errors import ConfigurationError
from calstation.jobs import ProgressCallback
from calstation.physics import display_by_unit

#: Code of the text for a step of the search; any other step is the best result so far.
_STEPS = {"checking": "cli.design_checking", "present": "cli.design_present", "": ""}


def design_command(request: DesignRequest, product: Path | None, out: Path, json: str | None) -> int:
    """Design a schedule, write the product with it, and show both; Ctrl-C ends the search with the best so far.

    Returns 1 if the schedule exceeds a limit, which is possible for a given duration.
    """
    _check_out(out)
    check_json(json)
    with tempfile.TemporaryDirectory(prefix="calstation-design-") as folder, _show_progress() as progress:
        stop = Path(folder) / "stop"
        with on_interrupt(stop.touch):
            found = design_schedule(progress, replace(request, stop=stop))
    out.write_text(designed_product(read_text(_file(product)), found), encoding="utf-8")
    report(found.to_json(), json, _lines(found, out))
    return 0 if found.worst <= 1.0 else 1


def shorten_command(request: DesignRequest, product: Path | None, out: Path, json: str | None) -> int:
    """Shorten the stages of a product, write the product with them, and show both."""
    _check_out(out)
    check_json(json)
    with _show_progress() as progress:
        found = shorten_stages(progress, request)
    out.write_text(shorter_product(read_text(_file(product)), found), encoding="utf-8")
    report(found.to_json(), json, _shorter_lines(found, out))
    return 0


def _file(product: Path | None) -> Path:
    return product or library.find("products", DEFAULT_PRODUCT)


def _check_out(out: Path) -> None:
    if out.is_dir() or not out.parent.is_dir():
        raise ConfigurationError("cli.out_unwritable", path=out)


@contextmanager
def _show_progress() -> Iterator[ProgressCallback]:
    """Show the progress of the search on standard error."""
    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn(), TextColumn("{task.fields[note]}"))
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(say("cli.designing"), total=1.0, note="")

        def progress(fraction: float, remaining_s: float | None = None, note: str = "") -> None:
            code = _STEPS.get(note, "cli.design_best")
            bar.update(task, completed=fraction, note=say(code, best=note) if code else "")

        yield progress


def _lines(found: Design, out: Path) -> Iterator[str]:
    """Yield the lines that summarise a design."""
    yield say("design.found", seconds=found.duration, moves=found.planned, worst=found.worst, parameter=found.limiting)
    if not found.searched:
        yield say("design.not_searched")
    if found.present is not None:
        yield say("design.present", seconds=found.present)
    if found.longest > found.duration:
        yield say("design.reserve", seconds=found.longest, moves=len(found.moves))
    for variation in found.variations:
        code = "design.varied" if variation.duration is not None else "design.varied_unreached"
        yield say(code, condition=variation.name, seconds=variation.duration or 0.0, worst=variation.worst)
    yield say("design.hidden")
    for limit in found.hidden:
        size, unit = display_by_unit(limit.unit, limit.size)
        name = " ".join(filter(None, (limit.cause, limit.component, limit.parameter)))
        moved = say("cli.design_moves", sigmas=limit.move, parameter=limit.moved)
        yield f"  {name:<40} {size:>10.3g} {unit:<16} {moved}"
    yield say("design.written", path=out)


def _shorter_lines(found: ShorterStages, out: Path) -> Iterator[str]:
    yield say(
        "design.shorter", seconds=found.duration, present=found.present, worst=found.worst, parameter=found.limiting
    )
    for stage, values in found.schedule.items():
        yield f"  {stage}: " + ", ".join(f"{name} = {value:g}" for name, value in values.items())
    yield say("design.written", path=out)
