"""Settings of the tasks of a request, and the solutions in the database."""

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any, Literal, NamedTuple

import numpy as np
from sqlalchemy import ColumnElement, Connection, Engine, Table, and_, case, exists, func, select
from sqlalchemy.dialects import postgresql, sqlite

from calstation import __version__
from calstation.database import locations, runs, solutions
from calstation.database import versions as versions_table
from calstation.errors import ConfigurationError
from calstation.fleet.changes import Changes
from calstation.fleet.sources import Origin, Selection, StoredLog
from calstation.results import Result

#: Version name of the results stored by the runs.
ONLINE = "online"
#: Number of solutions that are read at a time.
_CHUNK = 200
#: Number of files whose entries are read at a time.
_FILES = 10_000
#: Result JSON of a log that could not be solved; null for other logs.
_FAILED = case((solutions.c.outcome == "failed", solutions.c.result))


class StoredSolution(NamedTuple):
    """A solution in the database."""

    number: int
    error: dict[str, Any]  #: Why the log could not be solved, as in a result JSON; {} if it was solved.
    changed: bool | None  #: Whether configuration, range or stages differ from the log's own; None if unknown.
    attempt: int


class KnownFile(NamedTuple):
    """The database entry of a file."""

    origin: Origin
    solution: StoredSolution | None  #: None if its log has no solution.


@dataclass(frozen=True)
class SolveSettings:
    """Settings with which every log is solved."""

    changes: Changes = field(default_factory=Changes)
    stages: tuple[str, ...] | None = None  #: None for the stages of the log.
    first_seq: int | None = None  #: None for the start of the log.
    last_seq: int | None = None  #: None for the end of the log.
    diagnostics: bool = True  #: Whether data and model are tested; if not, only the parameters are solved.

    @property
    def differ_from_log(self) -> bool:
        """Whether the settings may differ from a log's own configuration, range or stages."""
        return bool(self.changes.entries) or (self.stages, self.first_seq, self.last_seq) != (None, None, None)

    @property
    def columns(self) -> dict[str, Any]:
        """The columns that identify the settings; solutions without diagnostics have another digest of the changes."""
        changes = self.changes.sha256
        return {
            "version": self.changes.version,
            "changes_sha256": changes
            if self.diagnostics
            else hashlib.sha256(f"parameters {changes}".encode()).hexdigest(),
            "first_seq": 0 if self.first_seq is None else self.first_seq,
            "last_seq": -1 if self.last_seq is None else self.last_seq,
            "stages": ",".join(self.stages or ()),
        }


#: ``failed`` means stored as failed, now or earlier; ``unreachable`` means failed but not stored.
Outcome = Literal["solved", "stored", "failed", "unreachable", "not_selected", "refused"]


@dataclass(frozen=True)
class Assignment:
    """Settings common to all tasks."""

    database: str
    settings: SolveSettings
    selection: Selection = field(default_factory=Selection)
    retry_failed: bool = False  #: Whether to solve again logs that are stored as failed.
    software: str = __version__


@dataclass(frozen=True)
class Status:
    """The outcome for a log."""

    location: str
    outcome: Outcome
    solution: int | None = None  #: Number of its solution in the database; None without a solution.
    error: dict[str, Any] = field(default_factory=dict)  #: The error as in a result JSON; {} if there is none.
    changed: bool | None = None  #: Whether configuration, range or stages differ from the log's own; None if unknown.
    seconds: dict[str, float] = field(default_factory=dict)  #: Duration of ``copy``, ``solve`` and ``write``.


def add_version(engine: Engine, settings: SolveSettings) -> bool:
    """Add a version if it is missing, even if several jobs do so at once; return whether it has these settings."""
    with engine.begin() as connection:
        connection.execute(_insert(connection, versions_table).values(settings.columns).on_conflict_do_nothing())
        query = select(versions_table.c.version).where(*_conditions(versions_table, settings.columns))
        return connection.execute(query).first() is not None


def known_files(engine: Engine, settings: SolveSettings) -> dict[tuple[str, str], KnownFile]:
    """Return the files in the database, with the solution of each file's log, by location and fingerprint."""
    is_same = and_(solutions.c.log_sha256 == locations.c.log_sha256, *_conditions(solutions, settings.columns))
    solution = (solutions.c.id, _FAILED, solutions.c.changed, solutions.c.attempt)
    query = select(*locations.c, *solution).join_from(locations, solutions, is_same, isouter=True)
    with engine.connect() as connection:
        return {
            (location, fingerprint): KnownFile(
                Origin(station, product, started),
                None if number is None else StoredSolution(number, stored_error(failed), changed, attempt),
            )
            for location, fingerprint, _, station, product, started, number, failed, changed, attempt in (
                connection.execution_options(yield_per=_FILES).execute(query.order_by(solutions.c.id))
            )
        }


def last_number(engine: Engine) -> int:
    """Return the largest number of a solution, or 0 if there is none."""
    with engine.connect() as connection:
        return connection.execute(select(func.max(solutions.c.id))).scalar() or 0


def versions(connection: Connection) -> list[str]:
    """Return the versions with solutions in the database, ``online`` first."""
    name = versions_table.c.version
    names = connection.execute(select(name).where(exists().where(solutions.c.version == name)).order_by(name)).scalars()
    online = connection.execute(select(runs.c.name).limit(1)).first() is not None
    return [*([ONLINE] if online else []), *names]


def require_version(connection: Connection, version: str) -> None:
    """Raise ConfigurationError if the database has no solutions of a version."""
    known = versions(connection)
    if version not in known:
        raise ConfigurationError("fleet.no_version", version=version, versions=known)


def find_solution(
    engine: Engine, settings: SolveSettings, log_sha256: str, configuration_sha256: str
) -> StoredSolution | None:
    """Return the last solution of a log, or None if there is none.

    Parameters
    ----------
    engine : database
    settings : version, range, stages and diagnostics of the solution
    log_sha256 : digest of the log
    configuration_sha256 : digest of the log's configuration
    """
    with engine.connect() as connection:
        return _solution(connection, _key(settings, log_sha256, configuration_sha256))


def add_location(engine: Engine, log: StoredLog, log_sha256: str | None, origin: Origin) -> None:
    """Store the digest of the log in a file, so that the file need not be read again.

    Parameters
    ----------
    engine : database
    log : location and fingerprint of the file
    log_sha256 : digest of the log; None if the file was not read to its end
    origin : station, product and start of the log
    """
    with engine.begin() as connection:
        _add_location(connection, log, log_sha256, origin)


def add_solution(
    engine: Engine,
    settings: SolveSettings,
    log: StoredLog,
    result: Result,
    text: str,
    *,
    changed: bool | None,
    retry: bool,
) -> tuple[int, bool]:
    """Write a solution and its location if it is missing; return its number and whether it was written.

    Parameters
    ----------
    engine : database
    settings : settings of the solution
    log : location of the log
    result : the solution
    text : its JSON
    changed : whether configuration, range or stages differ from the log's own; None if unknown
    retry : whether to write a solution in addition to a stored failure
    """
    rows = result.parameters
    numbers = [number for kind in ("value", "sigma") for number in (getattr(row, kind) for row in rows.values())]
    key = _key(settings, result.log.sha256, result.configuration_sha256)
    row = {
        **key,
        "location": log.location,
        "outcome": result.outcome,
        "error_code": result.error_code,
        "passed": result.passed,
        "partial": result.partial,
        "changed": changed,
        "serial": result.serial or None,
        "product": result.product,
        "station": result.station,
        "started_utc": result.started_utc,
        "batch": result.batch,
        "slot": result.slot,
        "failed_checks": json.dumps([check.id for check in result.failed_checks]),
        "parameters": json.dumps([*rows]),
        "numbers": np.array(numbers, dtype=float).tobytes(),
        "solved": datetime.now(UTC),
        "result": text,
    }
    with engine.begin() as connection:
        _add_location(connection, log, result.log.sha256, Origin(result.station, result.product, result.started_utc))
        existing = _solution(connection, key)
        if existing is None or (retry and existing.error):
            row["attempt"] = 0 if existing is None else existing.attempt + 1
            insert = _insert(connection, solutions).values(row).on_conflict_do_nothing().returning(solutions.c.id)
            written = connection.execute(insert).scalar()
            if written is not None:
                return int(written), True
            existing = _solution(connection, key)  # another worker has written the solution
        if existing is None:
            raise LookupError("the solution was deleted while it was written")
        return existing.number, False


def stored_error(text: str | None) -> dict[str, Any]:
    """Return the error in the JSON of a result, or {} if there is none."""
    return {name: value for name, value in json.loads(text or "{}").items() if name.startswith("error")}


def read_results(engine: Engine, numbers: Sequence[int]) -> Iterator[str]:
    """Yield the result JSON of each solution in order."""
    for start in range(0, len(numbers), _CHUNK):
        part = numbers[start : start + _CHUNK]
        with engine.connect() as connection:
            rows = connection.execute(select(solutions.c.id, solutions.c.result).where(solutions.c.id.in_(part)))
            results = {row.id: row.result for row in rows}
        yield from (results[number] for number in part)


def _add_location(connection: Connection, log: StoredLog, log_sha256: str | None, origin: Origin) -> None:
    if log.fingerprint is None:
        return
    values = {"log_sha256": log_sha256, **origin._asdict()}
    insert = _insert(connection, locations).values(location=log.location, fingerprint=log.fingerprint, **values)
    connection.execute(insert.on_conflict_do_update(index_elements=["location", "fingerprint"], set_=values))


def _solution(connection: Connection, key: Mapping[str, Any]) -> StoredSolution | None:
    columns = (solutions.c.id, _FAILED, solutions.c.changed, solutions.c.attempt)
    query = select(*columns).where(*_conditions(solutions, key)).order_by(solutions.c.attempt.desc()).limit(1)
    row = connection.execute(query).first()
    return None if row is None else StoredSolution(row[0], stored_error(row[1]), row[2], row[3])


def _key(settings: SolveSettings, log_sha256: str, configuration_sha256: str) -> dict[str, Any]:
    return {**settings.columns, "log_sha256": log_sha256, "configuration_sha256": configuration_sha256}


def _insert(connection: Connection, table: Table) -> Any:
    """Return an INSERT statement in the dialect of the database, which can ignore or update existing rows."""
    return (postgresql if connection.dialect.name == "postgresql" else sqlite).insert(table)


def _conditions(table: Table, values: Mapping[str, Any]) -> list[ColumnElement[bool]]:
    return [table.c[name] == value for name, value in values.items()]
