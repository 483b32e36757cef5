"""How one device is connected: network or serial line, its settings, and the test beside them."""

from collections.abc import Sequence
from typing import Any

from PySide6.QtCore import QEvent
from PySide6.QtWidgets import QHBoxLayout, QLabel, QPushButton, QVBoxLayout, QWidget

from calstation.config.link_defaults import LinkDefaults, imu_defaults, table_defaults
from calstation.config.station import StationConfig
from calstation.connection.link_test import FoundPort, discover_ports
from calstation.errors import CalstationError
from calstation.gui.settings.draft import Draft
from calstation.gui.settings.fields import EDITOR, LABEL, Field, Form, Row, tab_through
from calstation.gui.settings.inputs import ChoiceBox, NumberBox, NumberEdit
from calstation.gui.settings.port_box import AddressEdit, PortBox
from calstation.gui.settings.test_panel import TestPanel
from calstation.gui.shell.context import AppContext
from calstation.gui.text.messages import error_text
from calstation.gui.widgets import theme
from calstation.gui.widgets.jobs import JobWatch

_SERIAL, _TCP, _SERVER = "serial", "tcp", "socket"
#: Usual port numbers of Modbus TCP and of a serial server.
_MODBUS_PORT, _SERVER_PORT = 502, 4001
_BAUDS = (9600, 19200, 38400, 57600, 115200, 230400, 460800, 921600)


def _way(port: Any) -> str:
    """How a port is reached."""
    text = str(port or "")
    return next((way for way in (_TCP, _SERVER) if text.startswith(f"{way}://")), _SERIAL)


class LinkSection(QWidget):
    """The link of ``table`` or ``imu`` in a station's draft."""

    def __init__(self, app: AppContext, device: str, draft: Draft) -> None:
        super().__init__()
        self._app, self._device, self._draft = app, device, draft
        self._last: dict[str, str] = {}
        self._table = device == "table"
        self._searched = False
        self._profile: LinkDefaults | None = None
        self._heading, self._bench = QLabel(), QLabel()
        self._heading.setProperty("kind", "section")
        self._bench.setWordWrap(True)
        self._bench.setMinimumWidth(LABEL + EDITOR + 2 * theme.GRID)
        self.way_box = ChoiceBox(self._ways)
        self.way_box.setObjectName(f"{device}_way_combo")
        self.port_box = PortBox()
        self.search_button = QPushButton()
        self.search_button.setObjectName(f"{device}_search_button")
        self.search_button.clicked.connect(self.search)
        self.searching = JobWatch(self)
        self.searching.done.connect(self._found)
        self.searching.failed.connect(self._not_found)
        self.own_box = ChoiceBox(self._owns)
        self.own_box.setObjectName(f"{device}_own_serial_combo")
        self.unit_edit, self.timeout_edit = NumberEdit(), NumberEdit()
        self.test = TestPanel(app, device, self._station)
        self._build()
        self.way_box.typed.connect(self._choose_way)
        self.own_box.typed.connect(self._choose_own)
        draft.changed.connect(self.refresh)
        app.product_changed.connect(self.refresh)
        self.retranslate()

    def _build(self) -> None:
        place = (self._device, "port")
        addresses = {_TCP: _MODBUS_PORT, _SERVER: _SERVER_PORT} if self._table else {_SERVER: _SERVER_PORT}
        self._port_fields = {
            _SERIAL: Field(self._draft, place, self.port_box, lambda: self.tr("Port"), hint=self._about)
        }
        for scheme, number in addresses.items():
            edit = AddressEdit(scheme, number)
            self._port_fields[scheme] = Field(
                self._draft, place, edit, lambda: self.tr("Address and port number")
            )
        self._numbers = [
            Field(
                self._draft,
                (self._device, "timeout_s"),
                self.timeout_edit,
                lambda: self.tr("Wait for an answer"),
                unit="s",
                hint=self._timeout,
            )
        ]
        if self._table:
            words, hint = lambda: self.tr("Modbus unit number"), self._unit
            self._numbers.insert(0, Field(self._draft, ("table", "unit"), self.unit_edit, words, hint=hint))
        serial = (self._device, "serial")
        self._line_fields = [
            Field(self._draft, (*serial, "baud"), NumberBox(_BAUDS), lambda: self.tr("Baud"), default=115200),
            Field(
                self._draft,
                (*serial, "data_bits"),
                ChoiceBox(_data_bits),
                lambda: self.tr("Data bits"),
                default=8,
            ),
            Field(
                self._draft,
                (*serial, "parity"),
                ChoiceBox(self._parities),
                lambda: self.tr("Parity"),
                default="N",
            ),
            Field(
                self._draft,
                (*serial, "stop_bits"),
                ChoiceBox(_stop_bits),
                lambda: self.tr("Stop bits"),
                default=1,
            ),
        ]
        self._way_row = Row(self.way_box, lambda: self.tr("Connected by"))
        self._own_row = Row(self.own_box, lambda: self.tr("Serial settings"))
        self._search_row = Row(self.search_button, str)
        self._form = Form(
            self._way_row,
            *self._port_fields.values(),
            self._search_row,
            *self._numbers,
            self._own_row,
            *self._line_fields,
        )
        left = QVBoxLayout()
        left.setSpacing(theme.GRID)
        left.addWidget(self._heading)
        left.addWidget(self._bench)
        left.addWidget(self._form)
        left.addStretch(1)
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 0, 0, 0)
        row.setSpacing(3 * theme.GRID)
        row.addLayout(left)
        row.addWidget(self.test, 1)
        tab_through(
            self.way_box,
            *(field.editor for field in self._port_fields.values()),
            self.search_button,
            *(field.editor for field in self._numbers),
            self.own_box,
            *(field.editor for field in self._line_fields),
            self.test.product_box,
            self.test.button,
        )

    @property
    def fields(self) -> list[Field]:
        """All fields of the section."""
        return self._form.fields

    def lock(self, reason: str) -> None:
        """Forbid changes, with the reason as tooltip; "" allows them."""
        self._form.lock(reason)
        for widget in (self.way_box, self.own_box):
            widget.setEnabled(not reason)
            widget.setToolTip(reason)

    def search(self) -> None:
        """Look for ports, beside the window."""
        if not self.searching.busy:
            self.search_button.setEnabled(False)
            self.searching.watch(self._app.job_queue.submit(discover_ports))

    def refresh(self) -> None:
        """Show what the draft says."""
        data = self._draft
        self._profile = self._defaults()
        bench = data.value(("bench",)) is not None
        by_hand = self._profile is not None and self._profile.by_hand
        self._bench.setText(self._why_nothing_to_set(by_hand))
        self._bench.setVisible(bench or by_hand)
        self._form.setVisible(not (bench or by_hand))
        port = data.value((self._device, "port"))
        way = _way(port) if _way(port) in self._port_fields else _SERIAL
        if port:
            self._last[way] = str(port)
        else:
            way = self.way_box.value() or way
        self.way_box.fill()
        self.way_box.show_value(way)
        for key, field in self._port_fields.items():
            field.setVisible(key == way)
        self._search_row.setVisible(way == _SERIAL)
        own = data.value((self._device, "serial")) is not None
        self.own_box.fill()
        self.own_box.show_value(own)
        for field in self._line_fields:
            field.setVisible(own and way == _SERIAL)
        self._own_row.setVisible(way == _SERIAL)
        defaults = self._profile
        self.timeout_edit.setPlaceholderText(f"{defaults.timeout:g}" if defaults and defaults.timeout else "")
        if self._table:
            modbus = defaults is None or defaults.unit is not None
            self.unit_edit.setPlaceholderText(str(defaults.unit) if defaults and modbus else "")
            self._numbers[0].setVisible(modbus)
        self.test.refresh()

    def retranslate(self) -> None:
        """Say everything again in the language in force."""
        self._heading.setText(self.tr("Link to the table") if self._table else self.tr("Link to the IMU"))
        self.search_button.setText(self.tr("Look for ports again"))
        self.way_box.fill()
        for row in (self._way_row, self._own_row):
            row.retranslate()
        self.refresh()

    def _why_nothing_to_set(self, by_hand: bool) -> str:
        if by_hand:
            return self.tr(
                "The rails are turned by hand: no link is needed, and there is nothing to set here."
            )
        return self.tr(
            "This station is the virtual bench: a table and a unit in software, behind the same protocols as "
            "hardware. It opens its own ports, so there is nothing to set here.\n\n"
            "To connect hardware, press “New from copy” above and copy the station “example_hardware”."
        )

    def changeEvent(self, event: QEvent) -> None:
        """Hear of a new language."""
        if event.type() == QEvent.Type.LanguageChange:
            self.retranslate()
        super().changeEvent(event)

    def _station(self) -> StationConfig | None:
        model = self._draft.model
        return model if isinstance(model, StationConfig) else None

    def _defaults(self) -> LinkDefaults | None:
        if self._table:
            return table_defaults(str(self._draft.value(("table", "profile")) or ""))
        return imu_defaults(self._app.product_path)

    def _choose_way(self) -> None:
        """Another way to the device: what was typed for it before comes back."""
        way = self.way_box.value()
        self._draft.set({(self._device, "port"): self._last.get(way)})
        self.refresh()
        self._port_fields[way].editor.setFocus()

    def _choose_own(self) -> None:
        defaults = self._profile
        place = (self._device, "serial")
        if not self.own_box.value():
            self._draft.set({place: None})
        elif defaults is not None:
            serial = defaults.serial.model_dump(include={"baud", "data_bits", "parity", "stop_bits"})
            self._draft.set({(*place, key): value for key, value in serial.items()})

    def _found(self, ports: Sequence[FoundPort]) -> None:
        self.search_button.setEnabled(True)
        self._searched = True
        self.port_box.offer(ports)
        self._port_fields[_SERIAL].refresh()

    def _not_found(self, error: CalstationError) -> None:
        self.search_button.setEnabled(True)
        self.search_button.setToolTip(error_text(error).sentences)

    def _about(self) -> str:
        """What is known of the port chosen."""
        about = self.port_box.about()
        if about or not self._searched or not self.port_box.value():
            return about
        return self.tr("Not among the ports found now.")

    def _unit(self) -> str:
        return (
            "" if self._draft.value(("table", "unit")) is not None else self.tr("As the table profile says.")
        )

    def _timeout(self) -> str:
        set_here = self._draft.value((self._device, "timeout_s")) is not None
        return "" if set_here else self.tr("As the profile says.")

    def _ways(self) -> list[tuple[Any, str]]:
        if not self._table:
            return [(_SERIAL, self.tr("serial line")), (_SERVER, self.tr("serial server (TCP)"))]
        if self._profile is not None and self._profile.unit is None:
            return [(_TCP, self.tr("network (TCP)")), (_SERIAL, self.tr("serial line"))]
        return [
            (_TCP, self.tr("network: Modbus TCP")),
            (_SERIAL, self.tr("serial line: Modbus RTU")),
            (_SERVER, self.tr("serial server: Modbus RTU")),
        ]

    def _owns(self) -> list[tuple[Any, str]]:
        line = f" ({self._profile.line})" if self._profile is not None else ""
        return [(False, self.tr("the profile's") + line), (True, self.tr("this station's own"))]

    def _parities(self) -> list[tuple[Any, str]]:
        return [
            ("N", self.tr("none")),
            ("E", self.tr("even")),
            ("O", self.tr("odd")),
            ("M", self.tr("mark")),
            ("S", self.tr("space")),
        ]


def _data_bits() -> list[tuple[Any, str]]:
    return [(bits, str(bits)) for bits in (8, 7, 6, 5)]


def _stop_bits() -> list[tuple[Any, str]]:
    return [(1, "1"), (1.5, "1.5"), (2, "2")]
