"""The link of one device: network or serial line, its settings, and the test beside them."""

from collections.abc import Sequence
from typing import Any

from PySide6.QtWidgets import QWidget

from calstation.config import LinkDefaults, StationConfig, imu_defaults, table_defaults
from calstation.connection import FoundPort, discover_ports
from calstation.errors import CalstationError
from calstation.gui.settings.drafts import Draft
from calstation.gui.settings.fields import EDITOR, LABEL, Field, Form, Row, choices_of
from calstation.gui.settings.inputs import AddressEdit, ChoiceBox, NumberBox, NumberEdit, PortBox
from calstation.gui.settings.test_panel import TestPanel
from calstation.gui.shell import AppContext
from calstation.gui.text import error_text, on_language_change, say, term
from calstation.gui.widgets import JobWatch, button, column, enable, label, row, theme

#: Kinds of connection over a network, as schemes of addresses, and the common port number of each.
_NETWORK = {"tcp": 502, "socket": 4001}
_BAUDS = (9600, 19200, 38400, 57600, 115200, 230400, 460800, 921600)
_SERIAL_KEYS = {"baud", "data_bits", "parity", "stop_bits"}


class LinkSection(QWidget):
    """The link of ``table`` or ``imu`` in a station's draft."""

    def __init__(self, app: AppContext, device: str, draft: Draft) -> None:
        super().__init__()
        self._app, self._device, self._draft = app, device, draft
        #: The last address typed for each kind of connection.
        self._last: dict[str, str] = {}
        self._searched = False
        self._defaults: LinkDefaults | None = None
        self._note = label(wrap=True)
        self._note.setMinimumWidth(LABEL + EDITOR + 2 * theme.GRID)
        self.way_box = ChoiceBox(self._ways, f"{device}_way_combo")
        self.own_box = ChoiceBox(self._own_choices, f"{device}_own_serial_combo")
        self.way_box.typed.connect(self._choose_way)
        self.own_box.typed.connect(self._choose_own)
        self.port_box = PortBox()
        self.search_button = button(f"{device}_search_button", lambda: self.tr("Look for ports again"), self.search)
        self.searching = JobWatch(self)
        self.searching.done.connect(self._found)
        self.searching.failed.connect(self._not_found)
        self.test = TestPanel(app, device, self._station)
        self._make_form()
        heading = label(
            lambda: self.tr("Link to the table") if device == "table" else self.tr("Link to the IMU"), "section"
        )
        left = column(heading, self._note, self._form, None)
        row(left, (self.test, 1), on=self, spacing=3 * theme.GRID)
        draft.changed.connect(self.refresh)
        app.product_changed.connect(self.refresh)
        on_language_change(self, self.refresh)

    def _make_form(self) -> None:
        draft, device = self._draft, self._device
        port, serial = (device, "port"), (device, "serial")
        schemes = _NETWORK if device == "table" else {"socket": _NETWORK["socket"]}
        self._ports = {"serial": Field(draft, port, self.port_box, hint=self._port_hint)}
        for scheme, number in schemes.items():
            self._ports[scheme] = Field(draft, port, AddressEdit(scheme, number), name="address")
        self._timeout_edit, self._unit_edit = NumberEdit(), NumberEdit()
        timeout = Field(draft, (device, "timeout_s"), self._timeout_edit)
        self._unit = Field(draft, ("table", "unit"), self._unit_edit)
        self._line_fields = [
            Field(draft, (*serial, "baud"), NumberBox(_BAUDS)),
            Field(draft, (*serial, "data_bits")),
            Field(draft, (*serial, "parity")),
            Field(draft, (*serial, "stop_bits"), ChoiceBox(choices_of("stop_bits", 1, 1.5, 2))),
        ]
        self._own_row, self._search_row = Row(self.own_box, "own_serial"), Row(self.search_button)
        self._form = Form(
            Row(self.way_box, "way"),
            *self._ports.values(),
            self._search_row,
            self._unit,
            timeout,
            self._own_row,
            *self._line_fields,
        )

    def lock(self, reason: str) -> None:
        """Disable changes with the reason as tooltip; "" enables them."""
        self._form.lock(reason)
        enable(self.search_button, "")  # looking for ports changes nothing

    def search(self) -> None:
        """Look for ports in the background."""
        if not self.searching.busy:
            self.search_button.setEnabled(False)
            self.searching.watch(self._app.job_queue.submit(discover_ports))

    def refresh(self) -> None:
        """Show the draft."""
        draft, table = self._draft, self._device == "table"
        profile = str(draft.value(("table", "profile")) or "")
        self._defaults = defaults = table_defaults(profile) if table else imu_defaults(self._app.product_path)
        by_hand = defaults is not None and defaults.by_hand
        fixed = by_hand or draft.value(("bench",)) is not None
        self._note.setText(say("setting.no_link_by_hand" if by_hand else "setting.no_link_of_bench"))
        self._note.setVisible(fixed)
        self._form.setVisible(not fixed)
        port = str(draft.value((self._device, "port")) or "")
        scheme = port.partition("://")[0]
        way = scheme if scheme in self._ports else "serial"
        if port:
            self._last[way] = port
        else:
            way = self.way_box.value() or way
        own = draft.value((self._device, "serial")) is not None
        for box, value in ((self.way_box, way), (self.own_box, own)):
            box.fill()
            box.show_value(value)
        for key, field in self._ports.items():
            field.setVisible(key == way)
        for widget in (self._search_row, self._own_row):
            widget.setVisible(way == "serial")
        for field in self._line_fields:
            field.setVisible(own and way == "serial")
        self._timeout_edit.setPlaceholderText(f"{defaults.timeout:g}" if defaults and defaults.timeout else "")
        modbus = table and (defaults is None or defaults.unit is not None)
        self._unit_edit.setPlaceholderText(str(defaults.unit) if defaults and modbus else "")
        self._unit.setVisible(modbus)
        self.test.refresh()

    def _station(self) -> StationConfig | None:
        model = self._draft.model
        return model if isinstance(model, StationConfig) else None

    def _choose_way(self) -> None:
        """Change the kind of connection; the address last typed for it comes back."""
        way = self.way_box.value()
        self._draft.set({(self._device, "port"): self._last.get(way)})
        self.refresh()
        self._ports[way].editor.setFocus()

    def _choose_own(self) -> None:
        place = (self._device, "serial")
        if not self.own_box.value():
            self._draft.set({place: None})
        elif self._defaults is not None:
            serial = self._defaults.serial.model_dump(include=_SERIAL_KEYS)
            self._draft.set({(*place, key): value for key, value in serial.items()})

    def _found(self, ports: Sequence[FoundPort]) -> None:
        self.search_button.setEnabled(True)
        self._searched = True
        self.port_box.offer(ports)
        self._ports["serial"].refresh()

    def _not_found(self, error: CalstationError) -> None:
        self.search_button.setEnabled(True)
        self.search_button.setToolTip(error_text(error).sentences)

    def _port_hint(self) -> str:
        description = self.port_box.description()
        if description or not self._searched or not self.port_box.value():
            return description
        return self.tr("This port is not present now.")

    def _ways(self) -> list[tuple[Any, str]]:
        if self._device == "imu":
            return [(way, term("setting", f"way_{way}")) for way in ("serial", "socket")]
        if self._defaults is not None and self._defaults.unit is None:
            return [(way, term("setting", f"way_{way}")) for way in ("tcp", "serial")]
        return [(way, term("setting", f"modbus_{way}")) for way in ("tcp", "serial", "socket")]

    def _own_choices(self) -> list[tuple[Any, str]]:
        line = f" ({self._defaults.serial.line})" if self._defaults is not None else ""
        return [(False, self.tr("the profile's") + line), (True, self.tr("this station's own"))]
