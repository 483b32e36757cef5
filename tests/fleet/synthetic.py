"""Many synthetic solutions in a database, for comparisons."""

import hashlib
import json
import sqlite3
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np

from calstation.database import connect
from calstation.physics import NAMES

COLUMNS = (
    "log_sha256, version, configuration_sha256, first_seq, last_seq, stages, changes_sha256, location, "
    "outcome, passed, serial, product, station, started_utc, failed_checks, parameters, numbers, solved, result"
)
BEGIN = datetime(2025, 1, 1, tzinfo=UTC)
_BLOCK = 10_000


def add_solutions(path: str, version: str, count: int, moved: float = 0.0, failed_every: int = 50) -> None:
    """Add solutions of `count` logs to a SQLite database; each value moves by a random part of `moved` sigmas.

    Every `failed_every`-th unit fails.
    """
    connect(f"sqlite:///{path}").dispose()
    with sqlite3.connect(path) as connection:
        connection.execute("PRAGMA synchronous=OFF")
        marks = ",".join("?" * len(COLUMNS.split(",")))
        connection.execute("INSERT INTO versions VALUES (?, '', 0, -1, '') ON CONFLICT DO NOTHING", (version,))
        statement = f"INSERT INTO solutions ({COLUMNS}) VALUES ({marks})"
        for start in range(0, count, _BLOCK):
            connection.executemany(statement, _rows(version, start, min(start + _BLOCK, count), moved, failed_every))
    connection.close()


def _rows(version: str, start: int, stop: int, moved: float, failed_every: int) -> Iterator[tuple[Any, ...]]:
    random = np.random.default_rng(start)
    sigma = 1e-6 * (1.0 + random.random((stop - start, len(NAMES))))
    value = 1e-4 * random.standard_normal((stop - start, len(NAMES)))
    value = value + moved * sigma * np.random.default_rng(start + 1).standard_normal(value.shape)
    numbers = np.concatenate([value, sigma], axis=1)
    parameters = json.dumps(NAMES)
    for k, row in zip(range(start, stop), numbers, strict=True):
        passed = k % failed_every != 0
        started = (BEGIN + timedelta(minutes=k % 1_000_000)).isoformat()
        yield (
            hashlib.sha256(str(k).encode()).hexdigest(), version, "", 0, -1, "", "", f"/logs/{k}.h5", "resolved",
            passed, f"SN-{k:07d}", f"product {k % 5}", f"station {k % 7}", started, "[]" if passed else '["a within"]',
            parameters, row.tobytes(), "2026-01-01 00:00:00.000000", "{}",
        )  # fmt: skip
