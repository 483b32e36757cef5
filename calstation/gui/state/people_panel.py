"""The notice that asks to sign in, the panel in which people confirm an action, and the bar that releases a unit."""

from collections.abc import Callable
from contextlib import suppress
from datetime import date
from pathlib import Path

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QHideEvent, QShowEvent
from PySide6.QtWidgets import QFrame, QLabel, QLineEdit, QWidget

from calstation.config import ConfirmationRequired, Person, require_no_pin
from calstation.errors import CalstationError, ConfigurationError
from calstation.gui.state.context import AppContext
from calstation.gui.text import Words, bind, on_language_change, say
from calstation.gui.widgets import Choice, NoticeBar, button, column, enable, grid, label, row, show_text, theme
from calstation.messages import Text
from calstation.results import Result, override_required, override_result

#: Function that receives the reason, the acting person, and the confirming person if one is required.
ConfirmedCallback = Callable[[str, Person, Person | None], None]

#: Number of lines below the fields that are reserved for a refusal.
_REFUSAL_LINES = 2

#: Object name of the Close button of the notice that asks to sign in.
_SIGN_IN = "sign_in_close_button"


def ask_to_sign_in(app: AppContext, notice: NoticeBar, title: Words, text: Words, then: Callable[[], None]) -> None:
    """Show a notice until an operator has signed in; `then` is called after the notice has been closed."""

    def remove() -> None:
        if app.badge_required:
            return
        app.operator_changed.disconnect(remove)
        if notice.offers(_SIGN_IN):
            notice.dismiss()

    notice.ask("caution", title, text, (Choice(_SIGN_IN, "common.close", then),))
    app.operator_changed.connect(remove)


class PeoplePanel(QFrame):
    """A panel that `ask` shows; the caller hides it after the action, or calls `retry` for another attempt.

    A refusal or a wrong date is shown below the fields without moving them, so that nobody types a PIN into another
    field.
    """

    open_changed = Signal(bool)  #: Emitted with True when the panel opens, and with False when it closes.
    cancelled = Signal()  #: Emitted when a person cancels; a later refusal of the action need not be shown.

    def __init__(self, name: str) -> None:
        super().__init__()
        self.setObjectName(f"{name}_panel")
        self.setProperty("kind", "panel")
        self._words: Words = ""
        self._confirmed: ConfirmedCallback = lambda reason, first, second: None
        self._badges = False
        self._title = label(kind="section", wrap=True)
        self._note_words: Words = ""
        self._note = label(kind="muted", name=f"{name}_note_label", wrap=True)
        self._fields = grid(across=2 * theme.GRID, down=theme.GRID // 2, stretch=1)
        self._captions: list[QLabel] = []
        self._edits: list[QLineEdit] = []
        for key in ("reason", "badge", "pin", "second_badge", "second_pin"):
            edit, caption = QLineEdit(), label()
            edit.setObjectName(f"{name}_{key}_edit")
            edit.textChanged.connect(lambda _: self._refresh())
            edit.returnPressed.connect(self._confirm)
            if key.endswith("pin"):
                edit.setEchoMode(QLineEdit.EchoMode.Password)
            caption.setBuddy(edit)
            self._fields.addWidget(caption, len(self._edits), 0)
            self._fields.addWidget(edit, len(self._edits), 1)
            self._captions.append(caption)
            self._edits.append(edit)
        self._received, self._received_caption = QLineEdit(), label("window.received")
        self._received.setObjectName(f"{name}_received_edit")
        self._received.textChanged.connect(lambda _: self._refresh())
        self._received.returnPressed.connect(self._confirm)
        self._received_caption.setBuddy(self._received)
        bind(self._received.setPlaceholderText, "window.received_hint")
        self._error_words: Words = ""
        self._progress: Words = ""  #: Progress of the confirmed action; "" while no action is running.
        self._error = label(kind="error", name=f"{name}_refusal_label", wrap=True)
        self._error.setAlignment(Qt.AlignmentFlag.AlignTop)
        self._error.setMinimumHeight(_REFUSAL_LINES * self._error.fontMetrics().lineSpacing())
        self._confirm_button = button(f"{name}_confirm_button", pressed=self._confirm)
        cancel = button(f"{name}_cancel_button", "common.cancel", self._cancel)
        column(
            self._title,
            self._note,
            self._fields,
            self._error,
            row(self._received_caption, self._received, None, cancel, self._confirm_button),
            on=self,
            margins=(2 * theme.GRID, theme.GRID, 2 * theme.GRID, theme.GRID),
        )
        bind(self.setAccessibleName, "window.confirmation")
        on_language_change(self, self._show_texts)
        self.hide()

    def ask(
        self,
        words: Words,
        required: ConfirmationRequired,
        then: ConfirmedCallback,
        *,
        by: str = "",
        reason: bool = True,
        note: Words = "",
        received: bool = False,
    ) -> None:
        """Ask for the badges and PINs of the persons who confirm an action.

        Parameters
        ----------
        words
            Title of the action.
        required
            Who must confirm the action.
        then
            Called with the reason and the persons.
        by
            Badge proposed for the acting person.
        reason
            Whether a reason is required.
        note
            Note shown above the fields; "" for none.
        received
            Whether to ask for the date of receipt of the unit, which may stay empty; see `received`.
        """
        self._words, self._confirmed, self._badges = words, then, required.badge
        self._note_words, self._error_words = note, ""
        visible_fields = (reason, True, required.pin, required.second, required.second)
        for caption, edit, visible in zip(self._captions, self._edits, visible_fields, strict=True):
            edit.clear()
            caption.setVisible(visible)
            edit.setVisible(visible)
        self._edits[1].setText(by)
        self._received.clear()
        for widget in (self._received, self._received_caption):
            widget.setVisible(received)
        self._show_texts()
        self._refresh()
        self.show()
        next(edit for edit in self._edits if not edit.isHidden() and not edit.text()).setFocus()

    @property
    def received(self) -> date | None:
        """The date of receipt that was entered; None for no date."""
        text = self._received.text().strip()
        return date.fromisoformat(text) if text else None

    def retry(self, error: CalstationError) -> None:
        """Show why an attempt was refused, and clear the PINs."""
        self._refuse(error)
        self._edits[2].setFocus()

    def show_progress(self, words: Words) -> None:
        """Disable the Confirm button and show the progress of the confirmed action on it; "" enables the button."""
        self._progress = words
        if words and self._confirm_button.hasFocus():
            self._confirm_button.clearFocus()  # otherwise another button would receive the focus
        self._refresh()

    def _refuse(self, error: CalstationError) -> None:
        self._error_words = error.as_text
        for edit in (self._edits[2], self._edits[4]):
            edit.clear()
        self._show_texts()

    def showEvent(self, event: QShowEvent) -> None:
        """Report that the panel is open."""
        super().showEvent(event)
        self.open_changed.emit(True)

    def hideEvent(self, event: QHideEvent) -> None:
        """Report that the panel is closed."""
        super().hideEvent(event)
        self.open_changed.emit(False)

    def _why_not(self) -> Words:
        """Return why the action cannot be confirmed: it is running, a field is empty or a date wrong; "" if it can."""
        if self._progress:
            return self._progress
        if any(not edit.isHidden() and not edit.text().strip() for edit in self._edits):
            return "window.fill_in"
        return self._why_bad_date()

    def _why_bad_date(self) -> Words:
        with suppress(ValueError):
            _ = self.received
            return ""
        return "window.bad_date"

    def _confirm(self) -> None:
        if not self._why_not():
            reason, badge, pin, second_badge, second_pin = (edit.text() for edit in self._edits)
            first = Person(badge.strip(), pin)
            second = None if self._edits[3].isHidden() else Person(second_badge.strip(), second_pin)
            try:
                require_no_pin(reason, first, second)
            except ConfigurationError as error:
                self._refuse(error)
                self._edits[0].selectAll()
                self._edits[0].setFocus()
                return
            self._error_words = ""
            self._refresh()
            self._confirmed(reason.strip(), first, second)

    def _cancel(self) -> None:
        self.hide()
        self.cancelled.emit()

    def _refresh(self) -> None:
        self._error.setText(say(self._why_bad_date() or self._error_words))
        self._confirm_button.setText(say(self._progress or "window.confirm"))
        enable(self._confirm_button, say(self._why_not()))

    def _show_texts(self) -> None:
        name = "window.your_badge" if self._badges else "window.confirming_name"
        codes = "window.reason", name, "window.your_pin", "window.second_badge", "window.second_pin"
        for caption, text in zip(self._captions, map(say, codes), strict=True):
            caption.setText(text)
        self._title.setText(say(self._words))
        show_text(self._note, say(self._note_words))
        hint = self._received.fontMetrics().horizontalAdvance(self._received.placeholderText())
        self._received.setMinimumWidth(hint + 4 * theme.GRID)
        self._refresh()


class ReleaseBar(QWidget):
    """A bar that releases the unit of a failed run, and emits `AppContext.result_changed` after the release."""

    def __init__(self, app: AppContext, name: str) -> None:
        super().__init__()
        self._app = app
        self._path: Path | None = None
        self._serial = ""
        self._opening = app.job(self, override_required, self._open, failed=self._refuse)
        self._releasing = app.job(self, override_result, self._released, failed=self._refuse, cancellable=False)
        self._panel = PeoplePanel(name)
        self.open_changed = self._panel.open_changed
        self._error = label(kind="error", name=f"{name}_error_label", wrap=True)
        self._button = button(f"{name}_button", "window.release_button", self._ask, tip="window.release_tip")
        self.open_changed.connect(lambda asking: self._button.setVisible(not asking))
        self._panel.cancelled.connect(lambda: show_text(self._error, ""))
        column(row(self._button, None), self._panel, self._error, on=self)
        self.hide()

    def offer(self, result: Result | None, path: Path | None) -> None:
        """Show the bar if the unit of a result file has failed and has not been released."""
        if path != self._path:
            self._opening.cancel()
            self._panel.hide()
            show_text(self._error, "")
        self._path = path
        self._serial = "" if result is None else result.serial
        self.setVisible(result is not None and path is not None and result.outcome == "failed" and not result.released)

    def _ask(self) -> None:
        show_text(self._error, "")
        self._opening.start(self._path)

    def _open(self, required: ConfirmationRequired) -> None:
        by = (self._app.badge if required.badge else self._app.person) or ""
        self._panel.ask(Text.of("window.ask_release", serial=self._serial), required, self._release, by=by)

    def _release(self, reason: str, first: Person, second: Person | None) -> None:
        show_text(self._error, "")
        if not self._releasing.busy:
            self._releasing.start(self._path, reason, first, second)

    def _released(self, _: object) -> None:
        self._panel.hide()
        self.hide()
        self._app.result_changed.emit(self._path)

    def _refuse(self, error: CalstationError) -> None:
        if self._panel.isHidden():
            show_text(self._error, say(error.as_text))
        else:
            self._panel.retry(error)
