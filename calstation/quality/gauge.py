"""Repeatability and reproducibility of a measurement (GR&R): balanced crossed analysis of variance, random effects.

The units are crossed with one or more factors: operators, stations. Each term of the model is a set of factors. Its
mean square has the expectation sigma² + the sum of n_T sigma_T² over all terms T that contain it (n_T: number of
measurements at each combination of levels of T), which yields the variance components by inclusion and exclusion.

Sources: AIAG, *Measurement Systems Analysis*, 4th ed., 2010, chapter III section B and appendix A; D. C. Montgomery,
*Design and Analysis of Experiments*, 8th ed., 2013, chapter 13, also for approximate F tests (F. E. Satterthwaite,
Biometrics Bulletin 2, 1946, 110-114); for the generalised confidence intervals S. Weerahandi, Journal of the American
Statistical Association 88, 1993, 899-905, and R. K. Burdick, C. M. Borror and D. C. Montgomery, *Design and Analysis of
Gauge R&R Studies*, 2005, appendix B.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations, product
from typing import Literal

import numpy as np
from scipy.special import fdtrc, gammaincinv, ndtr

from calstation.errors import InputError
from calstation.physics import BoolArray, FloatArray

#: Factor whose variation is measured.
UNIT = "unit"
#: Interactions with a larger p-value are pooled with the repeatability.
_MAX_P_VALUE = 0.25
#: Percentages of the study variation or tolerance at which the verdict changes, and the required number of categories.
ACCEPTABLE, MARGINAL = 10.0, 30.0
MIN_CATEGORIES = 5
#: Width of the measurement's spread, in its sigmas, that is compared with the tolerance.
_SPREAD_WIDTH = 6.0
#: Number of categories for a ratio of part to measurement variation of 1: sqrt(2), as rounded by AIAG.
_CATEGORY_FACTOR = 1.41
#: Number of draws for a generalised confidence interval, and their fixed seed, which makes intervals reproducible.
_DRAWS, _SEED = 10_000, 1

Verdict = Literal["acceptable", "marginal", "unacceptable"]

#: Factors of a term of the model.
Term = frozenset[str]
#: Term of the repeatability.
_ERROR: Term = frozenset()
#: Coefficients of mean squares by term.
_Combination = Mapping[Term, float]


@dataclass(frozen=True)
class AnovaRow:
    """A row of the analysis of variance."""

    source: str  #: Factors joined by ``*``, or ``repeatability``.
    dof: int
    sum_squares: float
    mean_square: float
    #: Ratio to the mean square that tests it; None for the last row, or if that mean square is not positive.
    f: float | None
    p: float | None  #: Probability of a larger ratio by chance.
    pooled: bool  #: Whether the term is pooled with the repeatability.


@dataclass(frozen=True)
class Variation:
    """A component of the variation, as a standard deviation in the unit of the values."""

    sigma: float
    low: float  #: Lower confidence limit of `sigma`.
    high: float  #: Upper confidence limit of `sigma`.
    percent_study: float  #: Share of the total variation, %.
    percent_tolerance: float | None  #: 6 sigma as a share of the tolerance, %; None without a tolerance.


@dataclass(frozen=True)
class GaugeStudy:
    """Result of a study of units and trials crossed with one or more factors."""

    levels: Mapping[str, int]  #: Number of levels of each factor, the units first.
    trials: int
    confidence: float
    anova: tuple[AnovaRow, ...]
    components: Mapping[str, Variation]  #: Component of each term that is not pooled, by its source as in `anova`.
    repeatability: Variation  #: EV.
    reproducibility: Variation  #: AV: all components except the units.
    interaction: Variation | None  #: All interactions with the units; None if they are pooled.
    gauge: Variation  #: GRR: all of the above.
    part: Variation  #: PV: variation of the units.
    total: Variation  #: TV.

    @property
    def categories(self) -> int:
        """Number of distinct categories (ndc)."""
        ratio = _CATEGORY_FACTOR * self.part.sigma / self.gauge.sigma
        return math.floor(ratio)

    @property
    def verdict(self) -> Verdict:
        """Verdict by the fraction of the tolerance if there is one, otherwise of the study variation."""
        percent = self.gauge.percent_tolerance
        return verdict(self.gauge.percent_study if percent is None else percent)


def verdict(percent: float) -> Verdict:
    """Return AIAG's verdict for a share of the variation or tolerance: acceptable to 10 %, marginal to 30 %."""
    return "acceptable" if percent <= ACCEPTABLE else "marginal" if percent <= MARGINAL else "unacceptable"


def range_limits(values: FloatArray) -> tuple[float, float, float]:
    """Return lower control limit, mean and upper control limit of the ranges of `values`, shape (..., trials)."""
    center = float(np.ptp(values, axis=-1).mean())
    mean, deviation = _range_moments(values.shape[-1])
    width = 3.0 * deviation / mean * center
    return max(center - width, 0.0), center, center + width


def ranges_beyond(values: FloatArray) -> BoolArray:
    """Return whether each range of `values`, shape (..., trials), is beyond the control limits of all ranges."""
    ranges, (low, _, high) = np.ptp(values, axis=-1), range_limits(values)
    return np.asarray((ranges > high) | (ranges < low))


@lru_cache(maxsize=8)
def _range_moments(count: int) -> tuple[float, float]:
    """Return mean and standard deviation of the range of normally distributed values, in sigmas (d2 and d3).

    The range is at most r with the probability n times the integral of density(x) (Phi(x + r) - Phi(x))^(n - 1).
    """
    grid, step = np.linspace(-9.0, 9.0, 1201, retstep=True)
    ranges = grid - grid[0]
    density = np.exp(-0.5 * grid**2) / math.sqrt(2.0 * math.pi)
    inside = ndtr(np.add.outer(ranges, grid)) - ndtr(grid)
    above = 1.0 - count * step * inside ** (count - 1) @ density
    mean = float(np.trapezoid(above, dx=step))
    square = 2.0 * float(np.trapezoid(ranges * above, dx=step))
    return mean, math.sqrt(square - mean**2)


def crossed(
    factors: Sequence[str], rows: Iterable[tuple[tuple[str, ...], float]]
) -> tuple[list[list[str]], FloatArray]:
    """Return the levels of each factor and the values, shape (number of levels of each factor, trials).

    Each of `rows` contains the levels of the `factors` and a value. Raises InputError if not every combination was
    measured equally often, or if there are fewer than two levels of a factor or fewer than two trials.
    """
    cells: dict[tuple[str, ...], list[float]] = {}
    for key, value in rows:
        cells.setdefault(key, []).append(value)
    levels = [list(dict.fromkeys(key[k] for key in cells)) for k in range(len(factors))]
    keys = list(product(*levels))
    max_count = max(map(len, cells.values()), default=0)
    incomplete = [f"{', '.join(key)}: {len(cells.get(key, ()))}" for key in keys if len(cells.get(key, ())) < max_count]
    if incomplete:
        raise InputError("quality.unbalanced", trials=max_count, cells="; ".join(incomplete))
    check_size({name: len(names) for name, names in zip(factors, levels, strict=True)}, max_count)
    shape = (*map(len, levels), max_count)
    return levels, np.array([cells[key] for key in keys]).reshape(shape)


def check_size(levels: Mapping[str, int], trials: int) -> None:
    """Raise InputError if there are fewer than two levels of a factor, or fewer than two trials."""
    for name, count in {**levels, "trial": trials}.items():
        if count < 2:
            raise InputError("quality.small_study", factor=name, count=count)


def gauge_study(
    factors: Sequence[str], values: FloatArray, tolerance: float | None = None, *, confidence: float = 0.95
) -> GaugeStudy:
    """Return the repeatability and reproducibility of a crossed design.

    Parameters
    ----------
    factors : names of the factors, `UNIT` first
    values : shape (number of levels of each factor, trials), at least two of each
    tolerance : width of the tolerance in the unit of the values, or None
    confidence : probability of the confidence intervals

    Raises
    ------
    InputError : if all repeated measurements are equal
    """
    if not np.ptp(values, axis=-1).any():
        raise InputError("quality.no_repeatability")
    levels = dict(zip(factors, values.shape, strict=False))
    squares, dofs = _sums_of_squares(levels, values)
    tests: dict[Term, tuple[float | None, float | None]] = {}
    model = _Model(squares, dofs)
    for size in range(len(factors), 1, -1):
        tests_of_size = {
            term: model.test(term) for term in model.terms if len(term) == size and not model.containing(term)
        }
        tests |= tests_of_size
        model = model.pooled([term for term, (_, p) in tests_of_size.items() if p is not None and p > _MAX_P_VALUE])
    tests |= {term: model.test(term) for term in model.terms}
    variances = {term: model.variance(term, values.size, levels) for term in (_ERROR, *model.terms)}
    sizes = {term: max(model.value(each), 0.0) for term, each in variances.items()}
    part = frozenset({UNIT})
    others = [term for term in model.terms if UNIT not in term]
    interactions = [term for term in model.terms if UNIT in term and term != part]
    gauge = [_ERROR, *others, *interactions]

    def variation(terms: Sequence[Term]) -> Variation:
        # a negative variance estimate is set to 0, so that the total equals the sum of the displayed components
        sigma = math.sqrt(sum(sizes[term] for term in terms))
        low, high = model.interval([variances[term] for term in terms], (1.0 - confidence) / 2.0)
        share = None if tolerance is None else 100.0 * _SPREAD_WIDTH * sigma / tolerance
        percent = 100.0 * sigma / math.sqrt(sum(sizes.values()))
        return Variation(sigma, math.sqrt(low), math.sqrt(high), percent, share)

    anova = []
    for term, square in squares.items():
        f, p = tests.get(term, (None, None))
        row = _source(term), dofs[term], square, square / dofs[term], f, p, term not in variances
        anova.append(AnovaRow(*row))
    return GaugeStudy(
        levels=levels,
        trials=values.shape[-1],
        confidence=confidence,
        anova=tuple(anova),
        components={_source(term): variation([term]) for term in model.terms},
        repeatability=variation([_ERROR]),
        reproducibility=variation(others),
        interaction=variation(interactions) if interactions else None,
        gauge=variation(gauge),
        part=variation([part]),
        total=variation([*gauge, part]),
    )


def _source(term: Term) -> str:
    """Return the name of a term: its factors, the units first, or ``repeatability``."""
    return "*".join(sorted(term, key=lambda name: (name != UNIT, name))) or "repeatability"


def _sums_of_squares(levels: Mapping[str, int], values: FloatArray) -> tuple[dict[Term, float], dict[Term, int]]:
    """Return sums of squares and degrees of freedom of all terms, the repeatability last."""
    names = list(levels)
    effects: dict[Term, FloatArray] = {_ERROR: values.mean(keepdims=True)}
    squares, dofs = {}, {}
    for size in range(1, len(names) + 1):
        for term in map(frozenset, combinations(names, size)):
            others = tuple(k for k, name in enumerate((*names, "trial")) if name not in term)
            effect = values.mean(axis=others, keepdims=True)
            for contained, other in effects.items():
                if contained < term:
                    effect = effect - other
            effects[term] = effect
            squares[term] = float(np.sum(effect**2)) * values.size / effect.size
            dofs[term] = math.prod(levels[name] - 1 for name in term)
    squares[_ERROR] = float(np.sum((values - values.mean(axis=-1, keepdims=True)) ** 2))
    dofs[_ERROR] = values.size - values.size // values.shape[-1]
    return squares, dofs


@dataclass(frozen=True)
class _Model:
    """Sums of squares and degrees of freedom of the terms of a model and of its repeatability."""

    squares: Mapping[Term, float]
    dofs: Mapping[Term, int]

    @property
    def terms(self) -> list[Term]:
        return [term for term in self.squares if term]

    def containing(self, term: Term) -> list[Term]:
        """Return the larger terms that contain a term."""
        return [other for other in self.terms if other > term]

    def pooled(self, terms: Sequence[Term]) -> "_Model":
        """Return the model in which these terms are pooled with the repeatability."""
        squares, dofs = dict(self.squares), dict(self.dofs)
        for term in terms:
            squares[_ERROR] += squares.pop(term)
            dofs[_ERROR] += dofs.pop(term)
        return _Model(squares, dofs)

    def expected(self, term: Term) -> dict[Term, float]:
        """Return the combination of mean squares with the expectation of a term's mean square if its variance is 0."""
        combination = {_ERROR: 1.0}
        for other in self.containing(term):
            combination[other] = combination.get(other, 0.0) + 1.0
            for contained, factor in self.expected(other).items():
                combination[contained] = combination.get(contained, 0.0) - factor
        return combination

    def variance(self, term: Term, count: int, levels: Mapping[str, int]) -> dict[Term, float]:
        """Return the combination of mean squares that estimates the variance of a term from `count` values."""
        if not term:
            return {_ERROR: 1.0}
        scale = math.prod(levels[name] for name in term) / count
        return {term: scale} | {each: -scale * factor for each, factor in self.expected(term).items()}

    def value(self, combination: _Combination) -> float:
        """Return the value of a combination of mean squares."""
        return sum(factor * self.squares[term] / self.dofs[term] for term, factor in combination.items())

    def test(self, term: Term) -> tuple[float | None, float | None]:
        """Return the F ratio of a term and its p-value, approximated by Satterthwaite for several mean squares."""
        denominator = self.expected(term)
        value = self.value(denominator)
        if not value > 0.0:
            return None, None
        spread = sum(
            self.value({contained: factor}) ** 2 / self.dofs[contained] for contained, factor in denominator.items()
        )
        ratio = self.squares[term] / self.dofs[term] / value
        return ratio, float(fdtrc(self.dofs[term], value**2 / spread, ratio))

    def interval(self, combinations: Sequence[_Combination], tail: float) -> tuple[float, float]:
        """Return the generalised confidence interval of a sum of variances; its limits are at least 0.

        Each mean square is distributed as its expectation times chi-square divided by the degrees of freedom.
        """
        pivots = np.zeros(_DRAWS)
        for (term, square), draw in zip(self.squares.items(), _draws(tuple(self.dofs.values())), strict=True):
            factor = sum(combination.get(term, 0.0) for combination in combinations)
            if factor:
                pivots += factor * square / draw
        low, high = np.quantile(pivots, (tail, 1.0 - tail))
        return max(float(low), 0.0), max(float(high), 0.0)


@lru_cache(maxsize=8)
def _draws(dofs: tuple[int, ...]) -> list[FloatArray]:
    """Return independent chi-square draws with these degrees of freedom, the same for all parameters of a study.

    Each is a Latin hypercube sample, with which the quantiles of a sum have a much smaller error than with random
    draws.
    """
    random = np.random.default_rng(_SEED)
    return [np.asarray(2.0 * gammaincinv(0.5 * dof, (random.permutation(_DRAWS) + 0.5) / _DRAWS)) for dof in dofs]
