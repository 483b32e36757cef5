"""Repeatability and reproducibility agree with published studies, and unbalanced designs are refused."""

import numpy as np
import pytest
from scipy import stats

from calstation.errors import InputError
from calstation.physics import FloatArray
from calstation.quality import gauge_study, ranges_beyond
from calstation.quality.gauge import _Model, _sums_of_squares, crossed, range_limits, verdict

#: AIAG, Measurement Systems Analysis, 4th ed., 2010, figure III-B 6: ten parts (columns) measured by appraisers A, B
#: and C in three trials each (rows).
AIAG_TEXT = """
0.29 -0.56  1.34  0.47 -0.80  0.02  0.59 -0.31  2.26 -1.36
0.41 -0.68  1.17  0.50 -0.92 -0.11  0.75 -0.20  1.99 -1.25
0.64 -0.58  1.27  0.64 -0.84 -0.21  0.66 -0.17  2.01 -1.31
0.08 -0.47  1.19  0.01 -0.56 -0.20  0.47 -0.63  1.80 -1.68
0.25 -1.22  0.94  1.03 -1.20  0.22  0.55  0.08  2.12 -1.62
0.07 -0.68  1.34  0.20 -1.28  0.06  0.83 -0.34  2.19 -1.50
0.04 -1.38  0.88  0.14 -1.46 -0.29  0.02 -0.46  1.77 -1.49
-0.11 -1.13  1.09  0.20 -1.07 -0.67  0.01 -0.56  1.45 -1.77
-0.15 -0.96  0.67  0.11 -1.45 -0.49  0.21 -0.49  1.87 -2.16
"""
AIAG = np.array(AIAG_TEXT.split(), dtype=float).reshape(3, 3, 10).transpose(2, 0, 1)

BOTH = ("unit", "operator")
UNIT, WHO, CELL, ERROR = (frozenset(term) for term in (("unit",), ("operator",), BOTH, ()))
#: Mean squares and degrees of freedom of the thermal impedance study (M. E. Houf and D. B. Berman, IEEE Transactions
#: on Components, Hybrids, and Manufacturing Technology 11, 1988): ten parts, three operators, three trials.
HOUF = {UNIT: (437.3284, 9), WHO: (19.6333, 2), CELL: (2.6951, 18), ERROR: (0.5111, 60)}


def test_study_agrees_with_the_aiag_manual() -> None:
    study = gauge_study(BOTH, AIAG, tolerance=4.0)
    expected = [  # table A 3 of the manual, and the F ratios after pooling of Minitab's gauge study of the same data
        ("unit", 9, 88.3619, 9.81799, 245.614),
        ("operator", 2, 3.1673, 1.58363, 39.617),
        ("unit*operator", 18, 0.3590, 0.01994, 0.434),
        ("repeatability", 60, 2.7589, 0.04598, None),
    ]
    for row, (source, dof, square, mean, ratio) in zip(study.anova, expected, strict=True):
        assert (row.source, row.dof) == (source, dof)
        assert (row.sum_squares, row.mean_square) == pytest.approx((square, mean), abs=6e-5)
        assert row.f == (None if ratio is None else pytest.approx(ratio, abs=6e-4))
    assert [row.source for row in study.anova if row.pooled] == ["unit*operator"]
    assert study.interaction is None
    assert study.components == {"unit": study.part, "operator": study.reproducibility}
    found = [study.repeatability, study.reproducibility, study.gauge, study.part, study.total]
    # table A 4: standard deviations and shares of the total variation
    assert [each.sigma for each in found] == pytest.approx([0.199933, 0.226838, 0.302373, 1.042327, 1.0853], abs=5e-6)
    assert [each.percent_study for each in found] == pytest.approx([18.4, 20.9, 27.9, 96.0, 100.0], abs=0.05)
    assert study.gauge.percent_tolerance == pytest.approx(100 * 6 * 0.302373 / 4.0, abs=1e-3)
    assert (study.categories, study.verdict) == (4, "unacceptable")  # 45 % of the tolerance
    assert gauge_study(BOTH, AIAG).verdict == "marginal"


def test_significant_interaction_is_a_separate_component() -> None:
    random = np.random.default_rng(2)
    p, o, r = 10, 3, 3
    values = random.normal(0, 5, (p, 1, 1)) + random.normal(0, 2, (p, o, 1)) + random.normal(0, 0.5, (p, o, r))
    study = gauge_study(BOTH, values)
    assert study.interaction is not None
    assert study.interaction.sigma == pytest.approx(2.0, rel=0.4)
    assert study.repeatability.sigma == pytest.approx(np.sqrt(np.mean(values.var(axis=2, ddof=1))))
    squares = [study.repeatability, study.reproducibility, study.interaction]
    assert study.gauge.sigma**2 == pytest.approx(sum(each.sigma**2 for each in squares))
    assert study.total.sigma**2 == pytest.approx(study.gauge.sigma**2 + study.part.sigma**2)
    part, interaction = study.anova[0], study.anova[2]
    assert part.f == pytest.approx(part.mean_square / interaction.mean_square)


def test_confidence_intervals_agree_with_a_published_study() -> None:
    # R. K. Burdick, C. M. Borror and D. C. Montgomery, Journal of Quality Technology 35(4), 2003, 342-354: modified
    # large sample intervals of 95 % of the variances of the parts and of the measurement; generalised ones are close
    model = _Model(
        {term: mean * dof for term, (mean, dof) in HOUF.items()}, {term: dof for term, (_, dof) in HOUF.items()}
    )
    variances = {term: model.variance(term, 90, {"unit": 10, "operator": 3}) for term in HOUF}
    assert model.interval([variances[UNIT]], 0.025) == pytest.approx((22.69, 161.64), rel=0.01)
    assert model.interval([variances[term] for term in (WHO, CELL, ERROR)], 0.025) == pytest.approx(
        (1.20, 27.02), rel=0.02
    )
    exact = [60 * 0.5111 / stats.chi2.ppf(p, 60) for p in (0.975, 0.025)]
    assert model.interval([variances[ERROR]], 0.025) == pytest.approx(exact, rel=0.01)


def test_variance_interval_includes_zero_if_the_f_test_is_not_significant() -> None:
    for first, second in ((9, 18), (2, 78)):
        ratio = float(stats.f.isf(0.025, first, second))
        for factor in (0.97, 1.03):
            model = _Model({UNIT: ratio * factor * first, ERROR: second}, {UNIT: first, ERROR: second})
            low, _ = model.interval([model.variance(UNIT, 90, {"unit": 10})], 0.025)
            assert (low > 0.0) == (factor > 1.0)


def draw(random: np.random.Generator, sigmas: dict[str, float], shape: tuple[int, ...]) -> FloatArray:
    """Draw values of a crossed design of units, operators, stations and trials; `sigmas` by the letters of a term."""
    values = random.normal(0.0, sigmas[""], shape)
    for term, sigma in sigmas.items():
        levels = [n if axis in term else 1 for axis, n in zip("uos", shape[:-1], strict=False)]
        values = values + (random.normal(0.0, sigma, [*levels, 1]) if term else 0.0)
    return values


@pytest.mark.long
def test_estimated_variance_components_agree_with_the_model() -> None:
    """Means over many studies without pooling; the mean squares have their expectations."""
    random, shape, runs = np.random.default_rng(3), (5, 4, 3, 2), 3000
    sigmas = {"": 1.0, "u": 3.0, "o": 1.5, "s": 2.0, "uo": 1.2, "us": 0.8, "os": 0.7, "uos": 0.5}
    letters = {"u": "unit", "o": "operator", "s": "station"}
    levels = dict(zip(letters.values(), shape, strict=False))
    total: dict[frozenset[str], float] = {}
    for _ in range(runs):
        squares, dofs = _sums_of_squares(levels, draw(random, sigmas, shape))
        model = _Model(squares, dofs)
        for term in (*model.terms, ERROR):
            value = model.value(model.variance(term, int(np.prod(shape)), levels))
            total[term] = total.get(term, 0.0) + value / runs
    assert len(total) == 8
    for text, sigma in sigmas.items():
        found = total[frozenset(letters[letter] for letter in text)]
        assert found == pytest.approx(sigma**2, rel=0.1, abs=0.03), text


def test_study_of_operators_and_stations_identifies_the_varying_factor() -> None:
    random = np.random.default_rng(5)
    values = draw(random, {"": 0.3, "u": 5.0, "s": 2.0, "us": 1.0}, (10, 3, 4, 3))
    study = gauge_study(("unit", "operator", "station"), values)
    assert study.levels == {"unit": 10, "operator": 3, "station": 4}
    sources = [row.source for row in study.anova]
    assert sources[:4] == ["unit", "operator", "station", "unit*operator"]
    assert sources[-2:] == ["unit*operator*station", "repeatability"]
    pooled = {row.source for row in study.anova if row.pooled}
    assert "unit*station" not in pooled
    assert "unit*operator*station" in pooled
    assert study.components["unit*station"].sigma == pytest.approx(1.0, rel=0.4)
    assert study.components["station"].sigma == pytest.approx(2.0, rel=0.8)
    assert study.components["operator"].sigma < 0.3
    others = [each.sigma**2 for name, each in study.components.items() if "unit" not in name]
    assert study.reproducibility.sigma**2 == pytest.approx(sum(others))
    assert study.interaction is not None
    within = [each.sigma**2 for name, each in study.components.items() if name.startswith("unit*")]
    assert study.interaction.sigma**2 == pytest.approx(sum(within))
    assert study.total.sigma**2 == pytest.approx(study.gauge.sigma**2 + study.part.sigma**2)


def test_three_factor_model_with_an_inactive_factor_equals_two_factor_model() -> None:
    """Mean squares of a term do not depend on a factor without influence on the values."""
    random = np.random.default_rng(7)
    two = draw(random, {"": 1.0, "u": 5.0, "o": 2.0, "uo": 2.0}, (10, 3, 3))
    squares, dofs = _sums_of_squares({"unit": 10, "operator": 3}, two)
    three = np.repeat(two[:, :, None, :], 2, axis=2)
    more, more_dofs = _sums_of_squares({"unit": 10, "operator": 3, "station": 2}, three)
    for term in (UNIT, WHO, CELL):
        assert (more[term], more_dofs[term]) == (pytest.approx(2.0 * squares[term]), dofs[term])
    assert more[frozenset({"station"})] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.long
def test_intervals_contain_the_true_variation_with_the_stated_probability() -> None:
    random, runs = np.random.default_rng(4), 800
    p, o, r = 10, 4, 3
    true = {"repeatability": 1.0, "reproducibility": 1.5, "interaction": 1.2, "part": 4.0}
    true["gauge"] = (1.0 + 1.5**2 + 1.2**2) ** 0.5
    true["total"] = (true["gauge"] ** 2 + 16.0) ** 0.5
    inside = dict.fromkeys(true, 0)
    for _ in range(runs):
        values = random.normal(0, 4.0, (p, 1, 1)) + random.normal(0, 1.5, (1, o, 1))
        values = values + random.normal(0, 1.2, (p, o, 1)) + random.normal(0, 1.0, (p, o, r))
        study = gauge_study(BOTH, values)
        for name, sigma in true.items():
            each = getattr(study, name)
            inside[name] += each is not None and each.low <= sigma <= each.high
    for name, count in inside.items():
        assert 0.925 < count / runs < 0.985, (name, count / runs)  # the method is slightly conservative


def test_crossed_design_is_read_in_any_order_and_an_unbalanced_design_refused() -> None:
    rows = [
        ((f"SN-{p}", who), float(AIAG[p, o, r])) for r in range(3) for o, who in enumerate("ABC") for p in range(10)
    ]
    (parts, appraisers), values = crossed(BOTH, rows)
    assert (parts[0], appraisers) == ("SN-0", ["A", "B", "C"])
    np.testing.assert_array_equal(values, AIAG)
    for wrong, code, shown in (
        (rows[:-1], "quality.unbalanced", "SN-9, C: 2"),
        ([row for row in rows if row[0][1] == "A"], "quality.small_study", "fewer than two operators: 1"),
        (rows[:30], "quality.small_study", "fewer than two trials: 1"),
        ([row for row in rows if row[0] != ("SN-4", "B")], "quality.unbalanced", "SN-4, B: 0"),
        ([], "quality.small_study", "fewer than two units: 0"),
    ):
        with pytest.raises(InputError) as caught:
            crossed(BOTH, wrong)
        assert caught.value.code == code
        assert shown in str(caught.value)


def test_equal_repetitions_are_refused() -> None:
    with pytest.raises(InputError) as caught:
        gauge_study(BOTH, np.repeat(AIAG[:, :, :1], 3, axis=2))
    assert caught.value.code == "quality.no_repeatability"


def test_verdicts_follow_the_aiag_criteria() -> None:
    assert [verdict(share) for share in (9.0, 10.0, 29.0, 31.0)] == [
        "acceptable",
        "acceptable",
        "marginal",
        "unacceptable",
    ]


def test_limits_of_ranges_are_those_of_the_tables() -> None:
    """D3 and D4 of AIAG's manual (appendix) for samples of normally distributed values."""
    tables = {2: (0.0, 3.267), 3: (0.0, 2.574), 5: (0.0, 2.114), 7: (0.076, 1.924), 10: (0.223, 1.777)}
    for count, factors in tables.items():
        values = np.zeros((4, count))
        values[:, 0] = 2.0
        low, center, high = range_limits(values)
        assert center == 2.0
        np.testing.assert_allclose((low / center, high / center), factors, atol=1e-3)


def test_range_beyond_the_control_limits_of_the_aiag_study_is_found() -> None:
    """The manual's range chart shows appraiser B out of control at part 4: 1.02, with an upper limit of 0.88."""
    assert np.argwhere(ranges_beyond(AIAG)).tolist() == [[3, 1]]
