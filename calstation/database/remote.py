"""Runs of other stations: their logs in the archive and their results in the shared database.

The functions are named in the window, which imports neither the database nor the archive; the job process does.
"""

import re
from pathlib import Path

from calstation.config import load_station
from calstation.errors import ConfigurationError, InputError
from calstation.jobs import ProgressCallback
from calstation.records import RunRecord, write_atomic

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
    from sqlalchemy import select
    from sqlalchemy.exc import DBAPIError

    from calstation.database.connect import connect, public, reason_of
    from calstation.database.tables import runs

    path, config = load_station(station)
    if config.records.database is None:
        raise ConfigurationError("database.not_named", path=path)
    query = select(runs.c.result).where(runs.c.outbox == run.origin, runs.c.name == run.log.stem)
    engine = connect(config.records.database)
    report(0.5)
    try:
        with engine.connect() as connection:
            text = connection.execute(query).scalar()
    except DBAPIError as exc:
        raise ConfigurationError("database.unreachable", database=public(engine.url), reason=reason_of(exc)) from exc
    finally:
        engine.dispose()
    if text is None:
        raise InputError("result.elsewhere", log=run.log.name, station=run.station or "?")
    target = run.log.with_suffix(".json")
    target.parent.mkdir(parents=True, exist_ok=True)
    write_atomic(target, text)
    return target
