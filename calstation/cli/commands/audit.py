"""`audit`: lists, filters and verifies the audit trail of the site."""

from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import Annotated, Any

import typer

from calstation.cli.confirmation import ask_person
from calstation.cli.options import ByOption, JsonOption, check_choice, command_group
from calstation.cli.show import emit, ignore_progress
from calstation.cli.text import LANGUAGE, say, sentence
from calstation.config import (
    SiteTrail,
    TrailLine,
    access,
    computer_user,
    read_trail_copy,
    restart_site_trail,
    site_folder,
    trail_values,
)
from calstation.errors import ConfigurationError, InputError
from calstation.messages import local_time
from calstation.records import AUDIT_EVENTS, AuditEvent, audit_path
from calstation.reports import CertificateState, read_verified_trail, stamp_trail, verify_time_stamp
from calstation.results import check_runs
from calstation.validation import validation_due

app = command_group()


@app.command()
def audit(
    event: str | None = None,
    by: ByOption = None,
    since: Annotated[str | None, typer.Option(metavar="YYYY-MM-DD")] = None,
    file: Path | None = None,
    restart: Annotated[str | None, typer.Option(metavar="REASON")] = None,
    timestamp: Annotated[str | None, typer.Option(metavar="URL")] = None,
    json: JsonOption = None,
) -> int:
    """List the events of an audit trail, filtered by event, person and first day (UTC); or restart or time-stamp it.

    The default is the audit trail of the site. Returns the exit code of an input error unless everything was verified.
    Raises InputError if `file` is missing, or ConfigurationError for an unknown event.
    """
    try:
        first = "" if since is None else date.fromisoformat(since).isoformat()
    except ValueError as exc:
        raise ConfigurationError("cli.not_a_date", option="--since", value=since, program="calstation audit") from exc
    if restart is not None:
        person = ask_person(by or computer_user() or "", pin=access.has_pin(), reason=restart)
        restarted = restart_site_trail(restart, person)
        emit(restarted.model_dump(), json, [_line(restarted)])
        return 0
    if timestamp is not None:
        stamp = stamp_trail(timestamp)
        return show_evidence(stamp, verify_time_stamp(stamp), json)
    path, site = _read(file)
    names = dict.fromkeys((*AUDIT_EVENTS, *(e.event for e in site.trail.entries)))  # includes events of later versions
    check_choice("--event", event, tuple(names))
    lines = site.select(event, by, first)
    events = [each.event for each in lines if each.event is not None]
    emit(_row(path, site, events), json, [*map(_marked_line, lines), *_verified(site)])
    return _exit_code(site)


def _exit_code(site: SiteTrail) -> int:
    """Return 0 only if everything was verified; a missing file is not evidence."""
    return InputError.exit_code if site.faults or site.cautions else 0


def show_evidence(file: Path, state: CertificateState, json: str | None) -> int:
    """Show the findings of a file's verification; return 2, as for bad input, unless everything was verified."""
    lines = [say(each.code, **each.values) for each in state.findings]
    emit({"file": str(file), "kind": "evidence", "intact": state.intact, "found": lines}, json, lines)
    return InputError.exit_code if not state.intact or state.cautions else 0


def check_audit(file: Path | None, json: str | None) -> int:
    """Verify an audit trail, by default that of the site; return 2, as for bad input, unless everything was verified.

    Raises InputError if `file` is missing.
    """
    path, site = _read(file, unindexed=False)
    if file is None:
        faults, gaps = check_runs(Path("runs"))
        faults = [each for each in faults if each not in site.faults]
        # a gap is no fault, because the run may have been done at another station
        site = replace(site, state=(*site.state, *faults, *gaps), faults=(*site.faults, *faults))
    due = validation_due() if file is None else None
    row = {**_row(path, site, []), **({"validation_due": sentence(due)} if due is not None else {})}
    emit(row, json, [*_verified(site), *([sentence(due)] if due is not None else [])])
    return _exit_code(site)


def _read(file: Path | None, *, unindexed: bool = True) -> tuple[Path, SiteTrail]:
    if file is None:
        return audit_path(site_folder()), read_verified_trail(ignore_progress, None, Path("runs"), unindexed=unindexed)
    if not file.exists():
        raise InputError("audit.not_found", file=file)
    return file, read_trail_copy(file)


def _row(path: Path, site: SiteTrail, events: list[AuditEvent]) -> dict[str, Any]:
    trail = site.trail
    return {
        **{"file": str(path), "kind": "audit", "lines": len(trail.entries), "interrupted": list(trail.incomplete)},
        **{"first_bad": trail.damage and trail.damage.number, "digest": trail.head[1], "intact": site.intact},
        "found": _verified(site),
        "events": [each.model_dump() for each in events],
    }


def _verified(site: SiteTrail) -> list[str]:
    return [say(each.code, **each.values) for each in site.state]


def _marked_line(line: TrailLine) -> str:
    """Return a line of a trail as text, with a mark from the first damaged line on."""
    text = line.text if line.event is None else _line(line.event)
    return text if line.state == "proved" else say(f"cli.audit_line_{line.state}", line=line.number, text=text)


def _line(each: AuditEvent) -> str:
    people = say("common.unproven", name=each.by) if each.unproven else each.by or "-"
    if each.confirmed_by:
        people = say("cli.confirmed_by", by=people, second=each.confirmed_by)
    values = say("common.comma").join(trail_values(each.values, LANGUAGE, brief=True))
    why = f'"{each.why}"' if each.why else ""
    return " ".join(part for part in (local_time(each.utc, zone=True), each.event, f"({people})", why, values) if part)
