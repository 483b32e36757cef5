"""Texts about the checks of a result in the current language."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from decimal import Decimal

from calstation.gui.text import language
from calstation.gui.text.messages import about, say, term, with_minus
from calstation.judgement import Check, Where
from calstation.messages import Text, parameter_name
from calstation.physics import (
    ARCSECOND,
    DEGREE,
    INDEX,
    MICRO_G,
    PARAMETERS,
    compared_number,
    display,
    further_parameter,
    limit_number,
    limit_numbers,
)
from calstation.records import CheckId

#: Kinds of checks in the ``[checks]`` section of a product.
_PRODUCT_KINDS = (
    "gravity_at_rest",
    "improvement_at_rest",
    "improvement_at_rest_floor",
    "level_horizontal",
    "level_vertical",
    "motion_angle",
    "motion_improvement",
    "motion_improvement_floor",
    "offline_online",
    "excitation",
    "previous",
)

#: Maximum number of names of checks in a line.
_MAX_NAMES = 3
#: Smallest and largest value that is shown as a number.
_MIN_SHOWN, _MAX_SHOWN = 1e-6, 1e9

#: Display unit and its size for each unit of a check that does not compare a parameter; large angles are in °.
_DISPLAY_UNITS = {"m/s²": ("µg", MICRO_G), "rad": ("″", ARCSECOND), "sigma": ("σ", 1.0), "1": ("", 1.0)}


@dataclass(frozen=True)
class CheckText:
    """Texts of a check for a table; `state` is the badge shape of its verdict (`widgets.badge.KINDS`).

    `about` explains the check.
    """

    sentence: str
    value: str
    limit: str
    margin: str
    unit: str
    verdict: str
    state: str
    where: str
    about: str
    guard: str = ""  #: How the decision rule narrowed the limit; "" if it did not.


def check_text(check: Check) -> CheckText:
    """Return the texts of a check in the current language."""
    unit, size = _unit(check)
    verdict = "failed" if not check.passed else "near_miss" if check.near_miss else "passed"
    return CheckText(
        sentence=_sentence(check),
        value=_number(check.value, size, check.compared_with),
        limit=_limit(check.compared_with, size, check.value),
        margin=_number(check.margin, size),
        unit=unit,
        verdict=term("check_verdict", verdict),
        state={"failed": "bad", "near_miss": "caution", "passed": "good"}[verdict],
        where=_location_text(check.where),
        about="\n".join(filter(None, (about("check", check.kind), guard := _guard(check, unit, size)))),
        guard=guard,
    )


def check_name(check: Check | CheckId) -> str:
    """Return a short name of the quantity that a product check compares."""
    return say(f"check_short.{check.kind}", parameter=check.subject, stage=check.subject)


def is_product_check(check: Check) -> bool:
    """Return whether a check is requested by the ``[checks]`` section of a product."""
    return check.kind in _PRODUCT_KINDS


def is_parameter_check(check: Check) -> bool:
    """Return whether a check compares a parameter or its sigma with a limit, as shown in the parameter table."""
    return check.kind in ("within", "sigma_below")


def parameter_text(name: str) -> str:
    """Return the display name of a parameter or of a group; see `calstation.messages.parameter_name`."""
    return parameter_name(name, language.current())


def limit_text(*checks: Check) -> Text:
    """Return the heading for the limits of checks, "acceptance limit" if the decision rule narrowed one of them."""
    guarded = any(check.acceptance is not None for check in checks)
    return Text("common.acceptance_limit_column" if guarded else "common.limit_column")


def limit_ratio(check: Check | None) -> float:
    """Return the ratio of a check's value to its limit, relative to the middle of an interval; 0 without a value."""
    if check is None or math.isnan(check.value):
        return 0.0
    limit = check.compared_with
    if isinstance(limit, tuple):
        low, high = limit
        return float(abs(check.value - 0.5 * (low + high)) / (0.5 * (high - low))) if low < high else math.inf
    return check.value / limit if limit else 0.0


def check_names(checks: Iterable[Check]) -> str:
    """Return the names of the three checks with the largest `limit_ratio`, and the number of the other checks.

    A check of a parameter is named after the parameter, with σ appended if the check compares its sigma.
    """
    names = list(dict.fromkeys(map(_brief_name, sorted(checks, key=limit_ratio, reverse=True))))
    text = say("common.comma").join(names[:_MAX_NAMES])
    return text if len(names) <= _MAX_NAMES else say("advice.and_more", names=text, more=len(names) - _MAX_NAMES)


def checks_tip(checks: Iterable[Check]) -> str:
    """Return a line for each check with its value and limit, for a tooltip."""
    lines = []
    for check in sorted(checks, key=limit_ratio, reverse=True):
        row = check_text(check)
        value, limit = (f"{number} {row.unit}".rstrip() for number in (row.value, row.limit))
        lines.append(say("common.compared", name=row.sentence, value=value, limit=limit))
    return "\n".join(lines)


def _brief_name(check: Check) -> str:
    if not is_parameter_check(check):
        return check_name(check)
    return f"{parameter_text(check.subject)}{' σ' if check.kind == 'sigma_below' else ''}"


def _guard(check: Check, unit: str, size: float) -> str:
    """Return how the decision rule narrowed the limit of a check, or ""."""
    if check.acceptance is None or not isinstance(check.limit, tuple):
        return ""
    guard = _number(check.acceptance[0] - check.limit[0], size)
    texts = (f"{text}\u00a0{unit}".rstrip() for text in (_limit(check.limit, size, check.value), guard))
    return say("check.guard_band", **dict(zip(("limit", "guard"), texts, strict=True)))


def _sentence(check: Check) -> str:
    """Return a sentence that states the quantity compared by a check."""
    sentence = say(
        check.code,
        parameter=parameter_text(check.subject),
        stage=check.subject,
        words=check.subject.replace("_", " "),
    )
    return sentence[0].upper() + sentence[1:]


def _unit(check: Check) -> tuple[str, float]:
    """Return the display unit of a check and its size in the unit of the check."""
    if check.kind == "latitude":
        return "°", DEGREE
    if check.kind == "sample_clock":
        return "ppm", 1e-6
    if check.kind == "clipping":
        return say("common.samples_unit"), 1.0
    name = check.parameter or check.subject
    if check.kind == "previous":
        name = next((p.name for p in PARAMETERS if p.group == check.subject), name)
    if name in INDEX or further_parameter(name) is not None:
        factor, unit = display(name, 1.0)
        return unit if unit != "1" else "", 1.0 / factor
    largest = max(map(abs, check.limit)) if isinstance(check.limit, tuple) else check.limit
    if check.unit == "rad" and largest >= DEGREE:
        return "°", DEGREE
    return _DISPLAY_UNITS.get(check.unit, (check.unit, 1.0))


def _number(value: float, size: float, *limits: float | tuple[float, float]) -> str:
    """Format a value in a unit of the given size, without an exponent, on the correct side of its limits."""
    if not math.isfinite(value):
        return "–"
    shown = value / size
    if 0.0 < abs(shown) < _MIN_SHOWN:
        return f"< {_MIN_SHOWN:.6f}"
    if abs(shown) >= _MAX_SHOWN:
        return f"> {_MAX_SHOWN:.0f}"
    text = f"{shown:.0f}" if abs(shown) >= 1000.0 else f"{Decimal(f'{shown:.4g}'):f}"
    return with_minus(compared_number(text, size, value, *limits))


def _limit(limit: float | tuple[float, float], size: float, value: float) -> str:
    """Format a limit in a unit of the given size, rounded as it was entered."""
    if not isinstance(limit, tuple):
        return f"≤ {with_minus(limit_number(limit, size, value)) if math.isfinite(limit) else '–'}"
    low, high = limit
    if low > high:  # the guard bands overlap, so that no value is accepted
        return "–"
    low_text, high_text = limit_numbers(limit, size, value)
    if low == -high:
        return f"±{high_text}"
    if high == 1.0 and 0.0 < low < 1.0 and size == 1.0:  # a probability
        return f"≥ {low_text}"
    return f"{with_minus(low_text)} … {with_minus(high_text)}"


def _location_text(where: Where) -> str:
    """Return the rests or the parameter to which a check refers."""
    if where.rests is not None:
        return say(where.rests)
    return parameter_text(where.parameter) if where.parameter in INDEX else where.parameter
