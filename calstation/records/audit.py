"""The audit trail of a site, a chained file that records every action that can change the meaning of a result."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal, get_args

from pydantic import BaseModel, ConfigDict, JsonValue

from calstation.errors import ConfigurationError, InputError
from calstation.messages import os_reason
from calstation.records.chained_lines import Chain, ChainedFile

#: Names of the events.
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
]
AUDIT_EVENTS: tuple[AuditEventName, ...] = get_args(AuditEventName)


class AuditEvent(BaseModel):
    """One line of the audit trail."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    utc: str  #: ISO 8601.
    event: str
    by: str  #: Person who acted; "" for the program.
    confirmed_by: str | None  #: Second person who confirmed the action.
    why: str
    values: dict[str, JsonValue]
    previous: str
    digest: str


AuditTrail = Chain[AuditEvent]


def audit_path(folder: Path) -> Path:
    """Return the audit trail in a site's folder."""
    return folder / "audit.jsonl"


class AuditWriter(ChainedFile[AuditEvent]):
    """An audit trail that is locked against other programs."""

    def append_event(
        self, event: AuditEventName, by: str, why: str = "", *, confirmed_by: str | None = None, **values: Any
    ) -> AuditEvent:
        """Append an event; see `append_audit` for the arguments. Raises OSError."""
        utc = datetime.now(UTC).isoformat(timespec="seconds")
        row = {"utc": utc, "event": event, "by": by, "confirmed_by": confirmed_by, "why": why, "values": values}
        return self.append(row)


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


def select_audit(
    entries: Iterable[AuditEvent], event: str | None = None, person: str | None = None, since: str = ""
) -> list[AuditEvent]:
    """Return the events with a name, of a person who acted or confirmed, and since a time in ISO 8601 (UTC)."""
    return [
        each
        for each in entries
        if event in (None, each.event) and person in (None, each.by, each.confirmed_by) and each.utc >= since
    ]


def read_audit(path: Path) -> AuditTrail:
    """Read and verify an audit trail; it is empty if the file is missing. Raises InputError if it cannot be read."""
    try:
        return ChainedFile[AuditEvent](path, AuditEvent).read()
    except OSError as exc:
        raise InputError("result.unreadable", file=path, reason=os_reason(exc)) from exc
