"""Least-squares equations of the coefficients and of the lags of gyros and accelerometers behind the sensor."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calstation.estimation.common import Posterior, TemperatureModel
from calstation.estimation.temperature.course import ELEMENT_OF, ELEMENTS
from calstation.estimation.temperature.points import TemperaturePoint
from calstation.physics import FloatArray, group_indices

#: Standard deviation of the lags before the calibration, s.
LAG_SIGMA = 60.0


@dataclass(frozen=True)
class Equations:
    """Observations of all fitted points, and their Jacobian for scaled coefficients, lags and effects in the model."""

    observed: FloatArray  #: Shape (n,).
    jacobian: FloatArray  #: Shape (n, c + 2 + k).
    effects: int  #: Number k of effects.
    points: tuple[tuple[TemperaturePoint, FloatArray], ...]  #: Points and the Jacobians of the parameters.

    def column(self, parameter: int, sizes: FloatArray) -> FloatArray:
        """Return the change of the observations, shape (n,), for changes `sizes`, shape (points,), of a parameter."""
        return np.concatenate([j[:, parameter] * size for (_, j), size in zip(self.points, sizes, strict=True)])

    def columns(self, group: str, sizes: FloatArray) -> FloatArray:
        """Return the changes of the observations, shape (n, k), for changes `sizes` of each parameter of a group."""
        return np.stack([self.column(i, sizes) for i in group_indices(group)], axis=1)


@dataclass(frozen=True)
class Unknowns:
    """Prior of u unknowns: means and sigmas, shape (u,), and joint precision, shape (u, u)."""

    mean: FloatArray
    sigma: FloatArray  #: 0 for a fixed unknown.
    precision: FloatArray

    def updated(self, jacobian: FloatArray, observed: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the unknowns estimated from observations of unit variance, and their covariance."""
        used = np.flatnonzero(self.sigma > 0.0)
        scale = self.sigma[used]
        part = jacobian[:, used] * scale
        information = part.T @ part + self.precision[np.ix_(used, used)] * np.outer(scale, scale)
        covariance = np.zeros_like(self.precision)
        covariance[np.ix_(used, used)] = np.linalg.inv(information) * np.outer(scale, scale)
        return self.mean + covariance @ (jacobian.T @ (observed - jacobian @ self.mean)), covariance

    def with_further(self, mean: FloatArray, sigma: FloatArray) -> "Unknowns":
        """Return the unknowns followed by further, independent unknowns."""
        free = np.where(sigma > 0.0, sigma, np.inf)
        zeros = np.zeros((len(self.sigma), len(sigma)))
        precision = np.block([[self.precision, zeros], [zeros.T, np.diag(free**-2)]])
        return Unknowns(np.append(self.mean, mean), np.append(self.sigma, sigma), precision)


def coefficients_before(model: TemperatureModel, prior: Posterior) -> Unknowns:
    """Return the prior of the coefficients."""
    index = [column.parameter for column in model.columns]
    sigma = prior.sigma[index]
    precision = np.zeros((len(index), len(index)))
    first = [k for k, column in enumerate(model.columns) if column.power == 0 and sigma[k] > 0.0]
    free = [index[k] for k in first]
    precision[np.ix_(first, first)] = np.linalg.inv(prior.covariance[np.ix_(free, free)])
    for k, column in enumerate(model.columns):
        if column.power != 0 and sigma[k] > 0.0:
            precision[k, k] = sigma[k] ** -2
    mean = np.array([prior.mean[c.parameter] if c.power == 0 else 0.0 for c in model.columns])
    return Unknowns(mean, sigma, precision)


def unknowns_before(model: TemperatureModel, prior: Posterior, lags: FloatArray, effects: int) -> Unknowns:
    """Return the prior of all unknowns.

    Parameters
    ----------
    model, prior : as in `coefficients_before`
    lags : assumed lags, s, shape (2,); their corrections follow the coefficients
    effects : number of effects; their sizes in prior sigmas are the last unknowns
    """
    coefficients = coefficients_before(model, prior)
    with_lags = coefficients.with_further(-lags, np.full(len(lags), LAG_SIGMA * model.has_lag))
    return with_lags.with_further(np.zeros(effects), np.ones(effects))


def equations_of(model: TemperatureModel, points: Sequence[TemperaturePoint], prior: Posterior) -> Equations:
    """Return the equations of the points that are not held out, linearised about a fit without the lags."""
    fitted = [(p, *p.observations(prior.sigma)) for p in points if not p.is_held_out]
    observed = np.concatenate([y for _, y, _, _ in fitted])
    jacobian = np.vstack([j @ model.basis(*p.conditions) for p, _, j, _ in fitted])
    coefficients, _ = coefficients_before(model, prior).updated(jacobian, observed)
    lagging = np.vstack([_of_lags(model, p, j, coefficients) for p, _, j, _ in fitted])
    effects = np.vstack([e for _, _, _, e in fitted])
    with_jacobians = tuple((p, j) for p, _, j, _ in fitted)
    return Equations(observed, np.hstack([jacobian, lagging, effects]), effects.shape[1], with_jacobians)


def _of_lags(
    model: TemperatureModel, point: TemperaturePoint, jacobian: FloatArray, coefficients: FloatArray
) -> FloatArray:
    """Return the derivatives of the observations of a point with respect to the lags, 1/s, shape (n, 2)."""
    temperature, rate = point.conditions
    changes = -(model.slopes(temperature) @ coefficients) * rate
    return np.stack([jacobian @ (changes * (k == ELEMENT_OF)) for k in range(len(ELEMENTS))], axis=1)
