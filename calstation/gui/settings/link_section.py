"""The link to a device: network address or serial port, settings, and a connection test."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QFrame, QSizePolicy, QWidget

from calstation.config import (
    DEFAULT_PRODUCT,
    LinkDefaults,
    StationConfig,
    at_slot,
    chamber_defaults,
    imu_defaults,
    library,
    table_defaults,
)
from calstation.connection import (
    LinkTestRequest,
    SerialPortInfo,
    check_chamber_link,
    check_imu_link,
    check_table_link,
    discover_ports,
)
from calstation.errors import CalstationError
from calstation.gui.settings.drafts import Draft
from calstation.gui.settings.fields import EDITOR, LABEL, AddressEdit, Field, PortBox, Row, Section
from calstation.gui.state import AppContext, ResetBar
from calstation.gui.text import offered_products, on_language_change, rendered, say, term
from calstation.gui.widgets import (
    ChoiceBox,
    EditableBox,
    JobRow,
    NumberEdit,
    StateBadge,
    StateIcon,
    box,
    button,
    choices_of,
    clear,
    column,
    enable,
    label,
    row,
    scroll_area,
    show_text,
    theme,
    typed_number,
)
from calstation.messages import Finding, Report
from calstation.schema import KeyPath

#: Address schemes of network connections, and their default port numbers.
_NETWORK = {"tcp": 502, "socket": 4001}
_BAUDS = (9600, 19200, 38400, 57600, 115200, 230400, 460800, 921600)
_SERIAL_KEYS = {"baud", "data_bits", "parity", "stop_bits"}


class LinkSection(Section):
    """The section for the link to a device (``table``, ``chamber``, ``imu``), or to the unit in a slot, from 0."""

    def __init__(self, app: AppContext, device: str, draft: Draft, slot: int | None = None) -> None:
        super().__init__(draft)
        self._app, self._device = app, device
        self._key_path: KeyPath = (device,) if slot is None else ("slots", slot)
        #: Last address of each kind of connection.
        self._last: dict[str, str] = {}
        self._searched = False
        self._defaults: LinkDefaults | None = None
        self._note = label(wrap=True)
        self._note.setMinimumWidth(LABEL + EDITOR + 2 * theme.GRID)
        self.kind_box = ChoiceBox(self._kinds, f"{device}_way_combo")
        self.profile_box = ChoiceBox(self._profiles, "chamber_profile_combo")
        self.profile_box.typed.connect(self._select_profile)
        self.line_box = ChoiceBox(self._line_choices, f"{device}_own_serial_combo")
        self.kind_box.typed.connect(self._select_kind)
        self.line_box.typed.connect(self._select_line)
        self.port_box = PortBox()
        self.search_button = button(f"{device}_search_button", "settings.search_ports", self.search)
        self.searching = app.job(self, discover_ports, self._show_ports, failed=self._show_search_error)
        self.test = TestPanel(app, device, self._station, self._slot)
        self._make_form()
        self._heading = label(kind="section", wrap=True)
        left = column(self._heading, self._choice, self._note, self._form, self._chamber_fields, None)
        row(left, (self.test, 1), on=self, spacing=3 * theme.GRID)
        app.product_changed.connect(self.refresh)
        self.connect_draft()

    def _make_form(self) -> None:
        draft, device = self._draft, self._device
        port, serial = (*self._key_path, "port"), (*self._key_path, "serial")
        schemes = _NETWORK if device != "imu" else {"socket": _NETWORK["socket"]}
        self._ports = {"serial": Field(draft, port, self.port_box, hint=self._port_hint)}
        for scheme, number in schemes.items():
            self._ports[scheme] = Field(draft, port, AddressEdit(scheme, number), name="address")
        self._timeout_edit, self._unit_edit = NumberEdit(), NumberEdit()
        timeout = Field(draft, (*self._key_path, "timeout_s"), self._timeout_edit)
        self._unit = Field(draft, ("table", "unit"), self._unit_edit)
        self._line_fields = [
            Field(draft, (*serial, "baud"), EditableBox(_BAUDS, typed_number)),
            *(Field(draft, (*serial, key)) for key in ("data_bits", "parity")),
            Field(draft, (*serial, "stop_bits"), ChoiceBox(choices_of("stop_bits", 1, 1.5, 2))),
        ]
        self._line_row, self._search_row = Row(self.line_box, "own_serial"), Row(self.search_button)
        ports = (*self._ports.values(), self._search_row)
        others = (self._unit, timeout, self._line_row, *self._line_fields)
        self._form = box(Row(self.kind_box, "way"), *ports, *others, None)
        keys = ("ambient_c", "dew_point_c", "agreement_c") if device == "chamber" else ()
        self._chamber_fields = box(*(Field(draft, (device, key)) for key in keys), None)
        self._choice = Row(self.profile_box, "chamber_profile")
        if device != "chamber":
            self._choice.hide()

    def lock(self, reason: str) -> None:
        """Disable changes and show `reason` in tooltips; "" enables them."""
        super().lock(reason)
        enable(self.search_button, "")  # a search for ports does not change anything

    def search(self) -> None:
        """Search for ports in the background."""
        if not self.searching.busy:
            self.search_button.setEnabled(False)
            self.searching.start()

    def refresh(self) -> None:
        """Show the values of the draft."""
        draft, table = self._draft, self._device == "table"
        profile = str(draft.value((self._device, "profile")) or "")
        defaults_of = {"table": table_defaults, "chamber": chamber_defaults}.get(self._device)
        self._defaults = defaults = self._imu_defaults() if defaults_of is None else defaults_of(profile)
        self._heading.setText(self._title())
        absent = self._device == "chamber" and draft.value(("chamber",)) is None
        self.profile_box.fill()
        self.profile_box.show_value(profile or None)
        self._chamber_fields.setVisible(self._device == "chamber" and not absent)
        self.test.setVisible(not absent)
        by_hand = defaults is not None and defaults.by_hand
        fixed = by_hand or draft.value(("bench",)) is not None
        self._note.setText(say("setting.no_link_by_hand" if by_hand else "setting.no_link_of_bench"))
        self._note.setVisible(fixed and not absent)
        self._form.setVisible(not fixed and not absent)
        port = str(draft.value((*self._key_path, "port")) or "")
        scheme = port.partition("://")[0]
        kind = scheme if scheme in self._ports else "serial"
        if port:
            self._last[kind] = port
        else:
            kind = self.kind_box.value() or kind
        line_in_station = draft.value((*self._key_path, "serial")) is not None
        for choice, value in ((self.kind_box, kind), (self.line_box, line_in_station)):
            choice.fill()
            choice.show_value(value)
        for key, field in self._ports.items():
            field.setVisible(key == kind)
        for widget in (self._search_row, self._line_row):
            widget.setVisible(kind == "serial")
        for field in self._line_fields:
            field.setVisible(line_in_station and kind == "serial")
        self._timeout_edit.setPlaceholderText(f"{defaults.timeout:g}" if defaults and defaults.timeout else "")
        modbus = table and (defaults is None or defaults.unit is not None)
        self._unit_edit.setPlaceholderText(str(defaults.unit) if defaults and modbus else "")
        self._unit.setVisible(modbus)
        self.test.refresh()

    def _title(self) -> str:
        if self._device != "imu":
            return say(f"settings.link_to_{self._device}")
        slot = self._slot()
        return say("settings.link_to_imu") if slot is None else say("settings.link_to_slot", slot=slot)

    def _slot(self) -> str | None:
        """Return the name of the slot, or None for a device without a slot."""
        return None if self._key_path == (self._device,) else str(self._draft.value((*self._key_path, "name")) or "")

    def _imu_defaults(self) -> LinkDefaults | None:
        product, profile = (self._draft.value((*self._key_path, key)) for key in ("product", "imu"))
        is_known = product in library.names("products")
        return imu_defaults(
            library.find("products", product) if is_known else self._app.product_path,
            profile if profile in library.names("imus") else None,
        )

    def _station(self) -> StationConfig | None:
        model = self._draft.model
        return model if isinstance(model, StationConfig) else None

    def _profiles(self) -> list[tuple[Any, str]]:
        return [(None, say("settings.no_chamber")), *((name, name) for name in library.names("chambers"))]

    def _select_profile(self) -> None:
        """Choose another chamber, or none."""
        name = self.profile_box.value()
        self._draft.set({("chamber",): None} if name is None else {("chamber", "profile"): name})

    def _select_kind(self) -> None:
        """Change the kind of connection, and restore its last address."""
        kind = self.kind_box.value()
        self._draft.set({(*self._key_path, "port"): self._last.get(kind)})
        self.refresh()
        self._ports[kind].editor.setFocus()

    def _select_line(self) -> None:
        key_path = (*self._key_path, "serial")
        if not self.line_box.value():
            self._draft.set({key_path: None})
        elif self._defaults is not None:
            serial = self._defaults.serial.model_dump(include=_SERIAL_KEYS)
            self._draft.set({(*key_path, key): value for key, value in serial.items()})

    def _show_ports(self, ports: Sequence[SerialPortInfo]) -> None:
        enable(self.search_button, "")
        self._searched = True
        self.port_box.show_ports(ports)
        self._ports["serial"].refresh()

    def _show_search_error(self, error: CalstationError) -> None:
        enable(self.search_button, "", say(error.as_text))

    def _port_hint(self) -> str:
        description, port = self.port_box.description(), str(self.port_box.value() or "")
        if description or not self._searched or not port or Path(port).exists():  # a symbolic link
            return description
        return say("settings.port_absent")

    def _kinds(self) -> list[tuple[Any, str]]:
        if self._device == "imu":
            return [(kind, say(f"setting.way_{kind}")) for kind in ("serial", "socket")]
        if self._defaults is not None and self._defaults.unit is None:
            return [(kind, say(f"setting.way_{kind}")) for kind in ("tcp", "serial")]
        return [(kind, say(f"setting.modbus_{kind}")) for kind in ("tcp", "serial", "socket")]

    def _line_choices(self) -> list[tuple[Any, str]]:
        profile = f" ({self._defaults.serial.line})" if self._defaults is not None else ""
        return [(False, say("settings.of_profile") + profile), (True, say("settings.of_station"))]


#: Symbol of each state of a finding or a test.
_SYMBOLS = {"ok": "good", "info": "none", "warning": "caution", "error": "bad", "failed": "bad"}
#: Findings after which the user can try to reset the table.
_RESETTABLE = ("fault", "fault_untold")


class TestPanel(QFrame):
    """A panel that tests the link to the ``table``, ``chamber`` or ``imu``, and shows the findings.

    `station` returns the station, or None while its values are invalid; `slot` returns the name of the slot or None.
    """

    __test__ = False  # this is not a pytest class

    def __init__(
        self,
        app: AppContext,
        device: str,
        station: Callable[[], StationConfig | None],
        slot: Callable[[], str | None],
    ) -> None:
        super().__init__()
        self._app, self._device, self._station, self._slot = app, device, station, slot
        self.report: Report | None = None
        #: The settings that were tested.
        self._tested: tuple[object, ...] = ()
        self._error: CalstationError | None = None
        self.setProperty("kind", "panel")
        self.product_box = ChoiceBox(
            lambda: [(path.stem, name) for name, path in offered_products()], "imu_test_product"
        )
        self.product_box.typed.connect(self.refresh)
        self.button = button(f"test_{device}_button", f"settings.test_{device}", self.start, kind="primary")
        self.button.setSizePolicy(QSizePolicy.Policy.Maximum, QSizePolicy.Policy.Fixed)
        tests = {"table": check_table_link, "chamber": check_chamber_link, "imu": check_imu_link}
        self.watch = app.job(self, tests[device], self._done, failed=self._failed, cancelled=self._show_running)
        self.watch.progress.connect(self._show_note)
        self._progress, self._note = JobRow(self.watch), label(kind="muted", wrap=True)
        self.badge = StateBadge(theme.SECTION, f"{device}_test_badge")
        self.reset = ResetBar(app, self._request, f"{device}_reset_button")
        self.reset.changed.connect(self.refresh)
        self.reset.ended.connect(lambda _: self._test())
        self._why = label(wrap=True)
        self._nothing = label("setting.not_tested", "muted", wrap=True)
        self._lay_out()
        app.engine_link.running_changed.connect(lambda _: self.refresh())
        app.windows.changed.connect(self.refresh)
        app.product_changed.connect(self._follow_product)
        self._follow_product()
        on_language_change(self, self._show_running)

    def _lay_out(self) -> None:
        self._list = column()
        self._lines = box(self._list, None, margins=(0, 0, theme.GRID, 0))
        caption = label("settings.expected_imu", buddy=self.product_box)
        self._expected = box(row(caption, (self.product_box, 1)))
        column(
            label("settings.connection_test", "section"),
            label("setting.about_test", "muted", wrap=True),
            self._expected,
            self.button,
            self._progress,
            self._note,
            self.badge,
            self._why,
            self.reset,
            self._nothing,
            (scroll_area(self._lines, wide=False, texts=True), 1),
            on=self,
            margins=(2 * theme.GRID, 2 * theme.GRID, theme.GRID, theme.GRID),
        )

    def start(self) -> None:
        """Test the current settings, whether saved or not."""
        self.reset.clear()
        self._test()

    def refresh(self) -> None:
        """Update the button, and clear the findings if the settings have changed."""
        station = self._station()
        tested = self.report is not None or self.reset.result is not None
        if tested and (station is None or self._settings(station) != self._tested):
            self.reset.clear()
            self._clear()
        slots = () if station is None else station.slots
        names_product = any(slot.name == self._slot() and slot.product for slot in slots)
        self._expected.setVisible(self._device == "imu" and not names_product)
        reason = ""
        if self._app.engine_link.running:
            reason = say("settings.test_after_run")
        elif self._app.run.occupied is not None:
            reason = say(self._app.run.occupied)
        elif self.watch.busy:
            reason = say("settings.test_running")
        elif self.reset.watch.busy:
            reason = say("settings.fault_resetting")
        elif station is None:
            reason = say("settings.correct_first")
        enable(self.button, reason)

    def _test(self) -> None:
        """Run the test; the result of a reset remains visible."""
        request = self._request()
        if request is None or self._app.engine_link.running or self.watch.busy or self.reset.watch.busy:
            return
        self._clear()
        self._tested = self._settings(request.station)
        self.watch.start(request)
        self._show_running()

    def _request(self) -> LinkTestRequest | None:
        """Return the request for a test, or None if the values of the station are invalid."""
        station = self._station()
        return None if station is None else LinkTestRequest(station, self._product(), self._slot())

    def _product(self) -> Path:
        return library.find("products", self.product_box.value())

    def _settings(self, station: StationConfig) -> tuple[object, ...]:
        """Return the settings that a test depends on."""
        if self._device == "table":
            return (station.table, station.bench)
        if self._device == "chamber":
            return (station.chamber, station.bench)
        unit = at_slot(station, self._slot())
        return (unit.imu, unit.site, self._product(), unit.bench)

    def _follow_product(self) -> None:
        chosen = self._app.product_path
        self.product_box.show_value(chosen.stem if chosen is not None else DEFAULT_PRODUCT)

    def _show_note(self) -> None:
        job = self.watch.job
        self._note.setText(term("note", job.note) if job is not None and job.note else "")

    def _done(self, report: Report) -> None:
        self.report = report
        for finding in report.findings:
            self._list.addWidget(_finding_row(finding))
        self._show_running()
        # this call is last, because otherwise the focus would move from the hidden job row to the reset button
        self.reset.offer(self._device == "table" and any(map(report.find, _RESETTABLE)))

    def _failed(self, error: CalstationError) -> None:
        self._error = error
        self._show_running()

    def _show_running(self) -> None:
        for widget in (self._progress, self._note):
            widget.setVisible(self.watch.busy)
        self._show_verdict()
        self.refresh()

    def _show_verdict(self) -> None:
        state = "failed" if self._error else self.report.state if self.report is not None else ""
        self.badge.setVisible(bool(state) and not self.watch.busy)
        if state:
            self.badge.show_state(_SYMBOLS[state], say(f"setting.test_{state}"))
        effect = "setting.warning_effect" if state == "warning" else ""
        show_text(self._why, say(self._error.as_text if self._error else effect))
        self._nothing.setVisible(not state and not self.watch.busy)

    def _clear(self) -> None:
        self.report = self._error = None
        self.reset.offer(False)
        clear(self._list)
        self._show_verdict()


def _finding_row(finding: Finding) -> QWidget:
    """Create a row with the symbol, message and remedy of a finding."""
    icon = StateIcon(18)
    icon.set_kind(_SYMBOLS[finding.state])
    text = label(lambda: rendered(finding.message).text, wrap=True, selectable=True)
    remedy = label(lambda: rendered(finding.message).remedy, "muted", wrap=True, selectable=True)
    finding_row = box(row((icon, 0, Qt.AlignmentFlag.AlignTop), (column(text, remedy, spacing=2), 1)))
    remedy.setVisible(bool(remedy.text()))  # without a parent, it would be shown as a window
    return finding_row
