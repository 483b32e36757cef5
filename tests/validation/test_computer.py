"""Checks of the computer find clocks, disks and rights that are not in order."""

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from calstation.config import access
from calstation.records import append_audit, key_file
from calstation.validation import computer
from calstation.validation.computer import SystemClock, clock_lines, disk_lines, rights_lines
from calstation.validation.lines import Line


@pytest.fixture(autouse=True)
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "site"
    monkeypatch.setenv("CALSTATION_HOME", str(folder))
    append_audit(folder, "file_saved", "wang")
    access.set_pin("", "246813")
    monkeypatch.setattr(computer, "_BLOCK", 4096)
    monkeypatch.setattr(computer, "_REPLACEMENTS", 10)
    return folder


def rights(runs: Path) -> dict[str, Line]:
    runs.mkdir(exist_ok=True)
    return {line.check: line for line in rights_lines(runs)}


def disks(runs: Path) -> set[tuple[str, str]]:
    return {(line.check, line.state) for line in disk_lines(runs, lambda: None) if line.subject.startswith("runs")}


def test_a_computer_in_order(tmp_path: Path) -> None:
    assert disks(tmp_path / "runs") == {(name, "ok") for name in ("space", "writing", "lock", "replacement")}
    assert {line.state for name, line in rights(tmp_path / "runs").items()} == {"ok"}
    assert {line.state for line in clock_lines() if line.check != "synchronised"} == {"ok"}
    assert [line.state for line in SystemClock().lines()] == ["ok"]
    assert not list((tmp_path / "runs").iterdir())


def test_a_step_of_the_system_clock_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = SystemClock()
    now = time.time()
    monkeypatch.setattr("calstation.validation.computer.time.time", lambda: now + 1.0)
    assert [line.state for line in clock.lines()] == ["failed"]


def test_an_unknown_synchronisation_is_not_claimed(monkeypatch: pytest.MonkeyPatch) -> None:
    for answer, state in (((True, 0.01), "ok"), ((False, 0.0), "not_checked"), ((None, 0.0), "not_checked")):
        monkeypatch.setattr(computer, "_synchronisation", lambda answer=answer: answer)
        assert [line.state for line in clock_lines() if line.check == "synchronised"] == [state]


def test_a_folder_that_cannot_be_written_is_found(tmp_path: Path) -> None:
    (tmp_path / "runs").write_text("", encoding="utf-8")
    assert disks(tmp_path / "runs") == {("writing", "failed")}


def test_a_full_disk_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    usage = os.statvfs_result((4096, 4096, 1000, 1, 1, 1, 1, 1, 0, 255))
    monkeypatch.setattr("shutil.disk_usage", lambda path: type("Usage", (), {"free": usage.f_bavail * 4096})())
    assert ("space", "failed") in disks(tmp_path / "runs")


def test_locks_that_do_not_exclude_are_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    @contextmanager
    def granted(path: Path, timeout: float) -> Iterator[None]:
        yield

    monkeypatch.setattr(computer, "locked", granted)
    assert ("lock", "failed") in disks(tmp_path / "runs")


def test_a_replacement_that_is_not_atomic_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def write(path: Path, content: bytes, sync: bool) -> None:
        with path.open("wb") as stream:
            stream.write(content[:100])
            stream.flush()
            time.sleep(0.002)
            stream.write(content[100:])

    monkeypatch.setattr(computer, "write_atomic", write)
    assert ("replacement", "failed") in disks(tmp_path / "runs")


@pytest.mark.skipif(os.name == "nt", reason="no modes")
def test_folders_and_keys_that_others_may_write_or_read_are_found(site: Path, tmp_path: Path) -> None:
    key_file(site).chmod(0o640)
    site.chmod(0o777)
    found = rights(tmp_path / "runs")
    assert {name for name, line in found.items() if line.state == "failed"} == {"key", "site"}
    assert "wang" not in str(found["site"].found)


def test_a_missing_pin_and_a_changed_trail_are_found(
    site: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (site / "audit.jsonl").write_text("", encoding="utf-8")
    monkeypatch.setattr(access, "has_pin", lambda badge="": False)
    found = rights(tmp_path / "runs")
    assert (found["pin"].state, found["trail"].state) == ("failed", "failed")
