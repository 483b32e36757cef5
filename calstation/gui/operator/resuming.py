"""Offers interrupted runs, to be resumed after the last completed stage or closed."""

from pathlib import Path

from PySide6.QtCore import QObject

from calstation.config import RunRequest, library, load_product
from calstation.errors import CalstationError
from calstation.gui.operator.header import RunHeader
from calstation.gui.operator.starting import Starting
from calstation.gui.shell import AppContext
from calstation.gui.text import error_text, term
from calstation.gui.widgets import Choice, JobWatch, NoticeBar
from calstation.runs import Resumable, close_incomplete_job, find_resumable, recover_startup


class Resuming(QObject):
    """Finds interrupted runs in the background and offers them one after another."""

    def __init__(self, app: AppContext, header: RunHeader, notice: NoticeBar, starting: Starting) -> None:
        super().__init__(header)
        self._app, self._header, self._notice, self._starting = app, header, notice, starting
        self._wanted: Path | None = None
        self._serial: str | None = None
        self._search, self._closing, self._recovery = JobWatch(self), JobWatch(self), JobWatch(self)
        self._search.done.connect(self._found)
        self._closing.failed.connect(lambda error: self._show_error(error_text(error).sentences))
        app.resume_run.connect(self._offer_log)

    def start(self) -> None:
        """When the window opens: close runs that died, hand over waiting results, then offer what can be resumed."""
        if self._app.runs_folder.is_dir():
            recovery = self._app.job_queue.submit(recover_startup, self._app.runs_folder, self._app.station_path)
            self._recovery.watch(recovery)
        self.offer()

    def offer(self, serial: str | None = None) -> None:
        """Offer runs that can be resumed; only those of a unit if `serial` is given."""
        self._wanted, self._serial = None, serial
        self._submit()

    def _offer_log(self, log: object) -> None:
        """Offer the run of a log that another page has chosen."""
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
                self._ask(chosen)  # chosen on another page: hands may be on the fixture
            else:
                self._show_error(self.tr("This run has no completed stage to resume after, or has ended since."))
        else:
            self._ask([run for run in found if self._serial in (None, run.serial)])

    def _ask(self, runs: list[Resumable]) -> None:
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
            lambda: self.tr("Started {when} UTC. Is this unit still in the fixture, untouched?").format(when=when),
            [
                Choice(
                    "resume_choice",
                    lambda: self.tr("Resume at stage {number}").format(number=number),
                    lambda: self._resume(run),
                    primary=True,
                ),
                Choice(
                    "close_incomplete_job_choice",
                    lambda: self.tr("Close as incomplete"),
                    lambda: self._close(run, others),
                ),
                Choice("later_choice", lambda: self.tr("Later"), lambda: self._ask(others)),
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
        self._closing.watch(self._app.job_queue.submit(close_incomplete_job, run.log, self._header.operator))
        self._ask(others)

    def _show_error(self, text: str) -> None:
        self._notice.ask("caution", lambda: self.tr("The run cannot be resumed"), lambda: text)


def _product_file(name: str | None) -> Path | None:
    """The file of a product by the name in it."""
    for stem in library.names("products"):
        path = library.find("products", stem)
        try:
            if load_product(path)[1].name == name:
                return path
        except CalstationError:
            continue
    return None
