"""The plot of a log on the offline page: zoom, menu, values under the mouse, channels, texts in both languages."""

from pathlib import Path

import numpy as np
import pyqtgraph as pg
import pytest
from PySide6.QtCore import QPointF, Qt
from PySide6.QtWidgets import QAbstractButton, QFileDialog, QLabel, QPushButton
from pytestqt.qtbot import QtBot

from calstation.estimation.common import SampleBlock
from calstation.gui.logs import OfflinePage
from calstation.gui.logs.range_bar import CountSpin
from calstation.gui.shell.main_window import MainWindow
from calstation.records import LogMeta, RawLogWriter
from tests.gui.plot_mouse import double_click, drag, move_mouse, open_menu, pixel, turn_wheel

WAIT = 60_000
#: Samples per second, and samples of the log.
RATE, COUNT = 200, 40_000
META = {
    "site": {"latitude_deg": 34.25, "longitude_deg": 108.9, "height_m": 400, "azimuth_deg": 0.0},
    "imu": {
        "serial": "SN-PLOT",
        "sample_rate_hz": RATE,
        "output": "rate",
        "gyro_lsb": 1e-6,
        "accel_lsb": 1e-6,
        "gyro_arw": 1e-6,
        "accel_vrw": 1e-5,
    },
}


@pytest.fixture(autouse=True)
def unlimited_mouse_rate(monkeypatch: pytest.MonkeyPatch) -> None:
    """Disable the limit of mouse moves per second in pyqtgraph, which tests exceed."""
    monkeypatch.setitem(pg.CONFIG_OPTIONS, "mouseRateLimit", 0)


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log of two steps at rest; gyro x is the sample number in 1e-3 °/s, gyro y 3 °/s, and so on."""
    path = tmp_path_factory.mktemp("plot") / "log.h5"
    writer = RawLogWriter(path, LogMeta.model_validate(META))
    seq = np.arange(COUNT)
    counts = np.zeros((COUNT, 6))
    counts[:, 0] = np.deg2rad(seq * 1e-3) / 1e-6
    counts[:, 1] = np.deg2rad(3.0) / 1e-6
    counts[:, 5] = 9.8 / 1e-6
    step = np.where(seq < COUNT // 2, 1, 2)
    angles = np.deg2rad(np.column_stack([np.full(COUNT, 90.0), np.full(COUNT, -45.0)]))
    valid, temperature = np.ones(COUNT, np.bool_), np.full(COUNT, 25.5)
    label = ["turn_about", "y", 90.0]
    writer.event({"event": "StepStarted", "stage": "excitation", "step": 2, "kind": "move", "label": label})
    writer.append(SampleBlock("excitation", seq, (seq + 1) / RATE, counts, angles, step, valid, temperature))
    writer.close("imported")
    return path


@pytest.fixture
def page(window: MainWindow, log: Path, qtbot: QtBot) -> OfflinePage:
    """The page with the log open."""
    window.show_page("offline_page")
    offline_page = window.offline_page
    offline_page.open(log)
    qtbot.waitUntil(lambda: offline_page.log is not None, timeout=WAIT)
    qtbot.waitUntil(lambda: offline_page.plot.samples_per_column > 1, timeout=WAIT)
    return offline_page


def graph(page: OfflinePage) -> pg.GraphicsView:
    found = page.findChild(pg.GraphicsLayoutWidget, "log_graph")
    assert found is not None
    return found


def boxes(page: OfflinePage) -> list[pg.ViewBox]:
    return [plot.getViewBox() for plot in page.plot._plots]


def ranges(page: OfflinePage) -> np.ndarray:
    """Times and values in view, per plot."""
    return np.array([box.viewRange() for box in boxes(page)])


def at(page: OfflinePage, plot: int = 0, across: float = 0.5, down: float = 0.5) -> QPointF:
    return pixel(graph(page), boxes(page)[plot], across, down)


@pytest.mark.long
def test_wheel_zooms_time_and_ctrl_wheel_zooms_values(page: OfflinePage) -> None:
    whole = ranges(page)
    turn_wheel(graph(page), at(page, 1))
    zoomed = ranges(page)
    assert (np.ptp(zoomed[:, 0], axis=1) < 0.8 * np.ptp(whole[:, 0], axis=1)).all()
    np.testing.assert_allclose(zoomed[1, 1], whole[1, 1])
    turn_wheel(graph(page), at(page), Qt.KeyboardModifier.ControlModifier)
    assert np.ptp(ranges(page)[0, 1]) < 0.8 * np.ptp(zoomed[0, 1])
    np.testing.assert_allclose(ranges(page)[:, 0], zoomed[:, 0])


@pytest.mark.long
def test_dragging_a_box_zooms_and_a_double_click_shows_the_whole_log(page: OfflinePage, qtbot: QtBot) -> None:
    whole = ranges(page)
    drag(graph(page), at(page, 0, 0.3, 0.3), at(page, 0, 0.6, 0.8))
    zoomed = ranges(page)
    assert (np.ptp(zoomed[:, 0], axis=1) < 0.4 * np.ptp(whole[:, 0], axis=1)).all()
    assert np.ptp(zoomed[0, 1]) < 0.7 * np.ptp(whole[0, 1])
    qtbot.wait(20)  # the curves are drawn anew for the zoomed time; the zoom of the values stays
    np.testing.assert_allclose(ranges(page)[0], zoomed[0])
    first, last = (page.findChild(CountSpin, f"{name}_seq_spin").value() for name in ("first", "last"))
    assert (first, last) == (0, COUNT - 1)  # the box has not moved the range
    double_click(graph(page), at(page, 2))
    qtbot.waitUntil(lambda: np.allclose(ranges(page), whole))


@pytest.mark.long
def test_shorter_log_is_selected_whole_after_a_range_of_a_longer_one(
    page: OfflinePage, log: Path, tmp_path: Path, qtbot: QtBot
) -> None:
    path, count = tmp_path / "short.h5", COUNT // 4
    writer = RawLogWriter(path, LogMeta.model_validate(META))
    seq, temperature = np.arange(count), np.full(count, 25.5)
    rest, step, valid = np.zeros((count, 2)), np.ones(count, np.int64), np.ones(count, np.bool_)
    counts = np.zeros((count, 6))
    writer.append(SampleBlock("excitation", seq, (seq + 1) / RATE, counts, rest, step, valid, temperature))
    writer.close("imported")
    for first, last in ((count // 2, COUNT - 10), (COUNT - 20, COUNT - 10)):
        page.range.choose(first, last)
        page.open(path)
        qtbot.waitUntil(lambda: page.log is not None and page.log.path == path, timeout=WAIT)
        assert page.range.range == (0, count - 1)
        assert page.range.is_whole_log
        assert page.stages.available == ("excitation",)
        page.open(log)
        qtbot.waitUntil(lambda: page.log is not None and page.log.path == log, timeout=WAIT)
        assert page.range.range == (0, COUNT - 1)


@pytest.mark.long
def test_middle_mouse_button_pans(page: OfflinePage) -> None:
    page.plot.zoom(True)
    before = page.plot.view
    drag(graph(page), at(page, 0, 0.6), at(page, 0, 0.4), Qt.MouseButton.MiddleButton)
    after = page.plot.view
    assert after[0] > before[0]
    assert after[1] - after[0] == pytest.approx(before[1] - before[0])


def notes(page: OfflinePage) -> list[str]:
    return [note.toPlainText() for note in page.plot._notes]


def pointer(page: OfflinePage) -> str:
    return str(page.findChild(QLabel, "pointer_label").text())


@pytest.mark.long
def test_values_under_the_mouse_are_shown(page: OfflinePage, qtbot: QtBot) -> None:
    for _ in range(9):
        qtbot.mouseClick(page.findChild(QPushButton, "zoom_in_button"), Qt.MouseButton.LeftButton)
    qtbot.waitUntil(lambda: page.plot.samples_per_column == 1, timeout=WAIT)
    move_mouse(graph(page), at(page, 1, 0.6))
    seq = page.plot._pointed
    assert seq is not None
    assert pointer(page).split("   ")[1:] == [f"Sample {seq}", "Excitation", "step 2: Turning about y by 90°"]
    gyro, accel, table, temperature = notes(page)
    assert f"x {seq * 1e-3:.5f}" in gyro
    assert "y 3.00000" in gyro
    assert "z 9.80000" in accel
    assert "outer 90.0000" in table
    assert "inner −45.0000" in table
    assert "25.5" in temperature
    assert all(line.isVisible() for line in page.plot._cursors)
    move_mouse(graph(page), QPointF(2.0, 2.0))
    assert pointer(page) == ""
    assert "3.00000" not in notes(page)[0]


@pytest.mark.long
def test_merged_samples_show_minimum_and_maximum(page: OfflinePage) -> None:
    move_mouse(graph(page), at(page, 0, 0.25))
    low, high = (float(text) for text in notes(page)[0].split("x ")[1].split()[0].split("…"))
    seq, count = page.plot._pointed, page.plot.samples_per_column
    assert seq is not None
    assert (high - low) == pytest.approx((count - 1) * 1e-3, abs=2e-3)
    assert low - 1e-3 <= seq * 1e-3 <= high + 1e-3


def tick(page: OfflinePage, *names: str) -> None:
    """Toggle these entries of the channel menu."""
    menu = page.findChild(QPushButton, "channels_button").menu()
    for name in names:
        next(action for action in menu.actions() if action.text() == name).trigger()


@pytest.mark.long
def test_channels_are_hidden_and_shown(page: OfflinePage, window: MainWindow, log: Path, qtbot: QtBot) -> None:
    curves = page.plot._curves
    tick(page, "Gyro x", "Temperature")
    assert not curves["gyro_x"].isVisible()
    assert curves["gyro_y"].isVisible()
    assert notes(page)[0].split()[:3] == ["Gyro,", "°/s", "y"]
    assert page.plot._plots[3].scene() is None  # the plot of a hidden channel leaves its place to the others
    assert page.plot._plots[2].getAxis("bottom").isVisible()
    qtbot.waitUntil(lambda: boxes(page)[0].viewRange()[1][1] < 10.0)  # gyro x reached 40 °/s
    window.app.set_language("zh_CN")
    assert not curves["gyro_x"].isVisible()
    window.app.set_language("en")
    tick(page, "Gyro x", "Temperature")
    assert curves["gyro_x"].isVisible()
    assert page.plot._plots[3].scene() is not None
    tick(page, "Gyro x")
    page.open(log)
    qtbot.waitUntil(lambda: curves["gyro_x"].isVisible(), timeout=WAIT)  # a log opened anew shows all


@pytest.mark.long
def test_plots_are_saved_with_their_visible_channels(page: OfflinePage, tmp_path: Path) -> None:
    tick(page, "Gyro x", "Gyro y", "Gyro z")
    assert open_menu(graph(page)) == ["Copy as picture", "Save…"]
    for name, start in (("a.csv", b"seq,time_s,accel_x [m/s"), ("a.svg", b"<?xml"), ("a.png", b"\x89PNG")):
        graph(page).menu.actions()[1].trigger()
        dialog = page.findChild(QFileDialog)
        dialog.fileSelected.emit(str(tmp_path / name))
        dialog.close()
        dialog.setParent(None)
        assert (tmp_path / name).read_bytes().startswith(start)
    rows = np.loadtxt(tmp_path / "a.csv", delimiter=",", skiprows=1)
    np.testing.assert_allclose(rows[:, 4], 9.8, rtol=1e-5)  # seq, time, accel x, y, z
    np.testing.assert_allclose(rows[:, 1], rows[:, 0] / RATE)


def texts(page: OfflinePage) -> list[str]:
    """Return all texts of the page with a log, in a fixed order."""
    widgets = page.findChildren(QLabel) + page.findChildren(QAbstractButton)
    found = [widget.text() for widget in widgets if widget.isVisible()]
    tips = [widget.toolTip() for widget in widgets if widget.isVisible()]
    menus = [button.menu() for button in page.findChildren(QPushButton) if button.menu() is not None]
    entries = [action.text() for menu in menus for action in menu.actions()]
    return [*found, *tips, *entries, *notes(page)]


@pytest.mark.long
@pytest.mark.parametrize("method", ["", "multi_position", "gimbal", "cross_calibration"])
def test_all_texts_follow_the_language(method: str, page: OfflinePage, window: MainWindow, qtbot: QtBot) -> None:
    """Texts after a change of language equal the texts of the same actions in that language."""

    def act() -> None:
        page.methods.select(method)
        if method:
            return
        page.findChild(CountSpin, "first_seq_spin").setValue(0)
        page.findChild(CountSpin, "last_seq_spin").setValue(COUNT - 1)
        move_mouse(graph(page), at(page, 1, 0.6))
        first, last = page.findChild(CountSpin, "first_seq_spin"), page.findChild(CountSpin, "last_seq_spin")
        first.setValue(COUNT // 2)
        last.setValue(100)
        assert page.range.note_label.isVisible()

    act()
    english = texts(page)
    window.app.set_language("zh_CN")
    changed = texts(page)
    act()
    assert changed == texts(page)
    assert len(changed) == len(english)
    assert sum(a != b for a, b in zip(english, changed, strict=True)) > 10
    if not method:
        assert "采样点" in pointer(page)


@pytest.mark.long
@pytest.mark.parametrize(
    ("code", "head", "pause", "faulty"),
    [
        ("en", {"paused: 0:30, not used", "invalid samples: 200"}, "paused, not used", "invalid"),
        ("zh_CN", {"暂停 0:30，未使用", "无效采样点 200 个"}, "暂停，未使用", "无效"),
    ],
)
def test_samples_of_a_pause_are_told_from_invalid_ones(
    window: MainWindow, tmp_path: Path, qtbot: QtBot, code: str, head: set[str], pause: str, faulty: str
) -> None:
    path, seq = tmp_path / "paused.h5", np.arange(COUNT)
    writer = RawLogWriter(path, LogMeta.model_validate(META), station=True)
    valid = (seq < 8_000) | (seq >= 14_000) & (seq < 20_000) | (seq >= 20_200)
    values = (seq + 1) / RATE, np.ones((COUNT, 6)), np.zeros((COUNT, 2)), np.ones(COUNT, np.int64), valid
    station = np.where(seq % 20 == 0, seq / RATE, np.nan)[:, None]
    writer.append(SampleBlock("excitation", seq, *values, np.full(COUNT, 25.5), station=station))
    for state, second in (("paused", 40.0), ("running", 65.0)):
        writer.event({"event": "StateChanged", "state": state, "station_time": second})
    writer.close("passed")
    window.app.set_language(code)
    window.show_page("offline_page")
    page = window.offline_page
    page.open(path)
    qtbot.waitUntil(lambda: page.log is not None, timeout=WAIT)
    assert head <= {label.text() for label in page.findChildren(QLabel) if label.isVisible()}
    for pointed, use in ((7_999, ""), (8_000, pause), (13_999, pause), (14_000, ""), (20_100, faulty), (20_200, "")):
        page._show_pointed(pointed)
        assert [words for words in (pause, faulty) if pointer(page).endswith(words)] == [use] * bool(use), pointed
    marks = page.plot._layers[0]._marks
    assert (marks.paused.tolist(), marks.invalid.tolist()) == ([[40.0, 70.0]], [[100.0, 101.0]])
