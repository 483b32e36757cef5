"""Values in a certificate are rounded to two significant digits of their uncertainty."""

import math

import pytest

from calstation.reports.numbers import interval, rounded, short


@pytest.mark.parametrize(
    ("value", "uncertainty", "text"),
    [
        (100.02147, 0.00079, "100.02147"),  # JCGM 100:2008, 7.2.2
        (1.7449, 0.0204, "1.745"),
        (-806.3961, 0.8571, "−806.40"),
        (0.0996, 0.0996, "0.10"),  # 0.0996 is 0.10 to two digits
        (12345.6, 1234.0, "12300"),
        (-0.0004, 0.13, "0.00"),
        (3.0, 0.0, "3"),
        (math.nan, 0.1, "–"),
        (None, 0.1, "–"),
    ],
)
def test_value_is_rounded_to_the_second_digit_of_its_uncertainty(
    value: float | None, uncertainty: float, text: str
) -> None:
    assert rounded(value, uncertainty) == text


def test_limits_are_printed_with_few_digits() -> None:
    assert interval(-0.5, 0.5) == "±0.5"
    assert interval(-1.0, 2.0) == "−1 … 2"
    assert interval(-1072.577, 1072.577) == "±1072.577"  # 0.0052 rad/s in °/h: not 1073, which would be refused
    assert short(648000.4) == "648000"
    assert short(1e-6) == "1 × 10⁻⁶"
    assert short(math.inf) == "–"
