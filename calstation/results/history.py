"""Searchable history of the runs in a folder, using an index of their files, and run counts of a shift."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass, replace
from datetime import UTC, datetime, time, timedelta
from itertools import pairwise, takewhile
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from calstation.config import StationConfig, known_products
from calstation.errors import InputError
from calstation.jobs import ProgressCallback
from calstation.messages import Text
from calstation.records import (
    LATEST_FIRST,
    SUFFIX,
    IndexedRun,
    ResolveRecord,
    RunChoices,
    RunColumns,
    RunFilter,
    RunOrder,
    RunRecord,
    Verdict,
    last_result,
    read_resolves,
    resolve_file,
)
from calstation.results.result import NO_RESULT, SCHEMA, Result, load_result
from calstation.results.sections import Parameter
from calstation.results.stated import load_confirmed_result, require_own_log
from calstation.results.stored_runs import agrees_with_log, has_files, lacks_log, read_run, run_stamps

if TYPE_CHECKING:
    from calstation.records import RunIndex

#: Number of runs read between two progress reports.
_BATCH = 100

_PASSED = (Verdict.PASSED, Verdict.PARTIAL)
_SOLVED = (*_PASSED, Verdict.FAILED)

T = TypeVar("T")

#: A filter without conditions.
NO_FILTER = RunFilter()


class History:
    """The runs of a folder; queries read an index, which `refresh` updates from the files."""

    def __init__(self, folder: Path, index: "RunIndex | None" = None, *, measured: bool = False) -> None:
        """Open the history of a folder; `index` is its open index, and with `measured`, simulated runs are excluded."""
        from calstation.records import RunIndex  # loads SQLAlchemy

        self._measured = measured
        self._folder = folder
        self._index = RunIndex(folder) if index is None else index
        #: Fingerprint of the file of offline solutions, and its content.
        self._resolves: tuple[tuple[int, int] | None, list[ResolveRecord]] = (None, [])

    @classmethod
    def at(cls, folder: Path, station: StationConfig) -> "History":
        """Open the history of the runs that count at a station: simulated runs count only at a virtual station."""
        return cls(folder, measured=station.bench is None)

    def one_connection(self) -> AbstractContextManager[None]:
        """Use one connection to the index for all queries in this context, which is faster."""
        return self._index.one_connection()

    def refresh(self, report: Callable[[float], None] | None = None) -> int:
        """Update the index from the folder; return the number of changed runs."""
        count = 0
        for changed, fraction in self.refresh_in_parts():
            count += changed
            if report is not None:
                report(fraction)
        return count

    def refresh_in_parts(self) -> Iterator[tuple[int, float]]:
        """Update the index from the folder; yield each part's number of changed runs and the completed fraction."""
        known = self._index.stamps()
        files = run_stamps(self._folder, known)
        removed = [name for name in known if name not in files]
        changed = [name for name, stamp in files.items() if known.get(name) != stamp]
        if removed:
            missing = [name for name in removed if not has_files(self._folder, name)]
            self._index.update([], set(removed).difference(missing), missing)
            yield len(removed), 0.0
        for start in range(0, len(changed), _BATCH):
            names = changed[start : start + _BATCH]
            earlier = self._known_without_log(names, known)
            read = {name: read_run(self._folder, name, files[name], earlier.get(name)) for name in names}
            runs = [run for run in read.values() if run is not None]
            no_runs = [name for name, run in read.items() if run is None and name in known]
            self._index.update(runs, missing=no_runs)
            yield len(runs) + len(no_runs), (start + len(names)) / len(changed)

    def _known_without_log(self, names: Sequence[str], known: Mapping[str, str]) -> dict[str, IndexedRun]:
        """Return the runs in the index whose result files have changed, and whose logs are missing."""
        missing = [name for name in names if name in known and not (self._folder / f"{name}{SUFFIX}").is_file()]
        return {run.name: run for run in self._index.runs_by_name(missing)} if missing else {}

    def runs(
        self,
        conditions: RunFilter = NO_FILTER,
        limit: int | None = 200,
        offset: int = 0,
        order: RunOrder = LATEST_FIRST,
    ) -> list[RunRecord]:
        """Return at most `limit` runs that meet all conditions, sorted by `order`, starting at `offset`."""
        scope = self._scope(conditions)
        return self._query(lambda: self._index.records(scope, limit, offset, order))

    def indexed(self, conditions: RunFilter, limit: int | None = None) -> list[IndexedRun]:
        """Return at most `limit` runs that meet all conditions, with their values, the latest first."""
        return self._query(lambda: self._index.find(self._scope(conditions), limit))

    def columns(self, conditions: RunFilter = NO_FILTER) -> RunColumns:
        """Return the runs that meet all conditions and have a start time as columns, the oldest first."""
        return self._query(lambda: self._index.columns(self._scope(conditions)))

    def mark(self) -> str | None:
        """Return a value that changes with the indexed runs; None if there are none."""
        return self._query(lambda: self._index.change_token)

    def count(self, conditions: RunFilter) -> int:
        """Return the number of runs that meet all conditions."""
        return self.counts(conditions)[0]

    def counts(self, conditions: RunFilter) -> tuple[int, int]:
        """Return the number of runs that meet all conditions, and the number of those whose files are not missing."""
        return self._query(lambda: self._index.counts(self._scope(conditions)))

    def choices(self) -> RunChoices:
        """Return the products, stations and operators of the runs, and their earliest start."""
        return self._query(self._index.choices)

    def of(self, serial: str) -> list[RunRecord]:
        """Return all runs of a unit, the latest first."""
        return [run.record for run in self._of_unit(serial)]

    def passed(self, serial: str) -> list[RunRecord]:
        """Return the unit's runs that passed, partial ones included, the latest first."""
        return [run.record for run in self._of_unit(serial, _PASSED)]

    def passed_units(self) -> set[str]:
        """Return the serial numbers of the units that passed a run that was not partial."""
        return self._query(lambda: self._index.passed_units(measured=self._measured))

    def other_spellings(self, serial: str) -> list[str]:
        """Return the serial numbers that equal `serial` except for case; [] if `serial` itself has runs."""
        spellings = self._query(lambda: self._index.spellings(serial, measured=self._measured))
        return [] if serial in spellings else spellings

    def passed_before(self, serial: str) -> RunRecord | None:
        """Return the unit's latest run that passed and was not partial, even if its files are missing, or None."""
        runs = self._of_unit(serial, _PASSED, missing=True)
        return next((run.record for run in runs if not run.record.partial), None)

    def failed_last(self, serial: str) -> bool:
        """Return whether the unit's latest run with a verdict failed; partial runs do not count."""
        runs = self._of_unit(serial, _SOLVED, missing=True)
        return next((run.record.verdict is Verdict.FAILED for run in runs if not run.record.partial), False)

    def failed_after(self, serial: str, started_utc: str) -> RunRecord | None:
        """Return the unit's latest run that passed or failed if it failed and started later than `started_utc`.

        As for `failures`, failed partial runs and runs whose files are missing count.
        """
        runs = self._of_unit(serial, (Verdict.PASSED, Verdict.FAILED), missing=True)
        failed = runs[0].record if runs and runs[0].record.verdict is Verdict.FAILED else None
        return failed if failed is not None and failed.started_utc > started_utc else None

    def result(self, record: RunRecord) -> Result:
        """Return the result of a run in the index, from its log if there is no result file. Raises InputError.

        The result of a run of another folder is in the shared database; a copy may exist at the path of the log, with
        the suffix ``.json``. An altered result is refused.
        """
        if record.origin:
            copy = record.log.with_suffix(".json")
            if not copy.exists():
                raise InputError("result.elsewhere", log=record.log.name, station=record.station or "?")
            return load_result(copy)
        if record.result is not None:
            result = load_confirmed_result(record.result)
            if record.altered:  # the log, which would contradict it, is missing or damaged
                raise InputError("result.altered_without_log", file=record.result)
            return result
        stored = last_result(record.log)
        require_own_log(stored, record.log)
        try:
            return Result.from_json(stored or {})
        except NO_RESULT as exc:
            raise InputError("result.not_a_result", file=record.log, schema=SCHEMA) from exc

    def stated(self, record: RunRecord) -> Result:
        """Return the result of a run; if its result file was changed, that in its log or, failing that, in the index.

        The index contains only the parameters. Raises InputError.
        """
        if not record.altered or record.origin:
            return self.result(record)
        with suppress(InputError):
            return self.result(replace(record, result=None))
        (run,) = self._index.runs_by_name([record.log.stem])
        rows = {name: {"value": value, "sigma": run.sigmas.get(name, 0.0)} for name, value in run.values.items()}
        return Result.from_json(
            {
                "schema": SCHEMA,
                "unit": {"serial": record.serial},
                "stages": record.stages,
                "outcome": "failed" if record.verdict is Verdict.FAILED else "passed",
                "parameters": rows,
                "log": {"file": record.log.name},
            }
        )

    def read_again(self, record: RunRecord) -> None:
        """Read the files of a run again whose log was changed although its result file was not.

        If the log contradicts the index, the run keeps its entries in the index and counts as changed until the log is
        restored.
        """
        for earlier in self._index.runs_by_name([record.log.stem]):
            run = read_run(self._folder, earlier.name, earlier.stamp)
            if run is not None and (run.record.altered or lacks_log(record)):
                run = read_run(self._folder, earlier.name, earlier.stamp, earlier)
            if run is not None and run.record.badge != earlier.record.badge:
                self._index.update([run])

    def compare_logs(self, conditions: RunFilter = NO_FILTER, report: Callable[[float], None] | None = None) -> None:
        """Mark the runs whose logs contradict them although their result files were not changed, see `read_again`.

        `refresh` reads no log of an unchanged result file, such as a log that was exchanged with that of another run.
        """
        runs = [run for run in self.runs(conditions, limit=None) if run.result is not None and not run.origin]
        for number, run in enumerate(runs, 1):
            if run.altered or not agrees_with_log(run):
                self.read_again(run)
            if report is not None:
                report(number / len(runs))

    def resolves(self, log: Path) -> list[ResolveRecord]:
        """Return the offline solutions of a log of the folder, the oldest first. Raises InputError."""
        path = resolve_file(self._folder).path
        status = path.stat() if path.exists() else None
        stamp = None if status is None else (status.st_mtime_ns, status.st_size)
        if stamp != self._resolves[0]:
            self._resolves = (stamp, read_resolves(self._folder))
        return [record for record in self._resolves[1] if record.log == log.name]

    def attempts(self, serial: str) -> int:
        """Return the number of runs of the unit, including runs without files; a resumed run counts once."""
        return self._query(lambda: self._index.attempts(serial, measured=self._measured))

    def absent_attempts(self, serial: str) -> list[tuple[int, int]]:
        """Return the attempt numbers of the unit for which no run is known, as ranges (first, last).

        The number of a measured run is absent even if a simulated run has the same number.
        """
        measured = self._query(lambda: self._index.attempt_numbers(serial, measured=True))
        every = self._query(lambda: self._index.attempt_numbers(serial, measured=self._measured))
        return _absent_of(measured, every)

    def failures(self, serial: str, product: str | None) -> int:
        """Return the number of failures of the unit as a product since it last passed, including partial runs.

        Runs whose files are missing count, as do later attempt numbers for which no run is known, so that deleting
        files and index does not permit further attempts.
        """
        verdicts = Verdict.PASSED, Verdict.FAILED
        runs = self._of_unit(serial, verdicts, missing=True, product=product)
        failed = list(takewhile(lambda run: run.record.verdict is Verdict.FAILED, runs))
        passed = runs[len(failed)].record.attempt if len(failed) < len(runs) else 0
        return len(failed) + sum(
            last - max(first, passed + 1) + 1 for first, last in self.absent_attempts(serial) if last > passed
        )

    def previous(
        self, serial: str, product: str | None, before: str | None = None
    ) -> tuple[Mapping[str, Parameter], str]:
        """Return the unit's latest estimate of each parameter as this product, and the start of the latest such run.

        Runs as another product are omitted, because its parameters may be relative to other nominal values. `before` is
        the exclusive upper limit of the start, ISO 8601.
        """
        earlier = self._of_unit(serial, _SOLVED, before, product=product)
        runs = [run for run in earlier if run.values]
        return _latest(runs), runs[0].record.started_utc if runs else ""

    def solved(self, serial: str, product: str | None, limit: int) -> list[IndexedRun]:
        """Return at most the latest `limit` solved runs of the unit as a product, with values, the oldest first."""
        return self._of_unit(serial, _SOLVED, limit=limit, product=product)[::-1]

    def _of_unit(self, *conditions: Any, **more: Any) -> list[IndexedRun]:
        """Return the runs of a unit, see `RunIndex.runs_of_unit`."""
        return self._query(lambda: self._index.runs_of_unit(*conditions, **more, measured=self._measured))

    def _scope(self, conditions: RunFilter) -> RunFilter:
        return replace(conditions, simulated=False) if self._measured else conditions

    def _query(self, query: Callable[[], T]) -> T:
        result = query()
        if self._index.may_lack_runs:
            self._index.may_lack_runs = False
            self.refresh()
            result = query()
        return result


def _absent(numbers: Iterable[int]) -> list[tuple[int, int]]:
    known = sorted({0, *numbers})
    return [(before + 1, after - 1) for before, after in pairwise(known) if after - before > 1]


def _absent_of(measured: Iterable[int], every: Iterable[int]) -> list[tuple[int, int]]:
    """Return the absent numbers of measured runs and, above the last of them, of all runs.

    The numbers of measured runs do not count simulated runs; those of simulated runs count both.
    """
    numbers = [*measured]
    last = max(numbers, default=0)
    return [*_absent(numbers), *(each for each in _absent(every) if each[0] > last)]


def number_ranges(ranges: Iterable[tuple[int, int]]) -> list[str]:
    """Return the texts of ranges of numbers, such as ``3`` and ``5–7``."""
    return [str(first) if first == last else f"{first}–{last}" for first, last in ranges]


def check_runs(folder: Path) -> tuple[list[Text], list[Text]]:
    """Return messages about unconfirmed result files in a folder, and about units with missing attempts.

    An unconfirmed file differs from its log, or contains a release that is not in the audit trail of the site. The
    index of the folder is not used, because it is not evidence.
    """
    faults: list[Text] = []
    attempts: dict[str, list[RunRecord]] = {}
    for name, stamp in sorted(run_stamps(folder, {}).items()):
        run = read_run(folder, name, stamp)
        if run is None:
            continue
        attempts.setdefault(run.record.serial, []).append(run.record)
        if run.record.altered and run.record.result is not None:
            try:
                load_confirmed_result(run.record.result)
            except InputError as error:
                faults.append(error.as_text)
    gaps = {
        serial: number_ranges(
            _absent_of((run.attempt for run in runs if not run.simulated), (run.attempt for run in runs))
        )
        for serial, runs in sorted(attempts.items())
    }
    return faults, [
        Text.of("result.attempts_absent", folder=folder, serial=serial, numbers=numbers)
        for serial, numbers in gaps.items()
        if numbers
    ]


def refresh_history(report: ProgressCallback, folder: Path) -> int:
    """Job: update a folder's index; return the number of changed runs."""
    return History(folder).refresh(report)


def load_results(report: ProgressCallback, folder: Path, runs: Sequence[RunRecord]) -> list[Result]:
    """Job: read the results of runs in a folder's index as `History.stated`. Raises InputError if one is unreadable."""
    history = History(folder)
    results = []
    for run in runs:
        results.append(history.stated(run))
        report(len(results) / len(runs))
    return results


@dataclass(frozen=True)
class ShiftCount:
    """Counts of runs that passed or failed."""

    passed: int = 0
    failed: int = 0
    mean_duration: float | None = None  #: Mean time of the table per unit, s; None without runs.
    partial_failed: int = 0  #: Number of partial runs that failed, which are not among the counts.

    @property
    def done(self) -> int:
        """Number of runs."""
        return self.passed + self.failed

    @property
    def passed_share(self) -> float | None:
        """Fraction of the runs that passed (yield); None without runs."""
        return self.passed / self.done if self.done else None


def shift_start(starts: Iterable[str], now: datetime | None = None) -> datetime:
    """Return when the current shift began; `starts` are local times ``HH:MM``, `now` defaults to the current time."""
    now = (now or datetime.now()).astimezone()
    days = (now.date(), now.date() - timedelta(days=1))
    times = [datetime.combine(day, time.fromisoformat(start)).astimezone() for day in days for start in starts]
    return max(start for start in times if start <= now)


#: Maximum duration of a run that is counted in the shift in which it ends.
_LONGEST_RUN = timedelta(days=1)


def count_shift(
    report: ProgressCallback, folder: Path, station: str, since: datetime, *, measured: bool = False
) -> ShiftCount:
    """Job: count the runs of a station in a folder that ended at `since` or later; only measured ones if `measured`.

    A run belongs to the shift in which its time on the table ends. Stopped and faulty runs, and runs of check standards
    according to their results or a current product file, are not counted; failed partial runs are counted separately,
    other partial runs not at all. A resumed run is counted once. Runs whose files are missing are counted. The units of
    a batch share its duration.
    """
    history = History(folder, measured=measured)
    history.refresh()
    standards = {standard.serial for _, product in known_products() for standard in product.check_standards}
    begin = f"{since.astimezone(UTC) - _LONGEST_RUN:%Y-%m-%dT%H:%M:%S}"
    conditions = RunFilter(station=station, since=begin, missing=None)
    judged = [
        run
        for run in history.runs(conditions, limit=None)
        if run.verdict in (Verdict.PASSED, Verdict.FAILED) and not run.check_standard
        if run.serial not in standards
        if datetime.fromisoformat(run.started_utc) + timedelta(seconds=run.duration) >= since
    ]
    runs = [run for run in judged if not run.partial]
    partial_failed = sum(run.partial and run.verdict is Verdict.FAILED for run in judged)
    passed = sum(run.verdict is Verdict.PASSED for run in runs)
    on_table: dict[str, float] = {}  # the units of a batch share the table's time
    for run in runs:
        key = run.batch or run.log.name
        on_table[key] = max(run.duration, on_table.get(key, 0.0))
    mean = sum(on_table.values()) / len(runs) if runs else None
    return ShiftCount(passed, len(runs) - passed, mean, partial_failed)


def _latest(runs: list[IndexedRun]) -> Mapping[str, Parameter]:
    """Return the estimate of each parameter from the first of the runs that has it."""
    latest: dict[str, Parameter] = {}
    for run in runs:
        sigmas = run.sigmas
        latest = {n: Parameter(value=v, sigma=sigmas.get(n, 0.0)) for n, v in run.values.items()} | latest
    return latest
