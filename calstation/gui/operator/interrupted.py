"""The offer to resume or close interrupted runs."""

from collections.abc import Callable
from pathlib import Path

from PySide6.QtCore import QObject

from calstation.errors import CalstationError
from calstation.gui.operator.header import RunHeader
from calstation.gui.operator.questions import ask, refusal
from calstation.gui.state import AppContext
from calstation.gui.widgets import NoticeBar
from calstation.messages import Text
from calstation.results import Delivery
from calstation.runs import (
    Resumable,
    RunSummary,
    close_incomplete_job,
    find_resumable,
    recover_at_startup,
    resume_question,
)


class InterruptedRuns(QObject):
    """Finds interrupted runs and asks whether to resume or close them; `resume` is called to resume a run."""

    def __init__(
        self, app: AppContext, header: RunHeader, notice: NoticeBar, resume: Callable[[Resumable], None]
    ) -> None:
        super().__init__(header)
        self._app, self._header, self._notice, self._resume = app, header, notice, resume
        #: Summary of the next run; None if station and product are unusable.
        self.run_summary: RunSummary | None = None
        #: Unit and log of the offered run; None for any.
        self._serial: str | None = None
        self._log: Path | None = None
        self._search = app.job(self, find_resumable, self._search_done, failed=self._search_failed)
        self._closing = app.job(self, close_incomplete_job)
        self._recovery = app.job(
            self, recover_at_startup, lambda done: self._show_delivery(done.delivery), failed=self._recovery_failed
        )
        notice.report_failures(self._closing, "common.run_not_closed", header.focus_scan)
        app.resume_run.connect(lambda log: self.offer(log=log))

    def recover(self) -> None:
        """Write the results of aborted runs, deliver pending results, and offer to resume interrupted runs."""
        if self._app.runs_folder.is_dir():
            self._recovery.start(self._app.runs_folder, self._app.station_path)
        self.offer()

    def _recovery_failed(self, error: CalstationError) -> None:
        if self.run_summary is not None:  # otherwise the page shows the error in the station or product file
            self._notice.report("operator.earlier_not_closed", error, self.offer)

    def _show_delivery(self, delivery: Delivery) -> None:
        """Show why results could not be delivered."""
        if delivery.waiting and not self._notice.asking:
            values = {"count": delivery.waiting, "folder": str(delivery.folder), "reason": delivery.reason}
            self._notice.ask("caution", Text("event.handover_waiting", values), "")

    def offer(self, serial: str | None = None, log: Path | None = None) -> None:
        """Offer to resume interrupted runs: all runs, those of the unit `serial`, or the run of `log`."""
        self._serial, self._log = serial, log
        if self._app.runs_folder.is_dir() and self.run_summary is not None:
            self._search.start(self._app.runs_folder, self.run_summary.station)

    def _search_done(self, runs: list[Resumable]) -> None:
        if self._app.engine_link.running or self.run_summary is None:
            return
        if self.run_summary.slots:
            if self._log is not None:
                ask(self._notice, "caution", Text.of("question.not_resumed_in_slots"), {})
            return
        if self._log is None:
            self._offer([run for run in runs if self._serial in (None, run.serial)])
            return
        selected = [run for run in runs if run.log.name == self._log.name]
        if selected:
            self._notice.dismiss()
            self._offer(selected)  # a question about the run selected on another page replaces any other
        else:
            ask(self._notice, "caution", Text.of("question.nothing_to_resume"), {})

    def _search_failed(self, error: CalstationError) -> None:
        engineer = self._app.role.engineer
        ask(self._notice, "caution", refusal("cannot_resume", error, engineer=engineer), {}, engineer=engineer)

    def _offer(self, runs: list[Resumable]) -> None:
        """Ask whether to resume or close the first run, then ask about the others."""
        if not runs or self._notice.asking:
            return
        run, others = runs[0], runs[1:]
        answers = {
            "resume": lambda: self._resume(run),
            "close_incomplete_job": lambda: self._close(run, others),
            "later": lambda: self._offer(others),
        }
        ask(self._notice, "paused", resume_question(run), answers, primary="later")

    def _close(self, run: Resumable, others: list[Resumable]) -> None:
        if self._app.badge_required:
            ask(self._notice, "caution", Text("station.badge_missing"), {})
            return
        self._closing.start(run.log, self._app.person or None)
        self._offer(others)
