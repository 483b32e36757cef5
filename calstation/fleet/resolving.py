"""Solves many logs again on the workers of a Dask cluster; whatever is finished is in the database."""

import json
import logging
import math
import re
import threading
import time
from collections.abc import Callable, Hashable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field, replace
from itertools import takewhile
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Literal

from sqlalchemy.exc import SQLAlchemyError

from calstation.database import connect
from calstation.errors import CalstationError, ConfigurationError
from calstation.fleet.changes import load_changes
from calstation.fleet.sources import StoredLog, find_logs
from calstation.fleet.store import Wanted, label_used, last_number, read_results, solved_files
from calstation.fleet.task import (
    Assignment,
    Status,
    WarmUp,
    error_of,
    solve_stored_log,
)
from calstation.messages import values_from_json
from calstation.results import SCHEMA

try:
    import dask
    from distributed import Client, Future, KilledWorker, LocalCluster
    from distributed.comm.core import CommClosedError
    from distributed.core import Status as ServerStatus
except ImportError as exc:
    raise ConfigurationError("database.not_installed") from exc

#: Label of solutions without diagnostics, or what ends it, unless another one is given.
PARAMETERS = "parameters"
#: Largest number of logs given to the scheduler at a time.
WINDOW = 1000
#: Number of times that each local worker is replaced, and time, s, without any answer before the workers are given up.
_REPLACED, _UNANSWERED = 3, 120.0
#: Number of workers that may end while they solve a log before it is given up; some end for other reasons.
_DEATHS = 6
#: Longest time without a process until a local worker is replaced, s; its nanny starts another one at once.
_RESTART = 10.0
#: Interval at which a wish to stop is noticed, s.
_POLL = 0.2
#: Longest time to fetch an answer from the worker that has it, s.
_ANSWER = 2.0
#: Longest time to wait for a scheduler's answer.
_CONNECT_TIMEOUT = "10s"
_LOCAL = re.compile(r"local(?::([1-9]\d*))?")


@dataclass(frozen=True)
class FleetRequest:
    """Logs to solve, and with what."""

    sources: tuple[str, ...]  #: Files, folders and URLs; ``archive`` for the archive of the database.
    database: str  #: URL of the shared database.
    scheduler: str = "local"  #: ``local``, ``local:N`` or ``tcp://HOST:PORT``.
    patch: Path | None = None  #: TOML file with changes to the configuration of the logs.
    label: str | None = None  #: Name of the changes; by default that of the file.
    stages: tuple[str, ...] | None = None
    first_seq: int | None = None
    last_seq: int | None = None
    diagnostics: bool = True  #: False for the parameters only, which are a version of their own.


@dataclass
class FleetSummary:
    """State of a request: how many logs are done, and what became of them."""

    version: str
    total: int = 0
    solved_now: int = 0
    already_there: int = 0
    failed: int = 0  #: Failed, now or stored as failed before, including unreachable logs.
    stopped: bool = False
    duration_s: float = 0.0
    solutions: list[int] = field(default_factory=list)  #: Numbers in the database.
    failures: list[Status] = field(default_factory=list)  #: The logs that failed.
    #: Total duration by step of the logs that workers answered, s: ``copy``, ``solve`` and ``write``.
    seconds: dict[str, float] = field(default_factory=dict)
    answered: int = 0  #: Number of logs that workers answered.

    @property
    def done(self) -> int:
        """Number of logs that are done."""
        return self.solved_now + self.already_there + self.failed

    def add(self, status: Status) -> None:
        """Count a log."""
        self.solved_now += status.outcome == "solved"
        self.already_there += status.outcome == "there"
        self.failed += status.outcome in ("failed", "unreachable")
        if status.outcome in ("failed", "unreachable"):
            self.failures.append(status)
        if status.solution is not None:
            self.solutions.append(status.solution)
        self.answered += bool(status.seconds)
        for step, seconds in status.seconds.items():
            self.seconds[step] = self.seconds.get(step, 0.0) + seconds


def resolve_fleet(
    request: FleetRequest,
    report: Callable[[FleetSummary], None] = lambda summary: None,
    stop: threading.Event | None = None,
) -> FleetSummary:
    """Solve every log that is not solved yet under the same version, configuration, range and stages.

    A log that cannot be solved is recorded as failed; one that is not reachable or ends its workers is tried again by
    the next call. `report` is called after each log. Once `stop` is set, the call returns within seconds, and
    everything finished stays.

    Raises InputError for a source without logs, ConfigurationError for the changes, the database or the scheduler.
    """
    begin = time.monotonic()
    stop = stop or threading.Event()
    changes = load_changes(request.patch, request.label)
    wanted = Wanted(changes, request.stages, request.first_seq, request.last_seq, request.diagnostics)
    if request.first_seq is not None and request.last_seq is not None and request.first_seq > request.last_seq:
        raise ConfigurationError("solution.range_reversed", first=request.first_seq, last=request.last_seq)
    if changes.label is None and (wanted.stages, wanted.first_seq, wanted.last_seq) != (None, None, None):
        raise ConfigurationError("fleet.label_needed")
    if not request.diagnostics and request.label is None:
        changes = replace(changes, label=PARAMETERS if changes.label is None else f"{changes.label}-{PARAMETERS}")
        wanted = replace(wanted, changes=changes)
    workers = _workers(request.scheduler)
    engine = connect(request.database)
    try:
        if label_used(engine, wanted):
            raise ConfigurationError("fleet.label_used", version=changes.version)
        logs = list(takewhile(lambda log: not stop.is_set(), find_logs(request.sources, engine)))
        listing_stopped = stop.is_set()
        there, last = solved_files(engine, wanted), last_number(engine)
        summary = FleetSummary(changes.version, len(logs))
        left = []
        for log in logs:
            solution = there.get((log.location, log.fingerprint or ""))
            if solution is None:
                left.append(log)
            else:
                outcome: Literal["failed", "there"] = "failed" if solution.error else "there"
                summary.add(Status(log.location, outcome, solution.number, solution.error))
        report(summary)
        if left and not stop.is_set():
            assignment = Assignment(request.database, wanted)
            with _cluster(request.scheduler, workers) as client:
                for status in _solved(client, assignment, left, stop, request.scheduler):
                    if status.outcome == "there" and (status.solution or 0) > last:  # its worker ended after writing it
                        status = replace(status, outcome="solved")
                    summary.add(status)
                    summary.duration_s = time.monotonic() - begin
                    report(summary)
    except SQLAlchemyError as exc:
        raise ConfigurationError("fleet.database_failed", reason=str(exc).partition("\n")[0]) from exc
    finally:
        engine.dispose()
    summary.stopped = listing_stopped or summary.done < summary.total
    summary.duration_s = time.monotonic() - begin
    return summary


def solved_results(database: str, summary: FleetSummary) -> Iterator[str]:
    """Yield the result JSON of every log that is done; unreachable ones have only outcome, error and location.

    Raises ConfigurationError for the database.
    """
    engine = connect(database)
    yield from read_results(engine, summary.solutions)
    engine.dispose()
    for status in summary.failures:
        if status.solution is None:
            log = {"file": status.location}
            yield json.dumps({"schema": SCHEMA, "outcome": "failed", **status.error, "log": log}, ensure_ascii=False)


def _workers(scheduler: str) -> int | None:
    """Return the number of local workers; None for a cluster."""
    local = _LOCAL.fullmatch(scheduler)
    if local is not None:
        return int(local[1]) if local[1] else int(dask.system.CPU_COUNT)
    if not scheduler.startswith(("tcp://", "tls://")):
        raise ConfigurationError("fleet.scheduler", scheduler=scheduler)
    return None


@contextmanager
def _cluster(scheduler: str, workers: int | None) -> Iterator[Client]:
    """Connect to a scheduler, or start local workers, and prepare the workers."""
    settings = {
        "distributed.scheduler.allowed-failures": _DEATHS,
        "distributed.scheduler.worker-saturation": 1.0,
        "distributed.comm.timeouts.connect": _CONNECT_TIMEOUT,
    }
    with ExitStack() as stack:
        stack.enter_context(dask.config.set(settings))
        if workers is None:
            try:
                client = Client(scheduler, timeout=_CONNECT_TIMEOUT)
            except (OSError, ValueError) as exc:
                raise ConfigurationError("fleet.no_scheduler", scheduler=scheduler, reason=str(exc)) from exc
            stack.callback(client.close)
            with suppress(CommClosedError):  # of a worker that ends meanwhile; all others have the plugin
                client.register_plugin(WarmUp(local=False))
        else:
            cluster = LocalCluster(
                n_workers=0,
                threads_per_worker=1,
                processes=True,
                dashboard_address="127.0.0.1:0",
                silence_logs=logging.CRITICAL,
            )
            stack.callback(cluster.close)  # kills workers that are still solving after 4 s
            client = Client(cluster)
            stack.callback(client.close)
            client.register_plugin(WarmUp(local=True))
            cluster.scale(workers)
        yield client


def _replace_ended(cluster: LocalCluster | None, replaced: int, dead: dict[Hashable, float], answered: float) -> int:
    """Replace local workers that their nannies do not start again, and return how many in all.

    A nanny gives up if its worker ends while it starts, or waits for it for ever. `replaced` is the number since the
    last answer at time `answered`, s, `dead` since when a worker has no process, by name. Raises ConfigurationError if
    workers have ended again and again.
    """
    if cluster is None:
        return replaced
    now, count = time.monotonic(), len(cluster.worker_spec)
    for name in cluster.worker_spec:
        nanny = cluster.workers.get(name)  # None if it ended before the cluster knew it
        if nanny is not None and nanny.is_alive():
            dead.pop(name, None)
        elif nanny is not None and nanny.status in (ServerStatus.closed, ServerStatus.failed):
            dead[name] = -math.inf
        else:
            dead.setdefault(name, now)
    ended = [name for name in cluster.worker_spec if now - dead.get(name, now) > _RESTART]
    if replaced + len(ended) > _REPLACED * count and now - answered > _UNANSWERED:
        raise ConfigurationError("fleet.workers_end", count=replaced)
    if ended:
        for name in ended:
            cluster.worker_spec.pop(name, None)
            cluster.workers.pop(name, None)
            dead.pop(name)
        cluster.scale(count)
    return replaced + len(ended)


def _solved(
    client: Client, assignment: Assignment, logs: Sequence[StoredLog], stop: threading.Event, scheduler: str
) -> Iterator[Status]:
    """Yield the status of each log in the order in which they are done, until `stop` is set."""
    done: SimpleQueue[Future[Status]] = SimpleQueue()
    waiting = iter(logs)
    running: dict[Hashable, tuple[Future[Status], StoredLog]] = {}
    replaced, dead, answered = 0, dict[Hashable, float](), time.monotonic()
    while not stop.is_set():
        while len(running) < WINDOW and (log := next(waiting, None)) is not None:
            future = client.submit(solve_stored_log, assignment, log, pure=False)
            running[future.key] = (future, log)
            future.add_done_callback(done.put)
        if not running:
            return
        try:
            future = done.get(timeout=_POLL)
        except Empty:
            replaced = _replace_ended(client.cluster, replaced, dead, answered)
            continue
        if future.status == "cancelled":  # not by this program
            raise ConfigurationError("fleet.scheduler_lost", scheduler=scheduler)
        try:
            status = _status(running[future.key][1], future)
        except TimeoutError:  # the worker ended with its answer, and the log is given to another one
            done.put(future)
            replaced = _replace_ended(client.cluster, replaced, dead, answered)
            continue
        replaced, answered = 0, time.monotonic()
        del running[future.key]
        yield status
    client.cancel([future for future, _ in running.values()], force=True)


def _status(log: StoredLog, future: Future[Status]) -> Status:
    """Return the status of a log.

    Raises ConfigurationError if the reason of a failure is not the log, TimeoutError if no worker has the answer.
    """
    if future.status == "error":
        cause = future.exception()
        if not isinstance(cause, KilledWorker):
            raise ConfigurationError("fleet.task_failed", reason=f"{type(cause).__name__}: {cause}")
        died = CalstationError("fleet.worker_died", file=log.location)
        return Status(log.location, "unreachable", error=error_of(died))
    status: Status = future.result(timeout=_ANSWER)
    if status.outcome == "refused":
        raise ConfigurationError(status.error["error_code"], **values_from_json(status.error["error_values"]))
    return status
