"""Several windows of one station: the first one starts runs, and the others show them."""

import os
import stat
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QLabel, QPushButton
from pytestqt.qtbot import QtBot

from calstation.config import RunRequest
from calstation.gui.shell import create_window
from calstation.gui.shell.main_window import MainWindow
from calstation.gui.state import RunStrip
from calstation.sequencer import Command, StateChanged
from tests.gui.conftest import SERIAL, Operator, SiteFolder

PAGES = ["engineer_page", "offline_page", "history_page", "quality_page", "station_page"]


@pytest.fixture
def second(operator: Operator, qtbot: QtBot, site_folder: SiteFolder) -> Iterator[Operator]:
    """An operator at a second window of the same station."""
    operator.until(lambda: operator.window.app.windows._server is not None)
    window = create_window(site_folder.station)
    assert isinstance(window, MainWindow)
    qtbot.addWidget(window)
    window.show()
    yield Operator(window, qtbot, site_folder)
    window.app.close()


def begin_run(operator: Operator, monkeypatch: pytest.MonkeyPatch) -> list[Command]:
    """Begin a run that consists of emitted events; return the commands that are sent to it."""
    link, commands = operator.window.app.engine_link, list[Command]()
    monkeypatch.setattr(link, "send", commands.append)
    link.request = RunRequest(SERIAL, operator.site_folder.station, operator.site_folder.product)
    link.running_changed.emit(True)
    link.event.emit(StateChanged("running", "preparing"))
    return commands


def strip_text(operator: Operator) -> str:
    """Return the texts of the visible strip."""
    strip = next(strip for strip in operator.window.findChildren(RunStrip) if strip.isVisible())
    return "\n".join(label.text() for label in strip.findChildren(QLabel))


@pytest.mark.long
def test_running_unit_is_in_the_title_and_in_the_strip_of_every_page(
    operator: Operator, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert operator.window.windowTitle() == "calstation"
    begin_run(operator, monkeypatch)
    operator.until(lambda: operator.window.windowTitle() == f"{SERIAL}  ·  RUNNING  –  calstation")
    for page in PAGES:
        operator.window.show_page(page)
        assert f"{SERIAL}  ·  RUNNING" in strip_text(operator), page
    operator.window.app.set_language("zh_CN")
    assert operator.window.windowTitle() == f"{SERIAL}  ·  标定中  –  calstation"
    operator.window.show_page("engineer_page")
    assert f"{SERIAL}  ·  标定中" in strip_text(operator)


@pytest.mark.long
def test_number_for_the_next_run_is_named_so_on_the_engineer_page(
    operator: Operator, monkeypatch: pytest.MonkeyPatch
) -> None:
    operator.window.show_page("engineer_page")
    operator.widget("engineer_serial_edit").setText("SN-000007")
    begin_run(operator, monkeypatch)
    operator.until(lambda: f"{SERIAL}  ·  RUNNING" in strip_text(operator))
    assert "Serial number: next unit" in operator.says()


@pytest.mark.usefixtures("engineer_page")
@pytest.mark.long
def test_second_window_shows_the_run_of_the_first_one_and_stops_it(
    operator: Operator, second: Operator, monkeypatch: pytest.MonkeyPatch
) -> None:
    second.until(lambda: "This station is open in another window" in second.says())
    assert "READY (other window)" in second.says()
    assert second.message == "This station is open in another window"
    assert "This station and product cannot run" not in second.says()
    second.scan(SERIAL)
    second.window.create_engineer_page()
    for start in (second.widget("start_button", QPushButton), second.widget("engineer_start_button", QPushButton)):
        assert not start.isEnabled()
        assert "window" in start.toolTip()
    commands = begin_run(operator, monkeypatch)
    second.until(lambda: f"{SERIAL}  ·  RUNNING (other window)" in second.says())
    assert second.window.windowTitle().startswith(f"{SERIAL}  ·  RUNNING (other window)")
    for page in PAGES:
        second.window.show_page(page)
        assert f"{SERIAL}  ·  RUNNING (other window)" in strip_text(second), page
    test = second.widget("test_table_button", QPushButton)
    assert not test.isEnabled()
    assert test.toolTip().startswith("This station is open in another window")
    second.window.app.set_language("zh_CN")
    assert f"{SERIAL}  ·  标定中（另一窗口）" in strip_text(second)
    second.window.app.set_language("en")
    second.qtbot.mouseClick(second.window.stop_button, Qt.MouseButton.LeftButton)
    operator.until(lambda: commands == [Command.STOP])
    second.until(lambda: f"{SERIAL}  ·  STOPPING (other window)" in strip_text(second))
    second.window.show_page("operator_page")
    assert second.message == "Stopping. This station is open in another window"
    second.window.app.set_language("zh_CN")
    assert second.message == "正在停止。这个工位已在另一个窗口中打开"


@pytest.mark.long
def test_second_window_takes_the_place_of_the_first_one(operator: Operator, second: Operator) -> None:
    second.until(lambda: "This station is open in another window" in second.says())
    operator.window.app.close()
    second.until(lambda: second.widget("start_button").isEnabled())
    assert "open in another window" not in second.says()
    assert second.window.windowTitle() == "calstation"


@pytest.mark.long
def test_second_window_may_use_another_station(operator: Operator, second: Operator, site_folder: SiteFolder) -> None:
    second.until(lambda: "This station is open in another window" in second.says())
    other = site_folder.station.with_name("other.toml")
    other.write_text(site_folder.station.read_text(encoding="utf-8"), encoding="utf-8")
    second.window.app.set_station(other)
    assert second.window.app.run.elsewhere is None
    assert second.widget("start_button").isEnabled()
    operator.until(lambda: not operator.window.app.windows._others)
    second.window.app.set_station(site_folder.station)
    second.until(lambda: not second.widget("start_button").isEnabled())
    assert operator.widget("start_button").isEnabled()


#: Connects to the socket of a window as another user of the computer.
_INTRUDER = """
import os, socket, sys
os.setgroups([]), os.setgid(65534), os.setuid(65534)
try:
    socket.socket(socket.AF_UNIX).connect(sys.argv[1])
except PermissionError:
    print("refused")
"""


@pytest.mark.skipif(sys.platform == "win32", reason="permissions of files")
def test_other_users_of_the_computer_cannot_reach_the_window(operator: Operator) -> None:
    operator.until(lambda: operator.window.app.windows._server is not None)
    socket = Path(operator.window.app.windows._server.fullServerName())
    for path in (socket, socket.parent):
        assert path.stat().st_uid == os.getuid()
        assert stat.S_IMODE(path.stat().st_mode) & 0o077 == 0, path
    if os.getuid() == 0:
        command = [sys.executable, "-c", _INTRUDER, str(socket)]
        assert subprocess.run(command, capture_output=True, text=True, timeout=30).stdout == "refused\n"
        socket.parent.chmod(0o755)  # the socket itself is closed to them, too
        try:
            assert subprocess.run(command, capture_output=True, text=True, timeout=30).stdout == "refused\n"
        finally:
            socket.parent.chmod(0o700)
