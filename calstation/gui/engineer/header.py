"""Unit, engineer, START: the engineer page's part of the strip beside STOP, with how the run is doing."""

from PySide6.QtCore import QEvent, Signal
from PySide6.QtWidgets import QHBoxLayout, QLabel, QLineEdit, QPushButton, QVBoxLayout, QWidget

from calstation.gui.shell.run_status import RunStatus
from calstation.gui.shell.run_strip import RunStrip
from calstation.gui.widgets import theme


class EngineerHeader(QWidget):
    """What is started is the page's matter."""

    start_pressed = Signal()
    edited = Signal()

    def __init__(self, run: RunStatus, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.serial_edit, self.engineer_edit, self.start_button = QLineEdit(), QLineEdit(), QPushButton()
        self._captions = QLabel(), QLabel()
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 0, 0, 0)
        row.setSpacing(2 * theme.GRID)
        for edit, name, caption, width in (
            (self.serial_edit, "engineer_serial_edit", self._captions[0], 24),
            (self.engineer_edit, "engineer_name_edit", self._captions[1], 25),
        ):
            edit.setObjectName(name)
            edit.setFixedSize(width * theme.GRID, theme.BUTTON)
            edit.textChanged.connect(lambda _: self.edited.emit())
            caption.setBuddy(edit)
            column = QVBoxLayout()
            column.setSpacing(0)
            column.addWidget(caption)
            column.addWidget(edit)
            row.addLayout(column)
        self.engineer_edit.setMaxLength(40)
        self.serial_edit.setMaxLength(80)
        self.start_button.setObjectName("engineer_start_button")
        self.start_button.setProperty("kind", "primary")
        self.start_button.setFixedHeight(theme.BIG_BUTTON)
        self.start_button.setMinimumWidth(22 * theme.GRID)
        self.start_button.setFont(theme.font(theme.SECTION, bold=True))
        self.start_button.clicked.connect(self.start_pressed)
        row.addWidget(self.start_button)
        row.addWidget(RunStrip(run), 1)
        self.retranslate()

    @property
    def serial(self) -> str:
        """The number as it stands, without blanks around it."""
        return self.serial_edit.text().strip()

    @property
    def engineer(self) -> str:
        """Who is at it."""
        return self.engineer_edit.text().strip()

    def set_running(self, why: str) -> None:
        """While a run goes on nothing of it can be changed."""
        for edit in (self.serial_edit, self.engineer_edit):
            edit.setEnabled(not why)
            edit.setToolTip(why)

    def set_start(self, why_not: str) -> None:
        """START, with the reason where it cannot be pressed."""
        self.start_button.setEnabled(not why_not)
        self.start_button.setToolTip(why_not)

    def retranslate(self) -> None:
        """Say everything again in the language in force."""
        self._captions[0].setText(self.tr("Serial number"))
        self._captions[1].setText(self.tr("Your name"))
        self.serial_edit.setPlaceholderText(self.tr("scan or type"))
        self.engineer_edit.setPlaceholderText(self.tr("your name, for the record"))
        self.start_button.setText(self.tr("START"))

    def changeEvent(self, event: QEvent) -> None:
        """Hear of a new language."""
        if event.type() == QEvent.Type.LanguageChange:
            self.retranslate()
        super().changeEvent(event)
