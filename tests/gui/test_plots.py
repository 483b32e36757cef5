"""Plots are zoomed by wheel and box, reset by a double click, copied and saved from the menu; tables are saved too."""

import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pyqtgraph as pg
import pytest
from PySide6.QtCore import QPointF, Qt
from PySide6.QtGui import QContextMenuEvent, QGuiApplication, QImage
from PySide6.QtWidgets import QApplication, QFileDialog
from pytestqt.qtbot import QtBot

from calstation import gui
from calstation.gui.engineer import EngineerPage
from calstation.gui.operator.live.traces import Traces
from calstation.gui.settings.table_section import TravelPlot
from calstation.gui.shell.main_window import MainWindow
from calstation.gui.widgets import (
    Column,
    ParameterModel,
    ParameterTable,
    StackedPlots,
    ThemedPlot,
    ZoomBox,
    column,
    set_subject,
    theme,
)
from tests.gui.plot_mouse import double_click, drag, open_menu, pixel, turn_wheel


@pytest.fixture(autouse=True)
def unlimited_mouse_rate(monkeypatch: pytest.MonkeyPatch) -> None:
    """Disable the limit of mouse moves per second in pyqtgraph, which tests exceed."""
    monkeypatch.setitem(pg.CONFIG_OPTIONS, "mouseRateLimit", 0)


@pytest.fixture
def plot(qtbot: QtBot) -> ThemedPlot:
    """A visible plot of a line with a programmed horizontal range."""
    made = ThemedPlot(zoom=True)
    qtbot.addWidget(made)
    made.plot(np.arange(11.0), np.arange(11.0) ** 2, name="line")
    made.setXRange(0.0, 10.0, padding=0.0)
    made.resize(600, 400)
    made.show()
    qtbot.waitExposed(made)
    return made


def ranges(plot: ThemedPlot) -> np.ndarray:
    return np.array(plot.getViewBox().viewRange())


def test_wheel_zooms_and_a_double_click_resets(plot: ThemedPlot, qtbot: QtBot) -> None:
    before = ranges(plot)
    turn_wheel(plot, QPointF(plot.rect().center()))
    zoomed = ranges(plot)
    assert np.all(np.ptp(zoomed, axis=1) < np.ptp(before, axis=1))
    plot.setXRange(0.0, 20.0, padding=0.0)  # new data do not end it
    np.testing.assert_array_equal(ranges(plot), zoomed)
    qtbot.mouseDClick(plot.viewport(), Qt.MouseButton.LeftButton, pos=plot.rect().center())
    qtbot.waitUntil(lambda: np.allclose(ranges(plot), [(0.0, 20.0), before[1]]))


def test_dragging_a_box_zooms(plot: ThemedPlot, qtbot: QtBot) -> None:
    before, box = ranges(plot), plot.getViewBox()
    drag(plot, pixel(plot, box, 0.4, 0.4), pixel(plot, box, 0.6, 0.6))
    assert np.all(np.ptp(ranges(plot), axis=1) < 0.5 * np.ptp(before, axis=1))
    qtbot.mouseDClick(plot.viewport(), Qt.MouseButton.LeftButton, pos=plot.rect().center())
    qtbot.waitUntil(lambda: np.allclose(ranges(plot), before))


def test_linked_plots_are_reset_together(qtbot: QtBot) -> None:
    stacked = StackedPlots[None](2, 50)
    qtbot.addWidget(stacked)
    column(*stacked.plots, on=stacked)
    first, second = stacked.plots
    for each in (first, second):
        each.setXRange(0.0, 10.0, padding=0.0)
        each.setYRange(0.0, 1.0, padding=0.0)
    stacked.resize(600, 400)
    stacked.show()
    qtbot.waitExposed(stacked)
    turn_wheel(second, pixel(second, second.getViewBox(), 0.5, 0.5))
    assert np.ptp(ranges(first)[0]) < 9.0
    double_click(second, pixel(second, second.getViewBox(), 0.5, 0.5))
    qtbot.waitUntil(lambda: np.allclose([ranges(first), ranges(second)], [[0.0, 10.0], [0.0, 1.0]]))
    turn_wheel(second, pixel(second, second.getViewBox(), 0.5, 0.5))
    double_click(first, pixel(first, first.getViewBox(), 0.5, 0.5))
    qtbot.waitUntil(lambda: np.allclose([ranges(first), ranges(second)], [[0.0, 10.0], [0.0, 1.0]]))


#: Methods of the offline page, each with a panel of its own.
METHODS = ("multi_position", "gimbal", "cross_calibration")


def all_plots(window: MainWindow) -> list[pg.GraphicsView]:
    """Return all plots of all pages, including lazily created views, except the travel bars."""
    for method in METHODS:
        window.offline_page.methods.select(method)
    window.create_engineer_page()
    page = window.findChild(EngineerPage)
    assert page is not None
    analysis = page.analysis
    views = [window, page.design.result_view, *(lazy.view for lazy in analysis.views)]
    plots = dict.fromkeys(plot for view in views for plot in view.findChildren(pg.GraphicsView))
    return [plot for plot in plots if not isinstance(plot, TravelPlot)]


def zoom_and_reset(plot: pg.GraphicsView, box: ZoomBox) -> None:
    """Zoom a plot by the wheel and by a box, and reset it by a double click."""
    box.setRange(xRange=(0.0, 1.0), yRange=(0.0, 1.0), padding=0.0)
    turn_wheel(plot, pixel(plot, box, 0.5, 0.5), Qt.KeyboardModifier.ControlModifier)
    assert np.ptp(box.viewRange()[1]) < 0.9
    double_click(plot, pixel(plot, box, 0.5, 0.5))
    np.testing.assert_allclose(box.viewRange()[1], (0.0, 1.0))
    drag(plot, pixel(plot, box, 0.3, 0.3), pixel(plot, box, 0.6, 0.6))
    assert np.ptp(box.viewRange()[1]) < 0.5
    double_click(plot, pixel(plot, box, 0.5, 0.5))
    np.testing.assert_allclose(box.viewRange()[1], (0.0, 1.0))


@pytest.mark.usefixtures("engineer_page")
@pytest.mark.long
def test_every_plot_of_the_window_can_be_zoomed_copied_and_saved(window: MainWindow, qtbot: QtBot) -> None:
    plots = all_plots(window)
    assert len(plots) > 20
    for plot in plots:
        plot.setParent(None)
        qtbot.addWidget(plot)
        plot.resize(700, 500)
        plot.show()
        qtbot.waitExposed(plot)
        assert open_menu(plot) == ["Copy as picture", "Save…"], plot.parent()
        boxes = [item for item in plot.scene().items() if isinstance(item, ZoomBox) and item.isVisible()]
        for box in boxes:
            if box.height() > 40.0:  # the row of stage names above the plots of a log is lower
                zoom_and_reset(plot, box)
        assert boxes
        plot.hide()


def choose(plot: ThemedPlot | ParameterTable, text: str) -> None:
    """Choose an entry of the context menu."""
    center = plot.rect().center()
    QApplication.sendEvent(
        plot.viewport(), QContextMenuEvent(QContextMenuEvent.Reason.Mouse, center, plot.mapToGlobal(center))
    )
    menu = plot.menu if isinstance(plot, ThemedPlot) else plot._menu
    action = next(action for action in menu.actions() if action.text() == text)
    menu.close()
    action.trigger()


def test_plot_is_copied_as_an_image(plot: ThemedPlot) -> None:
    QGuiApplication.clipboard().clear()
    choose(plot, "Copy as picture")
    assert not QGuiApplication.clipboard().image().isNull()


@pytest.mark.parametrize(("name", "start"), [("a.png", b"\x89PNG"), ("a.svg", b"<?xml"), ("a.csv", b"line_x")])
def test_a_plot_is_saved(plot: ThemedPlot, tmp_path: Path, name: str, start: bytes) -> None:
    choose(plot, "Save…")
    dialog = plot.findChild(QFileDialog)
    assert dialog is not None
    dialog.fileSelected.emit(str(tmp_path / name))
    dialog.close()
    assert (tmp_path / name).read_bytes().startswith(start)


def test_a_saved_image_is_printable_and_named_after_its_unit(plot: ThemedPlot, tmp_path: Path) -> None:
    set_subject(plot.parentWidget() or plot, "SN-000042 gyro/bias")
    choose(plot, "Save…")
    dialog = plot.findChild(QFileDialog)
    assert dialog is not None
    assert Path(dialog.selectedFiles()[0]).name == "SN-000042_gyro_bias_plot.png"
    dialog.fileSelected.emit(str(tmp_path / "a.png"))
    dialog.close()
    image = QImage(str(tmp_path / "a.png"))
    assert image.size() == 3 * plot.size()
    assert image.pixelColor(1, 1).name() == theme.colours().panel
    assert (
        len({image.pixelColor(x, y).name() for x in range(0, image.width(), 3) for y in range(0, image.height(), 3)})
        > 3
    )


@pytest.fixture
def table(qtbot: QtBot) -> ParameterTable:
    """Return a table with an aligned and a negative number."""
    cells = {"gyro_bias_x": "  1.5", "gyro_bias_y": "−20"}
    made = ParameterTable(ParameterModel([Column(lambda: "value", cells.__getitem__)]))
    made.parameters.show(made.parameters.columns, tuple(cells))
    qtbot.addWidget(made)
    return made


def test_table_is_saved_with_plain_numbers(table: ParameterTable, tmp_path: Path) -> None:
    choose(table, "Save as CSV…")
    dialog = table.findChild(QFileDialog)
    assert dialog is not None
    dialog.fileSelected.emit(str(tmp_path / "a.csv"))
    dialog.close()
    lines = (tmp_path / "a.csv").read_text(encoding="utf-8-sig").splitlines()
    assert lines == ["parameter,value", "gyro_bias_x,1.5", "gyro_bias_y,-20"]


@pytest.mark.parametrize("scale", [1.0, 1.5, 2.0])
def test_curves_are_enlarged_with_the_screen(qtbot: QtBot, monkeypatch: pytest.MonkeyPatch, scale: float) -> None:
    monkeypatch.setattr(QGuiApplication, "primaryScreen", lambda: SimpleNamespace(devicePixelRatio=lambda: scale))
    traces, item = Traces(), pg.PlotCurveItem
    qtbot.addWidget(traces)
    curves = [curve for plot in traces.findChildren(pg.PlotWidget) for curve in plot.items() if isinstance(curve, item)]
    assert len(curves) == 6
    assert {pg.mkPen(curve.opts["pen"]).widthF() for curve in curves} == {scale}


def test_no_plot_has_a_pen_that_is_not_enlarged() -> None:
    sources = {path: path.read_text(encoding="utf-8") for path in Path(gui.__file__).parent.rglob("*.py")}
    assert [str(path) for path, text in sources.items() if re.search(r"pg\.mkPen\((?!None)", text)] == []
