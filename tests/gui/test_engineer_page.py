"""The engineer page, operated by clicks: stages and schedules, preview, run, analysis, registers."""

import json
import math
import re
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w
from PySide6.QtCore import QEvent, QObject, QPoint, QPointF, Qt
from PySide6.QtGui import QGuiApplication, QHelpEvent
from PySide6.QtWidgets import (
    QApplication,
    QCheckBox,
    QComboBox,
    QLabel,
    QLineEdit,
    QPushButton,
    QTabBar,
    QTableView,
    QToolButton,
    QToolTip,
    QWidget,
)
from pytestqt.qtbot import QtBot

from calstation.config import (
    RegisterOperation,
    RunRequest,
    access,
    library,
    load_configuration,
    schedule_options,
    versions,
)
from calstation.devices.imu import TransferOutcome, TransferStep
from calstation.gui.engineer import EngineerPage
from calstation.gui.engineer.choice_panel import StageSelector
from calstation.gui.engineer.observability_view import HeatMap
from calstation.gui.engineer.preview import PreviewView
from calstation.gui.engineer.result_view import ResultView
from calstation.gui.engineer.schedule_form import ScheduleForm
from calstation.gui.state import AppContext, ReleaseBar, UnitStatus, run_strip
from calstation.gui.text import language, say
from calstation.gui.widgets import (
    Cell,
    CellTable,
    ComparisonTable,
    ElidedLabel,
    FormField,
    JobWatch,
    ParameterSet,
    StateBadge,
    theme,
)
from calstation.jobs import Job
from calstation.judgement import Check
from calstation.messages import Text, local_time
from calstation.records import Limit, audit_path, open_log, read_audit
from calstation.registers import journal as register_journal
from calstation.results import SCHEMA, FinishedRun, Parameter, Preview, Result, StagePreview
from calstation.runs import run_summary
from calstation.sequencer import Settled
from tests.check_rows import check_row
from tests.gui.conftest import SERIAL, Operator, SiteFolder
from tests.site_folder import PRODUCT, STATION

pytestmark = pytest.mark.long

STAGES = ("rate", "six_position", "excitation", "azimuth_flip")


class Engineer(Operator):
    """Operates the engineer page."""

    def open_page(self) -> "Engineer":
        """Show the page and type serial number and name."""
        self.window.show_page("engineer_page")
        self.type("engineer_serial_edit", SERIAL)
        self.type("engineer_name_edit", "wang")
        return self

    def unlock(self) -> "Engineer":
        """Set the first PIN of the site."""
        self.press("unlock_schedule_button")
        for name in ("pin_edit", "pin_again_edit"):
            self.qtbot.keyClicks(self.widget(name, QLineEdit), "246813")
        self.press("unlock_button")
        assert self.window.app.role.engineer
        return self

    def type(self, name: str, text: str) -> None:
        """Replace the text of a field."""
        edit = self.widget(name, QLineEdit)
        edit.selectAll()
        self.qtbot.keyClicks(edit, text) if text else self.qtbot.keyClick(edit, Qt.Key.Key_Delete)

    def tick(self, *names: str) -> None:
        """Check only these boxes of parts and stages, by object name."""
        for box in self.page.findChildren(QCheckBox):
            if box.objectName().startswith("stage_check_"):
                box.setChecked(False)
        for name in names:
            self.widget(name, QCheckBox).click()

    def show_view(self, view: int) -> None:
        """Show a view: preview, parameters, innovations, residuals, observability, registers."""
        self.widget("engineer_views", QTabBar).setCurrentIndex(view)

    def preview(self) -> None:
        """Press Preview and wait for it."""
        self.show_view(0)
        self.press("preview_button")
        self.until(lambda: not self.page.preview.watch.busy)

    def start(self, meanwhile: Callable[[], None] = lambda: None) -> dict[str, Any]:
        """Press START, wait for the end and for the result to be shown."""
        shown = self.page.analysis.result.view.finished
        self.press("engineer_start_button")
        meanwhile()
        self.until(lambda: self.page.analysis.result.view.finished is not shown or self.run.fault is not None)
        self.until_ended()
        assert self.run.fault is None, self.run.fault
        assert self.page.analysis.result.view.finished is not None
        return dict(self.page.analysis.result.view.finished.result.to_json())

    def cells(self, table: str) -> dict[str, dict[str, str]]:
        """Return the texts of a parameter table by row identifier (the tooltip) and heading."""
        model = self.widget(table, QTableView).model()
        across, down = Qt.Orientation.Horizontal, Qt.Orientation.Vertical
        headings = [model.headerData(i, across) for i in range(model.columnCount())]
        return {
            model.headerData(row, down, Qt.ItemDataRole.ToolTipRole): {
                heading: str(model.index(row, column).data()).strip() for column, heading in enumerate(headings)
            }
            for row in range(model.rowCount())
        }

    def why_not(self, name: str) -> str:
        """Return the tooltip of a disabled button."""
        button = self.widget(name, QPushButton)
        assert not button.isEnabled(), name
        return str(button.toolTip())

    def check_disabled(self) -> None:
        """Assert that a run disables its settings and that their tooltips give the reason."""
        self.until(lambda: self.run.in_progress)
        for name in ("engineer_start_button", "read_registers_button", "write_registers_button"):
            assert "in progress" in self.why_not(name)
        for name in ("stage_check_rate", "schedule_six_position_dwell_s"):
            assert not self.widget(name).isEnabled()
            assert "in progress" in self.widget(name).toolTip()

    @property
    def page(self) -> EngineerPage:
        """Return the page, for state that its widgets do not show."""
        found = self.window.findChild(EngineerPage, "engineer_page")
        assert isinstance(found, EngineerPage)
        return found


@pytest.fixture
def engineer(window: Any, qtbot: Any, site_folder: SiteFolder) -> Engineer:
    """The engineer page with the short product, in the role of an operator."""
    return Engineer(window, qtbot, site_folder).open_page()


@pytest.mark.parametrize("code", ["en", "zh_CN"])
def test_hint_in_the_name_field_is_not_cut(engineer: Engineer, code: str) -> None:
    engineer.window.app.set_language(code)
    edit = engineer.widget("engineer_name_edit", QLineEdit)
    room = edit.width() - 2 * theme.GRID
    assert edit.fontMetrics().horizontalAdvance(edit.placeholderText()) <= room


def number(text: str) -> float:
    """Return the number in a cell."""
    return float(text.replace("−", "-"))


@pytest.mark.exhaustive
def test_each_part_can_be_previewed_and_run(engineer: Engineer) -> None:
    engineer.unlock()
    for part, stages in (
        ("part_check_scale_factors", ("rate", "six_position")),
        ("part_check_installation", ("excitation",)),
        ("part_check_biases", ("azimuth_flip",)),
    ):
        engineer.tick(part)
        engineer.type("engineer_serial_edit", SERIAL)
        ticked = [s for s in STAGES if engineer.widget(f"stage_check_{s}", QCheckBox).isChecked()]
        assert tuple(ticked) == stages
        engineer.preview()
        expected_table = engineer.cells("preview_table")
        result = engineer.start()
        assert result["stages"] == list(stages)
        assert result["operator"] == "wang"
        assert (result["outcome"], result["partial"]) == ("passed", True)
        shown = engineer.cells("result_table")
        assert list(shown) == list(result["parameters"]) == list(expected_table)
        for name, row in shown.items():
            expected = {"inside": "reached", "no limit": "no limit"}.get(row["Verdict"], "missed")
            if name not in result["not_compared"]:  # known from the calibration before, which the run does not judge
                assert expected_table[name]["Expected"] == expected, name
            if stages == ("excitation",):
                last = list(expected_table[name])[2]
                assert number(expected_table[name][last]) == pytest.approx(number(row["± σ"]), rel=0.15), name


def test_parts_are_offered_only_for_a_product_with_their_stages(engineer: Engineer) -> None:
    engineer.unlock()
    biases = engineer.widget("part_check_biases", QCheckBox)
    assert biases.isVisible()
    engineer.window.app.set_product(library.find("products", "mems_c_fast"))
    assert engineer.page.choice.selector.stages == ("designed",)
    assert not biases.isVisible()  # the designed stage determines them already
    assert "or single stages" not in engineer.says()


def test_product_that_cannot_be_read_replaces_the_previous_one(engineer: Engineer, site_folder: SiteFolder) -> None:
    engineer.unlock()
    good = engineer.window.app.product_path
    broken = site_folder.folder / "broken.toml"
    broken.write_text("name = \n", encoding="utf-8")
    engineer.window.app.set_product(broken)
    problem = engineer.widget("choice_problem_label", QLabel)
    for code, said in (("en", "Product: broken"), ("zh_CN", "产品型号：broken")):
        language.use(code)
        assert engineer.widget("choice_product_label", QLabel).text() == said
        assert problem.isVisible()
        assert "broken.toml" in problem.text()
        assert problem.text() == engineer.why_not("engineer_start_button")
        for name in ("stage_check_rate", "save_product_button", "save_reason_label"):
            assert not engineer.widget(name).isVisible()
    language.use("en")
    engineer.window.app.set_product(good)
    assert not problem.isVisible()
    engineer.until(lambda: engineer.widget("stage_check_rate").isVisible())  # its predecessor is deleted first
    assert engineer.widget("save_reason_label", QLabel).text() == "The values of this stage are those of the product."


def test_a_part_whose_stages_are_both_ticked_again_is_redrawn(qtbot: QtBot) -> None:
    selector = StageSelector()
    qtbot.addWidget(selector)
    selector.offer(STAGES, STAGES, STAGES)
    selector.show()
    part = selector.findChild(QCheckBox, "part_check_scale_factors")
    rate = selector.findChild(QCheckBox, "stage_check_rate")
    assert part is not None
    assert rate is not None
    rate.click()
    partly = part.grab().toImage()
    QApplication.processEvents()
    painted = PaintCounter(part)
    rate.click()
    QApplication.processEvents()
    assert painted.count
    assert part.grab().toImage() != partly
    assert (part.checkState(), part.isTristate()) == (Qt.CheckState.Checked, False)


class PaintCounter(QObject):
    """Counts how often a widget is drawn."""

    def __init__(self, widget: QWidget) -> None:
        super().__init__(widget)
        self.count = 0
        widget.installEventFilter(self)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        self.count += event.type() == QEvent.Type.Paint
        return super().eventFilter(watched, event)


@pytest.mark.parametrize(
    ("words", "some", "every"),
    [
        ("en", "a pass writes: gyro scale factor, accel scale factor, accel bias.", "a pass writes all of them"),
        ("zh_CN", "合格后写入：陀螺刻度系数、加表刻度系数、加表零偏。", "合格后全部写入"),
    ],
)
def test_the_parameters_that_the_ticked_stages_write_are_stated(
    engineer: Engineer, words: str, some: str, every: str
) -> None:
    engineer.unlock()
    line = engineer.widget("solved_parameters_label", QLabel)
    language.use(words)
    engineer.tick("part_check_scale_factors")
    assert some in line.text()
    engineer.tick("part_check_installation")
    assert every in line.text()
    language.use("en")


def test_single_stages_can_be_chosen_in_any_order(engineer: Engineer) -> None:
    engineer.unlock()
    engineer.tick("stage_check_rate", "stage_check_excitation")
    parts = {name: engineer.widget(f"part_check_{name}", QCheckBox) for name in ("scale_factors", "biases")}
    assert parts["scale_factors"].checkState() == Qt.CheckState.PartiallyChecked
    assert parts["biases"].checkState() == Qt.CheckState.Unchecked
    engineer.widget("stage_down_rate", QToolButton).click()
    engineer.widget("stage_down_rate", QToolButton).click()
    assert engineer.page.choice.selector.stages == ("excitation", "rate")
    assert engineer.window.app.stages == ("excitation", "rate")

    engineer.window.show_page("operator_page")
    assert "Partial calibration: not all stages of this product" in engineer.says()
    assert "without Six positions, Azimuth flips" in engineer.says()
    assert engineer.widget("start_button", QPushButton).text() == "START PARTIAL"
    assert "Excitation, Rate" in engineer.says()
    engineer.press("whole_choice")
    assert engineer.window.app.stages is None
    assert engineer.widget("start_button", QPushButton).text() == "START"

    engineer.window.show_page("engineer_page")
    assert engineer.page.choice.selector.stages == ("excitation", "rate"), "for runs started here"
    assert engineer.widget("engineer_start_button", QPushButton).text() == "START PARTIAL"
    engineer.tick()
    assert engineer.why_not("engineer_start_button") == "Choose at least one stage."
    assert engineer.why_not("preview_button") == "Choose at least one stage."

    path = engineer.site_folder.folder / "x.json"
    path.write_text(json.dumps({"schema": "other"}), encoding="utf-8")
    engineer.page.analysis.open(path)
    engineer.until(lambda: "This file cannot be opened" in engineer.says())


def test_changed_schedule_is_not_a_partial_calibration(engineer: Engineer) -> None:
    engineer.unlock()
    engineer.type("schedule_rate_dwell_s", "6.5")
    assert engineer.widget("engineer_start_button", QPushButton).text() == "START"
    engineer.window.show_page("operator_page")
    assert "Not the product's own schedule" in engineer.says()
    assert "Partial" not in engineer.says()
    assert engineer.widget("start_button", QPushButton).text() == "START"


@pytest.mark.parametrize(
    ("code", "title", "stages"),
    [
        ("en", "Not the product's own schedule", "only: Rate. “Whole"),
        ("zh_CN", "不是这个产品自己的流程参数", "有效：速率。"),
    ],
)
def test_notice_of_a_changed_schedule_names_only_the_changed_stages(
    engineer: Engineer, code: str, title: str, stages: str
) -> None:
    engineer.unlock()
    engineer.type("schedule_rate_dwell_s", "6.5")
    engineer.window.app.set_language(code)
    engineer.window.show_page("operator_page")
    notice = engineer.window.operator_page.notice
    assert notice.title_label.text() == title
    assert stages in notice.text_label.text()
    engineer.window.app.set_language("en")


@pytest.mark.parametrize(
    ("code", "title", "remedy", "unusable"),
    [
        ("en", "The schedule set on the Engineer page cannot run", "the schedule of Excitation on", "another product"),
        ("zh_CN", "工程师页设定的流程参数无法标定", "更正“三轴激励”的流程参数", "工位和产品型号"),
    ],
)
def test_operator_page_blames_a_wrong_schedule_instead_of_station_and_product(
    engineer: Engineer, code: str, title: str, remedy: str, unusable: str
) -> None:
    app, window = engineer.window.app, engineer.window
    app.set_language(code)
    engineer.unlock()
    engineer.type("schedule_rate_dwell_s", "6.5")  # valid
    engineer.page.choice.selector.select("excitation")
    engineer.type("schedule_excitation_targets_gyro_bias", "0")
    window.show_page("operator_page")
    texts = engineer.says()
    assert texts.count(title) == 3, "the notice, the view and the message"
    assert remedy in texts
    assert unusable not in texts
    assert not window.operator_page.notice.offers("station_choice")
    engineer.press("engineer_choice")
    assert engineer.page.isVisible()
    engineer.type("schedule_excitation_targets_gyro_bias", "-1")
    window.show_page("operator_page")
    engineer.press("whole_choice")
    assert (app.run.problem, app.schedule) == (None, None)
    assert title not in engineer.says()
    app.set_language("en")


def test_changed_schedule_is_marked_on_the_operator_page_and_applies_to_one_run(engineer: Engineer) -> None:
    """Its notice, which is dismissed by the next serial number, is not the only mark."""
    engineer.unlock()
    engineer.type("schedule_rate_dwell_s", "6.5")
    engineer.window.show_page("operator_page")
    assert "As set on the Engineer page, for the next run only: Rate" in engineer.says()
    engineer.scan(SERIAL)
    assert "Not the product's own schedule" not in engineer.says()
    mark = engineer.widget("partial_label", QLabel)
    for code, said in (("zh_CN", "流程参数已更改：速率"), ("en", "Changed schedule: Rate")):
        language.use(code)
        assert mark.isVisible()
        assert mark.text() == said
    engineer.press("start_button")
    engineer.until(engineer.in_a_stage)
    assert mark.text() == "Changed schedule: Rate"
    engineer.press("stop_button")
    engineer.until_ended()
    assert engineer.window.app.schedule is None
    engineer.scan("SN-000044")
    assert not mark.isVisible()
    engineer.window.show_page("engineer_page")
    assert engineer.widget("schedule_rate_dwell_s", QLineEdit).text() == "6.5"
    assert "the Operator page takes selection and changed schedule for one run only" in engineer.says()
    engineer.window.show_page("operator_page")
    assert not mark.isVisible()
    assert engineer.window.app.schedule is None


@pytest.mark.parametrize(
    ("code", "said", "button"),
    [("en", "The completed stages are kept", "Resume"), ("zh_CN", "已完成的阶段保留", "接着做")],
)
def test_stopped_run_is_resumed_from_the_engineer_page_with_the_question_of_the_operator_page(
    engineer: Engineer, code: str, said: str, button: str
) -> None:
    engineer.window.app.set_language(code)
    engineer.unlock()
    engineer.tick("part_check_scale_factors")
    engineer.press("engineer_start_button")
    engineer.until(lambda: engineer.run.stage is not None and engineer.run.stage.name == "six_position")
    engineer.press("stop_button")
    engineer.until_ended()
    assert said in engineer.says()
    assert engineer.widget("engineer_resume_button", QPushButton).text() == button
    engineer.press("engineer_resume_button")
    engineer.until(lambda: engineer.window.operator_page.notice.offers("resume_choice"))
    engineer.press("resume_choice")
    engineer.until(lambda: engineer.run.in_progress)
    assert not engineer.page.notice.asking
    request = engineer.window.app.engine_link.request
    assert request is not None
    assert request.resume is not None
    engineer.until(lambda: engineer.in_a_stage() and engineer.run.partial)
    assert [stage.name for stage in engineer.run.stages] == ["rate", "six_position", "transfer"]
    engineer.press("stop_button")
    engineer.until_ended()
    assert engineer.page.choice.selector.stages == ("rate", "six_position")
    engineer.window.app.set_language("en")


def test_schedule_of_a_stage_that_is_not_selected_any_more_does_not_stay_open(engineer: Engineer) -> None:
    selector = engineer.page.choice.selector
    engineer.unlock()
    assert selector.current == "rate"
    engineer.widget("part_check_scale_factors", QCheckBox).click()
    assert (selector.current, engineer.page.choice.form.stage) == ("excitation", "excitation")
    engineer.widget("stage_check_excitation", QCheckBox).click()
    assert selector.current == "azimuth_flip"
    engineer.widget("stage_check_azimuth_flip", QCheckBox).click()
    assert (selector.current, selector.stages) == ("azimuth_flip", ())


def test_selection_and_schedule_stay_when_the_files_are_read_again_until_the_product_changes(
    engineer: Engineer,
) -> None:
    app, panel = engineer.window.app, engineer.page.choice
    engineer.unlock()
    engineer.tick("stage_check_azimuth_flip", "stage_check_rate")
    engineer.type("schedule_rate_dwell_s", "6.5")
    engineer.widget("stage_down_rate", QToolButton).click()
    chosen = panel.selector.stages, panel.schedule
    for kept in (app.stages, None):  # for the next run of the Operator page; None after a run of this page
        app.choose(kept, panel.schedule if kept else None)
        for signal in (app.station_changed, app.product_changed):
            signal.emit()
            assert (panel.selector.stages, panel.schedule) == chosen
            assert app.stages == kept
            assert engineer.widget("schedule_rate_dwell_s", QLineEdit).text() == "6.5"
            assert engineer.widget("engineer_start_button", QPushButton).text() == "START PARTIAL"
    app.set_product(library.find("products", "mems_c"))
    assert (panel.selector.stages, panel.schedule) == (STAGES, {})


def test_question_about_an_unverified_transfer_outlasts_the_end_of_a_changed_schedule(engineer: Engineer) -> None:
    engineer.unlock()
    engineer.type("schedule_rate_dwell_s", "6.5")
    engineer.press("engineer_start_button")
    engineer.until(lambda: engineer.run.registers == "verifying")
    engineer.press("stop_button")
    engineer.until_ended()
    assert engineer.window.app.schedule is None
    engineer.window.show_page("operator_page")
    assert engineer.widget("restore_choice", QPushButton).isVisible()
    for code, place in (("zh_CN", "工程师页的“寄存器”"), ("en", "Engineer page, Registers")):
        engineer.window.app.set_language(code)
        assert place in engineer.message


def test_only_an_engineer_chooses_parts(engineer: Engineer) -> None:
    boxes = ("part_check_biases", "stage_check_rate")
    for name in (*boxes, "stage_down_rate"):
        assert not engineer.widget(name).isEnabled()
    for name in boxes:
        assert "PIN" in engineer.widget(name).toolTip()
        engineer.qtbot.mouseClick(engineer.widget(name), Qt.MouseButton.LeftButton)
    assert engineer.page.choice.selector.stages == STAGES
    assert engineer.widget("engineer_start_button", QPushButton).text() == "START"
    engineer.unlock()
    for names, stages in ((("stage_check_rate",), ("rate",)), ((), ())):
        engineer.tick(*names)
        assert engineer.page.choice.selector.stages == stages
        engineer.window.app.role.lock()
        assert engineer.page.choice.selector.stages == STAGES
        assert engineer.widget("engineer_start_button", QPushButton).text() == "START"
        engineer.window.app.role.unlock("246813")


def test_partial_run_is_marked_on_all_pages(engineer: Engineer) -> None:
    engineer.unlock()
    engineer.tick("part_check_scale_factors")
    assert engineer.widget("engineer_start_button", QPushButton).text() == "START PARTIAL"
    engineer.preview()
    during = []

    def look() -> None:
        engineer.until(engineer.in_a_stage)
        during.append(engineer.says())
        engineer.window.show_page("operator_page")
        engineer.until(lambda: "Partial calibration, without Excitation, Azimuth flips" in engineer.says())
        during.append(engineer.says())
        engineer.window.show_page("engineer_page")

    result = engineer.start(look)
    assert (result["outcome"], result["partial"], result["registers"]["verified"]) == ("passed", True, True)
    assert all("PARTIAL  ·  " in text for text in during)
    engineer.until(lambda: engineer.widget("engineer_views", QTabBar).currentIndex() == 1)
    assert "PARTIAL: Rate, Six positions" in engineer.says()
    assert "out of date" not in engineer.says()
    assert "PASS" not in engineer.says()
    assert engineer.page.choice.selector.stages == ("rate", "six_position"), "to repeat it"
    assert engineer.widget("engineer_serial_edit", QLineEdit).text() == "", "the unit must be identified again"
    assert engineer.window.app.stages is None, "the next run of the Operator page is whole"
    assert engineer.widget("engineer_start_button", QPushButton).text() == "START PARTIAL"

    engineer.window.show_page("operator_page")
    assert engineer.verdict == "PARTIAL"
    assert "Only Rate, Six positions" in engineer.says()
    assert "not a full PASS" in engineer.message
    assert engineer.widget("start_button", QPushButton).text() == "START"
    assert engineer.widget("serial_edit", QLineEdit).text() == "SN-000001"
    engineer.scan(SERIAL)
    engineer.press("start_button")
    assert engineer.window.app.engine_link.running, "no question: this unit has not passed yet"
    assert engineer.run.run_summary is not None
    engineer.until(lambda: engineer.run.run_summary is not None and engineer.run.run_summary.omitted == ())
    engineer.press("stop_button")
    engineer.until_ended()
    assert engineer.page.choice.selector.stages == ("rate", "six_position"), "a run of the Operator page keeps it, too"

    engineer.window.show_page("history_page")
    table = engineer.widget("history_table", QTableView).model()
    engineer.until(lambda: table.rowCount() == 2)
    assert [table.index(row, 0).data() for row in range(2)] == ["STOPPED, simulated", "PARTIAL, simulated"]
    combo = engineer.widget("history_outcome_combo", QComboBox)
    for verdict, rows in (("passed", 0), ("partial", 1)):
        combo.setCurrentIndex(combo.findData(verdict))
        assert table.rowCount() == rows


def test_schedule_is_validated_previewed_and_saved_to_the_product(
    engineer: Engineer,
) -> None:
    engineer.unlock()
    engineer.tick("stage_check_rate")
    engineer.page.choice.selector.select("rate")
    for field, text, problem in (
        ("schedule_rate_dwell_s", "1", "Too small; enter 2 to 600 s."),
        ("schedule_rate_dwell_s", "long", "Not a number; enter 2 to 600 s."),
        ("schedule_rate_turns", "1.5", "Must be a whole number, 1 to 50."),
        ("schedule_rate_rate_dps", "130", "The table allows 120 °/s at most; lower the value."),
    ):
        engineer.type(field, text)
        assert problem in engineer.says()
        assert "Rate" in engineer.why_not("engineer_start_button")
        assert "Rate" in engineer.why_not("preview_button")
        engineer.press("reset_schedule_button")
        assert problem not in engineer.says()
    assert engineer.widget("engineer_start_button").isEnabled()
    assert engineer.widget("schedule_rate_dwell_s", QLineEdit).text() == "2"

    engineer.type("schedule_rate_turns", "7")
    engineer.preview()
    assert "Lower turns in the schedule of rate" in engineer.widget("preview_violations", QLabel).text()
    assert "beyond the table's limits" in engineer.says()
    engineer.type("schedule_rate_turns", "2")
    assert "out of date" in engineer.says()
    engineer.preview()
    assert not engineer.widget("preview_violations", QLabel).isVisible()
    assert "within the table's limits" in engineer.says()
    assert "9 moves" in engineer.widget("preview_summary", QLabel).text()
    assert engineer.page.preview.preview is not None
    assert np.ptp(engineer.page.preview.preview.outer) == pytest.approx(4.0 * np.pi)

    engineer.press("reset_schedule_button")
    assert "are those of the product" in engineer.why_not("save_product_button")
    engineer.type("schedule_rate_dwell_s", "6.5")
    engineer.press("save_product_button")
    assert "All later runs of this product use it" in engineer.says()
    engineer.press("confirm_save_button")
    engineer.until(lambda: "version" in engineer.says())
    stored = tomllib.loads(engineer.site_folder.product.read_text(encoding="utf-8"))
    assert stored["schedule"]["rate"] == {**PRODUCT["schedule"]["rate"], "dwell_s": 6.5}
    assert versions.list_versions("products", "short")[0].author == "wang"
    assert engineer.widget("schedule_rate_dwell_s", QLineEdit).text() == "6.5"
    assert "are those of the product" in engineer.why_not("save_product_button")


def test_target_above_the_limit_of_the_product_is_a_caution(engineer: Engineer) -> None:
    engineer.unlock()
    engineer.window.app.set_product(library.find("products", "mems_c"))
    engineer.until(lambda: engineer.page.choice.selector.stages == STAGES)
    engineer.page.choice.selector.select("azimuth_flip")
    limit = engineer.page._options.sigma_limits["azimuth_flip"]["gyro_bias"] * 206264.8
    name = "schedule_azimuth_flip_targets_gyro_bias"
    message = engineer.widget(f"{name}_message", QLabel)
    for code, said in (("en", "the stage may end before it is reached"), ("zh_CN", "可能在达到限差之前就结束")):
        engineer.window.app.set_language(code)
        engineer.type(name, f"{1.1 * limit:.3f}")
        assert said in message.text()
        assert f"{limit:.2g} °/h" in message.text()
        engineer.type(name, f"{0.9 * limit:.3f}")
        assert said not in message.text()
    engineer.window.app.set_language("en")


@pytest.mark.parametrize(
    ("stage", "station", "product", "name", "unit"),
    [
        ("temperature", "virtual_chamber", "mems_c_thermal", "ramp_c_per_min", "°C/min"),
        ("multi_position", "virtual_hand", "mems_hand", "force_scatter", "m/s²"),
    ],
)
def test_units_of_a_schedule_are_shown_and_not_cut(
    qtbot: QtBot, stage: str, station: str, product: str, name: str, unit: str
) -> None:
    options = schedule_options(library.find("stations", station), library.find("products", product))
    form = ScheduleForm(stage, options)
    qtbot.addWidget(form)
    units = {field.editor.objectName(): field.unit for field in form.findChildren(FormField)}
    assert units[f"schedule_{stage}_{name}"].text() == unit
    assert all(label.sizeHint().width() <= label.maximumWidth() for label in units.values())


@pytest.mark.parametrize("code", ["en", "zh_CN"])
@pytest.mark.parametrize("group", ["gyro_bias", "accel_bias"])
def test_wrong_field_stays_in_sight_on_a_small_screen(engineer: Engineer, code: str, group: str) -> None:
    engineer.window.resize(1280, 720)
    engineer.window.app.set_language(code)
    engineer.unlock()
    engineer.page.choice.selector.select("excitation")
    edit = engineer.widget(f"schedule_excitation_targets_{group}", QLineEdit)
    area = engineer.page.choice._area
    edit.setFocus()
    area.ensureWidgetVisible(edit)  # as Tab does
    engineer.qtbot.keyClicks(edit, "0")
    message = engineer.widget(f"schedule_excitation_targets_{group}_message", QLabel)
    engineer.until(lambda: bool(message.text()))
    engineer.qtbot.wait(50)
    for widget in (edit, message):
        assert widget.visibleRegion().boundingRect().height() == widget.height() > 0
    engineer.window.app.set_language("en")


@pytest.mark.parametrize("code", ["en", "zh_CN"])
def test_target_below_one_in_an_empty_field_does_not_prevent_a_run(engineer: Engineer, code: str) -> None:
    app = engineer.window.app
    app.set_language(code)
    engineer.unlock()
    engineer.page.choice.selector.select("excitation")
    engineer.type("schedule_excitation_targets_gyro_bias", "0.02")
    assert engineer.widget("engineer_start_button").isEnabled()
    assert app.schedule is not None
    assert app.schedule["excitation"]["targets"] == pytest.approx({"gyro_bias": 0.02 * DEGREE_PER_HOUR})
    app.set_language("en")


def test_sigma_to_reach_is_the_limit_or_a_stricter_target_of_a_stage(engineer: Engineer) -> None:
    engineer.unlock()
    engineer.page.choice.selector.select("excitation")
    limit = run_summary(engineer.page._request()).targets["gyro_bias"]
    for factor, own in ((2.0, False), (0.5, True)):
        sigma = factor * limit
        engineer.type("schedule_excitation_targets_gyro_bias", f"{sigma / DEGREE_PER_HOUR:.6f}")
        summary = run_summary(engineer.page._request())
        assert summary.targets["gyro_bias"] == pytest.approx(min(sigma, limit), rel=1e-3)
        assert summary.own_targets == ({"gyro_bias"} if own else set())


@pytest.mark.parametrize("code", ["en", "zh_CN"])
def test_empty_target_shows_the_limit_at_which_a_designed_stage_ends_until_it_is_replaced(
    engineer: Engineer, code: str
) -> None:
    moves = {"moves": [[0.0, 0.0, 5.0], [90.0, 90.0, 5.0]], "margin": 0.5}
    engineer.site_folder.write({"stages": ["designed"], "schedule": {"designed": moves}})
    app = engineer.window.app
    app.product_changed.emit()
    app.set_language(code)
    engineer.unlock()
    engineer.page.choice.selector.select("designed")
    edit = engineer.widget("schedule_designed_targets_gyro_bias", QLineEdit)
    assert (edit.text(), edit.placeholderText()) == ("", f"{0.5e-5 / DEGREE_PER_HOUR:.3g}")
    engineer.type("schedule_designed_margin", "0.25")
    assert edit.placeholderText() == f"{0.25e-5 / DEGREE_PER_HOUR:.3g}"
    engineer.press("reset_schedule_button")

    engineer.type("schedule_designed_targets_gyro_bias", "1.5")
    typed = {"gyro_bias": pytest.approx(1.5 * DEGREE_PER_HOUR)}
    assert edit.placeholderText() == ""
    assert app.schedule is not None
    assert app.schedule["designed"]["targets"] == typed
    targets = load_configuration(engineer.page._request()).schedules["designed"].targets
    assert targets == {**typed, **{f"gyro_scale_{axis}": 0.5e-3 for axis in "xyz"}, **targets}
    assert not any(name.startswith("gyro_bias_") for name in targets)
    engineer.type("schedule_designed_targets_gyro_bias", "")
    assert app.schedule is None
    app.set_language("en")


def test_typed_target_replaces_those_of_single_parameters(engineer: Engineer) -> None:
    targets = {"gyro_bias_x": 2e-6, "gyro_bias_y": 1e-6, "accel_bias": 1e-3}
    excitation = {**PRODUCT["schedule"]["excitation"], "targets": targets}
    engineer.site_folder.write({"schedule": {**PRODUCT["schedule"], "excitation": excitation}})
    app = engineer.window.app
    app.product_changed.emit()
    engineer.unlock()
    engineer.page.choice.selector.select("excitation")
    edit = engineer.widget("schedule_excitation_targets_gyro_bias", QLineEdit)
    assert edit.placeholderText() == f"{1e-6 / DEGREE_PER_HOUR:.3g}"
    engineer.type("schedule_excitation_targets_gyro_bias", "1")
    assert app.schedule is not None
    assert app.schedule["excitation"]["targets"].keys() == {"gyro_bias", "accel_bias"}
    engineer.type("schedule_excitation_targets_gyro_bias", "")
    assert app.schedule is None


def test_confirmation_prompt_disappears_when_its_subject_changes(engineer: Engineer) -> None:
    app = engineer.window.app
    engineer.unlock()
    engineer.tick("stage_check_rate")
    engineer.page.choice.selector.select("rate")
    engineer.type("schedule_rate_dwell_s", "6.5")
    lock_and_unlock = (app.role.lock, lambda: app.role.unlock("246813"))
    for changes in (
        lock_and_unlock,
        (app.station_changed.emit,),
        (partial(app.engine_link.running_changed.emit, False),),
    ):
        engineer.type("schedule_rate_dwell_s", "6.5")
        engineer.press("save_product_button")
        assert engineer.page.notice.asking
        for change in changes:
            change()
        assert not engineer.page.notice.asking
    engineer.type("schedule_rate_dwell_s", "6.5")
    engineer.press("save_product_button")
    answer = engineer.page.notice._choices[-1]
    app.set_product(library.find("products", "nav_a"))
    assert not engineer.page.notice.asking
    answer.act()
    engineer.until(lambda: versions.list_versions("products", "short"))
    assert versions.list_versions("products", "nav_a") == (), "the values were typed for the other product"


def test_selection_changed_during_the_preview_makes_it_outdated(engineer: Engineer) -> None:
    engineer.unlock()
    engineer.tick("stage_check_rate")
    engineer.press("preview_button")
    engineer.tick("stage_check_six_position")
    engineer.until(lambda: not engineer.page.preview.watch.busy)
    assert "the selection has changed" in engineer.widget("preview_summary", QLabel).text()
    engineer.preview()
    assert "the selection has changed" not in engineer.widget("preview_summary", QLabel).text()


def test_preview_states_the_end_condition_of_a_repeated_stage(engineer: Engineer) -> None:
    engineer.unlock()
    engineer.tick("stage_check_azimuth_flip")
    engineer.page.choice.selector.select("azimuth_flip")
    for rounds, duration, ends in (
        ("2", "", "Azimuth flips: ends after 2 rounds."),
        ("0", "", "Azimuth flips: repeated until it is ended by hand"),
        ("0", "150", "Azimuth flips: ends by its duration, after 3 rounds."),
        ("1", "100", "Azimuth flips: ends after 1 round."),
    ):
        engineer.type("schedule_azimuth_flip_rounds", rounds)
        engineer.type("schedule_azimuth_flip_duration_s", duration)
        engineer.preview()
        assert ends in engineer.widget("preview_ends", QLabel).text()


@pytest.mark.parametrize(
    ("code", "missed", "reached", "said"),
    [
        ("en", "target missed", "reached", "Excitation: does not reach its target sigmas."),
        ("zh_CN", "达不到目标", "可达到", "达不到目标标准差"),
    ],
)
def test_preview_does_not_call_a_parameter_reached_that_misses_its_target(
    engineer: Engineer, code: str, missed: str, reached: str, said: str
) -> None:
    engineer.unlock()
    engineer.page.choice.selector.select("excitation")
    engineer.window.app.set_language(code)
    for target, verdict, state in (("0.001", missed, "caution"), ("100", reached, "good")):
        engineer.type("schedule_excitation_rounds", "1")
        engineer.type("schedule_excitation_targets_gyro_scale", target)
        engineer.preview()
        cells = engineer.page.preview.findChild(CellTable, "preview_table").cells["gyro_scale_z"]
        assert (cells["verdict"], cells["state"]) == (verdict, state)
        assert (said in engineer.widget("preview_ends", QLabel).text()) == (verdict == missed)
    engineer.window.app.set_language("en")


@pytest.mark.exhaustive
def test_changed_schedule_is_stored_in_the_log_and_its_hash(engineer: Engineer) -> None:
    engineer.unlock()
    engineer.tick("stage_check_six_position")
    before = engineer.start()
    engineer.type("engineer_serial_edit", before["unit"]["serial"])
    engineer.tick("stage_check_six_position")
    engineer.page.choice.selector.select("six_position")
    engineer.type("schedule_six_position_dwell_s", "4")
    after = engineer.start(engineer.check_disabled)
    assert open_log(Path(after["log"]["file"])).meta.schedule["six_position"]["dwell_s"] == 4.0
    assert after["configuration_sha256"] != before["configuration_sha256"]
    previous = {name: row["Previous"] for name, row in engineer.cells("result_table").items()}
    for name, text in previous.items():
        assert number(text) == pytest.approx(
            before["parameters"][name]["value"] / SIZE[name.rpartition("_")[0]], abs=0.6
        )

    engineer.window.app.role.lock()
    assert engineer.window.app.schedule is None
    assert not engineer.widget("schedule_six_position_dwell_s", QLineEdit).isEnabled()
    assert "PIN" in engineer.widget("schedule_six_position_dwell_s", QLineEdit).toolTip()
    assert engineer.widget("schedule_six_position_dwell_s", QLineEdit).text() == "3"


DEGREE_PER_HOUR = np.pi / 180.0 / 3600.0
SIZE = {"accel_bias": 9.80665e-6, "accel_scale": 1e-6}


def test_finished_run_is_analysed(engineer: Engineer) -> None:
    engineer.unlock()
    engineer.tick("stage_check_six_position", "stage_check_azimuth_flip")
    result = engineer.start()
    page = engineer.page
    table = engineer.widget("result_table", QTableView)
    engineer.show_view(1)
    table.setFocus()
    engineer.qtbot.keyClick(table, Qt.Key.Key_C, Qt.KeyboardModifier.ControlModifier)
    lines = QGuiApplication.clipboard().text().splitlines()
    assert lines[0].split("\t")[:3] == ["parameter", "Unit", "Value"]
    assert [line.split("\t")[0] for line in lines[1:]] == list(result["parameters"])

    engineer.show_view(2)
    engineer.until(lambda: page.analysis.innovations.view.isVisible())
    combo = engineer.widget("innovation_stage_combo", QComboBox)
    assert [combo.itemText(i) for i in range(combo.count())] == ["Six positions", "Azimuth flips"]
    assert "beyond ±3 σ" in engineer.says()
    nis = result["consistency"]["azimuth_flip"]["nis_mean"]
    assert engineer.cells("nis_table")["azimuth_flip"]["Mean NIS"] == f"{nis:.3f}"

    engineer.show_view(3)
    assert page.analysis.residuals.view.isVisible()
    for plot, words in zip(page.analysis.residuals.view.plots[:2], ("outer", "µg"), strict=True):
        point = plot.getPlotItem().getViewBox().mapViewToDevice(plot.getPlotItem().getViewBox().viewRect().center())
        engineer.qtbot.mouseMove(plot.viewport(), point.toPoint())
        engineer.until(lambda words=words: words in engineer.widget("rest_label", QLabel).text())

    engineer.show_view(4)
    assert "determined by this stage" in engineer.widget("unobservable_label", QLabel).text().lower()
    heat = page.analysis.observability.view.map
    text, move = tooltip_at(heat, 6, 1).split("\n")
    assert text.startswith("gyro bias x after step")
    assert re.fullmatch(r"Step \d+: Half turn about the vertical, [+−]180°", move)
    assert re.fullmatch(r"\d+  flip [+−]180°", heat.getAxis("top")._names[1])

    page.analysis.open(Path(result["log"]["file"]))
    engineer.until(lambda: not page.analysis.loading.busy)
    assert "SN-000042" in engineer.says()


def tooltip_at(heat: HeatMap, line: int, step: int) -> str:
    """Return the tooltip with the pointer at the centre of a cell."""
    view = heat.viewport()
    at = heat.mapFromScene(heat.getViewBox().mapViewToScene(QPointF(step + 0.5, line + 0.5)))
    QApplication.sendEvent(view, QHelpEvent(QEvent.Type.ToolTip, at, view.mapToGlobal(at)))
    return QToolTip.text()


def test_registers_are_read_compared_and_written_after_confirmation(engineer: Engineer) -> None:
    engineer.site_folder.write(flash_file=str(engineer.site_folder.folder / "flash.bin"), out_of_limits=True)
    engineer.window.app.product_changed.emit()
    engineer.unlock()
    engineer.tick("stage_check_six_position")
    result = engineer.start()
    assert result["outcome"] == "failed"
    engineer.show_view(5)
    engineer.window.app.role.lock()
    assert "PIN" in engineer.why_not("write_registers_button")
    engineer.window.app.role.unlock("246813")
    engineer.until(lambda: engineer.page.registers.target is not None)
    assert "Read the unit first" in engineer.why_not("write_registers_button")
    assert engineer.widget("write_reason_label", QLabel).text() == engineer.why_not("write_registers_button")
    engineer.press("read_registers_button")
    engineer.until(lambda: engineer.page.registers.unit is not None)
    before = engineer.cells("register_table")
    assert before["accel_scale_x"]["Address"] == "15"
    assert before["accel_scale_x"]["In the unit"] == "0.0000"
    engineer.press("write_registers_button")
    assert "The result is FAIL (partial: Six positions), simulated. Write its 6 registers" in engineer.says()
    assert "12–15, 19, 23" in engineer.says()
    assert "flash write number 1" in engineer.says()
    assert register_journal.history(engineer.site_folder.runs, SERIAL) == []
    assert "Do not touch the unit. “Write, table at rest” does not move the table." in engineer.says()
    assert "For “Write and turn the table”, the table of “test bench” moves" in engineer.says()
    engineer.press("confirm_write_button")
    assert engineer.widget("stop_button", QPushButton).isEnabled()
    engineer.until(lambda: "being written" in engineer.says())
    engineer.until(lambda: "being written" in engineer.why_not("engineer_start_button"))
    engineer.until(lambda: "Verified with a turn of the table" in engineer.says())
    assert "written and read back" in engineer.says()
    engineer.until_ended()
    assert (engineer.run.state, engineer.run.fault) == ("idle", None), "a register write has no verdict"
    (entry,) = register_journal.history(engineer.site_folder.runs, SERIAL)
    assert (entry.by, entry.why, entry.closing) == ("wang", "hand", "done")
    after = engineer.cells("register_table")
    assert after["accel_scale_x"]["Change"] == "0"
    assert after["accel_scale_x"]["In the unit"] == before["accel_scale_x"]["New"]
    assert "already contains these values" in engineer.why_not("write_registers_button")


def finished_run(found: dict[str, Any], **more: Any) -> FinishedRun:
    """Return a run whose result has these parameters."""
    result = {
        "schema": SCHEMA,
        "unit": {"serial": SERIAL},
        "stages": ["six_position"],
        "outcome": "passed",
        "parameters": found,
        "log": {"file": "x.h5"},
        "registers": None,
        **more,
    }
    return FinishedRun(Result.from_json(result), None, {})


@pytest.mark.parametrize("code", ["en", "zh_CN"])
def test_verdict_stands_before_the_comparison_with_the_previous_run(app: AppContext, qtbot: QtBot, code: str) -> None:
    language.use(code)
    found = {"gyro_bias_x": {"value": 3.0e-6, "sigma": 3.0e-7, "unit": "rad/s", "stage": "azimuth_flip"}}
    view = ResultView(JobWatch(app, Job), ReleaseBar(app, "release"))
    qtbot.addWidget(view)
    view.resize(864, 480)  # beside the stages in a window of 1280 x 720
    view.show_run(replace(finished_run(found), previous={"gyro_bias_x": Parameter(value=1.0e-6, sigma=4.0e-7)}))
    view.show()
    table = view.findChild(CellTable, "result_table")
    assert table is not None
    headings = [say(column.heading) for column in table.parameters.columns]
    verdict = headings.index(say("common.verdict"))
    assert table.columnViewportPosition(verdict) + table.columnWidth(verdict) <= table.viewport().width()
    assert verdict < headings.index(say("engineer.previous"))


@pytest.mark.parametrize(
    ("code", "verdict", "change", "why"),
    [
        ("en", "not judged", "not improved", "value and sigma follow from the current calibration"),
        ("zh_CN", "未判定", "未改进", "所列的值和标准差来自现行标定"),
    ],
)
def test_value_of_the_current_calibration_has_limits_but_is_not_judged(
    app: AppContext, qtbot: QtBot, code: str, verdict: str, change: str, why: str
) -> None:
    language.use(code)
    row = {"value": 3.0e-6, "sigma": 3.0e-7, "unit": "rad/s", "stage": "azimuth_flip"}
    calibration = {"log": "a.h5", "started_utc": "2026-01-01T00:00:00+00:00", "not_improved": ["gyro_bias_x"]}
    names = ["gyro_bias_x", "gyro_bias_y"]
    run = replace(
        finished_run(dict.fromkeys(names, row), partial=True, calibration=calibration, not_compared=names),
        previous=dict.fromkeys(names, Parameter(value=3.1e-6, sigma=3.0e-7)),
        limits={"gyro_bias": Limit(within=1.5e-5, sigma_below=9.7e-8)},
    )
    view = ResultView(JobWatch(app, Job), ReleaseBar(app, "release"))
    qtbot.addWidget(view)
    view.show_run(run)
    x, y = (view.findChild(CellTable, "result_table").cells[name] for name in names)
    assert [cells[key].strip() for cells in (x, y) for key in ("limit", "sigma_limit", "verdict")] == 2 * [
        "±3.1",
        "0.02",
        verdict,
    ]
    assert x["in_sigma"].strip() == change
    assert y["in_sigma"].strip() == "-0.33", "a run that contains data of the calibration is not independent of it"
    assert why in x["hint"]
    assert y["hint"]
    assert y["hint"] != x["hint"]


def test_change_from_the_calibration_with_which_a_run_started_is_that_of_the_check(
    app: AppContext, qtbot: QtBot
) -> None:
    row = {"value": 3.0e-6, "sigma": 4.0e-7, "unit": "rad/s", "stage": "azimuth_flip"}
    started = "2026-01-01T00:00:00+00:00"
    calibration = {"log": "a.h5", "started_utc": started, "not_improved": []}
    run = replace(
        finished_run({"gyro_bias_x": row}, partial=True, calibration=calibration),
        previous={"gyro_bias_x": Parameter(value=2.4e-6, sigma=5.0e-7)},
        previous_utc=started,
    )
    view = ResultView(JobWatch(app, Job), ReleaseBar(app, "release"))
    qtbot.addWidget(view)
    view.show_run(replace(run, changed_schedules=("rate",)))
    for code, words in (("en", "Changed schedule: Rate"), ("zh_CN", "流程参数已更改：速率")):
        language.use(code)
        view.refresh()
        assert any(words in label.text() for label in view.findChildren(QLabel))
    language.use("en")
    for sigmas, expected in (({}, "2.0"), ({"gyro_bias_x": math.hypot(4e-7, 2e-7)}, "3.0")):
        view.show_run(replace(run, prior_sigmas=sigmas))
        shown = view.findChild(CellTable, "result_table").cells["gyro_bias_x"]["in_sigma"].strip()
        assert float(shown) == pytest.approx(float(expected), rel=0.01)


@pytest.mark.parametrize("code", ["en", "zh_CN"])
def test_long_verdict_on_a_repeated_solution_leaves_room_for_the_parameters(
    app: AppContext, qtbot: QtBot, code: str
) -> None:
    language.use(code)
    names = ("gyro_bias", "gyro_scale", "accel_bias", "accel_scale")
    row = {"value": 3.0e-6, "sigma": 3.0e-7, "unit": "rad/s", "stage": "azimuth_flip"}
    kinds = ("gravity_at_rest", "improvement_at_rest", "improvement_at_rest_floor")
    failed = [check_row(kind, "", 2.0, 1.0, passed=False) for kind in kinds]
    passed = [check_row("sigma_below", f"{name}_x", 1.0, 2.0, passed=True) for name in names]
    states = {"outcome": "resolved", "passed": False, "states_added": ["accel_cubic"], "product": "Navigation grade A"}
    view = ResultView(JobWatch(app, Job), ReleaseBar(app, "release"))
    qtbot.addWidget(view)
    parameters = {f"{name}_{axis}": row for name in names for axis in "xyz"}
    view.show_run(finished_run(parameters, checks=[*failed, *passed], **states))
    view.resize(950, 505)  # beside the stages in a window of 1366 x 768
    view.show()
    assert view.minimumSizeHint().width() <= 950
    badge, table = view.findChild(StateBadge, "result_badge"), view.findChild(CellTable, "result_table")
    assert view._summary.width() == badge.parentWidget().width() == 950
    assert badge.width() >= 500
    assert table.viewport().height() >= 5 * table.rowHeight(0)


@pytest.mark.parametrize(
    ("code", "count", "tip"),
    [
        ("en", "near-misses: 1", "Gyro bias x within its limit: 2.888 °/h, allowed ±3.1 °/h"),
        ("zh_CN", "临界 1 项", "陀螺零偏 x在限差内：2.888 °/h，限差 ±3.1 °/h"),
    ],
)
def test_near_miss_is_named_in_the_tooltip_of_the_summary(
    app: AppContext, qtbot: QtBot, code: str, count: str, tip: str
) -> None:
    language.use(code)
    near = Check.compare("within", 1.4e-5, (-1.5e-5, 1.5e-5), "rad/s", subject="gyro_bias_x")
    far = Check.compare("within", 1.0e-6, (-1.5e-5, 1.5e-5), "rad/s", subject="gyro_bias_y")
    view = ResultView(JobWatch(app, Job), ReleaseBar(app, "release"))
    qtbot.addWidget(view)
    view.show_run(finished_run({}, passed=True, checks=[near.to_json(), far.to_json()]))
    assert count in view._summary.text()
    assert view._summary.toolTip().replace("\u00a0", " ") == tip


def test_columns_without_enough_room_elide_headings_but_no_numbers(qtbot: QtBot) -> None:
    stages = [Cell(lambda: "stage with a very long name", f"after_{k}") for k in range(4)]
    table = CellTable("table", columns=(*stages, Cell("engineer.expected", "verdict", number=False, state="state")))
    qtbot.addWidget(table)
    table.show_cells({"gyro_bias_x": {f"after_{k}": "0.000123" for k in range(4)} | {"verdict": "reached"}})
    table.resize(640, 200)
    table.show()
    widths = [table.columnWidth(i) for i in range(5)]
    assert sum(widths) <= table.viewport().width()
    assert all(width >= table.sizeHintForColumn(i) for i, width in enumerate(widths))
    across, tip = Qt.Orientation.Horizontal, Qt.ItemDataRole.ToolTipRole
    assert table.model().headerData(0, across, tip) == "stage with a very long name"
    table.resize(100, 200)
    assert all(table.columnWidth(i) >= table.sizeHintForColumn(i) for i in range(5))


def test_difference_in_sigmas_has_one_definition(app: AppContext, qtbot: QtBot) -> None:
    same = {"sigma": 3.0e-7, "unit": "rad/s", "stage": "six_position"}
    values = {"gyro_bias_x": 3.0e-6, "gyro_bias_y": 1.0001e-6, "gyro_bias_z": 0.9999e-6}
    parameters = {name: {"value": value, **same} for name, value in values.items()}
    before = {name: Parameter(value=1.0e-6, sigma=4.0e-7) for name in values}
    comparison = ComparisonTable("comparison", "", independent=True)
    result = finished_run(parameters).result
    comparison.show_sets((ParameterSet("", before), ParameterSet("", result.parameters)))
    analysis = ResultView(JobWatch(app, Job), ReleaseBar(app, "release"))
    qtbot.addWidget(analysis)
    analysis.show_run(replace(finished_run(parameters), previous=before))
    shown = analysis.findChild(CellTable, "result_table").cells["gyro_bias_x"]["in_sigma"]
    assert shown.strip() == comparison.cells["gyro_bias_x"]["in_sigma1"].strip() == "+4.00"
    for table, key in ((analysis.findChild(CellTable, "result_table"), "in_sigma"), (comparison, "in_sigma1")):
        assert {table.cells[name][key].strip() for name in ("gyro_bias_y", "gyro_bias_z")} == {"0.00"}


@pytest.mark.parametrize(
    ("limits", "words", "text"),
    [
        ({}, "en", "limits no sigma of these parameters"),
        ({}, "zh_CN", "未对这些参数的标准差规定限差"),
        ({"gyro_bias_x": 2.0}, "en", "every sigma limit reached"),
    ],
)
def test_preview_without_limits_does_not_call_them_reached(
    app: AppContext, qtbot: QtBot, limits: dict[str, float], words: str, text: str
) -> None:
    sigma, none = np.ones(30), np.zeros(0)
    stage = StagePreview("rate", 0.0, 1.0, "plan", 1, 1, ("gyro_bias_x",), sigma)
    view = PreviewView(app, lambda: RunRequest(""))
    qtbot.addWidget(view)
    language.use(words)
    view._done(Preview((stage,), none, none, none, (), sigma, limits, {}, ((-1.0, 1.0), (-1.0, 1.0))))
    assert any(text in label.text() for label in view.findChildren(QLabel))
    excluded = "Stages without warm-up and transfer: " if words == "en" else "各阶段（不含预热和传输）"
    assert any(excluded in label.text() for label in view.findChildren(QLabel))


@pytest.mark.parametrize(
    ("words", "badge", "reason", "selection", "uncalibrated"),
    [
        (
            "en",
            "sigmas cannot be predicted",
            "The drifts of a gimbal cannot be predicted.",
            "of this selection",
            "The unit has no current calibration.",
        ),
        ("zh_CN", "标准差无法预估", "框架的漂移无法预估", "所选阶段的标准差全部满足限差", "这台产品没有现行标定。"),
    ],
)
def test_preview_without_prediction_is_neutral_and_a_partial_one_names_its_selection(
    app: AppContext, qtbot: QtBot, words: str, badge: str, reason: str, selection: str, uncalibrated: str
) -> None:
    none, sigma, travel = np.zeros(0), np.ones(30), ((-1.0, 1.0), (-1.0, 1.0))
    view = PreviewView(app, lambda: RunRequest(""))
    qtbot.addWidget(view)
    view.show()
    language.use(words)
    view._unit_named = True
    error, flat = Text("preview.gimbal_motion"), np.zeros(2)
    unknown = StagePreview("gimbal", 0.0, 1.0, "plan", 0, 18, ("gyro_bias_x",), error=error, predictable=False)
    view._done(Preview((unknown,), flat, flat, flat, (), sigma, {"gyro_bias_x": 2.0}, {}, travel))
    assert badge in view._badge.text()
    assert reason in view._ends.text()
    assert not view._problems.isVisible()
    assert not view._plot.isVisible()
    stage = StagePreview("rate", 0.0, 1.0, "plan", 1, 1, ("gyro_bias_x",), sigma)
    view._done(Preview((stage,), none, none, none, (), sigma, {"gyro_bias_x": 2.0}, {}, travel, partial=True))
    assert any(selection in label.text() for label in view.findChildren(QLabel))
    assert uncalibrated in view._ends.text()
    view._done(replace(view.preview, calibrated=True))
    assert uncalibrated not in view._ends.text()


def test_preview_without_a_serial_number_says_that_no_unit_is_named(engineer: Engineer) -> None:
    engineer.unlock()
    engineer.tick("stage_check_rate")
    ends = engineer.widget("preview_ends", QLabel)
    for serial, texts in (
        ("", ("No serial number is entered", "未填序列号")),
        (SERIAL, ("The unit has no current calibration", "这台产品没有现行标定")),
    ):
        engineer.type("engineer_serial_edit", serial)
        engineer.preview()
        for words, text in zip(("en", "zh_CN"), texts, strict=True):
            language.use(words)
            assert text in ends.text()
        language.use("en")


def test_preview_of_a_run_that_leaves_a_parameter_undetermined_does_not_call_it_reached(
    app: AppContext, qtbot: QtBot
) -> None:
    sigma, none = np.ones(30), np.zeros(0)
    stage = StagePreview("rate", 0.0, 1.0, "plan", 1, 1, ("gyro_bias_x", "gyro_bias_y"), sigma)
    view, travel = PreviewView(app, lambda: RunRequest("")), ((-1.0, 1.0), (-1.0, 1.0))
    qtbot.addWidget(view)
    limits = {"gyro_bias_x": 2.0}
    view._done(Preview((stage,), none, none, none, (), sigma, limits, {}, travel, undetermined=("gyro_bias_y",)))
    texts = [label.text() for label in view.findChildren(QLabel)]
    assert "a run would fail" in texts
    assert "A run would fail, because its data do not determine gyro bias y." in texts
    cells = view.findChild(CellTable, "preview_table").cells
    assert cells["gyro_bias_y"]["verdict"] == "not determined"
    assert cells["gyro_bias_x"]["verdict"] == "reached"


@pytest.mark.parametrize(("words", "verdict"), [("en", "not improved"), ("zh_CN", "未改进")])
def test_preview_does_not_promise_the_limit_of_a_parameter_that_a_run_does_not_improve(
    app: AppContext, qtbot: QtBot, words: str, verdict: str
) -> None:
    sigma, none = np.ones(30), np.zeros(0)
    stage = StagePreview("rate", 0.0, 1.0, "plan", 1, 1, ("gyro_bias_x", "gyro_bias_y"), sigma)
    view, travel = PreviewView(app, lambda: RunRequest("")), ((-1.0, 1.0), (-1.0, 1.0))
    qtbot.addWidget(view)
    language.use(words)
    limits = {"gyro_bias_x": 2.0, "gyro_bias_y": 2.0}
    view._done(Preview((stage,), none, none, none, (), sigma, limits, {}, travel, not_improved=("gyro_bias_y",)))
    cells = view.findChild(CellTable, "preview_table").cells
    assert (cells["gyro_bias_y"]["verdict"], cells["gyro_bias_y"]["state"]) == (verdict, "")
    assert cells["gyro_bias_x"]["state"] == "good"


def ask_to_write(engineer: Engineer, *, of: Mapping[str, Any] | None = None, **bench: Any) -> None:
    """Show a result with the changes `of`, read the unit and press Write."""
    engineer.site_folder.write(flash_file=str(engineer.site_folder.folder / "flash.bin"), **bench)
    engineer.window.app.product_changed.emit()
    engineer.unlock()
    found = {"gyro_bias_x": {"value": 1e-6, "sigma": 1e-8, "unit": "rad/s", "stage": "six_position"}}
    engineer.page.registers.show_run(finished_run(found, **(of or {})))
    engineer.show_view(5)
    engineer.until(lambda: bool(engineer.cells("register_table")))
    engineer.press("read_registers_button")
    engineer.until(lambda: engineer.page.registers.unit is not None)
    engineer.press("write_registers_button")


def test_result_of_another_profile_requires_its_own_product(engineer: Engineer) -> None:
    engineer.unlock()
    found = {"gyro_bias_x": {"value": 1e-6, "sigma": 1e-8, "unit": "rad/s", "stage": "six_position"}}
    engineer.page.registers.show_run(finished_run(found))
    engineer.show_view(5)
    engineer.until(lambda: bool(engineer.cells("register_table")))
    used = {"imu": {"name": "bench_mems", "version": None, "sha256": ""}}
    other = finished_run(found, product="MEMS grade C", configuration=used)
    engineer.page.registers.show_run(other)
    engineer.until(
        lambda: "choose the result's own product, 'MEMS grade C'" in engineer.says().replace("Choose", "choose")
    )
    assert engineer.page.registers.target is None
    engineer.press("read_registers_button")
    engineer.until(lambda: engineer.page.registers.unit is not None)
    for code, reason in (("en", "choose the result's own product"), ("zh_CN", "产品")):
        language.use(code)
        assert reason in engineer.why_not("write_registers_button").replace("Choose", "choose")
        assert "MEMS" in engineer.why_not("write_registers_button")
    language.use("en")


def test_registers_of_the_previous_run_are_not_offered_for_the_next(engineer: Engineer) -> None:
    found = {"gyro_bias_x": {"value": 1e-6, "sigma": 1e-8, "unit": "rad/s", "stage": "six_position"}}
    registers = engineer.page.registers
    registers.show_run(finished_run(found))
    registers.show_run(finished_run({}))
    engineer.until_no_job()
    engineer.qtbot.wait(200)
    assert registers.target is None


@pytest.mark.parametrize(
    ("changes", "title"),
    [
        ({}, f"Write 1 register of unit {SERIAL}?"),
        ({"outcome": "failed"}, "The result is FAIL. Write its 1 register to unit"),
        ({"partial": True}, "The result is PARTIAL: Six positions. Write its 1 register to unit"),
        ({"outcome": "resolved", "passed": False}, "The result is solved offline, outside the limits. Write its"),
    ],
)
def test_write_confirmation_shows_the_verdict_of_the_result(
    engineer: Engineer, changes: dict[str, Any], title: str
) -> None:
    ask_to_write(engineer, of=changes)
    assert title in engineer.says()
    engineer.press("cancel_write_button")
    assert title not in engineer.says()


def test_write_to_another_unit_is_refused_with_a_reason_at_the_button(engineer: Engineer) -> None:
    ask_to_write(engineer)
    engineer.type("engineer_serial_edit", "SN-000007")
    assert "Write 1 register" not in engineer.says(), "the question was about the unit in the fixture"
    reason = f"Result of {SERIAL}, not of the entered unit SN-000007"  # only read from the unit, not from the number
    assert engineer.why_not("write_registers_button") == reason
    assert engineer.widget("write_reason_label", QLabel).isVisible()
    assert engineer.widget("write_reason_label", QLabel).text() == reason


@pytest.mark.parametrize(
    ("code", "reason", "kept"),
    [
        ("en", "Read the unit first, so that", "The virtual bench keeps the registers of its units in the folder"),
        ("zh_CN", "请先读取产品", "虚拟台架把虚拟产品的寄存器保存在标定记录文件夹中。"),
    ],
)
def test_registers_read_at_another_station_are_not_shown(engineer: Engineer, code: str, reason: str, kept: str) -> None:
    app, registers = engineer.window.app, engineer.page.registers
    app.set_language(code)
    engineer.unlock()
    found = {"gyro_bias_x": {"value": 0.0, "sigma": 1e-8, "unit": "rad/s", "stage": "six_position"}}
    registers.show_run(finished_run(found))
    engineer.show_view(5)
    engineer.until(lambda: registers.target is not None)
    engineer.press("read_registers_button")
    engineer.until(lambda: registers.unit is not None)
    assert kept in engineer.says()
    other = engineer.site_folder.station.with_name("rig1.toml")
    other.write_text(engineer.site_folder.station.read_text(encoding="utf-8"), encoding="utf-8")
    app.set_station(other)
    assert registers.unit is None
    assert kept not in engineer.says()
    engineer.until(lambda: registers.target is not None)
    assert reason in engineer.why_not("write_registers_button")
    engineer.press("read_registers_button")
    app.set_runs_folder(engineer.site_folder.folder / "others")  # while the unit is being read
    engineer.until_no_job()
    engineer.until(lambda: not registers.watch.busy)
    assert registers.unit is None


@pytest.mark.parametrize(
    ("code", "reason", "written"),
    [
        ("en", "The result was simulated on a virtual bench", "egisters written"),
        ("zh_CN", "该结果由虚拟台架模拟得到", "寄存器写入于"),
    ],
)
def test_simulated_result_is_not_written_to_a_real_unit(
    engineer: Engineer, code: str, reason: str, written: str
) -> None:
    app, registers = engineer.window.app, engineer.page.registers
    app.set_language(code)
    engineer.unlock()
    found = {"gyro_bias_x": {"value": 1e-6, "sigma": 1e-8, "unit": "rad/s", "stage": "six_position"}}
    wrote = {"old": {}, "new": {"gyro_bias_x": 1e-6}, "verified": True, "written_utc": "2026-07-01T03:03:00+00:00"}
    registers.show_run(finished_run(found, simulated=True, registers=wrote))
    engineer.show_view(5)
    engineer.until(lambda: registers.target is not None)
    assert written in engineer.says()
    station = engineer.site_folder.station.with_name("line3.toml")
    ports = {"table": {"profile": "bench", "port": "tcp://127.0.0.1:9"}, "imu": {"port": "socket://127.0.0.1:9"}}
    station.write_text(tomli_w.dumps({**STATION, **ports}), encoding="utf-8")
    app.set_station(station)
    engineer.until(lambda: reason in engineer.says())
    assert reason in engineer.why_not("write_registers_button")
    assert written not in engineer.says()


@pytest.mark.parametrize(("code", "said"), [("en", "Registers written"), ("zh_CN", "寄存器写入于")])
def test_time_after_a_write_is_that_of_the_write(engineer: Engineer, code: str, said: str) -> None:
    engineer.window.app.set_language(code)
    engineer.window.app.role.unlock("246813")
    view, wrote = engineer.page.registers, "2026-07-01T03:03:00+00:00"
    found = {"gyro_scale_x": {"value": 1e-4, "sigma": 1e-6, "unit": "1", "stage": "rate"}}
    registers = {"old": {}, "new": {"gyro_scale_x": 1e-4}, "verified": True, "written_utc": wrote}
    view.show_run(finished_run(found, registers=registers))
    engineer.until(lambda: view.target is not None)
    engineer.show_view(5)
    assert f"{said} {local_time(wrote)}" in engineer.says()
    purpose = register_journal.Purpose("li", "hand", "x.h5")
    transfer = register_journal.begin(engineer.site_folder.runs, SERIAL, {}, {"gyro_scale_x": 1e-4}, purpose)
    transfer.note(TransferStep.COMMITTING)
    transfer.close(TransferOutcome.DONE)
    register = {"parameter": "gyro_scale_x", "address": 12, "value": 1e-4, "raw": "0"}
    unit = {"serial": SERIAL, "model": "m", "firmware": "1", "registers": [register], "commits": 2, "virtual": True}
    view._operation = RegisterOperation(engineer.page._request(), "write")
    view._show_end(Settled(SERIAL, "done", "rest", unit))
    assert f"{said} {local_time(transfer.utc)}" in engineer.says()
    assert local_time(wrote) not in engineer.says()


def test_reason_that_prevents_a_write_is_shown_once_and_wraps(engineer: Engineer) -> None:
    engineer.window.resize(1280, 720)
    engineer.unlock()
    engineer.show_view(5)
    found = {"gyro_bias_x": {"value": 1e-6, "sigma": 1e-8, "unit": "rad/s", "stage": "six_position"}}
    used = {"imu": {"name": "bench_mems", "version": None, "sha256": ""}}
    for code in ("en", "zh_CN"):
        engineer.window.app.set_language(code)
        engineer.page.registers.show_run(finished_run(found, product="MEMS grade C", configuration=used))
        engineer.until(lambda: "MEMS grade C" in engineer.says() or "MEMS" in engineer.says())
        reason = engineer.why_not("write_registers_button")
        assert engineer.says().count(reason) == 1
        assert engineer.page.minimumSizeHint().width() <= 1280, code


@pytest.mark.parametrize(
    ("code", "said"),
    [
        ("en", "Result of SN-000009, not of the entered unit SN-000007"),
        ("zh_CN", "这是 SN-000009 的结果，不是所输入的 SN-000007"),
    ],
)
def test_result_of_another_unit_is_marked_until_that_unit_is_scanned(engineer: Engineer, code: str, said: str) -> None:
    engineer.window.app.set_language(code)
    engineer.page.analysis._loaded(finished_run({}, unit={"serial": "SN-000009"}))
    engineer.type("engineer_serial_edit", "SN-000009")
    badge = engineer.widget("other_unit_badge", StateBadge)
    assert not badge.isVisible()
    engineer.type("engineer_serial_edit", "SN-000007")
    assert badge.isVisible()
    assert badge.text() == said
    engineer.show_view(0)
    assert not badge.isVisible()
    engineer.show_view(1)
    edit = engineer.widget("engineer_serial_edit", QLineEdit)
    engineer.qtbot.keyClick(edit, Qt.Key.Key_Return)
    assert not badge.isVisible()
    assert engineer.page.analysis.serial == ""
    assert not engineer.run.in_progress


@pytest.mark.parametrize(
    ("code", "said"),
    [
        ("en", f"Not the result of the last run of {SERIAL}, which the strip above shows"),
        ("zh_CN", f"不是上方所示 {SERIAL} 最近一次标定的结果"),
    ],
)
def test_result_of_an_earlier_run_is_not_taken_for_that_of_the_run_shown_above(
    engineer: Engineer, code: str, said: str
) -> None:
    engineer.window.app.set_language(code)
    engineer.window.resize(1280, 720)
    page, run = engineer.page, engineer.run
    run.units = (UnitStatus(SERIAL),)
    run.state = "stopped"
    page.analysis._loaded(finished_run({}, log={"file": "first.h5"}, started_utc="2026-11-21T15:04:00+00:00"))
    for log, earlier in (("first.h5", False), ("second.h5", True)):
        page._last_log = log
        page._update()
        assert engineer.widget("other_unit_badge", StateBadge).isVisible() == earlier
    assert engineer.widget("other_unit_badge", StateBadge).text() == said
    assert page._source.isVisible()
    assert page._source.shortened() == page.analysis.source()
    assert "2026-11-21" in page._source.text()


@pytest.mark.parametrize(
    ("code", "names"), [("en", "Correct the marked values first: Rest."), ("zh_CN", "请先改正标出的数值：")]
)
def test_wrong_value_out_of_sight_is_named(engineer: Engineer, code: str, names: str) -> None:
    engineer.window.app.set_language(code)
    engineer.unlock()
    engineer.tick("stage_check_six_position")
    engineer.widget("stage_check_six_position", QCheckBox).setFocus()
    engineer.type("schedule_six_position_dwell_s", "-5")
    assert engineer.why_not("save_product_button").startswith(names.split(", ")[0])
    assert engineer.widget("save_reason_label", QLabel).text() == engineer.why_not("save_product_button")


def test_rows_of_stages_stay_aligned_after_a_selection(engineer: Engineer) -> None:
    engineer.unlock()
    checks = [engineer.widget(f"stage_check_{stage}", QCheckBox) for stage in STAGES]
    for check in checks:
        check.setFocus()
        engineer.qtbot.wait(10)
        assert len({each.mapTo(engineer.page, QPoint()).x() for each in checks}) == 1


def test_registers_that_a_partial_run_writes_are_announced_beside_start(engineer: Engineer) -> None:
    engineer.unlock()
    engineer.tick("stage_check_six_position")
    engineer.type("engineer_serial_edit", SERIAL)
    for code, start, said in (
        ("en", "START PARTIAL", "Writes registers only if the unit is within its limits"),
        ("zh_CN", "", "仅当产品符合限差时写入寄存器"),
    ):
        language.use(code)
        assert start in engineer.widget("engineer_start_button", QPushButton).text()
        shown = [label for label in engineer.page.header.findChildren(QLabel) if label.text() == said]
        assert [label.isVisibleTo(engineer.page.header) for label in shown] == [True]
    language.use("en")


@pytest.mark.parametrize(
    ("code", "state", "why"),
    [("en", "NOT READY", "serial number"), ("zh_CN", "未就绪", "序列号")],
)
def test_reason_why_no_run_can_start_stands_beside_start(engineer: Engineer, code: str, state: str, why: str) -> None:
    engineer.window.app.set_language(code)
    engineer.type("engineer_serial_edit", "SN-000020SN-000021")
    shown = [label.text() for label in engineer.page.header.findChildren(QLabel) if label.isVisible()]
    assert state in shown
    assert engineer.why_not("engineer_start_button") in shown
    assert why in engineer.why_not("engineer_start_button")
    engineer.type("engineer_serial_edit", SERIAL)
    shown = [label.text() for label in engineer.page.header.findChildren(QLabel) if label.isVisible()]
    assert state not in shown


@pytest.mark.parametrize(
    ("code", "product", "compared", "other"),
    [
        (
            "en",
            "Product: MEMS grade C",
            "compared with earlier runs of this product, the last of 2026-11-",
            "of product",
        ),
        ("zh_CN", "产品型号：MEMS", "与本产品型号先前的标定比较，最近一次为 2026-11-", "这是产品型号"),
    ],
)
def test_result_names_its_product_and_the_run_with_which_it_is_compared(
    engineer: Engineer, code: str, product: str, compared: str, other: str
) -> None:
    engineer.window.app.set_language(code)
    found = {"gyro_bias_x": {"value": 1e-6, "sigma": 1e-8, "unit": "rad/s", "stage": "six_position"}}
    badge = engineer.widget("other_unit_badge", StateBadge)
    run = replace(finished_run(found, product="MEMS grade C"), previous_utc="2026-11-02T08:00:00+00:00")
    engineer.page.analysis._loaded(run)
    engineer.show_view(1)
    assert product in engineer.says()
    assert compared in engineer.says()
    assert badge.isVisible()
    assert other in badge.text()
    engineer.page.analysis._loaded(finished_run(found, product=10 * "long name ", unit={"serial": "SN-000009"}))
    engineer.type("engineer_serial_edit", "SN-000007")
    assert "  ·  " in badge.text()
    page_width = engineer.page.minimumSizeHint().width()
    engineer.page.analysis._loaded(finished_run(found, product=engineer.page._options.name))
    engineer.type("engineer_serial_edit", engineer.page.analysis.serial)
    assert not badge.isVisible()
    assert engineer.page.minimumSizeHint().width() == page_width, "the sentences take two lines"


@pytest.mark.parametrize(
    ("code", "said"),
    [
        ("en", "failed: gyro bias x, gyro bias y σ, innovations of Rate and 1 more"),
        ("zh_CN", "不合格：陀螺零偏 x、陀螺零偏 y σ、速率新息，另有 1 项"),
    ],
)
def test_headline_names_the_failed_checks(engineer: Engineer, code: str, said: str) -> None:
    engineer.window.app.set_language(code)
    found = {"gyro_bias_x": {"value": 1e-6, "sigma": 1e-8, "unit": "rad/s", "stage": "six_position"}}
    checks = [
        Check("within", "gyro_bias_x", 9.0, (-1.0, 1.0), "rad/s", passed=False),
        Check("sigma_below", "gyro_bias_y", 7.0, 1.0, "rad/s", passed=False),
        Check("consistency", "rate", 5.0, 1.0, "1", passed=False),
        Check("unobservable", "", 2.0, 1.0, "1", passed=False),
        Check("sigma_below", "gyro_bias_z", 0.5, 1.0, "rad/s", passed=True),
    ]
    engineer.page.analysis._loaded(finished_run(found, outcome="failed", checks=[check.to_json() for check in checks]))
    engineer.show_view(1)
    assert said in engineer.says()


def test_two_engineers_confirm_a_write_if_the_product_requires_it(engineer: Engineer) -> None:
    ask_to_write(engineer)
    for badge in ("B0001", "B0002"):
        access.set_pin("246813", f"{badge}-", badge)
    flash = str(engineer.site_folder.folder / "flash.bin")
    names = {"B0001": "Li Na", "B0002": "Wang Wei"}
    sign_in = {"badge_pattern": r"B\d{4}", "engineers": [*names], "names": names}
    engineer.site_folder.write(
        {"confirmation": {"required_for": ["registers"]}}, {"sign_in": sign_in}, flash_file=flash
    )
    engineer.press("confirm_at_rest_button")
    assert f"Two engineers confirm the registers of unit {SERIAL}" in engineer.says()
    for key, text in (("badge", "B0001"), ("pin", "B0001-"), ("second_badge", "B0001"), ("second_pin", "B0001-")):
        engineer.type(f"registers_{key}_edit", text)
    engineer.press("registers_confirm_button")
    assert "cannot confirm their own action" in engineer.says()
    for key, text in (("pin", "B0001-"), ("second_badge", "B0002"), ("second_pin", "B0002-")):
        engineer.type(f"registers_{key}_edit", text)
    engineer.press("registers_confirm_button")
    engineer.until(lambda: "Verified at rest; no turn was made." in engineer.says())
    event = read_audit(audit_path(library.site_folder())).entries[-1]
    assert (event.event, event.by, event.confirmed_by) == ("registers", "Li Na (B0001)", "Wang Wei (B0002)")


@pytest.mark.exhaustive
def test_registers_can_be_written_with_the_table_at_rest(engineer: Engineer) -> None:
    ask_to_write(engineer)
    engineer.press("confirm_at_rest_button")
    engineer.until(lambda: "Verified at rest; no turn was made." in engineer.says())
    assert "written and read back" in engineer.says()
    (entry,) = register_journal.history(engineer.site_folder.runs, SERIAL)
    assert (entry.closing, entry.steps[-1]) == ("done", "at_rest")


def test_table_that_cannot_move_suggests_writing_at_rest(engineer: Engineer) -> None:
    ask_to_write(engineer, interlock_closed=False)
    engineer.press("confirm_write_button")
    engineer.until(lambda: "not done" in engineer.says())
    assert "Or choose “Write, table at rest”." in engineer.says()
    assert register_journal.history(engineer.site_folder.runs, SERIAL) == []
    engineer.until_ended()
    assert engineer.run.fault is not None, "the operator page shows the fault and asks for acknowledgement"


def test_stop_ends_the_verification_motion_after_a_write(engineer: Engineer) -> None:
    ask_to_write(engineer, speed=5.0)
    engineer.press("confirm_write_button")
    engineer.until(lambda: "Checking the output" in engineer.says())
    engineer.press("stop_button")
    engineer.until(lambda: "written but not verified" in engineer.says())
    engineer.until_ended()
    assert (engineer.run.state, engineer.run.stage) == ("idle", None)
    assert register_journal.interrupted(engineer.site_folder.runs, SERIAL) is not None
    engineer.press("read_registers_button")
    engineer.until(lambda: "NOT verified" in engineer.says())
    assert engineer.widget("write_registers_button", QPushButton).text() == "Verify or restore"
    engineer.press("write_registers_button")
    assert "Verify the new registers of unit SN-000042, or restore the old ones?" in engineer.says()
    assert engineer.widget("restore_registers_button", QPushButton).isVisible()
    for code, said in (("zh_CN", "“静止验证”和“恢复”不转动转台"), ("en", "“Verify at rest” and “Restore” do not move")):
        language.use(code)
        assert said in engineer.says()
    assert "before and after the write" not in engineer.says()
    engineer.press("confirm_at_rest_button")
    engineer.until(lambda: "Verified at rest" in engineer.says())
    engineer.until_ended()
    assert register_journal.interrupted(engineer.site_folder.runs, SERIAL) is None
    assert engineer.widget("write_registers_button", QPushButton).text() == "Write to the unit"


@pytest.mark.parametrize(("code", "said"), [("en", "old registers restored"), ("zh_CN", "已恢复原有寄存器")])
def test_restored_registers_are_not_shown_as_those_of_the_result(engineer: Engineer, code: str, said: str) -> None:
    row = {"value": 1e-4, "sigma": 1e-6, "unit": "1", "stage": "rate"}
    engineer.window.app.role.unlock("246813")
    view = engineer.page.registers
    view.show_run(finished_run({"gyro_scale_x": row}))
    engineer.until(lambda: view.target is not None)
    language.use(code)
    engineer.show_view(5)
    register = {"parameter": "gyro_scale_x", "address": 12, "value": 0.0, "raw": "0"}
    unit = {"serial": SERIAL, "model": "m", "firmware": "1", "registers": [register], "commits": 2, "virtual": True}
    view._operation = RegisterOperation(engineer.page._request(), "restore")
    view._show_end(Settled(SERIAL, "restored", "rest", unit))
    assert said in engineer.says()
    assert say("engineer.state_verified") not in engineer.says()
    assert say("engineer.verified_rest") in engineer.says()


def test_partial_run_shows_its_stages_and_when_registers_were_written(engineer: Engineer) -> None:
    row = {"value": 1e-4, "sigma": 1e-6, "unit": "1", "stage": "rate"}
    result = {
        "schema": "calstation.result/1",
        "unit": {"serial": SERIAL},
        "stages": ["rate", "six_position"],
        "partial": True,
        "parameters": {"gyro_scale_x": row, "gyro_scale_y": row},
        "unobservable": [],
        "checks": [],
        "outcome": "passed",
        "log": {"file": str(engineer.site_folder.runs / "gone.h5")},
        "registers": {
            "old": {"gyro_scale_x": 5e-4, "gyro_scale_y": 0.0},
            "new": {"gyro_scale_x": 5e-4, "gyro_scale_y": 1e-4},
            "verified": True,
            "written_utc": "2026-11-21T15:04:00+00:00",
        },
    }
    path = engineer.site_folder.folder / "x.json"
    path.write_text(json.dumps(result), encoding="utf-8")
    engineer.page.analysis.open(path)
    engineer.until(lambda: bool(engineer.cells("register_table")))
    assert f"{SERIAL}  ·  PARTIAL: Rate, Six positions" in engineer.says()
    assert "PASS" not in engineer.says()
    assert "registers written 2026-11-21" in engineer.says()
    rows = engineer.cells("register_table")
    assert (rows["gyro_scale_x"]["In the unit"], rows["gyro_scale_x"]["New"]) == ("500.0000", "500.0000")
    assert (rows["gyro_scale_y"]["In the unit"], rows["gyro_scale_y"]["Change"]) == ("100.0000", "0")
    engineer.show_view(5)
    assert "Registers written 2026-11-21" in engineer.says()
    assert "written by the run" in engineer.says()
    record_transfer(engineer, "run", "gone.h5", result["registers"]["new"])
    record_transfer(engineer, "hand", "older.h5", {"gyro_scale_x": 0.0, "gyro_scale_y": 0.0})
    engineer.page.analysis.open(path)
    engineer.until(lambda: "no longer in the unit" in engineer.says())
    assert "replaced by other values 20" in engineer.says()
    assert "In the unit" not in engineer.cells("register_table")["gyro_scale_x"]
    engineer.show_view(1)
    assert "replaced by other values 20" in engineer.says()


@pytest.mark.parametrize(
    ("code", "stated", "refused"),
    [
        ("en", "replaced by other values 20", "The result is of a unit of product"),
        ("zh_CN", "被其他数值替换，尚未验证", "该结果的产品型号是"),
    ],
)
def test_registers_replaced_by_other_values_are_stated_also_while_another_product_is_selected(
    engineer: Engineer, code: str, stated: str, refused: str
) -> None:
    row = {"value": 1e-4, "sigma": 1e-6, "unit": "1", "stage": "rate"}
    values = {"old": {"gyro_scale_x": 0.0}, "new": {"gyro_scale_x": 1e-4}, "verified": True}
    log = str(engineer.site_folder.runs / "passed.h5")
    run = finished_run({"gyro_scale_x": row}, log={"file": log}, registers=values, product="other")
    record_transfer(engineer, "run", "passed.h5", values["new"])
    record_transfer(engineer, "run", "stopped.h5", {"gyro_scale_x": 2e-4}, None)
    path = engineer.site_folder.folder / "x.json"
    path.write_text(json.dumps(run.result.to_json()), encoding="utf-8")
    language.use(code)
    engineer.page.analysis.open(path)
    engineer.show_view(5)
    engineer.until(lambda: say("engineer.state_replaced") in engineer.says(), 15.0)
    assert stated in engineer.says()
    assert engineer.says().count(refused) == 1
    assert say("engineer.state_failed") not in engineer.says()


def record_transfer(
    engineer: Engineer,
    why: str,
    source: str,
    new: Mapping[str, float],
    closing: TransferOutcome | None = TransferOutcome.DONE,
) -> None:
    """Record a transfer to the unit in its journal; None leaves it open."""
    purpose = register_journal.Purpose("wang", why, source)
    made = register_journal.begin(engineer.site_folder.runs, SERIAL, {}, new, purpose)
    made.note(TransferStep.COMMITTING)
    if closing is not None:
        made.close(closing)


@pytest.mark.parametrize(("code", "stated"), [("en", "registers written, NOT verified"), ("zh_CN", "尚未验证")])
def test_registers_left_unverified_by_a_stop_are_stated_until_they_are_verified(
    engineer: Engineer, code: str, stated: str
) -> None:
    row = {"value": 1e-4, "sigma": 1e-6, "unit": "1", "stage": "rate"}
    values = {"old": {"gyro_scale_x": 0.0}, "new": {"gyro_scale_x": 1e-4}}
    log = str(engineer.site_folder.runs / "stopped.h5")
    run = finished_run({"gyro_scale_x": row}, outcome="stopped", log={"file": log}, registers=values)
    record_transfer(engineer, "run", "stopped.h5", values["new"], None)
    path = engineer.site_folder.folder / "x.json"
    path.write_text(json.dumps(run.result.to_json()), encoding="utf-8")
    language.use(code)
    engineer.page.analysis.open(path)
    engineer.until(lambda: bool(engineer.cells("register_table")))
    assert stated in engineer.says()
    engineer.show_view(5)
    assert stated[1:] in engineer.says()
    assert say("engineer.state_unverified") in engineer.says()
    assert say("engineer.old") in engineer.cells("register_table")["gyro_scale_x"]


@pytest.mark.parametrize(
    ("why", "question"),
    [
        ("run", "Unit SN-000042 contains the registers of a later run, 20"),
        ("hand", "The registers of unit SN-000042 were written after this run, 20"),
    ],
)
def test_question_says_that_older_registers_would_replace_later_ones(
    engineer: Engineer, why: str, question: str
) -> None:
    record_transfer(engineer, why, "later.h5", {"gyro_bias_x": 2e-6})
    ask_to_write(engineer, of={"started_utc": "2020-01-02T03:04:05+00:00"})
    assert question in engineer.says()
    assert "Write 1 register of unit SN-000042?" in engineer.says()


def test_guard_band_shows_acceptance_limits_and_risk_of_wrong_decisions(engineer: Engineer) -> None:
    row = {"value": 9.5e-4, "sigma": 5e-5, "unit": "1", "stage": "rate"}
    limits, accepted = [-1e-3, 1e-3], [-9e-4, 9e-4]
    decision = {"accepted": False, "limits": limits, "acceptance": accepted, "outside": 0.159, "probability": 0.841}
    result = finished_run(
        {"gyro_scale_x": row},
        outcome="failed",
        checks=[check_row("within", "gyro_scale_x", 9.5e-4, limits, passed=False, unit="1", acceptance=accepted)],
        conformity={
            "rule": "guard_band",
            "parameters": {"gyro_scale_x": {**decision, "false_accept": 0.002, "false_reject": 0.05}},
        },
    )
    for name, shown in (("plain", finished_run({"gyro_scale_x": row})), ("guarded", result)):
        path = engineer.site_folder.folder / f"{name}.json"
        path.write_text(json.dumps(shown.result.to_json()), encoding="utf-8")
        engineer.page.analysis.open(path)
        engineer.until(lambda: not engineer.page.analysis.loading.busy)
        engineer.show_view(1)
        table = engineer.widget("result_table", QTableView)
        assert table.isColumnHidden(5) == (name == "plain")
    cells = engineer.cells("result_table")["gyro_scale_x"]
    assert (cells["Value limit"], cells["Acceptance limit"]) == ("±1000", "±900")
    assert "decision rule: guard band of 2 σ" in engineer.says()
    index = table.model().index(0, 7)
    hint = table.model().data(index, Qt.ItemDataRole.ToolTipRole)
    assert "the true value is within the limits with a probability of 84 %" in hint
    assert "0.2 % are accepted although outside the limits, 5 % refused although within" in hint


@pytest.mark.parametrize(("outcome", "counted"), [("fault", False), ("passed", True)])
def test_run_that_ended_in_a_fault_does_not_count_its_passed_checks(
    engineer: Engineer, outcome: str, counted: bool
) -> None:
    row = {"value": 1e-4, "sigma": 5e-5, "unit": "1", "stage": "rate"}
    check = check_row("within", "gyro_scale_x", 1e-4, [-1e-3, 1e-3], passed=True, unit="1")
    path = engineer.site_folder.folder / "ended.json"
    ended = finished_run({"gyro_scale_x": row}, outcome=outcome, checks=[check])
    path.write_text(json.dumps(ended.result.to_json()), encoding="utf-8")
    engineer.page.analysis.open(path)
    engineer.until(lambda: not engineer.page.analysis.loading.busy)
    engineer.show_view(1)
    assert ("1 of 1 check passed" in engineer.says()) == counted


def test_schedule_beyond_the_travel_is_explained_in_both_languages(qapp: QApplication) -> None:
    refusal = Text.of("plan.turns_exceed_travel", turns=7, needed_deg=2520, axis="outer", travel_deg=2160.0)
    assert say(refusal).endswith("Lower turns in the schedule of rate.")
    language.use("zh_CN")
    try:
        assert say(refusal).startswith("转 7 整圈需要外框 2520° 的行程，实际只有 2160°。")
    finally:
        language.use("en")


@pytest.mark.parametrize("title", ["SN-000001  ·  PARTIAL  ·  STARTING", "SN-000001  ·  部分标定  ·  正在连接和自检"])
def test_status_that_does_not_fit_into_the_strip_ends_with_an_ellipsis(
    app: AppContext, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch, title: str
) -> None:
    monkeypatch.setattr(run_strip, "run_title", lambda _: title)
    strip = run_strip.RunStrip(app.run)
    qtbot.addWidget(strip)
    strip.resize(240, 64)
    strip.show()
    (word,) = [label for label in strip.findChildren(ElidedLabel) if label.text() == title]
    assert word.mapTo(strip, word.rect().topRight()).x() < strip.width()
    assert word.shortened().endswith("…")
    assert word.toolTip()
    strip.resize(800, 64)
    assert word.shortened() == title
