"""The slots of a station as a form on the Station page: edited, saved and removed."""

import tomllib
from typing import Any

import pytest
from PySide6.QtWidgets import QPushButton
from pytestqt.qtbot import QtBot

from calstation.config import library, with_one_unit, with_slots
from calstation.gui.state import AppContext
from tests.gui.station_driver import PIN, station_page
from tests.gui.test_forms import FormDriver

pytestmark = pytest.mark.long

STATION, IMU_LINK = 0, 3


@pytest.fixture
def operator(app: AppContext, site_folder: Any, qtbot: QtBot) -> FormDriver:
    """The page in the role of an operator."""
    return station_page(app, site_folder, qtbot, FormDriver)


@pytest.fixture
def forms(operator: FormDriver) -> FormDriver:
    """The page in the role of an engineer."""
    operator.app.role.set_first_pin(PIN)
    return operator


def stored(name: str) -> str:
    return library.find("stations", name).read_text(encoding="utf-8")


def test_station_is_converted_to_slots_and_back_to_a_single_unit(forms: FormDriver) -> None:
    forms.copy_station("line_4")
    before = stored("line_4")
    forms.show_section(IMU_LINK)
    forms.press("several_units_button")
    assert forms.cell_text("1", "Port") == "/dev/ttyUSB0"
    forms.press("slots_add_button")
    assert "Row 2, Port" in forms.page.imus._problems.text()
    forms.enter("2", "Port", "usb:A9XYW")
    forms.enter("2", "Slot", "B1")
    forms.enter("2", "Lever y (mm)", "-125.5")
    forms.select("2", "Orientation", "-y+z: +z up, −y along x")
    forms.press("slots_up_button")
    forms.press("save_station_button")
    text = stored("line_4")
    slots = tomllib.loads(text)["slots"]
    first = {"name": "B1", "port": "usb:A9XYW", "orientation": "-y+z", "lever_m": [0.0, -0.1255, 0.0]}
    assert slots == [first, {"name": "1", "port": "/dev/ttyUSB0", "timeout_s": 1.0}]
    assert {line for line in before.splitlines() if "#" in line} <= set(text.splitlines()), "all comments are kept"
    forms.press("slots_remove_button")
    forms.press("slots_remove_button")
    forms.press("save_station_button")
    assert tomllib.loads(stored("line_4")) == tomllib.loads(before)


def test_operator_can_only_read_the_slots(operator: FormDriver) -> None:
    operator.show_section(IMU_LINK)
    button = operator.page.imus._several_button
    assert not button.isEnabled()
    assert "engineer" in button.toolTip()
    draft = operator.page.drafts.station
    draft.rewrite(with_slots(draft.text))
    assert operator.cell_text("1", "Slot") == "1"
    operator.click("1", "Slot", twice=True)
    assert operator.table.indexWidget(operator.index("1", "Slot")) is None
    assert not operator.find(QPushButton, "slots_add_button").isEnabled()


def test_bench_section_has_a_field_for_the_number_of_units(forms: FormDriver) -> None:
    forms.show_section(STATION)
    forms.type("bench_units_edit", "17")
    assert "1 to 16" in forms.message("bench_units")
    forms.type("bench_units_edit", "4")
    forms.show_section(IMU_LINK)
    forms.press("several_units_button")
    draft = forms.page.drafts.station
    assert draft.value(("slots",)) == [{"name": str(number)} for number in range(1, 5)]
    assert draft.value(("bench", "units")) is None
    assert not draft.problems


def test_link_keeps_its_comments_when_converted_to_a_single_unit() -> None:
    text = '[imu] # of the fixture\nport = "COM3" # left\n[imu.serial]\nbaud = 9600 # old\n\n# notes\n'
    slots = with_slots(text)
    assert slots.startswith('[[slots]] # of the fixture\nname = "1"\nport = "COM3" # left\n[slots.serial]\n')
    assert with_one_unit(slots) == text
