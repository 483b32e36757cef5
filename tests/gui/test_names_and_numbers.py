"""Parameter names and negative numbers are displayed consistently in the whole window."""

from datetime import UTC, datetime
from pathlib import Path

import pytest
from pyqtgraph.graphicsItems.DateAxisItem import MONTH_SPACING
from PySide6.QtCore import Qt
from PySide6.QtGui import QGuiApplication
from PySide6.QtWidgets import QApplication, QComboBox, QStyleOptionHeader
from pytestqt.qtbot import QtBot

from calstation.config import library, load_product
from calstation.gui.engineer.schedule_form import _number as schedule_number
from calstation.gui.quality.yield_view import DayAxis
from calstation.gui.text import about, check_text, language, parameter_text, product_text, say
from calstation.gui.widgets import Column, NumberEdit, ParameterModel, ParameterTable, ThemedPlot, VectorEdit, theme
from calstation.judgement import Check
from calstation.messages import Language, Text, sentence
from calstation.physics import EFFECT_PARAMETERS, PAIR_PARAMETERS, PARAMETERS
from tests.gui.conftest import Operator


@pytest.mark.parametrize(("code", "name"), [("en", "gyro bias x"), ("zh_CN", "陀螺零偏 x")])
def test_table_shows_translated_names_and_gives_programs_and_files_identifiers(
    qapp: QApplication, qtbot: QtBot, code: str, name: str
) -> None:
    language.use(code)
    model = ParameterModel([Column(lambda: "value", lambda _: "-1.5"), Column(lambda: "raw", str, number=False)])
    table = ParameterTable(model)
    qtbot.addWidget(table)
    model.show(model.columns, ["gyro_bias_x"])
    vertical = Qt.Orientation.Vertical
    assert model.headerData(0, vertical, Qt.ItemDataRole.AccessibleTextRole) == name
    option = QStyleOptionHeader()
    table.verticalHeader().initStyleOptionForIndex(option, 0)
    assert option.text == name
    assert model.headerData(0, vertical) == "gyro_bias_x"  # the contract's name, for programs that drive the window
    assert model.headerData(0, vertical, Qt.ItemDataRole.ToolTipRole) == "gyro_bias_x"
    assert model.index(0, 0).data() == "−1.5"
    assert model.index(0, 1).data() == "gyro_bias_x"
    table.copy()
    assert QGuiApplication.clipboard().text().splitlines()[1] == "gyro_bias_x\t-1.5\tgyro_bias_x"
    language.use("en")


def test_every_parameter_has_a_name_in_both_languages(qapp: QApplication) -> None:
    names = [p.name for p in (*PARAMETERS, *PAIR_PARAMETERS, *EFFECT_PARAMETERS)]
    english = {name: parameter_text(name) for name in names}
    language.use("zh_CN")
    chinese = {name: parameter_text(name) for name in names}
    language.use("en")
    assert len(set(english.values())) == len(set(chinese.values())) == len(names)
    assert not [name for name in names if english[name] == chinese[name] or "_" in english[name]]
    assert parameter_text("secondary3_gyro_bias_x") == "secondary gyro bias x, IMU 3"


@pytest.mark.parametrize("typed", ["-12.5", "−12.5"])
def test_field_shows_a_minus_sign_and_accepts_a_hyphen(qtbot: QtBot, typed: str) -> None:
    edit = NumberEdit()
    qtbot.addWidget(edit)
    edit.show_value(-12.5)
    assert edit.text() == "−12.5"
    edit.clear()
    QGuiApplication.clipboard().setText(typed)
    edit.paste()
    assert edit.value() == -12.5
    assert schedule_number(typed) == -12.5
    vector = VectorEdit()
    qtbot.addWidget(vector)
    vector.show_value([-1, 0, 1])
    assert [each.text() for each in vector.edits] == ["−1", "0", "1"]
    assert vector.value() == [-1, 0, 1]


def test_axis_labels_have_minus_signs(qtbot: QtBot) -> None:
    plot = ThemedPlot()
    qtbot.addWidget(plot)
    for side in ("left", "bottom"):
        assert plot.getAxis(side).tickStrings([-1.0, 0.0], 1.0, 1.0) == ["−1", "0"]


def test_sentences_have_minus_signs_only_in_the_window(qapp: QApplication) -> None:
    turn = Text.of("step.position", outer=-90.0, inner=0.0)
    assert "−90" in say(turn)
    assert "-90" in sentence(turn)


@pytest.mark.long
def test_products_have_the_same_translated_name_everywhere(operator: Operator) -> None:
    operator.choose("nav_a")
    operator.window.show_page("station_page")
    combo, box = operator.widget("product_combo", QComboBox), operator.widget("imu_test_product", QComboBox)
    for code, name in (("en", "Navigation grade A"), ("zh_CN", "导航级 A"), ("en", "Navigation grade A")):
        operator.window.app.set_language(code)
        assert combo.currentText() == box.currentText() == product_text("Navigation grade A") == name
        assert Path(combo.currentData()).stem == "nav_a"
    assert product_text("our_unit") == "our_unit"


def test_every_shipped_product_has_a_chinese_name(qapp: QApplication) -> None:
    language.use("zh_CN")
    files = (library.shipped_folder() / "products").glob("*.toml")
    names = [load_product(file)[1].name for file in files]
    untranslated = [name for name in names if product_text(name) == name]
    language.use("en")
    assert untranslated == []


@pytest.mark.parametrize(("code", "names"), [("en", ["Jan", "Dec"]), ("zh_CN", ["1月", "12月"])])
def test_months_of_the_yield_are_in_the_current_language(qapp: QApplication, code: str, names: list[str]) -> None:
    language.use(code)
    axis = DayAxis("bottom", utcOffset=0)
    starts = [datetime(2026, month, 1, tzinfo=UTC).timestamp() for month in (1, 12)]
    shown = axis.tickStrings(starts, 1.0, MONTH_SPACING)
    language.use("en")
    assert shown == names


@pytest.mark.parametrize("name", ["light", "dark"])
def test_names_have_the_background_of_their_rows(qtbot: QtBot, name: str) -> None:
    before = theme.current()
    theme.apply(name)
    model = ParameterModel([Column(lambda: "value", lambda _: "")])
    table = ParameterTable(model)
    qtbot.addWidget(table)
    names = [f"{group}_{axis}" for group in ("gyro_bias", "gyro_scale") for axis in "xy"]
    model.show(model.columns, names)
    table.resize(400, 300)
    table.show()
    image = table.grab().toImage()
    for row in range(len(names)):
        y = table.viewport().y() + table.rowViewportPosition(row) + 3
        colours = [image.pixelColor(x, y).name() for x in (table.verticalHeader().x() + 3, table.viewport().x() + 20)]
        assert colours[0] == colours[1], (names[row], colours)
    theme.apply(before)


def test_estimated_samples_are_the_unit_of_clipping(qapp: QApplication) -> None:
    check = Check("clipping", "azimuth_flip", 0.63, 30.0, "1", passed=True)
    text = check_text(check)
    assert [text.value, text.limit, text.unit] == ["0.63", "≤ 30", "samples (estimate)"]
    language.use("zh_CN")
    try:
        assert check_text(check).unit == "个采样点（估计）"
    finally:
        language.use("en")


@pytest.mark.parametrize(("limit", "texts"), [(0.10829, ["0.2984", "≤ 6.205", "°"]), (0.005, ["1074", "≤ 1031", "″"])])
def test_large_angle_of_a_check_is_in_degrees(limit: float, texts: list[str]) -> None:
    text = check_text(Check("heading", "azimuth_flip", 5.2077e-3, limit, "rad", passed=True))
    assert [text.value, text.limit, text.unit] == texts


@pytest.mark.parametrize(("code", "words"), [("en", "the larger of both"), ("zh_CN", "两者中较大的标准差")])
def test_the_tip_of_differences_in_sigma_states_the_divisor_for_the_same_data(
    qapp: QApplication, code: Language, words: str
) -> None:
    language.use(code)
    assert words in about("column", "in_sigma")
    language.use("en")
