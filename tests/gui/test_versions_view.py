"""The comparison of two versions on the history page: selection, changed verdicts, parameter changes, export."""

import json
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QComboBox, QLabel, QPushButton, QTableView, QWidget
from pytestqt.qtbot import QtBot

from calstation.database import ExchangeState
from calstation.gui.history import HistoryPage, versions_view
from calstation.gui.state import AppContext
from calstation.gui.text import language
from tests.fleet.test_fleet_compare import UNITS, add, row
from tests.gui.conftest import SiteFolder

pytestmark = [pytest.mark.long, pytest.mark.timeout(120)]
WAIT = 60_000


@pytest.fixture
def page(app: AppContext, site_folder: SiteFolder, tmp_path: Path, qtbot: QtBot) -> HistoryPage:
    """The visible page of a station that shares records."""
    site_folder.write(station={"records": {"database": f"sqlite:///{tmp_path / 'shared.sqlite'}"}})
    app.runs_folder, app.exchange_state = tmp_path, ExchangeState()
    history = HistoryPage(app)
    qtbot.addWidget(history)
    history.resize(1366, 640)
    history.show()
    return history


def press(page: QWidget, name: str) -> None:
    """Click a visible, enabled button."""
    button = page.findChild(QPushButton, name)
    assert button is not None
    assert button.isEnabled(), button.toolTip()
    button.click()


def settle(page: HistoryPage, qtbot: QtBot) -> None:
    qtbot.waitUntil(lambda: not page.busy, timeout=WAIT)


def texts(page: QWidget) -> list[str]:
    return [label.text() for label in page.findChildren(QLabel) if label.isVisible()]


def open_versions(page: HistoryPage, qtbot: QtBot) -> None:
    settle(page, qtbot)
    press(page, "history_versions_button")
    settle(page, qtbot)


def filled(tmp_path: Path, **more: object) -> None:
    """Insert two versions of four units into the database."""
    url = f"sqlite:///{tmp_path / 'shared.sqlite'}"
    add(url, *(row(unit, "0.1.0", 0, **more) for unit in UNITS), *(row(unit, "0.1.0+gravity", 1) for unit in UNITS))


def test_two_versions_are_compared(page: HistoryPage, tmp_path: Path, qtbot: QtBot) -> None:
    filled(tmp_path)
    open_versions(page, qtbot)
    combos = [page.findChild(QComboBox, f"versions_{name}_combo") for name in ("before", "after")]
    assert [combo.currentText() for combo in combos] == ["0.1.0", "0.1.0+gravity"]
    assert "Choose two versions and press Compare" in texts(page)
    press(page, "versions_compare_button")
    settle(page, qtbot)
    summary = page.findChild(QLabel, "versions_summary_label")
    assert summary.text() == "4 logs in both versions  ·  PASS to FAIL: 1, FAIL to PASS: 1"
    assert "Changed verdicts: 3" in texts(page)
    changes = page.findChild(QTableView, "versions_changes_table").model()
    cells = [[changes.index(line, k).data() for k in (0, 1, 2, 4, 5, 6)] for line in range(changes.rowCount())]
    assert cells == [
        ["A", "p", "bench 1", "PASS", "FAIL", "gyro bias x"],
        ["B", "p", "bench 2", "FAIL", "PASS", "gyro bias x"],
        ["D", "q", "bench 2", "PASS", "not judged", ""],
    ]
    assert changes.index(0, 0).data(Qt.ItemDataRole.ToolTipRole) == "/logs/A.h5"
    moves = page.findChild(QTableView, "versions_moves_table").model()
    assert [moves.index(0, k).data().strip() for k in range(4)] == ["2.500", "3.850", "4.000", "D"]
    assert list(page.versions.plot.data) == ["gyro bias x"]
    group = page.findChild(QComboBox, "versions_group_combo")
    for name, rows in (("By station", ["bench 1", "bench 2"]), ("By month", ["2026-01", "2026-03"])):
        group.setCurrentIndex(group.findText(name))
        assert list(page.versions.plot.data) == rows
    language.use("zh_CN")
    assert "判定变化：3 份" in texts(page)
    language.use("en")
    combos[1].setCurrentIndex(0)
    assert not page.findChild(QPushButton, "versions_compare_button").isEnabled()
    press(page, "versions_back_button")
    assert not page.versions.isVisible()


def test_a_partial_calibration_is_not_shown_as_a_pass(page: HistoryPage, tmp_path: Path, qtbot: QtBot) -> None:
    filled(tmp_path, partial=True)
    open_versions(page, qtbot)
    press(page, "versions_compare_button")
    settle(page, qtbot)
    summary = page.findChild(QLabel, "versions_summary_label")
    assert summary.text() == "4 logs in both versions  ·  PASS to FAIL: 0, FAIL to PASS: 1"
    changes = page.findChild(QTableView, "versions_changes_table").model()
    cells = [[changes.index(line, k).data() for k in (0, 4, 5)] for line in range(changes.rowCount())]
    assert cells == [
        ["A", "PARTIAL", "FAIL"],
        ["B", "FAIL", "PASS"],
        ["C", "PARTIAL", "PASS"],
        ["D", "PARTIAL", "not judged"],
    ]


def test_comparison_and_later_version_are_exported(
    page: HistoryPage, tmp_path: Path, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
) -> None:
    filled(tmp_path)
    open_versions(page, qtbot)
    for name in ("comparison.json", "solutions.parquet"):
        target = tmp_path / name
        monkeypatch.setattr(
            "calstation.gui.state.page.ask_file", lambda *arguments, target=target: arguments[-1](target)
        )
        press(page, "versions_export_button")
        settle(page, qtbot)
        assert page.notice.text_label.text() == str(target)
    assert json.loads((tmp_path / "comparison.json").read_text("utf-8"))["logs"] == 4
    assert pq.read_table(tmp_path / "solutions.parquet").num_rows == 4


def test_long_list_of_changes_is_truncated(
    page: HistoryPage, tmp_path: Path, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(versions_view, "_MAX_CHANGES", 2)
    filled(tmp_path)
    open_versions(page, qtbot)
    press(page, "versions_compare_button")
    settle(page, qtbot)
    assert "Changed verdicts: 3, the first 2 listed" in texts(page)
    assert page.findChild(QTableView, "versions_changes_table").model().rowCount() == 2


def test_page_explains_how_to_create_two_versions(page: HistoryPage, app: AppContext, qtbot: QtBot) -> None:
    open_versions(page, qtbot)
    assert "There are no two versions to compare yet" in texts(page)
    assert not page.findChild(QPushButton, "versions_compare_button").isEnabled()
    press(page, "versions_back_button")
    app.exchange_state = None
    open_versions(page, qtbot)
    assert "This station shares no records" in texts(page)


def test_unreachable_database_is_reported(page: HistoryPage, site_folder: SiteFolder, qtbot: QtBot) -> None:
    records = {"database": "postgresql+psycopg://station@127.0.0.1:9/calstation"}
    site_folder.write(station={"records": records})
    open_versions(page, qtbot)
    qtbot.waitUntil(page.notice.isVisible, timeout=WAIT)
    assert page.notice.title_label.text() == "The versions could not be read"
    assert "is not reachable" in page.notice.text_label.text()
