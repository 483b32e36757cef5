"""A refused serial number leaves the field, from which START would take it, and START starts only displayed units."""

import pytest
from PySide6.QtWidgets import QLineEdit

from calstation.config import RunRequest
from tests.gui.conftest import Operator
from tests.gui.test_units import begin, click, hardware, serials, started, tile, use_slots

__all__ = ["hardware", "started"]  # fixtures

UNITS = ("SN-910001", "SN-910002", "SN-910003")


def field(operator: Operator) -> str:
    """Return the text in the serial field."""
    return str(operator.widget("serial_edit", QLineEdit).text())


@pytest.mark.parametrize("dismiss", ["tile", "button"])
def test_refused_number_replaces_no_unit_of_a_full_table(
    hardware: Operator, started: list[RunRequest], dismiss: str
) -> None:
    for serial in (*UNITS, "SN-910004"):
        hardware.scan(serial)
    assert "There is no slot left for SN-910004" in hardware.says()
    assert field(hardware) == "SN-910004"
    if dismiss == "tile":
        click(hardware, "slot_A_tile")
    else:
        hardware.press("slot_A_button")
    assert field(hardware) == ""
    hardware.press("start_button")
    hardware.press("clear_choice")
    assert [request.serials for request in started] == [UNITS if dismiss == "tile" else ("", *UNITS[1:])]


def test_refused_number_is_not_kept_for_another_product(hardware: Operator, started: list[RunRequest]) -> None:
    for serial in (*UNITS, "TX-1"):
        hardware.scan(serial)
    hardware.window.app.set_station(hardware.window.app.station_path)  # reads the product again
    assert field(hardware) == ""
    hardware.press("start_button")
    hardware.press("clear_choice")
    assert [request.serials for request in started] == [UNITS]


@pytest.mark.parametrize(
    ("language", "note", "shown"),
    [("en", "accepted", "SN-910005 is in slot B"), ("zh_CN", "已接受", "SN-910005 已填入装夹位 B")],
)
def test_start_first_shows_a_number_that_was_typed_without_enter(
    hardware: Operator, started: list[RunRequest], language: str, note: str, shown: str
) -> None:
    hardware.window.app.set_language(language)
    for serial in (*UNITS, "SN-910004"):
        hardware.scan(serial)
    hardware.qtbot.keyClicks(hardware.widget("serial_edit"), "SN-910005")  # instead of the refused one
    click(hardware, "slot_B_tile")
    hardware.press("start_button")
    assert started == []
    assert shown in hardware.says()
    assert hardware.window.focusWidget() is hardware.widget("start_button")
    name = tile(hardware, "slot_B_tile").accessibleName()
    assert "SN-910005" in name
    assert note in name
    hardware.press("start_button")
    hardware.press("clear_choice")
    assert [request.serials for request in started] == [(UNITS[0], "SN-910005", UNITS[2])]


@pytest.mark.long
def test_start_of_the_engineer_takes_no_number_from_the_field(operator: Operator, started: list[RunRequest]) -> None:
    use_slots(operator, 3)
    operator.window.app.role.set_first_pin("246813")
    operator.window.show_page("engineer_page")
    edit = operator.widget("engineer_serial_edit", QLineEdit)
    for _ in range(2):  # the second scan is refused
        edit.setText("SN-000777")
        edit.returnPressed.emit()
    for _ in range(2):  # the first shows the slots
        operator.press("engineer_start_button")
    (request,) = started
    assert request.serials == serials(operator)
    assert request.serial == request.serials[0]


@pytest.mark.parametrize(("language", "refused"), [("en", "does not match"), ("zh_CN", "不符合")])
def test_refused_number_at_a_station_for_one_unit_stays_disabled_until_edited(
    operator: Operator, started: list[RunRequest], language: str, refused: str
) -> None:
    operator.window.app.set_language(language)
    operator.scan("TX-1")
    assert refused in operator.says()
    assert not operator.widget("start_button").isEnabled()
    operator.qtbot.keyClicks(operator.widget("serial_edit"), "2")
    assert field(operator) == "2"
    operator.press("start_button")  # checks the edited number, too
    assert refused in operator.says()
    assert started == []


@pytest.mark.parametrize(
    ("language", "remedy"),
    [
        ("en", "SN-000101 does: check Caps Lock, and scan the unit again."),
        ("zh_CN", "SN-000101 则符合：请检查大写锁定键，再重新扫描。"),
    ],
)
def test_number_that_only_its_case_makes_invalid_is_refused_with_caps_lock(
    operator: Operator, language: str, remedy: str
) -> None:
    operator.window.app.set_language(language)
    operator.scan("sn-000101")
    assert remedy in operator.says()
    assert not operator.widget("start_button").isEnabled()


def test_refused_number_is_dropped_when_failed_units_are_calibrated_again(
    operator: Operator, started: list[RunRequest]
) -> None:
    use_slots(operator, 2)
    begin(operator)
    units = operator.run.units
    operator.window.app.engine_link._end()
    operator.until(lambda: operator.run.ended)
    operator.scan("TX-1")
    operator.window.operator_page._starting.fill_again(units)
    assert field(operator) == ""
    operator.press("start_button")
    assert [request.serials for request in started] == [("SN-000001", "SN-000002")]
