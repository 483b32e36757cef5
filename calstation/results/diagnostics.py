"""Diagnostics of a result: innovations, residuals and observability of every stage.

A result JSON contains only a summary; the details are computed on demand by solving the log again, bit-exactly.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import groupby
from pathlib import Path
from typing import Any

from calstation.estimation import Innovations
from calstation.estimation.common import Consistency, RestResiduals, rest_residuals, stage_data
from calstation.jobs import ProgressCallback
from calstation.records import context_from_meta, open_log
from calstation.results.solver_chain import one_blas_thread, solve

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
    observability: Mapping[str, Any] = field(default_factory=dict)
    details: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Diagnostics:
    """Diagnostics of all stages of a log, in the order in which they were solved."""

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
    """Job: solve a log again and return the details that its result omits.

    Parameters and exceptions are those of `resolve`.
    """
    log = open_log(path)
    expected = len(stages or (log.meta.run.stages if log.meta.run is not None else ()))
    context = context_from_meta(log.meta)
    started: dict[str, None] = {}

    def progress(stage: str, seq: int, solved: float) -> None:
        started[stage] = None
        done = (len(started) - 1 + solved) / max(expected, len(started))
        report(_SOLVING * min(done, 1.0), note=stage)

    with one_blas_thread():
        chain = solve(lambda: log.blocks(first_seq, last_seq), log.meta, stages, source=path, progress=progress)
        solutions = {solution.stage: solution for solution in chain.solutions}
        diagnosed: dict[str, StageDiagnostics] = {}
        in_stages = (block for block in log.blocks(first_seq, last_seq) if block.stage)
        for stage, blocks in groupby(in_stages, lambda block: block.stage):
            if stage not in solutions or stage in diagnosed:
                continue
            report(_SOLVING + (1.0 - _SOLVING) * len(diagnosed) / len(solutions), note=stage)
            data = stage_data(list(blocks), context.imu)
            solution = solutions[stage]
            diagnosed[stage] = StageDiagnostics(
                stage,
                int(data.seq[0]),
                context.imu.sample_rate,
                solution.consistency,
                solution.innovations,
                rest_residuals(data, context, chain.belief),
                solution.observability,
                solution.details,
            )
    return Diagnostics(path, log.meta.imu.serial, tuple(diagnosed[s] for s in solutions if s in diagnosed))
