"""Plots: zoom by wheel and box, back by a double click, copy and save from the menu; tables are saved too."""

from pathlib import Path

import numpy as np
import pytest
from PySide6.QtCore import QPoint, QPointF, Qt
from PySide6.QtGui import QContextMenuEvent, QGuiApplication, QWheelEvent
from PySide6.QtWidgets import QApplication, QFileDialog
from pytestqt.qtbot import QtBot

from calstation.gui.widgets import Column, ParameterModel, ParameterTable, ThemedPlot


@pytest.fixture
def plot(qtbot: QtBot) -> ThemedPlot:
    """A shown plot of a line with a horizontal range set by the program."""
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


def turn_wheel(plot: ThemedPlot) -> None:
    at = QPointF(plot.rect().center())
    none = Qt.MouseButton.NoButton, Qt.KeyboardModifier.NoModifier, Qt.ScrollPhase.NoScrollPhase
    event = QWheelEvent(at, plot.mapToGlobal(at), QPoint(), QPoint(0, 240), *none, False)
    QApplication.sendEvent(plot.viewport(), event)


def test_the_wheel_zooms_until_a_double_click(plot: ThemedPlot, qtbot: QtBot) -> None:
    before = ranges(plot)
    turn_wheel(plot)
    zoomed = ranges(plot)
    assert np.all(np.ptp(zoomed, axis=1) < np.ptp(before, axis=1))
    plot.setXRange(0.0, 20.0, padding=0.0)  # new data do not end it
    np.testing.assert_array_equal(ranges(plot), zoomed)
    qtbot.mouseDClick(plot.viewport(), Qt.MouseButton.LeftButton, pos=plot.rect().center())
    qtbot.waitUntil(lambda: np.allclose(ranges(plot), [(0.0, 20.0), before[1]]))


def test_a_box_zooms(plot: ThemedPlot, qtbot: QtBot) -> None:
    before, view = ranges(plot), plot.viewport()
    corners = plot.rect().center() - QPoint(60, 60), plot.rect().center() + QPoint(60, 60)
    qtbot.mousePress(view, Qt.MouseButton.LeftButton, pos=corners[0])
    for at in (plot.rect().center(), corners[1]):
        qtbot.mouseMove(view, at)
        QApplication.processEvents()
    qtbot.mouseRelease(view, Qt.MouseButton.LeftButton, pos=corners[1])
    assert np.all(np.ptp(ranges(plot), axis=1) < 0.5 * np.ptp(before, axis=1))
    qtbot.mouseDClick(view, Qt.MouseButton.LeftButton, pos=plot.rect().center())
    qtbot.waitUntil(lambda: np.allclose(ranges(plot), before))


def choose(plot: ThemedPlot | ParameterTable, text: str) -> None:
    """Choose from the menu that the right button opens."""
    center = plot.rect().center()
    QApplication.sendEvent(
        plot.viewport(), QContextMenuEvent(QContextMenuEvent.Reason.Mouse, center, plot.mapToGlobal(center))
    )
    action = next(action for action in plot._menu.actions() if action.text() == text)
    plot._menu.close()
    action.trigger()


def test_a_plot_is_copied_as_a_picture(plot: ThemedPlot) -> None:
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


@pytest.fixture
def table(qtbot: QtBot) -> ParameterTable:
    """A table with an aligned and a negative number."""
    cells = {"gyro_bias_x": "  1.5", "gyro_bias_y": "−20"}
    made = ParameterTable(ParameterModel([Column(lambda: "value", cells.__getitem__)]))
    made.parameters.set_names(tuple(cells))
    qtbot.addWidget(made)
    return made


def test_a_table_is_saved_with_plain_numbers(table: ParameterTable, tmp_path: Path) -> None:
    choose(table, "Save as CSV…")
    dialog = table.findChild(QFileDialog)
    assert dialog is not None
    dialog.fileSelected.emit(str(tmp_path / "a.csv"))
    dialog.close()
    lines = (tmp_path / "a.csv").read_text(encoding="utf-8-sig").splitlines()
    assert lines == ["parameter,value", "gyro_bias_x,1.5", "gyro_bias_y,-20"]
