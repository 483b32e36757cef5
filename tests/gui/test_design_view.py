"""The schedule designer on the engineer page, operated by clicks: form, progress, result, saving and export."""

import json
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PySide6.QtCore import Qt
from PySide6.QtGui import QGuiApplication
from PySide6.QtWidgets import (
    QComboBox,
    QDoubleSpinBox,
    QFileDialog,
    QLabel,
    QLineEdit,
    QPushButton,
    QSlider,
    QTabBar,
)
from pytestqt.qtbot import QtBot

from calstation.config import library, versions
from calstation.gui.engineer.designer import DesignView
from calstation.gui.engineer.designer.form import DesignForm
from calstation.gui.engineer.designer.plots import FrontPlot, Sphere
from calstation.gui.engineer.designer.result import DesignResult, _headline
from calstation.gui.text import language, say
from calstation.gui.widgets import PageArea
from tests.gui import design_jobs
from tests.gui.conftest import SiteFolder
from tests.gui.test_engineer_page import Engineer

pytestmark = pytest.mark.long

DESIGN_VIEW = 7


class Designer(Engineer):
    """Operates the designer."""

    def open_view(self) -> "Designer":
        """Show the designer."""
        self.open_page()
        self.show_view(DESIGN_VIEW)
        return self

    def design(self) -> None:
        """Press Design and wait for the result and its path."""
        self.press("design_button")
        self.until(lambda: not (self.view.watch.busy or self.view.path_job.busy))

    def show_answer(self, number: int) -> None:
        """Show a part of the result: duration, path, parameters, robustness, hidden effects."""
        self.widget("design_views", QTabBar).setCurrentIndex(number)

    @property
    def view(self) -> DesignView:
        """The designer."""
        return self.page.design

    @property
    def headline(self) -> str:
        """Return the headline of the result."""
        return str(self.widget("design_headline", QLabel).text())


@pytest.fixture
def designer(window: Any, qtbot: Any, site_folder: SiteFolder, monkeypatch: pytest.MonkeyPatch) -> Designer:
    """The designer with a search that ends immediately."""
    use(monkeypatch, "found")
    return Designer(window, qtbot, site_folder).open_view()


def use(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    """Use a search of `design_jobs`."""
    monkeypatch.setattr("calstation.designer.design_schedule", getattr(design_jobs, name))


def test_design_is_shown_with_path_parameters_and_robustness(designer: Designer) -> None:
    assert "The shortest schedule for short" in designer.says()
    assert "Goal for short" in designer.says()
    designer.design()
    assert "The shortest schedule for short" not in designer.says()
    assert designer.headline == (
        "short on test bench: 0:33 planned, 0:48 at most. The current stages take 5:30, 10 times as long.\n"
        "Limited by accel bias y: σ is 0.78 of its limit. Effects that shift gyro bias z by up to 10.1 σ remain hidden."
    )
    assert "limits reached" in designer.says()
    assert "4 moves and 2 in reserve at 60 °/s and 60 °/s²" in designer.says()
    (front,) = designer.page.findChildren(FrontPlot)
    x, y = front.getPlotItem().listDataItems()[0].getOriginalDataset()
    np.testing.assert_allclose(x, [10.0, 20.0, 30.0, 33.0])
    np.testing.assert_allclose(y, [20.0, 2.0, 0.9, 0.78])

    designer.show_answer(1)
    path = designer.view.result_view._path
    assert [label for label, _, _ in path.bands(path.data)] == ["planned", "reserve"]
    assert path.data.duration == pytest.approx(sum(move[2] for move in design_jobs.MOVES) + 30.0, abs=20.0)

    designer.show_answer(2)
    rows = designer.cells("design_parameters")
    assert list(rows) == ["accel_bias_y", "gyro_bias_x", "accel_scale_z"]
    assert rows["accel_bias_y"]["σ / limit"] == "0.780"
    assert (rows["accel_scale_z"]["σ planned"], rows["accel_scale_z"]["σ limit"]) == ("25", "100")

    designer.show_answer(3)
    conditions = designer.cells("design_variations")
    assert [tuple(row.values()) for row in conditions.values()] == [
        ("Mounting of the unit off by 1.7°", "0:40", "0.95"),
        ("1.5 times the noise", "0:48", "0.99"),
        ("Table heading turned by 90°", "missed", "1.25"),
    ]
    assert "4 rests, the longest 6 s" in designer.says()
    assert "latitude with σ = 0.5°" in designer.says()
    assert "Noise 9 % above" in designer.says()

    designer.show_answer(4)
    hidden = [list(row.values()) for row in designer.cells("design_hidden").values()]
    assert [row[0] for row in hidden] == ["drift of gyro bias z", "gyro g-sensitivity yy", "time skew"]
    assert hidden[0][2:] == ["°/h", "gyro bias z", "10.1"]
    assert hidden[2][1:] == ["∞", "ms", "–", "–"]


@pytest.mark.parametrize(
    ("code", "words"),
    [("en", "The current stages take the same time, 0:33."), ("zh_CN", "现有阶段用时相同，为 0:33。")],
)
def test_current_stages_that_take_as_long_are_not_compared_by_a_factor(code: str, words: str) -> None:
    language.use(code)
    design = design_jobs.design()
    assert words in _headline(replace(design, present=design.duration))
    language.use("en")


@pytest.mark.parametrize(
    ("code", "verdict", "names"), [("en", "a run would fail", "gyro bias z"), ("zh_CN", "运行将不合格", "陀螺零偏 z")]
)
def test_design_that_leaves_a_parameter_undetermined_is_not_called_sufficient(
    designer: Designer, monkeypatch: pytest.MonkeyPatch, code: str, verdict: str, names: str
) -> None:
    use(monkeypatch, "incomplete")
    designer.window.app.set_language(code)
    designer.design()
    assert verdict in designer.says()
    assert names in designer.headline


def test_best_schedule_found_beside_the_chosen_one_is_in_the_range_of_the_plot(qtbot: QtBot) -> None:
    plot = FrontPlot()
    qtbot.addWidget(plot)
    for ratios in ((90.0, 500.0), (2.0, 500.0)):
        others = tuple((10.0 + number, ratio) for number, ratio in enumerate(sorted(ratios, reverse=True)))
        plot.show_design(replace(design_jobs.design(), front=others))
        _, (low, high) = plot.getViewBox().viewRange()
        assert low < np.log10(design_jobs.design().worst) < np.log10(min(ratios)) < high


@pytest.mark.parametrize(
    ("code", "found", "largest"),
    [
        (
            "en",
            "no other schedule found: search longer",
            "Largest σ: accel bias y, 0.78 of its limit.",
        ),
        ("zh_CN", "未找到其他流程：请延长搜索", "标准差最大的是加表零偏 y，为限差的 0.78 倍。"),
    ],
)
def test_random_moves_are_not_called_limited_and_their_plot_says_that_nothing_else_was_found(
    designer: Designer, monkeypatch: pytest.MonkeyPatch, code: str, found: str, largest: str
) -> None:
    use(monkeypatch, "random_moves")
    designer.window.app.set_language(code)
    designer.design()
    assert largest in designer.headline
    (front,) = designer.page.findChildren(FrontPlot)
    note = front._note.toPlainText()
    assert found in note
    assert "●" not in note


def test_sphere_shows_the_direction_of_gravity_and_can_be_rotated(designer: Designer, tmp_path: Path) -> None:
    designer.design()
    designer.show_answer(1)
    (sphere,) = designer.page.findChildren(Sphere)
    sphere.write_csv(tmp_path / "path.csv")
    lines = [line.split(",") for line in (tmp_path / "path.csv").read_text(encoding="utf-8").splitlines()]
    assert lines[0] == ["time_s", "down_x", "down_y", "down_z", "part"]
    down = np.array([[float(cell) for cell in line[1:4]] for line in lines[1:]])
    np.testing.assert_allclose(np.linalg.norm(down, axis=1), 1.0)
    np.testing.assert_allclose(down[0], [0.0, 0.0, -1.0], atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(np.diff(down, axis=0), axis=1).max(), 0.0, atol=0.15)
    assert {line[4] for line in lines[1:]} == {"planned", "reserve"}
    slider, before = designer.widget("design_turn_slider", QSlider), sphere.grab().toImage()
    slider.setFocus()
    designer.qtbot.keyClick(slider, Qt.Key.Key_Right)
    assert slider.value() == 10
    assert sphere.grab().toImage() != before


def test_form_creates_the_request(designer: Designer) -> None:
    (form,) = designer.page.findChildren(DesignForm)
    stop, product = Path("stop"), Path("short.toml")
    assert form.request(None, product, stop).margin == 0.8
    assert form.request(None, product, stop).time_limit is None
    for name in ("design_rate_spin", "design_minutes_spin"):
        assert not designer.widget(name, QDoubleSpinBox).isVisible()
    designer.press("design_more_button")
    for name, text in (
        ("design_margin_spin", "0.7"),
        ("design_search_spin", "90"),
        ("design_rate_spin", "500"),
        ("design_seed_spin", "3"),
    ):
        spin = designer.widget(name, QDoubleSpinBox)
        spin.setFocus()
        spin.selectAll()
        designer.qtbot.keyClicks(spin, text)
        designer.qtbot.keyClick(spin, Qt.Key.Key_Tab)
    request = form.request(None, product, stop)
    assert (request.margin, request.duration, request.as_present) == (0.7, None, False)
    assert (request.time_limit, request.seed, request.acceleration_dps2) == (90.0, 3, None)
    assert request.rate_dps is None, "500 is more than the table reaches"
    message = designer.widget("design_rate_spin_message", QLabel)
    assert message.text().startswith("500 was not accepted. Enter 0 to ")
    assert message.property("kind") == "error"
    assert designer.widget("design_rate_spin", QDoubleSpinBox).property("invalid"), "its border is red"
    language.use("zh_CN")
    assert message.text().startswith("未接受 500")
    language.use("en")
    combo = designer.widget("design_goal_combo", QComboBox)
    combo.setFocus()
    designer.qtbot.keyClick(combo, Qt.Key.Key_Down)
    assert form.request(None, product, stop).duration == 300.0
    assert not designer.widget("design_margin_spin", QDoubleSpinBox).isVisible()
    designer.qtbot.keyClick(combo, Qt.Key.Key_Down)
    request = form.request(None, product, stop)
    assert (request.as_present, request.margin, request.duration) == (True, 1.0, None)


@pytest.mark.parametrize(("code", "words"), [("en", "Margin: 5 was not accepted"), ("zh_CN", "裕度：未接受 5")])
def test_no_search_starts_with_a_rejected_number(designer: Designer, code: str, words: str) -> None:
    designer.window.app.set_language(code)
    designer.design()
    spin, design = designer.widget("design_margin_spin", QDoubleSpinBox), designer.widget("design_button", QPushButton)
    message = designer.widget("design_margin_spin_message", QLabel)

    def enter(typed: str) -> None:
        spin.setFocus()
        spin.selectAll()
        designer.qtbot.keyClicks(spin, typed)
        designer.qtbot.mouseClick(design, Qt.MouseButton.LeftButton)

    enter("5")
    assert not designer.view.watch.busy
    assert (spin.text(), message.isVisible()) == ("5", True)
    assert designer.why_not("design_button").startswith(words)
    assert say("engineer.design_outdated") in designer.says()
    designer.widget("design_goal_combo", QComboBox).setCurrentIndex(2)
    assert design.isEnabled(), "this goal has no margin"
    designer.widget("design_goal_combo", QComboBox).setCurrentIndex(0)
    assert not design.isEnabled()
    assert spin.text() == "5"
    enter("0.5")
    designer.until(lambda: not (designer.view.watch.busy or designer.view.path_job.busy))
    assert not message.isVisible()
    assert say("engineer.design_reached") in designer.says()


@pytest.mark.parametrize(("goal", "best"), [(0, "Best so far 0:34"), (1, "Best so far σ / limit 0.82")])
def test_search_is_stopped_with_its_best_design_or_cancelled(
    designer: Designer, monkeypatch: pytest.MonkeyPatch, goal: int, best: str
) -> None:
    use(monkeypatch, "searching")
    designer.widget("design_goal_combo", QComboBox).setCurrentIndex(goal)
    designer.press("design_button")
    designer.until(lambda: best in designer.says())
    assert designer.why_not("design_button") == "A search is in progress."
    stop = designer.view._stop_file
    designer.press("stop_design_button")
    assert not designer.widget("stop_design_button", QPushButton).isEnabled()
    designer.until(lambda: not designer.view.watch.busy)
    assert designer.headline.startswith("short on test bench: 0:33 planned")
    assert not stop.parent.exists()
    designer.until(lambda: not designer.view.path_job.busy)

    designer.press("design_button")
    designer.until(lambda: best in designer.says())
    designer.press("cancel_design_button")
    assert not designer.view.watch.busy
    assert designer.widget("design_button", QPushButton).isEnabled()
    assert designer.headline.startswith("short on test bench: 0:33 planned"), "the last answer stays"


def test_cancelled_search_for_another_product_keeps_the_previous_design(
    designer: Designer, monkeypatch: pytest.MonkeyPatch
) -> None:
    designer.design()
    use(monkeypatch, "searching")
    designer.choose("mems_c")
    designer.press("design_button")
    # a busy computer may end the search before a progress report is shown
    designer.until(lambda: "Best so far" in designer.says() or designer.view._result is not None)
    designer.press("cancel_design_button")
    assert designer.headline.startswith("short on test bench")
    designer.unlock()
    assert "design again" in designer.why_not("save_as_button")
    designer.choose("short")
    designer.press("save_as_button")
    assert designer.widget("design_name_edit", QLineEdit).text() == "short_fast"


@pytest.mark.parametrize(("code", "outdated"), [("en", "out of date"), ("zh_CN", "已过时")])
def test_design_is_out_of_date_after_a_change_of_its_conditions(
    designer: Designer, site_folder: SiteFolder, code: str, outdated: str
) -> None:
    designer.window.app.set_language(code)
    designer.unlock()
    designer.design()
    why, reached = say("engineer.design_outdated"), say("engineer.design_reached")
    product, station = designer.window.app.product_path, designer.window.app.station_path
    other = site_folder.folder / "other_station.toml"
    other.write_text(station.read_text(encoding="utf-8") + "\n", encoding="utf-8")

    def check(*, current: bool) -> None:
        save = designer.widget("save_as_button", QPushButton)
        assert (outdated in designer.says(), reached in designer.says(), save.isEnabled()) == (
            not current,
            current,
            current,
        )
        assert current or (why in designer.says() and save.toolTip() == why)

    check(current=True)
    for name, value in (("design_margin_spin", "0.05"), ("design_rate_spin", "10")):
        spin = designer.widget(name, QDoubleSpinBox)
        before = spin.value()
        spin.setFocus()
        spin.selectAll()
        designer.qtbot.keyClicks(spin, value)
        designer.qtbot.keyClick(spin, Qt.Key.Key_Tab)
        check(current=False)
        spin.setValue(before)
        check(current=True)
    combo = designer.widget("design_goal_combo", QComboBox)
    combo.setFocus()
    designer.qtbot.keyClick(combo, Qt.Key.Key_Down)
    check(current=False)
    designer.qtbot.keyClick(combo, Qt.Key.Key_Up)
    designer.press("save_as_button")
    designer.choose("mems_c")
    check(current=False)
    assert designer.headline.startswith("short")
    assert designer.why_not("save_design_button") == why
    designer.choose("short")
    check(current=True)
    designer.window.app.set_station(other)
    check(current=False)
    designer.window.app.set_station(station)
    designer.choose("short")
    check(current=True)
    product.write_text(product.read_text(encoding="utf-8") + "\n", encoding="utf-8")
    designer.window.app.product_changed.emit()
    check(current=False)
    designer.design()
    check(current=True)


def test_design_is_out_of_date_if_its_conditions_changed_during_the_search(
    designer: Designer, monkeypatch: pytest.MonkeyPatch
) -> None:
    use(monkeypatch, "searching")
    designer.press("design_button")
    designer.widget("design_margin_spin", QDoubleSpinBox).setValue(0.5)
    designer.press("stop_design_button")
    designer.until(lambda: not (designer.view.watch.busy or designer.view.path_job.busy))
    assert "out of date" in designer.says()
    assert not designer.widget("save_as_button", QPushButton).isEnabled()


def test_time_left_is_shown_from_the_start_if_the_search_has_a_limit(
    designer: Designer, monkeypatch: pytest.MonkeyPatch
) -> None:
    use(monkeypatch, "begun")
    assert designer.widget("design_search_spin", QDoubleSpinBox).text() == "usual, 60 to 180"
    designer.press("design_button")
    designer.until(lambda: designer.view._job.remaining_label.text() == "1 %, usually one to three minutes")
    language.use("zh_CN")
    assert designer.view._job.remaining_label.text() == "1 %, 通常需一到三分钟"
    language.use("en")
    designer.press("stop_design_button")
    designer.until(lambda: not designer.view.watch.busy)
    designer.widget("design_search_spin", QDoubleSpinBox).setValue(90.0)
    designer.press("design_button")
    designer.until(lambda: designer.view._job.remaining_label.text().startswith("1 %, 1:"))
    designer.press("stop_design_button")
    designer.until(lambda: not designer.view.watch.busy)


def test_duration_plot_has_at_least_three_labels(designer: Designer) -> None:
    designer.design()
    (front,) = designer.page.findChildren(FrontPlot)
    axis = front.getAxis("left")
    for low, high in ((-0.2, 0.1), (-0.11, -0.09), (0.0, 0.4), (-2.0, 3.0), (0.301, 0.698)):
        ticks = axis.logTickValues(low, high, 300.0, [(1.0, list(range(-2, 4)))])
        labels = [text for spacing, values in ticks for text in axis.logTickStrings(values, 1.0, spacing or 0.0)]
        named = {float(text) for text in labels if text}
        assert len(named) >= 3, (low, high)
        assert all(10.0**low * 0.999 <= value <= 10.0**high * 1.001 for value in named), (low, high)


def test_error_is_shown_below_the_form(designer: Designer, monkeypatch: pytest.MonkeyPatch) -> None:
    use(monkeypatch, "unreachable")
    designer.design()
    problem = designer.widget("design_problem", QLabel)
    assert problem.text().startswith("gyro bias x cannot be brought below 1 °/h")
    assert problem.isVisible()
    use(monkeypatch, "found")
    designer.design()
    assert not problem.isVisible()


def test_design_is_saved_as_a_product_and_selected(designer: Designer) -> None:
    designer.design()
    assert "PIN" in designer.why_not("save_as_button")
    designer.unlock()
    designer.press("save_as_button")
    name = designer.widget("design_name_edit", QLineEdit)
    assert name.text() == "short_fast"
    for wrong, problem in (("short fast", "Only letters"), ("short", "keeps its own stages"), ("", "Enter a name")):
        designer.type("design_name_edit", wrong)
        assert problem in designer.why_not("save_design_button")
    designer.type("design_name_edit", "short_fast")
    designer.press("save_design_button")
    designer.until(lambda: "short_fast: version 1 saved" in designer.says())
    path = library.find("products", "short_fast")
    stored = tomllib.loads(path.read_text(encoding="utf-8"))
    assert stored["stages"] == ["designed"]
    assert stored["schedule"]["designed"]["moves"] == [list(move) for move in design_jobs.MOVES]
    assert versions.list_versions("products", "short_fast")[0].author == "wang"
    designer.window.show_page("operator_page")
    combo = designer.widget("product_combo", QComboBox)
    assert "short, designed" in [combo.itemText(index) for index in range(combo.count())]
    designer.window.show_page("engineer_page")
    designer.press("select_product_button")
    assert designer.window.app.product_path == path
    selector = designer.page.choice.selector
    assert selector.stages == ("designed",)
    assert not any(check.isVisible() for check in selector._parts.values()), "no part consists of its stage"
    assert "Stages, in this order:" in designer.says()
    language.use("zh_CN")
    assert "阶段，按以下次序：" in designer.says()
    language.use("en")
    assert "Goal for short, designed" in designer.says()
    assert "Product: short, designed" in designer.says()
    designer.choose("short")
    designer.press("save_as_button")
    assert name.text() == "short_fast-2"
    designer.type("design_name_edit", "short_fast")
    assert "The product short_fast exists" in designer.says()
    designer.press("cancel_save_design_button")
    assert not name.isVisible()
    designer.choose("short_fast")
    designer.design()
    designer.press("save_as_button")
    assert name.text() == "short_fast-2", "a design of a designed product does not repeat the ending"


def test_schedule_is_copied_and_the_design_exported(designer: Designer, tmp_path: Path) -> None:
    designer.design()
    designer.press("copy_schedule_button")
    copied = tomllib.loads(QGuiApplication.clipboard().text())["schedule"]["designed"]
    assert copied == json.loads(json.dumps(design_jobs.design().schedule()))
    designer.press("export_design_button")
    dialog = designer.view.findChild(QFileDialog)
    assert dialog is not None
    dialog.fileSelected.emit(str(tmp_path / "design.json"))
    dialog.close()
    exported = json.loads((tmp_path / "design.json").read_text(encoding="utf-8"))
    assert exported["limiting"] == "accel_bias_y"


def test_designer_requires_a_motorised_table(window: Any, qtbot: Any, site_folder: SiteFolder) -> None:
    designer = Designer(window, qtbot, site_folder).open_view()
    for station, product in (("virtual_hand", "mems_hand"), ("virtual_gimbal", "mems_gimbal")):
        designer.window.app.set_product(library.find("products", product))
        designer.window.app.set_station(library.find("stations", station))
        assert "needs a two-axis table with drives" in designer.why_not("design_button")
        assert "needs a two-axis table with drives" in designer.says()


@pytest.mark.parametrize("code", ["en", "zh_CN"])
def test_designer_fits_a_small_window_in_both_languages(designer: Designer, code: str) -> None:
    designer.window.resize(1280, 720)
    designer.window.app.set_language(code)
    designer.unlock()
    designer.design()
    designer.press("design_more_button")
    designer.press("save_as_button")
    area = next(a for a in designer.window.findChildren(PageArea) if a.isAncestorOf(designer.page))
    for number in range(5):
        designer.show_answer(number)
        designer.qtbot.wait(1)
        assert area.verticalScrollBar().maximum() == area.horizontalScrollBar().maximum() == 0, number
        for button in designer.view.findChildren(QPushButton):
            if button.isVisible():
                assert button.width() >= button.fontMetrics().horizontalAdvance(button.text()), button.text()


def test_designer_is_operated_by_keyboard(designer: Designer) -> None:
    designer.design()
    designer.show_answer(1)
    designer.unlock()
    designer.widget("design_goal_combo").setFocus()
    seen = []
    for _ in range(10):
        seen.append(designer.window.focusWidget().objectName())
        designer.qtbot.keyClick(designer.window.focusWidget(), Qt.Key.Key_Tab)
    assert seen[:4] == ["design_goal_combo", "design_margin_spin", "design_search_spin", "design_more_button"]
    assert seen[4:6] == ["design_button", "design_views"]
    assert seen[6:] == ["copy_schedule_button", "export_design_button", "save_as_button", "design_turn_slider"]
    assert isinstance(designer.view.result_view, DesignResult)


def test_real_search_finds_a_shorter_schedule(window: Any, qtbot: Any, site_folder: SiteFolder) -> None:
    designer = Designer(window, qtbot, site_folder).open_view()
    designer.choose("mems_c")
    designer.widget("design_search_spin", QDoubleSpinBox).setValue(5.0)
    designer.press("design_button")
    # a busy computer may end the search before a progress report is shown
    designer.until(lambda: "Best so far" in designer.says() or designer.view._result is not None)
    designer.until(lambda: not (designer.view.watch.busy or designer.view.path_job.busy), 300.0)
    assert "limits reached" in designer.says() or "random moves: search longer" in designer.says()
    assert designer.view._result is not None
    design, _ = designer.view._result
    assert design.duration < 0.2 * design.present
    designer.show_answer(2)
    assert next(iter(designer.cells("design_parameters"))) == design.limiting
