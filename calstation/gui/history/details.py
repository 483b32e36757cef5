"""The details of a run: outcome, facts, offline solutions, the trend over the runs of its unit, and actions."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QAbstractItemView, QFormLayout, QFrame, QWidget

from calstation.database import is_archived
from calstation.errors import CalstationError
from calstation.gui.history.run_table import outcome_kind, run_text, stages_text
from calstation.gui.history.trend import Trend
from calstation.gui.operator import CertificateButton, FiguresTable, LabelButton, advice
from calstation.gui.state import ReleaseBar
from calstation.gui.text import (
    duration_text,
    fault_text,
    on_language_change,
    product_text,
    say,
    station_text,
    term,
)
from calstation.gui.widgets import (
    ROW,
    Cell,
    CellTable,
    ElidedLabel,
    StateBadge,
    TemperatureCurves,
    ViewTabs,
    button,
    column,
    enable,
    label,
    plain_tip,
    row,
    scroll_area,
    set_subject,
    show_text,
    theme,
)
from calstation.messages import Text, entry, known, local_time
from calstation.records import IndexedRun, ResolveRecord, RunRecord, Verdict
from calstation.results import RELEASE_IN_DOUBT, Result, changed_entry, lacks_log, number_ranges, run_outcome
from calstation.sequencer import Fault

#: Maximum number of listed failed checks.
_MAX_FAILED = 8


@dataclass(frozen=True)
class Actions:
    """Conditions of the actions and of the texts about them."""

    running: bool = False  #: Whether a run is in progress.
    closing: bool = False  #: Whether a run is being closed.
    resumable: bool = False  #: Whether the displayed run can be resumed.
    superseded: bool = False  #: Whether a later run of the unit has a verdict, so that there is nothing to close.
    engineer: bool = False  #: Whether an engineer reads the remedy for a fault.


class RunDetails(QFrame):
    """A panel with the details of a run; the page connects the buttons and provides those for documents."""

    def __init__(self, label_button: LabelButton, certificate_button: CertificateButton, release: ReleaseBar) -> None:
        super().__init__()
        self.setProperty("kind", "panel")
        self._run: RunRecord | None = None
        self._result: Result | None = None
        self._actions = Actions()
        #: Arguments of the last `show_run`.
        self._shown: tuple[object, ...] | None = None
        self._absent: Sequence[tuple[int, int]] = ()
        self._doubt: Text | None = None
        self._serial = label()
        self._serial.setFont(theme.font(theme.SECTION, bold=True))
        self.badge = StateBadge(theme.SECTION)
        self.reason_label = label(name="history_reason_label", wrap=True)
        self.failed_label = label(name="history_failed_label", wrap=True)
        self._figures, self._facts = FiguresTable(wrap=True), QFormLayout()
        self._facts.setHorizontalSpacing(2 * theme.GRID)
        self._facts.setVerticalSpacing(theme.GRID // 2)
        self.resolves = OfflineSolutionsTable()
        self.trend = Trend()
        self.trend.setMinimumHeight(20 * theme.GRID)
        self.curves = TemperatureCurves("history_curves_combo", differences=False)
        self.curves.setMinimumHeight(22 * theme.GRID)
        self.plot_tabs = ViewTabs("history_plot_tabs", "history.runs_of_this_unit", "common.over_temperature")
        self.plot_tabs.currentChanged.connect(lambda _: self._arrange_plots())
        self.result_button = button("history_result_button", "history.open_result")
        self.log_button = button("history_log_button", "history.open_log")
        self.record_button = button("history_record_button", "history.record", tip="history.record_tip")
        self.folder_button = button("history_folder_button", "history.folder")
        self.resume_button = button("history_resume_button", "history.resume")
        self.close_button = button("history_close_button")
        self.batch_button = button("history_batch_button", "history.batch", tip="history.whole_batch")
        self._documents, self._release = (label_button, certificate_button), release
        self._people = certificate_button.panel
        for asking in (release.open_changed, self._people.open_changed):
            asking.connect(self._arrange_plots)
        self._people.open_changed.connect(lambda asking: self.content_area.setVisible(not asking))
        release.open_changed.connect(self._offer_documents)
        self._lay_out()
        self._arrange_plots()
        on_language_change(self, self._show)

    @property
    def has_parameters(self) -> bool:
        """Whether the run has solved parameters."""
        return self._result is not None and bool(self._result.parameters)

    def show_run(
        self,
        run: RunRecord,
        result: Result | None,
        unit_runs: Sequence[IndexedRun],
        actions: Actions,
        absent: Sequence[tuple[int, int]] = (),
        doubt: Text | None = None,
    ) -> None:
        """Show a run, its result, the solved runs of its unit (the oldest first), and the possible actions.

        `absent` contains the ranges of the unit's attempt numbers without a known run; `doubt` states why the result
        is not confirmed.
        """
        registers = "" if result is None else advice.register_state(result, run.log.parent)
        shown = run, result, tuple(unit_runs), tuple(absent), doubt, registers
        if shown == self._shown:
            self.set_actions(actions)
            return
        self._shown = shown
        self._run, self._result, self._actions, self._absent = run, result, actions, absent
        self._doubt = doubt
        set_subject(self, run.serial)
        self._release.offer(result, run.result)
        self._offer_documents()
        self.trend.show_runs(unit_runs, run.log.stem, result)
        self.curves.show_result(result)
        self._arrange_plots()
        self._show()

    def set_actions(self, actions: Actions) -> None:
        """Update the possible actions."""
        if actions != self._actions:
            self._actions = actions
            self._show_actions()

    def _arrange_plots(self, open_: bool = False) -> None:
        """Show the plot that the tabs select; if `open_`, hide it and the buttons to make room for inputs."""
        shown = self.curves.has_curves and self.plot_tabs.currentIndex() == 1
        self._run_buttons.setVisible(not open_)
        self.plot_tabs.setVisible(self.curves.has_curves and not open_)
        self.curves.setVisible(shown and not open_)
        self.trend.setVisible(not shown and not open_ and self.trend.has_values)

    def _offer_documents(self, releasing: bool = False) -> None:
        """Show the buttons for documents; hide them while the inputs of a release use their space."""
        for document in self._documents:
            document.offer(self._result, None if releasing or self._run is None else self._run.result)

    def _lay_out(self) -> None:
        content = QWidget()
        items = (self.reason_label, self.failed_label, self._figures, self._facts, self.resolves, None)
        column(*items, on=content, spacing=theme.GRID, margins=(0, 0, theme.GRID, 0))
        self.content_area = scroll_area(content, texts=True)
        runs = (self.result_button, self.log_button, self.record_button, self.folder_button, self.batch_button)
        ends = (self.resume_button, self.close_button)
        self._run_buttons = QWidget()
        column(*(row(*((each, 1) for each in line)) for line in (ends, runs)), on=self._run_buttons)
        column(
            row((self._serial, 1), self.badge),
            (self.content_area, 5),
            self.plot_tabs,
            (self.trend, 3),
            (self.curves, 5),
            self._run_buttons,
            row(*((each, 1) for each in (*self._documents, self._release))),
            self._people,
            None,
            on=self,
            margins=(2 * theme.GRID,) * 4,
        )

    def _show(self) -> None:
        run, result = self._run, self._result
        if run is None:
            return
        self._serial.setText(run.serial)
        self.badge.show_state(outcome_kind(run), run_text(run))
        lines = []
        if result is not None and result.verdict.judged:
            failed = result.failed_checks
            lines = [f"✕  {advice.failed_check_text(check, result)}" for check in failed[:_MAX_FAILED]]
            if len(failed) > _MAX_FAILED:
                lines.append(say("history.and_more", count=len(failed) - _MAX_FAILED))
        show_text(self.failed_label, "\n".join(lines))
        self._figures.show_result(result)
        self._fill_facts(run)
        self._show_actions()

    def _show_actions(self) -> None:
        """Show the reason for the outcome and the buttons, which both depend on the possible actions."""
        run = self._run
        if run is None:
            return
        doubt = "" if run.missing or run.unconfirmed else say(self._doubt or "")
        reason = self._outcome_in_doubt(run) if doubt and run.altered else self._reason(run)
        registers = "" if self._result is None else advice.register_state(self._result, run.log.parent)
        registers = registers[:1].upper() + registers[1:]
        texts = doubt, *advice.result_notes(self._result), reason, registers
        show_text(self.reason_label, "\n".join(filter(None, texts)))
        self._update_buttons(run)

    def _outcome_in_doubt(self, run: RunRecord) -> str:
        """Return the outcome of a run without its unrecorded release; "" if the release is not in doubt."""
        if self._doubt is None or self._doubt.code not in RELEASE_IN_DOUBT:
            return ""
        return say("history.without_release", outcome=run_outcome(replace(run, altered=False)))

    def _reason(self, run: RunRecord) -> str:
        """Return the reason for the outcome of a run, and whether it can be resumed."""
        result = self._result
        if run.missing:
            outcome = run_outcome(replace(run, missing=False, altered=False, released=False))
            return say("history.missing_partial" if run.partial else "history.missing", outcome=outcome)
        if run.altered:
            altered = "history.altered" if run.log.exists() else "history.altered_without_log"
            code = "history.unconfirmed" if run.unconfirmed else altered
            reason = say(code, file=run.result, outcome=term("badge", run.verdict))
            changed = changed_entry(run)
            return reason if changed is None else f"{reason}\n{say('history.changed_entry', entry=changed)}"
        if run.verdict is Verdict.FAULT and run.error:
            fault = None if result is None else result.fault
            if fault is None:
                return run.error
            text = fault_text(Fault.of(fault), engineer=self._actions.engineer)
            reset = known(fault.code) and entry(fault.code).resettable  # this page has no button for it
            return "\n".join(filter(None, (text.text, "" if reset else text.remedy)))
        if result is not None and result.override is not None:
            return ""  # the note on the override states the reason
        if run.verdict.judged and result is not None:
            if result.failed_checks:
                cause = say("advice.uncalibrated", stages=result.stages) if result.lacks_calibration else ""
                return "\n".join(filter(None, (cause, say("history.failed", failure=result.failure))))
            return advice.reason(result.verdict, result)
        reason = ""
        if run.verdict is Verdict.INCOMPLETE:
            reason = say("history.not_ended")
        elif run.verdict is Verdict.STOPPED and run.error in (None, "", "operator"):
            reason = say("history.stopped")
        elif run.verdict is Verdict.STOPPED:
            reason = say("event.stopped_because", reason=run.error)
        if self._actions.resumable:
            reason += "\n" + say("history.can_be_resumed")
        elif run.closed:
            reason += "\n" + say("history.cannot_be_resumed")
        return reason

    def _fill_facts(self, run: RunRecord) -> None:
        while self._facts.rowCount():
            self._facts.removeRow(0)
        software = self._result.software if self._result is not None else None
        for code, text in (
            ("common.started", local_time(run.started_utc, zone=True)),
            ("history.duration", duration_text(run.duration)),
            ("common.cycle", self._cycle_text()),
            ("common.product", product_text(run.product or "")),
            ("history.attempt", str(run.attempt)),
            ("history.attempts_absent", say("common.comma").join(number_ranges(self._absent))),
            ("common.station", station_text(run.station or "")),
            ("common.operator", run.operator),
            ("history.batch", run.batch),
            ("history.slot", run.slot),
            ("history.software", software.version if software is not None else ""),
            ("history.resumed_from", run.resumed_from),
            ("common.stages", stages_text(run)),
            ("history.log_at", run.location),
        ):
            if text:
                value = ElidedLabel()
                value.setText(text)
                self._facts.addRow(label(code, "muted"), value)

    def _why_no_log(self, run: RunRecord) -> str:
        """Return why the log can be neither opened nor copied from an archive, or ""."""
        if run.log.exists() or is_archived(run.location):
            return ""
        if not run.origin:
            return say("history.log_gone")
        return say("history.log_elsewhere", station=run.station or "?", location=run.location or "?")

    def _why_no_result(self, run: RunRecord) -> str:
        """Return why the result cannot be opened, or ""."""
        if run.missing or run.altered:
            return say("history.files_missing" if run.missing else "history.result_changed")
        if self._doubt is not None and self._result is None:
            return say(self._doubt)
        if not (bool(run.stages) if run.origin else self.has_parameters):
            return say("history.no_parameters")
        return say("history.result_only_in_log") if run.result is None and not run.origin else ""

    def _cycle_text(self) -> str:
        """Return the durations of the cycle and of its phases other than stages, or "" if they are unknown."""
        seconds = {} if self._result is None else self._result.cycle_seconds
        if not seconds:
            return ""
        total = sum(seconds.values())
        others = duration_text(total - seconds.get("stage", 0.0))
        return say("history.duration_not_in_stages", duration=duration_text(total), others=others)

    def _update_buttons(self, run: RunRecord) -> None:
        actions = self._actions
        incomplete = run.verdict is Verdict.INCOMPLETE
        self.batch_button.setVisible(run.batch is not None)
        self.close_button.setText(say("history.close_as_incomplete" if incomplete else "history.do_not_resume"))
        self.resume_button.setVisible(actions.resumable)
        elsewhere = run.closed or run.origin or run.missing
        self.close_button.setVisible(actions.resumable or (incomplete and not (elsewhere or actions.superseded)))
        enable(self.result_button, self._why_no_result(run), say("history.show_parameters"))
        enable(self.log_button, self._why_no_log(run), say("history.draw_log"))
        why_not = say("history.log_gone" if lacks_log(run) else self._doubt or "")
        for document in self._documents:
            document.refuse(why_not)
        self.folder_button.setVisible(not run.origin)
        self.folder_button.setToolTip(plain_tip(str(run.log.parent)))
        busy = say("history.wait_for_run") if actions.running else ""
        enable(self.resume_button, busy, say("history.resume_tip"))
        enable(
            self.close_button,
            busy or (say("history.being_closed") if actions.closing else ""),
            say("history.close_tip"),
        )


#: Number of rows that are visible without scrolling.
_VISIBLE_ROWS = 4
_COLUMNS = (
    Cell("common.time", "time", number=False, hint="hint"),
    Cell("history.user", "user", number=False, hint="hint"),
    Cell("history.largest_difference", "difference", number=False, hint="hint"),
    Cell("common.stages", "stages", number=False, hint="hint"),
    Cell("history.samples", "samples", number=False, hint="hint"),
    Cell("history.software", "software", number=False, hint="hint"),
)


class OfflineSolutionsTable(QWidget):
    """A table of the offline solutions of a log, the latest first, which is hidden if there are none."""

    def __init__(self) -> None:
        super().__init__()
        self._records: Sequence[ResolveRecord] = ()
        self._error: CalstationError | None = None
        caption = label("history.solved_again", "muted")
        self._problem = label(kind="caution", wrap=True)
        self.table = CellTable("resolves_table", "history.offline_solutions", _COLUMNS, named=False)
        self.table.setSelectionMode(QAbstractItemView.SelectionMode.NoSelection)
        self.table.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        column(caption, self._problem, self.table, on=self, spacing=theme.GRID // 2)
        on_language_change(self, self._show)

    def show_records(self, records: Sequence[ResolveRecord], error: CalstationError | None) -> None:
        """Show the records of a log, given from the oldest to the latest, or the error if they cannot be read."""
        self._records, self._error = records[::-1], error
        self._show()

    def _show(self) -> None:
        table = self.table
        table.show_cells({str(number): self._cells(record) for number, record in enumerate(self._records)})
        rows = min(len(self._records), _VISIBLE_ROWS)
        bars = table.horizontalHeader().sizeHint().height() + table.horizontalScrollBar().sizeHint().height()
        table.setFixedHeight(ROW * rows + bars + 2)
        table.setVisible(bool(self._records))
        show_text(self._problem, "" if self._error is None else say(self._error.as_text))
        self.setVisible(bool(self._records) or self._error is not None)

    def _cells(self, record: ResolveRecord) -> dict[str, str]:
        return {
            "time": local_time(record.utc),
            "user": record.by or "",
            "difference": self._difference(record),
            "stages": say("common.comma").join(term("stage", stage) for stage in record.stages),
            "samples": f"{record.first_seq}–{record.last_seq}",
            "software": record.software,
            "hint": self._hint(record),
        }

    def _difference(self, record: ResolveRecord) -> str:
        difference = record.difference
        if difference is None:
            return say("history.no_run_result")
        if difference.identical:
            return say("history.identical")
        if not difference.parameter:
            return say("history.no_common_parameter")
        size = "∞" if difference.sigmas is None else f"{difference.sigmas:.2f}"
        text = say("history.difference", sigmas=size, parameter=difference.parameter)
        return say("history.trial", states=record.states_added, difference=text) if record.states_added else text

    def _hint(self, record: ResolveRecord) -> str:
        lines = [local_time(record.utc, zone=True)]
        if record.states_added:
            lines.append(say("history.states_added", states=", ".join(record.states_added)))
        lines.append(say("history.configuration", digest=record.configuration_sha256 or ""))
        return "\n".join(lines)
