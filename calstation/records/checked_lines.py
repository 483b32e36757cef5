"""Append-only file of JSON lines, each with a checksum of its bytes and of all lines before it.

A power failure can only leave an incomplete last line, which is skipped and replaced by the next; any other difference
is damage. Files started by an early version have lines without a checksum, which cannot follow a line with one.
"""

import json
import os
import re
import zlib
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from calstation.messages import Text
from calstation.records.files import sync_folder

_CHECKED = re.compile(rb'(\{.*), "chain": "([0-9a-f]{8})"\}', re.DOTALL)


class DamagedLineError(Exception):
    """Line `number`, counted from 1, is damaged; `why` describes the damage."""

    def __init__(self, number: int, why: Text) -> None:
        super().__init__(number, why)
        self.number = number
        self.why = why


@dataclass(frozen=True)
class Line:
    """A line of the file; `checked` is True if it has a checksum."""

    number: int
    content: Mapping[str, Any]
    checked: bool


@dataclass(frozen=True)
class Lines:
    """All lines of a file; `torn` is True if a power failure left an incomplete line at the end."""

    lines: tuple[Line, ...] = ()
    torn: bool = False


def read_lines(path: Path) -> Lines:
    """Read all lines of a file; none if it is missing. Raises OSError or DamagedLineError."""
    try:
        content = path.read_bytes()
    except (FileNotFoundError, NotADirectoryError):
        return Lines()
    *pieces, rest = content.split(b"\n")
    lines: list[Line] = []
    before = 0
    for piece in pieces:
        before = _add(lines, piece, before)
    if rest and _parsed(rest, before) is not None:
        _add(lines, rest, before)
        return Lines(tuple(lines))
    if not pieces:
        raise DamagedLineError(1, Text("log.line_incomplete" if content else "log.line_missing"))
    if _CHECKED.search(rest):
        raise DamagedLineError(len(lines) + 1, Text("log.line_altered"))
    return Lines(tuple(lines), torn=bool(rest))


def _add(lines: list[Line], piece: bytes, before: int) -> int:
    """Add a line and return the initial value of the next line's checksum."""
    line = _parsed(piece, before)
    if line is None:
        raise DamagedLineError(len(lines) + 1, Text("log.line_out_of_order"))
    content, checked = line
    if lines and lines[-1].checked and not checked:
        raise DamagedLineError(len(lines) + 1, Text("log.line_unchecked"))
    lines.append(Line(len(lines) + 1, content, checked))
    return _next_checksum(piece)


def append_line(path: Path, content: Mapping[str, Any]) -> None:
    """Append a line, or replace an incomplete one, and write it to disk. Raises OSError."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.exists():
        _extend(path, content)
    else:
        _begin(path, _line(content, 0))


def _line(content: Mapping[str, Any], before: int) -> bytes:
    text = json.dumps(content, ensure_ascii=False).encode()[:-1]
    return text + b', "chain": "%08x"}\n' % zlib.crc32(text, before)


def _next_checksum(piece: bytes) -> int:
    """Return the initial value of the next line's checksum."""
    found = _CHECKED.fullmatch(piece)
    return int(found[2], 16) if found else zlib.crc32(piece)


def _begin(path: Path, line: bytes) -> None:
    """Create the file with its first line under a temporary name; rename it to `path` when the line is on disk."""
    partial = path.with_suffix(".partial")
    with suppress(FileNotFoundError):
        partial.unlink()
    handle = os.open(partial, os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0), 0o644)
    try:
        _write(handle, line)
        os.fsync(handle)
    finally:
        os.close(handle)
    partial.replace(path)
    sync_folder(path.parent)
    sync_folder(path.parent.parent)


def _extend(path: Path, content: Mapping[str, Any]) -> None:
    handle = os.open(path, os.O_RDWR | os.O_APPEND | getattr(os, "O_BINARY", 0))
    try:
        *pieces, rest = path.read_bytes().split(b"\n")
        last = pieces[-1] if pieces else b""
        begin = b""
        if rest and (not pieces or _CHECKED.search(rest) or _parsed(rest, _next_checksum(last)) is not None):
            begin, last = (b"\n", rest)  # only the newline is missing, or the damage must remain visible
        elif rest:
            os.ftruncate(handle, os.fstat(handle).st_size - len(rest))
        _write(handle, begin + _line(content, _next_checksum(last)))
        os.fsync(handle)
    finally:
        os.close(handle)


def _write(handle: int, data: bytes) -> None:
    while data:
        data = data[os.write(handle, data) :]


def _parsed(piece: bytes, before: int) -> tuple[dict[str, Any], bool] | None:
    """Return the content of a line and whether it has a checksum; None if it is damaged or out of order."""
    found = _CHECKED.fullmatch(piece)
    if found and zlib.crc32(found[1], before) != int(found[2], 16):
        return None
    try:
        content = json.loads(found[1] + b"}" if found else piece)
    except (ValueError, RecursionError):
        return None
    return (content, found is not None) if isinstance(content, dict) else None
