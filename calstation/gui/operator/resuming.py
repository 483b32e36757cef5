"""Runs that did not reach their end: offered inline, to be continued behind the last finished stage or closed."""

from pathlib import Path

from PySide6.QtCore import QObject

from calstation.config import library
from calstation.config.request import RunRequest
from calstation.config.station import load_product
from calstation.errors import CalstationError
from calstation.gui.operator.header import RunHeader
from calstation.gui.operator.starting import Starting
from calstation.gui.shell.context import AppContext
from calstation.gui.text.messages import error_text, term
from calstation.gui.widgets.jobs import JobWatch
from calstation.gui.widgets.notice import Choice, NoticeBar
from calstation.runs.close_incomplete import close_run
from calstation.runs.resume import Resumable, find_resumable
from calstation.runs.startup_recovery import recover_startup


class Resuming(QObject):
    """Looks for such runs in the workshop and offers them one after another."""

    def __init__(self, app: AppContext, header: RunHeader, notice: NoticeBar, starting: Starting) -> None:
        super().__init__(header)
        self._app, self._header, self._notice, self._starting = app, header, notice, starting
        self._wanted: Path | None = None
        self._serial: str | None = None
        self._search, self._closing, self._tidying = JobWatch(self), JobWatch(self), JobWatch(self)
        self._search.done.connect(self._found)
        self._closing.failed.connect(lambda error: self._complain(error_text(error).sentences))
        app.resume_run.connect(self._look_for_log)

    def open_up(self) -> None:
        """When the window opens: runs that died get their result, what waits is handed over; then offer."""
        if self._app.runs_folder.is_dir():
            tidying = self._app.job_queue.submit(
                recover_startup, self._app.runs_folder, self._app.station_path
            )
            self._tidying.watch(tidying)
        self.look()

    def look(self, serial: str | None = None) -> None:
        """Offer what can be resumed; only a unit's where `serial` is given."""
        self._wanted, self._serial = None, serial
        self._submit()

    def _look_for_log(self, log: object) -> None:
        """Somebody wants this very log's run continued."""
        assert isinstance(log, Path)
        self._wanted, self._serial = log, None
        self._submit()

    def _submit(self) -> None:
        if self._app.runs_folder.is_dir():
            self._search.watch(self._app.job_queue.submit(find_resumable, self._app.runs_folder))

    def _found(self, found: list[Resumable]) -> None:
        if self._app.engine_link.running or self._starting.run_summary is None:
            return
        if self._wanted is not None:
            chosen = [run for run in found if run.log.name == self._wanted.name]
            if chosen:
                self._notice.dismiss()
                self._offer(
                    chosen
                )  # asked first: it was looked for on another page, hands may be on the fixture
            else:
                self._complain(
                    self.tr("This run has no finished stage to continue after, or has ended since.")
                )
        else:
            self._offer([run for run in found if self._serial in (None, run.serial)])

    def _offer(self, runs: list[Resumable]) -> None:
        if not runs or self._notice.asking:
            return
        run, others = runs[0], runs[1:]
        number = len(run.finished) + 1
        stage = run.stages[len(run.finished)] if len(run.finished) < len(run.stages) else run.stages[-1]
        when = run.started_utc.replace("T", " ")[:16]
        self._notice.ask(
            "paused",
            lambda: self.tr("{serial} was interrupted in stage {number}, {stage}").format(
                serial=run.serial, number=number, stage=term("stage", stage)
            ),
            lambda: self.tr("Begun {when} UTC. Is this unit still in the fixture, untouched?").format(
                when=when
            ),
            [
                Choice(
                    "resume_choice",
                    lambda: self.tr("Continue at stage {number}").format(number=number),
                    lambda: self._resume(run),
                    primary=True,
                ),
                Choice(
                    "close_run_choice",
                    lambda: self.tr("Close as incomplete"),
                    lambda: self._close(run, others),
                ),
                Choice("later_choice", lambda: self.tr("Later"), lambda: self._offer(others)),
            ],
        )

    def _resume(self, run: Resumable) -> None:
        product = _product_file(run.product)
        self._header.set_serial(run.serial)
        self._starting.run(
            RunRequest(
                run.serial,
                self._app.station_path,
                product or self._app.product_path,
                run.stages,
                self._app.runs_folder,
                self._header.operator,
                resume=run.log,
            )
        )

    def _close(self, run: Resumable, others: list[Resumable]) -> None:
        self._closing.watch(self._app.job_queue.submit(close_run, run.log, self._header.operator))
        self._offer(others)

    def _complain(self, text: str) -> None:
        self._notice.ask("caution", lambda: self.tr("The run cannot be continued"), lambda: text)


def _product_file(name: str | None) -> Path | None:
    """The file of a product by its own name."""
    for stem in library.names("products"):
        path = library.find("products", stem)
        try:
            if load_product(path)[1].name == name:
                return path
        except CalstationError:
            continue
    return None
