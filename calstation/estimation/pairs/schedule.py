"""Schedule of a cross-calibration: the fitted terms, the trigger and the tolerances."""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from calstation.estimation.pairs.fit import Model, PairChoice
from calstation.schema import EntryError


class Threshold(BaseModel):
    """Largest permitted deviation of a sensor at rest, SI."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    fixed: float = Field(gt=0.0)  #: Threshold from the factory tolerance, also used if no deviation is stored.
    offset: float | None = Field(None, gt=0.0)  #: Difference from the deviation after the last calibration.
    ratio: float | None = Field(None, gt=1.0)  #: Ratio to the deviation after the last calibration, without `offset`.

    @model_validator(mode="after")
    def _check_at_most_one(self) -> "Threshold":
        if self.offset is not None and self.ratio is not None:
            raise EntryError("plan.offset_and_ratio")
        return self

    def limit(self, last: float | None) -> float:
        """Return the threshold, given the deviation after the last calibration."""
        if last is not None and self.offset is not None:
            return last + self.offset
        if last is not None and self.ratio is not None:
            return last * self.ratio
        return self.fixed


class PairSchedule(BaseModel):
    """Fitted terms, trigger and tolerances of a cross-calibration."""

    model_config = ConfigDict(extra="forbid")
    model: Model = "full"  #: "bias", "scale" (bias and scale factors) or "full" (bias and 3×3 matrix).
    lever: bool = True  #: Whether the lever arm is fitted; only with the full model.
    clock_offset: bool = True  #: Whether the clock offset is fitted.
    sensors: Literal["all", "triggering"] = "all"  #: Fitted sensors: all, or only those out of tolerance.
    #: "command" fits the whole recording, "start_up" the data after a check at start-up; "period" repeats the check.
    trigger: Literal["command", "start_up", "period"] = "command"
    period_s: float = Field(3600.0, gt=0.0)  #: Period of the checks in IMU time.
    static_s: float = Field(2.0, ge=1.0, le=600.0)  #: Shortest rest for a check.
    motion_s: float = Field(20.0, ge=1.0, le=3600.0)  #: Duration of motion required for a fit.
    longest_s: float = Field(600.0, ge=10.0)  #: Longest time in which this motion must occur.
    #: A sensor of a secondary is calibrated if the same sensor, or both sensors, of the primary are within tolerance.
    primary_valid: Literal["same_sensor", "both_sensors"] = "same_sensor"
    moving_dps: float = Field(10.0, gt=0.0)  #: Smallest difference from the rate at rest during motion.
    primary_gyro: Threshold = Threshold(fixed=0.01, offset=None, ratio=None)  #: Permitted deviation at rest, rad/s.
    primary_accel: Threshold = Threshold(fixed=0.15, offset=None, ratio=None)  #: Permitted deviation at rest, m/s².
    secondary_gyro: Threshold = Threshold(fixed=0.01, offset=None, ratio=None)  #: Permitted deviation at rest, rad/s.
    secondary_accel: Threshold = Threshold(fixed=0.15, offset=None, ratio=None)  #: Permitted deviation at rest, m/s².

    @model_validator(mode="after")
    def _check_primary_thresholds(self) -> "PairSchedule":
        # a cross-calibration does not change the primary: a threshold relative to the last deviation would follow drift
        for name in ("primary_gyro", "primary_accel"):
            threshold: Threshold = getattr(self, name)
            if threshold.offset is not None or threshold.ratio is not None:
                raise EntryError("plan.primary_threshold", name)
        return self

    @property
    def choice(self) -> PairChoice:
        """Terms to fit."""
        return PairChoice(self.model, self.model, self.lever and self.model == "full", self.clock_offset)

    def threshold(self, unit: Literal["primary", "secondary"], sensor: str) -> Threshold:
        """Return the largest permitted deviation of a sensor at rest."""
        threshold: Threshold = getattr(self, f"{unit}_{sensor}")
        return threshold
