"""Runs a calibration from preparation to verdict; every exit path leaves the table at rest with its axes off."""

import logging
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from typing import Protocol, TypeVar

from calstation.errors import CalstationError
from calstation.estimation import Solution
from calstation.physics import Carry, Dwell, Finish, Move, Prepare, RoundEnd
from calstation.sequencer.capture import VerificationData
from calstation.sequencer.context import Ended, Finalized, Output, RunContext
from calstation.sequencer.control import State, StopRequested
from calstation.sequencer.driving import POLL, Driving, RunInBackground
from calstation.sequencer.events import Message, StageEnded, StageRanked, StageStarted, solution_events
from calstation.sequencer.guard import check_limits, check_travel
from calstation.sequencer.plan import StagePlan, StageTrack, plan_time, planned, step_time

_Result = TypeVar("_Result")

#: Type of a function that captures the unit's output before registers are written, as a reference for verification.
CaptureReference = Callable[[], None]

logger = logging.getLogger(__name__)


class Evaluation(Protocol):
    """Decides whether a run continues after a stage, whether the unit passed and whether its registers are correct.

    All communication with the unit runs in `run_in_background`, which a stop request does not interrupt.
    """

    def verify_earlier(self) -> Callable[[VerificationData, RunInBackground], None] | None:
        """Return a function that verifies registers written before the run, or None if there are none to verify."""

    def stage_passed(self, solution: Solution) -> bool:
        """Whether to continue after a stage. Raises ConfigurationError."""

    def finalize(
        self, solutions: tuple[Solution, ...], run_in_background: RunInBackground, capture_reference: CaptureReference
    ) -> Finalized:
        """Check the results against the limits and, if they pass, write the registers. The table is at rest."""

    def verify(self, data: VerificationData, run_in_background: RunInBackground) -> None:
        """Verify the written registers with the restarted unit's output. Raises DeviceFaultError if they are wrong."""


class Sequencer:
    """Executes one run; `run` blocks until it ends. `solved` contains the stages solved before the run was resumed."""

    def __init__(self, context: RunContext, evaluation: Evaluation, solved: tuple[Solution, ...] = ()) -> None:
        journal, solving = context.slot.journal, context.slot.solving
        if journal is None or solving is None:
            raise ValueError("a run needs a log and a solver chain")
        self._journal, self._solving = journal, solving
        self._context = context
        self._evaluation = evaluation
        self._solved_before = len(solved)
        self._solutions: list[Solution] = list(solved)
        self._track: StageTrack | None = None
        self._drive = Driving(context, self._show_progress)

    def run(self) -> Ended:
        """Prepare, run every stage and finalize; see `Driving.run` for errors."""
        error = self._drive.run(self._calibrate)
        return Ended(self._drive.state, tuple(self._solutions), error)

    def _calibrate(self) -> State:
        """Do everything from preparation to the load position with the axes off; return PASSED or FAILED."""
        drive, emit = self._drive, self._context.emit
        drive.go(State.PREPARING)
        with _worker("warm-up") as worker:
            warm = worker.submit(self._solving.warm)
            drive.begin()
            self._check_plans()
            drive.preflight()
            self._wait_for(warm)
        drive.go(State.RUNNING)
        verify_earlier = self._evaluation.verify_earlier()
        if verify_earlier is not None:
            emit(Message("verifying"))
            if self._context.slot.unit.corrected is Output.ASKED:
                drive.reference()
            verify_earlier(drive.verification_data(restarted=False), drive.run_in_background)
        for index, stage in enumerate(self._context.task.stages, start=self._solved_before):
            if not self._run_stage(stage, index):
                break
        drive.control_loop.check_cancelled()
        finalized = self._evaluation.finalize(tuple(self._solutions), drive.run_in_background, drive.reference)
        if finalized.written:
            emit(Message("verifying"))
            try:
                data = drive.verification_data()
            except (StopRequested, CalstationError):
                emit(Message("transfer_unproved"))
                raise
            self._evaluation.verify(data, drive.run_in_background)
        if not self._context.task.by_hand:
            drive.finish()
        return State.PASSED if finalized.passed else State.FAILED

    def _check_plans(self) -> None:
        """Check every move of every plan against the limits before anything moves."""
        position = self._drive.runner.position()
        for stage in self._context.task.stages:
            for step, _ in planned(stage.steps(), stage.rule, position):
                if isinstance(step, Move):
                    check_limits(self._context.task.geometry.limits, step)
                    check_travel(self._drive.control_loop.status.limits, step)

    def _run_stage(self, stage: StagePlan, index: int) -> bool:
        """Execute and solve a stage; return False if the run should not continue."""
        drive, emit = self._drive, self._context.emit
        duration = plan_time(stage.steps(), stage.rule, drive.runner.position(), self._context.task.settle)
        count = self._solved_before + len(self._context.task.stages)
        emit(StageStarted(stage.name, index, count, duration, stage.rule.repeated))
        logger.info("stage %s begins", stage.name)
        self._solving.start(stage.name)
        self._context.control.check_cancelled()  # a late END_STAGE of the stage before ends nothing
        self._context.control.ending_stage = False
        drive.acquisition.stage = stage.name
        drive.runner.begin_stage()
        try:
            reason, rounds = self._execute(stage, duration)
        finally:
            drive.acquisition.stage = ""
        drive.runner.gimbal.restore()
        self._track = None
        emit(StageEnded(stage.name, reason, rounds))
        with _worker("solver") as worker:
            solution = self._wait_for(worker.submit(self._solving.finish))
        logger.info("stage %s solved", stage.name)
        self._solutions.append(solution)
        for event in solution_events(solution):
            emit(event)
        # Once the log is on disk, a solved stage never has to be repeated.
        self._wait_for(self._journal.begin_sync())
        self._journal.service()
        return self._evaluation.stage_passed(solution)

    def _execute(self, stage: StagePlan, duration: float) -> tuple[str, int]:
        """Execute the steps of a stage; return the reason for its end and the number of rounds."""
        drive, clock = self._drive, self._context.clock
        begin = drive.acquisition.newest or 0.0
        rounds = 0
        track = self._track = StageTrack(stage.name, duration)
        self._show_progress()
        for step in stage.steps():
            if isinstance(step, RoundEnd):
                rounds = step.rounds
                elapsed = (drive.acquisition.newest or 0.0) - begin
                sigma = self._solving.sigma() if stage.rule.targets else None
                reason = stage.rule.reason(rounds, elapsed, sigma)
                if reason:
                    return reason, rounds
                if stage.rule.open_ended:
                    track = self._track = StageTrack(stage.name, duration)
            elif isinstance(step, Finish):
                break
            elif not isinstance(step, Prepare):
                track.begin(clock.now(), step_time(step, drive.runner.position(), self._context.task.settle))
                drive.runner.run(step)
                track.end(self._solving.sigma())
                self._show_progress()
                if (ranking := self._solving.ranking()) is not None:
                    self._context.emit(StageRanked(stage.name, ranking.step, ranking.rank, ranking.strength))
                ending = stage.rule.repeated and isinstance(step, Dwell) and self._context.control.ending_stage
                if ending or (isinstance(step, Carry) and drive.runner.guiding.done):
                    return "operator", rounds
        return "plan", rounds

    def _show_progress(self) -> None:
        if self._track is not None:
            self._context.emit(self._track.event(self._context.clock.now()))

    def _wait_for(self, job: Future[_Result]) -> _Result:
        """Return the result of a worker's job; until then feed the watchdog and drain samples. A stop ends the wait."""
        clock, control_loop = self._context.clock, self._drive.control_loop
        while not job.done():
            before = clock.now()
            clock.idle(POLL)
            if clock.now() > before:
                control_loop.update()
            else:
                control_loop.feed_watchdog()
                control_loop.check_cancelled()
        return job.result()


@contextmanager
def _worker(name: str) -> Iterator[ThreadPoolExecutor]:
    """Provide a worker for one job; leaving the context does not wait for the job to end."""
    worker = ThreadPoolExecutor(1, name)
    try:
        yield worker
    finally:
        worker.shutdown(wait=False)
