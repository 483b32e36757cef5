"""What is wrong with a value, as a short sentence with the mend, in the language in force."""

from collections.abc import Mapping
from typing import Any

from PySide6.QtCore import QCoreApplication

from calstation.config.editing import Place, Problem
from calstation.messages.marked import QT_TRANSLATE_NOOP

_CONTEXT = "station_problem"


#: Kinds of problems whose sentence does not depend on the field.
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

_TRAVEL = QT_TRANSLATE_NOOP("station_problem", "The lowest angle must lie below the highest.")
_UNIT_VECTOR = QT_TRANSLATE_NOOP("station_problem", "Give a unit vector: its squares add up to 1.")
_TABLES_ADDRESS = QT_TRANSLATE_NOOP(
    "station_problem", "Write tcp://host:port, or socket://host:port for a serial server; port 1 to 65535."
)
_IMUS_ADDRESS = QT_TRANSLATE_NOOP(
    "station_problem", "Write socket://host:port for a serial server; port 1 to 65535."
)
#: What the rules over several values say of the fields of this page; all else is told in the loader's own words.
_RULES: dict[Place, str] = {
    ("outer",): _TRAVEL,
    ("inner",): _TRAVEL,
    ("outer_axis",): _UNIT_VECTOR,
    ("inner_axis",): _UNIT_VECTOR,
    ("table", "port"): _TABLES_ADDRESS,
    ("imu", "port"): _IMUS_ADDRESS,
    (): QT_TRANSLATE_NOOP(
        "station_problem", "Outer and inner axis are less than 60° apart; correct one of them."
    ),
}


def word_problem(problem: Problem) -> str:
    """The sentence that stands beneath the field itself."""
    if problem.kind in _KINDS:
        return word(_KINDS[problem.kind], problem.values)
    if problem.kind == "value_error" and problem.place in _RULES:
        return word(_RULES[problem.place], {})
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
