"""One chain of stage solvers, fed by a run as samples come or from a log: same calls, same bits."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from calstation.errors import ConfigurationError, InputError, InsufficientDataError
from calstation.estimation.common.context import Belief
from calstation.estimation.common.latitude import RestOutput, resolves_earth_rate
from calstation.estimation.common.samples import SampleBlock, Spool
from calstation.estimation.common.stage_data import stage_data
from calstation.estimation.method import Progress, Solution, StageSolver
from calstation.estimation.navigation.stage import warm_up
from calstation.estimation.positions.evidence import gather
from calstation.physics.arrays import FloatArray
from calstation.records.meta import LogMeta, context_from_meta, prior_from_meta
from calstation.schema import validate
from procedures import method

#: Starts a fresh reading of a log's samples, in order.
Blocks = Callable[[], Iterable[SampleBlock]]

#: Is told the stage, the latest sequence number read, and how far the stage is solved, 0 while it is read, to 1.
Watch = Callable[[str, int, float], None]


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Sums of the linear algebra in one order, so that digits do not depend on the computer's load."""
    with threadpool_limits(limits=1):
        yield


class StageChain:
    """Solves stages one after another, each with the joint posterior of the one before as its prior.

    Attributes
    ----------
    solutions : in order
    missing_data : why a stage was skipped, by stage
    """

    def __init__(self, meta: LogMeta) -> None:
        self._meta = meta
        self._context = context_from_meta(meta)
        self.prior = prior_from_meta(meta)
        self._belief = self.prior
        self._solver: StageSolver | None = None
        self._stage = ""
        checks = meta.product.checks if meta.product is not None else None
        self._gather = checks is not None and checks.need_samples
        self._kept = Spool()
        imu = self._context.imu
        self._resting = RestOutput(imu) if resolves_earth_rate(imu) else None
        self.solutions: list[Solution] = []
        self.missing_data: dict[str, str] = {}

    def warm(self) -> None:
        """Compile the solvers' kernels, or load them from their cache."""
        warm_up()

    @property
    def belief(self) -> Belief:
        """What is known after the last finished stage."""
        return self._belief

    def start(self, stage: str) -> None:
        """Begin a stage. Raises ConfigurationError for an unknown one or a wrong schedule."""
        chosen = method(stage)
        self._stage = stage
        schedule = validate(
            chosen.schedule, self._meta.schedule.get(stage, {}), f"schedule of {stage}", InputError
        )
        self._solver = chosen.solver(self._context, self._belief, schedule)
        self._kept = Spool()

    def feed(self, block: SampleBlock) -> None:
        """Take samples of the stage begun."""
        assert self._solver is not None, "start a stage before feeding it"
        self._solver.feed(block)
        if self._gather:
            self._kept.append(block)
        if self._resting is not None:
            self._resting.feed(block)

    def sigma(self) -> FloatArray:
        """Standard deviations of the 30 parameters so far, shape (30,), SI."""
        return self._belief.sigma if self._solver is None else self._solver.sigma()

    def finish(self, progress: Progress | None = None) -> Solution:
        """Solve the stage begun; its posterior becomes the next stage's prior.

        progress : told how far the solver is

        Raises InputError where data and priors contradict each other so far that nothing can be solved.
        """
        assert self._solver is not None, "start a stage before finishing it"
        try:
            solution = self._solver.finish() if progress is None else self._solver.finish(progress)
        except np.linalg.LinAlgError as exc:
            raise InputError(
                f"stage '{self._stage}': the solution diverged ({exc}); check site.azimuth_deg, the axes in"
                " [table] and the sigmas in [prior]"
            ) from exc
        self._solver = None
        if self._gather:
            data = stage_data(list(self._kept.blocks()), self._context.imu)
            found = gather(self._stage, data, self._context, self.prior.mean, solution.belief.mean)
            solution = replace(solution, evidence=found)
        if self._resting is not None:
            solution = replace(solution, latitude=self._resting.latitude(solution.belief))
        self._belief = solution.belief
        self.solutions.append(solution)
        return solution

    def skip_stage(self, lacks: str) -> None:
        """Give the stage begun up: the next begins with what was known before it."""
        self._solver = None
        self.missing_data[self._stage] = lacks


def solve(
    blocks: Blocks,
    meta: LogMeta,
    stages: tuple[str, ...] | None = None,
    *,
    source: str | Path = "log",
    progress: Watch | None = None,
) -> StageChain:
    """Solve a log's stages; those that it holds, in its order, unless `stages` chooses.

    Parameters
    ----------
    blocks : gives the samples, anew at every call
    progress : told from time to time how it gets on

    Raises
    ------
    InsufficientDataError
        naming the stage and what it lacks: one of those chosen, or of the log where none has its data.
    """
    chain = StageChain(meta)
    with one_blas_thread():
        if stages is None:
            _solve_as_recorded(blocks, chain, source, progress)
        else:
            _solve_chosen(blocks, chain, stages, source, progress)
    return chain


def _solve_as_recorded(blocks: Blocks, chain: StageChain, source: str | Path, progress: Watch | None) -> None:
    stage, seq = "", 0
    seen: list[str] = []
    for block in blocks():
        if block.stage and block.stage != stage:
            if stage:
                _finish_or_leave_out(chain, stage, source, progress, seq)
            stage = block.stage
            if stage in seen:
                raise InputError(
                    f"{source}: stage '{stage}' was recorded twice; choose one with --stages, --from and --to"
                )
            seen.append(stage)
            _check_name(stage, source)
            chain.start(stage)
        if block.stage:
            chain.feed(block)
            seq = int(block.seq[-1])
            if progress is not None:
                progress(stage, seq, 0.0)
    if not stage:
        raise InsufficientDataError(
            f"{source}: no sample in the chosen range belongs to a stage; widen --from and --to, "
            "or name stages in the column 'stage'"
        )
    _finish_or_leave_out(chain, stage, source, progress, seq)
    if not chain.solutions:
        raise InsufficientDataError(f"{source}: {next(iter(chain.missing_data.values()))}")


def _finish_or_leave_out(
    chain: StageChain, stage: str, source: str | Path, progress: Watch | None, seq: int
) -> None:
    """A run that was cut short has a last stage without its data; those before it are solved all the same."""
    try:
        _finish(chain, stage, source, progress, seq)
    except InsufficientDataError as exc:
        chain.skip_stage(str(exc).removeprefix(f"{source}: "))


def _check_name(stage: str, source: str | Path) -> None:
    try:
        method(stage)
    except ConfigurationError as exc:
        raise InputError(f"{source}: column 'stage': {str(exc).removeprefix('stages: ')}") from exc


def _solve_chosen(
    blocks: Blocks,
    chain: StageChain,
    stages: tuple[str, ...],
    source: str | Path,
    progress: Watch | None,
) -> None:
    """As few readings of the log as the chosen order allows: one where it is the order of the log."""
    for stage in stages:
        method(stage)
    waiting = list(stages)
    while waiting:
        held: dict[str, None] = {}
        before = len(waiting)
        stage, seq = "", 0
        for block in blocks():
            if block.stage:
                held[block.stage] = None
            if stage and block.stage != stage and waiting[1:] and block.stage == waiting[1]:
                _finish(chain, stage, source, progress, seq)
                waiting.pop(0)
                stage = ""
            if waiting and block.stage == waiting[0]:
                if not stage:
                    stage = block.stage
                    chain.start(stage)
                chain.feed(block)
                seq = int(block.seq[-1])
                if progress is not None:
                    progress(stage, seq, 0.0)
        if stage:
            _finish(chain, stage, source, progress, seq)
            waiting.pop(0)
        if len(waiting) == before and method(waiting[0]).needs_no_table:
            _solve_whole(blocks, chain, waiting.pop(0), source, progress)
        elif len(waiting) == before:
            there = ", ".join(held) or "no stage"
            raise InsufficientDataError(
                f"{source}: no samples of stage '{waiting[0]}' in the chosen range, which holds {there}; "
                "choose other --stages or widen --from and --to"
            )


def _solve_whole(
    blocks: Blocks, chain: StageChain, stage: str, source: str | Path, progress: Watch | None
) -> None:
    """Solve all samples as one stage: a recording made by hand names no stages, or others."""
    chain.start(stage)
    seq = 0
    for block in blocks():
        chain.feed(block)
        seq = int(block.seq[-1])
        if progress is not None:
            progress(stage, seq, 0.0)
    _finish(chain, stage, source, progress, seq)


def _finish(chain: StageChain, stage: str, source: str | Path, progress: Watch | None, seq: int) -> None:
    try:
        chain.finish(None if progress is None else lambda done: progress(stage, seq, done))
    except InsufficientDataError as exc:
        lacks = str(exc).removeprefix(f"{stage}: ")
        raise InsufficientDataError(f"{source}: stage '{stage}': {lacks}") from exc
    except InputError as exc:
        raise InputError(f"{source}: {exc}") from exc
