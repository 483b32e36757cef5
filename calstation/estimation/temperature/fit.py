"""Least-squares fit of the coefficients to solutions at several temperatures, and the tests of this fit.

Every solution contributes the information of its data as decorrelated observations of unit variance. The tests add
columns to the fit: a higher order, a difference between rising and falling temperature, a change with time, and a term
in the rate of change of the temperature. The columns that explain most of the residual are the cause, unless they
explain no more of the residual of their group than of scatter, according to an F test. A difference between rising and
falling temperature is tested separately (`up_down`) and is removed from the residuals of the other tests.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import chdtrc, fdtrc

from calstation.estimation.common import Consistency, Diagnosis, ModelTest, Posterior, TemperatureModel, nis_consistency
from calstation.estimation.effects import MAX_EXCESS
from calstation.estimation.temperature.course import ELEMENTS
from calstation.estimation.temperature.equations import Equations, Unknowns, equations_of, unknowns_before
from calstation.estimation.temperature.hysteresis import fit_with_hysteresis
from calstation.estimation.temperature.points import TemperaturePoint, different_temperatures
from calstation.physics import COUNT, GROUPS, NAMES, PARAMETERS, FloatArray, group_indices

#: Largest difference at a held-out temperature, in sigmas; noise of any of 30 parameters exceeds it in 1 of 60,000
#: runs.
HELD_OUT_SIGMAS = 5.0
#: Highest order of a polynomial.
_HIGHEST = 6
#: Smallest number of temperatures in each direction at which hysteresis is tested.
_MIN_OF_WAY = 2
#: Largest rate of change of the temperature after a soak, K/min, up to which an error with the sign of the rate is a
#: hysteresis, not an effect of the rate.
_STEADY_RATE = 0.2
#: Smallest probability of remaining residuals that are attributed to noise.
_REMAINING_PROBABILITY = 0.01
#: Largest probability of attributing scatter to a cause.
_SCATTER_PROBABILITY = 0.005
_HYSTERESIS = "temperature_hysteresis"
#: Lags of elements that have the temperature of the sensor.
NO_LAGS = np.zeros(len(ELEMENTS))


@dataclass(frozen=True)
class WorstOverRange:
    """Largest magnitude and largest sigma of a parameter over the range, SI."""

    at: float  #: Temperature of the largest magnitude, °C.
    value: float
    sigma: float  #: Largest sigma, at any temperature.


@dataclass(frozen=True)
class HeldOut:
    """Difference of a parameter measured at a held-out temperature from the fit, and its sigma, SI."""

    at: float
    parameter: str
    difference: float
    sigma: float


@dataclass(frozen=True)
class UpDown:
    """Difference of a parameter between rising and falling temperature, and its sigma, SI."""

    parameter: str
    difference: float
    sigma: float


@dataclass(frozen=True)
class Polynomials:
    """Coefficients with their joint covariance, and the lags of gyros and accelerometers."""

    model: TemperatureModel
    scaled: FloatArray  #: Scaled coefficients, see `TemperatureModel.basis`, shape (c,).
    scaled_covariance: FloatArray  #: Shape (c, c).
    lags: FloatArray  #: Lags of gyros and accelerometers behind the sensor, s, shape (2,).
    lag_sigmas: FloatArray  #: Shape (2,).

    def at(self, temperature: float | FloatArray, rate: float | FloatArray = 0.0) -> Posterior:
        """Return the parameters at a temperature of their elements, °C, that changes by `rate`, K/s.

        Both can be those of each parameter, shape (30,).
        """
        basis = self.model.basis(temperature, rate)
        return Posterior(basis @ self.scaled, basis @ self.scaled_covariance @ basis.T)

    @property
    def coefficients(self) -> FloatArray:
        """Coefficients per K and per K/s, SI, shape (c,)."""
        return self.model.scale * self.scaled

    @property
    def covariance(self) -> FloatArray:
        """Covariance of `coefficients`, shape (c, c)."""
        return np.outer(self.model.scale, self.model.scale) * self.scaled_covariance

    @cached_property
    def _over_range(self) -> tuple[FloatArray, FloatArray]:
        """Parameters and their sigmas at the temperatures of the range, shape (n, 30) each."""
        parameters = [self.at(t) for t in self.model.temperatures]
        return np.array([p.mean for p in parameters]), np.array([p.sigma for p in parameters])

    @property
    def largest_sigma(self) -> FloatArray:
        """Largest sigma of each parameter over the range, SI, shape (30,)."""
        return np.asarray(self._over_range[1].max(axis=0))

    def worst(self, name: str, middle: float = 0.0) -> WorstOverRange:
        """Return the value of a parameter farthest from `middle` over the range, and its largest sigma."""
        i, (means, sigmas) = NAMES.index(name), self._over_range
        k = int(np.abs(means[:, i] - middle).argmax())
        return WorstOverRange(float(self.model.temperatures[k]), float(means[k, i]), float(sigmas[:, i].max()))


@dataclass(frozen=True)
class TemperatureFit(Polynomials):
    """The fit of all points, and its tests."""

    points: tuple[TemperaturePoint, ...]  #: With the effects in the model.
    effects: FloatArray  #: Sizes of the effects in the model, in prior sigmas, shape (k,).
    consistency: Consistency  #: Test of the residuals of the fitted points.
    test: ModelTest
    hysteresis: FloatArray  #: Part of the sigmas of the parameters due to hysteresis, SI, shape (30,).
    #: Differences of the parameters whose group has a hysteresis, or of all parameters if no group has one; empty if
    #: the temperature did not rise and fall often enough, or if another cause than hysteresis fails the test.
    up_down: tuple[UpDown, ...] = ()

    @property
    def without_hysteresis(self) -> Polynomials:
        """Polynomials without the variance of the hysteresis in use."""
        covariance = self.scaled_covariance
        without = covariance - _of_constants(self.model, np.diag(covariance), self.hysteresis)
        return Polynomials(self.model, self.scaled, without, self.lags, self.lag_sigmas)

    def held_out(self, estimated: Sequence[str]) -> list[HeldOut]:
        """Return the differences at the held-out temperatures."""
        rows = []
        for point in (p for p in self.points if p.is_held_out):
            fitted = self.at(*point.conditions)
            sigma = np.sqrt(np.diag(point.posterior.covariance + fitted.covariance))
            difference = point.posterior.mean - fitted.mean
            rows += [
                HeldOut(point.temperature, name, float(difference[i]), float(sigma[i]))
                for i, name in enumerate(NAMES)
                if name in estimated
            ]
        return rows

    def held_out_test(self, estimated: Sequence[str]) -> ModelTest | None:
        """Return the test of the largest difference at a held-out temperature; None if there is none."""
        rows = [row for row in self.held_out(estimated) if row.sigma > 0.0]
        if not rows:
            return None
        worst = max(rows, key=lambda row: abs(row.difference) / row.sigma)
        i = NAMES.index(worst.parameter)
        values = {"parameter": worst.parameter, "at_c": worst.at}
        diagnosis = Diagnosis("held_out_unlike", worst.difference, worst.sigma, PARAMETERS[i].unit, values=values)
        return ModelTest("held_out", abs(worst.difference) / worst.sigma, HELD_OUT_SIGMAS, "sigma", diagnosis)


def polynomials(
    model: TemperatureModel, points: Sequence[TemperaturePoint], prior: Posterior, lags: FloatArray = NO_LAGS
) -> Polynomials:
    """Fit the coefficients and correct the lags, using the points that are not held out.

    Parameters
    ----------
    model : orders of the polynomials
    points : solutions in order of time, whose information is independent
    prior : parameters at the reference before the calibration; its sigmas also bound the changes over the range
    lags : lags with which the temperatures of the points were computed, s, shape (2,)
    """
    equations = equations_of(model, points, prior)
    before = unknowns_before(model, prior, lags, equations.effects)
    return _solved(model, *before.updated(equations.jacobian, equations.observed), lags)


def _solved(model: TemperatureModel, mean: FloatArray, covariance: FloatArray, lags: FloatArray) -> Polynomials:
    count, of_lags = len(model.columns), slice(len(model.columns), len(model.columns) + len(lags))
    sigmas = np.sqrt(np.diag(covariance)[of_lags])
    return Polynomials(model, mean[:count], covariance[:count, :count], lags + mean[of_lags], sigmas)


def fit_temperature(
    model: TemperatureModel,
    points: Sequence[TemperaturePoint],
    prior: Posterior,
    lags: FloatArray = NO_LAGS,
    instability: FloatArray | None = None,
) -> TemperatureFit:
    """Fit the coefficients as `polynomials` does, and test the fit.

    The covariance of the constant coefficients includes the hysteresis, whose sense is unknown in use, and the bias
    instability, which the number of points does not reduce.

    Parameters
    ----------
    model, points, prior, lags : see `polynomials`
    instability : sigmas of the parameters due to bias instability, SI, shape (30,)
    """
    equations = equations_of(model, points, prior)
    before = unknowns_before(model, prior, lags, equations.effects)
    consistency, test, hysteretic = _tested(model, equations, before.sigma)
    mean, covariance, hysteresis = _with_hysteresis(model, equations, before, points)
    if instability is not None:
        covariance = covariance + _of_constants(model, before.sigma, instability)
    groups, first = hysteretic or (GROUPS if test.passed else ()), len(before.mean) - equations.effects
    return TemperatureFit(
        **vars(_solved(model, mean, covariance, lags)),
        points=tuple(p.with_effects(mean[first:], covariance[first:, first:]) for p in points),
        effects=mean[first:],
        consistency=consistency,
        test=test,
        hysteresis=hysteresis,
        up_down=_up_down(equations, before, prior, groups),
    )


def predicted_covariance(model: TemperatureModel, points: Sequence[TemperaturePoint], prior: Posterior) -> FloatArray:
    """Return the covariance of the scaled coefficients after a fit to points, shape (c, c); see `fit_temperature`."""
    equations = equations_of(model, points, prior)
    before = unknowns_before(model, prior, NO_LAGS, equations.effects)
    _, covariance, _ = _with_hysteresis(model, equations, before, points, is_planned=True)
    return covariance[: len(model.columns), : len(model.columns)]


def _with_hysteresis(
    model: TemperatureModel,
    equations: Equations,
    before: Unknowns,
    points: Sequence[TemperaturePoint],
    *,
    is_planned: bool = False,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the unknowns of a fit, their covariance, and the rms of the hysteresis, SI, shape (30,).

    The covariance includes the uncertainty due to the hysteresis during the calibration and, in the constant
    coefficients, the hysteresis in use. Hysteresis is fitted only if the temperature rises and falls repeatedly.

    Parameters
    ----------
    model : orders of the polynomials
    equations : observations
    before : unknowns before the fit
    points : all points, in order of time
    is_planned : see `fit_with_hysteresis`
    """
    if _ways(equations) is None:
        return (*before.updated(equations.jacobian, equations.observed), np.zeros(COUNT))
    mean, covariance, rms = fit_with_hysteresis(equations, before, points, is_planned=is_planned)
    return mean, covariance + _of_constants(model, before.sigma, rms), rms


def _of_constants(model: TemperatureModel, before: FloatArray, sigmas: FloatArray) -> FloatArray:
    """Return the covariance of unknowns due to independent errors of the parameters at all temperatures, shape (u, u).

    Parameters
    ----------
    model : orders of the polynomials
    before : sigmas of the unknowns before the fit, shape (u,)
    sigmas : sigmas of the errors, SI, shape (30,)
    """
    variances = np.zeros(len(before))
    for k, column in enumerate(model.columns):
        if column.power == 0 and before[k] > 0.0:
            variances[k] = sigmas[column.parameter] ** 2
    return np.diag(variances)


def _up_down(equations: Equations, before: Unknowns, prior: Posterior, groups: Sequence[str]) -> tuple[UpDown, ...]:
    """Return the differences between rising and falling temperature of all parameters in groups, fitted jointly.

    Parameters
    ----------
    equations : observations
    before : coefficients before the fit
    prior : parameters before the calibration, whose sigmas bound the differences
    groups : groups with a difference
    """
    ways = _ways(equations)
    if ways is None or not groups:
        return ()
    index = np.concatenate([group_indices(group) for group in groups])
    added = [_hysteresis_columns(equations, group, ways) for group in groups]
    columns = [*(begin for begin, _ in added), *(difference for _, difference in added)]
    before = before.with_further(np.zeros(2 * len(index)), np.tile(prior.sigma[index], 2))
    mean, covariance = before.updated(np.hstack([equations.jacobian, *columns]), equations.observed)
    sigma = np.sqrt(np.diag(covariance))[-len(index) :]
    return tuple(
        UpDown(NAMES[i], float(d), float(s))
        for i, d, s in zip(index, mean[-len(index) :], sigma, strict=True)
        if s > 0.0
    )


def with_orders(model: TemperatureModel, points: Sequence[TemperaturePoint], prior: Posterior) -> TemperatureModel:
    """Return the model with the orders that the data support, group by group, from 0.

    An order is increased while this lowers the Bayesian information criterion. One further order, if the temperatures
    determine it, covers terms that are not significant, but not small relative to the sigmas. Groups with an order in
    the model keep it, and lever arms do not depend on the temperature.
    """
    fitted, chosen = [p for p in points if not p.is_held_out], model
    highest = min(different_temperatures(fitted) - 1, _HIGHEST)
    free = [g for g in GROUPS if not (g in model.order or g.endswith("_lever")) and prior.sigma[group_indices(g)].any()]
    equations = equations_of(model, points, prior)
    before = unknowns_before(model, prior, NO_LAGS, equations.effects)
    projector = _Projector(equations.jacobian[:, before.sigma > 0.0])
    while True:
        gains, added = dict[str, float](), dict[str, FloatArray]()
        for group in free:
            if chosen.order.get(group, 0) < highest:
                added[group] = _next_order(chosen, equations, group)
                gain, _ = projector.explained(equations.observed, added[group])
                gains[group] = gain - added[group].shape[1] * np.log(max(len(equations.observed), 2))
        best = max(gains, key=lambda group: gains[group], default=None)
        if best is None or gains[best] <= 0.0:
            break
        projector.extend(added[best])
        chosen = chosen.with_order(best, chosen.order.get(best, 0) + 1)
    for group in free:
        chosen = chosen.with_order(group, min(chosen.order.get(group, 0) + 1, highest))
    return chosen


class _Projector:
    """Removes the part of observations that the columns of a Jacobian explain."""

    def __init__(self, jacobian: FloatArray) -> None:
        norms = np.linalg.norm(jacobian, axis=0)
        scaled = jacobian[:, norms > 0.0] / norms[norms > 0.0]
        u, values, _ = np.linalg.svd(scaled, full_matrices=False)
        self._basis = u[:, values > 1e-10 * values.max(initial=0.0)]
        self.freedom = len(jacobian) - self._basis.shape[1]

    def remaining(self, observed: FloatArray) -> FloatArray:
        """Return the residual."""
        return np.asarray(observed - self._basis @ (self._basis.T @ observed))

    def extend(self, added: FloatArray) -> None:
        """Also remove the part that further columns explain."""
        self._basis = np.hstack([self._basis, self._basis_of(added)])

    def explained(self, observed: FloatArray, added: FloatArray) -> tuple[float, int]:
        """Return the decrease of the sum of squares due to further columns, shape (n, k), and the rank they add."""
        kept = self._basis_of(added)
        return float(np.sum((kept.T @ observed) ** 2)), kept.shape[1]

    def _basis_of(self, added: FloatArray) -> FloatArray:
        """Return an orthonormal basis of the directions that further columns add, shape (n, at most k)."""
        columns = self.remaining(added)
        u, values, _ = np.linalg.svd(columns / np.maximum(np.linalg.norm(added, axis=0), 1e-300), full_matrices=False)
        return np.asarray(u[:, values > 1e-8])


@dataclass(frozen=True)
class _Candidate:
    """A possible cause of the residuals of a group."""

    cause: str
    group: str
    excess: float  #: Decrease of χ² minus the number of columns.
    is_scatter: bool  #: Whether the columns explain no more than they would of scatter.


def _tested(
    model: TemperatureModel, equations: Equations, sigma: FloatArray
) -> tuple[Consistency, ModelTest, tuple[str, ...]]:
    """Return the test of the residuals, the test of the likeliest cause, and the groups with a hysteresis.

    Hysteresis is removed from the residuals before the tests. Residuals that are too large without a cause fail the
    second test as scatter.
    """
    jacobian = equations.jacobian[:, sigma > 0.0] * sigma[sigma > 0.0]
    hysteretic, ways = tuple[str, ...](), _ways(equations)
    while ways is not None:
        candidates = _candidates(model, equations, _Projector(jacobian), ways)
        best = max(candidates, key=lambda candidate: candidate.excess)
        if best.cause != _HYSTERESIS or best.excess <= MAX_EXCESS or best.is_scatter:
            break
        hysteretic = (*hysteretic, best.group)
        jacobian = np.hstack([jacobian, *_hysteresis_columns(equations, best.group, ways)])
    projector = _Projector(jacobian)
    likeliest = max(_candidates(model, equations, projector, None), key=lambda candidate: candidate.excess)
    group = likeliest.group
    values = {"group": group} if likeliest.is_scatter else {"group": group, "order": model.order.get(group, 0)}
    diagnosis = Diagnosis("temperature_scatter" if likeliest.is_scatter else likeliest.cause, values=values)
    test = ModelTest("temperature_fit", likeliest.excess, MAX_EXCESS, "1", diagnosis)
    total = float(np.sum(projector.remaining(equations.observed) ** 2))
    consistency = nis_consistency(total, projector.freedom, 1)
    if test.passed and consistency.nis_mean > consistency.nis_high:
        largest, most = consistency.nis_high * projector.freedom, _most_scattered(equations, projector)
        test = ModelTest(
            "temperature_fit", total, largest, "1", Diagnosis("temperature_scatter", values={"group": most})
        )
    return consistency, test, hysteretic


def _candidates(
    model: TemperatureModel, equations: Equations, projector: _Projector, ways: FloatArray | None
) -> Iterator[_Candidate]:
    """Yield the possible causes of the residuals of every group.

    Parameters
    ----------
    model : orders of the polynomials
    equations : observations
    projector : removes the part of the observations that the coefficients explain
    ways : see `_ways`; None to exclude hysteresis as a cause
    """
    points = [p for p, _ in equations.points]
    times = np.array([p.time for p in points])
    times = times / max(float(times.max(initial=0.0)), 1e-9)
    rates = np.array([60.0 * p.rate for p in points])
    for group in GROUPS:
        causes = {
            "temperature_order": _next_order(model, equations, group),
            "changed_in_time": equations.columns(group, times),
        }
        if ways is not None:
            causes[_HYSTERESIS] = np.hstack(_hysteresis_columns(equations, group, ways))
        if group not in model.rate_term and np.abs(rates).max(initial=0.0) > _STEADY_RATE:
            causes["temperature_rate"] = equations.columns(group, rates)
        explained = {cause: projector.explained(equations.observed, added) for cause, added in causes.items()}
        most, freedom = 0.0, 0
        if max(gain - count for gain, count in explained.values()) > MAX_EXCESS:
            most, freedom = projector.explained(equations.observed, _each_point(equations, group))
        for cause, (gain, count) in explained.items():
            yield _Candidate(cause, group, gain - count, _is_scatter(gain, count, most - gain, freedom - count))


def _is_scatter(gain: float, count: int, rest: float, freedom: int) -> bool:
    """Return, by an F test, whether columns explain no more of a group's residual than they would of random scatter.

    If they leave only noise, they are the cause. The variance of the scatter is at least that of the noise. Without
    redundancy, a cause cannot be distinguished from scatter.

    Parameters
    ----------
    gain, count : decrease of χ² due to the columns, and their number
    rest, freedom : remaining χ² of the residual of the group, and its degrees of freedom
    """
    if freedom <= 0 or count == 0:
        return gain - count > MAX_EXCESS
    if chdtrc(freedom, rest) > _REMAINING_PROBABILITY:
        return False
    ratio = (gain / count) / max(rest / freedom, 1.0)
    return bool(fdtrc(count, freedom, ratio) > _SCATTER_PROBABILITY)


def _most_scattered(equations: Equations, projector: _Projector) -> str:
    """Return the group whose changes from point to point explain most of the residuals."""

    def excess(group: str) -> float:
        gain, count = projector.explained(equations.observed, _each_point(equations, group))
        return gain - count

    return max(GROUPS, key=excess)


def _ways(equations: Equations) -> FloatArray | None:
    """Return 0.5 for points after a rise, −0.5 after a fall, else 0; None if a direction has too few points."""
    ways = np.array([{"up": 0.5, "down": -0.5, "soak": 0.0}[p.way] for p, _ in equations.points])
    return ways if min(np.count_nonzero(ways > 0.0), np.count_nonzero(ways < 0.0)) >= _MIN_OF_WAY else None


def _hysteresis_columns(equations: Equations, group: str, ways: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the columns of a change of a group at the first temperature, and between rising and falling temperature.

    The temperatures before the first point are unknown. See `_ways`.
    """
    begin = np.where(ways == 0.0, 1.0, 0.0)
    return equations.columns(group, begin), equations.columns(group, ways)


def _each_point(equations: Equations, group: str) -> FloatArray:
    """Return the columns of changes of a group that are independent from point to point."""
    return np.hstack([equations.columns(group, row) for row in np.eye(len(equations.points))])


def _next_order(model: TemperatureModel, equations: Equations, group: str) -> FloatArray:
    element = group_indices(group)[0]
    x = np.array([(p.conditions[0][element] - model.reference) / model.span for p, _ in equations.points])
    return equations.columns(group, x ** (model.order.get(group, 0) + 1))
