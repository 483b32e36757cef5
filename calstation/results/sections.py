"""Sections of a result, with the names of the result JSON of the contract."""

from pydantic import Field

from calstation.estimation.common import Consistency
from calstation.schema import Number, ResultSection


class Parameter(ResultSection):
    """Estimate of a parameter, SI, and the last stage that estimated it."""

    value: Number
    sigma: Number
    unit: str = ""
    stage: str = ""


class TableValue(ResultSection):
    """A quantity of the table's geometry; see `calstation.estimation.positions.table_axes`."""

    value: Number
    sigma: Number
    unit: str = "rad"


class StageConsistency(ResultSection):
    """Innovation test of a stage: the mean normalised innovation squared and its acceptance band."""

    nis_mean: Number
    nis_low: Number
    nis_high: Number
    passed: bool | None  #: None if the stage tested no observation.
    warning: bool

    @classmethod
    def of(cls, consistency: Consistency) -> "StageConsistency":
        """Convert the consistency of a solution."""
        nis = {"nis_mean": consistency.nis_mean, "nis_low": consistency.nis_low, "nis_high": consistency.nis_high}
        return cls(**nis, passed=consistency.verdict, warning=bool(consistency.warning))


class Temperature(ResultSection):
    """Temperature of the unit during the run, °C."""

    mean: float
    min: float
    max: float


class Override(ResultSection):
    """Release of a unit that failed."""

    by: str  #: Badge or name of the person who released it.
    confirmed_by: str | None = None  #: Second person, if the product requires one.
    why: str
    utc: str  #: ISO 8601.


class JointEstimate(ResultSection):
    """Joint estimate of a unit's parameters by name, SI: means, standard deviations and correlation coefficients."""

    mean: dict[str, float]
    sigma: dict[str, float]
    correlation: dict[str, dict[str, float]] = Field(default_factory=dict)  #: 0 for pairs that are not listed.


class CalibrationUsed(ResultSection):
    """Current calibration of the unit, which was the prior of a partial run."""

    log: str  #: File name of the log of the calibration's run.
    started_utc: str
    #: Unobservable parameters, which keep the values of the calibration.
    not_improved: list[str] = Field(default_factory=list)


class Verification(ResultSection):
    """Comparison of a quantity of the unit's output after the transfer with its value expected from the registers."""

    name: str
    value: Number
    expected: Number
    tolerance: Number
    unit: str
    passed: bool


class Registers(ResultSection):
    """The unit's registers before and after the run, by parameter, SI."""

    old: dict[str, Number] = Field(default_factory=dict)
    new: dict[str, Number] | None = None  #: None if nothing was written.
    verified: bool = False  #: Whether the unit's output agrees with the new registers.
    #: Estimate of the parameters before registers are applied, from which verified registers were computed.
    estimate: JointEstimate | None = None
    proof: list[Verification] = Field(default_factory=list)  #: The comparisons of the output.
    proved_on: str | None = None  #: Basis of the verification: ``corrected_output`` or ``read_back``.
    written_utc: str | None = None


class DamagedRange(ResultSection):
    """Unreadable rows of the log: their number, and the first and last missing sequence number."""

    rows: int
    seq: str


class LogSection(ResultSection):
    """The log that was solved, and the range of its sequence numbers."""

    file: str
    sha256: str = ""
    first_seq: int = 0
    last_seq: int = -1
    part: bool = False  #: Whether the range is a part of the log.
    gaps: int = 0
    damaged: list[DamagedRange] = Field(default_factory=list)


class CyclePhase(ResultSection):
    """A phase of the run's cycle and its duration, s, in device time, or in host time during computation."""

    phase: str  #: Name in the catalogue family ``cycle``.
    stage: str = ""  #: Stage of a phase ``stage`` or ``solving``.
    seconds: Number


class LatitudeUnknown(ResultSection):
    """An inconsistent stage, and the configured latitude in degrees, which no rest has confirmed."""

    stage: str
    latitude: float


class Unit(ResultSection):
    """The calibrated unit."""

    serial: str


class Software(ResultSection):
    """The program that computed the result."""

    version: str
