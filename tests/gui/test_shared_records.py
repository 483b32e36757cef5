"""The window of a station that shares records: units claimed by two stations, and records waiting to be sent."""

from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import pytest
from PySide6.QtWidgets import QLabel, QListWidget, QPushButton
from pytestqt.qtbot import QtBot

from calstation.database import Claim, Exchange, read_state, upgrade
from calstation.database.state import change_state
from calstation.messages import Text
from calstation.results import History
from tests.database.result_files import write_result
from tests.gui.conftest import SERIAL, Operator, SiteFolder

RECORDS = 5


@pytest.fixture
def shared(site_folder: SiteFolder, tmp_path: Path) -> str:
    """URL of a database that the station of the window shares."""
    url = f"sqlite:///{tmp_path / 'shared.sqlite'}"
    upgrade(url)
    site_folder.write(station={"records": {"database": url}})
    return url


@pytest.fixture
def away(site_folder: SiteFolder, tmp_path: Path) -> None:
    """The station of the window has a run; its database and its archive are unavailable."""
    (tmp_path / "share").write_text("not mounted")
    records = {
        "database": "postgresql+psycopg://station@127.0.0.1:9/calstation",
        "archive": str(tmp_path / "share" / "logs"),
    }
    site_folder.write(station={"records": records})
    site_folder.runs.mkdir()
    write_result(site_folder.runs, "SN-1_20261101T000000", 1)
    (site_folder.runs / "SN-1_20261101T000000.h5").write_bytes(b"samples")


@pytest.mark.long
def test_unit_claimed_by_another_station_gives_a_warning_only(
    shared: str, operator: Operator, site_folder: SiteFolder, tmp_path: Path, qtbot: QtBot
) -> None:
    folder = tmp_path / "line 2"
    folder.mkdir()
    other = Exchange(folder, shared, "line 2", {SERIAL: "Li Na"})
    other.exchange()
    operator.scan(SERIAL)
    notice = operator.widget("claim_notice")
    operator.until(notice.isVisible)
    assert f"{SERIAL} has also been claimed for calibration by Li Na at line 2 since" in operator.says()
    operator.until(operator.widget("start_button", QPushButton).isEnabled)
    operator.scan("SN-000043")
    assert not notice.isVisible()
    operator.scan(SERIAL)
    operator.until(notice.isVisible)

    # the other station has ended its work, and the unit is known here
    write_result(folder, f"{SERIAL}_20261101T000000", 1, serial=SERIAL)
    other.claimed = {}
    other.exchange()
    other.close()
    operator.until(lambda: not notice.isVisible() and History(site_folder.runs).passed(SERIAL))
    operator.press("start_button")
    assert f"{SERIAL} has already passed at line 2" in operator.says()
    assert not operator.window.app.engine_link.running
    operator.press("cancel_choice")
    operator.scan(SERIAL)
    assert "attempt 2" in operator.says()


@pytest.mark.long
def test_unit_is_claimed_when_the_database_returns_and_released_on_close(
    away: None, operator: Operator, site_folder: SiteFolder, tmp_path: Path
) -> None:
    app = operator.window.app
    operator.until(lambda: app.exchange_state is not None and app.exchange_state.error is not None)
    operator.scan(SERIAL)
    url = f"sqlite:///{tmp_path / 'shared.sqlite'}"
    site_folder.write(station={"records": {"database": url}})
    app.set_station(site_folder.station)
    folder = tmp_path / "line 2"
    folder.mkdir()
    other = Exchange(folder, url, "line 2", {SERIAL: None})
    operator.until(lambda: other.exchange())
    operator.until(operator.widget("claim_notice").isVisible)
    app.close()
    operator.until(lambda: other.exchange() == [])
    other.close()


@pytest.mark.long
def test_claim_of_the_previous_session_is_not_shown(
    away: None, operator: Operator, site_folder: SiteFolder, tmp_path: Path
) -> None:
    app = operator.window.app
    operator.until(lambda: app.exchange_state is not None and app.exchange_state.error is not None)
    old = Claim(SERIAL, "line 2", None, datetime.now(UTC))
    change_state(site_folder.runs, claims=(old,))
    operator.scan(SERIAL)
    operator.until(lambda: app.exchange_state == replace(read_state(site_folder.runs), claims=()))
    assert not operator.widget("claim_notice").isVisible()


@pytest.mark.long
def test_pending_records_are_shown_until_sent(
    away: None, operator: Operator, site_folder: SiteFolder, tmp_path: Path
) -> None:
    label = operator.widget("exchange_label", QLabel)
    waiting = "1 run waiting for the database  ·  1 log waiting for the archive"
    operator.until(lambda: label.text() == waiting)
    assert label.isVisible()
    assert "is not reachable" in label.toolTip()
    operator.window.show_page("station_page")
    operator.until(lambda: operator.window.findChild(QListWidget, "station_sections"))
    operator.widget("station_sections", QListWidget).setCurrentRow(RECORDS)
    assert "Not exchanged yet" in operator.says()
    assert "is not reachable" in operator.says()
    assert waiting in operator.says()
    refused = Text("database.runs_refused", {"count": 3, "run": "SN-9_20261101T000000", "reason": "too long"})
    change_state(site_folder.runs, refusal=refused)
    operator.until(lambda: "refuses: 3; the last one is SN-9_20261101T000000: too long" in operator.says())
    operator.window.show_page("operator_page")

    assert "does not exist, so logs wait to be copied into it" in label.toolTip()
    (tmp_path / "share").unlink()
    (tmp_path / "share").mkdir()
    url = f"sqlite:///{tmp_path / 'shared.sqlite'}"
    site_folder.write(station={"records": {"database": url, "archive": str(tmp_path / "share")}})
    operator.window.app.set_station(site_folder.station)
    operator.until(lambda: not label.isVisible())
    operator.until(lambda: list((tmp_path / "share").rglob("*.h5")))


def test_exchange_state_is_hidden_for_a_station_without_shared_records(operator: Operator) -> None:
    operator.scan(SERIAL)
    operator.until_no_job()
    assert operator.window.app.exchange_state is None
    assert not operator.widget("exchange_label", QLabel).isVisible()
    assert not operator.widget("claim_notice").isVisible()
