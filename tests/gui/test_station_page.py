"""The station page, operated by clicks: validation while typing, versions, connection tests, operator permissions."""

import math
import re
import tomllib
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any, get_args

import pytest
import tomli_w
from PySide6.QtCore import QPoint, QPointF, Qt
from PySide6.QtGui import QWheelEvent
from PySide6.QtWidgets import (
    QApplication,
    QComboBox,
    QLabel,
    QLineEdit,
    QListWidget,
    QPushButton,
    QScrollArea,
    QWidget,
)
from pytestqt.qtbot import QtBot

from calstation.bench import BenchClock, BenchHost
from calstation.config import RunRequest, library, this_computer, versions
from calstation.config import access as role
from calstation.config.editing import check_data
from calstation.connection import SerialPortInfo
from calstation.devices.links.serial_link import Reason
from calstation.errors import ConfigurationError, DeviceFaultError
from calstation.gui.operator.verdict import VerdictPanel
from calstation.gui.settings import StationPage
from calstation.gui.settings import page as page_module
from calstation.gui.settings.table_section import TableSection, TravelPlot
from calstation.gui.shell.main_window import MainWindow
from calstation.gui.state import AppContext, RunStrip
from calstation.gui.state.engine_link import EngineLink
from calstation.gui.text import language
from calstation.gui.widgets import NoticeBar, problem_text, theme
from calstation.messages import Finding, Report
from calstation.messages.catalogue import family
from calstation.sequencer import Fault
from tests.gui.station_driver import PIN, PageDriver, station_page
from tests.site_folder import STATION as STATION_DATA

pytestmark = pytest.mark.long

(
    STATION,
    TABLE_LINK,
    CHAMBER_LINK,
    IMU_LINK,
    SITE,
    RECORDS,
    LABORATORY,
    OPERATORS,
    TABLE,
    PROFILES,
    PERSONAL,
) = range(11)
LATCHED = DeviceFaultError("table.latched_interlock", fault="interlock", station_options="")


@pytest.fixture
def operator(app: AppContext, site_folder: Any, qtbot: QtBot) -> PageDriver:
    """The page below its header, without the window, in the role of an operator."""
    return station_page(app, site_folder, qtbot, PageDriver)


@pytest.fixture
def page_driver(operator: PageDriver) -> PageDriver:
    """The page in the role of an engineer."""
    operator.app.role.set_first_pin(PIN)
    return operator


@pytest.fixture
def whole(window: MainWindow, qtbot: QtBot) -> PageDriver:
    """The page in the main window, in the role of an engineer."""
    window.app.role.set_first_pin(PIN)
    window.show_page("station_page")
    page = window.findChild(StationPage, "station_page")
    assert isinstance(page, StationPage)
    return PageDriver(window, page, qtbot)


@pytest.fixture
def chinese() -> Iterator[Callable[[], None]]:
    """Switch to Chinese, and back to English afterwards."""
    yield lambda: language.use("zh_CN")
    language.use("en")


def saved(path: Path) -> dict[str, Any]:
    return tomllib.loads(path.read_text(encoding="utf-8"))


# Who may do what


def test_an_operator_can_read_but_not_change_values(operator: PageDriver) -> None:
    page_driver = operator
    page_driver.show_section(SITE)
    edit = page_driver.find(QLineEdit, "site_latitude_deg_edit")
    assert edit.text() == "34.25"
    names = [
        "name_edit",
        "site_latitude_deg_edit",
        "outer_low_deg_edit",
        "handover_folder_edit",
        "new_pin_edit",
    ]
    for widget in [
        *(page_driver.find(QLineEdit, name) for name in names),
        page_driver.find(QComboBox, "station_combo"),
    ]:
        assert not widget.isEnabled()
        assert "engineer" in widget.toolTip()
    assert page_driver.page.profiles.editor.isReadOnly()
    page_driver.app.role.set_first_pin(PIN)
    assert edit.isEnabled()
    assert edit.toolTip() == ""
    page_driver.app.role.lock()
    assert not edit.isEnabled()


def test_an_operator_can_change_language_and_theme(whole: PageDriver, window: MainWindow, qtbot: QtBot) -> None:
    page_driver = whole
    page_driver.app.role.lock()
    page_driver.show_section(PERSONAL)
    page_driver.choose("theme_combo", "dark")
    assert theme.current() == "dark"
    page_driver.choose("station_language_combo", "中文")
    assert language.current() == "zh_CN"
    qtbot.waitUntil(lambda: window.language_combo.currentData() == "zh_CN")
    assert page_driver.page.nav.item(SITE).text() == "站址"
    page_driver.choose("station_language_combo", "English")
    qtbot.waitUntil(lambda: page_driver.page.nav.item(SITE).text() == "Site")


# Checking and saving


def test_invalid_value_shows_an_error_and_cannot_be_saved(page_driver: PageDriver, site_folder: Any) -> None:
    page_driver.show_section(SITE)
    before = site_folder.station.read_bytes()
    page_driver.type("site_latitude_deg_edit", "95")
    assert page_driver.message("site_latitude_deg") == "Out of range; it must be at most 90."
    save = page_driver.find(QPushButton, "save_station_button")
    assert not save.isEnabled()
    assert save.toolTip() == "Correct first, in “test”: Site, Latitude: Out of range; it must be at most 90."
    language.use("zh_CN")
    assert save.toolTip() == "请先改正“test”：站址，纬度：超出范围，不得大于 90。"
    language.use("en")
    assert page_driver.find(QLabel, "unsaved_label").text() == "● Not saved: test"
    page_driver.type("site_latitude_deg_edit", "ten")
    assert page_driver.message("site_latitude_deg") == "Not a number; type one like 12.5."
    page_driver.type("site_height_m_edit", "")
    assert page_driver.message("site_height_m") == "Missing; fill it in."
    page_driver.press("discard_station_button")
    assert page_driver.find(QLineEdit, "site_latitude_deg_edit").text() == "34.25"
    assert not save.isVisible()
    assert site_folder.station.read_bytes() == before


def test_saving_creates_a_version_and_keeps_comments(page_driver: PageDriver, site_folder: Any) -> None:
    text = "# our line\n" + site_folder.station.read_text(encoding="utf-8")
    site_folder.station.write_text(text, encoding="utf-8")
    page_driver.show_section(SITE)
    page_driver.page.discard()
    page_driver.page.drafts.station.open(site_folder.station)
    notified: list[int] = []
    page_driver.app.station_changed.connect(lambda: notified.append(1))
    page_driver.type("site_latitude_deg_edit", "39.9")
    page_driver.press("save_station_button")
    assert saved(site_folder.station)["site"]["latitude_deg"] == 39.9
    assert site_folder.station.read_text(encoding="utf-8").startswith("# our line\n")
    latest = versions.list_versions("stations", "test")[0]
    assert latest.author == page_driver.page.drafts.author.by
    assert notified
    assert page_driver.find(QLabel, "unsaved_label").text() == "✓ Saved: test"
    page_driver.type("site_latitude_deg_edit", "39")
    assert "Not saved" in page_driver.find(QLabel, "unsaved_label").text()


def test_shared_database_and_archive_can_be_edited(page_driver: PageDriver, site_folder: Any) -> None:
    page_driver.show_section(RECORDS)
    page_driver.type("records_database_edit", "postgresql+psycopg://station:secret@db/calstation")
    assert "contains a password" in page_driver.message("records_database")
    assert not page_driver.find(QPushButton, "save_station_button").isEnabled()
    url = "postgresql+psycopg://station@db/calstation"
    page_driver.type("records_database_edit", url)
    page_driver.type("records_archive_edit", "s3://logs/plant-2")
    page_driver.press("save_station_button")
    assert saved(site_folder.station)["records"] == {"database": url, "archive": "s3://logs/plant-2"}
    page_driver.type("records_archive_edit", "")
    page_driver.press("save_station_button")
    assert saved(site_folder.station)["records"] == {"database": url}


def test_current_station_is_listed_once(page_driver: PageDriver, site_folder: Any) -> None:
    box = page_driver.page.station_box
    listed = [box.itemText(i) for i in range(box.count())]
    assert len(listed) == len(set(listed))
    assert box.currentText() == "test (virtual bench)"


def test_edited_shipped_file_is_saved_in_the_site_folder(page_driver: PageDriver, site_folder: Any) -> None:
    page_driver.show_section(TABLE)
    page_driver.type("outer_high_deg_edit", "-2000")
    assert page_driver.message("outer_high_deg") == "The lowest angle, −1080°, must be below the highest, −2000°."
    assert "no travel" in page_driver.page.findChild(TravelPlot).accessibleName()
    page_driver.type("outer_high_deg_edit", "400")
    assert page_driver.message("outer_high_deg") == ""
    assert "1480° in all" not in page_driver.page.findChild(TravelPlot).accessibleName()
    assert "4.11 turns in all" in page_driver.page.findChild(TravelPlot).accessibleName()
    page_driver.press("save_station_button")
    own = site_folder.home / "tables" / "bench.toml"
    assert saved(own)["outer"]["high_deg"] == 400
    assert "CiA 402" in own.read_text(encoding="utf-8")
    assert [v.number for v in versions.list_versions("tables", "bench")] == [2, 1]


@pytest.mark.parametrize(("code", "middle"), [("en", "Middle axis"), ("zh_CN", "中框")])
def test_middle_joint_of_a_gimbal_is_edited(page_driver: PageDriver, site_folder: Any, code: str, middle: str) -> None:
    page_driver.show_section(TABLE)
    shown = page_driver.page.findChild(TableSection)
    assert middle not in [text.text() for text in shown.findChildren(QLabel) if text.isVisible()]
    assert not page_driver.find(QLineEdit, "middle_high_deg_edit").isVisible()
    language.use(code)
    page_driver.app.set_station(library.find("stations", "virtual_gimbal"))
    assert middle in [text.text() for text in shown.findChildren(QLabel) if text.isVisible()]
    assert page_driver.find(QWidget, "middle_axis_edit").isVisible()
    assert page_driver.page.findChild(TravelPlot).accessibleName().count("170°") == 3
    assert shown.minimumSizeHint().width() <= 1024, "beside the list of sections in a window of 1280 px"
    page_driver.type("middle_high_deg_edit", "80")
    page_driver.press("save_station_button")
    assert saved(site_folder.home / "tables" / "gimbal.toml")["middle"]["high_deg"] == 80
    language.use("en")


def test_an_axis_must_be_a_unit_vector(page_driver: PageDriver) -> None:
    page_driver.show_section(TABLE)
    edits = page_driver.find(QWidget, "outer_axis_edit").findChildren(QLineEdit)
    edits[1].setFocus()
    edits[1].selectAll()
    page_driver._bot.keyClicks(edits[1], "0.5")
    assert page_driver.message("outer_axis") == "1.0, 0.5, 0.0 has length 1.11803. Give a unit vector."
    page_driver._bot.keyClicks(edits[1], "x")
    assert page_driver.message("outer_axis") == "Not a number; type one like 12.5."


def test_gravity_is_compared_with_normal_gravity_while_typing(page_driver: PageDriver) -> None:
    page_driver.show_section(SITE)
    normal = page_driver.find(QLabel, "normal_gravity_label")
    assert normal.text() == "9.79547 m/s²"
    page_driver.type("site_latitude_deg_edit", "60")
    assert normal.text() == "9.81794 m/s²"
    page_driver.choose("gravity_way_combo", "surveyed")
    edit = page_driver.find(QLineEdit, "site_gravity_mps2_edit")
    page_driver.type("site_gravity_mps2_edit", "9.80")
    assert "−0.18 % from normal gravity" in page_driver.message("site_gravity_mps2")
    assert "off by −1828 ppm" in page_driver.message("site_gravity_mps2")
    page_driver.type("site_gravity_sigma_mps2_edit", "1e-4")
    page_driver.type("site_gravity_source_edit", "Report 118")
    assert page_driver.find(QPushButton, "save_station_button").isEnabled(), "advice does not prevent saving"
    page_driver.choose("gravity_way_combo", "normal")
    assert not edit.isVisible()


def test_product_with_which_the_station_starts_is_chosen(page_driver: PageDriver, site_folder: Any) -> None:
    page_driver.show_section(STATION)
    page_driver.choose("product_edit", "tactical_b")
    page_driver.press("save_station_button")
    assert saved(site_folder.station)["product"] == "tactical_b"
    language.use("zh_CN")
    page_driver.choose("product_edit", "本工位可标定的第一个产品型号")
    language.use("en")
    page_driver.press("save_station_button")
    assert "product" not in saved(site_folder.station)


def test_surveyed_gravity_is_typed_with_sigma_and_source(page_driver: PageDriver, site_folder: Any) -> None:
    page_driver.copy_station("line_8")
    page_driver.show_section(SITE)
    names = ["site_gravity_mps2", "site_gravity_sigma_mps2", "site_gravity_source"]
    page_driver.choose("gravity_way_combo", "surveyed")
    assert [page_driver.find(QLineEdit, f"{name}_edit").text() for name in names] == ["", "", ""]
    assert [page_driver.message(name) for name in names] == ["Missing; fill it in."] * 3
    save = page_driver.find(QPushButton, "save_station_button")
    for name, text in zip(names, ("9.7961", "2e-5", "Gravity network, report 118"), strict=True):
        assert not save.isVisible() or not save.isEnabled(), name
        page_driver.type(f"{name}_edit", text)
    page_driver.press("save_station_button")
    site = saved(library.find("stations", "line_8"))["site"]
    survey = {"gravity_mps2": 9.7961, "gravity_sigma_mps2": 2e-5, "gravity_source": "Gravity network, report 118"}
    assert {name: value for name, value in site.items() if name in survey} == survey
    page_driver.choose("gravity_way_combo", "normal")
    page_driver.choose("gravity_way_combo", "surveyed")
    assert page_driver.find(QLineEdit, "site_gravity_mps2_edit").text() == "9.7961", "the value of the file"
    page_driver.choose("gravity_way_combo", "normal")
    page_driver.press("save_station_button")
    assert not survey.keys() & saved(library.find("stations", "line_8"))["site"].keys()


def test_values_of_another_station_are_never_filled_in(page_driver: PageDriver) -> None:
    page_driver.show_section(SITE)
    page_driver.choose("station_combo", "virtual_bench")
    assert page_driver.find(QLineEdit, "site_gravity_mps2_edit").text() == "9.79547"
    assert "Is it surveyed" not in page_driver.message("site_gravity_mps2"), "a bench simulates this gravity"
    page_driver.copy_station("line_9")
    for box, choice, edit in (
        ("gravity_way_combo", "surveyed", "site_gravity_mps2_edit"),
        ("azimuth_way_combo", "given", "site_azimuth_deg_edit"),
    ):
        page_driver.choose(box, choice)
        assert page_driver.find(QLineEdit, edit).text() == ""
    page_driver.type("site_height_m_edit", "410")
    assert not page_driver.find(QPushButton, "save_station_button").isEnabled()


@pytest.mark.parametrize(("words", "question"), [("en", "Is it surveyed?"), ("zh_CN", "确为实测值吗？")])
def test_surveyed_gravity_equal_to_normal_gravity_is_questioned(
    page_driver: PageDriver, words: str, question: str
) -> None:
    page_driver.copy_station("line_9")
    page_driver.show_section(SITE)
    page_driver.choose("gravity_way_combo", "surveyed")
    page_driver.type("site_gravity_mps2_edit", page_driver.find(QLabel, "normal_gravity_label").text().split()[0])
    language.use(words)
    assert question in page_driver.message("site_gravity_mps2")
    page_driver.type("site_gravity_mps2_edit", "9.79600")
    assert question not in page_driver.message("site_gravity_mps2")


@pytest.mark.parametrize(
    ("words", "question", "hints"),
    [
        ("en", "but its sigma is 0.1 ppm", ("If empty, 5e-4", "Standard uncertainty stated")),
        ("zh_CN", "1σ 只有 0.1 ppm", ("留空时取 5e-4", "测量报告给出")),
    ],
)
def test_sigma_of_computed_gravity_is_questioned(
    page_driver: PageDriver, words: str, question: str, hints: tuple[str, str]
) -> None:
    page_driver.show_section(SITE)
    page_driver.copy_station("line_9")
    language.use(words)
    for station, hint in (("virtual_bench", hints[1]), ("line_9", hints[0]), ("virtual_bench", hints[1])):
        page_driver.choose("station_combo", station)
        assert hint in page_driver.message("site_gravity_sigma_mps2")
    page_driver.choose("station_combo", "line_9")
    page_driver.type("site_gravity_sigma_mps2_edit", "1e-6")
    assert question in page_driver.message("site_gravity_sigma_mps2")
    page_driver.type("site_gravity_sigma_mps2_edit", "5e-4")
    assert hints[0] in page_driver.message("site_gravity_sigma_mps2")


def test_sigmas_of_gravity_and_clock_are_saved_and_removed(page_driver: PageDriver, site_folder: Any) -> None:
    page_driver.show_section(SITE)
    page_driver.type("site_gravity_sigma_mps2_edit", "0")
    assert "greater than 0" in page_driver.message("site_gravity_sigma_mps2")
    page_driver.type("site_gravity_sigma_mps2_edit", "2e-6")
    page_driver.show_section(STATION)
    page_driver.type("clock_error_ppm_edit", "1")
    page_driver.press("save_station_button")
    station = saved(site_folder.station)
    assert (station["site"]["gravity_sigma_mps2"], station["clock_error_ppm"]) == (2e-6, 1)
    page_driver.type("clock_error_ppm_edit", "")
    page_driver.press("save_station_button")
    assert "clock_error_ppm" not in saved(site_folder.station)


def test_a_site_is_confirmed_on_this_computer(page_driver: PageDriver) -> None:
    page_driver.show_section(SITE)
    assert not page_driver.find(QPushButton, "confirm_place_button").isVisible(), (
        "a virtual bench has no site to confirm"
    )
    page_driver.copy_station("line_3")
    assert "This site has not been confirmed" in page_driver.message("site_confirmed_on")
    page_driver.press("confirm_place_button")
    page_driver.press("save_station_button")
    path = library.find("stations", "line_3")
    here = f"{this_computer()}: 34.25 108.9 400.0 normal"
    assert saved(path)["site"]["confirmed_on"] == [here]
    assert page_driver.message("site_confirmed_on").startswith("✓")
    assert not page_driver.find(QPushButton, "confirm_place_button").isVisible()
    draft, confirmed = page_driver.page.drafts.station, ("site", "confirmed_on")
    draft.set({confirmed: ["plant-2: 34.25 108.9 400.0 normal", here]})
    page_driver.type("site_height_m_edit", "1200")
    assert "not this one on this computer" in page_driver.message("site_confirmed_on"), (
        "the confirmation is of another height"
    )
    page_driver.press("confirm_place_button")
    assert draft.value(confirmed) == [
        "plant-2: 34.25 108.9 400.0 normal",
        f"{this_computer()}: 34.25 108.9 1200.0 normal",
    ]
    page_driver.type("site_height_m_edit", "ten")
    assert not page_driver.find(QPushButton, "confirm_place_button").isVisible(), "a wrong value cannot be confirmed"


def test_azimuth_estimated_from_the_data_is_not_stored(page_driver: PageDriver, site_folder: Any) -> None:
    page_driver.show_section(SITE)
    page_driver.choose("azimuth_way_combo", "determined")
    page_driver.press("save_station_button")
    assert "azimuth_deg" not in saved(site_folder.station)["site"]
    page_driver.choose("azimuth_way_combo", "given")
    page_driver.type("site_azimuth_deg_edit", "")
    assert page_driver.find(QLineEdit, "site_azimuth_deg_edit").isVisible(), (
        "the input stays while a new value is typed"
    )
    page_driver.type("site_azimuth_deg_edit", "90.5")
    page_driver.press("save_station_button")
    assert saved(site_folder.station)["site"]["azimuth_deg"] == 90.5


# Leaving


@pytest.mark.parametrize(
    "answer",
    [
        "stay_button",
        *(pytest.param(other, marks=pytest.mark.long) for other in ("discard_and_go_button", "save_and_go_button")),
    ],
)
def test_leaving_the_page_with_unsaved_changes_asks_for_confirmation(
    whole: PageDriver, window: MainWindow, site_folder: Any, answer: str
) -> None:
    page_driver, tabs = whole, window.page_tabs
    page_driver.type("name_edit", "line 7")
    tabs.setCurrentIndex(0)
    assert page_driver.page.isVisible()
    assert page_driver.page.notice.asking
    page_driver.press(answer)
    assert not page_driver.page.notice.asking
    assert page_driver.page.isVisible() == (answer == "stay_button")
    assert saved(site_folder.station)["name"] == ("line 7" if answer.startswith("save") else "test bench")


def test_question_about_changes_that_cannot_be_saved_focuses_the_answer_that_keeps_them(
    whole: PageDriver, window: MainWindow
) -> None:
    whole.type("name_edit", "")
    window.page_tabs.setCurrentIndex(0)
    assert whole.page.notice.asking
    assert whole.find(QPushButton, "stay_button").hasFocus()
    whole.press("discard_and_go_button")


@pytest.mark.parametrize(("code", "reason"), [("en", "turned by hand"), ("zh_CN", "手")])
def test_station_page_says_why_no_run_is_possible(
    whole: PageDriver, window: MainWindow, code: str, reason: str
) -> None:
    window.app.set_product(library.find("products", "mems_hand"))
    window.app.set_language(code)
    (strip,) = whole.page.findChildren(RunStrip)
    assert window.app.run.problem is not None
    assert reason in "".join(label.text() for label in strip.findChildren(QLabel))
    window.app.set_language("en")


def test_closing_the_window_with_unsaved_changes_asks_for_confirmation(whole: PageDriver, window: MainWindow) -> None:
    page_driver = whole
    page_driver.type("name_edit", "line 7")
    assert not window.close()
    assert page_driver.page.notice.asking
    page_driver.press("discard_and_go_button")
    assert not window.isVisible()


# Stations


def test_a_new_station_is_a_copy_and_is_remembered(page_driver: PageDriver, site_folder: Any) -> None:
    page_driver.press("new_station_button")
    make = page_driver.find(QPushButton, "make_file_button")
    for name, reason in (("", "Enter a name first."), ("line 3", "Only letters"), ("test", "taken")):
        page_driver.type("new_name_edit", name)
        assert not make.isEnabled()
        assert reason in make.toolTip()
    page_driver.type("new_name_edit", "line_3")
    page_driver.press("make_file_button")
    path = site_folder.home / "stations" / "line_3.toml"
    assert saved(path)["name"] == "line_3"
    assert page_driver.app.station_path == path
    assert page_driver.find(QComboBox, "station_combo").currentText() == "line_3"
    assert AppContext().station_path == path, "remembered at the next start"
    page_driver.choose("station_combo", "virtual_bench (virtual bench)")
    assert page_driver.app.station_path == library.find("stations", "virtual_bench")


def test_a_copied_product_does_not_keep_the_name_of_its_source(page_driver: PageDriver, site_folder: Any) -> None:
    product = page_driver.page.drafts.create("products", "nav_8", library.find("products", "nav_a"))
    assert product == site_folder.home / "products" / "nav_8.toml"
    assert saved(product) == {**saved(library.find("products", "nav_a")), "name": "nav_8"}
    product.write_text("name = \n", encoding="utf-8")
    with pytest.raises(ConfigurationError):
        page_driver.page.drafts.create("products", "nav_9", product)


def test_file_from_another_folder_is_saved_under_an_unused_name(page_driver: PageDriver, tmp_path: Path) -> None:
    elsewhere = tmp_path / "test.toml"
    elsewhere.write_bytes((tmp_path / "home" / "stations" / "test.toml").read_bytes())
    page_driver.app.set_station(elsewhere)
    page_driver.type("name_edit", "from elsewhere")
    page_driver.press("save_station_button")
    assert page_driver.app.station_path == tmp_path / "home" / "stations" / "test-2.toml"
    assert saved(elsewhere)["name"] == "test bench"


# Links


def test_connection_tests_of_the_virtual_bench_pass(page_driver: PageDriver) -> None:
    for section, device, finding in (
        (TABLE_LINK, "table", "bench-table, serial number T-0001."),
        (IMU_LINK, "imu", "bench-imu, serial number SN-000001."),
    ):
        page_driver.show_section(section)
        page_driver.press(f"test_{device}_button")
        assert not page_driver.find(QPushButton, f"test_{device}_button").isEnabled()
        assert finding in page_driver.findings(device)
        assert page_driver.find(QWidget, f"{device}_test_badge").text() == "The link works"


def test_a_chamber_is_chosen_described_and_tested(page_driver: PageDriver, chinese: Callable[[], None]) -> None:
    page_driver.show_section(CHAMBER_LINK)
    page = page_driver.page
    assert not page.chamber_link.test.isVisible(), "there is no chamber"
    page_driver.choose("chamber_profile_combo", "virtual_chamber")
    page_driver.type("chamber_ambient_c_edit", "21")
    page_driver.type("chamber_dew_point_c_edit", "22")
    said = "The dew point, 22 °C, must be below the ambient temperature, 21 °C."
    assert page_driver.message("chamber_dew_point_c") == said
    page_driver.type("chamber_dew_point_c_edit", "12.5")
    assert page.drafts.station.value(("chamber",)) == {
        "profile": "virtual_chamber",
        "ambient_c": 21.0,
        "dew_point_c": 12.5,
    }
    assert page.nav.item(CHAMBER_LINK).text() == "Link to the chamber ●"
    page_driver.press("test_chamber_button")
    assert "Chamber bench-chamber." in page_driver.findings("chamber")
    chinese()
    assert page.nav.item(CHAMBER_LINK).text() == "温箱连接 ●"
    page_driver.choose("chamber_profile_combo", "无温箱")
    assert page.drafts.station.value(("chamber",)) is None
    assert not page.drafts.station.dirty


def test_a_chamber_of_a_station_with_hardware_needs_a_port(page_driver: PageDriver) -> None:
    page_driver.copy_station("line_3")
    page_driver.show_section(CHAMBER_LINK)
    page_driver.choose("chamber_profile_combo", "simserv")
    page_driver.choose("chamber_way_combo", "network (TCP)")
    assert page_driver.message("chamber_port").startswith("The port is missing.")
    page_driver.type("chamber_port_edit", "192.168.0.50:2049")
    assert page_driver.page.drafts.station.value(("chamber", "port")) == "tcp://192.168.0.50:2049"


def test_a_missing_port_is_explained_in_both_languages(page_driver: PageDriver, chinese: Callable[[], None]) -> None:
    page_driver.copy_station("line_3")
    page_driver.show_section(TABLE_LINK)
    page_driver.choose("table_way_combo", "serial line")
    assert page_driver.message("table_port").startswith("The port is missing. Add the port")
    test = page_driver.find(QPushButton, "test_table_button")
    assert not test.isEnabled()
    assert test.toolTip() == "Correct what is marked first."
    box = next(b for b in page_driver.root.findChildren(QComboBox, "table_port_edit") if b.isVisible())
    page_driver._bot.keyClicks(box.lineEdit(), "/dev/ttyNONE7")
    page_driver.press("test_table_button")
    findings = page_driver.findings("table")
    assert findings[0] == "Port /dev/ttyNONE7 does not exist."
    assert findings[1].startswith("Plug the adapter in, or choose another port.")
    chinese()
    page_driver._bot.waitUntil(lambda: page_driver.findings("table")[0] == "没有端口 /dev/ttyNONE7。")
    page_driver._bot.keyClicks(box.lineEdit(), "8")
    assert page_driver.page.table_link.test.report is None, "findings of other settings are removed"


def test_headline_of_warnings_does_not_claim_that_no_run_starts(
    page_driver: PageDriver, chinese: Callable[[], None]
) -> None:
    page_driver.show_section(TABLE_LINK)
    test = page_driver.page.table_link.test
    station = test._station()
    assert station is not None
    test._tested = test._settings(station)
    travel = {"joint": "outer", "low": -90.0, "high": 90.0, "profile_low": -1080.0, "profile_high": 1080.0}
    test._done(Report("table", (Finding("travel_narrower", "warning", travel),)))
    assert test.badge.text() == "The link works, with warnings"
    assert test._why.text() == "What is marked can prevent or end a run."
    chinese()
    page_driver._bot.waitUntil(lambda: test.badge.text() == "连接正常，但有警告")
    assert test._why.text() == "标出的项可能使标定无法开始或中途结束。"
    test._done(Report("table", (Finding("interlock", "ok"),)))
    assert not test._why.isVisible()


def test_an_operator_can_reset_a_latched_fault(
    operator: PageDriver, site_folder: Any, monkeypatch: pytest.MonkeyPatch, chinese: Callable[[], None]
) -> None:
    with closing(BenchHost.start({"speed": 0.0})) as host:
        where, _, port = host.endpoints["clock"].rpartition(":")
        clock = BenchClock((where, int(port)), 0.0)
        clock.inject({"order": "drive_fault"})
        link = {"profile": "bench", "port": f"tcp://{host.endpoints['table']}", "timeout_s": 5.0}
        real = {
            "name": "line 3",
            "site": STATION_DATA["site"],
            "table": link,
            "imu": {"port": "/dev/ttyNONE9"},
        }
        site_folder.station.write_text(tomli_w.dumps(real), encoding="utf-8")
        operator.app.station_changed.emit()
        operator.show_section(TABLE_LINK)
        reset = operator.find(QPushButton, "table_reset_button")
        assert not reset.isVisible(), "no fault is known yet"
        operator.press("test_table_button")
        assert "The fault “drive” is latched." in operator.findings("table")
        assert reset.isVisible()
        assert not reset.hasFocus(), "the focus must not move to the reset button"
        operator.app.engine_link.request = RunRequest("SN-000042", site_folder.station)
        with monkeypatch.context() as going:
            going.setattr(EngineLink, "running", property(lambda _: True))
            operator.app.engine_link.running_changed.emit(True)
            assert not reset.isEnabled()
            assert reset.toolTip() == "A run is in progress; reset after it has ended."
        operator.app.engine_link.running_changed.emit(False)
        result = operator.find(QLabel, "table_reset_button_result")
        operator.press("table_reset_button")
        operator._bot.waitUntil(lambda: "was reset" in result.text(), timeout=60_000)
        operator.findings("table")
        assert operator.find(QWidget, "table_test_badge").text() == "The link works", (
            "the test is repeated after a reset"
        )
        assert not reset.isVisible()
        chinese()
        operator._bot.waitUntil(lambda: result.text() == "故障“驱动器”已复位；现在没有锁存的故障。")
        language.use("en")

        # The same from the verdict of a run; an open interlock keeps the fault latched.
        clock.inject({"order": "interlock", "value": 0})
        verdict = VerdictPanel(operator.app, NoticeBar(), NoticeBar(), lambda: None)
        operator._bot.addWidget(verdict)
        verdict.show()
        run = operator.app.run
        run.state, run.fault = "fault", Fault.of(DeviceFaultError("program.internal", detail="x"))
        verdict.show_end()
        assert not verdict.reset.isVisible()
        run.fault = Fault.of(LATCHED)
        verdict.show_end()
        assert verdict.action_label.text() == "Close the cover, then press “Reset the fault”."
        for closed, words in (
            (0, "the interlock is open"),
            (1, "The fault 'interlock' was reset"),
        ):
            clock.inject({"order": "interlock", "value": closed})
            operator._bot.mouseClick(verdict.reset.button, Qt.MouseButton.LeftButton)
            operator._bot.waitUntil(lambda w=words: w in verdict.reset.result_label.text(), timeout=60_000)
            assert verdict.reset.button.isVisible() == (not closed)
        clock.close()


def test_a_usb_adapter_is_chosen_by_its_serial_number(page_driver: PageDriver) -> None:
    page_driver.copy_station("line_3")
    page_driver.show_section(IMU_LINK)
    link = page_driver.page.imus.link
    page_driver._bot.waitUntil(lambda: not link.searching.busy, timeout=30_000)
    ports = (
        SerialPortInfo("/dev/ttyUSB4", "FT232R USB UART", "FTDI", "A9XYZ", "1-2", "usb:A9XYZ"),
        SerialPortInfo("/dev/ttyS0", "", "", None, "", None),
    )
    link.port_box.show_ports(ports)
    page_driver.choose("imu_port_edit", "usb:A9XYZ")
    assert link.port_box.currentText() == "usb:A9XYZ"
    assert page_driver.message("imu_port") == "FT232R USB UART, FTDI · /dev/ttyUSB4"
    page_driver.press("save_station_button")
    assert saved(library.find("stations", "line_3"))["imu"]["port"] == "usb:A9XYZ"


@pytest.mark.parametrize(("code", "absent"), [("en", "This port is not present now."), ("zh_CN", "当前未找到此端口。")])
def test_unlisted_port_that_exists_is_not_called_absent(
    page_driver: PageDriver, tmp_path: Path, code: str, absent: str
) -> None:
    page_driver.copy_station("line_3")
    page_driver.show_section(IMU_LINK)
    link, line = page_driver.page.imus.link, tmp_path / "imu_line3"
    page_driver._bot.waitUntil(lambda: not link.searching.busy and link._searched, timeout=30_000)
    language.use(code)
    page_driver.page.drafts.station.set({("imu", "port"): str(line)})
    assert page_driver.message("imu_port") == absent
    (tmp_path / "ttyX0").touch()
    line.symlink_to(tmp_path / "ttyX0")
    link._ports["serial"].refresh()
    assert page_driver.message("imu_port") == ""
    language.use("en")


@pytest.mark.parametrize("code", ["en", "zh_CN"])
def test_effect_of_the_latitude_is_the_largest_at_any_latitude(page_driver: PageDriver, code: str) -> None:
    page_driver.show_section(SITE)
    language.use(code)
    turned = math.radians(1.0) * 15.041  # °/h, the change of the earth rate's direction by 1°
    assert f"{turned:.2f} °/h" in page_driver.message("site_latitude_deg")
    language.use("en")


def test_serial_settings_come_from_the_profile_or_the_station(page_driver: PageDriver) -> None:
    page_driver.copy_station("line_3")
    page_driver.show_section(IMU_LINK)
    draft = page_driver.page.drafts.station
    page_driver.choose("imu_own_serial_combo", "the profile's (921600 8N1)")
    assert draft.value(("imu", "serial")) is None
    page_driver.choose("imu_own_serial_combo", "this station's own")
    assert draft.value(("imu", "serial")) == {"baud": 921600, "data_bits": 8, "parity": "N", "stop_bits": 1}
    box = page_driver.find(QComboBox, "imu_serial_baud_edit")
    box.lineEdit().clear()
    page_driver._bot.keyClicks(box.lineEdit(), "12.5")
    assert page_driver.message("imu_serial_baud") == "Not a whole number; type one like 12."
    page_driver.show_section(TABLE_LINK)
    page_driver.type("table_unit_edit", "300")
    assert page_driver.message("table_unit") == "Out of range; it must be at most 255."


def test_a_run_prevents_connection_tests_and_saving(page_driver: PageDriver, monkeypatch: pytest.MonkeyPatch) -> None:
    page_driver.show_section(TABLE_LINK)
    page_driver.app.engine_link.request = RunRequest("SN-000042")
    monkeypatch.setattr(EngineLink, "running", property(lambda _: True))
    page_driver.app.engine_link.running_changed.emit(True)
    button = page_driver.find(QPushButton, "test_table_button")
    assert not button.isEnabled()
    assert button.toolTip() == "A run is in progress; test after it has ended."
    page_driver.show_section(STATION)
    page_driver.type("name_edit", "line 7")
    save = page_driver.find(QPushButton, "save_station_button")
    assert not save.isEnabled()
    assert save.toolTip() == "A run is in progress; changes can be saved after it has ended."
    assert not page_driver.find(QComboBox, "station_combo").isEnabled()
    assert page_driver.page.may_leave(lambda: None), "during a run the page can be left"
    monkeypatch.undo()
    page_driver.app.engine_link.running_changed.emit(False)
    assert button.isEnabled()
    assert save.isEnabled()


def test_tab_key_follows_the_reading_order_and_the_wheel_changes_no_value(page_driver: PageDriver) -> None:
    page_driver.show_section(SITE)
    page_driver.choose("gravity_way_combo", "surveyed")
    order = ["site_latitude_deg_edit", "site_longitude_deg_edit", "site_height_m_edit", "azimuth_way_combo"]
    order += ["site_azimuth_deg_edit", "gravity_way_combo", "site_gravity_mps2_edit", "site_gravity_sigma_mps2_edit"]
    widget = page_driver.find(QLineEdit, order[0])
    widget.setFocus()
    for name in order:
        assert QApplication.focusWidget() is page_driver.find(QWidget, name), name
        page_driver._bot.keyClick(QApplication.focusWidget(), Qt.Key.Key_Tab)
    box = page_driver.find(QComboBox, "gravity_way_combo")
    event = QWheelEvent(
        QPointF(5, 5), box.mapToGlobal(QPointF(5, 5)), QPoint(), QPoint(0, -120),
        Qt.MouseButton.NoButton, Qt.KeyboardModifier.NoModifier, Qt.ScrollPhase.NoScrollPhase, False,
    )  # fmt: skip
    QApplication.sendEvent(box, event)
    assert box.currentText().startswith("surveyed")


def test_every_finding_has_a_catalogue_text() -> None:
    source = "".join(
        (Path(page_module.__file__).parents[2] / "connection" / f"{name}.py").read_text(encoding="utf-8")
        for name in ("link_test", "table_test", "imu_test")
    )
    ids = set(re.findall(r'Finding\(\s*"(\w+)"', source)) | set(get_args(Reason))
    ids |= set(re.findall(r'Finding\(\s*"(\w+)" if [^"]+ else "(\w+)"', source).__iter__().__next__())
    assert len(ids) > 40
    assert {f"finding.{name}" for name in ids} <= set(family("finding"))


def test_a_problem_without_a_field_message_shows_its_own_message() -> None:
    (problem,) = check_data("products", {"name": "x", "imu": "bench_nav", "serial_pattern": "(", "limits": {}})
    assert problem_text(problem).startswith("“(” is not a regular expression")


# Profiles as text


def test_files_added_outside_the_window_are_listed(page_driver: PageDriver) -> None:
    page_driver.show_section(PROFILES)
    files = page_driver.page.profiles.file_box
    text = library.find("products", "nav_a").read_text(encoding="utf-8")
    (library.site_folder() / "products").mkdir(parents=True, exist_ok=True)
    (library.site_folder() / "products" / "nav_b.toml").write_text(text, encoding="utf-8")
    assert files.findText("nav_b") < 0
    page_driver.show_section(IMU_LINK)
    box = page_driver.find(QComboBox, "imu_test_product")
    box.showPopup()
    assert box.findData("nav_b") >= 0
    box.hidePopup()
    page_driver.show_section(PROFILES)
    assert files.findText("nav_b") >= 0


def test_clicking_a_problem_opens_its_line_in_the_text(page_driver: PageDriver) -> None:
    page_driver.show_section(PROFILES)
    profiles = page_driver.page.profiles
    profiles.open("products", "nav_a")
    profiles.editor.setPlainText(profiles.editor.toPlainText().replace("turns = 2", "turns = 0"))
    problems = page_driver.find(QListWidget, "problems_list")
    assert problems.count() == 1
    assert problems.item(0).text().startswith("Line 19: schedule.rate.turns: 0 is out of range")
    problems.setCurrentRow(0)
    problems.itemClicked.emit(problems.item(0))
    assert profiles.editor.textCursor().blockNumber() == 18
    assert not page_driver.find(QPushButton, "save_station_button").isEnabled()


def test_versions_can_be_compared_and_restored(page_driver: PageDriver, site_folder: Any) -> None:
    page_driver.show_section(PROFILES)
    profiles = page_driver.page.profiles
    profiles.open("products", "nav_a")
    for turns in (3, 4):
        text = re.sub(r"turns = \d", f"turns = {turns}", profiles.editor.toPlainText())
        profiles.editor.setPlainText(text)
        page_driver.press("save_station_button")
    own = site_folder.home / "products" / "nav_a.toml"
    assert saved(own)["schedule"]["rate"]["turns"] == 4
    page_driver.show_view("Compare")
    listed = page_driver.find(QListWidget, "versions_list")
    assert [listed.item(i).text().split()[0] for i in range(listed.count())] == ["3", "2", "1"]
    assert "current" in listed.item(0).text()
    listed.setCurrentRow(2)
    page_driver.press("compare_button")
    shown = profiles.diff.toPlainText()
    assert "-turns = 2" in shown
    assert "+turns = 4" in shown
    page_driver.press("take_back_button")
    assert "turns = 2" in profiles.editor.toPlainText()
    page_driver.press("save_station_button")
    assert saved(own)["schedule"]["rate"]["turns"] == 2
    assert versions.list_versions("products", "nav_a")[0].number == 4


@pytest.mark.parametrize(
    ("code", "compare", "words"),
    [
        ("en", "Compare", "not that of version 3, the latest: the file was changed outside"),
        ("zh_CN", "比较", "与最新的版本 3 不同：文件在程序之外被改动"),
    ],
)
def test_file_changed_outside_is_not_shown_as_its_latest_version(
    page_driver: PageDriver, site_folder: Any, code: str, compare: str, words: str
) -> None:
    page_driver.show_section(PROFILES)
    profiles = page_driver.page.profiles
    profiles.open("products", "nav_a")
    note = page_driver.find(QLabel, "changed_outside_label")
    for turns in (3, 4):
        profiles.editor.setPlainText(re.sub(r"turns = \d", f"turns = {turns}", profiles.editor.toPlainText()))
        page_driver.press("save_station_button")
        assert not note.isVisible()
    own = site_folder.home / "products" / "nav_a.toml"
    own.write_text(own.read_text("utf-8").replace("turns = 4", "turns = 3"), "utf-8")
    page_driver.page.hide()
    language.use(code)
    page_driver.page.show()
    page_driver.show_view(compare)
    assert note.isVisible()
    assert words in note.text()
    assert words in profiles.diff.toPlainText(), "beside the sentence that the present text is the saved one"
    language.use("en")


def test_form_and_text_of_a_file_show_the_same_values(page_driver: PageDriver) -> None:
    page_driver.show_section(PROFILES)
    page_driver.page.profiles.open("stations", "test")
    page_driver.page.profiles.editor.setPlainText(
        page_driver.page.profiles.editor.toPlainText().replace("34.25", "12.5")
    )
    page_driver.show_section(SITE)
    assert page_driver.find(QLineEdit, "site_latitude_deg_edit").text() == "12.5"
    page_driver.type("site_latitude_deg_edit", "13.5")
    assert "latitude_deg = 13.5" in page_driver.page.profiles.editor.toPlainText()


def test_file_changed_on_another_page_is_reloaded(page_driver: PageDriver, site_folder: Any) -> None:
    page_driver.show_section(PROFILES)
    profiles = page_driver.page.profiles
    profiles.open("products", "short")
    for turns, notify in ((3, page_driver.app.product_changed.emit), (4, page_driver.page.hide)):
        text = re.sub(r"turns = \d", f"turns = {turns}", profiles.editor.toPlainText(), count=1)
        versions.save("products", "short", text, "wang")
        notify()
        page_driver.page.show()
        assert profiles.editor.toPlainText() == text
        assert page_driver.find(QListWidget, "versions_list").item(0).text().startswith(str(turns - 1))
    profiles.editor.setPlainText(text + "# checked\n")
    page_driver.press("save_station_button")
    assert saved(site_folder.product)["schedule"]["rate"]["turns"] == 4


def test_text_and_form_of_a_table_share_one_draft(page_driver: PageDriver) -> None:
    page_driver.show_section(PROFILES)
    profiles = page_driver.page.profiles
    profiles.open("tables", "cia402_drives")
    profiles.editor.setPlainText(profiles.editor.toPlainText() + "# checked\n")
    page_driver.page.drafts.station.set({("table", "profile"): "cia402_drives"})
    table = page_driver.page.drafts.table
    assert table.name == "cia402_drives"
    assert table.text == profiles.editor.toPlainText()
    table.set({("outer", "high_deg"): 400})
    assert "high_deg = 400" in profiles.editor.toPlainText()
    page_driver.press("discard_station_button")
    assert (table.name, page_driver.page.drafts.dirty) == ("bench", [])
    assert profiles.editor.toPlainText() == library.find("tables", "cia402_drives").read_text(encoding="utf-8")


def test_invalid_toml_text_can_be_corrected(page_driver: PageDriver) -> None:
    page_driver.show_section(PROFILES)
    profiles = page_driver.page.profiles
    profiles.open("stations", "test")
    right = profiles.editor.toPlainText()
    profiles.editor.setPlainText(right.replace("[site]", "[site"))
    assert "not valid TOML" in page_driver.find(QLabel, "station_problem_label").text()
    page_driver.show_section(SITE)
    page_driver.type("site_latitude_deg_edit", "1")
    profiles.editor.setPlainText(right)
    assert page_driver.find(QLineEdit, "site_latitude_deg_edit").text() == "34.25"


# The engineer's PIN


def test_changing_the_pin_requires_the_current_pin(page_driver: PageDriver) -> None:
    page_driver.show_section(PERSONAL)
    message = page_driver.page.personal.pin_message

    def change(old: str, new: str, again: str) -> str:
        for name, text in (("old_pin_edit", old), ("new_pin_edit", new), ("new_pin_again_edit", again)):
            page_driver.type(name, text)
        page_driver.press("change_pin_button")
        return str(message.text())

    assert change("111111", "135792", "135798") == "The two are not the same."
    assert change(PIN, "13579", "13579") == "Too short: at least 6 characters."
    assert change("111111", "135792", "135792") == "The current PIN is wrong. Try again."
    assert role.check(PIN)
    assert change(PIN, "135792", "135792") == "The PIN has been changed."
    assert role.check("135792")
    (library.site_folder() / "engineer.json").write_text("{", encoding="utf-8")
    assert "engineer.json cannot be read" in change("135792", "246813", "246813")


def test_personal_pin_of_an_engineer_requires_the_site_pin(page_driver: PageDriver) -> None:
    page_driver.show_section(PERSONAL)
    page_driver.type("pin_badge_edit", "B0003")
    old = page_driver.find(QLineEdit, "old_pin_edit")
    assert old.placeholderText() == "the PIN of this site"
    for name, text in (("old_pin_edit", PIN), ("new_pin_edit", "333333"), ("new_pin_again_edit", "333333")):
        page_driver.type(name, text)
    page_driver.press("change_pin_button")
    message = page_driver.page.personal.pin_message.text()
    assert message.startswith("The PIN has been changed. No station of this site lists badge B0003 as")
    assert role.check("333333", "B0003")
    assert role.check(PIN)
    assert old.placeholderText() == ""


@pytest.mark.parametrize("code", ["en", "zh_CN"])
def test_no_section_is_wider_than_its_area_and_no_vector_is_shown_as_a_tuple(window: MainWindow, code: str) -> None:
    window.app.set_language(code)
    window.resize(1280, 720)
    window.show_page("station_page")
    page = window.findChild(StationPage)
    assert page is not None
    for number in range(page.nav.count()):
        page.nav.setCurrentRow(number)
        QApplication.processEvents()
        for area in page.findChildren(QScrollArea):
            if area.isVisible() and area.widget() in page._sections:
                assert area.widget().width() <= area.viewport().width(), page.nav.item(number).text()
        for edit in page.findChildren(QLineEdit):
            assert not edit.text().startswith("("), edit.objectName()
    language.use("en")
