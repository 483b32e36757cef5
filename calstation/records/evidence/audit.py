"""The audit trail of a site, a chained file that records every action that can change the meaning of a result.

Every line is signed with the key of the station. The first signed line contains the public key; earlier lines are from
versions of the program without signatures. Nothing is appended to a trail that was changed; `restart_trail` begins a
new one, with a new key, that names the changed one.
"""

import hashlib
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, get_args

from pydantic import BaseModel, ConfigDict, JsonValue

from calstation.errors import ConfigurationError, InputError
from calstation.messages import Text, os_reason
from calstation.records.evidence.chained_lines import Chain, ChainedFile, Damage, SignedLine
from calstation.records.evidence.station_key import (
    StationKey,
    TrailHead,
    finish_key,
    head_file,
    is_signed,
    key_file,
    load_head,
    load_key,
    new_key,
    store_head,
)
from calstation.records.files import write_atomic

#: Names of the events.
AuditEventName = Literal[
    "file_saved",
    "file_changed_outside",
    "pin_set",
    "pin_changed",
    "registers",
    "override",
    "certificate",
    "certificate_printed",
    "label_printed",
    "standard_overridden",
    "attempt_allowed",
    "trail_restarted",
    "validation_begun",
    "validation",
]
AUDIT_EVENTS: tuple[AuditEventName, ...] = get_args(AuditEventName)

#: A person by name and badge.
_NAME_AND_BADGE = re.compile(r"(.+) \(([^()]+)\)")


class AuditEvent(BaseModel):
    """One line of the audit trail."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    utc: str  #: ISO 8601.
    event: str
    by: str  #: Person who acted; "" for the program.
    confirmed_by: str | None  #: Second person who confirmed the action.
    why: str
    values: dict[str, JsonValue]
    key: str | None = None  #: Public key of the station, in the first signed line.
    signature: str | None = None
    previous: str
    digest: str

    @property
    def unproven(self) -> bool:
        """Whether no personal PIN confirmed the name of the person; several people may share the PIN of the site."""
        return bool(self.by) and self.values.get("pin") != "personal"


AuditTrail = Chain[AuditEvent]


def audit_path(folder: Path) -> Path:
    """Return the audit trail in a site's folder."""
    return folder / "audit.jsonl"


@dataclass(frozen=True)
class TrailState:
    """The audit trail of a site, and the result of its verification."""

    path: Path
    trail: AuditTrail
    faults: tuple[Text, ...]  #: Signs that the trail, its head or its key was changed or removed.
    key: StationKey | None  #: The private key; None if there is none or it cannot be read.
    key_error: ConfigurationError | None  #: Why the private key cannot be read.
    stored: TrailHead | None  #: Head stored next to the key.

    @cached_property
    def public_key(self) -> str | None:
        """Public key with which the trail is signed; None before the first signed line."""
        return public_key(self.trail)

    @property
    def head(self) -> TrailHead | None:
        """Current head of the trail; None before its first line."""
        lines, digest = self.trail.head
        return TrailHead(self.public_key or "", lines, digest) if lines else None

    def require_intact(self) -> None:
        """Raise ConfigurationError if the trail was changed."""
        if self.faults:
            raise ConfigurationError("audit.broken", fault=self.faults[0])


class _SignatureCheck:
    """Checks the signatures of the lines of an audit trail in order, except those of the first `known` lines."""

    def __init__(self, known: int = 0) -> None:
        self._known, self._key = known, ""

    def __call__(self, line: SignedLine[AuditEvent]) -> Text | None:
        key = line.entry.key
        if key is not None and self._key:
            return Text("log.line_forged")
        self._key = self._key or key or ""
        if line.signature is None:
            return Text("log.line_unsigned") if self._key else None
        if line.number <= self._known or is_signed(self._key, line.message, line.signature):
            return None
        return Text("log.line_forged")


def damage_text(path: Path, damage: Damage) -> Text:
    """Return the description of a changed line of an audit trail."""
    return Text.of("audit.damaged", file=path, line=damage.number, why=damage.reason)


def verify_trail(folder: Path, *, every_signature: bool = False) -> TrailState:
    """Read and verify the audit trail of a site.

    The signed head next to the key covers the lines before it, so that their signatures are verified only if
    `every_signature` is set. Raises InputError if the trail or its head cannot be read.
    """
    path, head_path = audit_path(folder), head_file(folder)
    stored: TrailHead | None = None
    faults: list[Text] = []
    try:
        stored = load_head(folder)
    except ValueError:
        faults.append(Text.of("audit.head_changed", file=head_path))
    except OSError as exc:
        raise InputError("audit.head_unreadable", file=head_path, reason=os_reason(exc)) from exc
    trail = read_audit(path, 0 if every_signature or stored is None else stored.lines)
    key, error, interrupted = None, None, False
    recorded = public_key(trail)
    try:
        key, interrupted = load_key(folder, recorded)
    except ConfigurationError as exc:
        error = exc
    if trail.damage is not None:
        faults.append(damage_text(path, trail.damage))
    has_key = key is not None or error is not None
    if not trail.digests and (has_key or stored is not None):
        faults.append(Text.of("audit.removed", file=path))
    elif recorded is None and trail.damage is None and (has_key or stored is not None):
        faults.append(Text.of("audit.key_not_recorded", file=path))
    elif recorded is not None and not interrupted:
        if not has_key:
            faults.append(Text.of("audit.key_missing", file=key_file(folder)))
        elif key is not None and key.public != recorded:
            faults.append(Text.of("audit.key_other", file=key_file(folder)))
        if stored is None and not faults:
            faults.append(Text.of("audit.head_missing", file=head_path))
        elif stored is not None and not (stored.key == recorded and trail.contains(stored.lines, stored.digest)):
            faults.append(Text.of("audit.cut", file=path, lines=len(trail.digests), expected=stored.lines))
    return TrailState(path, trail, tuple(faults), key, error, stored)


class AuditWriter(ChainedFile[AuditEvent]):
    """An audit trail that is locked against other programs."""

    @property
    def folder(self) -> Path:
        """Folder of the site."""
        return self.path.parent

    def append_event(
        self, event: AuditEventName, by: str, why: str = "", *, confirmed_by: str | None = None, **values: Any
    ) -> AuditEvent:
        """Append an event; see `append_audit` for the arguments. Raises OSError or ConfigurationError."""
        state = self.require_intact()
        content = _content(event, by, why, confirmed_by, values)
        key = state.key or new_key(self.folder)
        entry = self.append(content if state.public_key else {**content, "key": key.public}, key.sign)
        self._keep(key, len(state.trail.digests) + 1, entry)
        return entry

    def require_intact(self) -> TrailState:
        """Return the state of the trail. Raises ConfigurationError if it was changed or its key cannot be read."""
        state = verify_trail(self.folder)
        state.require_intact()
        if state.key_error is not None:
            raise state.key_error
        return state

    def restart(self, by: str, why: str, pin: str | None) -> AuditEvent:
        """Begin a new trail with a new key; see `restart_trail`. Raises OSError or ConfigurationError."""
        state = verify_trail(self.folder)
        values: dict[str, Any] = {
            "pin": pin,
            "faults": [each.code for each in state.faults],
            "key": state.public_key,
            "stored": state.stored and asdict(state.stored),
        }
        if self.path.exists():
            content = self.path.read_bytes()
            former = self.path.with_name(f"audit_until_{datetime.now(UTC):%Y%m%dT%H%M%S%f}.jsonl")
            write_atomic(former, content)
            values |= {"file": former.name, "sha256": hashlib.sha256(content).hexdigest()}
        key = new_key(self.folder)
        entry = self.begin({**_content("trail_restarted", by, why, None, values), "key": key.public}, key.sign)
        self._keep(key, 1, entry)
        return entry

    def _keep(self, key: StationKey, lines: int, entry: AuditEvent) -> None:
        """Store the head of the trail, and finish the creation of a new key."""
        store_head(self.folder, key, TrailHead(key.public, lines, entry.digest))
        if load_key(self.folder, key.public)[1]:
            finish_key(self.folder)


def _content(
    event: AuditEventName, by: str, why: str, confirmed_by: str | None, values: dict[str, Any]
) -> dict[str, Any]:
    utc = datetime.now(UTC).isoformat(timespec="seconds")
    return {"utc": utc, "event": event, "by": by, "confirmed_by": confirmed_by, "why": why, "values": values}


@contextmanager
def audit_writer(folder: Path) -> Iterator[AuditWriter]:
    """Lock the audit trail of a site to append an event that depends on its content.

    Raises ConfigurationError if it cannot be written, or if another program keeps it locked.
    """
    writer = AuditWriter(audit_path(folder), AuditEvent)
    try:
        with writer.locked():
            yield writer
    except OSError as exc:
        raise ConfigurationError("audit.unwritable", file=writer.path, reason=os_reason(exc)) from exc
    except InputError as exc:
        if exc.code == "result.unreadable":
            raise ConfigurationError("audit.unwritable", **exc.values) from exc
        if exc.code == "audit.head_unreadable":
            raise ConfigurationError("audit.head_unreadable", **exc.values) from exc
        raise


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
        return audit.append_event(event, by, why, confirmed_by=confirmed_by, **values)


def recorded_people(entries: Iterable[AuditEvent], known: Iterable[str] = ()) -> dict[str, str]:
    """Map all spellings of each person in events to one: name and badge if known, as in ``Li Na (B0001)``.

    Events of earlier versions have only the badge or the name. `known` are further persons by name and badge. A name
    with several badges remains unchanged.
    """
    people = {person for each in entries for person in (each.by, each.confirmed_by) if person}
    complete: dict[str, set[str]] = {}
    for person in (*people, *known):
        parts = _NAME_AND_BADGE.fullmatch(person)
        for part in () if parts is None else parts.groups():
            complete.setdefault(part, set()).add(person)
    return {each: each for each in people} | {part: min(whole) for part, whole in complete.items() if len(whole) == 1}


def select_audit(
    entries: Iterable[AuditEvent],
    event: str | None = None,
    person: str | None = None,
    since: str = "",
    people: Mapping[str, str] | None = None,
) -> list[AuditEvent]:
    """Return the events of a kind, by a person who acted or confirmed, since a time in ISO 8601 (UTC).

    `people` is the result of `recorded_people`. A badge selects only events that record it, because
    anyone can type a name.
    """
    spelled = people or {}
    badges = {parts[2] for name in spelled.values() if (parts := _NAME_AND_BADGE.fullmatch(name)) is not None}

    def concerns(each: AuditEvent) -> bool:
        acted = [name for name in (each.by, each.confirmed_by) if name is not None]
        if person in badges:
            return any(name == person or name.endswith(f" ({person})") for name in acted)
        return person is None or spelled.get(person, person) in (spelled.get(name, name) for name in acted)

    return [each for each in entries if event in (None, each.event) and concerns(each) and each.utc >= since]


def restart_trail(folder: Path, by: str, why: str, pin: str | None) -> AuditEvent:
    """Begin a new audit trail that names the current one, which is kept, and return its first event.

    Parameters
    ----------
    folder : the site's folder
    by, why : person who decides to continue, and the reason
    pin : how the person was identified, see `calstation.config.Confirmation`

    Raises
    ------
    ConfigurationError : if the trail cannot be written.
    """
    with audit_writer(folder) as audit:
        return audit.restart(by, why, pin)


def read_audit(path: Path, known: int = 0) -> AuditTrail:
    """Read and verify an audit trail, except the signatures of the first `known` lines; it is empty if it is missing.

    Raises InputError if it cannot be read.
    """
    try:
        return ChainedFile[AuditEvent](path, AuditEvent).read(_SignatureCheck(known))
    except OSError as exc:
        raise InputError("result.unreadable", file=path, reason=os_reason(exc)) from exc


def site_trails(folder: Path) -> list[tuple[Path, AuditTrail]]:
    """Return the audit trails of the site: the current one, and the earlier ones that later trails name.

    Raises InputError if a trail cannot be read.
    """
    trails: list[tuple[Path, AuditTrail]] = []
    path: Path | None = audit_path(folder)
    while path is not None:
        trail = read_audit(path) if trails else _present_trail(folder)
        trails.append((path, trail))
        restarted = trail.entries[0].values if trail.entries and trail.entries[0].event == "trail_restarted" else {}
        former = folder / Path(str(restarted.get("file", ""))).name
        is_named = former.is_file() and hashlib.sha256(former.read_bytes()).hexdigest() == restarted.get("sha256")
        path = former if is_named and former not in [each for each, _ in trails] else None
    return trails


def _present_trail(folder: Path) -> AuditTrail:
    """Return the current trail of the site; signatures of lines that its signed head covers are not verified."""
    with suppress(InputError):  # the head cannot be read
        state = verify_trail(folder)
        if not state.faults:
            return state.trail
    return read_audit(audit_path(folder))


def site_events(folder: Path) -> list[AuditEvent]:
    """Return the events of all audit trails of the site, each up to its first changed line, the oldest first.

    Raises InputError if a trail cannot be read.
    """
    events: list[AuditEvent] = []
    for _, trail in site_trails(folder):
        last = len(trail.digests) if trail.damage is None else trail.damage.number - 1
        events = [each for number, each in zip(trail.numbers, trail.entries, strict=True) if number <= last] + events
    return events


def public_key(trail: AuditTrail) -> str | None:
    """Return the public key with which a trail is signed; None before its first signed line."""
    return next((each.key for each in trail.entries if each.key is not None), None)
