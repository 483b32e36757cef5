"""Solutions in the shared database: written once each, found again by log or file, and read."""

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any, NamedTuple

import numpy as np
from sqlalchemy import ColumnElement, Engine, and_, case, func, not_, select, update
from sqlalchemy.dialects import postgresql, sqlite

from calstation.database import solutions
from calstation.fleet.changes import Changes
from calstation.results import Result

#: Solutions read at a time.
_CHUNK = 200
#: JSON of the result of a log that could not be solved; null for others.
_FAILED = case((solutions.c.outcome == "failed", solutions.c.result))


class StoredSolution(NamedTuple):
    """A solution in the database."""

    number: int
    error: dict[str, Any]  #: Why the log could not be solved, as in a result JSON; {} if it was.


@dataclass(frozen=True)
class Wanted:
    """What is solved in every log."""

    changes: Changes = field(default_factory=Changes)
    stages: tuple[str, ...] | None = None  #: None for those of the log.
    first_seq: int | None = None  #: None for the start of the log.
    last_seq: int | None = None  #: None for the end of the log.
    diagnostics: bool = True  #: Whether data and model are tested, or only the parameters solved.

    @property
    def columns(self) -> dict[str, Any]:
        """The columns of the solutions that say what was solved; one without diagnostics counts as changed."""
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


def label_used(engine: Engine, wanted: Wanted) -> bool:
    """Whether the version names solutions with other changes, another range or other stages."""
    others = (solutions.c.version == wanted.changes.version) & not_(and_(*_conditions(wanted.columns)))
    with engine.connect() as connection:
        return connection.execute(select(solutions.c.id).where(others).limit(1)).first() is not None


def solved_files(engine: Engine, wanted: Wanted) -> dict[tuple[str, str], StoredSolution]:
    """Return the solutions by location and fingerprint of their logs."""
    columns = (solutions.c.location, solutions.c.fingerprint, solutions.c.id, _FAILED)
    with engine.connect() as connection:
        rows = connection.execute(select(*columns).where(*_conditions(wanted.columns)))
        return {
            (location, fingerprint): StoredSolution(number, stored_error(text))
            for location, fingerprint, number, text in rows
        }


def last_number(engine: Engine) -> int:
    """Return the largest number of a solution; 0 if there is none."""
    with engine.connect() as connection:
        return connection.execute(select(func.max(solutions.c.id))).scalar() or 0


def find_solution(engine: Engine, wanted: Wanted, log_sha256: str, configuration_sha256: str) -> StoredSolution | None:
    """Return the solution of a log; None if there is none."""
    key = {**wanted.columns, "log_sha256": log_sha256, "configuration_sha256": configuration_sha256}
    with engine.connect() as connection:
        row = connection.execute(select(solutions.c.id, _FAILED).where(*_conditions(key))).first()
    return None if row is None else StoredSolution(row[0], stored_error(row[1]))


def set_location(engine: Engine, number: int, location: str, fingerprint: str) -> None:
    """Store where the log of a solution lies now, so that the next start need not read it."""
    moved = update(solutions).where(solutions.c.id == number).values(location=location, fingerprint=fingerprint)
    with engine.begin() as connection:
        connection.execute(moved)


def stored_error(text: str | None) -> dict[str, Any]:
    """Return the error in the JSON of a result; {} if there is none."""
    return {name: value for name, value in json.loads(text or "{}").items() if name.startswith("error")}


def add_solution(
    engine: Engine, wanted: Wanted, location: str, fingerprint: str, result: Result, text: str
) -> tuple[int, bool]:
    """Write a solution unless there is one; return its number, and whether it was written. `text` is its JSON."""
    rows = result.parameters
    numbers = [number for kind in ("value", "sigma") for number in (getattr(row, kind) for row in rows.values())]
    row = {
        **wanted.columns,
        "log_sha256": result.log.sha256,
        "configuration_sha256": result.configuration_sha256,
        "location": location,
        "fingerprint": fingerprint,
        "outcome": result.outcome,
        "error_code": result.error_code,
        "passed": result.passed,
        "serial": result.serial or None,
        "product": result.product,
        "station": result.station,
        "started_utc": result.started_utc,
        "failed_checks": json.dumps([check.name for check in result.failed_checks]),
        "parameters": json.dumps([*rows]),
        "numbers": np.array(numbers, dtype=float).tobytes(),
        "solved": datetime.now(UTC),
        "result": text,
    }
    insert = postgresql.insert if engine.dialect.name == "postgresql" else sqlite.insert
    with engine.begin() as connection:
        written = connection.execute(
            insert(solutions).values(row).on_conflict_do_nothing().returning(solutions.c.id)
        ).scalar()
    if written is not None:
        return int(written), True
    there = find_solution(engine, wanted, result.log.sha256, result.configuration_sha256)
    assert there is not None
    return there.number, False


def read_results(engine: Engine, numbers: Sequence[int]) -> Iterator[str]:
    """Yield the result JSON of solutions in order."""
    for start in range(0, len(numbers), _CHUNK):
        part = numbers[start : start + _CHUNK]
        with engine.connect() as connection:
            rows = connection.execute(select(solutions.c.id, solutions.c.result).where(solutions.c.id.in_(part)))
            found = {row.id: row.result for row in rows}
        yield from (found[number] for number in part)


def _conditions(values: Mapping[str, Any]) -> list[ColumnElement[bool]]:
    return [solutions.c[name] == value for name, value in values.items()]
