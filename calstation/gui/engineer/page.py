"""The engineer page: choose and preview on the left and first view, look closely at a result on the others."""

import re
from pathlib import Path
from typing import Any

from PySide6.QtCore import Qt
from PySide6.QtWidgets import (
    QFileDialog,
    QHBoxLayout,
    QPushButton,
    QStackedWidget,
    QTabBar,
    QVBoxLayout,
)

from calstation.config.request import RunRequest
from calstation.config.schedules import ScheduleOptions, save_schedule, schedule_options
from calstation.errors import CalstationError
from calstation.gui.engineer.choice_panel import ChoicePanel
from calstation.gui.engineer.error_wording import one_line
from calstation.gui.engineer.header import EngineerHeader
from calstation.gui.engineer.preview import PreviewView
from calstation.gui.engineer.register_controller import UNNAMED, RegisterController
from calstation.gui.engineer.result_analysis import ResultAnalysis
from calstation.gui.shell.context import AppContext
from calstation.gui.shell.page import Page
from calstation.gui.text.messages import error_text, say, term
from calstation.gui.widgets import theme
from calstation.gui.widgets.jobs import JobWatch
from calstation.gui.widgets.labels import ElidedLabel
from calstation.gui.widgets.notice import Choice, NoticeBar
from calstation.results.finished_run import FinishedRun
from calstation.results.preview import compute_preview
from calstation.sequencer.events import Event, Verdict

_LEFT = 46 * theme.GRID


class EngineerPage(Page):
    """Parts, schedules, preview and START; parameters, innovations, residuals, observability, registers."""

    def __init__(self, app: AppContext) -> None:
        super().__init__(app)
        self.setObjectName("engineer_page")
        self._offer: ScheduleOptions | None = None
        self._problem = ""
        self._faulty = False
        self.header = self._fields = EngineerHeader(app.run)
        self._fields.engineer_edit.setText(str(app.settings.value("engineer_name", "")))
        self.choice = ChoicePanel()
        self.notice = NoticeBar()
        self._source, self.open_button = ElidedLabel(), QPushButton()
        self.open_button.setObjectName("open_result_button")
        self.preview = PreviewView()
        self._desk = RegisterController(app, self._request, self)
        self.registers = self._desk.view
        self.look = ResultAnalysis(app, self)
        self._saving = JobWatch(self)
        self.tabs, self.views = QTabBar(), QStackedWidget()
        self.tabs.setObjectName("engineer_views")
        self.tabs.setProperty("kind", "views")
        self.tabs.setDrawBase(False)
        self.tabs.setExpanding(False)
        for view in (self.preview, *self.look.views, self.registers):
            self.tabs.addTab("")
            self.views.addWidget(view)
        self._lay_out()
        self._connect()
        self.retranslate()
        self._read_offer()

    def title(self) -> str:
        """The page's name on its tab."""
        return self.tr("Engineer")

    def _lay_out(self) -> None:
        head = QHBoxLayout()
        head.setSpacing(theme.GRID)
        head.addWidget(self.tabs)
        head.addWidget(self._source, 1)
        head.addWidget(self.open_button)
        self._source.setProperty("kind", "muted")
        self._source.setAlignment(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
        right = QVBoxLayout()
        right.setSpacing(theme.GRID)
        right.addLayout(head)
        right.addWidget(self.notice)
        right.addWidget(self.views, 1)
        self.choice.setFixedWidth(_LEFT)
        body = QHBoxLayout(self)
        body.setContentsMargins(2 * theme.GRID, 0, 2 * theme.GRID, theme.GRID)
        body.setSpacing(2 * theme.GRID)
        body.addWidget(self.choice)
        body.addLayout(right, 1)

    def _connect(self) -> None:
        app = self.app
        self.choice.changed.connect(self._choice_changed)
        self.choice.unlock_wanted.connect(app.role.ask)
        self.choice.save_wanted.connect(self._save)
        self._fields.start_pressed.connect(self._start)
        self._fields.edited.connect(self._allow)
        self.preview.wanted.connect(self._preview)
        self.preview.watch.done.connect(self.look.foresee)
        self.open_button.clicked.connect(self._ask_file)
        self.look.changed.connect(lambda: self._source.setText(self.look.source()))
        self.look.loaded.connect(self._loaded)
        self.look.failed.connect(self._not_loaded)
        self._desk.changed.connect(self._allow)
        self._saving.done.connect(self._saved)
        self._saving.failed.connect(self._not_saved)
        self.tabs.currentChanged.connect(self._turn)
        app.engine_link.event.connect(self._take)
        app.engine_link.running_changed.connect(lambda _: self._allow())
        app.run.changed.connect(self._run_changed)
        app.role.changed.connect(self._role_changed)
        app.choice_changed.connect(self._choice_undone)
        app.station_changed.connect(self._read_offer)
        app.product_changed.connect(self._read_offer)
        app.open_run.connect(self.look.open)

    # ---- what is chosen

    def _read_offer(self) -> None:
        """Read station and product again; what is wrong with them keeps everything from working, and says so."""
        app = self.app
        try:
            self._offer = schedule_options(app.station_path, app.product_path)
            self._problem = ""
        except CalstationError as error:
            self._offer = None
            self._problem = one_line(str(error))
        if self._offer is not None and not self._offer.offered:
            self._offer = None
            self._problem = self.tr("None of this product's stages can run on this station's rig.")
        self.choice.setEnabled(self._offer is not None)
        if self._offer is not None:
            self.choice.show_offer(self._offer)
            if not self._fields.serial:
                self._fields.serial_edit.setText(self._offer.serial)
        self._allow()

    def _choice_changed(self) -> None:
        self.preview.outdate()
        found = self._offer
        if found is not None:
            stages, schedule = self.choice.parts.stages, self.choice.schedule
            whole = not stages or (stages == found.stages and not schedule)
            self.app.choose(None, None) if whole else self.app.choose(stages, schedule)
        self._allow()

    def _choice_undone(self) -> None:
        """Another page went back to the product's whole calibration."""
        found = self._offer
        if found is None or self.app.stages is not None:
            return
        if self.choice.parts.stages not in ((), found.stages) or self.choice.schedule:
            self.choice.show_offer(found)
            self._allow()

    def _role_changed(self, role: str) -> None:
        """An operator goes on with the product as it is."""
        if role == "operator":
            self.app.choose(None, None)
        self._allow()

    def _request(self) -> RunRequest:
        app, fields = self.app, self._fields
        return RunRequest(
            fields.serial or UNNAMED,
            app.station_path,
            app.product_path,
            self.choice.parts.stages,
            app.runs_folder,
            fields.engineer or None,
            schedule=self.choice.schedule,
            beyond_attempts=self.app.role.engineer,
        )

    def _preview(self) -> None:
        self.preview.watch.watch(self.app.job_queue.submit(compute_preview, self._request()))
        self.preview.begin()

    def _save(self) -> None:
        assert self._offer is not None
        stage = self.choice.parts.current
        changes = self.choice.form(stage).departures
        product = self._offer.name
        self.notice.ask(
            "caution",
            lambda: self.tr("Save the schedule of {0} to the product {1}?").format(
                term("stage", stage), product
            ),
            lambda: self.tr(
                "Every later run of this product uses it. The present version is kept; this one is saved under the "
                "name {0}."
            ).format(self._fields.engineer),
            (
                Choice("cancel_save_button", lambda: self.tr("Cancel"), lambda: None),
                Choice(
                    "confirm_save_button",
                    lambda: self.tr("Save to product"),
                    lambda: self._save_now({stage: changes}),
                    primary=True,
                ),
            ),
        )

    def _save_now(self, changes: dict[str, Any]) -> None:
        assert self._offer is not None
        job = self.app.job_queue.submit(
            save_schedule, self._offer.product, changes, self._fields.engineer, cancellable=False
        )
        self._saving.watch(job)
        self._allow()

    def _saved(self, saved: Any) -> None:
        path, version = saved
        name = self._offer.name if self._offer is not None else path.stem
        self.notice.ask(
            "good", lambda: self.tr("{0}: version {1} saved").format(name, version.number), lambda: str(path)
        )
        if path == self.app.product_path:
            self.app.product_changed.emit()
        else:
            self.app.set_product(path)

    def _not_saved(self, error: CalstationError) -> None:
        self.notice.ask("bad", lambda: self.tr("The product was not saved"), lambda: one_line(error))
        self._allow()

    # ---- START

    def _start(self) -> None:
        assert self._offer is not None
        self.notice.dismiss()
        if self.app.job_queue.at_device:
            self.notice.ask(
                "caution",
                lambda: self.tr("The unit is being asked."),
                lambda: self.tr("It takes some seconds; press START again then."),
            )
            return
        self.app.settings.setValue("engineer_name", self._fields.engineer)
        if self._offer.virtual:
            self._run()
            return
        station = self._offer.station
        self.notice.ask(
            "caution",
            lambda: self.tr("The table of '{0}' is going to move").format(station),
            lambda: self.tr("Is everybody clear of it, and the unit tight?"),
            (
                Choice("clear_choice", lambda: self.tr("All clear, start"), self._run),
                Choice("cancel_choice", lambda: self.tr("Cancel"), lambda: None, primary=True),
            ),
        )

    def _run(self) -> None:
        self.app.engine_link.start(self._request())

    def _run_changed(self) -> None:
        """Many times a second; only a fault changes what may be done here."""
        faulty = self.app.run.fault is not None
        if faulty != self._faulty:
            self._faulty = faulty
            self._allow()

    def _take(self, event: Event) -> None:
        if isinstance(event, Verdict):
            self.look.open(Path(event.result_file))

    # ---- a finished run

    def _ask_file(self) -> None:
        dialog = QFileDialog(self, self.tr("Open a result or a log"), str(self.app.runs_folder))
        dialog.setNameFilters(
            [self.tr("Results and logs (*.json *.h5 *.csv *.csv.gz)"), self.tr("All files (*)")]
        )
        dialog.fileSelected.connect(lambda name: self.look.open(Path(name)))
        dialog.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        dialog.open()

    def _loaded(self, run: FinishedRun) -> None:
        self._desk.take(run)
        if self.views.currentIndex() == 0 and not self.app.engine_link.running:
            self.tabs.setCurrentIndex(1)
        self.look.look(self.views.currentWidget())
        self._allow()

    def _not_loaded(self, path: Path | None, error: CalstationError) -> None:
        self.notice.ask(
            "bad", lambda: self.tr("This file cannot be opened"), lambda: error_text(error).sentences
        )

    def _turn(self, index: int) -> None:
        self.views.setCurrentIndex(index)
        self.look.look(self.views.currentWidget())

    # ---- what may be done now, and why not

    def _allow(self) -> None:
        running = self.app.engine_link.running
        busy = (
            say("window.busy_registers" if self.app.run.register_operation else "window.busy_run")
            if running
            else ""
        )
        role = (
            ""
            if self.app.role.engineer
            else self.tr("Only an engineer may change this; set the PIN first.")
            if self.app.role.new
            else self.tr("Only an engineer may change this; enter the PIN first.")
        )
        name = "" if self._fields.engineer else self.tr("Enter your name first; it stands in the record.")
        device = self.tr("The unit is being asked.") if self.registers.watch.busy else ""
        self._fields.set_running(busy)
        self._fields.set_start(
            self._problem or busy or device or self._why_no_choice() or self._why_no_unit()
        )
        self.choice.ask_for_pin(self.app.role.new)
        self.choice.lock(busy, role, name or self._why_not_save())
        self.preview.set_why_not(self._problem or self._why_no_choice())
        self.registers.engineer = self._fields.engineer
        found = self._offer
        self.registers.table_of = "" if found is None or found.by_hand else found.station
        self.registers.set_why_not(
            self._problem or busy or device,
            role or self._problem or busy or device or name or self._desk.why_not(),
        )

    def _why_no_choice(self) -> str:
        if not self.choice.parts.stages:
            return self.tr("Choose at least one stage.")
        if self.choice.unsound:
            return self.tr("Mend the schedule of {0} first.").format(
                ", ".join(term("stage", stage) for stage in self.choice.unsound)
            )
        return ""

    def _why_no_unit(self) -> str:
        if not self._fields.serial:
            return self.tr("Enter the unit's serial number.")
        if self._offer is not None and not re.fullmatch(self._offer.serial_pattern, self._fields.serial):
            return self.tr("The serial number does not fit this product ({0}).").format(
                self._offer.serial_pattern
            )
        if self.app.run.fault is not None:
            return self.tr("Read the fault on the Operator page and press Understood first.")
        return ""

    def _why_not_save(self) -> str:
        form = self.choice.form(self.choice.parts.current) if self._offer is not None else None
        if form is None or self._saving.busy:
            return self.tr("Being saved.")
        if not form.sound:
            return self.tr("Mend the values marked first.")
        return "" if form.departures else self.tr("This stage's values are the product's.")

    def retranslate(self) -> None:
        """Say everything again in the language in force."""
        for index, text in enumerate(
            (
                self.tr("Preview"),
                self.tr("Parameters"),
                self.tr("Innovations"),
                self.tr("Residuals"),
                self.tr("Observability"),
                self.tr("Registers"),
            )
        ):
            self.tabs.setTabText(index, text)
        self.open_button.setText(self.tr("Open"))
        self.open_button.setToolTip(self.tr("Look at an earlier result or log"))
        self._source.setText(self.look.source())
        self._allow()
