"""Labels of axes are centred on their axes and do not cover the ticks, names do not overlap; lines have captions."""

from itertools import combinations, pairwise, product
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import patch

import numpy as np
import pyqtgraph as pg
import pytest
from PySide6.QtGui import QColor, QFontMetrics, QGuiApplication, QImage, QPainter
from PySide6.QtWidgets import QApplication
from pytestqt.qtbot import QtBot

from calstation.gui.engineer.diagnostics_views import ResidualsView
from calstation.gui.quality.study_plots import StudyCharts, StudyValues
from calstation.gui.text import language
from calstation.gui.widgets import ThemedPlot, apart, spread, theme
from calstation.gui.widgets import plot as plot_module
from calstation.gui.widgets.plot import LineLabel, LineLabels, NumberAxis
from calstation.results import Diagnostics


@pytest.mark.parametrize("text", ["horizontal, °/h", "水平角速率，°/h"])
def test_label_set_after_the_plot_is_shown_is_centred_beside_the_ticks(qtbot: QtBot, text: str) -> None:
    plot = ThemedPlot()
    qtbot.addWidget(plot)
    plot.resize(600, 200)
    plot.addItem(pg.PlotDataItem(np.arange(5.0), np.arange(5.0)))
    plot.show()
    qtbot.wait(50)
    for side in ("left", "bottom"):
        plot.setLabel(side, text)
        axis = plot.getAxis(side)
        box, size = axis.mapRectFromItem(axis.label, axis.label.boundingRect()), axis.size()
        along = box.center().y() - size.height() / 2 if side == "left" else box.center().x() - size.width() / 2
        assert abs(along) < 2.0
    ticks = plot.getAxis("bottom").textHeight
    assert box.top() >= ticks - 5.0, "below the numbers"


@pytest.mark.parametrize("stations", [(), ("line 3 left", "line 3 right")])
def test_names_of_appraisers_do_not_overlap(qtbot: QtBot, stations: tuple[str, ...]) -> None:
    operators = ("Wang Xiaoming", "Li Xiaohong", "Zhang Wei", "Constantinopoulos")
    names = tuple(", ".join(each) for each in product(operators, stations)) if stations else operators
    charts = StudyCharts()
    qtbot.addWidget(charts)
    charts.resize(800, 500)
    charts.show_data(StudyValues("gyro_bias_x", "°/h", ("SN-1", "SN-2"), names, np.zeros((2, len(names), 3))))
    charts.show()
    qtbot.wait(50)
    for plot in (charts.by_appraiser, charts.ranges):
        axis, image = plot.getAxis("bottom"), QImage(8, 8, QImage.Format.Format_RGB32)
        painter = QPainter(image)
        painter.setFont(axis.style["tickFont"] or QGuiApplication.font())
        _, _, texts = axis.generateDrawSpecs(painter)
        painter.end()
        assert len(texts) == len(names), "every name is drawn"
        boxes = [rect for rect, _, _ in texts]
        assert all(left.right() < right.left() for left, right in pairwise(boxes))
        assert all(text.count("\n") == bool(stations) for _, _, text in texts)
        lines = 1 + bool(stations)
        assert axis.height() >= lines * QFontMetrics(QGuiApplication.font()).lineSpacing(), "no line is cut"


@pytest.mark.parametrize(
    ("code", "words"),
    [
        ("en", "– – 4 σ: notable, 5 σ: contradicts the model"),
        ("zh_CN", "– – 4 σ：需注意，5 σ：与模型矛盾"),
    ],
)
def test_lines_in_the_plot_of_tests_have_a_caption(qtbot: QtBot, code: str, words: str) -> None:
    language.use(code)
    view = ResidualsView()
    qtbot.addWidget(view)
    view.resize(1000, 600)
    view.show_data(Diagnostics(Path("log.h5"), "SN-000001", ()))
    view.show()
    qtbot.waitExposed(view)
    view.grab()  # positions the caption
    (caption,) = [line.label for _, line in view._items if getattr(line, "label", None) is not None]
    assert caption.toPlainText() == words
    box, plot = caption.mapRectToScene(caption.boundingRect()), view.plots[0].getViewBox().sceneBoundingRect()
    assert plot.contains(box)
    language.use("en")


@pytest.mark.parametrize("code", ["en", "zh_CN"])
def test_plots_of_residuals_have_space_for_their_labels_on_a_small_screen(
    qtbot: QtBot, monkeypatch: pytest.MonkeyPatch, code: str
) -> None:
    language.use(code)
    view = ResidualsView()
    qtbot.addWidget(view)
    view.resize(860, 530)
    view.show_data(Diagnostics(Path("log.h5"), "SN-000001", ()))
    view.show()
    stage = SimpleNamespace(rests=SimpleNamespace(axis=lambda _: "-x+y-z"))
    monkeypatch.setattr(view, "_rests", [(stage, number) for number in range(16)])
    view._name_ticks()
    qtbot.wait(50)
    for plot in view.plots:
        axis = plot.getAxis("left")
        margins = 2.0 * axis.label.document().documentMargin()
        assert axis.label.boundingRect().width() - margins <= axis.size().height(), axis.labelText
    bottom = view.plots[-1].getAxis("bottom")
    (first, name), (second, _), *_ = bottom._tickLevels[0]
    distance = (second - first) * bottom.width() / 16
    assert QFontMetrics(QGuiApplication.font()).horizontalAdvance(name) < distance
    language.use("en")


@pytest.mark.parametrize("width", [120.0, 300.0])
def test_numbers_of_a_short_horizontal_axis_do_not_touch(qapp: QApplication, width: float) -> None:
    (spacing, _), *_ = NumberAxis("bottom").tickValues(0.0, 0.1, width)
    assert spacing * width / 0.1 >= QFontMetrics(theme.font()).horizontalAdvance("0.02") + 4.0


def test_leader_lines_do_not_look_like_curves(qtbot: QtBot) -> None:
    theme.apply("light")
    labels, colours = LineLabels(80), [QColor("#ff0000"), QColor("#0000ff")]
    qtbot.addWidget(labels)
    labels.resize(80, 100)
    labels.show_labels([LineLabel(50.0, "x", colours[0]), LineLabel(51.0, "y", colours[1])])
    image = labels.grab().toImage()
    drawn = {image.pixelColor(x, y).name() for x in range(10) for y in range(image.height())}
    assert len(drawn) > 1, "there are leader lines"
    assert not {"#ff0000", "#0000ff"} & drawn


def test_labels_of_curves_without_space_are_left_out_those_of_reached_targets_first(qtbot: QtBot) -> None:
    theme.apply("light")
    labels, black = LineLabels(80), QColor("#000000")
    qtbot.addWidget(labels)
    target = LineLabel(20.0, "target", black, bold=True)
    reached = LineLabel(25.0, "reached", black, "good")
    active = [LineLabel(22.0 + i, f"active {i}", black) for i in range(3)]
    labels.show_labels([target, reached, *active])
    labels.resize(80, 200)
    with patch.object(plot_module, "spread", wraps=spread) as spreading:
        for height, shown in ((200, [target, *active, reached]), (76, [target, *active]), (40, [target, active[0]])):
            labels.resize(80, height)
            labels.grab()
            assert spreading.call_args.args[0] == [label.y for label in shown]
            drawn = spread(*spreading.call_args.args)
            assert min(np.diff(drawn)) >= theme.BODY


def test_names_of_axes_do_not_overlap_on_a_drawing() -> None:
    for points in (np.zeros((3, 2)), np.array([[0.1, 0.0], [0.12, 0.01], [-0.9, 0.3]])):
        moved = apart(points, 0.25)
        gaps = [float(np.linalg.norm(a - b)) for a, b in combinations(moved, 2)]
        assert min(gaps) > 0.12
    np.testing.assert_array_equal(apart(np.eye(3)[:, :2], 0.25), np.eye(3)[:, :2])
