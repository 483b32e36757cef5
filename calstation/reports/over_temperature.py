"""Section of a certificate over temperature: values at the ends of the range, curves and coefficients."""

from collections.abc import Sequence
from itertools import groupby
from typing import Any

import numpy as np

from calstation.judgement import COVERAGE_FACTOR
from calstation.messages import Language, Text, render, term, with_minus
from calstation.physics import display, group_of, unit_of_parameter
from calstation.reports.numbers import rounded, short
from calstation.results import Result, TemperatureResult

#: Number of temperatures of a curve.
_POINTS = 41


def statement(over: TemperatureResult) -> Text:
    """Return the statement that values and conformity hold only within the range of temperatures."""
    low, high = over.range_c
    return Text.of("certificate.over_temperature", low=low, high=high, reference=over.reference_c)


def temperature_section(result: Result, language: Language) -> dict[str, Any] | None:
    """Return the data for the template; None if the parameters do not depend on the temperature."""
    over = result.temperature
    if over is None:
        return None
    changing = over.largest_changes
    names = [name for name in over.coefficients if name in changing or over.coefficients[name].rate is not None]
    groups = [(group, list(members)) for group, members in groupby(names, group_of)]
    low, high = over.range_c
    ends = {"low": low, "reference": over.reference_c, "high": high}
    count = max(len(row.values) for row in over.coefficients.values())
    return {
        "statement": render(statement(over).code, statement(over).values, language, window=True).sentences,
        "ends": {key: with_minus(f"{value:g} °C") for key, value in ends.items()},
        "groups": [_group(result, group, members, list(ends.values()), language) for group, members in groups],
        "curves": [_curves(result, over, group, members, language) for group, members in groups],
        "powers": count,
        "rates": any(row.rate is not None for row in over.coefficients.values()),
        "coefficients": [_coefficients(over, group, members, count, language) for group, members in groups],
    }


def _group(
    result: Result, group: str, names: Sequence[str], temperatures: Sequence[float], language: Language
) -> dict[str, Any]:
    """Return the rows of a group: value and expanded uncertainty at every temperature, and the worst value."""
    rows = []
    for name in names:
        values, sigmas = result.curve(name, np.array(temperatures))
        worst, at = result.worst(name)
        cells = [*zip(values.tolist(), sigmas.tolist(), strict=True), (worst.value, worst.sigma)]
        rows.append(
            {
                "axis": _axis(name),
                "cells": [_with_uncertainty(name, value, sigma) for value, sigma in cells],
                "at": "–" if at is None else with_minus(f"{at:.0f}"),
            }
        )
    return {"name": _title(group, language), "unit": unit_of_parameter(names[0])[0], "rows": rows}


def _with_uncertainty(name: str, value: float, sigma: float) -> str:
    expanded = COVERAGE_FACTOR * display(name, sigma)[0]
    return f"{rounded(display(name, value)[0], expanded)} ± {rounded(expanded, expanded)}"


def _curves(
    result: Result, over: TemperatureResult, group: str, names: Sequence[str], language: Language
) -> dict[str, Any]:
    """Return the changes of a group from the reference temperature, with expanded uncertainties, over the range."""
    temperatures = np.linspace(*over.range_c, _POINTS)
    lines = []
    for name in names:
        size, start = display(name, 1.0)[0], result.parameters[name].value
        values, sigmas = result.curve(name, temperatures)
        points = [
            (point.at_c, size * (point.values[name] - start), point.way, point.held_out)
            for point in over.points
            if name in point.values
        ]
        changes, expanded = size * (values - start), COVERAGE_FACTOR * abs(size) * sigmas
        lines.append({"values": changes.tolist(), "expanded": expanded.tolist(), "points": points})
    ends = {"low": over.range_c[0], "reference": over.reference_c, "high": over.range_c[1]}
    return {"name": _title(group, language), "unit": unit_of_parameter(names[0])[0], **ends, "lines": lines}


def _coefficients(
    over: TemperatureResult, group: str, names: Sequence[str], count: int, language: Language
) -> dict[str, Any]:
    """Return the coefficients of a group with their expanded uncertainties, per powers of K, and per K/min."""
    rows = []
    for name in names:
        row, size = over.coefficients[name], display(name, 1.0)[0]
        pairs = [*zip(row.values, row.sigma, strict=True)]
        cells = [_pair(size * value, size * sigma) for value, sigma in pairs] + [None] * (count - len(pairs))
        rate = None if row.rate is None else _pair(size * row.rate.value / 60.0, size * row.rate.sigma / 60.0)
        rows.append({"axis": _axis(name), "cells": cells, "rate": rate})
    return {"name": _title(group, language), "unit": unit_of_parameter(names[0])[0], "rows": rows}


def _pair(value: float, sigma: float) -> dict[str, str]:
    return {"value": short(value), "expanded": short(float(f"{COVERAGE_FACTOR * abs(sigma):.2g}"))}


def _axis(name: str) -> str:
    return name.rpartition("_")[2]


def _title(group: str, language: Language) -> str:
    text = term("group", group, language)
    return text[:1].upper() + text[1:]
