"""Durations of the phases of a run from its start to its result, which are derived from its events."""

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from calstation.errors import DeviceFaultError
from calstation.results import CyclePhase
from calstation.sequencer import Clock, Event, Message, StageEnded, StageSolved, StageStarted, State, StateChanged

#: Phase that begins with each state.
_STATES: dict[str, str] = {
    State.PREPARING: "preparation",
    State.PAUSING: "pause",
    State.STOPPING: "stopping",
    **dict.fromkeys((State.STOPPED, State.FAULT, State.DONE), "files"),
}

#: Phase that begins with each message.
_MESSAGES = {
    "resumed": "resuming",
    "warming_up": "warm_up",
    "registers_reading": "transfer",
    "reference": "proof",
    "registers_transfer": "transfer",
    "verifying": "proof",
    "finishing": "unloading",
}


class Cycle:
    """The phases of a run, of which the first, ``opening``, begins when the object is created.

    The duration of a phase is the longer of device time and host time. On hardware both are the same; on a bench at
    full speed, motion takes device time, and solving and files take host time.
    """

    def __init__(self) -> None:
        self._clock: Clock | None = None
        self._host, self._station = time.monotonic(), 0.0
        self._completed: list[CyclePhase] = []
        self._phase, self._stage, self._seconds = "opening", "", 0.0
        self._paused = ("", "")
        self._lock = threading.Lock()  # another thread writes the result if a unit leaves its batch

    @contextmanager
    def using(self, clock: Clock) -> Iterator[None]:
        """Measure device time with the clock of the station while the context is open."""
        self._measure()
        self._clock, self._station = clock, clock.now()
        try:
            yield
        finally:
            self._measure()
            self._clock = None

    def follow(self, event: Event) -> None:
        """Begin a phase if the event marks its start."""
        if isinstance(event, StageStarted):
            self._begin("stage", event.stage)
        elif isinstance(event, StageEnded):
            self._begin("solving", event.stage)
        elif isinstance(event, StageSolved) and self._phase in ("solving", "files"):
            self._on_solved()
        elif isinstance(event, StateChanged) and event.previous == State.PAUSED and event.state == State.RUNNING:
            self._begin(*self._paused)
        elif isinstance(event, StateChanged) and event.state in _STATES:
            if event.state == State.PAUSING:
                self._paused = self._phase, self._stage
            self._begin(_STATES[event.state])
        elif isinstance(event, Message) and event.id in _MESSAGES:
            self._begin(_MESSAGES[event.id])

    def phases(self) -> list[CyclePhase]:
        """Return the phases up to now in order; the last one is in progress."""
        with self._lock:
            self._measure()
            return [*self._completed, self._current()]

    def station_time(self) -> float | None:
        """Return the device time, s; None before the devices are open and after they are closed."""
        clock = self._clock
        with suppress(DeviceFaultError):
            return None if clock is None else clock.now()
        return None

    def _on_solved(self) -> None:
        """Begin the phase ``files``; if it has already begun, another unit of the batch was solved until now."""
        with self._lock:
            if self._phase == "files":
                solving = self._completed.pop()
                self._phase, self._stage = solving.phase, solving.stage
                self._seconds += solving.seconds
        self._begin("files")

    def _begin(self, phase: str, stage: str = "") -> None:
        with self._lock:
            self._measure()
            self._completed.append(self._current())
            self._phase, self._stage, self._seconds = phase, stage, 0.0

    def _current(self) -> CyclePhase:
        stage = {"stage": self._stage} if self._stage else {}
        return CyclePhase(phase=self._phase, seconds=self._seconds, **stage)

    def _measure(self) -> None:
        """Add the time since the last call to the current phase."""
        host, station = time.monotonic(), self._station
        if self._clock is not None:
            with suppress(DeviceFaultError):  # a virtual bench that has terminated has no time
                station = self._clock.now()
        self._seconds += max(host - self._host, station - self._station)
        self._host, self._station = host, station
