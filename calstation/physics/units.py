"""Units for display: degrees, ppm, µg, °/h and arcseconds."""

import math
from collections.abc import Sequence
from decimal import Decimal

import numpy as np

from calstation.physics.coefficients import TEMPERATURES, coefficient
from calstation.physics.further_parameters import EFFECT_PARAMETERS, PAIR_PARAMETERS, group_of
from calstation.physics.parameters import PARAMETERS

DEGREE = np.pi / 180.0
ARCSECOND = DEGREE / 3600.0
DEGREE_PER_HOUR = DEGREE / 3600.0
STANDARD_GRAVITY = 9.80665
MICRO_G = 1e-6 * STANDARD_GRAVITY
#: Spaces of the width of a digit and of a decimal point.
FIGURE_SPACE, POINT_SPACE = "\u2007", "\u2008"

#: Display unit of a quantity and its size in SI, by the SI unit of the quantity.
_BY_UNIT: dict[str, tuple[str, float]] = {
    "rad": ("″", ARCSECOND),
    "rad/s": ("°/h", DEGREE_PER_HOUR),
    "rad/√s": ("°/√h", DEGREE / 60.0),
    "rad/s²": ("°/h/h", DEGREE_PER_HOUR / 3600.0),
    "m/s²": ("µg", MICRO_G),
    "m/s/√s": ("µg/√Hz", MICRO_G),
    "m/s³": ("µg/h", MICRO_G / 3600.0),
    "1/s": ("ppm/h", 1e-6 / 3600.0),
    "rad·s/m": ("°/h/g", DEGREE_PER_HOUR / STANDARD_GRAVITY),
    "s/rad": ("ppm at 100 °/s", 1e-6 / (100.0 * DEGREE)),
    "s²/rad²": ("ppm at 100 °/s", 1e-6 / (100.0 * DEGREE) ** 2),
    "s²/m": ("µg/g²", MICRO_G / STANDARD_GRAVITY**2),
    "s⁴/m²": ("µg/g³", MICRO_G / STANDARD_GRAVITY**3),
    "m": ("mm", 1e-3),
    "m/s": ("mm/s", 1e-3),
    "s": ("ms", 1e-3),
    "s²": ("ms²", 1e-6),
    "s⁴/rad⁴": ("ppm at 100 °/s", 1e-6 / (100.0 * DEGREE) ** 4),
    "s⁸/m⁴": ("µg/g⁵", MICRO_G / STANDARD_GRAVITY**5),
    "rad·s²/m": ("µrad/g", 1e-6 / STANDARD_GRAVITY),
    "rad·s³/m²": ("°/h/g²", DEGREE_PER_HOUR / STANDARD_GRAVITY**2),
    "1": ("ppm", 1e-6),
}

#: Powers of a unit, from 0.
_POWERS = ("⁰", "", "²", "³", "⁴", "⁵", "⁶")

#: Display unit of each parameter group and its size in SI, which follow from the SI unit with three exceptions.
DISPLAY: dict[str, tuple[str, float]] = {
    **{p.group: _BY_UNIT[p.unit] for p in PARAMETERS},
    **{p.group: _BY_UNIT[p.unit] for p in (*PAIR_PARAMETERS, *EFFECT_PARAMETERS)},
    **dict.fromkeys(("secondary_gyro_matrix", "secondary_accel_matrix"), ("1", 1.0)),
    "clock_offset": ("µs", 1e-6),
}

#: SI unit, display unit and its size in SI of each entry of `[noise]` in an IMU profile.
NOISE_DISPLAY: dict[str, tuple[str, str, float]] = {
    name: (unit, *_BY_UNIT[unit])
    for name, unit in (
        ("gyro_arw", "rad/√s"),
        ("accel_vrw", "m/s/√s"),
        ("gyro_bias_instability", "rad/s"),
        ("accel_bias_instability", "m/s²"),
    )
}


def unit_of(unit: str) -> tuple[str, float]:
    """Return the display unit of an SI unit, and its size in SI; an unknown unit is displayed unchanged."""
    return _BY_UNIT.get(unit, (unit, 1.0))


def unit_of_parameter(name: str) -> tuple[str, float]:
    """Return the display unit of a parameter or group, and its size in SI. Raises KeyError for an unknown name."""
    if name in TEMPERATURES:
        return "°C", 1.0
    if (term := coefficient(name)) is not None:
        unit, size = unit_of_parameter(term[0])
        return f"{unit}/K{_POWERS[term[1]]}", size
    return DISPLAY[group_of(name)]


def display_by_unit(unit: str, value: float) -> tuple[float, str]:
    """Convert an SI value that is not a parameter to the display unit of its SI unit; return both."""
    display_unit, size = unit_of(unit)
    return value / size, display_unit


def display(name: str, value: float) -> tuple[float, str]:
    """Convert an SI value to the parameter's display unit; return both. Raises KeyError for an unknown name."""
    unit, size = unit_of_parameter(name)
    return value / size, unit


def in_unit(value: float, size: float) -> str:
    """Format an SI value in a unit of `size` in SI, with the number of digits of the value, from 6 to 12."""
    digits = len(Decimal(repr(float(value))).normalize().as_tuple().digits)
    text = f"{value / size:.{min(12, max(6, digits))}g}"
    return f"{Decimal(text):f}" if "e+" in text else text


def limit_number(limit: float, size: float, value: float = math.nan) -> str:
    """Format a limit in a unit with the number of digits with which it was entered, from two to four.

    More digits are used if the value compares differently with the rounded limit than with the limit.

    Parameters
    ----------
    limit, value : limit and the value compared with it, SI; NaN without a value
    size : size of the unit in SI
    """
    if not math.isfinite(limit):
        return str(limit)
    shown, compared = limit / size, value / size
    entered = len(Decimal(repr(float(limit))).normalize().as_tuple().digits)
    exponent = math.floor(math.log10(abs(shown))) if shown else 0
    text = ""
    for digits in (min(max(entered, 2), 4), 4, 7, 12):
        text = f"{shown:.{max(0, digits - 1 - exponent)}f}"
        if math.isnan(compared) or (compared <= shown) == (compared <= float(text)):
            break
    return text.rstrip("0").rstrip(".") if "." in text else text


def limit_numbers(limit: float | tuple[float, float], size: float, value: float = math.nan) -> tuple[str, str]:
    """Return the texts of a lower and an upper limit, see `limit_number`; a missing one is ``-inf``.

    Parameters
    ----------
    limit : upper limit, or lower and upper limit, SI
    size : size of the unit in SI
    value : value compared with the limits, SI
    """
    low, high = limit if isinstance(limit, tuple) else (-math.inf, limit)
    if low == -high < 0.0:  # shown after one ±
        text = limit_number(high, size, abs(value))
        return f"-{text}", text
    return limit_number(low, size, value), limit_number(high, size, value)


def compared_number(
    text: str, size: float, value: float, *limits: float | tuple[float, float] | None, factor: float = 1.0
) -> str:
    """Return the text of a value, or the value with more digits if the text compares differently with a limit.

    Parameters
    ----------
    text : the rounded value in the unit
    size : size of the unit in SI
    value : value, SI
    *limits : upper limits, or lower and upper limits, SI, formatted by `limit_numbers`; None for no limit
    factor : factor included in the text but not in `value` and the limits, such as a coverage factor
    """
    if not math.isfinite(value):
        return text
    ranges = []
    for limit in limits:
        if limit is not None:
            low, high = limit if isinstance(limit, tuple) else (-math.inf, limit)
            low_shown, high_shown = map(float, limit_numbers(limit, size, value))
            ranges.append((factor * low_shown, factor * high_shown, low <= value <= high))
    decimals = max(0, -int(Decimal(text).as_tuple().exponent))
    candidates = (text, *(f"{factor * value / size:.{n}f}" for n in range(decimals, decimals + 12)))
    for candidate in candidates:
        if all((low <= float(candidate) <= high) is inside for low, high, inside in ranges):
            return candidate
    return text


def from_unit(value: float, size: float) -> float:
    """Convert a value in a unit of `size` in SI to SI; `in_unit` and `from_unit` preserve up to 12 digits."""
    return float(f"{value * size:.15g}")


def number(value: float, sigma: float) -> str:
    """Format `value`, rounded to two significant digits of its `sigma`."""
    if not 0.0 < sigma < float("inf"):
        return f"{value:.6g}"
    exponent = int(f"{sigma:e}".partition("e")[2])
    rounded = f"{value:.{max(0, min(12, 1 - exponent))}f}"
    return rounded.lstrip("-") if float(rounded) == 0.0 else rounded


def aligned(numbers: Sequence[str]) -> list[str]:
    """Pad numbers on the right with figure and punctuation spaces, so that their decimal points are aligned."""
    decimals = [len(text.partition(".")[2]) for text in numbers]
    points = any("." in text for text in numbers)
    max_decimals = max(decimals, default=0)
    return [
        text + (FIGURE_SPACE * (max_decimals - n)) + (POINT_SPACE if points and "." not in text else "")
        for text, n in zip(numbers, decimals, strict=True)
    ]
