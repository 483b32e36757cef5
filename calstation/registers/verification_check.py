"""One comparison of a proof, and the noise that all of them allow for."""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from calstation.estimation.common.context import ImuModel, SolveContext

#: Off by more than this many standard deviations is wrong: noise reaches it once in 10^8 times.
SIGMAS = 6.0

#: Bias instabilities that a bias may have wandered since it was found.
WANDER = 3.0


@dataclass(frozen=True)
class VerificationCheck:
    """One comparison: what was measured, what was expected, and how far they may be apart, SI."""

    name: str
    value: float
    expected: float
    tolerance: float
    unit: str

    @property
    def passed(self) -> bool:
        """Whether the two agree; what is no number does not."""
        return abs(self.value - self.expected) <= self.tolerance

    def to_json(self) -> dict[str, Any]:
        """As a result holds it."""
        return {**asdict(self), "passed": self.passed}


def rate_noise(imu: ImuModel, seconds: float) -> float:
    """Sigma of one axis of `mean_at_rest` of the gyro, rad/s: 6/5 of a plain mean's variance."""
    return float(imu.gyro_arw * np.sqrt(1.2 / seconds))


def force_noise(context: SolveContext, seconds: float) -> float:
    """Sigma of one axis of `mean_at_rest` of the accelerometer, m/s².

    Its own noise as the gyro's, and the base's vibration: the slope of a line through velocities of the sigma that the
    table's profile states, as many as it says, σ √12 / (T √n).
    """
    imu, table = context.imu, context.table
    count = seconds / table.velocity_interval
    vibration = table.velocity_sigma * np.sqrt(12.0 / count) / seconds
    return float(np.hypot(imu.accel_vrw * np.sqrt(1.2 / seconds), vibration))
