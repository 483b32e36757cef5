"""The audit trail of a site: an append-only file of JSON lines with a SHA-256 chain that reveals later changes.

Every line ends with ``, "digest": "..."}``. The digest is the SHA-256 of the line's UTF-8 bytes without this ending but
with its brace, and the line's `previous` is the digest of the intact line before it. A program that is killed while
writing leaves an incomplete last line. The line is kept, and the next event is preceded by a note with its digest, so
that the chain continues after it.
"""

import hashlib
import json
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal, get_args

from pydantic import BaseModel, ConfigDict, JsonValue, ValidationError

from calstation.errors import ConfigurationError, InputError
from calstation.messages import os_reason
from calstation.records.files import locked, write_atomic

#: Names of the events. Names are never removed, so that earlier trails remain filterable.
AuditEventName = Literal[
    "file_saved",
    "file_changed_outside",
    "pin_set",
    "pin_changed",
    "registers",
    "override",
    "certificate",
    "standard_overridden",
    "attempt_allowed",
    "interrupted",
]
AUDIT_EVENTS: tuple[AuditEventName, ...] = get_args(AuditEventName)

#: Event of the note that follows an incomplete line.
INTERRUPTED: AuditEventName = "interrupted"

#: Value of `previous` in the first line.
_START = "0" * 64

#: Longest time to wait for another program that appends a line, s.
_LOCKED_WITHIN = 5.0

_LINE = re.compile(rb'(\{.*), "digest": "([0-9a-f]{64})"\}', re.DOTALL)


class AuditEvent(BaseModel):
    """One line of the audit trail."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    utc: str  #: ISO 8601.
    event: str
    by: str  #: Person who acted; "" for the program.
    confirmed_by: str | None  #: Second person who confirmed the action.
    why: str
    values: dict[str, JsonValue]
    previous: str
    digest: str


@dataclass(frozen=True)
class AuditTrail:
    """Content of an audit trail.

    events : the intact lines, the oldest first
    interrupted : numbers, from 1, of incomplete lines left by a killed program
    first_bad : number of the first line that was changed, removed or inserted later; None if there is none
    """

    events: tuple[AuditEvent, ...] = ()
    interrupted: tuple[int, ...] = ()
    first_bad: int | None = None

    @property
    def digest(self) -> str:
        """Digest of the last intact line; a copy stored elsewhere can prove that no earlier line was changed."""
        return self.events[-1].digest if self.events else _START


def audit_path(folder: Path) -> Path:
    """Return the audit trail in a site's folder."""
    return folder / "audit.jsonl"


class AuditWriter:
    """An audit trail that is locked for other programs."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def trail(self) -> AuditTrail:
        """Read and verify the trail. Raises InputError."""
        return read_audit(self._path)

    def append(
        self, event: AuditEventName, by: str, why: str = "", *, confirmed_by: str | None = None, **values: Any
    ) -> AuditEvent:
        """Append an event, see `append_audit`. Raises OSError."""
        return _append(self._path, event, by, why, confirmed_by, values)


@contextmanager
def audit_writer(folder: Path) -> Iterator[AuditWriter]:
    """Lock the audit trail of a site to append an event that depends on its content.

    Raises ConfigurationError if it cannot be written, or if another program keeps it locked.
    """
    path = audit_path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with locked(folder / ".audit.lock", _LOCKED_WITHIN):
            yield AuditWriter(path)
    except OSError as exc:
        raise ConfigurationError("audit.unwritable", file=path, reason=os_reason(exc)) from exc


def append_audit(
    folder: Path, event: AuditEventName, by: str, why: str = "", *, confirmed_by: str | None = None, **values: Any
) -> AuditEvent:
    """Append an event to the audit trail of a site, write it to disk and return it.

    Parameters
    ----------
    folder : the site's folder
    event : name of the event
    by : person who acted; "" for the program
    why : reason that the person gave
    confirmed_by : second person who confirmed the action
    values : further values of the event, as JSON

    Raises
    ------
    ConfigurationError : if the file cannot be written, or another program keeps it locked.
    """
    with audit_writer(folder) as audit:
        return audit.append(event, by, why, confirmed_by=confirmed_by, **values)


def read_audit(path: Path) -> AuditTrail:
    """Read and verify an audit trail; it is empty if the file is missing. Raises InputError if it cannot be read."""
    try:
        return _verified(path.read_bytes())
    except FileNotFoundError:
        return AuditTrail()
    except OSError as exc:
        raise InputError("result.unreadable", file=path, reason=os_reason(exc)) from exc


def _append(path: Path, event: str, by: str, why: str, confirmed_by: str | None, values: dict[str, Any]) -> AuditEvent:
    content = path.read_bytes() if path.exists() else b""
    *lines, rest = content.split(b"\n")
    last = next(filter(None, map(_parsed, reversed([*lines, rest]))), None)
    previous = last.digest if last else _START
    data = b""
    if rest:
        data += b"\n"
        if _LINE.fullmatch(rest) is None:  # a complete line that was changed must remain visible
            fragment = {"line": len(lines) + 1, "sha256": hashlib.sha256(rest).hexdigest()}
            note, previous = _line(INTERRUPTED, "", "", None, fragment, previous)
            data += note
    line = _line(event, by, why, confirmed_by, values, previous)[0]
    data += line
    if not content:
        write_atomic(path, data)
    else:
        with path.open("ab") as stream:
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
    return AuditEvent.model_validate_json(line)


def _line(
    event: str, by: str, why: str, confirmed_by: str | None, values: dict[str, Any], previous: str
) -> tuple[bytes, str]:
    """Return a line and its digest."""
    utc = datetime.now(UTC).isoformat(timespec="seconds")
    row = {"utc": utc, "event": event, "by": by, "confirmed_by": confirmed_by, "why": why, "values": values}
    text = json.dumps({**row, "previous": previous}, ensure_ascii=False, allow_nan=False).encode()
    digest = hashlib.sha256(text).hexdigest()
    return text[:-1] + f', "digest": "{digest}"}}\n'.encode(), digest


def _parsed(line: bytes) -> AuditEvent | None:
    """Return the event of a line, None if the line is incomplete or was changed."""
    found = _LINE.fullmatch(line)
    if not found or hashlib.sha256(found[1] + b"}").hexdigest().encode() != found[2]:
        return None
    try:
        return AuditEvent.model_validate_json(line)
    except ValidationError:
        return None


def _verified(content: bytes) -> AuditTrail:
    *lines, rest = content.split(b"\n")
    events: list[AuditEvent] = []
    interrupted: list[int] = []
    first_bad: int | None = None
    damaged: tuple[int, str] | None = None  # the preceding line, which is excused only by a note
    for number, line in enumerate([*lines, rest] if rest else lines, 1):
        event = _parsed(line)
        excused = event is not None and event.event == INTERRUPTED and damaged is not None
        if excused and event is not None and damaged == (event.values.get("line"), event.values.get("sha256")):
            interrupted.append(number - 1)
        elif damaged is not None:
            first_bad = first_bad or damaged[0]
        damaged = None
        if event is None:
            damaged = (number, hashlib.sha256(line).hexdigest())
            continue
        if event.previous != (events[-1].digest if events else _START):
            first_bad = first_bad or number
        events.append(event)
    if damaged is not None and rest and _LINE.fullmatch(rest) is None:
        interrupted.append(damaged[0])
    elif damaged is not None:
        first_bad = first_bad or damaged[0]
    return AuditTrail(tuple(events), tuple(interrupted), first_bad)
