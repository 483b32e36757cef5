"""Who, which unit, which product, START and Pause: the operator page's part of the strip beside STOP."""

import re
from pathlib import Path

from PySide6.QtCore import QEvent, QObject, Qt, Signal
from PySide6.QtGui import QKeyEvent
from PySide6.QtWidgets import (
    QApplication,
    QComboBox,
    QHBoxLayout,
    QLabel,
    QLineEdit,
    QPushButton,
    QVBoxLayout,
    QWidget,
)

from calstation.config.request import computer_user
from calstation.gui.widgets import theme


class RunHeader(QWidget):
    """The fields and buttons; what they mean is the page's matter.

    `serial_entered()` : Enter in the serial field, as a scanner sends it; `serial_edited()` : any change of it;
    `enter_refused()` : Enter on START, which starts nothing
    """

    serial_entered = Signal()
    serial_edited = Signal()
    enter_refused = Signal()
    start_pressed = Signal()
    pause_pressed = Signal()
    product_chosen = Signal(object)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.operator_edit, self.serial_edit, self.product_combo = QLineEdit(), QLineEdit(), QComboBox()
        self.start_button, self.pause_button = QPushButton(), QPushButton()
        self._captions = [QLabel(), QLabel(), QLabel()]
        self._serial_note = ""
        self._serial_wrong = False
        self._paused = False
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 0, 0, 0)
        row.setSpacing(2 * theme.GRID)
        for widget, name, caption, stretch in (
            (self.operator_edit, "operator_edit", self._captions[0], 2),
            (self.serial_edit, "serial_edit", self._captions[1], 4),
            (self.product_combo, "product_combo", self._captions[2], 3),
        ):
            widget.setObjectName(name)
            widget.setProperty("kind", "tall")
            caption.setBuddy(widget)
            column = QVBoxLayout()
            column.setSpacing(0)
            column.addWidget(caption)
            column.addWidget(widget)
            row.addLayout(column, stretch)
        self.serial_edit.setFont(theme.font(theme.SECTION, bold=True))
        self.operator_edit.setMaxLength(40)
        self.serial_edit.setMaxLength(80)
        self.product_combo.setMinimumWidth(16 * theme.GRID)
        self.start_button.setObjectName("start_button")
        self.start_button.setProperty("kind", "primary")
        self.start_button.setMinimumWidth(22 * theme.GRID)
        self.pause_button.setObjectName("pause_button")
        self.pause_button.setMinimumWidth(17 * theme.GRID)
        row.addWidget(self.start_button)
        row.addWidget(self.pause_button)
        self.operator_edit.returnPressed.connect(self.focus_serial)
        self.serial_edit.returnPressed.connect(self.serial_entered)
        self.serial_edit.textEdited.connect(lambda _: self.serial_edited.emit())
        self.start_button.clicked.connect(self.start_pressed)
        self.pause_button.clicked.connect(self.pause_pressed)
        self.product_combo.activated.connect(lambda _: self.product_chosen.emit(self.product))
        self.start_button.installEventFilter(self)
        self.guard(self.product_combo)
        self.retranslate()

    @property
    def serial(self) -> str:
        """The number as it stands, without blanks around it."""
        return self.serial_edit.text().strip()

    @property
    def operator(self) -> str | None:
        """The badge, or the computer's user where none was given."""
        return self.operator_edit.text().strip() or computer_user()

    @property
    def product(self) -> Path | None:
        """The product's file."""
        path = self.product_combo.currentData()
        return path if isinstance(path, Path) else None

    def fits(self, pattern: str) -> bool:
        """Whether the number fits a product's pattern."""
        return re.fullmatch(pattern, self.serial) is not None

    @property
    def products(self) -> list[tuple[str, Path]]:
        """The products that are offered, by name."""
        box = self.product_combo
        return [(box.itemText(i), box.itemData(i)) for i in range(box.count())]

    def set_products(self, products: list[tuple[str, Path]], chosen: Path | None) -> None:
        """Offer these products by name."""
        self.product_combo.clear()
        for name, path in products:
            self.product_combo.addItem(name, path)
            if path == chosen:
                self.product_combo.setCurrentIndex(self.product_combo.count() - 1)

    def show_product(self, path: Path) -> None:
        """Show a product as the chosen one."""
        for index in range(self.product_combo.count()):
            if self.product_combo.itemData(index) == path:
                self.product_combo.setCurrentIndex(index)

    def set_serial(self, text: str) -> None:
        """Fill in a number."""
        self.serial_edit.setText(text)
        self.note_serial("")

    def focus_serial(self) -> None:
        """Ready for the scanner: the next number takes the place of this one."""
        self.serial_edit.setFocus()
        self.serial_edit.selectAll()

    def note_serial(self, note: str, *, wrong: bool = False) -> None:
        """A word beside the field's caption; wrong ones in the colour and with the word of an error."""
        self._serial_note, self._serial_wrong = note, wrong
        theme.set_kind(self._captions[1], "error" if wrong else "")
        self._caption()

    def set_running(self, why: str) -> None:
        """While something goes on (`why`, "" for nothing) nothing of it can be changed."""
        for widget in (self.operator_edit, self.serial_edit, self.product_combo):
            widget.setEnabled(not why)
            widget.setToolTip(why)

    def set_start(self, why_not: str) -> None:
        """START, with the reason where it cannot be pressed."""
        self.start_button.setEnabled(not why_not)
        self.start_button.setToolTip(
            why_not or self.tr("Press Space or click; Enter does not start, scanners send it.")
        )

    def set_pause(self, paused: bool, why_not: str) -> None:
        """Pause or Resume, with the reason where it cannot be pressed."""
        self._paused = paused
        self.pause_button.setEnabled(not why_not)
        self.pause_button.setToolTip(why_not)
        self.pause_button.setText(self.tr("Resume") if paused else self.tr("Pause"))

    def retranslate(self) -> None:
        """Say everything again in the language in force."""
        self._captions[0].setText(self.tr("Operator"))
        self._captions[2].setText(self.tr("Product"))
        self.operator_edit.setPlaceholderText(self.tr("name or badge"))
        self.serial_edit.setPlaceholderText(self.tr("scan or type"))
        self.start_button.setText(self.tr("START"))
        self.set_pause(self._paused, self.pause_button.toolTip())
        self._caption()

    def guard(self, combo: QComboBox) -> None:
        """A scan must not choose anything in a list, open or closed."""
        combo.installEventFilter(self)
        combo.view().installEventFilter(self)

    def take_key(self, event: QKeyEvent) -> bool:
        """A character that no field has taken, wherever the focus is, is the first of a scan: the serial field's.

        False where it is none, or the page is not shown, or a run goes on.
        """
        text = event.text()
        if not text.strip() or not text.isprintable() or event.modifiers() & _COMMAND:
            return False
        if not (self.isVisible() and self.serial_edit.isEnabled()):
            return False
        popup = QApplication.activePopupWidget()
        if popup is not None:
            popup.close()
        self.serial_edit.setFocus()
        self.serial_edit.clear()
        self.serial_edit.insert(text)
        self.serial_edited.emit()
        return True

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Lists and START leave characters to the serial field; Enter never starts, hands may be inside."""
        if isinstance(event, QKeyEvent) and event.type() == QEvent.Type.KeyPress:
            if watched is self.start_button and event.key() in (Qt.Key.Key_Return, Qt.Key.Key_Enter):
                self.enter_refused.emit()
                return True
            if self.take_key(event):
                return True
        return super().eventFilter(watched, event)

    def _caption(self) -> None:
        caption = self.tr("Serial number")
        note = self._serial_note
        self._captions[1].setText(f"{caption}: {note}" if note else caption)


_COMMAND = Qt.KeyboardModifier.ControlModifier | Qt.KeyboardModifier.AltModifier
