"""Scans into any widget, incompatible products and old verdicts; runs consist of emitted events without an engine."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import pytest
import tomli_w
from PySide6.QtCore import QPoint, Qt
from PySide6.QtWidgets import QApplication, QComboBox, QLabel, QLineEdit, QListWidget, QPushButton

from calstation.config import RunRequest, library
from calstation.connection import TableReset
from calstation.errors import DeviceFaultError, InputError
from calstation.escaping import for_file_name
from calstation.gui.operator.live.live_view import Preparation
from calstation.gui.operator.questions import closing_notice
from calstation.gui.state import AppContext, RunStrip, TableNotice
from calstation.gui.state.engine_link import EngineLink
from calstation.gui.text import rendered, say, step_sentence
from calstation.gui.widgets import theme
from calstation.jobs import JobQueue
from calstation.messages import Text
from calstation.records import Verdict
from calstation.results import Delivery, History
from calstation.runs import finish_incomplete
from calstation.runs.incomplete import StartupRecovery
from calstation.sequencer import (
    ChamberChanged,
    Fault,
    Finalized,
    Message,
    StageEnded,
    StageProgress,
    StageSolved,
    StageStarted,
    StateChanged,
    StepStarted,
    TableMoved,
)
from tests.check_rows import check_row
from tests.database.result_files import write_result
from tests.dead_logs import write_dead_log
from tests.gui.conftest import RESULT, SERIAL, Operator
from tests.open_transfers import WRITTEN, write_open_transfer
from tests.results.test_shift import VERDICT
from tests.site_folder import STATION, SiteFolder

ENDED: dict[str, Any] = {**RESULT, "attempt": 1, "duration_s": 60.0, "advice": "resume"}


@pytest.fixture
def simulated_run(operator: Operator) -> Operator:
    """An operator during a run that consists of emitted events."""
    link = operator.window.app.engine_link
    site = operator.site_folder
    link.request = RunRequest(SERIAL, site.station, site.product, out=operator.window.app.runs_folder)
    link.running_changed.emit(True)
    return operator


def end_run(operator: Operator, outcome: str, **result: Any) -> None:
    """End the run with an outcome."""
    link = operator.window.app.engine_link
    link.event.emit(Finalized(Verdict(outcome), "log.h5", "result.json", {**ENDED, **result}))
    link.running_changed.emit(False)
    operator.until(lambda: operator.verdict)


def scan_into_focus(operator: Operator, text: str) -> None:
    """Send each key to the widget that has the focus, as a scanner does."""
    for character in text:
        operator.qtbot.keyClick(operator.window.focusWidget() or operator.window, character)
    operator.qtbot.keyClick(operator.window.focusWidget() or operator.window, Qt.Key.Key_Return)


def serial_and_focus(operator: Operator) -> tuple[str, object]:
    """Return the text of the serial field, and the widget with the focus."""
    return operator.widget("serial_edit", QLineEdit).text(), operator.window.focusWidget()


def test_scan_reaches_the_serial_field_from_any_focus(operator: Operator) -> None:
    tabs = operator.window.page_tabs.tabBar()
    combo = operator.widget("product_combo", QComboBox)
    named = [operator.widget(n) for n in ("theme_button", "language_combo", "product_combo", "stop_button")]
    product = combo.currentText()
    for focused in (tabs, *named):
        focused.setFocus()
        scan_into_focus(operator, "TX-100")
        assert serial_and_focus(operator)[0] == "TX-100"
        assert "does not match this product" in operator.says()
        focused.setFocus()
        scan_into_focus(operator, SERIAL)
        assert serial_and_focus(operator) == (SERIAL, operator.widget("start_button"))
    assert operator.widget("language_combo", QComboBox).currentIndex() == 0

    combo.showPopup()
    operator.qtbot.keyClick(combo.view(), "t")
    operator.until(lambda: QApplication.activePopupWidget() is None)  # the list is closed after the scan
    assert (combo.currentText(), serial_and_focus(operator)[0]) == (product, "t")
    assert not operator.window.app.engine_link.running


@pytest.mark.long
def test_serial_field_has_the_focus_after_product_page_theme_and_language_changes(operator: Operator) -> None:
    edit = operator.widget("serial_edit", QLineEdit)
    operator.widget("product_combo").setFocus()
    operator.choose("nav_a")
    assert operator.window.focusWidget() is edit
    operator.window.show_page("history_page")
    operator.window.show_page("operator_page")
    assert operator.window.focusWidget() is edit
    operator.press("theme_button")
    assert operator.window.focusWidget() is edit
    operator.press("theme_button")
    operator.widget("language_combo", QComboBox).setFocus()
    operator.widget("language_combo", QComboBox).setCurrentIndex(1)
    assert operator.window.focusWidget() is edit


def test_typed_names_and_pins_are_not_taken_for_scans(operator: Operator) -> None:
    name = operator.widget("operator_edit", QLineEdit)
    name.setFocus()
    operator.qtbot.keyClicks(name, "Li")
    assert name.text() == "Li"

    operator.scan(SERIAL)
    start = operator.widget("start_button", QPushButton)
    assert "Press Space or click" in start.toolTip()
    operator.qtbot.keyClick(start, Qt.Key.Key_Return)
    assert operator.message == "Enter does not start: press Space or click START."

    operator.press("role_button")
    operator.qtbot.keyClick(operator.window, "7")
    assert serial_and_focus(operator)[0] == SERIAL


@pytest.mark.parametrize(("language", "text"), [("en", "Rate: solving"), ("zh_CN", "速率：解算中")])
def test_message_line_names_a_stage_that_is_solved_instead_of_its_last_move(
    simulated_run: Operator, language: str, text: str
) -> None:
    simulated_run.window.app.set_language(language)
    link = simulated_run.window.app.engine_link
    move = step_sentence("dwell", ("face_up", "x"))
    link.event.emit(StateChanged("running", "preparing"))
    link.event.emit(StageStarted("rate", 0, 2, 10.0))
    link.event.emit(StepStarted("rate", 1, "dwell", ("face_up", "x")))
    simulated_run.until(lambda: simulated_run.message == move, 10.0)
    link.event.emit(StageEnded("rate", "plan", 1))
    simulated_run.until(lambda: simulated_run.message == text, 10.0)
    link.event.emit(StepStarted("six_position", 2, "dwell", ("face_up", "x")))
    simulated_run.until(lambda: simulated_run.message == move, 10.0)


def test_resumed_stage_shows_no_time_and_message_line_follows_the_language(simulated_run: Operator) -> None:
    link = simulated_run.window.app.engine_link
    first, second = simulated_run.run.stages[0].name, simulated_run.run.stages[1].name
    link.event.emit(StageSolved(first, {}, {"passed": True}))
    link.event.emit(StageStarted(second, 1, 4, 10.0))
    link.event.emit(StageSolved(second, {}, {"passed": True}))
    stages = simulated_run.widget("stage_list", QListWidget)

    def state_texts(row: int) -> list[str]:
        return str(stages.item(row).data(Qt.ItemDataRole.AccessibleTextRole)).split(", ")[1:]

    simulated_run.until(lambda: state_texts(1) == ["done", "0:00"])
    assert state_texts(0) == ["done"]

    language = simulated_run.widget("language_combo", QComboBox)
    language.setCurrentIndex(1)
    end_run(simulated_run, "stopped", stages=[first, second])
    assert "已完成的阶段" in simulated_run.message
    language.setCurrentIndex(0)
    simulated_run.until(lambda: simulated_run.message.startswith("The completed stages are kept: resume after them"))


@pytest.mark.long
def test_verdict_is_cleared_by_another_product_or_station(simulated_run: Operator) -> None:
    end_run(simulated_run, "passed", simulated=True)
    assert simulated_run.verdict == "PASS"
    simulated_run.window.show_page("history_page")
    strip = next(s for s in simulated_run.window.findChildren(RunStrip) if s.isVisible())
    for code, text in (("en", "PASS, simulated"), ("zh_CN", "合格，模拟")):
        simulated_run.window.app.set_language(code)
        assert f"{SERIAL}  ·  {text}" in [label.text() for label in strip.findChildren(QLabel)], "as in the history"
    simulated_run.window.app.set_language("en")
    simulated_run.window.show_page("operator_page")
    simulated_run.choose("nav_a")
    assert simulated_run.verdict == ""
    assert "Load the unit" in simulated_run.says()

    simulated_run.window.app.engine_link.running_changed.emit(True)
    simulated_run.window.app.engine_link.event.emit(StateChanged("running", "preparing"))
    end_run(simulated_run, "passed")
    simulated_run.window.app.set_station(simulated_run.site_folder.station)
    assert simulated_run.verdict == ""


@pytest.mark.long
@pytest.mark.parametrize(
    ("language", "outcome", "text"),
    [
        ("en", "failed", "PARTIAL  ·  FAIL"),
        ("en", "partial", "PARTIAL"),
        ("zh_CN", "failed", "部分  ·  不合格"),
        ("zh_CN", "stopped", "部分  ·  已停止"),
    ],
)
def test_title_and_strip_say_after_a_partial_run_that_it_was_partial(
    operator: Operator, language: str, outcome: str, text: str
) -> None:
    app, site = operator.window.app, operator.site_folder
    app.set_language(language)
    app.engine_link.request = RunRequest(SERIAL, site.station, site.product, ("rate",), app.runs_folder)
    app.engine_link.running_changed.emit(True)
    end_run(operator, outcome, partial=True)
    operator.window.show_page("history_page")
    assert f"{SERIAL}  ·  {text}" in operator.says().splitlines()
    assert operator.window.windowTitle() == f"{SERIAL}  ·  {text}  –  calstation"
    operator.window.show_page("operator_page")
    operator.scan("SN-000043")
    assert operator.window.windowTitle() == "calstation"


def test_decisive_value_is_bold_and_shown_with_its_limit(simulated_run: Operator) -> None:
    row = {"unit": "rad/s", "stage": "rate", "value": -4e-6, "sigma": 9e-6}
    checks = [
        check_row("within", "gyro_bias_x", -4e-6, [-1.5e-5, 1.5e-5], passed=True),
        check_row("sigma_below", "gyro_bias_x", 9e-6, 1e-5, passed=True),
    ]
    end_run(simulated_run, "passed", parameters={"gyro_bias_x": row}, checks=checks)
    simulated_run.until(lambda: "σ ≤ 2.1" in simulated_run.says())
    bold = theme.font(bold=True).weight()
    shown = [
        label
        for label in simulated_run.window.findChildren(QLabel)
        if label.isVisible() and label.font().weight() == bold
    ]
    assert "1.9" in [label.text() for label in shown]
    assert "−0.8" not in [label.text() for label in shown]


def test_station_starts_with_the_product_that_it_names(operator: Operator, site_folder: SiteFolder) -> None:
    combo, path = operator.widget("product_combo", QComboBox), site_folder.station.with_name("named.toml")
    path.write_text(f'product = "tactical_b"\n{site_folder.station.read_text(encoding="utf-8")}', encoding="utf-8")
    assert Path(combo.currentData()).stem == "short"
    operator.window.app.set_station(path)
    assert Path(combo.currentData()).stem == "tactical_b"
    operator.choose("mems_c")
    operator.window.app.station_changed.emit()
    assert Path(combo.currentData()).stem == "mems_c", "the station was only saved"


def test_compatible_products_are_listed_and_selected_by_a_button(
    operator: Operator, monkeypatch: pytest.MonkeyPatch
) -> None:
    app = operator.window.app
    app.set_station(library.find("stations", "virtual_hand"))
    assert "cannot run" in operator.says()
    assert "rails are turned by hand" in operator.says()
    assert "Compatible products: “MEMS grade C, by hand”." in operator.says()
    assert "multi_position" not in operator.says()
    operator.press("product_choice_mems_hand")
    assert operator.widget("product_combo", QComboBox).currentText() == "MEMS grade C, by hand"
    assert "cannot run" not in operator.says()
    assert "The simulated operator turns the rails" in operator.says()
    assert operator.widget("start_button").isEnabled()

    app.set_station(library.find("stations", "virtual_bench"))
    assert "is driven; the selection is turned by hand" in operator.says()
    assert ".toml" not in operator.says()
    assert "manual" not in operator.says()
    operator.press("product_choice_mems_c")
    assert "cannot run" not in operator.says()

    names = library.names
    monkeypatch.setattr(library, "names", lambda kind: ["short"] if kind == "products" else names(kind))
    app.set_station(library.find("stations", "virtual_hand"))
    assert "No product can be calibrated here: choose another station for that." in operator.says()
    assert operator.widget("station_choice").isVisible()


@pytest.mark.long
def test_start_waits_while_another_page_uses_a_device(operator: Operator, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(JobQueue, "uses_device", True)
    operator.scan(SERIAL)
    operator.press("start_button")
    assert "then press START again" in operator.says()
    assert not operator.window.app.engine_link.running

    started: list[object] = []
    monkeypatch.setattr(EngineLink, "start", lambda _, order: started.append(order))
    request = RunRequest(SERIAL, operator.site_folder.station, operator.site_folder.product)
    operator.window.operator_page._starting.dialog.begin(request)
    operator.press("clear_choice")
    assert started == []
    monkeypatch.setattr(JobQueue, "uses_device", False)
    operator.press("clear_choice")
    assert started == [replace(request, operator="")], "nobody has entered a name"


def test_failures_in_closing_earlier_runs_are_reported(operator: Operator) -> None:
    interrupted = operator.window.operator_page._starting.interrupted
    error = InputError("run.not_resumable", path="log.h5")
    for watch, title in (
        (interrupted._recovery, "Earlier runs were not closed or handed over"),
        (interrupted._closing, "The run was not closed"),
    ):
        watch.failed.emit(error)
        assert title in operator.says()
        operator.press("operator_notice_close")
    interrupted._search.failed.emit(error)
    assert "The run cannot be resumed" in operator.says()
    reason = Text.of("handover.no_answer", seconds=5.0)
    interrupted._recovery.done.emit(StartupRecovery((), Delivery(Path("share"), 0, 2, reason)))
    assert "Hand-over: 2 results waiting, because share cannot be reached (no response within 5 s)." in operator.says()


@pytest.mark.parametrize(
    ("code", "waiting", "left"),
    [("en", "2 results waiting", "Registers not verified: SN-7"), ("zh_CN", "2 ", "寄存器尚未验证：SN-7")],
)
@pytest.mark.parametrize("occupied", [False, True])
def test_notice_at_the_start_names_waiting_results_and_unverified_registers(
    operator: Operator, code: str, waiting: str, left: str, occupied: bool
) -> None:
    operator.window.app.set_language(code)
    interrupted = operator.window.operator_page._starting.interrupted
    operator.until(lambda: not interrupted._first)
    if occupied:
        operator.run.set_elsewhere(((SERIAL,), "running"))
    delivery = Delivery(Path("share"), 0, 2, Text.of("handover.no_answer", seconds=5.0))
    write_open_transfer(operator.window.app.runs_folder, "SN-7", *WRITTEN)
    interrupted._recovery.done.emit(StartupRecovery((), delivery, ("SN-7",)))
    notice = operator.says()
    assert waiting in notice
    assert "share" in notice
    assert (left in notice) is not occupied, "the other window may be writing the registers"


@pytest.mark.usefixtures("engineer_page")
@pytest.mark.long
@pytest.mark.parametrize("outcome", ["passed", "failed", "stopped"])
def test_verdict_keeps_its_serial_number_and_the_field_is_for_the_next_unit(
    simulated_run: Operator, outcome: str
) -> None:
    edit, engineer_edit = (simulated_run.widget(n, QLineEdit) for n in ("serial_edit", "engineer_serial_edit"))
    assert edit.text() == SERIAL
    simulated_run.widget("engineer_serial_edit", QLineEdit).setText(SERIAL)
    end_run(simulated_run, outcome)
    word, serial = (simulated_run.widget(n, QLabel) for n in ("verdict_label", "verdict_serial_label"))
    assert serial.text() == SERIAL
    assert serial.isVisible()
    assert serial.font().pixelSize() >= word.font().pixelSize() - 1
    assert SERIAL not in (edit.text(), engineer_edit.text())
    assert "Serial number: next unit" in simulated_run.says()
    simulated_run.window.show_page("engineer_page")
    assert "Serial number: next unit" in simulated_run.says()
    assert f"{SERIAL}  ·  {word.text()}" in simulated_run.says()
    simulated_run.window.show_page("operator_page")

    simulated_run.window.app.set_language("zh_CN")
    assert "序列号：下一台产品" in simulated_run.says()
    simulated_run.window.app.set_language("en")
    simulated_run.qtbot.keyClicks(edit, "SN-00")
    assert "Serial number: next unit" in simulated_run.says()
    simulated_run.scan("SN-000077")
    assert simulated_run.verdict == ""
    assert "next unit" not in simulated_run.says()


@pytest.mark.long
def test_unit_scanned_before_a_stopped_engine_ends_is_kept(
    simulated_run: Operator, monkeypatch: pytest.MonkeyPatch
) -> None:
    link = simulated_run.window.app.engine_link
    monkeypatch.setattr(EngineLink, "running", True)
    simulated_run.press("stop_button")
    link.event.emit(StateChanged("stopped", "running"))
    simulated_run.until(lambda: simulated_run.message == "Stopped; the result is being stored.")
    simulated_run.window.app.set_language("zh_CN")
    assert simulated_run.message == "已停止，正在保存结果。"  # what to do next is not known yet
    simulated_run.window.app.set_language("en")
    link.event.emit(Finalized(Verdict.STOPPED, "log.h5", "result.json", ENDED))
    simulated_run.until(lambda: simulated_run.verdict)
    scan_into_focus(simulated_run, "SN-000077")
    assert simulated_run.verdict == ""
    assert serial_and_focus(simulated_run)[0] == "SN-000077"
    assert not simulated_run.widget("start_button").isEnabled()
    monkeypatch.setattr(EngineLink, "running", False)
    link.running_changed.emit(False)
    assert simulated_run.widget("start_button").isEnabled()
    assert serial_and_focus(simulated_run) == ("SN-000077", simulated_run.widget("start_button"))
    assert "interrupted" not in simulated_run.says()


def test_long_serial_number_fits_next_to_the_verdict(simulated_run: Operator) -> None:
    simulated_run.run.unit.serial = "UNIT-OF-A-VERY-LONG-NAME-0000000123456789"
    end_run(simulated_run, "incomplete")
    serial = simulated_run.widget("verdict_serial_label", QLabel)
    simulated_run.until(lambda: serial.fontMetrics().horizontalAdvance(serial.text()) <= serial.width(), 10.0)


@pytest.mark.usefixtures("engineer_page")
@pytest.mark.long
def test_suggested_serial_number_does_not_survive_a_change_to_hardware(operator: Operator) -> None:
    operator.window.create_engineer_page()
    edits = [operator.widget(name, QLineEdit) for name in ("serial_edit", "engineer_serial_edit")]
    bench = operator.site_folder.station
    assert [edit.text() for edit in edits] == ["SN-000001", "SN-000001"]
    hardware = bench.with_name("hardware.toml")
    ports = {"table": {"profile": "bench", "port": "tcp://127.0.0.1:9"}, "imu": {"port": "socket://127.0.0.1:9"}}
    hardware.write_text(tomli_w.dumps({**STATION, "name": "hardware", **ports}), encoding="utf-8")
    operator.window.app.set_station(hardware)
    assert [edit.text() for edit in edits] == ["", ""]
    start = operator.widget("start_button", QPushButton)
    assert not start.isEnabled()
    assert start.toolTip() == "Scan the serial number of the unit."

    operator.window.app.set_station(bench)
    assert [edit.text() for edit in edits] == ["SN-000001", "SN-000001"]
    operator.window.app.set_station(library.find("stations", "virtual_hand"))  # cannot run this product
    operator.window.app.set_station(hardware)
    assert [edit.text() for edit in edits] == ["", ""]
    operator.scan(SERIAL)
    operator.window.app.set_station(bench)
    assert edits[0].text() == SERIAL


def test_stage_of_a_failing_value_is_marked_and_the_value_listed_first(simulated_run: Operator) -> None:
    link = simulated_run.window.app.engine_link
    for stage in simulated_run.run.stages[:2]:
        link.event.emit(StageStarted(stage.name, 0, 4, 10.0))
        link.event.emit(StageSolved(stage.name, {}, {"passed": True}))
    row = {"unit": "1", "sigma": 1e-6}
    parameters = {
        "gyro_scale_x": {**row, "value": 1e-4, "stage": "rate"},
        "accel_scale_y": {**row, "value": 5e-3, "stage": "six_position"},
    }
    checks = [
        check_row("within", name, parameters[name]["value"], [-1e-3, 1e-3], passed=passed, unit="1")
        for name, passed in (("gyro_scale_x", True), ("accel_scale_y", False))
    ]
    end_run(simulated_run, "failed", parameters=parameters, checks=checks, stages=["rate", "six_position"])
    items = simulated_run.widget("stage_list", QListWidget)
    states = [items.item(k).data(Qt.ItemDataRole.AccessibleTextRole).split(", ")[1] for k in range(2)]
    assert states == ["done", "failed"]
    order = ["outside its limit", "accel scale factor y", "nearest to its limit", "gyro scale factor x"]
    simulated_run.until(lambda: set(order) <= set(simulated_run.says().splitlines()))
    labels = [label for label in simulated_run.window.findChildren(QLabel) if label.isVisible()]
    heights = {label.text(): label.mapToGlobal(label.rect().center()).y() for label in labels}
    assert sorted(order, key=lambda text: heights[text]) == order
    simulated_run.widget("language_combo", QComboBox).setCurrentIndex(1)
    simulated_run.until(lambda: "不合格" in simulated_run.says() and "完成" in simulated_run.says())


@pytest.mark.long
def test_interrupted_unit_scanned_again_is_resumed_or_restarted(
    operator: Operator, monkeypatch: pytest.MonkeyPatch
) -> None:
    runs = operator.window.app.runs_folder
    runs.mkdir()
    log = write_dead_log(runs)
    finish_incomplete(runs)
    History(runs).refresh()
    started: list[RunRequest] = []
    monkeypatch.setattr(EngineLink, "start", lambda _, order: started.append(order))
    operator.scan("SN-000004")
    assert "interrupted" not in operator.says()
    operator.scan("SN-000003")
    assert "SN-000003 was interrupted in stage 2" in operator.says()
    assert not operator.widget("start_button").isEnabled()
    assert operator.message == "Answer the question on this page first."
    assert "READY" not in operator.says().split("\n")
    operator.press("cancel_choice")
    operator.press("start_button")
    assert started == []
    operator.press("anew_choice")
    assert [request.resume for request in started] == [None]
    operator.scan("SN-000003")
    operator.press("resume_choice")
    assert [request.resume and request.resume.name for request in started] == [None, log.name]

    operator.window.show_page("engineer_page")
    operator.widget("engineer_serial_edit", QLineEdit).setText("SN-000003")
    operator.press("engineer_start_button")
    assert "SN-000003 was interrupted in stage 2" in operator.says()
    operator.press("anew_choice")
    assert len(started) == 3
    operator.press("engineer_start_button")
    operator.press("resume_choice")
    assert [request.resume and request.resume.name for request in started[2:]] == [None, log.name]


@pytest.mark.parametrize(
    ("language", "issued"), [("en", "The certificate was issued"), ("zh_CN", "证书已签发")], ids=["en", "zh"]
)
def test_finished_certificate_does_not_replace_an_open_question(operator: Operator, language: str, issued: str) -> None:
    page, runs = operator.window.operator_page, operator.window.app.runs_folder
    operator.window.app.set_language(language)
    write_dead_log(runs, station="test bench")
    finish_incomplete(runs)
    History(runs).refresh()
    operator.scan("SN-000003")
    assert operator.window.focusWidget() is operator.widget("cancel_choice")
    page._verdict.certificate_button._issued(Path("c.pdf"))
    assert issued in operator.says()
    assert operator.window.focusWidget() is operator.widget("cancel_choice")
    assert not operator.widget("start_button").isEnabled()
    operator.press("cancel_choice")
    operator.scan("SN-000004")
    assert issued not in operator.says()


@pytest.mark.parametrize(("language", "question"), [("en", "was interrupted in stage 2"), ("zh_CN", "中断")])
def test_unit_that_has_left_the_table_is_offered_only_after_its_scan(
    operator: Operator, language: str, question: str
) -> None:
    runs = operator.window.app.runs_folder
    write_dead_log(runs, "SN-000003", station="test bench")
    write_dead_log(runs, "SN-000004", 0, hours_ago=0.5, station="test bench")
    operator.window.app.set_language(language)
    operator.window.operator_page._starting.interrupted.recover()
    operator.until(lambda: not operator.run.reading_runs)
    assert question not in operator.says()
    operator.scan("SN-000003")
    assert question in operator.says()


@pytest.mark.parametrize("hardware", [True, False])
def test_interrupted_simulated_run_is_offered_only_at_a_virtual_station(operator: Operator, hardware: bool) -> None:
    write_dead_log(operator.window.app.runs_folder, "SN-000003", station="test bench", seed=5)
    interrupted = operator.window.operator_page._starting.interrupted
    assert interrupted.run_summary is not None
    if hardware:
        interrupted.run_summary = replace(interrupted.run_summary, bench=None)
    interrupted.recover()
    operator.until(lambda: operator.run.reading_runs)
    operator.until(lambda: not operator.run.reading_runs)
    assert ("was interrupted in stage 2" in operator.says()) is not hardware


@pytest.mark.parametrize(
    ("language", "why"), [("en", "The program is looking for interrupted runs."), ("zh_CN", "正在查找中断的标定。")]
)
def test_nothing_starts_before_interrupted_runs_were_looked_for(operator: Operator, language: str, why: str) -> None:
    write_dead_log(operator.window.app.runs_folder, station="test bench")
    operator.window.app.set_language(language)
    start = operator.widget("start_button", QPushButton)
    operator.scan(SERIAL)
    assert start.isEnabled()
    operator.window.operator_page._starting.interrupted.recover()
    assert not start.isEnabled()
    assert start.toolTip() == why
    operator.until(lambda: operator.message == why)
    assert not {"READY", "就绪"} & set(operator.says().split("\n"))
    operator.until(lambda: operator.window.operator_page.notice.asking)
    assert not start.isEnabled()
    operator.press("later_choice")
    assert start.isEnabled()
    operator.window.operator_page._starting.interrupted.offer()
    assert start.isEnabled(), "a later search may wait for other work"


def test_scan_while_interrupted_runs_are_looked_for_is_accepted_when_they_were(operator: Operator) -> None:
    operator.window.app.runs_folder.mkdir(exist_ok=True)
    operator.window.operator_page._starting.interrupted.recover()
    operator.scan(SERIAL)
    start, symbol = operator.widget("start_button", QPushButton), operator.widget("serial_symbol")
    assert not start.isEnabled()
    operator.window.app.windows.changed.emit()  # it becomes known that no other window is open
    operator.until(lambda: not operator.run.reading_runs)
    operator.until(start.hasFocus)
    assert symbol.isVisible()
    assert operator.widget("serial_edit", QLineEdit).text() == SERIAL


def test_completed_stages_of_a_resumed_run_are_done_from_the_beginning(operator: Operator) -> None:
    runs = operator.window.app.runs_folder
    runs.mkdir()
    log = write_dead_log(runs)
    finish_incomplete(runs)
    History(runs).refresh()
    link, site = operator.window.app.engine_link, operator.site_folder
    link.request = RunRequest("SN-000003", site.station, site.product, out=runs, resume=log)
    link.running_changed.emit(True)
    link.event.emit(StateChanged("preparing", "idle"))
    stages = operator.widget("stage_list", QListWidget)
    for language, done in (("en", "done"), ("zh_CN", "完成")):
        operator.window.app.set_language(language)
        operator.until(lambda: operator.run.state == "preparing")
        assert stages.item(0).data(Qt.ItemDataRole.AccessibleTextRole).split(", ")[1:] == [done]
        assert done not in stages.item(1).data(Qt.ItemDataRole.AccessibleTextRole)


@pytest.mark.long
@pytest.mark.parametrize(("station", "offered"), [("test bench", True), ("another bench", False)])
def test_interrupted_run_is_offered_only_at_its_station(operator: Operator, station: str, *, offered: bool) -> None:
    runs = operator.window.app.runs_folder
    runs.mkdir()
    log = write_dead_log(runs, station=station)
    finish_incomplete(runs)
    operator.window.show_page("history_page")
    operator.until(lambda: "SN-000003" in operator.says())
    operator.until_no_job()
    operator.until(lambda: operator.widget("history_resume_button").isVisible() is offered)
    operator.window.show_page("operator_page")
    operator.window.operator_page._starting.interrupted.recover()
    if not offered:
        operator.until_no_job()
        assert "was interrupted" not in operator.says()
        operator.scan("SN-000003")
        assert "was interrupted" not in operator.says()
        return
    operator.until(lambda: "SN-000003 was interrupted" in operator.says())
    assert operator.window.focusWidget() is operator.widget("later_choice")  # not what nobody has confirmed
    kept = log.rename(log.with_suffix(".kept"))
    operator.press("resume_choice")
    assert "cannot be resumed" in operator.says()
    assert operator.widget("serial_edit", QLineEdit).text() == ""
    start = operator.widget("start_button", QPushButton)
    assert not start.isEnabled()
    assert start.toolTip() == "Scan the serial number of the unit."
    kept.rename(log)
    operator.scan("SN-000003")
    assert operator.window.focusWidget() is operator.widget("cancel_choice")


@pytest.mark.long
def test_question_before_closing_is_not_mistaken_for_resuming(
    simulated_run: Operator, monkeypatch: pytest.MonkeyPatch
) -> None:
    window, link = simulated_run.window, simulated_run.window.app.engine_link
    with monkeypatch.context() as patch:
        patch.setattr(EngineLink, "running", True)
        link.event.emit(StateChanged("paused", "running"))
        simulated_run.until_state("paused")
        window.show_page("history_page")
        window.close()
        assert window.isVisible()
        assert "The calibration is paused" in simulated_run.says()
        simulated_run.until(lambda: simulated_run.widget("pause_button", QPushButton).text() == "Resume")
        window.app.set_language("zh_CN")
        keep_open = simulated_run.widget("keep_open_choice", QPushButton)
        assert (keep_open.text(), simulated_run.widget("pause_button", QPushButton).text()) == ("不关闭", "继续")
        assert "标定已暂停" in simulated_run.says()
        assert simulated_run.message.startswith("已暂停，转台静止，但轴使能仍接通。")
        assert window.focusWidget() is keep_open
        simulated_run.qtbot.keyClick(keep_open, Qt.Key.Key_Space)
        assert window.focusWidget() is window.operator_page  # not the tabs, which the arrow keys would change
        assert simulated_run.run.state == "paused"


@pytest.mark.parametrize("language", ["en", "zh_CN"])
def test_question_before_closing_promises_to_resume_only_what_can_be_resumed(
    simulated_run: Operator, monkeypatch: pytest.MonkeyPatch, language: str
) -> None:
    window, event = simulated_run.window, simulated_run.window.app.engine_link.event
    resumed = "the run can be resumed later" if language == "en" else "以后可以接着做"
    monkeypatch.setattr(EngineLink, "running", True)
    window.app.set_language(language)

    def question() -> str:
        window.close()
        return simulated_run.says()

    event.emit(StateChanged("preparing", "idle"))
    preparing = question()
    assert resumed not in preparing
    assert ("A calibration is being prepared" if language == "en" else "正在准备标定") in preparing
    event.emit(StateChanged("running", "preparing"))
    event.emit(StageStarted("six_position", 0, 2, 100.0))
    first = question()
    assert resumed not in first
    assert ("starts again from the first stage" if language == "en" else "已做的会丢失，须从头再来") in first
    event.emit(StageSolved("six_position", {}, {"passed": True}))
    assert resumed in question()
    assert ("Esc stops the run too." if language == "en" else "按 Esc 也会停止标定。") in question()
    simulated_run.press("stop_button")
    assert resumed not in simulated_run.says(), "the run is stopped, so nothing is asked about it"


@pytest.mark.parametrize("language", ["en", "zh_CN"])
def test_stage_says_that_the_run_is_stopping(simulated_run: Operator, language: str) -> None:
    event, stages = simulated_run.window.app.engine_link.event, simulated_run.widget("stage_list", QListWidget)
    simulated_run.window.app.set_language(language)
    event.emit(StateChanged("running", "preparing"))
    event.emit(StageStarted("rate", 0, 1, 100.0))
    progress(simulated_run, 0.54, 46.0, 3.0)
    simulated_run.until(lambda: "54 %" in stages.item(0).toolTip())
    simulated_run.press("stop_button")
    assert "54 %" not in stages.item(0).toolTip()
    assert ("STOPPING" if language == "en" else "正在停止") in stages.item(0).toolTip()
    assert simulated_run.run.remaining is None


def test_key_after_a_fault_does_not_reset_the_table(simulated_run: Operator) -> None:
    link = simulated_run.window.app.engine_link
    link.event.emit(StateChanged("fault", "running"))
    link.event.emit(Fault.of(DeviceFaultError("table.latched_drive", fault="drive")))
    end_run(simulated_run, "fault")
    reset = simulated_run.widget("verdict_reset_button", QPushButton)
    pressed: list[bool] = []
    reset.clicked.connect(pressed.append)
    assert reset.isVisible()
    for key in (Qt.Key.Key_Space, Qt.Key.Key_Return):
        simulated_run.qtbot.keyClick(simulated_run.window.focusWidget(), key)
    assert pressed == []
    assert simulated_run.run.fault is not None, "nor is it acknowledged"
    simulated_run.qtbot.keyClick(simulated_run.window.focusWidget(), Qt.Key.Key_Tab)
    assert simulated_run.window.focusWidget() is reset, "the next key of somebody who uses no mouse"


def test_stopped_run_offers_no_certificate_in_place_of_its_resumption(simulated_run: Operator) -> None:
    simulated_run.window.app.engine_link.event.emit(StateChanged("running", "preparing"))
    end_run(simulated_run, "stopped", parameters={"gyro_bias_x": {"value": 0.0, "sigma": 1e-6, "unit": "rad/s"}})
    assert not simulated_run.widget("certificate_button").isVisible()
    panel = simulated_run.window.operator_page._verdict
    lefts = [each.mapTo(panel, QPoint(0, 0)).x() for each in (panel.reason_label, panel.details_button)]
    assert lefts[0] == lefts[1], "nothing is indented without figures"


@pytest.mark.parametrize("language", ["en", "zh_CN"])
def test_safe_stop_that_failed_leads_the_advice(simulated_run: Operator, language: str) -> None:
    link, panel = simulated_run.window.app.engine_link, simulated_run.window.operator_page._verdict
    simulated_run.window.app.set_language(language)
    link.event.emit(StateChanged("running", "preparing"))
    failure = {"text": Text.of("os.other", words="no answer"), "table": True}
    link.event.emit(Message("safe_stop_incomplete", failure))
    link.event.emit(StateChanged("fault", "running"))
    link.event.emit(Fault.of(DeviceFaultError("motion.switched_off")))
    end_run(simulated_run, "fault")
    assert ("emergency stop" if language == "en" else "急停") in panel.action_label.text()
    cause = simulated_run.message
    simulated_run.press("stop_button")
    assert simulated_run.message == cause
    panel.reset._finish(TableReset("cleared", "drive", None))
    assert not simulated_run.run.stop_incomplete, "nor do the verdicts on several units name it any more"
    assert ("emergency stop" if language == "en" else "急停") not in panel.action_label.text()


def test_times_on_hardware_are_named_only_where_the_bench_is_faster(operator: Operator) -> None:
    note = operator.window.operator_page._stages._note
    for station, product, faster in (("virtual_pair", "mems_hand", False), ("virtual_chamber", "mems_c_thermal", True)):
        operator.window.app.set_station(library.find("stations", station))
        operator.window.app.set_product(library.find("products", product))
        assert ("virtual bench" in note.text()) is faster, station


@pytest.mark.long
def test_ready_is_not_shown_while_station_and_product_are_incompatible(operator: Operator) -> None:
    pages = ("operator_page", "engineer_page", "history_page")

    def badges() -> list[bool]:
        found = []
        for name in pages:
            operator.window.show_page(name)
            lines = operator.says().splitlines()
            assert ("READY" in lines) != ("NOT READY" in lines)
            found.append("READY" in lines)
        operator.window.show_page("operator_page")
        return found

    operator.window.app.set_station(library.find("stations", "virtual_hand"))
    assert "cannot run" in operator.says()
    assert badges() == [False, False, False]
    assert "press START" not in operator.message
    operator.press("product_choice_mems_hand")
    assert badges() == [True, True, True]


@pytest.mark.parametrize(
    ("commanded", "by_hand"),
    [(False, False), (True, False), (False, True), (True, True)],
    ids=["connecting", "table", "connecting-manual", "manual"],
)
def test_stop_message_states_only_what_was_done(simulated_run: Operator, *, commanded: bool, by_hand: bool) -> None:
    run = simulated_run.run
    assert run.run_summary is not None
    run.run_summary = replace(run.run_summary, by_hand=by_hand)
    if commanded:
        simulated_run.window.app.engine_link.event.emit(StateChanged("preparing", "idle"))
    simulated_run.press("stop_button")
    assert ("axes" in simulated_run.message) == (commanded and not by_hand)
    assert ("has not been commanded" in simulated_run.message) == (not commanded and not by_hand)
    end_run(simulated_run, "stopped")
    assert ("axes are off" in simulated_run.says()) == (commanded and not by_hand)
    assert ("was not commanded" in simulated_run.says()) == (not commanded and not by_hand)


def scan_after_click(operator: Operator, name: str, text: str, *, extend: bool = False) -> QLineEdit:
    """Click into a field and scan, after the last character if `extend` is True."""
    edit = operator.widget(name, QLineEdit)
    operator.qtbot.mouseClick(edit, Qt.MouseButton.LeftButton)
    if extend:
        operator.qtbot.keyClick(edit, Qt.Key.Key_End)
    operator.qtbot.keyClicks(edit, text)
    operator.qtbot.keyClick(edit, Qt.Key.Key_Return)
    assert isinstance(edit, QLineEdit)
    return edit


@pytest.mark.parametrize("accepted", [True, False])
def test_accepted_suggestion_stays_when_the_product_is_saved(
    operator: Operator, monkeypatch: pytest.MonkeyPatch, accepted: bool
) -> None:
    edit, passed = operator.widget("serial_edit", QLineEdit), {"SN-000001"}
    monkeypatch.setattr(History, "passed_units", lambda _: passed)
    operator.window.app.product_changed.emit()
    assert edit.text() == "SN-000002"
    if accepted:
        operator.qtbot.keyClick(edit, Qt.Key.Key_Return)
    passed.clear()
    operator.window.app.product_changed.emit()
    assert edit.text() == ("SN-000002" if accepted else "SN-000001")


@pytest.mark.parametrize("pattern", [r"SN-\d{6}", ".*"])
def test_scan_replaces_the_number_and_two_numbers_in_one_are_refused(operator: Operator, pattern: str) -> None:
    operator.site_folder.write({"serial_pattern": pattern})
    operator.window.app.product_changed.emit()
    edit = operator.widget("serial_edit", QLineEdit)
    assert edit.text() == "SN-000001"
    operator.qtbot.mouseClick(edit, Qt.MouseButton.LeftButton)  # the field has the focus already
    assert scan_after_click(operator, "serial_edit", "SN-000020").text() == "SN-000020"
    assert "accepted" in operator.says()
    scan_after_click(operator, "serial_edit", "SN-000021", extend=True)
    assert "“SN-000020SN-000021” is two serial numbers in one" in operator.says()
    operator.window.app.set_language("zh_CN")
    assert "“SN-000020SN-000021”是连在一起的两个序列号" in operator.says()
    operator.window.app.set_language("en")
    assert not operator.widget("start_button", QPushButton).isEnabled()
    scan_into_focus(operator, "SN-000021")
    assert edit.text() == "SN-000021"
    assert operator.window.focusWidget() is operator.widget("start_button")


@pytest.mark.parametrize(
    ("pattern", "text"),
    [
        (r"SN-\d{6}", "SN-000900SN-000900"),
        (".*", "SN-000900SN-000900"),
        (r"SN-\d{6}", "SN-000900SN-000901"),
        (r"SN-\d{6}", "SN-000900 SN-000901"),
    ],
)
def test_two_numbers_in_one_scan_are_recognised(operator: Operator, pattern: str, text: str) -> None:
    operator.site_folder.write({"serial_pattern": pattern})
    operator.window.app.product_changed.emit()
    operator.scan(text)
    for language, words in (("en", "” is two serial numbers in one"), ("zh_CN", "”是连在一起的两个序列号")):
        operator.window.app.set_language(language)
        assert f"“{text}{words}" in operator.says()
    assert not operator.widget("start_button", QPushButton).isEnabled()
    operator.scan("SN-000900")
    assert operator.widget("start_button", QPushButton).isEnabled()


@pytest.mark.long
@pytest.mark.parametrize("pattern", [r"SN-\d{6}", ".*"])
@pytest.mark.parametrize("slot", ["", "A1_", "x_20261123T_-.y_"])  # the last is as long as a name may be
def test_scan_of_a_label_enters_its_serial_number(operator: Operator, pattern: str, slot: str) -> None:
    operator.site_folder.write({"serial_pattern": pattern})
    operator.window.app.product_changed.emit()
    code = f"SN-000020 SN-000020_{slot}20261123T063000123456"
    assert scan_after_click(operator, "serial_edit", code).text() == "SN-000020"
    assert "accepted" in operator.says()
    operator.window.show_page("engineer_page")
    assert scan_after_click(operator, "engineer_serial_edit", code).text() == "SN-000020"


@pytest.mark.parametrize("serial", ["SN_20/A", "SN 20", "SN-0123456789-0123456789-0123456789"])
def test_label_of_a_number_with_characters_that_no_file_name_has_is_recognised(operator: Operator, serial: str) -> None:
    """The certificate number is the name of the log."""
    operator.site_folder.write({"serial_pattern": ".*"})
    operator.window.app.product_changed.emit()
    code = f"{serial} {for_file_name(serial)}_Turntable-upr-01_20261123T063000123456"
    assert scan_after_click(operator, "serial_edit", code).text() == serial


@pytest.mark.long
def test_two_numbers_in_one_are_refused_on_the_engineer_page(operator: Operator) -> None:
    operator.window.show_page("engineer_page")
    scan_after_click(operator, "engineer_serial_edit", "SN-000020")
    start = operator.widget("engineer_start_button", QPushButton)
    assert scan_after_click(operator, "engineer_serial_edit", "SN-000021").text() == "SN-000021"
    operator.widget("engineer_serial_edit", QLineEdit).setText("SN-000020")
    scan_after_click(operator, "engineer_serial_edit", "SN-000021", extend=True)
    assert not start.isEnabled()
    assert "two serial numbers in one" in start.toolTip()


def progress(operator: Operator, fraction: float, remaining: float, sigma: float) -> None:
    """Report the progress of the current stage, with a sigma of the gyro bias as a multiple of its target."""
    run = operator.run
    assert run.run_summary is not None
    targets = {"gyro_bias": sigma * run.run_summary.targets["gyro_bias"]}
    operator.window.app.engine_link.event.emit(StageProgress("rate", fraction, remaining, targets))


def test_pause_does_not_count_as_slowness(simulated_run: Operator, monkeypatch: pytest.MonkeyPatch) -> None:
    now = [1000.0]
    monkeypatch.setattr("calstation.gui.state.run_status.time", SimpleNamespace(monotonic=lambda: now[0]))
    event = simulated_run.window.app.engine_link.event
    event.emit(StateChanged("running", "preparing"))
    event.emit(StageStarted("rate", 1, 4, 100.0))
    now[0] += 5.0
    progress(simulated_run, 0.5, 50.0, 3.0)
    before = simulated_run.run.remaining
    assert before is not None
    event.emit(StateChanged("pausing", "running"))
    now[0] += 2.0
    event.emit(StateChanged("paused", "pausing"))
    now[0] += 600.0
    assert simulated_run.run.remaining == pytest.approx(before)
    event.emit(StateChanged("running", "paused"))
    now[0] += 1.0
    progress(simulated_run, 0.6, 40.0, 3.0)
    assert simulated_run.run.remaining == pytest.approx(before - 1.0)


def test_reserve_moves_extend_the_time_left_and_the_convergence_plot(simulated_run: Operator) -> None:
    live = simulated_run.window.operator_page._live._convergence
    event = simulated_run.window.app.engine_link.event
    event.emit(StateChanged("running", "preparing"))
    event.emit(StageStarted("rate", 1, 4, 100.0))
    progress(simulated_run, 1.0, 0.0, 1.3)
    assert not live.lines["gyro_bias"].reached
    progress(simulated_run, 0.5, 100.0, 1.3)  # the targets are not reached, and the reserve takes 100 s
    stage = simulated_run.run.stages[0]
    assert (stage.duration, stage.fraction, stage.remaining) == (200.0, 0.5, 100.0)
    progress(simulated_run, 0.75, 50.0, 0.9)
    live.draw()
    line = live.lines["gyro_bias"]
    assert line.reached
    minutes, decades = line.curve.getData()
    assert minutes[-1] == pytest.approx(150.0 / 60.0), "the line ends at the current time"
    assert decades[-1] < 0.0, "below the target"
    assert all(decade > 0.0 for minute, decade in zip(minutes, decades, strict=True) if minute < 2.5)


@pytest.mark.parametrize(
    ("code", "during", "after"),
    [
        (
            "en",
            "A calibration is in progress; press STOP first.",
            "The devices of the last run are being closed; wait a moment.",
        ),
        ("zh_CN", "正在标定；请先按“停止”。", "正在关闭上次标定的设备，请稍候。"),
    ],
)
def test_run_with_a_verdict_is_not_said_to_be_in_progress_while_its_devices_are_closed(
    simulated_run: Operator, code: str, during: str, after: str
) -> None:
    simulated_run.window.app.set_language(code)
    run, link = simulated_run.run, simulated_run.window.app.engine_link
    link.event.emit(StateChanged("running", "preparing"))
    assert say(run.why_busy) == during
    link.event.emit(StateChanged("stopped", "running"))
    link.event.emit(Finalized(Verdict.STOPPED, "log.h5", "result.json", ENDED))
    assert say(run.why_busy) == after


@pytest.mark.parametrize("reason", ["operator", "targets", "failing"])
def test_convergence_plot_continues_at_the_time_at_which_a_stage_ended_early(
    simulated_run: Operator, reason: str
) -> None:
    live = simulated_run.window.operator_page._live._convergence
    event = simulated_run.window.app.engine_link.event
    event.emit(StateChanged("running", "preparing"))
    event.emit(StageStarted("rate", 1, 4, 600.0, repeated=True))
    progress(simulated_run, 0.2, 480.0, 3.0)
    event.emit(StageEnded("rate", reason, 1))
    assert simulated_run.run.elapsed == pytest.approx(120.0)
    sigma = {"gyro_bias_x": {"value": 0.0, "sigma": 2.0 * live.lines["gyro_bias"].target}}
    event.emit(StageSolved("rate", sigma, {"passed": True}))
    assert live.lines["gyro_bias"].times == pytest.approx([120.0, 120.0])


@pytest.mark.long
def test_rounds_of_an_open_ended_stage_follow_each_other_in_the_convergence_plot(simulated_run: Operator) -> None:
    live = simulated_run.window.operator_page._live._convergence
    event = simulated_run.window.app.engine_link.event
    event.emit(StateChanged("running", "preparing"))
    event.emit(StageStarted("rate", 1, 4, 100.0, repeated=True))
    for fraction, remaining, sigma in ((0.9, 10.0, 3.0), (0.0, 100.0, 2.0), (0.8, 20.0, 1.5)):
        progress(simulated_run, fraction, remaining, sigma)
    assert live.lines["gyro_bias"].times == pytest.approx([90.0, 90.0, 170.0])


@pytest.mark.parametrize(
    ("language", "tip", "note"),
    [
        ("en", "Scan the serial number of the unit.", "Serial number: missing"),
        ("zh_CN", "请扫描产品的序列号。", "缺少"),
    ],
)
def test_start_asks_for_a_missing_serial_number(operator: Operator, language: str, tip: str, note: str) -> None:
    operator.site_folder.write({"serial_pattern": ".*"})
    operator.window.app.product_changed.emit()
    operator.window.app.set_language(language)
    edit, start = operator.widget("serial_edit", QLineEdit), operator.widget("start_button", QPushButton)
    assert start.isEnabled()
    edit.selectAll()
    operator.qtbot.keyClick(edit, Qt.Key.Key_Delete)
    assert (start.isEnabled(), start.toolTip()) == (False, tip)
    operator.qtbot.keyClick(edit, Qt.Key.Key_Return)
    assert note in operator.says()
    assert not start.isEnabled()
    operator.scan("SN-000020")
    assert operator.window.focusWidget() is start


@pytest.mark.parametrize(
    ("language", "words"),
    [("en", "Read the fault below and press Understood first."), ("zh_CN", "请先看下面的故障，再按“知道了”。")],
)
def test_scan_while_a_fault_is_open_points_to_the_fault_below(
    simulated_run: Operator, language: str, words: str
) -> None:
    simulated_run.window.app.set_language(language)
    simulated_run.window.app.engine_link.event.emit(Fault.of(DeviceFaultError("motion.switched_off")))
    simulated_run.window.app.engine_link.running_changed.emit(False)
    simulated_run.until(simulated_run.widget("acknowledge_button").isVisible)
    assert simulated_run.widget("start_button").toolTip() == words
    simulated_run.scan("SN-000050")
    assert words in simulated_run.says()


def test_stop_after_the_verdict_keeps_the_next_action(simulated_run: Operator) -> None:
    end_run(simulated_run, "passed", advice=None)
    simulated_run.until(lambda: simulated_run.message.startswith("Remove the unit"))
    simulated_run.qtbot.keyClick(simulated_run.window, Qt.Key.Key_Escape)
    assert simulated_run.message == "Nothing is running. Remove the unit, scan the next."
    simulated_run.window.app.set_language("zh_CN")
    simulated_run.qtbot.keyClick(simulated_run.window, Qt.Key.Key_Escape)
    assert simulated_run.message == "没有在标定。取下产品，扫描下一台。"


@pytest.mark.parametrize(
    ("language", "reason"), [("en", "STOP works at once"), ("zh_CN", "“停止”立即有效")], ids=["en", "zh"]
)
def test_a_pause_that_has_not_begun_yet_is_shown(simulated_run: Operator, language: str, reason: str) -> None:
    link, pause = simulated_run.window.app.engine_link, simulated_run.widget("pause_button")
    simulated_run.window.app.set_language(language)
    link.event.emit(StateChanged("running", "preparing"))
    link.event.emit(Message("registers_transfer"))
    simulated_run.until(pause.isEnabled)
    simulated_run.press("pause_button")
    assert not pause.isEnabled()
    assert reason in pause.toolTip()
    assert reason in simulated_run.message
    link.event.emit(StateChanged("pausing", "running"))
    link.event.emit(StateChanged("paused", "pausing"))
    simulated_run.until(pause.isEnabled)
    assert reason not in simulated_run.message
    simulated_run.press("pause_button")
    link.event.emit(StateChanged("running", "paused"))
    simulated_run.until(pause.isEnabled)


@pytest.mark.parametrize("language", ["en", "zh_CN"])
@pytest.mark.parametrize("registers", ["registers_written", "registers_kept"])
def test_closing_while_unloading_does_not_say_that_anything_is_lost(
    operator: Operator, monkeypatch: pytest.MonkeyPatch, registers: str, language: str
) -> None:
    monkeypatch.setattr(EngineLink, "running", True)
    link, closing = operator.window.app.engine_link, operator.window.operator_page.closing
    operator.window.app.set_language(language)
    link.request = RunRequest(SERIAL, operator.site_folder.station, operator.site_folder.product)
    link.running_changed.emit(True)
    link.event.emit(StateChanged("running", "preparing"))
    link.event.emit(Message(registers))
    link.event.emit(Message("finishing"))
    link.event.emit(StepStarted("", 9, "move", ("load",)))
    operator.window.close()
    titles = {"en": "The table is moving to its load position", "zh_CN": "转台正在转到装卸位置"}
    assert closing.title_label.text() == titles[language]
    assert {"en": "stays valid", "zh_CN": "仍然有效"}[language] in closing.text_label.text()


@pytest.mark.parametrize(("language", "note"), [("en", "The verdict on SN-000042 is valid"), ("zh_CN", "判定有效")])
def test_a_stop_while_unloading_shows_the_verdict_with_a_note(
    simulated_run: Operator, language: str, note: str
) -> None:
    link = simulated_run.window.app.engine_link
    simulated_run.window.app.set_language(language)
    for state, before in (("running", "preparing"), ("stopping", "running"), ("stopped", "stopping")):
        link.event.emit(StateChanged(state, before))
    link.event.emit(Message("unloading_stopped", {"serial": "SN-000042"}))
    end_run(simulated_run, "passed", passed=True)
    assert simulated_run.run.state == Verdict.PASSED
    assert note in simulated_run.window.operator_page._verdict._notes.text()


@pytest.mark.parametrize(
    ("language", "advised", "asked"),
    [
        ("en", "The new registers are not verified: calibrate", f"The new registers of {SERIAL} are written, but not"),
        ("zh_CN", "新寄存器尚未验证：请选择", f"{SERIAL} 的新寄存器已写入，但尚未验证"),
    ],
)
def test_a_stop_before_the_verification_asks_about_the_registers(
    simulated_run: Operator, language: str, advised: str, asked: str
) -> None:
    link, page = simulated_run.window.app.engine_link, simulated_run.window.operator_page
    write_open_transfer(simulated_run.window.app.runs_folder, SERIAL, *WRITTEN)
    simulated_run.window.app.set_language(language)
    link.event.emit(StateChanged("running", "preparing"))
    link.event.emit(Message("verifying"))
    link.event.emit(StateChanged("stopping", "running"))
    link.event.emit(Message("transfer_unproved"))
    link.event.emit(StateChanged("stopped", "stopping"))
    end_run(simulated_run, "stopped", advice="repeat")
    assert page._verdict.action_label.text().startswith(advised)
    assert asked in simulated_run.says()
    assert simulated_run.widget("restore_choice").isVisible()
    assert simulated_run.widget("serial_edit", QLineEdit).text() == SERIAL
    assert not simulated_run.widget("start_button").isEnabled()
    simulated_run.press("cancel_choice")
    assert simulated_run.widget("start_button").isEnabled()


@pytest.mark.parametrize(
    ("language", "asked"),
    [("en", f"Writing the registers of {SERIAL} was interrupted"), ("zh_CN", f"向 {SERIAL} 写寄存器时中断")],
)
def test_a_fault_while_registers_are_written_asks_about_them(
    simulated_run: Operator, monkeypatch: pytest.MonkeyPatch, language: str, asked: str
) -> None:
    """The run is not offered to be resumed, which its changed registers would prevent."""
    requests: list[RunRequest] = []
    monkeypatch.setattr(EngineLink, "start", lambda _, order: requests.append(order))
    link, app = simulated_run.window.app.engine_link, simulated_run.window.app
    app.set_language(language)
    log = write_dead_log(app.runs_folder, SERIAL, solved=2, station="test bench", seed=5)
    write_open_transfer(app.runs_folder, SERIAL)
    finish_incomplete(app.runs_folder)
    History(app.runs_folder).refresh()  # a job in the background may have done it before the answer
    link.request = replace(link.request, resume=log)
    link.event.emit(StateChanged("running", "preparing"))
    link.event.emit(Message("registers_transfer"))
    cause = Text("imu.reads_back_differently", {"name": "gyro_bias_x", "found": 0.0, "wanted": 1.0, "address": 4})
    link.event.emit(Fault.of(DeviceFaultError("imu.holds_new", serial=SERIAL, cause=cause)))
    end_run(simulated_run, "fault", advice="repeat")
    simulated_run.press("acknowledge_button")
    simulated_run.until_no_job()
    assert asked in simulated_run.says()
    assert simulated_run.window.focusWidget() is simulated_run.widget("cancel_choice")
    assert not simulated_run.widget("start_button").isEnabled()
    simulated_run.press("finish_choice")
    (request,) = requests
    assert (request.serial, request.unfinished, request.resume) == (SERIAL, "finish", None)


@pytest.mark.parametrize(
    ("language", "reminder"), [("en", f"Registers not verified: {SERIAL}"), ("zh_CN", f"寄存器尚未验证：{SERIAL}")]
)
def test_scan_of_another_unit_reminds_of_the_one_left_with_unverified_registers(
    simulated_run: Operator, language: str, reminder: str
) -> None:
    link, app = simulated_run.window.app.engine_link, simulated_run.window.app
    app.set_language(language)
    write_open_transfer(app.runs_folder, SERIAL, *WRITTEN)
    link.event.emit(StateChanged("running", "preparing"))
    link.event.emit(Fault.of(DeviceFaultError("imu.answer_not_framed", port="socket://10.0.0.7:4001", seconds=5.0)))
    end_run(simulated_run, "fault", advice="repeat")
    simulated_run.press("acknowledge_button")
    simulated_run.until(lambda: simulated_run.window.findChild(QPushButton, "restore_choice") is not None)
    simulated_run.scan("SN-000043")
    assert reminder in simulated_run.says()
    simulated_run.scan(SERIAL)
    assert reminder not in simulated_run.says()
    assert simulated_run.widget("restore_choice").isVisible()


@pytest.mark.parametrize("interrupted", [False, True])
@pytest.mark.parametrize(
    ("language", "reminder"), [("en", f"Registers not verified: {SERIAL}"), ("zh_CN", f"寄存器尚未验证：{SERIAL}")]
)
def test_units_with_unverified_registers_are_named_at_the_start(
    operator: Operator, language: str, reminder: str, interrupted: bool
) -> None:
    runs = operator.window.app.runs_folder
    runs.mkdir(exist_ok=True)
    write_open_transfer(runs, SERIAL, *WRITTEN)
    if interrupted:
        write_dead_log(runs, "SN-000004", station="test bench", seed=5)
    operator.window.app.set_language(language)
    operator.window.operator_page._starting.interrupted.recover()
    if interrupted:
        operator.until(lambda: operator.window.findChild(QPushButton, "later_choice") is not None)
        operator.until_no_job()
        operator.press("later_choice")
    operator.until(lambda: reminder in operator.says())


WARNING = {"en": "The table may still move", "zh_CN": "转台可能仍在动"}


def stop_incompletely(operator: Operator) -> None:
    """Stop a run whose table does not respond to the safe stop."""
    link = operator.window.app.engine_link
    link.event.emit(StateChanged("running", "preparing"))
    link.event.emit(StateChanged("stopping", "running"))
    failure = {"text": Text.of("os.other", words="no answer"), "table": True}
    link.event.emit(Message("safe_stop_incomplete", failure))
    link.event.emit(StateChanged("stopped", "stopping"))
    end_run(operator, "stopped")


@pytest.mark.long
@pytest.mark.parametrize("language", ["en", "zh_CN"])
def test_a_table_that_may_still_move_is_named_on_every_page_until_it_is_reset(
    simulated_run: Operator, language: str
) -> None:
    window, run = simulated_run.window, simulated_run.run
    window.app.set_language(language)
    stop_incompletely(simulated_run)
    run.acknowledge()
    simulated_run.until_no_job()
    simulated_run.scan("SN-000043")
    for page in ("operator_page", "engineer_page", "history_page", "station_page"):
        window.show_page(page)
        lines = simulated_run.says().splitlines()
        assert WARNING[language] in lines, page
        assert simulated_run.widget(f"{page}_table_reset_button").isVisible()
        assert not {"READY", "可以开始"} & set(lines), page
    window.show_page("operator_page")
    page = window.operator_page
    assert page._views.currentWidget() is page._hindrance, "no unit is mounted now"
    assert not simulated_run.widget("start_button").isEnabled()
    assert not page.notice.asking, "nothing is offered before"
    assert WARNING[language] in simulated_run.message

    reset = window.findChild(TableNotice).reset
    reset._finish(TableReset("still_moving", None, None))
    assert run.stop_incomplete
    reset._finish(TableReset("nothing", None, None))
    assert not run.stop_incomplete
    simulated_run.until(simulated_run.widget("start_button").isEnabled)
    assert WARNING[language] not in simulated_run.says()


def test_a_table_that_may_still_move_is_still_named_after_a_restart_of_the_window(
    simulated_run: Operator, job_queue: JobQueue
) -> None:
    station = simulated_run.site_folder.station
    stop_incompletely(simulated_run)
    again = AppContext(station)
    assert again.run.stop_incomplete
    again.set_station(None)
    assert not again.run.stop_incomplete, "the table of the other station is not concerned"
    again.set_station(station)
    assert again.run.why_not_start == "operator.table_unconfirmed"
    again.run.set_stop_incomplete(False)
    assert not AppContext(station).run.stop_incomplete


@pytest.mark.long
@pytest.mark.parametrize(
    ("language", "words", "unready"),
    [("en", "Close the cover, then press “Reset the fault”.", "NOT READY"), ("zh_CN", "请关好防护罩，", "未就绪")],
)
def test_fault_that_the_table_has_latched_is_kept_until_it_is_reset(
    simulated_run: Operator, language: str, words: str, unready: str
) -> None:
    window, run = simulated_run.window, simulated_run.run
    window.app.set_language(language)
    for _ in range(2):
        window.app.engine_link.event.emit(Fault.of(DeviceFaultError("table.latched_interlock", fault="interlock")))
        window.app.engine_link.running_changed.emit(False)
        simulated_run.press("acknowledge_button")
        for page in ("history_page", "operator_page"):
            window.show_page(page)
            assert words in simulated_run.says()
            assert simulated_run.widget(f"{page}_table_reset_button").isVisible()
        simulated_run.scan("SN-000043")
        assert simulated_run.message.startswith(words)
        assert unready in simulated_run.says().splitlines()
        window.findChild(TableNotice).reset._finish(TableReset("interlock_open", "interlock", "interlock"))
        assert run.unreset is not None
    window.findChild(TableNotice).reset._finish(TableReset("cleared", "interlock", None))
    assert words not in simulated_run.says()
    assert simulated_run.widget("start_button").isEnabled()
    assert unready not in simulated_run.says().splitlines()


def test_window_stays_open_after_a_stop_that_the_table_did_not_confirm(
    simulated_run: Operator, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(EngineLink, "running", True)
    simulated_run.window.stop_and_close()
    monkeypatch.setattr(EngineLink, "running", False)
    stop_incompletely(simulated_run)
    assert simulated_run.window.isVisible()


AT_REST = "The table is at rest and its axes are off."
JAMMED = Fault("x", "", 3, "motion.not_reached", {"outer_deg": 90.0, "inner_deg": 0.0})


@pytest.mark.parametrize("chamber", [False, True])
def test_message_after_stop_says_when_the_table_has_stopped(simulated_run: Operator, *, chamber: bool) -> None:
    link, run = simulated_run.window.app.engine_link, simulated_run.run
    for event in (StateChanged("preparing", "idle"), StateChanged("running", "preparing")):
        link.event.emit(event)
    if chamber:
        link.event.emit(ChamberChanged(1.0, -40.0, 23.0, 23.0, 100.0, {"": -38.0}, open_c=(10.0, 45.0)))
    run.stop()
    link.event.emit(TableMoved(0.0, 0.0, 0.0, 0.0, moving=False))  # before the engine stops
    link.event.emit(StateChanged("stopping", "running"))
    before = "Keep the chamber closed" if chamber else "Stopping safely"
    simulated_run.until(lambda: simulated_run.message.startswith(before))
    link.event.emit(TableMoved(0.0, 0.0, 0.0, 0.0, moving=False))
    run.changed.emit()
    assert simulated_run.message.startswith(AT_REST)
    assert ("Keep the chamber closed" in simulated_run.message) is chamber
    simulated_run.window.app.set_language("zh_CN")
    assert simulated_run.message.startswith(
        "转台静止，轴使能已断开。请勿打开温箱" if chamber else "转台静止，轴使能已断开。"
    )


@pytest.mark.parametrize(
    ("fault", "moving", "stopped"),
    [
        (JAMMED, False, True),
        (JAMMED, True, False),
        (Fault("x", "", 3, "run.engine_silent", {"then": "x"}), False, False),
    ],
)
def test_fault_says_that_the_table_has_stopped_if_this_is_known(
    simulated_run: Operator, fault: Fault, *, moving: bool, stopped: bool
) -> None:
    link = simulated_run.window.app.engine_link
    link.event.emit(StateChanged("preparing", "idle"))
    link.event.emit(TableMoved(0.0, 0.0, 0.0, 0.0, moving=moving))
    if fault is JAMMED:
        link.event.emit(StateChanged("fault", "preparing"))
    link.event.emit(fault)
    link.running_changed.emit(False)
    simulated_run.until(lambda: simulated_run.verdict == "FAULT")
    reason = simulated_run.window.operator_page._verdict.reason_label.text()
    assert (AT_REST in reason, AT_REST in simulated_run.message) == (stopped, stopped)


@pytest.mark.parametrize(
    ("language", "where", "note"), [("en", "Where:", "Values after"), ("zh_CN", "故障部位：", "数值取自")]
)
def test_fault_without_figures_has_no_note_on_them(
    simulated_run: Operator, language: str, where: str, note: str
) -> None:
    simulated_run.window.app.set_language(language)
    simulated_run.window.app.engine_link.event.emit(Fault.of(DeviceFaultError("table.latched_drive", fault="drive")))
    end_run(simulated_run, "fault", stages=["rate"])
    assert where in simulated_run.says()
    assert note not in simulated_run.says()


def test_notice_while_the_window_closes_agrees_with_a_table_at_rest(simulated_run: Operator) -> None:
    link, run = simulated_run.window.app.engine_link, simulated_run.run
    for event in (StateChanged("preparing", "idle"), StateChanged("stopping", "preparing")):
        link.event.emit(event)
    assert closing_notice(run).code == "question.closing"
    link.event.emit(TableMoved(0.0, 0.0, 0.0, 0.0, moving=False))
    assert closing_notice(run).code == "question.closing_stopped"
    simulated_run.window.app.set_language("zh_CN")
    assert rendered(closing_notice(run)).remedy == "转台已静止，正在保存数据。"


def test_pause_button_offers_to_resume_only_while_paused(simulated_run: Operator) -> None:
    link, button = simulated_run.window.app.engine_link, simulated_run.widget("pause_button", QPushButton)
    for state, text, enabled in (("running", "Pause", True), ("pausing", "Pause", False), ("paused", "Resume", True)):
        link.event.emit(StateChanged(state, "running"))
        expected = text, enabled
        simulated_run.until(lambda expected=expected: (button.text(), button.isEnabled()) == expected)


@pytest.mark.parametrize(("width", "height"), [(1280, 690), (1366, 730), (1920, 1000)])
def test_refused_scan_hides_no_preparation_step(simulated_run: Operator, width: int, height: int) -> None:
    window, link = simulated_run.window, simulated_run.window.app.engine_link
    window.resize(width, height)
    link._engine = Mock()
    link.event.emit(StateChanged("preparing", "idle"))
    simulated_run.until_state("preparing")
    window.operator_page._starting._refuse_scan()
    simulated_run.qtbot.wait(100)
    (steps,) = (each for each in window.findChildren(Preparation) if each.isVisible())
    assert steps.visibleRegion().boundingRect() == steps.rect()


@pytest.mark.parametrize(
    ("language", "kept", "closed"),
    [("en", "are kept", "The run was closed as incomplete"), ("zh_CN", "可以接着做", "标定已经结束，记为未完成")],
)
def test_run_closed_by_its_operator_is_shown_as_closed_and_not_resumed(
    simulated_run: Operator, language: str, kept: str, closed: str
) -> None:
    operator, app = simulated_run, simulated_run.window.app
    app.set_language(language)
    log = write_dead_log(app.runs_folder, SERIAL, station="test bench", batch=None)
    finish_incomplete(app.runs_folder)
    History(app.runs_folder).refresh()
    file = log.with_suffix(".json")
    app.engine_link.event.emit(Finalized(Verdict.INCOMPLETE, str(log), str(file), json.loads(file.read_text("utf-8"))))
    app.engine_link.running_changed.emit(False)
    operator.until(lambda: operator.window.findChild(QPushButton, "close_incomplete_job_choice") is not None)
    assert kept in operator.message
    operator.press("close_incomplete_job_choice")
    operator.until(lambda: closed in operator.message)
    assert kept not in operator.says()
    operator.scan(SERIAL)
    assert operator.window.findChild(QPushButton, "resume_choice") is None
    assert operator.widget("start_button").isEnabled()


@pytest.mark.parametrize(("language", "below"), [("en", "Read the fault below"), ("zh_CN", "请先看下面的故障")])
def test_no_interrupted_run_is_offered_before_the_fault_has_been_read(
    simulated_run: Operator, language: str, below: str
) -> None:
    operator, app = simulated_run, simulated_run.window.app
    app.set_language(language)
    log = write_dead_log(app.runs_folder, "SN-000004", station="test bench", seed=5)
    finish_incomplete(app.runs_folder)
    History(app.runs_folder).refresh()
    app.engine_link.event.emit(StateChanged("running", "preparing"))
    fault = DeviceFaultError("imu.answer_not_framed", port="socket://10.0.0.7:4001", seconds=5.0)
    app.engine_link.event.emit(Fault.of(fault))
    end_run(operator, "fault")
    badge = operator.window.operator_page.header.badge_field.signed_in.emit
    acts = badge, lambda: operator.scan("SN-000004"), lambda: app.resume_run.emit(log)
    for act in acts:
        act()
        operator.until_no_job()
        assert operator.window.findChild(QPushButton, "resume_choice") is None
        assert (below in operator.says()) is (act is not badge)
    operator.press("acknowledge_button")
    operator.until_no_job()
    badge()
    operator.until(lambda: operator.window.findChild(QPushButton, "resume_choice") is not None)


def test_interrupted_run_and_pending_results_are_named_when_the_fault_clears_by_itself(simulated_run: Operator) -> None:
    operator, app = simulated_run, simulated_run.window.app
    app.engine_link.event.emit(StateChanged("running", "preparing"))
    fault = DeviceFaultError("imu.answer_not_framed", port="socket://10.0.0.7:4001", seconds=5.0)
    app.engine_link.event.emit(Fault.of(fault))
    end_run(operator, "fault")
    interrupted = operator.window.operator_page._starting.interrupted
    delivery = Delivery(Path("share"), 0, 2, Text.of("handover.no_answer", seconds=5.0))
    interrupted._recovery.done.emit(StartupRecovery((), delivery))
    operator.until_no_job()
    assert "share" not in operator.says()
    operator.window.operator_page._starting.drop_fault()
    operator.until(lambda: "share" in operator.says())

    write_dead_log(app.runs_folder, "SN-000004", station="test bench", seed=5)
    finish_incomplete(app.runs_folder)
    History(app.runs_folder).refresh()
    app.engine_link.event.emit(StateChanged("running", "preparing"))
    app.engine_link.event.emit(Fault.of(fault))
    end_run(operator, "fault")
    operator.window.operator_page.header.badge_field.signed_in.emit()
    operator.until_no_job()
    assert operator.window.findChild(QPushButton, "resume_choice") is None
    operator.window.operator_page._starting.drop_fault()
    operator.until(lambda: operator.window.findChild(QPushButton, "resume_choice") is not None)


@pytest.mark.parametrize(
    ("language", "void"), [("en", "its old label is void. Remove it."), ("zh_CN", "旧标签已失效，请撕下。")]
)
@pytest.mark.parametrize(
    ("before", "template", "standard"),
    [("passed", True, False), ("failed", True, False), ("passed", False, False), ("passed", True, True)],
)
def test_old_label_of_a_unit_that_fails_after_it_passed_is_void(
    simulated_run: Operator, language: str, void: str, before: str, template: bool, standard: bool
) -> None:
    simulated_run.site_folder.write({"label": "label.typ"} if template else None)
    runs = simulated_run.window.app.runs_folder
    runs.mkdir(exist_ok=True)
    write_result(runs, f"{SERIAL}_1", 1, serial=SERIAL, outcome=before)
    simulated_run.window.app.history().refresh()
    simulated_run.window.app.set_language(language)
    product = {"name": "short", "sha256": "0" * 64}
    comparison = {"check_standard": VERDICT} if standard else {}
    end_run(simulated_run, "failed", configuration={"product": product}, **comparison)
    assert (void in simulated_run.says()) == (before == "passed" and template and not standard)
