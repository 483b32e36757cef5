"""The verified source of a certificate: a result file, every statement of which is compared with its log.

The result file of a run must equal the result in the log. A later override must be in the audit trail of the site. A
log that was solved again is solved once more, and the file must agree with the new solution.
"""

from pathlib import Path

from calstation import __version__
from calstation.errors import InputError
from calstation.jobs import ProgressCallback
from calstation.parsing import read_json
from calstation.records import Log, open_log
from calstation.results import (
    Result,
    altered_entry,
    difference,
    entry_text,
    find_log,
    load_result,
    plain,
    require_recorded_release,
    resolve_log,
    stated_by_log,
    stored_result,
    with_states,
)

#: Largest difference of a value between two computers, in sigmas, or relative to the largest number of its row.
ROUNDING = 1e-3

#: Entries that are attached to the certificate of a log that was solved again, but not printed, because their numbers
#: have no common scale for rounding.
_ONLY_ATTACHED = ("details", "observability")


def load_source(report: ProgressCallback, path: Path) -> tuple[Result, Log]:
    """Return the result in a result file, verified with its log, or the result of a log, and the log itself.

    Raises InputError, for example if the file contradicts its log.
    """
    result, log = read_source(path)
    if result is None or result.outcome == "resolved":
        result, run = _solve_again(report, path, result, log), stored_result(log)
        if run is not None:
            result = result.model_copy(update={"registers": run.registers})
    else:
        if path.suffix == ".json":
            result = _run_result(path, result, log)
        _check_with_log(result, log)
    # The folder of the log is not part of the report.
    section = result.log.model_copy(update={"file": log.path.name})
    return result.model_copy(update={"log": section}), log


def read_source(path: Path) -> tuple[Result | None, Log]:
    """Read a result file and open its log, or open a log and read its result, which is None if there is none.

    The result is not verified, apart from the digest of the log. Raises InputError.
    """
    if path.suffix != ".json":
        log = open_log(path)
        return stored_result(log), log
    result = load_result(path)
    if not result.tested:
        raise InputError("report.untested", file=path)
    log_path = find_log(result, path)
    if log_path is None:
        raise InputError("report.no_log", file=path, log=result.log.file)
    log = open_log(log_path)
    if log.facts().sha256 != result.log.sha256:
        raise InputError("report.other_log", file=path, log=log_path)
    return result, log


def _run_result(path: Path, result: Result, log: Log) -> Result:
    """Return the result in the log of a run, with the override of the file if the audit trail contains it."""
    stored = stored_result(log)
    if stored is None:
        raise InputError("report.no_result_in_log", file=path, log=log.path)
    content, stated = read_json(path), log.results[-1]
    entry = altered_entry(content, stated)
    if entry is not None:
        raise InputError("result.altered", file=path, log=log.path, entry=entry_text(entry, stated, content))
    if result.override is None:
        return stored
    require_recorded_release(result, path)
    return stored.model_copy(update={"override": result.override})


def _check_with_log(result: Result, log: Log) -> None:
    """Raise InputError if the result of a run contradicts the configuration, the samples or the events of its log."""
    facts = log.facts()
    expected = {**stated_by_log(log.meta, facts), "sha256": facts.sha256}
    content = result.to_json()
    if "simulated" not in content:  # the result of an earlier version
        del expected["simulated"]
    stated = {key: content.get(key) for key in expected} | {"sha256": result.log.sha256}
    registers = [event["registers"] for event in log.events if event.get("event") == "OldRegisters"]
    if result.registers is not None and (registers or log.meta.registers):
        expected["registers"] = log.meta.registers or registers[-1]
        stated["registers"] = result.registers.old
    entry = difference(stated, plain(expected), 0.0)
    if entry is not None:
        raise InputError("report.contradicts_log", log=log.path, entry=entry)


def _solve_again(report: ProgressCallback, path: Path, result: Result | None, log: Log) -> Result:
    """Solve a log with the options of a result file, or with defaults if there is none, and compare the results."""
    facts = log.facts()

    def progress(stage: str, seq: int, done: float) -> None:
        report(max(0.0, (seq - facts.first_seq) / max(facts.last_seq - facts.first_seq, 1)), note=stage)

    if result is None:
        return resolve_log(log, log.meta, progress=progress).result
    version = "?" if result.software is None else result.software.version
    if version != __version__:
        raise InputError("report.solved_by_other_version", file=path, log=log.path, version=version)
    span = result.log.first_seq, result.log.last_seq
    stages = None if result.missing_data else tuple(result.stages)
    meta, added = with_states(log.meta, tuple(result.states_added))
    solved = resolve_log(log, meta, stages, *span, progress, added=added).result
    content, stated = (
        {key: value for key, value in each.items() if key not in _ONLY_ATTACHED}
        for each in (read_json(path), solved.to_json())
    )
    entry = difference(content, {**stated, "log": {**stated["log"], "file": content["log"]["file"]}}, ROUNDING)
    if entry is not None:
        raise InputError("report.other_result", file=path, log=log.path, entry=entry_text(entry, stated, content))
    return solved
