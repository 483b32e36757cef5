"""The operator page says what is missing before a start, and shows nothing of another station or product."""

from datetime import date

import pytest
from PySide6.QtCore import QEvent, QPoint, Qt
from PySide6.QtWidgets import QApplication, QLabel, QLineEdit, QPushButton

from calstation.config import library
from calstation.jobs import JobQueue
from calstation.messages import Language
from calstation.messages.rendering import render
from calstation.results import History
from calstation.sequencer import StateChanged
from tests.database.result_files import write_result
from tests.gui.conftest import Operator
from tests.gui.test_operator_events import end_run, simulated_run
from tests.gui.test_units import FAILED, NO_ANSWER, use_slots

__all__ = ["simulated_run"]  # fixture


def test_refused_serial_number_is_not_ready_and_named_below(operator: Operator) -> None:
    assert "READY" in operator.says().split("\n")
    start = operator.widget("start_button", QPushButton)
    operator.scan("SN-000042")
    operator.qtbot.keyClick(start, Qt.Key.Key_Return)
    assert "Enter" in operator.message
    operator.scan("TX-1")
    assert operator.message.startswith("The serial number 'TX-1'")
    lines = operator.says().split("\n")
    assert "NOT READY" in lines
    assert "READY" not in lines
    assert not start.isEnabled()
    assert start.toolTip().startswith("The serial number 'TX-1'")
    operator.window.app.set_language("zh_CN")
    assert "TX-1" in operator.message
    assert "TX-1" in start.toolTip()
    assert "未就绪" in operator.says()
    operator.window.app.set_language("en")
    operator.scan("SN-000042")
    assert operator.message == "Load a unit, scan its serial number, and press START."
    assert "READY" in operator.says().split("\n")
    assert start.isEnabled()


@pytest.mark.long
@pytest.mark.parametrize("way", ["page", "program"])
@pytest.mark.parametrize(("code", "ready"), [("en", "READY"), ("zh_CN", "就绪")])
def test_station_file_corrected_in_another_program_is_read_again(
    operator: Operator, way: str, code: str, ready: str
) -> None:
    window, station = operator.window, operator.site_folder.station
    window.app.set_language(code)
    good = station.read_text(encoding="utf-8")
    station.write_text(good + "\nunknown = 1\n", encoding="utf-8")
    window.app.set_station(station)
    window.show_page("engineer_page")
    assert ready not in operator.says().splitlines()
    station.write_text(good, encoding="utf-8")
    if way == "program":
        window.activateWindow()
        QApplication.sendEvent(window, QEvent(QEvent.Type.ActivationChange))
    else:
        window.show_page("operator_page")
    assert ready in operator.says().splitlines()
    assert operator.widget("start_button", QPushButton).isEnabled()


@pytest.mark.parametrize(
    ("code", "note", "remedy"),
    [
        ("en", "Serial number: NOT READY", "Choose another product, or a station with a chamber."),
        ("zh_CN", "序列号：未就绪", "请另选产品型号，或选有温箱的工位。"),
    ],
)
def test_scan_for_an_unsuitable_product_is_refused(operator: Operator, code: str, note: str, remedy: str) -> None:
    operator.window.app.set_language(code)
    operator.window.app.set_product(library.find("products", "mems_c_thermal"))
    assert remedy in operator.says()
    assert "[chamber]" not in operator.says()
    operator.scan("SN-000042")
    assert note in operator.says()
    assert not operator.widget("start_button", QPushButton).isEnabled()
    operator.choose("short")
    assert note not in operator.says()
    assert operator.widget("start_button", QPushButton).isEnabled()


@pytest.mark.long
def test_overdue_calibration_of_the_table_is_not_ready(operator: Operator) -> None:
    overdue = [{"name": "Rate table A", "kind": "table", "due": date(2021, 3, 2)}]
    operator.site_folder.write(station={"instruments": overdue})
    operator.window.app.set_station(operator.site_folder.station)
    assert "NOT READY" in operator.says().split("\n")
    assert "the calibration of 'Rate table A' was due on 2021-03-02" in operator.message
    operator.window.app.set_language("zh_CN")
    assert "“Rate table A”应于 2021-03-02 前送检" in operator.message
    assert "未就绪" in operator.says()
    for page in ("history_page", "station_page", "engineer_page"):
        operator.window.show_page(page)
        assert "未就绪" in operator.says().split("\n")
        assert "“Rate table A”应于 2021-03-02 前送检" in operator.says()
    assert operator.widget("engineer_start_button", QPushButton).isEnabled()
    operator.window.show_page("operator_page")
    operator.window.app.set_language("en")
    assert operator.widget("start_button", QPushButton).isEnabled()
    operator.site_folder.write(station={"instruments": [{**overdue[0], "due": date(2999, 3, 2)}]})
    operator.window.app.set_station(operator.site_folder.station)
    for page in ("operator_page", "history_page"):
        operator.window.show_page(page)
        assert "READY" in operator.says().split("\n")


def test_refusal_names_product_and_station_as_the_list_does() -> None:
    values = {"product": "Navigation grade A", "station": "x", "name": "T", "since": "2021-03-02"}
    names: dict[Language, str] = {"en": "Navigation grade A", "zh_CN": "导航级 A"}
    for code, name in names.items():
        assert name in render("quality.standard_certificate", values, code, window=True).text
    assert "“Navigation grade A”" in render("quality.standard_certificate", values, "zh_CN").text


def test_question_before_a_start_replaces_the_message_about_enter(
    operator: Operator, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(JobQueue, "uses_device", True)
    operator.scan("SN-000042")
    start = operator.widget("start_button", QPushButton)
    operator.qtbot.keyClick(start, Qt.Key.Key_Return)
    assert "Enter" in operator.message
    operator.press("start_button")
    assert operator.widget("cancel_choice", QPushButton).isVisible()
    assert operator.message == "Answer the question on this page first."


@pytest.mark.long
def test_scan_before_the_fault_is_read_says_what_to_do(simulated_run: Operator) -> None:
    operator, link = simulated_run, simulated_run.window.app.engine_link
    link.event.emit(StateChanged("fault", "preparing"))
    link.event.emit(NO_ANSWER)
    link.running_changed.emit(False)
    operator.until(lambda: operator.verdict == "FAULT")
    operator.scan("SN-000043")
    notice = operator.widget("operator_notice")
    words = [text.text() for text in notice.findChildren(QLabel) if text.isVisible()]
    assert "Read the fault below and press Understood first." in words
    operator.press("acknowledge_button")
    assert "Read the fault" not in operator.says()
    assert operator.widget("serial_edit", QLineEdit).text() == "SN-000043"
    assert operator.widget("start_button").isEnabled()
    assert operator.window.focusWidget() is operator.widget("start_button")
    assert operator.widget("serial_symbol").isVisible()


@pytest.mark.long
def test_slots_of_the_last_station_are_not_shown_at_an_unusable_one(operator: Operator) -> None:
    use_slots(operator, 16)
    assert operator.widget("slot_16_tile").isVisible()
    operator.window.app.set_station(library.find("stations", "virtual_hand"))
    assert not operator.widget("slot_16_tile").isVisible()
    assert not operator.window.operator_page._loading.isVisible()
    assert "This station and product cannot run" in operator.says()
    operator.window.app.set_language("zh_CN")
    assert "这个工位和产品型号无法标定" in operator.says()
    operator.window.app.set_language("en")
    operator.choose("mems_hand")
    assert "This station and product cannot run" not in operator.says()


@pytest.mark.long
@pytest.mark.parametrize(("width", "height"), [(1280, 720), (1366, 768), (1920, 1080)])
def test_a_notice_does_not_move_the_buttons_of_a_verdict(simulated_run: Operator, width: int, height: int) -> None:
    operator, window = simulated_run, simulated_run.window
    window.resize(width, height)
    end_run(operator, "failed", **FAILED)
    details = operator.widget("details_button", QPushButton)
    operator.qtbot.wait(500)  # the panel fits its texts
    before = details.mapTo(window, QPoint())
    notice = window.operator_page.notice
    notice.inform("good", "operator.label_saved", lambda: "SN-000042.pdf", lambda: None)
    operator.until(notice.isVisible)
    operator.qtbot.wait(100)
    assert details.mapTo(window, QPoint()) == before
    assert details.visibleRegion().boundingRect() == details.rect()


@pytest.mark.long
@pytest.mark.parametrize("page", ["operator_page", "engineer_page"])
@pytest.mark.parametrize(
    ("code", "answer", "ready", "not_ready"),
    [
        ("en", "Answer the question on this page first.", "READY", "NOT READY"),
        ("zh_CN", "请先回答本页的问题。", "可以开始", "未就绪"),
    ],
)
def test_question_before_a_start_is_answered_first(
    operator: Operator, page: str, code: str, answer: str, ready: str, not_ready: str
) -> None:
    prefix = "engineer_" if page == "engineer_page" else ""
    runs = operator.site_folder.runs
    runs.mkdir()
    write_result(runs, "SN-000042_1", 1, serial="SN-000042", product="short")
    History(runs).refresh()
    operator.window.app.set_language(code)
    operator.window.app.role.set_first_pin("246813")
    operator.window.show_page(page)
    edit, start = operator.widget(f"{prefix}serial_edit"), operator.widget(f"{prefix}start_button")
    edit.clear()
    operator.qtbot.keyClicks(edit, "SN-000042")
    operator.press(f"{prefix}start_button")
    lines = operator.says().split("\n")
    assert answer in lines
    assert not_ready in lines
    assert ready not in lines
    assert not start.isEnabled()
    assert start.toolTip() == answer
    operator.press("cancel_choice")
    assert answer not in operator.says()
    assert start.isEnabled()


@pytest.mark.parametrize(
    ("code", "filled", "enter", "keep", "scan"),
    [
        ("en", "A serial number is filled in", "Enter a serial number", "Keep the suggested", "Scan serial numbers"),
        ("zh_CN", "序列号已经填好", "输入序列号", "可保留建议的序列号", "请扫描符合产品规则的序列号"),
    ],
)
def test_steps_call_a_number_filled_in_only_while_it_is_in_the_field(
    operator: Operator, code: str, filled: str, enter: str, keep: str, scan: str
) -> None:
    operator.window.app.set_language(code)
    assert filled in operator.says()
    operator.widget("serial_edit", QLineEdit).clear()
    assert filled not in operator.says()
    assert enter in operator.says()
    operator.qtbot.keyClicks(operator.widget("serial_edit"), "SN-000042")
    assert filled in operator.says()
    operator.widget("serial_edit", QLineEdit).clear()
    use_slots(operator, 2)
    assert keep in operator.says()
    operator.window.operator_page._starting.slots.remove_units()
    assert keep not in operator.says()
    assert scan in operator.says()
