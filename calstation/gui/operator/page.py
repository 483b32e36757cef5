"""The operator page: loading, scan, START, live view and verdict."""

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from PySide6.QtCore import Qt
from PySide6.QtGui import QShowEvent
from PySide6.QtWidgets import QSizePolicy, QWidget

from calstation.config import DEFAULT_PRODUCT, load_station
from calstation.errors import CalstationError
from calstation.gui.operator.header import RunHeader
from calstation.gui.operator.live import LiveView
from calstation.gui.operator.loading import Loading
from calstation.gui.operator.next_run import read_next_run, selection_question
from calstation.gui.operator.production import ShiftCounter, UnprintedNotice
from calstation.gui.operator.questions import (
    ClaimNotice,
    FailingNotice,
    ValidationNotice,
    ask,
    close_question,
    closing_notice,
    has_pair,
    progress_message,
    sign_in_text,
    unsuitable_products,
    urgent_message,
    why_not_load,
)
from calstation.gui.operator.stage_list import StageList
from calstation.gui.operator.starting import RunStarter
from calstation.gui.operator.units import SlotsPanel, VerdictGrid
from calstation.gui.operator.verdict import VerdictPanel
from calstation.gui.state import AppContext, EventLog, ExchangeLabel, Page, run_badge
from calstation.gui.text import language, offered_products, on_language_change, rendered, say, term
from calstation.gui.widgets import (
    ROW,
    STEPS,
    EmptyState,
    NoticeBar,
    PageArea,
    StateBadge,
    button,
    column,
    label,
    panel,
    progress_bar,
    row,
    stack,
    theme,
)
from calstation.messages import Text, joined
from calstation.records import Verdict
from calstation.sequencer import ChamberChanged, Event

#: Number of visible rows of the event log.
_EVENT_ROWS = 6


class OperatorPage(Page):
    """The page on which operators calibrate units, without settings that they must not change."""

    def __init__(self, app: AppContext) -> None:
        super().__init__(app)
        self.setObjectName("operator_page")
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)  # receives the keys of a scan during a run instead of a button
        #: Whether the serial field is for the next unit; the engine of the last run may still be running.
        self._next_awaited = True
        self._problem: Text | None = None
        self._opened = self._offer_due = False
        self._products: list[tuple[str, Path]] = []
        self._station = ""  #: Station file whose product has been selected.
        self.header: RunHeader = RunHeader(app.run)
        self._stages = StageList(app)
        self.closing, self.notice = NoticeBar(), NoticeBar("operator_notice")
        self._documents = NoticeBar("documents_notice")  #: Separate, so that questions about a run stay open.
        self._unprinted = UnprintedNotice(app, "unprinted_notice", self.await_scan)
        self._failing = FailingNotice(app.run, self.setFocus)
        self._loading, self._live = Loading(), LiveView(app)
        documents = self._documents, self._unprinted, self.await_scan
        self._verdict, self._shift = VerdictPanel(app, *documents), ShiftCounter(app)
        self._claimed, self._validation = ClaimNotice(app), ValidationNotice(app)
        self._starting = RunStarter(app, self.header, self.notice)
        self._slots = SlotsPanel(self._starting.slots)
        self._verdicts = VerdictGrid(app, *documents)
        self._unit_opened = False  #: Whether the verdict on one of several units is displayed.
        self._hindrance = EmptyState()
        self._views = stack(self._hindrance, self._loading, self._slots, self._live, self._verdicts, self._verdict)
        self._progress = progress_bar(theme.GRID, "run_progress")
        self._message, self._badge = label(name="message_label", wrap=True), StateBadge(theme.SECTION)
        self._message.setFont(theme.font(theme.SECTION))
        notices = self.closing, self._failing, self._claimed, self._validation, self._unprinted, self._documents
        right = column(*notices, self.notice, self._starting.dialog.people, (self._views, 1))
        counts = row(self._shift, None, ExchangeLabel(app), spacing=3 * theme.GRID)
        self._events = EventLog("events_table")
        self._events.follow(app.engine_link)
        header = self._events.horizontalHeader().sizeHint().height()
        self._events.setFixedHeight(header + _EVENT_ROWS * ROW + 2 * self._events.frameWidth())
        self._events.hide()
        show_events, events_tip = lambda: self._events.setVisible(self._events.isHidden()), "event_log.show_tip"
        events = button("events_button", "event_log.show", show_events, tip=events_tip)
        events.setFocusPolicy(Qt.FocusPolicy.NoFocus)  # the keys of a scan must not press it
        watch, tip = "logs.watch_live", "operator.show_watch_tip"
        self._watch = button("show_watch_button", watch, lambda: app.watch_requested.emit(), tip=tip)
        self._watch.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        state = column(self._message, counts, spacing=0), 1
        foot = panel(row(state, self._watch, events, self._badge, spacing=2 * theme.GRID))
        page_margins = (2 * theme.GRID, 0, 2 * theme.GRID, theme.GRID)
        content = QWidget()
        row(self._stages, (right, 1), on=content)
        column((PageArea(content), 1), self._events, self._progress, foot, on=self, margins=page_margins)
        self._connect()
        self._read_products()
        for show in (self._show_names, self._refresh, self._show_serial):
            on_language_change(self, show)

    @property
    def manual(self) -> str:
        """The section of the manual about a fault, a verdict, a batch or a calibration."""
        if self._problem is not None:
            return "reference/faults.md"
        if self.app.run.fault is not None:
            return "how-to/operate.md#after-a-fault"
        if self.app.run.ended:
            return "how-to/operate.md#after-the-verdict"
        if self.app.run.in_progress:
            return "how-to/operate.md#stop-at-once"
        return "how-to/several-units.md#run-a-batch" if self._starting.slots else "how-to/operate.md#calibrate-a-unit"

    def showEvent(self, event: QShowEvent) -> None:
        """Prepare for a scan and, when the page is first shown, offer to resume interrupted runs."""
        super().showEvent(event)
        self.update_files()
        if not self._opened:
            self._opened = True
            self._starting.interrupted.recover()
            self._validation.check()
        self._shift.count()
        self.await_scan()

    def await_scan(self) -> None:
        """Focus the serial number field for a scan, unless a run is in progress or a question is open."""
        run = self.app.run
        if self.isVisible() and not run.in_progress and run.fault is None and not self.notice.asking:
            self.header.focus_scan()

    def _connect(self) -> None:
        header, app = self.header, self.app
        for entered in (header.serial_entered, header.serial_edited, header.start_pressed):
            entered.connect(self._show_readiness)
        header.serial_edit.textChanged.connect(self._show_readiness)
        header.serial_edit.textChanged.connect(lambda text: self._loading.show_serial(text.strip()))
        for outdates in (header.serial_edited, header.serial_entered, app.station_changed):
            outdates.connect(self._documents.dismiss)
        app.port_watch.stopped.connect(lambda notice: ask(self._documents, "stopped", notice, {}))
        app.port_watch.freed.connect(self._port_freed)
        self.notice.changed.connect(self._show_readiness)
        header.product_combo.opening.connect(self._mark_products)
        header.product_selected.connect(app.set_product)
        header.product_selected.connect(header.focus_scan)
        header.enter_refused.connect(lambda: self._message.setText(say("operator.enter_refused")))
        field = header.badge_field
        for changed in (field.named, field.signed_in, field.signed_out):
            changed.connect(self._operator_changed)
        app.identified.connect(field.identify)
        field.signed_out.connect(app.role.lock)
        field.signed_out.connect(self.await_scan)
        self._verdict.acknowledged.connect(self._acknowledge)
        self._verdict.closed.connect(lambda: self._open_unit(opened=False))
        self._verdicts.again.connect(self._starting.fill_again)
        self._verdicts.opened.connect(lambda: self._open_unit(opened=True))
        self._slots.clicked.connect(self._starting.slot_edited)
        self._slots.clicked.connect(header.focus_scan)
        self._starting.slots.changed.connect(self._refresh)
        app.engine_link.running_changed.connect(self._running_changed)
        app.run.changed.connect(self._refresh)
        app.run.changed.connect(self.closing.refresh)
        app.engine_link.event.connect(self._refresh_closing)
        app.run.stop_pressed.connect(self._stop_pressed)
        app.run.chamber_acknowledged.connect(self._offer_after_fault)
        app.run.stop_incomplete_changed.connect(self._offer_after_fault)
        app.station_changed.connect(self._change_station)
        app.product_changed.connect(self._show_product)
        app.choice_changed.connect(self._plan)
        app.windows.changed.connect(self._plan)
        app.role.changed.connect(self._role_changed)

    # ---- the next run

    def _operator_changed(self) -> None:
        field = self.header.badge_field
        self.app.operator, self.app.badge = field.name, None if field.section is None else field.operator
        self.app.badge_required, self.app.signed_out_idle = field.required, field.signed_out_idle
        self.app.operator_changed.emit()
        self._refresh()

    def _role_changed(self) -> None:
        if self._problem is not None:  # only an engineer sees the file and its entry
            self._plan()

    def _change_station(self) -> None:
        self._clear_verdict()
        self._starting.slots.forget_last()
        request = self.app.engine_link.request
        if request is not None and request.station != self.app.station_path:
            self.app.run.set_unreset(None)
        self._read_products()

    def _clear_verdict(self) -> None:
        """Remove the verdict before a change of the station or product."""
        if not self.app.engine_link.running:
            self._starting.leave_verdict()

    def _show_product(self) -> None:
        """Show the current product, which another page may have selected."""
        self._clear_verdict()
        self.header.show_product(self.app.product_path)
        self._plan()

    def update_files(self) -> None:
        """Read the products again if files have been added or removed, and unusable files if they have been changed."""
        if self.app.engine_link.running:
            return
        before = self.app.product_path
        changed = self._problem is not None and read_next_run(self.app, self._products)[1] != self._problem
        if self._products != offered_products():
            self._read_products()
        if changed or self.app.product_path != before:
            self.app.product_changed.emit()

    def _read_products(self) -> None:
        self._products = offered_products()
        paths = [path for _, path in self._products]
        selected = self.app.product_path
        if self._station != str(self.app.station_path):
            self._station = str(self.app.station_path)
            with suppress(CalstationError):  # `_plan` shows the error
                name = load_station(self.app.station_path)[1].product
                selected = next((path for path in paths if path.stem == name), selected)
        if selected not in paths:
            last = str(self.app.settings.value("product", DEFAULT_PRODUCT)) if selected is None else selected.stem
            selected = next((path for path in paths if path.stem == last), paths[0] if paths else None)
        self.header.set_products(self._products, selected)
        self.app.product_path = self.header.product
        self._plan()

    def _show_names(self) -> None:
        """Show the names of the products in the current language."""
        self._products = offered_products()
        self.header.set_products(self._products, self.app.product_path)
        if self._problem is not None:
            self._plan()  # its notice contains product names

    def _plan(self) -> None:
        """Read the station and the product again; if they are unusable, show the reason and disable START."""
        app = self.app
        self._starting.dialog.drop()  # the notice refers to the previous station and product
        if app.product_path is not None:
            app.settings.setValue("product", app.product_path.stem)
        summary, self._problem, choices = read_next_run(app, self._products)
        self._watch.setVisible(has_pair(self.app.station_path))
        app.run.set_problem(self._problem)
        self._starting.set_next_run(summary)
        self._stages.set_next_run(summary)
        self._loading.set_next_run(summary)
        own = {} if summary is None else summary.slot_products
        self._slots.set_next_run(virtual=summary is not None and summary.virtual, products=own)
        self._shift.set_next_run(summary)
        if summary is not None:
            self.header.badge_field.set_section(summary.sign_in)
        if self._problem is not None:
            ask(self.notice, "caution", self._problem, {}, others=choices, engineer=app.role.engineer)
        else:
            self.notice.dismiss()
            if app.stages is not None and summary is not None:
                question = selection_question(app, summary)
                ask(self.notice, "caution", question, {"whole": lambda: app.choose(None, None)})
        self._refresh()

    def _mark_products(self) -> None:
        """Grey out the products that the station cannot calibrate."""
        self.header.mark_products(unsuitable_products(self.app, [path for _, path in self._products]))

    # ---- during the run

    def _acknowledge(self) -> None:
        self.notice.dismiss()
        unreset = self._verdict.unreset
        self.app.run.acknowledge()
        self.app.run.set_unreset(unreset)
        self._starting.await_unit()
        self._offer_due = True
        self._offer_after_fault()

    def _port_freed(self) -> None:
        """Clear the fault of a port that is no longer in use, and keep what the operator is entering."""
        self._starting.drop_fault() if self._starting.being_used else self._acknowledge()

    def _offer_after_fault(self) -> None:
        """After a fault or stop, offer what remains to be done once the chamber is at ambient or has been checked."""
        run = self.app.run
        if not self._offer_due or self.app.engine_link.running or run.chamber.must_stay_closed or run.stop_incomplete:
            return
        self._offer_due = False
        self._starting.offer_unfinished()

    def _stop_pressed(self) -> None:
        run = self.app.run
        if self.closing.asking:  # the question is about a run that is now stopped
            self.closing.dismiss()
        unsafe = run.fault is not None or run.stop_incomplete or run.chamber.must_stay_closed
        if not (run.in_progress or unsafe or run.occupied) and run.monitoring is None and not self._problem:
            self.notice.dismiss()
            self._message.setText(joined(say("operator.nothing_running"), self._message_text(), language.current()))

    def _running_changed(self, running: bool) -> None:
        run = self.app.run
        if running:
            self.notice.dismiss()
            if not run.register_operation:
                self._starting.slots.forget_unloaded()
            self._documents.dismiss()
            self._show_serial()
            self._next_awaited = self._unit_opened = self._offer_due = False
            self.setFocus()
            self._refresh()
            return
        self.closing.dismiss()
        self._refresh()
        self._shift.count()
        if not self._next_awaited:
            self._await_next()
        elif run.state == "idle":
            self._starting.check()  # the next unit may have been scanned before the engine ended
        if run.state in (Verdict.STOPPED, Verdict.INCOMPLETE):
            self._offer_due = True
        self._ask_transfer()
        self._offer_after_fault()

    def _show_serial(self) -> None:
        """Show the serial number of the unit, or the number of units, of the run in progress."""
        run, request = self.app.run, self.app.engine_link.request
        if run.in_progress and request is not None and not run.register_operation:
            count = say("operator.unit_count", count=len(run.units))
            self.header.set_serial(count if request.serials else request.serial)

    def _await_next(self) -> None:
        """Clear the serial number of the calibrated unit, so that the next unit can be scanned."""
        run = self.app.run
        self._next_awaited = True
        if not run.register_operation:
            self._starting.clear_units()
        if run.fault is not None:
            self._verdict.focus_action()
            return
        self.header.focus_scan()

    def ask_close(self, stop_and_close: Callable[[], None], close_now: Callable[[], None]) -> None:
        """Ask whether to stop the run and close the window; after a stop request, offer to close it immediately."""

        def stop() -> None:
            stop_and_close()
            if self.app.engine_link.running:
                ask(self.closing, "stopped", lambda: closing_notice(self.app.run), {"close_now": close_now})

        answers = {"close": stop, "keep_open": self.setFocus}
        ask(self.closing, "caution", lambda: close_question(self.app.run), answers, primary="keep_open")

    def _refresh_closing(self, event: Event) -> None:
        """Show the current temperature of the chamber in an open question."""
        if isinstance(event, ChamberChanged) and self.closing.asking:
            self.closing.refresh()

    # ---- status of the run

    def _refresh(self) -> None:
        run, header = self.app.run, self.header
        busy = self.app.engine_link.running
        why_busy = say(run.why_busy) if busy else ""
        if run.ended and run.finalized and busy and not self._next_awaited:
            self._await_next()
        header.set_running("" if busy and self._next_awaited else why_busy)
        summary = self._starting.run_summary
        header.show_partial(partial=summary is not None and bool(summary.omitted))
        self._progress.setValue(round(STEPS * run.fraction) if run.state != "idle" else 0)
        if run.in_progress and self.notice.asking:
            self.notice.dismiss()
        self._choose_view()
        self._show_readiness()

    def _show_readiness(self) -> None:
        """Show the message and the state of the run, and why it cannot start."""
        run = self.app.run
        self.header.set_start(self._why_not_start())
        self._verdicts.refuse_again(say("operator.answer_first") if self._starting.asking_about_units else "")
        waits = run.display_state == "idle" and run.occupied is None and not run.stop_incomplete
        waits = waits and self._starting.incomplete
        self._badge.show_state(*(("none", term("badge", "not_ready")) if waits else run_badge(run)))
        self._message.setText(self._message_text())
        self.app.overdue = waits and bool(self._starting.overdue)
        asking = run.display_state == "idle" and self._starting.asking
        run.set_missing(self._message_text("operator.answer_there") if waits else "", asking=asking)

    def _why_not_start(self) -> str:
        starting, header = self._starting, self.header
        run = self.app.run
        if run.problem is None and run.why_not_start == "operator.fault_open":
            return say("operator.fault_below")
        if why_not := run.why_no_run(engineer=self.app.role.engineer):
            return why_not
        if header.badge_field.required:
            return sign_in_text(self.app)
        if starting.asking or self.app.engineer_asks:
            return say("operator.answer_first" if starting.asking else "operator.answer_engineer")
        if starting.slots and not starting.slots.units and not header.serial:
            return say("operator.no_unit")
        if not (starting.slots or header.serial):
            return say("operator.no_serial")
        return "" if starting.refused is None else say(starting.refused)

    def _choose_view(self) -> None:
        """Show the view for the state of the run, and hide the list of stages next to the verdicts on several units."""
        run = self.app.run
        returning = run.chamber.access == "closed" and self.app.engine_link.running
        if run.state == "idle" and not returning:
            why = why_not_load(run, self._problem)
            self._hindrance.say(*why)
            loading: QWidget = self._slots if self._starting.slots else self._loading
            self._views.setCurrentWidget(self._hindrance if any(why) else loading)
        elif run.fault is None and (returning or not run.finalized) and self.app.engine_link.running:
            self._views.setCurrentWidget(self._live)
            self._verdicts.prepare()
        elif run.in_slots and run.fault is None and not self._unit_opened:
            self._verdicts.show_end()
            self._views.setCurrentWidget(self._verdicts)
        else:
            self._verdict.show_end()
            self._views.setCurrentWidget(self._verdict)
        view, size = self._views.currentWidget(), QSizePolicy.Policy
        self._stages.setVisible(view is not self._verdicts)
        # a notice needs space above the view, so that hidden views must not determine the height
        for each in (self._slots, self._live, self._verdicts, self._verdict):
            each.setSizePolicy(size.Preferred, size.Preferred if view is each else size.Ignored)

    def _open_unit(self, *, opened: bool) -> None:
        """Show the verdict on the selected unit, or the verdicts on all units."""
        self._unit_opened = opened
        self._choose_view()
        if opened:
            self._verdict.close_button.setFocus()
            self._ask_transfer()
        else:
            if self.notice.offers("restore_choice"):
                self.notice.dismiss()
                if self.app.run.state in (Verdict.STOPPED, Verdict.INCOMPLETE):
                    self._starting.offer_unfinished()  # the question may have been about all units
            self._verdicts.focus_unit()

    def _ask_transfer(self) -> None:
        """Ask about the open transfer of the displayed unit after the engine has ended."""
        run, request = self.app.run, self.app.engine_link.request
        may_ask = self._unit_opened and run.ended and not (run.why_not_start or self.notice.asking)
        if may_ask and request is not None and self._starting.interrupted.has_open_transfer(run.unit.serial):
            self._starting.ask_transfer(request, run.unit.serial)

    def _message_text(self, answer: str = "operator.answer_first") -> str:
        run = self.app.run
        if urgent := urgent_message(run, engineer=self.app.role.engineer):
            return urgent
        if run.display_state == "idle" and (missing := self._starting.missing_text(answer)):
            return missing
        if self.app.badge_required and run.ended and not run.fault:
            return sign_in_text(self.app)
        if run.display_state == "monitoring" and run.monitoring is not None:
            return say("operator.message_monitoring", state=say(run.monitoring[1]))
        if run.display_state == "not_ready" and has_pair(self.app.station_path):
            return say("operator.message_pair")
        if run.display_state == "not_ready" and run.problem is not None:
            return rendered(run.problem).text
        if run.state == "idle" and self._starting.slots:
            return say("operator.message_idle_slots")
        if run.state in ("idle", "starting"):
            return say(f"operator.message_{run.display_state}")
        if run.state == Verdict.STOPPED and not run.finalized and self.app.engine_link.running:
            return say("operator.message_stopped")
        if run.in_progress or run.state in ("stopping", "paused"):
            return progress_message(run)
        return self._verdicts.next_action() if run.in_slots else self._verdict.next_action()
