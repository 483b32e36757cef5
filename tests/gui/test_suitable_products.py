"""Products that the station cannot calibrate are greyed with the reason, and a pair station leads to its monitoring."""

from pathlib import Path

import pytest
from PySide6.QtCore import Qt
from PySide6.QtGui import QStandardItemModel
from PySide6.QtWidgets import QComboBox, QLineEdit, QPushButton

from calstation.config import RunRequest, library
from calstation.gui.logs.methods import pair_live
from calstation.gui.text import say
from calstation.gui.widgets import NoticeBar
from calstation.messages import Text
from tests.gui.conftest import SERIAL, Operator
from tests.gui.test_engineer_page import Engineer

#: Serial number that the virtual bench suggests.
SUGGESTED = "SN-000001"


def entry(operator: Operator, product: str) -> tuple[str, bool, str]:
    """Open the list of products; return the text of a product, whether it can be chosen, and its tooltip."""
    combo: QComboBox = operator.widget("product_combo", QComboBox)
    operator.qtbot.mouseClick(combo, Qt.MouseButton.LeftButton)
    operator.until(combo.view().isVisible)
    model = combo.model()
    assert isinstance(model, QStandardItemModel)
    item = model.item([Path(combo.itemData(k)).stem for k in range(combo.count())].index(product))
    combo.hidePopup()
    return item.text(), item.isEnabled(), item.toolTip()


@pytest.mark.long
def test_products_of_another_rig_are_greyed_with_the_reason(operator: Operator) -> None:
    text, enabled, _ = entry(operator, "mems_c")
    assert (text, enabled) == ("MEMS grade C", True)
    text, enabled, tip = entry(operator, "mems_hand")
    assert (text, enabled) == ("MEMS grade C, by hand (needs a table turned by hand)", False)
    assert tip == "The table of this station is driven; the selection is turned by hand."
    operator.window.app.set_language("zh_CN")
    text, enabled, _ = entry(operator, "mems_hand")
    assert "（需要手动转台）" in text
    assert not enabled
    operator.window.app.set_station(library.find("stations", "virtual_hand"))
    assert entry(operator, "mems_hand")[1]
    text, enabled, _ = entry(operator, "mems_c")
    assert "需要电动转台" in text
    assert not enabled


@pytest.mark.long
def test_pair_station_leads_to_its_live_monitoring(operator: Operator) -> None:
    app = operator.window.app
    app.set_station(library.find("stations", "virtual_pair"))
    assert "compares IMUs on one body" in operator.says()
    assert "No product can be calibrated here" in operator.says()
    assert "Live monitoring only" in operator.says()
    assert "cannot run" not in operator.says()
    assert operator.window.findChild(QPushButton, "product_choice_mems_hand") is None
    app.set_product(library.find("products", "mems_hand"))
    assert "compares IMUs on one body" in operator.says()
    assert not entry(operator, "mems_hand")[1]
    assert "(no run at this station)" in entry(operator, "mems_hand")[0]
    app.set_language("zh_CN")
    assert "（本工位不作标定）" in entry(operator, "mems_hand")[0]
    assert "只作实时监测" in operator.says()
    assert "仅用于实时监测" in operator.says()
    assert "无法标定" not in operator.says()
    assert "本工位不能标定任何产品型号" in operator.says()
    assert operator.widget("show_watch_button", QPushButton).text() == "实时监测"
    for language, text in (
        ("zh_CN", "请点击“实时监测”；本工位不需要“开始”按钮。"),
        ("en", "Press “Watch live”; this station needs no START."),
    ):
        operator.window.app.set_language(language)
        assert operator.message == text
        assert operator.says().count(text) == 2, "also below the reason, because no run ever becomes possible"
    operator.press("show_watch_button")
    page = operator.window.offline_page
    assert page.isVisible()
    assert page.panel is not None
    live = page.panel.views.live
    assert live is not None
    assert live.isVisible()
    assert operator.window.focusWidget() is live.start_button
    assert not live.watching  # nothing starts by itself


@pytest.mark.long
def test_monitoring_is_offered_for_every_product_and_its_state_is_shown(operator: Operator) -> None:
    app, watch = operator.window.app, operator.widget("show_watch_button", QPushButton)
    assert not watch.isVisible(), "the station has one IMU"
    app.set_station(library.find("stations", "virtual_pair"))
    app.set_product(library.find("products", "mems_hand"))
    operator.window.show_page("history_page")
    operator.window.show_page("operator_page")
    assert watch.isVisible()
    assert watch.focusPolicy() == Qt.FocusPolicy.NoFocus  # the keys of a scan must not press it
    app.run.set_monitoring(("caution", Text.of("logs.primary_out", sensors=["gyro"])))
    assert "The IMUs are watched live: primary out of tolerance: gyro" in operator.says()
    assert "Press “Watch live”" not in operator.says()
    app.set_language("zh_CN")
    assert "正在实时监测各 IMU：主 IMU 超差：" in operator.says()
    assert "请点击" not in operator.says()
    app.run.set_monitoring(None)
    assert "实时监测各 IMU" not in operator.says()
    app.set_station(library.find("stations", "virtual_bench"))
    assert not watch.isVisible()


class Watching:
    """A monitoring process that ends when it is told to."""

    def __init__(self, request: RunRequest) -> None:
        self.ended = False

    def poll(self) -> list[object]:
        return []

    def send(self, command: str) -> None:
        self.ended = command == "stop"

    def close(self) -> None: ...


@pytest.mark.long
def test_stop_and_esc_end_the_live_monitoring(operator: Operator, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pair_live, "PairProcess", Watching)
    operator.window.app.set_station(library.find("stations", "virtual_pair"))
    operator.press("show_watch_button")
    operator.press("watch_button")
    assert operator.run.display_state == "monitoring"
    operator.press("stop_button")
    operator.until(lambda: operator.run.monitoring is None)
    operator.press("watch_button")
    operator.qtbot.keyClick(operator.widget("watch_button"), Qt.Key.Key_Escape)
    operator.until(lambda: operator.run.monitoring is None)
    operator.press("watch_button")
    operator.window.show_page("operator_page")
    operator.press("stop_button")
    assert "Nothing is running" not in operator.message
    operator.until(lambda: operator.run.monitoring is None)


@pytest.mark.long
@pytest.mark.parametrize(("code", "text"), [("en", "stopping"), ("zh_CN", "正在停止")])
def test_live_monitoring_says_at_once_that_it_stops(
    operator: Operator, monkeypatch: pytest.MonkeyPatch, code: str, text: str
) -> None:
    monkeypatch.setattr(pair_live, "PairProcess", Watching)
    monkeypatch.setattr(Watching, "send", lambda *_: None)  # it has not closed its ports yet
    operator.window.app.set_language(code)
    operator.window.app.set_station(library.find("stations", "virtual_pair"))
    operator.press("show_watch_button")
    operator.press("watch_button")
    assert operator.run.monitoring is not None
    assert say(operator.run.monitoring[1]) != text
    operator.press("stop_button")
    assert say(operator.run.monitoring[1]) == text
    assert text in operator.says()


def refuse_start(engineer: Engineer) -> NoticeBar:
    """Show why the station and the product cannot run, as START does if their files have changed."""
    request = RunRequest(SERIAL, engineer.window.app.station_path, library.find("products", "mems_c_thermal"))
    engineer.page._start_dialog.begin(request)
    return engineer.page.notice


@pytest.mark.long
@pytest.mark.parametrize(("code", "words"), [("en", "the station has none"), ("zh_CN", "温箱")])
def test_refused_start_is_forgotten_with_its_station_or_product(operator: Operator, code: str, words: str) -> None:
    engineer = Engineer(operator.window, operator.qtbot, operator.site_folder).open_page()
    app = engineer.window.app
    app.set_language(code)
    changes = (
        lambda: app.set_product(library.find("products", "mems_c")),
        lambda: app.set_station(library.find("stations", "virtual_bench")),
        app.product_changed.emit,
        lambda: engineer.press("read_registers_button"),
    )
    for change in changes:
        notice = refuse_start(engineer)
        assert notice.isVisible()
        assert words in notice.text_label.text()
        engineer.show_view(5)
        change()
        assert not notice.isVisible()
        engineer.until_no_job()


@pytest.mark.long
@pytest.mark.parametrize(
    ("code", "reason"),
    [("en", "Choose another product, or a station with a chamber."), ("zh_CN", "有温箱的工位")],
)
def test_start_is_disabled_on_both_pages_if_the_station_has_no_chamber(
    operator: Operator, code: str, reason: str
) -> None:
    engineer = Engineer(operator.window, operator.qtbot, operator.site_folder).open_page()
    app, not_ready = engineer.window.app, {"en": "NOT READY", "zh_CN": "未就绪"}[code]
    app.set_language(code)
    app.set_product(library.find("products", "mems_c_thermal"))
    for page, name in (("operator_page", "start_button"), ("engineer_page", "engineer_start_button")):
        engineer.window.show_page(page)
        assert not_ready in engineer.says().split("\n")
        assert reason in engineer.why_not(name)
    app.set_station(library.find("stations", "virtual_chamber"))
    assert engineer.widget("engineer_start_button", QPushButton).isEnabled()
    assert not_ready not in engineer.says().split("\n")
    app.set_station(library.find("stations", "virtual_bench"))
    app.set_product(library.find("products", "mems_c_thermal"))
    assert reason in engineer.why_not("engineer_start_button")
    app.set_product(library.find("products", "mems_c"))
    assert engineer.widget("engineer_start_button", QPushButton).isEnabled()


@pytest.mark.long
def test_registers_are_read_from_the_entered_unit(operator: Operator) -> None:
    engineer = Engineer(operator.window, operator.qtbot, operator.site_folder).open_page()
    engineer.show_view(5)
    engineer.run.unit.serial = "SN-000010"  # of the last run
    edit, registers = engineer.widget("engineer_serial_edit", QLineEdit), engineer.page.registers
    assert engineer.page._options is not None
    edit.setText(engineer.page._options.serial)
    for typed, read in ((None, SUGGESTED), (SUGGESTED, SUGGESTED), ("", "SN-000010"), ("SN-000012", "SN-000012")):
        if typed is not None:
            engineer.type("engineer_serial_edit", typed)
        engineer.press("read_registers_button")
        engineer.until(lambda: not registers.watch.busy)
        assert registers.unit is not None, registers._error
        assert registers.unit.serial == read, typed


@pytest.mark.long
def test_typed_number_is_kept_if_it_equals_the_suggested_one(operator: Operator) -> None:
    engineer = Engineer(operator.window, operator.qtbot, operator.site_folder)
    engineer.window.show_page("engineer_page")
    app, hardware = engineer.window.app, library.find("stations", "example_hardware")
    edits = [engineer.widget(name, QLineEdit) for name in ("serial_edit", "engineer_serial_edit")]
    assert [edit.text() for edit in edits] == [SUGGESTED, SUGGESTED]
    for typed, kept in ((False, ""), (True, SUGGESTED)):
        for page, edit in zip(("operator_page", "engineer_page"), edits, strict=True):
            engineer.window.show_page(page)
            if typed:
                engineer.type(edit.objectName(), SUGGESTED)
        app.set_station(hardware)
        assert [edit.text() for edit in edits] == [kept, kept]
        app.set_station(engineer.site_folder.station)
