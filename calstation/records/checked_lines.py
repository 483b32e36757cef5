"""A file of JSON lines, only ever added to, each with a check of its bytes and of all before them: read whole, or
refused with the line, also where one is missing or stands in another's place.

The file appears with its first line on disk, and every line ends with its newline, so a power cut can leave one thing
only: a torn last line. That one announces nothing that happened and is passed over; the next line takes its place.
Whatever else does not read as it was written is damage. Lines without a check are those of files begun before there was
one; none can follow a line that has it.
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

from calstation.records.atomic import sync_folder

_CHECKED = re.compile(rb'(\{.*), "chain": "([0-9a-f]{8})"\}', re.DOTALL)


class DamagedLineError(Exception):
    """A line that does not read as it was written.

    Attributes
    ----------
    number : of the line, from 1
    why : in a few words
    """

    def __init__(self, number: int, why: str) -> None:
        super().__init__(f"line {number}: {why}")
        self.number = number
        self.why = why


@dataclass(frozen=True)
class Line:
    """A line as it was written; `checked` where its check says so."""

    number: int
    content: Mapping[str, Any]
    checked: bool


@dataclass(frozen=True)
class Lines:
    """All lines of a file; `torn` where a power cut left a piece of one behind them."""

    lines: tuple[Line, ...] = ()
    torn: bool = False


def read_lines(path: Path) -> Lines:
    """All lines of a file, none where it is missing. Raises OSError or DamagedLineError."""
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
        raise DamagedLineError(1, "is no line" if content else "the file is empty")
    if _CHECKED.search(rest):
        raise DamagedLineError(len(lines) + 1, "does not read as it was written")
    return Lines(tuple(lines), torn=bool(rest))


def _add(lines: list[Line], piece: bytes, before: int) -> int:
    """Take one more line; its check, with which that of the next begins."""
    line = _parsed(piece, before)
    if line is None:
        raise DamagedLineError(len(lines) + 1, "does not read as it was written, or one before it is missing")
    content, checked = line
    if lines and lines[-1].checked and not checked:
        raise DamagedLineError(len(lines) + 1, "has lost its check value")
    lines.append(Line(len(lines) + 1, content, checked))
    return _check(piece)


def append_line(path: Path, content: Mapping[str, Any]) -> None:
    """Add a line, on disk when this returns, in place of a torn one. Raises OSError."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.exists():
        _extend(path, content)
    else:
        _begin(path, _line(content, 0))


def _line(content: Mapping[str, Any], before: int) -> bytes:
    text = json.dumps(content, ensure_ascii=False).encode()[:-1]
    return text + b', "chain": "%08x"}\n' % zlib.crc32(text, before)


def _check(piece: bytes) -> int:
    """What the check of the next line begins with."""
    found = _CHECKED.fullmatch(piece)
    return int(found[2], 16) if found else zlib.crc32(piece)


def _begin(path: Path, line: bytes) -> None:
    """Make the file with its first line: until that is on disk there is none of this name."""
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
        if rest and (not pieces or _CHECKED.search(rest) or _parsed(rest, _check(last)) is not None):
            begin, last = b"\n", rest  # whole but for its end, or damaged, which stays to be seen
        elif rest:
            os.ftruncate(handle, os.fstat(handle).st_size - len(rest))
        _write(handle, begin + _line(content, _check(last)))
        os.fsync(handle)
    finally:
        os.close(handle)


def _write(handle: int, data: bytes) -> None:
    while data:
        data = data[os.write(handle, data) :]


def _parsed(piece: bytes, before: int) -> tuple[dict[str, Any], bool] | None:
    """What a line says, and whether its check proves it behind that of the one before; None where it is none."""
    found = _CHECKED.fullmatch(piece)
    if found and zlib.crc32(found[1], before) != int(found[2], 16):
        return None
    try:
        content = json.loads(found[1] + b"}" if found else piece)
    except (ValueError, RecursionError):
        return None
    return (content, found is not None) if isinstance(content, dict) else None
