"""View of a result: verdict, parameters with their limits and changes, checks, and registers."""

from dataclasses import replace

from PySide6.QtWidgets import QWidget

from calstation.gui.operator import advice
from calstation.gui.state import ReleaseBar
from calstation.gui.text import (
    KINDS,
    check_names,
    checks_tip,
    is_parameter_check,
    on_language_change,
    product_text,
    say,
    sigmas_text,
    term,
)
from calstation.gui.widgets import (
    NOTABLE_SIGMAS,
    Cell,
    CellTable,
    ChecksTable,
    JobWatch,
    MissingEffect,
    StateBadge,
    button,
    column,
    label,
    ordered,
    plain_tip,
    row,
    set_subject,
    show_text,
    theme,
)
from calstation.judgement import Check
from calstation.messages import local_time
from calstation.physics import (
    NAMES,
    compared_number,
    display,
    entry_of,
    further_parameter,
    limit_number,
    limit_numbers,
    number,
)
from calstation.records import CheckKind
from calstation.results import (
    FinishedRun,
    Result,
    in_sigma,
    run_outcome,
    value_decisions,
)

_NONE = "–"
#: Maximum height of the table of checks that do not refer to a single parameter, px.
_MAX_CHECKS_HEIGHT = 26 * theme.GRID
#: Kinds of checks of the output corrected with the parameters; the correction omits added states.
_COMPENSATED: frozenset[CheckKind] = frozenset(
    {
        *("gravity_at_rest", "improvement_at_rest", "improvement_at_rest_floor", "level_horizontal", "level_vertical"),
        *("motion_angle", "motion_improvement", "motion_improvement_floor"),
    }
)
_COLUMNS = (
    Cell("common.unit", "unit", number=False),
    Cell("common.numeric_value", "value"),
    Cell("common.at_temperature", "at"),
    Cell("common.plus_minus_sigma", "sigma"),
    Cell("engineer.value_limit", "limit"),
    Cell("engineer.accepted", "accepted"),
    Cell("engineer.sigma_limit", "sigma_limit"),
    Cell("common.verdict", "verdict", number=False, state="verdict_state", hint="hint"),
    Cell("engineer.previous", "previous"),
    Cell("engineer.change", "change"),
    Cell("common.in_sigma", "in_sigma", state="change_state"),
    Cell("engineer.stage", "stage", number=False),
)
_NUMBERS = ("value", "at", "sigma", "previous", "change", "in_sigma", "limit", "accepted", "sigma_limit")
#: Columns for the comparison with the previous run or with the result without an added state.
_COMPARED_COLUMNS = (8, 9, 10)
#: Column of the acceptance limits, which the decision rule may narrow.
_ACCEPTED_COLUMN = 5
#: Column of the temperature of the worst value, and headings for a result over temperature.
_AT_COLUMN = 2
_WORST = {
    **{"value": "common.worst_value", "sigma": "common.worst_sigma"},
    **{"previous": "engineer.previous_at_reference", "change": "engineer.change_at_reference"},
}
#: Badge shape (`widgets.badge.KINDS`) of each parameter verdict.
_SHAPES = {"good": "good", "near": "caution", "lost": "caution", "value": "bad", "sigma": "bad", "both": "bad"}


def verdict_text(result: Result, *, stages: bool = True) -> str:
    """Return the verdict on a run, such as ``PASS``, with the stages of a partial run if `stages` is True."""
    return say(run_outcome(result, stages=stages))


def verdict_badge(result: Result) -> tuple[str, str]:
    """Return the badge shape (`widgets.badge.KINDS`) and the text of the verdict on a run or a re-solved log."""
    if result.outcome != "resolved":
        return KINDS.get(result.verdict, "none"), verdict_text(result)
    kind = {None: "none", True: "partial" if result.partial else "good", False: "bad"}[result.passed]
    return kind, say(f"engineer.resolved_{kind if result.tested else 'untested'}", failure=result.failure)


class ResultView(QWidget):
    """A view of the verdict on a run, its parameters, and the checks that do not refer to a single parameter."""

    def __init__(self, adding: JobWatch, release: ReleaseBar) -> None:
        super().__init__()
        self.release = release
        self.finished: FinishedRun | None = None
        self.missing = MissingEffect(adding, "add_state_button")
        self._badge = StateBadge(theme.SECTION, "result_badge", elided=True)
        self._summary, self._note = label(wrap=True), label(wrap=True, name="override_note")
        self._table = CellTable("result_table", "engineer.run_parameters", _COLUMNS, grouped=True)
        self._checks = ChecksTable()
        self._checks.setObjectName("acceptance_checks")
        copy = button("copy_button", "common.copy_table", self._table.copy, tip="engineer.copy_table_tip")
        column(
            row(self._badge, None, copy, spacing=2 * theme.GRID),
            self._summary,
            self._note,
            release,
            (self._table, 2),
            self.missing,
            (self._checks, 1),
            on=self,
            margins=(0, theme.GRID, 0, 0),
        )
        on_language_change(self, self.refresh)

    def show_run(self, finished: FinishedRun) -> None:
        """Show a finished run."""
        self.finished = finished
        set_subject(self, finished.result.serial)
        general = [check for check in finished.result.checks if not is_parameter_check(check)]
        self._checks.show_checks(general)
        self._checks.setMaximumHeight(min(self._checks.height_of_rows(), _MAX_CHECKS_HEIGHT))
        self._checks.setVisible(bool(general))
        self.missing.show_result(finished.result if finished.log is not None else None)
        self.refresh()

    def refresh(self) -> None:
        """Show the run again, because its registers may have been written since."""
        finished = self.finished
        if finished is None:
            return
        result = finished.result
        cells = {name: _cells(finished, name) for name in ordered(result.parameters)}
        compared = "engineer.without_state" if result.states_added else "engineer.previous"
        headings = {"previous": compared} if result.temperature is None else _WORST
        columns = [replace(cell, heading=headings.get(cell.key, cell.heading)) for cell in _COLUMNS]
        self._table.show_cells(cells, _NUMBERS, columns)
        for index in _COMPARED_COLUMNS:
            self._table.setColumnHidden(index, not finished.previous)
        self._table.setColumnHidden(_AT_COLUMN, result.temperature is None)
        self._table.setColumnHidden(_ACCEPTED_COLUMN, all("accepted" not in row for row in cells.values()))
        self._table.fit_columns()
        kind, verdict = verdict_badge(result)
        self._badge.show_state(kind, f"{result.serial}  ·  {verdict}")
        texts = []
        if result.product:
            texts.append(say("engineer.for_product", product=product_text(result.product)))
        if finished.changed_schedules:
            texts.append(say("operator.schedule_changed", stages=finished.changed_schedules))
        count, failed = len(result.checks), len(result.failed_checks)
        if count and (failed or result.verdict.judged):  # before the end of a run, passed checks mean little
            passed = count - failed
            texts.append(say("engineer.checks_passed", passed=passed, count=count))
            if failed:
                texts.append(say("engineer.checks_failed", names=check_names(result.failed_checks)))
        if near := sum(check.near_miss for check in result.checks):
            texts.append(say("engineer.near_misses", count=near))
        if result.conformity is not None:
            texts.append(say(f"engineer.rule_{result.conformity.rule}"))
        texts += filter(None, [advice.register_state(result, finished.runs)])
        if result.states_added:
            names = [term("group", state) for state in result.states_added]
            texts.append(say("event.states_added", states=names))
        if finished.previous_utc:
            texts.append(say("engineer.compared_with", time=local_time(finished.previous_utc)))
        self._summary.setText("  ·  ".join(texts))
        notable = [check for check in result.checks if check.near_miss or not check.passed]
        self._summary.setToolTip(plain_tip(checks_tip(notable)))
        notes = advice.result_notes(result)
        if result.lacks_calibration:
            notes.insert(0, say("advice.uncalibrated", stages=result.stages))
        if result.passed and result.unjudged:
            notes.insert(0, say("advice.not_judged", names=result.unjudged))
        if result.states_added and any(check.kind in _COMPENSATED for check in result.failed_checks):
            notes.append(say("engineer.compensated_without_states"))
        show_text(self._note, "\n".join(notes))


def _cells(finished: FinishedRun, name: str) -> dict[str, str]:
    """Return the texts in the row of a parameter, in display units and rounded according to the sigma."""
    result, previous = finished.result, finished.previous.get(name)
    parameter, at = result.worst(name)
    at_reference = result.parameters[name]
    checks: dict[str, Check] = {
        check.kind: check for check in result.checks if is_parameter_check(check) and check.subject == name
    }
    not_improved = result.calibration is not None and name in result.calibration.not_improved
    unjudged = name in result.not_compared and not checks
    verdict = "lost" if name in result.undetermined else "unjudged" if unjudged else _verdict(checks)
    value, unit = _display(name, parameter.value)
    sigma, _ = _display(name, parameter.sigma)
    size = 1.0 / _display(name, 1.0)[0]
    within, below = (checks.get(kind) for kind in ("within", "sigma_below"))
    limit, accepted = (None, None) if within is None else (within.limit, within.acceptance)
    sigma_limit = None if below is None else below.limit
    stated = entry_of(finished.limits, name) if unjudged else None
    if stated is not None:
        limit, sigma_limit = stated.interval, stated.sigma_limit(parameter.stage)
    cells = {
        "unit": unit or parameter.unit,
        "value": compared_number(number(value, sigma), size, parameter.value, limit, accepted),
        "sigma": compared_number(number(sigma, sigma), size, parameter.sigma, sigma_limit),
        "stage": term("stage", parameter.stage),
        "verdict": say(f"engineer.verdict_{verdict}"),
        "verdict_state": _SHAPES.get(verdict, ""),
        "hint": _conformity_hint(result, name),
    }
    if unjudged:
        cells["hint"] = say(f"engineer.unjudged_{'not_improved' if not_improved else 'undetermined'}")
    if at is not None:
        cells["at"] = f"{at:.0f}"
    if previous is not None:
        before, now = _display(name, previous.value)[0], _display(name, at_reference.value)[0]
        cells["previous"] = number(before, sigma)
        cells["change"] = "0" if before == now else number(now - before, sigma)
        # a trial with an added state solves the same data again, and a partial run starts from a calibration
        independent, updated = not (result.states_added or result.calibration), finished.updates_previous
        before_run = previous.model_copy(update={"sigma": finished.prior_sigmas.get(name, previous.sigma)})
        sigmas = in_sigma(at_reference, before_run if updated else previous, independent=independent, updated=updated)
        cells["in_sigma"] = "0" if before == now else sigmas_text(sigmas)
        if not_improved:  # the value was kept, so a change of 0 is no evidence of repeatability
            cells["in_sigma"] = say("engineer.not_improved")
        elif abs(sigmas) > NOTABLE_SIGMAS:
            cells["change_state"] = "caution"
    for key, interval in (("limit", limit), ("accepted", accepted)):
        if isinstance(interval, tuple):
            low, high = limit_numbers(interval, size, parameter.value)
            cells[key] = f"±{high}" if interval[0] == -interval[1] else f"{low} … {high}"
            if interval[0] > interval[1]:  # the guard band leaves no acceptance interval
                cells[key] = _NONE
    if sigma_limit is not None and not isinstance(sigma_limit, tuple):
        cells["sigma_limit"] = limit_number(sigma_limit, size, parameter.sigma)
    return cells


def _conformity_hint(result: Result, name: str) -> str:
    """Return the probability that the decision on a parameter is wrong, and the product's risks of wrong decisions."""
    decision = value_decisions(result).get(name)
    if decision is None:
        return ""
    kind = "accepted" if decision.accepted else "refused"
    texts = [say(f"engineer.conformity_{kind}", probability=decision.probability)]
    if decision.false_accept is not None and decision.false_reject is not None:
        risks = {"accept": decision.false_accept, "reject": decision.false_reject}
        texts.append(say("engineer.conformity_product", **risks))
    return "\n".join(texts)


def _verdict(checks: dict[str, Check]) -> str:
    """Return the verdict on a parameter from its checks by kind: a key of `_SHAPES`, or ``none``."""
    value = "within" in checks and not checks["within"].passed
    sigma = "sigma_below" in checks and not checks["sigma_below"].passed
    if value or sigma:
        return "both" if value and sigma else "value" if value else "sigma"
    if any(check.near_miss for check in checks.values()):
        return "near"
    return "good" if checks else "none"


def _display(name: str, value: float) -> tuple[float, str]:
    """Return a value in its display unit, and the unit; return the value and "" for an unknown parameter."""
    return display(name, value) if name in NAMES or further_parameter(name) else (value, "")
