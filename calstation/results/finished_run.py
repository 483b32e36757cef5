"""A finished run or a foreign log for analysis: result, log and the unit's previous values."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from calstation.jobs import ProgressCallback
from calstation.records import SUFFIX, open_log
from calstation.results.history import History
from calstation.results.resolving import resolve
from calstation.results.result import Result, load_result


@dataclass(frozen=True)
class FinishedRun:
    """A result and what it is compared with."""

    result: Result
    log: Path | None  #: None if it is missing.
    previous: Mapping[str, float]  #: The unit's latest earlier value of each parameter, SI.
    solved_now: bool = False  #: The log held no result and has been solved.


def load_finished_run(report: ProgressCallback, path: Path, runs: Path) -> FinishedRun:
    """Job: read a result file, or a log that is solved if it has no result; `runs` is the folder of the unit's history.

    Raises InputError or ConfigurationError if the file cannot be used.
    """
    solved_now = False
    if path.suffix == ".json":
        result = load_result(path)
        candidates = (Path(result.log.file), path.with_suffix(SUFFIX))
        log = next((candidate for candidate in candidates if candidate.is_file()), None)
    else:
        log = path
        stored = open_log(path).results
        solved_now = not stored
        report(0.1)
        result = Result.from_json(stored[-1]) if stored else resolve(path).result
    report(0.9)
    previous: Mapping[str, float] = {}
    if runs.is_dir():
        history = History(runs)
        history.refresh()
        previous = history.previous(result.serial, result.started_utc)
    return FinishedRun(result, log, previous, solved_now)
