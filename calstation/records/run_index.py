"""Search index of runs in SQLite, which is rebuilt from the authoritative files of the runs if it is lost."""

import secrets
import sqlite3
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import sqlalchemy as sa
from sqlalchemy.exc import DatabaseError
from sqlalchemy.pool import NullPool, StaticPool

from calstation.errors import ConfigurationError
from calstation.records.check_id import read_check_ids
from calstation.records.indexed_run import (
    LATEST_FIRST,
    TABLE_PREFIX,
    Categories,
    IndexedRun,
    RunChoices,
    RunColumns,
    RunFilter,
    RunOrder,
    RunRecord,
    estimates_by_name,
    from_columns,
    natural_key,
    record_from,
)
from calstation.records.run_tables import (
    ACKNOWLEDGED,
    ACKNOWLEDGED_AT,
    CHANGE_TOKEN,
    CHANGED,
    LATEST,
    MEASURED,
    METADATA,
    NO_CHECKS,
    PRESENT,
    RECEIVED,
    ROWID,
    RUNS,
    conditions_of,
    row_of,
    sort_key,
)
from calstation.records.verdict import Verdict

#: Version of the table layout; an index of another version is rebuilt.
_VERSION = 21

#: File name of the index in the folder of the runs.
FILE = "history.sqlite"

#: Julian day of 1970-01-01T00:00 UTC.
_EPOCH = 2440587.5

#: Longest time to wait for another program that has locked the index, s.
_BUSY_S = 5.0

#: Time after which an index in memory tries its file again, s.
_RETRY_S = 10.0

#: Number of runs that are removed in one transaction, so that other programs wait only briefly for the index.
_MAX_REMOVED = 1000

#: SQLite errors for a damaged file or a file that is not a database; all others, such as a full disk, may be temporary.
_DAMAGED = (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB)

T = TypeVar("T")


class RunIndex:
    """Index of a folder of runs; it is kept in memory while its file is unusable, which thus never stops a run."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._path = folder / FILE
        self.may_lack_runs = False  #: Whether runs may be missing, because the index is new or its file was unusable.
        self._engine = _engine(f"sqlite:///{self._path}", NullPool)
        self._open: sa.Connection | None = None  #: Connection of `one_connection`.
        self._file_id: int | None = None  #: Random number stored in the file that was used last.
        self._memory: sa.Engine | None = None  #: Index in memory, which replaces the file until `_retry_at`.
        self._retry_at = 0.0
        #: Stamps as last read, with the value of `change_token` at that time.
        self._stamps: tuple[str | None, dict[str, str]] = (None, {})
        self._try(_create)

    @contextmanager
    def one_connection(self) -> Iterator[None]:
        """Use one connection in this context, because opening the file takes longer than most queries."""
        if self._open is not None:
            yield
            return
        with suppress(DatabaseError, OSError):  # the queries handle an unusable file
            self._open = self._engine.connect()
        try:
            yield
        finally:
            self._close()

    def _close(self) -> None:
        if self._open is not None:
            self._open.close()
            self._open = None

    @property
    def change_token(self) -> str | None:
        """Random value that changes with every change of the runs; None before the first change."""
        return self._try(lambda connection: connection.execute(CHANGE_TOKEN).scalar())

    def stamps(self) -> Mapping[str, str]:
        """Return the stamps of the runs of the folder by name, without those whose files are missing."""
        query = sa.select(RUNS.c.name, RUNS.c.stamp).where(RUNS.c.origin == "", PRESENT)

        def read(connection: sa.Connection) -> dict[str, str]:
            token = connection.execute(CHANGE_TOKEN).scalar()
            if token is None or token != self._stamps[0]:
                self._stamps = token, dict(_rows(connection, query))
            return self._stamps[1]

        return self._try(read)

    def update(self, runs: Iterable[IndexedRun], removed: Iterable[str] = (), missing: Iterable[str] = ()) -> None:
        """Add or replace runs of the folder, remove those in `removed`, and mark those in `missing` as missing."""
        rows, names, lost = [row_of(run) for run in runs], [*removed], [*missing]
        content = sa.func.json_set(RUNS.c.content, "$.missing", sa.func.json("true"))

        def change(connection: sa.Connection) -> None:
            for name in names:
                connection.execute(sa.delete(RUNS).where(RUNS.c.origin == "", RUNS.c.name == name))
            for name in lost:
                row = sa.update(RUNS).where(RUNS.c.origin == "", RUNS.c.name == name)
                connection.execute(row.values(missing=True, content=content))
            _store(connection, rows)

        if rows or names or lost:
            self._try(change)

    def names(self) -> dict[str, bool]:
        """Return the names of the runs of the folder, and whether their files are known to be missing."""
        query = sa.select(RUNS.c.name, RUNS.c.missing).where(RUNS.c.origin == "")
        return {name: bool(missing) for name, missing in self._select(query)}

    def runs_by_name(self, names: Sequence[str]) -> list[IndexedRun]:
        """Return the runs of the folder with these names."""
        return self._select_runs(sa.select(RUNS).where(RUNS.c.origin == "", RUNS.c.name.in_(names)))

    def received(self) -> tuple[str, int]:
        """Return the name of the shared database and the last revision received from it; ("", 0) if there is none.

        Raises ConfigurationError if the file is currently unusable.
        """
        rows = self._in_file(lambda connection: connection.execute(sa.select(RECEIVED)).all())
        return (rows[0].database, rows[0].revision) if rows else ("", 0)

    def receive(self, runs: Iterable[IndexedRun], database: str, revision: int, after: int = 0) -> None:
        """Add or replace runs of other folders, received from a shared database up to a revision.

        Runs received from another database are removed. Raises ConfigurationError if the file is currently unusable.

        Parameters
        ----------
        runs, database : received runs, and name of the shared database
        revision : revision of the last run
        after : revision after which the runs were requested; nothing is stored if the earlier runs have been lost
        """
        rows = [row_of(run) for run in runs]

        def change(connection: sa.Connection) -> None:
            if after and (database, after) not in _rows(connection, sa.select(RECEIVED)):
                return
            connection.execute(sa.delete(RECEIVED))
            connection.execute(sa.insert(RECEIVED).values(database=database, revision=revision))
            _store(connection, rows)

        if self.received()[0] != database:
            self._in_file(lambda connection: connection.execute(sa.delete(RECEIVED)))
            some = sa.select(ROWID).select_from(RUNS).where(RUNS.c.origin > "").limit(_MAX_REMOVED)
            while self._in_file(lambda connection: connection.execute(sa.delete(RUNS).where(ROWID.in_(some))).rowcount):
                pass
        self._in_file(change)

    def acknowledged_revision(self) -> int:
        """Return the revision of the acknowledged stamps in the shared database; 0 if there is none."""
        return self._try(lambda connection: connection.execute(sa.select(ACKNOWLEDGED_AT.c.revision)).scalar() or 0)

    def acknowledged(self) -> dict[tuple[str, str], str]:
        """Return the stamps that the shared database has acknowledged, by kind of message and name of the run."""
        return {(kind, name): stamp for kind, name, stamp in self._select(sa.select(ACKNOWLEDGED))}

    def acknowledge(self, revision: int, stamps: Iterable[tuple[str, str, str]], *, replace: bool) -> None:
        """Store kind, name and stamp of messages acknowledged at a revision; `replace` removes all others."""
        rows = [{"kind": kind, "name": name, "stamp": stamp} for kind, name, stamp in stamps]

        def change(connection: sa.Connection) -> None:
            if replace:
                connection.execute(sa.delete(ACKNOWLEDGED))
            connection.execute(sa.delete(ACKNOWLEDGED_AT))
            connection.execute(sa.insert(ACKNOWLEDGED_AT).values(revision=revision))
            if rows:
                connection.execute(sa.insert(ACKNOWLEDGED).prefix_with("OR REPLACE"), rows)

        self._try(change)

    def find(self, conditions: RunFilter, limit: int | None = None) -> list[IndexedRun]:
        """Find at most `limit` runs that meet all conditions, the latest first."""
        rows = sa.select(ROWID).select_from(RUNS).where(*conditions_of(conditions))
        part = ROWID.in_(rows.order_by(*LATEST).limit(limit))
        return self._select_runs(sa.select(RUNS).where(part).order_by(*LATEST))

    def records(self, conditions: RunFilter, limit: int | None, offset: int, order: RunOrder) -> list[RunRecord]:
        """Return records of at most `limit` matching runs, sorted by `order`, starting at `offset`."""
        key = sort_key(order.field)
        by = LATEST if order == LATEST_FIRST else (key.desc() if order.descending else key, *LATEST)
        matching = sa.select(ROWID).select_from(RUNS).where(*conditions_of(conditions)).order_by(*by)
        part = ROWID.in_(matching.limit(limit).offset(offset))
        query = sa.select(RUNS.c.content).where(part).order_by(*by)
        return [self._located(record_from(content)) for (content,) in self._select(query)]

    def counts(self, conditions: RunFilter) -> tuple[int, int]:
        """Return the number of matching runs, and how many of them have files."""
        with_files = sa.func.count(sa.case((RUNS.c.missing, None), else_=1))
        query = sa.select(sa.func.count(), with_files).select_from(RUNS).where(*conditions_of(conditions))
        count, present = self._try(lambda connection: connection.execute(query).one())
        return int(count), int(present)

    def choices(self) -> RunChoices:
        """Return the values that can be chosen as conditions."""
        query = sa.select(RUNS.c.product, RUNS.c.station, RUNS.c.operator).distinct()
        query_first = sa.select(sa.func.min(RUNS.c.started_utc)).where(RUNS.c.started_utc != "")
        rows, first = self._try(
            lambda connection: (connection.execute(query).all(), connection.execute(query_first).scalar())
        )
        products, stations, operators = (tuple(sorted({row[k] for row in rows if row[k]})) for k in range(3))
        return RunChoices(products, stations, operators, first or "")

    def runs_of_unit(
        self,
        serial: str,
        verdicts: tuple[Verdict, ...] | None = None,
        before: str | None = None,
        limit: int | None = None,
        product: str | None = "",
        *,
        missing: bool = False,
        measured: bool = False,
    ) -> list[IndexedRun]:
        """Return runs of a unit, the latest first.

        Parameters
        ----------
        serial : serial number of the unit
        verdicts : verdicts of the runs; None for any verdict
        before : exclusive upper limit of the start, ISO 8601; None for no limit
        limit : largest number of runs; None for no limit
        product : product of the runs; "" for any product
        missing : whether to include runs whose files are missing
        measured : whether to leave out simulated runs
        """
        query = _of_kind(sa.select(RUNS).where(RUNS.c.serial == serial), measured=measured)
        if not missing:
            query = query.where(PRESENT)
        if product != "":
            query = query.where(RUNS.c.product == product)
        if verdicts is not None:
            query = query.where(RUNS.c.verdict.in_(verdicts))
        if before is not None:
            query = query.where(RUNS.c.started_utc < before)
        return self._select_runs(query.order_by(*LATEST).limit(limit))

    def passed_units(self, *, measured: bool = False) -> set[str]:
        """Return the serial numbers of the units with a run that passed and was not partial; see `runs_of_unit`."""
        query = sa.select(RUNS.c.serial).where(RUNS.c.verdict == Verdict.PASSED, sa.not_(RUNS.c.partial), PRESENT)
        return {serial for (serial,) in self._select(_of_kind(query, measured=measured).distinct())}

    def spellings(self, serial: str, *, measured: bool = False) -> list[str]:
        """Return the serial numbers that differ from this one at most in case, including runs without files.

        The serial number itself is included if it has runs; see `runs_of_unit`. Case is ignored for ASCII letters only.
        """
        query = sa.select(RUNS.c.serial).where(RUNS.c.serial.collate("NOCASE") == serial)
        return sorted(str(row[0]) for row in self._select(_of_kind(query, measured=measured).distinct()))

    def attempts(self, serial: str, *, measured: bool = False) -> int:
        """Return the number of runs started for a unit, including runs without files; a resumed run counts once.

        The result is at least the largest attempt number of a run, because the index may lack some runs. Stations with
        hardware number simulated and measured runs separately, so that only the more numerous kind counts; if
        `measured`, only measured runs count.
        """
        query = sa.select(sa.func.count()).where(RUNS.c.serial == serial, RUNS.c.resumed_from.is_(None))
        query = query.where(MEASURED) if measured else query.group_by(RUNS.c.simulated)
        return max([*(int(row[0]) for row in self._select(query)), *self.attempt_numbers(serial, measured=measured), 0])

    def attempt_numbers(self, serial: str, *, measured: bool = False) -> list[int]:
        """Return the distinct attempt numbers of a unit's runs, including runs without files; see `attempts`."""
        number = sa.func.json_extract(RUNS.c.content, "$.attempt")
        query = sa.select(number).where(RUNS.c.serial == serial).distinct()
        return [int(row[0]) for row in self._select(_of_kind(query, measured=measured))]

    def columns(self, conditions: RunFilter) -> RunColumns:
        """Return the runs that meet all conditions and have a start time, in columns."""
        days = sa.func.julianday(RUNS.c.started_utc)  # SQL NULL for an invalid time
        fields = ("name", "serial", "verdict", "product", "station", "operator", "partial", "check_standard", "missing")
        where = (days.is_not(None), *conditions_of(conditions))

        def read(connection: sa.Connection) -> tuple[str, list[tuple[Any, ...]]]:
            # NULL replaces a text that most rows share, because reading 50,000 equal texts takes a fifth of the time
            usual_parameters = connection.execute(sa.select(RUNS.c.parameters).where(*where).limit(1)).scalar() or ""
            texts = (
                sa.func.nullif(RUNS.c.failed_checks, NO_CHECKS),
                sa.func.nullif(RUNS.c.parameters, usual_parameters),
            )
            query = sa.select(days, *(RUNS.c[name] for name in fields), *texts, RUNS.c.numbers)
            return usual_parameters, _rows(connection, query.where(*where))

        usual_parameters, rows = self._try(read)
        # sorted here, because SQLite would read the rows in the order of time, which is slow random access
        order = np.argsort([row[0] for row in rows], kind="stable")
        columns = zip(*map(rows.__getitem__, order.tolist()), strict=True) if rows else [()] * 13
        days_started, names, *texts, partial, standard, missing, failed, parameters, numbers = columns
        serials, verdicts, products, stations, operators = (Categories.of(column) for column in texts)
        values, sigmas = estimates_by_name(Categories.of(parameters), numbers, usual_parameters)
        checks = Categories.of(failed)
        of_table = [name for name in values if name.startswith(TABLE_PREFIX)]
        table = {name.removeprefix(TABLE_PREFIX): values.pop(name) for name in of_table}
        return RunColumns(
            names,
            serials,
            np.round((np.array(days_started, dtype=float) - _EPOCH) * 86400.0, 3),
            Categories(tuple(map(Verdict, verdicts.values)), verdicts.codes),
            products,
            stations,
            operators,
            np.array(partial, dtype=bool),
            np.array(standard, dtype=bool),
            np.array(missing, dtype=bool),
            Categories(tuple(read_check_ids(each or NO_CHECKS) for each in checks.values), checks.codes),
            values,
            {name: sigmas[name] for name in values},
            table,
        )

    def _select(self, query: sa.Select[Any]) -> list[tuple[Any, ...]]:
        return self._try(lambda connection: _rows(connection, query))

    def _select_runs(self, query: sa.Select[Any]) -> list[IndexedRun]:
        return self._try(lambda connection: [self._run(row) for row in connection.execute(query)])

    def _run(self, row: sa.Row[Any]) -> IndexedRun:
        """Return a stored run with the paths of its files in the folder of the index."""
        run = from_columns(row.name, row.stamp, row.content, row.failed_checks, row.parameters, row.numbers)
        return replace(run, record=self._located(run.record))

    def _located(self, record: RunRecord) -> RunRecord:
        """Return a record with the paths of its files in the folder of the index.

        The log of a run of another folder is in a folder named after the outbox of the run.
        """
        result = record.result and self._folder / record.result.name
        return replace(record, log=self._folder / record.origin / record.log.name, result=result)

    def _try(self, action: Callable[[sa.Connection], T]) -> T:
        """Execute `action` on the file, or in memory while the file cannot be used."""
        if time.monotonic() >= self._retry_at:
            try:
                result = self._execute_or_recreate(action)
            except (DatabaseError, OSError):
                self._retry_at = time.monotonic() + _RETRY_S
            else:
                if self._memory is not None:
                    self._memory, self.may_lack_runs = None, True
                return result
        if self._memory is None:
            self._memory, self.may_lack_runs = _engine("sqlite://", StaticPool), True
            with self._memory.begin() as connection:
                _create(connection)
        with self._memory.begin() as connection:
            return action(connection)

    def _in_file(self, action: Callable[[sa.Connection], T]) -> T:
        """Execute `action` on the file. Raises ConfigurationError if the file is currently unusable."""
        try:
            return self._execute_or_recreate(action)
        except (DatabaseError, OSError) as exc:
            reason = str(exc.orig if isinstance(exc, DatabaseError) else exc)
            raise ConfigurationError("database.index_unusable", file=self._path, reason=reason) from exc

    def _execute_or_recreate(self, action: Callable[[sa.Connection], T]) -> T:
        """Execute `action` on the file, or on a new file if the file is damaged or missing."""
        try:
            return self._execute(action)
        except DatabaseError as exc:
            if not _is_lost(exc):
                raise
        self._close()
        self._engine.dispose()
        for suffix in ("", "-wal", "-shm", "-journal"):
            self._path.with_name(self._path.name + suffix).unlink(missing_ok=True)
        self._execute(_create)
        self.may_lack_runs = True
        return self._execute(action)

    def _execute(self, action: Callable[[sa.Connection], T]) -> T:
        """Execute `action`, and detect whether another process has replaced the file since it was last used."""
        file: AbstractContextManager[sa.Connection] = nullcontext(self._open) if self._open else self._engine.connect()
        with file as connection, connection.begin():
            result = action(connection)
            file_id = connection.exec_driver_sql("PRAGMA application_id").scalar_one()
        self.may_lack_runs = self.may_lack_runs or self._file_id not in (None, file_id)
        self._file_id = file_id
        return result


def _is_lost(error: DatabaseError) -> bool:
    """Return whether the file is damaged, not a database, or lacks a table, rather than locked or out of space."""
    code: int = getattr(error.orig, "sqlite_errorcode", 0)
    return code & 0xFF in _DAMAGED or str(error.orig).startswith("no such table")


def _engine(url: str, pool: type[sa.Pool]) -> sa.Engine:
    engine = sa.create_engine(url, poolclass=pool, connect_args={"timeout": _BUSY_S, "check_same_thread": False})

    @sa.event.listens_for(engine, "connect")
    def _prepare(connection: sqlite3.Connection, _: object) -> None:
        with suppress(sqlite3.OperationalError):  # WAL is not available in a network folder
            connection.execute("PRAGMA journal_mode=WAL")
        connection.execute("PRAGMA synchronous=OFF")  # the index is rebuilt after a power failure
        connection.create_function("natural_key", 1, natural_key, deterministic=True)

    return engine


def _create(connection: sa.Connection) -> None:
    """Create the tables, replacing those of an index of another version.

    A lock keeps two processes that open a new index from replacing each other's tables.
    """
    version = sa.text("PRAGMA user_version")
    if connection.execute(version).scalar_one() == _VERSION:
        return
    connection.exec_driver_sql("BEGIN IMMEDIATE")
    if connection.execute(version).scalar_one() != _VERSION:
        METADATA.drop_all(connection)
        METADATA.create_all(connection)
        connection.execute(sa.text(f"PRAGMA user_version={_VERSION}"))
        connection.execute(sa.text(f"PRAGMA application_id={secrets.randbelow(2**31)}"))


def _of_kind(query: sa.Select[Any], *, measured: bool) -> sa.Select[Any]:
    return query.where(MEASURED) if measured else query


def _rows(connection: sa.Connection, query: sa.Select[Any]) -> list[tuple[Any, ...]]:
    """Return the rows as tuples of SQLite, which takes a third of the time that SQLAlchemy's rows take."""
    cursor = connection.execute(query).cursor
    return [] if cursor is None else list(cursor.fetchall())


def _store(connection: sa.Connection, rows: list[dict[str, Any]]) -> None:
    """Add or replace rows, and change `change_token`."""
    if rows:
        connection.execute(sa.insert(RUNS).prefix_with("OR REPLACE"), rows)
    connection.execute(sa.delete(CHANGED))
    connection.execute(sa.insert(CHANGED).values(mark=secrets.token_hex(8)))
