"""The operator page: load, scan, START, watch, verdict."""

from collections.abc import Callable
from pathlib import Path

from PySide6.QtCore import Signal
from PySide6.QtGui import QShowEvent
from PySide6.QtWidgets import (
    QFrame,
    QLabel,
    QProgressBar,
    QStackedWidget,
    QWidget,
)

from calstation.config import DEFAULT_PRODUCT, ManualRigError, RunRequest, library, run_summary
from calstation.errors import CalstationError
from calstation.gui.operator.header import RunHeader
from calstation.gui.operator.live_view import LiveView
from calstation.gui.operator.loading import Loading
from calstation.gui.operator.resuming import Resuming
from calstation.gui.operator.stage_list import StageList
from calstation.gui.operator.starting import CompatibilityNotice, Starting
from calstation.gui.operator.verdict import VerdictPanel
from calstation.gui.shell import AppContext, Page
from calstation.gui.text import KINDS, error_text, event_sentence, fault_text, say, step_sentence, term
from calstation.gui.widgets import Choice, NoticeBar, StateBadge, Words, column, row, theme
from calstation.sequencer import Command

#: Steps of the progress bar.
_STEPS = 1000


class OperatorPage(Page):
    """All that an operator needs, and nothing that an operator must not change.

    `station_wanted()` : open the station page.
    """

    station_wanted = Signal()

    def __init__(self, app: AppContext) -> None:
        super().__init__(app)
        self.setObjectName("operator_page")
        self._problem: Words | None = None
        self._opened = False
        self._shown: tuple[object, ...] = ()
        self.header: RunHeader = RunHeader()
        self._stages = StageList(app.run)
        self._loading, self._verdict = Loading(), VerdictPanel(app)
        self._live = LiveView(app.run)
        self.closing, self.notice = NoticeBar(), NoticeBar()
        self._starting = Starting(app, self.header, self.notice)
        self._resuming = Resuming(app, self.header, self.notice, self._starting)
        self._views = _stack(self._loading, self._live, self._verdict)
        self._progress = QProgressBar()
        self._progress.setObjectName("run_progress")
        self._progress.setRange(0, _STEPS)
        self._progress.setTextVisible(False)
        self._progress.setFixedHeight(theme.GRID)
        self._message = QLabel()
        self._message.setObjectName("message_label")
        self._message.setFont(theme.font(theme.SECTION))
        self._badge = StateBadge(theme.SECTION)
        self._build()
        self._connect()
        self._read_products()

    def title(self) -> str:
        """The text of the tab."""
        return self.tr("Operator")

    def retranslate(self) -> None:
        """Show all texts in the current language."""
        self._refresh()

    def showEvent(self, event: QShowEvent) -> None:
        """Be ready for a scan; when first shown, offer interrupted runs."""
        super().showEvent(event)
        self._update_products()
        if not self._opened:
            self._opened = True
            self._resuming.start()
        self.await_scan()

    def await_scan(self) -> None:
        """Be ready for a scan, unless a run is in progress or a question is open."""
        run = self.app.run
        if self.isVisible() and not run.going and run.fault is None and not self.notice.asking:
            self.header.focus_serial()

    def _build(self) -> None:
        self._stages.setFixedWidth(38 * theme.GRID)
        right = column(self.closing, self.notice, (self._views, 1))
        foot = QFrame()
        foot.setProperty("kind", "panel")
        foot_margins = (2 * theme.GRID, theme.GRID, 2 * theme.GRID, theme.GRID)
        row((self._message, 1), self._badge, on=foot, margins=foot_margins)
        column(
            (row(self._stages, (right, 1)), 1),
            self._progress,
            foot,
            on=self,
            margins=(2 * theme.GRID, 0, 2 * theme.GRID, theme.GRID),
        )

    def _connect(self) -> None:
        fields, app = self.header, self.app
        fields.pause_pressed.connect(self._pause)
        self._live.finish_wanted.connect(lambda: app.engine_link.send(Command.ENOUGH))
        fields.product_chosen.connect(self._choose_product)
        fields.enter_refused.connect(
            lambda: self._message.setText(self.tr("Enter does not start: press Space or click START."))
        )
        self._verdict.acknowledged.connect(self._acknowledge)
        self._verdict.details_wanted.connect(app.open_run)
        self._verdict.station_wanted.connect(self.station_wanted)
        app.engine_link.event.connect(self._live.take)
        app.engine_link.running_changed.connect(self._running_changed)
        app.run.changed.connect(self._refresh)
        app.run.stop_pressed.connect(self._stop_pressed)
        app.station_changed.connect(self._change_station)
        app.product_changed.connect(self._show_product)
        app.choice_changed.connect(self._plan)

    # ---- the next run

    def _choose_product(self, path: Path) -> None:
        self.app.set_product(path)
        self.header.focus_serial()

    def _change_station(self) -> None:
        self._clear_verdict()
        self._read_products()

    def _clear_verdict(self) -> None:
        """Remove a verdict that does not concern the next unit."""
        if self.app.run.ended and not self.app.engine_link.running:
            self.app.run.acknowledge()

    def _show_product(self) -> None:
        """Show the product that another page may have chosen."""
        self._clear_verdict()
        if self.app.product_path is not None:
            self.header.show_product(self.app.product_path)
        self._plan()

    def _update_products(self) -> None:
        """Read the products again if files were added or removed."""
        if self.app.engine_link.running or self.header.products == _products():
            return
        before = self.app.product_path
        self._read_products()
        if self.app.product_path != before:
            self.app.product_changed.emit()

    def _read_products(self) -> None:
        products = _products()
        paths = [path for _, path in products]
        chosen = self.app.product_path
        if chosen not in paths:
            last = str(self.app.settings.value("product", DEFAULT_PRODUCT)) if chosen is None else chosen.stem
            chosen = next((path for name, path in products if name == last), paths[0] if paths else None)
        self.header.set_products(products, chosen)
        self.app.product_path = self.header.product
        self._plan()

    def _plan(self) -> None:
        """Read station and product again; show what is wrong with them and disable START."""
        app = self.app
        choices: list[Choice] = []
        if app.product_path is not None:
            app.settings.setValue("product", app.product_path.stem)
        try:
            planned = run_summary(
                RunRequest("-", app.station_path, app.product_path, app.stages, schedule=app.schedule)
            )
            self._problem = None
        except ManualRigError as error:
            planned = None
            notice = CompatibilityNotice(app, error)
            self._problem, choices = notice.words, notice.choices()
        except CalstationError as error:
            planned = None
            problem = error
            self._problem = lambda: error_text(problem).sentences
        self._starting.run_summary = planned
        self._stages.plan(planned)
        self._loading.plan(planned)
        if self._problem is not None:
            self.notice.ask(
                "caution",
                lambda: self.tr("This station and product cannot run"),
                self._problem,
                [
                    *choices,
                    Choice("station_choice", lambda: self.tr("Open the station page"), self.station_wanted.emit),
                ],
            )
        else:
            self.notice.dismiss()
            self._starting.suggest()
            if app.stages is not None:
                self._show_choice(app.stages)
        self._refresh()

    def _show_choice(self, stages: tuple[str, ...]) -> None:
        """Show an engineer's choice of stages, which can be undone here."""
        self.notice.ask(
            "caution",
            lambda: self.tr("Not the whole calibration of this product"),
            lambda: self.tr("As chosen on the Engineer page: {stages}.").format(
                stages=", ".join(term("stage", stage) for stage in stages)
            ),
            [
                Choice(
                    "whole_choice",
                    lambda: self.tr("Whole calibration"),
                    lambda: self.app.choose(None, None),
                )
            ],
        )

    # ---- during the run

    def _acknowledge(self) -> None:
        transfer, request = self.app.run.transfer, self.app.engine_link.request
        self.app.run.acknowledge()
        self.header.focus_serial()
        if transfer is not None and request is not None:
            self._starting.ask_transfer(request)
        else:
            self._resuming.offer(self.header.serial)

    def _pause(self) -> None:
        paused = self.app.run.state in ("pausing", "paused")
        self.app.engine_link.send(Command.RESUME if paused else Command.PAUSE)

    def _stop_pressed(self) -> None:
        if not self.app.run.going and not self._problem:
            self.notice.dismiss()
            self._message.setText(self.tr("Nothing is running."))

    def _running_changed(self, running: bool) -> None:
        if running:
            request = self.app.engine_link.request
            self.notice.dismiss()
            if request is not None:
                self.header.set_serial(request.serial)
            self._live.start()
        else:
            self.closing.dismiss()
            self._live.stop()
            self._refresh()
            self._await_next()

    def _await_next(self) -> None:
        """Be ready for the next unit."""
        run = self.app.run
        if run.fault is not None:
            self._verdict.acknowledge_button.setFocus()
            return
        if run.state == "passed" and self._starting.run_summary is not None and self._starting.run_summary.virtual:
            self.header.set_serial("")
            self._starting.suggest()
        self.header.focus_serial()
        if run.state == "stopped":
            self._resuming.offer(self.header.serial)

    # ---- closing the window

    def ask_close(self, stop_and_close: Callable[[], None], close_now: Callable[[], None]) -> None:
        """Ask before the window closes during a run.

        Parameters
        ----------
        stop_and_close : stops the run safely, then closes the window
        close_now : closes the window at once
        """

        def stop() -> None:
            stop_and_close()
            if self.app.engine_link.running:
                self.closing.ask(
                    "stopped",
                    lambda: self.tr("Stopping safely, then closing"),
                    lambda: self.tr("The table comes to rest first."),
                    [Choice("close_now_choice", lambda: self.tr("Close now"), close_now)],
                )

        self.closing.ask(
            "caution",
            lambda: (
                self.tr("Registers are being written")
                if self.app.run.register_operation
                else self.tr("A calibration is in progress")
            ),
            lambda: (
                self.tr("Closing stops the table safely; a write in progress is completed first.")
                if self.app.run.register_operation
                else self.tr("Closing stops the table safely; the run can be resumed later.")
            ),
            [
                Choice("close_choice", lambda: self.tr("Stop and close"), stop),
                Choice("stay_choice", lambda: self.tr("Continue"), lambda: None, primary=True),
            ],
        )

    # ---- status of the run

    def _refresh(self) -> None:
        run, fields = self.app.run, self.header
        busy = self.app.engine_link.running
        fields.set_running(
            say("window.busy_registers" if run.register_operation else "window.busy_run") if busy else ""
        )
        fields.set_start(self._why_no_start())
        fields.set_pause(run.state in ("pausing", "paused"), self._why_no_pause())
        self._badge.show_state(KINDS.get(run.shown, "none"), term("badge", run.shown))
        self._progress.setValue(round(_STEPS * run.fraction) if run.state != "idle" else 0)
        self._live.refresh()
        if run.going and self.notice.asking:
            self.notice.dismiss()
        shown = (run.state, run.verdict, run.fault, len(run.remarks), busy)
        if shown != self._shown:
            self._shown = shown
            self._choose_view()
        self._message.setText(self._message_text())

    def _choose_view(self) -> None:
        """Show loading, live view or verdict."""
        run = self.app.run
        if run.state == "idle":
            self._views.setCurrentIndex(0)
        elif run.verdict is None and run.fault is None and self.app.engine_link.running:
            self._views.setCurrentIndex(1)
        else:
            self._verdict.show_end(run.state, run.verdict, run.fault, run.remarks)
            self._views.setCurrentIndex(2)

    def _why_no_start(self) -> str:
        run = self.app.run
        if self._problem is not None:
            return self._problem()
        if run.fault is not None:
            return self.tr("Read the fault and press Understood first.")
        if self.app.engine_link.running:
            return self._why_busy()
        return ""

    def _why_busy(self) -> str:
        return say("window.busy_registers" if self.app.run.register_operation else "window.busy_run")

    def _why_no_pause(self) -> str:
        return {
            "running": self.tr("Registers are being written.") if self.app.run.register_operation else "",
            "paused": "",
            "pausing": self.tr("The table is coming to rest."),
            "starting": self.tr("The run can be paused once its first stage has started."),
            "preparing": self.tr("The run can be paused once its first stage has started."),
            "stopping": self.tr("The run is stopping."),
        }.get(self.app.run.state, self.tr("Nothing is running."))

    def _message_text(self) -> str:
        run = self.app.run
        if run.fault is not None:
            return fault_text(run.fault).reason
        if run.state == "idle":
            return self.tr("Load a unit, scan its serial number, press START.")
        if run.state == "starting":
            return self.tr("Starting the engine and connecting.")
        if run.state == "stopping" and run.run_summary is not None and run.run_summary.by_hand:
            return self.tr("Stopping.")
        if run.state == "stopping":
            return self.tr("Stopping safely: the table comes to rest, then its axes are switched off.")
        if run.state == "paused" and run.run_summary is not None and run.run_summary.by_hand:
            return self.tr("Paused. Resume repeats the current position.")
        if run.state == "paused":
            return self.tr("Paused; the table is at rest. Resume repeats the current step.")
        if not run.going:
            return self._verdict.next_action()
        if run.latest is None:
            return ""
        what, key, values = run.latest
        return event_sentence(key, values) if what == "message" else step_sentence(key, values)


def _products() -> list[tuple[str, Path]]:
    """Names and files of all products."""
    return [(name, library.find("products", name)) for name in library.names("products")]


def _stack(*pages: QWidget) -> QStackedWidget:
    stack = QStackedWidget()
    for page in pages:
        stack.addWidget(page)
    return stack
