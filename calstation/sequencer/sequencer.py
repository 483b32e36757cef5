"""The sequence of a run from preparation to verdict, which always ends with the table at rest and its axes off."""

import logging
from collections.abc import Callable, Iterable
from concurrent.futures import Future
from dataclasses import replace
from typing import TYPE_CHECKING, TypeVar, cast

from calstation.errors import CalstationError
from calstation.estimation import Solution
from calstation.physics import Dwell, FloatArray, ManualMove, Move, Ramp, RoundEnd, Soak
from calstation.records import END_BY_OPERATOR, END_FAILING
from calstation.sequencer.context import Evaluation, Output, RunContext, Solving
from calstation.sequencer.control import State, StopRequested
from calstation.sequencer.driving import POLL, RunDriver
from calstation.sequencer.events import Message, PointCompleted, StageEnded, StageRanked, StageStarted, solution_events
from calstation.sequencer.guard import check_limits, check_travel
from calstation.sequencer.plan import StagePlan, StageTracker, plan_time, planned, step_time
from calstation.sequencer.soaking import verification_temperature
from calstation.sequencer.units import Unit

if TYPE_CHECKING:
    from calstation.records import RawLogWriter

_Result = TypeVar("_Result")

logger = logging.getLogger(__name__)


class Sequencer:
    """Executes one run, and reports its end to the `Evaluation` of each unit."""

    def __init__(self, context: RunContext) -> None:
        if any(None in (slot.log, slot.solving, slot.evaluation) for slot in context.slots):
            raise ValueError("a run needs a log, a solver chain and an evaluation for every unit")
        self._context = context
        self._solved_before = len(context.slot.solved)
        self._track: StageTracker | None = None
        self._drive = RunDriver(context, self._show_progress)
        self._units = self._drive.units

    def run(self) -> None:
        """Prepare, run every stage, judge the units, and write the registers; see `RunDriver.run` for errors."""
        try:
            error = self._drive.run(self._calibrate)
        finally:
            self._units.wait_for_results()
        self._units.close(self._drive.state, error)

    def _calibrate(self) -> State:
        """Execute the run from the preparation to the load position, where the axes are switched off."""
        drive = self._drive
        drive.go(State.PREPARING)
        with self._units.jobs(lambda unit: _solving(unit).warm()) as warm:
            drive.begin()
            self._check_plans()
            drive.preflight()
            if not all(job.done() for job in warm.values()):
                self._context.emit(Message("preparing_solver"))
            self._units.each(lambda unit: self._wait_for(warm[unit]))
        drive.go(State.RUNNING)
        self._verify_earlier()
        for index, stage in enumerate(self._context.task.stages, start=self._solved_before):
            if not self._run_stage(stage, index):
                break
        drive.control_loop.check_cancelled()
        self._finalize()
        if not self._context.task.by_hand:
            drive.finish()
        return State.DONE

    def _verify_earlier(self) -> None:
        """Verify registers that were written before the run."""
        drive, background = self._drive, self._drive.run_in_background
        earlier = {unit: verify for unit in self._units if (verify := _evaluation(unit).verify_earlier()) is not None}
        if not earlier:
            return
        for unit in earlier:
            unit.emit(Message("verifying"))
        drive.reference([unit for unit in earlier if unit.slot.unit.corrected is Output.ON_COMMAND], earlier)
        data = drive.verification_data(earlier, restarted=False)
        self._units.each(lambda unit: earlier[unit](data[unit], background), data)

    def _finalize(self) -> None:
        """Judge every unit, and write and verify the registers of the units that passed."""
        drive, units, background = self._drive, self._units, self._drive.run_in_background
        writing: list[Unit] = []

        def judge(unit: Unit) -> None:
            judged = _evaluation(unit).judge(tuple(unit.solutions))
            unit.judgement = judged.judgement
            if judged.to_write:
                _evaluation(unit).read_registers(background)
                writing.append(unit)

        def transfer(unit: Unit) -> None:
            if units.in_batch:  # the table was not polled while the previous units were read or written
                drive.control_loop.check_table()
            _evaluation(unit).transfer(background)
            unit.unverified = True

        def verify(unit: Unit) -> None:
            unit.unverified = False
            _evaluation(unit).verify(data[unit], background)

        self._compute_for_each(judge)
        if units.in_batch:
            self._complete(unit for unit in units if unit not in writing)
        if not units.of(writing):
            return
        self._soak_for_verification()
        self._context.emit(Message("reference"))
        drive.reference(units.of(writing), units.of(writing))
        try:
            units.each(transfer, writing)
            written = units.of(writing)
            if written:
                self._context.emit(Message("verifying"))
                data = drive.verification_data(written)
                units.each(verify, data)
                if units.in_batch:
                    self._complete(units.of(data))
        except (StopRequested, CalstationError):
            for unit in units:
                if unit.unverified:
                    unit.emit(Message("transfer_unproved"))
            raise

    def _soak_for_verification(self) -> None:
        """Soak at a temperature that differs from the last one of the stage, for the verification of the registers."""
        limits = self._context.task.chamber
        if limits is None:  # the plans of other stages may be endless
            return
        soaks = [step for stage in self._context.task.stages for step in stage.steps() if isinstance(step, Soak)]
        if not soaks:
            return
        temperature = verification_temperature([soak.temperature for soak in soaks], limits.ambient)
        self._context.control.ending_stage = False
        self._drive.runner.begin_stage()
        self._drive.runner.run(replace(soaks[-1], temperature=temperature, index=0))

    def _complete(self, units: Iterable[Unit]) -> None:
        """Remove complete units, so that later faults do not change their results."""
        for unit in units:
            self._units.remove(unit, State.DONE)

    def _check_plans(self) -> None:
        """Check every move of every plan against the limits before anything moves."""
        position, chamber = self._drive.runner.position(), self._context.task.chamber
        for stage in self._context.task.stages:
            for step, _ in planned(stage.steps(), stage.rule, position):
                if isinstance(step, Move):
                    check_limits(self._context.task.geometry.limits, step)
                    check_travel(self._drive.control_loop.status.limits, step)
                elif isinstance(step, Soak | Ramp) and chamber is not None:
                    chamber.check(step.temperature, step.rate / 60.0 if isinstance(step, Ramp) else None)

    def _run_stage(self, stage: StagePlan, index: int) -> bool:
        """Execute and solve a stage, and return whether the run should continue."""
        drive, emit = self._drive, self._context.emit
        duration = plan_time(stage.steps(), stage.rule, drive.runner.position(), self._context.task.settle)
        count = self._solved_before + len(self._context.task.stages)
        self._context.control.check_cancelled()  # discard an END_STAGE command that refers to the previous stage
        self._context.control.ending_stage = False
        emit(StageStarted(stage.name, index, count, duration, stage.rule.repeated))
        logger.info("stage %s begins", stage.name)
        if not stage.completed:
            self._compute_for_each(lambda unit: _solving(unit).start(stage.name))
        for unit in self._units:
            unit.points = stage.completed
        drive.tags.stage = stage.name
        drive.runner.begin_stage()
        try:
            reason, rounds = self._execute(stage, duration)
        finally:
            drive.tags.stage = ""
        drive.runner.gimbal.restore()
        self._track = None
        emit(StageEnded(stage.name, reason, rounds))
        if reason == END_FAILING:
            return False
        with self._units.jobs(lambda unit: _solving(unit).finish()) as jobs:
            self._units.each(lambda unit: self._solved(unit, jobs[unit]))
        finished: list[Unit] = []

        def decide(unit: Unit) -> None:
            if not _evaluation(unit).continues(unit.solutions[-1]):
                finished.append(unit)

        self._compute_for_each(decide)
        if len(finished) == len(self._units):
            return False
        for unit in finished:
            with self._units.attributing_errors_to(unit):
                unit.judgement = _evaluation(unit).judge(tuple(unit.solutions)).judgement
                self._units.remove(unit, State.DONE)
        return True

    def _solved(self, unit: Unit, job: Future[Solution]) -> None:
        """Wait for the solution of a unit's stage, and log it."""
        solution = self._wait_for(job)
        logger.info("stage %s of %s solved", solution.stage, unit.slot.unit.serial)
        unit.solutions.append(solution)
        unit.points = 0
        for event in solution_events(solution):
            unit.emit(event)
        self._sync(unit)

    def _complete_point(self, event: PointCompleted) -> None:
        """Log that a temperature is complete and need not be repeated."""
        self._context.emit(event)
        for unit in self._units:
            unit.points = event.index
        self._units.each(self._sync)

    def _sync(self, unit: Unit) -> None:
        """Write the log of a unit to disk, so that its content need not be repeated after an interruption."""
        log = cast("RawLogWriter", unit.slot.log)
        self._wait_for(log.begin_sync())
        log.service()

    def _execute(self, stage: StagePlan, duration: float) -> tuple[str, int]:
        """Execute the steps of a stage, and return the reason for its end and the number of rounds."""
        drive, clock, units = self._drive, self._context.clock, self._units
        begin = {unit: unit.acquisition.newest_time or 0.0 for unit in units}
        rounds, soak = stage.completed, None
        steps = planned(stage.steps(), stage.rule, drive.runner.position(), self._context.task.settle)
        longest = sum(seconds for _, seconds in steps)
        track = self._track = StageTracker(stage.name, duration, longest)
        self._show_progress()
        for step in stage.steps():
            if isinstance(step, RoundEnd):
                rounds = step.rounds
                if soak is not None:
                    self._complete_point(PointCompleted(stage.name, rounds, soak.temperature, drive.tags.step))
                elapsed = min((unit.acquisition.newest_time or 0.0) - begin[unit] for unit in units)
                sigmas = self._sigmas() if stage.rule.targets else {}
                reasons = [stage.rule.reason(rounds, elapsed, sigmas.get(unit.slot.name)) for unit in units]
                if reasons[0] and all(reasons):
                    return reasons[0], rounds
                track.next_round()
                if stage.rule.open_ended:
                    track = self._track = StageTracker(stage.name, duration)
                self._show_progress()
            else:
                track.begin(clock.now(), step_time(step, drive.runner.position(), self._context.task.settle))
                drive.runner.run(step)
                soak = step if isinstance(step, Soak) else soak
                if self._context.control.ending_failing and all(_evaluation(unit).will_fail for unit in units):
                    return END_FAILING, rounds
                track.end(self._sigmas())
                self._show_progress()
                for unit in units:
                    if (ranking := _solving(unit).ranking()) is not None:
                        unit.emit(StageRanked(stage.name, ranking.step, ranking.rank, ranking.strength))
                ending = stage.rule.repeated and isinstance(step, Dwell | Soak) and self._context.control.ending_stage
                if ending or (isinstance(step, ManualMove) and drive.runner.guiding.done):
                    return END_BY_OPERATOR, rounds
        return "plan", rounds

    def _sigmas(self) -> dict[str, FloatArray]:
        """Return the current standard deviations by slot."""
        sigmas: dict[str, FloatArray] = {}

        def compute(unit: Unit) -> None:
            sigmas[unit.slot.name] = _solving(unit).sigma()

        self._compute_for_each(compute)
        return sigmas

    def _compute_for_each(self, work: Callable[[Unit], object]) -> None:
        """Run time-consuming `work` for every unit, and feed the watchdog of the table after each unit.

        Raises StopRequested between units.
        """

        def compute(unit: Unit) -> None:
            self._context.control.check_cancelled()
            work(unit)
            self._drive.control_loop.feed_watchdog()

        self._units.each(compute)

    def _show_progress(self) -> None:
        if self._track is not None:
            now, remaining = self._context.clock.now(), self._drive.runner.soaking.remaining
            if remaining is not None:
                self._track.revise(now, remaining)
            for unit in self._units:
                unit.emit(self._track.event(now, unit.slot.name))

    def _wait_for(self, job: Future[_Result]) -> _Result:
        """Feed the watchdog and read samples until a job is done; return its result. Raises StopRequested."""
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


def _solving(unit: Unit) -> Solving:
    return cast(Solving, unit.slot.solving)


def _evaluation(unit: Unit) -> Evaluation:
    return cast(Evaluation, unit.slot.evaluation)
