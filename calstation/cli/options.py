"""Options that several commands share."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer

from calstation.errors import ConfigurationError

StagesOption = Annotated[
    str | None, typer.Option("--stages", help="Stages in order, e.g. rate,six_position.", metavar="A,B,...")
]
JsonOption = Annotated[
    str | None, typer.Option("--json", help="Write the result JSON to this file; - for standard output.")
]


def by_name(kind: str) -> Callable[[Path | None], Path | None]:
    """Return a callback that finds the file of an option by path or name and raises ConfigurationError."""

    def look_up(path: Path | None) -> Path | None:
        from calstation.config import locate

        return None if path is None else locate(kind, path)

    return look_up


def existing_folder(folder: Path) -> Path:
    """Return the folder of an option. Raises ConfigurationError if it is missing."""
    if not folder.is_dir():
        raise ConfigurationError("cli.no_folder", folder=folder)
    return folder


StationOption = Annotated[
    Path | None,
    typer.Option(help="Station file or its name; default: the virtual bench.", callback=by_name("stations")),
]
ParametersOnlyOption = Annotated[
    bool, typer.Option("--parameters-only", help="Leave out the tests of data and model; nothing is judged.")
]
ProductOption = Annotated[
    Path | None, typer.Option(help="Product file or its name; default: nav_a.", callback=by_name("products"))
]


def parsed_stages(text: str | None) -> tuple[str, ...] | None:
    """Return the stages of an option's comma-separated list, None without the option. Raises ConfigurationError."""
    if text is None:
        return None
    stages = tuple(part.strip() for part in text.split(",") if part.strip())
    if not stages:
        raise ConfigurationError("cli.no_stage")
    if len(set(stages)) != len(stages):
        raise ConfigurationError("cli.stage_twice")
    from procedures import method

    for stage in stages:
        method(stage)
    return stages


ByOption = Annotated[
    str | None, typer.Option(help="Badge of the engineer who does this; default: the computer's user.", metavar="BADGE")
]
ConfirmedByOption = Annotated[
    str | None, typer.Option(help="Badge of the engineer who confirms it, where two are required.", metavar="BADGE")
]
