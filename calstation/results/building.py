"""Creation of a result from the solutions of a run and their judgement."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from calstation import __version__
from calstation.errors import CalstationError
from calstation.estimation import Solution
from calstation.estimation.common import Posterior
from calstation.estimation.positions import TableQuantity
from calstation.judgement import Judgement, estimated_stage, undetermined, unobservable
from calstation.messages import values_to_json
from calstation.physics import INDEX, PARAMETERS
from calstation.records import LogFacts, LogMeta, Verdict, correlation_of
from calstation.results.result import SCHEMA, Result, TemperatureResult, plain
from calstation.results.sections import CalibrationUsed, CyclePhase, Parameter, StageConsistency

#: Entries of `RunSection` that a result has only if they are known.
_STATED_IF_KNOWN = (
    "resumed_from",
    "standard_override",
    "standard_override_by",
    "standard_overridden",
    "batch",
    "slot",
)


@dataclass(frozen=True)
class Ending:
    """Data of a result that depend on the end of a run, or on the solution of its log."""

    verdict: Verdict
    log_file: str
    facts: LogFacts  #: Facts of the samples that were solved.
    part: bool = False  #: Whether these samples are a part of the log.
    registers: Mapping[str, Any] | None = None  #: Registers as in the result JSON.
    error: CalstationError | None = None
    stop_reason: str | None = None  #: Source of the stop of a stopped run.
    advice: str | None = None  #: Recommended action, see `calstation.judgement.advice`.
    finished_stages: tuple[str, ...] | None = None  #: Stages that an incomplete run solved before it ended.
    cycle: Sequence[CyclePhase] | None = None  #: Phases of the run.
    ended_utc: str | None = None  #: Time of the verdict on a run, ISO 8601.
    table: Mapping[str, TableQuantity] | None = None  #: Geometry of the table, see `StageChain.table`.
    solved_again: bool = False  #: Whether a log was solved again.
    ended_by_hand: Sequence[str] = ()  #: Result of `calstation.records.stages_ended_by_hand`.


def build_result(
    meta: LogMeta, prior: Posterior, solutions: Sequence[Solution], judgement: Judgement, ending: Ending
) -> Result:
    """Build the result of a run from its solutions, in order, and the posterior before the first stage."""
    facts, error = ending.facts, ending.error
    stages, stated = [solution.stage for solution in solutions], stated_by_log(meta, facts)
    optional = {
        "calibration": _calibration(meta, prior, solutions),
        "error": None if error is None else str(error),
        "error_code": None if error is None else error.code,
        "error_values": None if error is None else values_to_json(error.values),
        "stop_reason": ending.stop_reason,
        "finished_stages": ending.finished_stages,
        "cycle": ending.cycle,
        "ended_utc": ending.ended_utc,
        "table": {name: asdict(value) for name, value in ending.table.items()} if ending.table else None,
        "latitude_untold": judgement.latitude,
        "temperature": next(
            (
                TemperatureResult.of(s.temperature, s.estimated, solutions[-1].posterior.covariance)
                for s in solutions
                if s.temperature is not None
            ),
            None,
        ),
        "check_standard": judgement.standard,
        "ended_by_hand": [stage for stage in ending.finished_stages or stages if stage in ending.ended_by_hand] or None,
    }
    tests = {
        "conformity": judgement.conformity,
        "consistency": {s.stage: StageConsistency.of(s.consistency) for s in solutions},
        "observability": {s.stage: plain(s.observability) for s in solutions if s.observability},
    }
    return Result.model_validate(
        {
            "schema": SCHEMA,
            **{key: value for key, value in stated.items() if value is not None or key not in _STATED_IF_KNOWN},
            "stages": stages,
            "partial": judgement.partial,
            "passed": ending.verdict.passed,
            "parameters": solved_parameters(solutions),
            "correlation": _correlation(solutions),
            "unobservable": unobservable(prior, solutions),
            "checks": judgement.checks,
            "not_compared": judgement.not_compared,
            **(tests if judgement.tested else {"tested": False}),
            "details": {s.stage: plain(s.details) for s in solutions if s.details},
            "outcome": "resolved" if ending.solved_again else ending.verdict.outcome,
            "advice": ending.advice,
            "registers": ending.registers,
            "log": {
                "file": ending.log_file,
                "sha256": facts.sha256,
                "first_seq": facts.first_seq,
                "last_seq": facts.last_seq,
                **({"part": True} if ending.part else {}),
                "gaps": facts.gaps,
            },
            "software": {"version": __version__},
            **{key: value for key, value in optional.items() if value is not None},
        }
    )


def stated_by_log(meta: LogMeta, facts: LogFacts) -> dict[str, Any]:
    """Return the entries of a result that the configuration and samples of its log determine; None if unknown."""
    run = meta.run
    stated = run.model_dump() if run else {}
    return {
        "unit": {"serial": meta.imu.serial},
        "simulated": meta.is_simulated,
        "attempt": run.attempt if run else 1,
        "operator": run.operator if run else None,
        "station": run.station if run else None,
        "product": meta.product.name if meta.product else None,
        "configuration_sha256": hashlib.sha256(meta.to_json().encode()).hexdigest(),
        "configuration": {kind: file.model_dump() for kind, file in ((run.files if run else None) or {}).items()},
        "temperature_c": facts.temperature and dict(zip(("mean", "min", "max"), facts.temperature, strict=True)),
        "started_utc": run.started_utc if run else None,
        "duration_s": facts.samples / meta.imu.sample_rate_hz,
        **{name: stated.get(name) for name in _STATED_IF_KNOWN},
    }


def _calibration(meta: LogMeta, prior: Posterior, solutions: Sequence[Solution]) -> CalibrationUsed | None:
    section = meta.run.calibration if meta.run is not None else None
    if section is None:
        return None
    unknown = undetermined(prior, solutions, meta.calibrated)
    names = [name for name in unobservable(prior, solutions) if name not in unknown]
    return CalibrationUsed(**section.model_dump(), not_improved=names)


def _correlation(solutions: Sequence[Solution]) -> dict[str, dict[str, float]]:
    if not solutions:
        return {}
    solved = estimated_stage(solutions)
    rows = {name: row for name, row in correlation_of(solutions[-1].posterior.covariance).items() if name in solved}
    return {name: {other: value for other, value in row.items() if other in solved} for name, row in rows.items()}


def solved_parameters(solutions: Sequence[Solution]) -> dict[str, Parameter]:
    """Return the solved parameters by name."""
    if not solutions:
        return {}
    posterior = solutions[-1].posterior
    sigma = posterior.sigma
    parameters = {}
    for name, stage in estimated_stage(solutions).items():
        i = INDEX[name]
        value, unit = float(posterior.mean[i]), PARAMETERS[i].unit
        parameters[name] = Parameter(value=value, sigma=float(sigma[i]), unit=unit, stage=stage)
    for solution in solutions:
        for name, estimate in solution.estimates.items():
            parameters[name] = Parameter(
                value=estimate.value, sigma=estimate.sigma, unit=estimate.unit, stage=solution.stage
            )
    return parameters
