"""Runs of other stations: their logs in the archive and their results in the shared database.

The functions are named in the window, which imports neither the database nor the archive; the job process does.
"""

import re
from collections.abc import Sequence
from pathlib import Path

from calstation.config import load_station
from calstation.errors import ConfigurationError, InputError
from calstation.jobs import ProgressCallback
from calstation.records import RunFilter, RunRecord, write_atomic
from calstation.results import History, Result, export_runs, load_results

#: A path on a computer, ``host:path``; one letter is a drive of Windows.
_ON_HOST = re.compile(r"[^/\\:]{2,}:(?!//)")


def is_archived(location: str | None) -> bool:
    """Whether the location of a log is in an archive, and not on the computer of its station."""
    return location is not None and _ON_HOST.match(location) is None


def fetch_log(report: ProgressCallback, run: RunRecord) -> Path:
    """Job: copy the log of another station's run from the archive to `run.log`, and return this path.

    Raises InputError if the archive cannot be read, ConfigurationError without the packages for it.
    """
    from calstation.database.archive import copy_to

    assert run.location is not None
    run.log.parent.mkdir(parents=True, exist_ok=True)
    copy_to(run.location, run.log, report)
    return run.log


def fetch_result(report: ProgressCallback, station: Path | None, run: RunRecord) -> Path:
    """Job: read the result of another station's run from the shared database, and return the path of its copy.

    Raises InputError if the run has no result there, ConfigurationError if the database cannot be used.
    """
    report(0.5)
    _fetch(station, [run])
    return run.log.with_suffix(".json")


def load_shared_results(
    report: ProgressCallback, station: Path | None, folder: Path, runs: Sequence[RunRecord]
) -> list[Result]:
    """Job: like `calstation.results.load_results`, for runs of all stations; see `fetch_result` for the errors."""
    _fetch(station, runs)
    return load_results(report, folder, runs)


def export_shared_runs(
    report: ProgressCallback, station: Path | None, folder: Path, wanted: RunFilter, target: Path
) -> Path:
    """Job: like `calstation.results.export_runs`, for runs of all stations; see `fetch_result` for the errors."""
    if target.suffix != ".csv":  # its rows are in the index
        _fetch(station, History(folder).runs(wanted, limit=None))
    return export_runs(report, folder, wanted, target)


def _fetch(station: Path | None, runs: Sequence[RunRecord]) -> None:
    """Copy the results of other stations' runs beside the place of their logs."""
    remote = [run for run in runs if run.origin and run.outcome != "incomplete"]
    if not remote:
        return
    from sqlalchemy import select
    from sqlalchemy.exc import DBAPIError

    from calstation.database import tables
    from calstation.database.connect import connect, public, reason_of

    path, config = load_station(station)
    if config.records.database is None:
        raise ConfigurationError("database.not_named", path=path)
    engine = connect(config.records.database)
    try:
        with engine.connect() as connection:
            for run in remote:
                wanted = (tables.runs.c.outbox == run.origin, tables.runs.c.name == run.log.stem)
                text = connection.execute(select(tables.runs.c.result).where(*wanted)).scalar()
                if text is None:
                    raise InputError("result.elsewhere", log=run.log.name, station=run.station or "?")
                target = run.log.with_suffix(".json")
                target.parent.mkdir(parents=True, exist_ok=True)
                write_atomic(target, text)
    except DBAPIError as exc:
        raise ConfigurationError("database.unreachable", database=public(engine.url), reason=reason_of(exc)) from exc
    finally:
        engine.dispose()
