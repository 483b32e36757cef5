"""What is wrong with a value, as a short sentence with the mend, in the language in force."""

from collections.abc import Mapping
from typing import Any

from PySide6.QtCore import QCoreApplication

from calstation.station.settings import Problem

_CONTEXT = "station_problem"


def QT_TRANSLATE_NOOP(context: str, text: str) -> str:
    """Marks a text for the translators under the name that lupdate looks for."""
    return text


_KINDS = {
    "missing": QT_TRANSLATE_NOOP("station_problem", "Missing; fill it in."),
    "greater_than": QT_TRANSLATE_NOOP("station_problem", "Out of range; it must be greater than {gt:g}."),
    "greater_than_equal": QT_TRANSLATE_NOOP("station_problem", "Out of range; it must be at least {ge:g}."),
    "less_than": QT_TRANSLATE_NOOP("station_problem", "Out of range; it must be less than {lt:g}."),
    "less_than_equal": QT_TRANSLATE_NOOP("station_problem", "Out of range; it must be at most {le:g}."),
    "float_type": QT_TRANSLATE_NOOP("station_problem", "Not a number; type one like 12.5."),
    "float_parsing": QT_TRANSLATE_NOOP("station_problem", "Not a number; type one like 12.5."),
    "int_type": QT_TRANSLATE_NOOP("station_problem", "Not a whole number; type one like 12."),
    "int_parsing": QT_TRANSLATE_NOOP("station_problem", "Not a whole number; type one like 12."),
    "int_from_float": QT_TRANSLATE_NOOP("station_problem", "Not a whole number; type one like 12."),
    "finite_number": QT_TRANSLATE_NOOP("station_problem", "Not a finite number; type one like 12.5."),
    "literal_error": QT_TRANSLATE_NOOP("station_problem", "Unknown; it must be {expected}."),
    "no_profile": QT_TRANSLATE_NOOP("station_problem", "“{value}” does not exist; choose from: {known}."),
}
"""Kinds of problems whose sentence does not depend on the field; others are told in the loader's own words."""


def word_problem(problem: Problem) -> str:
    """The sentence that stands beneath the field itself."""
    if problem.kind in _KINDS:
        return word(_KINDS[problem.kind], problem.values)
    text = problem.text.split(": ", 1)[-1] if problem.kind == "value_error" else problem.text
    return text[:1].upper() + text[1:]


def word_anywhere(problem: Problem) -> str:
    """The sentence where the field is not in sight: with its name."""
    if problem.kind in _KINDS and problem.place:
        return f"{'.'.join(map(str, problem.place))}: {word_problem(problem)}"
    return problem.text[:1].upper() + problem.text[1:]


def word(text: str, values: Mapping[str, Any]) -> str:
    """A marked text in the language in force, with its values."""
    return QCoreApplication.translate(_CONTEXT, text).format(**values)
