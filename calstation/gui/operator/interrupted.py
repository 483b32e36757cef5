"""The offer to resume or close interrupted runs."""

from collections.abc import Callable, Collection
from contextlib import suppress
from pathlib import Path

from PySide6.QtCore import QObject, QTimer

from calstation.config import load_station
from calstation.errors import CalstationError
from calstation.gui.operator.header import RunHeader
from calstation.gui.operator.questions import ask, refusal
from calstation.gui.state import AppContext
from calstation.gui.text import rendered
from calstation.gui.widgets import NoticeBar
from calstation.messages import Text
from calstation.registers import journal_folder, open_transfer
from calstation.results import Delivery
from calstation.runs import (
    Interrupted,
    RunSummary,
    StartupRecovery,
    close_incomplete_job,
    find_chamber_left,
    find_interrupted,
    recover_at_startup,
)

#: Setting that stores the start of the latest run after which the operator has checked the chamber.
_LOOKED_AT = "chamber_looked_at"


class InterruptedRuns(QObject):
    """Finds interrupted runs and asks whether to resume or close them; `resume` is called to resume a run or batch."""

    def __init__(
        self, app: AppContext, header: RunHeader, notice: NoticeBar, resume: Callable[[Interrupted], None]
    ) -> None:
        super().__init__(header)
        self._app, self._header, self._notice, self._resume = app, header, notice, resume
        #: Summary of the next run; None if station and product are unusable.
        self.run_summary: RunSummary | None = None
        #: Units and log of the offered run; () and None for any.
        self._serials: Collection[str] = ()
        self._log: Path | None = None
        self._otherwise: Callable[[], None] = lambda: None
        #: Units of the interrupted runs that the last search found.
        self.serials: frozenset[str] = frozenset()
        self._skipped = False  #: Whether nothing was offered after the last search because of a fault.
        self._faulty = False  #: Whether the run had a fault at its last change.
        self._search = app.job(self, find_interrupted, self._search_done, failed=self._search_failed)
        self._closing = app.job(self, close_incomplete_job, self._closed)
        self._recovering = False  #: Whether `recover` has been called.
        self._first = False  #: Whether the first search after `recover` has not ended yet.
        #: Units with unverified registers and outcome of the delivery of results at startup, until `forget_recovery`.
        self._unverified: tuple[str, ...] = ()
        self._delivery: Delivery | None = None
        self._shown = False  #: Whether a notice has shown them and neither a question nor a run has replaced it.
        #: Timer for one turn of the event loop, in which another question or a run may follow an answer.
        self._after_notice = QTimer(self, singleShot=True, interval=0)
        self._after_notice.timeout.connect(self._notice_changed)
        for changed in (notice.changed, app.engine_link.running_changed):
            changed.connect(self._after_notice.start)
        #: Start of the run that left the chamber at an unknown temperature; "" for none.
        self._left = ""
        self._chamber = app.job(self, find_chamber_left, self._chamber_found, failed=self._chamber_not_found)
        self._recovery = app.job(self, recover_at_startup, self._recovered, failed=self._recovery_failed)
        for search in (self._chamber, self._search):
            search.busy_changed.connect(self._searching_changed)
        notice.report_failures(self._closing, "common.run_not_closed", header.focus_scan)
        app.resume_run.connect(lambda log: self.offer(log=log))
        app.run.chamber_acknowledged.connect(self._chamber_looked_at)
        app.station_changed.connect(self._station_changed)
        app.run.stop_incomplete_changed.connect(self._stop_completed)
        app.run.changed.connect(self._run_changed)

    @property
    def asking(self) -> bool:
        """Whether the question about an interrupted run is open."""
        return self._notice.offers("later_choice")

    def recover(self) -> None:
        """Write the results of aborted runs, deliver pending results, and offer to resume interrupted runs.

        If such a run left the chamber at an unknown temperature, the operator must check the chamber first. Until this
        is known, no run can start.
        """
        self._recovering = True
        self._first = self._app.runs_folder.is_dir()
        if self._first:
            self._find_chamber_left()
            self._recovery.start(self._app.runs_folder, self._app.station_path)

    def _searching_changed(self) -> None:
        """Prevent the start of a run until the first search has ended; later searches, which may wait, do not."""
        self._app.run.set_reading_runs(self._first and (self._chamber.busy or self._search.busy))

    def _station_changed(self) -> None:
        if self._recovering and self._app.runs_folder.is_dir():  # the new station may have another chamber
            self._find_chamber_left()

    def _find_chamber_left(self) -> None:
        with suppress(CalstationError):  # nothing starts at an unusable station
            has_chamber = load_station(self._app.station_path)[1].chamber is not None
            self._app.run.set_chamber_left(None if has_chamber else False)
        self._chamber.start(self._app.runs_folder, self._app.station_path)

    def _chamber_found(self, left: str) -> None:
        """Set whether a run left the chamber at an unknown temperature and the operator has not checked it since."""
        if left == self._app.settings.value(_LOOKED_AT, "") or self._app.engine_link.running:
            left = ""
        self._left = left or self._left
        self._app.run.set_chamber_left(bool(left))
        if not left:
            self.offer()

    def _stop_completed(self, incomplete: bool) -> None:
        """Repeat the search whose result was not offered while the table might still have been moving."""
        if self._recovering and not incomplete and self._app.run.state == "idle":
            self.offer(self._serials, self._log, self._otherwise)

    def _run_changed(self) -> None:
        """After a fault, which may clear by itself, show the notice and repeat a search that was not offered."""
        cleared, self._faulty = self._faulty and self._app.run.fault is None, self._app.run.fault is not None
        if not cleared:
            return
        if self._skipped and not self._app.engine_link.running:
            self.offer(self._serials, self._log, self._otherwise)
        self._after_notice.start()

    def _chamber_not_found(self, _: CalstationError) -> None:
        """Require the operator to check the chamber if the runs cannot be read."""
        awaited = self._app.run.chamber.unchecked
        self._app.run.set_chamber_left(awaited)
        if not awaited:
            self.offer()

    def _chamber_looked_at(self) -> None:
        if self._left:
            self._app.settings.setValue(_LOOKED_AT, self._left)
            self._left = ""
            self.offer()

    def _recovery_failed(self, error: CalstationError) -> None:
        if self.run_summary is not None:  # otherwise the page shows the error in the station or product file
            self._notice.report("operator.earlier_not_closed", error, self.offer)

    def _recovered(self, done: StartupRecovery) -> None:
        self._delivery, self._unverified = done.delivery, done.unverified
        self._show_recovery()

    def _notice_changed(self) -> None:
        """Show the notice after the startup again when the question or the run that replaced it has ended."""
        if self._notice.asking or self._app.engine_link.running:
            self._shown = False
        elif self._notice.isHidden() and not self._search.busy:
            self._show_recovery()

    def forget_recovery(self) -> None:
        """Forget what the notice after the startup said if it has been shown, because the user continues."""
        if self._shown:
            self._delivery, self._unverified, self._shown = None, (), False

    def has_open_transfer(self, serial: str) -> bool:
        """Return whether registers were written to a unit and neither verified nor restored."""
        with suppress(CalstationError):  # START shows an error in the journal
            folder = journal_folder(load_station(self._app.station_path)[1], self._app.runs_folder)
            return open_transfer(folder, serial) is not None
        return False

    def _show_recovery(self) -> None:
        """Show the units with unverified registers and why results were not delivered, unless a question or fault is.

        Another program that uses the station may be writing the registers now.
        """
        run = self._app.run
        if self._first or self._notice.asking or self._app.engine_link.running or run.fault is not None:
            return
        delivery = self._delivery
        unverified = list(filter(self.has_open_transfer, () if run.occupied is not None else self._unverified))
        notices = [Text.of("question.registers_left", serials=unverified)] if unverified else []
        if delivery is not None and delivery.waiting:
            values = {"count": delivery.waiting, "folder": str(delivery.folder), "reason": delivery.reason}
            notices.append(Text("event.handover_waiting", values))
        if notices:
            self._shown = True
            first, *others = notices
            self._notice.ask("caution", lambda: rendered(first).text, lambda: _remedy(first, others))

    def offer(
        self, serials: Collection[str] = (), log: Path | None = None, otherwise: Callable[[], None] = lambda: None
    ) -> None:
        """Offer to resume all interrupted runs, those of some units or their batch, or the run of a log.

        Parameters
        ----------
        serials : units that are resumed; () for any
        log : log of the run that is resumed; None for any
        otherwise : called if nothing can be offered and no log is given
        """
        self._serials, self._log, self._otherwise, self._skipped = serials, log, otherwise, False
        if self._app.runs_folder.is_dir() and self.run_summary is not None:
            summary = self.run_summary
            self._search.start(self._app.runs_folder, summary.station, measured=summary.bench is None)
        else:
            otherwise()

    def _search_done(self, found: list[Interrupted]) -> None:
        self._first = False
        if self._app.engine_link.running or self.run_summary is None or self._app.run.stop_incomplete:
            return
        if self._app.run.fault is not None:  # nothing can be resumed before
            self._skipped = self._log is None
            if self._log is not None:
                ask(self._notice, "caution", Text("operator.fault_below"), {})
            return
        found = [each for each in found if (each.runs[0].slot is not None) == bool(self.run_summary.slots)]
        self.serials = frozenset(run.serial for each in found for run in each.runs)
        if self._log is None:
            units = self._serials
            mounted = [each.on_table for each in found]
            offered = [
                each for each in mounted if each.runs and (not units or any(run.serial in units for run in each.runs))
            ]
            self._offer(offered) if offered else self._otherwise()
            self._show_recovery()
            return
        selected = [each for each in found if self._log.name in {log.name for log in each.logs}]
        if selected:
            self._notice.dismiss()
            self._offer(selected)  # a question about the run selected on another page replaces any other
        else:
            ask(self._notice, "caution", Text.of("question.nothing_to_resume"), {})

    def _search_failed(self, error: CalstationError) -> None:
        self._first = False
        engineer = self._app.role.engineer
        ask(self._notice, "caution", refusal("cannot_resume", error, engineer=engineer), {}, engineer=engineer)

    def _offer(self, found: list[Interrupted]) -> None:
        """Ask whether to resume or close the first run or batch, then ask about the others."""
        if not found or self._notice.asking:
            self._show_recovery()
            return
        first, others = found[0], found[1:]
        answers = {
            "resume": lambda: self._resume(first),
            "close_incomplete_job": lambda: self._close(first, others),
            "later": lambda: self._offer(others),
        }
        summary = self.run_summary
        chosen = () if summary is None else (summary.product, *summary.slot_products.values())
        ask(self._notice, "paused", first.question(chosen), answers, primary="later")

    def _close(self, interrupted: Interrupted, others: list[Interrupted]) -> None:
        if self._app.badge_required:
            ask(self._notice, "caution", Text("station.badge_missing"), {})
            return
        self._closing.start(interrupted.logs, self._app.person or None)
        self._offer(others)

    def _closed(self, results: list[Path]) -> None:
        for result in results:
            self._app.result_changed.emit(result)


def _remedy(first: Text, others: list[Text]) -> str:
    """Return the remedy for a notice, and the other notices below it."""
    return "\n".join(filter(None, [rendered(first).remedy, *(rendered(each).text for each in others)]))
