"""Background jobs: one preloaded process executes them in order and can be killed during a job."""

import logging
import pickle
import signal
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from multiprocessing.reduction import ForkingPickler
from queue import Empty
from typing import Any, Literal, Protocol

from calstation import applog
from calstation.errors import CalstationError, system_error
from calstation.jobs.process import ChildProcess, receive_stop_signals

State = Literal["waiting", "running", "done", "failed", "cancelled"]

#: Shortest interval between two progress reports, s, so that a slow receiver does not delay the job.
_PROGRESS_INTERVAL = 0.05

#: Delay before the worker warms up, host time, s: the computer is busy while the window opens.
_WARM_UP_DELAY = 2.0

#: Time that `JobQueue.close` waits for a job that uses a device and must not be killed, host time, s.
_DEVICE_JOB_TIMEOUT = 10.0

#: Time allowed for a killed process to exit, host time, s.
_EXIT_TIMEOUT = 2.0

#: Smallest fraction done from which the remaining time is estimated if the job does not report it.
_ESTIMATE_FROM = 0.05

logger = logging.getLogger(__name__)


class ProgressCallback(Protocol):
    """Function with which a job reports its progress; it raises an exception if the job must end."""

    def __call__(self, fraction: float, remaining_s: float | None = None, note: str = "") -> None:
        """Report the fraction done (0 to 1), the remaining time, s, if known, and the current activity."""


class Job:
    """A job as seen by its owner; no method blocks."""

    def __init__(self, job_queue: "JobQueue", call: bytes, cancellable: bool) -> None:
        self._job_queue = job_queue
        self._call = call
        self._reported_remaining: float | None = None
        self._reported_at = self._started_at = 0.0
        self.cancellable = cancellable  #: False for a job that uses a device.
        self.state: State = "waiting"
        self.fraction = 0.0  #: Fraction done, 0 to 1.
        self.note = ""  #: Current activity, as reported by the job.
        self.result: Any = None  #: Return value, once the job is done.
        self.error: CalstationError | None = None  #: The error, once the job has failed.

    @property
    def ended(self) -> bool:
        """Whether the job is done, failed or cancelled."""
        return self.state in ("done", "failed", "cancelled")

    @property
    def remaining(self) -> float | None:
        """Remaining time, s, as reported, or else estimated from the fraction done.

        None if it is unknown, for example because the last estimate has elapsed without another report.
        """
        if self.state != "running":
            return None
        at_report = self._reported_remaining
        if at_report is None and self.fraction >= _ESTIMATE_FROM:
            at_report = (self._reported_at - self._started_at) * (1.0 - self.fraction) / self.fraction
        remaining = 0.0 if at_report is None else at_report - (time.monotonic() - self._reported_at)
        return remaining if remaining > 0.0 else None

    def poll(self) -> State:
        """Process messages from the worker and return the state; the owner calls this from a timer."""
        self._job_queue.poll()
        return self.state

    def cancel(self) -> bool:
        """Cancel the job, killing it if it is running. Returns False if it has ended or must not be cancelled."""
        return self._job_queue.cancel(self)

    def _begin(self) -> None:
        self.state = "running"
        self._started_at = self._reported_at = time.monotonic()

    def _progress(self, fraction: float, remaining: float | None, note: str) -> None:
        self.fraction = min(1.0, max(0.0, fraction))
        self._reported_remaining, self._reported_at = remaining, time.monotonic()
        self.note = note

    def _end(self, state: State, result: Any = None, error: CalstationError | None = None) -> None:
        self.state, self.result, self.error = state, result, error
        if state == "done":
            self.fraction = 1.0


class JobQueue:
    """Executes jobs in order in a separate process, which is started immediately.

    All processing occurs in `poll` (of the queue or of any of its jobs), which never blocks: a job is sent only to a
    worker that is ready. `warm_up`, a function at the top level of a module, imports and compiles what most jobs need.
    """

    def __init__(self, warm_up: Callable[[], None] | None = None) -> None:
        self._warm_up = warm_up
        self._waiting: deque[Job] = deque()
        self._running: Job | None = None
        self._worker: ChildProcess | None = None
        self._ready = False
        self._killed: list[BaseProcess] = []
        self._closed = False
        self._start()

    def submit(self, work: Callable[..., Any], /, *args: Any, cancellable: bool = True, **kwargs: Any) -> Job:
        """Queue the call ``work(progress, *args, **kwargs)``; see `ProgressCallback`.

        `work` is a function at the top level of a module; arguments and result must be picklable. A job that uses a
        device must not be `cancellable`: it is never killed. After `close`, a job is cancelled immediately.
        """
        job = Job(self, bytes(ForkingPickler.dumps((work, args, kwargs))), cancellable)
        if self._closed:
            job._end("cancelled")
            return job
        self._waiting.append(job)
        self.poll()
        return job

    @property
    def busy(self) -> bool:
        """Whether a job is running or waiting."""
        return self._running is not None or bool(self._waiting)

    @property
    def uses_device(self) -> bool:
        """Whether a job that uses a device, and therefore must not be cancelled, is running or waiting."""
        return any(job is not None and not job.cancellable for job in (self._running, *self._waiting))

    def poll(self) -> None:
        """Process messages from the worker and send it the next job; never blocks."""
        if self._closed:
            return
        self._killed = [process for process in self._killed if process.is_alive()]
        self._receive()
        if self._ready and self._running is None and self._worker is not None and not self._worker.process.is_alive():
            self._on_worker_exit()
        if self._waiting and self._worker is None:
            self._start()
        if self._waiting and self._ready and self._running is None and self._worker is not None:
            self._send(self._worker, self._waiting.popleft())

    def cancel(self, job: Job) -> bool:
        """Cancel a job; see `Job.cancel`."""
        self.poll()
        if job in self._waiting:
            self._waiting.remove(job)
        elif job is self._running and job.cancellable:
            self._kill()
            self._start()
        else:
            return False
        job._end("cancelled")
        return True

    def close(self) -> None:
        """Cancel all jobs and end the process; a job that uses a device has 10 s to finish."""
        if self._closed:
            return
        for job in self._waiting:
            job._end("cancelled")
        self._waiting.clear()
        deadline = time.monotonic() + _DEVICE_JOB_TIMEOUT
        while self._running is not None and not self._running.cancellable and time.monotonic() < deadline:
            self.poll()
            time.sleep(0.01)
        if self._running is not None:
            self._running._end("cancelled")
        self._kill()
        self._closed = True
        deadline = time.monotonic() + _EXIT_TIMEOUT
        for process in self._killed:
            process.join(max(0.0, deadline - time.monotonic()))

    def _receive(self) -> None:
        while self._worker is not None:
            try:
                message = self._worker.take()
            except Empty:
                return
            except (EOFError, OSError):
                self._on_worker_exit()
                return
            except Exception as error:  # noqa: BLE001 - a result that cannot be unpickled here
                message = ("failed", _internal(error))
            self._handle(*message)

    def _handle(self, kind: str, *values: Any) -> None:
        job = self._running
        if kind == "ready":
            self._ready = True
        elif job is not None and kind == "progress":
            job._progress(*values)
        elif job is not None:
            self._running = None
            if kind == "done":
                job._end("done", result=values[0])
            else:
                job._end("failed", error=values[0])

    def _send(self, worker: ChildProcess, job: Job) -> None:
        try:
            worker.connection.send_bytes(job._call)
        except OSError:  # the worker died while idle: the job is sent to the next one
            self._waiting.appendleft(job)
            self._on_worker_exit()
            return
        self._running = job
        job._begin()

    def _on_worker_exit(self) -> None:
        """Fail the running job of a process that died, or the first waiting job if the process never became ready."""
        code = None
        if self._worker is not None:
            self._worker.process.join(0.02)
            code = self._worker.process.exitcode
        job = self._running
        if job is None and not self._ready and self._waiting:
            job = self._waiting.popleft()
        self._kill()
        if job is not None:
            job._end("failed", error=CalstationError("program.worker_ended", exit_code=code))

    def _start(self) -> None:
        self._worker = ChildProcess("worker", _serve, self._warm_up, daemon=True)
        self._ready = False

    def _kill(self) -> None:
        if self._worker is not None:
            self._worker.close()
            self._worker.process.kill()
            self._killed.append(self._worker.process)
        self._worker = self._running = None
        self._ready = False


class _QueueClosedError(BaseException):
    """The job queue is closed; this error is derived from BaseException so that no job catches it."""


def _serve(connection: "Connection[Any, Any]", warm_up: Callable[[], None] | None) -> None:
    applog.configure("jobs")
    with suppress(ValueError, OSError):
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # the owner handles Ctrl-C
    receive_stop_signals()
    if warm_up is not None:
        warm = threading.Timer(_WARM_UP_DELAY, _try_warm_up, (warm_up,))
        warm.daemon = True
        warm.start()
    with suppress(_QueueClosedError, EOFError, OSError):
        connection.send(("ready",))
        while True:
            _run_job(connection, connection.recv_bytes())


def _try_warm_up(warm_up: Callable[[], None]) -> None:
    with suppress(Exception):  # a job that needs it fails with the same error and reports it
        warm_up()


def _run_job(connection: "Connection[Any, Any]", call: bytes) -> None:
    try:
        work, args, kwargs = pickle.loads(call)
        result = work(_progress_of(connection), *args, **kwargs)
        message = bytes(ForkingPickler.dumps(("done", result)))
    except CalstationError as error:
        message = bytes(ForkingPickler.dumps(("failed", CalstationError(error.code, **error.values))))
    except Exception as error:  # reported to the owner in the parent process
        logger.exception("a job ended with a programming error")
        message = bytes(ForkingPickler.dumps(("failed", _internal(error))))
    connection.send_bytes(message)


def _internal(error: BaseException) -> CalstationError:
    """Convert an unexpected exception to an error of the system or of the program."""
    if isinstance(error, OSError) and (of_system := system_error(error)):
        return of_system
    text = " ".join(str(error).split())
    detail = f"{type(error).__name__}: {text}" if text else type(error).__name__
    return CalstationError("program.internal", detail=detail)


def _progress_of(connection: "Connection[Any, Any]") -> ProgressCallback:
    last = float("-inf")

    def progress(fraction: float, remaining_s: float | None = None, note: str = "") -> None:
        nonlocal last
        now = time.monotonic()
        if now - last < _PROGRESS_INTERVAL:
            return
        last = now
        try:
            connection.send(("progress", float(fraction), remaining_s, note))
        except OSError:
            raise _QueueClosedError from None

    return progress
