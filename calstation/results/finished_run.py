"""A run that is over, or a log from elsewhere, brought together for a closer look: result, log, earlier values."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from calstation.errors import InputError
from calstation.jobs.queue import ProgressCallback
from calstation.records.log import open_log
from calstation.records.raw_log import SUFFIX
from calstation.results.history import History
from calstation.results.resolve import resolve
from calstation.results.result import SCHEMA


@dataclass(frozen=True)
class Finished:
    """A result with what it is to be compared with.

    Attributes
    ----------
    result : as in the result JSON
    log : its log, None where that is not there any more
    previous : the unit's latest earlier value of each parameter, SI
    solved_now : the log held no result, so it was solved for this look
    """

    result: Mapping[str, Any]
    log: Path | None
    previous: Mapping[str, float]
    solved_now: bool = False


def finished(tell: ProgressCallback, path: Path, runs: Path) -> Finished:
    """Work for the workshop: read a result JSON or a log; a log without a result is solved.

    `runs` : folder whose runs are the unit's history. Raises InputError or ConfigurationError with file and mend.
    """
    solved_now = False
    if path.suffix == ".json":
        result = _read(path)
        log = _log_of(path, result)
    else:
        log = path
        stored = open_log(path).results
        solved_now = not stored
        tell(0.1)
        result = stored[-1] if stored else resolve(path).result
    tell(0.9)
    previous: Mapping[str, float] = {}
    if runs.is_dir():
        history = History(runs)
        history.refresh()
        previous = history.previous(str(result["unit"]["serial"]), result.get("started_utc"))
    return Finished(result, log, previous, solved_now)


def _read(path: Path) -> dict[str, Any]:
    try:
        result = json.loads(path.read_text(encoding="utf-8"))
    except OSError as exc:
        raise InputError(f"{path}: cannot be read ({exc.strerror or exc}); give an existing file") from exc
    except ValueError as exc:
        raise InputError(f"{path}: no JSON ({exc}); give the result of a run") from exc
    if not isinstance(result, dict) or result.get("schema") != SCHEMA:
        raise InputError(f"{path}: no result of a run (its schema is not {SCHEMA}); give another file")
    return result


def _log_of(path: Path, result: Mapping[str, Any]) -> Path | None:
    """A result's log: where it says, else beside it under its own name."""
    for candidate in (Path(result["log"]["file"]), path.with_suffix(SUFFIX)):
        if candidate.is_file():
            return candidate
    return None
