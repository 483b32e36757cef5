"""`audit`: lists, filters and verifies the audit trail of the site."""

from datetime import date
from pathlib import Path
from typing import Annotated, Any

import typer

from calstation.cli.options import JsonOption, check_choice, command_group
from calstation.cli.show import emit
from calstation.cli.text import say
from calstation.config import site_folder, verification
from calstation.errors import ConfigurationError, InputError
from calstation.messages import local_time
from calstation.records import AUDIT_EVENTS, AuditEvent, AuditTrail, audit_path, read_audit, select_audit

app = command_group()


@app.command()
def audit(
    event: str | None = None,
    by: str | None = None,
    since: Annotated[str | None, typer.Option(metavar="YYYY-MM-DD")] = None,
    file: Path | None = None,
    json: JsonOption = None,
) -> int:
    """List the events of an audit trail, filtered by event, person and first day (UTC).

    The default is the audit trail of the site. Returns the exit code of an input error if the trail was changed.
    Raises InputError if `file` is missing, or ConfigurationError for an unknown event.
    """
    try:
        first = "" if since is None else date.fromisoformat(since).isoformat()
    except ValueError as exc:
        raise ConfigurationError("cli.not_a_date", option="--since", value=since, program="calstation audit") from exc
    path, trail = _read(file)
    names = dict.fromkeys((*AUDIT_EVENTS, *(each.event for each in trail.entries)))  # includes events of later versions
    check_choice("--event", event, tuple(names))
    events = select_audit(trail.entries, event, by, first)
    emit(_row(path, trail, events), json, [*map(_line, events), *_verified(path, trail)])
    return 0 if trail.damage is None else InputError.exit_code


def check_audit(file: Path | None, json: str | None) -> int:
    """Verify an audit trail, by default that of the site; return the exit code of an input error if it was changed.

    Raises InputError if `file` is missing.
    """
    path, trail = _read(file)
    emit(_row(path, trail, []), json, _verified(path, trail))
    return 0 if trail.damage is None else InputError.exit_code


def _read(file: Path | None) -> tuple[Path, AuditTrail]:
    if file is not None and not file.exists():
        raise InputError("audit.not_found", file=file)
    path = file or audit_path(site_folder())
    return path, read_audit(path)


def _row(path: Path, trail: AuditTrail, events: list[AuditEvent]) -> dict[str, Any]:
    return {
        **{"file": str(path), "kind": "audit", "lines": len(trail.entries), "interrupted": list(trail.incomplete)},
        **{"first_bad": trail.damage and trail.damage.number, "digest": trail.digest},
        "events": [each.model_dump() for each in events],
    }


def _verified(path: Path, trail: AuditTrail) -> list[str]:
    return [say(each.code, **each.values) for each in verification(path, trail)]


def _line(each: AuditEvent) -> str:
    people = each.by or "-"
    if each.confirmed_by:
        people = say("cli.confirmed_by", by=people, second=each.confirmed_by)
    values = " ".join(f"{name}={value}" for name, value in each.values.items() if name != "sha256")
    why = f'"{each.why}"' if each.why else ""
    return " ".join(part for part in (local_time(each.utc, zone=True), each.event, f"({people})", why, values) if part)
