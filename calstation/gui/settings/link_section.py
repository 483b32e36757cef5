"""The link of one device: network or serial line, its settings, and the test beside them."""

from collections.abc import Sequence
from typing import Any

from PySide6.QtWidgets import QWidget

from calstation.config import LinkDefaults, StationConfig, imu_defaults, table_defaults
from calstation.connection import FoundPort, discover_ports
from calstation.errors import CalstationError
from calstation.gui.settings.drafts import Draft
from calstation.gui.settings.fields import EDITOR, LABEL, Field, Form, Row, set_tab_order
from calstation.gui.settings.inputs import AddressEdit, ChoiceBox, NumberBox, NumberEdit, PortBox
from calstation.gui.settings.test_panel import TestPanel
from calstation.gui.shell import AppContext
from calstation.gui.text import error_text, on_language_change
from calstation.gui.widgets import JobWatch, button, column, enable, label, row, theme

_SERIAL, _TCP, _SERVER = "serial", "tcp", "socket"
#: Common port numbers of Modbus TCP and of a serial server.
_MODBUS_PORT, _SERVER_PORT = 502, 4001
_BAUDS = (9600, 19200, 38400, 57600, 115200, 230400, 460800, 921600)


class LinkSection(QWidget):
    """The link of ``table`` or ``imu`` in a station's draft."""

    def __init__(self, app: AppContext, device: str, draft: Draft) -> None:
        super().__init__()
        self._app, self._device, self._draft = app, device, draft
        self._table = device == "table"
        #: The last address typed for each kind of connection.
        self._last: dict[str, str] = {}
        self._searched = False
        self._defaults: LinkDefaults | None = None
        self._note = label(wrap=True)
        self._note.setMinimumWidth(LABEL + EDITOR + 2 * theme.GRID)
        self.way_box = ChoiceBox(self._ways, f"{device}_way_combo")
        self.own_box = ChoiceBox(self._own_choices, f"{device}_own_serial_combo")
        self.port_box = PortBox()
        self.search_button = button(f"{device}_search_button", lambda: self.tr("Look for ports again"), self.search)
        self.searching = JobWatch(self)
        self.searching.done.connect(self._found)
        self.searching.failed.connect(self._not_found)
        self.test = TestPanel(app, device, self._station)
        self._make_fields()
        self._way_row = Row(self.way_box, lambda: self.tr("Connected by"))
        self._own_row = Row(self.own_box, lambda: self.tr("Serial settings"))
        self._search_row = Row(self.search_button)
        self._form = Form(
            self._way_row,
            *self._port_fields.values(),
            self._search_row,
            *self._numbers,
            self._own_row,
            *self._line_fields,
        )
        heading = label(lambda: self.tr("Link to the table") if self._table else self.tr("Link to the IMU"), "section")
        row(column(heading, self._note, self._form, None), (self.test, 1), on=self, spacing=3 * theme.GRID)
        set_tab_order(
            (
                self.way_box,
                *(field.editor for field in self._port_fields.values()),
                self.search_button,
                *(field.editor for field in self._numbers),
                self.own_box,
                *(field.editor for field in self._line_fields),
                self.test.product_box,
                self.test.button,
            )
        )
        self.way_box.typed.connect(self._choose_way)
        self.own_box.typed.connect(self._choose_own)
        draft.changed.connect(self.refresh)
        app.product_changed.connect(self.refresh)
        on_language_change(self, self.refresh)

    def _make_fields(self) -> None:
        draft, device = self._draft, self._device
        port = (device, "port")
        addresses = {_TCP: _MODBUS_PORT, _SERVER: _SERVER_PORT} if self._table else {_SERVER: _SERVER_PORT}
        self._port_fields = {_SERIAL: Field(draft, port, self.port_box, lambda: self.tr("Port"), hint=self._port_hint)}
        for scheme, number in addresses.items():
            edit = AddressEdit(scheme, number)
            self._port_fields[scheme] = Field(draft, port, edit, lambda: self.tr("Address and port number"))
        self.unit_edit, self.timeout_edit = NumberEdit(), NumberEdit()
        timeout = Field(
            draft,
            (device, "timeout_s"),
            self.timeout_edit,
            lambda: self.tr("Response timeout"),
            unit="s",
            hint=lambda: self._unless_set("timeout_s", self.tr("As in the profile.")),
        )
        self._numbers = [timeout]
        if self._table:
            unit = Field(
                draft,
                ("table", "unit"),
                self.unit_edit,
                lambda: self.tr("Modbus unit number"),
                hint=lambda: self._unless_set("unit", self.tr("As in the table profile.")),
            )
            self._numbers.insert(0, unit)
        bits, stops = ChoiceBox(lambda: _numbers(8, 7, 6, 5)), ChoiceBox(lambda: _numbers(1, 1.5, 2))
        serial = (device, "serial")
        self._line_fields = [
            Field(draft, (*serial, "baud"), NumberBox(_BAUDS), lambda: self.tr("Baud"), default=115200),
            Field(draft, (*serial, "data_bits"), bits, lambda: self.tr("Data bits"), default=8),
            Field(draft, (*serial, "parity"), ChoiceBox(self._parities), lambda: self.tr("Parity"), default="N"),
            Field(draft, (*serial, "stop_bits"), stops, lambda: self.tr("Stop bits"), default=1),
        ]

    def lock(self, reason: str) -> None:
        """Disable changes with the reason as tooltip; "" enables them."""
        self._form.lock(reason)
        for widget in (self.way_box, self.own_box):
            enable(widget, reason)

    def search(self) -> None:
        """Look for ports in the background."""
        if not self.searching.busy:
            self.search_button.setEnabled(False)
            self.searching.watch(self._app.job_queue.submit(discover_ports))

    def refresh(self) -> None:
        """Show the draft."""
        draft = self._draft
        self._defaults = (
            table_defaults(str(draft.value(("table", "profile")) or ""))
            if self._table
            else imu_defaults(self._app.product_path)
        )
        defaults = self._defaults
        by_hand = defaults is not None and defaults.by_hand
        fixed = by_hand or draft.value(("bench",)) is not None
        self._note.setText(self._why_nothing_to_set(by_hand))
        self._note.setVisible(fixed)
        self._form.setVisible(not fixed)
        port = draft.value((self._device, "port"))
        way = _way(port) if _way(port) in self._port_fields else _SERIAL
        if port:
            self._last[way] = str(port)
        else:
            way = self.way_box.value() or way
        own = draft.value((self._device, "serial")) is not None
        for box, value in ((self.way_box, way), (self.own_box, own)):
            box.fill()
            box.show_value(value)
        for key, field in self._port_fields.items():
            field.setVisible(key == way)
        for widget in (self._search_row, self._own_row):
            widget.setVisible(way == _SERIAL)
        for field in self._line_fields:
            field.setVisible(own and way == _SERIAL)
        self.timeout_edit.setPlaceholderText(f"{defaults.timeout:g}" if defaults and defaults.timeout else "")
        if self._table:
            modbus = defaults is None or defaults.unit is not None
            self.unit_edit.setPlaceholderText(str(defaults.unit) if defaults and modbus else "")
            self._numbers[0].setVisible(modbus)
        self.test.refresh()

    def _why_nothing_to_set(self, by_hand: bool) -> str:
        if by_hand:
            return self.tr("The rig is turned by hand: it needs no link and there is nothing to set here.")
        return self.tr(
            "This station is the virtual bench: a table and a unit in software that speak the protocols of the "
            "hardware. It opens its own ports, so there is nothing to set here.\n\n"
            "To connect hardware, press “New from copy” above and copy the station “example_hardware”."
        )

    def _station(self) -> StationConfig | None:
        model = self._draft.model
        return model if isinstance(model, StationConfig) else None

    def _choose_way(self) -> None:
        """Change the kind of connection; the address last typed for it comes back."""
        way = self.way_box.value()
        self._draft.set({(self._device, "port"): self._last.get(way)})
        self.refresh()
        self._port_fields[way].editor.setFocus()

    def _choose_own(self) -> None:
        place = (self._device, "serial")
        if not self.own_box.value():
            self._draft.set({place: None})
        elif self._defaults is not None:
            serial = self._defaults.serial.model_dump(include={"baud", "data_bits", "parity", "stop_bits"})
            self._draft.set({(*place, key): value for key, value in serial.items()})

    def _found(self, ports: Sequence[FoundPort]) -> None:
        self.search_button.setEnabled(True)
        self._searched = True
        self.port_box.offer(ports)
        self._port_fields[_SERIAL].refresh()

    def _not_found(self, error: CalstationError) -> None:
        self.search_button.setEnabled(True)
        self.search_button.setToolTip(error_text(error).sentences)

    def _port_hint(self) -> str:
        description = self.port_box.description()
        if description or not self._searched or not self.port_box.value():
            return description
        return self.tr("This port is not present now.")

    def _unless_set(self, key: str, text: str) -> str:
        return text if self._draft.value((self._device, key)) is None else ""

    def _ways(self) -> list[tuple[Any, str]]:
        if not self._table:
            return [(_SERIAL, self.tr("serial line")), (_SERVER, self.tr("serial server (TCP)"))]
        if self._defaults is not None and self._defaults.unit is None:
            return [(_TCP, self.tr("network (TCP)")), (_SERIAL, self.tr("serial line"))]
        return [
            (_TCP, self.tr("network: Modbus TCP")),
            (_SERIAL, self.tr("serial line: Modbus RTU")),
            (_SERVER, self.tr("serial server: Modbus RTU")),
        ]

    def _own_choices(self) -> list[tuple[Any, str]]:
        line = f" ({self._defaults.line})" if self._defaults is not None else ""
        return [(False, self.tr("the profile's") + line), (True, self.tr("this station's own"))]

    def _parities(self) -> list[tuple[Any, str]]:
        return [
            ("N", self.tr("none")),
            ("E", self.tr("even")),
            ("O", self.tr("odd")),
            ("M", self.tr("mark")),
            ("S", self.tr("space")),
        ]


def _way(port: Any) -> str:
    """The kind of connection of a port."""
    text = str(port or "")
    return next((way for way in (_TCP, _SERVER) if text.startswith(f"{way}://")), _SERIAL)


def _numbers(*values: float) -> list[tuple[Any, str]]:
    return [(value, f"{value:g}") for value in values]
