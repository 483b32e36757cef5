"""Verification of the files of a certificate with the audit trail of the site."""

import hashlib
from dataclasses import dataclass
from pathlib import Path

from calstation.config import site_folder
from calstation.errors import InputError
from calstation.messages import Text, os_reason
from calstation.records import (
    find_heads,
    held_faults,
    held_heads,
    public_key,
    report_faults,
    reports_of_others,
    site_events,
    site_trails,
    verify_trail,
)
from calstation.reports.issued_pdf import file_digests


@dataclass(frozen=True)
class CertificateState:
    """What the verification of a file of a certificate has found."""

    found: tuple[Text, ...]
    intact: bool  #: Whether nothing contradicts the file.


def verify_certificate(path: Path) -> CertificateState:
    """Compare a PDF, a digital certificate or a validation with the audit trail of the site, which issued it.

    Raises InputError if a file cannot be read.
    """
    try:
        content = path.read_bytes()
    except OSError as exc:
        raise InputError("result.unreadable", file=path, reason=os_reason(exc)) from exc
    state = verify_trail(site_folder(), every_signature=True)
    found, intact = list(state.faults), not state.faults
    digest = hashlib.sha256(content).hexdigest()
    events = [each.values for each in site_events(site_folder()) if digest in file_digests(each.values)]
    numbers = [values["certificate"] if "certificate" in values else values["validation"] for values in events]
    if numbers:
        found.append(Text.of("audit.file_recorded", file=path, certificate=str(numbers[-1])))
    else:
        intact = False
        found.append(Text.of("audit.file_unknown", file=path))
    trails = {public_key(trail) or "": (file, trail) for file, trail in reversed(site_trails(site_folder()))}
    heads = find_heads(content)
    for head in heads:
        values = {"line": head.lines, "digest": head.digest}
        file, trail = trails.get(head.key) or (state.path, state.trail)
        if head.key and head.key not in trails:
            found.append(Text.of("audit.other_trail", key=head.key, **values))
        elif not trail.contains(head.lines, head.digest):
            intact = False
            found.append(Text.of("audit.contradicts", file=file, witness=path, **values))
        else:
            found.append(Text.of("audit.agrees", witness=path, **values))
    if not heads:
        found.append(Text.of("audit.no_head", file=path))
    return CertificateState(tuple(found), intact)


def verify_reports(folder: Path) -> CertificateState:
    """Verify the record of issued reports in a folder of runs, and the audit trail of the site with both its witnesses.

    They are this record, and the heads that the shared database has. Raises InputError if a file cannot be read.
    """
    state = verify_trail(site_folder(), every_signature=True)
    held = held_heads(folder)
    faults = (*state.faults, *held_faults(state, held), *report_faults(folder, state))
    if faults:
        return CertificateState(faults, intact=False)
    found = [Text.of("report.record_intact", folder=folder)]
    others = reports_of_others(folder, state)
    if others:
        found.append(Text.of("report.of_others", count=others))
    own = [each.head for each in held if each.head.key == state.public_key]
    found += [Text.of("audit.database_agrees", line=head.lines, digest=head.digest) for head in own]
    if not own:
        found.append(Text.of("audit.no_database"))
    return CertificateState(tuple(found), intact=True)
