"""Solver of a stage at several temperatures: a 39-state filter at each temperature, and one fit of all coefficients.

The samples at each temperature are solved separately, with the prior of the stage, so that their information is
independent. The temperature still changes during these samples: once the coefficients are known, the samples are
reduced to the mean temperature and solved again, which linearises about the parameters at the temperature of every
sample.
"""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from calstation.errors import InputError, InsufficientDataError
from calstation.estimation.common import (
    ImuModel,
    ModelTest,
    Posterior,
    SampleBlock,
    SolveContext,
    StageData,
    TemperatureModel,
    nis_consistency,
    stage_data,
)
from calstation.estimation.effects import EffectTests, Sensitivity, effect_tests, known_effects
from calstation.estimation.method import Progress, Solution, StageSolver
from calstation.estimation.navigation.stage import NavigationStage
from calstation.estimation.temperature import (
    ELEMENT_OF,
    NO_LAGS,
    ElementTemperatures,
    Polynomials,
    TemperatureFit,
    TemperaturePoint,
    different_temperatures,
    element_temperatures,
    fit_temperature,
    held_out_points,
    nearest_temperature,
    polynomials,
    reduced,
    with_orders,
    with_ways,
)
from calstation.physics import COUNT, GROUPS, FloatArray, group_indices

#: Duration at the end of a soak that is solved together with the moves after it, s.
_BEFORE = 20.0
#: Largest number of solutions of all temperatures, and largest change of a coefficient that ends them, in sigmas.
_MAX_PASSES, _CONVERGED = 6, 0.02
#: Number of fits in which the lags are corrected, and number of temperatures in a mean.
_LAG_PASSES, _MEAN_OF = 2, 201
#: Largest distance of an end of the range from the lowest or highest temperature of the fitted samples, K: the unit's
#: temperature may differ this much from that of the chamber.
_MAX_END_DISTANCE = 2.0
#: Largest distance of a held-out temperature from its measurement, as a part of the range.
_MARGIN = 0.05


class TemperatureStage(StageSolver):
    """Solves a stage at several temperatures."""

    def __init__(
        self,
        context: SolveContext,
        prior: Posterior,
        estimated: tuple[str, ...],
        soak: float,
        moves: int,
        *,
        is_ramp: bool = False,
    ) -> None:
        """Create the solver.

        Parameters
        ----------
        context : models, including the orders of the polynomials
        prior : parameters before the stage
        estimated : names of the parameters
        soak : duration of the shortest rest that separates two temperatures, s
        moves : number of moves in a cycle, which is one point of a ramp
        is_ramp : whether the temperature changes between the soaks
        """
        super().__init__(context, prior)
        if context.temperature is None:
            raise InputError("temperature.no_section")
        self._model: TemperatureModel = context.temperature
        self._estimated, self._soak, self._moves, self._is_ramp = estimated, soak, moves, is_ramp
        self._reduced: StageData | None = None
        self._messages: list[tuple[str, Mapping[str, Any]]] = []

    def data(self) -> StageData:
        """Return the valid samples; after the solution, reduced to the reference temperature."""
        return self._reduced or super().data()

    def finish(self, progress: Progress | None = None) -> Solution:
        """Solve all temperatures, then fit the coefficients."""
        block = self.buffer.block()
        if np.isnan(block.temperature).all():
            raise InputError("temperature.no_column")
        bounds = temperature_parts(block, self._soak, self._moves, is_ramp=self._is_ramp)
        # cycles of a ramp adjoin each other; other temperatures are separated by soaks, after which no element lags
        is_ramp = any(a[1] == b[0] for a, b in itertools.pairwise(bounds))
        self._model = replace(self._model, has_lag=is_ramp)
        parts = [_Part(block.part(*at), self.context, block.time[0]) for at in bounds]
        if len(parts) < 2:
            raise InsufficientDataError("temperature.one_temperature")
        self._require_range(held_out_points([p.point(self.prior, self.prior) for p in parts], self._model.held_out))
        solver = NavigationStage("temperature", self.context, self.prior, self._estimated)
        solutions = [solver.solve(part.data) for part in parts]
        fit, points, lags = self._fit(block, parts, solutions)
        for k in range(1, _MAX_PASSES):
            if progress is not None:
                progress(k / _MAX_PASSES)
            courses, before = self._courses(block, parts, fit.lags), fit
            solutions = [solver.solve(part.at_mean(fit, course)) for part, course in zip(parts, courses, strict=True)]
            fit, points, lags = self._fit(block, parts, solutions, before, keep_orders=k > 1)
            if _change(before, fit) < _CONVERGED:
                break
        else:
            self._messages = [("not_converged", {"stage": "temperature", "passes": _MAX_PASSES})]
        fitted = fit_temperature(fit.model, points, self.prior, lags, _instability(self.context.imu))
        return self._solution(fitted, solutions, block)

    def _require_range(self, points: Sequence[TemperaturePoint]) -> None:
        """Raise InsufficientDataError unless the points determine the polynomials and include those held out."""
        (low, high), margin = self._model.range, _MARGIN * (self._model.range[1] - self._model.range[0])
        for held_out in self._model.held_out:
            nearest = nearest_temperature(points, held_out)
            if abs(nearest - held_out) > margin:
                raise InsufficientDataError("temperature.held_out_missing", value=held_out, nearest=nearest)
        extents = [p.extent or (p.temperature, p.temperature) for p in points if not p.is_held_out]
        lowest = min((extent[0] for extent in extents), default=self._model.reference)
        highest = max((extent[1] for extent in extents), default=self._model.reference)
        if lowest > low + _MAX_END_DISTANCE or highest < high - _MAX_END_DISTANCE:
            measured = {"low": lowest, "high": highest, "beyond": _MAX_END_DISTANCE}
            raise InsufficientDataError("temperature.not_covered", range_low=low, range_high=high, **measured)
        different, fitted = different_temperatures(points), sum(not p.is_held_out for p in points)
        for group in GROUPS:
            needed, has_rate = self._model.order.get(group, 0) + 1, group in self._model.rate_term
            for count, minimum in ((different, needed), (fitted, needed + has_rate)):
                if count < minimum:
                    raise InsufficientDataError("temperature.too_few", group=group, needed=minimum, found=count)

    def _fit(
        self,
        block: SampleBlock,
        parts: Sequence["_Part"],
        solutions: Sequence[Solution],
        before: Polynomials | None = None,
        *,
        keep_orders: bool = False,
    ) -> tuple[Polynomials, list[TemperaturePoint], FloatArray]:
        """Return the coefficients, the points, and the lags with which their temperatures were computed, s, shape (2,).

        Parameters
        ----------
        block : samples of the stage
        parts : samples at each temperature
        solutions : their solutions
        before : latest coefficients
        keep_orders : whether the orders of `before` are kept
        """
        points = [self._completed(p.point(s.posterior, self.prior), s) for p, s in zip(parts, solutions, strict=True)]
        points = held_out_points(with_ways(points), self._model.held_out)
        automatic = self._model.is_automatic and not keep_orders
        model, lags = (self._model, NO_LAGS) if before is None else (before.model, before.lags)
        for _ in range(_LAG_PASSES if self._model.has_lag else 1):
            courses, used = self._courses(block, parts, lags), lags
            elements = [part.means(course) for part, course in zip(parts, courses, strict=True)]
            points = [replace(p, elements=means) for p, means in zip(points, elements, strict=True)]
            model = with_orders(self._model, points, self.prior) if automatic else model
            fit = polynomials(model, points, self.prior, used)
            lags = fit.lags
        return fit, points, used

    def _completed(self, point: TemperaturePoint, solution: Solution) -> TemperaturePoint:
        """Return a point with the noise of the table, and with the means of the effects in the model applied."""
        noise = next((test.value for test in solution.tests if test.kind == "table_noise"), 1.0)
        point = replace(point, table_noise=noise)
        if solution.sensitivity is None:
            return point
        effects = self._tested_effects(solution.sensitivity).modelled()
        posterior = Posterior(point.posterior.mean + effects.change, point.posterior.covariance)
        return replace(point, posterior=posterior, effects=effects)

    def _tested_effects(self, sensitivity: Sensitivity) -> EffectTests:
        effects = EffectTests(np.zeros(COUNT), self.context.states, known_effects(self.prior.sigma, self.context))
        return effects.with_stage("temperature", sensitivity, self._estimated)

    def _courses(self, block: SampleBlock, parts: Sequence["_Part"], lags: FloatArray) -> Sequence[ElementTemperatures]:
        """Return the temperatures of the elements during each part.

        Without lags, the temperatures of a part are computed from its own samples, because samples between two soaks
        may not have been recorded. The temperature of an element that lags also depends on earlier samples.

        Parameters
        ----------
        block : samples of the stage
        parts : samples at each temperature
        lags : lags of gyros and accelerometers behind the sensor, s, shape (2,)
        """
        if not self._model.has_lag:
            return [part.course for part in parts]
        return [element_temperatures(block, lags)] * len(parts)

    def _solution(self, fit: TemperatureFit, solutions: Sequence[Solution], block: SampleBlock) -> Solution:
        """Return the solution with the parameters at the reference temperature."""
        explained = sum(p.effects.explained(fit.effects) for p in fit.points if p.effects is not None)
        total = max(sum(s.consistency.nis_mean * s.consistency.count for s in solutions) - explained, 0.0)
        count = sum(s.consistency.count for s in solutions)
        posterior = fit.at(self._model.reference)
        held_out = fit.held_out_test(self._estimated)
        kinds = dict.fromkeys(test.kind for s in solutions for test in s.tests)
        worst = [max((t for s in solutions for t in s.tests if t.kind == kind), key=_severity) for kind in kinds]
        data = stage_data([block], self.context.imu)
        self._reduced = reduced(data, fit, element_temperatures(block, fit.lags), posterior.mean)
        return replace(
            solutions[0],
            stage="temperature",
            posterior=posterior,
            estimated=self._estimated,
            consistency=nis_consistency(total, count, 3),
            gaps=sum(s.gaps for s in solutions),
            details={"points": len(solutions)},
            messages=(*{str(m): m for s in solutions for m in s.messages}.values(), *self._messages),
            innovations=None,
            sensitivity=None,
            tests=(*worst, *self._effect_tests(solutions), fit.test, *([held_out] if held_out is not None else [])),
            local_scores=None,
            temperature=fit,
        )

    def _effect_tests(self, solutions: Sequence[Solution]) -> list[ModelTest]:
        """Return the worst test of the effects outside the model at a temperature."""
        tests = []
        for solution in solutions:
            if solution.sensitivity is not None:
                effects = self._tested_effects(solution.sensitivity)
                harmful, _ = effect_tests(effects.evidence(solution.posterior))
                tests += [harmful] if harmful is not None else []
        return sorted(tests, key=_severity)[-1:]


class _Part:
    """The samples at one temperature."""

    def __init__(self, block: SampleBlock, context: SolveContext, begin: float) -> None:
        self._block, self.data = block, stage_data([block], context.imu)
        known = block.valid & ~np.isnan(block.temperature)
        if not known.any():
            raise InputError("temperature.unknown", first=int(block.seq[0]), last=int(block.seq[-1]))
        self.course = element_temperatures(block, NO_LAGS)  #: Temperatures of the elements without lags.
        self._sensor = self.course.values[:, 0]
        self.mean = float(block.temperature[known].mean())  #: °C
        duration = float(block.time[-1] - block.time[0])
        self._rate = float(self._sensor[-1] - self._sensor[0]) / max(duration, 1.0)
        self._time = float(block.time.mean() - begin)

    def means(self, elements: ElementTemperatures) -> FloatArray:
        """Return the mean temperatures of gyros and accelerometers, °C, and their rates, K/s, shape (2, 2)."""
        times = np.linspace(self.data.time[0], self.data.time[-1], _MEAN_OF)
        return np.array([rows.mean(axis=0) for rows in elements.at(times)])

    def at_mean(self, fit: Polynomials, elements: ElementTemperatures) -> StageData:
        """Return the samples, reduced to the mean temperatures."""
        temperature, rate = self.means(elements)
        return reduced(self.data, fit, elements, fit.at(temperature[ELEMENT_OF], rate[ELEMENT_OF]).mean)

    def point(self, posterior: Posterior, prior: Posterior) -> TemperaturePoint:
        """Return the solution of the part as a point; whether the temperature rises or falls is determined later."""
        seq = self._block.seq
        times, extent = (self.mean, self._rate, self._time), (self._sensor.min(), self._sensor.max())
        point = TemperaturePoint(*times, "soak", int(seq[0]), int(seq[-1]), prior, posterior)
        return replace(point, extent=(float(extent[0]), float(extent[1])))


def temperature_parts(block: SampleBlock, soak: float, moves: int, *, is_ramp: bool = False) -> list[tuple[int, int]]:
    """Return the samples (start, stop) of each temperature: the moves between two soaks, or a cycle of a ramp.

    Parameters
    ----------
    block : samples of the stage
    soak : duration of the shortest rest that separates two temperatures, s
    moves : number of moves in a cycle
    is_ramp : whether the moves between two soaks are divided into cycles; without soaks, they always are
    """
    edges = np.concatenate([[0], np.flatnonzero(np.diff(block.step)) + 1, [len(block)]])
    first, last = edges[:-1], edges[1:]
    if len(first) < 3:
        raise InputError("temperature.no_steps")
    period = float(np.median(np.diff(block.time)))
    valid = np.concatenate([[0], np.cumsum(block.valid)])
    long = np.flatnonzero((valid[last] - valid[first]) * period >= soak)
    if len(long) < 2:
        return _cycles([*first, last[-1]], moves)
    before, parts = round(_BEFORE / period), list[tuple[int, int]]()
    for a, b in itertools.pairwise([*long.tolist(), len(first)]):
        bounds = [max(int(last[a]) - before, 0), *first[a + 2 : b], first[b] if b < len(first) else last[-1]]
        parts += _cycles(bounds, moves if is_ramp else len(bounds))
    return parts


def _cycles(bounds: Sequence[int], moves: int) -> list[tuple[int, int]]:
    """Divide moves, given by their bounds, into cycles; a last cycle of one or two moves is omitted."""
    ends = range(0, len(bounds) - 1, moves)
    cycles = [bounds[k : k + moves + 1] for k in ends]
    return [(int(cycle[0]), int(cycle[-1])) for cycle in cycles if len(cycle) > 3]


def _instability(imu: ImuModel) -> FloatArray:
    """Return the minimum of the Allan deviation of each bias due to its instability, SI, shape (30,)."""
    sigmas = np.zeros(COUNT)
    for group, size in (("gyro_bias", imu.gyro_bias_instability), ("accel_bias", imu.accel_bias_instability)):
        sigmas[group_indices(group)] = np.sqrt(2.0 * np.log(2.0) / np.pi) * size
    return sigmas


def _change(before: Polynomials, after: Polynomials) -> float:
    """Return the largest change of a coefficient in sigmas."""
    if before.model.columns != after.model.columns:
        return np.inf
    sigma = np.sqrt(np.diag(after.scaled_covariance))
    return float(np.max(np.abs(after.scaled - before.scaled) / np.where(sigma > 0.0, sigma, np.inf)))


def _severity(test: ModelTest) -> tuple[bool, float]:
    """Return whether a test fails, for example because its value is NaN, and the ratio of the value to the limit."""
    limit = test.limit[1] if isinstance(test.limit, tuple) else test.limit
    return not test.passed, test.value / limit if limit > 0.0 else test.value
