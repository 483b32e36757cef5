"""Conformity with limits: the probability that a decision is wrong, for one unit and for all units of a product.

Clause numbers refer to JCGM 106:2012, *The role of measurement uncertainty in conformity assessment*.

The true value y of a unit is drawn from N(μ, s²), with the spread s of the product about the middle μ of the limits
(9.2). The solver's estimate m with standard deviation σ contains the prior N(m₀, p²) of the IMU profile; given y,

    m ~ N(κ y + (1 − κ) m₀, κ σ²),  κ = 1 − σ²/p²,

which is N(y, σ²) if the data determine the parameter. A previous calibration of the same unit is also data: κ = 1.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from pydantic import Field
from scipy.special import ndtr, owens_t

from calstation.estimation import Estimate, Solution
from calstation.estimation.common import Posterior
from calstation.judgement.check import Check
from calstation.judgement.limits import COVERAGE_FACTOR, acceptance_interval
from calstation.judgement.over_temperature import worst_estimate
from calstation.physics import INDEX, PARAMETERS, entry_of
from calstation.records import ConformitySection, LogMeta, Rule
from calstation.schema import Number, ResultSection

#: Lowest and highest value.
Interval = tuple[float, float]

#: Value that replaces a denominator of 0.
_TINY = 1e-300

#: √(1 − ρ²) below which ρ is set to 1, because rounding errors in Owen's formula are divided by it.
_SMALLEST_ROOT = 1e-8


class ParameterConformity(ResultSection):
    """Decision on a parameter with limits of its value, and the probabilities of a wrong decision.

    `false_accept` and `false_reject` require the spread of the product and apply to all its units, not only to this
    one.
    """

    accepted: bool
    limits: tuple[Number, Number]
    acceptance: tuple[Number, Number]  #: Lowest and highest accepted value.
    outside: Number  #: Probability that the true value of this unit is outside the limits.
    probability: Number  #: Probability that the decision is wrong: false accept if accepted, else false reject.
    spread: float | None = None  #: Standard deviation of the true values of the product's units.
    false_accept: float | None = None  #: Probability that a unit is outside the limits and accepted.
    false_reject: float | None = None  #: Probability that a unit is within the limits and not accepted.


class Conformity(ResultSection):
    """Decision rule of a result, and the decisions by parameter."""

    rule: Rule
    coverage_factor: float = COVERAGE_FACTOR  #: Ratio of expanded to standard uncertainty.
    parameters: dict[str, ParameterConformity] = Field(default_factory=dict)


@dataclass(frozen=True)
class Measurement:
    """An estimate with its standard deviation, and the prior that it contains; infinitely wide if there is none."""

    value: float
    sigma: float
    prior_mean: float = 0.0
    prior_sigma: float = math.inf

    @property
    def response(self) -> float:
        """Derivative of the estimate with respect to the true value, κ, from 0 for a useless measurement to 1."""
        return max(0.0, 1.0 - (self.sigma / self.prior_sigma) ** 2)


def probability_outside(measured: Measurement, limits: Interval, spread: float | None = None) -> float:
    """Return the probability that the true value is outside the limits, given the estimate (7.1, 7.4).

    Without a spread, the true value has the distribution given by the solver. With it, the prior N(μ, spread²) of the
    product replaces the prior of the IMU profile, and Bayes' theorem (6.2) gives a normal distribution with

        1/u² = κ/σ² + 1/s²,  mean = u² ((m − (1 − κ) m₀)/σ² + μ/s²).

    Parameters
    ----------
    measured : estimate with its sigma and prior
    limits : limits of the value, in the unit of the estimate
    spread : standard deviation of the product, in the same unit; None if it is unknown
    """
    mean, sigma = measured.value, measured.sigma
    if spread is not None:
        kappa = measured.response
        precision = kappa / sigma**2 + spread**-2
        data = (mean - (1.0 - kappa) * measured.prior_mean) / sigma**2
        mean, sigma = (data + _middle(limits) * spread**-2) / precision, precision**-0.5
    return float(ndtr((limits[0] - mean) / sigma) + ndtr((mean - limits[1]) / sigma))


def product_risks(measured: Measurement, limits: Interval, spread: float, rule: Rule) -> tuple[float, float]:
    """Return the global probabilities of false accept and of false reject of a product (9.5.2).

    They are the consumer's risk ∬ over y outside the limits and m accepted, and the producer's risk ∬ over y within the
    limits and m not accepted, of the bivariate normal density of true value and estimate with the sigma of `measured`.

    Parameters
    ----------
    measured : estimate with its sigma and prior
    limits : limits of the value, in the unit of the estimate
    spread : standard deviation of the product, in the same unit
    rule : decision rule
    """
    mean, kappa = _middle(limits), measured.response
    accepted = acceptance_interval(limits, measured.sigma, rule)
    within = [(bound - mean) / spread for bound in limits]
    total = math.hypot(math.sqrt(kappa) * spread, measured.sigma)
    sigma = math.sqrt(kappa) * total or _TINY
    expected = kappa * mean + (1.0 - kappa) * measured.prior_mean
    low, high = ((bound - expected) / sigma for bound in accepted)
    conforming = float(ndtr(within[1]) - ndtr(within[0]))
    if low > high:
        return 0.0, conforming
    rho, root = math.sqrt(kappa) * spread / total, measured.sigma / total
    if root < _SMALLEST_ROOT:
        both = max(0.0, float(ndtr(min(within[1], high)) - ndtr(max(within[0], low))))
    else:
        both = (
            bivariate_normal(within[1], high, rho, root)
            - bivariate_normal(within[0], high, rho, root)
            - bivariate_normal(within[1], low, rho, root)
            + bivariate_normal(within[0], low, rho, root)
        )
    return max(0.0, float(ndtr(high) - ndtr(low)) - both), max(0.0, conforming - both)


def bivariate_normal(h: float, k: float, rho: float, root: float) -> float:
    """Return P(X ≤ h, Y ≤ k) of standard normal X and Y with correlation |rho| < 1, where root = √(1 − rho²).

    D. B. Owen, *Tables for computing bivariate normal probabilities*, Ann. Math. Statist. 27(4), 1956, eq. 2.1.

    Parameters
    ----------
    h, k : upper bounds of X and Y, in standard deviations
    rho : correlation of X and Y
    root : √(1 − rho²)
    """
    if math.isinf(h) or math.isinf(k):
        return float(ndtr(h) if k == math.inf else ndtr(k) if h == math.inf else 0.0)
    h, k = h or _TINY, k or _TINY
    p = 0.5 * (ndtr(h) + ndtr(k)) - owens_t(h, (k - rho * h) / (h * root)) - owens_t(k, (h - rho * k) / (k * root))
    return float(p - (0.5 if (h > 0.0) != (k > 0.0) else 0.0))


def conformity(
    meta: LogMeta, prior: Posterior, solutions: Sequence[Solution], checks: Sequence[Check]
) -> Conformity | None:
    """Return the decisions on the values in `checks` and their probabilities; None if there are none."""
    if not solutions:
        return None
    section, decisions = conformity_section(meta), {}
    for check in checks:
        if check.kind == "within" and isinstance(check.limit, tuple):
            name = check.subject
            measured, spread = _measurement(meta, name, prior, solutions, check.limit), entry_of(section.spread, name)
            if measured.sigma == 0.0:
                continue  # fixed, not measured
            outside = probability_outside(measured, check.limit, spread)
            risks = {}
            if spread is not None:
                accept, reject = product_risks(measured, check.limit, spread, section.rule)
                risks = {"spread": spread, "false_accept": accept, "false_reject": reject}
            decisions[name] = ParameterConformity(
                accepted=check.passed,
                limits=check.limit,
                acceptance=check.acceptance or check.limit,
                outside=outside,
                probability=outside if check.passed else 1.0 - outside,
                **risks,
            )
    return Conformity(rule=section.rule, parameters=decisions) if decisions else None


def conformity_section(meta: LogMeta) -> ConformitySection:
    """Return the decision rule and the spreads of the product in a log's configuration."""
    return (meta.product.conformity if meta.product is not None else None) or ConformitySection()


def _measurement(
    meta: LogMeta, name: str, prior: Posterior, solutions: Sequence[Solution], limits: Interval
) -> Measurement:
    """Return the value and sigma that are compared with the limits, the worst over a range of temperatures."""
    if name not in INDEX:
        estimate = next(s.estimates[name] for s in reversed(solutions) if name in s.estimates)
        return Measurement(estimate.value, estimate.sigma)
    i, posterior = INDEX[name], solutions[-1].posterior
    estimate = Estimate(float(posterior.mean[i]), float(posterior.sigma[i]), PARAMETERS[i].unit)
    worst = worst_estimate(solutions, name, limits, estimate)
    if name in meta.calibrated:
        return Measurement(worst.value, worst.sigma)
    return Measurement(worst.value, worst.sigma, float(prior.mean[i]), float(prior.sigma[i]))


def _middle(limits: Interval) -> float:
    middle = 0.5 * (limits[0] + limits[1])
    return middle if math.isfinite(middle) else 0.0
