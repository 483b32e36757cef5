"""Section ``temperature`` of a result: the parameters as functions of the temperature."""

from collections.abc import Iterable, Sequence
from typing import Literal

import numpy as np
from pydantic import Field

from calstation.errors import InputError
from calstation.estimation.temperature import ELEMENTS, LAG_SIGMA, TemperatureFit, TemperaturePoint, compensate_each
from calstation.physics import (
    NAMES,
    OBSERVABLE,
    PARAMETERS,
    TEMPERATURES,
    BoolArray,
    FloatArray,
    compensate,
    compensation,
    highest_powers,
)
from calstation.schema import Number, ResultSection

#: Number of temperatures among which the largest change over the range is found.
_TEMPERATURES = 101


class RateCoefficient(ResultSection):
    """Coefficient of the rate of change of the temperature, per K/s, SI."""

    value: Number
    sigma: Number


class Coefficients(ResultSection):
    """Coefficients of a parameter's polynomial in the temperature relative to the reference, SI per K^k."""

    values: list[Number]
    sigma: list[Number]
    rate: RateCoefficient | None = None
    unit: str


class LagResult(ResultSection):
    """Time by which the temperature of an element lags behind that of the sensor, s; negative if the sensor lags."""

    value: Number
    sigma: Number


class WorstValue(ResultSection):
    """Largest magnitude of a parameter over the range with its temperature, °C, and its largest sigma, SI."""

    at_c: float
    value: Number
    sigma: Number


class HeldOutDifference(ResultSection):
    """Difference of a parameter from the fit at a held-out temperature, °C, SI."""

    at_c: float
    parameter: str
    difference: Number
    sigma: Number


class TemperaturePointResult(ResultSection):
    """A temperature, °C, the samples taken at it, and the solution of these samples, SI, by parameter.

    The solution contains the parameters that these samples determine, reduced to a constant temperature.
    """

    at_c: float
    way: Literal["up", "down", "soak"]
    first_seq: int
    last_seq: int
    held_out: bool = False
    table_noise: float | None = None  #: Noise of the table relative to its profile; None if unknown.
    values: dict[str, Number] = Field(default_factory=dict)
    sigma: dict[str, Number] = Field(default_factory=dict)

    @classmethod
    def of(cls, fit: TemperatureFit, point: TemperaturePoint, estimated: Sequence[str]) -> "TemperaturePointResult":
        """Convert a point of the fit."""
        at = point.temperature
        moved = fit.at(*point.conditions).mean - fit.at(at).mean
        values, sigma = point.posterior.mean - moved, point.posterior.sigma
        known = [
            i for i, name in enumerate(NAMES) if name in estimated and sigma[i] <= OBSERVABLE * point.prior.sigma[i]
        ]
        return cls(
            at_c=at,
            way=point.way,
            first_seq=point.first_seq,
            last_seq=point.last_seq,
            held_out=point.is_held_out,
            table_noise=point.table_noise,
            values={NAMES[i]: float(values[i]) for i in known},
            sigma={NAMES[i]: float(sigma[i]) for i in known},
        )


class TemperatureResult(ResultSection):
    """Parameters as functions of the temperature; `covariance` is that of all coefficients, in order."""

    reference_c: float
    range_c: tuple[float, float]
    coefficients: dict[str, Coefficients]
    covariance: list[list[Number]]
    worst: dict[str, WorstValue]
    held_out: list[HeldOutDifference] = Field(default_factory=list)
    lag_s: dict[str, LagResult] = Field(default_factory=dict)  #: Determined lags of gyros and accelerometers.
    points: list[TemperaturePointResult]

    def parameters_at(self, temperature: FloatArray) -> FloatArray:
        """Return the parameters at constant temperatures, °C, shape (n,); SI, shape (n, 30).

        Raises InputError for temperatures outside the range; parameters that were not estimated are 0.
        """
        outside = ~self.covers(temperature)
        if outside.any():
            count, (low, high) = int(np.count_nonzero(outside)), self.range_c
            value = float(temperature[int(np.argmax(outside))])
            raise InputError("temperature.beyond", value=value, low=low, high=high, count=count, samples=len(outside))
        parameters = np.zeros((len(temperature), len(NAMES)))
        for name, row in self.coefficients.items():
            parameters[:, NAMES.index(name)] = np.polynomial.polynomial.polyval(
                temperature - self.reference_c, [float(value) for value in row.values]
            )
        return parameters

    def covers(self, temperature: FloatArray) -> BoolArray:
        """Return whether temperatures, °C, are within the range; False for NaN."""
        low, high = self.range_c
        return np.asarray((temperature >= low) & (temperature <= high))

    @property
    def temperatures(self) -> FloatArray:
        """Temperatures over the range, °C."""
        return np.linspace(*self.range_c, _TEMPERATURES)

    def changes(self, temperature: FloatArray) -> FloatArray:
        """Return the differences of the parameters from those at the reference, SI, shape (n, 30).

        Raises InputError for temperatures, °C, shape (n,), outside the range.
        """
        return self.parameters_at(temperature) - self.parameters_at(np.array([self.reference_c]))

    @property
    def largest_changes(self) -> dict[str, float]:
        """Largest difference from the reference over the range, SI, by parameter that depends on the temperature."""
        largest = np.abs(self.changes(self.temperatures)).max(axis=0)
        return {name: float(size) for name, size in zip(NAMES, largest, strict=True) if size > 0.0}

    @property
    def rate_terms(self) -> dict[str, float]:
        """Coefficients of the rate of change of the temperature by parameter, per K/s, SI."""
        return {name: float(row.rate.value) for name, row in self.coefficients.items() if row.rate is not None}

    def curve(self, name: str, temperature: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the values of a parameter at temperatures, °C, shape (n,), and their sigmas, SI, shape (n,) each."""
        first = 0
        for other, row in self.coefficients.items():
            if other == name:
                powers = np.vander(temperature - self.reference_c, len(row.values), increasing=True)
                part = slice(first, first + len(row.values))
                covariance = np.array(self.covariance, dtype=np.float64)[part, part]
                variance = np.einsum("ni,ij,nj->n", powers, covariance, powers)
                return powers @ np.array(row.values), np.sqrt(np.maximum(variance, 0.0))
            first += len(row.values) + (row.rate is not None)
        raise KeyError(name)

    def fits(self, names: Iterable[str]) -> bool:
        """Return whether registers with these names can store all polynomial coefficients of their parameters."""
        highest = highest_powers(names)
        return all(len(row.values) - 1 <= highest[name] for name, row in self.coefficients.items() if name in highest)

    @property
    def registers(self) -> dict[str, float]:
        """Coefficients of the powers from 1 on, and reference and range, °C, by register name."""
        terms = {
            f"{name}[{k}]": float(value)
            for name, row in self.coefficients.items()
            for k, value in enumerate(row.values)
            if k > 0
        }
        return terms | dict(zip(TEMPERATURES, (self.reference_c, *self.range_c), strict=True))

    @classmethod
    def of(cls, fit: TemperatureFit, estimated: Sequence[str], at_reference: FloatArray) -> "TemperatureResult":
        """Convert the fit of a solution.

        Parameters
        ----------
        fit : parameters over temperature
        estimated : names of the parameters
        at_reference : covariance of the parameters at the reference, SI, shape (30, 30), with the uncertainty of
            gravity, which is the same at all temperatures and is not part of the fit
        """
        common = at_reference - fit.at(fit.model.reference).covariance
        first = [k for k, column in enumerate(fit.model.columns) if column.power == 0]
        index = [fit.model.columns[k].parameter for k in first]
        covariance = fit.covariance.copy()
        covariance[np.ix_(first, first)] += common[np.ix_(index, index)]
        sigma, rows = np.sqrt(np.diag(covariance)), dict[str, Coefficients]()
        used = [k for k, column in enumerate(fit.model.columns) if NAMES[column.parameter] in estimated]
        for k in used:
            column, size, uncertainty = fit.model.columns[k], float(fit.coefficients[k]), float(sigma[k])
            unit = PARAMETERS[column.parameter].unit
            row = rows.setdefault(NAMES[column.parameter], Coefficients(values=[], sigma=[], rate=None, unit=unit))
            if column.power is None:
                rate = RateCoefficient(value=size, sigma=uncertainty)
                rows[NAMES[column.parameter]] = row.model_copy(update={"rate": rate})
            else:
                row.values.append(size)
                row.sigma.append(uncertainty)
        worst = {name: fit.worst(name) for name in estimated}
        largest = np.sqrt(fit.largest_sigma**2 + np.maximum(np.diag(common), 0.0))
        return cls(
            reference_c=fit.model.reference,
            range_c=fit.model.range,
            coefficients=rows,
            covariance=covariance[np.ix_(used, used)].tolist(),
            worst={
                n: WorstValue(at_c=w.at, value=w.value, sigma=float(largest[NAMES.index(n)])) for n, w in worst.items()
            },
            held_out=[
                HeldOutDifference(at_c=h.at, parameter=h.parameter, difference=h.difference, sigma=h.sigma)
                for h in fit.held_out(estimated)
            ],
            lag_s={
                element: LagResult(value=float(lag), sigma=float(uncertainty))
                for element, lag, uncertainty in zip(ELEMENTS, fit.lags, fit.lag_sigmas, strict=True)
                if 0.0 < uncertainty < OBSERVABLE * LAG_SIGMA
            },
            points=[TemperaturePointResult.of(fit, point, estimated) for point in fit.points],
        )


def known_temperatures(temperature: FloatArray) -> FloatArray:
    """Return temperatures, °C, shape (n,), with NaN replaced by linear interpolation.

    Raises InputError if all are NaN.
    """
    known = np.flatnonzero(~np.isnan(temperature))
    if not len(known):
        raise InputError("temperature.no_column")
    return np.interp(np.arange(len(temperature)), known, temperature[known])


def compensate_samples(
    parameters: FloatArray,
    over: TemperatureResult | None,
    gyro: FloatArray,
    accel: FloatArray,
    temperature: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return angular rate, rad/s, and specific force, m/s², at the reference point, shape (n, 3).

    Raises InputError for temperatures outside the range.

    Parameters
    ----------
    parameters : parameters, at the reference temperature if they depend on it, SI, shape (30,)
    over : parameters over temperature; None if they are constant
    gyro, accel : output, rad/s and m/s², shape (n, 3)
    temperature : temperature of the unit, °C, shape (n,); not used if the parameters are constant
    """
    if over is None:
        return compensate(compensation(parameters), gyro, accel)
    return compensate_each(gyro, accel, parameters + over.changes(temperature))
