"""Records of issued reports, each a line of a chained file next to the runs and an event in the site's audit trail.

The file belongs to the logs and lists their reports for everyone who uses the folder. The audit trail belongs to the
site and also lists reports of copied logs and reports missing at the end of a truncated file. Each proves that the
other is complete: a line contains the head of the trail before its event, and an event the head of the file before its
line. Lines are signed and contain the public key of their site.
"""

import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from pydantic import BaseModel, JsonValue, TypeAdapter, ValidationError

from calstation.errors import ConfigurationError, InputError
from calstation.messages import Text, os_reason
from calstation.records.evidence.audit import AuditEvent, AuditEventName, TrailState, verify_trail
from calstation.records.evidence.chained_lines import Chain, ChainedFile, SignedLine
from calstation.records.evidence.station_key import DatabaseHead, StationKey, TrailHead, database_heads, is_signed


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
    trail: TrailHead | None = None  #: Head of the audit trail before the issue, as stated in the report.
    rewritten: str | None = None  #: Time at which the registers were written again after the run, ISO 8601.

    @property
    def identification(self) -> str:
        """The number, followed by the revision for a revised report."""
        return _identification(self.number, self.revision)


def _identification(number: object, revision: object) -> str:
    return f"{number}-R{revision}" if revision else str(number)


#: Name of the event of an issued report in the audit trail.
_EVENT: AuditEventName = "certificate"
#: Values of an event that identify a report.
_IDENTITY = ("number", "revision", "content_sha256")


#: Time that another program may take between an event and its report, s.
_APPENDING = 0.2


class _ReportLine(BaseModel):
    """Entries of a line that identify the report and its issuer."""

    number: str
    revision: int
    content_sha256: str
    trail: TrailHead | None = None  #: As in `IssuedReport`.
    key: str | None = None  #: Public key of the site that issued the report; None for a line without a signature.


def report_file(folder: Path) -> ChainedFile[IssuedReport]:
    """Return the file of the reports of the logs in a folder."""
    return ChainedFile(folder / "reports.jsonl", IssuedReport)


def append_report(folder: Path, report: IssuedReport, key: StationKey) -> None:
    """Append a report to the locked file of a folder, signed with the key of the site. Raises OSError."""
    report_file(folder).append({**asdict(report), "key": key.public}, key.sign)


def reports_head(folder: Path) -> dict[str, JsonValue]:
    """Return the present head of the reports of a folder, for the event of the next one. Raises OSError."""
    lines, digest = report_file(folder).read().head
    return {"folder": str(folder.resolve()), "lines": lines, "digest": digest}


def report_faults(folder: Path, state: TrailState) -> list[Text]:
    """Return the faults of the reports of a folder, and their contradictions with the audit trail of the site.

    Raises InputError if the file cannot be read.
    """
    file: ChainedFile[_ReportLine] = ChainedFile(report_file(folder).path, _ReportLine)
    try:
        chain = file.read(_check_signature())
    except OSError as exc:
        raise InputError("result.unreadable", file=file.path, reason=os_reason(exc)) from exc
    if chain.damage is not None:
        line, why = chain.damage.number, chain.damage.reason
        return [Text.of("report.record_damaged", file=file.path, line=line, why=why)]
    for event in _events_of(folder, state.trail.entries):
        before: Any = event.values["reports"]
        if not chain.contains(before["lines"], before["digest"]):
            return [Text.of("report.record_cut", file=file.path, lines=len(chain.digests), expected=before["lines"])]
    recorded = {_identity(event.values) for event in state.trail.entries if event.event == _EVENT}
    for row in chain.entries:
        if row.key is None or row.key != state.public_key:
            continue  # issued before lines were signed, or at another site
        head = row.trail
        if head is not None and not state.trail.contains(head.lines, head.digest):
            values = {"line": head.lines, "digest": head.digest, "witness": file.path}
            return [Text.of("audit.contradicts", file=state.path, **values)]
        if _identity(row.model_dump()) not in recorded:
            return [
                Text.of(
                    "report.not_in_trail",
                    file=file.path,
                    number=_identification(row.number, row.revision),
                    trail=state.path,
                )
            ]
    return []


def unrecorded_reports(folder: Path, state: TrailState) -> list[str]:
    """Return the reports in the audit trail that are missing in the file of their folder, the oldest first.

    The file is read twice, because another program may have appended the event, but not yet the line. `report_faults`
    tolerates that the last report is missing, because the program may have ended between the two; see
    `complete_reports`. Raises OSError.
    """
    file: ChainedFile[_ReportLine] = ChainedFile(report_file(folder).path, _ReportLine)
    events = [event.values for event in _events_of(folder, state.trail.entries)]
    for wait in (_APPENDING, 0.0):
        recorded = {_identity(line.model_dump()) for line in file.read().entries}
        missing = [values for values in events if _identity(values) not in recorded]
        if not missing:
            break
        time.sleep(wait)
    return list(dict.fromkeys(str(each.get("certificate", each.get("number"))) for each in missing))


def recorded_folders(events: Iterable[AuditEvent]) -> list[Path]:
    """Return the folders of the logs of the reports in an audit trail."""
    names = (_folder(event) for event in events if event.event == _EVENT)
    return [Path(name) for name in dict.fromkeys(names) if isinstance(name, str)]


def intact_trail(site: Path, runs: Path) -> TrailState:
    """Return the audit trail of a site, after comparing it with the reports and the received heads in a folder of runs.

    The files are read again before a change is reported, because another program may have appended to one of them while
    they were read. Raises ConfigurationError if the trail or the file of reports was changed, or InputError if a file
    cannot be read.
    """
    try:
        return _intact_trail(site, runs)
    except ConfigurationError:
        time.sleep(_APPENDING)
        return _intact_trail(site, runs)


def _intact_trail(site: Path, runs: Path) -> TrailState:
    heads = database_heads(runs)
    state = verify_trail(site)
    state.require_intact()
    contradictions = database_contradictions(state, heads)
    if contradictions:
        raise ConfigurationError("audit.broken", fault=contradictions[0])
    faults = report_faults(runs, state)
    if faults:
        raise ConfigurationError("report.broken", fault=faults[0])
    return state


def database_contradictions(state: TrailState, heads: Iterable[DatabaseHead]) -> list[Text]:
    """Return the contradictions between an audit trail and its heads in the shared database."""
    return [
        Text.of("audit.contradicts_database", file=state.path, line=each.head.lines, digest=each.head.digest)
        for each in heads
        if each.head.key == state.public_key and not state.trail.contains(each.head.lines, each.head.digest)
    ]


def reports_of_others(folder: Path, state: TrailState) -> int:
    """Return the number of reports that the audit trail cannot confirm: reports of other sites or without signatures.

    Raises OSError.
    """
    lines: Chain[_ReportLine] = ChainedFile[_ReportLine](report_file(folder).path, _ReportLine).read()
    return sum(line.key is None or line.key != state.public_key for line in lines.entries)


def _events_of(folder: Path, events: Iterable[AuditEvent]) -> list[AuditEvent]:
    """Return the events of the reports in the file of a folder."""
    certificates = (event for event in events if event.event == _EVENT)
    return [each for each in certificates if _folder(each) == str(folder.resolve())]


def _folder(event: AuditEvent) -> JsonValue:
    reports = event.values.get("reports")
    return reports.get("folder") if isinstance(reports, dict) else None


def _identity(values: Mapping[str, Any]) -> tuple[Any, ...]:
    return tuple(values.get(name) for name in _IDENTITY)


def complete_reports(folder: Path, state: TrailState) -> None:
    """Append the last report of the audit trail to the file if the program ended before; see `unrecorded_reports`.

    Raises OSError.
    """
    events = _events_of(folder, state.trail.entries)
    report = _from_event(events[-1]) if events else None
    if report is not None and state.key is not None and report not in report_file(folder).read().entries:
        append_report(folder, report, state.key)


def _check_signature() -> Callable[[SignedLine[_ReportLine]], Text | None]:
    """Return a function that checks the signatures of lines, which must be passed in order."""
    is_signed_part = False

    def check(line: SignedLine[_ReportLine]) -> Text | None:
        nonlocal is_signed_part
        if line.signature is None:
            return Text("log.line_unsigned") if is_signed_part or line.entry.key is not None else None
        is_signed_part = True
        valid = line.entry.key is not None and is_signed(line.entry.key, line.message, line.signature)
        return None if valid else Text("log.line_forged")

    return check


def read_reports(folder: Path) -> list[IssuedReport]:
    """Read the reports of a folder, the oldest first; an empty list if there is no file. Raises InputError."""
    return report_file(folder).entries("report.record_damaged")


def issued_reports(folder: Path, events: Iterable[AuditEvent], number: str) -> list[IssuedReport]:
    """Return the reports with a number that are recorded next to the logs of a folder or in the site's audit trail.

    They are sorted by revision. Two reports with the same revision differ if one was issued for a copy of the log.
    Raises InputError if the record next to the logs cannot be read.

    Parameters
    ----------
    folder : folder of the logs
    events : events of the site
    number : number of the reports
    """
    certificates = (_from_event(event) for event in events if event.event == _EVENT)
    reports = dict.fromkeys(each for each in (*read_reports(folder), *certificates) if each is not None)
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
