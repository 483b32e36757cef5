"""Header of the engineer page in the strip next to STOP: serial number, engineer, START and status of the run."""

from PySide6.QtCore import QSignalBlocker, Signal
from PySide6.QtWidgets import QWidget

from calstation.gui.state import EndStageButton, PauseButton, RunStatus, RunStrip
from calstation.gui.text import bind, on_language_change, say
from calstation.gui.widgets import ScanEdit, button, column, enable, label, line_edit, row, theme


class EngineerHeader(QWidget):
    """Fields for the serial number and the engineer, the START button and the status of the run.

    Signals: `start_pressed()`; `edited()` when a text changes; `serial_entered()` on Enter in the serial field, which
    scanners also send.
    """

    start_pressed = Signal()
    edited = Signal()
    serial_entered = Signal()

    def __init__(self, run: RunStatus) -> None:
        super().__init__()
        self._next_unit, self._partial, self._slot = False, False, ""
        self.serial_edit = ScanEdit("engineer_serial_edit")
        self.serial_edit.setFixedWidth(24 * theme.GRID)
        bind(self.serial_edit.setPlaceholderText, "engineer.scan_or_type")
        self.engineer_edit = line_edit(
            "engineer_name_edit", width=20 * theme.GRID, longest=40, hint="engineer.name_hint"
        )
        self.serial_edit.returnPressed.connect(self.serial_entered)
        for edit in (self.serial_edit, self.engineer_edit):
            edit.setFixedHeight(theme.BUTTON)
            edit.textChanged.connect(lambda _: self.edited.emit())
        self._serial_caption = label(self._serial_text, buddy=self.serial_edit)
        serial = column(self._serial_caption, self.serial_edit, spacing=0)
        caption = label("engineer.your_name", buddy=self.engineer_edit)
        engineer = column(caption, self.engineer_edit, spacing=0)
        self.start_button = button("engineer_start_button", pressed=self.start_pressed, kind="primary")
        self.start_button.setFixedHeight(theme.BIG_BUTTON)
        self.start_button.setMinimumWidth(22 * theme.GRID)
        self.start_button.setFont(theme.font(theme.SECTION, bold=True))
        end_button = EndStageButton(run, "engineer_end_stage_button", self)
        pause_button = PauseButton(run, "engineer_pause_button")
        pause_button.setFixedSize(12 * theme.GRID, theme.BIG_BUTTON)
        self._strip = RunStrip(run)
        row(
            serial,
            engineer,
            self.start_button,
            (self._strip, 1),
            end_button,
            pause_button,
            on=self,
            spacing=2 * theme.GRID,
        )
        on_language_change(self, self._show_start)

    def show_partial(self, *, partial: bool) -> None:
        """Show on START whether the next run is partial."""
        if partial != self._partial:
            self._partial = partial
            theme.set_kind(self.start_button, "partial" if partial else "primary")
            self._show_start()

    def show_next_run(self, why_not: str, overdue: str, writes: str) -> None:
        """Enable START, and show next to it why the next run cannot start, what is overdue, or what the run writes."""
        enable(self.start_button, why_not)
        self._strip.show_idle(why_not or overdue or writes, ready=not (why_not or overdue))

    @property
    def serial(self) -> str:
        """The entered serial number."""
        return self.serial_edit.text().strip()

    def show_person(self, name: str, *, signed_in: bool) -> None:
        """Show the name of the user, which cannot be edited if users sign in with badges."""
        if name != self.engineer_edit.text().strip() and not self.engineer_edit.hasFocus():
            with QSignalBlocker(self.engineer_edit):
                self.engineer_edit.setText(name)
        self.engineer_edit.setReadOnly(signed_in)

    def _show_start(self) -> None:
        self.start_button.setText(say("common.start_partial" if self._partial else "common.start"))

    def show_next(self, next_unit: bool, slot: str) -> None:
        """Show whether the field is for the next unit, and the slot for the next scan ("" for none)."""
        if (next_unit, slot) != (self._next_unit, self._slot):
            self._next_unit, self._slot = next_unit, slot
            self._serial_caption.setText(self._serial_text())

    def _serial_text(self) -> str:
        caption = say("engineer.next_serial" if self._next_unit else "common.serial_number")
        if not self._slot or self._next_unit:
            return caption
        return say("common.named", name=caption, text=say("operator.slot", slot=self._slot))
