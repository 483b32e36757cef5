"""A batch keeps the places of its slots, and labels, certificates and new runs apply to several units at once."""

import json
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from PySide6.QtCore import QPoint
from PySide6.QtGui import QDesktopServices
from PySide6.QtWidgets import QAbstractButton, QComboBox, QLabel, QLineEdit, QPushButton, QScrollBar, QWidget

from calstation.config import Confirmation, ConfirmationRequired, RunRequest, computer_user
from calstation.gui.operator.production import document_buttons
from calstation.gui.state.slots import EarlierRuns, Slots
from calstation.gui.text import say
from calstation.gui.widgets import ElidedLabel, StateIcon
from calstation.jobs import ProgressCallback
from calstation.messages import Language, Text
from calstation.records import Verdict
from calstation.reports import IssueState, PrintedLabels, ReportRequest
from calstation.results import History
from calstation.runs import finish_incomplete
from calstation.sequencer import Fault, Message, StageSolved, StateChanged
from tests.database.result_files import write_result
from tests.dead_logs import write_dead_log
from tests.gui.conftest import Operator, result_with
from tests.gui.test_units import FAILED, NO_ANSWER, begin, click, end_unit, serials, started, tile, use_slots

__all__ = ["started"]  # fixture

#: Ends of the object names of tiles.
ENDS = ("_tile", "_verdict")

PASSED: dict[str, Any] = {
    "parameters": {"gyro_bias_x": {"unit": "rad/s", "sigma": 1e-6, "value": 0.0, "stage": "rate"}}
}


def corner(operator: Operator, name: str) -> tuple[int, int]:
    """Return the column and row of a tile in the grid of its panel."""
    widget: QWidget = operator.widget(name)
    operator.until(widget.isVisible, 10.0)
    tiles = [each for each in widget.parentWidget().findChildren(QWidget) if each.objectName().endswith(ENDS)]
    columns = sorted({each.x() for each in tiles if each.isVisible()})
    rows = sorted({each.y() for each in tiles if each.isVisible()})
    return columns.index(widget.x()), rows.index(widget.y())


def end(operator: Operator, failed: tuple[str, ...]) -> None:
    """End the run of all units, of which those in some slots fail."""
    for unit in operator.run.units:
        bad = unit.slot in failed
        end_unit(operator, unit.slot, "failed" if bad else "passed", **(FAILED if bad else PASSED))
    operator.window.app.engine_link._end()
    operator.until(lambda: operator.run.ended)


@pytest.mark.long
def test_slots_keep_their_places_from_loading_to_verdict(operator: Operator) -> None:
    use_slots(operator, 6)
    before = {name: corner(operator, f"slot_{name}_tile") for name in ("1", "4", "6")}
    for name in ("2", "5"):
        operator.press(f"slot_{name}_button")
    begin(operator)
    assert {name: corner(operator, f"unit_{name}_tile") for name in before} == before
    assert operator.window.operator_page._live.findChild(QWidget, "empty_2_tile").isVisible()
    end(operator, failed=("4",))
    assert {name: corner(operator, f"unit_{name}_verdict") for name in before} == before
    operator.widget("language_combo", QComboBox).setCurrentIndex(1)
    empty = operator.window.operator_page._verdicts.findChild(QWidget, "empty_5_tile")
    assert [text.text() for text in empty.findChildren(QLabel)] == ["5", "不参加本次标定"]


@pytest.mark.parametrize("count", [3, 12])  # with sentences, and in a few words
@pytest.mark.parametrize(("language", "void"), [("en", "Remove the old label"), ("zh_CN", "撕下旧标签")])
def test_tile_of_a_unit_that_fails_after_it_passed_says_that_its_label_is_void(
    operator: Operator, count: int, language: str, void: str
) -> None:
    app, site = operator.window.app, operator.site_folder
    use_slots(operator, count)
    site.write({"label": "label.typ"}, units=count)
    app.set_language(language)
    begin(operator)
    app.runs_folder.mkdir(exist_ok=True)
    for number, outcome in (("1", "passed"), ("2", "passed"), ("3", "failed")):
        write_result(app.runs_folder, f"SN-00000{number}_1", 1, serial=f"SN-00000{number}", outcome=outcome)
    app.history().refresh()
    product = {"name": "short", "sha256": "0" * 64}
    for unit in operator.run.units:
        failed = unit.slot in ("2", "3")
        configuration = {"configuration": {"product": product}}
        end_unit(
            operator, unit.slot, "failed" if failed else "passed", **(FAILED if failed else PASSED), **configuration
        )
    app.engine_link._end()
    operator.until(lambda: operator.run.ended)
    texts = {slot: tile(operator, f"unit_{slot}_verdict").accessibleName() for slot in ("1", "2", "3")}
    assert [slot for slot, text in texts.items() if void in text] == ["2"]
    labels = tile(operator, "unit_2_verdict").findChildren(QLabel)
    assert any(void in (text.toolTip() or "") + text.text() for text in labels)


def test_tile_of_a_unit_that_will_fail_says_so_briefly(operator: Operator) -> None:
    use_slots(operator, 2)
    begin(operator)
    why = Text.of("event.inconsistent", stage="rate", value=3.2, limit=1.1)
    operator.window.app.engine_link.event.emit(Message("will_fail", {"why": why}, slot="2"))
    operator.until(lambda: "will fail" in tile(operator, "unit_2_tile").toolTip())
    assert not operator.widget("failing_notice").isVisible()  # the other unit may pass
    operator.widget("language_combo", QComboBox).setCurrentIndex(1)
    assert "将不合格" in tile(operator, "unit_2_tile").toolTip()
    assert "将不合格" not in tile(operator, "unit_1_tile").toolTip()


def test_start_shows_units_that_were_not_displayed(operator: Operator, started: list[RunRequest]) -> None:
    use_slots(operator, 3)
    begin(operator)
    end(operator, failed=())
    operator.press("start_button")
    assert started == []
    assert operator.window.focusWidget() is operator.widget("start_button")
    assert "SN-000004" in tile(operator, "slot_1_tile").accessibleName()
    assert "These units will be calibrated" in operator.says()
    operator.window.app.set_language("zh_CN")
    assert "请核对，然后按“开始”按钮开始标定" in operator.says()
    operator.press("start_button")
    assert [request.serials for request in started] == [("SN-000004", "SN-000005", "SN-000006")]


@pytest.mark.parametrize(
    ("language", "entered", "remedy"),
    [
        ("en", "SN-000123 is in slot 1", "Press START to begin."),
        ("zh_CN", "SN-000123 已填入装夹位 1", "按“开始”按钮开始标定。"),
    ],
)
def test_start_says_in_which_slot_it_has_put_a_typed_number(
    operator: Operator, started: list[RunRequest], language: str, entered: str, remedy: str
) -> None:
    use_slots(operator, 2)
    operator.window.app.set_language(language)
    edit = operator.widget("serial_edit", QLineEdit)
    edit.setFocus()
    operator.qtbot.keyClicks(edit, "SN-000123")  # without Enter
    operator.press("start_button")
    assert started == []
    assert serials(operator)[0] == "SN-000123"
    assert entered in operator.says()
    assert remedy in operator.says()
    assert operator.window.focusWidget() is operator.widget("start_button")
    operator.press("start_button")
    assert [request.serials[0] for request in started] == ["SN-000123"]


@pytest.mark.long
def test_failed_units_are_calibrated_again_in_their_slots(operator: Operator, started: list[RunRequest]) -> None:
    use_slots(operator, 4)
    begin(operator)
    end(operator, failed=("2", "4"))
    again = operator.widget("again_button", QPushButton)
    operator.widget("language_combo", QComboBox).setCurrentIndex(1)
    assert again.text() == "重做不合格的产品（2）"
    operator.widget("language_combo", QComboBox).setCurrentIndex(0)
    operator.press("again_button")
    assert started == []
    assert serials(operator) == ("", "SN-000002", "", "SN-000004")
    for language, left_out in (("zh_CN", "不参加本次标定"), ("en", "not in this run")):
        operator.window.app.set_language(language)
        for name in ("1", "3"):  # nobody has removed these units
            assert left_out in tile(operator, f"slot_{name}_tile").accessibleName()
    operator.press("start_button")
    assert [request.serials for request in started] == [("", "SN-000002", "", "SN-000004")]


@pytest.mark.parametrize(("language", "left_out"), [("en", "not in this run"), ("zh_CN", "不参加本次标定")])
def test_slots_that_are_left_out_stay_so_after_a_badge(operator: Operator, language: str, left_out: str) -> None:
    operator.site_folder.write(station={"sign_in": {"badge_pattern": r"B\d{4}"}}, units=3)
    operator.window.app.set_station(operator.site_folder.station)
    operator.window.app.set_language(language)
    operator.window.operator_page.header.badge_field.sign_in("B1234")
    operator.until_no_job()
    begin(operator)
    end(operator, failed=("2",))
    operator.press("again_button")
    assert serials(operator) == ("", "SN-000002", "")
    operator.scan("B5678")
    operator.until_no_job()
    assert operator.window.app.badge == "B5678"
    assert serials(operator) == ("", "SN-000002", "")
    assert left_out in tile(operator, "slot_3_tile").accessibleName()
    click(operator, "slot_3_tile")
    operator.scan("SN-000077")
    assert serials(operator) == ("", "SN-000002", "SN-000077")
    click(operator, "slot_1_tile")
    for _ in range(2):  # stays empty, then in use
        operator.press("slot_1_button")
    assert left_out not in tile(operator, "slot_1_tile").accessibleName()


def test_slot_from_which_a_unit_was_moved_is_no_longer_left_out() -> None:
    slots = Slots()
    slots.set_names(("1", "2"))
    slots.note_last({"1": ("SN-000001", "failed")})
    slots.leave_out_others()
    first, second = slots
    assert first.left_out
    slots.fill(second, "SN-000001", History(Path("runs")))
    assert not first.left_out


@pytest.mark.long
def test_only_units_that_are_not_set_aside_are_offered_again(operator: Operator, started: list[RunRequest]) -> None:
    use_slots(operator, 4)
    begin(operator)
    for slot, advised in (("1", "set_aside"), ("2", "repeat"), ("3", "set_aside"), ("4", "reseat")):
        end_unit(operator, slot, "failed", **{**FAILED, "advice": advised})
    operator.window.app.engine_link._end()
    operator.until(lambda: operator.run.ended)
    again = operator.widget("again_button", QPushButton)
    for language, text in (("zh_CN", "重做不合格的产品（2）"), ("en", "Calibrate the failed units again (2)")):
        operator.window.app.set_language(language)
        assert again.text() == text
    operator.press("again_button")
    assert serials(operator) == ("", "SN-000002", "", "SN-000004")


@pytest.mark.long
@pytest.mark.parametrize(
    ("language", "advice"),
    [("en", "The tiles say what to do with each unit."), ("zh_CN", "请按各方块上的提示处理每台产品。")],
)
def test_batch_without_a_unit_that_passed_says_nothing_of_such_units(
    operator: Operator, language: str, advice: str
) -> None:
    use_slots(operator, 2)
    operator.window.app.set_language(language)
    begin(operator)
    for slot in ("1", "2"):
        end_unit(operator, slot, "failed", **{**FAILED, "advice": "set_aside"})
    operator.window.app.engine_link._end()
    operator.until(lambda: operator.run.ended)
    assert operator.message.startswith(advice)
    assert not operator.widget("again_button", QPushButton).isVisible()


@pytest.mark.long
def test_slots_show_the_last_verdicts_while_the_next_units_are_scanned(operator: Operator) -> None:
    """An operator who unloads the units while scanning must know which of them failed."""
    use_slots(operator, 4)
    operator.press("slot_3_button")
    begin(operator)
    end(operator, failed=("2",))
    operator.scan("SN-000101")
    operator.scan("SN-000102")
    assert serials(operator)[:2] == ("SN-000101", "SN-000102")
    names = [tile(operator, f"slot_{number}_tile").accessibleName() for number in (1, 2, 3, 4)]
    assert "last: PASS SN-000001" in names[0]
    assert "last: FAIL SN-000002" in names[1]
    assert "last" not in names[2]
    assert "PASS" in names[3]
    first = [each.text() for each in tile(operator, "slot_1_tile").findChildren(QLabel) if each.isVisible()]
    assert "last: SN-000001" in first
    operator.window.app.set_language("zh_CN")
    assert "上一台：不合格 SN-000002" in tile(operator, "slot_2_tile").accessibleName()
    shown = [each.text() for each in tile(operator, "slot_2_tile").findChildren(QLabel) if each.isVisible()]
    last = "上次 SN-000002"
    assert last in shown
    second = tile(operator, "slot_2_tile")
    label = next(each for each in second.findChildren(ElidedLabel) if each.text() == last)
    assert label.shortened() == last
    assert label.property("kind") == "muted"
    assert label.geometry().right() > 0.8 * second.width(), "it stands in the corner"
    assert label.width() < 0.7 * second.width()
    label.setFixedWidth(100)
    assert label.shortened().endswith("0002"), "serial numbers differ at their end"
    operator.window.app.set_station(operator.site_folder.station)  # the units of another station are not meant
    assert "上一台" not in tile(operator, "slot_2_tile").accessibleName()


@pytest.mark.long
def test_paused_batch_and_next_step_after_a_fault_of_the_table(operator: Operator) -> None:
    use_slots(operator, 2)
    begin(operator)
    emit = operator.window.app.engine_link.event.emit
    icon = tile(operator, "unit_1_tile").findChild(StateIcon)
    assert icon is not None
    assert icon._kind == "active"
    emit(StateChanged("paused", "running"))
    operator.until(lambda: icon._kind == "paused")
    assert "2 units  ·  PAUSED" in operator.window.windowTitle()
    emit(StateChanged("running", "paused"))
    end_unit(operator, "1", "passed", **PASSED)
    emit(Fault("TableFaultError", "", 3, "run.engine_ended", {"exit_code": -9, "then": Text("run.then_again")}))
    operator.window.app.engine_link._end()
    operator.press("acknowledge_button")
    says = operator.widget("message_label", QLabel).text
    operator.until(lambda: says().startswith("Remove the units that passed"))  # the other has no verdict
    assert "1 passed, 1 fault" in operator.window.windowTitle()
    operator.window.app.set_language("zh_CN")
    assert says().startswith("取下合格的产品")


@pytest.mark.long
def test_unit_scanned_again_is_entered_in_its_last_slot_with_a_notice(operator: Operator) -> None:
    use_slots(operator, 3)
    begin(operator)
    end(operator, failed=("2",))
    operator.scan("SN-000002")
    assert serials(operator)[1] == "SN-000002"
    assert "SN-000002" not in (serials(operator)[0], serials(operator)[2])
    assert "SN-000002 is entered in slot 2, as in its last run" in operator.says()
    operator.window.app.set_language("zh_CN")
    assert "SN-000002 已填入装夹位 2，与上次标定相同" in operator.says()
    operator.press("slot_2_button")  # the unit has been moved
    click(operator, "slot_3_tile")
    operator.scan("SN-000002")
    assert serials(operator)[2] == "SN-000002"
    assert "与上次标定相同" not in operator.says()


def empty_tile(operator: Operator, view: QWidget, slot: str) -> set[str]:
    """Return the visible texts of the tile of a slot without a unit in the run."""
    tile = view.findChild(QWidget, f"empty_{slot}_tile")
    assert tile is not None
    return {text.text() for text in tile.findChildren(QLabel) if text.isVisible()}


def end_with_fault(operator: Operator, slot: str) -> None:
    """End a batch of which one unit has a fault and the others are stopped."""
    link = operator.window.app.engine_link
    link.event.emit(replace(NO_ANSWER, slot=slot))
    end_unit(operator, slot, "fault")
    operator.press("stop_button")
    link.event.emit(StateChanged("stopped", "stopping"))
    for unit in operator.run.units:
        if unit.slot != slot:
            end_unit(operator, unit.slot, "stopped")
    link._end()
    operator.until(lambda: operator.run.ended)


@pytest.mark.parametrize("language", ["en", "zh_CN"])
def test_interrupted_units_keep_their_slots_while_another_is_repeated(operator: Operator, language: str) -> None:
    use_slots(operator, 4)
    begin(operator)
    end_with_fault(operator, slot="2")
    again, page = operator.widget("again_button", QPushButton), operator.window.operator_page
    operator.until(lambda: page.notice.offers("same_units_choice"))
    assert not again.isEnabled(), "the question about the others is open"
    operator.window.app.set_language(language)
    assert ("Answer the question" if language == "en" else "请先回答") in again.toolTip()
    assert again.text() == ("Calibrate SN-000002 again" if language == "en" else "重做 SN-000002")
    operator.press("cancel_choice")
    operator.press("again_button")
    begin(operator)
    left_out = "not in this run" if language == "en" else "不参加本次标定"
    operator.until(lambda: empty_tile(operator, page._live, "3") == {"3", left_out, "SN-000003"})
    end(operator, failed=())
    assert empty_tile(operator, page._verdicts, "4") == {"4", left_out, "SN-000004"}
    operator.scan("SN-000004")
    operator.scan("SN-000003")
    assert serials(operator)[2:] == ("SN-000003", "SN-000004"), "each is where it was"
    last = ("last: PASS SN-000002", "last: STOPPED SN-000001")
    if language == "zh_CN":
        last = ("上一台：合格 SN-000002", "上一台：已停止 SN-000001")
    names = [tile(operator, f"slot_{number}_tile").accessibleName() for number in (2, 1)]
    assert all(text in name for text, name in zip(last, names, strict=True))


def test_slot_shows_its_unit_after_a_fault_of_the_table_until_it_stays_empty(operator: Operator) -> None:
    use_slots(operator, 3)
    operator.press("slot_3_button")
    begin(operator)
    operator.window.app.engine_link.event.emit(NO_ANSWER)
    operator.window.app.engine_link._end()
    operator.press("acknowledge_button")
    operator.scan("SN-000077")
    name = tile(operator, "slot_2_tile").accessibleName
    assert "last: FAULT SN-000002" in name()
    for _ in range(2):
        operator.press("slot_2_button")  # clears the suggestion, then skips the slot
    assert "stays empty" in name()
    assert "last" not in name()


def test_units_that_passed_leave_slots_that_stay_empty(operator: Operator) -> None:
    use_slots(operator, 2)
    begin(operator)
    end(operator, failed=("2",))
    operator.scan("SN-000101")
    slots = operator.window.operator_page._starting.slots
    assert set(slots.last_units) == {"1", "2"}
    for slot in slots:
        slots.clear(slot)
    slots.forget_unloaded()
    assert slots.last_units == {"2": ("SN-000002", "failed")}


@pytest.mark.parametrize(("language", "use"), [("en", "“Use”"), ("zh_CN", "“启用”")])
def test_scan_refused_for_a_skipped_slot_names_the_button_that_uses_it(
    operator: Operator, language: str, use: str
) -> None:
    use_slots(operator, 2)
    operator.scan("SN-000077")
    for _ in range(2):
        operator.press("slot_2_button")
    operator.window.app.set_language(language)
    operator.scan("SN-000078")
    assert use in operator.says()
    operator.press("slot_2_button")
    operator.scan("SN-000078")
    assert serials(operator) == ("SN-000077", "SN-000078")
    operator.press("slot_2_button")
    operator.press("slot_2_button")
    begin(operator)
    end(operator, failed=())
    assert not any(slot.skipped for slot in operator.window.operator_page._starting.slots), "for one batch only"


def test_unit_interrupted_before_the_window_was_opened_is_entered_in_its_slot(operator: Operator) -> None:
    use_slots(operator, 3)
    app = operator.window.app
    write_dead_log(app.runs_folder, "SN-000050", slot="3", batch="B-7", batch_units=["SN-000050"], station="test bench")
    operator.window.operator_page._starting.interrupted.recover()
    operator.until(lambda: "SN-000050 was interrupted" in operator.says())
    operator.press("later_choice")
    operator.scan("SN-000050")
    assert serials(operator)[2] == "SN-000050"
    for language, note in (("zh_CN", "上次中断"), ("en", "interrupted before")):  # to resume it is no further attempt
        app.set_language(language)
        assert note in tile(operator, "slot_3_tile").accessibleName()
    assert "SN-000050 is entered in slot 3" in operator.says()


def label_of(report: ProgressCallback, files: list[Path], station: Path | None, author: Confirmation) -> PrintedLabels:
    """Job: stand in for the labels of results."""
    assert author.by, "the trail names the person"
    return PrintedLabels([Path("labels", f"{path.stem}.pdf") for path in files])


def states_of(
    report: ProgressCallback, files: list[Path], station: Path | None, language: Language
) -> list[IssueState]:
    """Job: stand in for the settings of the certificates."""
    required = ConfirmationRequired(pin=False, badge=False, second=False)
    return [IssueState(ReportRequest(path, Path("certificates"), language), required) for path in files]


def issue(report: ProgressCallback, requests: list[ReportRequest]) -> list[Path]:
    """Job: stand in for the issue of certificates."""
    return [request.out / f"{request.source.stem}.pdf" for request in requests]


@pytest.fixture
def documents(monkeypatch: pytest.MonkeyPatch) -> None:
    """Labels and certificates without logs."""
    monkeypatch.setattr(QDesktopServices, "openUrl", lambda _: True)
    monkeypatch.setattr(document_buttons, "label_template", lambda result: Path("label.zpl"))
    for name, job in (("print_labels", label_of), ("states_of_issue", states_of), ("issue_certificates", issue)):
        monkeypatch.setattr(document_buttons, name, job)


def printer_is_off(
    report: ProgressCallback, files: list[Path], station: Path | None, author: Confirmation
) -> PrintedLabels:
    """Job: stand in for labels without a printer."""
    return PrintedLabels([], dict.fromkeys(files, Text.of("log.not_found", file=str(files[0]))))


@pytest.fixture
def no_printer(documents: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Labels that cannot be printed."""
    monkeypatch.setattr(document_buttons, "print_labels", printer_is_off)


@pytest.mark.long
@pytest.mark.usefixtures("no_printer")
def test_focus_is_on_no_other_document_after_a_label_was_not_printed(operator: Operator) -> None:
    use_slots(operator, 2)
    begin(operator)
    end(operator, failed=())
    operator.press("labels_button")
    operator.until(lambda: "The label was not printed" in operator.says())
    assert operator.window.focusWidget() is not operator.widget("certificates_button")
    serials = ", ".join(unit.serial for unit in operator.run.units)
    for language, text in (("zh_CN", f"标签未打印：{serials.replace(', ', '、')}"), ("en", f"not printed: {serials}")):
        operator.window.app.set_language(language)
        assert text in operator.says()
    operator.scan("SN-000077")
    assert "The label was not printed" in operator.says(), "a scan does not hide it"
    operator.press("print_again_button")
    operator.until(lambda: f"not printed: {serials}" in operator.says())
    operator.press("unprinted_notice_close")
    assert operator.window.focusWidget() is operator.widget("serial_edit")


def printer_is_on(
    report: ProgressCallback, files: list[Path], station: Path | None, author: Confirmation
) -> PrintedLabels:
    """Job: stand in for labels that a printer prints."""
    return PrintedLabels([])


@pytest.mark.long
@pytest.mark.usefixtures("no_printer")
def test_labels_of_all_runs_are_kept_until_they_are_printed(
    operator: Operator, monkeypatch: pytest.MonkeyPatch
) -> None:
    use_slots(operator, 2)
    passed: list[str] = []
    for slot in ("1", "2"):
        begin(operator)
        passed.append(next(unit.serial for unit in operator.run.units if unit.slot == slot))
        end(operator, failed=({"1": "2", "2": "1"}[slot],))
        operator.press("labels_button")
        operator.until(lambda: f"not printed: {', '.join(passed)}" in operator.says(), 10.0)
    first, second = passed
    operator.window.app.set_language("zh_CN")
    assert f"标签未打印：{first}、{second}" in operator.says()
    assert operator.says().count("可在“历史记录”页对应的标定中打印") == 1
    operator.window.app.set_language("en")
    assert "print it from the run on the History page" in operator.says()
    operator.press("print_again_button")
    assert f"not printed: {first}, {second}" in operator.says(), "until they have been printed"
    operator.until(operator.widget("labels_button").isEnabled)
    for button in operator.window.findChildren(document_buttons.LabelButton):
        monkeypatch.setattr(button._watch, "_submit", partial(operator.window.app.job_queue.submit, printer_is_on))
    operator.press("labels_button")
    operator.until(lambda: f"sent to the printer: {second}" in operator.says())
    assert f"not printed: {first}" in operator.says()
    operator.press("print_again_button")
    operator.until(lambda: f"sent to the printer: {first}" in operator.says())
    assert "not printed" not in operator.says()


CAUTION = Text.of("log.not_found", file="a.h5")  # stands for registers that were replaced


def label_with_caution(
    report: ProgressCallback, files: list[Path], station: Path | None, author: Confirmation
) -> PrintedLabels:
    """Job: stand in for the labels of results with a caution."""
    return replace(label_of(report, files, station, author), cautions=[CAUTION])


@pytest.mark.usefixtures("documents")
@pytest.mark.parametrize("language", ["en", "zh_CN"])
def test_label_that_no_program_opens_is_kept_after_the_next_scan(
    operator: Operator, monkeypatch: pytest.MonkeyPatch, language: str
) -> None:
    opens: list[bool] = [False, True]
    button = operator.window.operator_page._verdicts._labels
    submit = partial(operator.window.app.job_queue.submit, label_with_caution)
    monkeypatch.setattr(button._watch, "_submit", submit)
    monkeypatch.setattr(QDesktopServices, "openUrl", lambda _: opens.pop(0))
    use_slots(operator, 2)
    operator.window.app.set_language(language)
    begin(operator)
    end(operator, failed=("2",))
    operator.press("labels_button")
    file = Path("labels", "1.pdf")
    texts = ("not printed: SN-000001", f"saved as PDF: {file}. This computer has no program that opens")
    if language == "zh_CN":
        texts = ("标签未打印：SN-000001", f"已存为 PDF：{file}。本机没有可打开")
    texts = *texts, say(CAUTION)
    operator.until(lambda: all(text in operator.says() for text in texts))
    operator.scan("SN-000077")
    assert all(text in operator.says() for text in texts)
    operator.press("print_again_button")
    operator.until(lambda: not opens)
    assert texts[0] not in operator.says()


@pytest.mark.long
@pytest.mark.usefixtures("documents")
def test_labels_and_certificates_of_all_units_that_passed(operator: Operator) -> None:
    use_slots(operator, 3)
    begin(operator)
    end(operator, failed=("2",))
    operator.press("labels_button")
    operator.until(lambda: "The labels were saved as PDF files" in operator.says())
    operator.press("documents_notice_close")
    operator.press("certificates_button")
    operator.until(lambda: "Certificates issued: 2" in operator.says())
    operator.widget("language_combo", QComboBox).setCurrentIndex(1)
    assert "已签发证书：2 份" in operator.says()


def test_the_user_of_the_computer_issues_without_a_person_at_the_window(operator: Operator) -> None:
    page, required = operator.window.operator_page, ConfirmationRequired(pin=False, badge=False, second=False)
    for button in (page._verdicts._certificates, page._verdict.certificate_button):
        assert button._person(required).badge == computer_user()


def test_only_units_of_a_product_with_a_label_get_one(operator: Operator, monkeypatch: pytest.MonkeyPatch) -> None:
    """The slots of a table may have different products."""
    template = {"short": Path("label.zpl"), "plain": None}
    monkeypatch.setattr(document_buttons, "label_template", lambda result: template[str(result.product)])
    button = operator.window.operator_page._verdicts._labels
    units = [(result_with(product=name), Path(f"{name}.json")) for name in ("plain", "short")]
    button.offer_all(units)
    assert [*button._files.values()] == [Path("short.json")]
    assert not button.isHidden()
    button.offer_all(units[:1])
    assert button.isHidden()


def test_no_button_for_documents_without_a_unit_that_passed(operator: Operator) -> None:
    use_slots(operator, 2)
    begin(operator)
    end(operator, failed=("1", "2"))
    for name in ("labels_button", "certificates_button"):
        assert not operator.widget(name, QAbstractButton).isVisible()
    assert operator.run.state == Verdict.FAILED


@pytest.mark.long
def test_start_of_the_engineer_shows_units_that_were_not_displayed(
    operator: Operator, started: list[RunRequest]
) -> None:
    use_slots(operator, 3)
    operator.window.app.role.set_first_pin("246813")
    operator.window.show_page("engineer_page")
    operator.press("engineer_start_button")
    assert started == []
    assert "SN-000001" in tile(operator, "engineer_slot_1_tile").accessibleName()
    assert "These units will be calibrated" in [label.text() for label in operator.window.findChildren(QLabel)]
    operator.press("engineer_start_button")
    assert [request.serials for request in started] == [("SN-000001", "SN-000002", "SN-000003")]


@pytest.mark.parametrize(
    ("language", "advice"),
    [("en", "What SN-000002 completed is kept: resume it,"), ("zh_CN", "SN-000002 已完成的部分保留：可以接着做，")],
)
def test_stopped_batch_with_one_unit_to_resume_names_it(operator: Operator, language: str, advice: str) -> None:
    use_slots(operator, 2)
    begin(operator)
    operator.window.app.set_language(language)
    operator.window.app.engine_link.event.emit(StageSolved("rate", {}, {"passed": True}, slot="2"))
    end_unit(operator, "1", "failed", **FAILED)
    end_unit(operator, "2", "stopped", advice="resume", finished_stages=["rate"])
    operator.window.app.engine_link._end()
    operator.until(lambda: operator.run.ended)
    assert operator.message.startswith(advice)


@pytest.mark.parametrize(
    ("language", "advice", "asked"),
    [
        ("en", "What was completed is kept: resume the units together,", "SN-00000{} was interrupted"),
        ("zh_CN", "已完成的部分保留：可以一起接着做，", "SN-00000{} 在第"),
    ],
)
def test_unit_with_its_own_fault_that_can_be_resumed_is_not_to_be_repeated(
    operator: Operator, language: str, advice: str, asked: str
) -> None:
    app, resume = operator.window.app, {"advice": "resume", "finished_stages": ["rate"]}
    use_slots(operator, 2)
    app.set_language(language)
    run = {"batch": "B-7", "batch_units": ["SN-000001", "SN-000002"], "station": "test bench"}
    logs = [write_dead_log(app.runs_folder, f"SN-00000{slot}", 3 - slot, slot=str(slot), **run) for slot in (1, 2)]
    finish_incomplete(app.runs_folder)
    for log, outcome in zip(logs, ("stopped", "fault"), strict=True):
        file = log.with_suffix(".json")
        file.write_text(json.dumps({**json.loads(file.read_text("utf-8")), "outcome": outcome}), "utf-8")
    app.history().refresh()
    begin(operator)
    app.engine_link.event.emit(StageSolved("rate", {}, {"passed": True}))
    app.engine_link.event.emit(replace(NO_ANSWER, slot="2"))
    end_unit(operator, "2", "fault", **resume)
    end_unit(operator, "1", "stopped", **resume)
    app.engine_link._end()
    operator.until(lambda: asked.format(1) in operator.says())
    assert not operator.widget("again_button").isVisible()
    operator.press("later_choice")
    assert asked.format(2) in operator.says(), "it has completed less"
    operator.press("later_choice")
    assert operator.message.startswith(advice)


def test_small_screen_with_a_question_about_a_batch_does_not_scroll(operator: Operator) -> None:
    """The verdict on one unit, which may have many notes, is hidden then."""
    operator.window.resize(1280, 690)  # 1920x1080 at 150 % without the task bar
    operator.window.app.set_language("zh_CN")
    use_slots(operator, 4)
    begin(operator)
    for number in range(1, 9):
        again = {"reason": "no_data", "attempt": number}
        operator.window.app.engine_link.event.emit(Message("step_repeated", again, slot="1"))
    end_with_fault(operator, slot="2")
    page = operator.window.operator_page
    operator.until(lambda: page.notice.offers("same_units_choice"))
    click(operator, "unit_1_verdict")
    operator.press("all_units_button")
    operator.qtbot.wait(100)
    assert not any(bar.isVisible() for bar in page.findChildren(QScrollBar))


@pytest.mark.parametrize("count", [4, 8])
@pytest.mark.parametrize("language", ["en", "zh_CN"])
def test_note_on_a_unit_in_a_slot_is_not_shortened(
    operator: Operator, monkeypatch: pytest.MonkeyPatch, count: int, language: str
) -> None:
    monkeypatch.setattr(EarlierRuns, "of", lambda *_: EarlierRuns(4, passed=True))
    operator.window.resize(1280, 690)  # 1920x1080 at 150 % without the task bar
    operator.window.app.set_language(language)
    use_slots(operator, count)
    operator.window.app.slots.remove_units()
    operator.scan("SN-000042")
    note = next(each for each in operator.window.findChildren(ElidedLabel) if "5" in each.text() and each.isVisible())
    operator.until(lambda: note.shortened() == note.text(), 10.0)
    page = operator.window.operator_page
    assert not any(bar.isVisible() for bar in page.findChildren(QScrollBar))


@pytest.mark.parametrize("count", [4, 8])
def test_live_view_of_a_batch_uses_the_whole_small_screen(operator: Operator, count: int) -> None:
    operator.window.resize(1280, 690)  # 1920x1080 at 150 % without the task bar
    use_slots(operator, count)
    begin(operator)
    live = operator.window.operator_page._live
    operator.until(live.isVisible)
    operator.qtbot.wait(100)
    lowest = live._units if count == 8 else live._convergence
    assert live._convergence.isVisible() is (count == 4)
    assert lowest.mapTo(live, QPoint(0, lowest.height())).y() == live.height()
