"""Comparison of a chain of solutions with the limits of its product."""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from calstation.estimation import Diagnosis, Estimate, Solution
from calstation.estimation.common import Posterior
from calstation.judgement.check import Check, Where
from calstation.judgement.over_temperature import check_up_down, fit_over_temperature, worst_estimate
from calstation.physics import (
    GROUP_BY_NAME,
    INDEX,
    NAMES,
    OBSERVABLE,
    PARAMETERS,
    display,
    entry_of,
)
from calstation.records import MODEL_KINDS, NEAR_MISS_FRACTION, Limit, Rule

#: Coverage factor of the expanded uncertainty.
COVERAGE_FACTOR = 2.0
#: Largest change of a parameter at which the unit agrees with its current calibration, in standard deviations.
_CHANGED = 6.0
#: Largest change of a parameter at which the data agree with the prior in a profile, in standard deviations. Any of 30
#: changes of a good unit exceeds it in 1 of 60,000 runs.
_UNLIKE_PRIOR = 5.0
#: Largest ratio of posterior to prior variance of a parameter that is compared with its prior.
_DETERMINED = 0.25
#: Smallest relative decrease of a variance that is not attributed to rounding.
_RESOLVED = 1e-6


def acceptance_interval(limits: tuple[float, float], sigma: float, rule: Rule) -> tuple[float, float]:
    """Return the lowest and highest accepted value; nothing is accepted if the lowest is above the highest.

    The rule is simple acceptance (JCGM 106:2012, 8.2) or guarded acceptance with a guard band of the expanded
    uncertainty on each side (8.3.2 and ILAC-G8:09/2019, 4.2).

    Parameters
    ----------
    limits : lowest and highest permitted true value
    sigma : standard uncertainty of the value
    rule : decision rule
    """
    guard = COVERAGE_FACTOR * sigma if rule == "guard_band" else 0.0
    return limits[0] + guard, limits[1] - guard


def estimated_stage(solutions: Sequence[Solution]) -> dict[str, str]:
    """Return the last stage that estimated each parameter, in the order of the parameter table."""
    last = {name: solution.stage for solution in solutions for name in solution.estimated}
    return {name: last[name] for name in NAMES if name in last}


def unobservable(prior: Posterior, solutions: Sequence[Solution]) -> list[str]:
    """Return the estimated parameters that the data do not determine.

    These are parameters whose sigma, the largest over the range of temperatures, exceeds 0.9 of the prior sigma; that
    were unobservable in every stage that estimated them, so that only a prior correlation has reduced their sigma; or
    whose sigma depends on an assumed scatter.
    """
    if not solutions:
        return []
    before, after = prior.sigma, solutions[-1].posterior.sigma
    fit = fit_over_temperature(solutions)
    if fit is not None:
        after = np.maximum(after, fit.largest_sigma)
    names = [
        name
        for name in estimated_stage(solutions)
        if before[INDEX[name]] > 0
        and (
            after[INDEX[name]] > OBSERVABLE * before[INDEX[name]]
            or _not_observed(name, solutions)
            or all(name in s.assumed for s in solutions if name in s.estimated)
        )
    ]
    return names + [name for s in solutions for name, e in s.estimates.items() if not e.determined]


def undetermined(prior: Posterior, solutions: Sequence[Solution], calibrated: Collection[str]) -> list[str]:
    """Return the unobservable parameters that are not known from the current calibration.

    The parameters in `calibrated` are known if the data determine at least half of the parameters. A run with less
    information, such as a stage that ended after its first rest, is not a calibration.
    """
    names, estimated = unobservable(prior, solutions), estimated_stage(solutions)
    calibrated_names = calibrated if 2 * sum(name in names for name in estimated) <= len(estimated) else ()
    return [name for name in names if name not in calibrated_names]


def _not_observed(name: str, solutions: Sequence[Solution]) -> bool:
    """Return whether, in all stages that estimated a parameter, the observability analysis found it unobservable."""
    states = [s.observability.get("states", {}).get(name) for s in solutions if name in s.estimated]
    return all(state is not None and state["step"] is None for state in states)


def not_compared(limits: Mapping[str, Limit], prior: Posterior, solutions: Sequence[Solution]) -> list[str]:
    """Return the parameters with a limit that no stage estimated, or that the data do not determine.

    A partial run is judged only by its own stages, without a statement about these parameters. Parameters that the
    table fixes, so that their sigma is 0 before the first stage, are known.
    """
    known = {p.name for p, sigma in zip(PARAMETERS, prior.sigma, strict=True) if sigma == 0.0}
    compared = {*estimated_stage(solutions), *(name for s in solutions for name in s.estimates)}
    compared -= {*unobservable(prior, solutions)}
    limited = [name for name, group in GROUP_BY_NAME.items() if name in limits or group in limits]
    return [name for name in limited if name not in compared and name not in known]


def check_limits(
    limits: Mapping[str, Limit],
    prior: Posterior,
    solutions: Sequence[Solution],
    near: float = NEAR_MISS_FRACTION,
    calibrated: Collection[str] = (),
    rule: Rule = "simple",
) -> list[Check]:
    """Compare the result of a chain of stages with the limits of its product by a decision rule.

    A parameter's limit overrides the limit of its group; only parameters that were estimated and determined by the data
    are compared. The checks of the innovations and of undetermined parameters have no near miss.

    Parameters
    ----------
    limits : limits by parameter or group, SI
    prior, solutions : estimate before the first stage, and the solution of each stage
    near : fraction of a limit above which a value is a near miss
    calibrated : parameters whose prior is the current calibration; their change is compared with its sigma
    rule : decision rule
    """
    if not solutions:
        return []
    posterior = solutions[-1].posterior
    sigma, undetermined_names = posterior.sigma, unobservable(prior, solutions)
    checks = []
    for name, stage in estimated_stage(solutions).items():
        if name in undetermined_names:
            continue
        i = INDEX[name]
        limit = entry_of(limits, name)
        if limit is not None:
            estimate = Estimate(float(posterior.mean[i]), float(sigma[i]), PARAMETERS[i].unit)
            estimate = worst_estimate(solutions, name, limit.interval, estimate)
            checks += _check_estimate(name, estimate, limit, limit.sigma_limit(stage), near, rule)
    for s in solutions:
        for name, estimate in s.estimates.items():
            limit = entry_of(limits, name)
            if limit is not None:
                checks += _check_estimate(name, estimate, limit, limit.sigma_below, near, rule)
    last = solutions[-1]
    model = [check for s in solutions for check in _model_checks(s, last=s is last)]
    model += [check for s in solutions for check in check_up_down(s, limits, near)]
    checks += sorted(model, key=lambda check: [*MODEL_KINDS].index(check.kind))
    checks += [check for s in solutions for check in _consistency(s)]
    unknown = undetermined(prior, solutions, calibrated)
    checks.append(Check("unobservable", "", float(len(unknown)), 0.0, "1", not unknown))
    changes = _changes(prior, posterior, [n for n in estimated_stage(solutions) if n in calibrated])
    if changes:
        worst = max(changes, key=lambda name: changes[name])
        checks.append(Check.compare("change", changes[worst], _CHANGED, "sigma", near=1.0, where=Where(worst)))
    return checks


def final_checks(solution: Solution) -> list[Check]:
    """Return the checks of a stage that later stages do not change: those of its innovations and of its data."""
    return [*_consistency(solution), *_model_checks(solution, last=False)]


def _model_checks(solution: Solution, *, last: bool) -> list[Check]:
    """Return the checks of the data and the model of a stage; only the `last` stage tests effects, for all stages."""
    tests = [test for test in solution.tests if last or test.kind not in ("effects", "alternatives")]
    return [Check.of_model(solution.stage, test) for test in tests]


def _consistency(solution: Solution) -> list[Check]:
    """Return the check of the innovations of a stage, if it has any."""
    c = solution.consistency
    diagnosis = None if c.passed else solution.diagnosis
    check = Check("consistency", solution.stage, c.nis_mean, c.nis_high, "1", bool(c.passed), diagnosis=diagnosis)
    return [check] if c.count else []


def check_prior(prior: Posterior, solutions: Sequence[Solution], stated: Collection[str]) -> list[Check]:
    """Compare the parameters that the data determine with their prior; [] if there are none.

    The prior pulls the estimate towards its mean. The change is therefore compared with the standard deviation of the
    change, not with that of the prior.

    Parameters
    ----------
    prior : posterior before the first stage
    solutions : solutions of the stages, in order
    stated : parameters with a prior in a profile or a configuration
    """
    if not solutions:
        return []
    posterior, unknown = solutions[-1].posterior, unobservable(prior, solutions)
    ratio = np.diag(posterior.covariance) / np.where(prior.sigma > 0.0, prior.sigma**2, np.nan)
    names = [
        name
        for name in estimated_stage(solutions)
        if name in stated and name not in unknown and ratio[INDEX[name]] < _DETERMINED
    ]
    changes = _changes(prior, posterior, names)
    if not changes:
        return []
    worst = max(changes, key=lambda name: changes[name])
    check = Check.compare("prior", changes[worst], _UNLIKE_PRIOR, "sigma", near=1.0, where=Where(worst))
    if check.passed:
        return [check]
    i = INDEX[worst]
    unit, mean = PARAMETERS[i].unit, display(worst, float(prior.mean[i]))[0]
    unlike = {name: change for name, change in changes.items() if change > _UNLIKE_PRIOR}
    values = {"parameter": worst, "mean": mean, "sigmas": changes[worst]}
    diagnosis = Diagnosis("prior_unlike", float(posterior.mean[i]), float(prior.sigma[i]), unit, unlike, values)
    return [replace(check, diagnosis=diagnosis)]


def change_sigma(before: float, after: float) -> float | None:
    """Return the standard deviation of the change of an estimate by more data, or None if the data do not improve it.

    Its variance is the decrease of the estimate's variance; `before` and `after` are the estimate's sigmas.
    """
    variance = before**2 - after**2
    return math.sqrt(variance) if variance > _RESOLVED * before**2 else None


def _changes(prior: Posterior, after_data: Posterior, names: Sequence[str]) -> dict[str, float]:
    """Return the change of each parameter by the data, in standard deviations of the change expected from the prior."""
    changes = {}
    for name in names:
        i = INDEX[name]
        sigma = change_sigma(float(prior.sigma[i]), float(after_data.sigma[i]))
        if sigma is not None:
            changes[name] = float(abs(after_data.mean[i] - prior.mean[i])) / sigma
    return changes


def _check_estimate(
    name: str, estimate: Estimate, limit: Limit, sigma_limit: float | None, near: float, rule: Rule
) -> list[Check]:
    checks, unit = [], estimate.unit
    if limit.interval is not None:
        accepted = None if rule == "simple" else acceptance_interval(limit.interval, estimate.sigma, rule)
        check = Check.compare(
            "within", estimate.value, limit.interval, unit, subject=name, near=near, acceptance=accepted
        )
        if accepted is not None and accepted[0] > accepted[1]:
            guard = COVERAGE_FACTOR * estimate.sigma
            check = replace(check, diagnosis=Diagnosis("guard_band", guard, unit=unit, values={"parameter": name}))
        checks.append(check)
    if sigma_limit is not None:
        checks.append(Check.compare("sigma_below", estimate.sigma, sigma_limit, unit, subject=name, near=near))
    return checks
