"""Each port has one owner; a second process is refused before it opens the port, and the error names the owner."""

import json
import multiprocessing
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
import tomli_w
from serial.tools import list_ports

from calstation.cli.app import run_app
from calstation.config import RunRequest, load_station
from calstation.connection import (
    LinkTestRequest,
    check_imu_link,
    check_table_link,
    port_lock,
    read_table,
    reset_table,
    station_owner,
)
from calstation.connection.port_lock import ENGINE, lock_ports
from calstation.errors import CalstationError, DeviceFaultError
from calstation.registers import read_unit
from calstation.results import History
from calstation.runs import execute
from calstation.sequencer import Control
from tests.connection.fake_links import SITE, FakeTable, order, server
from tests.helpers import ignore_progress, raises_code

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="POSIX processes and paths")

_OWNER = """
import sys
from calstation.connection.port_lock import lock_ports
with lock_ports(sys.argv[1:]):
    print("owned", flush=True)
    sys.stdin.read()
"""


@pytest.fixture(autouse=True)
def _impatient(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CALSTATION_HOME", str(tmp_path / "home"))
    monkeypatch.setattr(port_lock, "_LOCK_TIMEOUT", 0.1)


@contextmanager
def owner(*ports: str) -> Iterator["subprocess.Popen[str]"]:
    """Run another process that owns the ports."""
    command = [sys.executable, "-c", _OWNER, *ports]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "owned\n"
        try:
            yield process
        finally:
            process.kill()


class Station:
    """A station whose table has two addresses; `order` uses one and `request` the other."""

    def __init__(self, folder: Path, address: str) -> None:
        self.folder = folder
        self.address = address
        number = address.rpartition(":")[2]
        self.order: LinkTestRequest = order(table={"port": f"tcp://localhost:{number}"})
        self.station = folder / "station.toml"
        table = {"profile": "bench", "port": f"tcp://{address}"}
        station = {"name": "hall", "site": SITE, "table": table, "imu": {"port": "/dev/ttyNONE9"}}
        self.station.write_text(tomli_w.dumps(station), encoding="utf-8")
        self.request = RunRequest("SN-000042", self.station, None, ("rate",), folder / "runs", "wang")

    def run(self) -> None:
        execute(self.request, ignore_progress, Control())


@pytest.fixture
def opened(tmp_path: Path) -> Iterator[tuple[Station, list[bytes]]]:
    """The station and all bytes that its table has received."""
    heard: list[bytes] = []
    table = FakeTable({})

    def answer(data: bytes) -> bytes:
        heard.append(data)
        return table.answer(data)

    with server(answer) as address:
        yield Station(tmp_path, address), heard


USERS: dict[str, Callable[[Station], object]] = {
    "run": Station.run,
    "table's link tested": lambda hall: check_table_link(ignore_progress, hall.order),
    "unit's link tested": lambda hall: check_imu_link(ignore_progress, hall.order),
    "table looked at": lambda hall: read_table(ignore_progress, hall.order),
    "table reset": lambda hall: reset_table(ignore_progress, hall.order),
    "registers read": lambda hall: read_unit(ignore_progress, hall.request, hall.folder),
}


@pytest.mark.long
def test_a_second_owner_is_refused_before_a_byte_is_sent(opened: tuple[Station, list[bytes]]) -> None:
    hall, heard = opened
    with owner(f"socket://{hall.address}") as first:
        for name, use in USERS.items():
            with pytest.raises(CalstationError) as refused:
                use(hall)
            assert refused.value.code == "connection.port_in_use", name
            assert refused.value.values["pid"] == first.pid, name
            assert str(refused.value.values["since"]).startswith("20")
            assert heard == [], name


@pytest.mark.long
@pytest.mark.parametrize("command", ["table status", "run --serial SN-000042 --stages rate --yes"])
def test_command_line_reports_a_port_in_use_in_one_line(
    opened: tuple[Station, list[bytes]], command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    hall, _ = opened
    out = ["--out", str(hall.request.out)] if command.startswith("run") else []
    with owner(f"tcp://{hall.address}"):
        assert run_app([*command.split(), "--station", str(hall.station), *out]) == 3
    printed = capsys.readouterr()
    assert f"calstation: Port tcp://{hall.address} is in use by another" in printed.err
    assert printed.err.count("in use") == 1
    assert printed.out == ""


def test_run_at_a_station_in_use_is_no_attempt_of_its_unit(opened: tuple[Station, list[bytes]]) -> None:
    hall, heard = opened
    with lock_ports([f"tcp://{hall.address}"]), raises_code(DeviceFaultError, "connection.port_in_use"):
        hall.run()
    assert heard == []
    assert [path.name for path in hall.request.out.glob("SN-*")] == []
    assert History(hall.request.out).attempts("SN-000042") == 0


@pytest.mark.long
def test_port_is_released_when_its_owner_is_killed(opened: tuple[Station, list[bytes]]) -> None:
    hall, _ = opened
    with owner(f"tcp://{hall.address}") as first:
        first.kill()
        first.wait()
        assert read_table(ignore_progress, hall.order).model.startswith("bench-table")


def test_port_is_released_after_an_exception(opened: tuple[Station, list[bytes]]) -> None:
    port = f"tcp://{opened[0].address}"
    with pytest.raises(OSError, match="cut"), lock_ports([port]):
        raise OSError("cut")
    with lock_ports([port]):
        pass


def test_owner_of_a_station_is_named_and_stopped_only_while_it_owns_a_port(
    opened: tuple[Station, list[bytes]], monkeypatch: pytest.MonkeyPatch
) -> None:
    station, port = load_station(opened[0].station)[1], f"tcp://{opened[0].address}"
    sent: list[tuple[int, int]] = []
    monkeypatch.setattr(os, "kill", lambda pid, number: sent.append((pid, number)) if number else None)
    assert station_owner(station) is None
    with lock_ports([port]):
        other = station_owner(station)
        assert other is not None
        assert (other.pid, other.parent, other.can_stop) == (os.getpid(), None, False)
        assert not other.stop()
    monkeypatch.setattr(multiprocessing.current_process(), "_name", ENGINE)
    with lock_ports([port]):
        run = station_owner(station)
        assert run is not None
        assert run.can_stop
        assert not replace(run, pid=1).can_stop, "another process has not opened the file"
        assert run.stop()
    assert sent == [(os.getpid(), signal.SIGTERM)]
    assert not run.stop(), "the port is free"
    assert station_owner(station) is None


def test_ports_of_one_host_are_locked_separately() -> None:
    with lock_ports(["tcp://127.0.0.1:40001"]), lock_ports(["tcp://127.0.0.1:40002", "socket://[::1]:40003"]):
        pass


def refused(port: str) -> bool:
    try:
        with lock_ports([port]):
            return False
    except DeviceFaultError:
        return True


def test_serial_port_is_locked_under_all_its_names(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    device, link = tmp_path / "ttyX0", tmp_path / "by-id"
    device.touch()
    link.symlink_to(device)
    with lock_ports([str(device)]):
        assert refused(str(link))
    adapter = {"name": "ttyX0", "description": None, "manufacturer": None, "serial_number": "FT1"}
    listed = [SimpleNamespace(device=str(device), location="1-2", **adapter)]
    monkeypatch.setattr(list_ports, "comports", lambda: listed)
    with lock_ports(["usb:FT1"]):
        for name in (str(device), str(link), "usb:FT1@1-2"):
            assert refused(name)
        listed[0].device = str(tmp_path / "ttyX1")
        assert refused("usb:FT1"), "plugged in again under another name"
        assert not refused(str(device)), "which another adapter may have now"


def test_a_missing_port_is_not_locked(tmp_path: Path) -> None:
    with lock_ports(["usb:NONE", str(tmp_path / "none"), "tcp://"]):
        assert not refused("usb:NONE")


def test_a_failed_lock_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setattr(port_lock, "_folder", lambda: tmp_path / "file")
    with raises_code(DeviceFaultError, "connection.lock_failed"), lock_ports(["tcp://127.0.0.1:40001"]):
        pass


def test_lock_files_are_shared_by_all_users_and_follow_no_symlink(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(port_lock, "_folder", lambda: tmp_path / "locks")
    with lock_ports(["tcp://127.0.0.1:40001"]):
        (lock,) = (tmp_path / "locks").iterdir()
        assert lock.stat().st_mode & 0o777 == 0o666
        assert (tmp_path / "locks").stat().st_mode & 0o7777 == 0o1777
    target = tmp_path / "target"
    target.write_text("kept", encoding="utf-8")
    lock.unlink()
    lock.symlink_to(target)
    assert refused("tcp://127.0.0.1:40001")
    assert target.read_text(encoding="utf-8") == "kept"


def test_unresolvable_host_name_is_locked_by_its_name(monkeypatch: pytest.MonkeyPatch) -> None:
    def unknown(*args: object, **kwargs: object) -> None:
        raise socket.gaierror("unknown")

    monkeypatch.setattr(socket, "getaddrinfo", unknown)
    with lock_ports(["tcp://table.invalid:502"]):
        assert refused("socket://table.invalid:502")


def test_owner_is_read_from_a_lock_file_with_keys_of_a_later_version(
    opened: tuple[Station, list[bytes]],
) -> None:
    station, port = load_station(opened[0].station)[1], f"tcp://{opened[0].address}"
    with lock_ports([port]):
        written = station_owner(station)
        assert written is not None
        written.file.write_text(json.dumps({**json.loads(written.file.read_bytes()), "host": "pc-2", "file": "x"}))
        assert station_owner(station) == written
