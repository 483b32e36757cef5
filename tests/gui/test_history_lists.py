"""The history page: the list is filtered by values and dates, runs are compared, and lists are exported."""

import csv
import json
from dataclasses import replace
from datetime import datetime, timedelta
from pathlib import Path

import pytest
from pyqtgraph import ScatterPlotItem
from PySide6.QtCore import QDate, QPoint, Qt
from PySide6.QtWidgets import (
    QComboBox,
    QDateEdit,
    QFileDialog,
    QLabel,
    QPushButton,
    QTableView,
)
from pytestqt.qtbot import QtBot

from calstation.gui.history import HistoryPage
from calstation.gui.text import language, say
from calstation.gui.widgets import ThemedPlot, state_colour, state_icon
from calstation.messages import local_time
from calstation.physics import DEGREE_PER_HOUR
from calstation.records import OnlineDifference, append_resolve, resolve_file
from calstation.results import load_result
from tests.check_rows import check_row
from tests.dead_logs import NOW
from tests.gui import test_history_page as base
from tests.gui.test_history_page import WAIT, button, listed_runs, rows, select_row, visible_texts, write_run
from tests.results.test_resolves import RECORD

pytestmark = pytest.mark.timeout(120)
folder, page = base.folder, base.page


@pytest.fixture
def runs(folder: Path) -> dict[str, Path]:
    """Runs of three units with several products, stations and operators."""
    hour = timedelta(hours=1)
    return {
        "new": write_run(folder, "SN-000001", "passed", hour, operator="Li Wei"),
        "partial": write_run(folder, "SN-000002", "passed", 2 * hour, partial=True, product="mems-x"),
        "failed": write_run(folder, "SN-000001", "failed", 3 * hour, bias=5.0, station="hand"),
        "stopped": write_run(folder, "SN-000003", "stopped", 4 * hour, bias=5.0, stop_reason="operator"),
        "old": write_run(folder, "SN-000001", "passed", timedelta(days=100), bias=0.5),
    }


def combo(page: HistoryPage, name: str) -> QComboBox:
    """Return a combo box by its name."""
    widget = page.findChild(QComboBox, f"history_{name}_combo")
    assert isinstance(widget, QComboBox)
    return widget


def choose(page: HistoryPage, name: str, text: str) -> None:
    """Choose an entry of a combo box by its text."""
    box = combo(page, name)
    box.setCurrentIndex(box.findText(text))


def count(page: HistoryPage) -> str:
    """Return the displayed number of runs."""
    return str(page.findChild(QLabel, "history_count_label").text())


def ctrl_click(page: HistoryPage, row: int, qtbot: QtBot) -> None:
    """Click a row while Ctrl is held."""
    table = page.findChild(QTableView, "history_table")
    point = table.visualRect(table.model().index(row, 1)).center()
    control = Qt.KeyboardModifier.ControlModifier
    qtbot.mouseClick(table.viewport(), Qt.MouseButton.LeftButton, control, QPoint(point))


def save_as(page: HistoryPage, target: Path, qtbot: QtBot) -> None:
    """Press the export button, choose a file in its dialog, and wait for the end of the export."""
    button(page, "history_export_button").click()
    (dialog,) = page.findChildren(QFileDialog)
    dialog.fileSelected.emit(str(target))
    qtbot.waitUntil(lambda: page.notice.isVisible() and not page.busy, timeout=WAIT)


def compare(page: HistoryPage, rows: tuple[int, ...], qtbot: QtBot) -> QTableView:
    """Select rows and compare their runs."""
    select_row(page, rows[0], qtbot)
    for row in rows[1:]:
        ctrl_click(page, row, qtbot)
    button(page, "history_compare_button").click()
    table = page.findChild(QTableView, "run_comparison_table")
    qtbot.waitUntil(table.isVisible, timeout=WAIT)
    assert isinstance(table, QTableView)
    return table


def test_filters_list_the_values_of_the_runs(page: HistoryPage, runs: dict[str, Path], qtbot: QtBot) -> None:
    listed_runs(page, qtbot)
    offered = {
        name: [combo(page, name).itemText(i) for i in range(combo(page, name).count())]
        for name in ("product", "station", "operator")
    }
    assert offered == {
        "product": ["Every product", "mems-x", "nav-a"],
        "station": ["Every station", "bench", "hand"],
        "operator": ["Every operator", "Li Wei", "Zhang Min"],
    }


def test_filters_are_combined_and_cleared(page: HistoryPage, runs: dict[str, Path], qtbot: QtBot) -> None:
    listed_runs(page, qtbot)
    assert count(page) == "5 runs"
    assert not button(page, "history_clear_button").isVisible()
    choose(page, "outcome", "PARTIAL")
    assert rows(page) == [("SN-000002", "PARTIAL")]
    assert count(page) == "1 run"
    choose(page, "outcome", "PASS")
    choose(page, "operator", "Zhang Min")
    assert rows(page) == [("SN-000001", "PASS")]
    choose(page, "station", "hand")
    assert rows(page) == []
    assert "No run matches" in visible_texts(page)
    qtbot.mouseClick(button(page, "history_clear_button"), Qt.MouseButton.LeftButton)
    assert len(rows(page)) == 5
    choose(page, "station", "hand")
    assert rows(page) == [("SN-000001", "FAIL")]
    button(page, "history_clear_button").click()
    choose(page, "product", "mems-x")
    page.refresh()
    qtbot.waitUntil(lambda: not page.busy, timeout=WAIT)
    assert rows(page) == [("SN-000002", "PARTIAL")], "a filter survives the update of the list"


def test_calendar_dates_are_local_days(page: HistoryPage, folder: Path, qtbot: QtBot) -> None:
    day = (NOW - timedelta(days=60)).astimezone().replace(day=15)
    for hour, minute in ((0, 0), (23, 59)):
        begin = datetime(day.year, day.month, day.day, hour, minute).astimezone()
        write_run(folder, f"SN-{hour:06d}", "passed", NOW - begin)
    before = datetime(day.year, day.month, day.day).astimezone() - timedelta(minutes=1)
    write_run(folder, "SN-000099", "passed", NOW - before)
    after = datetime(day.year, day.month, day.day, 23, 59).astimezone() + timedelta(minutes=1)
    write_run(folder, "SN-000100", "passed", NOW - after)
    listed_runs(page, qtbot)
    first, last = (page.findChild(QDateEdit, f"history_{name}_edit") for name in ("from", "to"))
    assert first.date() == QDate(before.year, before.month, before.day), "the dates of all runs"
    assert last.date() == QDate.currentDate()
    last.setDate(QDate(day.year, day.month, 15))
    qtbot.waitUntil(lambda: len(rows(page)) == 3, timeout=WAIT)
    assert combo(page, "time").currentText() == "Dates"
    arrow = QPoint(first.width() - 8, first.height() // 2)
    qtbot.mouseClick(first, Qt.MouseButton.LeftButton, pos=arrow)
    calendar = first.calendarWidget()
    calendar.setCurrentPage(day.year, day.month)
    view = calendar.findChild(QTableView, "qt_calendar_calendarview")
    cells = [view.model().index(row, column) for row in range(1, 7) for column in range(7)]
    cell = next(index for index in cells if index.data() == 15)
    qtbot.mouseClick(view.viewport(), Qt.MouseButton.LeftButton, pos=view.visualRect(cell).center())
    qtbot.waitUntil(lambda: [serial for serial, _ in rows(page)] == ["SN-000023", "SN-000000"], timeout=WAIT)
    first.setDate(QDate(day.year, day.month, 20))
    assert last.date() == first.date(), "dates are never in reverse order"
    qtbot.waitUntil(lambda: rows(page) == [], timeout=WAIT)
    choose(page, "time", "Any time")
    assert len(rows(page)) == 4


def test_number_of_matching_runs_is_shown(page: HistoryPage, runs: dict[str, Path], qtbot: QtBot) -> None:
    listed_runs(page, qtbot)
    assert count(page) == "5 runs"
    choose(page, "outcome", "PASS")
    assert count(page) == "2 runs"
    language.use("zh_CN")
    qtbot.waitUntil(lambda: count(page) == "共 2 次", timeout=WAIT)
    language.use("en")


def test_selected_runs_are_compared_side_by_side(page: HistoryPage, runs: dict[str, Path], qtbot: QtBot) -> None:
    listed_runs(page, qtbot)
    assert button(page, "history_compare_button").toolTip() == "Select 2 to 8 runs with Ctrl or Shift"
    table = compare(page, (0, 2, 4), qtbot)
    model = table.model()
    headings = [model.headerData(k, Qt.Orientation.Horizontal) for k in range(model.columnCount())]
    assert [text.split("\n")[0] for text in headings] == [
        *("unit", "● SN-000001", "±σ"),
        *("■ SN-000001", "±σ", "in σ"),
        *("▲ SN-000001", "±σ", "in σ"),
    ]
    old, failed, new = (json.loads(runs[name].read_text("utf-8")) for name in ("old", "failed", "new"))
    values = [each["parameters"]["gyro_bias_x"]["value"] for each in (old, failed, new)]
    assert [model.index(0, k).data().strip() for k in (1, 3, 6)] == ["0.5000", "5.0000", "1.0000"]
    sigma = 2**0.5 * 1e-8
    assert [float(model.index(0, k).data()) for k in (5, 8)] == [
        round((value - values[0]) / sigma, 2) for value in values[1:]
    ]
    assert [model.index(0, k).data(Qt.ItemDataRole.UserRole) for k in (5, 8)] == ["caution", "caution"]
    plot = page._comparison.plot
    symbols = [item for item in plot.getPlotItem().items if hasattr(item, "points")]
    assert [[point.pos().x() for point in item.points()] for item in symbols] == [
        [pytest.approx(value)] for value in (0.5 / 3.0, 5.0 / 3.0, 1.0 / 3.0)
    ]
    assert len({item.opts["symbol"] for item in symbols}) == 3
    for code, caption in (("en", "value relative to its limits; bars: ± 1 σ"), ("zh_CN", "误差棒：± 1 σ")):
        language.use(code)
        plot.draw()
        assert caption in plot.getAxis("bottom").labelText
    language.use("en")
    qtbot.mouseClick(button(page, "comparison_back_button"), Qt.MouseButton.LeftButton)
    assert page.table.isVisible()
    assert len(page.table.selected_runs) == 3


def test_runs_of_one_unit_are_told_apart_on_a_small_screen(
    page: HistoryPage, runs: dict[str, Path], qtbot: QtBot
) -> None:
    page.resize(1100, 600)
    listed_runs(page, qtbot)
    table = compare(page, (0, 2, 4), qtbot)
    header = table.horizontalHeader()
    columns = range(table.model().columnCount())
    assert [k for k in columns if header.sectionSize(k) < header.sectionSizeFromContents(k).width()] == []
    heading = str(table.model().headerData(6, Qt.Orientation.Horizontal)).split("\n")
    assert heading == ["▲ SN-000001", *local_time(started(runs["new"])).split()]


def started(result: Path) -> str:
    """Return the start of a run from its result file."""
    return str(json.loads(result.read_text("utf-8"))["started_utc"])


def test_value_missing_in_one_run_has_no_difference(page: HistoryPage, folder: Path, qtbot: QtBot) -> None:
    rest = {"unit": "rad/s", "stage": "rate", "sigma": 1e-8}
    write_run(folder, "SN-000001", "passed", timedelta(hours=2), parameters={"gyro_bias_x": {"value": 0.0, **rest}})
    write_run(
        folder,
        "SN-000002",
        "passed",
        timedelta(hours=1),
        checks=[],
        parameters={"gyro_bias_x": {"value": 4e-8, **rest}, "gyro_bias_y": {"value": 0.0, **rest}},
    )
    listed_runs(page, qtbot)
    model = compare(page, (0, 1), qtbot).model()
    assert [model.index(row, 5).data() for row in (0, 1)] == ["+2.83", "–"]
    assert [model.index(row, 5).data(Qt.ItemDataRole.UserRole) for row in (0, 1)] == [None, None]
    assert "2 runs of SN-000001, SN-000002" in visible_texts(page)


@pytest.mark.parametrize(("code", "said"), [("en", "No run has limits"), ("zh_CN", "这些标定都没有限差")])
def test_runs_without_limits_are_compared_without_a_plot(
    page: HistoryPage, folder: Path, qtbot: QtBot, code: str, said: str
) -> None:
    row = {"gyro_bias_x": {"value": 0.0, "unit": "rad/s", "stage": "rate", "sigma": 1e-8}}
    for hours in (1, 2):
        write_run(folder, "SN-000001", "passed", timedelta(hours=hours), checks=[], parameters=row)
    listed_runs(page, qtbot)
    language.use(code)
    compare(page, (0, 1), qtbot)
    assert not page._comparison.plot.isVisible()
    assert said in " ".join(visible_texts(page))
    language.use("en")


@pytest.mark.parametrize(("code", "said"), [("en", "PASS, simulated"), ("zh_CN", "合格，模拟")])
def test_simulated_run_is_called_simulated_in_details_comparison_and_record(
    page: HistoryPage, folder: Path, qtbot: QtBot, code: str, said: str
) -> None:
    for hours in (1, 2):
        write_run(folder, "SN-000001", "passed", timedelta(hours=hours), simulated=hours == 1)
    listed_runs(page, qtbot)
    language.use(code)
    select_row(page, 0, qtbot)
    assert page.details.badge.text().startswith(said)
    qtbot.mouseClick(button(page, "history_record_button"), Qt.MouseButton.LeftButton)
    assert said in page.record._title.text()
    qtbot.mouseClick(page.record.back_button, Qt.MouseButton.LeftButton)
    model = compare(page, (0, 1), qtbot).model()
    headings = [model.headerData(k, Qt.Orientation.Horizontal) for k in range(model.columnCount())]
    assert [said in text for text in headings if "SN-000001" in text] == [False, True]
    language.use("en")


@pytest.mark.parametrize(("code", "said"), [("en", "a full calibration is needed"), ("zh_CN", "需要完整标定")])
def test_details_of_a_partial_run_without_a_calibration_say_what_it_lacks(
    page: HistoryPage, folder: Path, qtbot: QtBot, code: str, said: str
) -> None:
    failed = check_row("sigma_below", "gyro_bias_x", 1e-2, 1e-3, passed=False)
    write_run(folder, "SN-000001", "failed", timedelta(hours=1), partial=True, checks=[failed])
    listed_runs(page, qtbot)
    language.use(code)
    assert said in page.details.reason_label.text()
    language.use("en")


def test_incomplete_run_is_not_compared(page: HistoryPage, runs: dict[str, Path], qtbot: QtBot) -> None:
    base.write_dead_log(runs["new"].parent)
    listed_runs(page, qtbot)
    select_row(page, 0, qtbot)
    ctrl_click(page, 1, qtbot)
    compare_button = button(page, "history_compare_button")
    assert not compare_button.isEnabled()
    assert compare_button.toolTip() == "An incomplete run has no values to compare"


def test_deleted_run_is_not_compared(page: HistoryPage, runs: dict[str, Path], qtbot: QtBot) -> None:
    listed_runs(page, qtbot)
    runs["new"].unlink()
    select_row(page, 1, qtbot)
    ctrl_click(page, 0, qtbot)
    button(page, "history_compare_button").click()
    qtbot.waitUntil(page.notice.isVisible, timeout=WAIT)
    assert page.notice.title_label.text() == "The runs cannot be compared"
    assert "cannot be read" in page.notice.text_label.text()


def test_filtered_list_is_exported(page: HistoryPage, runs: dict[str, Path], tmp_path: Path, qtbot: QtBot) -> None:
    listed_runs(page, qtbot)
    choose(page, "product", "nav-a")
    assert button(page, "history_export_button").text() == "Export list…"
    save_as(page, tmp_path / "runs.csv", qtbot)
    assert page.notice.text_label.text() == str(tmp_path / "runs.csv")
    with (tmp_path / "runs.csv").open(encoding="utf-8", newline="") as stream:
        exported = [(row["serial"], row["verdict"], row["failed_checks"]) for row in csv.DictReader(stream)]
    assert exported == [
        ("SN-000001", "passed", ""),
        ("SN-000001", "failed", "gyro_bias_x within"),
        ("SN-000003", "stopped", ""),
        ("SN-000001", "passed", ""),
    ]


def test_only_selected_runs_are_exported(
    page: HistoryPage, runs: dict[str, Path], tmp_path: Path, qtbot: QtBot
) -> None:
    listed_runs(page, qtbot)
    select_row(page, 1, qtbot)
    ctrl_click(page, 3, qtbot)
    assert button(page, "history_export_button").text() == "Export selection…"
    save_as(page, tmp_path / "runs.json", qtbot)
    expected = [load_result(runs[name]).to_json() for name in ("partial", "stopped")]
    assert json.loads((tmp_path / "runs.json").read_text("utf-8")) == expected


def test_a_failed_export_is_reported(page: HistoryPage, runs: dict[str, Path], tmp_path: Path, qtbot: QtBot) -> None:
    listed_runs(page, qtbot)
    save_as(page, tmp_path / "missing" / "runs.csv", qtbot)
    assert page.notice.title_label.text() == "The export failed"
    assert "cannot be written" in page.notice.text_label.text()


def test_details_are_those_of_a_selected_run(page: HistoryPage, runs: dict[str, Path], qtbot: QtBot) -> None:
    listed_runs(page, qtbot)
    select_row(page, 1, qtbot)
    ctrl_click(page, 3, qtbot)
    third = page.table.runs[3]
    for row in (1, 3):  # the last selected row cannot be deselected
        ctrl_click(page, row, qtbot)
        qtbot.waitUntil(lambda: (page.table.selected_runs, page.table.run) == ((third,), third), timeout=WAIT)
        assert page.details._serial.text() == third.serial


def test_selection_is_kept_when_the_list_is_updated(
    page: HistoryPage, runs: dict[str, Path], folder: Path, qtbot: QtBot
) -> None:
    listed_runs(page, qtbot)
    select_row(page, 1, qtbot)
    ctrl_click(page, 3, qtbot)
    selected = [run.log for run in page.table.selected_runs]
    write_run(folder, "SN-000009", "passed", timedelta(minutes=1))
    page.refresh()
    qtbot.waitUntil(lambda: not page.busy and rows(page)[0][0] == "SN-000009", timeout=WAIT)
    assert [run.log for run in page.table.selected_runs] == selected
    page.table.selectionModel().clearSelection()
    page.table.selectionModel().clearCurrentIndex()
    page.show_runs()
    assert [run.serial for run in page.table.selected_runs] == ["SN-000009"]


def test_stopped_and_partial_runs_are_not_shown_as_passed(
    page: HistoryPage, runs: dict[str, Path], qtbot: QtBot
) -> None:
    listed_runs(page, qtbot)
    for row, serial, verdict in ((3, "SN-000003", "STOPPED"), (1, "SN-000002", "PARTIAL"), (2, "SN-000001", "FAIL")):
        select_row(page, row, qtbot)
        assert rows(page)[row] == (serial, verdict)
        assert page.details.badge.text().removesuffix(", log missing") == verdict
        assert page.details._serial.text() == serial
        assert page.details.failed_label.isVisible() == (verdict == "FAIL")
    select_row(page, 1, qtbot)
    assert page.details.reason_label.text() == "Only Rate: all solved values are within their limits."


def test_failed_partial_run_has_the_same_words_in_the_list_and_the_details(
    page: HistoryPage, runs: dict[str, Path], folder: Path, qtbot: QtBot
) -> None:
    listed_runs(page, qtbot)
    write_run(folder, "SN-000009", "failed", timedelta(minutes=1), bias=5.0, partial=True)
    page.refresh()
    qtbot.waitUntil(lambda: not page.busy and rows(page)[0][0] == "SN-000009", timeout=WAIT)
    select_row(page, 0, qtbot)
    assert rows(page)[0][1] == "FAIL (partial)"
    assert page.details.badge.text() == "FAIL (partial), log missing"
    language.use("zh_CN")
    qtbot.wait(10)
    assert rows(page)[0][1] == "不合格（部分）"
    assert page.details.badge.text().startswith("不合格（部分）")
    language.use("en")


@pytest.mark.parametrize("name", ["en", "zh_CN"])
def test_changed_result_is_a_caution_and_has_its_own_filter(
    page: HistoryPage, runs: dict[str, Path], qtbot: QtBot, name: str
) -> None:
    language.use(name)
    listed_runs(page, qtbot)
    runs["old"].write_text(runs["old"].read_text("utf-8").replace("Zhang Min", "Li Wei"), "utf-8")
    page.refresh()
    listed_runs(page, qtbot)
    changed, passed = say("badge.altered"), say("badge.passed")
    assert rows(page)[-1] == ("SN-000001", changed)
    choose(page, "outcome", passed)
    assert rows(page) == [("SN-000001", passed)]
    plots = page.details.trend.findChild(ThemedPlot).items()
    dots = [point for item in plots if isinstance(item, ScatterPlotItem) for point in item.points()]
    assert [dot.symbol() for dot in dots] == ["t1", "x", "o"]
    assert dots[0].pen().color() == state_colour("caution")
    choose(page, "outcome", changed)
    assert listed_runs(page, qtbot) == [("SN-000001", changed)]
    index, role = page.table.model().index(0, 0), Qt.ItemDataRole
    assert page.table.model().data(index, role.ForegroundRole) == state_colour("caution")
    assert page.table.model().data(index, role.DecorationRole).cacheKey() == state_icon("caution").cacheKey()
    assert page.details.badge._icon._kind == "caution"


def test_trend_shows_the_time_of_day(page: HistoryPage, runs: dict[str, Path], qtbot: QtBot) -> None:
    listed_runs(page, qtbot)
    (ticks,) = page.details.trend._plot.getAxis("bottom")._tickLevels
    local = (NOW - timedelta(hours=1)).astimezone()
    assert ticks[-1][1] == f"{local:%Y-%m-%d}\n{local:%H:%M}"


def test_details_fit_on_a_small_screen(page: HistoryPage, runs: dict[str, Path], qtbot: QtBot) -> None:
    page.resize(1280, 576)  # in a window of 1280x720
    listed_runs(page, qtbot)
    select_row(page, 2, qtbot)
    bar = page.details.content_area.horizontalScrollBar()
    qtbot.waitUntil(lambda: bar.maximum() == 0, timeout=WAIT)
    page.details.content_area.setMaximumWidth(300)
    qtbot.waitUntil(lambda: bar.maximum() > 0 and bar.isVisible(), timeout=WAIT)


def test_offline_solutions_are_listed_in_the_details(
    page: HistoryPage, runs: dict[str, Path], folder: Path, qtbot: QtBot
) -> None:
    log = runs["new"].with_suffix(".h5").name
    append_resolve(folder, replace(RECORD, log=log))
    append_resolve(folder, replace(RECORD, log=log, by="wang", difference=OnlineDifference(True, "gyro_bias_x", 0.0)))
    listed_runs(page, qtbot)
    table = page.findChild(QTableView, "resolves_table")
    qtbot.waitUntil(table.isVisible)
    texts = [[table.model().index(row, k).data() for k in (1, 2, 4)] for row in range(table.model().rowCount())]
    assert texts == [["wang", "identical bit for bit", "0–9"], ["li", "0.50 σ, gyro bias x", "0–9"]]
    select_row(page, 1, qtbot)
    assert not table.isVisible()
    path = resolve_file(folder).path
    path.write_text(path.read_text("utf-8").replace('"wang"', '"zhou"'), "utf-8")
    select_row(page, 0, qtbot)
    assert not table.isVisible()
    assert any("resolves.jsonl, line 2" in text for text in visible_texts(page))


def test_every_disabled_list_button_has_a_tooltip(page: HistoryPage, qtbot: QtBot) -> None:
    listed_runs(page, qtbot)
    for name in ("history_compare_button", "history_export_button"):
        widget = page.findChild(QPushButton, name)
        assert not widget.isEnabled()
        assert widget.toolTip()


def test_units_of_a_batch_are_listed_together(page: HistoryPage, folder: Path, qtbot: QtBot) -> None:
    hour = timedelta(hours=1)
    write_run(folder, "SN-000009", "passed", 2 * hour)
    listed_runs(page, qtbot)
    table = page.table
    headings = base.table_headings(page)
    batch, slot, stages = (headings.index(name) for name in ("Batch", "Slot", "Stages"))
    assert table.isColumnHidden(batch)
    assert table.isColumnHidden(slot)
    assert not button(page, "history_batch_button").isVisible()

    for name, age in (("A", hour), ("B", hour)):
        write_run(folder, f"SN-00000{name}", "passed", age, batch="B20261101T000000-00FF", slot=name)
    write_run(folder, "SN-000008", "passed", 3 * hour, batch="B20261101T090000-00FF", slot="A")
    page.refresh()
    qtbot.waitUntil(lambda: len(rows(page)) == 4, timeout=WAIT)
    assert not table.isColumnHidden(slot)
    needed = table.fontMetrics().horizontalAdvance("B20261101T000000-00FF")
    for width, stages_hidden in ((2400, False), (1120, True)):
        page.resize(width, 640)
        qtbot.waitUntil(lambda hidden=stages_hidden: table.isColumnHidden(stages) == hidden, timeout=WAIT)
        assert not table.isColumnHidden(batch)
        assert not table.horizontalScrollBar().isVisible()
        assert table.columnWidth(batch) > needed or stages_hidden
    select_row(page, 0, qtbot)
    assert {table.model().index(row, slot).data() for row in (0, 1)} == {"A", "B"}
    qtbot.waitUntil(lambda: "B20261101T000000-00FF" in visible_texts(page), timeout=WAIT)
    qtbot.mouseClick(button(page, "history_batch_button"), Qt.MouseButton.LeftButton)
    qtbot.waitUntil(lambda: len(rows(page)) == 2, timeout=WAIT)
    assert {serial for serial, _ in rows(page)} == {"SN-00000A", "SN-00000B"}


@pytest.mark.parametrize(("code", "name"), [("en", "Attempts without a run"), ("zh_CN", "缺少记录（第几次）")])
def test_details_name_the_attempts_without_a_run(
    page: HistoryPage, folder: Path, qtbot: QtBot, code: str, name: str
) -> None:
    write_run(folder, "SN-000001", "failed", timedelta(hours=2), attempt=4)
    language.use(code)
    listed_runs(page, qtbot)
    qtbot.waitUntil(lambda: "1–3" in visible_texts(page), timeout=WAIT)
    texts = visible_texts(page)
    assert texts[texts.index("1–3") - 1] == name
    language.use("en")


def test_values_are_plotted_relative_to_the_limits_of_their_own_run(
    page: HistoryPage, folder: Path, qtbot: QtBot
) -> None:
    """A run within its own, wider limits is not drawn outside those of another run."""
    write_run(folder, "SN-000001", "passed", timedelta(hours=2))
    wide = [check_row("within", "gyro_bias_x", 5.0, [-10.0 * DEGREE_PER_HOUR, 10.0 * DEGREE_PER_HOUR], passed=True)]
    write_run(folder, "SN-000001", "passed", timedelta(hours=1), bias=5.0, checks=wide)
    listed_runs(page, qtbot)
    compare(page, (0, 1), qtbot)
    symbols = [item for item in page._comparison.plot.getPlotItem().items if hasattr(item, "points")]
    drawn = [[point.pos().x() for point in item.points()] for item in symbols]
    assert drawn == [[pytest.approx(1.0 / 3.0)], [pytest.approx(0.5)]]
