"""Section ``temperature`` of a result: the parameters as functions of the temperature."""

from collections.abc import Sequence
from typing import Literal

import numpy as np
from pydantic import Field

from calstation.errors import InputError
from calstation.estimation.temperature import TemperatureFit
from calstation.physics import NAMES, PARAMETERS, FloatArray
from calstation.schema import Number, ResultSection


class RateCoefficient(ResultSection):
    """Coefficient of the rate of change of the temperature, per K/s, SI."""

    value: Number
    sigma: Number


class Coefficients(ResultSection):
    """Coefficients of a parameter's polynomial of the temperature relative to the reference, SI per powers of K."""

    values: list[Number]
    sigma: list[Number]
    rate: RateCoefficient | None = None
    unit: str


class WorstValue(ResultSection):
    """Largest magnitude of a parameter over the range with its temperature, °C, and its largest sigma, SI."""

    at_c: float
    value: Number
    sigma: Number


class HeldOutDifference(ResultSection):
    """Difference of a parameter at a temperature, °C, that was not fitted, SI."""

    at_c: float
    parameter: str
    difference: Number
    sigma: Number


class TemperaturePointResult(ResultSection):
    """A temperature, °C, and the samples taken at it."""

    at_c: float
    way: Literal["up", "down", "soak"]
    first_seq: int
    last_seq: int


class TemperatureResult(ResultSection):
    """Parameters as functions of the temperature; `covariance` has the rows of all coefficients in their order."""

    reference_c: float
    range_c: tuple[float, float]
    coefficients: dict[str, Coefficients]
    covariance: list[list[Number]]
    worst: dict[str, WorstValue]
    held_out: list[HeldOutDifference] = Field(default_factory=list)
    points: list[TemperaturePointResult]

    def parameters_at(self, temperature: FloatArray) -> FloatArray:
        """Return the parameters at temperatures of shape (n,), °C, that do not change; SI, shape (n, 30).

        Raises InputError for a temperature outside the range; parameters that were not estimated are 0.
        """
        low, high = self.range_c
        outside = ~((temperature >= low) & (temperature <= high))
        if outside.any():
            value = float(temperature[int(np.argmax(outside))])
            raise InputError("temperature.beyond", value=value, low=low, high=high)
        parameters = np.zeros((len(temperature), len(NAMES)))
        for name, row in self.coefficients.items():
            parameters[:, NAMES.index(name)] = np.polynomial.polynomial.polyval(
                temperature - self.reference_c, [float(value) for value in row.values]
            )
        return parameters

    @property
    def span(self) -> float:
        """Largest distance of a temperature in the range from the reference, K."""
        return max(abs(end - self.reference_c) for end in self.range_c)

    @property
    def terms(self) -> dict[str, float]:
        """Coefficients of the powers of the temperature from 1, by names such as ``gyro_bias_x[1]``, SI."""
        return {
            f"{name}[{k}]": float(value)
            for name, row in self.coefficients.items()
            for k, value in enumerate(row.values)
            if k > 0
        }

    @classmethod
    def of(cls, fit: TemperatureFit, estimated: Sequence[str]) -> "TemperatureResult":
        """Convert the fit of a solution."""
        sigma, rows = np.sqrt(np.diag(fit.covariance)), dict[str, Coefficients]()
        used = [k for k, column in enumerate(fit.model.columns) if NAMES[column.parameter] in estimated]
        for k in used:
            column, size, uncertainty = fit.model.columns[k], float(fit.coefficients[k]), float(sigma[k])
            unit = PARAMETERS[column.parameter].unit
            row = rows.setdefault(NAMES[column.parameter], Coefficients(values=[], sigma=[], unit=unit))
            if column.power is None:
                rate = RateCoefficient(value=size, sigma=uncertainty)
                rows[NAMES[column.parameter]] = row.model_copy(update={"rate": rate})
            else:
                row.values.append(size)
                row.sigma.append(uncertainty)
        worst = {name: fit.worst(name) for name in estimated}
        return cls(
            reference_c=fit.model.reference,
            range_c=fit.model.range,
            coefficients=rows,
            covariance=fit.covariance[np.ix_(used, used)].tolist(),
            worst={name: WorstValue(at_c=w.at, value=w.value, sigma=w.sigma) for name, w in worst.items()},
            held_out=[
                HeldOutDifference(at_c=h.at, parameter=h.parameter, difference=h.difference, sigma=h.sigma)
                for h in fit.held_out(estimated)
            ],
            points=[
                TemperaturePointResult(at_c=p.temperature, way=p.way, first_seq=p.first_seq, last_seq=p.last_seq)
                for p in fit.points
            ],
        )
