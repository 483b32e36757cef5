"""The audit trail of the site for the window: reading with verification, and export."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from calstation.config import library
from calstation.errors import ConfigurationError
from calstation.escaping import for_csv
from calstation.jobs import ProgressCallback
from calstation.messages import Text, os_reason
from calstation.records import AuditEvent, AuditTrail, audit_path, read_audit, write_atomic


@dataclass(frozen=True)
class SiteTrail:
    """The verified audit trail of the site, and what its verification has found."""

    trail: AuditTrail
    state: tuple[Text, ...]
    intact: bool


def read_site_trail(report: ProgressCallback) -> SiteTrail:
    """Job: read and verify the audit trail of the site. Raises InputError if it cannot be read."""
    path = audit_path(library.site_folder())
    trail = read_audit(path)
    report(1.0)
    return SiteTrail(trail, verification(path, trail), trail.damage is None)


def verification(path: Path, trail: AuditTrail) -> tuple[Text, ...]:
    """Return what the verification of an audit trail has found."""
    if not path.exists():
        return (Text.of("audit.none", file=path),)
    interrupted = (Text.of("audit.interrupted", file=path, line=number) for number in trail.incomplete)
    if trail.damage is not None:
        return (*interrupted, Text.of("audit.damaged", file=path, line=trail.damage.number))
    return (*interrupted, Text.of("audit.intact", file=path, lines=len(trail.entries), digest=trail.digest))


def export_trail(report: ProgressCallback, events: Sequence[AuditEvent], target: Path) -> Path:
    """Job: write events to a ``.csv`` file, or as a JSON list. Raises ConfigurationError if it cannot be written."""
    rows = [each.model_dump() for each in events]
    if target.suffix == ".csv":
        lines = [[*{**row, "values": json.dumps(row["values"], ensure_ascii=False)}.values()] for row in rows]
        content = "\ufeff" + for_csv([[*AuditEvent.model_fields], *lines])  # so that spreadsheets recognise UTF-8
    else:
        content = json.dumps(rows, indent=1, ensure_ascii=False) + "\n"
    try:
        write_atomic(target, content)
    except OSError as exc:
        raise ConfigurationError("result.unwritable", file=target, reason=os_reason(exc)) from exc
    report(1.0)
    return target
