"""A gimbal run in the window: joints and the drift of each rotation; the run consists of emitted events."""

import pytest
from PySide6.QtWidgets import QComboBox

from calstation.config import RunRequest, library
from calstation.gui.state.engine_link import EngineLink
from calstation.physics import ARCSECOND
from calstation.sequencer import GimbalTurned, JointsMoved, StageStarted, StateChanged, StepStarted
from tests.gui.conftest import SERIAL, Operator


@pytest.fixture
def gimbal_run(operator: Operator, monkeypatch: pytest.MonkeyPatch) -> Operator:
    """An operator at a station with a gimbal, in the first stage."""
    app = operator.window.app
    app.set_station(library.find("stations", "virtual_gimbal"))
    assert "the unit is on a gimbal" in operator.says()
    operator.press("product_choice_mems_gimbal")
    assert operator.widget("product_combo", QComboBox).currentText() == "MEMS grade C, on a gimbal"
    assert "cannot run" not in operator.says()
    link = app.engine_link
    link.request = RunRequest(SERIAL, app.station_path, app.product_path)
    monkeypatch.setattr(EngineLink, "running", True)
    link.running_changed.emit(True)
    link.event.emit(StateChanged("running", "preparing"))
    link.event.emit(StageStarted("gimbal", 0, 1, 345.0))
    link.event.emit(StepStarted("gimbal", 1, "gimbal_turn", ("gimbal_turn", "x", 1.0, 10.0)))
    return operator


@pytest.mark.long
def test_window_shows_joint_angles_and_drifts(gimbal_run: Operator) -> None:
    live, link = gimbal_run.window.operator_page._live, gimbal_run.window.app.engine_link
    link.event.emit(JointsMoved((0.5236, -0.001, 0.002), (0.1, 0.0, 0.0), True))
    assert [shown.text() for shown in live.table.angle_labels] == ["30.000°", "−0.057°", "0.115°"]
    assert not live.gimbal.isVisible()
    for index, drift in enumerate((222.0, 70.0, 25.0), start=1):
        turn = (0, index, 0.5236 * (-1) ** (index + 1), (drift * ARCSECOND, 5.0 * ARCSECOND))
        link.event.emit(GimbalTurned(*turn, 30.0 * ARCSECOND, 1.5, index == 3))
    link.event.emit(GimbalTurned(1, 1, 0.5236, (100.0 * ARCSECOND, 5.0 * ARCSECOND), 30.0 * ARCSECOND, 1.5, False))
    gimbal_run.until(live.gimbal.isVisible)
    axes = live.gimbal.badges
    assert [badge.text() for badge in axes] == ["Axis x: below the threshold", "Axis y: above the threshold"]
