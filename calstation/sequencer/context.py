"""The task of a run and the objects that its parts share: table, units, clock, commands and event listener."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from calstation.devices import Chamber, Imu, Table
from calstation.devices.profiles import ChannelRange, StatusSection
from calstation.errors import CalstationError
from calstation.estimation import Ranking, Solution
from calstation.estimation.common import ImuModel, SampleBlock
from calstation.judgement import Judgement
from calstation.physics import FloatArray, GimbalTurn, TableGeometry
from calstation.sequencer.control import Control, State
from calstation.sequencer.events import LOSSY, Event, times, to_json
from calstation.sequencer.plan import SETTLE_TIME, StagePlan
from calstation.sequencer.verification_path import VerificationData

if TYPE_CHECKING:  # the window uses tasks but not logs
    from calstation.records import RawLogWriter
    from calstation.sequencer.chamber import ChamberLimits

#: Function that runs another function in a separate thread to its end, and returns its result or raises its error.
RunInBackground = Callable[[Callable[[], Any]], Any]


class Output(StrEnum):
    """When a unit applies its registers to the samples that it outputs: always, on command, or never."""

    ALWAYS = "always"
    ON_COMMAND = "on_command"
    NEVER = "never"


@dataclass(frozen=True)
class LastSample:
    """Counter, IMU time, s, and step of the last sample of the run that is resumed."""

    seq: int
    time: float
    step: int


@dataclass(frozen=True)
class PreflightLimits:
    """Limits for the checks of a unit and its mounting before the run.

    Times are in s, angles in rad, and rates in rad/s. `warm_up_slope` is in °C/min, or None if it is not checked.
    `gravity` is in m/s²; `gravity_tolerance` and `turn_tolerance` are relative. At rest, each gyro must measure a rate
    between `rate_low` and `rate_high`, both of shape (3,). The data must contain no gap for `flow` s. If `output` is
    False, the output is not checked, because the registers applied to it may be wrong.
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
    turn_rate: float = np.deg2rad(60.0)
    turn_tolerance: float = 0.1
    flow: float = 1.0
    output: bool = True


@dataclass(frozen=True)
class UnitTask:
    """Properties of the stream of a unit, its preflight limits, and the geometry of the table in the axes of the unit.

    `span` is the range of the channels, counts. The counter wraps after `wrap` samples.
    """

    serial: str
    model: ImuModel
    preflight: PreflightLimits
    geometry: TableGeometry
    masks: StatusSection = field(default_factory=StatusSection)
    span: ChannelRange = field(default_factory=ChannelRange)
    wrap: float = np.inf
    corrected: Output = Output.NEVER


@dataclass(frozen=True)
class Task:
    """The motion of the table in a run and its limits, with times in s and angles in rad.

    Units are mounted at `load_angle`, to which the table moves with the travel rate and acceleration. `gimbal_turn`
    contains the settings of the turns of a gimbal, and `chamber` the limits of the chamber of a stage over temperature.
    """

    stages: tuple[StagePlan, ...]
    geometry: TableGeometry
    by_hand: bool = False
    latency: float = 0.0
    settle: float = SETTLE_TIME
    load_angle: tuple[float, float] = (0.0, 0.0)
    travel_rate: float = np.deg2rad(90.0)
    travel_acceleration: float = np.deg2rad(90.0)
    gimbal_turn: GimbalTurn | None = None
    chamber: "ChamberLimits | None" = None

    @property
    def gimbal(self) -> bool:
        """Whether the unit is on a gimbal instead of a table."""
        return self.geometry.gimbal is not None


@dataclass(frozen=True)
class UnitDecision:
    """The judgement of a unit, and whether to write its registers, which requires that the unit passed."""

    judgement: Judgement
    to_write: bool


@dataclass(frozen=True)
class RunEnd:
    """The end of a run for one unit: its final state, the solutions of its stages, and the error after a fault.

    `judgement` is None if the unit was not judged. `points` is the number of temperatures completed in a stage that was
    not solved.
    """

    state: State
    solutions: tuple[Solution, ...]
    error: CalstationError | None = None
    judgement: Judgement | None = None
    points: int = 0


Emit = Callable[[Event], None]


class Clock(Protocol):
    """A clock for station time, s, which is real time or the time of the virtual bench."""

    @property
    def tick(self) -> float:
        """Period at which the devices are polled, s."""

    @property
    def speed(self) -> float:
        """Multiple of real time; 0 if time advances only by `sleep`."""

    def now(self) -> float:
        """Return the station time, s."""

    def sleep(self, seconds: float) -> None:
        """Let `seconds` of station time pass."""

    def idle(self, seconds: float) -> None:
        """Let `seconds` of host time pass while the station computes."""

    def attach(self, received: Callable[[], Mapping[int, int]]) -> None:
        """Make `sleep` wait for the readers of the IMUs if the time is simulated.

        `received` returns the number of bytes that each reader has read, by the index of the IMU.
        """


class Solving(Protocol):
    """The chain of stage solvers."""

    def warm(self) -> None:
        """Prepare to solve, which may take seconds on a new computer, because the kernels are compiled first."""

    def start(self, stage: str) -> None:
        """Begin a stage, with the posterior of the previous stage as its prior."""

    def feed(self, block: SampleBlock) -> None:
        """Process samples of the stage."""

    def sigma(self) -> FloatArray:
        """Return the current standard deviations of the 30 parameters, shape (30,), SI."""

    def ranking(self) -> Ranking | None:
        """Return the observability at the last call of `sigma`, or None if the stage does not compute it."""

    def finish(self) -> Solution:
        """Solve the stage."""


class Evaluation(Protocol):
    """Decisions about a unit: whether it continues after a stage, passes, and has correct registers.

    All communication with the unit runs in `run_in_background` while the table is at rest, and is not interrupted by a
    stop request.
    """

    #: Whether the unit will fail, because no later stage changes a check that failed.
    will_fail: bool

    def verify_earlier(self) -> Callable[[VerificationData, RunInBackground], None] | None:
        """Return a function that verifies registers written before the run, or None if none have to be verified."""

    def continues(self, solution: Solution) -> bool:
        """Return whether to continue after a stage. Raises ConfigurationError."""

    def judge(self, solutions: tuple[Solution, ...]) -> UnitDecision:
        """Compare the results with the limits; called once after the last stage."""

    def read_registers(self, run_in_background: RunInBackground) -> None:
        """Read and log the registers that will be replaced. Raises DeviceFaultError."""

    def transfer(self, run_in_background: RunInBackground) -> None:
        """Write the registers. Raises DeviceFaultError, or StopRequested before the first write or after the last."""

    def verify(self, data: VerificationData, run_in_background: RunInBackground) -> None:
        """Verify the written registers with the restarted unit's output. Raises DeviceFaultError if they are wrong."""

    def ended(self, ended: RunEnd) -> None:
        """Write the result; called once in any thread, when the unit leaves a batch or the run ends."""


@dataclass(frozen=True)
class Slot:
    """A mounting position on the table, its unit, and all objects that belong to the unit.

    `log`, `solving` and `evaluation` are None in a register operation. `after` is the last sample of the run that is
    resumed, and `solved` contains the solutions of its stages. `name` is "" for the only unit of a run.
    """

    imu: Imu
    unit: UnitTask
    log: "RawLogWriter | None" = None
    solving: Solving | None = None
    after: LastSample | None = None
    name: str = ""
    evaluation: Evaluation | None = None
    solved: tuple[Solution, ...] = ()

    def add_samples(self, block: SampleBlock) -> None:
        """Log samples; those of a stage are also passed to the solver."""
        if self.log is not None:
            self.log.append(block)
        if block.stage and self.solving is not None:
            self.solving.feed(block)


@dataclass(frozen=True)
class RunContext:
    """The objects that the parts of a run share.

    `inactive` contains the names of the slots whose units have left the run; nothing more is written to their logs.
    `log_errors` contains, by the name of the slot, an error that occurred when the log was written, until the unit
    leaves the batch.
    """

    task: Task
    table: Table
    slots: tuple[Slot, ...]
    clock: Clock
    listener: Emit
    control: Control = field(default_factory=Control)
    inactive: set[str] = field(default_factory=set)
    log_errors: dict[str, CalstationError] = field(default_factory=dict)
    chamber: Chamber | None = None  #: The chamber around table and units, if the run changes its temperature.

    @property
    def slot(self) -> Slot:
        """The first slot, which is the only slot on a manual rig, on a gimbal and in a register operation."""
        return self.slots[0]

    def emit(self, event: Event) -> None:
        """Pass an event to the listener and, unless it only refreshes a display, to the logs of the units concerned.

        Raises ConfigurationError if the log of the last unit cannot be written; the listener receives the event first.
        """
        failure: CalstationError | None = None
        if not isinstance(event, LOSSY):
            entry = {**times(self.clock.now()), **to_json(event)}
            active = [slot for slot in self.slots if slot.name not in self.inactive]
            for slot in active:
                if slot.log is not None and event.slot in ("", slot.name):
                    try:
                        slot.log.event(entry)
                    except CalstationError as error:
                        if len(active) == 1:
                            failure = error
                        else:
                            self.log_errors[slot.name] = error
        self.listener(event)
        if failure is not None:
            raise failure
