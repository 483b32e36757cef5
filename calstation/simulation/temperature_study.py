"""Monte Carlo study of the stage `temperature`: fits over temperature of many units in the simulated chamber.

The bench simulates temperatures and parameters of each unit. The solution of each cycle of moves is drawn from the
true parameters with the filter's covariance; the errors of the filter itself are tested by the study of the stages.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from calstation.bench import BenchConfig
from calstation.bench.truth import GRID, GradeName
from calstation.config import RunConfiguration, RunRequest, library, load_configuration
from calstation.errors import ConfigurationError
from calstation.estimation.common import Posterior, SampleBlock, TemperatureModel
from calstation.estimation.navigation import temperature_parts
from calstation.estimation.temperature import (
    ELEMENT_OF,
    ELEMENTS,
    NO_LAGS,
    Polynomials,
    TemperatureFit,
    TemperaturePoint,
    element_temperatures,
    fit_temperature,
    held_out_points,
    parameters_at,
    polynomials,
    with_orders,
    with_ways,
)
from calstation.physics import COUNT, GROUPS, NAMES, Dwell, FloatArray, Move, group_indices
from calstation.records import prior_from_meta
from calstation.schema import validate
from calstation.simulation.bench_settings import bench_config
from calstation.simulation.chamber_simulator import ChamberSimulator
from calstation.simulation.study_table import chi_squared_band, rms_band
from procedures import method

#: Product of each grade.
PRODUCTS: dict[GradeName, str] = {"nav": "nav_a_thermal", "mems": "mems_c_thermal"}
#: Methods of the study: soaks as in the product, and a ramp as the designer writes it.
SOAK, RAMP = "temperature", "temperature_ramp"
#: Grades of each method.
OVER_TEMPERATURE = {SOAK: tuple(PRODUCTS), RAMP: tuple(PRODUCTS)}
RAMP_SCHEDULE = {
    "points_c": [21.0, -44.0, 81.0, 21.0],
    "ramp_c_per_min": 4.0,
    "soak": {"unit_rate_below_c_per_min": 0.33, "hold_s": 60.0, "at_most_s": 5400.0},
}
RATE_TERM = frozenset({"gyro_bias", "accel_bias"})
#: Temperatures at which the parameters are compared with the truth, and one that is held out for the last comparison.
_TEMPERATURES, _HELD_OUT = np.linspace(-40.0, 85.0, 12), (48.0,)
#: Rate at which the temperatures are simulated, Hz.
_SAMPLE_RATE = 1.0 / GRID
#: Number of fits, each with the lags and coefficients of the preceding one.
_PASSES = 4


@dataclass(frozen=True)
class _Setting:
    """Settings common to all units of a case."""

    setup: RunConfiguration
    model: TemperatureModel
    schedule: Any
    prior: Posterior
    cycle: Posterior  #: Predicted solution of a cycle of moves; only its covariance is used.
    is_ramp: bool


@dataclass(frozen=True)
class _Unit:
    """Fits of a unit with all temperatures and without the held-out one, and its true values."""

    fit: TemperatureFit
    without: TemperatureFit
    truth: FloatArray  #: True parameters at `_TEMPERATURES` without hysteresis, SI, shape (12, 30).
    in_use: FloatArray  #: The same with hysteresis, after the temperature rose or fell, SI, shape (12, 30).
    coefficients: FloatArray  #: Scaled coefficients of the polynomials nearest to the true parameters, shape (c,).
    minutes: float  #: Chamber time, min.


def study_temperature(
    stage: str, grade: GradeName, seeds: int, progress: Callable[[int, int], None] = lambda done, count: None
) -> dict[str, Any]:
    """Study soaks or a ramp; return JSON data as `run_method_study` does.

    `nees` is the mean of all coefficients. It and the statistics of the groups exclude hysteresis, except for `in_use`,
    the rms of error/sigma of a group with hysteresis. `held_out` is the rms of difference/sigma at the held-out
    temperature, and `minutes` the mean chamber time. `within_limits` is the number of units whose sigmas are within the
    product's limits over the whole range, and `tested` the number of units that pass the test of the fit. Raises
    ConfigurationError for a grade without a product.
    """
    if grade not in PRODUCTS:
        raise ConfigurationError("cli.unknown_choice", option="--grade", value=grade, choices=list(PRODUCTS))
    setting, units = _setting(stage, grade), []
    for seed in range(seeds):
        units.append(_unit(setting, grade, seed))
        progress(seed + 1, seeds)
    limits = setting.setup.sigma_limits()
    largest = np.array([limits.get(name, np.inf) for name in NAMES])
    groups, nees = {group: _group(units, group) for group in GROUPS}, _nees(units)
    held_out = [row.difference / row.sigma for u in units for row in u.without.held_out(NAMES) if row.sigma > 0.0]
    return {
        "method": stage,
        "grade": grade,
        "units": seeds,
        "groups": groups,
        "consistency": float(np.mean([u.fit.consistency.nis_mean for u in units])),
        "nees": nees,
        "held_out": float(np.sqrt(np.mean(np.square(held_out)))),
        "minutes": float(np.mean([u.minutes for u in units])),
        "worst_sigma_over_limit": float(max((u.fit.largest_sigma / largest).max() for u in units)),
        "within_limits": sum(bool((u.fit.largest_sigma <= largest).all()) for u in units),
        "tested": sum(u.fit.test.passed for u in units),
        "passed": bool(nees["passed"] and all(g["passed"] for g in groups.values())),
    }


def _setting(stage: str, grade: GradeName) -> _Setting:
    station, product = library.find("stations", "virtual_chamber"), library.find("products", PRODUCTS[grade])
    setup = load_configuration(RunRequest("study", station, product))
    if setup.product.temperature is None:
        raise ConfigurationError("temperature.no_section")
    is_ramp, model = stage == RAMP, setup.product.temperature.model()
    values = {**setup.schedules[SOAK].model_dump(), **(RAMP_SCHEDULE if is_ramp else {})}
    schedule = validate(method(SOAK).schedule, values, f"schedule.{SOAK}")
    steps = [step for step in method(SOAK).plan(setup.table.geometry(), schedule) if isinstance(step, Move | Dwell)]
    cycle = steps[1 : 1 + 2 * len(values["moves"])]
    from calstation.designer import Prediction  # a global import would delay the first paint

    prediction = Prediction(setup.log_meta(), model, cycle, setup.table.settle_s)
    posterior = prediction.posterior(1, after_soak=not is_ramp)
    model = replace(model, rate_term=RATE_TERM if is_ramp else model.rate_term, has_lag=is_ramp)
    return _Setting(setup, model, schedule, prior_from_meta(setup.log_meta()), posterior, is_ramp)


def _unit(setting: _Setting, grade: GradeName, seed: int) -> _Unit:
    changes = {"seed": seed, "grade": grade, "flash_file": None, "sample_rate_hz": _SAMPLE_RATE, "instability": False}
    config = BenchConfig.model_validate({**bench_config(setting.setup), **changes})
    truth, schedule = config.truth(), setting.schedule
    simulator = ChamberSimulator(truth, config, seed, counts=False)
    simulated = simulator.run(method(SOAK).plan(setting.setup.table.geometry(), schedule), SOAK)
    columns = {"step": simulated.step, "temperature": simulated.temperature}
    block = SampleBlock.without_table(SOAK, simulated.seq, simulated.time, simulated.counts, **columns)
    drawn = _Drawn(setting, block, np.array(simulator.parameters_of_cells), seed)
    fit, without = drawn.fit(()), drawn.fit(_HELD_OUT)
    thermal, base = simulator.thermal, truth.parameters
    steady = np.array([thermal.steady(base, t) for t in _TEMPERATURES])
    sides = np.random.default_rng([seed, 8]).choice([-1.0, 1.0], len(ELEMENTS))
    in_use = np.array([thermal.steady(base, t, sides[ELEMENT_OF]) for t in _TEMPERATURES])
    at_points = [thermal.steady(base, p.temperature) for p in fit.points]
    nearest = _nearest(fit, at_points, setting.prior.sigma)
    return _Unit(fit, without, steady, in_use, nearest, float(simulated.time[-1]) / 60.0)


def _nearest(fit: TemperatureFit, steady: list[FloatArray], scale: FloatArray) -> FloatArray:
    """Return the scaled coefficients of the polynomials nearest to the true parameters at the points, shape (c,).

    Parameters
    ----------
    fit : fit of a unit
    steady : true parameters at the temperature of each point, SI, shape (30,)
    scale : sigmas of the parameters before the calibration, SI, shape (30,)
    """
    used = [k for k, c in enumerate(fit.model.columns) if c.power is not None and scale[c.parameter] > 0.0]
    sizes = scale[[fit.model.columns[k].parameter for k in used]]
    weights = [point.observations(scale)[1] for point in fit.points]
    rows = [j @ fit.model.basis(p.temperature)[:, used] * sizes for j, p in zip(weights, fit.points, strict=True)]
    target = np.concatenate([j @ truth for j, truth in zip(weights, steady, strict=True)])
    scaled = np.zeros(len(fit.model.columns))
    scaled[used] = np.linalg.lstsq(np.vstack(rows), target, rcond=None)[0] * sizes
    return scaled


class _Drawn:
    """Solutions of the cycles of a unit; their errors are drawn once and used in every fit."""

    def __init__(self, setting: _Setting, block: SampleBlock, parameters: FloatArray, seed: int) -> None:
        self._setting, self._block, self._parameters = setting, block, parameters
        schedule = setting.schedule
        self._parts = temperature_parts(block, schedule.soak.hold_s, len(schedule.moves), is_ramp=setting.is_ramp)
        free = np.flatnonzero(setting.prior.sigma > 0.0)
        self._scale, block_of_free = setting.prior.sigma[free], np.ix_(free, free)
        self._free, scales = free, np.outer(self._scale, self._scale)
        self._before = np.linalg.inv(setting.prior.covariance[block_of_free] / scales)
        self._covariance = setting.cycle.covariance[block_of_free] / scales
        information = np.linalg.inv(self._covariance) - self._before
        values, vectors = np.linalg.eigh(0.5 * (information + information.T))
        values = np.maximum(values, 0.0)
        self._information = vectors @ np.diag(values) @ vectors.T
        normals = np.random.default_rng([seed, 7]).standard_normal((len(self._parts), len(free)))
        self._noise = normals * np.sqrt(values) @ vectors.T

    def fit(self, held_out: tuple[float, ...]) -> TemperatureFit:
        """Fit as the solver of the stage does, but always with the same number of passes."""
        setting, fit, lags = self._setting, None, NO_LAGS
        model = replace(setting.model, held_out=held_out)
        for _ in range(_PASSES):
            points, used = held_out_points(with_ways(self._points(fit, lags)), held_out), lags
            chosen = with_orders(model, points, setting.prior)
            fit = polynomials(chosen, points, setting.prior, lags)
            lags = fit.lags
        return fit_temperature(chosen, points, setting.prior, used)

    def _points(self, fit: Polynomials | None, lags: FloatArray) -> list[TemperaturePoint]:
        elements, points = element_temperatures(self._block, lags), []
        for (first, last), noise in zip(self._parts, self._noise, strict=True):
            times, parameters = self._block.time[first:last], self._parameters[first:last]
            temperatures, rates = elements.at(times)
            means = np.array([temperatures.mean(axis=0), rates.mean(axis=0)])
            true = parameters.mean(axis=0)
            if fit is not None:
                changes = parameters_at(fit, temperatures, rates).mean(axis=0)
                true = true - changes + fit.at(means[0, ELEMENT_OF], means[1, ELEMENT_OF]).mean
            sensed = self._block.temperature[first:last]
            rate = float(sensed[-1] - sensed[0]) / float(times[-1] - times[0])
            conditions = float(sensed.mean()), rate, float(times.mean())
            solved = self._solved(true, noise)
            point = TemperaturePoint(*conditions, "soak", first, last, self._setting.prior, solved, elements=means)
            points.append(replace(point, extent=(float(sensed.min()), float(sensed.max()))))
        return points

    def _solved(self, true: FloatArray, noise: FloatArray) -> Posterior:
        """Return the solution of a cycle, given its true parameters, SI, shape (30,), and drawn noise, shape (f,)."""
        free, prior = self._free, self._setting.prior
        data = self._information @ (true[free] / self._scale) + noise
        mean, covariance = prior.mean.copy(), np.zeros((COUNT, COUNT))
        mean[free] = self._covariance @ (data + self._before @ (prior.mean[free] / self._scale)) * self._scale
        covariance[np.ix_(free, free)] = self._covariance * np.outer(self._scale, self._scale)
        return Posterior(mean, covariance)


def _group(units: list[_Unit], group: str) -> dict[str, Any]:
    """Return the statistics of error/sigma of the parameters of a group at `_TEMPERATURES`."""
    index = list(group_indices(group))
    ratios, in_use, correlations, sigmas = [], [], [], []
    for unit in units:
        basis = np.vstack([unit.fit.model.basis(t)[index] for t in _TEMPERATURES])
        covariance = basis @ unit.fit.without_hysteresis.scaled_covariance @ basis.T
        sigma, found = np.sqrt(np.diag(covariance)), basis @ unit.fit.scaled
        free = sigma > 0.0
        ratios.append((found - unit.truth[:, index].ravel())[free] / sigma[free])
        whole = np.sqrt(np.sum(basis @ unit.fit.scaled_covariance * basis, axis=1))
        in_use.append((found - unit.in_use[:, index].ravel())[free] / whole[free])
        correlations.append(covariance[np.ix_(free, free)] / np.outer(sigma[free], sigma[free]))
        sigmas.append(unit.fit.largest_sigma[index].max())
    low, high = rms_band(correlations)
    values = np.concatenate(ratios)
    rms = float(np.sqrt(np.mean(values**2)))
    return {
        "sigma": float(np.mean(sigmas)),
        "rms": rms,
        "low": low,
        "high": high,
        "largest": float(np.abs(values).max()),
        "in_use": float(np.sqrt(np.mean(np.concatenate(in_use) ** 2))),
        "passed": bool(low <= rms <= high),
    }


def _nees(units: list[_Unit]) -> dict[str, Any]:
    """Return the normalised estimation error squared per coefficient of the polynomials, over all units."""
    total, count = 0.0, 0
    for unit in units:
        covariance = unit.fit.without_hysteresis.scaled_covariance
        used = [k for k, c in enumerate(unit.fit.model.columns) if c.power is not None and covariance[k, k] > 0.0]
        error = (unit.fit.scaled - unit.coefficients)[used]
        total += float(error @ np.linalg.solve(covariance[np.ix_(used, used)], error))
        count += len(used)
    low, high = chi_squared_band(count)
    return {
        "mean": total / count,
        "low": float(low),
        "high": float(high),
        "passed": bool(low <= total / count <= high),
    }
