"""Parameters as polynomials of the unit's temperature, with a term in its rate of change."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from calstation.physics import COUNT, PARAMETERS, FloatArray

#: Number of temperatures among which the largest value and sigma over a range are found.
_TEMPERATURES = 101


@dataclass(frozen=True)
class Column:
    """Coefficient of a power of the temperature relative to the reference, or of its rate of change."""

    parameter: int  #: Index of the parameter.
    power: int | None  #: None for the term in the rate of change.


@dataclass(frozen=True)
class TemperatureModel:
    """Orders of the polynomials, and their reference temperature and range of validity, °C."""

    reference: float
    range: tuple[float, float]
    order: Mapping[str, int] = field(default_factory=dict)  #: Order by group; 0 for other groups.
    rate_term: frozenset[str] = frozenset()  #: Groups with a term in the rate of change.
    held_out: tuple[float, ...] = ()  #: Temperatures that are measured and compared, but not fitted.
    is_automatic: bool = False  #: Whether the data determine the orders of groups that are not in `order`.
    has_lag: bool = False  #: Whether the temperatures of gyros and accelerometers lag behind that of the sensor.

    @cached_property
    def columns(self) -> tuple[Column, ...]:
        """All coefficients, those of a parameter in order of their powers."""
        columns = []
        for i, parameter in enumerate(PARAMETERS):
            powers: list[int | None] = [*range(self.order.get(parameter.group, 0) + 1)]
            columns += [Column(i, power) for power in powers + [None] * (parameter.group in self.rate_term)]
        return tuple(columns)

    @cached_property
    def span(self) -> float:
        """Largest distance of a temperature in the range from the reference, K, by which coefficients are scaled."""
        return max(abs(end - self.reference) for end in self.range)

    @property
    def temperatures(self) -> FloatArray:
        """Temperatures over the range, °C."""
        return np.linspace(*self.range, _TEMPERATURES)

    def with_order(self, group: str, order: int) -> "TemperatureModel":
        """Return the model with another order of a group."""
        return replace(self, order={**self.order, group: order})

    def basis(self, temperature: float | FloatArray, rate: float | FloatArray = 0.0) -> FloatArray:
        """Return the parameters per unit of each scaled coefficient, shape (30, columns).

        The coefficient of power k is scaled by `span` to the power k, and that of the rate of change by 1 K/min.

        Parameters
        ----------
        temperature : temperature, °C, or that of each parameter, shape (30,)
        rate : its rate of change, K/s, or that of each parameter, shape (30,)
        """
        x = np.broadcast_to((temperature - self.reference) / self.span, COUNT)
        rates, basis = np.broadcast_to(60.0 * rate, COUNT), np.zeros((COUNT, len(self.columns)))
        for k, column in enumerate(self.columns):
            i = column.parameter
            basis[i, k] = rates[i] if column.power is None else x[i] ** column.power
        return basis

    def slopes(self, temperature: float | FloatArray) -> FloatArray:
        """Return the derivative of `basis` with respect to the temperature, 1/K, shape (30, columns)."""
        x = np.broadcast_to((temperature - self.reference) / self.span, COUNT)
        slopes = np.zeros((COUNT, len(self.columns)))
        for k, column in enumerate(self.columns):
            if column.power:
                slopes[column.parameter, k] = column.power * x[column.parameter] ** (column.power - 1) / self.span
        return slopes

    @property
    def scale(self) -> FloatArray:
        """Factors from scaled coefficients to those per K^k and per K/s, shape (columns,)."""
        return np.array([60.0 if c.power is None else self.span**-c.power for c in self.columns])
