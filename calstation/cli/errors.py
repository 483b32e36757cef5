"""Errors of the command line: incorrect usage, and remedies that contain complete commands."""

import shlex
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import typer
from pydantic import ValidationError

from calstation.errors import CalstationError, ConfigurationError
from calstation.escaping import for_terminal

_USAGE_CODES = {
    "int_parsing": "cli.not_whole",
    "float_parsing": "cli.not_a_number",
    "greater_than_equal": "cli.too_small",
    "value_error": "cli.not_a_date",
}


def print_error(text: str) -> None:
    """Write an error as one line to standard error."""
    sys.stderr.write(f"calstation: {for_terminal(text)}\n")


def usage_error(error: typer.TyperException, arguments: list[str]) -> CalstationError:
    """Convert an error of the parser; `arguments` identify the command if the error does not."""
    context, parameter, cause = getattr(error, "ctx", None), getattr(error, "param", None), error.__cause__
    program, command = "calstation", ""
    if context is not None:
        program = context.command_path
        command = program.removeprefix("calstation").strip()
    elif arguments and not arguments[0].startswith("-"):
        program = f"calstation {arguments[0]}"
    if parameter is not None and not isinstance(cause, ValidationError):
        return ConfigurationError("cli.needs", command=command, name=_parameter_name(parameter), program=program)
    detail = cause.errors()[0] if isinstance(cause, ValidationError) else None
    if parameter is None or detail is None or detail["type"] not in _USAGE_CODES:
        return ConfigurationError("cli.usage", message=error.format_message(), program=program)
    values = {"option": parameter.opts[0], "value": detail["input"], "least": detail.get("ctx", {}).get("ge", 0)}
    return ConfigurationError(_USAGE_CODES[detail["type"]], program=program, **values)


def _parameter_name(parameter: Any) -> str:
    """Return the name of an argument, or of an option with the placeholder of its value, as in the help."""
    if parameter.param_type_name == "option":
        return f"{parameter.opts[0]} {parameter.metavar or 'FILE'}"
    return str(parameter.metavar or parameter.name.upper())


def station_options(station: Path | None, product: Path | None) -> str:
    """Return the command-line options for a station and a product; None has no option."""
    options = (("--station", station), ("--product", product))
    return shlex.join(word for option, path in options if path is not None for word in (option, str(path)))


def command_options(
    station: Path | None, product: Path | None, out: Path | None = None, slot: str | None = None
) -> dict[str, str]:
    """Return the values that complete the commands in a remedy: station file, product file, runs folder and slot."""
    where = station_options(station, product)
    return {
        "station_options": f" {where}" if where else "",
        "out_option": "" if out in (None, Path("runs")) else f" --out {shlex.quote(str(out))}",
        "slot_option": f" --slot {slot}" if slot else "",
    }


@contextmanager
def complete_commands(options: dict[str, str]) -> Iterator[None]:
    """Complete the commands in the remedies of errors that are raised in the context."""
    try:
        yield
    except CalstationError as error:
        error.values = {**error.values, **options}
        raise
