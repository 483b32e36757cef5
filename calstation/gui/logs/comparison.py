"""The comparison of the offline result with the result of the run, parameter by parameter."""

from pathlib import Path

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QWidget

from calstation.errors import InputError
from calstation.gui.text import KINDS, check_names, checks_tip, on_language_change, say
from calstation.gui.widgets import (
    NOTABLE_SIGMAS,
    ComparisonTable,
    ParameterSet,
    StateBadge,
    TemperatureCurves,
    ViewTabs,
    column,
    grid,
    label,
    plain_tip,
    show_text,
    theme,
)
from calstation.messages import event_text
from calstation.records import Verdict
from calstation.results import Resolved, Result, load_run_result, online_difference, run_outcome
from calstation.results.plots import LogIndex


class Comparison(QWidget):
    """A view of the result of the run and, after the log has been solved offline, of the offline result."""

    def __init__(self) -> None:
        super().__init__()
        self._log_index: LogIndex | None = None
        self._solved: Resolved | None = None
        self._outdated = False
        self._online: Result | None = None
        self._file_outcome = ""  #: Outcome in the result file if the log does not contain the run's end; "" if unknown.
        self._in_sigma: dict[str, float] = {}
        names = ("online_badge", "offline_badge", "difference_badge")
        self.online_badge, self.offline_badge, self.difference_badge = badges = [StateBadge(name=n) for n in names]
        self._difference_head = label("logs.compared", "muted")
        heads = (label("logs.online", "muted"), label("logs.offline", "muted"), self._difference_head)
        self.note_label = label(name="comparison_label", wrap=True)
        rows = grid(across=2 * theme.GRID, down=theme.GRID // 2, stretch=1)
        for line, (head, badge) in enumerate(zip(heads, badges, strict=True)):
            rows.addWidget(head, line, 0)
            rows.addWidget(badge, line, 1, Qt.AlignmentFlag.AlignLeft)
        self.table = ComparisonTable(
            "comparison_table", "logs.compared_parameters", independent=False, differences=True
        )
        self._nothing = label("logs.about_comparison", "muted", wrap=True)
        self._nothing.setAlignment(Qt.AlignmentFlag.AlignCenter)
        self.curves = TemperatureCurves("offline_curves_combo")
        self.tabs = ViewTabs("comparison_tabs", "common.parameters", "common.over_temperature")
        self.tabs.currentChanged.connect(lambda _: self._choose_view())
        column(rows, self.note_label, self.tabs, (self.table, 1), (self._nothing, 1), (self.curves, 1), on=self)
        self._choose_view()
        on_language_change(self, self._refresh)

    def show_log(self, log_index: LogIndex) -> None:
        """Show the result of the run."""
        self._log_index, self._solved = log_index, None
        without_end = log_index.stored is None and log_index.outcome is None
        self._file_outcome = _outcome_in_file(log_index.path) if without_end else ""
        self._online = log_index.stored
        self._fill()

    def show_solved(self, solved: Resolved) -> None:
        """Show an offline result next to the result of the run."""
        self._solved = solved
        self._fill()

    def set_outdated(self, outdated: bool) -> None:
        """Mark the offline result as outdated, because other stages or another range have been selected."""
        if outdated != self._outdated:
            self._outdated = outdated
            self._refresh()

    def _fill(self) -> None:
        result = None if self._solved is None else self._solved.result
        online = ParameterSet("logs.online_column", {} if self._online is None else self._online.compared)
        offline = ParameterSet(self._offline_heading, {})
        if result is not None:
            sigmas = {check.subject for check in result.failed_checks if check.kind == "sigma_below"}
            values = {check.subject for check in result.failed_checks if check.kind != "sigma_below"}
            sigma_states = dict.fromkeys(result.undetermined, "caution") | dict.fromkeys(sigmas, "bad")
            offline = ParameterSet(self._offline_heading, result.compared, dict.fromkeys(values, "bad"), sigma_states)
        self.table.show_sets((online, offline))
        (self._in_sigma,) = self.table.in_sigma
        self.curves.show_result(self._online if result is None else result)
        self._choose_view()
        self._refresh()

    def _choose_view(self) -> None:
        """Show the table or, for a result over temperature, the view that the tabs select."""
        names, shown = bool(self.table.names), self.curves.has_curves and self.tabs.currentIndex() == 1
        self.tabs.setVisible(self.curves.has_curves)
        self.curves.setVisible(shown)
        self.table.setVisible(names and not shown)
        self._nothing.setVisible(not names and not shown)

    def _refresh(self) -> None:
        self.table.parameters.refresh()
        self.online_badge.show_state(*self._online_verdict())
        if self._solved is None or self._log_index is None:
            self.offline_badge.show_state("none", say("logs.not_solved_yet"))
            notes = _worst_note(self._online)
        else:
            self.offline_badge.show_state(*self._offline_verdict(self._solved.result))
            notes = self._notes(self._solved, self._log_index)
        failed = [] if self._solved is None else self._solved.result.failed_checks
        for widget in (self.offline_badge, self.note_label):
            widget.setToolTip(plain_tip(checks_tip(failed)))
        show_text(self.note_label, "\n".join(notes))
        for widget in (self._difference_head, self.difference_badge):
            widget.setVisible(bool(self._in_sigma) and not self._outdated)
        if self._in_sigma and self._solved is not None and self._online is not None:
            self.difference_badge.show_state(*self._difference(self._solved.result, self._online))

    def _online_verdict(self) -> tuple[str, str]:
        if self._online is not None:
            return KINDS.get(self._online.verdict, "none"), say(run_outcome(self._online))
        if self._file_outcome:
            return "caution", say("logs.log_cut", outcome=self._file_outcome)
        log = self._log_index
        if log is not None and log.outcome is None and log.meta.run is not None:
            return "caution", say("logs.run_not_ended")
        return "none", say("logs.no_run_result")

    def _offline_heading(self) -> str:
        return say("logs.offline_outdated" if self._outdated else "logs.offline_column")

    def _offline_verdict(self, result: Result) -> tuple[str, str]:
        if self._outdated:
            return "caution", say("logs.outdated")
        if result.passed is None and result.missing_data:
            return "caution", say("logs.solved_partly")
        if result.passed is None:
            return "none", say("logs.solved_no_limits")
        if result.passed and result.partial:
            return "partial", say("logs.solved_partial")
        if result.passed:
            return "good", say("logs.inside_limits")
        return "bad", say("logs.outside_limits", failed=len(result.failed_checks), count=len(result.checks))

    def _difference(self, offline: Result, online: Result) -> tuple[str, str]:
        difference = online_difference(offline, online)
        if difference.identical:
            return "good", say("logs.identical")
        sigmas = abs(self._in_sigma[difference.parameter])
        largest = say("logs.largest_difference", sigmas=sigmas, parameter=difference.parameter)
        beyond = sum(abs(difference) > NOTABLE_SIGMAS for difference in self._in_sigma.values())
        if not beyond:
            return "none", largest
        return "caution", say("logs.difference_beyond", difference=largest, count=beyond)

    def _notes(self, solved: Resolved, log_index: LogIndex) -> list[str]:
        result, facts = solved.result, log_index.facts
        first, last = result.log.first_seq, result.log.last_seq
        notes = _worst_note(result)
        if result.passed is False:
            notes.append(say("logs.failed_checks", names=check_names(result.failed_checks)))
        if (first, last) != (facts.first_seq, facts.last_seq):
            notes.append(say("logs.part_of_log", first=first, last=last))
        if self._online is not None and self._online.stages not in ([], result.stages):
            notes.append(say("logs.stages_solved", stages=result.stages))
        if result.passed and result.unjudged:
            notes.append(say("advice.not_judged", names=result.unjudged))
        if undetermined := len(result.undetermined):
            notes.append(say("logs.parameters_lost", lost=undetermined, count=len(result.parameters)))
        notes += [say(reason) for reason in solved.missing_data]
        return notes + [say(event_text(key, values)) for key, values in solved.messages]


def _outcome_in_file(log: Path) -> str:
    """Return the outcome in the result file next to a log, or "" without a file or if the run did not end."""
    try:
        result = load_run_result(log.with_suffix(".json"))
    except InputError as error:
        return "unconfirmed" if error.code == "result.unconfirmed" else ""
    return "" if result.verdict is Verdict.INCOMPLETE else result.badge


def _worst_note(result: Result | None) -> list[str]:
    """Return a sentence that the values of a result over temperature are the worst values; [] for another result."""
    if result is None or result.temperature is None:
        return []
    low, high = result.temperature.range_c
    return [say("logs.worst_over_range", low=low, high=high)]
