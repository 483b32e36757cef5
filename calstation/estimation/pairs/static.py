"""The static check of two IMUs: what each shows at rest, after compensation, against its own threshold.

At rest the specific force is as long as gravity and the rate is nothing but the earth's. A secondary is compensated
with its stored error against the primary first and then with the primary's own errors: in that order, because the
stored error was found from the primary's raw output.
"""

from dataclasses import dataclass

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from calstation.estimation.common.context import StoredPair
from calstation.physics.arrays import FloatArray
from calstation.physics.imu_model import Compensation, compensate
from calstation.physics.parameters import PAIR_PARAMETERS

SENSORS = ("gyro", "accel")


class Threshold(BaseModel):
    """How much one sensor may show at rest, SI.

    fixed : from the factory's error; also where nothing is stored yet
    offset, ratio : at most one: the threshold follows what the sensor showed right after its last calibration, plus
        `offset` or times `ratio`
    """

    model_config = ConfigDict(extra="forbid", frozen=True)
    fixed: float = Field(gt=0.0)
    offset: float | None = Field(None, gt=0.0)
    ratio: float | None = Field(None, gt=1.0)

    @model_validator(mode="after")
    def _one(self) -> "Threshold":
        if self.offset is not None and self.ratio is not None:
            raise ValueError("offset and ratio exclude each other; remove one")
        return self

    def limit(self, last: float | None) -> float:
        """The threshold, `last` being what the sensor showed after its last calibration."""
        if last is not None and self.offset is not None:
            return last + self.offset
        if last is not None and self.ratio is not None:
            return last * self.ratio
        return self.fixed


@dataclass(frozen=True)
class RestDeviation:
    """What one sensor shows at rest beyond what it should, and its threshold: rad/s or m/s²."""

    value: float
    limit: float

    @property
    def within(self) -> bool:
        """Whether the sensor is as good as its threshold asks."""
        return self.value <= self.limit


@dataclass(frozen=True)
class StaticCheck:
    """Primary and secondary at one rest, by sensor: ``gyro`` and ``accel``."""

    primary: dict[str, RestDeviation]
    secondary: dict[str, RestDeviation]

    @property
    def off(self) -> tuple[str, ...]:
        """Sensors of the secondary that are off while the primary's is not: those that can be calibrated."""
        return tuple(s for s in SENSORS if not self.secondary[s].within and self.primary[s].within)

    @property
    def doubtful(self) -> tuple[str, ...]:
        """Sensors of the primary that are off: nothing can be measured against them."""
        return tuple(s for s in SENSORS if not self.primary[s].within)


def pair_vector(stored: StoredPair) -> FloatArray:
    """Stored values as the vector of all pair parameters, shape (28,), neutral where nothing is stored."""
    return np.array([stored.values.get(p.name, p.neutral) for p in PAIR_PARAMETERS])


def as_primary(pair: FloatArray, gyro2: FloatArray, accel2: FloatArray) -> tuple[FloatArray, FloatArray]:
    """What the primary would measure in the secondary's place, from the secondary's raw rates, each shape (n, 3)."""
    C, A = pair[3:12].reshape(3, 3), pair[15:24].reshape(3, 3)
    omega, force = np.linalg.solve(C, (gyro2 - pair[0:3]).T), np.linalg.solve(A, (accel2 - pair[12:15]).T)
    return np.asarray(omega.T, dtype=np.float64), np.asarray(force.T, dtype=np.float64)


def compensate_secondary(
    pair: FloatArray, c: Compensation, gyro2: FloatArray, accel2: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Rate (rad/s) and specific force (m/s²) from a secondary's raw rates: stored error, then the primary's own."""
    return compensate(c, *as_primary(pair, gyro2, accel2))


def static_figures(omega: FloatArray, force: FloatArray, gravity: float) -> dict[str, float]:
    """What gyro (rad/s) and accelerometer (m/s²) show at rest beyond what they should, from means, shape (3,)."""
    return {
        "gyro": float(np.linalg.norm(omega)),
        "accel": abs(float(np.linalg.norm(force)) - gravity),
    }
