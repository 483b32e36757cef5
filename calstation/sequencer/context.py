"""What a run is to do, and what it shares: table, units, clock, commands of the operator and the sink of its events."""

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING, Protocol

import numpy as np

from calstation.devices import Imu, Table
from calstation.devices.profiles import Span
from calstation.errors import CalstationError
from calstation.estimation import Solution
from calstation.estimation.common import ImuModel, SampleBlock
from calstation.physics import FloatArray, TableGeometry
from calstation.sequencer.control import Control, State
from calstation.sequencer.events import LOSSY, Event, to_json
from calstation.sequencer.plan import SETTLE, StagePlan

if TYPE_CHECKING:  # the window names tasks, but has no use for logs
    from calstation.records import RawLogWriter


class Output(StrEnum):
    """Whether a unit outputs samples with its registers applied: always, on command, or never."""

    ALWAYS = "always"
    ASKED = "asked"
    NEVER = "never"


@dataclass(frozen=True)
class StatusMasks:
    """Bits of the IMU's status word: data valid since power-up, output saturated, self-test failed."""

    ready: int = 0
    saturated: int = 0
    failed: int = 0


@dataclass(frozen=True)
class LastSample:
    """Counter, IMU time (s) and step of the last sample of a run that is resumed."""

    seq: int
    time: float
    step: int


@dataclass(frozen=True)
class PreflightLimits:
    """What a unit and its mounting must show before the run.

    Times in s, angles and rates in rad and rad/s. `warm_up_slope` is in °C/min, None where temperature does not matter.
    Gravity and turns are compared within fractions of their size, directions within `direction_tolerance`. At rest each
    gyro measures between `rate_low` and `rate_high`, shape (3,). `flow` seconds of data have no gap. `output` is False
    if registers that may be wrong are applied to the output, which is then not checked.
    """

    serial_pattern: str
    gravity: float
    ready_timeout: float = 30.0
    home_timeout: float = 180.0
    warm_up: float = 0.0
    warm_up_slope: float | None = None
    warm_up_timeout: float = 1800.0
    gravity_tolerance: float = 0.03
    direction_tolerance: float = np.deg2rad(5.0)
    rate_low: FloatArray = field(default_factory=lambda: np.full(3, -np.inf))
    rate_high: FloatArray = field(default_factory=lambda: np.full(3, np.inf))
    turn: float = np.deg2rad(5.0)
    turn_rate: float = np.deg2rad(5.0)
    turn_tolerance: float = 0.1
    flow: float = 2.0
    output: bool = True


@dataclass(frozen=True)
class UnitTask:
    """One unit on the table: what its stream is like and what it must show.

    `span` is the range of its channels, counts; its counter begins again after `wrap` samples.
    """

    serial: str
    model: ImuModel
    preflight: PreflightLimits
    masks: StatusMasks = field(default_factory=StatusMasks)
    span: Span = field(default_factory=Span)
    wrap: float = np.inf
    corrected: Output = Output.NEVER


@dataclass(frozen=True)
class Task:
    """What the table does in a run, and within which limits; s, rad.

    A unit is changed at the `load_angle`, reached with the travel rate and acceleration.
    """

    stages: tuple[StagePlan, ...]
    geometry: TableGeometry
    by_hand: bool = False
    latency: float = 0.0
    settle: float = SETTLE
    load_angle: tuple[float, float] = (0.0, 0.0)
    travel_rate: float = np.deg2rad(20.0)
    travel_acceleration: float = np.deg2rad(20.0)


@dataclass(frozen=True)
class Finalized:
    """Whether the unit passed, and whether registers were written, which then need verification."""

    passed: bool
    written: bool


@dataclass(frozen=True)
class Ended:
    """How a run ended: final state, what was solved, and the error of a fault."""

    state: State
    solutions: tuple[Solution, ...]
    error: CalstationError | None = None


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
    """A position on the table with the unit in it; everything that is per unit.

    A register operation has no `journal` and no `solving`. `after` is the last sample of the run that is resumed.
    """

    imu: Imu
    unit: UnitTask
    journal: "RawLogWriter | None" = None
    solving: Solving | None = None
    after: LastSample | None = None
    name: str = "unit"

    def take(self, block: SampleBlock) -> None:
        """Log samples, and feed those of a stage to its solver."""
        if self.journal is not None:
            self.journal.append(block)
        if block.stage and self.solving is not None:
            self.solving.feed(block)


@dataclass(frozen=True)
class RunContext:
    """Everything that the parts of a run share; what is per table. There is exactly one slot."""

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
