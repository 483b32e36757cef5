"""Comparison and export of versions, also as jobs; they import the optional package pyarrow only when they run."""

import json
from collections.abc import Collection
from pathlib import Path

from calstation.database import database_of, open_database
from calstation.errors import ConfigurationError
from calstation.fleet.comparison import Comparison
from calstation.jobs import ProgressCallback
from calstation.messages import os_reason
from calstation.records import write_atomic


def compare(
    report: ProgressCallback, url: str, before: str, after: str, numbers: Collection[int] | None = None
) -> Comparison:
    """Job: compare the solutions of two versions in a database; ``online`` means the results of the runs.

    If a version has several solutions of a log, the last one is used. Raises ConfigurationError if the database is
    missing, cannot be used or has no such version.

    Parameters
    ----------
    report : called with the progress
    url : URL of the database
    before, after : versions to compare
    numbers : numbers of the compared solutions of `after`; None for all
    """
    from calstation.fleet.columns import file_access, update_columns
    from calstation.fleet.comparing import CommonLogs, update_progress

    with open_database(url, create=False) as engine, engine.connect() as connection:
        old = update_columns(update_progress(report, 0.0), connection, before)
        new = update_columns(update_progress(report, 0.5), connection, after)
    with file_access(new.paths[0].parent):
        return CommonLogs(old, new, numbers).comparison(report, before, after)


def export_version(report: ProgressCallback, url: str, version: str, path: Path) -> int:
    """Job: write the solutions of a version to a Parquet file, and return their number. Raises ConfigurationError."""
    from calstation.fleet.columns import export_columns, update_columns
    from calstation.fleet.comparing import update_progress

    with open_database(url, create=False) as engine, engine.connect() as connection:
        files = update_columns(update_progress(report, 0.0), connection, version)
    try:
        return export_columns(files, path)
    except OSError as exc:
        raise ConfigurationError("csv.not_written", file=path, reason=os_reason(exc)) from exc


def versions_job(report: ProgressCallback, station: Path | None) -> list[str]:
    """Job: return the versions of solutions in the database of a station. Raises ConfigurationError."""
    from calstation.fleet.columns import versions

    with open_database(database_of(station)[0]) as engine, engine.connect() as connection:
        report(0.5)
        return versions(connection)


def compare_job(report: ProgressCallback, station: Path | None, before: str, after: str) -> Comparison:
    """Job: compare two versions in the database of a station. Raises ConfigurationError."""
    return compare(report, database_of(station)[0], before, after)


def export_job(report: ProgressCallback, station: Path | None, before: str, after: str, target: Path) -> Path:
    """Job: write the comparison to a JSON file, or the solutions of the version `after` to a Parquet file.

    Returns `target`. Raises ConfigurationError.
    """
    url = database_of(station)[0]
    if target.suffix == ".parquet":
        export_version(report, url, after, target)
        return target
    text = json.dumps(compare(report, url, before, after).to_json(), indent=2, ensure_ascii=False)
    try:
        write_atomic(target, text)
    except OSError as exc:
        raise ConfigurationError("csv.not_written", file=target, reason=os_reason(exc)) from exc
    return target
