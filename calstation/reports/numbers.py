"""Numbers of a certificate: values in display units, rounded to two significant digits of their uncertainty."""

import math

from calstation.messages import with_minus
from calstation.physics import compared_number, display, limit_number, limit_numbers, unit_of

#: Text of a number that is unknown.
NONE = "–"

_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")

#: Display units of checks that do not compare a parameter, and their sizes, by the unit of the check.
_CHECK_UNITS = {"1": ("", 1.0), "sigma": ("σ", 1.0), "K": ("K", 1.0), "s": ("s", 1.0)}


def decimal_places(uncertainty: float) -> int:
    """Return the number of decimal places for two significant digits, which is negative from 100 on (GUM 7.2.6)."""
    return 1 - int(f"{uncertainty:.1e}".partition("e")[2])


def rounded(value: float | None, uncertainty: float) -> str:
    """Return a value rounded to the second significant digit of its uncertainty."""
    if value is None or not math.isfinite(value):
        return NONE
    if not 0.0 < uncertainty < math.inf:
        return with_minus(f"{value:.6g}")
    digits = decimal_places(uncertainty)
    text = f"{round(value, digits):.{max(0, digits)}f}"
    return with_minus(text.removeprefix("-") if float(text) == 0.0 else text)


def in_display(name: str, value: float | None) -> float | None:
    """Convert the SI value of a parameter to its display unit; None stays None."""
    return None if value is None else display(name, value)[0]


def short(value: float) -> str:
    """Format a limit or the value of a check with up to four digits."""
    if not math.isfinite(value):
        return NONE
    text = f"{value:.0f}" if 1000.0 <= abs(value) < 1e9 else f"{value:.4g}"
    mantissa, _, exponent = text.partition("e")
    if exponent:
        text = f"{mantissa} × 10{str(int(exponent)).translate(_SUPERSCRIPTS)}"
    return with_minus(text)


def compared(
    text: str, size: float, value: float, limit: float | tuple[float, float] | None, factor: float = 1.0
) -> str:
    """Return the text of a value, or more of its digits if the text contradicts its limit; see `compared_number`."""
    if text == NONE or "×" in text:
        return text
    return with_minus(compared_number(text.replace("\u2212", "-"), size, value, limit, factor=factor))


def exact(value: float) -> str:
    """Format a number with up to seven digits."""
    return with_minus(f"{value:.7g}") if 1e-4 <= abs(value) < 1e7 else short(value)


def limit_text(limit: float, size: float, value: float) -> str:
    """Return the text of a limit rounded as it was entered, unless that contradicts its comparison with a value.

    Limit and value are in SI, or in the unit of a check, and `size` is the size of the display unit in the same unit.
    """
    return with_minus(limit_number(limit, size, value)) if math.isfinite(limit) else NONE


def interval(low: float, high: float, size: float, value: float) -> str:
    """Return the text of a permitted interval, rounded as `limit_text` does."""
    texts = limit_numbers((low, high), size, value)
    if low == -high:
        return f"±{texts[1]}"
    return " … ".join(with_minus(text) if math.isfinite(float(text)) else NONE for text in texts)


def check_unit(unit: str) -> tuple[str, float]:
    """Return the display unit of a check that does not compare a parameter, and its size in the check's unit."""
    return _CHECK_UNITS.get(unit) or unit_of(unit)


def percentage(probability: float) -> str:
    """Format a probability in percent with one decimal, or as less than the last digit."""
    return "< 0.1 %" if probability < 0.0005 else f"{100.0 * probability:.1f} %"
