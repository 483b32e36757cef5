"""An error of a plan, a device or a configuration in one line, in the language in force where its sentence is known."""

import re
from functools import cache

from PySide6.QtCore import QCoreApplication

from calstation.errors import CalstationError
from calstation.gui.text.messages import error_text
from calstation.messages.marked import QT_TRANSLATE_NOOP

#: What plans say that find no way within the table's limits, or that nobody can foretell.
_PLANS = (
    QT_TRANSLATE_NOOP(
        "plans",
        "table limits: {0} whole turns need {1}° of travel on the {2} axis, which has {3}°; "
        "lower turns in the schedule of rate",
    ),
    QT_TRANSLATE_NOOP(
        "plans", "table limits: azimuth flips need 180° both ways on the {0} axis; widen its travel"
    ),
    QT_TRANSLATE_NOOP(
        "plans",
        "table limits: the {0} axis cannot reach {1}° (or whole turns from it) within {2}° to {3}°; "
        "widen the travel or mount the unit otherwise",
    ),
    QT_TRANSLATE_NOOP("plans", "motion by hand cannot be foretold; its sigmas come with the run"),
)


def one_line(error: CalstationError | str) -> str:
    """Cause, what is wrong and the mend of an error's own words."""
    if isinstance(error, CalstationError) and error.code:
        return error_text(error).sentences
    text = str(error)
    for pattern, sentence in _patterns():
        if found := pattern.fullmatch(text):
            values = [_word_joint(value) for value in found.groups()]
            said = QCoreApplication.translate("plans", sentence).format(*values)
            return said.removeprefix("table limits: ")
    return text


def _word_joint(value: str) -> str:
    if value == "outer":
        return QCoreApplication.translate("plans", "outer")
    return QCoreApplication.translate("plans", "inner") if value == "inner" else value


@cache
def _patterns() -> tuple[tuple[re.Pattern[str], str], ...]:
    return tuple((re.compile(re.sub(r"\\\{\d\\\}", "(.*?)", re.escape(s))), s) for s in _PLANS)
