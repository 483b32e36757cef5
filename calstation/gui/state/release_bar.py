"""Button and panel to release a failed unit; the run remains FAIL and states who released the unit, and why."""

from pathlib import Path

from PySide6.QtWidgets import QWidget

from calstation.config import ConfirmationRequired, Person, computer_user
from calstation.errors import CalstationError
from calstation.gui.state.context import AppContext
from calstation.gui.state.people_panel import PeoplePanel
from calstation.gui.text import say
from calstation.gui.widgets import button, column, label, show_text
from calstation.messages import Text
from calstation.results import Result, override_required, override_result


class ReleaseBar(QWidget):
    """Visible for a failed run whose unit was not released; `AppContext.released` reports a release."""

    def __init__(self, app: AppContext, name: str) -> None:
        super().__init__()
        self._app = app
        self._path: Path | None = None
        self._serial = ""
        self._opening = app.job(self, override_required, self._open, failed=self._refuse)
        self._releasing = app.job(self, override_result, self._done, failed=self._refuse, cancellable=False)
        self._panel = PeoplePanel(name)
        self.asking = self._panel.asking
        self._error = label(kind="error", name=f"{name}_error_label", wrap=True)
        self._button = button(f"{name}_button", "window.release_button", self._ask, tip="window.release_tip")
        self.asking.connect(lambda asking: self._button.setVisible(not asking))
        column(self._button, self._panel, self._error, on=self)
        self.hide()

    def offer(self, result: Result | None, path: Path | None) -> None:
        """Offer the release of the unit of a result file, if it failed."""
        if path != self._path:
            self._opening.cancel()
            self._panel.hide()
            show_text(self._error, "")
        self._path = path
        self._serial = "" if result is None else result.serial
        open_ = result is not None and path is not None and result.outcome == "failed" and not result.released
        self.setVisible(open_)

    def _ask(self) -> None:
        show_text(self._error, "")
        self._opening.start(self._path)

    def _open(self, required: ConfirmationRequired) -> None:
        by = (self._app.badge if required.badge else self._app.operator or computer_user()) or ""
        serial = self._serial
        self._panel.ask(Text.of("window.ask_release", serial=serial), required, self._release, by=by)

    def _release(self, reason: str, first: Person, second: Person | None) -> None:
        show_text(self._error, "")
        if not self._releasing.busy:
            self._releasing.start(self._path, reason, first, second)

    def _done(self, _: object) -> None:
        self._panel.hide()
        self.hide()
        self._app.released.emit(self._path)

    def _refuse(self, error: CalstationError) -> None:
        show_text(self._error, say(error.as_text))
        if not self._panel.isHidden():
            self._panel.retry()
