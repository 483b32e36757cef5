"""Results over temperature in the window: curves with points of both directions, and the worst values in the tables."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyqtgraph as pg
import pytest
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QComboBox, QTabBar
from pytestqt.qtbot import QtBot

from calstation.gui.engineer import EngineerPage
from calstation.gui.history.details import Actions, RunDetails
from calstation.gui.logs.comparison import Comparison
from calstation.gui.operator import CertificateButton, LabelButton, advice
from calstation.gui.state import ReleaseBar
from calstation.gui.text import language, say
from calstation.gui.widgets import NoticeBar, TemperatureCurves, theme
from calstation.judgement import Check
from calstation.physics import display
from calstation.records import RunRecord, Verdict
from calstation.results import FinishedRun, Resolved, Result
from tests.gui.conftest import Operator
from tests.thermal_results import thermal_result


@pytest.fixture(scope="module")
def result() -> Result:
    """A result over temperature."""
    return Result.from_json(thermal_result().to_json())


@pytest.fixture
def curves(qtbot: QtBot, result: Result) -> TemperatureCurves:
    """The curves of this result."""
    made = TemperatureCurves("curves_combo")
    qtbot.addWidget(made)
    made.resize(900, 600)
    made.show()
    made.show_result(result)
    return made


def scatters(curves: TemperatureCurves, number: int = 0) -> list[pg.ScatterPlotItem]:
    """Return the points of a plot."""
    items = curves.plots[number].getPlotItem().items
    return [item for item in items if isinstance(item, pg.ScatterPlotItem) and len(item.data)]


def test_points_differ_by_direction_and_if_held_out(curves: TemperatureCurves, result: Result) -> None:
    found = {}
    for item in scatters(curves):
        (x,), style = item.getData()[0], item.opts
        found[round(float(x), 1), style["symbol"]] = (style["pen"].color().name(), style["brush"].color().name())
    panel = theme.colours().panel
    for point in result.temperature.points:
        symbol, axis = {"up": ("t1", "y"), "down": ("t", "x"), "soak": ("o", "z")}[point.way]
        pen, brush = found[round(point.at_c, 1), symbol]
        assert pen == theme.axis_text(axis).lower()
        assert (brush == panel) is point.held_out
    assert len({pen for pen, _ in found.values()}) == 3


def test_curve_band_reference_and_range_are_drawn(curves: TemperatureCurves, result: Result) -> None:
    items = curves.plots[0].getPlotItem().items
    (line,) = [item for item in items if isinstance(item, pg.PlotDataItem) and item.opts["pen"].widthF() > 1.0]
    x, y = line.getData()
    assert (x[0], x[-1]) == (-40.0, 85.0)
    assert y == pytest.approx(display("gyro_bias_x", 1.0)[0] * result.curve("gyro_bias_x", x)[0])
    assert any(isinstance(item, pg.FillBetweenItem) for item in items)
    regions = [item.getRegion() for item in items if isinstance(item, pg.LinearRegionItem)]
    assert sorted(end for region in regions for end in region)[1:3] == [-40.0, 85.0]
    assert 25.0 in [item.value() for item in items if isinstance(item, pg.InfiniteLine) and item.angle == 90]


def test_differences_have_error_bars(curves: TemperatureCurves, result: Result) -> None:
    bars = [item for item in curves.plots[1].getPlotItem().items if isinstance(item, pg.ErrorBarItem)]
    assert len(bars) == len(result.temperature.points)
    size = display("gyro_bias_x", 1.0)[0]
    assert bars[0].opts["height"][0] == pytest.approx(2.0 * size * result.temperature.points[0].sigma["gyro_bias_x"])
    assert abs(np.concatenate([item.getData()[1] for item in scatters(curves, 1)])).max() < 5.0 * size * max(
        point.sigma["gyro_bias_x"] for point in result.temperature.points
    )


@pytest.mark.parametrize(("code", "word"), [("en", "rising"), ("zh_CN", "升温")])
def test_parameter_is_chosen_by_keys_in_both_languages(
    curves: TemperatureCurves, result: Result, qtbot: QtBot, code: str, word: str
) -> None:
    language.use(code)
    combo = curves.findChild(QComboBox, "curves_combo")
    qtbot.keyClick(combo, Qt.Key.Key_Down)
    assert combo.currentData() == "gyro_bias_y"
    worst, at = result.worst("gyro_bias_y")
    assert f"{abs(display('gyro_bias_y', worst.value)[0]):.1f}" in curves._worst.text()
    assert f"{at:.0f} °C".replace("-", "−") in curves._worst.text()
    assert word in curves._note.toPlainText()
    language.use("en")


@pytest.mark.parametrize(
    ("code", "drawn", "outside"),
    [("en", "- - limit", "(outside the plot)"), ("zh_CN", "- - 限差", "（在图外）")],
)
def test_legend_says_if_the_limits_are_outside_the_plot(
    qtbot: QtBot, result: Result, code: str, drawn: str, outside: str
) -> None:
    language.use(code)
    low, high = (float(each) for each in np.sort(result.curve("gyro_bias_x", np.array([-40.0, 85.0]))[0]))
    made = TemperatureCurves("curves_combo")
    qtbot.addWidget(made)
    made.resize(900, 600)
    made.show()
    for limit, shown in (((low, high), drawn), ((-1.0, 1.0), outside)):
        check = Check("within", "gyro_bias_x", low, limit, "rad/s", passed=True)
        made.show_result(Result.from_json({**result.to_json(), "checks": [check.to_json()]}))
        assert shown in made._note.toPlainText()
        assert ({drawn, outside} - {shown}).pop() not in made._note.toPlainText()
    language.use("en")


def test_small_view_shows_the_curve_only(curves: TemperatureCurves, qtbot: QtBot) -> None:
    assert curves.plots[1].isVisible()
    curves.resize(600, 220)
    qtbot.waitUntil(lambda: not curves.plots[1].isVisible())
    assert curves.plots[0].getAxis("bottom").style["showValues"]


@pytest.mark.long
def test_engineer_page_has_a_view_and_the_worst_values(operator: Operator, result: Result, qtbot: QtBot) -> None:
    operator.window.show_page("engineer_page")
    page: Any = operator.window.findChild(EngineerPage, "engineer_page")
    tabs = operator.widget("engineer_views", QTabBar)
    last = page._views.indexOf(page.analysis.over_temperature)
    assert not tabs.isTabVisible(last)
    run = FinishedRun(result, None, {}, {})
    page.analysis._loaded(run)
    cells = page.analysis.result.view._table.cells["gyro_bias_y"]
    worst, at = result.worst("gyro_bias_y")
    assert float(cells["value"]) == pytest.approx(display("gyro_bias_y", worst.value)[0], rel=0.01)
    assert float(cells["at"]) == pytest.approx(at, abs=0.5)
    qtbot.mouseClick(tabs, Qt.MouseButton.LeftButton, pos=tabs.tabRect(last).center())
    assert tabs.currentIndex() == last
    assert operator.widget("engineer_curves_combo", QComboBox).isVisible()
    plain = Result.from_json({k: v for k, v in result.to_json().items() if k != "temperature"})
    page.analysis._loaded(replace(run, result=plain))
    assert not tabs.isTabVisible(last)
    assert tabs.currentIndex() == 1
    assert page.analysis.result.view._table.isColumnHidden(2)


def test_lower_plot_states_what_is_subtracted(curves: TemperatureCurves) -> None:
    assert curves.plots[1].getAxis("left").labelText == "point − curve, °/h"


def test_offline_comparison_shows_table_or_curves(qtbot: QtBot, result: Result) -> None:
    view = Comparison()
    qtbot.addWidget(view)
    view.show()
    assert not view.tabs.isVisible()
    view._online = result
    view._fill()
    assert view.note_label.text().startswith("Values and sigmas are the worst from "), "also before it is solved"
    view._online, view._solved = None, Resolved(result, ())
    view._fill()
    assert view.tabs.isVisible()
    assert view.table.isVisible()
    name = "gyro_bias_y"
    assert float(view.table.cells[name]["value1"]) == pytest.approx(
        display(name, result.compared[name].value)[0], rel=0.01
    )
    qtbot.mouseClick(view.tabs, Qt.MouseButton.LeftButton, pos=view.tabs.tabRect(1).center())
    assert view.curves.isVisible()
    assert not view.table.isVisible()


def test_figures_of_a_result_name_the_temperature_of_the_worst_value(result: Result) -> None:
    names = [figure.name for figure in advice.figures(result)]
    worst = next(name for name in names if "gyro bias" in name)
    parameter = f"gyro_bias_{worst.removeprefix('gyro bias ')[0]}"
    assert worst.endswith(f", worst at {result.worst(parameter)[1]:.0f} °C".replace("-", "−"))


def test_history_shows_the_curves_of_a_run(operator: Operator, result: Result, qtbot: QtBot) -> None:
    app, notice = operator.window.app, NoticeBar()
    view = RunDetails(
        LabelButton(app, "label", notice, lambda: None, unprinted=operator.window.operator_page._unprinted),
        CertificateButton(app, "certificate", notice, lambda: None),
        ReleaseBar(app, "release"),
    )
    qtbot.addWidget(view)
    view.show()
    started = "2026-11-28T08:00:00+00:00"
    facts = {"attempt": 1, "product": None, "station": None, "operator": "wang", "stages": ("temperature",)}
    run = RunRecord("SN-000001", started, Verdict.PASSED, **facts, log=Path("a.h5"), result=None, duration=60.0)
    view.show_run(run, result, (), Actions())
    assert view.plot_tabs.isVisible()
    assert not view.curves.isVisible()
    qtbot.mouseClick(view.plot_tabs, Qt.MouseButton.LeftButton, pos=view.plot_tabs.tabRect(1).center())
    assert view.curves.isVisible()
    assert view.plot_tabs.tabText(1) == say("common.over_temperature")
