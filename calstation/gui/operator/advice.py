"""Explanation of a result for operators: the reason, the next action, and the values outside or near their limits."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from calstation.errors import CalstationError
from calstation.gui.state import RunStatus
from calstation.gui.text import (
    about,
    check_name,
    check_text,
    is_parameter_check,
    is_product_check,
    language,
    limit_ratio,
    limit_text,
    parameter_text,
    rendered,
    say,
    term,
    with_minus,
)
from calstation.judgement import Check
from calstation.messages import joined, local_time
from calstation.physics import GROUPS, INDEX, PARAMETERS, compared_number, display, number, unit_of_parameter
from calstation.registers import run_registers
from calstation.results import Parameter, Result

#: Maximum number of figures below the verdict on a small screen, without and with a long reason.
_MAX_FIGURES, _MAX_BELOW_REASON = 9, 7


@dataclass(frozen=True)
class Figure:
    """Value of a parameter or of a product check, with its limit."""

    name: str
    value: str
    sigma: str
    limit: str
    unit: str
    passed: bool
    near: bool = False
    by_sigma: bool = False  #: Whether the sigma is decisive and `limit` is its limit.
    guarded: bool = False  #: Whether the decision rule narrowed the limit of the value.
    about: str = ""  #: What is compared, for a tooltip.


def reason(outcome: str, result: Result | None, run: RunStatus | None = None) -> str:
    """Return the reason for an outcome; `run` is the run that has just ended, whose table may not have been moved."""
    checks = [] if result is None else result.checks
    if outcome in ("passed", "partial"):
        unjudged = [] if result is None else result.unjudged
        code = f"{outcome}_judged" if unjudged else outcome
        passed = say(f"advice.{code}", stages=[] if result is None else result.stages, names=unjudged)
        return joined(passed, _near(checks), language.current())
    if outcome != "failed":
        if outcome != "stopped":
            return say("advice.incomplete")
        if run is not None and run.by_hand:
            return say("advice.stopped_manual")
        return say("advice.stopped_connecting" if run is not None and not run.commanded else "advice.stopped")
    failed = [check for check in checks if not check.passed]
    if not failed or result is None:
        return say("advice.no_stage")
    tests = [check for check in failed if check.diagnosis is not None]
    first = failed_check_text(tests[0] if tests else max(failed, key=limit_ratio), result)
    first = first[0].upper() + first[1:]
    if result.lacks_calibration:
        first = joined(say("advice.uncalibrated", stages=result.stages), first, language.current())
    more = say("advice.more_failed", count=len(failed) - 1) if len(failed) > 1 else ""
    return joined(first, more, language.current())


def result_notes(result: Result | None) -> list[str]:
    """Return notes on stages ended by hand, overrides and the release of a failed unit."""
    notes = []
    if result is not None and result.ended_by_hand:
        notes.append(say("advice.ended_by_hand", stages=result.ended_by_hand))
    if result is not None and result.standard_override is not None:
        notes.append(say("advice.standard_override", why=result.standard_override))
    if result is not None and result.override is not None:
        override = result.override
        people = ", ".join(filter(None, (override.by, override.confirmed_by)))
        when = local_time(override.utc, zone=True)
        notes.append(say("advice.released_by", people=people, when=when, why=override.why))
    return notes


def register_state(result: Result, runs: Path) -> str:
    """Return what a run wrote to the registers and the state of that transfer, or "" if the run wrote none.

    `runs` is the folder that contains the log of the run.
    """
    try:
        state = run_registers(result, runs)
    except CalstationError as error:
        return say(error.as_text)
    return "" if state is None else "  ·  ".join(map(say, state.texts))


def next_action(outcome: str, result: Result | None, *, in_batch: bool = False, engineer: bool = False) -> str:
    """Return the next action for the unit, as a sentence.

    For a unit `in_batch`, the scan of the next unit is omitted. For an engineer, the remedy of the cause is returned.
    """
    if engineer and result is not None and _action(outcome, result) == "ask_engineer":
        checks = filter(None, (result.missing_state, *result.failed_checks))
        if (cause := next(filter(None, (check.cause_text for check in checks)), None)) is not None:
            return rendered(cause).remedy
    if in_batch and _action(outcome, result) in ("next_unit", "ask_engineer", "set_aside"):
        return brief_action(outcome, result)  # the line below the tiles says what to scan next
    return say(f"advice.{_action(outcome, result)}")


def repeats(result: Result | None) -> bool:
    """Return whether the operator may calibrate a unit again, without an engineer, after it failed or had a fault."""
    return result is None or not (result.released or _action("failed", result) in ("set_aside", "ask_engineer"))


def brief_reason(outcome: str, result: Result | None) -> str:
    """Return the worst failed check of a failed unit, or the value nearest to its limit of a passed unit."""
    if outcome in ("passed", "partial"):
        if result is not None and result.unjudged:
            return say("advice.not_judged", names=result.unjudged)
        return "" if result is None else _near(result.checks, brief=True)
    if outcome != "failed" or result is None:
        return ""
    failing = [figure for figure in figures(result) if not figure.passed]
    if not failing:
        return say("advice.no_stage")
    worst, count = failing[0], len(result.failed_checks)
    text = f"{worst.name} σ" if worst.by_sigma else worst.name
    return text if count == 1 else say("advice.and_more", names=text, more=count - 1)


def brief_action(outcome: str, result: Result | None) -> str:
    """Return the next action for the unit, in a few words."""
    return term("advice_brief", _action(outcome, result))


def _action(outcome: str, result: Result | None) -> str:
    """Return the catalogue term of the next action for the unit."""
    if outcome == "failed" and result is not None and result.missing_state is not None:
        return "ask_engineer"
    advised = None if result is None else result.advice
    if outcome == "passed":
        return "next_unit"
    if outcome == "partial":
        return "next_partial"
    if advised in ("reseat", "set_aside", "full_calibration", "ask_engineer"):
        return advised
    if outcome == "failed":
        return "repeat_in_full" if result is not None and result.ended_by_hand else "repeat"
    if result is not None and result.closed_utc is not None:
        return "closed"
    if result is None or advised != "resume":
        return "begin_again"
    return "resume" if result.solved_stages else "resume_temperatures"  # complete in its first stage


def figures(result: Result) -> list[Figure]:
    """Return the failing parameters and checks in descending order of their ratio to the limit, then the passing ones.

    For the passing parameters of a group, only the parameter nearest to its limit is returned. If there are too many
    figures, near misses take precedence. A run without a verdict has no figures: later stages would have changed them.
    """
    if not result.verdict.judged:
        return []
    failing: list[tuple[float, Figure]] = []
    passing: dict[str, tuple[float, Figure]] = {}
    checks = {(check.kind, check.subject): check for check in result.checks}
    for name, row in result.compared.items():
        if name not in INDEX:
            continue
        within, below = checks.get(("within", name)), checks.get(("sigma_below", name))
        ratio = max(limit_ratio(within), limit_ratio(below))
        group = PARAMETERS[INDEX[name]].group
        if any(check is not None and not check.passed for check in (within, below)):
            failing.append((ratio, replace(_figure(name, row, within, below), name=_worst_name(result, name))))
        elif (within or below) and ratio >= passing.get(group, (-1.0, None))[0]:
            passing[group] = (ratio, replace(_figure(name, row, within, below), name=_worst_name(result, name)))
    parameters = [passing[group][1] for group in GROUPS if group in passing]
    rows = list(parameters)
    for check in result.checks:
        if is_parameter_check(check) or (check.passed and not is_product_check(check)):
            continue
        text = check_text(check)
        figure = Figure(
            check_name(check), text.value, "", text.limit, text.unit, check.passed, check.near_miss, about=text.about
        )
        if check.passed:
            rows.append(figure)
        else:
            failing.append((limit_ratio(check), figure))
    maximum = _MAX_BELOW_REASON if failing else _MAX_FIGURES
    failed = [figure for _, figure in sorted(failing, key=lambda item: -item[0])][:maximum]
    order = sorted(range(len(rows)), key=lambda k: (not rows[k].near, k >= len(parameters)))
    return failed + [rows[k] for k in sorted(order[: maximum - len(failed)])]


def _worst_name(result: Result, name: str) -> str:
    """Return the name of a parameter and, if its value depends on temperature, the temperature of the worst value."""
    at = result.worst(name)[1]
    return parameter_text(name) if at is None else say("operator.worst_at", parameter=name, at=at)


def failed_check_text(check: Check, result: Result) -> str:
    """Return a sentence that describes a failed check."""
    if check.kind == "consistency":
        return say("advice.inconsistent", stage=check.subject, value=check.value, limit=check.limit)
    if check.kind == "unobservable":
        return say("advice.undetermined", names=result.undetermined)
    cause = check.cause_text
    if cause is not None:
        text, inferred = rendered(cause).text, check.kind == "effects" and cause.code != "cause.no_single_effect"
        return say("advice.most_likely", cause=text) if inferred else text
    row, name = check_text(check), parameter_text(check.subject)
    if check.kind == "change":
        return say("advice.changed", name=parameter_text(check.where.parameter), value=row.value, limit=row.limit)
    value, limit = (f"{number} {row.unit}".rstrip() for number in (row.value, row.limit))
    if not is_parameter_check(check) or check.subject not in INDEX:
        return say("advice.violated", name=row.sentence, value=value, limit=limit)
    if row.guard:
        return say("advice.outside_guarded", parameter=name, value=value, acceptance=limit, why=row.guard)
    code = "advice.outside" if check.kind == "within" else "advice.uncertain"
    return say(code, parameter=name, value=value, limit=limit)


def _near(checks: Sequence[Check], *, brief: bool = False) -> str:
    """Return the near miss nearest to its limit and the number of other near misses, or "" if there is none."""
    near = [check for check in checks if check.near_miss]
    if not near:
        return ""
    nearest = max(near, key=limit_ratio)
    name = parameter_text(nearest.subject) if is_parameter_check(nearest) else check_name(nearest)
    more, values = len(near) - 1, {"percent": int(100.0 * limit_ratio(nearest)), "limit": limit_text(nearest)}
    if brief:
        names = say("advice.and_more", names=name, more=more) if more else name
        return say("advice.near_brief", names=names, **values)
    return say("advice.near_more" if more else "advice.near", name=name, more=more, **values)


def _figure(name: str, row: Parameter, within: Check | None, below: Check | None) -> Figure:
    """Return the figure of a parameter from the checks of its value and its sigma."""
    (value, unit), (sigma, _), size = display(name, row.value), display(name, row.sigma), unit_of_parameter(name)[1]
    limits = [None if check is None else check.compared_with for check in (within, below)]
    by_sigma = limit_ratio(below) > limit_ratio(within)
    limit = "" if within is None else check_text(within).limit
    if by_sigma and below is not None:
        limit = f"σ {check_text(below).limit}"
    both = [check for check in (within, below) if check is not None]
    return Figure(
        name=parameter_text(name),
        value=with_minus(compared_number(number(value, sigma), size, row.value, limits[0])),
        sigma=compared_number(number(sigma, sigma), size, row.sigma, limits[1]),
        limit=limit,
        unit=unit,
        passed=all(check.passed for check in both),
        near=any(check.near_miss for check in both),
        by_sigma=by_sigma,
        guarded=within is not None and within.acceptance is not None,
        about=about("check", "sigma_below") if by_sigma or within is None else check_text(within).about,
    )
