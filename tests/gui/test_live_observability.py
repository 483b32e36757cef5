"""The observability of the run in progress, drawn step by step on the engineer page."""

from types import SimpleNamespace

from PySide6.QtWidgets import QLabel
from pytestqt.qtbot import QtBot

from calstation.gui.engineer.diagnostics_views import ObservabilityView
from calstation.gui.engineer.result_analysis import ResultAnalysis
from calstation.sequencer import StageRanked, StateChanged


def ranked(step: int, stage: str = "excitation", **strength: float) -> StageRanked:
    """The observability after a step."""
    return StageRanked(stage, step, 8 + step, {"attitude_error_up": 1.0, "position_error_up": 1.0, **strength})


def test_the_map_grows_with_every_step(qtbot: QtBot) -> None:
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


def test_a_run_replaces_what_was_shown_and_a_result_the_run(qtbot: QtBot) -> None:
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


def test_an_opened_result_is_shown_until_a_stage_reports(qtbot: QtBot) -> None:
    analysis = ResultAnalysis(SimpleNamespace())
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
