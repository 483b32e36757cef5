"""What stands behind a result: innovations, residuals and observability of every stage, from its log alone.

A result JSON keeps only their summary. The log holds everything, and solving it again gives the same bits, so what an
engineer looks at is made when it is asked for, for a run just ended and for a log from elsewhere alike.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import groupby
from pathlib import Path
from typing import Any

from calstation.estimation.common.least_squares import Consistency
from calstation.estimation.common.residuals import RestResiduals, rest_residuals
from calstation.estimation.common.samples import SampleBlock
from calstation.estimation.common.stage_data import stage_data
from calstation.estimation.method import Innovations
from calstation.jobs.queue import ProgressCallback
from calstation.records.log import Log, open_log
from calstation.records.meta import context_from_meta
from calstation.results.solver_chain import SolveProgress, one_blas_thread, solve

#: Share of the work in solving.
_SOLVING = 0.9


@dataclass(frozen=True)
class StageDiagnostics:
    """One stage looked at closely.

    Attributes
    ----------
    first_seq : of the stage; sample_rate : 1/s, so that a sequence number is a time
    consistency, observability, details : as in the result
    innovations : None where its method tells none
    rests : what is left at its rests with the run's final answer
    """

    stage: str
    first_seq: int
    sample_rate: float
    consistency: Consistency
    innovations: Innovations | None
    rests: RestResiduals
    observability: Mapping[str, Any] = field(default_factory=dict)
    details: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Diagnostics:
    """All stages of a log, in the order in which they were solved."""

    log: Path
    serial: str
    stages: tuple[StageDiagnostics, ...]


def diagnose(
    tell: ProgressCallback,
    path: Path,
    stages: tuple[str, ...] | None = None,
    first_seq: int | None = None,
    last_seq: int | None = None,
) -> Diagnostics:
    """Work for the workshop: solve a log again and keep what the result leaves out.

    stages, first_seq, last_seq : as `resolve`. Raises InputError or ConfigurationError with file, field and mend.
    """
    log = open_log(path)
    expected = len(stages or (log.meta.run.stages if log.meta.run is not None else ()))
    context = context_from_meta(log.meta)
    with one_blas_thread():
        chain = solve(
            lambda: log.blocks(first_seq, last_seq),
            log.meta,
            stages,
            source=path,
            progress=_meter(tell, expected),
        )
        solutions = {solution.stage: solution for solution in chain.solutions}
        looked: dict[str, StageDiagnostics] = {}
        for stage, blocks in _by_stage(log, first_seq, last_seq):
            if stage not in solutions or stage in looked:
                continue
            tell(_SOLVING + (1.0 - _SOLVING) * len(looked) / len(solutions), note=stage)
            data = stage_data(list(blocks), context.imu)
            solution = solutions[stage]
            looked[stage] = StageDiagnostics(
                stage,
                int(data.seq[0]),
                context.imu.sample_rate,
                solution.consistency,
                solution.innovations,
                rest_residuals(data, context, chain.belief),
                solution.observability,
                solution.details,
            )
    return Diagnostics(path, log.meta.imu.serial, tuple(looked[s] for s in solutions if s in looked))


def _by_stage(log: Log, first: int | None, last: int | None) -> Iterator[tuple[str, Iterator[SampleBlock]]]:
    """Stages in the order of the log, each with its blocks, which are to be used at once."""
    return groupby((block for block in log.blocks(first, last) if block.stage), lambda block: block.stage)


def _meter(tell: ProgressCallback, expected: int) -> SolveProgress:
    """Tells how far solving is, by stages: of `expected` ones where that is known."""
    begun: dict[str, None] = {}

    def watch(stage: str, seq: int, solved: float) -> None:
        begun[stage] = None
        done = (len(begun) - 1 + solved) / max(expected, len(begun))
        tell(_SOLVING * min(done, 1.0), note=stage)

    return watch
