"""The Allan deviation of a rest in a run on the virtual bench, operated by clicks on the offline page."""

from functools import partial
from pathlib import Path

import numpy as np
import pyqtgraph as pg
import pytest
from PySide6.QtCore import Qt
from PySide6.QtGui import QGuiApplication
from PySide6.QtWidgets import QFileDialog, QLabel, QLineEdit, QPushButton, QTableView
from pytestqt.qtbot import QtBot

from calstation.config import library, versions
from calstation.devices.profiles import load_imu_profile
from calstation.gui.logs import OfflinePage
from calstation.gui.logs.allan_view import AllanPlot
from calstation.gui.shell.main_window import MainWindow
from calstation.physics import DEGREE
from calstation.sequencer import Finalized
from tests.gui.conftest import Operator
from tests.shared_runs import SharedRuns
from tests.site_folder import PRODUCT, SiteFolder

pytestmark = pytest.mark.long

WAIT = 60_000
#: Angle random walk of the bench's navigation grade, °/√h.
WALK = 0.001


def flips(site: SiteFolder) -> Finalized:
    """A log of azimuth flips with rests of one minute."""
    site.write({"schedule": {"azimuth_flip": {**PRODUCT["schedule"]["azimuth_flip"], "dwell_s": 60.0}}})
    return site.run("azimuth_flip")


@pytest.fixture
def page(window: MainWindow, shared_runs: SharedRuns, tmp_path: Path, qtbot: QtBot) -> OfflinePage:
    """The page with the log of azimuth flips."""
    ended = shared_runs.copy("rests", tmp_path / "run", flips)
    window.show_page("offline_page")
    offline_page = window.offline_page
    offline_page.open(Path(ended.log))
    qtbot.waitUntil(lambda: offline_page.log is not None, timeout=WAIT)
    return offline_page


def press(page: OfflinePage, name: str, qtbot: QtBot) -> None:
    button = page.findChild(QPushButton, name)
    assert button.isEnabled(), button.toolTip()
    qtbot.mouseClick(button, Qt.MouseButton.LeftButton)


def choose_longest_rest(page: OfflinePage, qtbot: QtBot) -> None:
    page.range.set_button.menu().actions()[-1].trigger()
    qtbot.waitUntil(lambda: not page.rest_finder.busy and not page.range.is_whole_log, timeout=WAIT)


def compute(page: OfflinePage, qtbot: QtBot) -> None:
    press(page, "allan_button", qtbot)
    qtbot.waitUntil(lambda: page.allan.data is not None and not page.allan.watch.busy, timeout=WAIT)


def cells(page: OfflinePage) -> list[list[str]]:
    model = page.findChild(QTableView, "allan_table").model()
    return [[model.index(i, k).data().strip() for k in range(model.columnCount())] for i in range(model.rowCount())]


def all_inside(plot: AllanPlot, names: list[pg.TextItem]) -> bool:
    inside = plot.getViewBox().sceneBoundingRect().adjusted(-2, -2, 2, 2)
    return all(inside.contains(name.mapRectToScene(name.boundingRect())) for name in names)


def test_range_with_table_motion_is_refused(page: OfflinePage, qtbot: QtBot) -> None:
    press(page, "allan_button", qtbot)
    qtbot.waitUntil(lambda: page.notice.isVisible(), timeout=WAIT)
    assert "The table moves between samples" in page.notice.text_label.text()
    assert page.solve_button.isVisible()


def test_longest_rest_gives_the_random_walk(page: OfflinePage, window: MainWindow, qtbot: QtBot) -> None:
    choose_longest_rest(page, qtbot)
    compute(page, qtbot)
    assert not page.solve_button.isVisible()
    rows = cells(page)
    assert [row[0] for row in rows] == [f"{sensor} {axis}" for sensor in ("gyro", "accel") for axis in "xyz"]
    for row in rows[:3]:
        assert float(row[1]) == pytest.approx(WALK, rel=0.3)
        assert row[2] == "0.001 °/√h"
        assert row[3].startswith("≤ ")  # the rest is too short for a flat minimum
    for plot in page.findChildren(AllanPlot):
        names = [item for item in plot.getPlotItem().items if isinstance(item, pg.TextItem)]
        assert len(names) >= 2
        qtbot.waitUntil(partial(all_inside, plot, names), timeout=WAIT)  # drawing sets the ranges
    first, last = page.range.range
    assert f"samples {first} to {last}" in page.findChild(QLabel, "allan_label").text()
    press(page, "copy_noise_button", qtbot)
    assert QGuiApplication.clipboard().text().count("\n") == 7
    window.app.set_language("zh_CN")
    assert [row[0] for row in cells(page)][:4] == ["陀螺 x", "陀螺 y", "陀螺 z", "加表 x"]
    assert "静止" in page.findChild(QLabel, "allan_label").text()
    press(page, "allan_back_button", qtbot)
    assert page.solve_button.isVisible()


def test_curves_are_saved(page: OfflinePage, tmp_path: Path, qtbot: QtBot) -> None:
    choose_longest_rest(page, qtbot)
    compute(page, qtbot)
    plot = page.allan._plots[0]
    plot.menu._ask_file()
    plot.findChild(QFileDialog).fileSelected.emit(str(tmp_path / "a.csv"))
    plot.findChild(QFileDialog).close()
    rows = np.genfromtxt(tmp_path / "a.csv", delimiter=",", names=True)
    assert page.allan.data is not None
    curve = page.allan.data.curves["gyro_y"]
    np.testing.assert_allclose(rows["gyro_y_deviation"], curve.deviation)
    np.testing.assert_allclose(rows["gyro_y_high"], curve.high)
    np.testing.assert_allclose(rows["tau_s"], curve.tau)


def test_engineer_saves_the_values_in_the_profile(page: OfflinePage, operator: Operator, qtbot: QtBot) -> None:
    choose_longest_rest(page, qtbot)
    compute(page, qtbot)
    take = page.findChild(QPushButton, "take_noise_button")
    assert not take.isEnabled()
    assert "Only an engineer" in take.toolTip()
    operator.window.app.role.ask()
    for name, text in (("role_person_edit", "wang"), ("pin_edit", "246813"), ("pin_again_edit", "246813")):
        qtbot.keyClicks(operator.widget(name, QLineEdit), text)
    operator.press("unlock_button")
    operator.press("take_noise_button")
    assert page.notice.title_label.text() == "Save as a new version of the IMU profile bench_nav?"
    assert "angle random walk 0.001 → 0.00" in page.notice.text_label.text()
    assert "unchanged: velocity random walk" in page.notice.text_label.text()
    operator.press("cancel_noise_button")
    assert versions.list_versions("imus", "bench_nav") == ()
    operator.press("take_noise_button")
    operator.press("save_noise_button")
    operator.until(lambda: "Saved: version 2 of the IMU profile bench_nav" in page.notice.title_label.text())
    profile = library.find("imus", "bench_nav")
    measured = max(page.allan.data.curves[f"gyro_{axis}"].random_walk for axis in "xyz")  # type: ignore[union-attr]
    assert load_imu_profile(profile).noise.gyro_arw == pytest.approx(measured, rel=1e-3)
    assert load_imu_profile(profile).noise.gyro_arw == pytest.approx(WALK * DEGREE / 60.0, rel=0.3)
