"""Several units on one table: scans into slots, tiles during the run, and verdicts; runs consist of emitted events."""

import json
from dataclasses import replace
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
import tomli_w
from PySide6.QtCore import QCoreApplication, Qt
from PySide6.QtWidgets import QAbstractButton, QComboBox, QLabel, QLineEdit, QListWidget, QPushButton

from calstation.config import Confirmation, RunRequest, library, load_product
from calstation.errors import DeviceFaultError
from calstation.gui.operator import starting
from calstation.gui.operator.live import TablePicture
from calstation.gui.state import RunStrip, run_badge
from calstation.gui.state.engine_link import EngineLink
from calstation.gui.text import product_text
from calstation.records import Verdict
from calstation.results import History
from calstation.runs import finish_incomplete
from calstation.sequencer import (
    Fault,
    Finalized,
    Message,
    StageEnded,
    StageProgress,
    StageSolved,
    StageStarted,
    StateChanged,
    StepStarted,
    Trace,
)
from tests.check_rows import check_row
from tests.database.result_files import write_result
from tests.dead_logs import write_dead_log
from tests.gui.conftest import RESULT, Operator
from tests.open_transfers import WRITTEN, write_open_transfer
from tests.site_folder import STATION

#: A unit that does not answer.
NO_ANSWER = Fault.of(DeviceFaultError("imu.answer_not_framed", port="socket://10.0.0.7:4001", seconds=5.0))


def use_slots(operator: Operator, count: int) -> None:
    """Use the virtual bench with this number of slots."""
    operator.site_folder.write(units=count)
    operator.window.app.set_station(operator.site_folder.station)


def use_long_names(operator: Operator, count: int) -> list[str]:
    """Use the virtual bench with this number of slots, with names of 16 characters."""
    names = [f"Turntable-upr-{number:02d}" for number in range(1, count + 1)]
    operator.site_folder.write(station={"slots": [{"name": name} for name in names]}, units=count)
    operator.window.app.set_station(operator.site_folder.station)
    return names


@pytest.fixture
def hardware(operator: Operator) -> Operator:
    """An operator at a station with three slots whose serial numbers are not suggested."""
    slots = [{"name": name, "port": f"socket://127.0.0.1:{port}"} for name, port in (("A", 7), ("B", 8), ("C", 9))]
    table = {"profile": "bench", "port": "tcp://127.0.0.1:9"}
    station = operator.site_folder.station.with_name("hardware.toml")
    station.write_text(tomli_w.dumps({**STATION, "name": "line", "table": table, "slots": slots}), encoding="utf-8")
    operator.window.app.set_station(station)
    return operator


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> list[RunRequest]:
    """The requests of runs, recorded instead of starting an engine."""
    requests: list[RunRequest] = []
    monkeypatch.setattr(EngineLink, "start", lambda _, order: requests.append(order))
    return requests


def serials(operator: Operator) -> tuple[str, ...]:
    """Return the serial numbers in the slots."""
    return operator.window.operator_page._starting.slots.serials


def tile(operator: Operator, name: str) -> QAbstractButton:
    """Return a visible tile."""
    found: QAbstractButton = operator.widget(name, QAbstractButton)
    operator.until(found.isVisible, 10.0)
    return found


def click(operator: Operator, name: str) -> None:
    """Click a tile at its left end, outside its button."""
    found = tile(operator, name)
    operator.qtbot.mouseClick(found, Qt.MouseButton.LeftButton, pos=found.rect().topLeft() + found.rect().center() / 8)


def begin(operator: Operator) -> None:
    """Start a run of the units in the slots, up to its first stage."""
    app = operator.window.app
    link, slots = app.engine_link, operator.window.operator_page._starting.slots
    link.request = RunRequest(
        slots.units[0], app.station_path, app.product_path, serials=slots.serials, out=app.runs_folder
    )
    link._engine = Mock()
    link.running_changed.emit(True)
    link.event.emit(StateChanged("preparing", "idle"))
    link.event.emit(StateChanged("running", "preparing"))
    link.event.emit(StageStarted("rate", 0, 4, 10.0))
    operator.until(lambda: operator.run.stage is not None)


def end_unit(operator: Operator, slot: str, outcome: str, **result: Any) -> None:
    """Emit the verdict of a unit."""
    unit = next(unit for unit in operator.run.units if unit.slot == slot)
    facts = {"outcome": outcome, "attempt": 1, "duration_s": 60.0, "slot": slot}
    ended = {**RESULT, "unit": {"serial": unit.serial}, **facts, **result}
    operator.window.app.engine_link.event.emit(Finalized(Verdict(outcome), "log.h5", f"{slot}.json", ended, slot=slot))


FAILED: dict[str, Any] = {
    "advice": "reseat",
    "stages": ["rate"],
    "parameters": {"accel_scale_y": {"unit": "1", "sigma": 1e-6, "value": 5e-3, "stage": "rate"}},
    "checks": [check_row("within", "accel_scale_y", 5e-3, [-1e-3, 1e-3], passed=False, unit="1")],
}


def test_virtual_bench_suggests_serial_numbers_for_all_slots(operator: Operator, started: list[RunRequest]) -> None:
    use_slots(operator, 6)
    expected = tuple(f"SN-00000{number}" for number in range(1, 7))
    assert serials(operator) == expected
    assert operator.widget("slots_count_label", QLabel).text() == "6 of 6 slots with a unit"
    assert operator.widget("serial_edit", QLineEdit).text() == ""
    operator.press("start_button")
    (request,) = started
    assert (request.serial, request.serials, request.resume) == (expected[0], expected, None)
    assert request.batch

    operator.scan("SN-000077")  # replaces the first suggestion
    operator.scan("SN-000004")  # a suggestion elsewhere
    assert serials(operator) == ("SN-000077", "SN-000004", "SN-000003", "", "SN-000005", "SN-000006")
    use_slots(operator, 1)
    assert operator.widget("serial_edit", QLineEdit).text() == "SN-000001"
    assert serials(operator) == ()


def test_scans_fill_successive_slots_and_then_focus_start(hardware: Operator, started: list[RunRequest]) -> None:
    window, edit, start = hardware.window, hardware.widget("serial_edit", QLineEdit), hardware.widget("start_button")
    assert not start.isEnabled()
    assert start.toolTip() == "No slot has a unit: scan at least one serial number."
    assert "Serial number: slot A" in hardware.says()
    hardware.scan("SN-000001")
    assert (edit.text(), window.focusWidget()) == ("", edit)
    assert "Serial number: slot B" in hardware.says()
    assert hardware.widget("serial_symbol").isVisible()
    assert start.isEnabled()
    click(hardware, "slot_C_tile")
    assert window.focusWidget() is edit
    hardware.scan("SN-000002")
    assert serials(hardware) == ("SN-000001", "", "SN-000002")
    hardware.scan("SN-000003")
    assert serials(hardware) == ("SN-000001", "SN-000003", "SN-000002")
    assert window.focusWidget() is start
    assert "all slots have a unit" in hardware.says()
    assert list(window.app.claimed) == ["SN-000001", "SN-000003", "SN-000002"]
    hardware.scan("SN-000004")
    assert "There is no slot left for SN-000004" in hardware.says()
    hardware.press("slot_B_button")
    hardware.scan("SN-000004")
    assert serials(hardware) == ("SN-000001", "SN-000004", "SN-000002")
    hardware.qtbot.keyClick(start, Qt.Key.Key_Space)
    hardware.press("clear_choice")
    assert started[0].serials == ("SN-000001", "SN-000004", "SN-000002")


def test_scans_fill_the_slots_in_order_after_clearing_all(operator: Operator) -> None:
    use_slots(operator, 3)
    assert "all slots have a unit" in operator.says()
    for name in ("1", "2", "3"):
        operator.until(operator.widget(f"slot_{name}_button").isVisible)
        operator.press(f"slot_{name}_button")
        assert "all slots have a unit" not in operator.says()
    assert "Serial number: slot 1" in operator.says()
    for number in (7, 8, 9):
        operator.scan(f"SN-00000{number}")
    assert serials(operator) == ("SN-000007", "SN-000008", "SN-000009")


def test_enter_without_a_number_focuses_start_and_slots_may_stay_empty(
    hardware: Operator, started: list[RunRequest]
) -> None:
    edit, start = hardware.widget("serial_edit", QLineEdit), hardware.widget("start_button")
    hardware.qtbot.keyClick(edit, Qt.Key.Key_Return)
    assert "The serial number is missing" in hardware.says()
    hardware.press("slot_A_button")  # skips it
    hardware.scan("SN-000001")
    assert serials(hardware) == ("", "SN-000001", "")
    hardware.qtbot.keyClick(edit, Qt.Key.Key_Return)
    assert hardware.window.focusWidget() is start
    assert started == []
    hardware.press("slot_C_button")
    assert "Serial number: the other slots stay empty" in hardware.says()
    hardware.press("start_button")
    hardware.press("clear_choice")
    (request,) = started
    assert (request.serial, request.serials) == ("SN-000001", ("", "SN-000001", ""))
    hardware.press("slot_A_button")
    hardware.scan("SN-000002")
    assert serials(hardware)[0] == "SN-000002"


def test_invalid_and_repeated_serial_numbers_are_refused_in_the_field(hardware: Operator) -> None:
    hardware.scan("SN-000001")
    hardware.scan("SN-000001")
    assert "SN-000001 is already in slot A" in hardware.says()
    assert serials(hardware) == ("SN-000001", "", "")
    assert "Serial number: twice" in hardware.says()
    assert tile(hardware, "slot_B_tile").accessibleName() == "B, next scan"
    hardware.scan("TX-1")
    assert "Serial number: not valid" in hardware.says()
    assert hardware.widget("serial_edit", QLineEdit).text() == "TX-1"
    assert "The serial number 'TX-1' does not match this product" in hardware.says()
    hardware.scan("SN-000002")
    assert "Serial number: slot C" in hardware.says()
    assert serials(hardware) == ("SN-000001", "SN-000002", "")
    hardware.press("slot_A_button")
    assert serials(hardware) == ("", "SN-000002", "")
    hardware.scan("SN-000001")
    assert serials(hardware) == ("SN-000001", "SN-000002", "")


def test_editing_the_slots_removes_the_notice_of_a_refused_scan(hardware: Operator, started: list[RunRequest]) -> None:
    notice = hardware.widget("operator_notice")
    hardware.scan("SN-000001")
    hardware.scan("SN-000001")
    assert notice.isVisible()
    hardware.press("slot_A_button")
    assert not notice.isVisible()
    assert "Serial number: slot A" in hardware.says()
    hardware.scan("TX-1")
    assert notice.isVisible()
    click(hardware, "slot_C_tile")
    assert not notice.isVisible()

    hardware.scan("SN-000002")
    hardware.press("start_button")
    assert "clear_choice" in [button.objectName() for button in notice.findChildren(QPushButton)]
    hardware.press("slot_C_button")  # the question was about this unit
    assert not notice.isVisible()
    assert started == []


def test_scans_give_a_sound_and_each_unit_is_confirmed_once(
    hardware: Operator, started: list[RunRequest], monkeypatch: pytest.MonkeyPatch
) -> None:
    sounds: list[str] = []
    monkeypatch.setattr(starting, "play", sounds.append)
    hardware.window.app.settings.setValue("sounds", True)
    runs = hardware.site_folder.runs
    runs.mkdir()
    for number in (1, 2):
        write_result(runs, f"SN-00000{number}_20261101T000000", number, serial=f"SN-00000{number}")
    History(runs).refresh()
    for number in (1, 2, 3):
        hardware.scan(f"SN-00000{number}")
    hardware.scan("nothing")
    assert sounds == ["accepted", "accepted", "accepted", "refused"]
    assert "attempt 2, already passed" in tile(hardware, "slot_A_tile").accessibleName()
    assert "accepted" in tile(hardware, "slot_C_tile").accessibleName()
    edit = hardware.widget("serial_edit", QLineEdit)
    edit.selectAll()
    hardware.qtbot.keyClick(edit, Qt.Key.Key_Delete)
    hardware.press("start_button")
    assert "Units that have already passed: SN-000001, SN-000002" in hardware.says()
    hardware.press("repeat_choice")
    hardware.press("clear_choice")
    assert len(started) == 1


def test_simulated_pass_of_a_unit_is_no_attempt_on_hardware(hardware: Operator, started: list[RunRequest]) -> None:
    runs = hardware.site_folder.runs
    runs.mkdir()
    for number, simulated in ((1, True), (2, False)):
        serial = f"SN-00000{number}"
        write_result(runs, f"{serial}_20261101T000000", number, serial=serial, simulated=simulated)
    History(runs).refresh()
    for number in (1, 2, 3):
        hardware.scan(f"SN-00000{number}")
    simulated, measured = (tile(hardware, f"slot_{slot}_tile").accessibleName() for slot in "AB")
    assert "accepted" in simulated
    assert "attempt 2, already passed" in measured
    hardware.press("start_button")
    assert "Units that have already passed: SN-000002\n" in hardware.says()


@pytest.mark.long
def test_confirmations_for_several_units_are_asked_one_after_another(
    hardware: Operator, started: list[RunRequest]
) -> None:
    runs = hardware.site_folder.runs
    runs.mkdir()
    for number, outcome in (("1", "failed"), ("2", "passed")):
        write_result(
            runs, f"SN-00000{number}_20261101T000000", 1, serial=f"SN-00000{number}", outcome=outcome, product="short"
        )
    History(runs).refresh()
    hardware.site_folder.write({"attempts_allowed": 1})
    app = hardware.window.app
    app.set_station(app.station_path)  # reads the product again
    for number in (1, 2, 3):
        hardware.scan(f"SN-00000{number}")
    hardware.press("start_button")
    assert "Set aside: SN-000001\n" in hardware.says()
    hardware.press("cancel_choice")
    app.role.set_first_pin("246813")
    hardware.press("start_button")
    assert "Allow one more attempt?" in hardware.says()
    hardware.press("beyond_choice")
    assert "Units that have already passed: SN-000002\n" in hardware.says()
    assert started == []
    hardware.press("repeat_choice")
    hardware.press("clear_choice")
    (request,) = started
    assert request.beyond_attempts
    assert request.allowed_by == Confirmation("engineer", pin="site")
    assert request.serials == ("SN-000001", "SN-000002", "SN-000003")


@pytest.mark.long
def test_tiles_show_unit_and_slot_and_a_click_selects_its_plots(operator: Operator) -> None:
    use_slots(operator, 3)
    begin(operator)
    link, live = operator.window.app.engine_link, operator.window.operator_page._live
    for language, count in ((1, "3 台产品"), (0, "3 units")):
        operator.widget("language_combo", QComboBox).setCurrentIndex(language)
        assert operator.widget("serial_edit", QLineEdit).text() == count
        assert not any(note in operator.says() for note in ("all slots have a unit", "所有装夹位都有产品"))
    targets = operator.run.run_summary.targets if operator.run.run_summary else {}
    for slot, factor in (("1", 3.0), ("2", 0.5), ("3", 12.0)):
        sigma = {group: factor * target for group, target in targets.items()}
        link.event.emit(StageProgress("rate", 0.5, 5.0, sigma, slot=slot))
        link.event.emit(Trace((0.0, 1.0), (float(slot),) * 12, slot=slot))
    operator.until(lambda: "σ 12 × limit" in tile(operator, "unit_3_tile").accessibleName())
    assert "σ 3 × limit" in tile(operator, "unit_1_tile").accessibleName()
    assert operator.run.run_summary is not None
    operator.run.run_summary = replace(operator.run.run_summary, own_targets=frozenset(targets))
    for code, text in (("zh_CN", "标准差 3 × 目标"), ("en", "σ 3 × target")):
        operator.window.app.set_language(code)
        operator.until(lambda text=text: text in tile(operator, "unit_1_tile").accessibleName())
    operator.run.run_summary = replace(operator.run.run_summary, own_targets=frozenset())
    assert "reached" in tile(operator, "unit_2_tile").accessibleName()
    assert live._traces.rows[0, 1] == 1.0
    assert live._convergence.lines["gyro_bias"].ratios == [3.0]
    click(operator, "unit_2_tile")
    assert operator.run.unit.slot == "2"
    assert len(live._traces.rows) == 0
    assert live._convergence.lines["gyro_bias"].ratios == [0.5]
    link.event.emit(Trace((2.0,), (2.0,) * 6, slot="2"))
    link.event.emit(Trace((2.0,), (1.0,) * 6, slot="1"))
    assert live._traces.rows[:, 1].tolist() == [2.0]

    link.event.emit(StageEnded("rate", "plan", 1))
    for slot, passed in (("1", True), ("2", False)):
        solved = {f"{group}_x": {"value": 0.0, "sigma": 0.2 * target} for group, target in targets.items()}
        link.event.emit(StageSolved("rate", solved, {"passed": passed}, slot=slot))
    operator.until(lambda: "reached (σ 0.2 × limit)" in tile(operator, "unit_1_tile").accessibleName())
    assert live._convergence.lines["gyro_bias"].ratios == [0.5, 0.2]
    operator.until(lambda: "Rate: solving" in tile(operator, "unit_3_tile").accessibleName())
    assert "Rate: not ok" in tile(operator, "unit_2_tile").accessibleName()
    stages = operator.widget("stage_list", QListWidget)
    assert "done" in stages.item(0).data(Qt.ItemDataRole.AccessibleTextRole)


@pytest.mark.long
def test_tile_names_the_own_product_of_its_slot(operator: Operator) -> None:
    operator.site_folder.write(station={"slots": [{"name": "1"}, {"name": "2", "product": "mems_c"}]}, units=2)
    operator.window.app.set_station(operator.site_folder.station)
    name = load_product(library.find("products", "mems_c"))[1].name
    for language in ("zh_CN", "en"):
        operator.window.app.set_language(language)
        assert product_text(name) in tile(operator, "slot_2_tile").accessibleName()
        assert product_text(name) not in tile(operator, "slot_1_tile").accessibleName()
    begin(operator)
    operator.until(lambda: f"2 · {product_text(name)}" in tile(operator, "unit_2_tile").accessibleName())
    end_unit(operator, "1", "passed")
    end_unit(operator, "2", "failed")
    operator.window.app.engine_link._engine = None
    operator.window.app.engine_link.running_changed.emit(False)
    operator.until(lambda: f"2 · {product_text(name)}" in tile(operator, "unit_2_verdict").accessibleName())


@pytest.mark.long
def test_unit_with_a_fault_is_removed_and_the_others_continue(operator: Operator) -> None:
    use_slots(operator, 3)
    begin(operator)
    link = operator.window.app.engine_link
    link.event.emit(Message("unit_left", {"serial": "SN-000001", "reason": "no answer"}, slot="1"))
    link.event.emit(replace(NO_ANSWER, slot="1"))
    end_unit(operator, "1", "fault")
    operator.until(lambda: operator.message == "SN-000001 leaves the batch: no answer")
    assert operator.run.in_progress
    assert operator.run.fault is None
    assert "FAULT: The unit does not respond" in tile(operator, "unit_1_tile").accessibleName()
    link.event.emit(StageProgress("rate", 0.4, 6.0, {}, slot="2"))
    stages = operator.widget("stage_list", QListWidget)
    operator.until(lambda: "40 %" in stages.item(0).data(Qt.ItemDataRole.AccessibleTextRole))
    assert operator.run.fraction > 0.0
    link.event.emit(StateChanged("done", "running"))
    end_unit(operator, "2", "passed")
    assert operator.run.in_progress
    end_unit(operator, "3", "passed")
    link._end()
    operator.until(lambda: operator.run.state == "failed")
    assert "2 passed, 1 fault" in operator.says()


@pytest.mark.long
def test_registers_of_a_failed_unit_are_kept_while_others_are_written(operator: Operator) -> None:
    use_slots(operator, 3)
    begin(operator)
    link = operator.window.app.engine_link
    link.event.emit(StageEnded("rate", "plan", 1))
    for slot in ("1", "2", "3"):
        link.event.emit(StageSolved("rate", {}, {"passed": True}, slot=slot))
    link.event.emit(Message("registers_kept", slot="1"))
    for slot in ("2", "3"):
        link.event.emit(Message("registers_reading", slot=slot))
    link.event.emit(Message("reference"))
    link.event.emit(Message("registers_transfer", slot="2"))
    link.event.emit(Message("verifying"))
    for _ in range(9):
        link.event.emit(StepStarted("", 1, "move", ("verify",)))
    operator.until(lambda: "not passed, registers kept" in tile(operator, "unit_1_tile").accessibleName())
    assert "Transfer" in tile(operator, "unit_2_tile").accessibleName()
    stages = operator.widget("stage_list", QListWidget)
    assert "50 %" in stages.item(stages.count() - 1).data(Qt.ItemDataRole.AccessibleTextRole)
    assert operator.run.fraction < 1.0

    link.event.emit(Message("registers_written", slot="2"))
    link.event.emit(Message("registers_written", slot="3"))
    link.event.emit(StateChanged("done", "running"))
    for slot, outcome, more in (("1", "failed", FAILED), ("2", "passed", {}), ("3", "passed", {})):
        end_unit(operator, slot, outcome, **more)
    link._end()
    click(operator, "unit_1_verdict")
    assert "not written" in stages.item(stages.count() - 1).data(Qt.ItemDataRole.AccessibleTextRole)
    operator.window.show_page("history_page")
    strip = next(strip for strip in operator.window.findChildren(RunStrip) if strip.isVisible())
    assert not any("Transfer" in text.text() for text in strip.findChildren(QLabel))


def end_mixed_run(operator: Operator) -> None:
    """End a run of three units with passed, failed and fault."""
    use_slots(operator, 3)
    begin(operator)
    link = operator.window.app.engine_link
    link.event.emit(StageSolved("rate", {}, {"passed": True}, slot="2"))
    link.event.emit(replace(NO_ANSWER, slot="3"))
    for slot, outcome, more in (("3", "fault", {}), ("1", "passed", {}), ("2", "failed", FAILED)):
        end_unit(operator, slot, outcome, **more)
    link._end()
    operator.until(lambda: operator.run.ended and tile(operator, "unit_1_verdict"))


@pytest.mark.long
def test_all_verdicts_are_shown_and_a_click_opens_its_result(operator: Operator) -> None:
    end_mixed_run(operator)
    says = operator.says()
    assert "1 passed, 1 failed, 1 fault" in says
    assert not operator.widget("stage_list").isVisible()
    words = {slot: operator.widget(f"unit_{slot}_verdict_label", QLabel).text() for slot in ("1", "2", "3")}
    assert words == {"1": "PASS", "2": "FAIL", "3": "FAULT"}
    for sentence in (
        "Accel scale factor y is 5000 ppm",
        "Reseat the unit",
        "The unit does not respond",
        "ask an engineer",
    ):
        assert sentence in says
    assert operator.verdict == ""
    click(operator, "unit_2_verdict")
    assert operator.verdict == "FAIL"
    assert operator.widget("verdict_serial_label", QLabel).text() == "2 · SN-000002"
    operator.until(lambda: "outside its limit" in operator.says())
    stages = operator.widget("stage_list", QListWidget)
    operator.until(lambda: "failed" in stages.item(0).data(Qt.ItemDataRole.AccessibleTextRole))
    opened: list[object] = []
    operator.window.app.open_run.connect(opened.append)
    operator.press("details_button")
    assert [path.name for path in opened] == ["2.json"]  # type: ignore[attr-defined]
    operator.window.show_page("operator_page")
    operator.press("all_units_button")
    assert operator.window.focusWidget() is tile(operator, "unit_2_verdict")

    found = tile(operator, "unit_3_verdict")
    found.setFocus()
    operator.qtbot.keyClick(found, Qt.Key.Key_Space)
    assert operator.verdict == "FAULT"
    assert "Check mounting, power and cables, then try again." in operator.says()
    assert not operator.widget("acknowledge_button").isVisible()
    operator.qtbot.keyClick(operator.widget("all_units_button"), Qt.Key.Key_Space)
    assert operator.window.focusWidget() is tile(operator, "unit_3_verdict")
    operator.widget("language_combo", QComboBox).setCurrentIndex(1)
    operator.until(lambda: "1 台合格，1 台不合格，1 台故障" in operator.says())


@pytest.mark.long
def test_next_units_are_scanned_while_verdicts_are_shown(operator: Operator) -> None:
    end_mixed_run(operator)
    assert serials(operator) == ("SN-000004", "SN-000005", "SN-000006")
    assert "Serial number: next unit" in operator.says()
    assert "Remove the units that passed; the tiles of the others say what to do." in operator.message
    operator.window.show_page("history_page")
    strip = next(strip for strip in operator.window.findChildren(RunStrip) if strip.isVisible())
    assert "1 passed, 1 failed, 1 fault" in [label.text() for label in strip.findChildren(QLabel)]
    operator.window.show_page("operator_page")
    operator.scan("SN-000002")
    assert operator.run.state == "idle"
    assert tile(operator, "slot_1_tile").isVisible()
    assert serials(operator) == ("SN-000004", "SN-000002", "SN-000006"), "its slot in the last run"


@pytest.mark.long
def test_a_fault_of_the_table_ends_the_run_of_all_units(operator: Operator) -> None:
    use_slots(operator, 2)
    begin(operator)
    link = operator.window.app.engine_link
    link.event.emit(StateChanged("fault", "running"))
    link.event.emit(NO_ANSWER)
    for slot in ("1", "2"):
        end_unit(operator, slot, "fault")
    link._end()
    operator.until(lambda: operator.verdict == "FAULT")
    assert operator.widget("verdict_serial_label", QLabel).text() == "2 units"
    assert not operator.widget("all_units_button").isVisible()
    assert not operator.widget("start_button").isEnabled()
    operator.press("acknowledge_button")
    assert tile(operator, "slot_1_tile").isVisible()
    operator.press("same_units_choice")
    assert serials(operator) == ("SN-000001", "SN-000002")
    assert operator.widget("start_button").isEnabled()


@pytest.mark.long
def test_units_finished_before_a_table_fault_are_not_offered_again(operator: Operator) -> None:
    use_slots(operator, 4)
    begin(operator)
    link = operator.window.app.engine_link
    link.event.emit(replace(NO_ANSWER, slot="2"))
    end_unit(operator, "2", "fault")
    end_unit(operator, "1", "failed", **FAILED)
    link.event.emit(StateChanged("fault", "running"))
    link.event.emit(NO_ANSWER)
    end_unit(operator, "3", "passed")  # its result was still being written
    operator.until(lambda: operator.verdict == "FAULT")
    operator.press("acknowledge_button")  # before the last verdict
    tile(operator, "unit_1_verdict")
    words = [operator.widget(f"unit_{slot}_verdict_label", QLabel).text() for slot in ("1", "2", "3", "4")]
    assert words == ["FAIL", "FAULT", "PASS", "FAULT"]
    assert "1 passed, 1 failed, 2 fault" in operator.says()
    assert "Are they still in their slots, untouched? SN-000004" in operator.says()
    operator.press("same_units_choice")
    assert serials(operator) == ("", "", "", "SN-000004")
    assert tile(operator, "slot_4_tile").isVisible()
    assert operator.widget("start_button").isEnabled()


@pytest.mark.long
def test_interrupted_transfer_is_recovered_only_for_its_unit(operator: Operator, started: list[RunRequest]) -> None:
    use_slots(operator, 2)
    begin(operator)
    link = operator.window.app.engine_link
    write_open_transfer(operator.window.app.runs_folder, "SN-000002")
    link.event.emit(replace(NO_ANSWER, slot="2"))
    for slot, outcome in (("1", "passed"), ("2", "fault")):
        end_unit(operator, slot, outcome)
    operator.until(lambda: operator.window.findChild(QAbstractButton, "unit_1_verdict"))
    click(operator, "unit_1_verdict")
    assert "was interrupted" not in operator.says()
    operator.press("all_units_button")
    click(operator, "unit_2_verdict")
    assert link.running  # no run can start yet
    assert "was interrupted" not in operator.says()
    link._end()
    assert "Writing the registers of SN-000002 was interrupted" in operator.says()
    operator.press("all_units_button")
    assert "was interrupted" not in operator.says()
    click(operator, "unit_2_verdict")
    assert "Writing the registers of SN-000002 was interrupted" in operator.says()
    operator.press("restore_choice")
    (request,) = started
    assert (request.serial, request.serials, request.unfinished) == ("SN-000002", ("", "SN-000002"), "restore")


@pytest.mark.long
def test_table_is_drawn_with_the_axes_of_the_selected_unit(operator: Operator, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn: list[np.ndarray] = []
    monkeypatch.setattr(TablePicture, "axes", lambda _, unit, *__: drawn.append(unit))
    slots = [{"name": name, "orientation": orientation} for name, orientation in (("A", "+x+z"), ("B", "-y+z"))]
    station = operator.site_folder.station.with_name("turned.toml")
    text = tomli_w.dumps({**STATION, "slots": slots, "bench": {"units": 2}})
    station.write_text(text, encoding="utf-8")
    operator.window.app.set_station(station)
    begin(operator)
    operator.until(lambda: len(drawn) > 0)
    np.testing.assert_allclose(drawn[-1], np.eye(3), atol=1e-12)
    click(operator, "unit_B_tile")
    turned = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]  # x of the platform is -y of the unit, y of the platform its x
    operator.until(lambda: np.allclose(drawn[-1], turned))


@pytest.mark.parametrize(
    ("language", "reason"), [("en", "the table was not commanded"), ("zh_CN", "没有向转台发出指令")]
)
def test_batch_stopped_while_connecting_says_that_the_table_was_not_commanded(
    operator: Operator, language: str, reason: str
) -> None:
    use_slots(operator, 2)
    operator.window.app.set_language(language)
    app, link = operator.window.app, operator.window.app.engine_link
    link.request = RunRequest("SN-000001", app.station_path, app.product_path, serials=("SN-000001", "SN-000002"))
    link._engine = Mock()
    link.running_changed.emit(True)
    operator.press("stop_button")
    link.event.emit(StateChanged("stopped", "idle"))
    for slot in ("1", "2"):
        end_unit(operator, slot, "stopped")
    link._end()
    for slot in ("1", "2"):
        assert reason in tile(operator, f"unit_{slot}_verdict").accessibleName()


@pytest.mark.long
def test_stop_ends_all_units(operator: Operator) -> None:
    use_slots(operator, 2)
    begin(operator)
    link = operator.window.app.engine_link
    for slot in ("1", "2"):
        link.event.emit(StageProgress("rate", 0.5, 5.0, {"gyro_bias": 1.0}, slot=slot))
    operator.until(lambda: operator.run.stage is not None and operator.run.stage.fraction == 0.5)
    done = operator.run.fraction
    operator.press("stop_button")
    link.event.emit(StateChanged("stopped", "stopping"))
    end_unit(operator, "1", "stopped")
    operator.until(lambda: "STOPPED" in tile(operator, "unit_1_tile").accessibleName())
    assert "STOPPING" in tile(operator, "unit_2_tile").accessibleName()
    assert operator.message.startswith("Stopping safely")
    end_unit(operator, "2", "stopped")
    link._end()
    operator.until(lambda: "2 stopped" in operator.says())
    click(operator, "unit_2_verdict")
    operator.press("all_units_button")
    assert operator.run.state == "stopped"
    assert operator.run.fraction == done
    assert operator.message.startswith("Scan the units to begin again, or scan the next.")
    assert "Remove the units" not in operator.says()
    assert "Are they still in their slots, untouched? SN-000001, SN-000002" in operator.says()
    assert serials(operator) == ("SN-000003", "SN-000004")
    operator.press("same_units_choice")
    assert serials(operator) == ("SN-000001", "SN-000002")
    assert operator.run.state == "idle"
    assert operator.window.focusWidget() is operator.widget("start_button")
    assert "accepted" in tile(operator, "slot_1_tile").accessibleName()
    operator.until_no_job()
    assert operator.window.findChild(QPushButton, "resume_choice") is None


@pytest.mark.parametrize(
    ("language", "advised", "asked"),
    [
        ("en", "choose to verify them", "New registers are written, but not verified: SN-000001, SN-000002"),
        ("zh_CN", "请选择验证新值或恢复原值", "新寄存器已写入，但尚未验证：SN-000001、SN-000002"),
    ],
)
def test_batch_stopped_in_the_verification_is_asked_about_its_registers(
    operator: Operator, started: list[RunRequest], language: str, advised: str, asked: str
) -> None:
    """The tiles advise the choice that is offered, also after one of them was opened."""
    use_slots(operator, 2)
    operator.window.app.set_language(language)
    begin(operator)
    link = operator.window.app.engine_link
    for slot in ("1", "2"):
        write_open_transfer(operator.site_folder.runs, f"SN-00000{slot}", *WRITTEN)
        link.event.emit(Message("transfer_unproved", slot=slot))
    operator.press("stop_button")
    link.event.emit(StateChanged("stopped", "stopping"))
    for slot in ("1", "2"):
        end_unit(operator, slot, "stopped", advice="repeat")
    link._end()
    operator.until(lambda: asked in operator.says())
    assert advised in operator.message
    click(operator, "unit_1_verdict")
    operator.press("all_units_button")
    assert asked in operator.says()
    assert not operator.widget("start_button").isEnabled()
    operator.press("restore_choice")
    (request,) = started
    assert (request.serials, request.unfinished) == (("SN-000001", "SN-000002"), "restore")


@pytest.mark.parametrize(
    ("language", "mounted"),
    [("en", "Still mounted: SN-000001, SN-000003;"), ("zh_CN", "仍在转台上：SN-000001、SN-000003；")],
)
def test_units_that_stay_mounted_are_named_after_the_repetition_of_another(
    operator: Operator, language: str, mounted: str
) -> None:
    use_slots(operator, 3)
    operator.window.app.set_language(language)
    begin(operator)
    link = operator.window.app.engine_link
    end_unit(operator, "2", "failed", **FAILED)
    operator.press("stop_button")
    link.event.emit(StateChanged("stopped", "stopping"))
    for slot in ("1", "3"):
        end_unit(operator, slot, "stopped", advice="resume", stages=["rate"])
    link._end()
    operator.until(lambda: operator.window.findChild(QPushButton, "same_units_choice") is not None)
    operator.press("cancel_choice")
    operator.press("again_button")
    assert serials(operator) == ("", "SN-000002", "")
    begin(operator)
    end_unit(operator, "2", "passed")
    link._end()
    operator.until(lambda: operator.run.state == "passed")
    operator.until(lambda: mounted in operator.message)


@pytest.mark.long
def test_units_finished_before_a_stop_are_not_offered_again(operator: Operator) -> None:
    use_slots(operator, 2)
    begin(operator)
    link = operator.window.app.engine_link
    link.event.emit(replace(NO_ANSWER, slot="1"))
    end_unit(operator, "1", "fault")
    operator.press("stop_button")
    link.event.emit(StateChanged("stopped", "stopping"))
    end_unit(operator, "2", "stopped", advice="resume", stages=["rate"])
    link._end()
    operator.until(lambda: "1 fault, 1 stopped" in operator.says())
    assert run_badge(operator.run)[0] == "caution"
    again = operator.widget("again_button", QPushButton)
    assert again.text() == "Calibrate SN-000001 again"
    assert "The completed stages are kept: resume" in tile(operator, "unit_2_verdict").accessibleName()
    operator.window.app.set_language("zh_CN")
    assert again.text() == "重做 SN-000001"
    assert "可以接着做" in tile(operator, "unit_2_verdict").accessibleName()
    operator.window.app.set_language("en")
    operator.press("same_units_choice")
    assert serials(operator) == ("", "SN-000002")


@pytest.mark.long
def test_interrupted_batch_is_resumed_together_from_its_page(operator: Operator, started: list[RunRequest]) -> None:
    """Its units are named, also those that are not resumed; closing it closes the runs of all of them."""
    use_slots(operator, 3)
    app = operator.window.app
    units = ["SN-000001", "SN-000002", "SN-000003"]
    run = {"batch": "B-7", "batch_units": units, "station": "test bench", "seed": 5}
    logs = [
        write_dead_log(app.runs_folder, serial, int(slot != "2"), slot=slot, **run)
        for slot, serial in zip("123", units, strict=True)
    ]
    operator.window.operator_page._starting.interrupted.recover()
    operator.until(lambda: "2 units interrupted in stage 2" in operator.says())
    start = operator.widget("start_button", QPushButton)
    assert serials(operator) == ("", "", "")  # nobody has scanned a unit
    for language, why in (("zh_CN", "请先回答本页的问题。"), ("en", "Answer the question on this page first.")):
        app.set_language(language)
        assert not start.isEnabled()
        assert start.toolTip().startswith(why)
        assert operator.message == why
        assert "1: SN-000001" in operator.says()
    assert "1: SN-000001, 3: SN-000003. Not resumed: SN-000002 (nothing completed)." in operator.says()
    assert operator.window.focusWidget() is operator.widget("later_choice")  # not what nobody has confirmed
    app.set_language("zh_CN")
    assert "不继续：SN-000002（没有已完成的部分）" in operator.says()
    app.set_language("en")
    operator.press("resume_choice")
    (request,) = started
    assert (request.serials, request.resumes) == (("SN-000001", "", "SN-000003"), (logs[0], logs[2]))

    app.resume_run.emit(logs[2])
    operator.until(lambda: "2 units interrupted in stage 2" in operator.says())
    operator.press("later_choice")
    assert start.isEnabled()
    assert "SN-000001" not in serials(operator)
    assert all(serials(operator))
    app.resume_run.emit(logs[2])
    operator.until(lambda: "2 units interrupted in stage 2" in operator.says())
    operator.press("close_incomplete_job_choice")
    operator.until_no_job()
    closed = [json.loads(log.with_suffix(".json").read_text("utf-8")).get("closed_utc") for log in logs]
    assert [each is not None for each in closed] == [True, False, True]


def write_killed_batch(operator: Operator) -> None:
    """Write a batch that was killed: registers of unit 1 written but not verified, unit 2 failed, 3 and 4 resumable."""
    runs, units = operator.window.app.runs_folder, [f"SN-00000{slot}" for slot in "1234"]
    run = {"batch": "B-7", "batch_units": units, "station": "test bench", "seed": 5}
    logs = [write_dead_log(runs, serial, slot=serial[-1], **run) for serial in units]
    write_open_transfer(runs, units[0], *WRITTEN)
    finish_incomplete(runs)
    file = logs[1].with_suffix(".json")
    file.write_text(json.dumps({**json.loads(file.read_text("utf-8")), "outcome": "failed"}), "utf-8")
    logs[1].unlink()


@pytest.mark.parametrize(
    ("language", "others", "left"),
    [
        ("en", ("SN-000001 (registers written, not verified)", "SN-000002 (verdict FAIL)"), "Registers not verified: "),
        ("zh_CN", ("SN-000001（寄存器已写入，尚未验证）", "SN-000002（结论：不合格）"), "寄存器尚未验证："),
    ],
)
@pytest.mark.parametrize("answer", ["later", "resume"])
def test_units_that_a_power_failure_left_are_named_in_the_question_and_after_it(
    operator: Operator, started: list[RunRequest], language: str, others: tuple[str, str], left: str, answer: str
) -> None:
    use_slots(operator, 4)
    operator.window.app.set_language(language)
    write_killed_batch(operator)
    operator.window.operator_page._starting.interrupted.recover()
    operator.until(lambda: "3: SN-000003" in operator.says())
    operator.until_no_job()
    assert all(text in operator.says() for text in others)
    operator.press(f"{answer}_choice")
    if answer == "resume":
        (request,) = started
        link = operator.window.app.engine_link
        link.request, link._engine = request, Mock()
        link.running_changed.emit(True)
        link.event.emit(StateChanged("running", "preparing"))
        operator.qtbot.wait(20)
        assert left not in operator.says()
        for slot in ("3", "4"):
            end_unit(operator, slot, "passed")
        link._end()
    operator.until(lambda: f"{left}SN-000001" in operator.says())
    operator.scan("SN-000105")
    operator.qtbot.wait(20)
    assert left not in operator.says(), "it has been read"


@pytest.mark.long
def test_sixteen_units_fit_on_a_small_screen(operator: Operator) -> None:
    use_slots(operator, 16)
    for language in (0, 1):
        operator.widget("language_combo", QComboBox).setCurrentIndex(language)
        assert whole(operator, [f"slot_{number}_tile" for number in range(1, 17)])
    for language in (0, 1):
        operator.widget("language_combo", QComboBox).setCurrentIndex(language)
        operator.scan("TX-1")
        assert whole(operator, [f"slot_{number}_tile" for number in range(1, 17)])
    begin(operator)
    for language in (0, 1):
        operator.widget("language_combo", QComboBox).setCurrentIndex(language)
        assert whole(operator, [f"unit_{number}_tile" for number in range(1, 17)])
    for number in range(1, 17):
        end_unit(operator, str(number), "failed" if number % 5 == 0 else "passed", **FAILED)
    operator.window.app.engine_link._end()
    operator.until(lambda: operator.run.ended)
    for language in (0, 1):
        operator.widget("language_combo", QComboBox).setCurrentIndex(language)
        assert whole(operator, [f"unit_{number}_verdict" for number in range(1, 17)])
        words = [operator.widget(f"unit_{number}_verdict_label", QLabel) for number in (5, 6)]
        heights = {word.parentWidget().height() for word in words}
        assert len(heights) == 1  # one with a reason, one without


@pytest.mark.long
def test_sixteen_verdicts_fit_below_the_prompt_after_a_stop(operator: Operator) -> None:
    use_slots(operator, 16)
    begin(operator)
    link = operator.window.app.engine_link
    link.event.emit(replace(NO_ANSWER, slot="5"))
    for number in range(1, 17):
        end_unit(operator, str(number), "fault" if number == 5 else "stopped")
    link._end()
    operator.until(lambda: "Are they still in their slots" in operator.says())
    for language in (0, 1):
        operator.widget("language_combo", QComboBox).setCurrentIndex(language)
        assert whole(operator, [f"unit_{number}_verdict" for number in range(1, 17)])


@pytest.mark.long
@pytest.mark.parametrize(("width", "height"), [(1366, 768), (1280, 720)])
def test_long_slot_names_leave_notes_and_serial_numbers_readable(operator: Operator, width: int, height: int) -> None:
    names = use_long_names(operator, 16)
    operator.window.resize(width, height)
    for language in (0, 1):
        operator.widget("language_combo", QComboBox).setCurrentIndex(language)
        assert whole(operator, [f"slot_{name}_tile" for name in names])
        assert uncut(operator, [f"slot_{name}_tile" for name in names])
    begin(operator)
    for language in (0, 1):
        operator.widget("language_combo", QComboBox).setCurrentIndex(language)
        assert whole(operator, [f"unit_{name}_tile" for name in names])
        assert uncut(operator, [f"unit_{name}_tile" for name in names])
    assert tile(operator, f"unit_{names[1]}_tile").toolTip().startswith("Turntable-upr-02, SN-000002, ")
    for name in names:
        end_unit(operator, name, "passed")
    operator.window.app.engine_link._end()
    operator.until(lambda: operator.run.ended)
    assert whole(operator, [f"unit_{name}_verdict" for name in names])
    assert uncut(operator, [f"unit_{name}_verdict" for name in names])


def uncut(operator: Operator, names: list[str]) -> bool:
    """Return whether all texts of tiles fit into their labels."""
    labels = [each for name in names for each in tile(operator, name).findChildren(QLabel) if each.isVisible()]
    return all(each.fontMetrics().horizontalAdvance(each.text()) <= each.width() for each in labels)


def whole(operator: Operator, names: list[str]) -> bool:
    """Return whether tiles are completely visible and as high as their contents."""
    tiles = [tile(operator, name) for name in names]
    QCoreApplication.processEvents()  # lays out the present texts
    operator.until(lambda: all(each.visibleRegion().boundingRect().size() == each.size() for each in tiles), 10.0)
    return all(each.height() >= each.minimumSizeHint().height() for each in tiles)


@pytest.mark.long
def test_batch_continues_on_the_virtual_bench_after_one_unit_stops_sending(operator: Operator) -> None:
    folder = operator.site_folder
    plan = folder.folder / "plan.toml"
    fault = {"kind": "silence_imu", "stage": "six_position", "time_s": 3.0, "value": 60.0, "unit": 2}
    plan.write_text(tomli_w.dumps({"fault": [fault]}), encoding="utf-8")
    folder.write({"stages": ["six_position"]}, units=3, faults=str(plan))
    operator.window.app.set_station(folder.station)
    operator.press("start_button")
    operator.until(lambda: any(unit.fault is not None for unit in operator.run.units[1:2]))
    assert operator.run.in_progress
    operator.until(lambda: "FAULT" in tile(operator, "unit_2_tile").accessibleName())
    operator.until_ended()
    assert [unit.verdict for unit in operator.run.units] == ["passed", "fault", "passed"], operator.says()
    assert "2 passed, 1 fault" in operator.says()
    click(operator, "unit_3_verdict")
    assert operator.verdict == "PASS"
    operator.until(lambda: "2 done" in operator.widget("shift_label", QLabel).text())
    assert serials(operator) == ("SN-000004", "SN-000005", "SN-000006")
    operator.window.show_page("history_page")
    operator.until(lambda: operator.window.findChild(QPushButton, "history_batch_button"))
    operator.until(lambda: operator.widget("history_batch_button").isVisible())
