"""Runs a calibration from preparation to verdict; every way out leaves the table at rest, axes off."""

from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any, TypeVar

from calstation.devices.interfaces import Imu, Table
from calstation.errors import CalstationError, DeviceFaultError
from calstation.estimation.method import Solution
from calstation.estimation.samples import SampleBlock
from calstation.physics.motion import Carry, Finish, Move, Prepare, RoundEnd
from calstation.sequencer import states
from calstation.sequencer.acquisition import Acquisition, LastSample, to_si
from calstation.sequencer.carried_data import carried_data
from calstation.sequencer.control import Control, StopRequested
from calstation.sequencer.events import (
    LOSSY,
    Event,
    Fault,
    Message,
    StageEnded,
    StageStarted,
    StateChanged,
    to_json,
)
from calstation.sequencer.fresh_data import FreshData, fresh_data
from calstation.sequencer.guard import check_limits, check_travel
from calstation.sequencer.guiding import Guiding
from calstation.sequencer.ports import Clock, Emit, Journal, Solving
from calstation.sequencer.preflight import Preflight
from calstation.sequencer.preview import plan_time, planned, step_time
from calstation.sequencer.progress import StageTrack
from calstation.sequencer.pulse import Pulse
from calstation.sequencer.safe_stop import safe_stop
from calstation.sequencer.solved import told
from calstation.sequencer.states import State
from calstation.sequencer.steps import StepRunner
from calstation.sequencer.task import Concluded, Ended, StagePlan, Task

_LOOK = 0.05
"""Host time between looks while something else is done, s."""

_Result = TypeVar("_Result")

Aside = Callable[[Callable[[], Any]], Any]
"""Does a work in a thread of its own, to its end, and returns what it returns or raises."""


class Sequencer:
    """One run. `run` returns when it is over; `control` takes the operator's commands from any thread.

    `verify(solution)` says after each stage whether to go on. `conclude(solutions, aside)`, called with the table at
    rest, checks the limits, writes the registers and says whether the unit passed; where registers were written
    `prove(data, aside)` then judges the restarted unit's fresh data. Both do what talks to the unit by `aside`, during
    which a stop waits.

    A resumed run begins with what was `solved` before and carries on behind the last sample, `after`.
    """

    def __init__(
        self,
        task: Task,
        table: Table,
        imu: Imu,
        clock: Clock,
        journal: Journal,
        solving: Solving,
        emit: Emit,
        *,
        verify: Callable[[Solution], bool],
        conclude: Callable[[tuple[Solution, ...], Aside], Concluded],
        prove: Callable[[FreshData, Aside], None],
        control: Control | None = None,
        solved: tuple[Solution, ...] = (),
        after: LastSample | None = None,
    ) -> None:
        self.control = control or Control()
        self.state = State.IDLE
        self._task = task
        self._table = table
        self._clock = clock
        self._journal = journal
        self._solving = solving
        self._listener = emit
        self._verify = verify
        self._conclude = conclude
        self._prove = prove
        self._imu = imu
        self._solved_before = len(solved)
        self._solutions: list[Solution] = list(solved)
        self._track: StageTrack | None = None
        self._acquisition = Acquisition(
            imu,
            task.imu,
            clock,
            self._take,
            latency=task.latency,
            masks=task.masks,
            span=task.span,
            after=after,
        )

    @property
    def gaps(self) -> int:
        """Interruptions of the sample counter met in the run."""
        return self._acquisition.gaps

    def run(self) -> Ended:
        """Prepare, run every stage, conclude. Every way out leaves the table at rest, axes off.

        Errors of devices, configuration and input end in the state fault and are returned; a mistake of
        the program stops the table as well and is raised.
        """
        try:
            with self.control.ticking():
                passed = self._calibrate()
        except StopRequested:
            try:
                self._go(State.STOPPING)
                if self.control.stop_reason != "operator":
                    self.emit(Message("stopped_because", {"reason": self.control.stop_reason}))
            finally:
                self._stop_safely()
            self._go(State.STOPPED)
            return Ended(self.state, tuple(self._solutions))
        except CalstationError as error:
            self._stop_safely()
            self._go(State.FAULT)
            self.emit(Fault(type(error).__name__, str(error), error.exit_code))
            return Ended(self.state, tuple(self._solutions), error)
        except BaseException:
            self._stop_safely()
            raise
        self._go(State.PASSED if passed else State.FAILED)
        return Ended(self.state, tuple(self._solutions))

    def _calibrate(self) -> bool:
        """Everything from preparation to the load angle, axes off; whether the unit passed."""
        self._go(State.PREPARING)
        with _worker("warm-up") as worker:
            warm = worker.submit(self._solving.warm)
            self._prepare()
            self._wait_for(warm)
        self._go(State.RUNNING)
        for index, stage in enumerate(self._task.stages, start=self._solved_before):
            if not self._run_stage(stage, index):
                break
        self._pulse.hear()
        concluded = self._conclude(tuple(self._solutions), self._aside)
        if concluded.written:
            self.emit(Message("verifying"))
            try:
                data = self._fresh_data()
            except (StopRequested, CalstationError):
                self.emit(Message("transfer_unproved"))
                raise
            self._prove(data, self._aside)
        if not self._task.by_hand:
            self._finish()
        return concluded.passed

    def _fresh_data(self) -> FreshData:
        """Output of the restarted unit, to be judged."""
        self._aside(self._imu.start)
        take = carried_data if self._task.by_hand else fresh_data
        scale = to_si(self._task.imu)
        return take(self._pulse, self._acquisition, self._runner, self._task.geometry, scale)

    def emit(self, event: Event) -> None:
        """Tell the listener, and the journal unless the event only refreshes a display."""
        if not isinstance(event, LOSSY):
            self._journal.event({"station_time": self._clock.now(), **to_json(event)})
        self._listener(event)

    def _go(self, state: State) -> None:
        previous, self.state = self.state, states.step(self.state, state)
        self.emit(StateChanged(self.state, previous))

    def _take(self, block: SampleBlock) -> None:
        self._journal.append(block)
        if block.stage:
            self._solving.feed(block)

    def _check_plans(self) -> None:
        """Every move of every plan against the limits, before anything moves."""
        position = self._runner.position()
        for stage in self._task.stages:
            for step, _ in planned(stage.steps(), stage.rule, position):
                if isinstance(step, Move):
                    check_limits(self._task.geometry.limits, step)
                    check_travel(self._pulse.status.limits, step)

    def _prepare(self) -> None:
        task = self._task
        self._pulse = Pulse(
            self._table,
            self._imu,
            self._acquisition,
            self._clock,
            self.control,
            self.emit,
            self._journal.service,
            self._show_progress,
        )
        self._guiding = Guiding(task.imu, self._pulse, self._acquisition, self.control, self.emit)
        self._runner = StepRunner(
            self._table,
            self._pulse,
            self._acquisition,
            self.control,
            self.emit,
            task.geometry.limits,
            self._go,
            self._guiding,
        )
        self._check_plans()
        Preflight(
            self._table,
            self._imu,
            self._pulse,
            self._acquisition,
            self._runner,
            self._clock,
            task.geometry,
            to_si(task.imu),
            task.preflight,
            self.emit,
        ).run()

    def _run_stage(self, stage: StagePlan, index: int) -> bool:
        """Drive and solve a stage; False where the run should not go on."""
        position = self._runner.position()
        duration = plan_time(stage.steps(), stage.rule, position, self._task.settle)
        count = self._solved_before + len(self._task.stages)
        self.emit(StageStarted(stage.name, index, count, duration))
        self._solving.start(stage.name)
        self.control.enough = False
        self._acquisition.stage = stage.name
        self._runner.begin_stage()
        try:
            reason, rounds = self._drive(stage, duration)
        finally:
            self._acquisition.stage = ""
        self._track = None
        self.emit(StageEnded(stage.name, reason, rounds))
        solution = self._solve()
        self._solutions.append(solution)
        for event in told(solution):
            self.emit(event)
        self._journal.sync()  # a stage that is solved need not be done again, whatever happens next
        return self._verify(solution)

    def _drive(self, stage: StagePlan, duration: float) -> tuple[str, int]:
        begin = self._acquisition.newest or 0.0
        rounds = 0
        self._track = StageTrack(stage.name, duration)
        self._show_progress()
        for step in stage.steps():
            if isinstance(step, RoundEnd):
                rounds = step.rounds
                elapsed = (self._acquisition.newest or 0.0) - begin
                sigma = self._solving.sigma() if stage.rule.targets else None
                reason = stage.rule.reason(rounds, elapsed, sigma, self.control.enough)
                if reason:
                    return reason, rounds
            elif isinstance(step, Finish):
                break
            elif not isinstance(step, Prepare):
                track = self._track
                seconds = step_time(step, self._runner.position(), self._task.settle)
                track.begin(self._clock.now(), seconds)
                self._runner.run(step)
                track.end(self._solving.sigma())
                self._show_progress()
                if isinstance(step, Carry) and self._guiding.done:
                    return "operator", rounds
        return "plan", rounds

    def _show_progress(self) -> None:
        if self._track is not None:
            self.emit(self._track.event(self._clock.now()))

    def _solve(self) -> Solution:
        """Solve in a worker, the table's watchdog fed and samples drained meanwhile."""
        with _worker("solver") as worker:
            return self._wait_for(worker.submit(self._solving.finish))

    def _wait_for(self, job: Future[_Result]) -> _Result:
        """What a worker's job returns; a stop does not wait for it."""
        while not job.done():
            before = self._clock.now()
            self._clock.idle(_LOOK)
            if self._clock.now() > before:
                self._pulse.look()
            else:
                self._pulse.keep_alive()
                self._pulse.hear()
        return job.result()

    def _aside(self, work: Callable[[], Any]) -> Any:
        """Do what must not be interrupted, the table's watchdog fed meanwhile; whatever happens, it is done then."""
        with ThreadPoolExecutor(1, "aside") as worker:
            job = worker.submit(work)
            while not job.done():
                self._clock.idle(_LOOK)
                self._pulse.keep_alive()
                self.control.take()
            return job.result()

    def _finish(self) -> None:
        """To the load angle, axes off."""
        self.emit(Message("finishing"))
        outer, inner = self._task.load_angle
        limits = self._task.geometry.limits
        rate = min(self._task.travel_rate, *limits.rate)
        acceleration = min(self._task.travel_acceleration, *limits.acceleration)
        if not self._runner.arrived((outer, inner)):
            self._runner.drive(Move(outer, inner, rate, acceleration, ("load",)))
        self._pulse.powered = False
        self._table.disable()

    def _stop_safely(self) -> None:
        self._acquisition.stage, self._acquisition.valid = "", False
        for failure in safe_stop(self._table, self._clock):
            self.emit(Message("safe_stop_incomplete", {"text": failure}))
        try:
            self._acquisition.drain()
        except DeviceFaultError as error:
            self.emit(Message("safe_stop_incomplete", {"text": str(error)}))


@contextmanager
def _worker(name: str) -> Iterator[ThreadPoolExecutor]:
    """A worker for one job, left to end by itself where the run does not wait for it."""
    worker = ThreadPoolExecutor(1, name)
    try:
        yield worker
    finally:
        worker.shutdown(wait=False)
