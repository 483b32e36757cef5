"""The audit trail of the site for the window: reading with verification, and export."""

import json
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Literal

from calstation.config import library
from calstation.config.confirmation import Person, confirm_at_site
from calstation.config.request import plain_text
from calstation.config.station import load_station
from calstation.errors import CalstationError, ConfigurationError
from calstation.escaping import for_csv
from calstation.jobs import ProgressCallback
from calstation.messages import Text, os_reason
from calstation.parsing import read_json
from calstation.records import (
    AuditEvent,
    AuditTrail,
    audit_path,
    damage_text,
    public_key,
    read_audit,
    recorded_people,
    restart_trail,
    select_audit,
    verify_trail,
    write_atomic,
)

#: State of a line of an audit trail; from the first changed line on, the chain proves no line.
LineState = Literal["proved", "unproved", "changed"]


@dataclass(frozen=True)
class TrailLine:
    """A line of an audit trail."""

    number: int  #: From 1.
    state: LineState
    event: AuditEvent | None  #: None for a changed line that is no event.
    text: str = ""  #: Text of a changed line that is no event.


@dataclass(frozen=True)
class SiteTrail:
    """The verified audit trail of the site, and the findings of its verification."""

    trail: AuditTrail
    state: tuple[Text, ...]
    faults: tuple[Text, ...] = ()  #: The findings in `state` that contradict the trail or a file.
    cautions: tuple[Text, ...] = ()  #: The findings in `state` about what could not be verified.
    changed: tuple[tuple[int, str], ...] = ()  #: Number and text of the lines of a damaged trail that are no events.
    known: tuple[str, ...] = ()  #: Persons with a badge at the stations, by name and badge.

    @cached_property
    def people(self) -> dict[str, str]:
        """One spelling for each person, by all spellings; see `calstation.records.recorded_people`."""
        return recorded_people(self.trail.entries, self.known)

    @property
    def intact(self) -> bool:
        """Whether nothing contradicts the trail and the files of its certificates."""
        return not self.faults

    @property
    def lines(self) -> int:
        """Number of events, and of changed lines that are no events."""
        return len(self.trail.entries) + len(self.changed)

    def select(self, event: str | None = None, person: str | None = None, since: str = "") -> list[TrailLine]:
        """Return the lines of the events that `select_audit` selects, and all changed lines, the oldest first."""
        trail, lines = self.trail, [TrailLine(number, "changed", None, text) for number, text in self.changed]
        chosen = {id(each) for each in select_audit(trail.entries, event, person, since, self.people)}
        damaged = len(trail.digests) + 1 if trail.damage is None else trail.damage.number
        for number, each in zip(trail.numbers, trail.entries, strict=True):
            if id(each) in chosen:
                state: LineState = "changed" if number == damaged else "unproved"
                lines.append(TrailLine(number, "proved" if number < damaged else state, each))
        return sorted(lines, key=lambda line: line.number)


def read_site_trail(report: ProgressCallback) -> SiteTrail:
    """Job: read and verify the audit trail of the site. Raises InputError if it cannot be read."""
    folder = library.site_folder()
    state = verify_trail(folder, every_signature=True)
    report(1.0)
    faults = state.faults or _without_trail(folder, "audit.files_without", _proofs(folder))
    cautions = () if faults else _without_trail(folder, "audit.older_or_removed", _traces(folder))
    texts = cautions or _verification(audit_path(folder), state.trail, faults)
    if state.key_error is not None:
        texts = (*texts, state.key_error.as_text)
    changed = _changed_lines(audit_path(folder), state.trail)
    return SiteTrail(state.trail, texts, faults, cautions, changed, tuple(_known_people()))


def _known_people() -> Iterator[str]:
    """Yield the persons with a badge at the stations of the site, except at those whose file is damaged."""
    for name in library.names("stations"):
        with suppress(CalstationError):
            sign_in = load_station(library.find("stations", name))[1].sign_in
            yield from () if sign_in is None else map(sign_in.person, sign_in.names)


def _without_trail(folder: Path, code: str, witnesses: Iterator[Path]) -> tuple[Text, ...]:
    """Return the finding about the first witness of a site that has no audit trail; () if it has one."""
    path = audit_path(folder)
    findings = () if path.exists() else (Text.of(code, file=path, witness=each) for each in witnesses)
    return tuple(findings)[:1]


def _proofs(folder: Path) -> Iterator[Path]:
    """Yield files that only a program with an audit trail writes, after an event of the trail."""
    if (folder / "engineers").exists():
        yield folder / "engineers"
    for path in sorted((folder / "versions").glob("*/*/*.json")):
        with suppress(OSError, ValueError):
            if "reason" in read_json(path):  # versions of programs without an audit trail have no reason
                yield path


def _traces(folder: Path) -> Iterator[Path]:
    """Yield files that programs without an audit trail also wrote."""
    yield from (each for name in ("engineer.json", "versions") if (each := folder / name).exists())


def read_trail_copy(path: Path) -> SiteTrail:
    """Read and verify a copy of an audit trail with the key that it contains. Raises InputError."""
    trail = read_audit(path)
    faults = () if trail.damage is None else (damage_text(path, trail.damage),)
    return SiteTrail(trail, _verification(path, trail, faults), faults, changed=_changed_lines(path, trail))


def _changed_lines(path: Path, trail: AuditTrail) -> tuple[tuple[int, str], ...]:
    """Return number and text of the lines of a damaged trail that are no events; () if it can no longer be read."""
    try:
        content = b"" if trail.damage is None else path.read_bytes()
    except OSError:
        return ()
    known = {*trail.numbers, *trail.incomplete}
    lines = enumerate(content.split(b"\n")[: len(trail.digests)] if content else [], 1)
    return tuple((number, plain_text(line.decode(errors="replace"))) for number, line in lines if number not in known)


def _verification(path: Path, trail: AuditTrail, faults: Sequence[Text]) -> tuple[Text, ...]:
    """Return the findings of the verification of an audit trail."""
    if faults:
        later = sum(number > trail.damage.number for number in trail.numbers) if trail.damage else 0
        state = (*faults, *([Text.of("audit.unverified", lines=later)] if later else []))
    elif not path.exists():
        state = (Text.of("audit.none", file=path),)
    else:
        key = public_key(trail)
        unsigned = sum(each.signature is None for each in trail.entries)
        values = {"file": path, "lines": len(trail.entries), "digest": trail.head[1]}
        signed = [] if key is None else [Text.of("audit.signed", key=key)]
        state = (
            Text.of("audit.intact", **values),
            *signed,
            *([Text.of("audit.unsigned", lines=unsigned)] if unsigned else []),
        )
    return (*(Text.of("audit.interrupted", file=path, line=number) for number in trail.incomplete), *state)


def restart_site_trail(why: str, person: Person) -> AuditEvent:
    """Begin a new audit trail of the site, which names the present one; return its first event.

    Raises ConfigurationError if the person is not identified or no reason is given.
    """
    why = plain_text(why)
    if not why:
        raise ConfigurationError("audit.no_reason")
    people = confirm_at_site(person)
    return restart_trail(library.site_folder(), people.by, why, people.pin)


def export_trail(report: ProgressCallback, lines: Sequence[TrailLine], target: Path) -> Path:
    """Job: write lines of a trail with their state to a ``.csv`` file, or as a JSON list.

    Raises ConfigurationError if it cannot be written.
    """
    names = [*AuditEvent.model_fields, "line", "state", "text"]
    rows = [
        {
            **({} if line.event is None else line.event.model_dump()),
            **{"line": line.number, "state": line.state, "text": line.text},
        }
        for line in lines
    ]
    if target.suffix == ".csv":
        texts = [{**row, "values": json.dumps(row.get("values", {}), ensure_ascii=False)} for row in rows]
        cells = [[row.get(name) for name in names] for row in texts]
        content = "\ufeff" + for_csv([names, *cells])  # so that spreadsheets recognise UTF-8
    else:
        content = json.dumps(rows, indent=1, ensure_ascii=False) + "\n"
    try:
        write_atomic(target, content)
    except OSError as exc:
        raise ConfigurationError("result.unwritable", file=target, reason=os_reason(exc)) from exc
    report(1.0)
    return target
