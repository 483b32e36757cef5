"""The context of a window, with the state that all its pages share."""

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from PySide6.QtCore import QObject, QSettings, Signal

from calstation.config import Confirmation, SignInSection, library, load_station
from calstation.database import ExchangeState
from calstation.errors import CalstationError
from calstation.gui.state.engine_link import EngineLink
from calstation.gui.state.port_watch import PortWatch
from calstation.gui.state.role import RoleLock
from calstation.gui.state.run_status import RunStatus
from calstation.gui.state.slots import Slots
from calstation.gui.state.station_windows import StationWindows
from calstation.gui.text import language
from calstation.gui.widgets import JobWatch, Slot, theme
from calstation.jobs import JobQueue
from calstation.results import History


def _warm_up() -> None:
    from calstation.results import warm_up  # the solvers take a second to import, and only the job process needs them

    warm_up()


class AppContext(QObject):
    """The state that all pages of a window share."""

    station_changed = Signal()
    product_changed = Signal()
    choice_changed = Signal()
    operator_changed = Signal()
    identified = Signal(str)  #: Badge or name of the person at the window, entered outside the operator page.
    open_log = Signal(object)
    open_run = Signal(object)
    resume_run = Signal(object)
    #: Result file that has changed: its failed unit was released, or its incomplete run was closed.
    result_changed = Signal(object)
    labels_printed = Signal(list)  #: Serial numbers of the units whose labels have been printed.
    page_requested = Signal(str)  #: Object name of the page to show.
    watch_requested = Signal()  #: Emitted to show the live monitoring of the IMUs on one body.
    runs_folder_changed = Signal()
    exchange_changed = Signal()  #: Emitted after `exchange_state` has changed.
    claim_changed = Signal()
    closing = Signal()

    def __init__(self, station: Path | None = None, runs_folder: Path | None = None) -> None:
        super().__init__()
        #: Language, theme and recent files; nothing that affects results.
        self.settings = QSettings(str(library.site_folder() / "window.ini"), QSettings.Format.IniFormat, self)
        self.job_queue = JobQueue(_warm_up)
        self.engine_link = EngineLink(self)
        self.run = RunStatus(self.engine_link, self)
        self.windows = StationWindows(self.run, self)
        self.port_watch = PortWatch(self.run, self.engine_link, self)
        self.role = RoleLock(self, lambda: self.engine_link.running or self.job_queue.busy)
        #: Units of the next run at a station with several slots.
        self.slots = Slots(self)
        #: Station file; None for the virtual bench.
        self.station_path = station or self._last_station()
        self.product_path: Path | None = None
        #: Name and badge of the person at the window; None if nobody is signed in or has entered a name.
        self.operator: str | None = None
        self.badge: str | None = None
        self.badge_required = False  #: Whether an operator must sign in before a run.
        self.engineer_asks = False  #: Whether a question before a start is open on the Engineer page.
        self.overdue = False  #: Whether an engineer must permit the next run, because calibrations are overdue.
        self.signed_out_idle = False  #: Whether the last operator was signed out by the idle timeout.
        #: Stages and schedule selected by an engineer; None for those of the product.
        self.stages: tuple[str, ...] | None = None
        self.schedule: Mapping[str, Mapping[str, Any]] | None = None
        #: State of the exchange with the shared database; None for a station without one.
        self.exchange_state: ExchangeState | None = None
        #: Serial numbers of the units that are claimed in the shared database, with their operators.
        self.claimed: Mapping[str, str | None] = {}
        self.engine_link.running_changed.connect(self._end_choice)  # called before the slots of the pages
        self.run.stop_incomplete_changed.connect(self._store_stop_incomplete)
        self.station_changed.connect(self._restore_stop_incomplete)
        self._restore_stop_incomplete()
        self.runs_folder = runs_folder or Path(str(self.settings.value("runs_folder", "runs")))

    def job(
        self,
        owner: QObject,
        work: Callable[..., object] | None,
        done: Slot = None,
        *,
        failed: Slot = None,
        cancelled: Slot = None,
        cancellable: bool = True,
    ) -> JobWatch:
        """Return a watch whose `start` calls `work` with its arguments in the background; see `JobQueue.submit`.

        The slots are called in the thread of the window.

        Parameters
        ----------
        owner
            Object whose destruction disconnects the slots.
        work
            Function at the top level of a module; None if it is the first argument of `start`.
        done, failed, cancelled
            Slots that are called with the result, with the error, and without arguments.
        cancellable
            Whether the job may be cancelled.
        """
        submit = partial(self.job_queue.submit, cancellable=cancellable)
        if work is not None:
            submit = partial(submit, work)
        return JobWatch(owner, submit, done, failed, cancelled)

    @property
    def person(self) -> str:
        """Name of the person in records: whoever is at the window or unlocked the engineer role; "" if unknown."""
        return self.operator or self.role.person

    @property
    def author(self) -> Confirmation:
        """The `person` as recorded in the audit trail, and which PIN, personal or of the site, was entered, if any."""
        role = self.role
        if role.badge and role.person == self.person and self.badge in (None, role.badge):
            return Confirmation(self.recorded(role.badge), pin="personal")
        by = self.recorded(self.badge or self.person or "engineer")
        return Confirmation(by, pin="site" if role.engineer and not role.badge else None)

    @property
    def _sign_in(self) -> SignInSection | None:
        """Badges of the station; None if it has none or if its file cannot be read."""
        try:
            return load_station(self.station_path)[1].sign_in
        except CalstationError:
            return None

    def recorded(self, entered: str) -> str:
        """Return the name in records of the person who entered a badge or a name."""
        sign_in = self._sign_in
        return entered if sign_in is None else sign_in.person(entered)

    def history(self) -> History:
        """Open the history of the runs that count at the station, or of all runs if the station cannot be read."""
        try:
            return History.at(self.runs_folder, load_station(self.station_path)[1])
        except CalstationError:
            return History(self.runs_folder)

    def engineer_badge(self, entered: str) -> str:
        """Return the entered badge if the station lists it as an engineer's, otherwise ""."""
        sign_in = self._sign_in
        return entered if sign_in is not None and entered in sign_in.engineers else ""

    def name_of(self, entered: str) -> str:
        """Return the name of the person who entered a badge or, at a station without badges, a name.

        Raises ConfigurationError if the badge is not accepted.
        """
        sign_in = self._sign_in
        return entered if sign_in is None else sign_in.operator(entered)

    def set_station(self, path: Path | None) -> None:
        """Use another station file."""
        self.station_path = path
        self.station_changed.emit()

    def set_product(self, path: Path) -> None:
        """Use another product file."""
        if path != self.product_path:
            self.product_path = path
            self.product_changed.emit()

    def choose(self, stages: tuple[str, ...] | None, schedule: Mapping[str, Mapping[str, Any]] | None) -> None:
        """Select the stages of the next run and the changes to their schedules, or None for those of the product."""
        if (stages, schedule) != (self.stages, self.schedule):
            self.stages, self.schedule = stages, schedule
            self.choice_changed.emit()

    def _end_choice(self, running: bool) -> None:
        """Return to the stages and the schedule of the product after a run."""
        if not running and self.engine_link.operation is None:
            self.choose(None, None)

    def set_runs_folder(self, folder: Path) -> None:
        """Use another folder for logs and results."""
        self.runs_folder = folder
        self.settings.setValue("runs_folder", str(folder))
        self.runs_folder_changed.emit()

    def claim(self, *serials: str) -> None:
        """Claim these units in the shared database instead of the previous ones."""
        claimed = dict.fromkeys(serials, self.operator)
        if claimed != self.claimed:
            self.claimed = claimed
            self.claim_changed.emit()

    def set_theme(self, name: str) -> None:
        """Switch to the theme ``light`` or ``dark``."""
        theme.apply(name)
        self.settings.setValue("theme", theme.current())

    def set_language(self, code: str) -> None:
        """Switch to another language."""
        language.use(code)
        self.settings.setValue("language", language.current())

    def close(self) -> None:
        """Stop a run in progress safely, and end the engine, the job process and the live monitoring."""
        self.closing.emit()
        self.windows.leave()
        self.port_watch.leave()
        self.engine_link.close()
        self.job_queue.close()

    @property
    def _incomplete_stops(self) -> set[str]:
        """Station files whose table may still move after a safe stop."""
        return set(filter(None, str(self.settings.value("incomplete_stops", "")).split("\n")))

    def _store_stop_incomplete(self, incomplete: bool) -> None:
        """Store for the next start of the window whether the table of the station may still move."""
        here, stations = {str(self.station_path)}, self._incomplete_stops
        self.settings.setValue(
            "incomplete_stops", "\n".join(sorted(stations | here if incomplete else stations - here))
        )
        self.settings.sync()

    def _restore_stop_incomplete(self) -> None:
        self.run.set_stop_incomplete(str(self.station_path) in self._incomplete_stops)

    def _last_station(self) -> Path | None:
        """Return the station file selected last on the station page, or None if it no longer exists."""
        name = str(self.settings.value("station", ""))
        return library.find("stations", name) if name in library.names("stations") else None
