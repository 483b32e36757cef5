"""Parameters as functions of the unit's temperature."""

from calstation.estimation.temperature.course import ELEMENT_OF, ELEMENTS, ElementTemperatures, element_temperatures
from calstation.estimation.temperature.equations import LAG_SIGMA
from calstation.estimation.temperature.fit import (
    NO_LAGS,
    HeldOut,
    Polynomials,
    TemperatureFit,
    UpDown,
    WorstOverRange,
    fit_temperature,
    polynomials,
    predicted_covariance,
    with_orders,
)
from calstation.estimation.temperature.points import (
    TemperaturePoint,
    different_temperatures,
    held_out_points,
    nearest_temperature,
    with_ways,
)
from calstation.estimation.temperature.reduction import compensate_each, corrected, parameters_at, reduced
