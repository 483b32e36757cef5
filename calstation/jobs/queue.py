"""Slow work beside the window: one warmed process does jobs in order and can be killed in the middle of one."""

import multiprocessing
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

from calstation.errors import CalstationError
from calstation.jobs.process import PipeReader, spawn_process

#: Progress told more often than this, s, is left out: a listener that is late must not slow the work down.
_TELL_EVERY = 0.05

#: Host time after which kernels are made ready, s: while the window opens the computer has enough to do.
_WARM_AFTER = 2.0

READY = ("ready",)


class ProgressCallback(Protocol):
    """How a work says how far it is; also where it learns that nobody wants it any more."""

    def __call__(self, fraction: float, remaining_s: float | None = None, note: str = "") -> None:
        """`fraction` 0..1 done, `remaining_s` s left where known, `note` what is being done."""


class _HungUp(BaseException):
    """The workshop has gone; no work catches this."""


def serve(connection: "Connection[Any, Any]") -> None:
    """Entry of the worker's process: ends when the workshop hangs up."""
    with suppress(ValueError, OSError):
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the listener
    import calstation.results.resolve  # noqa: F401 - what most jobs need, before the first of them

    warm = threading.Timer(_WARM_AFTER, _warm)
    warm.daemon = True
    warm.start()
    with suppress(_HungUp, EOFError, OSError):
        connection.send(READY)
        while True:
            _do(connection, connection.recv_bytes())


def _warm() -> None:
    from calstation.estimation.navigation.stage import warm_up

    with suppress(Exception):  # a job that needs it meets the same error, and its listener is told
        warm_up()


def _do(connection: "Connection[Any, Any]", job: bytes) -> None:
    """Do one job and answer with its result or its error."""
    try:
        work, args, kwargs = pickle.loads(job)
        result = work(_teller(connection), *args, **kwargs)
        answer = bytes(ForkingPickler.dumps(("done", result)))
    except CalstationError as error:
        answer = bytes(ForkingPickler.dumps(("failed", CalstationError(error.args[0], **error.values))))
    except Exception as error:  # noqa: BLE001 - told to the listener, whose process this is not
        answer = bytes(ForkingPickler.dumps(("failed", internal(error))))
    connection.send_bytes(answer)


def internal(error: BaseException) -> CalstationError:
    """An unexpected exception as an error of the program."""
    text = " ".join(str(error).split())
    detail = f"{type(error).__name__}: {text}" if text else type(error).__name__
    return CalstationError("program.internal", detail=detail)


def _teller(connection: "Connection[Any, Any]") -> Callable[..., None]:
    last = float("-inf")

    def tell(fraction: float, remaining_s: float | None = None, note: str = "") -> None:
        nonlocal last
        now = time.monotonic()
        if now - last < _TELL_EVERY:
            return
        last = now
        try:
            connection.send(("progress", float(fraction), remaining_s, note))
        except OSError:
            raise _HungUp from None

    return tell


State = Literal["waiting", "running", "done", "failed", "cancelled"]

#: What `JobQueue.close` gives to a job that must not be cancelled, s: it talks to a device.
_DEVICE_WORK_WITHIN = 10.0

#: What a killed process is given to be gone, s.
_END_WITHIN = 2.0

#: Fraction from which the time left is estimated where the work does not say it.
_ESTIMATE_FROM = 0.02


class Job:
    """One piece of work, looked at from outside. Nothing here waits.

    Attributes
    ----------
    state : waiting, running, done, failed or cancelled
    fraction : 0..1 done; note : what is being done, as the work says
    result : what the work returned, once done; error : what went wrong, once failed
    cancellable : False for work that talks to a device
    """

    def __init__(self, job_queue: "JobQueue", call: bytes, cancellable: bool) -> None:
        self._job_queue = job_queue
        self._call = call
        self._told_remaining: float | None = None
        self._told_at = self._begun = 0.0
        self.cancellable = cancellable
        self.state: State = "waiting"
        self.fraction = 0.0
        self.note = ""
        self.result: Any = None
        self.error: CalstationError | None = None

    @property
    def ended(self) -> bool:
        """Whether nothing more will come."""
        return self.state in ("done", "failed", "cancelled")

    @property
    def remaining(self) -> float | None:
        """Seconds left as the work said, else estimated from its fraction; None where nobody can tell."""
        if self.state != "running":
            return None
        now = time.monotonic()
        if self._told_remaining is not None:
            return max(0.0, self._told_remaining - (now - self._told_at))
        if self.fraction < _ESTIMATE_FROM:
            return None
        spent = self._told_at - self._begun
        return max(0.0, spent * (1.0 - self.fraction) / self.fraction - (now - self._told_at))

    def poll(self) -> State:
        """Take what the worker has told; returns the state. To be called from a timer."""
        self._job_queue.poll()
        return self.state

    def cancel(self) -> bool:
        """Give the job up; a running one is killed. False where it has ended or must not be cancelled."""
        return self._job_queue.cancel(self)

    def _begin(self) -> None:
        self.state = "running"
        self._begun = self._told_at = time.monotonic()

    def _progress(self, fraction: float, remaining: float | None, note: str) -> None:
        self.fraction = min(1.0, max(0.0, fraction))
        self._told_remaining, self._told_at = remaining, time.monotonic()
        self.note = note

    def _end(self, state: State, result: Any = None, error: CalstationError | None = None) -> None:
        self.state, self.result, self.error = state, result, error
        if state == "done":
            self.fraction = 1.0


class JobQueue:
    """Takes jobs and does them in order in one process of its own, started at once.

    Everything moves on in `poll` (of the workshop or of any of its jobs), which never waits, not even for the rest of
    a large result. A job is sent only to a worker that is waiting for one, so that sending does not wait either.
    """

    def __init__(self) -> None:
        self._waiting: deque[Job] = deque()
        self._running: Job | None = None
        self._process: BaseProcess | None = None
        self._connection: Connection[Any, Any] | None = None
        self._pipe_reader: PipeReader | None = None
        self._ready = False
        self._dying: list[BaseProcess] = []
        self._closed = False
        self._start()

    def submit(self, work: Callable[..., Any], /, *args: Any, cancellable: bool = True, **kwargs: Any) -> Job:
        """Have ``work(tell, *args, **kwargs)`` done; see `worker.Tell`.

        Parameters
        ----------
        work : a function at the top level of a module; arguments and result must be picklable
        cancellable : False for work that talks to a device: it is never killed
        """
        if self._closed:
            raise RuntimeError("the workshop is closed")
        job = Job(self, bytes(ForkingPickler.dumps((work, args, kwargs))), cancellable)
        self._waiting.append(job)
        self.poll()
        return job

    @property
    def busy(self) -> bool:
        """Whether a job runs or waits."""
        return self._running is not None or bool(self._waiting)

    @property
    def at_device(self) -> bool:
        """Whether a job that talks to a device, and is therefore not to be cancelled, runs or waits."""
        jobs = [*self._waiting, *([] if self._running is None else [self._running])]
        return any(not job.cancellable for job in jobs)

    def poll(self) -> None:
        """Take what the worker has told and give it the next job. Never waits."""
        if self._closed:
            return
        self._reap()
        self._take()
        if self._ready and self._running is None and not self._alive():
            self._lost()
        if self._waiting and self._process is None:
            self._start()
        if self._waiting and self._ready and self._running is None:
            self._send(self._waiting.popleft())

    def cancel(self, job: Job) -> bool:
        """Give a job up, see `Job.cancel`."""
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
        """Give all jobs up and end the process. A job that must not be cancelled has 10 s to end itself."""
        if self._closed:
            return
        for job in self._waiting:
            job._end("cancelled")
        self._waiting.clear()
        deadline = time.monotonic() + _DEVICE_WORK_WITHIN
        while self._running is not None and not self._running.cancellable and time.monotonic() < deadline:
            self.poll()
            time.sleep(0.01)
        if self._running is not None:
            self._running._end("cancelled")
        self._kill()
        self._closed = True
        deadline = time.monotonic() + _END_WITHIN
        for process in self._dying:
            process.join(max(0.0, deadline - time.monotonic()))

    def _take(self) -> None:
        while self._pipe_reader is not None:
            try:
                message = self._pipe_reader.take()
            except Empty:
                return
            except (EOFError, OSError):
                self._lost()
                return
            except Exception as error:  # noqa: BLE001 - a result that cannot be unpacked here
                message = ("failed", internal(error))
            self._hear(message)

    def _hear(self, message: tuple[Any, ...]) -> None:
        if message == READY:
            self._ready = True
        elif self._running is not None:
            kind, *values = message
            if kind == "progress":
                self._running._progress(*values)
                return
            job, self._running = self._running, None
            if kind == "done":
                job._end("done", result=values[0])
            else:
                job._end("failed", error=values[0])

    def _send(self, job: Job) -> None:
        assert self._connection is not None
        try:
            self._connection.send_bytes(job._call)
        except OSError:  # it died while idle: the next one gets the job
            self._waiting.appendleft(job)
            self._lost()
            return
        self._running = job
        job._begin()

    def _alive(self) -> bool:
        return self._process is not None and self._process.is_alive()

    def _lost(self) -> None:
        """The process died by itself: the job in hand fails, or the first in line where it never got ready."""
        code = None
        if self._process is not None:
            self._process.join(0.02)
            code = self._process.exitcode
        job = self._running
        if job is None and not self._ready and self._waiting:
            job = self._waiting.popleft()
        self._kill()
        if job is not None:
            job._end("failed", error=CalstationError("program.worker_ended", exit_code=code))

    def _start(self) -> None:
        context = multiprocessing.get_context("spawn")
        here, there = context.Pipe()
        process = context.Process(target=serve, args=(there,), name="calstation worker", daemon=True)
        spawn_process(process)
        there.close()
        self._process, self._connection, self._pipe_reader = process, here, PipeReader(here)
        self._ready = False

    def _kill(self) -> None:
        if self._pipe_reader is not None:
            self._pipe_reader.close()
        if self._process is not None:
            self._process.kill()
            self._dying.append(self._process)
        self._process = self._connection = self._pipe_reader = self._running = None
        self._ready = False

    def _reap(self) -> None:
        self._dying = [process for process in self._dying if process.is_alive()]
