"""Verification of the files of a certificate with the audit trail of the site."""

import hashlib
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

from calstation.config import SiteTrail, library, load_station, read_site_trail, site_folder, versions
from calstation.errors import ConfigurationError, InputError
from calstation.jobs import ProgressCallback
from calstation.messages import Text, os_reason
from calstation.records import (
    LATEST_FIRST,
    SUFFIX,
    RunFilter,
    database_contradictions,
    database_heads,
    find_heads,
    public_key,
    recorded_folders,
    report_faults,
    report_file,
    reports_of_others,
    site_events,
    site_trails,
    unrecorded_reports,
    verify_trail,
)
from calstation.reports.issued_pdf import file_digests
from calstation.reports.request import default_report_folder, report_folder
from calstation.results import History, check_runs, load_confirmed_result

#: Maximum number of missing files that are named.
_MAX_NAMES = 5

#: End of the name of a run's log, which is the number of its certificate; the names of other logs end differently.
_RUN_LOG = re.compile(r"_\d{8}T\d{12}$")


@dataclass(frozen=True)
class CertificateState:
    """Result of the verification of a file of a certificate."""

    findings: tuple[Text, ...]
    intact: bool  #: Whether nothing contradicts the file.
    cautions: tuple[Text, ...] = ()  #: The `findings` that state what could not be verified.


def verify_certificate(path: Path) -> CertificateState:
    """Compare a PDF, a digital certificate or a validation with the audit trail of the site that issued it.

    Raises InputError if a file cannot be read.
    """
    content = _content_of(path)
    state = verify_trail(site_folder(), every_signature=True)
    findings, intact = list(state.faults), not state.faults
    digest = hashlib.sha256(content).hexdigest()
    events = [each.values for each in site_events(site_folder()) if digest in file_digests(each.values)]
    numbers = [values["certificate"] if "certificate" in values else values["validation"] for values in events]
    if numbers:
        findings.append(Text.of("audit.file_recorded", file=path, certificate=str(numbers[-1])))
    else:
        intact = False
        findings.append(Text.of("audit.file_unknown", file=path))
    trails = {public_key(trail) or "": (file, trail) for file, trail in reversed(site_trails(site_folder()))}
    heads = find_heads(content)
    for head in heads:
        values = {"line": head.lines, "digest": head.digest}
        file, trail = trails.get(head.key) or (state.path, state.trail)
        if head.key and head.key not in trails:
            findings.append(Text.of("audit.other_trail", key=head.key, **values))
        elif not trail.contains(head.lines, head.digest):
            intact = False
            findings.append(Text.of("audit.contradicts", file=file, witness=path, **values))
        else:
            findings.append(Text.of("audit.agrees", witness=path, **values))
    if not heads:
        findings.append(Text.of("audit.no_head", file=path))
    return CertificateState(tuple(findings), intact)


def read_verified_trail(
    report: ProgressCallback, station: Path | None, runs: Path, *, unindexed: bool = True
) -> SiteTrail:
    """Job: read and verify the audit trail of the site, and compare it with the files of the site and of certificates.

    The files of certificates are sought in the report folders of the station and of all stations in the library, in
    the default report folders of `runs` and of the runs of the certificates, and in the folders of these runs. The
    records of issued reports are those in `runs` and in the other folders that the trail names, unless such a folder
    was archived. The files of the site are compared with their last version in the trail. Without `unindexed`, runs
    that have no index are not compared with their logs. Raises InputError if a file cannot be read.
    """
    site = read_site_trail(lambda *_, **__: None)
    folders = [*_report_folders(station), default_report_folder(runs.absolute())]
    issued, successors = list(_issued_files(folders)), _successors()
    intact, missing, faults = 0, [], list(site.faults)
    for number, (certificate, name, digests, locations) in enumerate(issued, 1):
        file = next((each / name for each in locations if (each / name).is_file()), None)
        if file is None:
            missing.append(name)
        elif _digest_of(file) in digests:
            intact += 1
        else:
            successor = successors.get(certificate, certificate)
            code = "audit.file_changed" if successor == certificate else "audit.replaced_file_changed"
            faults.append(Text.of(code, file=file, certificate=certificate, successor=successor))
        report(0.5 * number / len(issued))
    cautions = [Text.of("audit.files_missing", count=len(missing), names=_first(missing))] if missing else []
    outside = [] if site.faults else versions.changed_outside(site_events(site_folder()))
    cautions += [Text.of("audit.changed_outside", count=len(outside), names=_first(outside))] if outside else []
    # the last location of a certificate is the folder of its runs, where other files need not be certificates
    searched = dict.fromkeys([*folders, *(each for *_, locations in issued for each in locations[:-1])])
    forged, unrecorded = _unrecorded_files(list(searched), runs)
    faults, cautions = [*faults, *forged, *_changed_results(report, runs, unindexed)], [*cautions, *unrecorded]
    others = [Text.of("audit.files_intact", count=intact)] if intact else []
    for record in map(_verify_record, _record_folders(runs, site)):
        cautions += record.cautions
        for each in record.findings:
            if each in record.cautions:
                continue
            if not record.intact:
                faults += [each] if each not in faults else []
            elif each.code in ("report.record_intact", "report.of_others", "report.of_unknown"):
                others.append(each)
    state = [*site.state, *(each for each in (*faults, *cautions, *others) if each not in site.state)]
    return replace(site, state=tuple(state), faults=tuple(faults), cautions=(*site.cautions, *cautions))


def _record_folders(runs: Path, site: SiteTrail) -> list[Path]:
    """Return `runs`, and the other existing folders in which the site has issued reports."""
    others = [each for each in recorded_folders(site.trail.entries) if each != runs.resolve() and each.is_dir()]
    return [runs, *others]


def _verify_record(runs: Path) -> CertificateState:
    """Return the result of `verify_reports`, or why it is impossible."""
    try:
        return verify_reports(runs)
    except InputError as exc:
        return CertificateState((exc.as_text,), intact=False)


def _first(names: Sequence[str]) -> list[str]:
    """Return the first names, with an ellipsis for the others."""
    return [*names[:_MAX_NAMES], *(["…"] if len(names) > _MAX_NAMES else [])]


def _unrecorded_files(folders: Sequence[Path], runs: Path) -> tuple[list[Text], list[Text]]:
    """Return faults and cautions about files in folders for reports that no record of the site contains.

    A file that states the trail of this site is a fault, because the trail contains all files that the site has issued.
    """
    values = [each.values for each in site_events(site_folder())]
    names = {Path(name).name for each in values if isinstance(files := each.get("files"), dict) for name in files}
    digests = {digest for each in values for digest in file_digests(each)}
    numbers = {each.identification for each in report_file(runs).read().entries}
    keys = {key for _, trail in site_trails(site_folder()) if (key := public_key(trail)) is not None}
    faults: list[Text] = []
    cautions: list[Text] = []
    for folder in folders:
        unknown: list[str] = []
        for path in sorted(each for each in folder.glob("*") if each.suffix in (".pdf", ".xml") and each.is_file()):
            if path.name in names or path.stem.removesuffix("_zh") in numbers:
                continue
            content = _content_of(path)
            if hashlib.sha256(content).hexdigest() in digests:
                continue  # a copy with another name
            if any(head.key in keys for head in find_heads(content)):
                faults.append(Text.of("audit.file_unknown", file=path))
            else:
                unknown.append(path.name)
        if unknown:
            count = len(unknown)
            cautions.append(Text.of("audit.files_unrecorded", folder=folder, count=count, names=_first(unknown)))
    return faults, cautions


def _report_folders(station: Path | None) -> Iterator[Path]:
    """Yield the report folders that `station`, if given, and the stations in the library specify."""
    paths = [library.find("stations", name) for name in library.names("stations")]
    for path in [*([station] if station else []), *paths]:
        with suppress(ConfigurationError):
            folder = report_folder(path, load_station(path)[1].report)
            if folder is not None:
                yield folder


def _successors() -> dict[str, str]:
    """Return the last certificate with the same number for every certificate of the site."""
    numbers, last = {}, {}
    for values in (each.values for each in site_events(site_folder())):
        certificate, number = values.get("certificate"), str(values.get("number"))
        if isinstance(certificate, str) and "number" in values:
            numbers[certificate], last[number] = number, certificate
    return {certificate: last[number] for certificate, number in numbers.items()}


def is_searched(file: Path, source: Path) -> bool:
    """Return whether the verification of the audit trail searches the folder of `file`, a certificate of `source`.

    `source` is a result or log in its folder of runs.
    """
    runs = source.absolute().parent
    folders = [*_report_folders(None), default_report_folder(runs), runs]
    return file.absolute().parent.resolve() in {folder.resolve() for folder in folders}


def _issued_files(report_folders: Sequence[Path]) -> Iterator[tuple[str, str, set[object], list[Path]]]:
    """Yield number, name, recorded SHA-256 and possible folders of every file of the certificates of the site."""
    digests: dict[tuple[str, str], set[object]] = {}
    folders: dict[str, list[Path]] = {}
    for values in (each.values for each in site_events(site_folder())):
        files, certificate, reports = values.get("files"), values.get("certificate"), values.get("reports")
        if not isinstance(certificate, str) or not isinstance(files, dict):
            continue
        for name, digest in files.items():
            digests.setdefault((certificate, Path(name).name), set()).add(digest)
        if isinstance(reports, dict):
            runs = Path(str(reports.get("folder")))
            folders[certificate] = [default_report_folder(runs), runs]
    for (certificate, name), recorded in digests.items():
        yield certificate, name, recorded, [*report_folders, *folders.get(certificate, [])]


def _digest_of(file: Path) -> str:
    """Return the SHA-256 of a file. Raises InputError."""
    return hashlib.sha256(_content_of(file)).hexdigest()


def _content_of(file: Path) -> bytes:
    """Return the bytes of a file. Raises InputError."""
    try:
        return file.read_bytes()
    except OSError as exc:
        raise InputError("result.unreadable", file=file, reason=os_reason(exc)) from exc


def verify_reports(folder: Path) -> CertificateState:
    """Verify the record of issued reports in a folder of runs and the audit trail of the site against each other.

    The record must contain all reports that the trail names for this folder, and the trail its heads in the shared
    database. Raises InputError if a file cannot be read.
    """
    state = verify_trail(site_folder(), every_signature=True)
    heads = database_heads(folder)
    cautions = _missing_runs(folder)
    of_record = report_faults(folder, state)
    faults = [*state.faults, *database_contradictions(state, heads), *of_record]
    file, missing = report_file(folder).path, unrecorded_reports(folder, state)
    if missing and "report.record_damaged" not in (each.code for each in of_record):  # its lines cannot be read
        faults.append(Text.of("report.not_in_record", file=file, count=len(missing), names=_first(missing)))
    if faults:
        return CertificateState((*faults, *cautions), intact=False, cautions=tuple(cautions))
    lines, others = len(report_file(folder).read().entries), reports_of_others(folder, state)
    code = "report.record_intact" if others < lines else "report.record_alone" if lines else "report.no_record"
    findings = [Text.of(code, folder=folder)]
    if others:
        of_others = "report.of_others" if state.public_key is not None else "report.of_unknown"
        findings.append(Text.of(of_others, file=file, count=others))
    if code == "report.record_alone":
        cautions = [*cautions, *(findings if not state.trail.digests else findings[:1])]
    of_this_trail = [each.head for each in heads if each.head.key == state.public_key]
    findings += [Text.of("audit.database_agrees", line=head.lines, digest=head.digest) for head in of_this_trail]
    if not of_this_trail:
        findings.append(Text.of("audit.no_database"))
    findings += [each for each in cautions if each not in findings]
    return CertificateState(tuple(findings), intact=True, cautions=tuple(cautions))


def _missing_runs(folder: Path) -> list[Text]:
    """Return a caution about the runs in the index or in the audit trails whose log, or all files, are missing."""
    from calstation.records.run_index import FILE, RunIndex  # loads SQLAlchemy

    numbers = [str(each.get("number")) for each in _certificates_of(folder)]
    runs = {number: False for number in numbers if _RUN_LOG.search(number)}
    if (folder / FILE).is_file():
        runs |= RunIndex(folder).names()
    logs = {each.stem for each in folder.glob(f"*{SUFFIX}")}
    names = sorted(name for name, missing in runs.items() if missing or name not in logs)
    return [Text.of("audit.runs_missing", folder=folder, count=len(names), names=_first(names))] if names else []


def _changed_results(report: ProgressCallback, folder: Path, unindexed: bool) -> list[Text]:
    """Compare the runs of a folder with their logs, update the index, and return a fault for every unconfirmed one."""
    from calstation.records.run_index import FILE, RunIndex  # loads SQLAlchemy

    if not (folder / FILE).is_file():
        faults = check_runs(folder)[0] if unindexed else []
        report(1.0)
        return faults
    history = History(folder)
    history.refresh()
    history.compare_logs(report=lambda done: report(0.5 + 0.5 * done))
    faults = []
    for run in RunIndex(folder).records(RunFilter(altered=True), None, 0, LATEST_FIRST):
        if run.origin or run.result is None or run.missing:
            continue
        try:
            load_confirmed_result(run.result)
        except InputError as error:
            faults.append(error.as_text)
        else:  # a file that agrees with its log has been restored since
            faults += [] if run.log.exists() else [Text.of("result.altered_without_log", file=run.result)]
    report(1.0)
    return faults


def _certificates_of(folder: Path) -> Iterator[Mapping[str, object]]:
    """Yield the values of the certificates of the site for logs in a folder."""
    for each in site_events(site_folder()):
        if str(folder.resolve()) in map(str, recorded_folders([each])):
            yield each.values
