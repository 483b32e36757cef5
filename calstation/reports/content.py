"""Content of a calibration certificate, which is built only from a result and the configuration in its log."""

import hashlib
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, date, datetime, timedelta
from pathlib import PureWindowsPath
from typing import Literal

import numpy as np

from calstation.errors import InputError
from calstation.judgement import ParameterConformity
from calstation.messages import Text
from calstation.physics import (
    AXES,
    DEFAULT_ORIENTATION,
    FloatArray,
    compose,
    entry_of,
)
from calstation.records import (
    LOG_SUFFIXES,
    InstrumentSection,
    LaboratorySection,
    Limit,
    LogMeta,
    Rule,
    TrailHead,
    Verdict,
)
from calstation.reports.budget import Budget
from calstation.results import Result, Temperature

Decision = Literal["passed", "failed", "not_judged"]


@dataclass(frozen=True)
class Quantity:
    """A calibrated quantity, with its values in SI units."""

    name: str  #: Name of the parameter in files.
    value: float
    sigma: float  #: Standard uncertainty.
    unit: str
    stage: str  #: The last stage that estimated the quantity.
    unobservable: bool  #: Whether the data of the run did not determine the quantity.
    limit: tuple[float, float] | None  #: Lowest and highest permitted value.
    sigma_limit: float | None  #: Largest permitted standard uncertainty.
    #: Remaining errors of the unit with its registers before and after the run; None if unknown.
    as_found: float | None
    as_left: float | None
    decision: Decision
    #: Probability that the decision is wrong, a false accept or a false reject; None if the value has no limits.
    risk: float | None = None
    acceptance: tuple[float, float] | None = None  #: Limits narrowed by the decision rule; None if not narrowed.

    @property
    def accepted(self) -> tuple[float, float] | None:
        """Lowest and highest accepted value; None without limits, or if the guard bands leave no value."""
        accepted = self.acceptance or self.limit
        return accepted if accepted is not None and accepted[0] <= accepted[1] else None


@dataclass(frozen=True)
class Certificate:
    """A calibration certificate."""

    number: str  #: Unique identification, without the revision.
    issued: date
    result: Result
    meta: LogMeta
    laboratory: LaboratorySection | None
    instruments: tuple[InstrumentSection, ...]
    quantities: tuple[Quantity, ...]
    correlation: FloatArray  #: Correlation coefficients in the order of `quantities`, shape (n, n).
    budget: Budget | None  #: None if it was not computed.
    verdict: Verdict  #: Statement of conformity, which is omitted if the verdict is undetermined.
    rule: Rule
    revision: int = 0  #: 0 for the first issue.
    supersedes: str | None = None  #: Identification and date of issue of the certificate that a revision replaces.
    reason: str | None = None  #: Reason for a revision.
    received: date | None = None  #: Date of receipt of the unit; None if not stated.
    #: Names of the persons who issued the certificate and confirmed their identity with their own PINs.
    authorised: tuple[str, ...] = ()
    trail: TrailHead | None = None  #: Head of the audit trail of the site before the issue.
    #: Temperature of the unit in the data from which the values were calculated; None if unknown.
    temperature: Temperature | None = None
    rewritten: str | None = None  #: Time at which the registers were written again after the run, ISO 8601.

    @property
    def identification(self) -> str:
        """Number and, for a revision, the number of the revision."""
        return f"{self.number}-R{self.revision}" if self.revision else self.number

    @property
    def days(self) -> tuple[date, date]:
        """First and last day (UTC) of the calibration, or the date of issue if they are unknown."""
        period = performed(self.result)
        return (self.issued, self.issued) if period is None else (period[0].date(), period[1].date())


def build_certificate(
    result: Result,
    meta: LogMeta,
    *,
    issued: date | None = None,
    budget: Budget | None = None,
) -> Certificate:
    """Build the first issue of the certificate for a result.

    Raises InputError if the date of issue is unknown, or if the result has no parameters.

    Parameters
    ----------
    result : result of a run or of a log solved again
    meta : configuration in its log
    issued : date of issue; by default `earliest_issue`
    budget : uncertainty budget; None if it was not computed
    """
    if not result.parameters:
        raise InputError("report.no_parameters", log=result.log.file)
    issued = issued or earliest_issue(result)
    if issued is None:
        raise InputError("report.no_date", log=result.log.file)
    quantities = tuple(_quantities(result, meta))
    return Certificate(
        number=certificate_number(result),
        issued=issued,
        result=result,
        meta=meta,
        laboratory=_laboratory(meta),
        instruments=tuple(meta.instruments),
        quantities=quantities,
        correlation=_correlation([q.name for q in quantities], result.correlation),
        budget=budget,
        verdict=result.verdict if result.verdict.judged else Verdict.UNDETERMINED,
        rule="simple" if result.conformity is None else result.conformity.rule,
    )


def arrangement(meta: LogMeta) -> Iterator[Text]:
    """Yield sentences about the placement on the table of a rotated unit or of a unit in a batch."""
    run, table = meta.run, meta.table
    in_batch = run is not None and run.batch is not None
    if run is not None and in_batch:
        yield Text.of("certificate.slot", slot=run.slot or "–", batch=run.batch)
        others = [serial for serial in run.batch_units or () if serial != meta.imu.serial]
        if others:
            yield Text.of("certificate.together", count=len(others), serials=", ".join(others))
    if in_batch or table.orientation != DEFAULT_ORIENTATION:
        yield Text.of("certificate.orientation", x=_signed(table.orientation[:2]), z=_signed(table.orientation[2:]))
    if in_batch and table.outer_lever == "estimated":
        priors = {axis: meta.prior.get(f"outer_lever_{axis}") for axis in AXES}
        arm = {axis: (prior and prior.value) or 0.0 for axis, prior in priors.items()}
        yield Text.of("certificate.lever", **{axis: _signed(f"{value:.3f}") for axis, value in arm.items()})


def _signed(text: str) -> str:
    return text.replace("-", "−")


def _laboratory(meta: LogMeta) -> LaboratorySection | None:
    """Return the laboratory of a log; without the accreditation, which does not cover it, for a simulated run."""
    if meta.laboratory is None or not meta.is_simulated:
        return meta.laboratory
    return meta.laboratory.model_copy(update={"accreditation": None})


def certificate_number(result: Result) -> str:
    """Return the number of a certificate, which is the name of its log without the suffix.

    For a recording of another program, whose name may not be unique, digits of its digest are added. A log that was
    solved again has a different number for every range, selection of stages and states, and version of the program.
    """
    name = PureWindowsPath(result.log.file).name
    name = next((name.removesuffix(end) for end in LOG_SUFFIXES if name.endswith(end)), name)
    if result.started_utc is None:
        return f"{name}-{result.log.sha256[:8]}"
    if result.outcome != "resolved":
        return name
    version = "" if result.software is None else result.software.version
    solved = (result.log.first_seq, result.log.last_seq, *result.stages, *result.states_added, version)
    return f"{name}-S{hashlib.sha256(repr(solved).encode()).hexdigest()[:8]}"


def earliest_issue(result: Result) -> date | None:
    """Return the date (UTC) of the end of the run or, if later, of its override; None if the run has no date."""
    period = performed(result)
    if period is None:
        return None
    ended = period[1].date()
    return ended if result.override is None else max(ended, date.fromisoformat(result.override.utc[:10]))


def performed(result: Result) -> tuple[datetime, datetime] | None:
    """Return the start and the end (UTC) of the calibration, each None if unknown."""
    if result.started_utc is None:
        return None
    begin = datetime.fromisoformat(result.started_utc).astimezone(UTC)
    if result.ended_utc is not None:
        return begin, datetime.fromisoformat(result.ended_utc).astimezone(UTC)
    # The cycle includes parts of a run that are not recorded, such as warm-up and transfer.
    seconds = sum(part.seconds for part in result.cycle) or result.duration_s
    return begin, begin + timedelta(seconds=seconds if math.isfinite(seconds) else 0.0)


def _quantities(result: Result, meta: LogMeta) -> list[Quantity]:
    limits = meta.product.limits if meta.product is not None else {}
    before, after = _remaining_errors(result, meta)
    decisions: dict[str, Decision] = {}
    for check in result.checks:
        if check.kind in ("within", "sigma_below") and decisions.get(check.subject) != "failed":
            decisions[check.subject] = "passed" if check.passed else "failed"
    acceptance = {check.subject: check.acceptance for check in result.checks if check.kind == "within"}
    judged = {} if result.conformity is None else result.conformity.parameters
    rows = []
    for name, parameter in result.parameters.items():
        limit = entry_of(limits, name) or Limit()
        decision = decisions.get(name, "not_judged") if result.verdict.judged else "not_judged"
        rows.append(
            Quantity(
                name=name,
                value=parameter.value,
                sigma=parameter.sigma,
                unit=parameter.unit,
                stage=parameter.stage,
                unobservable=name in result.unobservable,
                limit=limit.interval,
                sigma_limit=limit.sigma_limit(parameter.stage),
                as_found=before.get(name),
                as_left=after.get(name),
                decision=decision,
                risk=_risk(decision, judged.get(name)),
                acceptance=acceptance.get(name),
            )
        )
    return rows


def _risk(decision: Decision, judged: ParameterConformity | None) -> float | None:
    """Return the probability of a wrong decision, or None if the decision is not based on limits of the value."""
    if judged is None or decision != ("passed" if judged.accepted else "failed"):
        return None
    return judged.probability


def _remaining_errors(result: Result, meta: LogMeta) -> tuple[Mapping[str, float], Mapping[str, float]]:
    """Return the errors (estimates minus registers) that remain with the registers before and after the run.

    If the unit applies the registers to its output, the estimate is the remaining error, and the sum of the estimate
    and the register is the error of the uncorrected output.
    """
    values = {name: parameter.value for name, parameter in result.parameters.items()}
    errors = compose(meta.registers, values) if meta.registers else values
    registers = {name: pair for name, pair in unit_registers(result, meta).items() if name in values and name in errors}
    before, after = ({name: errors[name] - pair[k] for name, pair in registers.items()} for k in (0, 1))
    return before, after


def unit_registers(result: Result, meta: LogMeta) -> dict[str, tuple[float, float]]:
    """Return the registers of the unit before and after the run, by parameter, SI, or {} if they were not read."""
    old: Mapping[str, float] = meta.registers if result.registers is None else result.registers.old
    new = old if result.registers is None or result.registers.new is None else result.registers.new
    return {name: (value, new.get(name, value)) for name, value in old.items()}


def _correlation(names: list[str], correlations: Mapping[str, Mapping[str, float]]) -> FloatArray:
    matrix = np.eye(len(names))
    index_of = {name: k for k, name in enumerate(names)}
    for name, row in correlations.items():
        for other, coefficient in row.items():
            if name in index_of and other in index_of:
                matrix[index_of[name], index_of[other]] = matrix[index_of[other], index_of[name]] = coefficient
    return matrix
