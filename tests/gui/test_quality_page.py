"""The Quality page operated by real clicks: control charts, capability, yield, check standards, repeatability."""

import json
import shutil
from collections.abc import Iterator
from dataclasses import replace
from datetime import date, timedelta
from itertools import pairwise
from pathlib import Path

import numpy as np
import pyqtgraph as pg
import pytest
import tomli_w
from PySide6.QtCore import QPoint, QPointF, Qt
from PySide6.QtWidgets import QComboBox, QLabel, QLineEdit, QPushButton, QTabBar, QTableView
from pytestqt.qtbot import QtBot
from synthetic.run_history import synthesise_runs

from calstation.cli.app import run_app
from calstation.config import library
from calstation.estimation.positions import TABLE_QUANTITIES
from calstation.gui.quality import QualityPage, study_view
from calstation.gui.quality.yield_view import YieldView
from calstation.gui.text import language, parameter_text, with_minus
from calstation.gui.widgets import theme
from calstation.physics import NAMES, display
from calstation.quality import BASELINE, FailedCheck, GaugePlan, StationQuality, TableChart, Yields
from calstation.records import CheckId
from calstation.results import History, load_result
from tests.gui.conftest import Operator
from tests.gui.test_history_page import write_run
from tests.site_folder import BENCH, STATION

pytestmark = pytest.mark.timeout(180)


@pytest.fixture(scope="module")
def history(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of synthetic runs with a study."""
    folder = tmp_path_factory.mktemp("history")
    synthesise_runs(lambda *_, **__: None, folder, 600, 1)
    return folder


@pytest.fixture
def page(operator: Operator, history: Path) -> Iterator[QualityPage]:
    """The page with the synthetic runs of the navigation product."""
    shutil.copytree(history, operator.site_folder.runs)
    operator.window.app.set_product(library.find("products", "nav_a"))
    operator.window.show_page("quality_page")
    page = operator.window.findChild(QualityPage, "quality_page")
    assert isinstance(page, QualityPage)
    until_read(operator, page)
    yield page
    language.use("en")


def until_read(operator: Operator, page: QualityPage) -> None:
    """Wait until all jobs of the page are done."""
    operator.until(lambda: not page.busy)


def click_tab(operator: Operator, title: str, name: str = "quality_views") -> None:
    tabs = operator.widget(name, QTabBar)
    index = [tabs.tabText(k) for k in range(tabs.count())].index(title)
    operator.qtbot.mouseClick(tabs, Qt.MouseButton.LeftButton, pos=tabs.tabRect(index).center())


def cells(operator: Operator, name: str) -> list[list[str]]:
    """Return the texts of a visible table."""
    table = operator.widget(name, QTableView)
    assert table.isVisible(), name
    model = table.model()
    return [[str(model.index(r, c).data() or "") for c in range(model.columnCount())] for r in range(model.rowCount())]


def click_row(operator: Operator, name: str, line: int, *, double: bool = False) -> None:
    table = operator.widget(name, QTableView)
    center = table.visualRect(table.model().index(line, 0)).center()
    operator.qtbot.mouseClick(table.viewport(), Qt.MouseButton.LeftButton, pos=center)
    if double:
        operator.qtbot.mouseDClick(table.viewport(), Qt.MouseButton.LeftButton, pos=center)


def offer_check_standard(operator: Operator, page: QualityPage) -> None:
    """Give the product the check standard of the synthetic runs."""
    own = operator.site_folder.home / "products" / "nav_a.toml"
    standard = {"serial": "GOLDEN-NAVA", "interval_days": 7, "reference": {"gyro_bias_x": {"value": 0.0, "sigma": 1.0}}}
    product = library.find("products", "nav_a").read_text(encoding="utf-8")
    own.write_text(product + tomli_w.dumps({"check_standards": [standard]}), encoding="utf-8")
    operator.window.app.set_product(own)
    until_read(operator, page)


def choose(operator: Operator, name: str, index: int) -> None:
    operator.widget(name, QComboBox).setCurrentIndex(index)


@pytest.mark.long
def test_every_quantity_has_control_charts_and_a_signal_opens_its_run(operator: Operator, page: QualityPage) -> None:
    quantities = cells(operator, "quality_quantities_table")
    assert len(quantities) == len(NAMES) + 1, "and the mean of the accelerometer scale factors"
    assert all(int(count) > 100 for count, _ in quantities)
    line = next(k for k, (_, signals) in enumerate(quantities) if int(signals) > 0)
    click_row(operator, "quality_quantities_table", line)
    rows = cells(operator, "quality_signals_table")
    assert rows
    assert int(rows[0][0]) > int(rows[-1][0]), "the latest first"
    name = page.control.signals.cells
    run = page.control._charts[list(page.control._charts)[line]].names[int(next(iter(name)))]
    click_row(operator, "quality_signals_table", 0)
    with operator.qtbot.waitSignal(operator.window.app.open_run) as opened:
        click_row(operator, "quality_signals_table", 0, double=True)
    assert [Path(path).resolve() for path in opened.args] == [operator.site_folder.runs / f"{run}.json"]
    assert operator.window.page_tabs.currentWidget().objectName() == "engineer_page"


@pytest.mark.long
def test_choices_and_tabs_stay_in_place_in_every_view(operator: Operator, page: QualityPage) -> None:
    fixed = (page.product, page.tabs)
    places = []
    for title in ("Control charts", "Capability", "Yield", "Check standards", "Repeatability"):
        click_tab(operator, title)
        operator.qtbot.wait(50)
        places.append([(each.mapTo(page, QPoint(0, 0)), each.size()) for each in fixed])
    assert all(place == places[0] for place in places)


@pytest.mark.long
def test_table_counts_the_runs_that_signal(operator: Operator, page: QualityPage) -> None:
    for line, (runs, signalling) in enumerate(cells(operator, "quality_quantities_table")[:6]):
        click_row(operator, "quality_quantities_table", line)
        if int(signalling):
            assert (
                operator.widget("quality_signals_label", QLabel)
                .text()
                .startswith(f"Signals in {signalling} of {runs} runs")
            )


@pytest.mark.long
@pytest.mark.parametrize(
    ("code", "note"),
    [
        ("en", "{} of them signal only in the chart {}, which is not shown."),
        ("zh_CN", "其中{}次仅在未显示的{}图中报警。"),
    ],
)
def test_note_says_how_many_signals_are_in_the_chart_that_is_not_shown(
    operator: Operator, page: QualityPage, code: str, note: str
) -> None:
    language.use(code)
    said = 0
    for line in range(len(cells(operator, "quality_quantities_table"))):
        click_row(operator, "quality_quantities_table", line)
        for index, hidden in enumerate(("cusum", "ewma")):
            choose(operator, "quality_slow_combo", index)
            signals = page.control._signals
            others = {int(run) for name, runs in signals.items() if name != hidden for run in runs}
            count = len({int(run) for run in signals[hidden]} - others)
            shown = operator.widget("quality_signals_label", QLabel).text()
            assert (note.format(count, hidden.upper()) in shown) == bool(count)
            said += bool(count)
    assert said, "the runs signal in one of the charts only"
    language.use("en")


@pytest.mark.long
@pytest.mark.parametrize(
    ("code", "title", "longer"), [("en", "3 of 10 runs", "longer time"), ("zh_CN", "已有3次，需要10次", "更长的时间")]
)
def test_number_of_runs_is_stated_until_a_chart_is_possible(
    operator: Operator, code: str, title: str, longer: str
) -> None:
    folder = operator.site_folder.runs
    folder.mkdir(exist_ok=True)
    for hours, serial in enumerate(("SN-000001", "SN-000002", "SN-000003", "SN-000003"), 1):
        write_run(folder, serial, "passed", timedelta(hours=hours), bias=0.1 * hours, product="Navigation grade A")
    operator.window.app.set_product(library.find("products", "nav_a"))
    language.use(code)
    operator.window.show_page("quality_page")
    page = operator.window.findChild(QualityPage, "quality_page")
    operator.until(lambda: not page.busy and title in operator.says())
    assert longer not in operator.says(), "the time is not limited"
    period = operator.widget("quality_period_combo", QComboBox)
    period.setCurrentIndex(period.findData(7))
    operator.until(lambda: not page.busy and longer in operator.says())
    assert title in operator.says()
    language.use("en")


@pytest.mark.parametrize(
    ("code", "said"),
    [("en", "Not shown: 2 more checks"), ("zh_CN", "另有 2 项检查未显示")],
)
def test_chart_of_failed_checks_states_how_many_it_omits(qtbot: QtBot, code: str, said: str) -> None:
    names = ("gyro_bias", "gyro_scale", "accel_bias")
    ids = [CheckId("within", f"{name}_{axis}") for name in names for axis in "xyz"]
    checks = tuple(FailedCheck(each, 1, (k + 1) / len(ids)) for k, each in enumerate(ids))
    language.use(code)
    view = YieldView()
    qtbot.addWidget(view)
    for shown, text in ((checks, said), (checks[:7], "")):
        view.show_data(Yields(None, None, None, {}, {}, {}, {}, shown))
        assert view.others_label.text() == text
    language.use("en")


@pytest.mark.parametrize(
    ("code", "names"),
    [
        ("en", ["table vibration (Rate)", "IMU noise", "table vibration (Six positions)"]),
        ("zh_CN", ["转台振动（速率）", "IMU 噪声", "转台振动（六位置）"]),
    ],
)
def test_chart_of_failed_checks_names_the_stages_of_equal_names(qtbot: QtBot, code: str, names: list[str]) -> None:
    ids = CheckId("table_noise", "rate"), CheckId("imu_noise", "rate"), CheckId("table_noise", "six_position")
    language.use(code)
    view = YieldView()
    qtbot.addWidget(view)
    view.show_data(Yields(None, None, None, {}, {}, {}, {}, tuple(FailedCheck(each, 2, 1.0) for each in ids)))
    (ticks,) = view.pareto.getAxis("left")._tickLevels
    assert [name for _, name in ticks] == names
    language.use("en")


@pytest.mark.long
def test_ticks_of_numbers_of_runs_are_whole_numbers(operator: Operator, page: QualityPage) -> None:
    click_tab(operator, "Yield")
    page.yields.pareto.show_data((FailedCheck(CheckId("within", "gyro_bias_x"), 1, 1.0),))
    spacings = page.yields.pareto.getAxis("bottom").tickSpacing(0.0, 1.3, 400.0)
    assert min(spacing for spacing, _ in spacings) >= 1.0


@pytest.mark.long
def test_low_capability_is_marked_and_names_are_shaded_like_their_rows(operator: Operator, page: QualityPage) -> None:
    click_tab(operator, "Capability")
    table, rows = page.capability.table, cells(operator, "capability_table")
    kinds = [table.model().index(line, 5).data(Qt.ItemDataRole.UserRole) for line in range(len(rows))]
    assert kinds == ["bad" if float(row[5]) < 1.0 else "caution" if float(row[5]) < 1.33 else None for row in rows]
    assert {"caution", None} <= set(kinds)
    header = table.verticalHeader()
    image = header.grab().toImage()
    colours = [image.pixelColor(2, header.sectionViewportPosition(line) + 3).name() for line in (2, 3)]
    assert colours == [theme.colours().panel, theme.colours().window]
    center = QPoint(20, header.sectionViewportPosition(4) + 8)
    operator.qtbot.mouseClick(header.viewport(), Qt.MouseButton.LeftButton, pos=center)
    assert page.capability.plot.data.parameter == list(page.capability._charts)[4]


@pytest.mark.long
def test_study_lists_the_results_of_all_parameters(operator: Operator, page: QualityPage) -> None:
    click_tab(operator, "Repeatability")
    page.study.open_plan(next((operator.site_folder.runs / "studies").glob("*.json")))
    until_read(operator, page)
    rows = cells(operator, "study_overview_table")
    assert len(rows) == len(NAMES)
    study = page.study._state.studies[NAMES[4]]
    assert rows[4][:3] == ["ACCEPTABLE", f"{study.gauge.percent_tolerance:.1f}", f"{study.gauge.percent_study:.1f}"]
    click_row(operator, "study_overview_table", 4)
    assert operator.widget("study_parameter_label", QLabel).text() == parameter_text(NAMES[4])
    click_tab(operator, "Analysis of variance", "study_views")
    components = cells(operator, "study_components_table")
    assert next(row[4] for row in components if "GRR" in row[0]) == rows[4][1]
    click_tab(operator, "Capability")
    cpk = [row[5] for row in cells(operator, "capability_table")]
    click_tab(operator, "Repeatability")
    assert [row[4].strip() for row in cells(operator, "study_overview_table")] == cpk
    model = page.study.overview.model()
    marks = [model.index(line, 4).data(Qt.ItemDataRole.UserRole) for line in range(len(cpk))]
    assert [mark is not None for mark in marks] == [float(each) < 1.33 for each in cpk]
    assert operator.widget("study_parameter_label", QLabel).text() == parameter_text(NAMES[4]), "the selection is kept"
    language.use("zh_CN")
    assert cells(operator, "study_overview_table")[4][0] == "可接受"
    assert operator.widget("study_parameter_label", QLabel).text() == parameter_text(NAMES[4])


@pytest.mark.long
def test_study_shows_every_column_and_explains_a_verdict_without_a_tick(operator: Operator, page: QualityPage) -> None:
    click_tab(operator, "Repeatability")
    page.study.open_plan(next((operator.site_folder.runs / "studies").glob("*.json")))
    until_read(operator, page)
    for code, reason in (("en", "Ranges beyond the control limits"), ("zh_CN", "重复性不受控")):
        language.use(code)
        table = page.study.overview
        assert table.horizontalHeader().length() <= table.viewport().width()
        verdicts = [table.model().index(line, 0) for line in range(len(NAMES))]
        reasons = {each.data(Qt.ItemDataRole.UserRole): each.data(Qt.ItemDataRole.ToolTipRole) for each in verdicts}
        assert reason in reasons["caution"]
        assert not reasons["good"]
        columns = range(table.model().columnCount())
        of_row = next(each.row() for each in verdicts if each.data(Qt.ItemDataRole.UserRole) == "caution")
        tips = [table.model().index(of_row, k).data(Qt.ItemDataRole.ToolTipRole) for k in columns]
        assert all(reason in str(tip) for tip in tips), "in the whole row"
        note = operator.widget("study_choices_label", QLabel).text()
        assert ("only the runs of Cpk" if code == "en" else "仅用于选择计算 Cpk") in note


@pytest.mark.long
@pytest.mark.parametrize(
    ("code", "about", "caution"),
    [
        (
            "en",
            ("0 distinct categories (at", "1 distinct category (at"),
            "separates these units into only {} categor",
        ),
        ("zh_CN", ("可区分0类", "可区分1类"), "测量只能把这些产品区分为{}类"),
    ],
)
def test_study_with_too_few_distinct_categories_has_no_tick(
    operator: Operator, page: QualityPage, code: str, about: tuple[str, str], caution: str
) -> None:
    click_tab(operator, "Repeatability")
    page.study.open_plan(next((operator.site_folder.runs / "studies").glob("*.json")))
    until_read(operator, page)
    language.use(code)
    state, table = page.study._state, page.study.overview
    assert state is not None
    name, study = next((n, s) for n, s in state.studies.items() if s.verdict == "acceptable" and not state.beyond(n))
    for categories, words in enumerate(about):
        part = replace(study.part, sigma=(categories + 0.5) / 1.41 * study.gauge.sigma)
        page.study._show(replace(state, studies={**state.studies, name: replace(study, part=part)}))
        line = list(state.studies).index(name)
        click_row(operator, "study_overview_table", line)
        verdict = table.model().index(line, 0)
        assert verdict.data(Qt.ItemDataRole.UserRole) == "caution"
        assert caution.format(categories) in verdict.data(Qt.ItemDataRole.ToolTipRole)
        assert words in page.study.about_label.text()
        assert caution.format(categories) in page.study.about_label.text()
        assert page.study.badge._icon._kind == "caution"


@pytest.mark.long
def test_study_names_its_product_and_shows_only_the_cpk_of_this_product(operator: Operator, page: QualityPage) -> None:
    click_tab(operator, "Repeatability")
    page.study.open_plan(next((operator.site_folder.runs / "studies").glob("*.json")))
    until_read(operator, page)
    assert operator.widget("study_plan_label", QLabel).text().endswith(" (Navigation grade A)")
    assert all(float(row[4]) for row in cells(operator, "study_overview_table"))
    products = [page.product.itemData(k) for k in range(page.product.count())]
    choose(operator, "quality_product_combo", products.index(library.find("products", "tactical_b")))
    until_read(operator, page)
    assert page._summary is not None
    assert any(each.capability is not None for each in page._summary.parameters)
    assert {row[4].strip() for row in cells(operator, "study_overview_table")} == {"–"}
    language.use("zh_CN")
    assert operator.widget("study_plan_label", QLabel).text().endswith("（导航级 A）")


@pytest.mark.long
def test_study_is_charted_by_unit_by_appraiser_and_for_all_parameters(operator: Operator, page: QualityPage) -> None:
    click_tab(operator, "Repeatability")
    page.study.open_plan(next((operator.site_folder.runs / "studies").glob("*.json")))
    until_read(operator, page)
    click_row(operator, "study_overview_table", 4)
    name, charts, plan = NAMES[4], page.study.charts, page.study._state.plan
    values = display(name, 1.0)[0] * page.study._state.values[name]
    assert values.shape == (10, 3, 3)
    assert charts.isVisible()
    points, means = (item.getData() for item in charts.by_unit.getPlotItem().listDataItems())
    np.testing.assert_allclose(points[1], values.ravel())
    np.testing.assert_allclose(means[1], values.mean(axis=(1, 2)))
    means = charts.by_appraiser.getPlotItem().listDataItems()[1].getData()
    np.testing.assert_allclose(means[1], values.mean(axis=(0, 2)))
    assert [name for _, name in charts.by_appraiser.getAxis("bottom")._tickLevels[0]] == list(plan.operators)
    items = charts.ranges.getPlotItem().items
    lines = [item.getData()[1] for item in items if isinstance(item, pg.PlotDataItem)]
    np.testing.assert_allclose(lines, np.ptp(values, axis=-1).T)
    limits = [item.value() for item in items if isinstance(item, pg.InfiniteLine)]
    np.testing.assert_allclose(limits, np.array([0.0, 1.0, 2.574]) * np.ptp(values, axis=-1).mean(), rtol=1e-3)
    shares = page.study.shares
    assert not shares.isVisible()
    click_tab(operator, "All parameters", "study_views")
    assert shares.isVisible()
    assert "limits 10 % and 30 %" in shares._note.textItem.toPlainText()
    axis = shares.axis
    assert axis.parentWidget() is shares, "legend and numbers do not scroll"
    ends = [
        shares.plot.getViewBox().mapFromView(QPointF(100.0, 0.0)),
        axis.getViewBox().mapFromView(QPointF(100.0, 0.0)),
    ]
    assert ends[0].x() == pytest.approx(ends[1].x(), abs=1.0)
    bars = [item for item in shares.plot.getPlotItem().items if isinstance(item, pg.BarGraphItem)]
    tolerance = [each.gauge.percent_tolerance for each in page.study._state.studies.values()]
    assert bars[0].opts["width"] == tolerance
    colours = [bar.opts["brush"].name() for bar in bars]
    theme.apply("dark")
    bars = [item for item in shares.plot.getPlotItem().items if isinstance(item, pg.BarGraphItem)]
    assert all(bar.opts["brush"].name() != colour for bar, colour in zip(bars, colours, strict=True))
    theme.apply("light")
    language.use("zh_CN")
    assert shares.plot.getAxis("left")._tickLevels[0][4][1] == parameter_text(name)
    click_tab(operator, "图表", "study_views")
    assert "各产品的测量值及其均值" in operator.says()


@pytest.mark.long
def test_missing_standards_and_instruments_are_explained_beside_the_geometry(
    operator: Operator, page: QualityPage
) -> None:
    values = np.zeros(40)
    names = tuple(f"run {k}" for k in range(40))
    chart = TableChart(names, 1e9 + np.arange(40), values, 0.0, 1e-4, 40, ())
    click_tab(operator, "Check standards")
    page._show_station(StationQuality((), (), (), dict.fromkeys(TABLE_QUANTITIES, chart)))
    assert "The product has no check standard" in operator.says()
    assert "The station has no instruments" in operator.says()
    assert "[[" not in operator.says(), "there are forms for both"
    assert page.standards.table.isVisible()
    for table in (page.standards.standards, page.standards.runs, page.standards.instruments, page.standards.power):
        assert not table.isVisible()
    language.use("zh_CN")
    assert "该产品型号没有标准件" in operator.says()


@pytest.mark.long
def test_slow_changes_are_shown_by_ewma_or_cusum_charts(operator: Operator, page: QualityPage) -> None:
    assert "EWMA, λ = 0.2, L = 3.06" in operator.says()
    choose(operator, "quality_slow_combo", 1)
    assert "CUSUM, k = 0.5 σ, h = 5.35 σ" in operator.says()
    assert "individuals, ±3.13 σ, Nelson's rules; limits from the first 100 runs of any time" in operator.says()


@pytest.mark.long
def test_control_limits_do_not_depend_on_the_time_shown(operator: Operator) -> None:
    folder = operator.site_folder.runs
    folder.mkdir(exist_ok=True)
    for k in range(40):
        bias = (-1) ** k * (0.1 if k < 20 else 1.0)
        write_run(folder, f"SN-{k:06}", "passed", timedelta(days=45 - k), bias=bias, product="Navigation grade A")
    operator.window.app.set_product(library.find("products", "nav_a"))
    operator.window.show_page("quality_page")
    page = operator.window.findChild(QualityPage, "quality_page")
    operator.until(lambda: not page.busy and not page.control.empty)
    before = page.control._charts["gyro_bias_x"]
    period = operator.widget("quality_period_combo", QComboBox)
    period.setFocus()
    while period.currentData() != 30:
        operator.qtbot.keyClick(period, Qt.Key.Key_Down)
    operator.until(lambda: not page.busy and 20 < len(page.control.plots.data.parameter.names) < 30, 20)
    after = page.control._charts["gyro_bias_x"]
    assert after.process == before.process
    assert after.names == before.names[-len(after.names) :]
    assert after.baseline == len(after.names), "all runs belong to the baseline"
    assert "limits from all 40 runs of any time" in operator.says()


@pytest.mark.long
@pytest.mark.parametrize(
    ("code", "every", "state"),
    [
        ("en", "Every station", "One of the latest 10 runs signals."),
        ("zh_CN", "全部工位", "最近10次标定中有报警。"),
    ],
)
def test_runs_of_one_station_are_charted_and_a_state_is_explained(
    operator: Operator, code: str, every: str, state: str
) -> None:
    folder = operator.site_folder.runs
    folder.mkdir(exist_ok=True)
    for k in range(24):
        bias = (-1) ** (k // 2) * (2.9 if k == 23 else 0.1)
        station = ("bench 1", "bench 2")[k % 2]
        hours = timedelta(hours=30 - k)
        write_run(folder, f"SN-{k:06}", "passed", hours, bias, product="Navigation grade A", station=station)
    operator.window.app.set_product(library.find("products", "nav_a"))
    language.use(code)
    operator.window.show_page("quality_page")
    page = operator.window.findChild(QualityPage, "quality_page")
    operator.until(lambda: not page.busy and not page.control.empty)
    station = operator.widget("quality_station_combo", QComboBox)
    assert [station.itemText(k) for k in range(station.count())] == [every, "bench 1", "bench 2"]
    station.setFocus()
    operator.qtbot.keyClick(station, Qt.Key.Key_Down)
    operator.until(lambda: not page.busy and len(page.control.plots.data.parameter.names) == 12)
    signals = page.control.quantities.model().index(0, 1)
    assert signals.data(Qt.ItemDataRole.UserRole) == "good"
    operator.qtbot.keyClick(station, Qt.Key.Key_Down)
    operator.until(lambda: not page.busy and signals.data(Qt.ItemDataRole.UserRole) == "bad")
    assert signals.data(Qt.ItemDataRole.ToolTipRole) == state
    assert page._summary.yields.stations.keys() == {"bench 2"}
    others = folder.parent / "others"
    others.mkdir()
    write_run(others, "SN-1", "passed", timedelta(hours=1), product="Navigation grade A", station="bench 3")
    History(others).refresh()
    operator.window.app.set_runs_folder(others)
    operator.until(lambda: not page.busy and page._summary.yields.stations.keys() == {"bench 3"})
    assert station.currentText() == every, "the other folder has no runs of this station"
    language.use("en")


@pytest.mark.long
@pytest.mark.parametrize(
    ("code", "tab", "words"), [("en", "Yield", "No failed checks"), ("zh_CN", "合格率", "没有不合格的检查")]
)
def test_yield_of_a_single_day_without_failures_says_so(operator: Operator, code: str, tab: str, words: str) -> None:
    folder = operator.site_folder.runs
    folder.mkdir(exist_ok=True)
    write_run(folder, "SN-000001", "passed", timedelta(seconds=1), product="Navigation grade A")
    operator.window.app.set_product(library.find("products", "nav_a"))
    language.use(code)
    operator.window.show_page("quality_page")
    page = operator.window.findChild(QualityPage, "quality_page")
    click_tab(operator, tab)
    operator.until(lambda: not page.busy and words in operator.says())
    begin, end = page.yields.days.getViewBox().viewRange()[0]
    assert 7 <= (end - begin) / 86_400 < 9, "days, not one month"
    language.use("en")


@pytest.mark.long
@pytest.mark.parametrize(
    ("code", "counted"),
    [
        ("en", "1 complete run with PASS or FAIL, 1 partial run with FAIL not counted"),
        ("zh_CN", "1次得出合格或不合格结论的完整标定，另有1次部分标定不合格未计入"),
    ],
)
def test_partial_runs_that_failed_are_named_where_they_do_not_count(
    operator: Operator, code: str, counted: str
) -> None:
    folder = operator.site_folder.runs
    folder.mkdir(exist_ok=True)
    ago = timedelta(seconds=1)
    write_run(folder, "SN-000001", "passed", ago, product="Navigation grade A")
    write_run(folder, "SN-000002", "failed", ago, bias=9.0, partial=True, product="Navigation grade A")
    operator.window.app.set_product(library.find("products", "nav_a"))
    language.use(code)
    operator.window.show_page("quality_page")
    page = operator.window.findChild(QualityPage, "quality_page")
    operator.until(lambda: not page.busy and counted in operator.says())
    click_tab(operator, "Yield" if code == "en" else "合格率")
    assert counted in operator.says()
    language.use("en")


@pytest.mark.long
@pytest.mark.parametrize(
    ("code", "real", "said"),
    [
        ("en", True, "2 simulated runs of the virtual bench left out."),
        ("zh_CN", True, "未计入虚拟台架的2次模拟标定。"),
        ("en", False, "All runs are simulated, of the virtual bench."),
        ("zh_CN", False, "全部标定均为虚拟台架的模拟标定。"),
    ],
)
def test_simulated_runs_are_named(operator: Operator, code: str, real: bool, said: str) -> None:
    folder = operator.site_folder.runs
    folder.mkdir(exist_ok=True)
    for serial, simulated in (("SN-000001", not real), ("SN-000002", True), ("SN-000003", True)):
        write_run(folder, serial, "passed", timedelta(seconds=1), product="Navigation grade A", simulated=simulated)
    operator.window.app.set_product(library.find("products", "nav_a"))
    language.use(code)
    operator.window.show_page("quality_page")
    page = operator.window.findChild(QualityPage, "quality_page")
    operator.until(lambda: not page.busy and said in operator.says())
    click_tab(operator, "Yield" if code == "en" else "合格率")
    assert said in operator.says()
    assert ("1/1" if real else "3/3") in page.yields.overall_label.text()
    language.use("en")


@pytest.mark.long
def test_values_divided_by_sigma_combine_different_schedules(operator: Operator, page: QualityPage) -> None:
    before = page.control._charts["gyro_bias_x"].values
    choose(operator, "quality_scale_combo", 1)
    until_read(operator, page)
    after = page.control._charts["gyro_bias_x"]
    assert len(after.values) == len(before)
    assert after.values[:BASELINE].std() == pytest.approx(1.0, abs=0.1)
    assert after.effects is not None
    click_tab(operator, "Capability")
    assert "No capability of deviations" in operator.says()
    assert "choose “Value” under “Shown as”" in operator.says()
    language.use("zh_CN")
    until_read(operator, page)
    assert "偏差没有过程能力" in operator.says()
    language.use("en")


@pytest.mark.long
@pytest.mark.parametrize(
    ("code", "titles", "scopes"),
    [
        (
            "en",
            ("Control charts", "Capability", "Yield", "Check standards", "Repeatability"),
            (
                "",
                "All units except check standards, the last run of each: ",
                "Runs of all units except check standards: ",
                "Station test bench, runs of any time. Only the choice of the product applies here",
                "All units except check standards, the last run of each: ",
            ),
        ),
        (
            "zh_CN",
            ("控制图", "过程能力", "合格率", "标准件", "重复性研究"),
            (
                "",
                "标准件以外的全部产品，取各自最后一次：",
                "标准件以外全部产品的标定：",
                "工位“test bench”，不限时间。此处仅产品型号的选择有效",
                "标准件以外的全部产品，取各自最后一次：",
            ),
        ),
    ],
)
def test_view_says_which_choices_do_not_apply(
    operator: Operator, page: QualityPage, code: str, titles: tuple[str, ...], scopes: tuple[str, ...]
) -> None:
    offer_check_standard(operator, page)
    language.use(code)
    for title, scope in zip(titles[:3], ("the first run of each,", "the last run of each.", ""), strict=True):
        click_tab(operator, title)
        assert (scope in page.scope_label.text()) == (code == "en" or not scope)
        assert page.scope_label.isVisible() == bool(scope)
    click_tab(operator, titles[0])
    choose(operator, "quality_unit_combo", 1)
    until_read(operator, page)
    assert page.unit.currentData() == "GOLDEN-NAVA"
    for title, scope in zip(titles, scopes, strict=True):
        click_tab(operator, title)
        assert page.scope_label.text().startswith(scope)
        assert page.scope_label.isVisible() == bool(scope)
    click_tab(operator, titles[3])
    assert [each.isEnabled() for each in (page.product, page.unit, page.station, page.period, page.scale)] == [
        *(True, False, False, False, False)
    ]
    assert page.count_label.text() == "", "the count depends on choices that do not apply"
    click_tab(operator, titles[0])
    assert all(each.isEnabled() for each in (page.product, page.unit, page.station, page.period, page.scale))


@pytest.mark.long
def test_few_runs_of_a_check_standard_are_counted_as_its_own(operator: Operator, page: QualityPage) -> None:
    offer_check_standard(operator, page)
    choose(operator, "quality_unit_combo", 1)
    until_read(operator, page)
    choose(operator, "quality_station_combo", 1)
    until_read(operator, page)
    assert "A chart needs at least 10 full runs of the check standard." in operator.says()
    language.use("zh_CN")
    until_read(operator, page)
    assert "绘图至少需要该标准件的10次完整标定。" in operator.says()


@pytest.mark.long
def test_capability_and_yield_are_shown(operator: Operator, page: QualityPage) -> None:
    click_tab(operator, "Capability")
    rows = cells(operator, "capability_table")
    assert len(rows) == 30
    assert all(0.5 < float(row[5]) < 3.0 for row in rows), "Cpk"
    click_row(operator, "capability_table", 3)
    assert page.capability.plot.data.parameter == list(page.capability._charts)[3]
    click_tab(operator, "Yield")
    assert "Units passed 9" in operator.says()
    assert "runs passed" in operator.says()
    shares = cells(operator, "yield_table")
    assert {row[0] for row in shares} == {"Product", "Station", "Operator"}
    assert sum(int(row[3]) for row in shares if row[0] == "Station") == page._summary.yields.overall.count


@pytest.mark.long
def test_folder_without_runs_shows_an_explanation(operator: Operator) -> None:
    operator.window.show_page("quality_page")
    page = operator.window.findChild(QualityPage, "quality_page")
    operator.site_folder.runs.mkdir(exist_ok=True)
    page._read_all()
    assert "Reading the runs" in operator.says()
    assert "No runs yet" not in operator.says()
    until_read(operator, page)
    assert "No runs yet" in operator.says()
    assert "Reading the runs" not in operator.says()
    click_tab(operator, "Check standards")
    assert "No check standards yet" in operator.says()
    click_tab(operator, "Repeatability")
    assert "How well do stations and operators agree?" in operator.says()
    language.use("zh_CN")
    assert "各工位、各操作员的结果是否一致？" in operator.says()


@pytest.mark.long
def test_overdue_instruments_and_failed_check_standards_are_shown(operator: Operator, page: QualityPage) -> None:
    site = operator.site_folder
    product = library.find("products", "nav_a").read_text(encoding="utf-8")
    own = site.home / "products" / "nav_a.toml"
    standard = {"serial": "GOLD-1", "interval_days": 7, "reference": {"gyro_bias_x": {"value": 0.0, "sigma": 1e-8}}}
    own.write_text(product + tomli_w.dumps({"check_standards": [standard]}), encoding="utf-8")
    instruments = [
        {"name": "Table", "kind": "table", "certificate": "T-1", "due": date(2020, 1, 1)},
        {"name": "Thermometer", "kind": "other"},
        {"name": "Barometer", "kind": "other", "calibrated": date(2019, 1, 1), "due": date(2020, 1, 1)},
        {"name": "Gravity", "kind": "site", "calibrated": date(2099, 1, 1)},
        {"name": "Azimuth", "kind": "site", "calibrated": date(2026, 1, 1), "due": date(2099, 1, 1)},
    ]
    site.station.write_text(tomli_w.dumps({**STATION, "bench": BENCH, "instruments": instruments}), encoding="utf-8")
    operator.window.app.set_station(site.station)
    operator.window.app.set_product(own)
    until_read(operator, page)
    click_tab(operator, "Check standards")
    assert [row[:2] for row in cells(operator, "standards_table")] == [["never passed", "GOLD-1"]]
    states = ["overdue", "no due date", "overdue", "future date", "in order"]
    kinds = ["table", "other", "other", "survey of the site", "survey of the site"]
    rows = cells(operator, "instruments_table")
    assert [(row[0], row[2]) for row in rows] == list(zip(states, kinds, strict=True))
    model = operator.widget("instruments_table", QTableView).model()
    symbols = [model.index(line, 0).data(Qt.ItemDataRole.UserRole) for line in range(len(rows))]
    assert symbols == ["bad", "none", "caution", "caution", "good"], "another instrument does not refuse production"
    assert "not on other instruments or the geometry" in page.scope_label.text()
    language.use("zh_CN")
    states = ["已过期", "无到期日", "已过期", "日期在未来", "有效"]
    assert [row[0] for row in cells(operator, "instruments_table")] == states
    language.use("en")
    units = operator.widget("quality_unit_combo", QComboBox)
    assert [units.itemText(k) for k in range(units.count())] == [
        "All units",
        "Check standard GOLD-1",
    ]


@pytest.mark.long
def test_errors_detectable_by_a_check_standard_are_shown_with_the_limits(operator: Operator, page: QualityPage) -> None:
    site, entry = operator.site_folder, {"value": 0.0, "sigma": 1e-8}
    golden = load_result(next(site.runs.glob("GOLDEN-NAVA_*.json")))
    product = library.find("products", "nav_a").read_text(encoding="utf-8")
    own = site.home / "products" / "nav_a.toml"
    standard = {"serial": "GOLDEN-NAVA", "interval_days": 7, "reference": {"gyro_bias_x": entry, "accel_bias_y": entry}}
    own.write_text(product + tomli_w.dumps({"check_standards": [standard]}), encoding="utf-8")
    site.station.write_text(tomli_w.dumps({**STATION, "name": golden.station, "bench": BENCH}), encoding="utf-8")
    operator.window.app.set_station(site.station)
    operator.window.app.set_product(own)
    until_read(operator, page)
    click_tab(operator, "Check standards")
    assert cells(operator, "standards_table")[0][0] == "disagrees"
    state = operator.widget("standards_table", QTableView).model().index(0, 0)
    assert "disagreed with its reference" in state.data(Qt.ItemDataRole.ToolTipRole)
    click_row(operator, "standard_runs_table", 0)
    found = page.standards._standard
    assert found is not None
    rows = cells(operator, "standard_power_table")
    assert [row[0] for row in rows] == [parameter_text(name) for name in ("gyro_bias_x", "accel_bias_y")]
    for (_, e_n, shown, unit, share), name in zip(rows, ("gyro_bias_x", "accel_bias_y"), strict=True):
        value, in_unit = display(name, found.verdicts[-1].detectable[name])
        assert e_n == with_minus(f"{found.verdicts[-1].e_n[name]:.2f}")
        assert (float(shown), unit) == (pytest.approx(value, rel=0.01), in_unit)
        assert share == f"{100 * found.verdicts[-1].detectable[name] / found.half_limits[name]:.0f} %"
    assert "Smallest errors that this run detects, 90 %" in operator.says()
    names = page.standards.errors.getAxis("left")._tickLevels[0]
    assert [name for _, name in names] == [parameter_text(name) for name in ("gyro_bias_x", "accel_bias_y")]
    page.standards.errors.show_data((dict.fromkeys(NAMES, 0.5), 2.0))
    errors = page.standards.errors
    rows = [row for row, _ in errors.getAxis("left")._tickLevels[0]]
    space = errors.getViewBox().height() / len(NAMES)
    assert all(b - a >= errors.fontMetrics().height() / space for a, b in pairwise(rows)), "names do not overlap"
    out = ["--station", str(site.station), "--product", str(own), "--out", str(site.runs)]
    assert run_app(["quality", "standards", *out, "--json", str(site.home / "found.json")]) == 1
    (row,) = json.loads((site.home / "found.json").read_text(encoding="utf-8"))["standards"]
    assert row["detectable"]["gyro_bias_x"]["error"] == found.verdicts[-1].detectable["gyro_bias_x"]


@pytest.mark.long
@pytest.mark.parametrize("later", [0, 20])
def test_control_limits_of_the_table_start_after_its_baseline(
    operator: Operator, page: QualityPage, later: int
) -> None:
    values = np.append(np.zeros(BASELINE), np.full(later, 2e-4))
    alarms = tuple(BASELINE + k for k in (5, 11)[: later // 10])
    names = tuple(f"run {k}" for k in range(len(values)))
    chart = TableChart(names, 1e9 + np.arange(len(values)), values, 0.0, 1e-4, BASELINE, alarms)
    click_tab(operator, "Check standards")
    page._show_station(StationQuality((), (), (), {"orthogonality": chart}))
    assert "EWMA after 100 runs" in operator.says()
    assert ("Changed: angle between the axes. Check the axes" in operator.says()) == (later > 0)
    missing = "Nothing is tested yet: 100 of 100 runs of the baseline missing."  # of the two other quantities
    assert missing in operator.says()
    page._show_station(StationQuality((), (), (), dict.fromkeys(TABLE_QUANTITIES, chart)))
    assert "Nothing is tested yet" not in operator.says()
    short = replace(chart, names=names[:40], started=chart.started[:40], values=values[:40], baseline=40, alarms=())
    page._show_station(StationQuality((), (), (), dict.fromkeys(TABLE_QUANTITIES, short)))
    assert "60 of 100 runs of the baseline missing" in operator.says()
    page._show_station(StationQuality((), (), (), {"orthogonality": chart}))
    low, high, average = page.standards.table.plots[0].listDataItems()[1:4]
    for item in (low, high, average):
        assert list(item.xData if later else []) == list(range(BASELINE + 1, BASELINE + later + 1))


@pytest.mark.long
def test_gauge_study_is_planned_run_and_judged(
    operator: Operator, page: QualityPage, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    click_tab(operator, "Repeatability")
    operator.press("study_new_button")
    operator.qtbot.keyClicks(operator.widget("study_units_edit", QLineEdit), "A-1, A-2")
    operator.press("study_save_button")
    assert "The study" in operator.says()
    operator.qtbot.keyClicks(operator.widget("study_operators_edit", QLineEdit), "Li, Wang")
    new = tmp_path / "plan.json"
    monkeypatch.setattr(study_view, "ask_file", lambda parent, title, proposed, kinds, write: write(new))
    operator.press("study_save_button")
    until_read(operator, page)
    plan = GaugePlan.load(new)
    assert (plan.product, plan.units, plan.operators) == ("Navigation grade A", ("A-1", "A-2"), ("Li", "Wang"))
    assert (plan.stations, plan.trials) == ((), 3)
    operator.press("study_new_button")
    operator.press("study_save_button")
    again = GaugePlan.load(new)
    assert again.seed != plan.seed, "every plan has an order of its own"
    until_read(operator, page)
    plan = again
    first = plan.order[0]
    assert f"12 of 12 runs missing. Next: {first.operator} calibrates unit {first.unit}." in operator.says()
    assert [row[-1] for row in cells(operator, "study_order_table")] == ["next", *["waiting"] * 11]
    made = next((operator.site_folder.runs / "studies").glob("*.json"))
    monkeypatch.setattr(study_view, "ask_open", lambda parent, title, folder, kinds, then: then(made))
    operator.press("study_open_button")
    until_read(operator, page)
    assert "10 units × 3 operators, 3 times each" in operator.says()
    click_tab(operator, "Analysis of variance", "study_views")
    rows = cells(operator, "study_components_table")
    assert [row[0] for row in rows][-2:] == ["Units (PV)", "Total (TV)"]
    assert float(rows[-1][3]) == 100.0
    assert operator.widget("study_plan_label", QLabel).text() == f"{made.name} (Navigation grade A)"
    assert operator.widget("study_open_button", QPushButton).isEnabled()
    unit = GaugePlan.load(made).units[0]
    for path in [*operator.site_folder.runs.glob(f"{unit}_*")]:
        path.unlink()
    operator.press("study_open_button")
    until_read(operator, page)
    assert "The files of 9 runs of the study are missing" in operator.says()
    assert "calibrates unit" not in operator.says()
    states = [row[-1] for row in cells(operator, "study_order_table")]
    assert (states.count("files missing"), states.count("done")) == (9, 81)
