"""A station whose devices another program uses: the window shows it, refuses START, and STOP stops its run."""

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path
from unittest.mock import Mock

import pytest
import tomli_w
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QLabel, QLineEdit, QPushButton

from calstation.config import RunRequest
from calstation.connection import port_lock
from calstation.gui.state import RunStrip
from calstation.gui.state.engine_link import EngineLink
from calstation.gui.widgets import ElidedLabel, theme
from calstation.sequencer import Command, Fault, StateChanged
from tests.database.result_files import write_result
from tests.gui.conftest import SERIAL, Operator
from tests.site_folder import STATION

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="POSIX locks and signals")

#: Owns a lock file as a process with a name, until a signal that ends a run safely.
_OWNER = """
import fcntl, json, os, signal, sys
file = open(sys.argv[1], "w")
fcntl.flock(file, fcntl.LOCK_EX)
since = "2026-07-01T03:03:00+00:00"
json.dump({"pid": os.getpid(), "user": "wang", "since": since, "name": sys.argv[2], "parent": None}, file)
file.flush()
signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
print("owned", flush=True)
signal.pause()
"""


@contextmanager
def owner(name: str) -> Iterator["subprocess.Popen[str]"]:
    """Run another process that uses the table of the hardware station."""
    command = [sys.executable, "-c", _OWNER, str(port_lock._lock_file("loopback:9")), name]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "owned\n"
        try:
            yield process
        finally:
            process.kill()


@pytest.fixture
def hardware(operator: Operator, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Operator:
    """An operator at a station with hardware."""
    (tmp_path / "locks").mkdir()
    monkeypatch.setattr(port_lock, "_folder", lambda: tmp_path / "locks")
    ports = {"table": {"profile": "bench", "port": "tcp://127.0.0.1:9"}, "imu": {"port": "socket://127.0.0.1:7"}}
    station = operator.site_folder.station.with_name("hardware.toml")
    station.write_text(tomli_w.dumps({**STATION, "name": "line 3", **ports}), encoding="utf-8")
    operator.window.app.set_station(station)
    operator.scan(SERIAL)
    return operator


def press_stop(operator: Operator) -> None:
    operator.qtbot.mouseClick(operator.window.stop_button, Qt.MouseButton.LeftButton)


@pytest.mark.long
@pytest.mark.parametrize(
    ("code", "used", "remedy", "badge", "stopped", "afterwards"),
    [
        (
            *("en", "process {pid} of wang", "STOP and Esc in this window stop its run", "IN USE"),
            *("told to stop its run", "The run of process {pid} of wang was stopped from this window"),
        ),
        (
            *("zh_CN", "用户 wang 的进程 {pid}", "会安全停止它的标定", "使用中"),
            *("安全停止标定", "已从本窗口停止用户 wang 的进程 {pid} 的标定"),
        ),
    ],
)
def test_run_of_another_program_is_shown_and_stopped(
    hardware: Operator, code: str, used: str, remedy: str, badge: str, stopped: str, afterwards: str
) -> None:
    hardware.window.app.set_language(code)
    start = hardware.widget("start_button", QPushButton)
    hardware.until(start.isEnabled)
    with owner(port_lock.ENGINE) as process:
        hardware.until(lambda: hardware.run.display_state == "in_use")  # what a second window of the station shows
        hardware.until(lambda: used.format(pid=process.pid) in hardware.message)
        assert remedy in hardware.says()
        assert badge in hardware.says()
        assert not start.isEnabled()
        assert str(process.pid) in start.toolTip()
        hardware.window.show_page("engineer_page")
        (strip,) = (strip for strip in hardware.window.findChildren(RunStrip) if strip.isVisible())
        assert badge in [label.text() for label in strip.findChildren(QLabel)]
        hardware.window.resize(1280, 720)  # 1920x1080 at a scale of 150 %
        hardware.until(lambda: hardware.window.width() == 1280)
        (said,) = (each for each in strip.findChildren(ElidedLabel) if str(process.pid) in each.text())
        hardware.until(lambda: said.shortened() == said.text())
        assert strip.height() == theme.BIG_BUTTON
        assert str(process.pid) in hardware.widget("engineer_start_button", QPushButton).toolTip()
        press_stop(hardware)
        assert any(stopped in label.text() for label in strip.findChildren(QLabel))
        assert process.wait(10.0) == 0
        hardware.window.show_page("operator_page")
        hardware.until(start.isEnabled)
        assert badge not in hardware.says()
        assert afterwards.format(pid=process.pid) in hardware.says()
        hardware.scan(SERIAL)
        assert afterwards.format(pid=process.pid) not in hardware.says(), "it concerns the run before the next scan"


def test_run_that_ends_by_itself_is_not_said_to_be_stopped(hardware: Operator) -> None:
    with owner(port_lock.ENGINE) as process:
        hardware.until(lambda: hardware.run.display_state == "in_use")
        process.kill()
        hardware.until(lambda: hardware.run.display_state == "idle")
        assert str(process.pid) not in hardware.says()


@pytest.mark.parametrize(
    ("code", "said"),
    [("en", "If the table moves, press its emergency stop"), ("zh_CN", "如果转台在动，请按转台的急停按钮")],
)
def test_program_that_executes_no_run_is_not_stopped(hardware: Operator, code: str, said: str) -> None:
    hardware.window.app.set_language(code)
    with owner("MainProcess") as process:
        hardware.until(lambda: str(process.pid) in hardware.message)
        press_stop(hardware)
        assert said in hardware.message
        assert process.poll() is None


@pytest.mark.long
def test_run_in_another_window_is_not_called_that_of_another_program(hardware: Operator) -> None:
    with owner(port_lock.ENGINE):
        hardware.until(lambda: hardware.run.display_state == "in_use")
        hardware.run.set_elsewhere(((SERIAL,), "running"))
        hardware.window.show_page("history_page")
        (strip,) = (strip for strip in hardware.window.findChildren(RunStrip) if strip.isVisible())
        assert SERIAL in visible_text(strip)
        assert "another program" not in visible_text(strip)
        assert hardware.run.display_state != "in_use"


def visible_text(strip: RunStrip) -> str:
    return "\n".join(label.text() for label in strip.findChildren(QLabel))


def start_engine(operator: Operator) -> Mock:
    """Let the engine of this window begin to open its ports."""
    app = operator.window.app
    link, engine = app.engine_link, Mock()
    link.request = RunRequest(SERIAL, app.station_path, app.product_path, out=app.runs_folder)
    link._engine = engine
    link.running_changed.emit(True)
    assert operator.run.state == "starting"
    return engine


@pytest.mark.long
@pytest.mark.parametrize("page", ["operator_page", "engineer_page"])
def test_question_before_a_start_is_dropped_when_another_program_uses_the_station(
    hardware: Operator, page: str
) -> None:
    prefix = "engineer_" if page == "engineer_page" else ""
    hardware.window.app.role.set_first_pin("246813")
    hardware.window.show_page(page)
    if prefix:
        hardware.qtbot.keyClicks(hardware.widget("engineer_serial_edit"), SERIAL)
    hardware.press(f"{prefix}start_button")
    assert "will move" in hardware.says()
    with owner(port_lock.ENGINE):
        hardware.until(lambda: hardware.run.display_state == "in_use")
        hardware.until(lambda: "will move" not in hardware.says())
        assert hardware.run.state == "idle"


def test_answer_starts_no_run_after_another_window_has_started_one(
    hardware: Operator, monkeypatch: pytest.MonkeyPatch
) -> None:
    started: list[object] = []
    monkeypatch.setattr(EngineLink, "start", lambda _, order: started.append(order))
    hardware.press("start_button")
    answer = hardware.widget("clear_choice", QPushButton)
    hardware.run.elsewhere = ((SERIAL,), "running")  # before the window shows it
    hardware.qtbot.mouseClick(answer, Qt.MouseButton.LeftButton)
    assert started == []
    assert "another window" in hardware.says()


@pytest.mark.parametrize(
    ("code", "told", "wrong"), [("en", "told to stop its run", "commanded"), ("zh_CN", "安全停止标定", "没有收到")]
)
def test_stop_before_the_ports_are_opened_stops_the_program_that_uses_them(
    hardware: Operator, code: str, told: str, wrong: str
) -> None:
    hardware.window.app.set_language(code)
    with owner(port_lock.ENGINE) as process:
        engine = start_engine(hardware)
        press_stop(hardware)
        hardware.until(lambda: told in hardware.message, 5.0)
        assert wrong not in hardware.message
        hardware.until(lambda: process.poll() == 0, 10.0)
        engine.send.assert_called_once_with(Command.STOP)


def test_stop_of_a_run_that_has_opened_its_ports_stops_nothing_else(hardware: Operator) -> None:
    start_engine(hardware)
    hardware.window.app.engine_link.event.emit(StateChanged("preparing", "idle"))
    with owner(port_lock.ENGINE) as process:
        press_stop(hardware)
        hardware.qtbot.wait(1500)
        assert process.poll() is None


@pytest.mark.parametrize("later", ["read", "owner"])
def test_stop_is_not_passed_to_a_later_run(hardware: Operator, monkeypatch: pytest.MonkeyPatch, later: str) -> None:
    watch, done = hardware.window.app.port_watch, Mock()
    hardware.until(lambda: not watch._reading)
    watch.leave()
    monkeypatch.setattr("calstation.gui.state.port_watch.find_station_owner", done)
    now = datetime.now(UTC)
    since = now + timedelta(minutes=1) if later == "owner" else now - timedelta(minutes=1)
    owner = Mock(pid=1, parent=None, since=since.isoformat(timespec="seconds"), user="wang")
    watch._find_owner()
    if later == "read":
        start_engine(hardware)
    hardware.run.stop()  # during a read
    if later == "read":
        hardware.window.app.engine_link.event.emit(StateChanged("preparing", "idle"))
        watch._show(watch._station, None)
        hardware.run.state = "idle"
        watch._find_owner()
    watch._show(watch._station, owner)
    assert hardware.run.program is not None
    owner.stop.assert_not_called()


@pytest.mark.parametrize("waiting", ["typed", "scanned", "badge"])
def test_end_of_the_other_program_leaves_what_is_entered(hardware: Operator, waiting: str) -> None:
    edit = hardware.widget("serial_edit", QLineEdit)
    with owner(port_lock.ENGINE) as process:
        fail_to_start(hardware, "connection.port_in_use", in_use_by(process))
        hardware.until(lambda: hardware.run.fault is not None)
        if waiting == "scanned":
            hardware.scan("SN-000077")
            assert "Understood first" in hardware.says()
        elif waiting == "typed":
            hardware.qtbot.keyClicks(edit, "SN-00007")
        else:
            hardware.widget("operator_edit", QLineEdit).setFocus()
        accepted = hardware.widget("serial_symbol").isVisible()
        process.kill()
        hardware.until(lambda: hardware.run.fault is None, 10.0)
    assert edit.text() == {"typed": "SN-00007", "scanned": "SN-000077", "badge": ""}[waiting]
    assert hardware.widget("serial_symbol").isVisible() == accepted == (waiting == "scanned")
    assert "Understood first" not in hardware.says()
    assert hardware.widget("start_button").isEnabled() == (waiting != "badge")
    if waiting == "typed":
        hardware.qtbot.keyClicks(edit, "7")
        assert edit.text() == "SN-000077"
    elif waiting == "badge":
        assert hardware.widget("operator_edit").hasFocus()


@pytest.mark.parametrize(
    ("code", "remedy", "told"),
    [
        ("en", "STOP and Esc in this window stop its run", "told to stop its run"),
        ("zh_CN", "会安全停止它的标定", "安全停止标定"),
    ],
)
def test_fault_of_a_port_in_use_names_stop_and_goes_when_the_other_program_ends(
    hardware: Operator, code: str, remedy: str, told: str
) -> None:
    hardware.window.app.set_language(code)
    with owner(port_lock.ENGINE) as process:
        fail_to_start(hardware, "connection.port_in_use", in_use_by(process))
        hardware.until(lambda: remedy in hardware.says())
        press_stop(hardware)
        assert told in hardware.message
        assert process.wait(10.0) == 0
        hardware.until(lambda: hardware.run.state == "idle", 5.0)
        assert hardware.run.fault is None
        assert "tcp://" not in hardware.says()


def test_fault_of_a_port_whose_owner_is_unreadable_stays(hardware: Operator) -> None:
    with owner(port_lock.ENGINE):
        port_lock._lock_file("loopback:9").write_text("", encoding="utf-8")
        fail_to_start(hardware, "connection.port_in_use_unknown", {"port": "tcp://127.0.0.1:9"})
        hardware.qtbot.wait(2500)
        assert hardware.run.fault is not None


def in_use_by(process: "subprocess.Popen[str]") -> dict[str, object]:
    """Return the values of the fault of a port that a process uses."""
    return {"port": "tcp://127.0.0.1:9", "pid": process.pid, "user": "wang", "since": "2026-07-01T03:03:00+00:00"}


def fail_to_start(operator: Operator, code: str, values: dict[str, object]) -> None:
    """Let the engine of this window end with a fault before it opens its ports."""
    start_engine(operator)
    link = operator.window.app.engine_link
    link.event.emit(Fault("PortLockError", "", 3, code, values))
    link._end()


def test_shift_is_counted_again_when_the_run_of_another_program_ends(hardware: Operator) -> None:
    shift = hardware.widget("shift_label", QLabel)
    with owner(port_lock.ENGINE) as process:
        hardware.until(lambda: hardware.run.display_state == "in_use")
        runs = hardware.window.app.runs_folder
        runs.mkdir(exist_ok=True)
        now = f"{datetime.now(UTC):%Y-%m-%dT%H:%M:%S+00:00}"
        write_result(runs, "SN-1_1", 1, station="line 3", started_utc=now)
        assert "0 done" in shift.text()
        process.kill()
        hardware.until(lambda: "1 done" in shift.text(), 20.0)
