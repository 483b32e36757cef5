"""Repeatability and reproducibility of a measurement (GR&R): crossed two-way analysis of variance.

Sources: AIAG, *Measurement Systems Analysis*, 4th ed., 2010, chapter III section B and appendix A; for the confidence
intervals R. K. Burdick, C. M. Borror and D. C. Montgomery, *Design and Analysis of Gauge R&R Studies*, 2005, chapter 3
(modified large sample intervals of R. K. Burdick and F. A. Graybill, *Confidence Intervals on Variance Components*,
1992).
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy import stats

from calstation.errors import InputError
from calstation.physics import FloatArray

#: Interaction with a larger p-value is pooled with the repeatability.
_POOLED_ABOVE = 0.25
#: Percentages of the study variation or tolerance at which the verdict changes, and the least number of categories.
_ACCEPTABLE, _MARGINAL = 10.0, 30.0
LEAST_CATEGORIES = 5
#: Width of the tolerance that the measurement takes, in its sigmas.
_WIDTH = 6.0
#: Number of categories for a ratio of part to measurement variation of 1: sqrt(2), as rounded by AIAG.
_CATEGORIES = 1.41

Verdict = Literal["acceptable", "marginal", "unacceptable"]


@dataclass(frozen=True)
class AnovaRow:
    """A row of the analysis of variance."""

    source: Literal["part", "appraiser", "interaction", "repeatability"]
    dof: int
    sum_squares: float
    mean_square: float
    f: float | None  #: Ratio to the mean square that tests it; None for the last row.
    p: float | None  #: Probability of a larger ratio by chance.


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
    """Result of a study of parts, appraisers and trials."""

    parts: int
    appraisers: int
    trials: int
    confidence: float
    anova: tuple[AnovaRow, ...]
    pooled: bool  #: Whether the interaction is part of the repeatability.
    repeatability: Variation  #: EV.
    reproducibility: Variation  #: AV, of the appraisers alone.
    interaction: Variation | None  #: None if it is pooled.
    gauge: Variation  #: GRR: all of the above.
    part: Variation  #: PV.
    total: Variation  #: TV.

    @property
    def categories(self) -> int:
        """Number of distinct categories (ndc)."""
        ratio = _CATEGORIES * self.part.sigma / self.gauge.sigma
        return math.floor(ratio)

    @property
    def verdict(self) -> Verdict:
        """Verdict by the share of the tolerance if there is one, otherwise of the study variation."""
        percent = self.gauge.percent_tolerance
        return verdict(self.gauge.percent_study if percent is None else percent)


def verdict(percent: float) -> Verdict:
    """Return AIAG's verdict for a share of the variation or tolerance: acceptable to 10 %, marginal to 30 %."""
    return "acceptable" if percent <= _ACCEPTABLE else "marginal" if percent <= _MARGINAL else "unacceptable"


def crossed(rows: Iterable[tuple[str, str, float]]) -> tuple[list[str], list[str], FloatArray]:
    """Return the parts, the appraisers and the values, shape (parts, appraisers, trials), of a crossed design.

    `rows` are parts, appraisers and values. Raises InputError if not every appraiser measured every part equally
    often, or if there are fewer than two of each.
    """
    cells: dict[tuple[str, str], list[float]] = {}
    for part, appraiser, value in rows:
        cells.setdefault((part, appraiser), []).append(value)
    parts, appraisers = (list(dict.fromkeys(key[side] for key in cells)) for side in (0, 1))
    counts = {(part, who): len(cells.get((part, who), ())) for part in parts for who in appraisers}
    most = max(counts.values(), default=0)
    lacking = [f"{part}, {who}: {count}" for (part, who), count in counts.items() if count < most]
    if lacking:
        raise InputError("quality.unbalanced", trials=most, cells="; ".join(lacking))
    if min(len(parts), len(appraisers), most) < 2:
        raise InputError("quality.small_study", parts=len(parts), appraisers=len(appraisers), trials=most)
    return parts, appraisers, np.array([[cells[part, who] for who in appraisers] for part in parts])


def gauge_study(values: FloatArray, tolerance: float | None = None, *, confidence: float = 0.95) -> GaugeStudy:
    """Return the repeatability and reproducibility of a crossed design.

    Parameters
    ----------
    values
        Shape (parts, appraisers, trials), at least two of each.
    tolerance
        Width of the tolerance in the unit of the values; None without one.
    confidence
        Probability of the confidence intervals.

    Raises
    ------
    InputError
        All repeated measurements are equal.
    """
    p, o, r = values.shape
    mean = values.mean()
    of_part, of_appraiser, of_cell = values.mean(axis=(1, 2)), values.mean(axis=(0, 2)), values.mean(axis=2)
    residual = of_cell - of_part[:, None] - of_appraiser[None, :] + mean
    squares = (
        o * r * float(np.sum((of_part - mean) ** 2)),
        p * r * float(np.sum((of_appraiser - mean) ** 2)),
        r * float(np.sum(residual**2)),
        float(np.sum((values - of_cell[:, :, None]) ** 2)),
    )
    dofs = (p - 1, o - 1, (p - 1) * (o - 1), p * o * (r - 1))
    ms_p, ms_o, ms_po, ms_e = (_Mean(square / dof, dof) for square, dof in zip(squares, dofs, strict=True))
    if not np.ptp(values, axis=2).any():
        raise InputError("quality.no_repeatability")
    interaction_f = ms_po.value / ms_e.value
    interaction_p = float(stats.f.sf(interaction_f, ms_po.dof, ms_e.dof))
    pooled = interaction_p > _POOLED_ABOVE
    if pooled:
        dof = ms_po.dof + ms_e.dof
        ms_e = ms_po = _Mean((squares[2] + squares[3]) / dof, dof)
    scale = p * o * r
    terms = {
        "repeatability": [(1.0, ms_e)],
        "reproducibility": [(1.0 / (p * r), ms_o), (-1.0 / (p * r), ms_po)],
        "part": [(1.0 / (o * r), ms_p), (-1.0 / (o * r), ms_po)],
    }
    if pooled:
        terms["gauge"] = [(1.0 / (p * r), ms_o), (1.0 - 1.0 / (p * r), ms_e)]
        terms["total"] = [(p / scale, ms_p), (o / scale, ms_o), (1.0 - (p + o) / scale, ms_e)]
    else:
        terms["interaction"] = [(1.0 / r, ms_po), (-1.0 / r, ms_e)]
        terms["gauge"] = [(1.0 / (p * r), ms_o), ((p - 1) / (p * r), ms_po), ((r - 1) / r, ms_e)]
        terms["total"] = [
            *((p / scale, ms_p), (o / scale, ms_o)),
            *(((p * o - p - o) / scale, ms_po), ((r - 1) / r, ms_e)),
        ]
    variance = {name: max(sum(factor * mean.value for factor, mean in sum_), 0.0) for name, sum_ in terms.items()}
    # a variance that came out negative is 0, so that the total is the sum of what is shown
    variance["gauge"] = sum(variance.get(name, 0.0) for name in ("repeatability", "reproducibility", "interaction"))
    variance["total"] = variance["gauge"] + variance["part"]

    def variation(name: str) -> Variation:
        low, high = _interval(terms[name], (1.0 - confidence) / 2.0)
        sigma = math.sqrt(variance[name])
        share = None if tolerance is None else 100.0 * _WIDTH * sigma / tolerance
        return Variation(
            sigma, math.sqrt(low), math.sqrt(high), 100.0 * math.sqrt(variance[name] / variance["total"]), share
        )

    return GaugeStudy(
        parts=p,
        appraisers=o,
        trials=r,
        confidence=confidence,
        anova=(
            _anova_row("part", squares[0], dofs[0], ms_po),
            _anova_row("appraiser", squares[1], dofs[1], ms_po),
            AnovaRow("interaction", dofs[2], squares[2], squares[2] / dofs[2], interaction_f, interaction_p),
            AnovaRow("repeatability", dofs[3], squares[3], squares[3] / dofs[3], None, None),
        ),
        pooled=pooled,
        repeatability=variation("repeatability"),
        reproducibility=variation("reproducibility"),
        interaction=None if pooled else variation("interaction"),
        gauge=variation("gauge"),
        part=variation("part"),
        total=variation("total"),
    )


@dataclass(frozen=True)
class _Mean:
    """A mean square and its degrees of freedom."""

    value: float
    dof: int


def _anova_row(source: Literal["part", "appraiser"], square: float, dof: int, by: _Mean) -> AnovaRow:
    ratio = square / dof / by.value
    return AnovaRow(source, dof, square, square / dof, ratio, float(stats.f.sf(ratio, dof, by.dof)))


def _interval(terms: list[tuple[float, _Mean]], tail: float) -> tuple[float, float]:
    """Return the modified large sample interval of a variance, which is the sum of factors times mean squares.

    Burdick and Graybill, sections 3.2 (sums) and 3.3 (a difference of two). No limit is below 0.
    """
    value = sum(factor * mean.value for factor, mean in terms)
    below = above = 0.0
    for factor, mean in terms:
        g, h = _bounds(mean, tail)
        size = (factor * mean.value) ** 2
        below += size * (g if factor > 0.0 else h) ** 2
        above += size * (h if factor > 0.0 else g) ** 2
    if terms[-1][0] < 0.0:
        (first, one), (second, other) = terms
        product = abs(first * second) * one.value * other.value
        (g1, h1), (g2, h2) = _bounds(one, tail), _bounds(other, tail)
        below += product * _cross(float(stats.f.isf(tail, one.dof, other.dof)), g1, h2)
        above += product * _cross(float(stats.f.ppf(tail, one.dof, other.dof)), h1, g2)
    low, high = value - math.sqrt(max(below, 0.0)), value + math.sqrt(max(above, 0.0))
    return max(low, 0.0), max(high, 0.0)


def _bounds(mean: _Mean, tail: float) -> tuple[float, float]:
    """Return by which fraction of a mean square its confidence interval extends below and above it."""
    low, high = stats.chi2.isf(tail, mean.dof), stats.chi2.ppf(tail, mean.dof)
    return float(1.0 - mean.dof / low), float(mean.dof / high - 1.0)


def _cross(f: float, first: float, second: float) -> float:
    """Return the factor of the mixed term, with which the limit of a difference is 0 exactly where the F test says."""
    return ((f - 1.0) ** 2 - (first * f) ** 2 - second**2) / f
