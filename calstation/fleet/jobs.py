"""Jobs of the window, which refers to them without importing the database."""

import json
from pathlib import Path

from calstation.config import load_station
from calstation.errors import ConfigurationError
from calstation.fleet.comparison import Comparison
from calstation.jobs import ProgressCallback
from calstation.messages import os_reason
from calstation.records import write_atomic


def versions_job(report: ProgressCallback, station: Path | None) -> list[str]:
    """Job: return the versions of solutions in the database of a station. Raises ConfigurationError."""
    from calstation.fleet.columns import versions
    from calstation.fleet.store import opened

    with opened(_database(station)) as engine, engine.connect() as connection:
        report(0.5)
        return versions(connection)


def compare_job(report: ProgressCallback, station: Path | None, before: str, after: str) -> Comparison:
    """Job: compare two versions in the database of a station. Raises ConfigurationError."""
    from calstation.fleet.comparing import compare

    return compare(report, _database(station), before, after)


def export_job(report: ProgressCallback, station: Path | None, before: str, after: str, target: Path) -> Path:
    """Job: write the comparison to a JSON file, or the solutions of the version `after` to a Parquet file.

    Returns `target`. Raises ConfigurationError.
    """
    from calstation.fleet.comparing import compare, export_version

    url = _database(station)
    if target.suffix == ".parquet":
        export_version(report, url, after, target)
        return target
    text = json.dumps(compare(report, url, before, after).to_json(), indent=2, ensure_ascii=False)
    try:
        write_atomic(target, text)
    except OSError as exc:
        raise ConfigurationError("csv.not_written", file=target, reason=os_reason(exc)) from exc
    return target


def _database(station: Path | None) -> str:
    path, config = load_station(station)
    if config.records.database is None:
        raise ConfigurationError("database.not_named", path=path)
    return config.records.database
