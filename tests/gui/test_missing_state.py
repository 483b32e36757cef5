"""A failed model test reports an effect; a button adds it to the model and solves the log again."""

from pathlib import Path

import pytest
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QPushButton

from calstation.gui.engineer import EngineerPage
from calstation.gui.logs import OfflinePage
from calstation.gui.text import language
from calstation.results import FinishedRun
from tests.check_rows import check_row
from tests.estimation.simulated_stages import log_with
from tests.gui.conftest import Operator, result_with

pytestmark = pytest.mark.timeout(120)
NAMES = {f"accel_cubic_{axis}" for axis in "xyz"}


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A six-position log of a unit with a third-order accelerometer error."""
    path = tmp_path_factory.mktemp("cubic") / "log.h5"
    log_with(path, "six_position", accel_cubic_ug_g3=300.0)
    return path


@pytest.mark.long
@pytest.mark.parametrize(("states", "noted"), [([], False), (["accel_cubic"], True)])
def test_failed_check_at_rest_is_explained_after_a_state_was_added(
    operator: Operator, states: list[str], noted: bool
) -> None:
    operator.window.show_page("engineer_page")
    view = operator.window.findChild(EngineerPage, "engineer_page").analysis.result.view
    failed = check_row("gravity_at_rest", "", 0.02, 0.01, passed=False, unit="m/s²")
    for code, words in (("en", "without the added state"), ("zh_CN", "不含新加入的状态")):
        language.use(code)
        view.show_run(FinishedRun(result_with(checks=[failed], states_added=states), None, {}, {}))
        assert (words in view._note.text()) is noted
    language.use("en")


@pytest.mark.long
def test_state_is_added_on_the_engineer_page(operator: Operator, log: Path) -> None:
    window = operator.window
    window.show_page("engineer_page")
    page = window.findChild(EngineerPage, "engineer_page")
    assert page is not None
    analysis = page.analysis
    analysis.open(log)
    operator.until(lambda: analysis.result.view.missing.isVisible())
    before = analysis.result.view.finished
    assert before is not None
    assert "The accelerometer has a third-order error" in operator.says()
    content = log.read_bytes()

    operator.press("add_state_button")
    operator.until(lambda: analysis.result.view.finished is not before)
    after = analysis.result.view.finished
    assert after is not None
    assert after.result.states_added == ["accel_cubic"]
    assert set(after.result.parameters) - set(before.result.parameters) == NAMES
    assert after.previous == before.result.parameters
    assert "a trial that replaces neither the stored result nor any register" in operator.says()
    assert "+ accel cubic" in analysis.source()
    assert not operator.widget("add_state_button", QPushButton).isVisible()
    assert log.read_bytes() == content

    operator.until_no_job()
    assert page.registers.target is None, "no register is written from a trial"
    language.use("zh_CN")
    assert "仅为试算" in operator.says()
    assert page.registers.why_not_write()


@pytest.mark.long
def test_state_is_added_on_the_offline_page(operator: Operator, log: Path) -> None:
    window = operator.window
    window.show_page("offline_page")
    page = window.findChild(OfflinePage, "offline_page")
    assert page is not None
    page.open(log)
    operator.until(lambda: operator.widget("solve_button", QPushButton).isEnabled())
    operator.press("solve_button")
    operator.until(lambda: page.missing.isVisible())
    operator.press("offline_add_state_button")
    operator.until(lambda: page.solved is not None and page.solved.result.states_added == ["accel_cubic"])
    assert not page.missing.isVisible()
    assert "Solved with accel_cubic added" in page.comparison.note_label.text()
    rows = {
        page.comparison.table.parameters.headerData(k, Qt.Orientation.Vertical, Qt.ItemDataRole.ToolTipRole)
        for k in range(page.comparison.table.parameters.rowCount())
    }
    assert rows >= NAMES
