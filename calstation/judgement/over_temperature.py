"""Judgement over a range of temperatures: worst value and largest sigma, hysteresis, and the temperature sensor."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.special import chdtrc

from calstation.estimation import Diagnosis, Estimate, ModelTest, Solution
from calstation.estimation.common import SampleBlock
from calstation.estimation.temperature import TemperatureFit, UpDown
from calstation.judgement.check import Check, Where
from calstation.physics import INDEX, PARAMETERS, FloatArray, entry_of
from calstation.records import Limit

#: Smallest probability of the differences of a group between rising and falling temperature that are attributed to
#: noise, and largest difference in such a group, in sigmas.
_UP_DOWN_PROBABILITY, _UP_DOWN_SIGMAS = 1e-5, 6.0

#: Window in which a unit is steady, s, and largest change of the temperatures of unit and air between its halves, K.
_STEADY_TIME, _STEADY_CHANGE = 60.0, 0.1
#: Longest time constant of a steady unit that still approaches its final temperature, s, and smallest change of the air
#: temperature that starts another soak, K.
_LONGEST, _OTHER_AIR = 7200.0, 1.0
#: Largest change of the difference between unit and air over the range, K, and addition to it as a fraction of the
#: difference, because self-heating depends on the density of the air.
_LARGEST_CHANGE, _PART_OF_HEATING = 3.0, 0.25


def fit_over_temperature(solutions: Sequence[Solution]) -> TemperatureFit | None:
    """Return the parameters as functions of the temperature; None if they are constant."""
    return next((s.temperature for s in reversed(solutions) if s.temperature is not None), None)


def worst_estimate(
    solutions: Sequence[Solution], name: str, interval: tuple[float, float] | None, estimate: Estimate
) -> Estimate:
    """Return the value farthest from the middle of its limits, and the largest sigma, over the range of temperatures.

    Parameters
    ----------
    solutions : solutions of the stages, in order
    name : name of the parameter
    interval : limits of its value, SI; None if there are none
    estimate : estimate at the reference, which is returned if the parameters do not depend on the temperature; its
        sigma includes the uncertainty of gravity, which is the same at all temperatures
    """
    fit = fit_over_temperature(solutions)
    if fit is None:
        return estimate
    worst = fit.worst(name, 0.5 * sum(interval) if interval is not None else 0.0)
    at_reference = fit.at(fit.model.reference).sigma[INDEX[name]]
    common = max(estimate.sigma**2 - float(at_reference) ** 2, 0.0)
    return replace(estimate, value=worst.value, sigma=float(np.sqrt(worst.sigma**2 + common)))


def check_up_down(solution: Solution, limits: Mapping[str, Limit], near: float) -> list[Check]:
    """Return the check of the hysteresis of a stage at several temperatures; [] if it was not determined.

    Half of the difference of a parameter between rising and falling temperature is an error of its polynomial. Together
    with the parameter's sigma without hysteresis, it may reach the limit of the sigma; differences attributed to noise
    also pass.

    Parameters
    ----------
    solution : solution of the stage
    limits : limits of the product by parameter or group
    near : fraction of its limit above which a value is a near miss
    """
    fit = solution.temperature
    rows = [] if fit is None else [row for row in fit.up_down if row.parameter in solution.estimated]
    if fit is None or not rows:
        return []

    without = fit.without_hysteresis
    squares = dict.fromkeys((PARAMETERS[INDEX[row.parameter]].group for row in rows), np.zeros(0))
    for row in rows:
        group = PARAMETERS[INDEX[row.parameter]].group
        squares[group] = np.append(squares[group], (row.difference / row.sigma) ** 2)

    def largest(row: UpDown) -> float:
        limit, each = entry_of(limits, row.parameter), squares[PARAMETERS[INDEX[row.parameter]].group]
        permitted = (None if limit is None else limit.sigma_limit(solution.stage)) or 0.0
        rest = float(without.largest_sigma[INDEX[row.parameter]])
        permitted = np.sqrt(permitted**2 - rest**2) if rest < permitted else permitted
        is_noise = chdtrc(len(each), each.sum()) > _UP_DOWN_PROBABILITY
        return max(permitted, 0.5 * _UP_DOWN_SIGMAS * row.sigma if is_noise or not permitted else 0.0)

    worst = max(rows, key=lambda row: abs(row.difference) / largest(row))
    i, half = INDEX[worst.parameter], 0.5 * abs(worst.difference)
    unit, where = PARAMETERS[i].unit, Where(worst.parameter)
    check = Check.compare("hysteresis", half, largest(worst), unit, subject=solution.stage, near=near, where=where)
    if check.passed:
        return [check]
    sigma = without.at(fit.model.reference).sigma
    shifts = {row.parameter: 0.5 * row.difference / float(sigma[INDEX[row.parameter]]) for row in rows}
    values = {"parameter": worst.parameter, "group": PARAMETERS[i].group}
    hysteresis = Diagnosis("temperature_hysteresis", worst.difference, worst.sigma, unit, shifts, values)
    return [replace(check, diagnosis=hysteresis)]


def sensor_test(samples: SampleBlock, rate: float) -> list[ModelTest]:
    """Test whether the temperature sensor of a unit follows the air of the chamber from soak to soak.

    A steady unit is warmer than the air by its self-heating, and by its time constant times its remaining rate of
    cooling; see `_time_constant`. Returns [] without the temperature of the air, or if the unit is steady at only one
    temperature. `rate` is the sample rate, Hz.
    """
    width = round(_STEADY_TIME * rate)
    count = len(samples) // max(width, 1)
    if count < 2 or not samples.chamber.shape[1]:
        return []
    unit, air = (
        values[: count * width].reshape(count, width) for values in (samples.temperature, samples.chamber[:, 0])
    )
    halves = np.stack([_means(unit), _means(air)])
    steady = np.all(np.abs(halves[:, :, 1] - halves[:, :, 0]) <= _STEADY_CHANGE, axis=0)
    units, airs = halves[:, steady].mean(axis=2)
    if not len(airs) or np.ptp(airs) < 2.0 * _LARGEST_CHANGE:
        return []
    rates = np.diff(halves[0, steady], axis=1)[:, 0] / (0.5 * _STEADY_TIME)
    differences = units - airs
    differences = differences + _time_constant(differences, rates, airs) * rates
    low, high = int(differences.argmin()), int(differences.argmax())
    size = float(differences[high] - differences[low])
    limit = _LARGEST_CHANGE + _PART_OF_HEATING * abs(float(np.median(differences)))
    first, last = sorted((low, high))
    values = {
        "first_air_c": float(airs[first]),
        "first_unit_c": float(units[first]),
        "last_air_c": float(airs[last]),
        "last_unit_c": float(units[last]),
    }
    diagnosis = Diagnosis("temperature_sensor", size, unit="K", values=values)
    return [ModelTest("temperature_sensor", size, limit, "K", diagnosis)]


def _time_constant(differences: FloatArray, rates: FloatArray, airs: FloatArray) -> float:
    """Return the time constant of a unit, s, from the change of its difference from the air within each soak.

    Differences between soaks are not used, because a wrong sensor could cause them. Returns 0 if every soak has only
    one window.

    Parameters
    ----------
    differences, rates, airs : unit minus air, K, rate of the unit, K/s, and temperature of the air, °C, shape (n,)
    """
    soak = np.cumsum(np.abs(np.diff(airs, prepend=airs[0])) > _OTHER_AIR)
    counts = np.bincount(soak)
    changes, slopes = (
        values - (np.bincount(soak, values) / np.maximum(counts, 1))[soak] for values in (differences, rates)
    )
    square = float(slopes @ slopes)
    return float(np.clip(-(changes @ slopes) / square, 0.0, _LONGEST)) if square > 0.0 else 0.0


def _means(values: FloatArray) -> FloatArray:
    """Return the means of both halves of n windows, shape (n, 2), ignoring NaN; NaN if a half has no value.

    `values` has the shape (n, m).
    """
    halves = np.array_split(values, 2, axis=1)
    counts = [np.count_nonzero(~np.isnan(half), axis=1) for half in halves]
    sums = [np.nansum(half, axis=1) for half in halves]
    means = [total / np.where(count, count, np.nan) for total, count in zip(sums, counts, strict=True)]
    return np.stack(means, axis=1)
