"""Reading of the runs of a folder from their files, for the index."""

import math
import os
import stat
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from calstation.errors import InputError
from calstation.messages import Text
from calstation.parsing import read_json
from calstation.records import (
    SUFFIX,
    IndexedRun,
    Log,
    RunRecord,
    Verdict,
    being_written,
    can_be_resumed,
    last_result,
    open_log,
    solved_stages,
)
from calstation.results.result import NO_RESULT, Result
from calstation.results.stated import (
    ADDED_LATER,
    RELEASE_IN_DOUBT,
    altered_entry,
    content_digest,
    is_run,
    load_confirmed_result,
    load_run_result,
    require_own_log,
    require_recorded_release,
    was_simulated,
)

#: Largest attempt number in the index, which cannot store arbitrarily large integers.
_MAX_ATTEMPTS = 1_000_000


def run_stamps(folder: Path, known: Mapping[str, str]) -> dict[str, str]:
    """Return a fingerprint of each run's files by stem, except for logs that are still being written.

    A log whose fingerprint equals its `known` fingerprint is not being written.
    """
    if not folder.is_dir():
        return {}
    stamps: dict[str, dict[str, str]] = {SUFFIX.removeprefix("."): {}, "json": {}}
    with os.scandir(folder) as entries:
        for entry in entries:
            stem, _, suffix = entry.name.rpartition(".")
            if suffix in stamps and stem and not stem.startswith("."):
                try:
                    status = entry.stat()
                except OSError:  # such as a link to a file that has been removed
                    continue
                if stat.S_ISREG(status.st_mode):  # reading a pipe would wait forever
                    stamps[suffix][stem] = f"{status.st_mtime_ns} {status.st_size}"
    logs, results = stamps.values()
    without_result = {stem: f"log {stamp}" for stem, stamp in logs.items() if stem not in results}
    ended = {
        stem: stamp
        for stem, stamp in without_result.items()
        if known.get(stem) == stamp or not _is_running(folder, stem)
    }
    return {**ended, **results}


def has_files(folder: Path, name: str) -> bool:
    """Return whether a run has a file; it is not listed while it is in progress."""
    return (folder / f"{name}{SUFFIX}").exists() or (folder / f"{name}.json").exists()


def _is_running(folder: Path, stem: str) -> bool:
    """Return whether a run is still in progress, or its log cannot be read.

    The lock is tested once without waiting, because each of up to 16 runs in progress is tested whenever one of them
    ends. A log that another program tests at the same time is indexed by the next refresh.
    """
    try:
        return being_written(folder / f"{stem}{SUFFIX}", within=0.0)
    except InputError:
        return True


def read_run(folder: Path, name: str, stamp: str, earlier: IndexedRun | None = None) -> IndexedRun | None:
    """Read a run from its result, or from its log if it has no result; return None for other or damaged files.

    `earlier` is the run in the index if its log is missing.
    """
    try:
        run = _read_file(folder, name, stamp)
        if run is not None and earlier is not None and _contradicts(run.record, earlier.record):
            run = replace(earlier, stamp=stamp, record=replace(earlier.record, altered=True))
        if run is not None:
            _check_texts(run)
    except (OSError, InputError, *NO_RESULT):
        return None
    return run


def lacks_log(record: RunRecord) -> bool:
    """Return whether the log of a run of this folder is missing."""
    return not record.origin and not record.log.exists()


def result_doubt(record: RunRecord) -> Text | None:
    """Return why the result of a run with a verdict is unconfirmed; None if its log confirms or contradicts it.

    Reasons: the audit trail does not contain its release; or its log is unreadable, of another run, or without a
    result, for example because its end was cut off.
    """
    if record.origin or not record.verdict.judged:
        return None
    return _log_doubt(record) or _release_doubt(record)


def changed_entry(record: RunRecord) -> Text | None:
    """Return the first entry in which a run's result file differs from the result in its log; None if none does."""
    try:
        if record.altered and record.result is not None:
            load_run_result(record.result)
    except InputError as error:
        entry = error.values.get("entry")
        return entry if isinstance(entry, Text) else None
    return None


def _release_doubt(record: RunRecord) -> Text | None:
    try:
        if record.altered and record.result is not None:
            load_confirmed_result(record.result)
    except InputError as error:
        return error.as_text if error.code in RELEASE_IN_DOUBT else None
    return None


def _log_doubt(record: RunRecord) -> Text | None:
    if not record.log.is_file():
        return None
    try:
        stored = last_result(record.log)
        require_own_log(stored, record.log)
    except InputError as error:
        return error.as_text
    return Text.of("result.not_in_log", log=record.log) if stored is None else None


def agrees_with_log(record: RunRecord) -> bool:
    """Return whether a log contains the result in the index of its run; True if there is no log, or it is damaged."""
    with suppress(InputError, FileNotFoundError):
        return content_digest(last_result(record.log) or {}) == record.result_sha256
    return True


def _contradicts(run: RunRecord, earlier: RunRecord) -> bool:
    """Return whether a result file without a log differs from the result of the run in the index."""
    return run.result_sha256 != earlier.result_sha256 if earlier.result_sha256 else earlier.altered


def _read_file(folder: Path, name: str, stamp: str) -> IndexedRun | None:
    path = folder / f"{name}.json"
    if not stamp.startswith("log "):
        return _from_file(folder, name, stamp, path)
    contents = open_log(folder / f"{name}{SUFFIX}")
    if contents.outcome is None:
        return _from_log(folder, name, stamp, contents)
    ended = ended_result(contents)
    return None if ended is None else _from_result(folder, name, stamp, ended, None)


def ended_result(log: Log) -> Result | None:
    """Return the last result in the log of the run to which it belongs, or None if the log contains no valid one."""
    try:
        results = map(Result.from_json, reversed(log.results))
        return next((result for result in results if is_run(result, log.path.stem)), None)
    except NO_RESULT:
        return None


def _from_file(folder: Path, name: str, stamp: str, path: Path) -> IndexedRun | None:
    """Read a run from its result file or, if that was altered, from its log; an unrecorded release is omitted."""
    content = read_json(path)
    result = Result.from_json(content)
    if not is_run(result, name):
        return None
    unknown_release = not _knows_release(result, path)
    if unknown_release:
        result = result.model_copy(update={"override": None})
        content.pop("override")
    run = _from_result(folder, name, stamp, result, path)
    log = run.record.log
    entry, stored = None, None
    if log.is_file():
        with suppress(InputError):  # a damaged log does not hide the run
            stored = last_result(log)
            entry = altered_entry(content, stored)
    if entry is None:
        record = replace(run.record, altered=unknown_release, result_sha256=content_digest(content))
        return replace(run, record=record)
    if stored is not None and not is_run(Result.from_json(stored), name):  # the log of another run confirms nothing
        return replace(run, record=replace(run.record, altered=True, result_sha256=content_digest(content)))
    digest, unconfirmed = "", False
    if stored is None:
        contents = open_log(log)
        run, unconfirmed = _from_log(folder, name, stamp, contents), contents.outcome is None
    else:
        digest = content_digest(stored)
        later = {key: content[key] for key in ADDED_LATER if key in content}
        run = _from_result(folder, name, stamp, Result.from_json({**stored, **later}), path)
    record = replace(run.record, result=path, altered=True, unconfirmed=unconfirmed, result_sha256=digest)
    return replace(run, record=record)


def _knows_release(result: Result, path: Path) -> bool:
    """Return whether the audit trail contains the release in a result file, or the file contains no release."""
    try:
        require_recorded_release(result, path)
    except InputError:
        return False
    return True


def _check_texts(run: IndexedRun) -> None:
    """Raise ValueError if the index or the database cannot store the texts of a run."""
    record = run.record
    required_texts = (run.name, record.serial, record.started_utc, record.product, record.station, record.operator)
    other_texts = (*record.stages, record.error, record.resumed_from, record.batch, record.slot)
    "".join(filter(None, (*required_texts, *other_texts))).encode()  # raises for a lone surrogate
    if "\0" in record.serial + record.started_utc:
        raise ValueError("PostgreSQL has no such character")


def _from_result(folder: Path, name: str, stamp: str, result: Result, beside: Path | None) -> IndexedRun:
    record = RunRecord(
        serial=result.serial,
        started_utc=result.started_utc or "",
        verdict=result.verdict,
        attempt=min(result.attempt, _MAX_ATTEMPTS),
        product=result.product,
        station=result.station,
        operator=result.operator,
        stages=tuple(result.solved_stages),
        log=folder / f"{name}{SUFFIX}",
        result=beside,
        duration=result.duration_s if math.isfinite(result.duration_s) else 0.0,
        error=result.end_reason,
        resumed_from=result.resumed_from,
        closed=result.closed_utc is not None,
        partial=result.partial,
        released=result.released,
        check_standard=result.check_standard is not None,
        batch=result.batch,
        slot=result.slot,
        resumable=result.advice == "resume",
        simulated=was_simulated(result, folder / f"{name}.json"),
    )
    finite = {name: row for name, row in result.parameters.items() if math.isfinite(row.value)}
    values = {name: row.value for name, row in finite.items()}
    sigmas = {name: row.sigma for name, row in finite.items() if math.isfinite(row.sigma)}
    failed = tuple(check.id for check in result.failed_checks) if result.verdict.judged else ()
    rows = {name: (row.value, row.sigma) for name, row in result.table.items()}
    table = {name: row for name, row in rows.items() if all(map(math.isfinite, row))}
    return IndexedRun(name, stamp, record, values, sigmas, failed, table)


def _from_log(folder: Path, name: str, stamp: str, contents: Log) -> IndexedRun:
    meta, run = contents.meta, contents.meta.run
    record = RunRecord(
        serial=meta.imu.serial,
        started_utc=run.started_utc if run else "",
        verdict=Verdict.INCOMPLETE,
        attempt=run.attempt if run else 1,
        product=meta.product.name if meta.product else None,
        station=run.station if run else None,
        operator=run.operator if run else None,
        stages=solved_stages(contents.events),
        log=folder / f"{name}{SUFFIX}",
        result=None,
        duration=0.0,
        resumed_from=run.resumed_from if run else None,
        batch=run.batch if run else None,
        slot=run.slot if run else None,
        resumable=can_be_resumed(contents.events),
        simulated=meta.is_simulated,
    )
    return IndexedRun(name, stamp, record, {}, {})
