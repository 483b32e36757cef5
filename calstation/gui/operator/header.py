"""Header of the operator page in the strip next to STOP: operator, serial number, product, START and Pause."""

from collections.abc import Mapping
from pathlib import Path
from typing import cast

from PySide6.QtCore import QEvent, QObject, Qt, QTimer, Signal
from PySide6.QtGui import QKeyEvent, QStandardItemModel
from PySide6.QtWidgets import QApplication, QComboBox, QLabel, QLineEdit, QVBoxLayout, QWidget

from calstation.gui.operator.production import BadgeField
from calstation.gui.state import PauseButton, RunStatus
from calstation.gui.text import bind, on_language_change, say
from calstation.gui.widgets import ScanEdit, StateIcon, button, column, enable, label, row, theme

#: Size of the symbol that shows in the serial field whether a scan was accepted, px.
_SYMBOL = 28

#: Time without a character after which a scan over an open list has ended, ms.
_SCAN_MS = 150

_COMMAND = Qt.KeyboardModifier.ControlModifier | Qt.KeyboardModifier.AltModifier


class ProductCombo(QComboBox):
    """A list of products; emits `opening` before it opens."""

    opening = Signal()

    def showPopup(self) -> None:
        """Open the list, wide enough for the longest entry."""
        self.opening.emit()
        self.view().setMinimumWidth(self.view().sizeHintForColumn(0) + 2 * theme.GRID)
        super().showPopup()


class RunHeader(QWidget):
    """Fields and buttons for a run.

    Signals: `serial_entered()` on Enter in the serial field, which scanners also send; `serial_edited()`;
    `start_pressed()`; `enter_refused()` when Enter on START is ignored; `scan_refused()` after a scan while the
    field is locked; `product_selected(path)`.
    """

    serial_entered = Signal()
    serial_edited = Signal()
    enter_refused = Signal()
    scan_refused = Signal()
    start_pressed = Signal()
    product_selected = Signal(object)

    def __init__(self, run: RunStatus) -> None:
        super().__init__()
        self.badge_field, self.serial_edit, self.product_combo = BadgeField(), ScanEdit("serial_edit"), ProductCombo()
        self.operator_edit = self.badge_field.edit
        self.start_button = button("start_button", pressed=self.start_pressed, kind="primary")
        self.pause_button = PauseButton(run, "pause_button")
        self._serial_caption = label()
        self._serial_note = ""
        self._symbol = StateIcon(_SYMBOL)
        self._symbol.setObjectName("serial_symbol")
        self._symbol.hide()
        self._partial = False
        self._products: list[tuple[str, Path]] = []
        #: Timer that is active while a scan arrives over an open list.
        self._scanning = QTimer(self, singleShot=True, interval=_SCAN_MS)
        self._scanning.timeout.connect(self._end_scan)
        row(
            (self.badge_field, 2),
            (_field(self.serial_edit, "serial_edit", self._serial_caption), 4),
            (_field(self.product_combo, "product_combo", label("common.product")), 3),
            self.start_button,
            self.pause_button,
            on=self,
            spacing=2 * theme.GRID,
        )
        self.serial_edit.setFont(theme.font(theme.SECTION, bold=True))
        self.serial_edit.setTextMargins(0, 0, _SYMBOL + theme.GRID, 0)
        row(None, self._symbol, on=self.serial_edit, margins=(0, 0, theme.GRID, 0))
        self.product_combo.setSizeAdjustPolicy(QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon)
        self.product_combo.setMinimumWidth(16 * theme.GRID)
        self.start_button.setMinimumWidth(22 * theme.GRID)
        self.pause_button.setMinimumWidth(17 * theme.GRID)
        self.badge_field.entered.connect(self.focus_scan)
        self.serial_edit.returnPressed.connect(self.serial_entered)
        self.serial_edit.textEdited.connect(lambda _: self.serial_edited.emit())
        self.product_combo.activated.connect(lambda _: self.product_selected.emit(self.product))
        self.start_button.installEventFilter(self)
        self.guard(self.product_combo)
        bind(self.serial_edit.setPlaceholderText, "operator.scan_or_type")
        on_language_change(self, self._show_texts)

    @property
    def serial(self) -> str:
        """The entered serial number without surrounding spaces."""
        return self.serial_edit.text().strip()

    @property
    def product(self) -> Path | None:
        """The file of the selected product, or None."""
        name = self.product_combo.currentData()
        return None if name is None else Path(name)

    def set_products(self, products: list[tuple[str, Path]], selected: Path | None) -> None:
        """List products, given by name and file, and select `selected`."""
        self._products = products
        self.product_combo.clear()
        for name, path in products:
            self.product_combo.addItem(name, str(path))
        self.show_product(selected)

    def mark_products(self, reasons: Mapping[Path, tuple[str, str]]) -> None:
        """Grey out the products that the station cannot calibrate, with a note and with an explanation as tooltip."""
        model = cast("QStandardItemModel", self.product_combo.model())
        for index, (name, path) in enumerate(self._products):
            note, explanation = reasons.get(path, ("", ""))
            self.product_combo.setItemText(index, say("common.noted", name=name, note=note) if note else name)
            self.product_combo.setItemData(index, explanation, Qt.ItemDataRole.ToolTipRole)
            model.item(index).setEnabled(not note)

    def show_product(self, path: Path | None) -> None:
        """Select a product if it is in the list."""
        index = self.product_combo.findData(str(path))
        if index >= 0:
            self.product_combo.setCurrentIndex(index)

    def set_serial(self, text: str) -> None:
        """Replace the serial number."""
        self.serial_edit.setText(text)
        self.note_serial("")

    def focus_scan(self) -> None:
        """Focus the field for the next scan, which is the badge field if a badge is required, and select its text."""
        field = self._scan_field
        field.setFocus()
        field.selectAll()

    @property
    def _scan_field(self) -> ScanEdit:
        return self.operator_edit if self.badge_field.required else self.serial_edit

    def note_serial(self, note: str, *, accepted: bool | None = None) -> None:
        """Show a note in the caption of the serial number, with a tick or a cross after a scan."""
        self._serial_note = note
        if accepted:
            self.serial_edit.keep()
        theme.set_kind(self._serial_caption, "error" if accepted is False else "")
        self._symbol.set_kind("good" if accepted else "bad")
        self._symbol.setVisible(accepted is not None)
        self._show_caption()

    def set_running(self, reason: str) -> None:
        """Lock the fields for the given reason; "" unlocks them."""
        self.badge_field.lock(reason)
        for widget in (self.serial_edit, self.product_combo):
            enable(widget, reason)

    def set_start(self, why_not: str) -> None:
        """Disable START for the given reason; "" enables it."""
        enable(self.start_button, why_not, say("operator.start_tip"))

    def show_partial(self, *, partial: bool) -> None:
        """Show on START whether the next run is partial."""
        if partial != self._partial:
            self._partial = partial
            theme.set_kind(self.start_button, "partial" if partial else "primary")
            self._show_texts()

    def guard(self, combo: QComboBox) -> None:
        """Prevent a scan from changing the selection of an open or closed combo box."""
        combo.installEventFilter(self)
        combo.view().installEventFilter(self)

    def handle_key(self, event: QKeyEvent) -> bool:
        """Enter a character that begins a scan into the field for the next scan, and return True.

        Return False for other keys, while the page is hidden, and during a run. Over an open list, all characters of
        a scan are handled, because closing the list at the first character would lose the next ones; during a run,
        they are discarded, because they would select an entry of the list.
        """
        in_list = QApplication.activePopupWidget() is not None and self.isVisible()
        if in_list and self._scanning.isActive() and event.key() in (Qt.Key.Key_Return, Qt.Key.Key_Enter):
            self._end_scan()
            self._enter()
            return True
        text = event.text()
        if not (text.strip() or self._scanning.isActive()) or not text.isprintable() or event.modifiers() & _COMMAND:
            return False
        field = self._scan_field
        if not (self.isVisible() and (field.isEnabled() or in_list)):
            return False
        if in_list and self._scanning.isActive():
            field.setText(field.text() + text if field.isEnabled() else field.text())
        elif field.isEnabled():
            field.begin(text)
        if in_list:
            self._scanning.start()
        else:
            field.setFocus()
        if field is self.serial_edit and field.isEnabled():
            self.serial_edited.emit()
        return True

    def enter_scan(self, text: str) -> None:
        """Enter a whole scan, as a scanner does."""
        if self._scan_field.isEnabled():
            self._scan_field.begin(text)
        self._enter()

    def _enter(self) -> None:
        """Report the scan in the field as entered or, while the field is locked, as refused."""
        (self._scan_field.returnPressed if self._scan_field.isEnabled() else self.scan_refused).emit()

    def _end_scan(self) -> None:
        """Close the list that was open while a scan arrived."""
        self._scanning.stop()
        popup = QApplication.activePopupWidget()
        if popup is not None:
            popup.close()
        self._scan_field.setFocus()

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Pass characters from lists and START to the field for the next scan, and ignore Enter on START."""
        if isinstance(event, QKeyEvent) and event.type() == QEvent.Type.KeyPress:
            if watched is self.start_button and event.key() in (Qt.Key.Key_Return, Qt.Key.Key_Enter):
                self.enter_refused.emit()
                return True
            if self.handle_key(event):
                return True
        return super().eventFilter(watched, event)

    def _show_texts(self) -> None:
        self.start_button.setText(say("common.start_partial" if self._partial else "common.start"))
        self._show_caption()

    def _show_caption(self) -> None:
        caption = say("common.serial_number")
        noted = say("common.named", name=caption, text=self._serial_note) if self._serial_note else caption
        self._serial_caption.setText(noted)


def _field(widget: QLineEdit | QComboBox, name: str, caption: QLabel) -> QVBoxLayout:
    widget.setObjectName(name)
    widget.setProperty("kind", "tall")
    caption.setBuddy(widget)
    caption.setFixedHeight(theme.BIG_BUTTON - theme.BUTTON)  # Chinese characters are taller
    return column(caption, widget, spacing=0)
