"""Chain of stage solvers, whose results for the samples of a run and of its log are bit-identical."""

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from calstation.errors import ConfigurationError, InputError, InsufficientDataError
from calstation.estimation import Progress, Ranking, Solution, StageSolver
from calstation.estimation.common import (
    RestOutput,
    SampleBlock,
    StageBuffer,
    StageData,
    gravity_sensitivity,
    has_gyros,
    resolves_earth_rate,
    with_gravity,
)
from calstation.estimation.effects import known_effects, last_turns, plausible_changes, possible_signs
from calstation.estimation.navigation import warm_up
from calstation.estimation.positions import TableQuantity, TableRests, gather, table_axes, table_rests
from calstation.judgement import DataTests, ModelTests, TestedSamples
from calstation.messages import Text
from calstation.physics import COUNT, FloatArray, composition
from calstation.records import LogMeta, context_from_meta, prior_from_meta
from calstation.schema import validate
from procedures import method

#: Function that reads the samples of a log from the beginning.
Blocks = Callable[[], Iterable[SampleBlock]]

#: Callback with the stage, the latest sequence number read, and the solved fraction of the stage, 0 during reading.
SolveProgress = Callable[[str, int, float], None]


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Limit linear algebra to one thread, which fixes the order of its sums and hence every digit."""
    with threadpool_limits(limits=1):
        yield


class StageChain:
    """Solves stages in order, each with the joint posterior of the previous one as its prior.

    Without `diagnostics`, the solutions have the same parameters, but data and model are not tested.
    """

    def __init__(self, meta: LogMeta, *, diagnostics: bool = True) -> None:
        self._meta, self._diagnostics = meta, diagnostics
        context = context_from_meta(meta)
        # additional states are estimated from the sensitivities to them, which are part of the diagnostics
        self._context = replace(context, diagnostics=diagnostics or bool(context.states))
        self.prior = prior_from_meta(meta)
        #: Posterior of the last completed stage excluding the gravity error, which no stage can reduce.
        self.posterior = self.prior
        #: The same posterior without the effects in the unit's model, from which the next stage starts.
        self._solved = self.prior
        self._gravity = np.zeros(COUNT)
        self.solutions: list[Solution] = []
        #: Reason why a stage was skipped, by stage.
        self.missing_data: dict[str, Text] = {}
        self._solver: StageSolver | None = None
        self._lacks_gyros = False
        self._stage = ""
        checks = meta.product.checks if meta.product is not None else None
        self._gather = diagnostics and checks is not None and checks.need_samples
        self._data_tests = DataTests(meta, self._context, self.prior)
        offset, matrix = composition(meta.registers)
        #: Parameters with which compensation of the recorded output cancels the correction by the registers.
        self._uncalibrated = np.asarray(np.linalg.solve(matrix, -offset), np.float64)
        imu = self._context.imu
        priors = known_effects(self.prior.sigma, self._context)
        changes, signs = plausible_changes(imu, meta.turn_on_sigmas), possible_signs(self._context)
        self.model_tests = ModelTests(changes, context.states, priors, signs)
        self._resting = RestOutput(imu) if diagnostics and resolves_earth_rate(imu) else None
        self._table_rests: list[TableRests] = []

    def warm(self) -> None:
        """Compile the solvers' kernels, or load them from their cache."""
        warm_up()

    def start(self, stage: str) -> None:
        """Start a stage. Raises ConfigurationError for an unknown stage, InputError for an invalid schedule."""
        schedule_type, self._stage = method(stage).schedule, stage
        schedule = validate(schedule_type, self._meta.schedule.get(stage, {}), f"schedule of {stage}", InputError)
        self._lacks_gyros = False
        self._solver = method(stage).solver(self._context, self._solved, schedule)
        self._solver.effects = self.model_tests.effects

    def feed(self, block: SampleBlock) -> None:
        """Add samples of the started stage."""
        if not has_gyros(block.counts) and not method(self._stage).without_gyros:
            self._lacks_gyros = True
            return
        self._current_solver().feed(block)

    def _current_solver(self) -> StageSolver:
        if self._solver is None:
            raise RuntimeError("no stage has been started")
        return self._solver

    def sigma(self) -> FloatArray:
        """Return the current standard deviations of the 30 parameters, shape (30,), SI."""
        return self.posterior.sigma if self._solver is None else self._solver.sigma()

    def ranking(self) -> Ranking | None:
        """Return the observability at the last call of `sigma`; None for a stage without the 39-state filter."""
        return None if self._solver is None else self._solver.ranking()

    def finish(self, progress: Progress | None = None) -> Solution:
        """Solve the started stage; its posterior becomes the next prior. Raises InputError if the solution diverges."""
        solver = self._current_solver()
        if self._lacks_gyros:
            raise InsufficientDataError("recording.no_gyros")
        if self._resting is not None and self._context.temperature is None:
            self._resting.feed(solver.buffer.block())
        self._data_tests.require_configuration(self._stage, solver.buffer.block(), solver.buffer.data())
        with ThreadPoolExecutor(1) as executor:  # while the compiled passes of the solver run
            samples = solver.buffer.block(), solver.buffer.data()
            tested = executor.submit(self._test_samples, *samples) if self._diagnostics else None
            try:
                solution = solver.finish(progress)
            except (np.linalg.LinAlgError, ZeroDivisionError, InputError) as exc:
                raise self._unsolvable(solver.buffer, exc) from exc
        earlier_messages = [message for earlier in self.solutions for message in earlier.messages]
        # a message without the name of its stage, such as the one about a quiet table, is displayed once
        solution = replace(solution, messages=tuple(m for m in solution.messages if m not in earlier_messages))
        self._solver, solved = None, solution.posterior
        if tested is not None:
            solution = self._with_tests(solution, solver, tested.result())
        else:
            solution = replace(self.model_tests.with_states(solution), observability={}, tests=())
        if self._context.diagnostics:
            senses = last_turns(solver.data(), solved.mean, self._context.initial_turn_senses)
            self._context = replace(self._context, initial_turn_senses=senses)
        self._gravity = gravity_sensitivity(self._solved, solved, solution.estimated, self._gravity)
        self._solved, self.posterior = solved, solution.posterior
        gravity = self._context.site.relative_gravity_sigma
        solution = replace(solution, posterior=with_gravity(self.posterior, self._gravity, gravity))
        self.solutions.append(solution)
        return solution

    def _unsolvable(self, buffer: StageBuffer, error: Exception) -> InputError:
        """Return the error of a stage that cannot be solved; a fault of its samples is the cause, if there is one.

        An error with which a method refuses a recording already contains the cause.
        """
        if isinstance(error, InputError) and not isinstance(error, InsufficientDataError):
            return error
        fault = self._data_tests.sample_fault(buffer.block(), buffer.data())
        if fault is not None:
            return InputError("solution.in_stage", stage=self._stage, what=fault.text(self._stage))
        if isinstance(error, InputError):
            return error
        what = Text.of("solution.diverged", detail=str(error))
        return InputError("solution.in_stage", stage=self._stage, what=what)

    def _test_samples(self, samples: SampleBlock, data: StageData) -> TestedSamples:
        tested = self._data_tests.test_samples(samples, data)
        import_module("scipy.optimize")  # takes a third of a second, and `table` needs it
        return tested

    def _with_tests(self, solution: Solution, solver: StageSolver, tested: TestedSamples) -> Solution:
        """Return a solution with its evidence, its latitude, and the tests of data and model."""
        data, block = solver.data(), solver.buffer.block()
        if self._gather:
            at = self._uncalibrated, solution.posterior.mean
            evidence = gather(self._stage, data, self._context, *at, solution.noise)
            solution = replace(solution, evidence=evidence)
        if self._resting is not None and self._context.temperature is None:
            solution = replace(solution, latitude=self._resting.latitude(solution.posterior))
        solution = self.model_tests.add_tests(solution, self.solutions, self.posterior)
        solution = self._data_tests.add_tests(solution, tested, block, data)
        if not data.joints.size:  # a gimbal is not a two-axis table
            self._table_rests.append(table_rests(data, self._context, solution.posterior))
        return solution

    def table(self) -> dict[str, TableQuantity]:
        """Return the table geometry determined from the rests of the solved stages; {} if there are too few rests."""
        return table_axes(self._table_rests, self._context, self.posterior)

    def skip_stage(self, reason: Text) -> None:
        """Skip the started stage; the next stage starts with the posterior of the previous stage."""
        self._solver = None
        self.missing_data[self._stage] = reason


def solve(
    blocks: Blocks,
    meta: LogMeta,
    stages: tuple[str, ...] | None = None,
    *,
    source: str | Path = "log",
    progress: SolveProgress | None = None,
    chain: StageChain | None = None,
) -> StageChain:
    """Solve the chosen stages of a log, by default all as recorded; `source` names the log in messages.

    `chain` is a new chain that the caller may monitor meanwhile.

    Raises InsufficientDataError if the data of a chosen stage, or of every stage of the log, are insufficient;
    InputError if the log cannot be solved for another reason.
    """
    replay = _Replay(blocks, chain or StageChain(meta), source, progress)
    with one_blas_thread():
        if stages is None:
            replay.solve_all()
        else:
            replay.solve_chosen(stages)
    return replay.chain


class _Replay:
    """Feeds the blocks of a log to a chain and solves its stages."""

    def __init__(self, blocks: Blocks, chain: StageChain, source: str | Path, progress: SolveProgress | None) -> None:
        self._blocks, self.chain, self._source, self._progress = blocks, chain, source, progress
        self._stage, self._seq = "", 0

    def solve_all(self) -> None:
        """Solve all stages in the order of the log; skip stages with insufficient data."""
        started: set[str] = set()
        for block in self._blocks():
            if block.stage and block.stage != self._stage:
                if self._stage:
                    self._finish(skip=True)
                if block.stage in started:
                    raise self._in_log(InputError("solution.stage_recorded_twice", stage=block.stage))
                started.add(block.stage)
                try:
                    method(block.stage)
                except ConfigurationError as exc:
                    raise InputError("solution.in_log", file=self._source, what=exc.as_text) from exc
                self._start(block.stage)
            if block.stage:
                self._feed(block)
        if not self._stage:
            raise self._in_log(InsufficientDataError("solution.no_stage_samples"))
        self._finish(skip=True)
        if not self.chain.solutions:
            reason = next(iter(self.chain.missing_data.values()))
            raise InsufficientDataError("solution.in_log", file=self._source, what=reason)

    def solve_chosen(self, stages: tuple[str, ...]) -> None:
        """Solve the chosen stages; the log is read only once if their order is that of the log."""
        for stage in stages:
            method(stage)
        waiting = list(stages)
        while waiting:
            before = len(waiting)
            recorded = self._one_pass(waiting)
            if len(waiting) < before:
                continue
            if not method(waiting[0]).needs_no_table:
                code = "solution.stage_not_in_range" if recorded else "solution.range_without_stages"
                raise self._in_log(InsufficientDataError(code, stage=waiting[0], held=recorded))
            # A manual recording names no stages, or other stages; all of its samples belong to this stage.
            self._start(waiting.pop(0))
            for block in self._blocks():
                self._feed(block)
            self._finish()

    def _one_pass(self, waiting: list[str]) -> list[str]:
        """Solve and remove as many stages of `waiting` as one pass permits; return the stages of the log."""
        recorded: dict[str, None] = {}
        self._stage = ""
        for block in self._blocks():
            if block.stage:
                recorded[block.stage] = None
            if self._stage and block.stage != self._stage and waiting[1:] and block.stage == waiting[1]:
                self._finish()
                waiting.pop(0)
                self._stage = ""
            if waiting and block.stage == waiting[0]:
                if not self._stage:
                    self._start(block.stage)
                self._feed(block)
        if self._stage:
            self._finish()
            waiting.pop(0)
        return list(recorded)

    def _start(self, stage: str) -> None:
        self.chain.start(stage)
        self._stage = stage

    def _feed(self, block: SampleBlock) -> None:
        self.chain.feed(block)
        self._seq = int(block.seq[-1])
        self._report(0.0)

    def _report(self, solved: float) -> None:
        if self._progress is not None:
            self._progress(self._stage, self._seq, solved)

    def _finish(self, *, skip: bool = False) -> None:
        """Finish a stage; with `skip`, omit it if its data are insufficient, as in an interrupted run."""
        try:
            self.chain.finish(None if self._progress is None else self._report)
        except InsufficientDataError as exc:
            error = InsufficientDataError("solution.in_stage", stage=self._stage, what=exc.as_text)
            if not skip:
                raise self._in_log(error) from exc
            self.chain.skip_stage(error.as_text)
        except InputError as exc:
            raise self._in_log(exc) from exc

    def _in_log(self, error: InputError) -> InputError:
        return type(error)("solution.in_log", file=self._source, what=error.as_text)
