"""The result of a run or of a log solved again: typed values, read from and written to the contract's result JSON."""

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, JsonValue, PlainSerializer

from calstation.errors import CalstationError, ConfigurationError, InputError
from calstation.messages import known, os_reason, values_from_json
from calstation.records import Check, FileSection, write_atomic

SCHEMA = "calstation.result/1"

#: A number; ``null`` in JSON stands for one that is not finite.
Number = Annotated[float, BeforeValidator(lambda value: math.nan if value is None else value)]

#: A check, in the form that the result JSON gives it.
CheckField = Annotated[
    Check,
    BeforeValidator(lambda value: value if isinstance(value, Check) else Check.from_json(value)),
    PlainSerializer(Check.to_json),
]


class _Section(BaseModel):
    """A part of a result. Keys of other versions of the program are kept."""

    model_config = ConfigDict(frozen=True, extra="allow", populate_by_name=True, arbitrary_types_allowed=True)


class Parameter(_Section):
    """A solved parameter, SI, and the stage that was the last to estimate it."""

    value: Number
    sigma: Number
    unit: str = ""
    stage: str = ""


class StageConsistency(_Section):
    """Innovation test of a stage: the mean normalised innovation squared and its band."""

    nis_mean: Number
    nis_low: Number
    nis_high: Number
    passed: bool
    warning: bool


class Temperature(_Section):
    """Temperature of the unit during the run, °C."""

    mean: float
    min: float
    max: float


class KeptRegister(_Section):
    """A register that was left as it was, because an earlier run had found it better; SI."""

    sigma: Number = math.nan
    sigma_now: Number = math.nan
    value_now: Number = math.nan
    found_utc: str = Field(default="", alias="from")


class Verification(_Section):
    """One comparison of the unit's output after the transfer with what its registers let expect."""

    name: str
    value: Number
    expected: Number
    tolerance: Number
    unit: str
    passed: bool


class Registers(_Section):
    """The unit's registers before and after the run, by parameter, SI.

    Attributes
    ----------
    new : None where nothing was written
    verified : the unit's output was compared and agrees
    kept : registers that were left as they were
    proof : the comparisons
    proved_on : what was compared: ``turn``, ``rest`` or ``read_back``
    """

    old: dict[str, Number] = Field(default_factory=dict)
    new: dict[str, Number] | None = None
    verified: bool = False
    kept: dict[str, KeptRegister] = Field(default_factory=dict)
    proof: list[Verification] = Field(default_factory=list)
    proved_on: str | None = None
    written_utc: str | None = None


class DamagedRange(_Section):
    """Rows of the log that could not be read: their number, and the first and last missing sequence number."""

    rows: int
    seq: str


class LogSection(_Section):
    """The log that was solved, and the range of sequence numbers."""

    file: str
    sha256: str = ""
    first_seq: int = 0
    last_seq: int = -1
    gaps: int = 0
    damaged: list[DamagedRange] = Field(default_factory=list)


class LatitudeUnknown(_Section):
    """An inconsistent stage and the latitude, degrees, that it assumed and no rest confirmed."""

    stage: str
    latitude: float


class Unit(_Section):
    """The calibrated unit."""

    serial: str


class Software(_Section):
    """The program that solved."""

    version: str


class Result(_Section):
    """A result, see the contract. Sections that the JSON leaves out have their defaults.

    Attributes
    ----------
    stages : those that were solved
    partial : the run left out stages of the product
    passed : None without limits
    unobservable : parameters that the data did not determine
    not_compared : parameters with a limit that no stage estimated
    observability, details : of each stage, as its method reports them
    advice : what to do next: reseat, repeat, set_aside or resume
    configuration : the files used, by kind
    error : the fault that ended the run, in English
    error_code, error_values : its entry in the message catalogue, and what stands in the braces of the entry
    finished_stages : of an incomplete run, those that were solved before it died
    missing_data : why a stage could not be solved, by stage
    closed_utc, closed_by : when and by whom it was decided not to resume an incomplete run
    """

    schema_name: Literal["calstation.result/1"] = Field(alias="schema")
    unit: Unit
    stages: list[str]
    partial: bool = Field(default=False, alias="part")
    passed: bool | None = None
    parameters: dict[str, Parameter]
    unobservable: list[str] = Field(default_factory=list)
    checks: list[CheckField] = Field(default_factory=list)
    not_compared: list[str] = Field(default_factory=list)
    consistency: dict[str, StageConsistency] = Field(default_factory=dict)
    observability: dict[str, dict[str, JsonValue]] = Field(default_factory=dict)
    details: dict[str, dict[str, JsonValue]] = Field(default_factory=dict)
    outcome: str
    advice: str | None = None
    attempt: int = 1
    operator: str | None = None
    station: str | None = None
    product: str | None = None
    configuration_sha256: str = ""
    configuration: dict[str, FileSection] = Field(default_factory=dict)
    temperature_c: Temperature | None = None
    registers: Registers | None = None
    log: LogSection
    software: Software | None = None
    started_utc: str | None = None
    duration_s: Number = 0.0
    error: str | None = None
    error_code: str | None = None
    error_values: dict[str, JsonValue] | None = None
    stop_reason: str | None = None
    finished_stages: list[str] | None = None
    latitude_untold: LatitudeUnknown | None = None
    resumed_from: str | None = None
    missing_data: dict[str, str] = Field(default_factory=dict, alias="lacking")
    closed_utc: str | None = None
    closed_by: str | None = None

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> "Result":
        """Read a result JSON. Raises ValueError for anything else."""
        return cls.model_validate(data)

    def to_json(self) -> dict[str, Any]:
        """The contract's result JSON, with the keys that were given."""
        rows: dict[str, Any] = plain(self.model_dump(by_alias=True, exclude_unset=True))
        return rows

    @property
    def serial(self) -> str:
        """Serial number of the unit."""
        return self.unit.serial

    @property
    def solved_stages(self) -> list[str]:
        """Stages that were solved, those of a run that died included."""
        return self.finished_stages or self.stages

    @property
    def failed_checks(self) -> list[Check]:
        """The checks that were not passed."""
        return [check for check in self.checks if not check.passed]

    @property
    def end_reason(self) -> str | None:
        """What ended a faulty or stopped run, in English."""
        return self.error or self.stop_reason

    @property
    def fault(self) -> CalstationError | None:
        """The fault that ended the run, None for a result that does not hold its values."""
        if self.error_code is None or self.error_values is None or not known(self.error_code):
            return None
        return CalstationError(self.error_code, **values_from_json(self.error_values))

    @property
    def verified(self) -> bool:
        """Whether registers were written and the unit's output agrees with them."""
        return self.registers is not None and self.registers.verified


def load_result(path: Path) -> Result:
    """Read a result file. Raises InputError."""
    try:
        return Result.from_json(json.loads(path.read_text(encoding="utf-8")))
    except OSError as exc:
        raise InputError("result.unreadable", file=path, reason=os_reason(exc)) from exc
    except json.JSONDecodeError as exc:
        raise InputError("result.not_json", file=path, detail=str(exc)) from exc
    except ValueError as exc:
        raise InputError("result.not_a_result", file=path, schema=SCHEMA) from exc


def plain(value: Any) -> Any:
    """Numbers and containers as JSON knows them; what is not finite becomes null."""
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


def write_json(path: Path, data: Mapping[str, Any]) -> None:
    """Write a JSON file, whole or not at all. Raises ConfigurationError where it cannot be written."""
    text = json.dumps(data, indent=1, allow_nan=False, ensure_ascii=False) + "\n"
    try:
        if path.exists() and not path.is_file():
            path.write_text(text, encoding="utf-8")  # a pipe or a device cannot be replaced
        else:
            write_atomic(path, text)
    except OSError as exc:
        raise ConfigurationError("result.unwritable", file=path, reason=os_reason(exc)) from exc
