"""Groups of commands, and the options that several commands share."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer

from calstation.errors import ConfigurationError


def command_group() -> typer.Typer:
    """Return a Typer application for the commands of a module; several commands form a group."""
    return typer.Typer(no_args_is_help=True, add_completion=False, rich_markup_mode=None)


def by_name(kind: str) -> Callable[[Path | None], Path | None]:
    """Return a callback that finds the file of an option by path or name, and raises ConfigurationError without one."""

    def find(path: Path | None) -> Path | None:
        from calstation.config import locate

        return None if path is None else locate(kind, path)

    return find


def existing_folder(folder: Path) -> Path:
    """Return the folder of an option. Raises ConfigurationError if it is missing."""
    if not folder.is_dir():
        raise ConfigurationError("cli.no_folder", folder=folder)
    return folder


def names_folder(path: str) -> bool:
    """Return whether a path ends with a slash and thus denotes a folder, which may not exist yet."""
    return path.endswith(("/", os.sep))


def output_file(path: str) -> Path:
    """Return the file of an output option. Raises ConfigurationError for a path that denotes a folder."""
    if names_folder(path):
        raise ConfigurationError("cli.out_is_folder", path=path)
    return Path(path)


def document_file(path: str) -> Path:
    """Return the file of an output option. Raises ConfigurationError for a folder or a new file without a suffix."""
    file = output_file(path)
    if not file.suffix and not file.exists():
        raise ConfigurationError("cli.out_without_suffix", path=path)
    return file


def _writable(target: str | None) -> str | None:
    """Return the value of ``--json``. Raises ConfigurationError if the file cannot be written."""
    if target is None or target == "-":
        return target
    path = Path(target)
    if names_folder(target) or path.is_dir() or not os.access(path if path.exists() else path.parent, os.W_OK):
        raise ConfigurationError("cli.json_unwritable", path=path)
    return target


StagesOption = Annotated[str | None, typer.Option("--stages", metavar="A,B,...")]
JsonOption = Annotated[str | None, typer.Option("--json", callback=_writable)]
StationOption = Annotated[Path | None, typer.Option(callback=by_name("stations"))]
ProductOption = Annotated[Path | None, typer.Option(callback=by_name("products"))]
ParametersOnlyOption = Annotated[bool, typer.Option("--parameters-only")]
RunsOption = Annotated[Path, typer.Option("--out", callback=existing_folder)]
ByOption = Annotated[str | None, typer.Option(metavar="BADGE")]
ConfirmedByOption = Annotated[str | None, typer.Option(metavar="BADGE")]
YesOption = Annotated[bool, typer.Option("--yes")]
LogOutOption = Annotated[Path, typer.Option("-o", "--out", metavar="LOG", parser=output_file)]


def check_choice(option: str, value: str | None, choices: tuple[str, ...]) -> None:
    """Raise ConfigurationError if an option has a value that is not among the choices; None is permitted."""
    if value is not None and value not in choices:
        raise ConfigurationError("cli.unknown_choice", option=option, value=value, choices=choices)


def refuse_options_before(context: typer.Context) -> None:
    """Raise ConfigurationError if options were given before a command of a group, which has its own options."""
    for each in context.command.params:
        source = context.get_parameter_source(each.name or "")
        if source is not None and source.name == "COMMANDLINE":
            name = context.invoked_subcommand
            raise ConfigurationError("cli.option_before", option=each.opts[0], name=name, program=context.command_path)


def parsed_stages(text: str | None) -> tuple[str, ...] | None:
    """Return the stages in an option's comma-separated list; None without the option. Raises ConfigurationError."""
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
