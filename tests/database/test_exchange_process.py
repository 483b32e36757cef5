"""The exchange runs in a separate process, which ends with its owner and writes its state to a file."""

import errno
import json
import multiprocessing
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from types import SimpleNamespace

import pytest
from sqlalchemy import Connection

from calstation.cli.app import run_app
from calstation.database import (
    Claim,
    Exchange,
    ExchangeProcess,
    connect,
    exchange_once,
    read_state,
    start_exchange,
    watch,
)
from calstation.database.exchange import _store
from calstation.database.outbox import OutboxMessage
from calstation.database.process import MAX_RETRY_S, PAUSE_S, RETRY_S
from calstation.database.state import change_state
from calstation.errors import ConfigurationError
from calstation.records import locked
from tests.database.result_files import in_database, in_index, write_result
from tests.database.test_claims import station_file
from tests.helpers import raises_code


def eventually(condition: Callable[[], object]) -> None:
    """Wait until a condition holds."""
    deadline = time.monotonic() + 120.0
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.05)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Runs folder of a station."""
    made = tmp_path / "line 1"
    made.mkdir()
    return made


@pytest.mark.long
def test_runs_are_exchanged_while_the_process_lives(shared_database: str, folder: Path, tmp_path: Path) -> None:
    other = tmp_path / "line 2"
    other.mkdir()
    write_result(folder, "a", 1)
    with start_exchange(station_file(folder, shared_database), folder, {"SN-7": "li"}) as exchange:
        eventually(lambda: in_database(shared_database) == [("a", "line 1")])
        write_result(folder, "b", 2)
        eventually(lambda: len(in_database(shared_database)) == 2)
        with start_exchange(station_file(other, shared_database), other, {"SN-7": None}):
            eventually(lambda: len(in_index(other)) == 2)
            claims = []
            eventually(lambda: claims.extend(exchange.new_claims()) or claims)
            assert [(claim.serial, claim.station) for claim in claims] == [("SN-7", "line 2")]
            assert exchange.new_claims() == []
            write_result(other, "c", 3)
        # the last exchange sends the remaining runs
        eventually(lambda: len(in_index(folder)) == 3)
        write_result(folder, "d", 4)
    eventually(lambda: exchange.process.poll() is not None)
    assert [name for name, _ in in_database(shared_database)] == ["a", "b", "c", "d"]
    state = read_state(folder)
    assert (state.pending, state.error) == (0, None)
    assert state.contact_utc == state.attempt_utc


def test_only_new_claims_on_the_current_unit_are_returned(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("calstation.database.process._MIN_READ_INTERVAL_S", 0.0)
    now = datetime.now(UTC)
    mine, other = (Claim(serial, "line 2", None, now) for serial in ("SN-7", "SN-8"))
    change_state(folder, contact_utc=now, claims=(mine, other))
    with monkeypatch.context() as patch:
        patch.setattr("calstation.database.process.sys.executable", shutil.which("cat"))  # exchanges nothing
        exchange = ExchangeProcess(folder, "sqlite://", "line 1", {"SN-7": None})
    with exchange:
        assert exchange.new_claims() == []  # claims of the last session are ignored
        change_state(folder, contact_utc=now + timedelta(seconds=1))
        assert exchange.new_claims() == [mine]
        assert exchange.new_claims() == []
        exchange.claim({"SN-8": None})
        assert exchange.new_claims() == [other]


def _run_owner(url: str, folder: Path, connection) -> None:
    process = ExchangeProcess(folder, url, "line 1")
    connection.send(process.process.pid)
    time.sleep(600)


@pytest.mark.long
def test_process_ends_when_its_owner_is_killed(shared_database: str, folder: Path) -> None:
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    owner = context.Process(target=_run_owner, args=(shared_database, folder, there))
    owner.start()
    pid = here.recv()
    eventually(lambda: read_state(folder).contact_utc)
    write_result(folder, "a", 1)
    owner.kill()
    owner.join()
    eventually(lambda: not _alive(pid))
    assert len(in_database(shared_database)) == 1


def _alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    status = Path(f"/proc/{pid}/stat")
    return not status.exists() or status.read_text(encoding="utf-8").split()[2] != "Z"


def test_unreachable_database_is_retried_with_growing_pauses(folder: Path) -> None:
    write_result(folder, "a", 1)
    pauses: list[float] = []

    def wait(seconds: float) -> bool:
        pauses.append(seconds)
        state = read_state(folder)
        assert state.pending == 1
        assert state.error is not None
        assert state.error.code == "database.unreachable"
        return len(pauses) == 9

    watch(folder, "postgresql+psycopg://line@127.0.0.1:1/none", "line 1", wait)
    assert pauses == [RETRY_S * 2**k for k in range(6)] + [MAX_RETRY_S] * 3
    assert min(RETRY_S, PAUSE_S) >= 1.0


def test_unexpected_error_does_not_end_the_exchange(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    url = f"sqlite:///{tmp_path / 'shared.sqlite'}"
    write_result(folder, "a", 1)
    made: list[Exchange] = []
    init, errors = Exchange.__init__, []

    def note(self: Exchange, *args: object, **kwargs: object) -> None:
        init(self, *args, **kwargs)
        made.append(self)

    def fail(*_: object) -> None:
        raise RuntimeError("no backend of the keyring")

    monkeypatch.setattr(Exchange, "__init__", note)
    monkeypatch.setattr("calstation.database.exchange.connect", fail)

    def wait(seconds: float) -> bool:
        error = read_state(folder).error
        errors.append(None if error is None else error.code)
        if len(made) == 2:
            monkeypatch.setattr("calstation.database.exchange.connect", connect)
        return len(made) == 3

    watch(folder, url, "line 1", wait)
    assert errors == ["program.internal", "program.internal", None]
    assert in_database(url) == [("a", "line 1")]


def test_full_disk_does_not_end_the_exchange(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    url = f"sqlite:///{tmp_path / 'shared.sqlite'}"
    pauses = []

    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    def wait(seconds: float) -> bool:
        pauses.append(seconds)
        if len(pauses) == 2:
            patch.undo()
        return len(pauses) == 3

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("calstation.database.state.write_atomic", full)
        watch(folder, url, "line 1", wait)
    assert pauses[:2] == [RETRY_S, 2.0 * RETRY_S]
    assert read_state(folder).contact_utc is not None


def test_folder_exchanged_by_another_process_is_busy(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("calstation.database.process._LOCK_TIMEOUT_S", 0.0)
    exchange = Exchange(folder, f"sqlite:///{tmp_path / 'shared.sqlite'}", "line 1")
    with locked(folder / ".exchange.lock", 0.0), raises_code(ConfigurationError, "database.busy"):
        exchange_once(exchange, folder)


@pytest.mark.long
def test_long_exchange_yields_to_another_process_on_the_same_folder(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    url, there = f"sqlite:///{tmp_path / 'shared.sqlite'}", tmp_path / "there"
    there.mkdir()
    names = [f"a{number:03d}" for number in range(170)]  # four pages
    for number, name in enumerate(names):
        write_result(folder, name, number)
        write_result(there, f"b{number:03d}", number)
    station = Exchange(there, url, "line 2")
    station.exchange()
    one, two = Exchange(folder, url, "line 1"), Exchange(folder, url, "line 1")
    monkeypatch.setattr("calstation.database.process._SLICE_S", 0.0)
    monkeypatch.setattr("calstation.database.exchange._PAGE_SIZE", 50)
    pending: list[int] = []
    stored: list[str] = []

    def store(connection: Connection, outbox: str, messages: Sequence[OutboxMessage]) -> int:
        stored.extend(message.columns["name"] for message in messages)
        return _store(connection, outbox, messages)

    monkeypatch.setattr("calstation.database.exchange._store", store)

    def pause(_: float) -> None:
        pending.append(one.outbox.pending)
        with locked(folder / ".exchange.lock", 0.0):
            two.exchange(0.0)

    clock = SimpleNamespace(sleep=pause, monotonic=time.monotonic)
    monkeypatch.setattr("calstation.database.process.time", clock)
    state = exchange_once(one, folder)
    assert (state.pending, state.error) == (0, None)
    assert pending[:3] == [0, 120, 20]  # 100 runs are read, then both processes send pages alternately
    assert [name for name, _ in in_database(url) if name in names] == names
    assert stored == names  # no run was sent twice
    station.exchange()
    assert len(in_index(folder)) == 2 * len(names)
    assert in_index(folder) == in_index(there)
    for each in (station, one, two):
        each.close()


def test_unchanged_state_is_rarely_written(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    exchange = Exchange(folder, f"sqlite:///{tmp_path / 'shared.sqlite'}", "line 1")
    first = exchange_once(exchange, folder)
    assert exchange_once(exchange, folder) == first
    monkeypatch.setattr("calstation.database.process._MAX_UPDATE_INTERVAL", timedelta(0))
    assert exchange_once(exchange, folder).contact_utc > first.contact_utc
    exchange.close()


@pytest.mark.long
def test_ending_does_not_block_and_a_hanging_process_exits(folder: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:  # accepts connections and sends nothing
        url = f"postgresql+psycopg://line@127.0.0.1:{server.getsockname()[1]}/none"
        exchange = ExchangeProcess(folder, url, "line 1")
        server.settimeout(60.0)
        connection, _ = server.accept()
        with connection:
            begin = time.monotonic()
            exchange.end()
            assert time.monotonic() - begin < 0.5
            assert exchange.process.wait(60.0) == 0


@pytest.mark.long
def test_logs_state_and_errors_contain_no_password(
    postgres, shared_database: str, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    postgres.execute("CREATE ROLE guarded LOGIN PASSWORD 'geheim' IN ROLE with_password")
    name = shared_database.rpartition("/")[2]
    station = station_file(folder, postgres.url(name, "guarded"))
    logs = tmp_path / "logs"
    monkeypatch.setenv("CALSTATION_LOG_FOLDER", str(logs))
    monkeypatch.setenv("CALSTATION_LOG_LEVEL", "debug")
    command = [sys.executable, "-m", "calstation", "--log-level", "debug", "database", "exchange"]
    command += ["--station", str(station), "--out", str(folder)]
    found = []
    for password in ("falsch geheim", "geheim"):  # a wrong password, then a role without permissions
        monkeypatch.setenv("PGPASSWORD", password)
        for extra in ([], ["--debug"]):
            done = subprocess.run([*command, *extra], capture_output=True, text=True, check=False)
            assert done.returncode == 2
            found.append(done.stderr)
    assert "password authentication failed" in found[0]
    assert "permission denied" in found[2]
    texts = [*found, *(path.read_text("utf-8") for path in logs.iterdir())]
    texts += [path.read_text("utf-8", "replace") for path in folder.iterdir() if path.is_file()]
    assert len(texts) > 6
    assert not [text for text in texts if "geheim" in text]


def test_commands_exchange_runs_and_show_the_state(
    shared_database: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    station = station_file(folder, shared_database)
    write_result(folder, "a", 1)
    common = ["--station", str(station), "--out", str(folder)]
    assert run_app(["database", "upgrade", "--station", str(station)]) == 0
    assert run_app(["database", "upgrade", shared_database]) == 0
    line = f"The tables of the database {shared_database} already have this version; nothing was changed.\n"
    assert capsys.readouterr().err == 2 * line
    assert run_app(["database", "exchange", *common]) == 0
    assert "All runs of the folder are in the shared database." in capsys.readouterr().err
    assert run_app(["database", "status", "--out", str(folder), "--json", "-"]) == 0
    state = json.loads(capsys.readouterr().out)
    assert (state["pending"], state["error"]) == (0, None)
    assert run_app(["database", "status", "--out", str(folder)]) == 0
    assert "database: 0; logs that wait for the archive: 0; last contact: 20" in capsys.readouterr().out
    assert run_app(["database", "exchange", "--out", str(folder)]) == 2
    assert "names no shared database" in capsys.readouterr().err


@pytest.mark.parametrize("command", [("exchange",), ("exchange", "--watch"), ("status",), ("adopt",)])
def test_missing_folder_is_refused_and_not_created(
    folder: Path, tmp_path: Path, command: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    station = station_file(folder, f"sqlite:///{tmp_path / 'shared.sqlite'}")
    missing = tmp_path / "rnus"
    options = ["--station", str(station)] if "exchange" in command else []
    assert run_app(["database", *command, "--out", str(missing), *options]) == 2
    out, err = capsys.readouterr()
    assert (out, f"{missing}: No such folder of runs. Give an existing folder with --out." in err) == ("", True)
    assert not missing.exists()
    assert not (tmp_path / "shared.sqlite").exists()


@pytest.mark.long
def test_service_shows_state_changes_and_ends_on_a_signal(
    postgres, shared_database: str, folder: Path, tmp_path: Path
) -> None:
    station = station_file(folder, shared_database)
    command = [sys.executable, "-m", "calstation", "database", "exchange", "--watch", "--station", str(station)]
    log = tmp_path / "journal"
    with log.open("w", encoding="utf-8") as stream:
        process = subprocess.Popen([*command, "--out", str(folder)], stderr=stream)
        eventually(lambda: log.read_text("utf-8").count("All runs of the folder are in the shared database.") == 1)
        postgres.stop()
        try:
            eventually(lambda: "is not reachable" in log.read_text("utf-8"))
            write_result(folder, "a", 1)
            eventually(lambda: read_state(folder).pending)
        finally:
            postgres.start()
        eventually(lambda: log.read_text("utf-8").count("All runs of the folder are in the shared database.") == 2)
        write_result(folder, "b", 2)
        process.send_signal(signal.SIGTERM)
        assert process.wait(60.0) == 0
    assert len(in_database(shared_database)) == 2
    shown = log.read_text("utf-8").splitlines()
    assert len(shown) < 8
    assert len(set(shown[1:-1])) == len(shown[1:-1])  # no line is repeated while nothing changes
