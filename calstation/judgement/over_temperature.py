"""Comparison with limits over a range of temperatures: worst value, largest sigma, and hysteresis."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from calstation.estimation import Diagnosis, Estimate, Solution
from calstation.estimation.temperature import TemperatureFit, UpDown
from calstation.judgement.check import Check, Where
from calstation.physics import INDEX, PARAMETERS, entry_of
from calstation.records import Limit

#: Smallest difference between rising and falling temperature that counts, in sigmas: of 30 parameters, one is larger in
#: 10 million runs.
_UP_DOWN_SIGMAS = 6.0


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

    Half of the difference of a parameter between rising and falling temperature is an error of its polynomial. It may
    be as large as the limit of the parameter's sigma, or not significant.

    Parameters
    ----------
    solution : solution of the stage
    limits : limits of the product by parameter or group
    near : fraction of its limit from which a value is a near miss
    """
    fit = solution.temperature
    rows = [] if fit is None else [row for row in fit.up_down if row.parameter in solution.estimated]
    if fit is None or not rows:
        return []

    def largest(row: UpDown) -> float:
        limit = entry_of(limits, row.parameter)
        permitted = None if limit is None else limit.sigma_limit(solution.stage)
        return max(permitted or 0.0, 0.5 * _UP_DOWN_SIGMAS * row.sigma)

    worst = max(rows, key=lambda row: abs(row.difference) / largest(row))
    i, half = INDEX[worst.parameter], 0.5 * abs(worst.difference)
    unit, where = PARAMETERS[i].unit, Where(worst.parameter)
    check = Check.compare("hysteresis", half, largest(worst), unit, subject=solution.stage, near=near, where=where)
    if check.passed:
        return [check]
    sigma = fit.at(fit.model.reference).sigma
    shifts = {row.parameter: 0.5 * row.difference / float(sigma[INDEX[row.parameter]]) for row in rows}
    values = {"parameter": worst.parameter, "group": PARAMETERS[i].group}
    hysteresis = Diagnosis("temperature_hysteresis", worst.difference, worst.sigma, unit, shifts, values)
    return [replace(check, diagnosis=hysteresis)]
