"""Small result files, as written by runs, for tests of the exchange."""

import json
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

from sqlalchemy import create_engine, select

from calstation.database import runs
from calstation.records import RunFilter, RunIndex

BEGIN = datetime(2026, 11, 1, tzinfo=UTC)


def write_result(folder: Path, name: str, number: int, serial: str = "SN-1", **more: Any) -> Path:
    """Write the result of a run that started `number` minutes after the first; the file appears atomically."""
    path = folder / f"{name}.json"
    result = {
        "schema": "calstation.result/1",
        "unit": {"serial": serial},
        "stages": ["rate"],
        "parameters": {"gyro_bias_x": {"value": 0.1 * number, "sigma": 1e-8}},
        "outcome": "passed",
        "attempt": 1,
        "operator": "li",
        "station": folder.name,
        "product": "Navigation grade A",
        "log": {"file": f"{name}.h5", "sha256": "0" * 64},
        "started_utc": (BEGIN + timedelta(minutes=number)).isoformat(),
        "duration_s": 100.0,
        **more,
    }
    partial = path.with_suffix(".partial")
    partial.write_text(json.dumps(result), encoding="utf-8")
    partial.replace(path)
    return path


def in_database(url: str) -> list[tuple[str, str]]:
    """Return name and station of all runs in a database, in order of arrival."""
    engine = create_engine(url)
    with engine.connect() as connection:
        rows = connection.execute(select(runs.c.name, runs.c.content).order_by(runs.c.revision)).all()
    engine.dispose()
    return [(row.name, json.loads(row.content)["station"]) for row in rows]


def in_index(folder: Path) -> list[tuple[str, str | None, str, dict[str, float]]]:
    """Return name, station, verdict and values of all runs in the index of a folder."""
    found = RunIndex(folder).find(RunFilter())
    return sorted((run.name, run.record.station, run.record.badge, dict(run.values)) for run in found)
