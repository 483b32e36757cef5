"""The role of the user, and the panel in which the engineer's PIN is set or entered."""

import re
from collections.abc import Callable
from typing import TYPE_CHECKING, cast

from PySide6.QtCore import QCoreApplication, QEvent, QObject, Qt, QTimer, Signal
from PySide6.QtGui import QHideEvent
from PySide6.QtWidgets import QFrame, QGridLayout, QLineEdit, QPushButton, QWidget

from calstation.config import Confirmation, RunRequest, access
from calstation.errors import CalstationError, ConfigurationError
from calstation.gui.text import bind, on_language_change, say
from calstation.gui.widgets import button, column, grid, label, row, show_text, theme
from calstation.runs import run_summary

if TYPE_CHECKING:
    from calstation.gui.state.context import AppContext

#: Time without a key press, click or touch after which the engineer role is locked, min.
_IDLE_MINUTES = 15
_ACTIVITY = (QEvent.Type.KeyPress, QEvent.Type.MouseButtonPress, QEvent.Type.Wheel, QEvent.Type.TouchBegin)


class RoleLock(QObject):
    """The current role, which is operator at the start.

    The engineer role is locked when the person signs out, and after an idle time unless `busy` returns True.
    """

    changed = Signal(str)
    pin_requested = Signal()  #: Emitted by `ask`.

    def __init__(self, parent: QObject | None = None, busy: Callable[[], bool] = lambda: False) -> None:
        super().__init__(parent)
        self.role = "operator"
        self.person = ""  #: Name of the person who unlocked the engineer role.
        self.badge = ""  #: Badge whose personal PIN unlocked the engineer role; "" for the PIN of the site.
        self._busy = busy
        self._idle = QTimer(self, singleShot=True, interval=60_000 * _IDLE_MINUTES)
        self._idle.timeout.connect(self._lock_idle)

    @property
    def engineer(self) -> bool:
        """Whether the user may edit settings that affect results."""
        return self.role == "engineer"

    @property
    def new(self) -> bool:
        """Whether no PIN has been set; the first user sets it."""
        return not access.has_pin()

    def ask(self) -> None:
        """Ask the user for the PIN."""
        self.pin_requested.emit()

    def unlock(self, pin: str, person: str = "", badge: str = "") -> bool:
        """Switch to the engineer role for a person and return True if `pin` is that of an engineer's badge or the site.

        Raises ConfigurationError if the PIN file cannot be read.
        """
        owner = access.identify(pin, badge)
        if owner is None:
            return False
        self._set("engineer", person, badge if owner == "personal" else "")
        return True

    def set_first_pin(self, pin: str, person: str = "", recorded: str = "") -> None:
        """Set the first PIN and switch to the engineer role for a person, whom the audit trail names as `recorded`.

        Raises ConfigurationError if the PIN is not allowed or cannot be stored.
        """
        access.set_pin("", pin, author=Confirmation(recorded or person) if recorded or person else None)
        self._set("engineer", person)

    def lock(self) -> None:
        """Switch to the operator role."""
        self._set("operator")

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Restart the idle time on a key press, click or touch."""
        if event.type() in _ACTIVITY:
            self._idle.start()
        return super().eventFilter(watched, event)

    def _lock_idle(self) -> None:
        if self._busy():
            self._idle.start()
        else:
            self.lock()

    def _set(self, role: str, person: str = "", badge: str = "") -> None:
        self.person, self.badge = person, badge
        if role == self.role:
            return
        self.role = role
        application = cast("QCoreApplication", QCoreApplication.instance())
        if self.engineer:
            application.installEventFilter(self)
            self._idle.start()
        else:
            application.removeEventFilter(self)
            self._idle.stop()
        self.changed.emit(role)


class RolePanel(QFrame):
    """Panel with a touch keypad that asks for a person and the PIN, and closes when the engineer role is unlocked.

    The signal `closed` is emitted when the panel has been closed or cancelled.
    """

    closed = Signal()

    def __init__(self, app: "AppContext", parent: QWidget) -> None:
        super().__init__(parent)
        self._app, role = app, app.role
        self.setProperty("kind", "panel")
        self.setAutoFillBackground(True)
        self._role = role
        self._error_text = ""
        self._signed_in = ""  #: Name or badge of the person who was signed in by unlocking the engineer role.
        self._title, self._text = label(kind="section"), label(wrap=True)
        self._error = label(kind="error", wrap=True)
        self._person_edit, self.pin_edit, self._again_edit = QLineEdit(), QLineEdit(), QLineEdit()
        self._person_edit.setObjectName("role_person_edit")
        self._person_edit.setMaxLength(40)
        self._person_edit.setProperty("kind", "tall")
        self._person_edit.returnPressed.connect(self._person_entered)
        for edit, name in ((self.pin_edit, "pin_edit"), (self._again_edit, "pin_again_edit")):
            edit.setObjectName(name)
            edit.setEchoMode(QLineEdit.EchoMode.Password)
            edit.setFont(theme.font(theme.SECTION))
            edit.setProperty("kind", "tall")
            edit.returnPressed.connect(self._pressed_enter)
            edit.textEdited.connect(lambda _: self._show_error(""))
        self._unlock = button("unlock_button", pressed=self._enter, kind="primary")
        cancel = button("", "common.cancel", self.hide)
        column(
            *(self._title, self._text, self._person_edit, self.pin_edit, self._again_edit, self._error, self._keys()),
            row((self._unlock, 1), (cancel, 1)),
            on=self,
            margins=(2 * theme.GRID,) * 4,
        )
        self.setFixedWidth(42 * theme.GRID)
        self._timer = QTimer(self, interval=250)
        self._timer.timeout.connect(self._show_wait)
        role.pin_requested.connect(self.open)
        role.changed.connect(self._role_changed)
        bind(self._again_edit.setPlaceholderText, "window.same_again")
        on_language_change(self, self._refresh)
        self.hide()

    def open(self) -> None:
        """Open the panel and ask for the PIN."""
        self.pin_edit.clear()
        self._again_edit.clear()
        self._error_text = ""
        self._person_edit.setText(self._app.badge or self._app.person)
        self._refresh()
        self.show()
        self.raise_()
        (self.pin_edit if self._person_edit.text() else self._person_edit).setFocus()
        self._show_wait()

    def hideEvent(self, event: QHideEvent) -> None:
        """Report that the panel has been closed, but not that the whole window is hidden."""
        super().hideEvent(event)
        if self.isHidden():
            self.closed.emit()

    def _refresh(self) -> None:
        new = self._role.new
        self._again_edit.setVisible(new)
        self._title.setText(say("window.choose_pin" if new else "window.engineer"))
        about = "window.about_choosing_pin" if new else "window.about_pin"
        self._text.setText(say(about, least=access.MIN_PIN_LENGTH))
        hint = say("operator.scan_badge" if self._badges else "window.your_name")
        self._person_edit.setPlaceholderText(hint)
        self._person_edit.setAccessibleName(hint)
        self.pin_edit.setPlaceholderText(say("window.new_pin" if new else "window.pin"))
        self._unlock.setText(say("window.set_pin" if new else "window.unlock"))
        self.adjustSize()

    def _keys(self) -> QGridLayout:
        keys = grid()
        for index, text in enumerate(("1", "2", "3", "4", "5", "6", "7", "8", "9", "", "0", "⌫")):
            if text:
                key = QPushButton(text)
                key.setFocusPolicy(Qt.FocusPolicy.NoFocus)
                key.clicked.connect(lambda _, text=text: self._type(text))
                keys.addWidget(key, index // 3, index % 3)
        return keys

    def _type(self, text: str) -> None:
        """Enter a key of the keypad into the repeated PIN if its field has the focus, otherwise into the PIN."""
        field = self._again_edit if self._again_edit.hasFocus() else self.pin_edit
        if text == "⌫":
            field.backspace()
        else:
            field.insert(text)

    def _person_entered(self) -> None:
        """Go on to the PIN, unless the name is the serial number of a unit that was scanned into the wrong field."""
        if self._is_serial(self._person_edit.text().strip()):
            self._person_edit.clear()
            self._show_error(say("window.serial_as_name"))
        else:
            self._show_error("")
            self.pin_edit.setFocus()

    def _is_serial(self, text: str) -> bool:
        """Return whether a text contains a digit, matches the product's serial numbers, and is not a badge."""
        try:
            summary = run_summary(RunRequest("-", self._app.station_path, self._app.product_path))
        except CalstationError:
            return False
        sign_in = summary.sign_in
        badge = sign_in is not None and (text in sign_in.names or sign_in.is_badge(text))
        digits = any(character.isdigit() for character in text)
        return digits and not badge and re.fullmatch(summary.serial_pattern, text) is not None

    def _pressed_enter(self) -> None:
        """Confirm the PIN; only the button confirms a new PIN, because scanners also send Enter."""
        if not self._role.new:
            self._enter()
        elif self.pin_edit.hasFocus():
            self._again_edit.setFocus()
        else:
            self._unlock.setFocus()

    def _enter(self) -> None:
        pin, again, person = self.pin_edit.text(), self._again_edit.text(), self._person_edit.text().strip()
        try:
            name = self._app.name_of(person) if person else ""
            if not name:
                self._show_error(say("operator.sign_in" if self._badges else "window.no_person"))
                self._person_edit.setFocus()
            elif self._role.new and pin in (person, name):
                self._show_error(say("window.pin_is_name"))
                self.pin_edit.setFocus()
            elif self._role.new and again != pin:
                self._show_error(say("window.pins_differ"))
                self._again_edit.setFocus()
            elif self._role.new:
                self._role.set_first_pin(pin, name, self._app.recorded(person))
                self._accept(person)
            elif self._role.unlock(pin, name, self._app.engineer_badge(person)):
                self._accept(person)
            else:
                self._show_error(say("window.wrong_pin"))
                self.pin_edit.selectAll()
        except ConfigurationError as error:
            self._show_error(say(error.as_text))

    def _accept(self, person: str) -> None:
        """Close the panel, and sign in the person who unlocked the role."""
        self.hide()
        if person not in (self._app.badge, self._app.person if self._app.operator else None):
            self._app.identified.emit(person)
            self._signed_in = person

    def _role_changed(self, role: str) -> None:
        """When the engineer role is locked, sign out the person who was signed in by unlocking it."""
        person, self._signed_in = self._signed_in, "" if role == "operator" else self._signed_in
        if role == "operator" and person and person in (self._app.badge, self._app.operator):
            self._app.identified.emit("")

    @property
    def _badges(self) -> bool:
        """Whether the station accepts only badges."""
        return self._app.badge is not None or self._app.badge_required

    def _show_error(self, text: str) -> None:
        self._error_text = text
        self._show_wait()

    def _show_wait(self) -> None:
        """Show the error, and disable Unlock during the delay after wrong PINs."""
        wait = 0.0
        try:
            wait = access.identify_wait(self._app.engineer_badge(self._person_edit.text().strip()))
        except ConfigurationError as error:
            self._error_text = say(error.as_text)
        waiting = say("window.wait", seconds=max(1.0, wait)) if wait > 0.0 else ""
        text = f"{self._error_text} {waiting}".strip()
        self._unlock.setEnabled(not waiting)
        show_text(self._error, text)
        self.adjustSize()
        if waiting:
            self._timer.start()
        else:
            self._timer.stop()
