"""Static check of two IMUs: the deviation of each at rest, after compensation, against its threshold.

At rest the specific force is as long as gravity and the rate is earth rate. A secondary is compensated with its stored
error relative to the primary first and then with the primary's own errors, because the stored error refers to the
primary's raw output.
"""

from dataclasses import dataclass

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from calstation.estimation.common import StoredPair
from calstation.physics import PAIR_PARAMETERS, Compensation, FloatArray, compensate
from calstation.schema import EntryError

SENSORS = ("gyro", "accel")


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


@dataclass(frozen=True)
class RestDeviation:
    """Deviation of one sensor at rest and its threshold, rad/s or m/s²."""

    value: float
    limit: float

    @property
    def within(self) -> bool:
        """Whether the deviation is within the threshold."""
        return self.value <= self.limit


@dataclass(frozen=True)
class StaticCheck:
    """Primary and secondary at one rest, by sensor: ``gyro`` and ``accel``."""

    primary: dict[str, RestDeviation]
    secondary: dict[str, RestDeviation]

    @property
    def out_of_tolerance(self) -> tuple[str, ...]:
        """Sensors of the secondary that are out of tolerance while the primary's is within."""
        return tuple(s for s in SENSORS if not self.secondary[s].within and self.primary[s].within)

    @property
    def primary_out_of_tolerance(self) -> tuple[str, ...]:
        """Sensors of the primary that are out of tolerance, so that they are no reference."""
        return tuple(s for s in SENSORS if not self.primary[s].within)


def pair_vector(stored: StoredPair) -> FloatArray:
    """Stored values as the vector of all pair parameters, shape (28,); missing ones are neutral."""
    return np.array([stored.values.get(p.name, p.neutral) for p in PAIR_PARAMETERS])


def _as_primary(pair: FloatArray, gyro2: FloatArray, accel2: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Raw rates that the primary would measure in the secondary's place, each shape (n, 3)."""
    C, A = pair[3:12].reshape(3, 3), pair[15:24].reshape(3, 3)
    omega, force = np.linalg.solve(C, (gyro2 - pair[0:3]).T), np.linalg.solve(A, (accel2 - pair[12:15]).T)
    return np.asarray(omega.T, dtype=np.float64), np.asarray(force.T, dtype=np.float64)


def compensate_secondary(
    pair: FloatArray, c: Compensation, gyro2: FloatArray, accel2: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Rate, rad/s, and specific force, m/s², of a secondary: its stored error removed first, then the primary's own."""
    return compensate(c, *_as_primary(pair, gyro2, accel2))


def static_figures(omega: FloatArray, force: FloatArray, gravity: float) -> dict[str, float]:
    """Deviation of gyro (rad/s) and accelerometer (m/s²) at rest, from means of shape (3,) and gravity in m/s²."""
    return {"gyro": float(np.linalg.norm(omega)), "accel": abs(float(np.linalg.norm(force)) - gravity)}
