"""The history page on runs whose files were changed, moved or deleted."""

import csv
import json
from datetime import timedelta
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import pytest
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QLabel
from pytestqt.qtbot import QtBot

from calstation.config import library
from calstation.database import export_shared_runs
from calstation.gui.history import HistoryPage
from calstation.gui.logs.comparison import Comparison
from calstation.gui.quality import QualityPage
from calstation.gui.text import language, say
from calstation.records import LogMeta, RawLogWriter, RunFilter
from calstation.reports import read_verified_trail
from calstation.results import History
from calstation.results.plots import LogIndex
from tests.dead_logs import META, NOW
from tests.gui import test_history_page as base
from tests.gui.conftest import Operator
from tests.gui.test_history_lists import choose, combo, compare
from tests.gui.test_history_page import WAIT, button, listed_runs, rows, select_row, write_run
from tests.gui.test_quality_page import click_tab
from tests.gui.test_run_record import press_record
from tests.helpers import exchange_logs, ignore_progress

pytestmark = pytest.mark.timeout(120)
folder, page = base.folder, base.page


def edit(path: Path) -> None:
    """Change the operator in a result file."""
    path.write_text(path.read_text("utf-8").replace("Zhang Min", "Li Wei"), "utf-8")


def write_log(result_file: Path) -> None:
    """Write a closed log without samples, which contains the result in a file, next to this file."""
    run = {**META["run"], "started_utc": NOW.isoformat()}
    writer = RawLogWriter(result_file.with_suffix(".h5"), LogMeta.model_validate({**META, "run": run}))
    writer.add_result(json.loads(result_file.read_text("utf-8")))
    writer.close("failed")


def list_again(page: HistoryPage, qtbot: QtBot) -> None:
    """Read the folder again, and select the first run by a click."""
    page.refresh()
    qtbot.waitUntil(lambda: not page.busy, timeout=WAIT)
    listed_runs(page, qtbot)
    select_row(page, 0, qtbot)
    listed_runs(page, qtbot)


@pytest.mark.parametrize("code", ["en", "zh_CN"])
def test_changed_result_without_a_log_is_compared_with_the_index(
    page: HistoryPage, folder: Path, qtbot: QtBot, code: str
) -> None:
    language.use(code)
    path = write_run(folder, "SN-000001", "failed", timedelta(hours=1), bias=5.0)
    listed_runs(page, qtbot)
    edit(path)
    list_again(page, qtbot)
    reason = page.details.reason_label.text()
    assert ("the index of the runs states FAIL", "标定索引中为“不合格”")[code != "en"] in reason
    assert ("do not move this file", "不要移动该文件")[code != "en"] in reason
    result = button(page, "history_result_button")
    assert not result.isEnabled()
    assert ("was changed after the run", "在标定后被改动")[code != "en"] in result.toolTip()


def test_run_without_its_result_file_keeps_the_reasons_from_its_log(
    page: HistoryPage, folder: Path, qtbot: QtBot
) -> None:
    path = write_run(folder, "SN-000001", "failed", timedelta(hours=1), bias=5.0)
    write_log(path)
    listed_runs(page, qtbot)
    edit(path)
    list_again(page, qtbot)
    reason = page.details.reason_label.text()
    assert "its log states FAIL. Restore the file from a backup" in reason
    assert 'First difference: entry operator: "Zhang Min" in the log, "Li Wei" in the file.' in reason
    path.rename(folder.parent / path.name)
    list_again(page, qtbot)
    details = page.details
    assert (details.badge.text(), details.reason_label.text()) == ("FAIL", "Failed, outside the limits:")
    assert "gyro bias x is 5 °/h; allowed: ±3 °/h" in details.failed_label.text()
    result = button(page, "history_result_button")
    qtbot.mouseClick(result, Qt.MouseButton.LeftButton)
    assert not result.isEnabled()
    assert "the log contains the result" in result.toolTip()


@pytest.mark.parametrize("code", ["en", "zh_CN"])
def test_run_without_files_stays_listed(page: HistoryPage, folder: Path, qtbot: QtBot, code: str) -> None:
    language.use(code)
    gone = write_run(folder, "SN-000001", "failed", timedelta(hours=1), bias=5.0)
    write_run(folder, "SN-000002", "passed", timedelta(hours=2))
    listed_runs(page, qtbot)
    content = gone.read_text("utf-8")
    gone.unlink()
    list_again(page, qtbot)
    badge, passed = say("badge.missing"), say("badge.passed")
    assert rows(page) == [("SN-000001", badge), ("SN-000002", passed)]
    reason = page.details.reason_label.text()
    assert ("are no longer in the folder" if code == "en" else "文件已不在文件夹中") in reason
    assert say("badge.failed") in reason
    counts = {
        "en": "counts in the yield and as an attempt, but not in charts or capability, and is not exported",
        "zh_CN": "仍计入合格率和次数，但不计入控制图和过程能力，也不导出",
    }
    assert counts[code] in reason
    for name in ("result", "log"):
        assert not button(page, f"history_{name}_button").isEnabled()
    assert say("history.export_tip", count=1) == button(page, "history_export_button").toolTip()
    choose(page, "outcome", badge)
    assert rows(page) == [("SN-000001", badge)]
    export = button(page, "history_export_button")
    assert not export.isEnabled()
    assert export.toolTip() == ("There is nothing to export" if code == "en" else "没有可导出的内容")
    choose(page, "outcome", passed)
    assert rows(page) == [("SN-000002", passed)]
    qtbot.mouseClick(button(page, "history_clear_button"), Qt.MouseButton.LeftButton)
    gone.write_text(content, "utf-8")
    list_again(page, qtbot)
    assert rows(page)[0] == ("SN-000001", say("badge.failed"))


def test_run_without_files_counts_only_as_an_attempt(folder: Path) -> None:
    path = write_run(folder, "SN-000001", "passed", timedelta(hours=1))
    history = History(folder)
    history.refresh()
    path.unlink()
    assert (history.refresh(), history.refresh()) == (1, 0)
    assert (history.count(RunFilter()), history.count(RunFilter(missing=True))) == (0, 1)
    assert history.counts(RunFilter(missing=None)) == (1, 0)
    assert not history.of("SN-000001")
    assert not history.passed_units()
    assert history.attempts("SN-000001") == 1
    assert not history.columns().names


@pytest.mark.parametrize(
    ("code", "heading", "every", "unit"),
    [("en", "Product", "Every product", "This unit's runs"), ("zh_CN", "产品型号", "全部产品型号", "该产品历次标定")],
)
def test_words_of_unit_and_product_differ(
    page: HistoryPage, folder: Path, qtbot: QtBot, code: str, heading: str, every: str, unit: str
) -> None:
    write_run(folder, "SN-000001", "passed", timedelta(hours=1))
    language.use(code)
    listed_runs(page, qtbot)
    model = page.table.model()
    headings = [model.headerData(k, Qt.Orientation.Horizontal) for k in range(model.columnCount())]
    assert heading in headings
    assert combo(page, "product").itemText(0) == every
    assert say("history.runs_of_this_unit") == unit


@pytest.mark.parametrize(
    ("code", "caption"),
    [("en", "Unit's runs as nav-a"), ("zh_CN", "按“nav-a”的历次标定")],
)
def test_trend_contains_only_runs_as_the_product_of_the_run(
    page: HistoryPage, folder: Path, qtbot: QtBot, code: str, caption: str
) -> None:
    for hours, product in ((3, "nav-a"), (2, "mems-c"), (1, "nav-a")):
        write_run(folder, "SN-000001", "passed", timedelta(hours=hours), bias=0.1 * hours, product=product)
    language.use(code)
    listed_runs(page, qtbot)
    select_row(page, 0, qtbot)
    trend = page.details.trend
    assert [run.record.product for run in trend._runs] == ["nav-a", "nav-a"]
    assert trend.findChild(QLabel, "trend_label").text().startswith(caption)
    select_row(page, 1, qtbot)
    assert [run.record.product for run in trend._runs] == ["mems-c"]
    language.use("en")


@pytest.mark.long
@pytest.mark.parametrize(
    ("code", "words"),
    [("en", "3 complete runs with PASS or FAIL; 1 of them with missing files"), ("zh_CN", "其中1次文件缺失")],
)
def test_yield_counts_a_failed_run_whose_files_were_deleted(operator: Operator, code: str, words: str) -> None:
    folder = operator.site_folder.runs
    folder.mkdir(exist_ok=True)
    for hours in (2, 3):
        write_run(folder, f"SN-{hours}", "passed", timedelta(hours=hours), product="Navigation grade A")
    failed = write_run(folder, "SN-1", "failed", timedelta(hours=1), bias=9.0, product="Navigation grade A")
    History(folder).refresh()
    failed.unlink()
    operator.window.app.set_product(library.find("products", "nav_a"))
    language.use(code)
    operator.window.show_page("quality_page")
    page = operator.window.findChild(QualityPage, "quality_page")
    click_tab(operator, say("quality.yield"))
    operator.until(lambda: not page.busy and words in page.count_label.text())
    assert "66.7 % (2/3)" in operator.widget("yield_overall_label", QLabel).text()
    language.use("en")


@pytest.mark.parametrize("code", ["en", "zh_CN"])
def test_changed_result_is_compared_by_the_values_of_the_index_and_marked(
    page: HistoryPage, folder: Path, qtbot: QtBot, code: str
) -> None:
    language.use(code)
    path = write_run(folder, "SN-000001", "failed", timedelta(hours=1), bias=5.0)
    write_run(folder, "SN-000001", "passed", timedelta(hours=2))
    listed_runs(page, qtbot)
    edited = json.loads(path.read_text("utf-8"))
    edited["parameters"]["gyro_bias_x"]["value"] /= 5.0
    path.write_text(json.dumps({**edited, "outcome": "passed"}), "utf-8")
    list_again(page, qtbot)
    model = compare(page, (0, 1), qtbot).model()
    assert [model.index(0, k).data().strip() for k in (1, 3)] == ["1.0000", "5.0000"]
    headings = [model.headerData(k, Qt.Orientation.Horizontal) for k in (1, 3)]
    assert [say("badge.altered") in heading for heading in headings] == [False, True]
    assert say("history.compared_without_result") in page._comparison._note.text()
    language.use("en")


@pytest.mark.parametrize("code", ["en", "zh_CN"])
def test_log_of_another_unit_marks_the_run_and_is_named(
    page: HistoryPage, folder: Path, qtbot: QtBot, code: str
) -> None:
    language.use(code)
    path = write_run(folder, "SN-000001", "passed", timedelta(hours=1))
    other = write_run(folder, "SN-000002", "passed", timedelta(hours=2))
    for each in (path, other):
        write_log(each)
    listed_runs(page, qtbot)
    own = path.with_suffix(".h5").read_bytes()
    path.with_suffix(".h5").write_bytes(other.with_suffix(".h5").read_bytes())
    select_row(page, 1, qtbot)
    listed_runs(page, qtbot)
    select_row(page, 0, qtbot)
    listed_runs(page, qtbot)
    assert rows(page) == [("SN-000001", say("badge.altered")), ("SN-000002", say("badge.passed"))]
    assert "SN-000002" in page.details.reason_label.text()
    assert button(page, "history_result_button").toolTip() == say("history.result_changed")
    assert (
        "is not the log of this run" if code == "en" else "不是本次标定的数据记录"
    ) in page.details.reason_label.text()
    (folder / "history.sqlite").unlink()  # a new index finds the same
    history = History(folder)
    history.refresh()
    found = {run.serial: run.badge for run in history.runs()}
    assert found == {"SN-000001": "altered", "SN-000002": "passed"}
    path.with_suffix(".h5").write_bytes(own)
    list_again(page, qtbot)
    assert rows(page)[0] == ("SN-000001", say("badge.passed"))
    language.use("en")


@pytest.mark.parametrize("code", ["en", "zh_CN"])
def test_log_without_its_end_is_named_in_the_details_and_in_the_record(
    page: HistoryPage, folder: Path, qtbot: QtBot, code: str
) -> None:
    language.use(code)
    path = write_run(folder, "SN-000001", "failed", timedelta(hours=1), bias=5.0)
    run = {**META["run"], "started_utc": NOW.isoformat()}
    RawLogWriter(path.with_suffix(".h5"), LogMeta.model_validate({**META, "run": run})).close("failed")
    listed_runs(page, qtbot)
    assert rows(page) == [("SN-000001", say("badge.failed"))]
    assert ("its end is missing" if code == "en" else "缺少结尾") in page.details.reason_label.text()
    assert say("history.failed", failure=say("common.outside_limits")) in page.details.reason_label.text()
    press_record(page, qtbot)
    label = page.record.findChild(QLabel, "no_events_label")
    qtbot.waitUntil(lambda: label.text() == say("history.log_without_events"), timeout=WAIT)
    assert not page.record.events.isVisible()
    language.use("en")


@pytest.mark.parametrize("code", ["en", "zh_CN"])
def test_missing_partial_run_is_not_said_to_count_in_the_yield(
    page: HistoryPage, folder: Path, qtbot: QtBot, code: str
) -> None:
    language.use(code)
    gone = write_run(folder, "SN-000001", "failed", timedelta(hours=1), bias=5.0, partial=True)
    listed_runs(page, qtbot)
    gone.unlink()
    list_again(page, qtbot)
    reason = page.details.reason_label.text()
    assert ("does not count in the yield" if code == "en" else "不计入合格率") in reason
    assert ("counts in the yield and" if code == "en" else "仍计入合格率") not in reason
    language.use("en")


def test_notice_of_success_is_dismissed_with_another_run(page: HistoryPage, folder: Path, qtbot: QtBot) -> None:
    for number in (1, 2):
        write_run(folder, f"SN-00000{number}", "passed", timedelta(hours=number))
    listed_runs(page, qtbot)
    page.notice.inform("good", "operator.label_saved", lambda: "SN-000001.pdf", page.setFocus)
    list_again(page, qtbot)
    assert page.notice.isVisible(), "the same run is selected again"
    select_row(page, 1, qtbot)
    listed_runs(page, qtbot)
    assert not page.notice.isVisible()
    page.notice.inform("bad", "operator.label_saved", lambda: "SN-000002.pdf", page.setFocus)
    select_row(page, 0, qtbot)
    listed_runs(page, qtbot)
    assert page.notice.isVisible(), "a failure is not lost"


@pytest.mark.parametrize("code", ["en", "zh_CN"])
def test_offline_page_states_the_verdict_beside_a_log_without_its_end(folder: Path, qtbot: QtBot, code: str) -> None:
    language.use(code)
    path = write_run(folder, "SN-000001", "failed", timedelta(hours=1), bias=5.0)
    widget = Comparison()
    qtbot.addWidget(widget)
    meta = LogMeta.model_validate({**META, "run": {**META["run"], "started_utc": NOW.isoformat()}})
    index = SimpleNamespace(path=path.with_suffix(".h5"), meta=meta, outcome=None, stored=None)
    widget.show_log(cast("LogIndex", index))
    text = widget.online_badge.text()
    assert say("badge.failed") in text
    assert ("end of this log is missing" if code == "en" else "缺少结尾") in text
    path.unlink()
    widget.show_log(cast("LogIndex", index))
    assert widget.online_badge.text() == say("logs.run_not_ended")
    language.use("en")


@pytest.mark.parametrize("code", ["en", "zh_CN"])
def test_verification_of_the_site_names_runs_with_changed_results(
    page: HistoryPage, folder: Path, qtbot: QtBot, code: str
) -> None:
    language.use(code)
    logged = write_run(folder, "SN-000001", "failed", timedelta(hours=1), bias=5.0)
    write_log(logged)
    alone = write_run(folder, "SN-000002", "failed", timedelta(hours=2), bias=5.0)
    listed_runs(page, qtbot)
    for path in (logged, alone):
        edit(path)
    list_again(page, qtbot)
    station = library.find("stations", "virtual_bench")
    faults = read_verified_trail(lambda *_, **__: None, station, folder).faults
    assert [each.code for each in faults] == ["result.altered", "result.altered_without_log"]
    assert [each.values["file"] for each in faults] == [logged, alone]
    assert ("its log is missing" if code == "en" else "数据记录缺失") in say(faults[1])
    language.use("en")


@pytest.mark.parametrize(("code", "said"), [("en", "differs from the result in its log"), ("zh_CN", "被改动")])
def test_result_that_was_changed_while_the_window_is_open_is_found_by_verification_and_export(
    page: HistoryPage, folder: Path, tmp_path: Path, qtbot: QtBot, code: str, said: str
) -> None:
    language.use(code)
    path = write_run(folder, "SN-000001", "failed", timedelta(hours=1), bias=5.0)
    write_log(path)
    listed_runs(page, qtbot)
    edit(path)
    target = export_shared_runs(ignore_progress, None, folder, RunFilter(), tmp_path / "runs.csv")
    (row,) = csv.DictReader(target.read_text("utf-8-sig").splitlines())
    assert row["result_changed"] == "1"
    again = write_run(folder, "SN-000002", "failed", timedelta(hours=2), bias=5.0)
    write_log(again)
    list_again(page, qtbot)
    edit(again)
    faults = read_verified_trail(ignore_progress, None, folder).faults
    assert [each.values["file"] for each in faults if each.code == "result.altered"] == [path, again]
    assert said in say(faults[-1])
    language.use("en")


@pytest.mark.parametrize("code", ["en", "zh_CN"])
def test_release_that_the_audit_trail_does_not_record_is_named(
    page: HistoryPage, folder: Path, qtbot: QtBot, code: str
) -> None:
    language.use(code)
    path = write_run(folder, "SN-000001", "failed", timedelta(hours=1), bias=5.0)
    write_log(path)
    listed_runs(page, qtbot)
    forged = {"by": "B0002", "confirmed_by": None, "why": "forged", "utc": NOW.isoformat()}
    path.write_text(json.dumps({**json.loads(path.read_text("utf-8")), "override": forged}), "utf-8")
    list_again(page, qtbot)
    assert rows(page) == [("SN-000001", say("badge.altered"))]
    reason = page.details.reason_label.text()
    unrecorded = "the audit trail of this site does not record this release" if code == "en" else "没有此次放行"
    assert unrecorded in reason
    assert "B0002" in reason
    assert "forged" not in reason
    assert ("The outcome is FAIL" if code == "en" else "结论仍为“不合格”") in reason
    assert ("First keep a copy of the file and find out" if code == "en" else "请先保留该文件的副本") in reason
    choose(page, "outcome", say("badge.failed"))
    qtbot.waitUntil(lambda: rows(page) == [("SN-000001", say("badge.altered"))], timeout=WAIT)
    choose(page, "outcome", say("badge.passed"))
    qtbot.waitUntil(lambda: rows(page) == [], timeout=WAIT)
    (fault,) = read_verified_trail(lambda *_, **__: None, None, folder).faults
    assert say(fault) in reason
    assert unrecorded in say(fault)
    language.use("en")


@pytest.mark.parametrize(("code", "said"), [("en", "is not the log of this run"), ("zh_CN", "不是本次标定的数据记录")])
@pytest.mark.parametrize("indexed", [True, False])
def test_exchanged_logs_are_found_by_verification_and_export(
    page: HistoryPage, folder: Path, tmp_path: Path, qtbot: QtBot, code: str, said: str, indexed: bool
) -> None:
    language.use(code)
    paths = [write_run(folder, f"SN-00000{k}", "failed", timedelta(hours=k), bias=5.0) for k in (1, 2)]
    for path in paths:
        write_log(path)
    listed_runs(page, qtbot)
    if indexed:
        list_again(page, qtbot)
    exchange_logs(*paths)
    target = export_shared_runs(ignore_progress, None, folder, RunFilter(), tmp_path / "runs.csv")
    table = csv.DictReader(target.read_text("utf-8-sig").splitlines())
    assert [(row["serial"], row["result_changed"]) for row in table] == [("SN-000001", "1"), ("SN-000002", "1")]
    done: list[float] = []
    faults = read_verified_trail(lambda fraction, **_: done.append(fraction), None, folder).faults
    assert [each.values["log"] for each in faults] == [path.with_suffix(".h5") for path in paths]
    assert all(said in say(each) for each in faults)
    assert done == sorted(done)
    assert done[-1] == 1.0
    page.refresh()
    list_again(page, qtbot)
    assert {state for _, state in rows(page)} == {say("badge.altered")}
    language.use("en")


def test_exchanged_logs_are_found_where_the_runs_have_no_index(folder: Path) -> None:
    paths = [write_run(folder, f"SN-00000{k}", "failed", timedelta(hours=k), bias=5.0) for k in (1, 2)]
    for path in paths:
        write_log(path)
    exchange_logs(*paths)
    for file in folder.glob("history.sqlite*"):
        file.unlink()
    done: list[float] = []
    faults = read_verified_trail(lambda fraction, **_: done.append(fraction), None, folder).faults
    assert done[-1] == 1.0
    assert [each.code for each in faults] == ["result.log_of_other"] * 2
