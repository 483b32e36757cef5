"""Inputs of a port: an address on the network, or a serial port typed or chosen among those found."""

from collections.abc import Sequence
from typing import Any

from PySide6.QtCore import QEvent, QSignalBlocker, Qt, Signal
from PySide6.QtWidgets import QComboBox, QHBoxLayout, QLabel, QLineEdit, QSizePolicy, QWidget

from calstation.connection.link_test import FoundPort
from calstation.gui.settings.inputs import StillBox, line_of
from calstation.gui.widgets import theme


def describe(port: FoundPort) -> str:
    """What a found port is: the adapter's own words, and what the system calls it now."""
    maker = "" if port.maker in port.description else port.maker
    about = ", ".join(filter(None, (port.description, maker)))
    return f"{about} · {port.device}" if about else port.device


class AddressEdit(QWidget):
    """Host and port number; the value is ``scheme://host:port``."""

    typed = Signal()

    def __init__(self, scheme: str, number: int) -> None:
        super().__init__()
        self._scheme, self._usual = scheme, number
        self.host = QLineEdit()
        self.number = QLineEdit()
        self.number.setFixedWidth(9 * theme.GRID)
        self.number.setAlignment(Qt.AlignmentFlag.AlignRight)
        self.number.setPlaceholderText(str(number))
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 0, 0, 0)
        row.setSpacing(theme.GRID // 2)
        row.addWidget(self.host, 1)
        row.addWidget(QLabel(":"))
        row.addWidget(self.number)
        self.setFocusProxy(self.host)
        for edit in (self.host, self.number):
            edit.textEdited.connect(self.typed)
        self.retranslate()

    def value(self) -> Any:
        """The address as typed; the usual port number where none is."""
        host, number = self.host.text().strip(), self.number.text().strip()
        return f"{self._scheme}://{host}:{number or self._usual}" if host or number else None

    def show_value(self, value: Any) -> None:
        """Show an address, unless it is as typed already."""
        if value == self.value():
            return
        host, _, number = str(value or "").partition("://")[2].rpartition(":")
        self.host.setText(host)
        self.number.setText(number)

    def retranslate(self) -> None:
        """Say everything again in the language in force."""
        self.host.setPlaceholderText(self.tr("name or IP address"))
        self.host.setAccessibleName(self.tr("host"))
        self.number.setAccessibleName(self.tr("port number"))

    def changeEvent(self, event: QEvent) -> None:
        """Hear of a new language."""
        if event.type() == QEvent.Type.LanguageChange:
            self.retranslate()
        super().changeEvent(event)


class PortBox(StillBox):
    """A serial port, typed or chosen; a USB adapter is chosen by its serial number, so it may be plugged anywhere."""

    typed = Signal()

    def __init__(self) -> None:
        super().__init__()
        self.setEditable(True)
        self.setInsertPolicy(QComboBox.InsertPolicy.NoInsert)
        self.setCompleter(None)  # type: ignore[arg-type]  # completing would choose a port that was not meant
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)
        self.ports: Sequence[FoundPort] = ()
        line_of(self).textEdited.connect(self.typed)
        self.activated.connect(self._chosen)
        self.view().setMinimumWidth(56 * theme.GRID)
        self.retranslate()

    def value(self) -> Any:
        """The port as typed or chosen."""
        return self.currentText().strip() or None

    def show_value(self, value: Any) -> None:
        """Show a port."""
        if value != self.value():
            self.setEditText(str(value or ""))

    def offer(self, ports: Sequence[FoundPort]) -> None:
        """Offer the ports found."""
        self.ports = ports
        typed = self.currentText()
        with QSignalBlocker(self):
            self.clear()
            for port in ports:
                if port.usb:
                    self.addItem(f"{port.usb}   {describe(port)}", port.usb)
                self.addItem(port.device if port.usb else describe(port), port.device)
            self.setCurrentIndex(-1)
            self.setEditText(typed)

    def about(self) -> str:
        """What the port shown is, as far as it was found; "" where it was not."""
        value = self.value()
        found = next((p for p in self.ports if value in (p.device, p.usb)), None)
        return describe(found) if found is not None else ""

    def retranslate(self) -> None:
        """Say everything again in the language in force."""
        line_of(self).setPlaceholderText(self.tr("choose or type a port"))

    def changeEvent(self, event: QEvent) -> None:
        """Hear of a new language."""
        if event.type() == QEvent.Type.LanguageChange:
            self.retranslate()
        super().changeEvent(event)

    def _chosen(self, index: int) -> None:
        self.setEditText(str(self.itemData(index)))
        self.typed.emit()
