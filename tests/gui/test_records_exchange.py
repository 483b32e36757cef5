"""While the window is open, its runs folder is exchanged with the database of its station."""

from pathlib import Path

import pytest
from pytestqt.qtbot import QtBot

from calstation.database import read_state
from calstation.gui.shell import create_window
from tests.database.result_files import in_database, write_result
from tests.gui.conftest import SiteFolder


@pytest.mark.long
def test_window_exchanges_its_runs_until_it_closes(site_folder: SiteFolder, qtbot: QtBot, tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'shared.sqlite'}"
    site_folder.write(station={"records": {"database": url}})
    site_folder.runs.mkdir()
    write_result(site_folder.runs, "a", 1)
    window = create_window(site_folder.station)
    qtbot.addWidget(window)
    qtbot.waitUntil(lambda: read_state(site_folder.runs).contact_utc is not None, timeout=60_000)
    assert in_database(url) == [("a", "runs")]
    (tmp_path / "others").mkdir()
    write_result(tmp_path / "others", "c", 3)
    window.app.set_runs_folder(tmp_path / "others")
    qtbot.waitUntil(lambda: len(in_database(url)) == 2, timeout=60_000)
    write_result(tmp_path / "others", "d", 4)
    window.app.close()
    # the last exchange continues after the window has closed
    qtbot.waitUntil(lambda: [name for name, _ in in_database(url)] == ["a", "c", "d"], timeout=60_000)


def test_window_without_a_shared_database_starts_no_exchange(site_folder: SiteFolder, qtbot: QtBot) -> None:
    window = create_window(site_folder.station)
    qtbot.addWidget(window)
    assert read_state(site_folder.runs).attempt_utc is None
    window.app.close()
