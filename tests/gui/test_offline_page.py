"""The offline page: a log is opened, plotted, solved again over a range, compared and exported."""

import json
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import h5py
import numpy as np
import pyqtgraph as pg
import pytest
from PySide6.QtCore import QEvent, QMimeData, QPoint, QPointF, Qt, QUrl
from PySide6.QtGui import QDragEnterEvent, QDropEvent, QMouseEvent
from PySide6.QtWidgets import (
    QApplication,
    QCheckBox,
    QFileDialog,
    QLabel,
    QLineEdit,
    QPushButton,
    QTableView,
    QWidget,
)
from pytestqt.qtbot import QtBot

from calstation.bench import BenchConfig
from calstation.bench.truth import Simulator
from calstation.estimation.common import SampleBlock
from calstation.gui.history import HistoryPage
from calstation.gui.logs import OfflinePage
from calstation.gui.logs.comparison import Comparison
from calstation.gui.logs.range_bar import CountSpin
from calstation.gui.logs.source_bar import SourceBar
from calstation.gui.shell.main_window import MainWindow
from calstation.gui.state import AppContext
from calstation.gui.text import language
from calstation.records import LogMeta, RawLogWriter
from calstation.results import Resolved, resolve
from tests.check_rows import check_row
from tests.cli.conftest import META as CSV_META
from tests.cli.conftest import six_position_rows, write_log
from tests.estimation.simulated_stages import block_of, simulate
from tests.gui.conftest import result_with
from tests.gui.plot_mouse import move_mouse, pixel
from tests.shared_runs import SharedRuns

pytestmark = pytest.mark.timeout(120)
#: Longest wait for a job, ms: a loaded machine is no failure.
WAIT = 60_000

SIMULATED = {
    "site": {"latitude_deg": 34.25, "longitude_deg": 108.9, "height_m": 400, "azimuth_deg": 0.0},
    "imu": {
        "serial": "SIM",
        "output": "increment",
        "gyro_arw": 2.9e-7,
        "accel_vrw": 4.9e-5,
    },
}
#: A sequence number that no 32-bit box holds.
FAR = 2**33 + 5


@pytest.fixture(scope="module")
def run_log(tmp_path_factory: pytest.TempPathFactory, shared_runs: SharedRuns) -> Path:
    """The log of a real run of two stages that passed; the product has more."""
    ended = shared_runs.passed(tmp_path_factory.mktemp("run"), "rate", "six_position")
    assert ended.verdict == "partial"
    return Path(ended.log)


@pytest.fixture(scope="module")
def long_log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log of an excitation at 1 kHz that takes some seconds to solve, with high sequence numbers."""
    truth = BenchConfig(grade="nav", seed=7, sample_rate_hz=1000.0).truth()
    block = block_of(simulate(Simulator(truth, 7), truth, "excitation"))
    imu = {
        **SIMULATED["imu"],
        "sample_rate_hz": 1000.0,
        "gyro_lsb": truth.imu.gyro_lsb,
        "accel_lsb": truth.imu.accel_lsb,
    }
    path = tmp_path_factory.mktemp("long") / "long.h5"
    writer = RawLogWriter(path, LogMeta.model_validate({**SIMULATED, "imu": imu}))
    moved = SampleBlock(
        block.stage,
        block.seq + FAR,
        block.time,
        block.counts,
        block.angles,
        block.step,
        block.valid,
        block.temperature,
    )
    writer.append(moved)
    writer.close("imported")
    return path


@pytest.fixture(autouse=True)
def unlimited_mouse_rate(monkeypatch: pytest.MonkeyPatch) -> None:
    """Disable the limit of mouse moves per second in pyqtgraph, which tests exceed."""
    monkeypatch.setitem(pg.CONFIG_OPTIONS, "mouseRateLimit", 0)


@pytest.fixture
def page(app: AppContext, qtbot: QtBot) -> Iterator[OfflinePage]:
    """The page at its size in a window of 1366x768."""
    app.settings.clear()
    offline_page = OfflinePage(app)
    qtbot.addWidget(offline_page)
    offline_page.resize(1366, 640)
    offline_page.show()
    qtbot.waitExposed(offline_page)
    yield offline_page
    for watch in (offline_page.reader, offline_page.solver, offline_page.exports.watch):
        watch.cancel()


def opened(page: OfflinePage, path: Path, qtbot: QtBot) -> OfflinePage:
    """The page with a log opened by typing its path."""
    edit = page.findChild(QLineEdit, "log_edit")
    edit.setText(str(path))
    qtbot.keyClick(edit, Qt.Key.Key_Return)
    qtbot.waitUntil(lambda: page.log is not None or page.notice.isVisible(), timeout=WAIT)
    assert page.log is not None, page.notice.text_label.text()
    return page


def spins(page: OfflinePage) -> tuple[CountSpin, CountSpin]:
    """Return the spin boxes of the range."""
    first, last = page.findChild(CountSpin, "first_seq_spin"), page.findChild(CountSpin, "last_seq_spin")
    assert first is not None
    assert last is not None
    return first, last


def solve(page: OfflinePage, qtbot: QtBot) -> None:
    """Press the button and wait for a result or an error."""
    button(page, "solve_button").click()
    qtbot.waitUntil(lambda: button(page, "solve_button").isVisible(), timeout=WAIT)


def button(page: QWidget, name: str) -> QPushButton:
    """Return a button by its name."""
    widget = page.findChild(QPushButton, name)
    assert widget is not None
    return widget


def cells(page: OfflinePage, column: str) -> dict[str, str]:
    """Return a column of the comparison by parameter."""
    table = page.findChild(QTableView, "comparison_table")
    model = table.model()
    headings = [model.headerData(i, Qt.Orientation.Horizontal) for i in range(model.columnCount())]
    k = headings.index(column)
    return {model.headerData(i, Qt.Orientation.Vertical): model.index(i, k).data() for i in range(model.rowCount())}


def save_as(page: OfflinePage, name: str, target: Path, kind: int, qtbot: QtBot) -> None:
    """Press an export button and choose a file in its dialog."""
    button(page, name).click()
    dialogs = page.findChildren(QFileDialog)
    assert len(dialogs) == 1
    dialog = dialogs[0]
    filters = dialog.nameFilters()
    dialog.selectNameFilter(filters[kind])
    dialog.filterSelected.emit(filters[kind])
    dialog.setDirectory(str(target.parent))
    dialog.selectFile(target.name)
    dialog.accept()
    qtbot.waitUntil(lambda: page.notice.isVisible(), timeout=WAIT)


@pytest.mark.long
def test_pasted_path_is_opened_without_pressing_enter(page: OfflinePage, run_log: Path, qtbot: QtBot) -> None:
    edit = page.findChild(QLineEdit, "log_edit")
    edit.setText(str(run_log.with_suffix(".json")))
    edit.setText(str(run_log))
    qtbot.waitUntil(lambda: button(page, "solve_button").isEnabled(), timeout=WAIT)
    assert page.log is not None


def test_empty_page_explains_what_to_do(page: OfflinePage) -> None:
    solve_button = button(page, "solve_button")
    assert not solve_button.isEnabled()
    assert solve_button.toolTip() == "Open a log first"


@pytest.mark.long
@pytest.mark.parametrize(
    ("code", "words"),
    [
        ("en", "This log contains no stage of a calibration. “Multi-position” above solves rests"),
        ("zh_CN", "此记录不含任何标定阶段。上方的“"),
    ],
)
def test_log_without_stages_says_what_solves_it(
    window: MainWindow, page: OfflinePage, tmp_path: Path, qtbot: QtBot, code: str, words: str
) -> None:
    window.app.set_language(code)
    path, count = tmp_path / "log.h5", 1000
    imu = {**SIMULATED["imu"], "sample_rate_hz": 100, "gyro_lsb": 1e-6, "accel_lsb": 1e-6}
    writer = RawLogWriter(path, LogMeta.model_validate({**SIMULATED, "imu": imu}))
    seq, zeros, valid = np.arange(count), np.zeros((count, 6)), np.ones(count, np.bool_)
    writer.append(SampleBlock("", seq, seq / 100, zeros, zeros[:, :2], seq * 0, valid, np.full(count, 20.0)))
    writer.close("imported")
    opened(page, path, qtbot)
    why_not = page.findChild(QLabel, "why_not_solve_label")
    assert why_not.isVisible()
    assert words in why_not.text() == button(page, "solve_button").toolTip()


@pytest.mark.long
def test_same_log_gives_a_bit_identical_result(page: OfflinePage, run_log: Path, qtbot: QtBot) -> None:
    opened(page, run_log, qtbot)
    assert page.comparison.online_badge.text() == "PARTIAL, simulated"
    assert "–" in set(cells(page, "offline").values())
    solve(page, qtbot)
    assert page.comparison.difference_badge.text() == "Identical bit for bit"
    assert page.comparison.offline_badge.text().startswith("Partial: within the limits")
    stored = json.loads(run_log.with_suffix(".json").read_text("utf-8"))["parameters"]
    assert page.solved is not None
    assert page.solved.result.to_json()["parameters"] == stored
    assert set(cells(page, "in σ").values()) == {"0"}
    assert set(cells(page, "unit")) == set(stored)


@pytest.mark.long
def test_solution_is_shown_even_if_it_cannot_be_recorded(
    page: OfflinePage, run_log: Path, tmp_path: Path, qtbot: QtBot
) -> None:
    log = Path(shutil.copy(run_log, tmp_path))
    (tmp_path / "resolves.jsonl").mkdir()
    opened(page, log, qtbot)
    solve(page, qtbot)
    assert page.comparison.difference_badge.text() == "Identical bit for bit"
    assert "The solution is not recorded" in page.comparison.note_label.text()


@pytest.mark.long
def test_a_range_entered_in_the_boxes_is_solved(page: OfflinePage, run_log: Path, qtbot: QtBot) -> None:
    opened(page, run_log, qtbot)
    assert page.log is not None
    facts, (rate, _) = page.log.facts, page.log.spans
    first, last = spins(page)
    assert (first.value(), last.value()) == (facts.first_seq, facts.last_seq)
    last.setValue(rate.last_seq)
    first.setValue(rate.first_seq)
    assert not page.findChild(QCheckBox, "offline_stage_check_six_position").isEnabled()
    solve(page, qtbot)
    assert page.solved is not None
    expected = resolve(run_log, None, rate.first_seq, rate.last_seq).result.to_json()
    assert page.solved.result.to_json() == expected
    assert expected["stages"] == ["rate"]
    assert f"samples {rate.first_seq} to {rate.last_seq}" in page.comparison.note_label.text()
    # and dragged further in, so far that a turn is missing
    drag_edge(page, 1, 0.15)
    assert last.value() < rate.last_seq
    solve(page, qtbot)
    assert page.notice.isVisible()
    said = page.notice.text_label.text()
    assert "Include both directions about every axis" in said
    assert "--" not in said
    assert page.solved.result.to_json() == expected  # the earlier solution is kept


@pytest.mark.long
def test_result_of_another_selection_is_outdated_and_not_exported(
    page: OfflinePage, run_log: Path, tmp_path: Path, qtbot: QtBot
) -> None:
    opened(page, run_log, qtbot)
    solve(page, qtbot)
    export, (first, last) = button(page, "export_result_button"), spins(page)
    stage = page.findChild(QCheckBox, "offline_stage_check_rate")
    inside = page.comparison.offline_badge.text()
    assert "within the limits" in inside
    start, end = first.value(), last.value()
    for change, undo in (
        (lambda: last.setValue(end - 10), lambda: last.setValue(end)),
        (lambda: first.setValue(start + 10), lambda: first.setValue(start)),
        (stage.click, stage.click),
    ):
        assert export.isEnabled()
        assert page.comparison.offline_badge.text() == inside
        change()
        assert "the range or the stages have changed" in page.comparison.offline_badge.text()
        assert not page.comparison.difference_badge.isVisible()
        assert set(cells(page, "outdated")) == set(cells(page, "unit"))
        assert not export.isEnabled()
        assert "solve again first" in export.toolTip()
        undo()
    stage.click()
    solve(page, qtbot)
    assert export.isEnabled()
    assert "Stages solved: Six positions." in page.comparison.note_label.text()

    copy = shutil.copyfile(run_log, tmp_path / "copy.h5")
    page.open(copy)
    qtbot.waitUntil(lambda: page.log is not None and page.log.path == copy, timeout=WAIT)
    assert page.comparison.offline_badge.text() == "Not solved yet"
    assert not export.isEnabled()


def drag_edge(page: OfflinePage, edge: int, to: float) -> None:
    """Drag edge 0 or 1 of the range to a fraction of the view with the mouse."""
    view = page.plot.findChild(QWidget, "log_graph").viewport()
    box = page.plot._plots[0].getViewBox()
    height = box.mapToScene(box.boundingRect().center()).y()
    left, right = page.plot.view

    def pixel(seconds: float) -> QPointF:
        return QPointF(box.mapViewToScene(QPointF(seconds, 0.0)).x(), height)

    start = pixel(page.plot._ranges[0].getRegion()[edge])
    stop = pixel(left + to * (right - left))
    middle = QPointF((start.x() + stop.x()) / 2, height)
    press, move, release = (
        QEvent.Type.MouseButtonPress,
        QEvent.Type.MouseMove,
        QEvent.Type.MouseButtonRelease,
    )
    steps = ((press, start), (move, middle), (move, stop), (release, stop))
    for kind, position in ((QEvent.Type.MouseMove, start), *steps):
        held = Qt.MouseButton.NoButton if kind == release else Qt.MouseButton.LeftButton
        if (kind, position) == (move, start):
            held = Qt.MouseButton.NoButton
        pressed = Qt.MouseButton.NoButton if kind == move else Qt.MouseButton.LeftButton
        event = QMouseEvent(kind, position, view.mapToGlobal(position), pressed, held, Qt.KeyboardModifier.NoModifier)
        QApplication.sendEvent(view, event)
        QApplication.processEvents()


@pytest.mark.long
def test_range_boxes_and_plot_region_stay_synchronised_within_the_log(
    page: OfflinePage, long_log: Path, qtbot: QtBot
) -> None:
    opened(page, long_log, qtbot)
    assert page.log is not None
    facts = page.log.facts
    first, last = spins(page)
    assert first.value() == FAR
    first.setValue(FAR + 100_000)
    start, _ = page.plot._ranges[0].getRegion()
    assert start == pytest.approx(100.0)
    drag_edge(page, 1, 0.6)
    assert first.value() == FAR + 100_000
    assert FAR + 100_000 < last.value() < facts.last_seq
    assert page.plot._ranges[0].getRegion()[1] == pytest.approx((last.value() + 1 - FAR) / 1000.0)
    first.setValue(2**52)
    assert first.value() == last.value()
    assert "cannot be after the last" in page.range.note_label.text()
    last.setValue(0)
    assert last.value() == first.value()
    assert "cannot be before the first" in page.range.note_label.text()
    assert button(page, "export_log_button").text() == "Export range…"
    last.lineEdit().selectAll()
    qtbot.keyClicks(last.lineEdit(), "7")
    qtbot.keyClick(last, Qt.Key.Key_Return)
    assert "7 is not in this log" in page.range.note_label.text()
    page.range.set_button.menu().actions()[0].trigger()
    assert (first.value(), last.value()) == (facts.first_seq, facts.last_seq)


def test_number_outside_the_log_does_not_change_the_range(page: OfflinePage, run_log: Path, qtbot: QtBot) -> None:
    opened(page, run_log, qtbot)
    assert page.log is not None
    facts = page.log.facts
    first, last = spins(page)
    first.setValue(100)
    outside = f"{10 * (facts.last_seq + 1)}"
    for spin, typed in ((last, outside), (first, "12.5"), (last, f"{facts.last_seq + 1}")):
        spin.setFocus()
        spin.selectAll()
        qtbot.keyClicks(spin, typed)
        assert spin.lineEdit().text() == typed
        assert f"{typed} is not" not in page.range.note_label.text()
        qtbot.keyClick(spin, Qt.Key.Key_Tab)
        assert (first.value(), last.value()) == (100, facts.last_seq)
        assert f"{typed} is not in this log" in page.range.note_label.text()
        assert spin.lineEdit().text() == typed
    assert page.range.note_label.text().startswith("12.5 is not in this log")
    language.use("zh_CN")
    assert f"{facts.last_seq + 1} 不在此记录内" in page.range.note_label.text()
    language.use("en")
    edit = page.findChild(QLineEdit, "log_edit")
    edit.clear()
    qtbot.keyClicks(edit, str(run_log))
    qtbot.keyClick(edit, Qt.Key.Key_Return)
    qtbot.waitUntil(lambda: first.value() == facts.first_seq, timeout=WAIT)
    assert not page.range.note_label.isVisible()


@pytest.mark.parametrize(
    ("code", "words"), [("en", "999999999 is not in this log"), ("zh_CN", "999999999 不在此记录内")]
)
def test_rejected_number_remains_and_nothing_starts_until_it_is_corrected(
    page: OfflinePage, run_log: Path, qtbot: QtBot, code: str, words: str
) -> None:
    language.use(code)
    opened(page, run_log, qtbot)
    assert page.log is not None
    facts, note, (first, last) = page.log.facts, page.range.note_label, spins(page)
    solve_button = button(page, "solve_button")

    def enter(typed: str) -> None:
        last.setFocus()
        last.selectAll()
        qtbot.keyClicks(last, typed)
        qtbot.mouseClick(solve_button, Qt.MouseButton.LeftButton)

    enter("999999999")
    assert page.solver.job is None
    assert last.lineEdit().text() == "999999999"
    assert (first.property("invalid"), last.property("invalid")) == (None, True), "one border is red"
    for name in ("solve_button", "export_log_button", "allan_button"):
        assert not button(page, name).isEnabled()
        assert button(page, name).toolTip().startswith(words)
    first.setFocus()
    page.range.hide()
    page.range.show()
    assert last.lineEdit().text() == "999999999"
    first.setValue(facts.first_seq + 10)  # the other box is limited, but does not hide the rejected number
    assert last.lineEdit().text() == "999999999"
    assert note.text().startswith(words)

    page.range.set_button.menu().actions()[0].trigger()
    assert not note.isVisible()
    assert not last.property("invalid")
    assert last.value() == int(last.lineEdit().text()) == facts.last_seq
    enter("999999999")
    assert note.isVisible()
    drag_edge(page, 1, 0.6)
    assert not note.isVisible()
    assert solve_button.isEnabled()
    assert last.value() == int(last.lineEdit().text()) < facts.last_seq
    enter("999999999")
    qtbot.keyClick(last, Qt.Key.Key_Down)
    assert not note.isVisible()
    assert solve_button.isEnabled()
    language.use("en")


def test_sigma_above_its_limit_marks_only_the_sigma(qtbot: QtBot) -> None:
    row = {"value": 1e-4, "sigma": 1e-6, "unit": "1", "stage": "rate"}
    checks = [
        check_row("within", "gyro_scale_x", 1.0, 1.0, passed=True, unit="1"),
        check_row("sigma_below", "gyro_scale_x", 1.0, 1.0, passed=False, unit="1"),
        check_row("within", "gyro_scale_y", 1.0, 1.0, passed=False, unit="1"),
    ]
    parameters = {"gyro_scale_x": row, "gyro_scale_y": row}
    log = {"file": "log.h5", "first_seq": 0, "last_seq": 9}
    result = {"parameters": parameters, "checks": checks, "unobservable": [], "passed": False, "log": log}
    shown = Comparison()
    qtbot.addWidget(shown)
    before = result_with(**result, outcome="failed", stages=["rate"])
    shown.show_log(SimpleNamespace(stored=before, facts=SimpleNamespace(first_seq=0, last_seq=9)))  # type: ignore[arg-type]
    shown.show_solved(Resolved(result_with(**result, stages=["rate"], outcome="resolved"), ()))
    model = shown.table.model()
    states = [[model.index(line, column).data(Qt.ItemDataRole.UserRole) for column in (3, 4)] for line in (0, 1)]
    assert states == [[None, "bad"], ["bad", None]]


def test_latest_runs_are_listed_below_recent_logs(app: AppContext, qtbot: QtBot) -> None:
    app.settings.clear()
    bar = SourceBar(app.settings, lambda: [Path("/runs/b.h5"), Path("/runs/a.h5")])
    qtbot.addWidget(bar)
    assert bar.recent_button.isEnabled()
    bar.remember(Path("/runs/a.h5"))
    offered = [action.text().split()[0] for action in bar.recent_button.menu().actions() if action.text()]
    assert offered == ["a.h5", "Latest", "b.h5"]


@pytest.mark.long
def test_zooming_reaches_single_samples(page: OfflinePage, long_log: Path, qtbot: QtBot) -> None:
    opened(page, long_log, qtbot)
    assert page.log is not None
    assert page.plot.samples_per_column > 100
    assert sum(len(curve.xData) for curve in page.plot._curves.values()) <= 9 * 2 * 1100
    for _ in range(11):
        button(page, "zoom_in_button").click()
    qtbot.waitUntil(lambda: page.plot.samples_per_column == 1, timeout=WAIT)
    left, right = page.plot.view
    assert right - left < 1.0
    button(page, "zoom_all_button").click()
    qtbot.waitUntil(lambda: page.plot.samples_per_column > 100, timeout=WAIT)


def test_running_solution_is_cancelled(page: OfflinePage, long_log: Path, qtbot: QtBot) -> None:
    opened(page, long_log, qtbot)
    fractions: list[float] = []
    page.solver.progress.connect(lambda fraction, _: fractions.append(fraction))
    button(page, "solve_button").click()
    assert button(page, "solve_cancel_button").isVisible()
    assert not page.findChild(QLineEdit, "log_edit").isEnabled()
    qtbot.waitUntil(lambda: max(fractions, default=0.0) > 0.02, timeout=WAIT)
    button(page, "solve_cancel_button").click()
    qtbot.waitUntil(lambda: button(page, "solve_button").isVisible(), timeout=WAIT)
    assert page.solved is None
    assert button(page, "solve_button").isEnabled()


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("notes.doc", "The file is not a log."),
        ("broken.h5", "The file is damaged, cut short or not a raw log."),
        ("alone.csv", "No such file"),
        ("nowhere.h5", "No such file"),
    ],
)
def test_file_that_is_not_a_log_is_refused_with_a_reason(
    page: OfflinePage, name: str, said: str, tmp_path: Path, qtbot: QtBot
) -> None:
    if name != "nowhere.h5":
        (tmp_path / name).write_text("seq,time_s\n", "utf-8")
    page.open(tmp_path / name)
    qtbot.waitUntil(lambda: page.notice.isVisible(), timeout=WAIT)
    assert said in page.notice.text_label.text()
    assert page.log is None


def test_dropped_csv_is_opened_and_a_dropped_image_is_not(page: OfflinePage, tmp_path: Path, qtbot: QtBot) -> None:
    log = write_log(tmp_path, six_position_rows(), meta=CSV_META)
    for name, taken in (("picture.png", False), (log.name, True)):
        mime = QMimeData()
        mime.setUrls([QUrl.fromLocalFile(str(tmp_path / name))])
        how = (Qt.DropAction.CopyAction, mime, Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier)
        QApplication.sendEvent(page, QDragEnterEvent(QPoint(50, 50), *how))
        QApplication.sendEvent(page, QDropEvent(QPointF(50, 50), *how))
        assert page.reader.busy == taken
    qtbot.waitUntil(lambda: page.log is not None, timeout=WAIT)
    assert page.comparison.online_badge.text() == "The log contains no result of a run"
    solve(page, qtbot)
    assert page.solved is not None
    assert page.solved.result.to_json()["parameters"] == resolve(log).result.to_json()["parameters"]
    assert [path.name for path in page.source.recent()] == [log.name]


@pytest.mark.long
def test_log_and_result_are_exported(page: OfflinePage, run_log: Path, tmp_path: Path, qtbot: QtBot) -> None:
    opened(page, run_log, qtbot)
    solve(page, qtbot)
    assert page.solved is not None
    save_as(page, "export_result_button", tmp_path / "answer", 0, qtbot)
    assert json.loads((tmp_path / "answer.json").read_text("utf-8")) == page.solved.result.to_json()
    save_as(page, "export_result_button", tmp_path / "answer", 1, qtbot)
    rows = (tmp_path / "answer.csv").read_text("utf-8").splitlines()
    assert len(rows) == 1 + len(page.solved.result.to_json()["parameters"])
    save_as(page, "export_log_button", tmp_path / "copy", 0, qtbot)
    for name in ("copy.csv", "copy.toml"):
        assert (tmp_path / name).is_file()
        assert str(tmp_path / name) in page.notice.text_label.text()
    copy = resolve(tmp_path / "copy.csv").result.to_json()["parameters"]
    assert copy == page.solved.result.to_json()["parameters"]


def test_cancelled_export_leaves_no_file(page: OfflinePage, long_log: Path, tmp_path: Path, qtbot: QtBot) -> None:
    opened(page, long_log, qtbot)
    target = tmp_path / "out" / "copy.csv"
    target.parent.mkdir()
    button(page, "export_log_button").click()
    dialog = page.findChild(QFileDialog)
    dialog.setDirectory(str(target.parent))
    dialog.selectFile(target.name)
    dialog.accept()
    qtbot.waitUntil(lambda: any(target.parent.iterdir()), timeout=WAIT)
    button(page, "export_cancel_button").click()
    qtbot.waitUntil(lambda: not any(target.parent.iterdir()), timeout=WAIT)
    assert button(page, "export_log_button").isEnabled()


def readable(page: OfflinePage) -> list[str]:
    """Return the visible texts of labels, buttons and tables, except bare numbers and units."""
    widgets = [*page.findChildren(QLabel), *page.findChildren(QPushButton)]
    said = [text for widget in widgets if widget.isVisible() for text in (widget.text(), widget.toolTip())]
    for table in filter(QTableView.isVisible, page.findChildren(QTableView)):
        model = table.model()
        across, down = range(model.columnCount()), range(model.rowCount())
        said += [str(model.headerData(k, Qt.Orientation.Horizontal)) for k in across]
        names = (model.headerData(k, Qt.Orientation.Vertical, Qt.ItemDataRole.AccessibleTextRole) for k in down)
        said += [str(name or "") for name in names]
        said += [str(model.index(i, k).data()) for i in down for k in across]
    return [text for text in said if re.search(r"[A-Za-z\u4e00-\u9fff]{4,}", text)]


@pytest.mark.long
def test_all_texts_about_a_solved_log_follow_the_language(window: MainWindow, run_log: Path, qtbot: QtBot) -> None:
    window.show_page("offline_page")
    page, languages = window.offline_page, window.language_combo
    opened(page, run_log, qtbot)
    solve(page, qtbot)
    button(page, "allan_button").click()  # the table moves, so the notice says why there is none
    qtbot.waitUntil(lambda: page.notice.isVisible(), timeout=WAIT)
    spins(page)[0].setValue(spins(page)[1].value())
    graph = page.findChild(pg.GraphicsLayoutWidget, "log_graph")
    move_mouse(graph, pixel(graph, page.plot._plots[0].getViewBox(), 0.6, 0.5))
    pointer = page.findChild(QLabel, "pointer_label")
    assert "Sample" in pointer.text()
    english = readable(page)
    qtbot.keyClick(languages, Qt.Key.Key_Down)
    assert language.current() == "zh_CN"
    assert "采样点" in pointer.text()
    assert [text for text in readable(page) if not re.search(r"[\u4e00-\u9fff]", text)] == []
    qtbot.keyClick(languages, Qt.Key.Key_Up)
    assert readable(page) == english


@pytest.mark.long
def test_history_page_opens_a_log_on_the_offline_page(window: MainWindow, run_log: Path, qtbot: QtBot) -> None:
    window.app.runs_folder = run_log.parent
    window.show_page("history_page")
    history, offline = window.findChild(HistoryPage), window.offline_page
    assert isinstance(history, HistoryPage)
    qtbot.waitUntil(lambda: history.table.run is not None, timeout=WAIT)
    button(history, "history_log_button").click()
    assert offline.isVisible()
    qtbot.waitUntil(lambda: offline.log is not None, timeout=WAIT)
    window.app.set_language("zh_CN")
    qtbot.waitUntil(lambda: button(offline, "solve_button").text() == "开始离线解算", timeout=WAIT)
    solve(offline, qtbot)
    assert offline.comparison.difference_badge.text() == "逐位完全一致"


def test_damaged_rows_are_reported_before_and_after_solving(
    page: OfflinePage, run_log: Path, tmp_path: Path, qtbot: QtBot
) -> None:
    path = tmp_path / "damaged.h5"
    shutil.copyfile(run_log, path)
    with h5py.File(path, "r+", libver="latest") as file:
        rows = file["samples"][400:410]
        rows["counts"] += 1e6
        file["samples"][400:410] = rows
    opened(page, path, qtbot)
    said = {label.text() for label in page.findChildren(QLabel) if label.isVisible()}
    assert {"gaps: 1", "damaged rows: 10"} <= said
    solve(page, qtbot)
    words = f"10 damaged rows treated as a gap (samples {rows['seq'][0]}…"
    assert words in page.comparison.note_label.text()
