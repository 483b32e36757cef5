"""Noise of an IMU and a table as the filters use it: spectral densities from the profile's Allan data."""

from dataclasses import dataclass

import numpy as np

from calstation.estimation.context import SolveContext
from calstation.physics.parameters import COUNT, group_indices

INSTABILITY_TIME = 100.0
"""Averaging time (s) at which the random walk that stands in for bias instability meets its Allan floor."""


@dataclass(frozen=True)
class FilterNoise:
    """Process and observation noise.

    rate : angle random walk, rad²/s; force : velocity random walk, (m/s)²/s
    velocity : variance of a velocity observation, (m/s)²; interval : between observations, s
    end_rate : variance of the angular rate at an observation, (rad/s)²
    parameter_walk : growth of the parameters' variances, SI²/s, shape (30,)
    """

    rate: float
    force: float
    velocity: float
    interval: float
    end_rate: float
    parameter_walk: np.ndarray


def filter_noise(context: SolveContext) -> FilterNoise:
    """Noise densities for a filter.

    A count is a uniform error of lsb²/12. A rate output rounds every sample anew: white at the sample rate.
    An increment output carries its remainder on: what stays is one count per observation interval.
    Bias instability B has an Allan floor of 0.664 B (IEEE Std 952-2020, annex C); it enters as the random walk
    K²τ/3 that equals the floor at τ = `INSTABILITY_TIME`.
    """
    imu, table = context.imu, context.table
    interval = table.velocity_interval
    per_count = 1.0 / imu.sample_rate if imu.output == "rate" else 1.0
    rounding_rate = imu.sample_rate if imu.output == "rate" else 1.0 / interval
    gyro_count, accel_count = imu.gyro_lsb * per_count, imu.accel_lsb * per_count
    rate = imu.gyro_arw**2 + gyro_count**2 / 12.0 * rounding_rate
    force = imu.accel_vrw**2 + accel_count**2 / 12.0 * rounding_rate
    walk = np.zeros(COUNT)
    floor = 0.664**2 * 3.0 / INSTABILITY_TIME
    walk[group_indices("gyro_bias")] = floor * imu.gyro_bias_instability**2
    walk[group_indices("accel_bias")] = floor * imu.accel_bias_instability**2
    end_rate = 0.5 * (imu.gyro_arw**2 * imu.sample_rate + (gyro_count * imu.sample_rate) ** 2 / 12.0)
    return FilterNoise(
        rate, force, table.velocity_sigma**2, max(interval, 1.0 / imu.sample_rate), end_rate, walk
    )


def rest_mean_variance(context: SolveContext, duration: float) -> float:
    """Variance (m/s²)² of the specific force of a rest of `duration` s, averaged with `slope_weights`.

    Slope through m + 1 velocities τ apart: 12 σ_v²/(τ² m (m+1) (m+2)); the white force noise's q/τ Σw², which is
    6/5 q/T; and the bias instability.
    """
    noise = filter_noise(context)
    m = max(int(duration / noise.interval + 1e-9), 1)
    size = m * (m + 1) * (m + 2)
    return (
        12.0 * noise.velocity / (noise.interval**2 * size)
        + noise.force / noise.interval * 1.2 * (m * m + 2 * m + 2) / size
        + context.imu.accel_bias_instability**2
    )
