"""The engineer page's part of the strip beside STOP: unit, engineer, START, and how the run is doing."""

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QLineEdit, QVBoxLayout, QWidget

from calstation.gui.shell import RunStatus, RunStrip
from calstation.gui.text import bind
from calstation.gui.widgets import Words, button, column, enable, label, row, theme


class EngineerHeader(QWidget):
    """Emits `start_pressed`, and `edited` with every key."""

    start_pressed = Signal()
    edited = Signal()

    def __init__(self, run: RunStatus) -> None:
        super().__init__()
        self.serial_edit, self.engineer_edit = QLineEdit(), QLineEdit()
        serial = self._captioned(self.serial_edit, "engineer_serial_edit", lambda: self.tr("Serial number"))
        engineer = self._captioned(self.engineer_edit, "engineer_name_edit", lambda: self.tr("Your name"))
        self.serial_edit.setFixedWidth(24 * theme.GRID)
        self.serial_edit.setMaxLength(80)
        bind(self.serial_edit.setPlaceholderText, lambda: self.tr("scan or type"))
        self.engineer_edit.setFixedWidth(25 * theme.GRID)
        self.engineer_edit.setMaxLength(40)
        bind(self.engineer_edit.setPlaceholderText, lambda: self.tr("your name, for the record"))
        self._start_button = button(
            "engineer_start_button", lambda: self.tr("START"), self.start_pressed, kind="primary"
        )
        self._start_button.setFixedHeight(theme.BIG_BUTTON)
        self._start_button.setMinimumWidth(22 * theme.GRID)
        self._start_button.setFont(theme.font(theme.SECTION, bold=True))
        row(serial, engineer, self._start_button, (RunStrip(run), 1), on=self, spacing=2 * theme.GRID)

    @property
    def serial(self) -> str:
        """The serial number typed."""
        return self.serial_edit.text().strip()

    @property
    def engineer(self) -> str:
        """The name typed."""
        return self.engineer_edit.text().strip()

    def lock(self, why: str) -> None:
        """Disable serial number and name with a reason; "" enables them."""
        for edit in (self.serial_edit, self.engineer_edit):
            enable(edit, why)

    def set_why_no_start(self, why: str) -> None:
        """Disable START with a reason; "" enables it."""
        enable(self._start_button, why)

    def _captioned(self, edit: QLineEdit, name: str, words: Words) -> QVBoxLayout:
        edit.setObjectName(name)
        edit.setFixedHeight(theme.BUTTON)
        edit.textChanged.connect(lambda _: self.edited.emit())
        caption = label(words)
        caption.setBuddy(edit)
        return column(caption, edit, spacing=0)
