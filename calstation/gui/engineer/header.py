"""Header of the engineer page, in the strip next to STOP: serial number, engineer's name, START and run status."""

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QLabel, QLineEdit, QVBoxLayout, QWidget

from calstation.gui.state import EndStageButton, RunStatus, RunStrip
from calstation.gui.text import bind, on_language_change, say
from calstation.gui.widgets import button, column, label, row, theme


class EngineerHeader(QWidget):
    """The fields, START and the run status; emits `start_pressed`, and `edited` on every text change."""

    start_pressed = Signal()
    edited = Signal()

    def __init__(self, run: RunStatus) -> None:
        super().__init__()
        self.serial_edit, self.engineer_edit = QLineEdit(), QLineEdit()
        self._next = False
        self._serial_caption = label(self._serial_text, buddy=self.serial_edit)
        serial = self._captioned(self.serial_edit, "engineer_serial_edit", self._serial_caption)
        name = label("engineer.your_name", buddy=self.engineer_edit)
        engineer = self._captioned(self.engineer_edit, "engineer_name_edit", name)
        self.serial_edit.setFixedWidth(24 * theme.GRID)
        self.serial_edit.setMaxLength(80)
        bind(self.serial_edit.setPlaceholderText, "engineer.scan_or_type")
        self.engineer_edit.setFixedWidth(25 * theme.GRID)
        self.engineer_edit.setMaxLength(40)
        bind(self.engineer_edit.setPlaceholderText, "engineer.name_tip")
        self._partial = False
        self.start_button = button("engineer_start_button", pressed=self.start_pressed, kind="primary")
        self.start_button.setFixedHeight(theme.BIG_BUTTON)
        self.start_button.setMinimumWidth(22 * theme.GRID)
        self.start_button.setFont(theme.font(theme.SECTION, bold=True))
        end_button = EndStageButton(run, "engineer_end_stage_button")
        row(serial, engineer, self.start_button, (RunStrip(run), 1), end_button, on=self, spacing=2 * theme.GRID)
        on_language_change(self, self._show_start)

    def show_partial(self, *, partial: bool) -> None:
        """Mark on START whether the next run is partial."""
        if partial != self._partial:
            self._partial = partial
            theme.set_kind(self.start_button, "partial" if partial else "primary")
            self._show_start()

    @property
    def serial(self) -> str:
        """The entered serial number."""
        return self.serial_edit.text().strip()

    @property
    def engineer(self) -> str:
        """The entered name of the engineer."""
        return self.engineer_edit.text().strip()

    def _show_start(self) -> None:
        self.start_button.setText(say("common.start_partial" if self._partial else "engineer.start"))

    def show_next(self, following: bool) -> None:
        """Show whether the serial number belongs to the next unit instead of the one whose verdict is shown."""
        if following != self._next:
            self._next = following
            self._serial_caption.setText(self._serial_text())

    def _serial_text(self) -> str:
        return say("engineer.next_serial" if self._next else "common.serial_number")

    def _captioned(self, edit: QLineEdit, name: str, caption: QLabel) -> QVBoxLayout:
        edit.setObjectName(name)
        edit.setFixedHeight(theme.BUTTON)
        edit.textChanged.connect(lambda _: self.edited.emit())
        return column(caption, edit, spacing=0)
