"""Append-only files of JSON lines with a SHA-256 chain, such as the audit trail, issued reports and journals.

Every line ends with ``, "previous": "...", "digest": "..."}``. `digest` is the SHA-256 of the UTF-8 bytes of the line
without ``, "digest": "..."``; `previous` is the digest of the line before, or 64 zeros in the first line. A power
failure or a killed program can only leave an incomplete last line. The next append keeps this line and closes it with
``#incomplete``; `previous` of the new line is then the SHA-256 of the preceding digest and the incomplete line's bytes.

A signed line has ``, "signature": "..."`` before `previous`: the signature of the line's bytes without it and `digest`.
"""

import hashlib
import json
import os
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Generic, TypeVar

from pydantic import TypeAdapter

from calstation.errors import InputError
from calstation.messages import Text, os_reason
from calstation.parsing import parse_json
from calstation.records.files import locked, sync_folder, write_atomic

#: Digest before the first line.
START = "0" * 64

#: Longest time to wait while another program appends a line, s.
LOCK_TIMEOUT = 5.0

_INCOMPLETE = b"#incomplete"
_ENDING = re.compile(rb'(, "previous": "[0-9a-f]{64}"), "digest": "([0-9a-f]{64})"\}')
_SIGNATURE = re.compile(rb', "signature": "([0-9a-f]{128})"$')

T = TypeVar("T")

#: Cached, because creating an adapter takes 2 ms, and the program reads the journals of all units when it starts.
_adapter = cache(TypeAdapter[Any])


@dataclass(frozen=True)
class Damage:
    """The first line at which the file was changed after it had been written."""

    number: int  #: Number of the line, from 1.
    reason: Text


@dataclass(frozen=True)
class Chain(Generic[T]):
    """Contents of a chained file."""

    entries: tuple[T, ...] = ()  #: Entries of all lines that agree with their own digest, the oldest first.
    numbers: tuple[int, ...] = ()  #: Line number of each entry, from 1.
    incomplete: tuple[int, ...] = ()  #: Numbers of the lines left incomplete by a killed program.
    truncated: bool = False  #: Whether the last line is incomplete.
    damage: Damage | None = None
    digest: str = START  #: Digest of the last line; a copy kept elsewhere proves that no line was changed.
    digests: tuple[str, ...] = ()  #: Digest of every line, which the next line contains as `previous`.

    def contains(self, lines: int, digest: str) -> bool:
        """Return whether the file had this digest when it had this number of lines; 0 lines have the digest START."""
        return 0 <= lines <= len(self.digests) and digest == (self.digests[lines - 1] if lines else START)

    @property
    def head(self) -> tuple[int, str]:
        """Number and digest of the last complete line; (0, START) if there is none.

        An incomplete line after it is not part of the head, because the next append changes it.
        """
        number = len(self.digests)
        while number in self.incomplete:
            number -= 1
        return number, self.digests[number - 1] if number else START


@dataclass(frozen=True)
class SignedLine(Generic[T]):
    """A complete line with its signature."""

    number: int  #: From 1.
    entry: T
    message: bytes  #: The signed bytes.
    signature: str | None  #: Hexadecimal digits; None for a line without a signature.


class ChainedFile(Generic[T]):
    """A chained file whose lines contain entries of one type, which pydantic validates."""

    def __init__(self, path: Path, entry: Any) -> None:
        self.path = path
        self._entry: TypeAdapter[T] = _adapter(entry)

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Lock the file, creating its folder if necessary. Raises OSError, also after `LOCK_TIMEOUT`."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        with locked(self.path.with_name(f".{self.path.stem}.lock"), LOCK_TIMEOUT):
            yield

    def read(self, check: Callable[[SignedLine[T]], Text | None] | None = None) -> Chain[T]:
        """Read and verify the file; it is empty if it is missing.

        `check` returns what is wrong with the signature of a line, or None. Raises OSError.
        """
        try:
            content = self.path.read_bytes()
        except (FileNotFoundError, NotADirectoryError):
            return Chain()
        if not content:
            return Chain(damage=Damage(1, Text("log.line_missing")))
        *lines, last_line = content.split(b"\n")
        entries: dict[int, T] = {}
        incomplete: list[int] = []
        unconfirmed: list[int] = []  # incomplete lines that no valid line follows
        damage: Damage | None = None
        digests = [START]
        for number, line in enumerate([*lines, last_line] if last_line else lines, 1):
            is_last = bool(last_line) and number > len(lines)
            if number > 1 and (line.endswith(_INCOMPLETE) or (is_last and not _ENDING.search(line))):
                unconfirmed.append(number)
            else:
                reason = self._check_line(number, line, digests[-1], entries)
                if reason is None and check is not None:
                    reason = check(SignedLine(number, entries[number], *_signed(line)))
                if reason is None:
                    incomplete += unconfirmed
                elif damage is None:
                    damage = Damage(min([*unconfirmed, number]), reason)
                unconfirmed.clear()
            digests.append(_next_digest(line, digests[-1]))
        return Chain(
            tuple(entries.values()),
            tuple(entries),
            (*incomplete, *unconfirmed),
            bool(unconfirmed),
            damage,
            digests[-1],
            tuple(digests[1:]),
        )

    def _check_line(self, number: int, line: bytes, digest: str, entries: dict[int, T]) -> Text | None:
        """Check a line and add its entry if it agrees with its own digest; return a description of damage, or None."""
        ending = _ENDING.search(line)
        if ending is None:
            return Text("log.line_incomplete")
        if ending.end() != len(line) or _sha256(line[: ending.end(1)] + b"}") != ending[2].decode():
            return Text("log.line_altered")
        try:
            content = parse_json(line)
            entries[number] = self._entry.validate_python(content)
        except ValueError:
            return Text("log.line_unknown")
        return None if content["previous"] == digest else Text("log.line_out_of_order")

    def entries(self, code: str) -> list[T]:
        """Return all entries, the oldest first; an empty list if the file is missing.

        Raises InputError with `code` if a line is damaged, or if the file cannot be read.
        """
        try:
            chain = self.read()
        except OSError as exc:
            raise InputError("result.unreadable", file=self.path, reason=os_reason(exc)) from exc
        if chain.damage is not None:
            raise InputError(code, file=self.path, line=chain.damage.number, why=chain.damage.reason)
        return list(chain.entries)

    def append(self, content: Mapping[str, Any], sign: Callable[[bytes], str] | None = None) -> T:
        """Append an entry given as JSON data, write it to disk and return it.

        `sign` returns the signature of a line. The file is created with its first line; a file that was emptied remains
        damaged. The caller must lock the file unless no other program can append to it. Raises OSError, and ValueError
        if the content is not an entry.
        """
        exists = self.path.exists()
        *lines, last_line = (self.path.read_bytes() if exists else b"").split(b"\n")
        digest, prefix = START, b""
        if last_line or (exists and not lines):
            complete = _ENDING.search(last_line) is not None or not lines
            prefix = b"\n" if complete else _INCOMPLETE + b"\n"
            lines.append(last_line if complete else last_line + _INCOMPLETE)
        for line in lines:
            digest = _next_digest(line, digest)
        line, entry = self._line(content, digest, sign)
        if exists:
            handle = os.open(self.path, os.O_WRONLY | os.O_APPEND | getattr(os, "O_BINARY", 0))
            try:
                _write(handle, prefix + line + b"\n")
                os.fsync(handle)
            finally:
                os.close(handle)
        else:
            self._begin(line)
        return entry

    def begin(self, content: Mapping[str, Any], sign: Callable[[bytes], str] | None = None) -> T:
        """Replace the file by a new chain with this first entry; see `append`."""
        line, entry = self._line(content, START, sign)
        self._begin(line)
        return entry

    def _begin(self, line: bytes) -> None:
        self.path.parent.mkdir(parents=True, exist_ok=True)
        write_atomic(self.path, line + b"\n")
        sync_folder(self.path.parent.parent)

    def _line(self, content: Mapping[str, Any], digest: str, sign: Callable[[bytes], str] | None) -> tuple[bytes, T]:
        """Return the line that follows a line with this digest, and its entry. Raises ValueError."""
        text = json.dumps({**content, "previous": digest}, ensure_ascii=False).encode()
        if sign is not None:
            signed = {**content, "signature": sign(text), "previous": digest}
            text = json.dumps(signed, ensure_ascii=False).encode()
        line = text[:-1] + f', "digest": "{_sha256(text)}"}}'.encode()
        return line, self._entry.validate_python(parse_json(line))


def _sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def _signed(line: bytes) -> tuple[bytes, str | None]:
    """Return the signed bytes of a complete line, and its signature."""
    ending = _ENDING.search(line)
    if ending is None:
        return line, None
    content = line[: ending.start()]
    signature = _SIGNATURE.search(content)
    if signature is None:
        return content + ending[1] + b"}", None
    return content[: signature.start()] + ending[1] + b"}", signature[1].decode()


def _next_digest(line: bytes, digest: str) -> str:
    """Return the digest that the line after `line` must contain; `digest` is the digest of the preceding line."""
    ending = _ENDING.search(line)
    complete = ending is not None and ending.end() == len(line)
    return ending[2].decode() if ending and complete else _sha256(digest.encode() + line)


def _write(handle: int, data: bytes) -> None:
    while data:
        data = data[os.write(handle, data) :]
