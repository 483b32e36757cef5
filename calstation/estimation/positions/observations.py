"""Rests of a recording as observations: mean outputs with their variances, and their additional scatter.

The profile states the unit's own noise. A hand, a rail or a warming unit adds to it; `Scatter` is this addition,
estimated from the recording, so that the sigmas of the solution hold for it.
"""

from dataclasses import dataclass

import numpy as np

from calstation.estimation.common import (
    SolveContext,
    StageData,
    Stillness,
    chi_square_quantile,
    filter_noise,
    rest_mean_variance,
    slope_weights,
)
from calstation.physics import FloatArray

#: Left out of the rates at the start of a rest, s, because a settling rig still turns.
CREEP = 0.5
#: Probability at which residuals exceed the known noise significantly.
SIGNIFICANT = 0.9995


@dataclass(frozen=True)
class Scatter:
    """Standard deviations beyond the profile's noise."""

    force: float = 0.0  #: Of the mean specific force of a rest, m/s².
    rate: float = 0.0  #: Of the gyro bias from rest to rest, rad/s.
    turn: float = 0.0  #: Of the angle of a motion, rad.

    def near(self, other: "Scatter") -> bool:
        """Whether both agree within 5 %."""
        pairs = ((self.force, other.force), (self.rate, other.rate), (self.turn, other.turn))
        return all(abs(a - b) <= 0.05 * max(a, b) for a, b in pairs)


@dataclass(frozen=True)
class Position:
    """One rest."""

    start: int  #: First sample.
    stop: int  #: The sample after the last.
    time: float  #: IMU time of its middle, s.
    force: FloatArray  #: Mean raw specific force, m/s², shape (3,).
    force_variance: float  #: From the profile, (m/s²)².
    rate: FloatArray  #: Mean raw rate, rad/s, shape (3,).
    rate_variance: float  #: From the profile, (rad/s)².


def positions(data: StageData, still: Stillness, context: SolveContext) -> list[Position]:
    """The rests with their mean outputs."""
    noise = filter_noise(context)
    stride = max(round(noise.interval / data.dt), 1)
    found = []
    for a, b in still.rests:
        duration = (b - a) * data.dt
        begin = a + round(CREEP / data.dt) if duration > 4.0 * CREEP else a
        found.append(
            Position(
                start=a,
                stop=b,
                time=float(0.5 * (data.time[a] + data.time[b - 1])),
                force=slope_weights(b - a, stride) @ data.accel[a:b],
                force_variance=rest_mean_variance(context, duration) - float(noise.bias_drift[3]) ** 2,
                rate=data.gyro[begin:b].mean(axis=0),
                rate_variance=noise.rate / ((b - begin) * data.dt),
            )
        )
    return found


def excess(residual: FloatArray, variance: FloatArray, redundancy: float) -> float:
    """Standard deviation that, added to the noise, brings the squared residuals to their degrees of freedom.

    It is 0 if the known variances explain the residuals or `redundancy`, the degrees of freedom, is below 1.
    """
    total = float(np.sum(residual**2 / variance))
    if redundancy < 1.0 or total <= chi_square_quantile(SIGNIFICANT, redundancy):
        return 0.0
    from scipy.optimize import brentq  # half a second to import, for the few recordings that need it

    most = float(np.sum(residual**2)) / redundancy
    found = brentq(lambda x: float(np.sum(residual**2 / (variance + x))) - redundancy, 0.0, most)
    return float(np.sqrt(found))
