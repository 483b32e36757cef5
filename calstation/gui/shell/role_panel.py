"""Panel below the padlock in which the engineer's PIN is entered or first set, with keys for touch."""

from PySide6.QtCore import Qt, QTimer
from PySide6.QtWidgets import (
    QFrame,
    QGridLayout,
    QLineEdit,
    QPushButton,
    QWidget,
)

from calstation.errors import ConfigurationError
from calstation.gui.shell.role import RoleLock
from calstation.gui.text import bind, error_text, on_language_change
from calstation.gui.widgets import button, column, label, row, theme

#: Interval at which the time to wait is updated, ms.
_TICK = 250


class RolePanel(QFrame):
    """Hidden until it is wanted; closes when the engineer is unlocked."""

    def __init__(self, role: RoleLock, parent: QWidget) -> None:
        super().__init__(parent)
        self.setProperty("kind", "panel")
        self.setAutoFillBackground(True)
        self._role = role
        self._wrong = ""
        self._title, self._text = label(kind="section"), label(wrap=True)
        self._error = label(kind="error", wrap=True)
        self.pin_edit, self._again_edit = QLineEdit(), QLineEdit()
        self.pin_edit.setObjectName("pin_edit")
        self._again_edit.setObjectName("pin_again_edit")
        for edit in (self.pin_edit, self._again_edit):
            edit.setEchoMode(QLineEdit.EchoMode.Password)
            edit.setFont(theme.font(theme.SECTION))
            edit.setProperty("kind", "tall")
            edit.returnPressed.connect(self._enter)
            edit.textEdited.connect(lambda _: self._show_error(""))
        self._unlock = button("unlock_button", pressed=self._enter, kind="primary")
        cancel = button("", lambda: self.tr("Cancel"), self.hide)
        column(
            *(self._title, self._text, self.pin_edit, self._again_edit, self._error, self._keys()),
            row((self._unlock, 1), (cancel, 1)),
            on=self,
            margins=(2 * theme.GRID,) * 4,
        )
        self.setFixedWidth(42 * theme.GRID)
        self._timer = QTimer(self)
        self._timer.setInterval(_TICK)
        self._timer.timeout.connect(self._count_down)
        role.wanted.connect(self.open)
        bind(self._again_edit.setPlaceholderText, lambda: self.tr("the same again"))
        on_language_change(self, self._refresh)
        self.hide()

    def open(self) -> None:
        """Ask for the PIN."""
        self.pin_edit.clear()
        self._again_edit.clear()
        self._show_error("")
        self._refresh()
        self.show()
        self.raise_()
        self.pin_edit.setFocus()
        self._count_down()

    def _refresh(self) -> None:
        new = self._role.new
        self._again_edit.setVisible(new)
        self._title.setText(self.tr("Choose the engineer's PIN") if new else self.tr("Engineer"))
        self._text.setText(
            self.tr("No PIN has been set here yet. At least four characters; it opens what changes results.")
            if new
            else self.tr("The PIN opens settings that change results, and registers.")
        )
        self.pin_edit.setPlaceholderText(self.tr("new PIN") if new else self.tr("PIN"))
        self._unlock.setText(self.tr("Set PIN") if new else self.tr("Unlock"))
        self.adjustSize()

    def _keys(self) -> QGridLayout:
        grid = QGridLayout()
        grid.setSpacing(theme.GRID)
        for index, text in enumerate("123456789"):
            grid.addWidget(self._key(text), index // 3, index % 3)
        grid.addWidget(self._key("0"), 3, 1)
        back = QPushButton("⌫")
        back.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        back.clicked.connect(lambda: self._field().backspace())
        grid.addWidget(back, 3, 2)
        return grid

    def _key(self, digit: str) -> QPushButton:
        key = QPushButton(digit)
        key.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        key.clicked.connect(lambda: self._field().insert(digit))
        return key

    def _field(self) -> QLineEdit:
        """The field that the keys write to."""
        return self._again_edit if self._again_edit.hasFocus() else self.pin_edit

    def _enter(self) -> None:
        try:
            if self._role.new:
                self._set_first()
            elif self._role.unlock(self.pin_edit.text()):
                self.hide()
            else:
                self._show_error(self.tr("The PIN is wrong."))
                self.pin_edit.selectAll()
        except ConfigurationError as error:
            self._show_error(error_text(error).sentences)
        self._count_down()

    def _set_first(self) -> None:
        if self._again_edit.text() != self.pin_edit.text():
            self._show_error(self.tr("The two PINs differ."))
            self._again_edit.setFocus()
            return
        self._role.set_first_pin(self.pin_edit.text())
        self.hide()

    def _show_error(self, text: str) -> None:
        self._wrong = text
        self._error.setText(text)
        self._error.setVisible(bool(text))
        self.adjustSize()

    def _count_down(self) -> None:
        """Disable Unlock while the next try has to wait after wrong PINs."""
        wait = 0.0 if self._role.new else self._role.wait
        self._unlock.setEnabled(wait <= 0.0)
        if wait > 0.0:
            seconds = self.tr("Wait {seconds:.0f} s.").format(seconds=max(1.0, wait))
            self._error.setText(f"{self._wrong} {seconds}".strip())
            self._error.setVisible(True)
            self._timer.start()
        else:
            self._timer.stop()
            self._error.setText(self._wrong)
            self._error.setVisible(bool(self._wrong))
        self.adjustSize()
