"""Issues the report of a result: its date and revision, the record of issued reports, and the file."""

import hashlib
import json
from dataclasses import dataclass, replace
from datetime import UTC, date, datetime
from pathlib import Path

from calstation import __version__
from calstation.config import (
    Confirmation,
    ConfirmationRequired,
    Person,
    ReportSection,
    computer_user,
    confirm,
    confirmation_required,
    load_station,
    plain_text,
    site_folder,
)
from calstation.errors import InputError
from calstation.jobs import ProgressCallback
from calstation.messages import Language, os_reason
from calstation.records import (
    IssuedReport,
    Log,
    LogMeta,
    append_audit,
    append_report,
    open_log,
    read_reports,
    reports_locked,
    write_atomic,
)
from calstation.reports.analysis import analyse
from calstation.reports.content import Certificate, build_certificate, certificate_number, earliest_issue, performed
from calstation.reports.dcc import write_dcc
from calstation.reports.deviations import deviations
from calstation.reports.pdf import Attachment, templates, typeset
from calstation.reports.signing import load_signer, sign_pdf, sign_xml
from calstation.results import Result, find_log, load_result, resolve, run_files, stored_result

#: Fraction of the job's progress before the PDF is typeset.
_ANALYSED = 0.97


@dataclass(frozen=True)
class ReportRequest:
    """What a report is made of and how."""

    source: Path  #: Result JSON, or a log.
    out: Path  #: PDF to write.
    language: Language = "en"
    issued: date | None = None  #: Date of issue; None for the day of `earliest_issue`.
    received: date | None = None  #: Date of receipt of the unit; None for that of the last issue, if it had one.
    revise: str | None = None  #: Reason for a new revision.
    templates: Path | None = None  #: Folder of templates that take precedence over those of the site.
    dcc: Path | None = None  #: XML to write: the digital calibration certificate, which is also in the PDF.
    signing: Path | None = None  #: PKCS #12 file to sign both with; None for no signatures.
    first: Person | None = None  #: Who issues it; None for the computer's user.
    second: Person | None = None  #: Who confirms a new certificate, where the product requires it.

    def __post_init__(self) -> None:
        """Remove control characters from the reason."""
        if self.revise is not None:
            object.__setattr__(self, "revise", plain_text(self.revise))


def station_request(station: Path, section: ReportSection | None, result_file: Path) -> ReportRequest:
    """Return the request for the report of a result as the `[report]` section of a station file asks for it.

    Without a folder, the PDF is written to ``certificates`` beside the folder of the runs.
    """
    section, beside = section or ReportSection(), station.absolute().parent
    folder = (
        result_file.absolute().parent.parent / "certificates" if section.folder is None else _at(beside, section.folder)
    )
    return ReportRequest(
        result_file.absolute(),
        folder / f"{result_file.stem}.pdf",
        "zh_CN" if section.language == "zh" else "en",
        templates=None if section.template is None else _at(beside, section.template),
        signing=None if section.signing is None else _at(beside, section.signing.certificate),
    )


def issue_certificate(
    report: ProgressCallback, result_file: Path, station: Path | None, first: Person, second: Person | None
) -> Path:
    """Job: issue the report of a result as the station asks for it, and return the PDF.

    `first` issues it, `second` confirms it where the product requires it.

    Raises InputError or ConfigurationError.
    """
    path, config = load_station(station)
    request = replace(station_request(path, config.report, result_file), first=first, second=second)
    if config.report is None or config.report.folder is None:
        try:
            request.out.parent.mkdir(exist_ok=True)
        except OSError as exc:
            raise InputError("report.unwritable", file=request.out.parent, reason=os_reason(exc)) from exc
    issue_report(report, request)
    return request.out


def _at(folder: Path, name: str) -> Path:
    return folder / Path(name).expanduser()


def issue_report(report: ProgressCallback, request: ReportRequest) -> Certificate:
    """Job: record the report of a result or log in the audit trail and beside the log, then write it.

    The same result gives the same bytes in one language, unless they are signed. A certificate that was issued keeps
    its number, revision and date; another result, date or reason needs a revision. Raises InputError or
    ConfigurationError.
    """
    signer = None if request.signing is None else load_signer(request.signing)
    result, log = load_source(request.source)
    certificate, last, record = _numbered(result, log, request)
    people = None if record is None else _confirmed(result, log.meta, request)
    analysis = analyse(lambda done, remaining_s=None, note="": report(_ANALYSED * done, note=note), log, result)
    certificate = replace(certificate, budget=analysis.budget)
    dcc = write_dcc(certificate, deviations(certificate, analysis))
    dcc = dcc if signer is None else sign_xml(dcc, signer)
    digital = Attachment(f"{certificate.identification}.xml", "application/xml", dcc, "alternative")
    files = [digital, *attachments(certificate)]
    pdf = typeset(certificate, analysis, request.language, files, request.templates)
    written = {request.out: pdf if signer is None else sign_pdf(pdf, signer)}
    if request.dcc is not None:
        written[request.dcc] = dcc
    missing = {path: content for path, content in written.items() if not _is_written(path, content)}
    if record is not None and people is not None:
        _record(log.path.absolute().parent, certificate, last, record, people)
    for path, content in missing.items():
        _write(path, content)
    report(1.0)
    return certificate


def certificate_required(report: ProgressCallback, result_file: Path) -> ConfirmationRequired:
    """Job: return what issuing a certificate of a result requires. Raises InputError."""
    result, log = load_source(result_file)
    if not _has_product(log.meta):
        return ConfirmationRequired(pin=False, badge=False, second=False)
    return confirmation_required("certificate", *run_files(result, result_file, log.meta.profiles))


def _confirmed(result: Result, meta: LogMeta, request: ReportRequest) -> Confirmation:
    """Return who issues a certificate.

    Raises ConfigurationError if one or two people must prove their identity, or InputError if that is unknown.
    """
    first = request.first or Person(computer_user() or "-")
    if not _has_product(meta):
        return Confirmation(first.badge)
    return confirm("certificate", *run_files(result, request.source, meta.profiles), first, request.second)


def _has_product(meta: LogMeta) -> bool:
    """Whether a log is of a product; a recording of another program may be of none."""
    return meta.product is not None or bool(meta.profiles)


def attachments(certificate: Certificate) -> list[Attachment]:
    """Return the files embedded in the PDF of a certificate beside its digital form."""
    content = json.dumps(certificate.result.to_json(), indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    name = f"{certificate.identification}.json"
    return [Attachment(name, "application/json", content.encode(), "source")]


def load_source(path: Path) -> tuple[Result, Log]:
    """Read a result file and open its log, or open a log, which is solved if it has no result. Raises InputError."""
    if path.suffix == ".json":
        result = load_result(path)
        if not result.tested:
            raise InputError("report.untested", file=path)
        found = find_log(result, path)
        if found is None:
            raise InputError("report.no_log", file=path, log=result.log.file)
        log = open_log(found)
        if result.log.sha256 and log.facts().sha256 != result.log.sha256:
            raise InputError("report.other_log", file=path, log=found)
    else:
        log = open_log(path)
        result = stored_result(log) or resolve(path).result
    # The folder of the log is no part of the report.
    section = result.log.model_copy(update={"file": log.path.name})
    return result.model_copy(update={"log": section}), log


def _numbered(
    result: Result, log: Log, request: ReportRequest
) -> tuple[Certificate, IssuedReport | None, IssuedReport | None]:
    """Return the certificate with its revision and date, the last record of it, and its own if it is not yet issued."""
    number, digest = certificate_number(result), _digest(result, log.meta, request.templates)
    same = _issued(log.path.absolute().parent, number)
    last = same[-1] if same else None
    known = None if last is None else date.fromisoformat(last.issued)
    earliest = earliest_issue(result)
    if request.issued is not None and earliest is not None and request.issued < earliest:
        raise InputError("report.issued_too_early", date=request.issued.isoformat(), earliest=earliest.isoformat())
    begun = performed(result)
    if request.received is not None and begun is not None and request.received > begun[0].date():
        raise InputError("report.received_late", date=request.received.isoformat(), begun=begun[0].date().isoformat())
    if request.revise is not None and not request.revise.strip():
        raise InputError("report.no_reason")
    certificate = build_certificate(result, log.meta, issued=request.issued or known)
    if request.revise is None and last is not None:
        asked = None if request.issued is None else request.issued.isoformat()
        received = None if request.received is None else request.received.isoformat()
        for each, before in zip(reversed(same), [*reversed(same[:-1]), None], strict=True):
            if each.content_sha256 == digest and asked in (None, each.issued) and received in (None, each.received):
                return _revised(certificate, each, before), last, None
        raise InputError("report.already_issued", number=last.identification, date=last.issued)
    if request.revise is None:
        issued, reason, revision = certificate.issued, None, 0
    elif last is None:
        raise InputError("report.nothing_to_revise", number=number)
    else:
        # A revision is made today, not on the day of the run.
        today = datetime.now(UTC).date()
        issued = request.issued or max(today, earliest or today)
        reason, revision = request.revise.strip(), last.revision + 1
    received = last.received if last is not None else None
    if request.received is not None:
        received = request.received.isoformat()
    record = IssuedReport(number, revision, issued.isoformat(), reason, digest, __version__, received)
    return _revised(certificate, record, last), last, record


def _issued(folder: Path, number: str) -> list[IssuedReport]:
    return [each for each in read_reports(folder) if each.number == number]


def _record(
    folder: Path, certificate: Certificate, last: IssuedReport | None, record: IssuedReport, people: Confirmation
) -> None:
    """Write the issue of a certificate to the audit trail, then to the record of issued reports.

    Raises InputError if another program has issued the next revision since `last`, or ConfigurationError.
    """
    reason, result = record.reason or "", certificate.result
    about = {"serial": result.serial, "certificate": certificate.identification, "verdict": certificate.verdict}
    try:
        with reports_locked(folder):
            now = next(reversed(_issued(folder, record.number)), None)
            if now == record and record.reason is None:
                return  # the same first issue
            if now != last:
                raise InputError("report.issued_meanwhile", number=record.number)
            append_audit(site_folder(), "certificate", people.by, reason, confirmed_by=people.confirmed_by, **about)
            append_report(folder, record)
    except OSError as exc:
        raise InputError("report.unwritable", file=folder, reason=os_reason(exc)) from exc


def _revised(certificate: Certificate, record: IssuedReport, before: IssuedReport | None) -> Certificate:
    return replace(
        certificate,
        revision=record.revision,
        supersedes=None if before is None else f"{before.identification} ({before.issued})",
        reason=record.reason,
        issued=date.fromisoformat(record.issued),
        received=None if record.received is None else date.fromisoformat(record.received),
    )


def _digest(result: Result, meta: LogMeta, folder: Path | None) -> str:
    """Return the digest of all that a certificate is made of: result, configuration, program and templates."""
    content = json.dumps(result.to_json(), sort_keys=True) + meta.to_json() + __version__
    digest = hashlib.sha256(content.encode())
    for name, template in sorted(templates(folder).items()):
        digest.update(name.encode() + hashlib.sha256(template).digest())
    return digest.hexdigest()


def _is_written(path: Path, content: bytes) -> bool:
    """Whether a file exists with this content. Raises InputError if it has another one."""
    try:
        if not path.exists():
            return False
        if path.read_bytes() != content:
            raise InputError("report.exists", file=path)
    except OSError as exc:
        raise InputError("report.unwritable", file=path, reason=os_reason(exc)) from exc
    return True


def _write(path: Path, content: bytes) -> None:
    try:
        write_atomic(path, content)
    except OSError as exc:
        raise InputError("report.unwritable", file=path, reason=os_reason(exc)) from exc
