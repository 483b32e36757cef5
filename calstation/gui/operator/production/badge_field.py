"""Field for the operator: an optional name or, if the station requires sign-in, a badge."""

from typing import cast

from PySide6.QtCore import QCoreApplication, QEvent, QObject, QTimer, Signal
from PySide6.QtWidgets import QApplication, QWidget

from calstation.config import SignInSection
from calstation.errors import ConfigurationError
from calstation.gui.text import bind, say
from calstation.gui.widgets import ScanEdit, button, column, enable, label, row, theme

#: Events that restart the idle timeout.
_ACTIVITY = (QEvent.Type.KeyPress, QEvent.Type.MouseButtonPress, QEvent.Type.TouchBegin)

#: Minimum width of the field with the sign-out button, px.
_MIN_WIDTH = 28 * theme.GRID


class BadgeField(QWidget):
    """The field for the person at the window, who signs in with a badge if the station has a `SignInSection`.

    The person is signed out by a button or after an idle timeout. Signals: `entered()` on Enter in the field if no
    badge is required; `named()` after a change of the name at a station without badges; `signed_in()` and
    `signed_out()`; `refused(error)` if a badge is not accepted.
    """

    entered = Signal()
    named = Signal()
    signed_in = Signal()
    signed_out = Signal()
    refused = Signal(object)

    def __init__(self) -> None:
        super().__init__()
        self.edit = ScanEdit("operator_edit", longest=40)
        self.edit.setProperty("kind", "tall")
        self._section: SignInSection | None = None
        self._badge = ""
        self._locked = False
        #: Whether the last operator was signed out by the idle timeout.
        self.signed_out_idle = False
        self._idle = QTimer(self, singleShot=True)
        self._idle.timeout.connect(self._sign_out_idle)
        self._application = cast("QCoreApplication", QApplication.instance())
        self.sign_out_button = button("sign_out_button", "operator.sign_out", lambda: self.sign_out())
        self.sign_out_button.hide()
        caption = label("common.operator", buddy=self.edit)
        caption.setFixedHeight(theme.BIG_BUTTON - theme.BUTTON)  # Chinese characters are taller
        column(caption, row((self.edit, 1), self.sign_out_button), on=self, spacing=0)
        self.edit.returnPressed.connect(self._entered)
        self.edit.textChanged.connect(self._text_changed)
        bind(self.edit.setPlaceholderText, self._placeholder)

    @property
    def section(self) -> SignInSection | None:
        """Settings of the sign-in at the station; None if no badges are required."""
        return self._section

    @property
    def required(self) -> bool:
        """Whether an operator must sign in before a run."""
        return self._section is not None and not self._badge

    @property
    def operator(self) -> str | None:
        """The operator for a request: the badge or, without sign-in, the entered name; None without either."""
        return (self.edit.text().strip() if self._section is None else self._badge) or None

    @property
    def name(self) -> str | None:
        """The operator for a record: the name of the signed-in operator or, without sign-in, `operator`."""
        return self.operator if self._section is None else self.edit.text() if self._badge else None

    def set_section(self, section: SignInSection | None) -> None:
        """Set the sign-in settings, and sign out the operator if they differ from the current ones."""
        if section != self._section:
            self._section = section
            self.setMinimumWidth(0 if section is None else _MIN_WIDTH)
            self.edit.clear()
            self.sign_out()
            self.edit.setPlaceholderText(self._placeholder())

    def identify(self, entered: str) -> None:
        """Sign in the operator with a badge or, at a station without badges, show a name.

        If `entered` is "", sign out the operator or clear the name, unless the field is locked.
        """
        if not entered and self._locked:
            return
        if self._section is None:
            self.edit.setText(entered)
        elif entered:
            self.sign_in(entered)
        else:
            self.sign_out()

    def sign_in(self, badge: str) -> None:
        """Sign in the operator with a badge in place of the previous operator."""
        if self._section is None:
            return
        try:
            name = self._section.operator(badge)
        except ConfigurationError as error:
            self.edit.selectAll()
            self.refused.emit(error)
            return
        self._badge = badge
        self.edit.setText(name)
        self._show()
        if self._section.idle_minutes is not None:
            self._application.installEventFilter(self)
            self._idle.start(round(60_000 * self._section.idle_minutes))
        self.signed_in.emit()

    def sign_out(self, *, idle: bool = False) -> None:
        """Sign out the operator, by the idle timeout if `idle`."""
        if self._badge:
            self._badge, self.signed_out_idle = "", idle
            self.edit.clear()
            self._idle.stop()
            self._application.removeEventFilter(self)
        self._show()
        self.signed_out.emit()

    def lock(self, reason: str) -> None:
        """Lock the field, and suspend the idle timeout, for the given reason; "" unlocks the field."""
        for widget in (self.edit, self.sign_out_button):
            enable(widget, reason)
        self._locked = bool(reason)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Restart the idle timeout on a key press, click or touch."""
        if event.type() in _ACTIVITY:
            self._idle.start()
        return super().eventFilter(watched, event)

    def _sign_out_idle(self) -> None:
        if self._locked:
            self._idle.start()
        else:
            self.sign_out(idle=True)

    def _text_changed(self) -> None:
        if self._section is None:
            self.named.emit()

    def _entered(self) -> None:
        if self._section is None or self._badge:
            self.entered.emit()
        else:
            self.sign_in(self.edit.text().strip())

    def _placeholder(self) -> str:
        return say("operator.name_or_badge" if self._section is None else "operator.scan_badge")

    def _show(self) -> None:
        self.edit.setReadOnly(bool(self._badge))
        self.sign_out_button.setVisible(bool(self._badge))
