"""Parameters as polynomials of the unit's temperature, with a term in its rate of change."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from calstation.physics import COUNT, PARAMETERS, FloatArray

#: Number of temperatures at which the largest value and sigma over a range are searched.
_TEMPERATURES = 101


@dataclass(frozen=True)
class Column:
    """One coefficient: it multiplies a power of the temperature relative to the reference, or its rate of change."""

    parameter: int  #: Index of the parameter.
    power: int | None  #: None for the term in the rate of change.


@dataclass(frozen=True)
class TemperatureModel:
    """Orders of the polynomials, and the temperatures for which they hold, °C."""

    reference: float
    range: tuple[float, float]
    order: Mapping[str, int] = field(default_factory=dict)  #: Order by group; 0 for other groups.
    rate_term: frozenset[str] = frozenset()  #: Groups with a term in the rate of change.
    held_out: tuple[float, ...] = ()  #: Temperatures that are measured and compared, but not fitted.
    is_automatic: bool = False  #: Whether the data determine the orders of the groups without one.

    @cached_property
    def columns(self) -> tuple[Column, ...]:
        """All coefficients, those of a parameter in order of their powers."""
        columns = []
        for i, parameter in enumerate(PARAMETERS):
            powers: list[int | None] = [*range(self.order.get(parameter.group, 0) + 1)]
            columns += [Column(i, power) for power in powers + [None] * (parameter.group in self.rate_term)]
        return tuple(columns)

    @property
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

    def basis(self, temperature: float, rate: float = 0.0) -> FloatArray:
        """Return the parameters per unit of each scaled coefficient, shape (30, columns).

        A coefficient of a power k is scaled by `span` to the power k, that of the rate of change, K/s, by 1 K/min.
        """
        basis, x = np.zeros((COUNT, len(self.columns))), (temperature - self.reference) / self.span
        for k, column in enumerate(self.columns):
            basis[column.parameter, k] = 60.0 * rate if column.power is None else x**column.power
        return basis

    @property
    def scale(self) -> FloatArray:
        """Factors from scaled coefficients to those per K and per K/s, shape (columns,)."""
        return np.array([60.0 if c.power is None else self.span**-c.power for c in self.columns])
