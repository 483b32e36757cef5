"""A deterministic scheduler: threads run one at a time, in an order that a seed determines, in virtual time.

`Scheduler.run` executes a function in the calling thread and every thread that it starts. `threading.Lock` and
`threading.Thread`, from which the standard library builds conditions, events, queues, futures and executors, are
replaced by cooperative ones, and `time.monotonic` and `time.sleep` by virtual time. Another thread may be chosen
whenever a lock is acquired or released, a thread begins, ends or sleeps, and before every line of the modules in
`traced`. Therefore code between two lines of these modules is atomic, and so is each call of C code.
"""

import logging
import os
import pickle
import queue
import random
import sys
import threading
import time
import traceback
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import thread as executor_module
from contextlib import contextmanager
from types import FrameType, ModuleType
from typing import Any

import pytest

_allocate, _start, _now = threading.Lock, threading._start_new_thread, time.monotonic  # type: ignore[attr-defined]

#: Folder of the standard library, whose lines a report omits.
_LIBRARY = threading.__file__.removesuffix("threading.py")

#: Virtual time of a call of `time.monotonic`, s, so that a loop that only reads the time ends.
_READ_TIME = 1e-6


class DeadlockError(AssertionError):
    """All threads wait for each other, or the threads do not end."""


class _End(BaseException):
    """Ends a thread, because the scheduler has ended or the thread's process is killed."""


class Task:
    """A thread under control of the scheduler."""

    def __init__(self, name: str, frame_of: int | None = None) -> None:
        self.name, self.ident = name, frame_of
        self.baton = _allocate()
        self.baton.acquire()
        self.ready: Callable[[], bool] | None = None  #: Condition for which it waits.
        self.deadline = float("inf")
        self.ended = False
        self.life = float("inf")  #: Number of switch points after which it is killed; then it only cleans up.


class Scheduler:
    """Runs threads in an order determined by `seed`; at every line of `traced` modules, another one may run.

    Parameters
    ----------
    seed : seed of the order; `random` is the generator, which a scenario may use as well
    traced : modules in which the order may change at every line
    max_steps : number of switch points after which the threads are considered to run forever
    """

    _active: "Scheduler | None" = None

    def __init__(self, seed: int, traced: tuple[ModuleType, ...] = (), max_steps: int = 100_000) -> None:
        self.random = random.Random(seed)
        self._files = {module.__file__ for module in traced}
        self._max_steps = max_steps
        #: Probability that a thread continues at a switch point, and that a timer expires while threads are ready.
        self._inertia = self.random.choice((0.0, 0.5, 0.9, 0.99))
        self.haste = self.random.choice((0.0, 0.001, 0.02))
        self._delay = self.random.choice(
            (0.0, 0.01, 0.1)
        )  #: Delay of a timer, which then ends together with others, s.
        self.now = 1000.0
        self.steps = 0
        self._ending = False
        self._failure: BaseException | None = None
        self._tasks: list[Task] = []
        self._by_ident: dict[int, Task] = {}

    def run(self, main: Callable[[], Any]) -> Any:
        """Run `main` and its threads to the end of `main`, then end the threads that still run; return its result.

        Raises an exception of any thread, and DeadlockError.
        """
        task = self._main = self._running = Task("main", threading.get_ident())
        self._tasks.append(task)
        self._by_ident[threading.get_ident()] = task
        with _patched(self):
            sys.settrace(self._trace)
            try:
                return main()
            except _End:
                assert self._failure is not None
                raise self._failure from None
            finally:
                sys.settrace(None)
                self._end_threads()
                if self._failure is not None and sys.exc_info()[0] is None:
                    raise self._failure

    @classmethod
    def current(cls) -> "tuple[Scheduler, Task] | None":
        """Return the scheduler and the task of the calling thread; None for a thread outside the scheduler."""
        scheduler = cls._active
        task = None if scheduler is None else scheduler._by_ident.get(threading.get_ident())
        return None if task is None or scheduler is None else (scheduler, task)

    def begin(self, name: str, work: Callable[[], None]) -> Task:
        """Start `work` in a new thread."""
        task = Task(name)

        def bootstrap() -> None:
            task.ident = threading.get_ident()
            self._by_ident[task.ident] = task
            task.baton.acquire()
            try:
                if not self._ending:
                    sys.settrace(self._trace)
                    work()
            except _End:
                pass
            except BaseException as error:  # noqa: BLE001 - raised by the main thread
                if self._failure is None and not self._ending:
                    self._failure = error
            finally:
                sys.settrace(None)
                del self._by_ident[task.ident]
                task.ended = True
                self._hand_over(task, self._main if self._failure is not None else None)

        self._tasks.append(task)
        _start(bootstrap, ())
        self.switch()
        return task

    @property
    def ends(self) -> bool:
        """Whether the threads are being ended, so that a context may end without the lock that it waited for."""
        return self._ending or self._failure is not None

    def switch(self) -> None:
        """Let another thread run."""
        self.wait(None)

    def wait(self, ready: Callable[[], bool] | None, timeout: float | None = None) -> None:
        """Let other threads run until `ready` is true, or `timeout` s have passed."""
        task = self._running
        if self._ending:
            if ready is not None:
                raise _End
            return
        task.life -= 1
        if task.life <= 0:
            task.life = float("inf")
            raise _End
        task.ready = ready
        task.deadline = float("inf") if timeout is None else self.now + max(0.0, timeout)
        self._hand_over(task, None)
        task.ready = None
        if self._ending or (self._failure is not None and task is self._main):
            raise _End

    def _hand_over(self, task: Task, successor: Task | None) -> None:
        following = self._main if self._ending else successor or self._choose(task)
        if following is not task:
            self._running = following
            following.baton.release()
            if not task.ended:
                task.baton.acquire()

    def _choose(self, current: Task) -> Task:
        """Choose the next thread; the main thread if no thread can continue."""
        self.steps += 1
        waiting = [task for task in self._tasks if not task.ended]
        ready = [task for task in waiting if task.ready is None or task.deadline <= self.now or task.ready()]
        timers = [task.deadline for task in waiting if task not in ready and task.deadline < float("inf")]
        if self.steps > self._max_steps:
            return self._fail(f"{self._max_steps} steps without an end")
        if timers and (not ready or self.random.random() < self.haste):
            end = min(timers) + self._delay
            self.now = max(self.now, *(deadline for deadline in timers if deadline <= end))
            ready = [task for task in waiting if task in ready or task.deadline <= self.now]
        if not ready:
            return self._fail("a deadlock")
        if current in ready and self.random.random() < self._inertia:
            return current
        return self.random.choice(ready)

    def _fail(self, problem: str) -> Task:
        frames, lines = sys._current_frames(), []
        for task in self._tasks:
            if not task.ended:
                frame = frames.get(task.ident or 0)
                stack = [] if frame is None else traceback.extract_stack(frame)
                where = [entry for entry in stack if entry.filename != __file__ and _LIBRARY not in entry.filename]
                lines += [f"  {task.name}:"] + [f"    {e.filename}:{e.lineno} {e.line}" for e in where[-4:]]
        self._failure = DeadlockError("\n".join([problem, *lines]))
        return self._main

    def _end_threads(self) -> None:
        self._ending = True
        logging.disable(logging.CRITICAL)  # of what ends in the middle
        try:
            for task in self._tasks:
                if task is not self._main and not task.ended:
                    self._running = task
                    task.baton.release()
                    self._main.baton.acquire()
        finally:
            logging.disable(logging.NOTSET)
            self._by_ident.clear()

    def _trace(self, frame: FrameType, event: str, argument: object) -> Any:
        if frame.f_code.co_filename not in self._files:
            return None
        return self._trace_line

    def _trace_line(self, frame: FrameType, event: str, argument: object) -> Any:
        if event == "line":
            self.switch()
        return self._trace_line


class Lock:
    """A cooperative `threading.Lock`."""

    def __init__(self) -> None:
        self._held = False

    def acquire(self, blocking: bool = True, timeout: float = -1) -> bool:
        found = Scheduler.current()
        if found is not None:
            found[0].switch()
            if self._held and blocking:
                found[0].wait(lambda: not self._held, None if timeout < 0 else timeout)
        if self._held:
            return False
        self._held = True
        return True

    def release(self) -> None:
        found = Scheduler.current()
        if not self._held:
            raise _End if found is not None and found[0].ends else RuntimeError("release unlocked lock")
        self._held = False
        if found is not None:
            found[0].switch()

    def locked(self) -> bool:
        return self._held

    def __enter__(self) -> None:
        if not self.acquire():
            raise _End

    def __exit__(self, *_: object) -> None:
        self.release()


class Thread:
    """A cooperative `threading.Thread`."""

    def __init__(
        self, group: None = None, target: Any = None, name: str = "", args: Any = (), kwargs: Any = None, *,
        daemon: bool | None = None,
    ) -> None:  # fmt: skip
        self._work = lambda: target(*args, **(kwargs or {}))
        self.name, self.daemon = name or getattr(target, "__name__", "thread"), bool(daemon)
        self.task: Task | None = None

    def start(self) -> None:
        found = Scheduler.current()
        assert found is not None
        self.task = found[0].begin(self.name, self._run)

    def _run(self) -> None:
        ident = threading.get_ident()
        threading._active[ident] = self  # type: ignore[attr-defined] # for `threading.current_thread`
        try:
            self._work()
        finally:
            del threading._active[ident]  # type: ignore[attr-defined]

    def is_alive(self) -> bool:
        return self.task is not None and not self.task.ended

    def join(self, timeout: float | None = None) -> None:
        found = Scheduler.current()
        if found is not None and self.is_alive():
            found[0].wait(lambda: not self.is_alive(), timeout)


class SimpleQueue(queue._PySimpleQueue):  # type: ignore[name-defined,misc]
    """A cooperative `queue.SimpleQueue`, which ignores the timeout of a call that does not block."""

    def get(self, block: bool = True, timeout: float | None = None) -> Any:
        return super().get(block, timeout if block else None)


class Pipe:
    """One end of a cooperative pipe, as `multiprocessing.Pipe` makes it, which holds `capacity` messages."""

    def __init__(self, condition: threading.Condition, capacity: int) -> None:
        self._condition, self._capacity = condition, capacity
        self._inbox: deque[bytes] = deque()
        self.peer = self
        self.closed = False

    @classmethod
    def pair(cls, capacity: int) -> "tuple[Pipe, Pipe]":
        condition = threading.Condition(threading.Lock())  # cooperative only in a thread of the scheduler
        one, other = cls(condition, capacity), cls(condition, capacity)
        one.peer, other.peer = other, one
        return one, other

    def inherited(self) -> "Pipe":
        """Return this end as a new process has it, which the owner of the process does not close."""
        copy = Pipe(self._condition, self._capacity)
        copy._inbox, copy.peer, self.peer.peer = self._inbox, self.peer, copy
        return copy

    def send(self, message: Any) -> None:
        self.send_bytes(pickle.dumps(message))

    def send_bytes(self, data: bytes) -> None:
        with self._condition:
            inbox = self.peer._inbox
            self._condition.wait_for(lambda: self.closed or self.peer.closed or len(inbox) < self._capacity)
            if self.closed or self.peer.closed:
                raise BrokenPipeError
            inbox.append(data)
            self._condition.notify_all()

    def poll(self, timeout: float = 0.0) -> bool:
        with self._condition:
            readable = self._condition.wait_for(lambda: self._inbox or self.closed or self.peer.closed, timeout)
            if self.closed:
                raise OSError("handle is closed")
            return bool(readable)

    def recv(self) -> Any:
        return pickle.loads(self.recv_bytes())

    def recv_bytes(self) -> bytes:
        with self._condition:
            self._condition.wait_for(lambda: self._inbox or self.closed or self.peer.closed)
            if self.closed:
                raise OSError("handle is closed")
            if not self._inbox:
                raise EOFError
            data = self._inbox.popleft()
            self._condition.notify_all()
            return data

    def close(self) -> None:
        with self._condition:
            self.closed = True
            self._condition.notify_all()


@contextmanager
def _patched(scheduler: Scheduler) -> Iterator[None]:
    """Replace the primitives for threads of the scheduler; other threads keep the real ones."""

    def for_tasks(cooperative: Callable[..., Any], real: Callable[..., Any]) -> Callable[..., Any]:
        return lambda *args, **kwargs: (cooperative if Scheduler.current() else real)(*args, **kwargs)

    def monotonic() -> float:
        scheduler.now += _READ_TIME
        return scheduler.now

    def sleep(seconds: float) -> None:
        scheduler.wait(lambda: False, seconds)

    lock = for_tasks(Lock, _allocate)
    virtual_now, virtual_sleep = for_tasks(monotonic, _now), for_tasks(sleep, time.sleep)
    with pytest.MonkeyPatch.context() as patch:
        for target, name, value in (
            (threading, "Lock", lock),
            (threading, "_allocate_lock", lock),
            (threading, "RLock", for_tasks(threading._PyRLock, threading.RLock)),  # type: ignore[attr-defined]
            (threading, "Thread", for_tasks(Thread, threading.Thread)),
            (threading, "_time", virtual_now),
            (queue, "time", virtual_now),
            (queue, "SimpleQueue", SimpleQueue),
            (executor_module, "_global_shutdown_lock", Lock()),
            (time, "monotonic", virtual_now),
            (time, "sleep", virtual_sleep),
        ):
            patch.setattr(target, name, value)
        Scheduler._active = scheduler
        try:
            yield
        finally:
            Scheduler._active = None


def with_seeds(count: int) -> pytest.MarkDecorator:
    """Parametrize a test by `seeds`: `count` of them in the suite, and 10,000 before a release.

    The environment variable `CALSTATION_SEED` replaces them by one, to replay it.
    """
    if seed := os.environ.get("CALSTATION_SEED"):
        return pytest.mark.parametrize("seeds", [pytest.param(range(int(seed), int(seed) + 1), id=seed)])
    marks = [pytest.mark.exhaustive, pytest.mark.timeout(3600)]
    parts = [pytest.param(range(first, first + 1000), marks=marks, id=f"{first}") for first in range(0, 10_000, 1000)]
    return pytest.mark.parametrize("seeds", [pytest.param(range(count), id="suite"), *parts])


def run_seeds(seeds: Iterable[int], scenario: Callable[[int], object]) -> None:
    """Run a scenario with each seed; a failure says how to replay it."""
    for seed in seeds:
        try:
            scenario(seed)
        except Exception as error:
            error.add_note(f"replay with CALSTATION_SEED={seed}")
            raise


def failing_seed(seeds: Iterable[int], scenario: Callable[[int], object]) -> int | None:
    """Return the first seed with which a scenario, into which a fault was planted, fails; None if none does."""
    for seed in seeds:
        try:
            scenario(seed)
        except Exception:  # noqa: BLE001 - any failure finds the fault
            return seed
    return None
