"""Numbers beside a limit have the digits that show on which side of the limit they are."""

import math

import pytest

from calstation.physics import DEGREE_PER_HOUR, compared_number, limit_numbers, number


@pytest.mark.parametrize(
    ("value", "limit", "texts"),
    [
        (3.926, 1.9e-5, ("3.93", "3.9")),  # exceeds the limit, 3.919 °/h, although both round to 3.9
        (3.918, 1.9e-5, ("3.9", "3.919")),  # does not exceed it, but 3.9
        (3.96, 3.94 * DEGREE_PER_HOUR, ("4.0", "3.94")),
    ],
)
def test_a_sigma_and_its_limit_are_shown_as_they_compare(value: float, limit: float, texts: tuple[str, str]) -> None:
    size = DEGREE_PER_HOUR
    assert compared_number(number(value, value), size, value * size, limit) == texts[0]
    assert limit_numbers(limit, size, value * size)[1] == texts[1]


@pytest.mark.parametrize("value", [-2.04, 2.04, -1.96, 1.96, 2.0, -2.0])
@pytest.mark.parametrize("limit", [(-2.0, 2.0), (-2.0, 3.0), (-3.0, 2.0)])
def test_a_rounded_value_is_inside_its_limits_exactly_if_the_value_is(value: float, limit: tuple[float, float]) -> None:
    text = compared_number(f"{value:.0f}", 1.0, value, limit)
    assert (limit[0] <= float(text) <= limit[1]) is (limit[0] <= value <= limit[1])


def test_an_expanded_uncertainty_is_compared_with_twice_the_limit() -> None:
    assert compared_number("7.8", 1.0, 3.914, 3.9, factor=2.0) == "7.83"
    assert compared_number("7.9", 1.0, 3.926, 3.9, factor=2.0) == "7.9"


def test_a_number_without_a_limit_or_an_unknown_value_is_unchanged() -> None:
    assert compared_number("3.9", 1.0, 3.926, None) == compared_number("3.9", 1.0, math.nan, 3.9) == "3.9"
    assert limit_numbers(math.inf, 1.0) == ("-inf", "inf")


@pytest.mark.parametrize("limit", [(2.0, -2.0), (3.0, -2.0), (0.0, 0.0)])
def test_a_guard_band_may_leave_no_interval(limit: tuple[float, float]) -> None:
    low, high = limit_numbers(limit, 1.0, 1.0)
    assert (float(low), float(high)) == limit
    assert compared_number("1.0", 1.0, 1.0, limit) == "1.0"
