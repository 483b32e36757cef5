"""`run`: calibrates the unit on the station without a window."""

from pathlib import Path
from typing import Annotated

import typer

from calstation.cli import run as run_display
from calstation.cli.confirmation import confirm_override
from calstation.cli.options import (
    ConfirmedByOption,
    JsonOption,
    ProductOption,
    StagesOption,
    StationOption,
    YesOption,
    command_group,
    parsed_stages,
)
from calstation.config import RunRequest

app = command_group()


@app.command()
def run(
    context: typer.Context,
    stages: StagesOption = None,
    station: StationOption = None,
    product: ProductOption = None,
    serial: list[str] | None = None,
    speed: float | None = None,
    seed: int | None = None,
    out: Path = Path("runs"),
    json: JsonOption = None,
    yes: YesOption = False,
    resume: Annotated[Path | None, typer.Option(metavar="LOG")] = None,
    beyond_attempts: Annotated[bool, typer.Option("--beyond-attempts")] = False,
    override_standard: Annotated[str | None, typer.Option(metavar="REASON")] = None,
    faults: Annotated[Path | None, typer.Option(metavar="FILE.toml")] = None,
    operator: str | None = None,
    confirmed_by: ConfirmedByOption = None,
) -> int:
    """Run a calibration, of several units at a station with slots, and return the exit code."""
    request = RunRequest(
        "",
        station,
        product,
        parsed_stages(stages),
        out,
        operator,
        serials=tuple(serial or ()),
        speed=speed,
        seed=seed,
        resume=resume,
        beyond_attempts=beyond_attempts,
        override_standard=override_standard,
        faults=faults,
    )
    request = run_display.complete_request(request)
    if override_standard is not None:
        request = confirm_override(request, confirmed_by)
    return run_display.run_command(request, json, yes=yes, debug=bool(context.obj))
