"""A run is paused and followed live on the engineer page as on the operator page."""

import pytest
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QComboBox, QPushButton, QTabBar

from calstation.config import RunRequest
from calstation.errors import DeviceFaultError
from calstation.gui.operator import LiveView
from calstation.sequencer import Command, Fault, StageProgress, StateChanged, TableMoved, Trace
from tests.gui.conftest import SERIAL, Operator
from tests.gui.test_units import begin, end_unit, tile, use_slots


@pytest.fixture
def run(operator: Operator) -> Operator:
    """A run of two units, with the engineer page shown before its start."""
    use_slots(operator, 2)
    operator.window.show_page("engineer_page")
    begin(operator)
    return operator


def current_view(operator: Operator) -> str:
    """Return the title of the current view of the engineer page."""
    tabs: QTabBar = operator.widget("engineer_views", QTabBar)
    return tabs.tabText(tabs.currentIndex())


def test_no_live_view_before_a_run(operator: Operator) -> None:
    operator.window.show_page("engineer_page")
    tabs: QTabBar = operator.widget("engineer_views", QTabBar)
    assert [tabs.isTabVisible(k) for k in range(tabs.count()) if tabs.tabText(k) == "Live"] == [False]
    assert current_view(operator) == "Preview"


@pytest.mark.long
@pytest.mark.parametrize("code", ["port_in_use", "stopped"])
def test_no_live_view_after_a_run_that_ended_in_its_preparation(operator: Operator, code: str) -> None:
    operator.window.show_page("engineer_page")
    link, site = operator.window.app.engine_link, operator.site_folder
    link.request = RunRequest(SERIAL, site.station, site.product, out=site.runs)
    link.running_changed.emit(True)
    assert (current_view(operator), "Preparing" in operator.says()) == ("Live", True)
    if code == "stopped":
        link.event.emit(StateChanged("stopped", "preparing"))
    else:
        link.event.emit(Fault.of(DeviceFaultError("connection.port_in_use_unknown", port="COM3")))
    link.running_changed.emit(False)
    assert current_view(operator) == "Preview"
    assert "Preparing" not in operator.says()
    operator.window.app.set_station(site.station)
    tabs: QTabBar = operator.widget("engineer_views", QTabBar)
    assert "Live" not in [tabs.tabText(k) for k in range(tabs.count()) if tabs.isTabVisible(k)]


@pytest.mark.long
def test_traces_table_and_convergence_are_live(run: Operator) -> None:
    assert current_view(run) == "Live"
    live = next(view for view in run.window.findChildren(LiveView) if view.isVisible())
    link = run.window.app.engine_link
    targets = run.run.run_summary.targets if run.run.run_summary else {}
    link.event.emit(TableMoved(0.5, 1.0, 0.1, 0.0, moving=True))
    for slot in ("1", "2"):
        link.event.emit(Trace((0.0, 1.0), (float(slot),) * 12, slot=slot))
        link.event.emit(
            StageProgress("rate", 0.5, 5.0, {name: 3.0 * value for name, value in targets.items()}, slot=slot)
        )
    run.until(lambda: "table moving" in run.says())
    assert live._traces.rows[:, 1].tolist() == [1.0, 1.0]
    assert live._convergence.lines["gyro_bias"].ratios == [3.0]
    run.until(lambda: "σ 3 × limit" in tile(run, "engineer_unit_2_tile").accessibleName())
    run.qtbot.mouseClick(tile(run, "engineer_unit_2_tile"), Qt.MouseButton.LeftButton)
    assert run.run.unit.slot == "2"
    run.widget("language_combo", QComboBox).setCurrentIndex(1)
    assert current_view(run) == "实时"


@pytest.mark.long
@pytest.mark.parametrize(
    ("code", "at_rest", "unknown"),
    [("en", "table at rest", "table not connected"), ("zh_CN", "转台静止", "转台未连接")],
)
def test_reading_of_the_table_is_not_shown_as_current_after_the_run(
    run: Operator, code: str, at_rest: str, unknown: str
) -> None:
    run.window.app.set_language(code)
    link = run.window.app.engine_link
    link.event.emit(TableMoved(0.5, 1.0, 0.0, 0.0, moving=False))
    assert at_rest in run.says()
    for slot in ("1", "2"):
        end_unit(run, slot, "stopped")
    link._end()
    assert unknown in run.says()
    assert at_rest not in run.says()
    assert "28.648°" not in run.says()


@pytest.mark.long
def test_run_is_paused_and_resumed(run: Operator, monkeypatch: pytest.MonkeyPatch) -> None:
    sent: list[Command] = []
    link = run.window.app.engine_link
    monkeypatch.setattr(link, "send", sent.append)
    run.press("engineer_pause_button")
    link.event.emit(StateChanged("paused", "pausing"))
    button = run.widget("engineer_pause_button", QPushButton)
    run.until(lambda: button.text() == "Resume")
    run.press("engineer_pause_button")
    assert sent == [Command.PAUSE, Command.RESUME]
    link.event.emit(StateChanged("running", "paused"))
    for slot in ("1", "2"):
        end_unit(run, slot, "stopped")
    link._end()
    run.until(lambda: not button.isEnabled())
    assert button.toolTip() == "Nothing is running."
