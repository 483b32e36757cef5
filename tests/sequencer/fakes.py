"""Fake table, IMU and clock without protocols or noise, for tests of the sequencer."""

import math
from collections.abc import Iterator
from concurrent.futures import Future
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import numpy as np

from calstation.devices import ImuIdentity, LinkStats, NoFramesError, SampleBatch, TableIdentity, TableStatus
from calstation.devices.profiles import StatusSection
from calstation.errors import DeviceFaultError
from calstation.estimation import Ranking, Solution
from calstation.estimation.common import Consistency, ImuModel, Posterior, SampleBlock
from calstation.judgement import Judgement
from calstation.physics import (
    COUNT,
    Dwell,
    JointLimits,
    Move,
    RoundEnd,
    Step,
    TableGeometry,
    rotation_matrix,
    rotation_vector,
)
from calstation.sequencer import (
    Control,
    Event,
    LastSample,
    PreflightLimits,
    RunContext,
    RunEnd,
    Sequencer,
    Slot,
    StagePlan,
    State,
    StopRule,
    Task,
    UnitDecision,
    UnitTask,
)

GRAVITY = 9.8
RATE = 100.0
MODEL = ImuModel("SN-1", RATE, "rate", 1e-6, 1e-5, 1e-9, 1e-9)  # no noise, as the fake has none
LIMITS = JointLimits((-20.0, -20.0), (20.0, 20.0), (1.0, 1.0), (2.0, 2.0))
GEOMETRY = TableGeometry(limits=LIMITS)
UNIT = UnitTask("SN-1", MODEL, PreflightLimits(r"SN-\d+", GRAVITY), GEOMETRY)


class FakeClock:
    """A clock that advances only during sleep; `scripts` run at their times."""

    tick = 0.2

    def __init__(self) -> None:
        self.time = 0.0
        self.scripts: list[tuple[float, Any]] = []

    def now(self) -> float:
        return self.time

    def sleep(self, seconds: float) -> None:
        self.time += seconds
        for moment, action in list(self.scripts):
            if self.time >= moment:
                self.scripts.remove((moment, action))
                action()

    def idle(self, seconds: float) -> None:
        return

    def at(self, moment: float, action: Any) -> None:
        self.scripts.append((moment, action))


@dataclass
class FakeTable:
    """A table that moves both joints at constant rate and records its commands."""

    clock: FakeClock
    homed: bool = True
    watchdog: float = 1.0
    fault: str | None = None
    interlock: bool = True
    dead: bool = False
    stuck: bool = False
    enabled: bool = False
    commands: list[str] = field(default_factory=list)
    origin: tuple[float, float] = (0.0, 0.0)
    target: tuple[float, float] = (0.0, 0.0)
    rate: float = 1.0
    begun: float = 0.0
    beats: int = 0
    on_move: Any = None

    def angles_at(self, time: float) -> tuple[float, float]:
        """Return the joint angles at a station time, rad."""
        way = max(0.0, time - self.begun) * self.rate
        return tuple(  # type: ignore[return-value]
            a + math.copysign(min(way, abs(b - a)), b - a) for a, b in zip(self.origin, self.target, strict=True)
        )

    def _answer(self) -> None:
        if self.dead:
            raise DeviceFaultError("link.lost", device="table", port="FAKE", reason="no answer")

    def identify(self) -> TableIdentity:
        self._answer()
        return TableIdentity("fake table", "T1")

    def status(self) -> TableStatus:
        self._answer()
        angles = np.array(self.angles_at(self.clock.time))
        moving = not np.array_equal(angles, np.array(self.target))
        return TableStatus(
            angles,
            np.zeros(2),
            self.enabled,
            self.homed,
            moving,
            not moving,
            self.fault,
            self.interlock,
            self.watchdog,
            LIMITS,
        )

    def enable(self) -> None:
        self.commands.append("enable")
        self.enabled = True

    def disable(self) -> None:
        self._answer()
        self.commands.append("disable")
        self.enabled = False

    def home(self) -> None:
        self.commands.append("home")
        self.homed = True

    def move(self, outer: float, inner: float, rate: float, acceleration: float) -> None:
        self.commands.append(f"move {math.degrees(outer):.0f} {math.degrees(inner):.0f}")
        if self.on_move is not None:
            self.on_move()
        self.origin, self.begun = self.angles_at(self.clock.time), self.clock.time
        self.target, self.rate = (outer, inner), (1e-6 if self.stuck else rate)

    def stop(self) -> None:
        self._answer()
        self.commands.append("stop")
        self.origin = self.target = self.angles_at(self.clock.time)

    def reset_fault(self) -> None:
        self.fault = None

    def heartbeat(self) -> None:
        self._answer()
        self.beats += 1

    def close(self) -> None:
        return


@lru_cache(maxsize=1000)
def _motion(before: tuple[float, float], now: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Return the rotation vector of the body between joint angles, rad, and the final vertical in body axes."""
    first, last = GEOMETRY.body_to_home(*before), GEOMETRY.body_to_home(*now)
    return rotation_vector(first.T @ last), last.T @ np.array([0.0, 0.0, 1.0])


@dataclass
class FakeImu:
    """Noise-free samples of the fake table's motion at `RATE`; corrected gyro output is `gain` times the raw output.

    After a restart it sends raw output; if `mute`, it sends nothing, or `babble`, until it is commanded to stream.
    If `deaf`, it does not respond to commands.
    """

    clock: FakeClock
    table: FakeTable
    serial: str = "SN-1"
    sign: float = 1.0
    upside_down: bool = False
    twist: float = 0.0
    ready_at: float = 0.0
    silent: bool = False
    sent: int = 0
    drop: int = 0
    saturated: bool = False
    nan: bool = False
    gain: float = 1.0
    mute: bool = False
    babble: bool = False
    deaf: bool = False
    off: bool = False
    chamber: Any = None
    corrected: bool = False
    started: list[bool] = field(default_factory=list)
    stats: LinkStats = field(default_factory=LinkStats)

    def start(self, *, corrected: bool = False) -> None:
        self.started.append(corrected)
        self.corrected, self.off = corrected, False

    def restart(self) -> None:
        """Restart: some samples are missing, the counter restarts, and the unit is not ready for one second."""
        self.corrected, self.off = False, self.mute
        self.drop = 3
        self.ready_at = self.clock.time + 1.0
        self.stats = replace(self.stats, restarts=self.stats.restarts + 1)

    def wake(self, check_cancelled: Any, *, corrected: bool = False) -> ImuIdentity:
        check_cancelled()
        if self.deaf:
            raise DeviceFaultError("link.lost", device="imu", port="FAKE", reason="no answer")
        self.start(corrected=corrected)
        return self.identify()

    def read(self) -> SampleBatch:
        end = int(self.clock.time * RATE + 1e-6)
        if self.off and self.babble:
            raise NoFramesError("imu.no_frames", port="FAKE")
        if self.silent or self.off:
            self.sent = end
        seq = np.arange(self.sent, end) + 1
        self.sent = end
        if self.drop and len(seq) > self.drop:
            seq, self.drop = seq[self.drop :], 0
        status = np.where(seq / RATE >= self.ready_at, 1, 0) | (2 if self.saturated else 0)
        counts = self._all_counts(seq / RATE)
        if self.nan and len(counts):
            counts[0, 4], self.nan = math.nan, False
        self.saturated = False
        temperature = 25.0 if self.chamber is None else self.chamber.unit
        return SampleBatch(seq, seq / RATE, counts, np.full(len(seq), temperature), status, np.zeros(len(seq)))

    def _all_counts(self, times: np.ndarray) -> np.ndarray:
        """Return the counts at these times, shape (n, 6); they are constant at rest."""
        if len(times) and self._rests(times[0] - 1.0 / RATE, times[-1]):
            return np.tile(self._counts(times[0]), (len(times), 1))
        return np.array([self._counts(time) for time in times]).reshape(-1, 6)

    def _rests(self, begin: float, end: float) -> bool:
        """Return whether the unit is at rest from `begin` to `end`."""
        table = self.table
        first = table.angles_at(begin)
        return first == table.angles_at(end) and (first == table.target or table.begun >= end)

    def _counts(self, time: float) -> np.ndarray:
        turn, vertical = _motion(self.table.angles_at(time - 1.0 / RATE), self.table.angles_at(time))
        gyro = turn * RATE * self.sign * (self.gain if self.corrected else 1.0)
        force = vertical * (-GRAVITY if self.upside_down else GRAVITY)
        if self.twist:
            mount = rotation_matrix(np.array([0.0, 0.0, self.twist]))
            gyro, force = mount @ gyro, mount @ force
        return np.concatenate([gyro / MODEL.gyro_lsb, force / MODEL.accel_lsb])

    def identify(self) -> ImuIdentity:
        return ImuIdentity("fake imu", self.serial, "1")

    def read_registers(self) -> dict[str, float]:
        return {}

    def write_registers(self, values: Any) -> None:
        return

    def commit(self) -> None:
        return

    def reset(self) -> None:
        return

    def close(self) -> None:
        return


class FakeSolving:
    """A solver that accepts samples and returns sigmas that halve with every `sigma` call."""

    def __init__(self) -> None:
        self.blocks: dict[str, list[SampleBlock]] = {}
        self.stage = ""
        self.level = 1.0

    def warm(self) -> None:
        pass

    def start(self, stage: str) -> None:
        self.stage = stage
        self.blocks[stage] = []

    def feed(self, block: SampleBlock) -> None:
        self.blocks[self.stage].append(block)

    def sigma(self) -> np.ndarray:
        self.level *= 0.5
        return np.full(COUNT, self.level)

    def ranking(self) -> Ranking | None:
        return Ranking(len(self.blocks[self.stage]), 8, {"gyro_bias_x": 1.0 / self.level})

    def finish(self, progress: Any = None) -> Solution:
        posterior = Posterior(np.zeros(COUNT), np.eye(COUNT))
        return Solution(self.stage, posterior, ("gyro_bias_x",), Consistency(1.0, 0.9, 1.1, 10))


class FakeJournal:
    """A journal that keeps samples and events in memory."""

    def __init__(self) -> None:
        self.blocks: list[SampleBlock] = []
        self.events: list[Any] = []

    def append(self, block: SampleBlock) -> None:
        self.blocks.append(block)

    def event(self, event: Any) -> None:
        self.events.append(event)

    def service(self) -> None:
        return

    def begin_sync(self) -> Future[None]:
        done: Future[None] = Future()
        done.set_result(None)
        return done


def quarter_turns() -> Iterator[Step]:
    """Yield two moves of the outer axis, each followed by a rest."""
    for angle in (0.5 * math.pi, 0.0):
        yield Move(angle, 0.0, 0.5, 1.0, ("turn", "x"))
        yield Dwell(3.0)


def endless() -> Iterator[Step]:
    """Yield rests, one per round, for more rounds than a run executes; reading all of them is an error."""
    for rounds in range(1, 1000):
        yield Dwell(1.0)
        yield RoundEnd(rounds)
    raise AssertionError("an endless plan is read to its end")


class Scene:
    """A sequencer with fake devices."""

    def __init__(self, *stages: StagePlan, serial: str = "SN-1", by_hand: bool = False, **preflight: Any) -> None:
        self.clock = FakeClock()
        self.table = FakeTable(self.clock)
        self.imu = FakeImu(self.clock, self.table)
        self.journal = FakeJournal()
        self.solving = FakeSolving()
        self.control = Control()
        self.events: list[Event] = []
        self.passes = True
        self.writes = True
        self.finalized = 0
        self.ends: list[RunEnd] = []
        self.proved: list[Any] = []
        self.earlier: Any = None
        self.chamber: Any = None
        self.task = Task(stages or (StagePlan("rate", quarter_turns),), GEOMETRY, by_hand=by_hand)
        self.unit = UnitTask(
            serial,
            MODEL,
            PreflightLimits(r"SN-\d+", GRAVITY, **preflight),
            GEOMETRY,
            StatusSection(ready=1, saturated=2, failed=4),
        )

    def run(self, solved: tuple[Solution, ...] = (), after: LastSample | None = None) -> Any:
        """Run to the end and return how the run ended for the unit."""
        slot = Slot(self.imu, self.unit, self.journal, self.solving, after, evaluation=self, solved=solved)
        context = RunContext(
            self.task,
            self.table,
            (slot,),
            self.clock,
            lambda event: self.events.append(event),
            self.control,
            chamber=self.chamber,
        )
        Sequencer(context).run()
        (ended,) = self.ends
        return ended

    will_fail = False

    def verify_earlier(self) -> Any:
        """Verify nothing, because nothing was written before the run."""
        return self.earlier

    def continues(self, solution: Solution) -> bool:
        """Continue the run."""
        return True

    def judge(self, solutions: Any) -> UnitDecision:
        """Pass, and write as configured by the test."""
        self.finalized += 1
        self.solutions = solutions
        return judged(passes=self.passes, writes=self.writes)

    def read_registers(self, run_in_background: Any) -> None:
        """Return no registers."""

    def transfer(self, run_in_background: Any) -> None:
        """Write nothing."""

    def ended(self, ended: RunEnd) -> None:
        """Store how the run ended."""
        self.ends.append(ended)

    def verify(self, data: Any, run_in_background: Any) -> None:
        """Store the verification data."""
        self.proved.append(data)

    def events_of(self, kind: type) -> list[Any]:
        """Return the events of a type."""
        return [event for event in self.events if isinstance(event, kind)]


def judged(*, passes: bool, writes: bool) -> UnitDecision:
    """Return an evaluation's answer; registers are written only to a unit that passes."""
    return UnitDecision(Judgement((), passes, partial=False), passes and writes)


def verdict(ended: RunEnd) -> str:
    """Return ``passed`` or ``failed`` for a unit whose run was completed, otherwise the state in which it ended."""
    if ended.state is not State.DONE or ended.judgement is None:
        return str(ended.state)
    return "passed" if ended.judgement.passed else "failed"


def repeated(rule: StopRule) -> StagePlan:
    """Return a stage of unlimited rounds that ends by `rule`."""
    return StagePlan("excitation", endless, rule)
