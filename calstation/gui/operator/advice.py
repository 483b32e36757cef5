"""What a result comes down to for an operator: why, what to do next, and the few numbers that matter."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from PySide6.QtCore import QCoreApplication

from calstation.gui.text import check_wording
from calstation.gui.text.check_wording import of_product
from calstation.gui.text.messages import term
from calstation.physics.parameters import GROUPS, INDEX, PARAMETERS
from calstation.physics.units import display, number

#: Rows that fit beside the verdict on a small screen; what failed or nearly did goes before what did not.
_MOST_ROWS = 10


@dataclass(frozen=True)
class Figure:
    """The value of a group that is nearest to its limit, or over it: texts for one row.

    by_sigma : its sigma is what is so near, and `limit` is sigma's
    """

    name: str
    value: str
    sigma: str
    limit: str
    unit: str
    passed: bool
    near: bool = False
    by_sigma: bool = False


def reason(outcome: str, result: Mapping[str, Any]) -> str:
    """Why a run ended as it did, in a sentence or two."""
    if outcome == "passed":
        inside = QCoreApplication.translate("advice", "Every value is inside its limits.")
        near = sum(bool(check.get("near_miss")) for check in result.get("checks", ()))
        if not near:
            return inside
        few = QCoreApplication.translate("advice", "({count} near its limit.)").format(count=near)
        return f"{inside} {few}"
    if outcome == "stopped":
        return QCoreApplication.translate(
            "advice", "The run was stopped; the table is at rest, its axes are off."
        )
    if outcome != "failed":
        return QCoreApplication.translate("advice", "The run did not reach its end.")
    failed = [check for check in result["checks"] if not check["passed"]]
    if not failed:
        return QCoreApplication.translate("advice", "No stage was solved.")
    first = word_check(failed[0], result)
    first = first[0].upper() + first[1:]
    if len(failed) == 1:
        return first
    more = QCoreApplication.translate("advice", "({count} more checks failed.)").format(count=len(failed) - 1)
    return f"{first} {more}"


def next_action(outcome: str, result: Mapping[str, Any]) -> str:
    """What to do with the unit now, by the result's own advice."""
    word = result.get("advice")
    if outcome == "passed":
        return QCoreApplication.translate("advice", "Remove the unit, scan the next.")
    if word == "reseat":
        return QCoreApplication.translate(
            "advice", "Reseat the unit: screws tight, cable free, table undisturbed. Then repeat."
        )
    if word == "set_aside":
        return QCoreApplication.translate("advice", "Set the unit aside and scan the next.")
    if outcome == "failed":
        return QCoreApplication.translate("advice", "Repeat the calibration: press START.")
    if word == "resume":
        return QCoreApplication.translate(
            "advice", "The finished stages are kept: continue after them, or press START to begin again."
        )
    return QCoreApplication.translate("advice", "Press START to begin again.")


def figures(result: Mapping[str, Any]) -> list[Figure]:
    """One row per parameter group, its value that is nearest to its limit, or over it; and the product's checks.

    Where there are too many, those that tell nothing are left out.
    """
    found: dict[str, tuple[float, Figure]] = {}
    checks = {check["name"]: check for check in result["checks"]}
    for name, row in result["parameters"].items():
        if name not in INDEX:
            continue
        within, below = checks.get(f"{name} within"), checks.get(f"{name} sigma below")
        share = max(_share(within), _share(below))
        group = PARAMETERS[INDEX[name]].group
        if (within or below) and share >= found.get(group, (-1.0, None))[0]:
            found[group] = (share, _figure(name, row, within, below))
    asked = [_figure_of_check(check) for check in result["checks"] if of_product(check)]
    rows = [*(found[group][1] for group in GROUPS if group in found), *asked]
    groups = len(rows) - len(asked)
    places = sorted(range(len(rows)), key=lambda k: (rows[k].passed, not rows[k].near, k >= groups))
    return [rows[k] for k in sorted(places[:_MOST_ROWS])]


def _figure_of_check(check: Mapping[str, Any]) -> Figure:
    words = check_wording.word_check(check)
    return Figure(
        name=check_wording.word_short(str(check["name"])),
        value=words.value,
        sigma="",
        limit=words.limit,
        unit=words.unit,
        passed=bool(check["passed"]),
        near=bool(check.get("near_miss")),
    )


def _share(check: Mapping[str, Any] | None) -> float:
    """How much of its limit a check's value takes, 1 at the limit."""
    if check is None or check["value"] is None:
        return 0.0
    limit = check["limit"]
    if isinstance(limit, list):
        low, high = limit
        return float(abs(check["value"] - 0.5 * (low + high)) / (0.5 * (high - low)))
    return float(check["value"]) / float(limit) if limit else 0.0


def _figure(
    name: str,
    row: Mapping[str, Any],
    within: Mapping[str, Any] | None,
    below: Mapping[str, Any] | None,
) -> Figure:
    (value, unit), (sigma, _) = display(name, row["value"]), display(name, row["sigma"])
    by_sigma = _share(below) > _share(within)
    limit = _interval(name, within["limit"]) if within is not None else ""
    if by_sigma and below is not None:
        limit = f"σ ≤ {display(name, below['limit'])[0]:.3g}"
    return Figure(
        name=_word_parameter(name),
        value=number(value, sigma).replace("-", "−"),
        sigma=number(sigma, sigma),
        limit=limit,
        unit=unit,
        passed=all(check["passed"] for check in (within, below) if check is not None),
        near=any(check.get("near_miss") for check in (within, below) if check is not None),
        by_sigma=by_sigma,
    )


def word_check(check: Mapping[str, Any], result: Mapping[str, Any]) -> str:
    """A failed check as a sentence."""
    name, _, kind = check["name"].partition(" ")
    if kind == "consistency":
        return QCoreApplication.translate(
            "advice", "{stage}: the measurements do not fit together (NIS {value:.2f}, at most {limit:.2f})."
        ).format(stage=term("stage", name), value=check["value"], limit=check["limit"])
    if check["name"] != "unobservable parameters" and name not in INDEX:
        words = check_wording.word_check(check)
        return QCoreApplication.translate(
            "advice", "Not so: {name} ({value} {unit}, allowed {limit})."
        ).format(name=words.sentence, value=words.value, unit=words.unit, limit=words.limit)
    if name not in INDEX:
        lost = ", ".join(_word_parameter(lost) for lost in result.get("unobservable", ()))
        return QCoreApplication.translate("advice", "The data did not determine {names}.").format(names=lost)
    value, unit = display(name, check["value"])
    if kind == "within":
        return QCoreApplication.translate("advice", "{name} is {value} {unit}, allowed are {limit}.").format(
            name=_word_parameter(name),
            value=f"{value:.4g}".replace("-", "−"),
            unit=unit,
            limit=_interval(name, check["limit"]),
        )
    return QCoreApplication.translate(
        "advice", "{name} is known to {value} {unit} only, wanted are {limit}."
    ).format(
        name=_word_parameter(name),
        value=number(value, value),
        unit=unit,
        limit=f"{display(name, check['limit'])[0]:.4g}",
    )


def _word_parameter(name: str) -> str:
    """A parameter by its group's words and its axis."""
    group = PARAMETERS[INDEX[name]].group
    return f"{term('group', group)} {name.removeprefix(group + '_')}"


def _interval(name: str, limit: list[float]) -> str:
    low, high = (display(name, bound)[0] for bound in limit)
    return f"±{high:.4g}" if low == -high else f"{low:.4g} … {high:.4g}".replace("-", "−")
