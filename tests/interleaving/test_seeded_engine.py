"""Window, pipe, engine, control loop and log of a run with devices in memory: commands and STOP at any moment."""

import os
import threading
import time
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from calstation.config import RunRequest
from calstation.connection import RealClock
from calstation.estimation import Solution
from calstation.estimation.common import SampleBlock
from calstation.jobs import process
from calstation.physics import Dwell, Move
from calstation.records import LogMeta, RawLogWriter, Verdict, open_log
from calstation.runs import channel, engine
from calstation.sequencer import (
    LOSSY,
    Command,
    Control,
    Emit,
    Event,
    Finalized,
    RunContext,
    RunEnd,
    Sequencer,
    Slot,
    StagePlan,
    State,
    StateChanged,
    StopReason,
    control,
    driving,
)
from tests.interleaving.scheduler import Pipe, Scheduler, failing_seed, run_seeds, with_seeds
from tests.records.records_samples import META
from tests.sequencer.fakes import FakeSolving, Scene

pytest.importorskip("PySide6.QtCore", exc_type=ImportError)

from calstation.gui.state import engine_link

#: Virtual time after which the operator stops a run that has not ended, s.
LAST_STOP = 25.0
BEGIN = 1000.0
OUTCOMES = {State.DONE: Verdict.FAILED, State.STOPPED: Verdict.STOPPED, State.FAULT: Verdict.FAULT}


class VirtualClock(RealClock):
    """The clock of a station on hardware, in virtual time from 0, with fewer ticks."""

    tick = 0.25

    @property
    def time(self) -> float:
        return time.monotonic() - BEGIN

    def now(self) -> float:
        return self.time


class Log(RawLogWriter):
    """A log that remembers what was appended."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, LogMeta.model_validate(META), station=True)
        self.appended: list[np.ndarray] = []

    def append(self, block: SampleBlock) -> None:
        self.appended.append(block.seq)
        super().append(block)


class SlowSolving(FakeSolving):
    """A solver that takes time, in its own thread."""

    def finish(self, progress: Any = None) -> Solution:
        time.sleep(1.0)
        return super().finish()


class Run(Scene):
    """A run of two short stages in the engine's process."""

    def __init__(self, path: Path) -> None:
        super().__init__(StagePlan("rate", stage), StagePlan("excitation", stage))
        self.path, self.emitted = path, list[Event]()
        self.clock = self.table.clock = self.imu.clock = VirtualClock()  # type: ignore[assignment]
        self.passes = False

    def execute(self, request: RunRequest, emit: Emit, control: Control) -> None:
        """Execute the run, as `calstation.runs.run.execute` does."""

        def listener(event: Event) -> None:
            self.emitted.append(event)
            emit(event)

        self.control, self.listener, self.log = control, listener, Log(self.path)
        slot = Slot(self.imu, self.unit, self.log, SlowSolving(), evaluation=self)
        Sequencer(RunContext(self.task, self.table, (slot,), self.clock, listener, control)).run()

    def ended(self, ended: RunEnd) -> None:
        super().ended(ended)
        verdict = OUTCOMES[ended.state]
        self.log.close(verdict.outcome)
        self.listener(Finalized(verdict, str(self.path), "", {}))


def stage() -> Any:
    """Yield one short move and a rest."""
    yield Move(0.2, 0.0, 0.5, 1.0, ("turn", "x"))
    yield Dwell(1.0)


class Process:
    """A process of `multiprocessing`, as a thread."""

    def __init__(self, target: Callable[..., None], args: Any, name: str, daemon: bool) -> None:
        end, *others = args
        self._target, self._args = target, (end.inherited(), *others)
        self._thread = threading.Thread(target=self._run, name=name, daemon=daemon)
        self.killed, self.exitcode = False, None
        self.start, self.is_alive, self.join = self._thread.start, self._thread.is_alive, self._thread.join

    def _run(self) -> None:
        try:
            self._target(*self._args)
        finally:
            self._args[0].close()

    def kill(self) -> None:
        self.killed = True
        assert self._thread.task is not None
        self._thread.task.life = 0


class Timer:
    """A `QTimer` that the window's thread calls."""

    def __init__(self, parent: object, interval: int, singleShot: bool = False) -> None:
        self.timeout, self.active = self, False
        self.interval = interval / 1000.0

    def connect(self, callback: Callable[[], None]) -> None:
        self.callback = callback

    def start(self) -> None:
        self.active = True

    def stop(self) -> None:
        self.active = False


class Window:
    """The window's thread: it sends commands, reads events, and closes or freezes at some moment."""

    def __init__(self, scheduler: Scheduler) -> None:
        random = self._random = scheduler.random
        self.link = engine_link.EngineLink()
        self.events: list[Event] = []
        self.link.event.connect(self.events.append)
        count = random.choice((0, 1, 1, 2, 6))
        commands = [random.choice([*Command, Command.STOP]) for _ in range(count)]
        moments = sorted(random.choice((random.uniform(0.0, 0.5), random.uniform(0.0, 15.0))) for _ in commands)
        self.commands = [*zip(moments, commands, strict=True), (LAST_STOP, Command.STOP)]
        self.end = random.choice(("", "", "", "", "close", "freeze"))
        self._end_at = random.uniform(0.0, 15.0)
        self.sent: list[Command] = []
        self.stopped_at: float | None = None

    def run(self) -> None:
        self.link.start(RunRequest("SN-1"))
        started: Any = self.link._started
        started.callback()
        timer: Any = self.link._timer
        while self.link.running:
            time.sleep(timer.interval)
            now = time.monotonic() - BEGIN
            while self.commands and now >= self.commands[0][0]:
                command = self.commands.pop(0)[1]
                if command is Command.STOP and self.stopped_at is None:
                    self.stopped_at = now
                self.sent.append(command)
                self.link.send(command)
            if self.end == "close" and now >= self._end_at:
                self.link.close()
            elif self.end == "freeze" and now >= self._end_at:
                time.sleep(15.0)
                self.end = "frozen"
            if timer.active:
                timer.callback()


def run_station(seed: int, folder: Path) -> None:
    """Run a window and an engine, and check how table, log and window end."""
    modules = (channel, engine, process, control, engine_link)
    scheduler = Scheduler(seed, modules, max_steps=500_000)
    scheduler.haste = min(scheduler.haste, 0.001)  # otherwise events arrive faster than the window reads them
    random, path = scheduler.random, folder / f"{seed}.h5"
    capacity = random.choice((3, 1000))
    children: list[Process] = []

    def create_process(**values: Any) -> Process:
        children.append(Process(**values))
        return children[0]

    def main() -> tuple[Window, Run]:
        run = Run(path)
        patch.setattr("calstation.runs.run.execute", run.execute)
        window = Window(scheduler)
        window.run()
        children[0].join()
        return window, run

    context = SimpleNamespace(Pipe=lambda: Pipe.pair(capacity), Process=create_process)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(process, "multiprocessing", SimpleNamespace(get_context=lambda method: context))
        patch.setattr(process, "deferred_signals", nullcontext)
        patch.setattr(process, "_hide_main_module", nullcontext)
        patch.setattr(
            engine, "signal", SimpleNamespace(SIGINT=2, SIGHUP=1, SIGTSTP=20, SIGTTIN=21, SIG_IGN=1, signal=_ignore)
        )
        patch.setattr(engine, "receive_stop_signals", _ignore)
        patch.setattr(os, "_exit", _ignore)  # of a stopped engine whose solver still runs
        patch.setattr(engine, "applog", SimpleNamespace(configure=_ignore))
        patch.setattr(engine_link, "QTimer", Timer)
        patch.setattr(os, "fsync", lambda handle: time.sleep(random.choice((0.0, 0.3))))
        window, run = scheduler.run(main)
    if children[0].killed:
        return
    check_table(run)
    check_log(run)
    if not scheduler.haste:  # a slow computer may exceed the time that a window has to read the last events
        check_window(window, run)


def check_table(run: Run) -> None:
    """Check that the table is at rest with its axes off, and that the run ended once."""
    commands = run.table.commands
    assert not run.table.enabled
    assert run.table.origin == run.table.target or run.ends[0].state is State.DONE
    assert len(run.ends) == 1
    if run.ends[0].state is not State.DONE:
        assert commands[-2:] == ["stop", "disable"], commands[-5:]
    else:
        assert commands[-1] == "disable"


def check_log(run: Run) -> None:
    """Check that the log is closed, and has all samples in order."""
    log = open_log(run.path)
    assert log.outcome == OUTCOMES[run.ends[0].state].outcome
    if any(map(len, run.log.appended)):
        seq = np.concatenate([block.seq for block in log.blocks()])
        assert np.array_equal(seq, np.concatenate(run.log.appended))
        assert np.all(np.diff(seq) > 0)
    run.path.unlink()


def check_window(window: Window, run: Run) -> None:
    """Check that a window that listened to the end received every event in order, and one verdict as the last one."""
    if window.end in ("close", "frozen"):
        return
    received = [event for event in window.events if not isinstance(event, LOSSY)]
    assert received == [event for event in run.emitted if not isinstance(event, LOSSY)]
    assert [type(event) for event in received].count(Finalized) == 1
    assert isinstance(received[-1], Finalized)
    states = [event.state for event in received if isinstance(event, StateChanged)]
    assert states[-1] == run.ends[0].state


def _ignore(*arguments: object) -> None:
    pass


@pytest.mark.long
@with_seeds(6)
def test_run_ends_safely_with_one_verdict_and_a_complete_log(seeds: range, tmp_path: Path) -> None:
    run_seeds(seeds, lambda seed: run_station(seed, tmp_path))


def _close_without_events(self: channel.Channel) -> None:
    """Close a channel before its events are sent."""
    self._closing = True
    self._connection.close()


#: Faults, each of which some seed finds.
PLANTED = {
    "the axes stay on": (driving, "safe_stop", lambda table, clock: []),
    "the last events are lost": (channel.Channel, "close", _close_without_events),
    "a stop is lost while paused": (
        control.Control,
        "send",
        lambda self, command, reason=StopReason.OPERATOR: self.pausing or self._queue.put((command, reason)),
    ),
}


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", PLANTED)
def test_seeds_find_a_fault_of_the_engine(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(*PLANTED[name])
    assert failing_seed(range(100), lambda seed: run_station(seed, tmp_path)) is not None
