"""Workers that solve logs, which are local processes or a Dask cluster; the failure of single workers is tolerated."""

import asyncio
import logging
import math
import re
import threading
import time
from collections.abc import Hashable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from queue import Empty, SimpleQueue

from calstation.errors import CalstationError, ConfigurationError
from calstation.fleet.sources import StoredLog
from calstation.fleet.store import Assignment, Status
from calstation.fleet.task import WarmUp, error_of, solve_stored_log
from calstation.messages import values_from_json

try:
    import dask
    from distributed import Client, Future, KilledWorker, LocalCluster, Nanny, Security
    from distributed.comm.core import CommClosedError
    from distributed.core import Status as ServerStatus
except ImportError as exc:
    raise ConfigurationError("database.not_installed") from exc

#: Maximum number of logs that are submitted to the scheduler at a time.
MAX_QUEUED = 1000
#: Number of replacements per local worker and time without a result, s, after which the workers are abandoned.
_MAX_REPLACEMENTS, _MAX_SILENCE = 3, 120.0
#: Number of workers that may terminate while solving a log before the log, which may not be the cause, is abandoned.
_MAX_TERMINATIONS = 6
#: Time without a process after which a local worker is replaced, s; its nanny usually restarts it immediately.
_RESTART_TIMEOUT = 10.0
#: Interval at which `stop` is checked, s.
_POLL_INTERVAL = 0.2
#: Timeout for fetching a result from the worker that has it, s.
_FETCH_TIMEOUT = 2.0
#: Timeout for a response of the scheduler.
_CONNECT_TIMEOUT = "10s"
_LOCAL = re.compile(r"local(?::([1-9]\d*))?")


def worker_count(scheduler: str) -> int | None:
    """Return the number of local workers, or None for a cluster."""
    local = _LOCAL.fullmatch(scheduler)
    if local is not None:
        return int(local[1]) if local[1] else int(dask.system.CPU_COUNT)
    if not scheduler.startswith(("tcp://", "tls://")):
        raise ConfigurationError("fleet.scheduler", scheduler=scheduler)
    return None


@contextmanager
def started_cluster(scheduler: str, workers: int | None) -> Iterator[Client]:
    """Connect to a scheduler, or start local workers, and prepare the workers."""
    settings = {
        "distributed.scheduler.allowed-failures": _MAX_TERMINATIONS,
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
            with suppress(CommClosedError):  # a worker is terminating; all others have the plugin
                client.register_plugin(WarmUp(local=False))
        else:
            cluster = LocalCluster(
                n_workers=0,
                threads_per_worker=1,
                processes=True,
                dashboard_address="127.0.0.1:0",
                silence_logs=logging.CRITICAL,
                security=Security.temporary(),  # other users of the computer cannot connect
            )
            stack.callback(_close, cluster)
            client = Client(cluster)
            stack.callback(client.close)
            client.register_plugin(WarmUp(local=True))
            cluster.scale(workers)
        yield client


def _close(cluster: LocalCluster) -> None:
    """Close local workers; workers that are still solving after 4 s are killed.

    The cluster itself does not close workers that it has lost or replaced, and fails if one of them is running.
    """
    unmanaged = [nanny for nanny in cluster._created if nanny not in cluster.workers.values()]
    if unmanaged:
        cluster.sync(_close_nannies, unmanaged)
    cluster.close()


async def _close_nannies(nannies: Sequence[Nanny]) -> None:
    await asyncio.wait([asyncio.ensure_future(nanny.close()) for nanny in nannies], timeout=_RESTART_TIMEOUT)


def _replace_workers(
    cluster: LocalCluster | None, replaced: int, without_process: dict[Hashable, float], last_result: float
) -> int:
    """Replace local workers that are not restarted by their nannies, and return the number of replacements.

    If a worker terminates during its start, its nanny gives up or waits forever. `replaced` is the number of
    replacements since the last result, which arrived at the time `last_result`, s. `without_process` contains, by the
    name of a worker, the time since which it has had no process, s. Raises ConfigurationError if workers terminate
    repeatedly.
    """
    if cluster is None:
        return replaced
    now, count = time.monotonic(), len(cluster.worker_spec)
    nannies = {nanny.name: nanny for nanny in cluster._created}  # `workers` lacks those that are starting
    for name in cluster.worker_spec:
        nanny = nannies.get(name)
        if nanny is not None and nanny.is_alive():
            without_process.pop(name, None)
        elif nanny is not None and nanny.status in (ServerStatus.closed, ServerStatus.failed):
            without_process[name] = -math.inf
        else:
            without_process.setdefault(name, now)
    names = [name for name in cluster.worker_spec if now - without_process.get(name, now) > _RESTART_TIMEOUT]
    if replaced + len(names) > _MAX_REPLACEMENTS * count and now - last_result > _MAX_SILENCE:
        raise ConfigurationError("fleet.workers_end", count=replaced)
    if names:
        for name in names:
            cluster.worker_spec.pop(name, None)
            cluster.workers.pop(name, None)
            without_process.pop(name)
        cluster.scale(count)
    return replaced + len(names)


def solve_logs(
    client: Client, assignment: Assignment, logs: Sequence[StoredLog], stop: threading.Event, scheduler: str
) -> Iterator[Status]:
    """Yield the status of each log in the order of completion until `stop` is set.

    Parameters
    ----------
    client : connection to the scheduler
    assignment : settings common to all tasks
    logs : logs to solve
    stop : no further log is assigned once it is set
    scheduler : address of the scheduler, for error messages
    """
    completed: SimpleQueue[Future[Status]] = SimpleQueue()
    remaining = iter(logs)
    running: dict[Hashable, tuple[Future[Status], StoredLog]] = {}
    replaced, without_process, last_result = 0, dict[Hashable, float](), time.monotonic()
    while not stop.is_set():
        while len(running) < MAX_QUEUED and (log := next(remaining, None)) is not None:
            future = client.submit(solve_stored_log, assignment, log, pure=False)
            running[future.key] = (future, log)
            future.add_done_callback(completed.put)
        if not running:
            return
        try:
            future = completed.get(timeout=_POLL_INTERVAL)
        except Empty:
            replaced = _replace_workers(client.cluster, replaced, without_process, last_result)
            continue
        if future.status == "cancelled":  # the scheduler, not this program, has cancelled the task
            raise ConfigurationError("fleet.scheduler_lost", scheduler=scheduler)
        try:
            status = _status(running[future.key][1], future)
        except TimeoutError:  # the worker terminated with its result, and the log is assigned to another worker
            completed.put(future)
            replaced = _replace_workers(client.cluster, replaced, without_process, last_result)
            continue
        replaced, last_result = 0, time.monotonic()
        del running[future.key]
        yield status
    client.cancel([future for future, _ in running.values()], force=True)


def _status(log: StoredLog, future: Future[Status]) -> Status:
    """Return the status of a log whose task has ended.

    Raises ConfigurationError if the task failed for a reason other than the log, or TimeoutError if no worker has the
    result.
    """
    if future.status == "error":
        cause = future.exception()
        if not isinstance(cause, KilledWorker):
            raise ConfigurationError("fleet.task_failed", reason=f"{type(cause).__name__}: {cause}")
        terminated = CalstationError("fleet.worker_died", file=log.location)
        return Status(log.location, "unreachable", error=error_of(terminated))
    status: Status = future.result(timeout=_FETCH_TIMEOUT)
    if status.outcome == "refused":
        raise ConfigurationError(status.error["error_code"], **values_from_json(status.error["error_values"]))
    return status
