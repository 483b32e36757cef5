"""`run`: calibrates the units at a station without opening the window."""

from pathlib import Path
from typing import Annotated

import typer

from calstation.cli import run as run_display
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
    resume: Annotated[list[Path] | None, typer.Option(metavar="LOG")] = None,
    restart: Annotated[bool, typer.Option("--restart")] = False,
    again: Annotated[bool, typer.Option("--again")] = False,
    beyond_attempts: Annotated[bool, typer.Option("--beyond-attempts")] = False,
    override_standard: Annotated[str | None, typer.Option(metavar="REASON")] = None,
    faults: Annotated[Path | None, typer.Option(metavar="FILE.toml")] = None,
    operator: str | None = None,
    confirmed_by: ConfirmedByOption = None,
) -> int:
    """Calibrate a unit, or several units at a station with slots, and return the exit code."""
    logs = tuple(resume or ())
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
        resume=next(iter(logs), None),
        resumes=logs if len(logs) > 1 else (),
        faults=faults,
    )
    answers = {
        "resume": "anew" if restart else None,
        "attempts": "beyond" if beyond_attempts else None,
        "passed": "repeat" if again else None,
        "standard": override_standard,
        "table_moves": "clear" if yes else None,
    }
    return run_display.run_command(request, json, answers, confirmed_by=confirmed_by, debug=bool(context.obj))
