"""A run over temperature in the window: temperatures, what a soak waits for, and the chamber that must stay closed."""

from dataclasses import replace

import pytest
from PySide6.QtWidgets import QApplication, QComboBox, QPushButton

from calstation.config import RegisterOperation, RunRequest, access, library
from calstation.errors import DeviceFaultError
from calstation.gui.engineer.page import EngineerPage
from calstation.gui.operator.live import TemperaturePanel
from calstation.gui.operator.loading import Loading
from calstation.gui.state import ChamberNotice, RunStrip, run_badge
from calstation.gui.state.engine_link import EngineLink
from calstation.gui.state.unit_status import TRANSFER
from calstation.messages import Text
from calstation.records import Verdict
from calstation.runs import run_summary
from calstation.sequencer import (
    DURATION,
    ChamberChanged,
    Event,
    Fault,
    Finalized,
    Message,
    StageProgress,
    StageStarted,
    StateChanged,
    StepStarted,
)
from tests.gui.conftest import RESULT, SERIAL, Operator
from tests.gui.test_suitable_products import entry

#: A unit in the air at the set point, which still changes by 0.3 K/min.
SOAK = ChamberChanged(600.0, -39.6, -40.0, -40.0, 750.0, {"": -21.3}, {"": -0.3}, 0.05, (15.0, 43.0))
RETURNING = {"air_c": -12.0, "unit_c": -30.0, "ambient_c": 23.0}


class ThermalRun:
    """A run over temperature that consists of emitted events."""

    def __init__(self, operator: Operator, monkeypatch: pytest.MonkeyPatch, serials: tuple[str, ...] = ()) -> None:
        self.operator, self.app = operator, operator.window.app
        self._patch = monkeypatch
        self.app.set_station(library.find("stations", "virtual_chamber"))
        self.app.set_product(library.find("products", "mems_c_thermal"))
        link = self.app.engine_link
        link.request = RunRequest(SERIAL, self.app.station_path, self.app.product_path)
        self.set_running(running=True)
        self.emit(StateChanged("running", "preparing"), StageStarted("temperature", 0, 1, 20000.0))

    def emit(self, *events: Event) -> None:
        for event in events:
            self.app.engine_link.event.emit(event)

    def set_running(self, *, running: bool) -> None:
        self._patch.setattr(EngineLink, "running", running)
        self.app.engine_link.running_changed.emit(running)

    @property
    def panel(self) -> TemperaturePanel:
        return self.operator.window.operator_page._live.temperature

    @property
    def notice(self) -> ChamberNotice:
        notice: ChamberNotice = self.operator.widget("operator_page_chamber_notice", ChamberNotice)
        return notice


@pytest.fixture
def thermal(operator: Operator, monkeypatch: pytest.MonkeyPatch) -> ThermalRun:
    """An operator at a station with a chamber, in the stage temperature."""
    return ThermalRun(operator, monkeypatch)


@pytest.mark.parametrize("code", ["en", "zh_CN"])
def test_time_axis_of_a_narrow_temperature_panel_is_not_cut(thermal: ThermalRun, code: str) -> None:
    thermal.operator.window.app.set_language(code)
    thermal.emit(StepStarted("temperature", 1, "soak", ("soak", -40.0, 1.0, 7.0)))
    thermal.emit(SOAK)
    thermal.panel.setFixedWidth(427)  # in a window of 1280 x 720
    thermal.panel.refresh()
    QApplication.processEvents()
    axis = thermal.panel._plot.getAxis("bottom")
    text = axis.label.boundingRect().width() - 2 * axis.label.document().documentMargin()
    assert text <= axis.boundingRect().width()


@pytest.mark.long
def test_soak_shows_temperatures_its_reason_and_the_curves(thermal: ThermalRun) -> None:
    assert not thermal.panel.isVisible()
    thermal.emit(StepStarted("temperature", 1, "soak", ("soak", -40.0, 1.0, 7.0)))
    thermal.emit(replace(SOAK, time=0.0, air_c=20.0, rates={}))
    assert thermal.panel.words.text() == "Going to −40 °C; the air is at 20.0 °C"
    thermal.emit(SOAK)
    thermal.panel.refresh()
    assert thermal.panel.isVisible()
    assert thermal.panel.words.text() == "Soaking at −40 °C: the unit changes by 0.30 °C/min, limit 0.05 °C/min"
    assert [value.text() for value in thermal.panel.values[:4]] == ["−39.6 °C", "−40.0 °C", "−21.3 °C", "−0.30 °C/min"]
    times, air = thermal.panel._air.getData()
    assert times.tolist() == [0.0, 10.0]
    assert air.tolist() == [20.0, -39.6]
    assert thermal.panel._units[""].getData()[1].tolist() == [-21.3, -21.3]
    thermal.emit(replace(SOAK, rates={"": 0.02}))
    thermal.panel.refresh()
    assert "within the limit of 0.05 °C/min" in thermal.panel.words.text()
    thermal.operator.widget("language_combo", QComboBox).setCurrentIndex(1)
    assert thermal.panel.words.text().startswith("在 −40 °C 保温：产品变化率 0.02 °C/min")
    thermal.emit(replace(SOAK, limit=None, rates={}))
    thermal.panel.refresh()
    assert thermal.panel.words.text() == "正处于 −40 °C"


@pytest.mark.long
def test_time_left_is_that_of_the_soak_at_the_pace_of_the_station(
    thermal: ThermalRun, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(type(thermal.app.run), "pace", 10.0)
    thermal.emit(SOAK)
    thermal.panel.refresh()
    assert thermal.panel.values[4].text() == "1:15"


@pytest.mark.long
def test_time_left_of_the_transfer_contains_its_soak(thermal: ThermalRun) -> None:
    run = thermal.app.run
    row = next(stage for stage in run.stages if stage.name == TRANSFER)
    assert row.duration > 300.0, "the plan contains the soak"
    thermal.emit(StageProgress("temperature", 1.0, 0.0), Message("registers_reading"))
    thermal.emit(StepStarted("", 1, "soak_to_verify", ("soak_to_verify", 23.0)))
    thermal.emit(replace(SOAK, time=1000.0, remaining=300.0), replace(SOAK, time=1100.0, remaining=200.0))
    assert run.stage_remaining(row) == pytest.approx(200.0 + DURATION)
    assert row.fraction == pytest.approx(100.0 / 345.0)
    thermal.emit(Message("soaked", {"temperature": 23.0, "minutes": 2.0}), Message("verifying"))
    assert run.stage_remaining(row) == pytest.approx(DURATION)
    for step in range(18):
        thermal.emit(StepStarted("", step, "move", ("verify", 1.0)))
    assert run.stage_remaining(row) == pytest.approx(0.0)


@pytest.mark.long
@pytest.mark.parametrize(("language", "name"), [("en", "Time left here"), ("zh_CN", "本步剩余时间")])
def test_return_of_the_chamber_shows_its_time_left(
    thermal: ThermalRun, monkeypatch: pytest.MonkeyPatch, language: str, name: str
) -> None:
    monkeypatch.setattr(type(thermal.app.run), "pace", 1.0)
    thermal.app.set_language(language)
    thermal.emit(SOAK, Message("chamber_to_ambient", RETURNING))
    thermal.emit(replace(SOAK, limit=None, rates={}, target_c=23.0, remaining=600.0))
    thermal.panel.refresh()
    assert (thermal.panel._names[4].text(), thermal.panel.values[4].text()) == (name, "10:00")


@pytest.mark.long
def test_progress_follows_the_duration_that_is_expected_now(thermal: ThermalRun) -> None:
    run = thermal.app.run
    stage = next(stage for stage in run.stages if stage.name == "temperature")
    thermal.emit(StageProgress("temperature", 0.0021, 17719.0))
    assert run.elapsed == pytest.approx(0.0021 * 17719.0 / 0.9979)
    assert run.fraction == pytest.approx(run.elapsed / sum(each.duration for each in run.stages))
    before = run.elapsed
    thermal.emit(StageProgress("temperature", 0.004, 16500.0))
    assert before < run.elapsed < 100.0
    assert run.stage_remaining(stage) == 16500.0


@pytest.mark.long
def test_window_names_the_chamber_when_it_closes(thermal: ThermalRun) -> None:
    operator, window = thermal.operator, thermal.operator.window
    thermal.emit(SOAK)
    for language, text in (
        ("en", "The chamber, at −39.6 °C, must stay closed until it is back at the temperature of the room."),
        ("zh_CN", "温箱现为 −39.6 °C，回到室温之前请勿打开。"),
    ):
        thermal.app.set_language(language)
        window.close()
        assert text in operator.says()
    thermal.app.set_language("en")
    operator.press("close_choice")
    thermal.emit(StateChanged("stopping", "running"), Message("chamber_to_ambient", RETURNING))
    assert "This window closes by itself once the chamber is back at the temperature of the room" in operator.says()
    assert operator.widget("close_now_choice", QPushButton).text() == "Close without waiting"
    thermal.emit(replace(SOAK, limit=None, rates={}, air_c=30.0, units={"": 24.0}, target_c=23.0))
    operator.until(
        lambda: "Wait until the air is at the temperature of the room (23 °C, now 30.0 °C)" in operator.says()
    )
    thermal.app.set_language("zh_CN")
    assert "请等空气回到室温（23 °C，现为 30.0 °C）" in operator.says()
    thermal.emit(Message("chamber_unknown", RETURNING))
    thermal.emit(Finalized(Verdict.STOPPED, "log.h5", "result.json", {**RESULT, "outcome": "stopped"}))
    thermal.set_running(running=False)
    assert window.isVisible(), "nothing else says that the temperature of the chamber is not known"
    operator.press("operator_page_chamber_notice_close")
    window.close()
    assert not window.isVisible()


@pytest.mark.long
@pytest.mark.parametrize(
    ("language", "titles", "chamber", "unverified"),
    [
        (
            "en",
            ("A calibration is in progress", "Registers are being written", "The new registers are being verified"),
            "The chamber, at 30.0 °C, must stay closed",
            "the new registers then stay unverified",
        ),
        (
            "zh_CN",
            ("正在标定", "正在写寄存器", "正在验证新寄存器"),
            "温箱现为 30.0 °C，回到室温之前请勿打开",
            "新寄存器将未经验证",
        ),
    ],
)
def test_close_question_in_the_transfer_names_the_chamber_and_what_is_lost(
    thermal: ThermalRun, language: str, titles: tuple[str, ...], chamber: str, unverified: str
) -> None:
    closing, window = thermal.operator.window.operator_page.closing, thermal.operator.window
    thermal.app.set_language(language)
    thermal.emit(replace(SOAK, air_c=34.0), Message("registers_reading"))
    thermal.emit(StepStarted("", 1, "soak_to_verify", ("soak_to_verify", 23.0)), Message("reference"))
    window.close()
    for title, message in zip(titles, ("", "registers_transfer", "verifying"), strict=True):
        thermal.emit(*([Message(message)] if message else []), replace(SOAK, air_c=30.0))
        thermal.operator.until(lambda title=title: closing.title_label.text() == title)
        assert chamber in closing.text_label.text()
        assert (unverified in closing.text_label.text()) is bool(message)


@pytest.mark.long
@pytest.mark.parametrize(
    ("language", "returns", "cold", "ends"),
    [
        ("en", "The chamber returns to the temperature of the room", "at 18.0 °C", "The calibration is ending"),
        ("zh_CN", "温箱正在回到室温", "温箱现为 18.0 °C", "标定正在结束"),
    ],
)
def test_close_question_follows_the_chamber_until_it_may_be_opened(
    thermal: ThermalRun, language: str, returns: str, cold: str, ends: str
) -> None:
    closing = thermal.operator.window.operator_page.closing
    thermal.app.set_language(language)
    thermal.emit(SOAK)
    thermal.operator.press("stop_button")
    thermal.emit(StateChanged("stopping", "running"), Message("chamber_to_ambient", RETURNING))
    thermal.emit(StateChanged("stopped", "stopping"))
    thermal.operator.window.close()
    assert closing.title_label.text() == returns
    thermal.emit(replace(SOAK, limit=None, rates={}, air_c=18.0, target_c=23.0))
    assert cold in closing.text_label.text()
    thermal.emit(Message("chamber_may_be_opened", RETURNING))
    thermal.operator.until(lambda: closing.title_label.text() == ends)
    assert "18.0" not in closing.text_label.text()
    thermal.set_running(running=False)
    assert not closing.isVisible()


def test_run_at_one_temperature_shows_no_chamber(operator: Operator, monkeypatch: pytest.MonkeyPatch) -> None:
    link = operator.window.app.engine_link
    link.request = RunRequest(SERIAL, operator.window.app.station_path, operator.window.app.product_path)
    monkeypatch.setattr(EngineLink, "running", True)
    link.running_changed.emit(True)
    link.event.emit(StateChanged("running", "preparing"))
    link.event.emit(StateChanged("stopping", "running"))
    assert not operator.window.operator_page._live.temperature.isVisible()
    monkeypatch.setattr(EngineLink, "running", False)
    link.running_changed.emit(False)
    assert operator.run.chamber.access == ""
    assert not operator.widget("operator_page_chamber_notice").isVisible()


@pytest.mark.long
def test_chamber_must_stay_closed_after_stop_until_it_may_be_opened(thermal: ThermalRun) -> None:
    operator = thermal.operator
    thermal.emit(SOAK)
    assert not thermal.notice.isVisible()
    operator.press("stop_button")
    thermal.emit(StateChanged("stopping", "running"), Message("chamber_to_ambient", RETURNING))
    thermal.emit(replace(SOAK, limit=None, rates={}, air_c=-20.0, units={"": -12.0}, target_c=23.0))
    operator.until(thermal.notice.isVisible)
    assert thermal.notice.title_label.text() == "Keep the chamber closed"
    cold = "Air at −20.0 °C, 35.0 °C below the dew point of the room (15 °C)"
    assert thermal.notice.text_label.text() == cold
    assert not thermal.notice.asking, "it cannot be closed"
    assert run_badge(operator.run) == ("caution", "KEEP CHAMBER CLOSED  ·  STOPPING")
    assert cold in operator.message
    operator.window.show_page("history_page")
    strip = next(strip for strip in operator.window.findChildren(RunStrip) if strip.isVisible())
    assert strip._badge.text() == "KEEP CHAMBER CLOSED  ·  STOPPING"
    assert cold in strip._text.text()
    for page in ("engineer_page", "station_page"):
        operator.window.show_page(page)
        notice = operator.widget(f"{page}_chamber_notice", ChamberNotice)
        assert notice.isVisible()
        assert notice.text_label.text() == cold
    operator.window.show_page("operator_page")
    operator.window.app.set_language("zh_CN")
    assert thermal.notice.title_label.text() == "请勿打开温箱"
    assert "比室内露点（15 °C）低 35.0 °C" in thermal.notice.text_label.text()
    thermal.emit(Message("chamber_may_be_opened", {**RETURNING, "air_c": 23.0, "unit_c": 20.0}))
    operator.until(lambda: thermal.notice.title_label.text() == "可以打开温箱")
    thermal.emit(StateChanged("stopped", "stopping"))
    thermal.emit(Finalized(Verdict.STOPPED, "log.h5", "result.json", {**RESULT, "outcome": "stopped"}))
    thermal.set_running(running=False)
    operator.until(lambda: run_badge(operator.run) == ("stopped", "已停止"))
    operator.press("operator_page_chamber_notice_close")
    operator.until(lambda: not thermal.notice.isVisible())


@pytest.mark.long
def test_chamber_must_stay_closed_after_its_fault_was_read(thermal: ThermalRun) -> None:
    operator = thermal.operator
    thermal.emit(replace(SOAK, air_c=80.0, units={"": 70.0}), Message("chamber_to_ambient", RETURNING))
    thermal.emit(StateChanged("fault", "running"), Fault.of(DeviceFaultError("chamber.door_open", air_c=80.0)))
    operator.until(thermal.notice.isVisible)
    operator.press("acknowledge_button")
    operator.until(lambda: operator.run.fault is None)
    assert thermal.app.engine_link.running, "the chamber is still watched"
    assert thermal.panel.isVisible()
    assert "Air at 80.0 °C, 37.0 °C too hot to touch (limit 43 °C)" in operator.says()
    assert run_badge(operator.run) == ("caution", "KEEP CHAMBER CLOSED")
    start = operator.widget("start_button", QPushButton)
    assert not start.isEnabled()
    assert start.toolTip() == "Keep the chamber closed; a run can start once it may be opened."
    thermal.emit(replace(SOAK, door_open=True))
    operator.until(lambda: "Its door is open: close it at once." in operator.says())
    thermal.emit(Message("chamber_may_be_opened", {**RETURNING, "air_c": 23.0, "unit_c": 30.0}))
    thermal.emit(Finalized(Verdict.FAULT, "log.h5", "result.json", {**RESULT, "outcome": "fault"}))
    thermal.set_running(running=False)
    operator.until(lambda: thermal.notice.title_label.text() == "The chamber may be opened")
    assert operator.run.state == "idle"


def shown_buttons(operator: Operator) -> list[str]:
    """Return the texts of the buttons that acknowledge a fault or a notice about the chamber."""
    names = "acknowledge_button", "operator_page_chamber_notice_close"
    return [button.text() for name in names if (button := operator.widget(name, QPushButton)).isVisible()]


@pytest.mark.usefixtures("engineer_page")
@pytest.mark.long
def test_engine_that_dies_leaves_the_chamber_unknown(thermal: ThermalRun) -> None:
    access.set_pin("", "246813")
    thermal.app.role.unlock("246813")
    thermal.emit(SOAK, StageProgress("temperature", 0.1, 100.0))
    thermal.emit(Fault.of(DeviceFaultError("run.engine_ended", exit_code=-9, then=Text("run.then_again"))))
    thermal.set_running(running=False)
    thermal.operator.until(thermal.notice.isVisible)
    assert thermal.notice.title_label.text() == "Keep the chamber closed: its temperature is not known"
    assert "look at its display before you open it" in thermal.notice.text_label.text()
    assert shown_buttons(thermal.operator) == ["Understood", "I looked at the chamber"]
    thermal.app.set_language("zh_CN")
    assert shown_buttons(thermal.operator) == ["知道了", "已查看温箱"]
    thermal.operator.press("acknowledge_button")
    assert thermal.notice.isVisible(), "it is not part of the fault"
    page, start = thermal.operator.window.operator_page, thermal.operator.widget("start_button", QPushButton)
    for language, why in (
        ("en", "Look at the chamber, then press “I looked at the chamber”."),
        ("zh_CN", "请先查看温箱，再按“已查看温箱”。"),
    ):
        thermal.app.set_language(language)
        assert page._views.currentWidget() is page._hindrance, "no unit is loaded yet"
        assert not start.isEnabled()
        assert start.toolTip() == why
        assert not thermal.operator.widget("engineer_start_button", QPushButton).isEnabled()
        assert thermal.operator.widget("engineer_start_button", QPushButton).toolTip() == why
        assert thermal.operator.widget("write_registers_button", QPushButton).toolTip() == why
    thermal.app.set_language("en")
    registers = thermal.operator.window.findChild(EngineerPage).registers
    registers._start(RegisterOperation(RunRequest("SN-1"), "restore"))  # would remove the notice about the chamber
    assert "I looked at the chamber" in registers._about.text()
    assert not thermal.app.engine_link.running
    page._starting.start()
    assert not thermal.app.engine_link.running
    thermal.operator.press("operator_page_chamber_notice_close")
    assert page._views.currentWidget() is page._loading
    assert start.isEnabled()
    assert "chamber" not in thermal.operator.widget("engineer_start_button", QPushButton).toolTip()
    thermal.operator.until(lambda: not thermal.notice.isVisible())
    assert run_badge(thermal.operator.run)[0] != "caution"


@pytest.mark.long
@pytest.mark.parametrize(
    ("code", "action", "after"),
    [
        ("en", "Look at the chamber, then press “I looked at the chamber”.", "Scan the unit to begin again."),
        ("zh_CN", "请先查看温箱，再按“已查看温箱”。", "扫描这台产品，从头再来。"),
    ],
)
def test_verdict_asks_for_nothing_else_before_the_chamber_was_looked_at(
    thermal: ThermalRun, code: str, action: str, after: str
) -> None:
    thermal.app.set_language(code)
    thermal.emit(SOAK)
    thermal.operator.press("stop_button")
    thermal.emit(StateChanged("stopping", "running"), Message("chamber_to_ambient", RETURNING))
    thermal.emit(Message("chamber_unknown", RETURNING), StateChanged("stopped", "stopping"))
    thermal.emit(Finalized(Verdict.STOPPED, "log.h5", "result.json", {**RESULT, "outcome": "stopped"}))
    thermal.set_running(running=False)
    label = thermal.operator.window.operator_page._verdict.action_label
    thermal.operator.until(lambda: label.text() == action)
    thermal.operator.press("operator_page_chamber_notice_close")
    thermal.operator.until(lambda: label.text() == after)


def test_loading_ends_with_the_closed_chamber(operator: Operator) -> None:
    loading, summary = (
        Loading(),
        run_summary(
            RunRequest("-", library.find("stations", "virtual_chamber"), library.find("products", "mems_c_thermal"))
        ),
    )
    operator.qtbot.addWidget(loading)
    loading.set_next_run(summary)
    assert loading._texts[2].text() == "A calibration over temperature takes several minutes here."
    loading.set_next_run(replace(summary, bench=None))
    assert loading._titles[3].text() == "Close the chamber, then press START"
    operator.window.app.set_language("zh_CN")
    assert loading._titles[3].text() == "关好温箱，再按“开始”按钮"
    loading.set_next_run(replace(summary, bench=None, stages=()))
    assert "温箱" not in loading._titles[3].text()


@pytest.mark.parametrize(
    ("code", "only", "any_other"),
    [("en", "It is the only unit of this station", "is another unit"), ("zh_CN", "只有这一台产品", "另一台产品")],
)
def test_loading_names_the_only_unit_of_a_virtual_bench(
    operator: Operator, code: str, only: str, any_other: str
) -> None:
    operator.window.app.set_language(code)
    operator.window.app.set_station(library.find("stations", "virtual_gimbal"))
    operator.window.app.set_product(library.find("products", "mems_gimbal"))
    loading = operator.window.operator_page._loading
    assert "SN-GIMBAL-1" in loading._titles[1].text()
    assert only in loading._texts[1].text()
    operator.window.app.set_station(library.find("stations", "virtual_bench"))
    operator.window.app.set_product(library.find("products", "nav_a"))
    assert any_other in loading._texts[1].text()
    assert only not in loading._texts[1].text()


def test_product_over_temperature_is_greyed_where_there_is_no_chamber(operator: Operator) -> None:
    text, enabled, tip = entry(operator, "mems_c_thermal")
    assert "(needs a chamber)" in text
    assert not enabled
    assert "the station has none" in tip
    operator.window.app.set_language("zh_CN")
    assert "需要温箱" in entry(operator, "mems_c_thermal")[0]
    operator.window.app.set_product(library.find("products", "mems_c_thermal"))
    assert not operator.widget("start_button", QPushButton).isEnabled()
    operator.window.app.set_station(library.find("stations", "virtual_chamber"))
    assert entry(operator, "mems_c_thermal")[1]
