"""Gives runs that died the result that they could not write themselves, and closes those that nobody will resume."""

import json
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from calstation.errors import ConfigurationError, InputError
from calstation.records.log import Log, open_log
from calstation.records.raw_log import SUFFIX
from calstation.records.raw_read import being_written, solved_stages
from calstation.results.handover import register_pending
from calstation.results.judge import Ending, build_result, judge
from calstation.results.result import write_json
from calstation.results.solver_chain import StageChain


def finish_incomplete(folder: Path) -> list[Path]:
    """Write the result ``incomplete`` beside every log in `folder` whose run died; returns those logs.

    Their results wait for the next hand-over, and their runs can still be resumed. A log that cannot be read at
    all is left as it is.
    """
    found = []
    for path in sorted(folder.glob(f"*{SUFFIX}")):
        if path.with_suffix(".json").exists():
            continue
        try:
            if being_written(path):
                continue
            log = open_log(path)
            if log.outcome is None:
                _settle(log)
                found.append(path)
        except InputError:
            continue
    return found


def close_incomplete(path: Path, operator: str | None = None) -> Path:
    """Decide that a run is not to be resumed; returns its result file, which says who and when.

    Raises ConfigurationError where the run is still going, or the place cannot be written, InputError where the
    log cannot be read.
    """
    if not path.with_suffix(".json").exists() and being_written(path):
        raise ConfigurationError(f"{path}: its run is still going; stop it first")
    log = open_log(path)
    beside = path.with_suffix(".json")
    if not beside.exists():
        if log.outcome is None:
            _settle(log)
        elif log.results:
            write_json(beside, log.results[-1])
        else:
            raise InputError(f"{path}: no run that could be resumed")
    result: dict[str, Any] = json.loads(beside.read_text(encoding="utf-8"))
    closed = {"closed_utc": datetime.now(UTC).isoformat(timespec="seconds"), "closed_by": operator}
    write_json(beside, {**result, **closed})
    return beside


def _settle(log: Log) -> None:
    prior = StageChain(log.meta).prior
    facts = log.facts()
    finished = solved_stages(log.events)
    ending = Ending(
        "incomplete",
        str(log.path),
        facts,
        advice="resume" if finished else "repeat",
        finished_stages=finished,
    )
    result = build_result(log.meta, prior, (), judge(log.meta, prior, ()), ending)
    with suppress(OSError):  # the result is there all the same
        register_pending(log.path.parent, log.path.stem)
    write_json(log.path.with_suffix(".json"), result.to_json())
