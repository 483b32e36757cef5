"""The engineer page, with stages and schedules on the left, and preview, results, registers and design on the right."""

import re
from dataclasses import replace
from functools import partial
from pathlib import Path

from PySide6.QtCore import QSignalBlocker
from PySide6.QtWidgets import QWidget

from calstation.config import RunRequest, ScheduleOptions, Version, save_schedule, schedule_options
from calstation.errors import CalstationError
from calstation.gui.engineer.choice_panel import ChoicePanel
from calstation.gui.engineer.designer import DesignView
from calstation.gui.engineer.header import EngineerHeader
from calstation.gui.engineer.preview import PreviewView
from calstation.gui.engineer.registers_view import UNNAMED, RegistersView
from calstation.gui.engineer.result_analysis import ResultAnalysis
from calstation.gui.operator import LiveView, SlotsPanel, StartDialog, advice, ask
from calstation.gui.state import AppContext, Page
from calstation.gui.text import on_language_change, product_text, say
from calstation.gui.widgets import (
    Choice,
    ElidedLabel,
    StateBadge,
    ViewTabs,
    ask_open,
    button,
    column,
    enable,
    row,
    show_text,
    stack,
    theme,
)
from calstation.messages import Text, event_text
from calstation.results import FinishedRun
from calstation.sequencer import Event, Finalized

#: Width of the panel on the left, px.
_PANEL_WIDTH = 46 * theme.GRID

#: Object name of the button that resumes a stopped run.
_RESUME = "engineer_resume_button"


class EngineerPage(Page):
    """The page on which engineers select stages, preview and start runs, and inspect results and registers."""

    def __init__(self, app: AppContext) -> None:
        super().__init__(app, "engineer")
        self._options: ScheduleOptions | None = None
        #: Serial number that the virtual bench suggested last; "" after the user has entered one.
        self._suggested = ""
        #: Error in the station or product files that prevents a run.
        self._problem: CalstationError | None = None
        #: Name of the log of the last run, or of its first unit; "" until the run ends, None before the first run.
        self._last_log: str | None = None
        #: Reason why nothing may start, problem of the station or the product, what is missing before a run, and
        #: whether the Operator page asks a question.
        self._obstacles: tuple[str | Text, Text | None, str, bool] | None = None
        self.header = self._header = EngineerHeader(app.run)
        self.choice = ChoicePanel()
        self._start_dialog = StartDialog(app, self.notice, "engineer_override", self._header.serial_edit.setFocus)
        self._slots = SlotsPanel(app.slots, "engineer_")
        self._live = LiveView(app, "engineer_")
        self.preview = PreviewView(app, self._request)
        self.registers = RegistersView(app, self._register_request)
        self.analysis = ResultAnalysis(app, self)
        self.design = DesignView(app, self.notice, lambda: self.app.author)
        self._saving = app.job(self, save_schedule, self._saved, failed=self._save_failed, cancellable=False)
        self._lay_out()
        self._connect()
        on_language_change(self, self._update)
        self._read_options()

    @property
    def manual(self) -> str:
        """The section of the manual about the current view."""
        analysis, view = self.analysis, self._views.currentWidget()
        sections: dict[QWidget | None, str] = {
            self.preview: "explanation/estimation.md#partial-runs",
            analysis.observability: "explanation/estimation.md#observability",
            self.registers: "how-to/connect.md#what-a-transfer-verifies",
            analysis.cycle: "how-to/production-line.md#cycle-time",
            analysis.over_temperature: "how-to/temperature.md",
            self.design: "how-to/design-a-schedule.md",
            self._slots: "how-to/several-units.md#run-a-batch",
        }
        return sections.get(view, "explanation/verdict.md#the-chain")

    def prepare(self) -> None:
        """Create the views that a run fills."""
        self.analysis.create_views()

    def _lay_out(self) -> None:
        self._tabs = ViewTabs(
            "engineer_views",
            *("engineer.preview", "common.parameters", "engineer.innovations", "common.residuals"),
            *("engineer.observability", "engineer.register_view", "common.cycle", "engineer.design", "engineer.units"),
            *("common.live", "common.over_temperature"),
        )
        analysis = self.analysis
        views = (self.registers, analysis.cycle, self.design, self._slots, self._live, analysis.over_temperature)
        self._views = stack(self.preview, *analysis.views, *views)
        self._tabs.setTabVisible(self._views.indexOf(analysis.over_temperature), False)
        self._tabs.setTabVisible(self._views.indexOf(self._live), False)
        self._source = ElidedLabel("muted")
        self._other_unit = StateBadge(name="other_unit_badge", wrap=True)
        open_button = button("open_result_button", "common.open", self._ask_file, tip="engineer.open_tip")
        self.choice.setFixedWidth(_PANEL_WIDTH)
        tabs = row((self._tabs, 1), open_button)
        right = column(tabs, self._source, self._other_unit, self.notice, self._start_dialog.people, (self._views, 1))
        wide = 2 * theme.GRID
        row(self.choice, (right, 1), on=self, spacing=wide, margins=(wide, 0, wide, theme.GRID))

    def _connect(self) -> None:
        app = self.app
        self.choice.changed.connect(self._choice_changed)
        self.choice.unlock_requested.connect(app.role.ask)
        self.choice.save_requested.connect(self._ask_to_save)
        self._header.start_pressed.connect(self._start)
        self._header.serial_entered.connect(self._scan)
        app.slots.changed.connect(self._update)
        self._header.edited.connect(self._update)
        self._header.serial_edit.textEdited.connect(self._forget_suggestion)
        self.preview.watch.done.connect(self.analysis.show_preview)
        self.analysis.changed.connect(self._update)
        self.analysis.loaded.connect(self._loaded)
        self.analysis.failed.connect(lambda error: self.notice.ask("bad", "engineer.file_not_opened", error.as_text))
        self._saving.busy_changed.connect(self._update)
        self.registers.watch.busy_changed.connect(self._start_dialog.drop)
        self.notice.report_failures(self.analysis.adding, "engineer.log_not_solved", self.analysis.result.setFocus)
        self.registers.changed.connect(self._update)
        self.notice.changed.connect(self._update)
        self._tabs.currentChanged.connect(self._views.setCurrentIndex)
        self._views.currentChanged.connect(lambda _: self.analysis.prepare(self._views.currentWidget()))
        self._views.currentChanged.connect(lambda _: self._show_other_unit())
        app.engine_link.event.connect(self._follow)
        app.engine_link.running_changed.connect(self._running_changed)
        app.windows.changed.connect(self._update)
        app.run.changed.connect(self._run_changed)
        app.run.chamber_acknowledged.connect(self._update)
        app.role.changed.connect(self._role_changed)
        self.app.operator_changed.connect(self._update)
        self._header.engineer_edit.textEdited.connect(lambda text: self.app.identified.emit(text.strip()))
        app.station_changed.connect(self._read_options)
        app.product_changed.connect(self._read_options)
        app.open_run.connect(self.analysis.open)

    # ---- selection of stages and schedule

    def _read_options(self) -> None:
        """Read the station and the product again; an error disables the controls and is shown in their tooltips."""
        app = self.app
        self._start_dialog.drop()  # the notice refers to the previous station and product
        self._options = self._problem = None
        try:
            self._options = schedule_options(app.station_path, app.product_path)
        except CalstationError as error:
            self._problem = error
        options = self._options
        own = {} if options is None else options.slot_products
        self._slots.set_next_run(virtual=options is not None and options.virtual, products=own)
        self._tabs.setTabVisible(self._views.indexOf(self._slots), options is not None and bool(options.slots))
        self.design.offer(options)
        if options is not None and options.offered:
            self._show_options(options)  # before a new serial number updates the page
        if self._header.serial in ("", self._suggested):
            self._suggest()
        self._update()

    def _show_options(self, options: ScheduleOptions) -> None:
        """List the stages of the product; keep the selection if the product still offers all selected stages."""
        if not self.choice.keeps(options):
            self.choice.show_options(options)
            return
        with QSignalBlocker(self.choice):  # the Operator page must not get a selection kept after a run
            self.choice.show_options(options, keep=True)
        self.preview.mark_outdated()
        if self.app.stages is not None:
            self._choice_changed()

    def _suggest(self) -> None:
        """Suggest the unit of the virtual bench unless its verdict is displayed; with hardware, clear the field."""
        run = self.app.run
        displayed = run.unit.serial if run.ended or run.fault is not None else ""
        serial = "" if self._options is None else self._options.serial
        self._suggested = "" if serial == displayed else serial
        self._header.serial_edit.setText(self._suggested)

    def _forget_suggestion(self, _: str) -> None:
        self._suggested = ""

    def _choice_changed(self) -> None:
        self.preview.mark_outdated()
        if self._options is not None:
            stages, schedule = self.choice.selector.stages, self.choice.schedule
            whole = not stages or (stages == self._options.stages and not schedule)
            self.app.choose(None, None) if whole else self.app.choose(stages, schedule)
        self._update()

    def _restore_product(self) -> None:
        """Restore the product's stages and schedule."""
        options, choice = self._options, self.choice
        if options is not None and options.offered and (choice.selector.stages != options.stages or choice.schedule):
            choice.show_options(options)
            self._update()

    def _role_changed(self, role: str) -> None:
        """Restore the product's stages and schedule when the role changes to operator."""
        self._start_dialog.drop()
        if role == "operator":
            self.app.choose(None, None)
            self._restore_product()
        self._update()

    def _running_changed(self, running: bool) -> None:
        """Show the progress of a run; after the run, clear the serial number and show the remarks.

        The selection of stages and the changes to their schedules stay. The serial number does not: the unit on the
        table must be identified before every run.
        """
        self._start_dialog.drop()
        if running and self.notice.offers(_RESUME):
            self.notice.dismiss()
        live = self._views.indexOf(self._live)
        if running and not self.app.run.register_operation:
            self._last_log = ""
            self._close_result()
            self._tabs.setTabVisible(live, True)
            self._tabs.setCurrentIndex(live)
        if not running:
            if not self._live.started:  # it would show a preparation that has ended
                if self._tabs.currentIndex() == live:
                    self._tabs.setCurrentIndex(0)
                self._tabs.setTabVisible(live, False)
            self.analysis.refresh()
        if not running and self.app.engine_link.operation is None:
            self._header.serial_edit.clear()
            for name, values in self.app.run.unit.remarks:
                if name in ("certificate_waits", "certificate_not_made", "table_moved"):
                    self.notice.ask("caution", event_text(name, values), "")
            self._offer_resume()
        self._update()

    def _offer_resume(self) -> None:
        """Offer to resume the stopped run, in the same words as on the Operator page."""
        for unit in self.app.run.units:
            ended, result = unit.finalized, unit.result
            if ended is not None and result is not None and result.advice == "resume":
                resume = Choice(_RESUME, "history.resume", partial(self.app.resume_run.emit, Path(ended.log)))
                title = partial(advice.next_action, ended.verdict, result)
                self.notice.ask("paused", title, "", (resume,))
                return

    def _request(self) -> RunRequest:
        app, header = self.app, self._header
        return RunRequest(
            header.serial or UNNAMED,
            app.station_path,
            app.product_path,
            self.choice.selector.stages,
            app.runs_folder,
            app.person,
            schedule=self.choice.schedule,
        )

    def _register_request(self) -> RunRequest:
        """Return the request for a register operation; on a virtual bench, an empty field means the last run's unit."""
        request, serial = self._request(), self.app.run.unit.serial
        if not self._header.serial and serial and self._options is not None and self._options.virtual:
            request = replace(request, serial=serial)
        slots = {unit.serial: unit.slot for unit in self.app.run.units}
        return replace(request, slot=slots.get(request.serial) or None)

    def _ask_to_save(self) -> None:
        if self._options is None:
            return
        product, stage = self._options.name, self.choice.form.stage
        file, changes = self._options.product, {stage: self.choice.form.deviations}

        def save() -> None:
            self._saving.start(file, changes, self.app.author)

        confirm = Choice("confirm_save_button", "engineer.save_to_product", save, primary=True)
        choices = Choice("cancel_save_button", "common.cancel", lambda: None), confirm
        self.notice.ask(
            "caution",
            lambda: say("engineer.ask_save", stage=stage, product=product_text(product)),
            Text.of("engineer.about_save", engineer=self.app.person),
            choices,
        )

    def _saved(self, saved: tuple[Path, Version]) -> None:
        path, version = saved
        name = self._options.name if self._options is not None else path.stem
        title = partial(say, "engineer.saved", number=version.number)
        if path == self.app.product_path:
            self.app.product_changed.emit()
        else:
            self.app.set_product(path)
        self.notice.ask("good", lambda: title(product=product_text(name)), lambda: str(path))

    def _save_failed(self, error: CalstationError) -> None:
        self.notice.ask("bad", "engineer.product_not_saved", error.as_text)

    # ---- START

    def _scan(self) -> None:
        """At a station with several slots, assign the entered serial number to the next slot."""
        slots, serial = self.app.slots, self._header.serial
        if self.app.engine_link.running:
            return
        if not slots:
            if serial != self.analysis.serial and self._why_no_serial() is None:
                self._close_result()
            return
        if slots.units and not serial:
            self._header.start_button.setFocus()
            return
        refusal = self._why_no_serial() or slots.refusal(serial)
        if refusal is None and slots.next is not None:
            self.notice.dismiss()
            self._header.serial_edit.clear()
            slots.fill(slots.next, serial, self.app.history())
        else:
            self.notice.ask("caution", refusal or "", "")

    def _close_result(self) -> None:
        """Close the result of an earlier run."""
        self.analysis.close()
        self._tabs.setTabVisible(self._views.indexOf(self.analysis.over_temperature), False)

    def _start(self) -> None:
        """Ask the questions before a start; if units are in slots, show the slots first."""
        self.notice.dismiss()
        request, serials = self._request(), self.app.slots.serials
        if serials and self._views.currentWidget() is not self._slots:
            self._tabs.setCurrentIndex(self._views.indexOf(self._slots))
            ask(self.notice, "none", Text("question.units_in_slots"), {})
            return
        first = self.app.slots.units[:1] or (request.serial,)
        self._start_dialog.begin(replace(request, serial=first[0], serials=serials))

    def _run_changed(self) -> None:
        """Update the actions only if the obstacles to a run have changed; this is called many times per second."""
        self._show_next()
        run = self.app.run
        obstacles = run.why_not_start, run.problem, run.missing, run.asking
        if obstacles != self._obstacles:
            self._obstacles = obstacles
            self._update()

    def _follow(self, event: Event) -> None:
        """Show the observability and the result of a run; with several units, those of the first one."""
        if event.slot not in ("", self.app.run.units[0].slot):
            return
        self.analysis.follow(event)
        if isinstance(event, Finalized):
            self._last_log = Path(event.log).name
            self.analysis.open(Path(event.result_file))

    # ---- finished run

    def _ask_file(self) -> None:
        kinds = [say("engineer.results_and_logs"), say("common.all_files")]
        ask_open(self, say("engineer.open_result_or_log"), self.app.runs_folder, kinds, self.analysis.open)

    def _loaded(self, run: FinishedRun) -> None:
        self.registers.show_run(run)
        curves = self._views.indexOf(self.analysis.over_temperature)
        if run.result.temperature is None and self._tabs.currentIndex() == curves:
            self._tabs.setCurrentIndex(1)
        self._tabs.setTabVisible(curves, run.result.temperature is not None)
        if self._views.currentWidget() in (self.preview, self._live):
            self._tabs.setCurrentIndex(1)
        self.analysis.prepare(self._views.currentWidget())
        self._update()

    # ---- available actions

    def _update(self) -> None:
        """Enable the possible actions, and explain in the tooltips why the others are not possible."""
        show_text(self._source, self.analysis.source())
        self._show_next()
        self._show_other_unit()
        options, role = self._options, ""
        if not self.app.role.engineer:
            role = say("engineer.new_pin_needed" if self.app.role.new else "engineer.pin_needed")
        run = self.app.run
        if self.app.engineer_asks != self._start_dialog.asking:
            self.app.engineer_asks = self._start_dialog.asking
            run.changed.emit()
        waits = say(run.why_not_start)
        busy = waits if self.app.engine_link.running or run.occupied is not None else ""
        badges = self.app.badge is not None or self.app.badge_required
        self._header.show_person(self.app.person, signed_in=badges)
        name = "" if self.app.person else say("engineer.no_name")
        device = say("engineer.communicating") if self.registers.watch.busy else ""
        problem, choice = self._why_no_options(), self._why_no_choice()
        if problem:
            file = self.app.product_path
            self.choice.show_problem(options.name if options is not None else file.stem if file else "", problem)
        stages = self.choice.selector.stages
        self._header.show_partial(partial=options is not None and bool(stages) and not {*options.stages} <= {*stages})
        writes = options is not None and options.writes and not problem and not busy
        for edit in (self._header.serial_edit, self._header.engineer_edit):
            enable(edit, busy)
        badge = say("operator.sign_in") if self.app.badge_required else ""
        unusable = run.why_no_run(engineer=self.app.role.engineer)
        there = say("operator.answer_there") if run.asking else ""
        asking = say("operator.answer_first") if self._start_dialog.asking else there
        why_not = problem or waits or device or choice or unusable or badge or asking or self._why_no_unit()
        overdue = run.missing if self.app.overdue else ""
        self._header.show_next_run(why_not, overdue, say("engineer.pass_writes") if writes else "")
        self.choice.lock(busy, role, name or self._why_not_save(), new_pin=self.app.role.new)
        enable(self.preview.button, problem or choice)
        self.design.lock(problem, role or name)
        self.registers.table = "" if options is None or options.by_hand else options.station
        write = role or problem or waits or device or name or self.registers.why_not_write()
        self.registers.set_why_not(problem or busy or device, write)

    def _why_no_options(self) -> str:
        if self._problem is not None:
            return say(self._problem.as_text)
        if self._options is not None and not self._options.offered:
            return say("engineer.no_stage_offered")
        return ""

    def _why_no_choice(self) -> str:
        if not self.choice.selector.stages:
            return say("engineer.no_stage")
        if invalid := self.choice.invalid:
            return say("engineer.wrong_schedule", stages=invalid)
        return ""

    def _show_next(self) -> None:
        run, slot = self.app.run, self.app.slots.marked
        other = run.in_progress and not slot and self._header.serial not in run.serials
        self._header.show_next(
            run.ended or run.fault is not None or other, "" if slot is None or run.in_progress else slot.name
        )

    def _show_other_unit(self) -> None:
        """Warn if the displayed result is not that of the entered serial number, the chosen product or the last run."""
        shown, entered = self.analysis.serial, self._header.serial
        differs = bool(shown and entered) and shown != entered and self._why_no_serial() is None
        texts = [say("engineer.result_of_other_unit", shown=shown, entered=entered)] if differs else []
        product, chosen = self.analysis.product, "" if self._options is None else self._options.name
        if product and chosen and product != chosen:
            names = {"shown": product_text(product), "chosen": product_text(chosen)}
            texts.append(say("engineer.result_of_other_product", **names))
        run, is_last = self.app.run, self._last_log in (None, self.analysis.log_name)
        if (run.ended or run.fault is not None) and shown == run.units[0].serial and not is_last:
            texts.append(say("engineer.result_of_other_run", shown=shown))
        self._other_unit.setVisible(bool(texts) and self._views.currentWidget() not in (self.preview, self.design))
        self._other_unit.show_state("caution", "  ·  ".join(texts))

    def _why_no_unit(self) -> str:
        slots, serial = self.app.slots, self._header.serial
        if not (slots.units if slots else serial):
            return say("operator.no_unit" if slots else "engineer.no_serial")
        return say((None if slots else self._why_no_serial()) or "")

    def _why_no_serial(self) -> Text | None:
        """Return why the entered serial number is not valid for the product, or None."""
        options, header = self._options, self._header
        if options is None:
            return None
        valid = re.compile(options.serial_pattern).fullmatch
        if header.serial_edit.holds_two(lambda serial: valid(serial) is not None):
            return Text.of("question.two_serials", serial=header.serial)
        return None if valid(header.serial) else Text.of("engineer.wrong_serial", example=options.serial_example)

    def _why_not_save(self) -> str:
        if self._saving.busy:
            return say("engineer.saving")
        if not self.choice.selector.current or self._why_no_options():
            return ""
        if not self.choice.form.valid:
            return say("engineer.wrong_values", names=self.choice.form.wrong)
        return "" if self.choice.form.deviations else say("engineer.values_of_product")
