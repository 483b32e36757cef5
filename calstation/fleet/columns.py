"""Solutions of a version in Parquet files, which are updated from the database before they are used.

Each database has a folder in the folder of the site, with a subfolder for each version. Solutions are only added, but
solutions of the runs (version `ONLINE`) may be replaced: the last row of a run is valid. The numbers of solutions may
become visible out of order, so that a number below the last one may be missing. The number of rows reveals missing
and deleted rows; after a deletion the files are rebuilt.
"""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import Connection, Row, Select, func, select

from calstation.config import site_folder
from calstation.database import revisions, runs, solutions
from calstation.errors import ConfigurationError
from calstation.fleet.store import ONLINE, versions
from calstation.jobs import ProgressCallback
from calstation.judgement import End, verdict_of
from calstation.messages import os_reason
from calstation.physics import NAMES
from calstation.records import Categories, Verdict, estimates_by_name, locked, read_check_ids

try:
    import pyarrow as pa
    import pyarrow.parquet as pq
except ImportError as exc:
    raise ConfigurationError("database.not_installed") from exc

#: Number of rows that are read from the database and written at a time.
_CHUNK = 100_000
#: Maximum number of files of a version; more files are joined.
_MAX_FILES = 8
#: Timeout for another program that updates the same files, s.
_LOCK_TIMEOUT = 600.0

_TEXTS = (
    *("log_sha256", "serial", "product", "station", "started_utc", "month", "verdict", "failed_checks", "location"),
    *("batch", "slot"),
)
#: Columns of a solution that are part of the content of a run.
_FROM_CONTENT = ("product", "station", "batch", "slot")
#: Text columns with few distinct values.
_CATEGORICAL = ("product", "station", "month", "verdict")
SCHEMA = pa.schema(
    [
        ("number", pa.int64()),
        ("log_key", pa.uint64()),
        *((name, pa.string()) for name in _TEXTS),
        *((f"{name}{suffix}", pa.float64()) for name in NAMES for suffix in ("", "_sigma")),
    ],
)


@dataclass(frozen=True)
class ColumnFiles:
    """Parquet files of a version, which together contain all solutions."""

    paths: tuple[Path, ...]

    def read(self, *names: str, threads: bool = False) -> Any:
        """Return columns of all rows as a pyarrow table, which several threads read if `threads` is True."""
        categorical = [name for name in names if name in _CATEGORICAL]
        return pa.concat_tables(
            pq.read_table(path, columns=list(names), read_dictionary=categorical, use_threads=threads, memory_map=True)
            for path in self.paths
        )

    def numbers(self, name: str) -> NDArray[Any]:
        """Return a numeric column."""
        parts = [chunk.to_numpy() for chunk in self.read(name).column(0).chunks]
        return parts[0] if len(parts) == 1 else np.concatenate(parts)


def update_columns(report: ProgressCallback, connection: Connection, version: str) -> ColumnFiles:
    """Update the files of a version from the database.

    Raises ConfigurationError if the database has no such version, or if the files cannot be used.
    """
    database = connection.execute(select(revisions.c.database)).scalar_one()
    connection.rollback()  # PostgreSQL terminates a transaction that waits for the lock
    folder = site_folder() / "fleet" / str(database) / quote(version, safe="+.")
    with file_access(folder):
        folder.mkdir(parents=True, exist_ok=True)
        with locked(folder / ".lock", _LOCK_TIMEOUT):
            files = _update(report, connection, version, folder)
    if not files:
        raise ConfigurationError("fleet.no_version", version=version, versions=versions(connection))
    return ColumnFiles(tuple(files))


@contextmanager
def file_access(folder: Path) -> Iterator[None]:
    """Convert file errors in the context, including errors due to updates by other programs, to ConfigurationError."""
    try:
        yield
    except TimeoutError as exc:
        raise ConfigurationError("fleet.columns_locked", folder=folder) from exc
    except (OSError, pa.ArrowException) as exc:
        reason = os_reason(exc) if isinstance(exc, OSError) else str(exc).partition("\n")[0]
        raise ConfigurationError("fleet.columns_unusable", folder=folder, reason=reason) from exc


def _update(report: ProgressCallback, connection: Connection, version: str, folder: Path) -> list[Path]:
    files = _current_files(folder)
    stored = np.concatenate([np.empty(0, np.int64), *(ColumnFiles((path,)).numbers("number") for path in files)])
    last = int(stored.max(initial=0))
    added = _count(connection, _rows(version, last))
    after, remaining = last, added
    if version != ONLINE:
        total = _count(connection, _rows(version, 0))
        if len(stored) + added > total:  # rows were deleted
            for path in files:
                path.unlink()
            files, stored, after = [], stored[:0], 0
        elif len(stored) + added < total:
            numbers = connection.execute(_rows(version, 0).with_only_columns(solutions.c.id)).scalars().all()
            missing = np.setdiff1d(np.array(numbers, np.int64), stored)
            after = int(missing.min(initial=last + 1)) - 1
        remaining = total - len(stored)
    done = 0
    for table in _tables(connection, _rows(version, after), set(stored[stored > after].tolist())):
        files.append(folder / f"{_generation(files)}-{len(files):06d}.parquet")
        _write(table, files[-1])
        done += len(table)
        report(min(done / max(remaining, 1), 1.0))
    return [_join(files)] if len(files) > _MAX_FILES else files


def _generation(files: list[Path]) -> str:
    """Return the generation of files from their names; a generation begins when all files are joined into one."""
    return files[0].name.partition("-")[0] if files else f"{0:06d}"


def _current_files(folder: Path) -> list[Path]:
    """Return the files of the last generation, and delete earlier files that another program may have been reading.

    Files with other columns, written by an earlier version of the program, are also deleted.
    """
    files = sorted(folder.glob("*-*.parquet"))
    current = [path for path in files if _generation([path]) == _generation(files[-1:])]
    if any(not pq.read_schema(path).equals(SCHEMA) for path in current):
        current = []
    for path in set(files) - set(current):
        path.unlink()
    return current


def _rows(version: str, after: int) -> Select[Any]:
    """Return the query for the solutions of a version, or for the runs of all stations, above a number."""
    query: Select[Any]
    if version == ONLINE:
        r = runs.c
        query = select(r.revision.label("number"), r.log_sha256, r.serial, r.started_utc, r.failed_checks)
        query = query.add_columns(r.log.label("location"), r.content, r.parameters, r.numbers)
        return query.where(r.log_sha256.is_not(None), r.revision > after).order_by(r.revision)
    c = solutions.c
    query = select(c.id.label("number"), c.log_sha256, c.serial, c.product, c.station, c.started_utc, c.failed_checks)
    query = query.add_columns(c.location, c.outcome, c.passed, c.partial, c.batch, c.slot, c.parameters, c.numbers)
    return query.where(c.version == version, c.id > after).order_by(c.id)


def _count(connection: Connection, query: Select[Any]) -> int:
    return connection.execute(query.with_only_columns(func.count()).order_by(None)).scalar_one()


def _tables(connection: Connection, statement: Select[Any], stored: set[int]) -> Iterator[Any]:
    """Yield the rows of a statement in tables, except rows whose number is already stored."""
    result = connection.execution_options(yield_per=_CHUNK).execute(statement)
    for part in result.partitions(_CHUNK):
        rows = [row for row in part if row.number not in stored]
        if rows:
            yield _table(rows)


def _table(rows: list[Row[Any]]) -> Any:
    columns: dict[str, Any] = {
        "number": [row.number for row in rows],
        "log_key": np.array([int(row.log_sha256[:16], 16) for row in rows], np.uint64),
        **{name: [getattr(row, name) for row in rows] for name in ("log_sha256", "serial", "started_utc", "location")},
        "month": [(row.started_utc or "")[:7] for row in rows],
        "failed_checks": [", ".join(check.name for check in read_check_ids(row.failed_checks)) for row in rows],
    }
    if "content" in rows[0]._fields:
        contents = [json.loads(row.content) for row in rows]
        columns |= {name: [content.get(name) for content in contents] for name in _FROM_CONTENT}
        columns["verdict"] = [_verdict(Verdict(each["verdict"])) for each in contents]
    else:
        columns |= {name: [getattr(row, name) for row in rows] for name in _FROM_CONTENT}
        columns["verdict"] = [
            "error" if row.outcome == "failed" else _verdict(verdict_of(End.COMPLETED, row.passed, partial=row.partial))
            for row in rows
        ]
    parameters = Categories.of([row.parameters for row in rows])
    values, sigmas = estimates_by_name(parameters, [row.numbers for row in rows])
    missing = np.full(len(rows), np.nan)
    for name in NAMES:
        columns[name], columns[f"{name}_sigma"] = values.get(name, missing), sigmas.get(name, missing)
    return pa.table([columns[name] for name in SCHEMA.names], schema=SCHEMA)


def _verdict(verdict: Verdict) -> str:
    return verdict if verdict.judged and verdict.passed is not None else "unjudged"


def _write(table: Any, path: Path) -> None:
    """Write a file atomically, so that it is either complete or missing."""
    partial = path.with_suffix(".partial")
    compression = {field.name: "NONE" if field.type == pa.float64() else "ZSTD" for field in table.schema}
    pq.write_table(
        table,
        partial,
        compression=compression,
        use_dictionary=list(_CATEGORICAL),
        write_statistics=False,
        row_group_size=1 << 20,
    )
    partial.replace(path)


def _join(files: list[Path]) -> Path:
    """Join the files of a version into the first file of the next generation, and return it."""
    path = files[0].with_name(f"{int(_generation(files)) + 1:06d}-{0:06d}.parquet")
    _write(pa.concat_tables([pq.read_table(each, memory_map=True) for each in files]), path)
    return path


def latest_rows(files: ColumnFiles) -> tuple[NDArray[np.uint64], NDArray[np.intp]]:
    """Return the keys of the logs in order, and the row of the last solution of each log."""
    keys, numbers = files.numbers("log_key"), files.numbers("number")
    order = np.argsort(keys, kind="stable")
    ordered = keys[order]
    first = np.flatnonzero(np.append(True, ordered[1:] != ordered[:-1]))
    if len(first) < len(keys):
        order = np.lexsort((numbers, keys))
        last = np.append(first[1:], len(keys)) - 1
        return ordered[first], order[last]
    return ordered, order


def export_columns(files: ColumnFiles, path: Path) -> int:
    """Write the last solution of every log to one Parquet file, and return their number. Raises OSError."""
    _, rows = latest_rows(files)
    table = files.read(*(name for name in SCHEMA.names if name != "log_key")).take(np.sort(rows))
    _write(table, path)
    return len(table)
