"""The operator page operated by real clicks, with the real engine and a short product on the virtual bench."""

import json
import os
import signal
import sys
from pathlib import Path
from typing import Any

import pytest
import tomli_w
from PySide6.QtCore import Qt
from PySide6.QtWidgets import (
    QApplication,
    QComboBox,
    QLabel,
    QLineEdit,
    QListWidget,
    QProgressBar,
    QPushButton,
    QTabBar,
)

from calstation.config import library
from calstation.gui.shell import create_window
from calstation.gui.shell.main_window import MainWindow
from calstation.gui.text import language, say
from calstation.messages import Language
from tests.gui.conftest import SERIAL, Operator, ShownWindows, SiteFolder
from tests.site_folder import ONE_STAGE, PRODUCT, QUICK, STATION

#: Half a minute long at twenty times real time: it does not end while buttons are pressed.
LONG_STAGE = {"six_position": {"dwell_s": 100.0, **QUICK}}


def results(site_folder: SiteFolder) -> list[dict[str, Any]]:
    """Return the results of the runs, oldest first."""
    return [json.loads(p.read_text(encoding="utf-8")) for p in sorted(site_folder.runs.glob("SN-*.json"))]


def visit_views(window: MainWindow) -> None:
    """Show every page, and every view and section of it."""
    for number in range(window.page_tabs.count()):
        window.page_tabs.setCurrentIndex(number)
        QApplication.processEvents()
        page = window.page_tabs.currentWidget()
        assert page is not None
        for bar in page.findChildren(QTabBar):
            for tab in range(bar.count()):
                bar.setCurrentIndex(tab)
                QApplication.processEvents()
        sections = page.findChild(QListWidget, "station_sections")
        for row in range(0 if sections is None else sections.count()):
            sections.setCurrentRow(row)
            QApplication.processEvents()


@pytest.mark.long
def test_run_passes_after_one_click_despite_language_changes(operator: Operator, shown_windows: ShownWindows) -> None:
    serial = operator.widget("serial_edit", QLineEdit).text()
    assert serial == "SN-000001"
    assert "test bench (simulated)" in operator.says()
    operator.press("start_button")
    stages = operator.widget("stage_list", QListWidget)
    operator.until(lambda: operator.run.stages and operator.run.stages[1].fraction > 0.0)  # a short stage may be over
    assert not operator.widget("serial_edit").isEnabled()

    language = operator.widget("language_combo", QComboBox)
    language.setCurrentIndex(1)
    operator.until(lambda: operator.widget("start_button", QPushButton).text() == "开始")
    assert "六位置" in stages.item(1).data(Qt.ItemDataRole.AccessibleTextRole)
    operator.until(lambda: operator.run.stages[2].fraction > 0.3)
    language.setCurrentIndex(0)

    operator.until(lambda: operator.verdict)
    assert operator.verdict == "PASS", operator.says()
    assert "Remove the unit, scan the next" in operator.says()
    texts = [stages.item(i).data(Qt.ItemDataRole.AccessibleTextRole) for i in range(stages.count())]
    assert [text.split(",")[1].strip() for text in texts] == ["done"] * 5
    assert texts[-1].startswith("5  Transfer")
    progress = operator.widget("run_progress", QProgressBar)
    assert progress.value() == progress.maximum()
    operator.until_ended()
    (result,) = results(operator.site_folder)
    assert (result["unit"]["serial"], result["outcome"], result["passed"]) == (serial, "passed", True)
    assert operator.widget("serial_edit", QLineEdit).text() == "SN-000002"
    operator.press("details_button")
    operator.until_no_job()
    visit_views(operator.window)
    assert shown_windows.names == []


@pytest.mark.long
@pytest.mark.parametrize("page", ["operator_page", "engineer_page"])
def test_unlimited_stage_is_ended_by_a_click_and_solved(operator: Operator, page: str) -> None:
    unlimited = {**PRODUCT["schedule"]["azimuth_flip"], "rounds": 0}
    product = {"stages": ["azimuth_flip"], "schedule": {"azimuth_flip": unlimited}, "operator_ends_stages": True}
    operator.site_folder.write(product)
    name = {"operator_page": "end_stage_button", "engineer_page": "engineer_end_stage_button"}[page]
    operator.scan(SERIAL)
    operator.press("start_button")
    operator.window.show_page(page)
    button = operator.widget(name, QPushButton)
    operator.until(button.isVisible)
    assert not button.isEnabled(), "no stage has started"
    operator.until(button.isEnabled)
    operator.press(name)
    assert not button.isEnabled()
    assert "after this move" in button.toolTip()
    operator.until_ended()
    assert operator.run.fault is None, operator.run.fault
    assert results(operator.site_folder)[0]["outcome"] in ("passed", "failed")
    assert not button.isVisible()


@pytest.mark.usefixtures("engineer_page")
@pytest.mark.long
def test_stage_ended_early_by_a_click_is_named_wherever_the_result_is_shown(operator: Operator) -> None:
    flips = {**PRODUCT["schedule"]["azimuth_flip"], "rounds": 50}
    product = {"stages": ["azimuth_flip"], "schedule": {"azimuth_flip": flips}, "operator_ends_stages": True}
    operator.site_folder.write(product, out_of_limits=True)
    operator.scan(SERIAL)
    operator.press("start_button")
    operator.until(operator.widget("end_stage_button", QPushButton).isEnabled)
    operator.press("end_stage_button")
    operator.until_ended()
    assert operator.verdict == "FAIL", operator.says()
    note = "Ended by the operator before its schedule was complete: Azimuth flips."
    assert note in operator.says()
    assert "Repeat the calibration with every stage in full" in operator.says()
    assert "Reseat" not in operator.says()
    operator.window.app.set_language("zh_CN")
    assert "操作员提前结束的阶段（未按流程做完）：方位翻转。" in operator.says()
    assert "各阶段" in operator.says() or "每个阶段都做完" in operator.says()
    operator.window.app.set_language("en")
    operator.press("details_button")
    operator.until_no_job()
    assert operator.widget("override_note", QLabel).text() == note
    operator.window.show_page("history_page")
    operator.until(lambda: note in operator.widget("history_reason_label", QLabel).text())


@pytest.mark.long
def test_run_is_paused_resumed_and_stopped_from_another_page(operator: Operator) -> None:
    operator.site_folder.write({**ONE_STAGE, "schedule": LONG_STAGE}, speed=20.0)
    operator.scan(SERIAL)
    operator.press("start_button")
    pause = operator.widget("pause_button", QPushButton)
    assert not pause.isEnabled()
    assert pause.toolTip()
    operator.until(operator.in_a_stage)
    operator.press("pause_button")
    operator.until(lambda: pause.text() == "Resume")
    assert operator.run.state in ("pausing", "paused")
    operator.until(lambda: "Paused" in operator.message)
    operator.press("pause_button")
    operator.until_state("running")

    operator.window.show_page("history_page")
    operator.qtbot.keyClick(operator.window, Qt.Key.Key_Escape)
    assert operator.run.state == "stopping"
    operator.until_ended()
    operator.window.show_page("operator_page")
    assert operator.verdict == "STOPPED"
    assert "at rest" in operator.says()
    assert results(operator.site_folder)[0]["outcome"] == "stopped"
    operator.scan(SERIAL)
    assert operator.widget("start_button").isEnabled()


@pytest.mark.long
def test_fault_is_shown_until_acknowledged_and_a_passed_unit_needs_confirmation(
    operator: Operator,
) -> None:
    operator.site_folder.write(ONE_STAGE, orders=[{"order": "interlock", "value": 0, "at": 35.0}])
    operator.scan(SERIAL)
    operator.press("start_button")
    operator.until(lambda: operator.verdict)
    assert operator.verdict == "FAULT", operator.says()
    operator.until_ended()
    assert "Where: Table" in operator.says()
    assert "Close the cover" in operator.says()
    start = operator.widget("start_button", QPushButton)
    assert not start.isEnabled()
    assert "Understood" in start.toolTip()
    operator.press("acknowledge_button")
    assert operator.verdict == ""

    operator.site_folder.write(ONE_STAGE)
    operator.scan(SERIAL)
    assert "attempt 2" in operator.says()
    operator.press("start_button")
    operator.until(lambda: operator.verdict)
    assert operator.verdict == "PASS", operator.says()
    operator.until_ended()

    operator.scan(SERIAL)
    operator.press("start_button")
    assert not operator.window.app.engine_link.running
    assert f"{SERIAL} has already passed" in operator.says()
    operator.press("cancel_choice")
    assert f"{SERIAL} has already passed" not in operator.says()
    operator.press("start_button")
    operator.press("repeat_choice")
    assert operator.window.app.engine_link.running
    operator.press("stop_button")
    operator.until_ended()
    assert [r["outcome"] for r in results(operator.site_folder)] == ["fault", "passed", "stopped"]


def test_scanner_enter_validates_the_serial_number_but_does_not_start(operator: Operator) -> None:
    start = operator.widget("start_button", QPushButton)
    operator.scan("WRONG 1")
    assert "does not match this product" in operator.says()
    assert "Serial number: not valid" in operator.says()
    assert "Example: SN-000123" in operator.says()
    assert "\\d" not in operator.says()
    assert operator.window.focusWidget() is operator.widget("serial_edit")
    operator.scan(SERIAL)
    assert "does not fit" not in operator.says()
    assert operator.window.focusWidget() is start
    operator.qtbot.keyClick(start, Qt.Key.Key_Return)
    assert not operator.window.app.engine_link.running
    operator.qtbot.keyClick(start, Qt.Key.Key_S)
    edit = operator.widget("serial_edit", QLineEdit)
    assert operator.window.focusWidget() is edit
    assert edit.text().lower() == "s"
    assert not operator.window.app.engine_link.running


@pytest.mark.long
def test_failed_unit_shows_the_reason_and_what_to_do(operator: Operator) -> None:
    operator.site_folder.write(ONE_STAGE, out_of_limits=True)
    operator.scan(SERIAL)
    operator.press("start_button")
    operator.until(lambda: operator.verdict)
    assert operator.verdict == "FAIL", operator.says()
    assert "Accel scale factor y is" in operator.says()
    assert "Reseat the unit" in operator.says()
    operator.until_ended()


@pytest.mark.long
@pytest.mark.skipif(sys.platform == "win32", reason="SIGKILL exists only on POSIX systems")
def test_killed_engine_is_a_fault(operator: Operator) -> None:
    operator.site_folder.write(ONE_STAGE)
    operator.scan(SERIAL)
    operator.press("start_button")
    operator.until(operator.in_a_stage)
    engine = operator.window.app.engine_link._engine
    assert engine is not None
    assert engine.process.pid is not None
    os.kill(engine.process.pid, signal.SIGKILL)
    operator.until(lambda: operator.verdict == "FAULT", 10.0)
    assert "Where: Program" in operator.says()
    assert "watchdog, if it has one, stops the table and stays latched" in operator.says()
    operator.press("acknowledge_button")
    assert operator.widget("start_button").isEnabled()


@pytest.mark.long
def test_closing_during_a_run_asks_for_confirmation_and_stops(operator: Operator) -> None:
    operator.site_folder.write({**ONE_STAGE, "schedule": LONG_STAGE}, speed=20.0)
    operator.press("start_button")
    operator.until(operator.in_a_stage)
    operator.window.show_page("station_page")
    operator.window.close()
    assert operator.window.isVisible()
    assert QApplication.activeModalWidget() is None
    assert "A calibration is in progress" in operator.says()
    operator.press("keep_open_choice")
    assert operator.window.app.engine_link.running
    operator.window.close()
    operator.press("close_choice")
    operator.until(lambda: not operator.window.isVisible())
    assert results(operator.site_folder)[0]["outcome"] == "stopped"


@pytest.mark.long
def test_interrupted_run_is_offered_at_startup_and_resumed(operator: Operator, site_folder: SiteFolder) -> None:
    site_folder.write({"stages": ["six_position", "rate"]})
    operator.scan(SERIAL)
    operator.press("start_button")
    operator.until(lambda: operator.run.stages and operator.run.stages[1].fraction > 0.1)
    operator.press("stop_button")
    operator.until_ended()
    operator.until(lambda: f"{SERIAL} was interrupted in stage 2, Rate" in operator.says())
    operator.press("later_choice")
    operator.scan(SERIAL)
    assert f"{SERIAL} was interrupted in stage 2, Rate" in operator.says()
    assert not operator.widget("start_button").isEnabled()

    operator.window.app.close()
    again = create_window(site_folder.station)
    assert isinstance(again, MainWindow)
    operator.qtbot.addWidget(again)
    again.show()
    second = Operator(again, operator.qtbot, site_folder)
    second.until(lambda: f"{SERIAL} was interrupted in stage 2, Rate" in second.says())
    second.press("resume_choice")
    second.until(lambda: second.verdict)
    assert second.verdict == "PASS"
    second.until_ended()
    assert [r["outcome"] for r in results(site_folder)] == ["stopped", "passed"]
    assert results(site_folder)[1]["stages"] == ["six_position", "rate"]
    again.app.close()


@pytest.mark.long
def test_real_table_moves_only_after_confirmation(operator: Operator, site_folder: SiteFolder) -> None:
    hardware = {
        **STATION,
        "name": "station 7",
        "table": {"profile": "bench", "port": "tcp://127.0.0.1:9"},
        "imu": {"port": "socket://127.0.0.1:9"},
    }
    site_folder.station.write_text(tomli_w.dumps(hardware), encoding="utf-8")
    operator.window.app.set_station(site_folder.station)
    assert "station 7" in operator.says()
    assert "(simulated)" not in operator.says()
    operator.scan(SERIAL)
    operator.press("start_button")
    assert "The table of 'station 7' will move" in operator.says()
    operator.qtbot.keyClick(operator.window, Qt.Key.Key_Escape)
    assert "will move" not in operator.says()
    operator.press("start_button")
    operator.press("clear_choice")
    operator.until(lambda: operator.verdict)
    assert operator.verdict == "FAULT", operator.says()
    assert "127.0.0.1:9" in operator.says()
    operator.until_ended()


def test_invalid_product_disables_start_until_it_is_corrected(operator: Operator, site_folder: SiteFolder) -> None:
    site_folder.product.write_text("name = 1", encoding="utf-8")
    operator.window.app.product_changed.emit()
    assert "cannot run" in operator.says()
    assert not operator.widget("start_button").isEnabled()
    site_folder.write()
    operator.window.app.product_changed.emit()
    assert "cannot run" not in operator.says()
    assert operator.widget("start_button").isEnabled()


def test_runs_folder_has_a_default(operator: Operator) -> None:
    assert operator.window.app.runs_folder == Path("runs")


@pytest.mark.long
def test_product_file_added_while_the_window_is_open_is_listed(operator: Operator) -> None:
    combo = operator.widget("product_combo", QComboBox)
    before = combo.currentData()
    text = (library.site_folder() / "products" / "short.toml").read_text(encoding="utf-8")
    (library.site_folder() / "products" / "another.toml").write_text(text, encoding="utf-8")
    operator.window.show_page("station_page")
    operator.window.show_page("operator_page")
    assert combo.findText("short (another)") >= 0, "both files name their product short"
    assert combo.currentText() == "short (short)"
    assert combo.currentData() == before
    assert str(operator.window.app.product_path) == combo.currentData()


@pytest.mark.long
@pytest.mark.parametrize(("code", "name"), [("en", "gyro bias"), ("zh_CN", "陀螺零偏")])
def test_limits_that_no_stage_judges_are_named_before_the_start(operator: Operator, code: Language, name: str) -> None:
    operator.site_folder.write({"stages": ["six_position"]})
    operator.window.app.set_station(operator.site_folder.station)
    language.use(code)
    message = operator.widget("message_label", QLabel)
    assert name in message.text()
    assert message.text() != say("operator.message_idle")
    operator.window.show_page("engineer_page")
    operator.until_no_job()
    assert name in operator.widget("choice_problem_label", QLabel).text()
    operator.window.show_page("operator_page")
    operator.site_folder.write(ONE_STAGE)
    operator.window.app.set_station(operator.site_folder.station)
    assert name not in message.text()
    language.use("en")
