"""Comparison of a run of a check standard with its reference values.

Two tests share the probability `FALSE_ALARM` equally, so that together they fail an unchanged station and unit with at
most this probability. The normalised error of each parameter, Eₙ = (x − x_ref) / √(U² + U_ref²) with U = 2σ (ISO
13528:2022, 9.7), shows which parameter changed. Its limit is the Bonferroni limit for the largest of n, √χ²₁(1 − p/n) /
2: with a limit of 1, one of 27 correct values would fail in 71 % of all runs. Hotelling's T² = dᵀ (P + P_ref)⁻¹ d, with
the covariance P of the run, is χ² with n degrees of freedom for known covariances (D. C. Montgomery, *Introduction to
Statistical Quality Control*, 7th ed., 2013, 11.3). It detects small changes of many parameters and uses their
correlations. U_ref and P_ref include the expected change of the unit since the reference, from the stability in the IMU
profile.
"""

from collections.abc import Collection, Mapping
from datetime import UTC, datetime, time
from statistics import NormalDist

import numpy as np
from pydantic import Field

from calstation.config import CheckStandardSection
from calstation.devices.profiles import ImuProfile
from calstation.estimation.common import Posterior, chi_square_quantile
from calstation.judgement.limits import COVERAGE_FACTOR
from calstation.physics import INDEX, FloatArray, group_indices
from calstation.schema import Number, ResultSection

#: Probability that a run fails although neither station nor unit changed beyond their stated uncertainties.
FALSE_ALARM = 0.0027

#: Probability with which a run detects an error of the size of `StandardComparison.detectable`.
POWER = 0.9

#: Durations of a day and a year, s.
_DAY, _YEAR = 86400.0, 365.25 * 86400.0
_MOUNTING = frozenset(group_indices("outer_lever"))


class StandardComparison(ResultSection):
    """Comparison of a check standard's values with its reference."""

    passed: bool
    e_n: dict[str, Number]  #: Normalised error of each parameter, by name.
    e_n_limit: Number  #: Largest magnitude of a normalised error that passes.
    t_squared: Number  #: Hotelling's T² of all parameters together.
    t_squared_limit: Number
    degrees: int  #: Number of parameters compared.
    false_alarm: Number  #: Probability that an unchanged station and unit fail.
    #: Smallest true error of each parameter that its normalised error detects with 90 % probability, SI.
    detectable: dict[str, Number] = Field(default_factory=dict)


def judge_standard(
    standard: CheckStandardSection, imu: ImuProfile, started: datetime, estimate: Posterior, determined: Collection[str]
) -> StandardComparison:
    """Compare a run of a check standard with its reference.

    `estimate` is the estimate of the run that began at `started`. The parameters that are both `determined` by its data
    and contained in the reference are compared; a run without any of them fails. Other parameters have the large
    sigma of the prior: they could not fail, but would increase both limits for the others.
    """
    names = [name for name in standard.reference if name in determined and INDEX[name] not in _MOUNTING]
    indices = [INDEX[name] for name in names]
    reference = [standard.reference[name] for name in names]
    expected = reference_variances(standard, imu, np.array([started.timestamp()]))
    variance = np.array([float(expected[name][0]) for name in names])
    difference = estimate.mean[indices] - np.array([r.value for r in reference])
    covariance = estimate.covariance[np.ix_(indices, indices)] + np.diag(variance)
    sigma = np.sqrt(np.diag(covariance))
    errors = difference / (COVERAGE_FACTOR * sigma)
    count, each = len(names), 0.5 * FALSE_ALARM
    limit = float(np.sqrt(chi_square_quantile(1.0 - each / max(count, 1), 1))) / COVERAGE_FACTOR
    # x - x_ref is normal with the true error as mean: P(error beyond the limit) = POWER. The other limit is more than 7
    # sigma away and adds less than 1e-12.
    detectable = (COVERAGE_FACTOR * limit + NormalDist().inv_cdf(POWER)) * sigma
    t_squared = float(difference @ np.linalg.solve(covariance, difference)) if count else 0.0
    t_squared_limit = float(chi_square_quantile(1.0 - each, max(count, 1)))
    return StandardComparison(
        passed=bool(count and (np.abs(errors) <= limit).all() and t_squared <= t_squared_limit),
        e_n=dict(zip(names, errors.tolist(), strict=True)),
        e_n_limit=limit,
        t_squared=t_squared,
        t_squared_limit=t_squared_limit,
        degrees=count,
        false_alarm=FALSE_ALARM,
        detectable=dict(zip(names, detectable.tolist(), strict=True)),
    )


def reference_variances(
    standard: CheckStandardSection, imu: ImuProfile, started: FloatArray
) -> Mapping[str, FloatArray]:
    """Return the variances of true minus reference values by parameter, SI, for runs at `started`, s since 1970, UTC.

    A variance is the sum of those of the reference and of the unit's change since the date of the reference.
    """
    years = np.zeros(len(started))
    if standard.date is not None:
        begin = datetime.combine(standard.date, time.min, UTC).timestamp()
        years = np.maximum(started - begin, 0.0) // _DAY * _DAY / _YEAR
    at_power_up, within_a_year = (imu.change_sigmas(age) ** 2 for age in (0.0, 1.0))
    return {
        name: reference.sigma**2 + at_power_up[k] + years * (within_a_year - at_power_up)[k]
        for name, reference in standard.reference.items()
        for k in (INDEX[name],)
    }
