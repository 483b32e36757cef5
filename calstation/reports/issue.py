"""Issue of a report: its date and revision, the record of issued reports, and the files."""

import hashlib
import json
import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import UTC, date, datetime
from pathlib import Path
from typing import Any, Literal

from calstation import __version__
from calstation.config import (
    Action,
    Confirmation,
    ConfirmationRequired,
    Person,
    ProductConfig,
    StationConfig,
    confirm,
    confirmation_required,
    load_station,
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
    audit_values,
    audit_writer,
    complete_reports,
    intact_trail,
    issued_reports,
    report_file,
    reports_head,
    site_events,
    verify_trail,
)
from calstation.registers import run_registers
from calstation.reports.analysis import analyse
from calstation.reports.content import Certificate, build_certificate, certificate_number, earliest_issue, performed
from calstation.reports.dcc import write_dcc
from calstation.reports.deviations import deviations
from calstation.reports.issued_pdf import IssuedPdf, find_pdfs, pdf_name
from calstation.reports.pdf import Attachment, typeset, used_templates
from calstation.reports.request import ReportRequest, default_report_folder, station_request
from calstation.reports.signing import load_signer, sign_pdf, sign_xml
from calstation.reports.source import load_source, read_source
from calstation.results import Result, run_files

#: Progress of the job, as a fraction, before the samples are analysed and before the PDF is typeset.
_READ, _ANALYSED = 0.1, 0.97


#: What has changed since the last certificate was issued: the unit was released, the program was updated, the result or
#: the templates were changed, or a certificate with the same number was issued for a copy of the log.
Change = Literal["released", "program", "content", "copy"]


@dataclass(frozen=True)
class IssueState:
    """Settings of a station for the certificate of a result, and the last certificate issued for this result.

    last : last certificate with the same number; None if there is none, or if the number is unknown before the log is
        solved
    changes : what has changed since `last`, which therefore cannot be printed again
    pdf : PDF of the last certificate in the language of the request; None if it is missing
    simulated : whether the run was simulated, but the station has hardware
    """

    request: ReportRequest
    required: ConfirmationRequired
    last: IssuedReport | None = None
    changes: tuple[Change, ...] = ()
    pdf: IssuedPdf | None = None
    simulated: bool = False


def issue_state(report: ProgressCallback, result_file: Path, station: Path | None, language: Language) -> IssueState:
    """Job: return how a station issues the certificate of a result, and the last certificate issued for it.

    `language` is used for certificates if the station file does not specify a language. Raises InputError or
    ConfigurationError.
    """
    path, config = load_station(station)
    request = station_request(path, config.report, result_file, language)
    result, log = read_source(request.source)
    files = _files(log.meta, request.source)
    issued = [] if result is None else _find_issued(log, certificate_number(result))
    required = ConfirmationRequired(pin=False, badge=False, second=False)
    if files is not None:
        required = confirmation_required("revision" if issued else "certificate", *files)
    if not issued:
        return IssueState(request, required, simulated=log.meta.is_simulated and config.bench is None)
    result, log = load_source(report, request.source)
    changes = _changes(result, log.meta, request.templates, issued)
    (pdf,) = find_pdfs(request.out, [issued[-1].identification], [request.language])
    return IssueState(request, required, issued[-1], changes, pdf)


def states_of_issue(
    report: ProgressCallback, result_files: Sequence[Path], station: Path | None, language: Language
) -> list[IssueState]:
    """Job: return how a station issues the certificates of several results; see `issue_state`."""
    states = []
    for number, result_file in enumerate(result_files):
        report(number / len(result_files))
        states.append(issue_state(lambda *_, **__: None, result_file, station, language))
    return states


def issue_certificate(report: ProgressCallback, request: ReportRequest) -> Path:
    """Job: issue a report to the folder of the request, and return the PDF. Raises InputError or ConfigurationError.

    The folder ``certificates`` next to the runs is created if it is missing.
    """
    if request.out == default_report_folder(request.source.parent):
        certificate_folder(request.out)
    elif not request.out.is_dir():
        raise InputError("report.no_folder", folder=request.out)
    return issue_report(report, request)[1]


def certificate_folder(folder: Path) -> None:
    """Create a folder for certificates if it is missing. Raises InputError if it cannot be created, or is a file."""
    try:
        folder.mkdir(exist_ok=True)
    except FileExistsError as exc:
        raise InputError("report.not_a_folder", folder=folder) from exc
    except OSError as exc:
        raise InputError("report.unwritable", file=folder, reason=os_reason(exc)) from exc


def issue_certificates(report: ProgressCallback, requests: Sequence[ReportRequest]) -> list[Path]:
    """Job: issue several reports one after another, and return their PDFs; see `issue_certificate`.

    After an error, the reports before it remain issued.
    """
    share = 1.0 / len(requests)
    return [
        issue_certificate(_part_of(report, number * share, share), request) for number, request in enumerate(requests)
    ]


def _part_of(report: ProgressCallback, start: float, share: float) -> ProgressCallback:
    """Return a callback for a part of a job; `start` and `share` are fractions of the whole job."""
    return lambda done, *_, note="": report(start + share * done, note=note)


def issue_report(report: ProgressCallback, request: ReportRequest) -> tuple[Certificate, Path]:
    """Job: record the issue of a report in the audit trail and next to the log, then write the report.

    Returns the certificate and its PDF. In one language, the same result yields identical bytes, unless they are
    signed. An issued certificate keeps its number, revision, date and statement of a later write of the registers; a
    different result, date or reason requires a revision. Raises InputError or ConfigurationError.
    """
    signer = None if request.signing is None else load_signer(request.signing)
    result, log = load_source(lambda done, *_, note="": report(_READ * done, note=note), request.source)
    certificate, before, record = _number_certificate(result, log, request)
    people, names = _confirm_issue(log.meta, request, reprint=record is None)
    if record is not None:
        record = replace(record, trail=intact_trail(site_folder(), log.path.absolute().parent).head)
        registers = run_registers(result, log.path.absolute().parent)
        later = None if registers is None else registers.later
        record = replace(record, rewritten=None if later is None else later.utc)
        certificate = replace(certificate, trail=record.trail, rewritten=record.rewritten)
        record, certificate = replace(record, authorised=names), replace(certificate, authorised=names)
    share = _ANALYSED - _READ
    analysis = analyse(lambda done, *_, note="": report(_READ + share * done, note=note), log, result)
    certificate = replace(certificate, budget=analysis.budget, temperature=analysis.temperature)
    dcc = write_dcc(certificate, deviations(certificate, analysis))
    dcc = dcc if signer is None else sign_xml(dcc, signer)
    digital = Attachment(f"{certificate.identification}.xml", "application/xml", dcc, "alternative")
    embedded = [digital, *attachments(certificate)]
    embedded_xml = _digests({Path(digital.name): dcc})
    pdf = typeset(certificate, analysis, request.language, embedded, request.templates)
    out = request.out
    if out.is_dir():
        out = out / pdf_name(certificate.identification, request.language)
    written = {out: pdf if signer is None else sign_pdf(pdf, signer)}
    if request.dcc is not None:
        written[request.dcc] = dcc
    unwritten = {path: content for path, content in written.items() if not _is_written(path, content)}
    if record is not None:
        _record(log, certificate, before, record, people, files=_digests(written), embedded=embedded_xml)
    elif unwritten:
        values: dict[str, Any] = {"certificate": certificate.identification, "pin": people.pin}
        values |= {"confirmed_by": people.confirmed_by, "files": _digests(unwritten), "embedded": embedded_xml}
        append_audit(site_folder(), "certificate_printed", people.by, **values)
    for path, content in unwritten.items():
        _write(path, content)
    report(1.0)
    return certificate, out


def _digests(files: Mapping[Path, bytes]) -> dict[str, str]:
    """Return the SHA-256 of files by name."""
    return {path.name: hashlib.sha256(content).hexdigest() for path, content in files.items()}


def _confirm_issue(meta: LogMeta, request: ReportRequest, *, reprint: bool) -> tuple[Confirmation, tuple[str, ...]]:
    """Return the persons who issue a certificate or print it again, and the names of those who entered their own PINs.

    Raises ConfigurationError if a required confirmation is missing, or InputError if the requirement is unknown.
    """
    files = _files(meta, request.source)
    if files is None:
        return Confirmation("" if request.first is None else request.first.badge), ()
    product, station = files
    action: Action = "reprint" if reprint else "certificate" if request.revise is None else "revision"
    if request.first is None and not confirmation_required(action, product, station).pin:
        return Confirmation(""), ()
    confirmation = confirm(action, product, station, request.first or Person(""), request.second)
    people = (confirmation.by, confirmation.confirmed_by) if confirmation.pin == "personal" else ()
    return confirmation, tuple(filter(None, people))


def _files(meta: LogMeta, path: Path) -> tuple[ProductConfig, StationConfig] | None:
    """Return the product and the station of a log, or None for a recording of another program."""
    if meta.product is None and not meta.profiles:
        return None
    return run_files((meta.run.files if meta.run is not None else None) or {}, path, meta.profiles)


def attachments(certificate: Certificate) -> list[Attachment]:
    """Return the files that are embedded in the PDF of a certificate in addition to the digital certificate."""
    content = json.dumps(certificate.result.to_json(), indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    name = f"{certificate.identification}.json"
    return [Attachment(name, "application/json", content.encode(), "source")]


def _number_certificate(
    result: Result, log: Log, request: ReportRequest
) -> tuple[Certificate, list[IssuedReport], IssuedReport | None]:
    """Return the numbered certificate, the records with its number, and the record of a new issue or None."""
    _check_dates(result, request)
    number, digest = certificate_number(result), _digest(result.to_json(), log.meta, request.templates)
    earlier = _find_issued(log, number)
    last = earlier[-1] if earlier else None
    last_date = None if last is None else date.fromisoformat(last.issued)
    certificate = build_certificate(result, log.meta, issued=request.issued or last_date)
    if request.revise is None and last is not None:
        issued, received = (None if day is None else day.isoformat() for day in (request.issued, request.received))
        reprinted = _find_reprint(earlier, digest, issued, received)
        if reprinted is not None:
            return _with_record(certificate, reprinted, earlier), earlier, None
        if any(_is_same(each, digest, issued, received) for each in earlier if each.revision < last.revision):
            values = {"number": number, "successor": last.identification, "date": last.issued, "why": last.reason or ""}
            raise InputError("report.superseded", **values)
        raise InputError("report.already_issued", number=last.identification, date=last.issued)
    if request.revise is None:
        issue_date, reason, revision = certificate.issued, None, 0
    elif last is None:
        raise InputError("report.nothing_to_revise", number=number)
    else:
        # a revision is issued today, not on the day of the run
        issue_date = request.issued or max(_today(), earliest_issue(result) or _today())
        reason, revision = request.revise.strip(), last.revision + 1
    received = last.received if last is not None else None
    if request.received is not None:
        received = request.received.isoformat()
    record = IssuedReport(number, revision, issue_date.isoformat(), reason, digest, __version__, received)
    return _with_record(certificate, record, earlier), earlier, record


def _check_dates(result: Result, request: ReportRequest) -> None:
    """Raise InputError for an impossible date of issue or receipt, or a revision without a reason."""
    earliest, today = earliest_issue(result), _today()
    if request.issued is not None and earliest is not None and request.issued < earliest:
        raise InputError("report.issued_too_early", date=request.issued.isoformat(), earliest=earliest.isoformat())
    if request.issued is not None and request.issued > today:
        raise InputError("report.issued_in_future", date=request.issued.isoformat(), today=today.isoformat())
    period = performed(result)
    if request.received is not None and period is not None and request.received > period[0].date():
        raise InputError("report.received_late", date=request.received.isoformat(), begun=period[0].date().isoformat())
    if request.revise is not None and not request.revise.strip():
        raise InputError("report.no_reason")


def _today() -> date:
    return datetime.now(UTC).date()


def _find_issued(log: Log, number: str) -> list[IssuedReport]:
    """Return the records with a number next to the log and in the audit trail of the site; see `issued_reports`."""
    return issued_reports(log.path.absolute().parent, site_events(site_folder()), number)


def _find_reprint(
    records: list[IssuedReport], digest: str, issued: str | None = None, received: str | None = None
) -> IssuedReport | None:
    """Return the record of the last revision if its content and dates are the same, otherwise None.

    A superseded certificate is never printed again, because it could be mistaken for a valid certificate. The same
    applies if a copy of the log has a different certificate with the same revision.
    """
    latest = [each for each in records if each.revision == records[-1].revision]
    return latest[0] if len(latest) == 1 and _is_same(latest[0], digest, issued, received) else None


def _changes(result: Result, meta: LogMeta, templates: Path | None, records: list[IssuedReport]) -> tuple[Change, ...]:
    """Return what has changed since the last of `records`, or () if its certificate can be printed again."""
    content, last = result.to_json(), records[-1]
    if _find_reprint(records, _digest(content, meta, templates)) is not None:
        return ()
    program: tuple[Change, ...] = () if last.software == __version__ else ("program",)
    if _digest(content, meta, templates, last.software) == last.content_sha256:
        return program or ("copy",)
    without_release = {key: value for key, value in content.items() if key != "override"}
    released = _digest(without_release, meta, templates, last.software) == last.content_sha256
    return ("released" if released else "content", *program)


def _is_same(each: IssuedReport, digest: str, issued: str | None, received: str | None) -> bool:
    return each.content_sha256 == digest and issued in (None, each.issued) and received in (None, each.received)


def _record(
    log: Log,
    certificate: Certificate,
    before: list[IssuedReport],
    record: IssuedReport,
    people: Confirmation,
    **digests: Mapping[str, str],
) -> None:
    """Write the issue of a certificate to the audit trail, then to the record of issued reports.

    Parameters
    ----------
    log, certificate : log and content of the certificate
    before : earlier reports with its number
    record : the new report
    people : persons who issue and confirm it
    digests : SHA-256 by name of its ``files``, and of the XML that is ``embedded`` in its PDF

    Raises
    ------
    InputError : if another program has issued the same or the next revision since `before` was read.
    ConfigurationError : if the audit trail or the record was changed, or cannot be written.
    """
    folder, result = log.path.absolute().parent, certificate.result
    values: dict[str, Any] = {"serial": result.serial, "certificate": certificate.identification}
    values |= {"verdict": certificate.verdict, **({"simulated": True} if log.meta.is_simulated else {})}
    values |= {"log_sha256": result.log.sha256, **audit_values(record)}
    try:
        with report_file(folder).locked():
            with audit_writer(site_folder()) as audit:
                complete_reports(folder, intact_trail(site_folder(), folder))
                current = issued_reports(folder, site_events(site_folder()), record.number)
                if current == [record] and not before:
                    return  # another process has recorded the same first issue
                if current != before:
                    raise InputError("report.issued_meanwhile", number=record.number)
                audit.append_event(
                    "certificate",
                    people.by,
                    record.reason or "",
                    confirmed_by=people.confirmed_by,
                    pin=people.pin,
                    reports=reports_head(folder),
                    **digests,
                    **values,
                )
            complete_reports(folder, verify_trail(site_folder()))
    except OSError as exc:
        raise InputError("report.unwritable", file=folder, reason=os_reason(exc)) from exc


def _with_record(certificate: Certificate, record: IssuedReport, records: list[IssuedReport]) -> Certificate:
    """Return a certificate with the revision, dates and persons of its record; `records` are all with its number."""
    before = next((each for each in reversed(records) if each.revision < record.revision), None)
    return replace(
        certificate,
        revision=record.revision,
        supersedes=None if before is None else f"{before.identification} ({before.issued})",
        reason=record.reason,
        issued=date.fromisoformat(record.issued),
        received=None if record.received is None else date.fromisoformat(record.received),
        authorised=record.authorised,
        trail=record.trail,
        rewritten=record.rewritten,
    )


def _digest(content: Mapping[str, Any], meta: LogMeta, folder: Path | None, version: str | None = None) -> str:
    """Return the digest of the sources of a certificate: result, configuration, program and templates.

    `version` is the version of the program, by default the current one.
    """
    digest = hashlib.sha256((json.dumps(content, sort_keys=True) + meta.to_json() + (version or __version__)).encode())
    for name, template in sorted(used_templates(folder).items()):
        digest.update(name.encode() + hashlib.sha256(template).digest())
    return digest.hexdigest()


def _is_written(path: Path, content: bytes) -> bool:
    """Return whether a file exists with this content. Raises InputError if it has different content."""
    try:
        if not path.exists():
            return False
        if path.read_bytes() != content:
            raise InputError("report.exists", file=path)
    except OSError as exc:
        raise InputError("report.unwritable", file=path, reason=os_reason(exc)) from exc
    return True


def _write(path: Path, content: bytes) -> None:
    """Create a file. Raises InputError, for example if another program has created it in the meantime."""
    try:
        with path.open("xb") as stream:
            try:
                stream.write(content)
                stream.flush()
                os.fsync(stream.fileno())
            except BaseException:
                with suppress(OSError):
                    path.unlink()
                raise
    except FileExistsError as exc:
        raise InputError("report.exists", file=path) from exc
    except OSError as exc:
        raise InputError("report.unwritable", file=path, reason=os_reason(exc)) from exc
