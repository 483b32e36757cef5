"""Examples of serial numbers that match a product's pattern."""

import re

import pytest

from calstation.config.serials import serial_example


@pytest.mark.parametrize(
    ("pattern", "example"),
    [
        (r"[A-Za-z0-9][A-Za-z0-9_.-]*", "SN-000123"),
        (r"NAV-\d{4}", "NAV-1234"),
        (r"(?:IMU|GYR)-?\w+", "IMU-1"),
        (r"[^a-z]{2}/.\S*", None),
        (r"\D[^\d]\s?x", None),
    ],
)
def test_example_matches_the_pattern(pattern: str, example: str | None) -> None:
    found = serial_example(pattern)
    assert re.fullmatch(pattern, found)
    assert example is None or found == example


def test_condition_on_the_surroundings_has_no_example() -> None:
    assert serial_example(r"X(?=77)\d\d") == "…"
