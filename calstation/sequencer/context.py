"""What a run shares: the table, the units on it, the clock, the operator's commands and the sink of its events."""

from collections.abc import Callable, Mapping
from concurrent.futures import Future
from dataclasses import dataclass, field
from typing import Any, Protocol

from calstation.devices import Imu, Table
from calstation.estimation import Solution
from calstation.estimation.common import SampleBlock
from calstation.physics import FloatArray
from calstation.sequencer.control import Control
from calstation.sequencer.events import LOSSY, Event, to_json
from calstation.sequencer.task import LastSample, Task, UnitTask

Emit = Callable[[Event], None]


class Clock(Protocol):
    """Station time, s: real, or the virtual bench's."""

    @property
    def tick(self) -> float:
        """Period at which the devices are polled, s."""

    def now(self) -> float:
        """Station time, s."""

    def sleep(self, seconds: float) -> None:
        """Let `seconds` of station time pass."""

    def idle(self, seconds: float) -> None:
        """Let `seconds` of host time pass while the station computes."""


class Journal(Protocol):
    """The raw log, as the sequencer writes it."""

    def append(self, block: SampleBlock) -> None:
        """Write samples."""

    def event(self, event: Mapping[str, Any]) -> None:
        """Write an event."""

    def service(self) -> None:
        """Write out what is due; called at every tick."""

    def begin_sync(self) -> Future[None]:
        """Begin to write everything to the disk; once that is done, `service` raises what it refused."""


class Solving(Protocol):
    """The chain of stage solvers."""

    def warm(self) -> None:
        """Prepare to solve; may take seconds on a new computer, where kernels are compiled first."""

    def start(self, stage: str) -> None:
        """Begin a stage with the last one's posterior as its prior."""

    def feed(self, block: SampleBlock) -> None:
        """Take samples of the stage."""

    def sigma(self) -> FloatArray:
        """Standard deviations of the 30 parameters so far, shape (30,), SI."""

    def finish(self) -> Solution:
        """Solve the stage."""


@dataclass(frozen=True)
class Slot:
    """A place on the table with the unit in it; everything that is per unit.

    Attributes
    ----------
    imu : the open device
    unit : what its stream is like and what it must show
    journal : its raw log; None for a register operation, which keeps no samples
    solving : solves its samples; None for a register operation
    after : the last sample of the run that is resumed; None for a new one
    name : of the slot in the station file
    """

    imu: Imu
    unit: UnitTask
    journal: Journal | None = None
    solving: Solving | None = None
    after: LastSample | None = None
    name: str = "unit"

    def take(self, block: SampleBlock) -> None:
        """Log samples, and feed those of a stage to its solver."""
        if self.journal is not None:
            self.journal.append(block)
        if block.stage and self.solving is not None:
            self.solving.feed(block)

    def service(self) -> None:
        """Let the log write out what is due."""
        if self.journal is not None:
            self.journal.service()


@dataclass(frozen=True)
class RunContext:
    """Everything that the parts of a run share; what is per table.

    Attributes
    ----------
    task : what the table does
    table : the open device
    slots : exactly one
    clock : station time
    control : the operator's commands, from any thread
    listener : takes every event
    """

    task: Task
    table: Table
    slots: tuple[Slot, ...]
    clock: Clock
    listener: Emit
    control: Control = field(default_factory=Control)

    @property
    def slot(self) -> Slot:
        """The only slot."""
        (slot,) = self.slots
        return slot

    def emit(self, event: Event) -> None:
        """Pass an event to the listener, and to the logs unless it only refreshes a display."""
        if not isinstance(event, LOSSY):
            entry = {"station_time": self.clock.now(), **to_json(event)}
            for slot in self.slots:
                if slot.journal is not None:
                    slot.journal.event(entry)
        self.listener(event)
