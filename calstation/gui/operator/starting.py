"""Starts a run: checks the serial number, asks what must be asked in the notice bar, then starts the engine."""

import re
from collections.abc import Callable
from dataclasses import replace
from functools import partial

from PySide6.QtCore import QObject

from calstation.config import ManualRigError, RunRequest, RunSummary, compatible_products
from calstation.gui.operator.header import RunHeader
from calstation.gui.shell import AppContext
from calstation.gui.text import say
from calstation.gui.widgets import Choice, NoticeBar
from calstation.results import History

Go = Callable[[], None]


class Starting(QObject):
    """Everything between the scanner's Enter and the start of the engine.

    `run_summary` : of the next run; None while station and product cannot run.
    """

    def __init__(self, app: AppContext, header: RunHeader, notice: NoticeBar) -> None:
        super().__init__(header)
        self._app, self._header, self._notice = app, header, notice
        self.run_summary: RunSummary | None = None
        header.serial_entered.connect(self.check)
        header.serial_edited.connect(self._edited)
        header.start_pressed.connect(self.start)

    def history(self) -> History | None:
        """The history of earlier runs; None if there are none."""
        folder = self._app.runs_folder
        return History(folder) if folder.is_dir() else None

    def suggest(self) -> None:
        """On the virtual bench, fill in a number that has not passed yet, if the field is empty."""
        if self.run_summary is not None and self.run_summary.virtual and not self._header.serial:
            history = self.history()

            def passed(serial: str) -> bool:
                return history is not None and history.passed_before(serial) is not None

            self._header.set_serial(suggested_serial(self.run_summary, passed))

    def check(self) -> bool:
        """Check the serial number; a valid one moves the focus to START, which only a separate press activates."""
        header = self._header
        if self.run_summary is None:
            return False
        if not header.fits(self.run_summary.serial_pattern):
            self._refuse(header.serial, self.run_summary.serial_pattern)
            return False
        history = self.history()
        before = history.attempts(header.serial) if history is not None else 0
        header.note_serial(self.tr("attempt {count}").format(count=before + 1) if before else "")
        if self._app.run.state in ("passed", "failed", "stopped", "incomplete"):
            self._app.run.acknowledge()
        header.start_button.setFocus()
        return True

    def start(self) -> None:
        """Check, ask what must be asked, then run."""
        if self._app.engine_link.running or not self.check() or self.run_summary is None:
            return
        if self._app.job_queue.at_device:
            self._notice.ask(
                "caution",
                lambda: self.tr("Another page is talking to a device"),
                lambda: self.tr("It takes a few seconds; then press START again."),
            )
            return
        serial = self._header.serial
        request = RunRequest(
            serial,
            self._app.station_path,
            self._app.product_path,
            self._app.stages,
            self._app.runs_folder,
            self._header.operator,
            schedule=self._app.schedule,
        )
        history = self.history()
        if history is not None:
            failures = history.failures(serial)
            allowed = self.run_summary.attempts_allowed
            if allowed is not None and failures >= allowed:
                self._ask_beyond(serial, failures, request)
                return
            passed = history.passed_before(serial)
            if passed is not None:
                when = passed.started_utc.replace("T", " ")[:16]
                self._ask_repeat(serial, when, lambda: self.run(request))
                return
        self.run(request)

    def run(self, request: RunRequest) -> None:
        """Start a run; before a real table moves, ask."""
        if self.run_summary is not None and self.run_summary.virtual:
            self._app.engine_link.start(request)
        else:
            self._ask_motion(lambda: self._app.engine_link.start(request))

    def ask_transfer(self, request: RunRequest) -> None:
        """Ask which registers the unit shall have after an interrupted transfer, then run."""
        self._notice.ask(
            "caution",
            lambda: self.tr("Writing the registers of {serial} was interrupted").format(serial=request.serial),
            lambda: (
                self.tr(
                    "Which registers shall the unit have before it is calibrated? New ones are verified first with a "
                    "turn of the table."
                )
                if self.run_summary is not None and not self.run_summary.by_hand
                else self.tr("Which registers shall the unit have before it is calibrated?")
            ),
            [
                Choice(
                    "restore_choice",
                    lambda: self.tr("The old ones, then calibrate"),
                    lambda: self.run(replace(request, unfinished="restore")),
                ),
                Choice(
                    "finish_choice",
                    lambda: self.tr("The new ones, then calibrate"),
                    lambda: self.run(replace(request, unfinished="finish")),
                ),
                self._cancel(),
            ],
        )

    def _edited(self) -> None:
        self._header.note_serial("")
        if self.run_summary is not None and not self._app.run.going:
            self._notice.dismiss()

    def _refuse(self, serial: str, pattern: str) -> None:
        self._header.note_serial(self.tr("not valid"), wrong=True)
        self._notice.ask(
            "caution",
            lambda: (
                self.tr("The serial number '{serial}' does not fit this product").format(serial=serial)
                if serial
                else self.tr("The serial number is missing")
            ),
            lambda: self.tr(
                "Scan it again, or choose the product that belongs to the unit. Its pattern is {pattern}"
            ).format(pattern=pattern),
        )
        self._header.focus_serial()

    def _ask_repeat(self, serial: str, when: str, go: Go) -> None:
        self._notice.ask(
            "caution",
            lambda: self.tr("{serial} has already passed").format(serial=serial),
            lambda: self.tr("On {when} UTC. Calibrate it once more?").format(when=when),
            [
                Choice("repeat_choice", lambda: self.tr("Calibrate again"), go),
                self._cancel(),
            ],
        )

    def _ask_beyond(self, serial: str, failures: int, request: RunRequest) -> None:
        """Ask for an engineer after too many failed attempts."""
        engineer = self._app.role.engineer
        allow = Choice(
            "beyond_choice",
            lambda: self.tr("Allow one more"),
            lambda: self.run(replace(request, beyond_attempts=True)),
        )
        unlock = Choice("unlock_choice", lambda: self.tr("Engineer …"), self._app.role.ask)
        self._notice.ask(
            "bad",
            lambda: self.tr("Set {serial} aside").format(serial=serial),
            lambda: (
                self.tr("It was outside its limits {count} times in a row. ").format(count=failures)
                + (
                    self.tr("Allow one more attempt?")
                    if engineer
                    else self.tr("An engineer can allow one more attempt.")
                )
            ),
            [allow if engineer else unlock, self._cancel()],
        )

    def _ask_motion(self, go: Go) -> None:
        station = self.run_summary.station if self.run_summary is not None else ""
        self._notice.ask(
            "caution",
            lambda: self.tr("The table of '{station}' is going to move").format(station=station),
            lambda: self.tr("Is everyone clear of the table and the unit secured?"),
            [Choice("clear_choice", lambda: self.tr("All clear, start"), go), self._cancel()],
        )

    def _cancel(self) -> Choice:
        return Choice("cancel_choice", lambda: self.tr("Cancel"), self._header.focus_serial, primary=True)


#: Most compatible products that get a button; all are named.
_BUTTONS = 2

#: Serial numbers tried.
_TRIED = 1000


def suggested_serial(run_summary: RunSummary, passed: Callable[[str], bool]) -> str:
    """A serial number for the virtual bench that has not passed yet; "" for hardware.

    Parameters
    ----------
    run_summary : of the next run
    passed : tells whether a number has passed before
    """
    if run_summary.bench is None:
        return ""
    own = run_summary.bench.get("serial")
    if own is not None:
        return str(own)
    for number in range(1, _TRIED):
        serial = f"SN-{number:06d}"
        if not re.fullmatch(run_summary.serial_pattern, serial):
            return ""
        if not passed(serial):
            return serial
    return ""


class CompatibilityNotice:
    """Texts and choices for a product that needs the other kind of table."""

    def __init__(self, app: AppContext, error: ManualRigError) -> None:
        self._app, self._error = app, error
        self._found = compatible_products(app.station_path, app.product_path)

    def words(self) -> str:
        """What is incompatible, and what is compatible."""
        why = say(
            "window.manual_station" if self._error.code != "product.needs_manual_table" else "window.driven_station"
        )
        if not self._found:
            return f"{why} {say('window.no_compatible_product')}"
        names = ", ".join(name for name, _ in self._found)
        return f"{why} {say('window.compatible_products', names=names)}"

    def choices(self) -> list[Choice]:
        """Buttons that choose a compatible product."""
        return [
            Choice(
                f"product_choice_{name}",
                partial(say, "window.choose_product", name=name),
                partial(self._app.set_product, path),
            )
            for name, path in self._found[:_BUTTONS]
        ]
