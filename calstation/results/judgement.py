"""Comparison of a run's solutions with the product's limits, explanation of failed tests, and the result."""

import hashlib
import tomllib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from calstation import __version__
from calstation.config import check_latitude, gravity_beyond, unconfirmed_latitude
from calstation.errors import CalstationError
from calstation.estimation import Diagnosis, Solution
from calstation.estimation.common import Posterior
from calstation.estimation.positions import TableQuantity
from calstation.messages import Text, values_from_json, values_to_json
from calstation.physics import EFFECT_STATES, INDEX, PARAMETERS, display, display_by_unit
from calstation.records import (
    NEAR,
    Check,
    CheckKind,
    Limit,
    LogFacts,
    LogMeta,
    acceptance,
    check_limits,
    context_from_meta,
    correlation_of,
    estimated_stage,
    not_compared,
    undetermined,
    unobservable,
)
from calstation.results.conformity import conformity, decision_rule
from calstation.results.result import SCHEMA, CalibrationUsed, CyclePhase, Parameter, Result, StageConsistency, plain
from procedures import DEFAULT_STAGES

#: Kinds of checks that may fail because the model does not describe the data.
_OF_THE_MODEL: frozenset[CheckKind] = frozenset({
    "within", "consistency", "agreement", "halves", "gravity_at_rest", "improvement_at_rest",
    "improvement_at_rest_floor", "motion_angle", "motion_improvement", "motion_improvement_floor",
})  # fmt: skip
#: Largest number of parameters listed in the message about a failed test.
_MOST_MOVES = 3


@dataclass(frozen=True)
class Judgement:
    """Checks of the solutions against the product's limits."""

    checks: tuple[Check, ...]
    passed: bool | None  #: None if there are no limits.
    not_compared: tuple[str, ...] = ()  #: Parameters with a limit that no stage estimated or determined.
    tested: bool = True  #: Whether data and model were tested; if not, there is no verdict.

    def with_more(self, checks: list[Check]) -> "Judgement":
        """Return the judgement with more checks; it fails if one of them does not pass."""
        if not checks:
            return self
        passed = (self.passed is not False) and all(check.passed for check in checks)
        return replace(self, checks=(*self.checks, *checks), passed=passed)


def judge(meta: LogMeta, prior: Posterior, solutions: tuple[Solution, ...]) -> Judgement:
    """Compare the solutions with the limits in the log's configuration; without a solution the unit fails."""
    limits, near = _limits(meta)
    section = meta.product.checks if meta.product is not None else None
    compared = check_limits(limits, prior, solutions, near, meta.calibrated, decision_rule(meta))
    found = [_explained(meta, check) for check in compared]
    if section is not None:
        if meta.calibrated:  # the current calibration, not the run, determines most of the sigmas
            section = section.model_copy(update={"excitation": None})
        found += acceptance(section, context_from_meta(meta), prior, solutions, meta.previous)
    checks = (*_with_explanation(found, solutions), *check_latitude(meta, solutions))
    if not limits and section is None:
        return Judgement(checks, None)
    passed = bool(found) and all(check.passed for check in checks)
    return Judgement(checks, passed, tuple(not_compared(limits, prior, solutions)))


def compare_only(meta: LogMeta, prior: Posterior, solutions: tuple[Solution, ...]) -> Judgement:
    """Compare values and sigmas of untested solutions with the limits; the unit neither passes nor fails."""
    limits, near = _limits(meta)
    checks = check_limits(limits, prior, solutions, near, meta.calibrated, decision_rule(meta))
    found = tuple(_explained(meta, check) for check in checks if check.kind in ("within", "sigma_below"))
    return Judgement(found, None, tuple(not_compared(limits, prior, solutions)), tested=False)


def _limits(meta: LogMeta) -> tuple[Mapping[str, Limit], float]:
    """Return the limits of the product, and the fraction of a limit beyond which a value is a near miss."""
    if meta.product is None:
        return {}, NEAR
    checks = meta.product.checks
    return meta.product.limits, NEAR if checks is None else checks.near_miss_beyond


def _with_explanation(checks: list[Check], solutions: Sequence[Solution]) -> list[Check]:
    """Return the checks, with the last stage's failed test inserted before the first check that it explains."""
    failed = [k for k, check in enumerate(checks) if not check.passed and check.kind in _OF_THE_MODEL]
    last = solutions[-1] if solutions else None
    if not failed or last is None or last.explanation is None:
        return checks
    return [*checks[: failed[0]], Check.of_model(last.stage, last.explanation), *checks[failed[0] :]]


def _explained(meta: LogMeta, check: Check) -> Check:
    """Return a check of a sigma with the cause if gravity alone exceeds its limit."""
    if check.kind != "sigma_below" or isinstance(check.limit, tuple):
        return check
    found = gravity_beyond(meta, check.subject, check.limit)
    if found is None:
        return check
    size = found["sigma_ppm"] * 1e-6
    return replace(check, diagnosis=Diagnosis("gravity_uncertain", size, values={"parameter": check.subject, **found}))


def is_partial(meta: LogMeta, solved: Collection[str] | None = None) -> bool:
    """Return whether the stages of the run, or the stages `solved` again, omit stages of its product.

    A log without a run section is never partial.
    """
    text = meta.profiles.get("product")
    if meta.run is None or text is None:
        return False
    stages = tomllib.loads(text).get("stages", DEFAULT_STAGES)
    return not set(stages) <= set(meta.run.stages if solved is None else solved)


@dataclass(frozen=True)
class Ending:
    """How a run ended, or that a log was solved again."""

    outcome: str
    log_file: str
    facts: LogFacts
    first_seq: int | None = None  #: First sequence number solved; None for the first of the log.
    last_seq: int | None = None  #: Last sequence number solved; None for the last of the log.
    registers: Mapping[str, Any] | None = None  #: Registers as in the result JSON.
    error: CalstationError | None = None
    stop_reason: str | None = None  #: Source of the stop of a stopped run.
    advice: str | None = None  #: Recommended action, see `calstation.runs.verdict`.
    finished_stages: tuple[str, ...] | None = None  #: Stages that an incomplete run solved before it ended.
    cycle: Sequence[CyclePhase] | None = None  #: Phases of the run.
    table: Mapping[str, TableQuantity] | None = None  #: Geometry of the table, see `StageChain.table`.


def build_result(
    meta: LogMeta, prior: Posterior, solutions: tuple[Solution, ...], judgement: Judgement, ending: Ending
) -> Result:
    """Build the result of a run from its solutions in order, and the posterior before the first stage."""
    run, facts, error = meta.run, ending.facts, ending.error
    first, last = ending.first_seq, ending.last_seq
    stages = [solution.stage for solution in solutions]
    optional = {
        "calibration": _calibration(meta, prior, solutions),
        "error": None if error is None else str(error),
        "error_code": None if error is None else error.code,
        "error_values": None if error is None else values_to_json(error.values),
        "stop_reason": ending.stop_reason,
        "finished_stages": ending.finished_stages,
        "cycle": ending.cycle,
        "table": {name: asdict(found) for name, found in ending.table.items()} if ending.table else None,
        "latitude_untold": unconfirmed_latitude(meta, solutions) if judgement.tested else None,
        "resumed_from": run.resumed_from if run else None,
        "standard_override": run.standard_override if run else None,
        "batch": run.batch if run else None,
        "slot": run.slot if run else None,
    }
    return Result.model_validate(
        {
            "schema": SCHEMA,
            "unit": {"serial": meta.imu.serial},
            "stages": stages,
            "partial": is_partial(meta, stages if ending.outcome == "resolved" else None),
            "passed": judgement.passed,
            "parameters": solved_parameters(solutions),
            "correlation": _correlation(solutions),
            "unobservable": unobservable(prior, solutions),
            "checks": judgement.checks,
            "not_compared": judgement.not_compared,
            **(_tests(meta, prior, solutions, judgement) if judgement.tested else {"tested": False}),
            "details": {s.stage: plain(s.details) for s in solutions if s.details},
            "outcome": ending.outcome,
            "advice": ending.advice,
            "attempt": run.attempt if run else 1,
            "operator": run.operator if run else None,
            "station": run.station if run else None,
            "product": meta.product.name if meta.product else None,
            "configuration_sha256": hashlib.sha256(meta.to_json().encode()).hexdigest(),
            "configuration": {kind: file.model_dump() for kind, file in ((run.files if run else None) or {}).items()},
            "temperature_c": facts.temperature and dict(zip(("mean", "min", "max"), facts.temperature, strict=True)),
            "registers": ending.registers,
            "log": {
                "file": ending.log_file,
                "sha256": facts.sha256,
                "first_seq": facts.first_seq if first is None else max(first, facts.first_seq),
                "last_seq": facts.last_seq if last is None else min(last, facts.last_seq),
                "gaps": facts.gaps,
            },
            "software": {"version": __version__},
            "started_utc": run.started_utc if run else None,
            "duration_s": facts.samples / meta.imu.sample_rate_hz,
            **{key: value for key, value in optional.items() if value is not None},
        }
    )


def _tests(meta: LogMeta, prior: Posterior, solutions: tuple[Solution, ...], judgement: Judgement) -> dict[str, Any]:
    """Return the sections of a result that judge its values or test data and model."""
    return {
        "conformity": conformity(meta, prior, solutions, judgement.checks),
        "consistency": {s.stage: StageConsistency.of(s.consistency) for s in solutions},
        "observability": {s.stage: plain(s.observability) for s in solutions if s.observability},
    }


def _calibration(meta: LogMeta, prior: Posterior, solutions: tuple[Solution, ...]) -> CalibrationUsed | None:
    section = meta.run.calibration if meta.run is not None else None
    if section is None:
        return None
    unknown = undetermined(prior, solutions, meta.calibrated)
    names = [name for name in unobservable(prior, solutions) if name not in unknown]
    return CalibrationUsed(**section.model_dump(), not_improved=names)


def _correlation(solutions: Sequence[Solution]) -> dict[str, dict[str, float]]:
    if not solutions:
        return {}
    solved = estimated_stage(tuple(solutions))
    rows = {name: row for name, row in correlation_of(solutions[-1].posterior.covariance).items() if name in solved}
    return {name: {other: value for other, value in row.items() if other in solved} for name, row in rows.items()}


def solved_parameters(solutions: tuple[Solution, ...]) -> dict[str, Parameter]:
    """Return the solved parameters by contract name."""
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
        for name, found in solution.found.items():
            parameters[name] = Parameter(value=found.value, sigma=found.sigma, unit=found.unit, stage=solution.stage)
    return parameters


def cause_text(check: Check) -> Text | None:
    """Return the message about the cause of a failed test of the model; None for any other check."""
    found = check.diagnosis
    if found is None:
        return None
    parameter = found.values.get("parameter", "")
    (size, unit), (sigma, _) = (
        display(parameter, value) if parameter else display_by_unit(found.unit, value)
        for value in (found.size, found.sigma)
    )
    worst = sorted(found.parameter_shift, key=lambda name: -abs(found.parameter_shift[name]))[:_MOST_MOVES]
    moves = [Text.of("cause.move", parameter=name, sigmas=found.parameter_shift[name]) for name in worst]
    shown = {"size": size, "sigma": sigma, "unit": unit, "moves": moves, "stage": check.subject}
    return Text(f"cause.{found.cause}", {**shown, **values_from_json(found.values)})


def missing_state(result: Result) -> Check | None:
    """Return the most significant failed check whose cause another state of the model would describe, or None."""
    failed = [c for c in result.failed_checks if c.diagnosis is not None and c.diagnosis.cause in EFFECT_STATES]
    return max(failed, key=lambda check: check.value, default=None)
