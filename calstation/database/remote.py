"""Runs of other stations: their logs in the archive and their results in the shared database.

The interface refers to these functions by name; only the job process imports the packages for database and archive.
"""

import os
import re
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from calstation.errors import InputError
from calstation.jobs import ProgressCallback
from calstation.records import SUFFIX, RunFilter, RunRecord, Verdict, write_atomic
from calstation.results import History, Result, export_runs, load_results

#: A path on another computer, ``host:path``; a single letter is a Windows drive.
_REMOTE_PATH = re.compile(r"[^/\\:]{2,}:(?!//)")

#: Largest total size of the copies of other stations' logs in a runs folder, bytes.
_MAX_COPIES_SIZE = 5_000_000_000

#: Pattern of the copies of other stations' logs in a runs folder; their folders are named by the UUIDs of outboxes.
_COPIES_PATTERN = "-".join("[0-9a-f]" * count for count in (8, 4, 4, 4, 12)) + f"/*{SUFFIX}"


def is_archived(location: str | None) -> bool:
    """Return whether the location of a log is in an archive rather than on its station's computer."""
    return location is not None and _REMOTE_PATH.match(location) is None


def fetch_log(report: ProgressCallback, run: RunRecord) -> Path:
    """Job: copy the log of another station's run from the archive to `run.log`, and return this path.

    If the copies become too large, the least recently used ones are deleted; an open copy can be read to its end.
    Raises InputError if the archive cannot be read, ConfigurationError without the packages for it.
    """
    from calstation.database.archive import copy_from_archive

    if run.location is None:
        raise InputError("result.elsewhere", log=run.log.name, station=run.station or "?")
    run.log.parent.mkdir(parents=True, exist_ok=True)
    copy_from_archive(run.location, run.log, report)
    with suppress(OSError):  # a copy may be open on Windows or deleted by another window; the next call tries again
        _delete_copies(run.log)
    return run.log


def note_use(log: Path) -> None:
    """Record that the copy of a log is in use, because not every file system records the time of access."""
    with suppress(OSError):  # created by another user
        os.utime(log, ns=(time.time_ns(), log.stat().st_mtime_ns))


def _delete_copies(newest: Path) -> None:
    """Delete the least recently used copies of logs beyond the largest total size, but not the newest one."""
    stamps = {path: path.stat() for path in newest.parent.parent.glob(_COPIES_PATTERN)}
    size = sum(stamp.st_size for stamp in stamps.values())
    for path in sorted(stamps.keys() - {newest}, key=lambda path: stamps[path].st_atime_ns):
        if size <= _MAX_COPIES_SIZE:
            break
        path.unlink()
        size -= stamps[path].st_size


def fetch_result(report: ProgressCallback, station: Path | None, run: RunRecord) -> Path:
    """Job: read the result of another station's run from the shared database, and return the path of its copy.

    Raises InputError if the database has no result of the run, ConfigurationError if the database cannot be used.
    """
    report(0.5)
    _fetch(station, [run])
    return run.log.with_suffix(".json")


def load_shared_results(
    report: ProgressCallback, station: Path | None, folder: Path, runs: Sequence[RunRecord]
) -> list[Result]:
    """Job: load results of runs of all stations.

    Raises the errors of `fetch_result` and `calstation.results.load_results`.
    """
    _fetch(station, runs)
    return load_results(report, folder, runs)


def export_shared_runs(
    report: ProgressCallback, station: Path | None, folder: Path, run_filter: RunFilter, target: Path
) -> Path:
    """Job: update the index, and export runs of all stations.

    Raises the errors of `fetch_result` and `calstation.results.export_runs`.

    Parameters
    ----------
    report : callback for the progress
    station : station file, which names the database; None for the default station
    folder : runs folder with the index
    run_filter : conditions for the runs
    target : file to write
    """
    history = History(folder)
    history.refresh()
    if target.suffix != ".csv":  # CSV rows are in the index
        _fetch(station, history.runs(run_filter, limit=None))
    return export_runs(report, folder, run_filter, target)


def _fetch(station: Path | None, runs: Sequence[RunRecord]) -> None:
    """Copy the results of other stations' runs next to the paths of their logs."""
    remote = [run for run in runs if run.origin and run.verdict is not Verdict.INCOMPLETE]
    if not remote:
        return
    from sqlalchemy import select

    from calstation.database import tables
    from calstation.database.connect import database_of, open_database

    with open_database(database_of(station)[0]) as engine, engine.connect() as connection:
        for run in remote:
            conditions = (tables.runs.c.outbox == run.origin, tables.runs.c.name == run.log.stem)
            text = connection.execute(select(tables.runs.c.result).where(*conditions)).scalar()
            if text is None:
                raise InputError("result.elsewhere", log=run.log.name, station=run.station or "?")
            target = run.log.with_suffix(".json")
            target.parent.mkdir(parents=True, exist_ok=True)
            write_atomic(target, text)
