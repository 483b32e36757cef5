"""The schedule designer on the engineer page for a product over temperature."""

import tomllib
from typing import Any

import pytest
from PySide6.QtWidgets import QComboBox, QDoubleSpinBox, QLabel, QLineEdit

from calstation.config import library
from calstation.designer import TIME_CONSTANT, DesignRequest, TemperatureDesign, design_temperature
from calstation.jobs import ProgressCallback
from tests.gui.conftest import SiteFolder
from tests.gui.test_design_view import DESIGN_VIEW, Designer

pytestmark = pytest.mark.long


def quick(report: ProgressCallback, request: DesignRequest, tau: float, heating: float) -> TemperatureDesign:
    """Design as the command does, and check the properties of the unit that the form states."""
    assert (tau, heating) == (270.0, 4.0)
    return design_temperature(report, request, tau, heating)


def test_design_over_temperature_is_shown_and_saved(
    window: Any, qtbot: Any, site_folder: SiteFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("calstation.designer.design_temperature", quick)
    designer = Designer(window, qtbot, site_folder)
    window.app.set_station(library.find("stations", "virtual_chamber"))
    window.app.set_product(library.find("products", "mems_c_thermal"))
    designer.open_page()
    designer.show_view(DESIGN_VIEW)
    assert not designer.widget("design_goal_combo", QComboBox).isEnabled()
    assert designer.widget("design_time_constant_spin", QDoubleSpinBox).value() == TIME_CONSTANT
    designer.widget("design_time_constant_spin", QDoubleSpinBox).setValue(270.0)
    designer.widget("design_self_heating_spin", QDoubleSpinBox).setValue(4.0)
    designer.design()
    design = designer.view._result[0]
    assert isinstance(design, TemperatureDesign)
    headline = designer.widget("temperature_design_headline", QLabel).text()
    assert f"{design.soak.temperatures} temperatures" in headline
    rows = designer.cells("temperature_design_schedules")
    assert list(rows) == ["soak", "fewer", "more", "ramp"]
    assert rows["soak"]["σ / limit"] == f"{design.soak.worst:.2f}"
    sigmas = designer.cells("temperature_design_sigmas")
    assert {name.rpartition("_")[0] for name in sigmas} >= {"gyro_bias", "accel_scale"}
    window.app.set_language("zh_CN")
    headline = designer.widget("temperature_design_headline", QLabel).text()
    assert "占用温箱" in headline
    assert headline.startswith("MEMS C 级，全温，虚拟温箱")
    assert "目标（MEMS C 级，全温）" in designer.says()
    assert "陀螺零偏 4、陀螺刻度系数 4" in designer.says().replace("\u00a0", " ")

    designer.unlock()
    constant = designer.widget("design_time_constant_spin", QDoubleSpinBox)
    constant.setValue(280.0)
    assert "已过时" in designer.says()
    assert "重新设计" in designer.why_not("save_temperature_design_as_button")
    constant.setValue(270.0)
    assert "已过时" not in designer.says()
    designer.press("save_temperature_design_as_button")
    designer.widget("design_name_edit", QLineEdit).setText("thermal_designed")
    designer.press("save_design_button")
    designer.until(lambda: "thermal_designed" in library.names("products"))
    text = library.find("products", "thermal_designed").read_text(encoding="utf-8")
    assert tomllib.loads(text)["schedule"]["temperature"]["points_c"] == design.soak.schedule["points_c"]
