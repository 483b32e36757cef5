"""The observability of the current run, drawn step by step on the engineer page."""

from PySide6.QtCore import QEvent, QPointF
from PySide6.QtGui import QHelpEvent
from PySide6.QtWidgets import QApplication, QLabel, QToolTip
from pytestqt.qtbot import QtBot

from calstation.gui.engineer.observability_view import ObservabilityView
from calstation.gui.engineer.result_analysis import ResultAnalysis
from calstation.gui.state import AppContext
from calstation.gui.text import language
from calstation.sequencer import StageRanked, StateChanged, StepStarted


def ranked(step: int, stage: str = "excitation", **strength: float) -> StageRanked:
    """Return the observability after a step."""
    return StageRanked(stage, step, 8 + step, {"attitude_error_up": 1.0, "position_error_up": 1.0, **strength})


def tooltip(view: ObservabilityView, at: QPointF) -> str:
    """Return the tooltip with the pointer at a point of the scene."""
    where, port = view.map.mapFromScene(at), view.map.viewport()
    QApplication.sendEvent(port, QHelpEvent(QEvent.Type.ToolTip, where, port.mapToGlobal(where)))
    return str(QToolTip.text())


def test_observability_map_grows_with_every_step(qtbot: QtBot) -> None:
    view = ObservabilityView()
    qtbot.addWidget(view)
    found = view.findChild(QLabel, "unobservable_label")
    view.follow(ranked(1, gyro_bias_x=1.0))
    view.follow(ranked(2, gyro_bias_x=1.05))
    assert found.text() == "Running, after step 2: rank 10. Not determined so far: attitude up, gyro bias x"
    view.follow(ranked(2, gyro_bias_x=3.0))  # the rest after the move
    assert found.text() == "Running, after step 2: rank 10. Not determined so far: attitude up"
    view.follow(ranked(3, gyro_bias_x=4.0, attitude_error_up=2.0))
    assert found.text() == "Running, after step 3: rank 11. Every state is determined."
    assert view.map._steps == (1, 2, 3)
    assert view.map._strength.tolist() == [[1.0, 1.0, 2.0], [1.0, 3.0, 4.0]]


def test_colour_scale_is_visible_without_scrolling_in_a_small_window(qtbot: QtBot) -> None:
    view = ObservabilityView()
    qtbot.addWidget(view)
    view.follow(ranked(1, **{f"gyro_bias_{k}": 2.0 for k in range(40)}))
    view.resize(860, 470)
    view.show()
    qtbot.waitExposed(view)
    qtbot.wait(50)
    scale = view.map._scale
    low, high = (
        scale.mapToScene(scale.boundingRect().topLeft()).y(),
        scale.mapToScene(scale.boundingRect().bottomLeft()).y(),
    )
    assert view.map.height() > view._scroll.viewport().height()
    assert 0.0 <= low < high <= view._scroll.viewport().height()


def test_new_run_replaces_the_map_and_its_result_replaces_the_live_map(qtbot: QtBot) -> None:
    view = ObservabilityView()
    qtbot.addWidget(view)
    stored = {"segments": [{"step": 7}], "states": {"gyro_bias_x": {"step": None, "by_step": [1.0]}}}
    view.show_stages({"azimuth_flip": stored})
    view.follow(ranked(1, gyro_bias_x=2.0))
    assert list(view._stages) == ["excitation"]
    view.follow(ranked(1, "azimuth_flip", gyro_bias_x=2.0))
    assert list(view._stages) == ["excitation", "azimuth_flip"]
    view.show_stages({"azimuth_flip": stored})
    assert "gyro bias x" in view.findChild(QLabel, "unobservable_label").text()


def test_opened_result_is_shown_until_a_stage_reports_progress(qtbot: QtBot) -> None:
    analysis = ResultAnalysis(AppContext())
    view = analysis.observability.view
    qtbot.addWidget(analysis.observability)
    states = {"gyro_bias_x": {"step": None, "by_step": [1.0]}}
    view.show_stages({"azimuth_flip": {"segments": [{"step": 7}], "states": states}})
    for _ in range(2):
        analysis.follow(StateChanged("preparing", "idle"))  # a register operation begins with it, too
        assert list(view._stages) == ["azimuth_flip"]
    analysis.follow(ranked(1, gyro_bias_x=2.0))
    assert list(view._stages) == ["excitation"]
    analysis.follow(StateChanged("preparing", "idle"))
    analysis.follow(ranked(1, "azimuth_flip", gyro_bias_x=2.0))
    assert list(view._stages) == ["azimuth_flip"]


def test_steps_are_named_by_their_moves(qtbot: QtBot) -> None:
    analysis = ResultAnalysis(AppContext())
    view = analysis.observability.view
    qtbot.addWidget(analysis.observability)
    analysis.observability.resize(900, 600)
    analysis.observability.show()
    axis, scale = view.map.getAxis("top"), view.map._scale
    analysis.follow(StateChanged("preparing", "idle"))
    for step, label in ((1, ("into_place", "y")), (2, ("turn_about", "y", -90.0)), (3, ())):
        analysis.follow(StepStarted("excitation", step, "move", label))
        analysis.follow(ranked(step, gyro_bias_x=2.0))
    assert axis._names == ["1  y to start", "2  y −90°", "3"]
    assert axis.labelText == "Excitation: after step"
    assert scale.labelText == "prior σ / σ after the step, ×"
    cell = view.map.getViewBox().mapViewToScene(QPointF(1.5, 1.5))
    moved = "Step 2: Turning about y by −90°"
    assert tooltip(view, cell) == f"gyro bias x after step 2: sigma 2 times smaller than before the stage\n{moved}"
    assert tooltip(view, QPointF(cell.x(), axis.sceneBoundingRect().center().y())) == moved
    language.use("zh_CN")
    try:
        assert axis._names == ["1  y 到位", "2  y −90°", "3"]
        assert axis.labelText == "三轴激励：各步之后"
        assert scale.labelText == "先验 σ / 各步之后的 σ，倍"
        assert tooltip(view, cell).endswith("第 2 步：绕 y 轴转动 −90°")
    finally:
        language.use("en")
