"""Incomplete runs: results of runs whose process died, and closing of runs that will not be resumed."""

import json
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from calstation.errors import ConfigurationError, InputError
from calstation.jobs import ProgressCallback
from calstation.judgement import End, judge, verdict_of
from calstation.records import SUFFIX, Log, being_written, open_log, prior_from_meta, solved_stages
from calstation.results import (
    Delivery,
    Ending,
    History,
    build_result,
    deliver_pending,
    load_result,
    register_pending,
    write_json,
)


def finish_incomplete(folder: Path) -> list[Path]:
    """Write the result ``incomplete`` next to every log in `folder` whose run died, and return these logs.

    The results are delivered at the next hand-over, and the runs can still be resumed. Unreadable logs are ignored.
    """
    logs = []
    for path in sorted(folder.glob(f"*{SUFFIX}")):
        if path.with_suffix(".json").exists():
            continue
        try:
            if being_written(path):
                continue
            log = open_log(path)
            if log.outcome is None:
                _write_result(log)
                logs.append(path)
        except InputError:
            continue
    return logs


def close_incomplete(path: Path, operator: str | None = None) -> Path:
    """Record in the result file of a run who decided not to resume it and when, and return the file.

    Raises ConfigurationError if the run is still in progress or the folder cannot be written, InputError if the log or
    its result file cannot be read.
    """
    if not path.with_suffix(".json").exists() and being_written(path):
        raise ConfigurationError("run.still_running", path=path)
    log = open_log(path)
    result_file = path.with_suffix(".json")
    if not result_file.exists():
        if log.outcome is None:
            _write_result(log)
        elif log.results:
            write_json(result_file, log.results[-1])
        else:
            raise InputError("run.not_resumable", path=path)
    load_result(result_file)  # raises the errors of an unreadable file
    result: dict[str, Any] = json.loads(result_file.read_text(encoding="utf-8"))
    decision = {"closed_utc": datetime.now(UTC).isoformat(timespec="seconds"), "closed_by": operator}
    write_json(result_file, {**result, **decision})
    return result_file


def _write_result(log: Log) -> None:
    prior = prior_from_meta(log.meta)
    facts = log.facts()
    finished = solved_stages(log.events)
    judgement = judge(log.meta, prior, ())
    verdict = verdict_of(End.INCOMPLETE, judgement.passed, partial=judgement.partial)
    action = "resume" if finished else "repeat"
    ending = Ending(verdict, str(log.path), facts, advice=action, finished_stages=finished)
    result = build_result(log.meta, prior, (), judgement, ending)
    with suppress(OSError):  # the result is still written
        register_pending(log.path.parent, log.path.stem)
    write_json(log.path.with_suffix(".json"), result.to_json())


def close_incomplete_job(progress: ProgressCallback, log: Path, operator: str | None) -> Path:
    """Job: close a run that will not be resumed, and return its result file."""
    result = close_incomplete(log, operator)
    progress(1.0)
    return result


@dataclass(frozen=True)
class StartupRecovery:
    """Logs of the runs whose process died, and the outcome of the hand-over."""

    incomplete: tuple[Path, ...]
    delivery: Delivery


def recover_at_startup(progress: ProgressCallback, runs: Path, station: Path | None) -> StartupRecovery:
    """Job: finish incomplete runs, update the history, and deliver pending results as the station file specifies."""
    incomplete = finish_incomplete(runs) if runs.is_dir() else []
    progress(0.3)
    History(runs).refresh(lambda fraction: progress(0.3 + 0.4 * fraction))
    return StartupRecovery(tuple(incomplete), deliver_pending(progress, runs, station))
