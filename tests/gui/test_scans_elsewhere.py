"""Scans that arrive over an open list or on another page are complete, and none sets a PIN."""

import pytest
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QComboBox, QLineEdit, QPushButton

from calstation.config import access
from calstation.gui.operator import starting
from calstation.gui.state.engine_link import EngineLink
from calstation.results import History
from tests.database.result_files import write_result
from tests.gui.conftest import Operator
from tests.gui.test_operator_events import scan_into_focus, simulated_run

__all__ = ["simulated_run"]  # fixture


SCANNED = "SN-000077"


@pytest.mark.parametrize("name", ["product_combo", "language_combo"])
def test_scan_over_an_open_list_is_complete(operator: Operator, name: str) -> None:
    combo = operator.window.findChild(QComboBox, name)
    before = combo.currentIndex()
    combo.showPopup()
    for letter in SCANNED:
        operator.qtbot.keyClicks(combo.view(), letter)
        assert combo.view().isVisible()  # closing it would lose the characters that are on their way
    operator.qtbot.keyClick(combo.view(), Qt.Key.Key_Return)
    assert operator.widget("serial_edit", QLineEdit).text() == SCANNED
    assert not combo.view().isVisible()
    assert combo.currentIndex() == before


def test_scan_over_an_open_list_during_a_run_changes_nothing(operator: Operator) -> None:
    combo, edit = operator.window.findChild(QComboBox, "language_combo"), operator.widget("serial_edit", QLineEdit)
    edit.setText("SN-000042")
    operator.window.operator_page.header.set_running("running")
    before = combo.currentIndex()
    combo.showPopup()
    for letter in "EN-000063":
        operator.qtbot.keyClicks(combo.view(), letter)
    operator.qtbot.keyClick(combo.view(), Qt.Key.Key_Return)
    assert (combo.currentIndex(), edit.text()) == (before, "SN-000042")


@pytest.mark.long
def test_scan_on_another_page_is_entered_on_the_operator_page(operator: Operator) -> None:
    window, edit = operator.window, operator.widget("serial_edit", QLineEdit)
    edit.setText("SN-000042")
    window.show_page("quality_page")
    window.setFocus()
    for letter in SCANNED:
        operator.qtbot.keyClicks(window, letter)
    operator.qtbot.keyClick(window, Qt.Key.Key_Return)
    assert operator.window.operator_page.isVisible()
    assert edit.text() == SCANNED
    assert "Serial number: accepted" in operator.says()


@pytest.mark.long
def test_scan_of_a_unit_that_has_passed_says_so(operator: Operator) -> None:
    runs = operator.site_folder.runs
    runs.mkdir()
    write_result(runs, f"{SCANNED}_20261101T000000", 1, serial=SCANNED)
    History(runs).refresh()
    operator.window.show_page("history_page")
    operator.window.setFocus()
    operator.qtbot.keyClicks(operator.window, SCANNED)
    operator.qtbot.keyClick(operator.window, Qt.Key.Key_Return)
    assert "Serial number: attempt 2, already passed" in operator.says()
    operator.window.app.set_language("zh_CN")
    operator.scan(SCANNED)
    assert "序列号：第 2 次，以前已合格" in operator.says()


def test_scan_of_a_unit_whose_latest_verdict_is_failed_says_so(operator: Operator) -> None:
    runs = operator.site_folder.runs
    runs.mkdir()
    write_result(runs, f"{SCANNED}_20261101T000000", 1, serial=SCANNED, outcome="failed")
    write_result(runs, f"{SCANNED}_20261102T000000", 2, serial=SCANNED, attempt=2, outcome="stopped")
    History(runs).refresh()
    for language, note in (("en", "attempt 3, latest verdict: failed"), ("zh_CN", "第 3 次，最近一次判定：不合格")):
        operator.window.app.set_language(language)
        operator.scan(SCANNED)
        assert note in operator.says()
    operator.site_folder.write(units=2)
    operator.window.app.set_station(operator.site_folder.station)
    operator.scan(SCANNED)
    assert "第 3 次，最近一次判定：不合格" in operator.widget("slot_1_tile").accessibleName()


@pytest.mark.long
@pytest.mark.parametrize("page", ["operator_page", "history_page"])
def test_scan_during_a_run_is_refused_with_a_sentence_and_a_sound(
    simulated_run: Operator, monkeypatch: pytest.MonkeyPatch, page: str
) -> None:
    window, edit = simulated_run.window, simulated_run.widget("serial_edit", QLineEdit)
    sounds: list[str] = []
    monkeypatch.setattr(starting, "play", sounds.append)
    window.app.settings.setValue("sounds", True)
    with monkeypatch.context() as patch:
        patch.setattr(EngineLink, "running", True)
        window.app.run.changed.emit()
        before = edit.text()
        window.show_page(page)
        window.setFocus()
        scan_into_focus(simulated_run, SCANNED)
        assert window.operator_page.isVisible()
        assert "This scan was not taken" in simulated_run.says()
        window.app.set_language("zh_CN")
        assert "标定还在进行，请等它结束后再扫描下一台产品。" in simulated_run.says()
        assert (edit.text(), sounds) == (before, ["refused"])


@pytest.mark.parametrize(
    ("language", "remedy"),
    [
        ("en", "scan a badge or the next unit when it has ended."),
        ("zh_CN", "请等它结束后再扫描工牌或下一台产品。"),
    ],
)
def test_scan_during_a_run_says_when_somebody_can_sign_in(operator: Operator, language: str, remedy: str) -> None:
    operator.site_folder.write(station={"sign_in": {"badge_pattern": r"B\d{4}"}})
    operator.window.app.set_station(operator.site_folder.station)
    operator.window.app.set_language(language)
    operator.window.operator_page.header.scan_refused.emit()
    assert remedy in operator.says()


def test_scans_set_no_pin(operator: Operator) -> None:
    operator.window.app.role.ask()
    person = operator.widget("role_person_edit", QLineEdit)
    operator.qtbot.keyClicks(person, SCANNED)
    operator.qtbot.keyClick(person, Qt.Key.Key_Return)
    assert (person.text(), operator.window.focusWidget()) == ("", person)
    assert "This is a serial number: enter your name or badge." in operator.says()
    operator.qtbot.keyClicks(person, "Li Wei")
    operator.qtbot.keyClick(person, Qt.Key.Key_Return)
    assert operator.window.focusWidget() is operator.widget("pin_edit")
    assert "This is a serial number" not in operator.says()
    person.setText(SCANNED)
    for name in ("pin_edit", "pin_again_edit"):
        edit = operator.widget(name, QLineEdit)
        edit.setFocus()
        operator.qtbot.keyClicks(edit, SCANNED)
        operator.qtbot.keyClick(edit, Qt.Key.Key_Return)
    assert not access.has_pin()
    operator.qtbot.mouseClick(operator.widget("unlock_button", QPushButton), Qt.MouseButton.LeftButton)
    assert not access.has_pin()
    assert "must differ from the name" in operator.says()
