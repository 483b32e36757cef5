"""Schedule of a cross-calibration: what is fitted, when, and the tolerances."""

from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from calstation.estimation.pairs.fit import Model, PairChoice
from calstation.schema import EntryError


class Threshold(BaseModel):
    """Largest deviation of one sensor at rest, SI."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    fixed: float = Field(gt=0.0)  #: From the factory's error; also used while nothing is stored.
    #: The threshold is the deviation right after the last calibration plus this ...
    offset: float | None = Field(None, gt=0.0)
    ratio: float | None = Field(None, gt=1.0)  #: ... or times this; at most one of both.

    @model_validator(mode="after")
    def _one(self) -> "Threshold":
        if self.offset is not None and self.ratio is not None:
            raise EntryError("plan.offset_and_ratio")
        return self

    def limit(self, last: float | None) -> float:
        """The threshold; `last` is the deviation right after the last calibration."""
        if last is not None and self.offset is not None:
            return last + self.offset
        if last is not None and self.ratio is not None:
            return last * self.ratio
        return self.fixed


class PairSchedule(BaseModel):
    """What is fitted, when, and the tolerances."""

    model_config = ConfigDict(extra="forbid")
    model: Model = "full"  #: Bias, scale (scale factors too) or full (3×3).
    lever: bool = True  #: Fitted as well, with the full model only.
    clock_offset: bool = True  #: Fitted as well.
    sensors: Literal["all", "triggering"] = "all"  #: All, or only those that triggered.
    #: Everything recorded is fitted, or what follows a check at start-up, and then every `period_s`.
    trigger: Literal["command", "start_up", "period"] = "command"
    period_s: float = Field(3600.0, gt=0.0)  #: Of IMU time.
    static_s: float = Field(2.0, ge=1.0, le=600.0)  #: Shortest rest to check at.
    motion_s: float = Field(20.0, ge=1.0, le=3600.0)  #: Motion to collect.
    longest_s: float = Field(600.0, ge=10.0)  #: Longest time to collect it.
    moving_dps: float = Field(10.0, gt=0.0)  #: Smallest rate, less that at rest, that counts as motion.
    primary_gyro: Threshold = Threshold(fixed=0.01, offset=None, ratio=None)  #: Largest deviation at rest, rad/s.
    primary_accel: Threshold = Threshold(fixed=0.15, offset=None, ratio=None)  #: The same, m/s².
    secondary_gyro: Threshold = Threshold(fixed=0.01, offset=None, ratio=None)
    secondary_accel: Threshold = Threshold(fixed=0.15, offset=None, ratio=None)

    @property
    def choice(self) -> PairChoice:
        """What is fitted."""
        return PairChoice(self.model, self.model, self.lever and self.model == "full", self.clock_offset)

    @property
    def moving(self) -> float:
        """Smallest rate, less that at rest, that counts as motion, rad/s."""
        return float(np.deg2rad(self.moving_dps))

    def threshold(self, unit: Literal["primary", "secondary"], sensor: str) -> Threshold:
        """Largest deviation of a sensor at rest."""
        found: Threshold = getattr(self, f"{unit}_{sensor}")
        return found
