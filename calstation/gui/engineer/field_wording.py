"""Fields of schedules in words, and what is wrong with a value, with the mend."""

from PySide6.QtCore import QCoreApplication

from calstation.config.schedules import ScheduleField, ScheduleProblem
from calstation.gui.text.messages import term
from calstation.messages.marked import QT_TRANSLATE_NOOP

_CONTEXT = "schedule"


_NAMES = {
    "turns": QT_TRANSLATE_NOOP("schedule", "Whole turns each way"),
    "rate_dps": QT_TRANSLATE_NOOP("schedule", "Rate"),
    "acceleration_dps2": QT_TRANSLATE_NOOP("schedule", "Acceleration"),
    "dwell_s": QT_TRANSLATE_NOOP("schedule", "Rest"),
    "place_dwell_s": QT_TRANSLATE_NOOP("schedule", "Rest in between"),
    "rounds": QT_TRANSLATE_NOOP("schedule", "Rounds"),
    "duration_s": QT_TRANSLATE_NOOP("schedule", "Duration"),
    "targets": QT_TRANSLATE_NOOP("schedule", "Target sigma"),
    "initial_rest_s": QT_TRANSLATE_NOOP("schedule", "First rest"),
    "rest_s": QT_TRANSLATE_NOOP("schedule", "Rest in every position"),
    "step_deg": QT_TRANSLATE_NOOP("schedule", "From position to position"),
    "manual": QT_TRANSLATE_NOOP("schedule", "Moved by hand"),
    "shortest_rest_s": QT_TRANSLATE_NOOP("schedule", "Shortest rest"),
    "turn_deg": QT_TRANSLATE_NOOP("schedule", "Turn"),
}

_DESCRIPTIONS = {
    "whole turns each way about every axis": QT_TRANSLATE_NOOP(
        "schedule", "whole turns each way about every axis"
    ),
    "rate of every move": QT_TRANSLATE_NOOP("schedule", "rate of every move"),
    "acceleration of every move": QT_TRANSLATE_NOOP("schedule", "acceleration of every move"),
    "rest before and after every turn": QT_TRANSLATE_NOOP("schedule", "rest before and after every turn"),
    "rest in every position": QT_TRANSLATE_NOOP("schedule", "rest in every position"),
    "rest after every quarter turn": QT_TRANSLATE_NOOP("schedule", "rest after every quarter turn"),
    "rest after an axis was brought into place": QT_TRANSLATE_NOOP(
        "schedule", "rest after an axis was brought into place"
    ),
    "rest after every half turn": QT_TRANSLATE_NOOP("schedule", "rest after every half turn"),
    "complete rounds": QT_TRANSLATE_NOOP("schedule", "complete rounds"),
    "the round during which this is over is the last": QT_TRANSLATE_NOOP(
        "schedule", "the round during which this is over is the last"
    ),
    "the round after which every sigma is below its target is the last": QT_TRANSLATE_NOOP(
        "schedule", "the round after which every sigma is below its target is the last"
    ),
}


def _say(text: str) -> str:
    return QCoreApplication.translate(_CONTEXT, text)


def word_field(name: str) -> str:
    """A field's name; a method's own field that is not known here as its name reads."""
    if name in _NAMES:
        return _say(_NAMES[name])
    return name.rsplit("_", 1)[0].replace("_", " ").capitalize()


def word_description(field: ScheduleField) -> str:
    """What a field does, its range and whether it may be left out, for its tooltip."""
    said = _say(_DESCRIPTIONS.get(field.description, field.description))
    parts = [said[:1].upper() + said[1:]] if said else []
    if span := word_range(field):
        parts.append(span)
    if field.optional:
        parts.append(_say(QT_TRANSLATE_NOOP("schedule", "empty: does not end the stage")))
    return "; ".join(parts)


def word_range(field: ScheduleField) -> str:
    """From where to where a value may go."""
    unit = f" {field.unit}" if field.unit else ""
    if field.low is not None and field.high is not None:
        template = (
            QT_TRANSLATE_NOOP("schedule", "a number above {0:g}, at most {1:g}{2}")
            if field.above
            else QT_TRANSLATE_NOOP("schedule", "{0:g} to {1:g}{2}")
        )
        return _say(template).format(field.low, field.high, unit)
    if field.low is not None:
        template = (
            QT_TRANSLATE_NOOP("schedule", "a number above {0:g}{1}")
            if field.above
            else QT_TRANSLATE_NOOP("schedule", "{0:g}{1} or more")
        )
        return _say(template).format(field.low, unit)
    return ""


def word_problem(field: ScheduleField, problem: ScheduleProblem) -> str:
    """What is wrong with a field's value, and the mend."""
    unit = f" {field.unit}" if field.unit else ""
    subject = f"{term('group', problem.subject)}: " if problem.subject else ""
    if problem.kind == "table":
        return _say(QT_TRANSLATE_NOOP("schedule", "The table does {0:g}{1} at most; lower it.")).format(
            problem.bound, unit
        )
    if problem.kind == "whole":
        return _say(QT_TRANSLATE_NOOP("schedule", "Must be a whole number, {0}.")).format(
            word_range(field) or "1"
        )
    if problem.kind in ("low", "high") and not problem.subject:
        template = (
            QT_TRANSLATE_NOOP("schedule", "Too small; enter {0}.")
            if problem.kind == "low"
            else QT_TRANSLATE_NOOP("schedule", "Too large; enter {0}.")
        )
        return _say(template).format(word_range(field))
    if problem.kind == "low":
        return subject + _say(QT_TRANSLATE_NOOP("schedule", "enter a number above 0, or leave it empty."))
    if problem.kind == "name":
        return _say(QT_TRANSLATE_NOOP("schedule", "{0} is no parameter or group; remove it.")).format(
            problem.subject
        )
    return subject + _say(QT_TRANSLATE_NOOP("schedule", "Not a number; enter {0}.")).format(
        word_range(field) or "0.1"
    )
