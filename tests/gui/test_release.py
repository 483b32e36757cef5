"""A failed unit is released in the window by one or two engineers; it is never shown as PASS."""

import json
from pathlib import Path
from typing import Any

import pytest
from PySide6.QtWidgets import QLabel, QLineEdit, QPushButton, QTableView

from calstation.config import access
from calstation.gui.text import language
from calstation.records import Verdict, audit_path, read_audit
from calstation.sequencer import Finalized, StateChanged
from tests.check_rows import check_row
from tests.gui.conftest import RESULT, SERIAL, Operator

pytestmark = pytest.mark.long

ENGINEERS = {"badge_pattern": r"B\d{4}", "engineers": ["B0001", "B0002"]}
PINS = {"B0001": "111111", "B0002": "222222"}


@pytest.fixture
def failed(operator: Operator) -> Path:
    """The result of a failed run of a product that requires two engineers."""
    site = operator.site_folder
    site.write({"confirmation": {"required_for": ["override", "registers"]}}, {"sign_in": ENGINEERS})
    access.set_pin("", "000000")
    for badge, pin in PINS.items():
        access.set_pin("000000", pin, badge)
    site.runs.mkdir(exist_ok=True)
    row = {"value": 3e-5, "sigma": 1e-8, "unit": "rad/s", "stage": "rate"}
    check = check_row("within", "gyro_bias_x", 3e-5, [-1.5e-5, 1.5e-5], passed=False, unit="rad/s")
    files = {kind: {"name": name, "sha256": ""} for kind, name in (("station", "test"), ("product", "short"))}
    result: dict[str, Any] = {
        **RESULT,
        "stages": ["rate"],
        "outcome": "failed",
        "passed": False,
        "parameters": {"gyro_bias_x": row},
        "checks": [check],
        "configuration": files,
        "log": {"file": "SN-000042_x.h5"},
        "started_utc": "2026-11-23T08:00:00+00:00",
    }
    path = site.runs / "SN-000042_x.json"
    path.write_text(json.dumps(result), encoding="utf-8")
    return path


def fill(operator: Operator, panel: str, **texts: str) -> None:
    for key, text in texts.items():
        edit = operator.widget(f"{panel}_{key}_edit", QLineEdit)
        assert edit.isVisible(), key
        edit.clear()
        operator.qtbot.keyClicks(edit, text)


def texts(operator: Operator) -> str:
    table = operator.widget("history_table", QTableView).model()
    return f"{table.index(0, 0).data()}\n{operator.says()}"


def open_history(operator: Operator) -> None:
    operator.window.show_page("history_page")
    operator.until(lambda: operator.widget("history_table", QTableView).model().rowCount() == 1)
    operator.until_no_job()
    operator.until(lambda: operator.widget("history_release_button", QPushButton).isVisible())


def open_panel(operator: Operator, name: str) -> None:
    """Press the button once it is visible, and wait for the panel."""
    released = operator.widget(f"{name}_button", QPushButton)
    operator.until(lambda: not released.visibleRegion().isEmpty())
    operator.press(f"{name}_button")
    panel, error = operator.widget(f"{name}_panel"), operator.widget(f"{name}_error_label", QLabel)
    operator.until(lambda: panel.isVisible() or error.text())
    assert error.text() == ""


def test_two_engineers_release_a_unit_on_the_history_page(operator: Operator, failed: Path) -> None:
    open_history(operator)
    assert "released" not in texts(operator)
    open_panel(operator, "history_release")
    confirm = operator.widget("history_release_confirm_button", QPushButton)
    people = {"badge": "B0001", "pin": "111111", "second_badge": "B0002"}
    fill(operator, "history_release", reason="label scratched", **people)
    assert (confirm.isEnabled(), confirm.toolTip()) == (False, "Fill in every field")
    fill(operator, "history_release", second_pin="111111")
    operator.press("history_release_confirm_button")
    error = operator.widget("history_release_refusal_label", QLabel)
    operator.until(lambda: "The PIN of B0002 is wrong." in error.text())
    assert "override" not in json.loads(failed.read_text("utf-8"))
    fill(operator, "history_release", pin="111111", second_pin="222222")
    operator.press("history_release_confirm_button")
    operator.until(lambda: "FAIL, released" in texts(operator))
    operator.until_no_job()
    operator.until(lambda: "Released by B0001, B0002" in operator.says())
    assert "label scratched" in operator.says()
    assert "PASS" not in texts(operator)
    assert not operator.widget("history_release_button", QPushButton).isVisible()
    assert json.loads(failed.read_text("utf-8"))["outcome"] == "failed"
    event = read_audit(audit_path(operator.site_folder.home)).entries[-1]
    assert (event.event, event.by, event.confirmed_by) == ("override", "B0001", "B0002")
    language.use("zh_CN")
    assert "不合格，已放行" in texts(operator)


def test_a_release_can_be_cancelled(operator: Operator, failed: Path) -> None:
    before = failed.read_bytes()
    open_history(operator)
    open_panel(operator, "history_release")
    people = {"badge": "B0001", "pin": "111111", "second_badge": "B0002", "second_pin": "111111"}
    fill(operator, "history_release", reason="label scratched", **people)
    operator.press("history_release_confirm_button")
    error = operator.widget("history_release_refusal_label", QLabel)
    operator.until(lambda: "The PIN of B0002 is wrong." in error.text())
    operator.press("history_release_cancel_button")
    assert not operator.widget("history_release_panel").isVisible()
    open_panel(operator, "history_release")
    assert error.text() == ""
    assert operator.widget("history_release_pin_edit", QLineEdit).text() == ""
    assert failed.read_bytes() == before


def test_release_on_the_engineer_page_updates_the_operator_page(operator: Operator, failed: Path) -> None:
    result = json.loads(failed.read_text("utf-8"))
    link = operator.window.app.engine_link
    link.event.emit(StateChanged("running", "idle"))
    link.event.emit(StateChanged("done", "running"))
    link.event.emit(Finalized(Verdict.FAILED, "SN-000042_x.h5", str(failed), result))
    operator.window.show_page("operator_page")
    operator.until(lambda: operator.verdict == "FAIL")
    operator.window.show_page("engineer_page")
    operator.window.app.open_run.emit(failed)
    operator.until(lambda: operator.widget("engineer_release_button", QPushButton).isVisible())
    open_panel(operator, "engineer_release")
    second = {"second_badge": "B0002", "second_pin": "222222"}
    fill(operator, "engineer_release", reason="agreed", badge="B0001", pin="111111", **second)
    operator.press("engineer_release_confirm_button")
    operator.until(lambda: f"{SERIAL}  ·  FAIL, released" in operator.says())
    operator.window.show_page("operator_page")
    assert operator.verdict == "FAIL, released"
