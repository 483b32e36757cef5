"""Diagnostics of a result: innovations, residuals and observability of every stage.

A result JSON contains only a summary; the details are computed on demand by solving the log again, with bit-identical
results.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import groupby
from pathlib import Path
from typing import Any

from calstation.estimation import Innovations, stage_residuals
from calstation.estimation.common import Consistency, PositionResidual, RestResiduals, rest_residuals, stage_data
from calstation.jobs import ProgressCallback
from calstation.records import Log, context_from_meta, open_log
from calstation.results.solver_chain import StageChain, one_blas_thread, solve

#: Fraction of the job's progress taken by solving.
_SOLVING = 0.9


@dataclass(frozen=True)
class StageDiagnostics:
    """Diagnostics of one stage."""

    stage: str
    first_seq: int
    sample_rate: float  #: Samples per second.
    consistency: Consistency
    innovations: Innovations | None  #: None if the method has none.
    rests: RestResiduals  #: Residuals at the stage's rests with the final solution.
    residuals: tuple[PositionResidual, ...]  #: Residuals per rest and move; empty without innovations.
    observability: Mapping[str, Any] = field(default_factory=dict)
    details: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Diagnostics:
    """Diagnostics of all stages of a log in the order in which they were solved."""

    log: Path
    serial: str
    stages: tuple[StageDiagnostics, ...]


def diagnose(
    report: ProgressCallback,
    path: Path,
    stages: tuple[str, ...] | None = None,
    first_seq: int | None = None,
    last_seq: int | None = None,
) -> Diagnostics:
    """Job: solve a log again and return its diagnostics; parameters and exceptions are as in `resolve`."""
    log = open_log(path)
    expected = len(stages or (log.meta.run.stages if log.meta.run is not None else ()))
    started: dict[str, None] = {}

    def progress(stage: str, seq: int, solved: float) -> None:
        started[stage] = None
        done = (len(started) - 1 + solved) / max(expected, len(started))
        report(_SOLVING * min(done, 1.0), note=stage)

    with one_blas_thread():
        chain = solve(lambda: log.blocks(first_seq, last_seq), log.meta, stages, source=path, progress=progress)
        diagnosed = stage_diagnostics(
            log, chain, first_seq, last_seq, lambda done, stage: report(_SOLVING + (1.0 - _SOLVING) * done, note=stage)
        )
    return Diagnostics(path, log.meta.imu.serial, diagnosed)


def stage_diagnostics(
    log: Log,
    chain: StageChain,
    first_seq: int | None = None,
    last_seq: int | None = None,
    progress: Callable[[float, str], None] = lambda done, stage: None,
) -> tuple[StageDiagnostics, ...]:
    """Read a solved log again and return the diagnostics of its stages in the order in which they were solved."""
    context = context_from_meta(log.meta)
    solutions = {solution.stage: solution for solution in chain.solutions}
    diagnosed: dict[str, StageDiagnostics] = {}
    in_stages = (block for block in log.blocks(first_seq, last_seq) if block.stage)
    for stage, blocks in groupby(in_stages, lambda block: block.stage):
        if stage not in solutions or stage in diagnosed:
            continue
        progress(len(diagnosed) / len(solutions), stage)
        data = stage_data(list(blocks), context.imu)
        solution, rests = solutions[stage], rest_residuals(data, context, chain.posterior)
        diagnosed[stage] = StageDiagnostics(
            stage,
            int(data.seq[0]),
            context.imu.sample_rate,
            solution.consistency,
            solution.innovations,
            rests,
            stage_residuals(solution, data, rests).rows,
            solution.observability,
            solution.details,
        )
    return tuple(diagnosed[stage] for stage in solutions if stage in diagnosed)
