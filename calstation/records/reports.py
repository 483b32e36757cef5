"""Record of issued reports: a line with a checksum in a file next to the runs, and an event in the site's audit trail.

The file belongs to the logs and lists their reports for everyone who uses the folder. The audit trail belongs to the
site and also lists reports of copied logs and reports missing at the end of a truncated file.
"""

from contextlib import AbstractContextManager
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from calstation.errors import InputError
from calstation.messages import os_reason
from calstation.records.audit import AuditEvent, AuditEventName, AuditTrail
from calstation.records.checked_lines import DamagedLineError, append_line, read_lines
from calstation.records.files import locked

#: Longest time to wait for another program that issues a report, s.
_LOCKED_WITHIN = 5.0


@dataclass(frozen=True)
class IssuedReport:
    """An issued revision of a report."""

    number: str
    revision: int  #: 0 for the first issue.
    issued: str  #: Date of issue, ISO 8601.
    reason: str | None  #: Reason for a revision.
    content_sha256: str  #: Digest of result, configuration, program version and templates; "" if it is unknown.
    software: str  #: Version of the program.
    received: str | None = None  #: Date of receipt of the unit, ISO 8601; None if it was not stated.
    #: Names of the persons who issued it and confirmed their identity with their own PIN.
    authorised: tuple[str, ...] = ()

    @property
    def identification(self) -> str:
        """Number and, if revised, the revision."""
        return f"{self.number}-R{self.revision}" if self.revision else self.number


_RECORD = TypeAdapter(IssuedReport)
#: Event of an issued report in the audit trail.
_EVENT: AuditEventName = "certificate"


def reports_path(folder: Path) -> Path:
    """Return the file of the reports of the logs in a folder."""
    return folder / "reports.jsonl"


def reports_locked(folder: Path) -> AbstractContextManager[None]:
    """Lock the reports of a folder for other programs. Raises OSError, also if another program keeps them locked."""
    return locked(folder / ".reports.lock", _LOCKED_WITHIN)


def append_report(folder: Path, report: IssuedReport) -> None:
    """Append a report to the file of a folder, which the caller has locked. Raises OSError."""
    append_line(reports_path(folder), asdict(report))


def read_reports(folder: Path) -> list[IssuedReport]:
    """Read the reports of a folder, the oldest first; none if there is no file. Raises InputError."""
    path = reports_path(folder)
    try:
        return [_RECORD.validate_python(line.content) for line in read_lines(path).lines]
    except OSError as exc:
        raise InputError("result.unreadable", file=path, reason=os_reason(exc)) from exc
    except DamagedLineError as exc:
        raise InputError("report.record_damaged", file=path, line=exc.number, why=exc.why) from exc
    except ValueError as exc:
        raise InputError("result.resolves_unknown", file=path) from exc


def issued_reports(folder: Path, trail: AuditTrail, number: str) -> list[IssuedReport]:
    """Return the reports with a number that are recorded next to the logs of a folder or in the site's audit trail.

    They are in the order of their revisions. Two reports with the same revision have different content: one was issued
    for a copy of the log. Raises InputError if the record next to the logs cannot be read.
    """
    events = (_from_event(event) for event in trail.events if event.event == _EVENT)
    same = [each for each in (*read_reports(folder), *events) if each is not None and each.number == number]
    known = {each.revision for each in same if each.content_sha256}
    different = dict.fromkeys(each for each in same if each.content_sha256 or each.revision not in known)
    return sorted(different, key=lambda each: each.revision)


def audit_values(report: IssuedReport) -> dict[str, Any]:
    """Return the values of a report's event; its reason is the event's reason."""
    return {name: value for name, value in asdict(report).items() if name != "reason"}


def _from_event(event: AuditEvent) -> IssuedReport | None:
    """Return the report of an event; None if its content is unknown."""
    values = event.values
    if "content_sha256" not in values:  # from an earlier version of the program
        number, mark, revision = str(values.get("certificate", "")).rpartition("-R")
        number, revision = (number, revision) if mark and revision.isdecimal() else (f"{number}{mark}{revision}", "0")
        return IssuedReport(number, int(revision), event.utc[:10], event.why or None, "", "")
    known = {field.name: values[field.name] for field in fields(IssuedReport) if field.name in values}
    try:
        return _RECORD.validate_python({**known, "reason": event.why or None})
    except ValidationError:
        return None
