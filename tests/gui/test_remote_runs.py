"""The history page with runs of other stations: their details, their logs from the archive, and their results."""

import csv
import os
from datetime import timedelta
from pathlib import Path

import pytest
from PySide6.QtWidgets import QComboBox, QLabel, QPushButton, QTableView, QWidget
from pytestqt.qtbot import QtBot

from calstation.config import library
from calstation.database import Exchange, is_archived
from calstation.errors import InputError
from calstation.gui.history import HistoryPage
from calstation.gui.quality import QualityPage
from calstation.gui.state import AppContext
from calstation.records import IndexedRun, RunFilter, RunIndex, RunRecord, Verdict
from calstation.results import History, export_runs, load_result, load_results
from tests.dead_logs import NOW
from tests.gui.test_history_page import WAIT, listed_runs, rows, select_row, write_run
from tests.helpers import ignore_progress, raises_code

pytestmark = pytest.mark.timeout(120)
#: Name of the outbox of the other station.
OTHER = "5f0c0a52-6c0e-4c53-9d0e-0c5a52f7a7b1"


@pytest.fixture
def folder(app: AppContext, tmp_path: Path) -> Path:
    """The runs folder of the station of the window, with one run."""
    folder = tmp_path / "line-1"
    folder.mkdir()
    write_run(folder, "SN-000001", "passed", timedelta(hours=2))
    app.runs_folder = folder
    return folder


@pytest.fixture
def page(app: AppContext, folder: Path, qtbot: QtBot) -> HistoryPage:
    """The page; shown by the test."""
    made = HistoryPage(app)
    qtbot.addWidget(made)
    made.resize(1366, 640)
    return made


def receive(folder: Path, location: str, verdict: Verdict = Verdict.PASSED) -> RunRecord:
    """Add a run of the other station to the index of a folder, as the exchange does."""
    record = RunRecord(
        serial="SN-000001",
        started_utc=(NOW - timedelta(hours=1)).isoformat(),
        verdict=verdict,
        attempt=1,
        product="nav-a",
        station="line 2",
        operator="Wang Wei",
        stages=("rate",),
        log=Path("SN-000001_20260101T000000.h5"),
        result=None,
        duration=754.0,
        origin=OTHER,
        location=location,
    )
    values = {"gyro_bias_x": 1e-6}
    RunIndex(folder).receive([IndexedRun(record.log.stem, "", record, values, {"gyro_bias_x": 1e-8})], "database", 1)
    return record


def button(page: QWidget, name: str) -> QPushButton:
    found = page.findChild(QPushButton, name)
    assert found is not None
    return found


def test_runs_of_all_stations_are_listed_and_filtered(page: HistoryPage, folder: Path, qtbot: QtBot) -> None:
    receive(folder, "line2:/home/op/runs/x.h5")
    assert listed_runs(page, qtbot) == [("SN-000001", "PASS"), ("SN-000001", "PASS")]
    table = page.findChild(QTableView, "history_table")
    model = table.model()
    assert not table.isColumnHidden(7)
    assert [model.index(row, 7).data() for row in range(2)] == ["line 2", "bench"]
    station = page.findChild(QComboBox, "history_station_combo")
    station.setCurrentIndex(station.findData("line 2"))
    assert [model.index(row, 7).data() for row in range(model.rowCount())] == ["line 2"]
    assert table.isColumnHidden(7)  # one station
    assert page.details.trend._runs[0].record.station == "bench"  # the trend of the unit is over all stations
    assert len(page.details.trend._runs) == 2


def test_log_stored_only_at_its_station_cannot_be_opened(page: HistoryPage, folder: Path, qtbot: QtBot) -> None:
    place = "line2:/home/op/runs/SN-000001_20260101T000000.h5"
    receive(folder, place, verdict=Verdict.INCOMPLETE)
    listed_runs(page, qtbot)
    log = button(page, "history_log_button")
    assert not log.isEnabled()
    assert log.toolTip() == f"The log is only at the station line 2, which keeps no archive of logs: {place}"
    assert place in [label.toolTip() or label.text() for label in page.details.findChildren(QLabel)]
    for name in ("history_folder_button", "history_resume_button", "history_close_button"):
        assert not button(page, name).isVisible()
    select_row(page, 1, qtbot)
    assert button(page, "history_folder_button").isVisible()


def test_an_archived_log_is_copied_and_opened(
    page: HistoryPage, folder: Path, app: AppContext, tmp_path: Path, qtbot: QtBot
) -> None:
    archive = tmp_path / "archive" / "SN-000001_20260101T000000.h5"
    archive.parent.mkdir()
    archive.write_bytes(b"samples")
    receive(folder, str(archive))
    listed_runs(page, qtbot)
    here = folder / OTHER / archive.name
    with qtbot.waitSignal(app.open_log, timeout=WAIT) as wanted:
        button(page, "history_log_button").click()
    assert wanted.args == [here]
    assert here.read_bytes() == b"samples"
    archive.unlink()
    os.utime(here, (1e9, 2e9))
    with qtbot.waitSignal(app.open_log, timeout=WAIT):  # the copy stays
        button(page, "history_log_button").click()
    assert here.stat().st_atime > 1.7e9  # and is now the most recently used one
    assert here.stat().st_mtime == 2e9
    page.refresh()
    qtbot.waitUntil(lambda: not page.busy, timeout=WAIT)
    assert len(rows(page)) == 2


def test_unavailable_archive_is_reported(page: HistoryPage, folder: Path, tmp_path: Path, qtbot: QtBot) -> None:
    receive(folder, str(tmp_path / "archive" / "gone.h5"))
    listed_runs(page, qtbot)
    button(page, "history_log_button").click()
    qtbot.waitUntil(page.notice.isVisible, timeout=WAIT)
    assert page.notice.title_label.text() == "The log was not opened"
    assert "gone.h5" in page.notice.text_label.text()
    assert not list((folder / OTHER).iterdir())


@pytest.mark.long
def test_quality_page_includes_and_opens_runs_of_all_stations(
    app: AppContext, folder: Path, tmp_path: Path, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
) -> None:
    url = f"sqlite:///{tmp_path / 'shared.sqlite'}"
    other = tmp_path / "line-2"
    other.mkdir()
    stem = write_run(other, "SN-000002", "passed", timedelta(hours=3), product="Navigation grade A").stem
    write_run(folder, "SN-000001", "passed", timedelta(hours=4), product="Navigation grade A")
    for each in (other, folder):
        exchange = Exchange(each, url, each.name)
        exchange.exchange()
        exchange.close()
    shipped = library.find("stations", "virtual_bench").read_text(encoding="utf-8")
    station = tmp_path / "line-1.toml"
    station.write_text(f'{shipped}\n[records]\ndatabase = "{url}"\n', encoding="utf-8")
    monkeypatch.setattr(app, "station_path", station)
    page = QualityPage(app)
    qtbot.addWidget(page)
    page.show()
    qtbot.waitUntil(lambda: not page.busy and page.count_label.text() != "", timeout=WAIT)
    assert page.count_label.text().startswith("2 complete runs")
    with qtbot.waitSignal(app.open_run, timeout=WAIT) as opened:
        page.control.run_requested.emit(stem)
    assert load_result(opened.args[0]).serial == "SN-000002"


def test_opened_runs_of_all_stations_are_exported_and_compared(folder: Path, tmp_path: Path) -> None:
    own = write_run(folder, "SN-000001", "passed", timedelta(hours=3))
    record = receive(folder, "line2:/home/op/x.h5")
    History(folder).refresh()
    export_runs(ignore_progress, folder, RunFilter(), tmp_path / "runs.csv")
    with (tmp_path / "runs.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [(row["station"], row["verdict"]) for row in rows] == [("line 2", "passed"), *[("bench", "passed")] * 2]
    assert (float(rows[0]["gyro_bias_x [rad/s]"]), float(rows[0]["gyro_bias_x_sigma [rad/s]"])) == (1e-6, 1e-8)
    runs = History(folder).runs()
    with raises_code(InputError, "result.elsewhere"):
        load_results(ignore_progress, folder, runs)
    opened = folder / OTHER / record.log.with_suffix(".json").name
    opened.parent.mkdir()
    opened.write_bytes(own.read_bytes())
    assert load_results(ignore_progress, folder, runs)[0].station == "bench"


@pytest.mark.parametrize(
    ("location", "archived"),
    [
        ("s3://logs/plant-2/x.h5", True),
        ("/mnt/share/x.h5", True),
        ("C:/share/x.h5", True),
        (r"\\server\share\x.h5", True),
        ("line2:/home/op/x.h5", False),
        ("LINE2:C:\\runs\\x.h5", False),
        (None, False),
    ],
)
def test_archive_locations_are_distinguished_from_station_paths(location: str | None, archived: bool) -> None:
    assert is_archived(location) == archived
