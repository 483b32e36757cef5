"""Parameters as functions of the unit's temperature."""

from calstation.estimation.temperature.fit import (
    HeldOut,
    TemperatureFit,
    TemperaturePoint,
    UpDown,
    WorstOverRange,
    different_temperatures,
    fit_temperature,
    held_out_points,
    nearest_temperature,
    predicted_covariance,
    with_orders,
)
from calstation.estimation.temperature.reduction import compensate_each, corrected, parameters_at, reduced
