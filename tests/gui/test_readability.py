"""The window can be read from two metres: it grows with the screen, and STOP and FAIL are red in both themes."""

import re
import tomllib
from types import SimpleNamespace

import pytest
from PySide6.QtCore import QPoint
from PySide6.QtGui import QColor
from PySide6.QtWidgets import QLabel, QListWidget, QPushButton, QWidget

from calstation.config import library
from calstation.connection.table_reset import TableReset
from calstation.gui.operator import advice
from calstation.gui.operator.page import OperatorPage
from calstation.gui.start import enlargement
from calstation.gui.state import RunStrip
from calstation.gui.text import language, product_text, say, station_text
from calstation.gui.widgets import Choice, PageArea, lay_out, theme
from calstation.messages import Text, render
from calstation.physics import DEGREE_PER_HOUR, INDEX, PARAMETERS
from calstation.records import Verdict
from calstation.sequencer import Fault, Finalized, StageProgress, StageStarted, StateChanged
from tests.check_rows import check_row
from tests.gui.conftest import RESULT, Operator
from tests.gui.test_operator_events import end_run, simulated_run

__all__ = ["simulated_run"]  # fixture
LIMIT = 3.0 * DEGREE_PER_HOUR
FAILED = {
    "checks": [check_row("within", "gyro_bias_x", 5 / 3 * LIMIT, [-LIMIT, LIMIT], passed=False, unit="rad/s")],
    "parameters": {"gyro_bias_x": {"value": 5 / 3 * LIMIT, "sigma": 1e-8, "unit": "rad/s", "stage": "rate"}},
    "passed": False,
}


def text_size(widget: QWidget) -> int:
    return widget.font().pixelSize()


@pytest.mark.parametrize(
    ("screen", "factor"),
    [((1280, 720), 1.0), ((1366, 768), 1.0), ((1920, 1080), 1.4), ((3440, 1440), 1.87), ((3840, 2160), 2.5)],
)
def test_window_grows_with_the_screen(screen: tuple[int, int], factor: float) -> None:
    assert enlargement(screen) == factor


@pytest.mark.long
def test_texts_keep_their_sizes_after_a_change_of_the_theme_and_after_a_run(simulated_run: Operator) -> None:
    page, stages = simulated_run.window.findChild(OperatorPage), simulated_run.widget("stage_list", QListWidget)

    def sizes() -> list[int]:
        row = stages.itemWidget(stages.item(0)).findChildren(QLabel)
        return [*map(text_size, (*row, *page._loading._titles, page._message, page._live.table.badge._word))]

    before = sizes()
    assert theme.SECTION in before
    for name in ("dark", "light"):
        simulated_run.window.app.set_theme(name)
        assert sizes() == before
    end_run(simulated_run, "failed", **FAILED)
    assert sizes() == before


def test_verdict_uses_its_space(simulated_run: Operator) -> None:
    end_run(simulated_run, "failed", **FAILED)
    panel = simulated_run.window.findChild(OperatorPage)._verdict
    heights = {}
    for size in ((902, 490), (1390, 830)):
        panel.setFixedSize(*size)
        panel.layout().activate()
        simulated_run.qtbot.wait(20)
        panel.layout().activate()
        lowest = max(
            child.mapTo(panel, child.rect().bottomLeft()).y()
            for child in panel.findChildren(QWidget)
            if child.isVisibleTo(panel)
        )
        assert lowest > 0.93 * panel.height()  # nothing is empty below
        heights[size] = panel._banner.height(), text_size(panel.reason_label)
    (small_banner, small_text), (large_banner, large_text) = heights.values()
    assert large_banner > 1.4 * small_banner > 250
    assert large_text > 1.5 * small_text


@pytest.mark.long
@pytest.mark.parametrize("code", ["en", "zh_CN"])
@pytest.mark.parametrize("size", [(1264, 672), (1366, 732)])
def test_verdict_with_many_figures_needs_no_scroll_bar(
    simulated_run: Operator, size: tuple[int, int], code: str
) -> None:
    window = simulated_run.window
    window.app.set_language(code)
    window.resize(*size)
    names = {parameter.group: name for parameter, name in zip(PARAMETERS, INDEX, strict=True)}.values()
    rows = {name: {"value": 1.2e-5, "sigma": 1e-8, "unit": "1", "stage": "rate"} for name in names}
    checks = [{**check_row("within", name, 1.2e-5, [-1.4e-5, 1.4e-5], passed=True), "near_miss": True} for name in rows]
    end_run(simulated_run, "passed", parameters=rows, checks=checks, passed=True)
    panel = window.operator_page._verdict
    panel.label_button.show()
    panel.acknowledge_button.show()
    simulated_run.qtbot.wait(50)
    assert len(advice.figures(simulated_run.run.unit.result)) == 9
    area = next(each for each in window.operator_page.findChildren(PageArea) if each.isAncestorOf(panel))
    assert not area.horizontalScrollBar().isVisible()
    assert not area.verticalScrollBar().isVisible()
    assert text_size(panel.reason_label) >= theme.BODY


@pytest.mark.long
@pytest.mark.parametrize("code", ["en", "zh_CN"])
def test_strip_shows_stage_and_time_left_in_a_small_window(
    simulated_run: Operator, code: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    window, now = simulated_run.window, [1000.0]
    monkeypatch.setattr("calstation.gui.state.run_status.time", SimpleNamespace(monotonic=lambda: now[0]))
    window.app.set_language(code)
    window.resize(1280, 720)
    window.show_page("engineer_page")
    event = window.app.engine_link.event
    event.emit(StateChanged("running", "preparing"))
    event.emit(StageStarted("excitation", 1, 4, 100.0))
    now[0] += 5.0
    event.emit(StageProgress("excitation", 0.4, 60.0, {}))
    strip = next(each for each in window.findChildren(RunStrip) if each.isVisible())
    simulated_run.qtbot.wait(20)
    for text in (strip._text, strip._badge._word):
        assert text.isVisible()
        assert text.text()
        assert text.width() >= text.fontMetrics().horizontalAdvance(text.text()), text.text()
        assert text.height() >= text.fontMetrics().height()
    assert "40 %" in strip._text.text()
    left = {"en": "left", "zh_CN": "剩余"}[code]
    assert left in strip._text.text()


def fits(text: QLabel) -> bool:
    """Return whether a label has the size of its text."""
    height = text.heightForWidth(text.width()) if text.wordWrap() else text.sizeHint().height()
    return text.height() >= height and (text.wordWrap() or text.width() >= text.sizeHint().width())


@pytest.mark.parametrize("size", [(1366, 768), (1280, 720)])
@pytest.mark.parametrize("code", ["en", "zh_CN"])
def test_texts_fit_in_the_first_frame_after_stop(simulated_run: Operator, code: str, size: tuple[int, int]) -> None:
    """Qt lays out after the events that have arrived, and may paint before: no event is processed here."""
    window, run = simulated_run.window, simulated_run.run
    window.app.set_language(code)
    window.resize(*size)
    page = window.findChild(OperatorPage)
    emit = window.app.engine_link.event.emit
    emit(StateChanged("running", "preparing"))
    emit(StageStarted("rate", 0, 1, 60.0))
    simulated_run.until(lambda: page._badge.text() in ("RUNNING", "标定中"))
    simulated_run.qtbot.wait(50)
    rate = page._stages.list.itemWidget(page._stages.list.item(0))
    for state in ("stopping", "stopped"):
        emit(StateChanged(state, "running"))
        run.changed.emit()
        assert fits(page._badge._word), state
        assert page._badge._word.width() < page._badge._word.sizeHint().width() + theme.GRID
        assert all(map(fits, (rate._name, rate._state)))
    emit(Finalized(Verdict.STOPPED, "log.h5", "result.json", {**RESULT, "outcome": "stopped", "duration_s": 60.0}))
    window.app.engine_link.running_changed.emit(False)
    run.changed.emit()
    panel = page._verdict
    assert all(map(fits, (page._badge._word, panel.reason_label, panel.action_label, panel._facts)))
    assert panel._facts.mapTo(panel, QPoint(0, 0)).x() == panel.reason_label.mapTo(panel, QPoint(0, 0)).x()


@pytest.mark.parametrize("code", ["en", "zh_CN"])
def test_question_above_a_verdict_on_a_small_screen_covers_no_text(simulated_run: Operator, code: str) -> None:
    window = simulated_run.window
    window.app.set_language(code)
    window.resize(1280, 720)
    names = list(INDEX)[:12:3]
    rows = {name: {"value": 1.2e-5, "sigma": 1e-8, "unit": "1", "stage": "rate"} for name in names}
    checks = [check_row("within", name, 1.2e-5, [-1.4e-5, 1.4e-5], passed=True) for name in rows]
    written = {"written": dict.fromkeys(names, 1.2e-5), "verified": False}
    end_run(simulated_run, "stopped", parameters=rows, checks=checks, passed=None, registers=written)
    page = window.findChild(OperatorPage)
    message = render("question.transfer_interrupted", {"serial": "SN-000042"}, language.current())
    names = "Old registers, then calibrate", "New registers, then calibrate", "Cancel"
    answers = [Choice(name, lambda name=name: name, lambda: None) for name in names]
    page.notice.ask("caution", lambda: message.text, lambda: message.remedy, answers)
    simulated_run.qtbot.wait(100)
    panel = page._verdict
    for text, lines in ((panel.reason_label, 1), (panel.action_label, 2), (panel._notes, 4)):
        text.setText("\n".join([say("advice.decide_registers")[:20]] * lines))
        text.show()
    lay_out(panel._values, panel)
    assert panel._banner.geometry().bottom() < panel.reason_label.geometry().top()
    labels = panel.reason_label, panel.action_label, panel._facts, panel._notes
    assert [text.text() for text in labels if not fits(text)] == []


@pytest.mark.parametrize("code", ["en", "zh_CN"])
def test_long_notes_below_a_question_on_a_small_screen_scroll(simulated_run: Operator, code: str) -> None:
    window = simulated_run.window
    window.app.set_language(code)
    window.resize(1280, 720)
    end_run(simulated_run, "passed", standard_override="measured at the laboratory, expected back on Friday " * 8)
    page = window.findChild(OperatorPage)
    panel = page._verdict
    bar, text = panel._notes_area.verticalScrollBar(), panel._notes
    page.notice.ask("caution", lambda: "Calibrate again?", lambda: "It has passed. " * 30)
    simulated_run.until(bar.isVisible)
    simulated_run.until(lambda: fits(text))
    bar.setValue(bar.maximum())
    end = text.mapTo(panel._notes_area.viewport(), QPoint(0, text.height())).y()
    assert end <= panel._notes_area.viewport().height(), "the last line can be read"


def test_shipped_names_of_products_and_stations_are_translated(operator: Operator) -> None:
    language.use("zh_CN")
    for kind, name_text in (("products", product_text), ("stations", station_text)):
        for name in library.names(kind):
            file = library.shipped_folder() / kind / f"{name}.toml"
            if file.is_file():
                given = tomllib.loads(file.read_text(encoding="utf-8"))["name"]
                assert re.search("[\u4e00-\u9fff]", name_text(given)), given
    assert station_text("Line 7") == "Line 7"
    language.use("en")


def red(colour: QColor) -> bool:
    """Whether a colour is a saturated red, not salmon."""
    hue, saturation, value, _ = colour.getHsv()
    return (hue < 12 or hue > 348) and saturation > 170 and value > 150


@pytest.mark.long
@pytest.mark.parametrize("name", ["light", "dark"])
def test_stop_and_fail_are_red_with_white_text(simulated_run: Operator, name: str) -> None:
    simulated_run.window.app.set_theme(name)
    end_run(simulated_run, "failed", **FAILED)
    for widget in (
        simulated_run.widget("stop_button", QPushButton),
        simulated_run.window.findChild(OperatorPage)._verdict._banner,
    ):
        image = widget.grab().toImage()
        assert red(image.pixelColor(image.width() // 2, 6)), widget
        colours = {image.pixel(x, y) for x in range(0, image.width(), 2) for y in range(0, image.height(), 2)}
        assert QColor("#ffffff").rgb() in colours, widget
    simulated_run.window.app.set_theme("light")


@pytest.mark.parametrize("code", ["en", "zh_CN"])
def test_a_fault_that_the_table_latched_stresses_the_reset(simulated_run: Operator, code: str) -> None:
    window = simulated_run.window
    window.app.set_language(code)
    window.app.engine_link.event.emit(
        Fault("TableFaultError", "", 3, "run.engine_ended", {"exit_code": -9, "then": Text("run.then_again")})
    )
    window.app.engine_link.running_changed.emit(False)
    panel = window.operator_page._verdict
    panel.show_end()
    assert panel.reset.offered
    word, done = {"en": ("Reset", "press Understood"), "zh_CN": ("复位故障", "请按“知道了”")}[code]
    assert word in panel.action_label.text()
    assert (panel.reset.button.property("kind"), panel.acknowledge_button.property("kind")) == ("primary", "")
    panel.reset._finish(TableReset("cleared", "interlock", None))
    assert not panel.reset.offered
    assert word not in panel.action_label.text()  # it has been done
    assert done in panel.action_label.text()
    assert (panel.reset.button.property("kind"), panel.acknowledge_button.property("kind")) == ("", "primary")


@pytest.mark.parametrize("state", ["failed", "stopped", "passed"])
def test_the_bench_suggests_no_other_unit_after_a_run_that_may_be_repeated(simulated_run: Operator, state: str) -> None:
    end_run(simulated_run, state)
    simulated_run.window.operator_page._await_next()
    assert bool(simulated_run.window.operator_page.header.serial) == (state == "passed")


@pytest.mark.parametrize("code", ["en", "zh_CN"])
def test_no_fault_is_shown_after_a_silent_engine_responds_again(simulated_run: Operator, code: str) -> None:
    window, run = simulated_run.window, simulated_run.run
    window.app.set_language(code)
    emit = window.app.engine_link.event.emit
    emit(StateChanged("running", "preparing"))
    emit(StageStarted("rate", 0, 1, 60.0))
    silent = Fault("DeviceFaultError", "", 3, "run.engine_silent", {"then": Text("run.then_again")})
    emit(silent)
    emit(silent)  # silent again after heartbeats without an event
    assert (run.state, run.stages[0].state) == ("fault", "fault")
    emit(StageProgress("rate", 0.5, 30.0, {}))
    assert (run.state, run.fault, run.stages[0].state) == ("running", None, "active")
    assert run.stages[0].fraction == 0.5
    emit(Fault("TableFaultError", "", 3, "run.engine_ended", {"exit_code": -9, "then": Text("run.then_again")}))
    emit(StageProgress("rate", 0.6, 20.0, {}))
    assert run.state == "fault", "another fault stays until it is acknowledged"
