"""Commands that a sentence names, so that they can be typed as they stand: for the station and the unit in hand."""

import re
import shlex
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from calstation.config.request import RunRequest
from calstation.errors import DeviceFaultError

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
