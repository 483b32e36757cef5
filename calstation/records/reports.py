"""Record of issued reports beside the runs: one file, to which each report appends a checked line."""

from contextlib import AbstractContextManager
from dataclasses import asdict, dataclass
from pathlib import Path

from pydantic import TypeAdapter

from calstation.errors import InputError
from calstation.messages import os_reason
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
    content_sha256: str  #: Digest of result, configuration, program version and templates.
    software: str  #: Version of the program.
    received: str | None = None  #: Date of receipt of the unit, ISO 8601; None if it was not stated.

    @property
    def identification(self) -> str:
        """Number and, from the first revision on, revision."""
        return f"{self.number}-R{self.revision}" if self.revision else self.number


_RECORD = TypeAdapter(IssuedReport)


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
