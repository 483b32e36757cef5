"""Synthetic solutions in a database for comparisons."""

import base64
import hashlib
import json
import random
import sqlite3
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np
import psycopg

from calstation.database import connect
from calstation.physics import NAMES

COLUMNS = (
    "log_sha256, version, configuration_sha256, first_seq, last_seq, stages, changes_sha256, location, "
    "outcome, passed, serial, product, station, started_utc, failed_checks, parameters, numbers, solved, result"
)
BEGIN = datetime(2025, 1, 1, tzinfo=UTC)
_BLOCK = 10_000
#: Text that cannot be compressed; a result is a part of it.
_TEXT = base64.b64encode(random.Random(1).randbytes(750_000)).decode()


def add_solutions(
    url: str, version: str, count: int, moved: float = 0.0, failed_every: int = 50, result_size: int = 2
) -> None:
    """Add solutions of `count` logs; each value changes by a random part of `moved` sigmas.

    Every `failed_every`-th unit fails. The result of each has `result_size` characters.
    """
    connect(url).dispose()
    starts = range(0, count, _BLOCK)
    rows = (
        row
        for start in starts
        for row in _rows(version, start, min(start + _BLOCK, count), moved, failed_every, result_size)
    )
    entered = f"INSERT INTO versions VALUES ('{version}', '', 0, -1, '') ON CONFLICT DO NOTHING"
    if url.startswith("sqlite"):
        with sqlite3.connect(url.removeprefix("sqlite:///")) as connection:
            connection.execute("PRAGMA synchronous=OFF")
            marks = ",".join("?" * len(COLUMNS.split(",")))
            connection.execute(entered)
            connection.executemany(f"INSERT INTO solutions ({COLUMNS}) VALUES ({marks})", rows)
        connection.close()
        return
    with psycopg.connect(url.replace("+psycopg", "")) as server, server.cursor() as cursor:
        cursor.execute(entered)
        with cursor.copy(f"COPY solutions ({COLUMNS}) FROM STDIN") as copy:
            for row in rows:
                copy.write_row(row)


def _rows(
    version: str, start: int, stop: int, moved: float, failed_every: int, result_size: int
) -> Iterator[tuple[Any, ...]]:
    generator = np.random.default_rng(start)
    sigma = 1e-6 * (1.0 + generator.random((stop - start, len(NAMES))))
    value = 1e-4 * generator.standard_normal((stop - start, len(NAMES)))
    value = value + moved * sigma * np.random.default_rng(start + 1).standard_normal(value.shape)
    numbers = np.concatenate([value, sigma], axis=1)
    parameters = json.dumps(NAMES)
    for k, row in zip(range(start, stop), numbers, strict=True):
        passed = k % failed_every != 0
        started = (BEGIN + timedelta(minutes=k % 1_000_000)).isoformat()
        begin = 7 * k % (len(_TEXT) - result_size)
        yield (
            hashlib.sha256(str(k).encode()).hexdigest(), version, "", 0, -1, "", "", f"/logs/{k}.h5", "resolved",
            passed, f"SN-{k:07d}", f"product {k % 5}", f"station {k % 7}", started,
            "[]" if passed else '[["within", "a"]]', parameters, row.tobytes(), "2026-01-01 00:00:00.000000",
            _TEXT[begin : begin + result_size],
        )  # fmt: skip
