"""A result's checks in the language in force: what each asks as a sentence, its numbers, its verdict."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from PySide6.QtCore import QCoreApplication

from calstation.config.site_check import LATITUDE
from calstation.gui.text.messages import term
from calstation.messages.marked import QT_TRANSLATE_NOOP
from calstation.physics.parameters import INDEX, PARAMETERS, pair_parameter
from calstation.physics.units import ARCSECOND, DEGREE, MICRO_G, display

#: What acceptance checks ask, by their names (`records.checks`).
_SENTENCES = {
    "gravity_at_rest": QT_TRANSLATE_NOOP("checks", "At every rest the force is as long as gravity"),
    "improvement_at_rest": QT_TRANSLATE_NOOP(
        "checks", "At rest, what is left is a small part of what it was"
    ),
    "level_horizontal": QT_TRANSLATE_NOOP("checks", "Level: hardly any force along x and y"),
    "level_vertical": QT_TRANSLATE_NOOP("checks", "Level: along z all of gravity"),
    "motion_angle": QT_TRANSLATE_NOOP("checks", "Motions turn by the angle of the reference"),
    "motion_improvement": QT_TRANSLATE_NOOP(
        "checks", "Motions: the angle's error is a small part of what it was"
    ),
    "offline_online": QT_TRANSLATE_NOOP("checks", "Solved again, the log gives the run's answer"),
    "excitation": QT_TRANSLATE_NOOP("checks", "Every sigma is a small part of what it was"),
    LATITUDE: QT_TRANSLATE_NOOP("checks", "The gyros see the earth turn as at the station's latitude"),
}

#: The same in two or three words, where there is little room.
_SHORT = {
    "gravity_at_rest": QT_TRANSLATE_NOOP("checks", "force at rest"),
    "improvement_at_rest": QT_TRANSLATE_NOOP("checks", "force at rest, improved"),
    "level_horizontal": QT_TRANSLATE_NOOP("checks", "level, x and y"),
    "level_vertical": QT_TRANSLATE_NOOP("checks", "level, z"),
    "motion_angle": QT_TRANSLATE_NOOP("checks", "angle of motions"),
    "motion_improvement": QT_TRANSLATE_NOOP("checks", "angle of motions, improved"),
    "offline_online": QT_TRANSLATE_NOOP("checks", "solved again"),
    "excitation": QT_TRANSLATE_NOOP("checks", "sigma after over before"),
}

#: Units of checks that compare no parameter, and in what people read them.
_SHOWN = {"m/s²": ("µg", MICRO_G), "rad": ("″", ARCSECOND), "sigma": ("σ", 1.0), "1": ("", 1.0)}


@dataclass(frozen=True)
class CheckWords:
    """One check, ready for a row; state : shape of its verdict (`widgets.badge.KINDS`)."""

    sentence: str
    value: str
    limit: str
    margin: str
    unit: str
    verdict: str
    state: str
    where: str


def of_parameter(check: Mapping[str, Any]) -> bool:
    """Whether a check compares one parameter with its limit: such checks stand in the parameters' own table."""
    name = str(check["name"]).partition(" ")[0]
    return name in INDEX or pair_parameter(name) is not None


def word_check(check: Mapping[str, Any]) -> CheckWords:
    """A check as the result JSON holds it; those of results made before margins were told show none."""
    name = str(check["name"])
    unit, size = _unit(name, str(check["unit"]))
    passed, near = bool(check["passed"]), bool(check.get("near_miss"))
    verdict = (
        QCoreApplication.translate("checks", "failed")
        if not passed
        else QCoreApplication.translate("checks", "near-miss")
        if near
        else QCoreApplication.translate("checks", "passed")
    )
    sentence = word_check_name(name)
    return CheckWords(
        sentence=sentence[0].upper() + sentence[1:],
        value=_number(check["value"], size),
        limit=_limit(check["limit"], size),
        margin=_number(check.get("margin"), size),
        unit=unit,
        verdict=verdict,
        state="bad" if not passed else "caution" if near else "good",
        where=_where(str(check.get("where", ""))),
    )


def word_check_name(name: str) -> str:
    """What a check asks."""
    if name in _SENTENCES:
        return QCoreApplication.translate("checks", _SENTENCES[name])
    first, _, rest = name.partition(" ")
    if rest == "consistency":
        return QCoreApplication.translate("checks", "{0}: the measurements fit together (NIS)").format(
            term("stage", first)
        )
    if name == "unobservable parameters":
        return QCoreApplication.translate("checks", "Every parameter is determined by the data")
    if first == "previous":
        return QCoreApplication.translate("checks", "{0}: hardly changed since the last calibration").format(
            _word_parameter(rest)
        )
    if rest == "within":
        return QCoreApplication.translate("checks", "{0} within its limit").format(_word_parameter(first))
    if rest == "sigma below":
        return QCoreApplication.translate("checks", "{0} known well enough").format(_word_parameter(first))
    return name.replace("_", " ")


def of_product(check: Mapping[str, Any]) -> bool:
    """Whether a check is one of those that a product's ``[checks]`` ask for."""
    name = str(check["name"])
    return name in _SHORT or name.startswith("previous ")


def word_short(name: str) -> str:
    """What such a check compares, in a few words."""
    if name in _SHORT:
        return QCoreApplication.translate("checks", _SHORT[name])
    changed = QCoreApplication.translate("checks", "{0}, change")
    return changed.format(_word_parameter(name.partition(" ")[2]))


def _word_parameter(name: str) -> str:
    """A parameter by its group's words and its axis; a group by its words."""
    if name not in INDEX:
        return term("group", name)
    group = PARAMETERS[INDEX[name]].group
    return f"{term('group', group)} {name.removeprefix(group + '_')}"


def _unit(name: str, unit: str) -> tuple[str, float]:
    """In what a check's numbers are shown, and the size of that in SI."""
    if name == LATITUDE:
        return "°", DEGREE
    for part in name.split(" "):
        if part in INDEX or pair_parameter(part) is not None:
            shown = display(part, 1.0)
            return shown[1] if shown[1] != "1" else "", 1.0 / shown[0]
    first = next((p.name for p in PARAMETERS if name == f"previous {p.group}"), None)
    if first is not None:
        shown = display(first, 1.0)
        return shown[1], 1.0 / shown[0]
    return _SHOWN.get(unit, (unit, 1.0))


def _number(value: Any, size: float) -> str:
    if value is None:
        return "–"
    shown = float(value) / size
    text = f"{shown:.0f}" if 1000.0 <= abs(shown) < 1e9 else f"{shown:.4g}"
    return text.replace("-", "−")


def _limit(limit: Any, size: float) -> str:
    if not isinstance(limit, list | tuple):
        return f"≤ {_number(limit, size)}"
    low, high = limit
    return f"±{_number(high, size)}" if low == -high else f"{_number(low, size)} … {_number(high, size)}"


def _where(where: str) -> str:
    """A rest, a motion or a parameter, in words."""
    if not where:
        return ""
    if where in INDEX:
        return _word_parameter(where)
    kind, _, number = where.partition(" ")[2].partition(" ")
    if kind == "rest" and number.isdecimal():
        return QCoreApplication.translate("checks", "rest {0}").format(int(number) + 1)
    first, to, last = number.partition(" to ")
    if kind == "samples" and to:
        return QCoreApplication.translate("checks", "samples {0} to {1}").format(first, last)
    return where
