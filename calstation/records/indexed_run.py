"""Representations of indexed runs: a single run, many runs in columns, and the conditions that select runs."""

import json
import math
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cache, cached_property
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np
from pydantic import TypeAdapter

from calstation.physics import BoolArray, FloatArray, IntArray
from calstation.records.check_id import CheckId, read_check_ids
from calstation.records.verdict import Verdict

T = TypeVar("T")
#: Prefix of the names of the table's quantities in the column `parameters` of the index.
TABLE_PREFIX = "table."
_DIGITS = re.compile(r"\d+")


@dataclass(frozen=True)
class RunRecord:
    """A run in the index. For a run of another folder, `log` does not exist and `result` is None."""

    serial: str
    started_utc: str  #: Start of the run, ISO 8601.
    verdict: Verdict
    attempt: int
    product: str | None
    station: str | None
    operator: str | None
    stages: tuple[str, ...]  #: Stages that were solved.
    log: Path
    result: Path | None  #: File of the result; None if there is no result.
    duration: float  #: Duration of the samples, s.
    error: str | None = None  #: Cause of a fault or a stop.
    resumed_from: str | None = None  #: Name of the log that this run continued; None for a new run.
    closed: bool = False  #: Whether an operator decided not to resume the run.
    partial: bool = False  #: Whether the run omitted stages of its product.
    released: bool = False  #: Whether an engineer released the unit although it failed.
    check_standard: bool = False  #: Whether the unit was a check standard of the product instead of a production unit.
    origin: str = ""  #: Outbox of the other folder that contains the run; "" for a run of this folder.
    location: str | None = None  #: Location of the log of a run of another folder: a URL or ``host:path``.
    batch: str | None = None  #: Common identifier of the units that were on the table together; None for a single unit.
    slot: str | None = None  #: Name of the unit's slot on the table.
    altered: bool = False  #: Whether the result file differs from the log; the entries are then those of the log.
    #: Whether the result states a PASS that the log, which was not closed, neither confirms nor contradicts.
    unconfirmed: bool = False
    missing: bool = False  #: Whether the files are missing or unreadable; the entries were read earlier.
    resumable: bool = False  #: Whether the run ended early after a stage or a temperature that need not be repeated.
    simulated: bool = False  #: Whether the virtual bench generated the samples.
    result_sha256: str = ""  #: Digest of the result file, which shows changes if the log is missing.

    @property
    def badge(self) -> str:
        """The verdict as displayed.

        It is ``missing`` if the files are missing, ``altered`` or ``unconfirmed`` if the result file differs from the
        log, and ``released`` for a failed run whose unit was released.
        """
        if self.missing:
            return "missing"
        if self.altered:
            return "unconfirmed" if self.unconfirmed else "altered"
        return "released" if self.released else self.verdict


@dataclass(frozen=True)
class IndexedRun:
    """A row of the index."""

    name: str  #: Key of the row: the file name of the log without suffix.
    stamp: str  #: Stamp that changes with the files from which the row was read.
    record: RunRecord
    values: Mapping[str, float]  #: Solved values by parameter, SI.
    sigmas: Mapping[str, float]  #: Standard deviations of the values, SI.
    failed_checks: tuple[CheckId, ...] = ()  #: The checks that failed; empty for a run without a verdict.
    #: Quantities of the table's geometry and their standard deviations by name, rad.
    table: Mapping[str, tuple[float, float]] = field(default_factory=dict)


@dataclass(frozen=True)
class Categories(Generic[T]):
    """A column with repeated values, stored as its distinct values and the index of each row's value."""

    values: tuple[T, ...]  #: Distinct values.
    codes: IntArray  #: Index of the value of each row, shape (n,).

    @classmethod
    def of(cls, column: Sequence[T]) -> "Categories[T]":
        """Create a column from hashable values."""
        code_of = {value: code for code, value in enumerate(dict.fromkeys(column))}
        return cls(tuple(code_of), np.array([*map(code_of.__getitem__, column)], dtype=np.int64))

    def __getitem__(self, row: int) -> T:
        return self.values[int(self.codes[row])]

    def take(self, rows: IntArray) -> "Categories[T]":
        """Return the column of the selected rows."""
        return Categories(self.values, self.codes[rows])

    def isin(self, members: Collection[T]) -> BoolArray:
        """Return a mask of the rows whose value is one of `members`, shape (n,)."""
        flags = np.zeros(len(self.values), dtype=bool)
        flags[[self._code_of[value] for value in members if value in self._code_of]] = True
        return flags[self.codes]

    @cached_property
    def _code_of(self) -> Mapping[T, int]:
        return {value: code for code, value in enumerate(self.values)}


@dataclass(frozen=True)
class RunColumns:
    """Runs in columns, the oldest first, for statistics of many runs; the arrays have shape (n,)."""

    names: tuple[str, ...]  #: File names of the logs without suffix.
    serials: Categories[str]
    started: FloatArray  #: Start, s since 1970 in UTC to a millisecond.
    verdicts: Categories[Verdict]
    products: Categories[str | None]
    stations: Categories[str | None]
    operators: Categories[str | None]
    partial: BoolArray  #: Whether the run omitted stages of its product.
    check_standard: BoolArray  #: Whether the unit was a check standard.
    missing: BoolArray  #: Whether the files of the run are missing.
    failed_checks: Categories[tuple[CheckId, ...]]  #: As in `IndexedRun`.
    values: Mapping[str, FloatArray]  #: Solved values by parameter, SI; NaN if a run has none.
    sigmas: Mapping[str, FloatArray]  #: Standard deviations of the values, SI.
    table: Mapping[str, FloatArray]  #: Quantities of the table's geometry by name, rad; NaN if a run has none.


@dataclass(frozen=True)
class RunFilter:
    """Conditions, all of which a run must meet; "" means no condition."""

    search: str = ""  #: Part of a serial number, file name, product, station, operator or batch.
    verdict: str = ""
    altered: bool | None = None  #: Whether the result file differs from the log; None means no condition.
    missing: bool | None = False  #: Whether the files of the run are missing; None means no condition.
    simulated: bool | None = None  #: Whether the run was simulated; None means no condition.
    product: str = ""
    station: str = ""
    operator: str = ""
    since: str = ""  #: Earliest start, ISO 8601 in UTC without an offset.
    before: str = ""  #: Exclusive upper limit of the start, in the same format.
    names: tuple[str, ...] = ()  #: File names of the logs without suffix; () means no condition.
    batch: str = ""


@dataclass(frozen=True)
class RunOrder:
    """The order of runs by a field of `RunRecord`; runs with equal values are sorted by start, the latest first."""

    field: str
    descending: bool = False


def natural_key(value: str | float) -> str | float:
    """Return the sort key of a value; numbers within a text are compared by magnitude."""
    return _DIGITS.sub(lambda digits: digits[0].zfill(20), value.casefold()) if isinstance(value, str) else value


LATEST_FIRST = RunOrder("started_utc", descending=True)


@dataclass(frozen=True)
class RunChoices:
    """The sorted values that occur in the runs of a folder, and their earliest start; "" if there are no runs."""

    products: tuple[str, ...] = ()
    stations: tuple[str, ...] = ()
    operators: tuple[str, ...] = ()
    first_utc: str = ""


def to_columns(run: IndexedRun) -> dict[str, Any]:
    """Return the columns that contain a whole run: ``content``, ``failed_checks``, ``parameters`` and ``numbers``."""
    table_rows = {f"{TABLE_PREFIX}{name}": row for name, row in run.table.items()}
    rows = {name: (value, run.sigmas.get(name, math.nan)) for name, value in run.values.items()} | table_rows
    return {
        "content": json.dumps(asdict(run.record), default=str),
        "failed_checks": json.dumps(run.failed_checks),
        "parameters": json.dumps([*rows]),
        "numbers": np.array([*rows.values()], dtype=float).reshape(-1, 2).T.tobytes(),
    }


def from_columns(
    name: str, stamp: str, content: str, failed_checks: str, parameters: str, numbers: bytes
) -> IndexedRun:
    """Return the run in a row; see `to_columns` for the arguments."""
    names = json.loads(parameters)
    values, sigmas = (
        {name: number for name, number in zip(names, part, strict=True) if not math.isnan(number)}
        for part in np.frombuffer(numbers).reshape(2, len(names)).tolist()
    )
    table_names = [name for name in names if name.startswith(TABLE_PREFIX)]
    table = {n.removeprefix(TABLE_PREFIX): (values.pop(n, math.nan), sigmas.pop(n, math.nan)) for n in table_names}
    return IndexedRun(name, stamp, record_from(content), values, sigmas, read_check_ids(failed_checks), table)


@cache
def _adapter() -> TypeAdapter[RunRecord]:
    return TypeAdapter(RunRecord)


def record_from(content: str) -> RunRecord:
    """Return the record in the column ``content``."""
    return _adapter().validate_python(json.loads(content))


def estimates_by_name(
    parameters: Categories[str | None], numbers: Sequence[bytes], usual: str = ""
) -> tuple[dict[str, FloatArray], dict[str, FloatArray]]:
    """Return the values and the sigmas of n rows by parameter, shape (n,); NaN if a row lacks the parameter.

    Parameters
    ----------
    parameters, numbers : columns of the n rows, as in `to_columns`
    usual : names of the parameters as JSON, for rows in which `parameters` is None
    """
    names_of = [json.loads(names_json or usual) for names_json in parameters.values]
    column = {name: j for j, name in enumerate(dict.fromkeys(name for names in names_of for name in names))}
    estimates = np.full((2, len(column), len(numbers)), np.nan)
    for code, names in enumerate(names_of):
        rows = np.flatnonzero(parameters.codes == code)
        table = np.frombuffer(b"".join(map(numbers.__getitem__, rows.tolist()))).reshape(len(rows), 2, len(names))
        indices = np.array([column[name] for name in names], dtype=np.int64)
        estimates[np.ix_(np.arange(2), indices, rows)] = table.transpose(1, 2, 0)
    values, sigmas = ({name: kind[j] for name, j in column.items()} for kind in estimates)
    return values, sigmas
