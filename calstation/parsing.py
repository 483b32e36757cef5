"""Reading of TOML and JSON of unknown origin, with limits on size, nesting, parts of a key and digits."""

import errno
import json
import os
import re
import stat
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

#: Size limits, bytes: a parsed text takes up to 30 times its size.
MAX_TOML, MAX_JSON = 1 << 20, 1 << 24
#: Largest depth of nested lists and tables.
MAX_DEPTH = 64
_NESTED = f"More than {MAX_DEPTH} nested lists or tables"
#: Largest number of digits of a whole number; 64 bits have 20.
_MAX_DIGITS = 20
#: Largest number of parts of a TOML key, because tomllib's memory grows with the square of this number.
_MAX_PARTS = 32
_LONG_KEY = re.compile(rf"""(?<![\w-])(?:(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+){{{_MAX_PARTS},}}""")


def read_limited(path: Path, limit: int) -> bytes:
    """Read a file, but at most `limit` + 1 bytes.

    Raises OSError if the file cannot be read or is not a regular file: opening a pipe may wait forever.
    """
    if not stat.S_ISREG(path.stat().st_mode):
        code = errno.EISDIR if path.is_dir() else errno.ESPIPE
        raise OSError(code, os.strerror(code), str(path))
    with path.open("rb") as stream:
        return stream.read(limit + 1)


def parse_toml(text: str) -> dict[str, Any]:
    """Parse TOML. Raises tomllib.TOMLDecodeError, also for a text that exceeds a limit."""
    if len(text) > MAX_TOML:
        raise _toml_error(f"More than {MAX_TOML} characters")
    if key := _LONG_KEY.search(text):
        raise _toml_error(f"A key has more than {_MAX_PARTS} parts", text.count("\n", 0, key.start()) + 1)
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        raise
    except (ValueError, RecursionError) as exc:
        what = (
            f"More than {MAX_DEPTH} nested lists" if isinstance(exc, RecursionError) else "A number has too many digits"
        )
        raise _toml_error(what) from None
    for depth, value in _values(data):
        if depth > MAX_DEPTH:
            raise _toml_error(_NESTED)
        if isinstance(value, int) and abs(value) >= 1 << 64:
            raise _toml_error("A whole number has more than 64 bits")
    return data


def parse_json(text: str | bytes) -> Any:
    """Parse JSON. Raises ValueError, also for a text that exceeds a limit."""
    if len(text) > MAX_JSON:
        raise json.JSONDecodeError(f"More than {MAX_JSON} characters", "", 0)
    decoded = text if isinstance(text, str) else text.decode()
    try:
        data = json.loads(decoded, parse_int=_whole_number)
    except RecursionError:
        raise json.JSONDecodeError(_NESTED, "", 0) from None
    if decoded.count("[") + decoded.count("{") > MAX_DEPTH and any(depth > MAX_DEPTH for depth, _ in _values(data)):
        raise json.JSONDecodeError(_NESTED, "", 0)
    return data


def read_json(path: Path) -> Any:
    """Read a JSON file. Raises OSError, and ValueError like `parse_json`."""
    return parse_json(read_limited(path, MAX_JSON))


def _toml_error(what: str, line: int = 1) -> tomllib.TOMLDecodeError:
    return tomllib.TOMLDecodeError(f"{what} (at line {line}, column 1)")


def _whole_number(digits: str) -> int:
    if len(digits) > _MAX_DIGITS:
        raise json.JSONDecodeError("A number has too many digits", "", 0)
    return int(digits)


def _values(data: Any) -> Iterator[tuple[int, Any]]:
    """Yield all values in nested lists and tables with their depths."""
    rest = [(0, data)]
    while rest:
        depth, value = rest.pop()
        yield depth, value
        if depth <= MAX_DEPTH and isinstance(value, dict | list):
            inner = value.values() if isinstance(value, dict) else value
            rest += [(depth + 1, each) for each in inner]
