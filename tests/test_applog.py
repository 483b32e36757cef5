"""The application log: one file per process, the run id in every line, and no failure if it cannot be written."""

import logging
import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from calstation import applog

logger = logging.getLogger("calstation.tests")


@pytest.fixture(autouse=True)
def restored(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.delenv(applog.FOLDER, raising=False)
    monkeypatch.delenv(applog.LEVEL, raising=False)
    yield
    monkeypatch.setenv(applog.FOLDER, "")
    applog.configure("tests")
    logging.getLogger("calstation").propagate = True


def text(folder: Path) -> str:
    return "".join(path.read_text("utf-8") for path in sorted(folder.glob("*.log")))


def test_log_line_contains_time_level_run_and_module(tmp_path: Path) -> None:
    applog.configure("engine", tmp_path)
    logger.info("before")
    with applog.run("SN-1_20261122"):
        logger.warning("within")
    assert " INFO    [-] calstation.tests: before\n" in text(tmp_path)
    assert " WARNING [SN-1_20261122] calstation.tests: within\n" in text(tmp_path)
    (path,) = tmp_path.glob("*.log")
    assert path.name.startswith("engine_")
    assert str(os.getpid()) in path.name


def test_process_without_log_lines_creates_no_file(tmp_path: Path) -> None:
    applog.configure("cli", tmp_path)
    assert not list(tmp_path.iterdir())


def test_log_level_is_applied_and_inherited(tmp_path: Path) -> None:
    applog.configure("cli", tmp_path, applog.Level.WARNING)
    applog.configure("engine")  # as a child process does, whose environment names both
    logger.info("too fine")
    logger.error("kept")
    assert "kept" in text(tmp_path)
    assert "too fine" not in text(tmp_path)


def test_empty_folder_in_the_environment_disables_the_log(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(applog.FOLDER, "")
    applog.configure("cli", tmp_path)
    logger.error("nowhere")
    assert not list(tmp_path.iterdir())


def test_folder_that_cannot_be_created_is_ignored(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    applog.configure("cli", tmp_path / "file" / "logs")
    logger.error("nowhere")


def test_oldest_files_are_deleted(tmp_path: Path) -> None:
    for number in range(40):
        (tmp_path / f"cli_20200101T0000{number:02d}_1.log").write_text("", encoding="utf-8")
    other = tmp_path / "engine_20190101T000000_1.log"
    other.write_text("", encoding="utf-8")
    applog.configure("cli", tmp_path)
    kept = sorted(path.name for path in tmp_path.glob("cli_*.log"))
    assert len(kept) == 30
    assert kept[0] == "cli_20200101T000010_1.log"
    assert other.exists()


def test_tracebacks_are_logged(tmp_path: Path) -> None:
    applog.configure("engine", tmp_path)
    try:
        raise ZeroDivisionError("one by zero")
    except ZeroDivisionError:
        logger.exception("a mistake")
    assert "ZeroDivisionError: one by zero" in text(tmp_path)
