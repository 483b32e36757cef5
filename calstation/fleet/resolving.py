"""Repeated solution of many logs on the workers of a Dask cluster; the database stores every finished solution."""

import json
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from itertools import takewhile
from pathlib import Path

from calstation.database import open_database
from calstation.errors import ConfigurationError
from calstation.fleet.changes import load_changes
from calstation.fleet.sources import Selection, StoredLog, find_logs
from calstation.fleet.store import (
    Assignment,
    KnownFile,
    Outcome,
    SolveSettings,
    Status,
    add_version,
    known_files,
    last_number,
    read_results,
    require_version,
)
from calstation.results import SCHEMA

#: Default label of solutions without diagnostics, which is appended to the label of the changes, if any.
PARAMETERS = "parameters"
#: Name of the baseline version, solved by the same program with the log's own configuration.
UNCHANGED = "unchanged"


@dataclass(frozen=True)
class FleetRequest:
    """The logs to solve and how to solve them."""

    sources: tuple[str, ...]  #: Files, folders and URLs; ``archive`` for the archive of the database.
    database: str  #: URL of the shared database.
    scheduler: str = "local"  #: ``local``, ``local:N`` or ``tcp://HOST:PORT``.
    patch: Path | None = None  #: TOML file with changes to the configuration of the logs.
    label: str | None = None  #: Name of the changes; default: the file name.
    stages: tuple[str, ...] | None = None
    first_seq: int | None = None
    last_seq: int | None = None
    diagnostics: bool = True  #: False to solve the parameters only, which is a separate version.
    selection: Selection = field(default_factory=Selection)
    retry_failed: bool = False  #: Whether to solve again logs that are stored as failed.

    @property
    def unchanged(self) -> "FleetRequest":
        """The same request, but with the logs' own configuration, range and stages."""
        return replace(self, patch=None, label=None, stages=None, first_seq=None, last_seq=None)

    def settings(self) -> SolveSettings:
        """Return the settings for solving every log. Raises ConfigurationError if they are invalid."""
        changes = load_changes(self.patch, self.label)
        if self.first_seq is not None and self.last_seq is not None and self.first_seq > self.last_seq:
            raise ConfigurationError("solution.range_reversed", first=self.first_seq, last=self.last_seq)
        if changes.label is None and (self.stages, self.first_seq, self.last_seq) != (None, None, None):
            raise ConfigurationError("fleet.label_needed")
        if not self.diagnostics and self.label is None:
            changes = replace(changes, label=PARAMETERS if changes.label is None else f"{changes.label}-{PARAMETERS}")
        return SolveSettings(changes, self.stages, self.first_seq, self.last_seq, self.diagnostics)

    def baseline(self, compare_with: str) -> str:
        """Return the version to compare the solutions with; ``unchanged`` means the version of the request `unchanged`.

        Raises ConfigurationError if it is the version of the solutions themselves, or is missing from the database.
        """
        after = self.settings().changes.version
        before = self.unchanged.settings().changes.version if compare_with == UNCHANGED else compare_with
        if before == after:
            raise ConfigurationError("fleet.compared_with_itself", version=after)
        if compare_with != UNCHANGED:
            with open_database(self.database, create=False) as engine, engine.connect() as connection:
                require_version(connection, before)
        return before


@dataclass
class FleetSummary:
    """The state of a request: the number of logs by outcome."""

    version: str
    total: int = 0
    solved_now: int = 0
    already_there: int = 0
    failed: int = 0  #: Logs that failed now or in an earlier call, or were unreachable.
    not_selected: int = 0
    unchanged: int = 0  #: Logs that the requested changes do not affect.
    stopped: bool = False
    duration_s: float = 0.0
    solutions: dict[int, str] = field(default_factory=dict)  #: Location of the log by number in the database.
    #: For each duplicate log, by its location, the location listed in `solutions`.
    copies: dict[str, str] = field(default_factory=dict)
    failures: list[Status] = field(default_factory=list)  #: The logs that failed.
    #: Total duration of the logs processed by workers, s, by step: ``copy``, ``solve`` and ``write``.
    seconds: dict[str, float] = field(default_factory=dict)
    processed: int = 0  #: Number of logs processed by workers.

    @property
    def done(self) -> int:
        """Number of logs that have been processed or need not be solved."""
        return self.solved_now + self.already_there + self.failed + self.not_selected

    def add(self, status: Status) -> None:
        """Count a log; another copy of a log is counted as already solved."""
        outcome = status.outcome
        if status.solution is not None:
            location = self.solutions.setdefault(status.solution, status.location)
            if location != status.location:
                self.copies[status.location] = location
                outcome = "stored" if outcome == "solved" else outcome
        self.solved_now += outcome == "solved"
        self.already_there += outcome == "stored"
        self.not_selected += outcome == "not_selected"
        if outcome in ("failed", "unreachable"):
            self.failed += 1
            self.failures.append(status)
        self.unchanged += status.changed is False
        self.processed += bool(status.seconds)
        for step, seconds in status.seconds.items():
            self.seconds[step] = self.seconds.get(step, 0.0) + seconds


def resolve_fleet(
    request: FleetRequest,
    report: Callable[[FleetSummary], None] = lambda summary: None,
    stop: threading.Event | None = None,
) -> FleetSummary:
    """Solve every selected log that has not been solved with the same version, configuration, range and stages.

    A log that cannot be solved is recorded as failed; a log that is unreachable or terminates its workers is tried
    again by the next call. `report` is called after each log. Once `stop` is set, the call returns within seconds;
    finished solutions are kept.

    Raises InputError if a source contains no logs, and ConfigurationError if the changes or the selection are invalid
    or the database or the scheduler cannot be used.
    """
    from calstation.fleet.cluster import solve_logs, started_cluster, worker_count  # imports `distributed`, optional

    begin = time.monotonic()
    stop = stop or threading.Event()
    settings = request.settings()
    workers = worker_count(request.scheduler)
    with open_database(request.database) as engine:
        logs = list(takewhile(lambda log: not stop.is_set(), find_logs(request.sources, engine)))
        if not add_version(engine, settings):
            raise ConfigurationError("fleet.label_used", version=settings.changes.version)
        listing_stopped = stop.is_set()
        known, last = known_files(engine, settings), last_number(engine)
        summary = FleetSummary(settings.changes.version, len(logs))
        remaining = []
        for log in logs:
            status = _known_status(request, log, known.get((log.location, log.fingerprint or "")))
            if status is None:
                remaining.append(log)
            else:
                summary.add(status)
        report(summary)
        if remaining and not stop.is_set():
            assignment = Assignment(request.database, settings, request.selection, request.retry_failed)
            with started_cluster(request.scheduler, workers) as client:
                for status in solve_logs(client, assignment, remaining, stop, request.scheduler):
                    # written by a worker that terminated before it returned the status
                    if status.outcome == "stored" and (status.solution or 0) > last:
                        status = replace(status, outcome="solved")
                    summary.add(status)
                    summary.duration_s = time.monotonic() - begin
                    report(summary)
    if not settings.differ_from_log:
        summary.unchanged = 0
    summary.stopped = listing_stopped or summary.done < summary.total
    summary.duration_s = time.monotonic() - begin
    if summary.not_selected and summary.not_selected == summary.total:
        raise ConfigurationError("fleet.none_selected", count=summary.total)
    return summary


def _known_status(request: FleetRequest, log: StoredLog, known: KnownFile | None) -> Status | None:
    """Return the status of a log according to the archive and the database, or None if its file must be read."""
    origin = log.origin or (known.origin if known is not None else None)
    solution = known.solution if known is not None else None
    readable = origin is not None and (any(origin) or (solution is not None and not solution.error))
    if readable and origin is not None and not request.selection.includes(origin):
        return Status(log.location, "not_selected")
    if solution is None or (solution.error and request.retry_failed):
        return None
    outcome: Outcome = "failed" if solution.error else "stored"
    return Status(log.location, outcome, solution.number, solution.error, solution.changed)


def solved_results(database: str, summary: FleetSummary) -> Iterator[str]:
    """Yield the result JSON of every finished log, only once for several copies of a log.

    For an unreachable log, the JSON has only outcome, error and location. Raises ConfigurationError if the database
    cannot be used.
    """
    with open_database(database) as engine:
        yield from read_results(engine, [*summary.solutions])
    for status in summary.failures:
        if status.solution is None:
            log = {"file": status.location}
            yield json.dumps({"schema": SCHEMA, "outcome": "failed", **status.error, "log": log}, ensure_ascii=False)
