"""Result of a run or of a log solved again, which is read from and written to the result JSON of the contract.

A new entry of the result is a field here, which `build_result` in `building.py` sets; an entry of every parameter is a
field of `Parameter` in `sections.py`, which `solved_parameters` sets. See docs/how-to/extend.md.
"""

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field, JsonValue, PlainSerializer

from calstation.errors import CalstationError, ConfigurationError, InputError
from calstation.judgement import (
    Check,
    Conformity,
    End,
    StandardComparison,
    change_sigma,
    needs_full_calibration,
    short_names,
    verdict_of,
)
from calstation.messages import Text, known, os_reason, values_from_json
from calstation.parsing import read_json
from calstation.physics import (
    EFFECT_STATES,
    GROUP_BY_NAME,
    NAMES,
    EffectName,
    FloatArray,
    parameter_vector,
)
from calstation.records import FileSection, OnlineDifference, OverriddenSection, Verdict, covariance_from, write_atomic
from calstation.results.sections import (
    CalibrationUsed,
    CyclePhase,
    LatitudeUnknown,
    LogSection,
    Override,
    Parameter,
    Registers,
    Software,
    StageConsistency,
    TableValue,
    Temperature,
    Unit,
)
from calstation.results.temperature import TemperatureResult
from calstation.schema import Number, ResultSection

if TYPE_CHECKING:
    import pandas

SCHEMA = "calstation.result/1"

#: Largest number of failed checks listed in the verdict.
_MAX_NAMED_CHECKS = 3

#: Exceptions that `Result.from_json` raises for JSON that is not a result.
NO_RESULT = (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError)

#: A check, serialised as in the result JSON.
CheckField = Annotated[
    Check,
    BeforeValidator(lambda value: value if isinstance(value, Check) else Check.from_json(value)),
    PlainSerializer(Check.to_json),
]


class Result(ResultSection):
    """A result as defined in the contract; missing entries have their defaults."""

    schema_name: Literal["calstation.result/1"] = Field(alias="schema")
    unit: Unit
    stages: list[str]  #: Solved stages.
    partial: bool = False  #: Whether the run, or the solution of its log, omitted stages of the product.
    simulated: bool = False  #: Whether the virtual bench generated the samples; see also `was_simulated`.
    passed: bool | None = None  #: None if there are no limits, or data and model were not tested.
    #: Whether data and model were tested; False if a log was solved again for its parameters only, without a verdict.
    tested: bool = True
    parameters: dict[str, Parameter]
    #: Correlation coefficients of the solved parameters among the 30, by name; 0 for pairs that are not listed.
    correlation: dict[str, dict[str, float]] = Field(default_factory=dict)
    #: Geometry of the table, which does not depend on the unit: ``orthogonality``, ``tilt_x`` and ``tilt_y``.
    table: dict[str, TableValue] = Field(default_factory=dict)
    unobservable: list[str] = Field(default_factory=list)  #: Parameters that the run's own data did not determine.
    checks: list[CheckField] = Field(default_factory=list)
    not_compared: list[str] = Field(default_factory=list)  #: Parameters with a limit that no stage determined.
    conformity: Conformity | None = None  #: None if no value has limits.
    consistency: dict[str, StageConsistency] = Field(default_factory=dict)
    #: Observability and details by stage, as reported by its method.
    observability: dict[str, dict[str, JsonValue]] = Field(default_factory=dict)
    details: dict[str, dict[str, JsonValue]] = Field(default_factory=dict)
    outcome: Literal["passed", "failed", "stopped", "fault", "incomplete", "resolved"]
    advice: str | None = None  #: Recommended action, see `calstation.judgement.advice`.
    attempt: int = 1
    operator: str | None = None
    station: str | None = None
    product: str | None = None
    configuration_sha256: str = ""
    configuration: dict[str, FileSection] = Field(default_factory=dict)  #: The files used, by kind.
    temperature_c: Temperature | None = None
    temperature: TemperatureResult | None = None  #: Parameters over temperature; `parameters` are at the reference.
    registers: Registers | None = None
    calibration: CalibrationUsed | None = None  #: None for a run that started from the prior of the IMU profile.
    log: LogSection
    software: Software | None = None
    started_utc: str | None = None
    ended_utc: str | None = None  #: Time of the verdict on a run by the computer's clock; None if solved again.
    duration_s: Number = 0.0
    #: Phases from the start of the run to the result, in order.
    cycle: list[CyclePhase] = Field(default_factory=list)
    error: str | None = None  #: The fault that ended the run, in English.
    error_code: str | None = None  #: Catalogue code of the fault.
    error_values: dict[str, JsonValue] | None = None  #: Values of the fault's message.
    stop_reason: str | None = None
    finished_stages: list[str] | None = None  #: Stages that an incomplete run solved before it ended.
    #: Solved stages that the operator ended before their schedules did.
    ended_by_hand: list[str] = Field(default_factory=list)
    latitude_untold: LatitudeUnknown | None = None
    #: Comparison of a check standard with its reference values; None for a production unit.
    check_standard: StandardComparison | None = None
    #: Reason for a run despite an overdue or failed check standard or certificate.
    standard_override: str | None = None
    standard_override_by: list[str] = Field(default_factory=list)
    standard_overridden: list[OverriddenSection] = Field(default_factory=list)
    resumed_from: str | None = None
    batch: str | None = None  #: Common identifier of the units that were on the table together; None for a single unit.
    slot: str | None = None  #: Name of the unit's slot on the table.
    #: Reason why a stage could not be solved, by stage.
    missing_data: dict[str, str] = Field(default_factory=dict, alias="lacking")
    #: States that were added to the model of the log when it was solved again; always empty for a run.
    states_added: list[EffectName] = Field(default_factory=list)
    closed_utc: str | None = None  #: Time of the decision not to resume an incomplete run.
    closed_by: str | None = None  #: Person who made this decision.
    override: Override | None = None  #: Release of a unit that failed; the outcome remains ``failed``.

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> "Result":
        """Read a result JSON. Raises ValueError if the data are not a result."""
        try:
            return cls.model_validate(data)
        # pydantic does not catch these errors for a malformed check
        except (LookupError, TypeError, AttributeError) as exc:
            raise ValueError(f"malformed check: {exc!r}") from exc

    def to_json(self) -> dict[str, Any]:
        """Return the result JSON of the contract, with the keys that were set."""
        rows: dict[str, Any] = plain(self.model_dump(by_alias=True, exclude_unset=True))
        return rows

    @property
    def serial(self) -> str:
        """Serial number of the unit."""
        return self.unit.serial

    @property
    def vector(self) -> FloatArray:
        """The 30 parameters, SI, shape (30,); 0 for those that the result does not contain."""
        return parameter_vector({name: row.value for name, row in self.parameters.items()})

    @property
    def covariance(self) -> FloatArray:
        """Covariance of the 30 parameters, SI, shape (30, 30); NaN for those that the result does not contain."""
        sigmas = [self.parameters[name].sigma if name in self.parameters else math.nan for name in NAMES]
        covariance = covariance_from(np.array(sigmas), self.correlation)
        unknown = np.isnan(sigmas)
        covariance[unknown, :] = covariance[:, unknown] = math.nan
        return covariance

    def to_frame(self) -> "pandas.DataFrame":
        """Return the parameters as a pandas table by name, with the fields of `Parameter`: value, sigma, unit, stage.

        Raises ConfigurationError if pandas is not installed.
        """
        try:
            import pandas
        except ImportError as exc:
            raise ConfigurationError("api.no_package", function="to_frame", package="pandas") from exc
        rows = {name: row.model_dump() for name, row in self.parameters.items()}
        columns = [*Parameter.model_fields]
        return pandas.DataFrame.from_dict(rows, orient="index", columns=columns).rename_axis("parameter")

    def curve(self, name: str, temperature: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return a parameter at temperatures, °C, shape (n,), and its sigmas, SI, shape (n,) each.

        A parameter that does not depend on the temperature is constant.
        """
        parameter = self.parameters[name]
        if self.temperature is None or name not in self.temperature.coefficients:
            return np.full(len(temperature), parameter.value), np.full(len(temperature), parameter.sigma)
        return self.temperature.curve(name, temperature)

    @property
    def compared(self) -> Mapping[str, Parameter]:
        """The parameters as compared with limits: the worst value and the largest sigma over temperature."""
        return {name: self.worst(name)[0] for name in self.parameters}

    def worst(self, name: str) -> tuple[Parameter, float | None]:
        """Return a parameter as compared with its limits, and the temperature of its worst value, °C.

        The worst value is the value farthest from the middle of the limits, or from 0 without limits. The temperature
        is None if the parameter does not depend on it.
        """
        parameter = self.parameters[name]
        if self.temperature is None or name not in self.temperature.coefficients:
            return parameter, None
        limits = (check.limit for check in self.checks if check.kind == "within" and check.subject == name)
        interval = next((limit for limit in limits if isinstance(limit, tuple)), (0.0, 0.0))
        temperatures = self.temperature.temperatures
        values, sigmas = self.curve(name, temperatures)
        k = int(np.abs(values - 0.5 * sum(interval)).argmax())
        worst = parameter.model_copy(update={"value": float(values[k]), "sigma": float(sigmas.max())})
        return worst, float(temperatures[k]) if np.ptp(values) > 0.0 else None

    @property
    def verdict(self) -> Verdict:
        """Verdict of the result."""
        if self.outcome == "resolved":
            return verdict_of(End.COMPLETED, self.passed, partial=self.partial)
        ended = self.outcome in ("passed", "failed")
        return verdict_of(End.COMPLETED if ended else End(self.outcome), self.outcome == "passed", partial=self.partial)

    @property
    def released(self) -> bool:
        """Whether the unit failed, but was released."""
        return self.override is not None

    @property
    def badge(self) -> str:
        """Verdict displayed in the window: ``released`` for a failed run whose unit was released."""
        return "released" if self.released else self.verdict

    @property
    def solved_stages(self) -> list[str]:
        """Solved stages, including those of an interrupted run."""
        return self.finished_stages or self.stages

    @property
    def undetermined(self) -> list[str]:
        """Parameters that neither the run's data nor the current calibration determine."""
        calibrated = self.calibration.not_improved if self.calibration is not None else ()
        return [name for name in self.unobservable if name not in calibrated]

    @property
    def lacks_calibration(self) -> bool:
        """Whether a partial run failed because the unit has no current calibration."""
        return self.calibration is None and needs_full_calibration(self.checks, partial=self.partial)

    @property
    def unjudged(self) -> list[str]:
        """Parameters with a limit that were not judged (of a partial run, solved ones), or the group if all of it."""
        names = {*self.not_compared} & ({*self.parameters} if self.partial else {*GROUP_BY_NAME})
        left = {name: group for name, group in GROUP_BY_NAME.items() if name in names}
        in_part = {group for name, group in GROUP_BY_NAME.items() if name not in left}
        return list(dict.fromkeys(name if group in in_part else group for name, group in left.items()))

    @property
    def cycle_seconds(self) -> dict[str, float]:
        """Duration of the cycle's phases by name, s; the sum of all stages is ``stage``."""
        seconds: dict[str, float] = {}
        for part in self.cycle:
            seconds[part.phase] = seconds.get(part.phase, 0.0) + part.seconds
        return seconds

    @property
    def failed_checks(self) -> list[Check]:
        """The checks that did not pass."""
        return [check for check in self.checks if not check.passed]

    @property
    def failure(self) -> Text:
        """Text about the failure: a limit or a narrowed limit of a parameter was exceeded, or other checks failed."""
        failed = self.failed_checks
        if failed and not any(check.kind in ("within", "sigma_below") for check in failed):
            names = short_names(failed)[:_MAX_NAMED_CHECKS]
            return Text.of("common.checks_failed", count=len(failed), checks=names)
        guarded = any(check.acceptance is not None for check in failed)
        return Text("common.outside_acceptance_limits" if guarded else "common.outside_limits")

    @property
    def missing_state(self) -> Check | None:
        """The most significant failed check whose cause can be added to the model as a state, or None."""
        failed = [c for c in self.failed_checks if c.diagnosis is not None and c.diagnosis.cause in EFFECT_STATES]
        return max(failed, key=lambda check: check.value, default=None)

    @property
    def failed_stages(self) -> set[str]:
        """Stages with a failed value."""
        names: set[str] = set()
        for check in self.failed_checks:
            names |= {check.subject, check.where.stage, check.where.parameter}
            names.update(self.undetermined if check.kind == "unobservable" else ())
        return {self.parameters[name].stage if name in self.parameters else name for name in names} & {*self.stages}

    @property
    def end_reason(self) -> str | None:
        """Reason why the run was stopped or ended in a fault, in English."""
        return self.error or self.stop_reason

    @property
    def fault(self) -> CalstationError | None:
        """The fault that ended the run; None if the result does not contain the values of its message."""
        if self.error_code is None or self.error_values is None or not known(self.error_code):
            return None
        return CalstationError(self.error_code, **values_from_json(self.error_values))

    @property
    def verified(self) -> bool:
        """Whether registers were written and agree with the unit's output."""
        return self.registers is not None and self.registers.verified


def in_sigma(later: Parameter, earlier: Parameter, *, independent: bool = False, updated: bool = False) -> float:
    """Return the difference of two estimates of a parameter, later minus earlier, in sigmas of the difference.

    If one estimate uses part of the other's data, the sigma of the difference is at most the larger sigma (J. A.
    Hausman, *Specification Tests in Econometrics*, Econometrica 46(6), 1978, lemma 2.1), which is used; for
    `independent` data, the sigmas are added in quadrature. If the later estimate is the earlier one `updated` with more
    data, the sigma is that of the check "change" (`change_sigma`).
    """
    difference = later.value - earlier.value
    sigma = math.hypot(later.sigma, earlier.sigma) if independent else max(later.sigma, earlier.sigma)
    if updated:
        sigma = change_sigma(earlier.sigma, later.sigma) or sigma
    return difference / sigma if sigma > 0.0 else 0.0 if difference == 0.0 else float("inf")


def online_difference(offline: Result, online: Result) -> OnlineDifference:
    """Return the largest difference between the parameters solved offline and in the run."""
    both = [{name: (p.value, p.sigma) for name, p in each.parameters.items()} for each in (offline, online)]
    common = [name for name in offline.parameters if name in online.parameters]
    sigmas = {name: abs(in_sigma(offline.parameters[name], online.parameters[name])) for name in common}
    largest = max(common, key=lambda name: sigmas[name], default="")
    return OnlineDifference(bool(common) and both[0] == both[1], largest, plain(sigmas.get(largest)))


def load_result(path: Path) -> Result:
    """Read a result file. Raises InputError."""
    return result_from(read_content(path), path)


def result_from(content: Mapping[str, Any], path: Path) -> Result:
    """Return the result with the content of a file. Raises InputError."""
    try:
        return Result.from_json(content)
    except ValueError as exc:
        raise InputError("result.not_a_result", file=path, schema=SCHEMA) from exc


def read_content(path: Path) -> dict[str, Any]:
    """Read a result file as JSON data. Raises InputError."""
    try:
        content = read_json(path)
    except OSError as exc:
        raise InputError("result.unreadable", file=path, reason=os_reason(exc)) from exc
    except json.JSONDecodeError as exc:
        raise InputError("result.not_json", file=path, line=exc.lineno, detail=exc.msg) from exc
    except ValueError as exc:
        raise InputError("result.not_a_result", file=path, schema=SCHEMA) from exc
    if not isinstance(content, dict):
        raise InputError("result.not_a_result", file=path, schema=SCHEMA)
    return content


def plain(value: Any) -> Any:
    """Convert numbers and containers to JSON types; a non-finite number becomes null."""
    if type(value) is float:  # fast path for most values
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def write_json(path: Path, data: Mapping[str, Any] | Sequence[Mapping[str, Any]]) -> None:
    """Write a JSON file atomically. Raises ConfigurationError."""
    text = json.dumps(data, indent=1, allow_nan=False, ensure_ascii=False) + "\n"
    try:
        if path.exists() and not path.is_file():
            path.write_text(text, encoding="utf-8")  # a pipe or a device cannot be replaced
        else:
            write_atomic(path, text)
    except OSError as exc:
        raise ConfigurationError("result.unwritable", file=path, reason=os_reason(exc)) from exc
