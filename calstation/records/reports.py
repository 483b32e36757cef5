"""Records of issued reports, each a line of a chained file next to the runs and an event in the site's audit trail.

The file belongs to the logs and lists their reports for everyone who uses the folder. The audit trail belongs to the
site and also lists reports of copied logs and reports missing at the end of a truncated file.
"""

from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from calstation.records.audit import AuditEvent, AuditEventName, AuditTrail
from calstation.records.chained_lines import ChainedFile


@dataclass(frozen=True)
class IssuedReport:
    """An issued revision of a report."""

    number: str
    revision: int  #: 0 for the first issue.
    issued: str  #: Date of issue, ISO 8601.
    reason: str | None  #: Reason for a revision.
    content_sha256: str  #: Digest of result, configuration, program version and templates.
    software: str  #: Version of the program.
    received: str | None = None  #: Date of receipt of the unit, ISO 8601; None if it was not stated.
    #: Names of the persons who issued it and confirmed their identity with their own PIN.
    authorised: tuple[str, ...] = ()

    @property
    def identification(self) -> str:
        """The number, followed by the revision for a revised report."""
        return f"{self.number}-R{self.revision}" if self.revision else self.number


#: Name of the event of an issued report in the audit trail.
_EVENT: AuditEventName = "certificate"


def report_file(folder: Path) -> ChainedFile[IssuedReport]:
    """Return the file of the reports of the logs in a folder."""
    return ChainedFile(folder / "reports.jsonl", IssuedReport)


def read_reports(folder: Path) -> list[IssuedReport]:
    """Read the reports of a folder, the oldest first; an empty list if there is no file. Raises InputError."""
    return report_file(folder).entries("report.record_damaged")


def issued_reports(folder: Path, trail: AuditTrail, number: str) -> list[IssuedReport]:
    """Return the reports with a number that are recorded next to the logs of a folder or in the site's audit trail.

    They are sorted by revision. Two reports with the same revision differ if one was issued for a copy of the log.
    Raises InputError if the record next to the logs cannot be read.

    Parameters
    ----------
    folder : folder of the logs
    trail : audit trail of the site
    number : number of the reports
    """
    events = (_from_event(event) for event in trail.entries if event.event == _EVENT)
    reports = dict.fromkeys(each for each in (*read_reports(folder), *events) if each is not None)
    return sorted((each for each in reports if each.number == number), key=lambda each: each.revision)


def audit_values(report: IssuedReport) -> dict[str, Any]:
    """Return the values of a report for its event; the reason is stored separately in the event."""
    return {name: value for name, value in asdict(report).items() if name != "reason"}


def _from_event(event: AuditEvent) -> IssuedReport | None:
    """Return the report of an event; None if the event is not valid for this version of the program."""
    values = {field.name: event.values[field.name] for field in fields(IssuedReport) if field.name in event.values}
    try:
        return TypeAdapter(IssuedReport).validate_python({**values, "reason": event.why or None})
    except ValidationError:
        return None
