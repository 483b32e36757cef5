"""Limits, acceptance checks, decision rule and temperatures of a product, as in product files and log configurations.

`calstation.judgement` compares results with them.
"""

from collections.abc import Iterable
from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from calstation.estimation.common import TemperatureModel
from calstation.physics import EFFECT_PARAMETERS, GROUPS, NAMES, PAIR_PARAMETERS, further_parameter
from calstation.schema import EntryError, StrictModel, check_names, near_miss

#: Default fraction of a limit above which a value is a near miss.
NEAR_MISS_FRACTION = 0.8
#: Decision rule, which accepts a value within the limits, or within the limits narrowed by its expanded uncertainty.
Rule = Literal["simple", "guard_band"]
#: Numbers of rests of a stage, from 0.
Positions = list[Annotated[int, Field(ge=0)]]


class Limit(StrictModel):
    """Limits of a parameter or group, SI."""

    within: float | list[float] | None = None  #: Largest magnitude, or [low, high].
    sigma_below: float | None = Field(default=None, gt=0)  #: Largest standard deviation.
    #: Largest standard deviation by the last stage that estimated the parameter, for partial runs.
    sigma_below_after: dict[str, float] = Field(default_factory=dict)

    @field_validator("within")
    @classmethod
    def _check_within(cls, within: float | list[float] | None) -> float | list[float] | None:
        if isinstance(within, list):
            if len(within) != 2 or within[0] >= within[1]:
                raise EntryError("limits.interval", value=str(within))
        elif within is not None and within <= 0:
            raise EntryError("limits.magnitude", value=within)
        return within

    @field_validator("sigma_below_after")
    @classmethod
    def _check_sigmas(cls, limits: dict[str, float]) -> dict[str, float]:
        for stage, limit in limits.items():
            if not limit > 0:
                raise EntryError("limits.not_positive", stage, value=limit)
        return limits

    def sigma_limit(self, stage: str) -> float | None:
        """Return the largest standard deviation of a parameter last estimated by `stage`; None without a limit."""
        return self.sigma_below_after.get(stage, self.sigma_below)

    @property
    def interval(self) -> tuple[float, float] | None:
        """Lowest and highest permitted value; None without a limit."""
        if self.within is None:
            return None
        if isinstance(self.within, list):
            return self.within[0], self.within[1]
        return -self.within, self.within

    def shifted_by(self, nominal: float) -> "Limit":
        """Return the limits shifted by the nominal value of a parameter."""
        if self.interval is None:
            return self
        return self.model_copy(update={"within": [end + nominal for end in self.interval]})


def check_limit_names(names: Iterable[str]) -> None:
    """Raise EntryError if a name is neither a parameter nor a group."""
    further = (*PAIR_PARAMETERS, *EFFECT_PARAMETERS)
    known = (*NAMES, *GROUPS, *(p.name for p in further), *dict.fromkeys(p.group for p in further))
    for name in names:
        if name not in known and further_parameter(name) is None:
            raise EntryError("entry.unknown_parameter", name, name=name, remedy=near_miss(name, known))


class ConformitySection(StrictModel):
    """`[conformity]` of a product: its decision rule, and the spread of the true values of its units."""

    rule: Rule = "simple"
    #: Standard deviation of the true values about the middle of the limits, SI, by parameter or group.
    spread: dict[str, Annotated[float, Field(gt=0)]] = Field(default_factory=dict)

    @field_validator("spread")
    @classmethod
    def _check_spread(cls, spread: dict[str, float]) -> dict[str, float]:
        check_limit_names(spread)
        return spread


class GravityAtRest(StrictModel):
    """Largest difference in magnitude between force and gravity, m/s², at rests of at least `shortest_rest_s`."""

    within: float = Field(gt=0)
    shortest_rest_s: float = Field(default=2.0, ge=1.0)


class ImprovementAtRest(StrictModel):
    """Largest fraction of the difference in magnitude between force and gravity that remains after calibration."""

    below: float = Field(gt=0)  #: Largest remaining fraction.
    #: Lower bound, m/s², of the limit of the remaining error, which otherwise follows from `below`.
    or_within: float = Field(default=0.0, ge=0)
    positions: Positions | None = None  #: Rests to compare; None for all rests.
    stage: str | None = None  #: Stage of the rests; None for the last stage with rests.


class Level(StrictModel):
    """Largest specific-force errors, m/s², at the level position, which is the rest number `position` of `stage`."""

    horizontal_within: float | None = Field(default=None, gt=0)
    vertical_within: float | None = Field(default=None, gt=0)
    position: int = Field(default=0, ge=0)
    stage: str | None = None


class MotionAngle(StrictModel):
    """Comparison of the rotation angles between rests, measured by the calibrated gyros, with a reference."""

    #: ``gravity`` for the calibrated accelerometers; None for the encoders, or for gravity if there are no encoders.
    reference: Literal["gravity"] | None = None
    within: float | None = Field(default=None, gt=0)  #: Largest error, rad.
    below: float | None = Field(default=None, gt=0)  #: Largest remaining fraction of the uncalibrated error.
    #: Lower bound, rad, of the limit of the remaining error, which otherwise follows from `below`.
    or_within: float = Field(default=0.0, ge=0)
    #: Rests that are compared in all pairs, over all motions between them; None for consecutive rests.
    positions: Positions | None = Field(default=None, min_length=2)
    stage: str | None = None  #: Stage of the motions; None for all stages.


class OfflineOnline(StrictModel):
    """Largest difference of a parameter from the run's result, in sigmas."""

    within_sigmas: float = Field(ge=0)


class Previous(StrictModel):
    """Largest change since the last calibration of the same unit, by parameter or group, SI."""

    change_within: dict[str, float] = Field(min_length=1)

    @field_validator("change_within")
    @classmethod
    def _check_limits(cls, limits: dict[str, float]) -> dict[str, float]:
        check_names(limits, NAMES + GROUPS)
        for name, limit in limits.items():
            if not limit > 0:
                raise EntryError("limits.not_positive", name, value=limit)
        return limits


class Excitation(StrictModel):
    """Largest permitted ratio of posterior to prior sigma."""

    sigma_ratio_below: float = Field(gt=0, le=1)


class SampleClockLimit(StrictModel):
    """Largest relative error of the sample rate in excess of the error of the reference, ppm."""

    within_ppm: float = Field(default=20.0, gt=0)


class TemperatureLimit(StrictModel):
    """Largest change of the temperature over a run, °C."""

    change_within: float = Field(default=10.0, gt=0)


class ChecksSection(StrictModel):
    """`[checks]` of a product; a value above the fraction `near_miss_beyond` of its limit is a near miss."""

    near_miss_beyond: float = Field(default=NEAR_MISS_FRACTION, gt=0, lt=1)
    gravity_at_rest: GravityAtRest | None = None
    improvement_at_rest: ImprovementAtRest | None = None
    level: Level | None = None
    motion_angle: MotionAngle | None = None
    offline_online: OfflineOnline | None = None
    previous: Previous | None = None
    excitation: Excitation | None = None
    sample_clock: SampleClockLimit | None = None  #: None for the default limit.
    temperature: TemperatureLimit | None = None  #: None for the default limit.

    @model_validator(mode="after")
    def _check_floors(self) -> "ChecksSection":
        for name, improvement, absolute in (
            ("improvement_at_rest", self.improvement_at_rest, self.gravity_at_rest),
            ("motion_angle", self.motion_angle, self.motion_angle),
        ):
            limit = absolute.within if absolute is not None else None
            if improvement is not None and limit is not None and improvement.or_within > limit:
                raise EntryError(
                    "limits.floor_above_limit", name, "or_within", floor=improvement.or_within, limit=limit
                )
        return self

    @property
    def need_samples(self) -> bool:
        """Whether a check needs the rests and motions of the stages."""
        checks = (self.gravity_at_rest, self.improvement_at_rest, self.level, self.motion_angle)
        return any(check is not None for check in checks)


class TemperatureSection(StrictModel):
    """`[temperature]`: parameters as polynomials of the temperature of the unit, °C."""

    reference_c: float = Field(default=25.0, ge=-100, le=200)
    range_c: tuple[float, float] = Field(strict=False)  #: Lowest and highest temperature that the result covers.
    #: Order of the polynomial by group, 0 for groups not listed; ``auto`` for the orders that the data support.
    order: dict[str, Annotated[int, Field(ge=0, le=6)]] | Literal["auto"] = "auto"
    rate_term: list[str] = Field(default_factory=list)  #: Groups with a term in the temperature's rate of change.
    held_out_c: list[float] = Field(default_factory=list)  #: Temperatures that test the fit, but are not fitted.

    @model_validator(mode="after")
    def _check_entries(self) -> "TemperatureSection":
        low, high = self.range_c
        if not low < high:
            raise EntryError("temperature.range", "range_c", low=low, high=high)
        for key, values in (("reference_c", [self.reference_c]), ("held_out_c", self.held_out_c)):
            for value in values:
                if not low <= value <= high:
                    raise EntryError("temperature.outside", key, value=value, low=low, high=high)
        groups = tuple(group for group in GROUPS if not group.endswith("_lever"))
        for key, names in (("order", () if self.order == "auto" else self.order), ("rate_term", self.rate_term)):
            for name in names:
                if name not in groups:
                    raise EntryError("entry.unknown_parameter", key, name=name, remedy=near_miss(name, groups))
        return self

    def model(self) -> TemperatureModel:
        """Return the model for the solvers."""
        order = {} if self.order == "auto" else self.order
        return TemperatureModel(
            self.reference_c,
            self.range_c,
            order,
            frozenset(self.rate_term),
            tuple(self.held_out_c),
            is_automatic=self.order == "auto",
        )
