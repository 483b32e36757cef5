"""Least-squares fit of the coefficients to solutions at several temperatures, and the tests of this fit.

Every solution contributes the information of its data, in decorrelated observations of unit variance. The tests add
columns to the fit: a higher order, a difference between rising and falling temperature, a change with time, and a term
in the rate of change of the temperature. The one that explains most of the residual is the cause, unless it explains no
more of the residual of its group than it would of scatter: an F test tells them apart. A difference between rising and
falling temperature is a test of its own, `up_down`, and is removed from the residuals of the other tests.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from scipy.special import chdtrc, fdtrc

from calstation.estimation.common import Consistency, Diagnosis, ModelTest, Posterior, TemperatureModel, nis_consistency
from calstation.estimation.effects import MAX_EXCESS
from calstation.physics import COUNT, GROUPS, NAMES, PARAMETERS, FloatArray, group_indices

Way = Literal["up", "down", "soak"]
#: Smallest information of an observation, relative to that of the prior.
_INFORMATIVE = 1.0
#: Largest difference at a held-out temperature, in sigmas: of 30 parameters, one is larger in 50,000 runs.
HELD_OUT_SIGMAS = 5.0
#: Difference of temperatures up to which they count as one, K.
_SAME = 1.0
#: Smallest number of temperatures in each direction at which hysteresis is tested.
_MIN_OF_WAY = 2
#: Largest rate of change of the temperature after a soak, K/min. Up to it, an error that has the sign of the rate is a
#: hysteresis.
_STEADY_RATE = 0.2
#: Largest probability with which scatter is taken for a cause.
_SCATTER_PROBABILITY = 0.005
#: Smallest probability of the remaining residuals with which they are noise.
_NOISE_PROBABILITY = 0.01
_HYSTERESIS = "temperature_hysteresis"


@dataclass(frozen=True)
class TemperaturePoint:
    """Solution of the samples at one temperature."""

    temperature: float  #: Mean temperature, °C.
    rate: float  #: Mean rate of change, K/s.
    time: float  #: Mean time since the start of the stage, s.
    way: Way  #: Change of the temperature towards this one.
    first_seq: int
    last_seq: int
    prior: Posterior
    posterior: Posterior
    is_held_out: bool = False
    extent: tuple[float, float] | None = None  #: Lowest and highest temperature, °C; None if it did not change.

    def observations(self, scale: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return decorrelated observations of unit variance, shape (n,), and their Jacobian, shape (n, 30).

        `scale` are the sigmas of the prior, 0 for a fixed parameter. The observations contain the data only.
        """
        free = scale > 0.0
        s = scale[free]
        before, after = (np.linalg.inv(p.covariance[np.ix_(free, free)] / np.outer(s, s)) for p in self._both)
        means = [p.mean[free] / s for p in self._both]
        values, vectors = np.linalg.eigh(after - before)
        kept = values > _INFORMATIVE
        roots = np.sqrt(values[kept])
        observed = vectors[:, kept].T @ (after @ means[1] - before @ means[0]) / roots
        jacobian = np.zeros((len(roots), COUNT))
        jacobian[:, free] = roots[:, None] * vectors[:, kept].T / s
        return observed, jacobian

    @property
    def _both(self) -> tuple[Posterior, Posterior]:
        return self.prior, self.posterior


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
class TemperatureFit:
    """Coefficients with their joint covariance."""

    model: TemperatureModel
    scaled: FloatArray  #: Scaled coefficients, see `TemperatureModel.basis`, shape (c,).
    scaled_covariance: FloatArray  #: Shape (c, c).
    points: tuple[TemperaturePoint, ...]
    consistency: Consistency  #: Test of the residuals of the fitted points.
    test: ModelTest
    #: Differences of the parameters whose group has a hysteresis or, if none has, of all of them; empty if the
    #: temperature did not rise and fall often enough, or if something else than a hysteresis fails the test.
    up_down: tuple[UpDown, ...] = ()

    def at(self, temperature: float, rate: float = 0.0) -> Posterior:
        """Return the parameters at a temperature, °C, that changes by `rate`, K/s."""
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

    def held_out(self, estimated: Sequence[str]) -> list[HeldOut]:
        """Return the differences at the held-out temperatures."""
        rows = []
        for point in (p for p in self.points if p.is_held_out):
            fitted = self.at(point.temperature, point.rate)
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


@dataclass(frozen=True)
class _Equations:
    """Observations of all fitted points, and their Jacobian with respect to the scaled coefficients."""

    observed: FloatArray
    jacobian: FloatArray
    points: tuple[tuple[TemperaturePoint, FloatArray], ...]  #: Points and the Jacobians of the parameters.

    def column(self, parameter: int, sizes: FloatArray) -> FloatArray:
        """Return the observations of a change of a parameter by `sizes`, shape (points,)."""
        return np.concatenate([j[:, parameter] * size for (_, j), size in zip(self.points, sizes, strict=True)])


def fit_temperature(model: TemperatureModel, points: Sequence[TemperaturePoint], prior: Posterior) -> TemperatureFit:
    """Fit the coefficients to the points that are not held out.

    Parameters
    ----------
    model : orders of the polynomials
    points : solutions in order of time, whose information is independent
    prior : parameters at the reference before the calibration; its sigmas bound the changes over the range, too
    """
    equations, before = _equations(model, points, prior), _before(model, prior)
    sigma = before.sigma
    consistency, test, hysteretic = _tested(model, equations, equations.jacobian[:, sigma > 0.0] * sigma[sigma > 0.0])
    fit = TemperatureFit(model, *before.updated(equations.jacobian, equations), tuple(points), consistency, test)
    groups = hysteretic or (GROUPS if test.passed else ())
    return replace(fit, up_down=_up_down(equations, before, prior, groups))


def predicted_covariance(model: TemperatureModel, points: Sequence[TemperaturePoint], prior: Posterior) -> FloatArray:
    """Return the covariance of the scaled coefficients after a fit to points, shape (c, c); see `fit_temperature`."""
    equations = _equations(model, points, prior)
    return _before(model, prior).updated(equations.jacobian, equations)[1]


def _before(model: TemperatureModel, prior: Posterior) -> "_Coefficients":
    """Return the coefficients before the fit."""
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
    return _Coefficients(mean, sigma, precision)


@dataclass(frozen=True)
class _Coefficients:
    """Coefficients before the fit: means and sigmas, shape (c,), and their joint precision, shape (c, c)."""

    mean: FloatArray
    sigma: FloatArray  #: 0 for a fixed coefficient.
    precision: FloatArray

    def updated(self, jacobian: FloatArray, equations: _Equations) -> tuple[FloatArray, FloatArray]:
        """Return the coefficients after the observations, and their covariance."""
        used = np.flatnonzero(self.sigma > 0.0)
        scale = self.sigma[used]
        part = jacobian[:, used] * scale
        information = part.T @ part + self.precision[np.ix_(used, used)] * np.outer(scale, scale)
        covariance = np.zeros_like(self.precision)
        covariance[np.ix_(used, used)] = np.linalg.inv(information) * np.outer(scale, scale)
        return self.mean + covariance @ (jacobian.T @ (equations.observed - jacobian @ self.mean)), covariance

    def with_further(self, sigma: FloatArray) -> "_Coefficients":
        """Return the coefficients with further, independent ones of mean 0."""
        free = np.where(sigma > 0.0, sigma, np.inf)
        zeros = np.zeros((len(self.sigma), len(sigma)))
        precision = np.block([[self.precision, zeros], [zeros.T, np.diag(free**-2)]])
        return _Coefficients(np.append(self.mean, 0.0 * sigma), np.append(self.sigma, sigma), precision)


def _up_down(
    equations: _Equations, before: _Coefficients, prior: Posterior, groups: Sequence[str]
) -> tuple[UpDown, ...]:
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
    further = np.tile(prior.sigma[index], 2)
    mean, covariance = before.with_further(further).updated(np.hstack([equations.jacobian, *columns]), equations)
    sigma = np.sqrt(np.diag(covariance))[-len(index) :]
    return tuple(
        UpDown(NAMES[i], float(d), float(s))
        for i, d, s in zip(index, mean[-len(index) :], sigma, strict=True)
        if s > 0.0
    )


def with_orders(model: TemperatureModel, points: Sequence[TemperaturePoint], prior: Posterior) -> TemperatureModel:
    """Return the model with the orders that the data support, group by group, from 0.

    An order is increased while that lowers the Bayesian information criterion, up to one less than the number of
    different temperatures. Groups with an order in the model keep it.
    """
    fitted = [p for p in points if not p.is_held_out]
    highest = different_temperatures(fitted) - 1
    chosen = model
    while True:
        equations = _equations(chosen, points, prior)
        projector = _Projector(equations.jacobian)
        gains = {}
        for group in GROUPS:
            order = chosen.order.get(group, 0)
            if group in model.order or order >= highest or not prior.sigma[group_indices(group)].any():
                continue
            added = _next_order(chosen, equations, group)
            gain, _ = projector.explained(equations.observed, added)
            gains[group] = gain - added.shape[1] * np.log(max(len(equations.observed), 2))
        best = max(gains, key=lambda group: gains[group], default=None)
        if best is None or gains[best] <= 0.0:
            return chosen
        chosen = chosen.with_order(best, chosen.order.get(best, 0) + 1)


def _equations(model: TemperatureModel, points: Sequence[TemperaturePoint], prior: Posterior) -> _Equations:
    fitted = [(p, *p.observations(prior.sigma)) for p in points if not p.is_held_out]
    observed = np.concatenate([y for _, y, _ in fitted])
    jacobian = np.vstack([j @ model.basis(p.temperature, p.rate) for p, _, j in fitted])
    return _Equations(observed, jacobian, tuple((p, j) for p, _, j in fitted))


class _Projector:
    """Removes from observations what the columns of a Jacobian explain."""

    def __init__(self, jacobian: FloatArray) -> None:
        norms = np.linalg.norm(jacobian, axis=0)
        scaled = jacobian[:, norms > 0.0] / norms[norms > 0.0]
        u, values, _ = np.linalg.svd(scaled, full_matrices=False)
        self._basis = u[:, values > 1e-10 * values.max(initial=0.0)]
        self.freedom = len(jacobian) - self._basis.shape[1]

    def remaining(self, observed: FloatArray) -> FloatArray:
        """Return the residual."""
        return np.asarray(observed - self._basis @ (self._basis.T @ observed))

    def explained(self, observed: FloatArray, added: FloatArray) -> tuple[float, int]:
        """Return the decrease of the sum of squares by further columns, shape (n, k), and their effective number."""
        columns = self.remaining(added)
        u, values, _ = np.linalg.svd(columns / np.maximum(np.linalg.norm(added, axis=0), 1e-300), full_matrices=False)
        kept = u[:, values > 1e-8]
        return float(np.sum((kept.T @ observed) ** 2)), kept.shape[1]


@dataclass(frozen=True)
class _Candidate:
    """A possible cause of the residuals of a group."""

    cause: str
    group: str
    excess: float  #: Decrease of χ² minus the number of columns.
    is_scatter: bool  #: Whether scatter of the group would be explained as well.


def _tested(
    model: TemperatureModel, equations: _Equations, jacobian: FloatArray
) -> tuple[Consistency, ModelTest, tuple[str, ...]]:
    """Return the test of the residuals, that of the columns that explain most of them, and groups with a hysteresis.

    The tests are those of the residuals without the hysteresis. Residuals that are too large without columns that
    explain them fail the second one as scatter.
    """
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
    model: TemperatureModel, equations: _Equations, projector: _Projector, ways: FloatArray | None
) -> Iterator[_Candidate]:
    """Yield the possible causes of the residuals of every group.

    Parameters
    ----------
    model : orders of the polynomials
    equations : observations
    projector : removes what the coefficients explain
    ways : direction of every point, shape (points,); None to exclude a hysteresis
    """
    points = [p for p, _ in equations.points]
    times = np.array([p.time for p in points])
    times = times / max(float(times.max(initial=0.0)), 1e-9)
    rates = np.array([60.0 * p.rate for p in points])
    for group in GROUPS:
        causes = {
            "temperature_order": _next_order(model, equations, group),
            "changed_in_time": _columns(equations, group, times),
        }
        if ways is not None:
            causes[_HYSTERESIS] = np.hstack(_hysteresis_columns(equations, group, ways))
        if group not in model.rate_term and np.abs(rates).max(initial=0.0) > _STEADY_RATE:
            causes["temperature_rate"] = _columns(equations, group, rates)
        most, freedom = projector.explained(equations.observed, _each_point(equations, group))
        for cause, added in causes.items():
            gain, count = projector.explained(equations.observed, added)
            yield _Candidate(cause, group, gain - count, _is_scatter(gain, count, most - gain, freedom - count))


def _is_scatter(gain: float, count: int, rest: float, freedom: int) -> bool:
    """Return whether columns explain no more of the residual of a group than they would of scatter, by an F test.

    Columns that leave no more than noise explain all of it. What they leave counts as noise at least. Without
    redundancy, nothing tells scatter from a cause.

    Parameters
    ----------
    gain, count : decrease of χ² by the columns, and their number
    rest, freedom : what they leave of the residual of the group, and its degrees of freedom
    """
    if freedom <= 0 or count == 0:
        return gain - count > MAX_EXCESS
    if chdtrc(freedom, rest) > _NOISE_PROBABILITY:
        return False
    ratio = (gain / count) / max(rest / freedom, 1.0)
    return bool(fdtrc(count, freedom, ratio) > _SCATTER_PROBABILITY)


def _most_scattered(equations: _Equations, projector: _Projector) -> str:
    """Return the group whose changes from point to point explain most of the residuals."""

    def excess(group: str) -> float:
        gain, count = projector.explained(equations.observed, _each_point(equations, group))
        return gain - count

    return max(GROUPS, key=excess)


def _ways(equations: _Equations) -> FloatArray | None:
    """Return half a step up for points after a rise, and down after a fall; None if a way has too few points."""
    ways = np.array([{"up": 0.5, "down": -0.5, "soak": 0.0}[p.way] for p, _ in equations.points])
    return ways if min(np.count_nonzero(ways > 0.0), np.count_nonzero(ways < 0.0)) >= _MIN_OF_WAY else None


def _hysteresis_columns(equations: _Equations, group: str, ways: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the columns of a change of a group at the first temperature, and between rising and falling temperature.

    What came before the first temperature is unknown. `ways` is half a step in the direction of every point.
    """
    begin = np.where(ways == 0.0, 1.0, 0.0)
    return _columns(equations, group, begin), _columns(equations, group, ways)


def _each_point(equations: _Equations, group: str) -> FloatArray:
    """Return the columns of a change of a group at every point by itself."""
    return np.hstack([_columns(equations, group, row) for row in np.eye(len(equations.points))])


def _next_order(model: TemperatureModel, equations: _Equations, group: str) -> FloatArray:
    x = np.array([(p.temperature - model.reference) / model.span for p, _ in equations.points])
    return _columns(equations, group, x ** (model.order.get(group, 0) + 1))


def _columns(equations: _Equations, group: str, sizes: FloatArray) -> FloatArray:
    return np.stack([equations.column(i, sizes) for i in group_indices(group)], axis=1)


def different_temperatures(points: Sequence[TemperaturePoint]) -> int:
    """Return the number of different temperatures of the points that are not held out."""
    count, last = 0, -np.inf
    for temperature in sorted(p.temperature for p in points if not p.is_held_out):
        if temperature - last > _SAME:
            count, last = count + 1, temperature
    return count


def nearest_temperature(points: Sequence[TemperaturePoint], temperature: float) -> float:
    """Return the temperature of a point nearest to another temperature, °C."""
    found = np.array([p.temperature for p in points])
    return float(found[np.abs(found - temperature).argmin()])


def held_out_points(points: Sequence[TemperaturePoint], temperatures: Sequence[float]) -> list[TemperaturePoint]:
    """Return the points, those at the temperature nearest to a held-out one marked, however often it was visited."""
    chosen = [nearest_temperature(points, t) for t in temperatures]
    return [replace(p, is_held_out=any(abs(p.temperature - t) <= _SAME for t in chosen)) for p in points]
