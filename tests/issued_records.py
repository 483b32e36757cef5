"""Certificates in the audit trail of a site and in the record of issued reports, without their documents."""

from collections.abc import Mapping
from pathlib import Path

from calstation.records import IssuedReport, append_audit, audit_path, audit_values, reports_head, verify_trail
from calstation.records.evidence.reports import append_report
from calstation.records.evidence.station_key import head_file, key_file


def issue_in_records(
    home: Path, runs: Path, number: str, revision: int = 0, files: Mapping[str, str] | None = None
) -> None:
    """Append the issue of a certificate to the audit trail of a site, then to the record in a folder of runs."""
    runs.mkdir(exist_ok=True)
    report = IssuedReport(number, revision, "2026-11-20", None, f"{revision:064}", "0.1", trail=verify_trail(home).head)
    values = {"certificate": report.identification, "files": files or {}, "reports": reports_head(runs)}
    append_audit(home, "certificate", "Li Na", **values, **audit_values(report))
    key = verify_trail(home).key
    assert key is not None
    append_report(runs, report, key)


def cut_last_line(path: Path) -> None:
    """Remove the last line of a file."""
    path.write_bytes(b"".join(path.read_bytes().splitlines(keepends=True)[:-1]))


def remove_trail(home: Path) -> None:
    """Remove the audit trail of a site with its key and its head."""
    for path in (audit_path(home), key_file(home), head_file(home)):
        path.unlink()
