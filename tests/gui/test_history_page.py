"""The history page: runs are searched, selected, opened, resumed and closed."""

import json
from datetime import timedelta
from pathlib import Path
from typing import Any

import pyqtgraph as pg
import pytest
from PySide6.QtCore import QPoint, Qt
from PySide6.QtGui import QGuiApplication
from PySide6.QtWidgets import QComboBox, QDateEdit, QLabel, QLineEdit, QPushButton, QTableView, QWidget
from pytestqt.qtbot import QtBot

from calstation.errors import DeviceFaultError
from calstation.gui.history import HistoryPage
from calstation.gui.history.run_table import _RunModel
from calstation.gui.shell.main_window import MainWindow
from calstation.gui.state import AppContext
from calstation.gui.text import fault_text, language, say
from calstation.physics import DEGREE_PER_HOUR
from calstation.records import Verdict
from calstation.results import SCHEMA
from calstation.sequencer import Fault, Finalized
from tests.check_rows import check_row
from tests.dead_logs import NOW, write_dead_log
from tests.gui.conftest import RESULT

pytestmark = pytest.mark.timeout(120)
WAIT = 60_000
FAULT = DeviceFaultError("stream.repeated_no_data")


def write_run(folder: Path, serial: str, outcome: str, age: timedelta, bias: float = 1.0, **more: Any) -> Path:
    """Write the result of a run of one stage with an x gyro bias in °/h; 3 are allowed."""
    started = NOW - age
    name = f"{serial}_{started:%Y%m%dT%H%M%S%f}"
    passed = abs(bias) <= 3.0
    limit = 3.0 * DEGREE_PER_HOUR
    value = bias * DEGREE_PER_HOUR
    result = {
        "schema": SCHEMA,
        "unit": {"serial": serial},
        "stages": ["rate"],
        "passed": outcome == "passed",
        "parameters": {
            "gyro_bias_x": {"value": value, "sigma": 1e-8, "unit": "rad/s", "stage": "rate"},
            "gyro_bias_y": {"value": value / 2, "sigma": 1e-8, "unit": "rad/s", "stage": "rate"},
        },
        "unobservable": [],
        "checks": [check_row("within", "gyro_bias_x", value, [-limit, limit], passed=passed, unit="rad/s")],
        "outcome": outcome,
        "attempt": 1,
        "operator": "Zhang Min",
        "station": "bench",
        "product": "nav-a",
        "log": {"file": str(folder / f"{name}.h5")},
        "software": {"version": "0.1"},
        "started_utc": started.isoformat(),
        "duration_s": 754.0,
        **more,
    }
    path = folder / f"{name}.json"
    path.write_text(json.dumps(result), "utf-8")
    return path


@pytest.fixture
def folder(app: AppContext, tmp_path: Path) -> Path:
    """An empty folder of runs, set in the window."""
    folder = tmp_path / "made-here"
    folder.mkdir()
    app.runs_folder = folder
    return folder


@pytest.fixture
def runs(folder: Path) -> dict[str, Path]:
    """Runs of three units."""
    return {
        "passed": write_run(folder, "SN-000001", "passed", timedelta(hours=2)),
        "failed": write_run(folder, "SN-000001", "failed", timedelta(days=40), bias=5.0),
        "old": write_run(folder, "SN-000001", "passed", timedelta(days=500), bias=0.5),
        "fault": write_run(
            folder,
            "SN-000002",
            "fault",
            timedelta(days=3),
            error=str(FAULT),
            error_code=FAULT.code,
            error_values=FAULT.values,
        ),
        "dead": write_dead_log(folder),
    }


@pytest.fixture
def page(app: AppContext, folder: Path, qtbot: QtBot) -> HistoryPage:
    """The page; shown by the test."""
    history = HistoryPage(app)
    qtbot.addWidget(history)
    history.resize(1366, 640)
    return history


def listed_runs(page: HistoryPage, qtbot: QtBot) -> list[tuple[str, str]]:
    """Show the page; return serial number and outcome of each row once it is up to date."""
    page.show()
    timers = page._list_timer, page._details_timer
    qtbot.waitUntil(lambda: not page.busy and not any(timer.isActive() for timer in timers), timeout=WAIT)
    details = page.details  # whose buttons have no size, and take no click, before they are laid out
    qtbot.waitUntil(lambda: not details.isVisible() or details.record_button.width() > 0, timeout=WAIT)
    return rows(page)


def rows(page: HistoryPage) -> list[tuple[str, str]]:
    """Return serial number and outcome of each row, without the hint at a missing log, which `write_run` omits."""
    model = page.findChild(QTableView, "history_table").model()
    hint = say("history.outcome_without_log", outcome="")
    return [(model.index(i, 1).data(), model.index(i, 0).data().removesuffix(hint)) for i in range(model.rowCount())]


def button(page: QWidget, name: str) -> QPushButton:
    """Return a button by its name."""
    widget = page.findChild(QPushButton, name)
    assert widget is not None
    return widget


def visible_texts(page: HistoryPage) -> list[str]:
    """Return the texts of all visible labels."""
    return [label.text() for label in page.findChildren(QLabel) if label.isVisible()]


def select_row(page: HistoryPage, row: int, qtbot: QtBot) -> None:
    """Click a row."""
    table = page.findChild(QTableView, "history_table")
    point = table.visualRect(table.model().index(row, 1)).center()
    qtbot.mouseClick(table.viewport(), Qt.MouseButton.LeftButton, pos=QPoint(point))


def test_run_of_another_program_is_listed_while_the_page_is_visible(
    page: HistoryPage, folder: Path, qtbot: QtBot
) -> None:
    write_run(folder, "SN-000001", "passed", timedelta(hours=2))
    listed_runs(page, qtbot)
    write_run(folder, "SN-000002", "failed", timedelta(hours=1), bias=5.0)
    page._refresh_timer.setInterval(0)
    qtbot.waitUntil(lambda: len(rows(page)) == 2, timeout=WAIT)
    page.hide()
    assert not page._refresh_timer.isActive()


def test_run_of_another_program_moves_neither_the_list_nor_the_selection(
    page: HistoryPage, folder: Path, qtbot: QtBot
) -> None:
    for hours in range(2, 332):
        write_run(folder, f"SN-{hours:06}", "passed", timedelta(hours=hours))
    page.resize(1000, 600)
    listed_runs(page, qtbot)
    table = page.table
    while table.model().canFetchMore():
        table.model().fetchMore()
    table.setCurrentIndex(table.model().index(320, 0))
    table.verticalScrollBar().setValue(250)
    write_run(folder, "SN-000001", "passed", timedelta(hours=1))
    page._refresh_quietly()
    qtbot.waitUntil(lambda: len(rows(page)) == 331, timeout=WAIT)
    assert table.verticalScrollBar().value() == 250
    assert table.run is not None
    assert table.run.serial == "SN-000322"


def test_reading_the_folder_is_not_called_an_empty_history(page: HistoryPage, qtbot: QtBot) -> None:
    for code, reading in (("en", "Reading the runs"), ("zh_CN", "正在读取标定")):
        language.use(code)
        page.hide()
        page.show()
        assert page.busy
        assert reading in visible_texts(page)
        qtbot.waitUntil(lambda: not page.busy, timeout=WAIT)
        assert reading not in visible_texts(page)
    language.use("en")


def test_empty_page_explains_what_will_be_listed(page: HistoryPage, qtbot: QtBot) -> None:
    assert listed_runs(page, qtbot) == []
    assert "Every run will be listed here" in visible_texts(page)
    assert not button(page, "history_clear_button").isVisible()


def test_latest_run_is_listed_first(page: HistoryPage, runs: dict[str, Path], qtbot: QtBot) -> None:
    assert listed_runs(page, qtbot) == [
        ("SN-000003", "INCOMPLETE"),
        ("SN-000001", "PASS"),
        ("SN-000002", "FAULT"),
        ("SN-000001", "FAIL"),
        ("SN-000001", "PASS"),
    ]


def test_search_filters_while_typing(page: HistoryPage, runs: dict[str, Path], qtbot: QtBot) -> None:
    listed_runs(page, qtbot)
    search = page.findChild(QLineEdit, "history_search_edit")
    qtbot.keyClicks(search, "000001")
    qtbot.waitUntil(lambda: len(rows(page)) == 3, timeout=WAIT)
    outcome = page.findChild(QComboBox, "history_outcome_combo")
    outcome.setCurrentIndex(outcome.findData("failed"))
    assert rows(page) == [("SN-000001", "FAIL")]
    qtbot.keyClicks(search, "9")
    qtbot.waitUntil(lambda: rows(page) == [], timeout=WAIT)
    assert "No run matches" in visible_texts(page)
    button(page, "history_clear_button").click()
    qtbot.waitUntil(lambda: len(rows(page)) == 5, timeout=WAIT)


def test_period_filter_excludes_older_runs(page: HistoryPage, runs: dict[str, Path], qtbot: QtBot) -> None:
    listed_runs(page, qtbot)
    time = page.findChild(QComboBox, "history_time_combo")
    for days, count in ((7, 3), (365, 4), (None, 5)):
        time.setCurrentIndex(time.findData(days))
        assert len(rows(page)) == count


def test_details_give_the_reason(page: HistoryPage, runs: dict[str, Path], qtbot: QtBot) -> None:
    listed_runs(page, qtbot)
    select_row(page, 1, qtbot)
    assert page.details.reason_label.text() == "Every value is within its limits."
    assert len(page.details.trend._plot.listDataItems()[0].xData) == 3
    select_row(page, 2, qtbot)
    assert page.details.reason_label.text().startswith("No more data arrive.\nCheck cable, power and port.")
    language.use("zh_CN")
    qtbot.waitUntil(lambda: page.details.reason_label.text().startswith("数据中断。"), timeout=WAIT)
    language.use("en")
    assert not button(page, "history_log_button").isEnabled()
    select_row(page, 3, qtbot)
    assert page.details.badge.text() == "FAIL, log missing"
    assert "gyro bias x is 5 °/h; allowed: ±3 °/h" in page.details.failed_label.text()
    assert not button(page, "history_resume_button").isVisible()
    assert not button(page, "history_close_button").isVisible()


def test_details_show_an_overridden_check_standard(page: HistoryPage, folder: Path, qtbot: QtBot) -> None:
    write_run(folder, "SN-000005", "passed", timedelta(minutes=3), standard_override="golden unit is away")
    listed_runs(page, qtbot)
    qtbot.waitUntil(lambda: "certificate: golden unit is away" in page.details.reason_label.text(), timeout=WAIT)


def test_search_by_batch_finds_its_units_and_details_show_the_batch(
    page: HistoryPage, folder: Path, qtbot: QtBot
) -> None:
    for number in (1, 2):
        write_run(folder, f"SN-00009{number}", "passed", timedelta(minutes=number), batch="B-77", slot=f"A{number}")
    listed_runs(page, qtbot)
    qtbot.keyClicks(page.findChild(QLineEdit, "history_search_edit"), "b-77")
    qtbot.waitUntil(lambda: page.table.model().rowCount() == 2, timeout=WAIT)
    select_row(page, 1, qtbot)
    texts = {label.text() for label in page.details.findChildren(QLabel)}
    assert {"Batch", "B-77", "Slot"} <= texts
    assert {"A1", "A2"} & texts


def test_result_and_log_are_opened_on_other_pages(
    page: HistoryPage, runs: dict[str, Path], app: AppContext, qtbot: QtBot
) -> None:
    listed_runs(page, qtbot)
    select_row(page, 1, qtbot)
    with qtbot.waitSignal(app.open_run) as emitted:
        button(page, "history_result_button").click()
    assert emitted.args == [runs["passed"]]
    select_row(page, 0, qtbot)
    assert not button(page, "history_result_button").isEnabled()
    with qtbot.waitSignal(app.open_log) as emitted:
        button(page, "history_log_button").click()
    assert emitted.args == [runs["dead"]]


@pytest.mark.long
def test_folder_that_cannot_be_opened_is_shown_for_copying(
    page: HistoryPage, runs: dict[str, Path], monkeypatch: pytest.MonkeyPatch, qtbot: QtBot
) -> None:
    monkeypatch.setattr("calstation.gui.history.page.QDesktopServices.openUrl", lambda _: False)
    listed_runs(page, qtbot)
    select_row(page, 1, qtbot)
    button(page, "history_folder_button").click()
    folder = str(runs["passed"].parent)
    assert page.notice.text_label.text() == folder
    button(page, "copy_folder_button").click()
    assert QGuiApplication.clipboard().text() == folder


@pytest.mark.parametrize("code", ["en", "zh_CN"])
def test_product_and_operator_are_visible_in_every_width(
    page: HistoryPage, folder: Path, qtbot: QtBot, code: str
) -> None:
    language.use(code)
    stages = ["rate", "six_position", "excitation", "azimuth_flips", "random_tumble"]
    write_run(folder, "SN-000001", "passed", timedelta(hours=1), stages=stages, product="nav_a", operator="Zhang Min")
    listed_runs(page, qtbot)
    table = page.findChild(QTableView, "history_table")
    headings = {heading: k for k, heading in enumerate(table_headings(page))}
    product, operator, attempt, duration, shown = (
        headings[say(each)]
        for each in (
            "common.product", "common.operator", "history.attempt", "history.duration", "common.stages"
        )
    )  # fmt: skip
    for width in (900, 1280, 1366, 1920):
        page.resize(width, 640)
        if width > 900:  # in Chinese, it depends on the font whether the attempts fit there
            qtbot.waitUntil(lambda: not table.isColumnHidden(attempt), timeout=WAIT)
        assert table.isColumnHidden(duration) or not table.isColumnHidden(attempt)
        assert not table.isColumnHidden(product)
        assert not table.isColumnHidden(operator)
        assert table.isColumnHidden(shown) or table.columnWidth(shown) >= 128
        qtbot.waitUntil(lambda: not table.horizontalScrollBar().isVisible(), timeout=WAIT)
    language.use("en")


def table_headings(page: HistoryPage) -> list[str]:
    """Return the headings of the columns without the arrow of the order."""
    model = page.table.model()
    heading, across = model.headerData, Qt.Orientation.Horizontal
    return [heading(k, across).split("  ")[0] for k in range(model.columnCount())]


def click_heading(page: HistoryPage, heading: str, qtbot: QtBot) -> None:
    """Click the heading of a column."""
    header, column = page.table.horizontalHeader(), table_headings(page).index(heading)
    at = QPoint(header.sectionViewportPosition(column) + 20, header.height() // 2)
    qtbot.mouseClick(header.viewport(), Qt.MouseButton.LeftButton, pos=at)


def column(page: HistoryPage, heading: str) -> list[str]:
    """Return the texts of a column."""
    model, column = page.table.model(), table_headings(page).index(heading)
    return [model.index(row, column).data() for row in range(model.rowCount())]


def test_a_click_on_a_heading_sorts_by_its_column(page: HistoryPage, folder: Path, qtbot: QtBot) -> None:
    units = (
        ("SN-9", 2, 65.0, "passed"),
        ("SN-10", 10, 3700.0, "failed"),
        ("SN-9", 1, 600.0, "passed"),
        ("SN-100", 9, 5.0, "failed"),
    )
    for hours, (serial, attempt, duration, outcome) in enumerate(units, 1):
        write_run(folder, serial, outcome, timedelta(hours=hours), attempt=attempt, duration_s=duration)
    page.resize(2600, 640)
    listed_runs(page, qtbot)
    assert column(page, "Serial number") == ["SN-9", "SN-10", "SN-9", "SN-100"]
    select_row(page, 1, qtbot)
    click_heading(page, "Serial number", qtbot)
    assert column(page, "Serial number") == ["SN-9", "SN-9", "SN-10", "SN-100"], "numbers count as numbers"
    assert column(page, "Attempt") == ["2", "1", "10", "9"], "equal ones remain in their order"
    assert [run.serial for run in page.table.selected_runs] == ["SN-10"], "the selection is kept"
    click_heading(page, "Serial number", qtbot)
    assert column(page, "Attempt") == ["9", "10", "2", "1"]
    assert page.table.model().headerData(1, Qt.Orientation.Horizontal) == "Serial number  ▼"
    click_heading(page, "Attempt", qtbot)
    assert column(page, "Attempt") == ["1", "2", "9", "10"]
    click_heading(page, "Duration", qtbot)
    assert column(page, "Attempt") == ["9", "2", "1", "10"]
    click_heading(page, "Outcome", qtbot)
    assert [outcome for _, outcome in rows(page)] == ["FAIL", "FAIL", "PASS", "PASS"]
    page.refresh()
    qtbot.waitUntil(lambda: not page.busy, timeout=WAIT)
    assert [outcome for _, outcome in rows(page)] == ["FAIL", "FAIL", "PASS", "PASS"], "an update keeps the order"
    click_heading(page, "Started", qtbot)
    click_heading(page, "Started", qtbot)
    assert column(page, "Attempt") == ["2", "10", "1", "9"]
    page.table.selectAll()
    assert [run.attempt for run in page.table.selected_runs] == [2, 10, 1, 9]


@pytest.mark.parametrize("code", ["en", "zh_CN"])
def test_all_runs_are_sorted_and_reached_by_scrolling(
    page: HistoryPage, folder: Path, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch, code: str
) -> None:
    language.use(code)
    monkeypatch.setattr("calstation.gui.history.run_table._PART", 4)
    for k in range(15):
        write_run(folder, f"SN-{k}", "passed", timedelta(hours=1 + k))
    page.resize(1366, 768)
    listed_runs(page, qtbot)
    serial = say("common.serial_number")
    qtbot.waitUntil(lambda: len(rows(page)) >= 4, timeout=WAIT)
    assert column(page, serial)[:4] == ["SN-0", "SN-1", "SN-2", "SN-3"]
    click_heading(page, serial, qtbot)
    click_heading(page, serial, qtbot)
    assert column(page, serial)[:4] == ["SN-14", "SN-13", "SN-12", "SN-11"], "the oldest runs are sorted, too"
    bar = page.table.verticalScrollBar()
    while len(rows(page)) < 15:
        before = len(rows(page))
        bar.setValue(bar.maximum())
        qtbot.waitUntil(lambda before=before: len(rows(page)) > before, timeout=WAIT)
    assert column(page, serial) == [f"SN-{k}" for k in range(14, -1, -1)]
    select_row(page, 14, qtbot)
    assert page.table.run is not None
    assert page.table.run.serial == "SN-0"
    language.use("en")


def test_a_list_ends_where_runs_have_been_removed_meanwhile(page: HistoryPage) -> None:
    model, inserted = page.table.model(), list[object]()
    assert isinstance(model, _RunModel)
    model.show_runs(lambda *_: [], 5)
    model.rowsInserted.connect(lambda *_: inserted.append(1))
    model.fetchMore()
    assert (inserted, model.canFetchMore()) == ([], False)


def test_trend_shows_the_parameter_that_failed(page: HistoryPage, folder: Path, qtbot: QtBot) -> None:
    limit = 3.0 * DEGREE_PER_HOUR
    checks = [
        check_row("within", "gyro_bias_x", 0.0, [-limit, limit], passed=True, unit="rad/s"),
        check_row("within", "gyro_bias_y", 2 * limit, [-limit, limit], passed=False, unit="rad/s"),
    ]
    write_run(folder, "SN-000001", "failed", timedelta(hours=1), checks=checks)
    write_run(folder, "SN-000001", "passed", timedelta(hours=2))
    listed_runs(page, qtbot)
    trend = page.findChild(QComboBox, "trend_combo")
    assert trend.currentData() == "gyro_bias_y"
    select_row(page, 1, qtbot)
    assert trend.currentData() == "gyro_bias_y", "a choice is kept unless another parameter failed"
    trend.setCurrentIndex(trend.findData("gyro_bias_x"))
    page.show_runs()
    assert trend.currentData() == "gyro_bias_x"
    select_row(page, 0, qtbot)
    assert trend.currentData() == "gyro_bias_y"
    language.use("zh_CN")
    assert trend.currentText() == "陀螺零偏 y"
    language.use("en")


@pytest.mark.parametrize(("code", "words"), [("en", "limits of the selected run"), ("zh_CN", "所选标定的限差")])
def test_trend_shows_limits_only_at_the_run_that_they_judged(
    page: HistoryPage, folder: Path, qtbot: QtBot, code: str, words: str
) -> None:
    """An earlier run that passed with wider limits does not lie outside the limits of a later one."""
    limit = 1.0 * DEGREE_PER_HOUR
    tighter = [check_row("within", "gyro_bias_x", 2 * limit, [-limit, limit], passed=False, unit="rad/s")]
    write_run(folder, "SN-000001", "failed", timedelta(hours=1), 2.0, checks=tighter)
    write_run(folder, "SN-000001", "passed", timedelta(hours=2), 2.0)
    language.use(code)
    listed_runs(page, qtbot)
    plot = page.details.trend._plot
    for row, at, bound in ((0, 1, 1.0), (1, 0, 3.0)):  # the trend begins with the oldest run
        select_row(page, row, qtbot)
        curves = [each for each in plot.listDataItems() if isinstance(each, pg.PlotDataItem)]
        lines = [(list(each.xData), list(each.yData)) for each in curves[1:]]
        assert lines == [([at - 0.4, at + 0.4], pytest.approx([side * bound] * 2)) for side in (-1, 1)]
    assert words in page.findChild(QLabel, "trend_label").text()
    language.use("en")


def test_dates_that_are_not_in_effect_are_muted(page: HistoryPage, runs: dict[str, Path], qtbot: QtBot) -> None:
    listed_runs(page, qtbot)
    time = page.findChild(QComboBox, "history_time_combo")
    dates = page.findChildren(QDateEdit)
    assert [edit.property("kind") for edit in dates] == ["muted", "muted"]
    time.setCurrentIndex(time.findData(0))
    assert [edit.property("kind") for edit in dates] == ["", ""]


@pytest.mark.parametrize(
    ("by", "text"),
    [
        ("operator", "The run was stopped by the operator."),
        ("listener_lost", "Stopped safely: the window or terminal that monitored the run has ended."),
    ],
)
def test_reason_of_a_stop_is_shown(page: HistoryPage, folder: Path, qtbot: QtBot, by: str, text: str) -> None:
    write_run(folder, "SN-000004", "stopped", timedelta(minutes=3), stop_reason=by)
    listed_runs(page, qtbot)
    select_row(page, 0, qtbot)
    assert page.details.reason_label.text().startswith(text)


@pytest.mark.parametrize("signed_in", [None, "Li Na"])
def test_incomplete_run_is_resumed_or_closed(
    page: HistoryPage, runs: dict[str, Path], app: AppContext, qtbot: QtBot, signed_in: str | None
) -> None:
    app.operator = signed_in
    listed_runs(page, qtbot)
    select_row(page, 0, qtbot)
    with qtbot.waitSignal(app.resume_run) as emitted:
        button(page, "history_resume_button").click()
    assert emitted.args == [runs["dead"]]
    button(page, "history_close_button").click()
    qtbot.waitUntil(lambda: not page.busy and not button(page, "history_close_button").isVisible(), timeout=WAIT)
    assert not button(page, "history_resume_button").isVisible()
    result = json.loads(runs["dead"].with_suffix(".json").read_text("utf-8"))
    assert (result["outcome"], result["closed_by"]) == ("incomplete", signed_in)


def test_incomplete_run_is_not_closed_after_a_later_verdict(page: HistoryPage, folder: Path, qtbot: QtBot) -> None:
    dead = {serial: write_dead_log(folder, serial, solved=0) for serial in ("SN-000003", "SN-000004")}
    write_run(folder, "SN-000003", "passed", timedelta(minutes=3))
    write_run(folder, "SN-000004", "passed", timedelta(hours=3))
    listed_runs(page, qtbot)
    for serial, log in dead.items():
        select_row(page, [run.log.stem for run in page.table._model.runs].index(log.stem), qtbot)
        qtbot.waitUntil(lambda serial=serial: page.table.run is not None and page.table.run.serial == serial)
        assert button(page, "history_close_button").isVisible() is (serial == "SN-000004")


@pytest.mark.parametrize("code", ["en", "zh_CN"])
def test_remedy_of_a_fault_is_that_of_the_operator_page(
    page: HistoryPage, folder: Path, app: AppContext, qtbot: QtBot, code: str
) -> None:
    fault = DeviceFaultError("imu.answer_not_framed", port="socket://10.0.0.7:4001", seconds=5.0)
    texts = {"error": str(fault), "error_code": fault.code, "error_values": fault.values}
    write_run(folder, "SN-000003", "fault", timedelta(days=1), **texts)
    language.use(code)
    listed_runs(page, qtbot)
    select_row(page, 0, qtbot)
    for engineer in (False, True):
        if engineer:
            app.role.set_first_pin("246813")
        text = fault_text(Fault.of(fault), engineer=engineer)
        assert page.details.reason_label.text().startswith(f"{text.text}\n{text.remedy}")
    language.use("en")


def test_failures_of_background_jobs_are_reported(page: HistoryPage, runs: dict[str, Path], qtbot: QtBot) -> None:
    listed_runs(page, qtbot)
    for watch, title in (
        (page._refresher, "The runs could not be read"),
        (page._resumable_finder, "The runs could not be read"),
        (page._closer, "The run was not closed"),
    ):
        watch.failed.emit(FAULT)
        assert page.notice.title_label.text() == title
        button(page, "history_notice_close").click()


def test_finished_run_is_listed_immediately(
    page: HistoryPage, runs: dict[str, Path], folder: Path, app: AppContext, qtbot: QtBot
) -> None:
    listed_runs(page, qtbot)
    result = write_run(folder, "SN-000009", "passed", timedelta(minutes=1))
    app.engine_link.event.emit(Finalized(Verdict.PASSED, str(result.with_suffix(".h5")), str(result), RESULT))
    qtbot.waitUntil(lambda: rows(page)[0] == ("SN-000009", "PASS"), timeout=WAIT)
    assert page.table.run is not None
    assert page.table.run.serial == "SN-000003"  # the selection is kept


@pytest.mark.long
def test_resume_asks_for_confirmation_on_the_operator_page(window: MainWindow, folder: Path, qtbot: QtBot) -> None:
    write_dead_log(folder)
    window.app.runs_folder = folder
    window.show_page("history_page")
    history, operator = window.findChild(HistoryPage), window.operator_page
    assert isinstance(history, HistoryPage)
    qtbot.waitUntil(lambda: button(history, "history_resume_button").isVisible(), timeout=WAIT)
    button(history, "history_resume_button").click()
    assert operator.isVisible()
    qtbot.waitUntil(lambda: operator.findChild(QPushButton, "resume_choice") is not None, timeout=WAIT)
    assert not window.app.engine_link.running


def test_start_time_is_local_with_the_time_zone_in_the_tooltip(
    page: HistoryPage, runs: dict[str, Path], qtbot: QtBot
) -> None:
    listed_runs(page, qtbot)
    model = page.findChild(QTableView, "history_table").model()
    cells = [model.index(row, 2) for row in range(model.rowCount())]
    local = (NOW - timedelta(hours=2)).astimezone()
    (cell,) = [cell for cell in cells if cell.data() == f"{local:%Y-%m-%d %H:%M}"]
    offset = local.isoformat()[-6:].replace("+00:00", "")  # UTC is not said twice
    assert cell.data(Qt.ItemDataRole.ToolTipRole) == f"{local:%Y-%m-%d %H:%M:%S} UTC{offset}"


@pytest.mark.parametrize(("code", "stated"), [("en", "Registers written, NOT verified"), ("zh_CN", "尚未验证")])
def test_details_say_that_written_registers_are_not_verified(
    page: HistoryPage, folder: Path, qtbot: QtBot, code: str, stated: str
) -> None:
    registers = {"old": {"gyro_bias_x": 0.0}, "new": {"gyro_bias_x": 1e-6}}
    write_run(folder, "SN-000001", "stopped", timedelta(hours=1), stop_reason="operator", registers=registers)
    language.use(code)
    listed_runs(page, qtbot)
    select_row(page, 0, qtbot)
    reason = page.findChild(QLabel, "history_reason_label")
    assert reason is not None
    qtbot.waitUntil(lambda: stated in reason.text(), timeout=WAIT)


@pytest.mark.parametrize("code", ["en", "zh_CN"])
def test_list_and_details_say_that_a_run_was_simulated(
    page: HistoryPage, folder: Path, qtbot: QtBot, code: str
) -> None:
    language.use(code)
    write_run(folder, "SN-000001", "passed", timedelta(hours=1), simulated=True)
    write_run(folder, "SN-000002", "passed", timedelta(hours=2))
    simulated, measured = ("PASS, simulated", "PASS") if code == "en" else ("合格，模拟", "合格")
    assert listed_runs(page, qtbot) == [("SN-000001", simulated), ("SN-000002", measured)]
    assert page.details.badge.text().startswith(simulated)
    language.use("en")


@pytest.mark.parametrize(
    ("code", "text"),
    [("en", "The interlock was opened (fault 'interlock' is latched)."), ("zh_CN", "安全联锁被断开。")],
)
def test_reason_of_a_latched_fault_names_no_button_that_the_page_lacks(
    page: HistoryPage, folder: Path, qtbot: QtBot, code: str, text: str
) -> None:
    fault = DeviceFaultError("table.latched_interlock", fault="interlock")
    texts = {"error": str(fault), "error_code": fault.code, "error_values": fault.values}
    write_run(folder, "SN-000003", "fault", timedelta(days=1), **texts)
    language.use(code)
    listed_runs(page, qtbot)
    select_row(page, 0, qtbot)
    qtbot.waitUntil(lambda: bool(page.details.reason_label.text()), timeout=WAIT)
    assert page.details.reason_label.text().split("\n")[0] == text
    assert not any(words in page.details.reason_label.text() for words in ("Reset the fault", "复位故障"))
    language.use("en")
