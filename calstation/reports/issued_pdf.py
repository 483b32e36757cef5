"""Issued certificates and their PDFs, which are compared with the digests in the audit trail of the site."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from calstation.config import StationConfig, load_station, site_folder
from calstation.jobs import ProgressCallback
from calstation.messages import Language, render
from calstation.records import AuditEvent, IssuedReport, issued_reports, site_events
from calstation.reports.request import station_request


@dataclass(frozen=True)
class IssuedPdf:
    """The PDF of an issued certificate, and the SHA-256 of all files of this certificate."""

    path: Path
    digests: frozenset[str]  #: Empty if the audit trail does not contain the issue, for example of another site.

    def intact(self) -> bool | None:
        """Return whether the file is one that was issued; None if it is unreadable or no digest was recorded."""
        try:
            digest = hashlib.sha256(self.path.read_bytes()).hexdigest()
        except OSError:
            return None
        return digest in self.digests if self.digests else None


def pdf_name(identification: str, language: Language) -> str:
    """Return the name of the PDF of a certificate in a language."""
    return f"{identification}{'_zh' if language == 'zh_CN' else ''}.pdf"


def find_pdfs(folder: Path, identifications: Sequence[str], languages: Sequence[Language]) -> list[IssuedPdf | None]:
    """Return a PDF in a folder for each certificate: a changed one, or else the one in the first available language.

    Raises InputError if the audit trail cannot be read.
    """
    events = [each.values for each in site_events(site_folder())]
    pdfs = []
    for identification in identifications:
        issues = [values for values in events if values.get("certificate") == identification]
        digests = frozenset(str(digest) for values in issues for digest in file_digests(values))
        paths = (folder / pdf_name(identification, code) for code in languages)
        existing = [IssuedPdf(path, digests) for path in paths if path.is_file()]
        changed = next((pdf for pdf in existing if pdf.intact() is False), None)
        pdfs.append(changed or next(iter(existing), None))
    return pdfs


def file_digests(values: Mapping[str, object]) -> list[object]:
    """Return the SHA-256 of the files in an event of the audit trail, including embedded files."""
    parts = (values.get(name) for name in ("files", "embedded"))
    return [digest for part in parts if isinstance(part, dict) for digest in part.values()]


@dataclass(frozen=True)
class IssuedCertificate:
    """A certificate that was issued, and its PDF, or None if the file is not in the folder of certificates."""

    report: IssuedReport
    pdf: IssuedPdf | None
    intact: bool | None = None  #: As `IssuedPdf.intact`; None without a PDF.
    #: Names of the persons who issued it, from the report or the audit trail; names not confirmed by a PIN say so.
    people: tuple[str, ...] = ()
    released_since: bool = False  #: Whether the unit was released after its issue, according to the audit trail.


def issued_certificates(
    report: ProgressCallback, log: Path, station: Path | None, language: Language
) -> list[IssuedCertificate]:
    """Job: return the certificates of a run, the oldest first, each with a changed PDF, or else the one in `language`.

    If there is neither, the PDF in the other language is returned. Certificates are found by their number, the name of
    the log, and thus also if the files of the run are missing. Raises InputError or ConfigurationError.
    """
    path, config = load_station(station)
    folder = station_request(path, config.report, log, language).out
    issued = issued_reports(log.absolute().parent, site_events(site_folder()), log.stem)
    languages: tuple[Language, ...] = (language, "zh_CN" if language == "en" else "en")
    pdfs = find_pdfs(folder, [each.identification for each in issued], languages)
    people, released = _issuers(config, language), _issued_before_release()
    return [
        IssuedCertificate(
            each,
            pdf,
            None if pdf is None else pdf.intact(),
            each.authorised or people.get((each.identification, each.content_sha256), ()),
            (each.identification, each.content_sha256) in released,
        )
        for each, pdf in zip(issued, pdfs, strict=True)
    ]


def _issued_before_release() -> set[tuple[object, object]]:
    """Return number and digest of the certificates that were issued before the unit of the run was released."""
    open_, released = dict[object, set[tuple[object, object]]](), set[tuple[object, object]]()
    for event in site_events(site_folder()):
        log = event.values.get("log_sha256")
        if event.event == "certificate":
            identity = event.values.get("certificate"), event.values.get("content_sha256")
            open_.setdefault(log, set()).add(identity)
        elif event.event == "override":
            released |= open_.pop(log, set())
    return released


def _issuers(station: StationConfig, language: Language) -> dict[tuple[object, object], tuple[str, ...]]:
    """Return who issued the certificates of the site by number and digest; older events have badges without names."""

    def shown(event: AuditEvent, badge: str) -> str:
        name = station.person(badge)
        return render("common.unproven", {"name": name}, language).sentences if event.unproven else name

    return {
        (event.values.get("certificate"), event.values.get("content_sha256")): tuple(
            shown(event, badge) for badge in (event.by, event.confirmed_by) if badge
        )
        for event in site_events(site_folder())
        if event.event == "certificate"
    }
