"""The result JSON of the contract, the same for a run and for a log solved again."""

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from calstation import __version__
from calstation.config.site_check import check_latitude, latitude_untold
from calstation.errors import ConfigurationError
from calstation.estimation.common.context import Belief
from calstation.estimation.common.least_squares import Consistency
from calstation.estimation.method import Solution
from calstation.physics.parameters import INDEX, PARAMETERS
from calstation.records.atomic import write_atomic
from calstation.records.checks import acceptance
from calstation.records.facts import LogFacts
from calstation.records.limits import NEAR, Check, check_limits, estimated_stage, not_compared, unobservable
from calstation.records.meta import LogMeta, context_from_meta
from calstation.results.partial import is_part

SCHEMA = "calstation.result/1"


@dataclass(frozen=True)
class Judgement:
    """Checks of a chain's answer against its product's limits; `passed` is None where there are no limits.

    not_compared : parameters that have a limit and were not estimated; they do not fail the unit
    """

    checks: tuple[Check, ...]
    passed: bool | None
    not_compared: tuple[str, ...] = ()

    def with_more(self, checks: list[Check]) -> "Judgement":
        """The same with further checks, which fail it where they are not passed."""
        if not checks:
            return self
        passed = (self.passed is not False) and all(check.passed for check in checks)
        return replace(self, checks=(*self.checks, *checks), passed=passed)


def judge(meta: LogMeta, prior: Belief, solutions: tuple[Solution, ...]) -> Judgement:
    """Compare what was solved with the limits in the log's meta; a run without a solved stage fails the unit."""
    limits = meta.product.limits if meta.product is not None else {}
    section = meta.product.checks if meta.product is not None else None
    near = section.near_miss_beyond if section is not None else NEAR
    found = check_limits(limits, prior, solutions, near)
    if section is not None:
        found += acceptance(section, context_from_meta(meta), prior, solutions, meta.previous)
    there = check_latitude(meta, solutions)
    checks = (*found, *there)
    if not limits and section is None:
        return Judgement(checks, None)
    passed = bool(found) and all(check.passed for check in checks)
    return Judgement(checks, passed, tuple(not_compared(limits, solutions)))


@dataclass(frozen=True)
class Ending:
    """What a result says about how it came to be: `outcome`, log and registers.

    log_file : path as text; first_seq, last_seq : range solved, None for all of the log
    stop_reason : who or what stopped a stopped run; advice : what to do next, see `station.advice`
    finished_stages : of an incomplete run, those that were solved before it died
    """

    outcome: str
    log_file: str
    facts: LogFacts
    first_seq: int | None = None
    last_seq: int | None = None
    registers: Mapping[str, Any] | None = None
    error: str | None = None
    stop_reason: str | None = None
    advice: str | None = None
    finished_stages: tuple[str, ...] | None = None


def build_result(
    meta: LogMeta, prior: Belief, solutions: tuple[Solution, ...], judgement: Judgement, ending: Ending
) -> dict[str, Any]:
    """The contract's result, JSON-ready; every value SI. Its duration is that of the log's samples."""
    run, facts = meta.run, ending.facts
    result: dict[str, Any] = {
        "schema": SCHEMA,
        "unit": {"serial": meta.imu.serial},
        "stages": [solution.stage for solution in solutions],
        "part": is_part(meta),
        "passed": judgement.passed,
        "parameters": parameters_json(solutions),
        "unobservable": unobservable(prior, solutions),
        "checks": [check.to_json() for check in judgement.checks],
        "not_compared": list(judgement.not_compared),
        "consistency": {s.stage: consistency_json(s.consistency) for s in solutions},
        "observability": {s.stage: dict(s.observability) for s in solutions if s.observability},
        "details": {s.stage: dict(s.details) for s in solutions if s.details},
        "outcome": ending.outcome,
        "advice": ending.advice,
        "attempt": run.attempt if run else 1,
        "operator": run.operator if run else None,
        "station": run.station if run else None,
        "product": meta.product.name if meta.product else None,
        "configuration_sha256": hashlib.sha256(meta.to_json().encode()).hexdigest(),
        "configuration": _files(meta),
        "temperature_c": _temperature(facts),
        "registers": ending.registers,
        "log": {
            "file": ending.log_file,
            "sha256": facts.sha256,
            "first_seq": facts.first_seq
            if ending.first_seq is None
            else max(ending.first_seq, facts.first_seq),
            "last_seq": facts.last_seq if ending.last_seq is None else min(ending.last_seq, facts.last_seq),
            "gaps": facts.gaps,
        },
        "software": {"version": __version__},
        "started_utc": run.started_utc if run else None,
        "duration_s": facts.samples / meta.imu.sample_rate_hz,
    }
    more = {
        "error": ending.error,
        "stop_reason": ending.stop_reason,
        "finished_stages": ending.finished_stages,
        "latitude_untold": latitude_untold(meta, solutions),
        "resumed_from": run.resumed_from if run else None,
    }
    result.update({key: value for key, value in more.items() if value is not None})
    plain: dict[str, Any] = _plain(result)
    return plain


def _files(meta: LogMeta) -> dict[str, dict[str, Any]]:
    """Name, version and digest of each file that the run used, by kind."""
    files = (meta.run.files if meta.run else None) or {}
    return {kind: file.model_dump() for kind, file in files.items()}


def _plain(value: Any) -> Any:
    """Numbers and containers as JSON knows them; what is not finite becomes null."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def consistency_json(consistency: Consistency) -> dict[str, Any]:
    """A stage's innovation test as the result holds it."""
    return {
        "nis_mean": consistency.nis_mean,
        "nis_low": consistency.nis_low,
        "nis_high": consistency.nis_high,
        "passed": consistency.passed,
        "warning": consistency.warning,
    }


def parameters_json(solutions: tuple[Solution, ...]) -> dict[str, dict[str, Any]]:
    """The values found, by contract name, as the result holds them."""
    if not solutions:
        return {}
    belief = solutions[-1].belief
    sigma = belief.sigma
    parameters: dict[str, dict[str, Any]] = {
        name: {
            "value": float(belief.mean[INDEX[name]]),
            "sigma": float(sigma[INDEX[name]]),
            "unit": PARAMETERS[INDEX[name]].unit,
            "stage": stage,
        }
        for name, stage in estimated_stage(solutions).items()
    }
    for solution in solutions:
        for name, found in solution.found.items():
            parameters[name] = {
                "value": found.value,
                "sigma": found.sigma,
                "unit": found.unit,
                "stage": solution.stage,
            }
    return parameters


def _temperature(facts: LogFacts) -> dict[str, float] | None:
    if facts.temperature is None:
        return None
    mean, low, high = facts.temperature
    return {"mean": mean, "min": low, "max": high}


def write_json(path: Path, result: Mapping[str, Any]) -> None:
    """Write a result file, whole or not at all. Raises ConfigurationError where the place cannot be written."""
    text = json.dumps(result, indent=1, allow_nan=False, ensure_ascii=False) + "\n"
    try:
        if path.exists() and not path.is_file():
            path.write_text(text, encoding="utf-8")  # a pipe or a device, which cannot be replaced
        else:
            write_atomic(path, text)
    except OSError as exc:
        raise ConfigurationError(
            f"{path}: cannot be written ({exc.strerror or exc}); choose another folder"
        ) from exc
