"""Runs a calibration from preparation to verdict; every way out leaves the table at rest, axes off."""

from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from typing import TypeVar

from calstation.devices.interfaces import Imu, Table
from calstation.errors import CalstationError
from calstation.estimation.common.samples import SampleBlock
from calstation.estimation.method import Solution
from calstation.physics.motion import Carry, Finish, Move, Prepare, RoundEnd
from calstation.sequencer.acquisition import LastSample
from calstation.sequencer.capture import VerificationData
from calstation.sequencer.control import Control, StopRequested
from calstation.sequencer.driving import LOOK, Driving, RunInBackground
from calstation.sequencer.events import LOSSY, Event, Message, StageEnded, StageStarted, to_json
from calstation.sequencer.guard import check_limits, check_travel
from calstation.sequencer.ports import Clock, Emit, Journal, Solving
from calstation.sequencer.preview import plan_time, planned, step_time
from calstation.sequencer.progress import StageTrack
from calstation.sequencer.solved import told
from calstation.sequencer.states import State
from calstation.sequencer.task import Ended, Finalized, Output, StagePlan, Task

_Result = TypeVar("_Result")

#: Takes the unit's output before registers are written, to compare what follows with.
Look = Callable[[], None]

#: Judges a unit's fresh data; raises DeviceFaultError where they are wrong.
Judge = Callable[[VerificationData, RunInBackground], None]


class Sequencer:
    """One run. `run` returns when it is over; `control` takes the operator's commands from any thread.

    `verify(solution)` says after each stage whether to go on. `conclude(solutions, aside, look)`, called with the table
    at rest, checks the limits, has a `look` at the unit as it is, writes the registers and says whether the unit
    passed; where registers were written `prove(data, aside)` then judges the restarted unit's fresh data. Both do what
    talks to the unit by `aside`, during which a stop waits. `prove_first` judges, before any stage, registers that were
    written before the run.

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
        finalize: Callable[[tuple[Solution, ...], RunInBackground, Look], Finalized],
        prove: Judge,
        prove_first: Judge | None = None,
        control: Control | None = None,
        solved: tuple[Solution, ...] = (),
        after: LastSample | None = None,
    ) -> None:
        self.control = control or Control()
        self._task = task
        self._clock = clock
        self._journal = journal
        self._solving = solving
        self._listener = emit
        self._verify = verify
        self._finalize = finalize
        self._prove = prove
        self._prove_first = prove_first
        self._solved_before = len(solved)
        self._solutions: list[Solution] = list(solved)
        self._track: StageTrack | None = None
        self._drive = Driving(
            task,
            table,
            imu,
            clock,
            self.control,
            self.emit,
            take=self._take,
            service=journal.service,
            on_show=self._show_progress,
            after=after,
        )

    @property
    def state(self) -> State:
        """Where the run stands."""
        return self._drive.state

    @property
    def gaps(self) -> int:
        """Interruptions of the sample counter met in the run."""
        return self._drive.acquisition.gaps

    def run(self) -> Ended:
        """Prepare, run every stage, conclude. Every way out leaves the table at rest, axes off.

        Errors of devices, configuration and input end in the state fault and are returned; a mistake of
        the program stops the table as well and is raised.
        """
        error = self._drive.run(self._calibrate)
        return Ended(self.state, tuple(self._solutions), error)

    def _calibrate(self) -> State:
        """Everything from preparation to the load angle, axes off; whether the unit passed."""
        drive = self._drive
        drive.go(State.PREPARING)
        with _worker("warm-up") as worker:
            warm = worker.submit(self._solving.warm)
            drive.begin()
            self._check_plans()
            drive.preflight()
            self._wait_for(warm)
        drive.go(State.RUNNING)
        if self._prove_first is not None:
            self.emit(Message("verifying"))
            if self._task.corrected is Output.ASKED:
                drive.reference()
            self._prove_first(drive.verification_data(restarted=False), drive.run_in_background)
        for index, stage in enumerate(self._task.stages, start=self._solved_before):
            if not self._run_stage(stage, index):
                break
        drive.control_loop.check_cancelled()
        finalized = self._finalize(tuple(self._solutions), drive.run_in_background, drive.reference)
        if finalized.written:
            self.emit(Message("verifying"))
            try:
                data = drive.verification_data()
            except (StopRequested, CalstationError):
                self.emit(Message("transfer_unproved"))
                raise
            self._prove(data, drive.run_in_background)
        if not self._task.by_hand:
            drive.finish()
        return State.PASSED if finalized.passed else State.FAILED

    def emit(self, event: Event) -> None:
        """Tell the listener, and the journal unless the event only refreshes a display."""
        if not isinstance(event, LOSSY):
            self._journal.event({"station_time": self._clock.now(), **to_json(event)})
        self._listener(event)

    def _take(self, block: SampleBlock) -> None:
        self._journal.append(block)
        if block.stage:
            self._solving.feed(block)

    def _check_plans(self) -> None:
        """Every move of every plan against the limits, before anything moves."""
        position = self._drive.runner.position()
        for stage in self._task.stages:
            for step, _ in planned(stage.steps(), stage.rule, position):
                if isinstance(step, Move):
                    check_limits(self._task.geometry.limits, step)
                    check_travel(self._drive.control_loop.status.limits, step)

    def _run_stage(self, stage: StagePlan, index: int) -> bool:
        """Drive and solve a stage; False where the run should not go on."""
        position = self._drive.runner.position()
        duration = plan_time(stage.steps(), stage.rule, position, self._task.settle)
        count = self._solved_before + len(self._task.stages)
        self.emit(StageStarted(stage.name, index, count, duration))
        self._solving.start(stage.name)
        self.control.enough = False
        self._drive.acquisition.stage = stage.name
        self._drive.runner.begin_stage()
        try:
            reason, rounds = self._execute(stage, duration)
        finally:
            self._drive.acquisition.stage = ""
        self._track = None
        self.emit(StageEnded(stage.name, reason, rounds))
        solution = self._solve()
        self._solutions.append(solution)
        for event in told(solution):
            self.emit(event)
        # A stage that is solved need not be done again, whatever happens next.
        self._wait_for(self._journal.begin_sync())
        self._journal.service()
        return self._verify(solution)

    def _execute(self, stage: StagePlan, duration: float) -> tuple[str, int]:
        begin = self._drive.acquisition.newest or 0.0
        rounds = 0
        self._track = StageTrack(stage.name, duration)
        self._show_progress()
        for step in stage.steps():
            if isinstance(step, RoundEnd):
                rounds = step.rounds
                elapsed = (self._drive.acquisition.newest or 0.0) - begin
                sigma = self._solving.sigma() if stage.rule.targets else None
                reason = stage.rule.reason(rounds, elapsed, sigma, self.control.enough)
                if reason:
                    return reason, rounds
            elif isinstance(step, Finish):
                break
            elif not isinstance(step, Prepare):
                track = self._track
                seconds = step_time(step, self._drive.runner.position(), self._task.settle)
                track.begin(self._clock.now(), seconds)
                self._drive.runner.run(step)
                track.end(self._solving.sigma())
                self._show_progress()
                if isinstance(step, Carry) and self._drive.guiding.done:
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
            self._clock.idle(LOOK)
            if self._clock.now() > before:
                self._drive.control_loop.look()
            else:
                self._drive.control_loop.feed_watchdog()
                self._drive.control_loop.check_cancelled()
        return job.result()


@contextmanager
def _worker(name: str) -> Iterator[ThreadPoolExecutor]:
    """A worker for one job, left to end by itself where the run does not wait for it."""
    worker = ThreadPoolExecutor(1, name)
    try:
        yield worker
    finally:
        worker.shutdown(wait=False)
