"""What is wrong with a command line, in a sentence of our own; the parser's speaks of inputs and parsing."""

import re
import shlex
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import typer

from calstation.config.request import RunRequest
from calstation.errors import DeviceFaultError

#: The parser's words for a value, and ours.
_KINDS = (
    (r"valid integer", "must be a whole number"),
    (r"valid number", "must be a number"),
    (r"greater than or equal to (\S+)", "must be at least {0}"),
    (r"greater than (\S+)", "must be greater than {0}"),
    (r"less than or equal to (\S+)", "must be at most {0}"),
)


def usage_sentence(error: typer.TyperException, arguments: Sequence[str]) -> str:
    """What is wrong, the mend, and which help says more.

    `arguments` : of the command line, for the value as it was typed
    """
    context = getattr(error, "ctx", None)
    if context is None:
        path = next((argument for argument in arguments[:1] if not argument.startswith("-")), "")
    else:
        path = context.command_path.partition(" ")[2]
    command = " ".join(part for part in ("calstation", path) if part)
    return f"{_said(error, arguments, path)} ({command} --help shows what it takes)"


def _said(error: typer.TyperException, arguments: Sequence[str], path: str) -> str:
    message = error.format_message()
    parameter = getattr(error, "param", None)
    if parameter is None:
        return message
    name = _name(parameter)
    if message.startswith("Missing"):
        value = f" {parameter.metavar or 'FILE'}" if parameter.param_type_name == "option" else ""
        return f"{path} needs {name}{value}"
    for pattern, words in _KINDS:
        found = re.search(pattern, message)
        if found is not None:
            typed = " ".join(part for part in (name, _typed(parameter, arguments)) if part)
            return f"{typed}: {words.format(*found.groups())}"
    return message


def _name(parameter: Any) -> str:
    """An option with the short form that is usual, or an argument as the help calls it."""
    if parameter.param_type_name == "option":
        return str(parameter.opts[0])
    return str(parameter.metavar or parameter.name.upper())


def _typed(parameter: Any, arguments: Sequence[str]) -> str:
    """The option's value on the command line, "" where it is not found there."""
    for argument, value in zip(arguments, [*arguments[1:], ""], strict=True):
        option, equals, joined = argument.partition("=")
        if option in parameter.opts:
            return joined if equals else value
    return ""


_RESET = re.compile(r"calstation table reset")
_REGISTERS = re.compile(r"calstation registers (?:finish|restore)(?: \(or restore\))? [^\s,;]+")


def options(station: Path | None, product: Path | None) -> str:
    """The options that name a station and a product, those that are not the default."""
    words = [
        word
        for option, path in (("--station", station), ("--product", product))
        if path is not None
        for word in (option, str(path))
    ]
    return shlex.join(words)


def as_typed(text: str, request: RunRequest) -> str:
    """A fault's text whose commands are for the request's own station, product and folder of runs."""
    where = options(request.station, request.product)
    runs = "" if request.out == RunRequest.out else f"--out {shlex.quote(str(request.out))}"
    text = _RESET.sub(lambda found: f"{found[0]} {where}".rstrip(), text)
    return _REGISTERS.sub(lambda found: " ".join(filter(None, (found[0], where, runs))), text)


@contextmanager
def said_as_typed(request: RunRequest) -> Iterator[None]:
    """Device faults that are raised in here are told as `as_typed` has them."""
    try:
        yield
    except DeviceFaultError as error:
        raise DeviceFaultError(as_typed(str(error), request)) from error
