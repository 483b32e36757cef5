"""Errors about logs and ranges are shown in the language of the window, without command-line options."""

import re
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from PySide6.QtWidgets import QApplication

from calstation.errors import InputError
from calstation.gui.text import language, say
from calstation.results import resolve
from tests.cli.conftest import HEADER, six_position_rows, write_log

Maker = Callable[[Path], tuple[Path, tuple[str, ...] | None, int | None, int | None]]


def _csv(change: Callable[[list[str]], list[str]], header: str = HEADER) -> Maker:
    def make(folder: Path) -> tuple[Path, None, None, None]:
        return write_log(folder, change(six_position_rows(2.0)), header), None, None, None

    return make


def _cell(row: int, column: int, text: str) -> Callable[[list[str]], list[str]]:
    def change(rows: list[str]) -> list[str]:
        cells = rows[row].split(",")
        cells[column] = text
        return [*rows[:row], ",".join(cells), *rows[row + 1 :]]

    return change


def _stage(name: str) -> Callable[[list[str]], list[str]]:
    return lambda rows: [row.replace("six_position", name) for row in rows]


def _range(stages: tuple[str, ...] | None, first: int | None, last: int | None) -> Maker:
    return lambda folder: (write_log(folder, six_position_rows(2.0)), stages, first, last)


def _file(name: str, text: str) -> Maker:
    def make(folder: Path) -> tuple[Path, None, None, None]:
        (folder / name).write_text(text, "utf-8")
        return folder / name, None, None, None

    return make


WRONG: dict[str, Maker] = {
    "nothing there": lambda folder: (folder / "none.h5", None, None, None),
    "another kind": _file("notes.txt", "x"),
    "damaged": _file("broken.h5", "x"),
    "no toml": _file("alone.csv", "seq"),
    "no column": _csv(lambda rows: rows, HEADER.replace("gyro_y", "gyroy")),
    "a word": _csv(_cell(30, 3, "abc")),
    "an empty cell": _csv(_cell(30, 3, "")),
    "a cell too many": _csv(lambda rows: [*rows[:9], rows[9] + ",1", *rows[10:]]),
    "repeated": _csv(lambda rows: [*rows[:9], rows[8], *rows[9:]]),
    "only a header": _csv(lambda rows: []),
    "no such range": _range(None, 90_000, 99_999),
    "too short": _range(None, 0, 200),
    "not that stage": _range(("rate",), None, None),
    "no turn": _csv(_stage("rate")),
    "no rest": _csv(lambda rows: _stage("excitation")(rows[:20])),
    "no stage": _csv(_stage("")),
    "twice": _csv(lambda rows: [*rows[:50], *_stage("rate")(rows[50:90]), *rows[90:]]),
}


@pytest.fixture
def chinese(qapp: QApplication) -> Iterator[None]:
    """Chinese as the language of the window."""
    language.use("zh_CN")
    yield
    language.use("en")


def error_of(make: Maker, folder: Path) -> str:
    """Return the error in the current language of the window."""
    path, stages, first, last = make(folder)
    with pytest.raises(InputError) as error:
        resolve(path, stages, first, last)
    return say(error.value.as_text)


@pytest.mark.parametrize("make", WRONG.values(), ids=WRONG)
def test_error_is_a_sentence_without_command_line_options(make: Maker, tmp_path: Path, qapp: QApplication) -> None:
    text = error_of(make, tmp_path)
    assert "--" not in text
    assert text.endswith((".", "?"))


@pytest.mark.parametrize("make", WRONG.values(), ids=WRONG)
def test_an_error_is_translated_to_chinese(make: Maker, tmp_path: Path, chinese: None) -> None:
    text = error_of(make, tmp_path)
    assert len(re.findall(r"[\u4e00-\u9fff]", text)) >= 6, text
    assert text.endswith(("。", "？"))
