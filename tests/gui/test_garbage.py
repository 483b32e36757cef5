"""Garbage of the window's process is collected in the thread of the window, and nowhere else."""

import gc
import threading
import weakref
from collections.abc import Iterator
from typing import Any

import pytest
from PySide6.QtWidgets import QWidget
from pytestqt.qtbot import QtBot

from calstation.gui.shell.main_window import MainWindow


@pytest.fixture
def collecting_threads() -> Iterator[set[str]]:
    """The names of the threads that have collected garbage."""
    names: set[str] = set()

    def note(_phase: str, _info: dict[str, Any]) -> None:
        names.add(threading.current_thread().name)

    gc.callbacks.append(note)
    yield names
    gc.callbacks.remove(note)


def test_no_other_thread_deletes_a_widget(window: MainWindow, qtbot: QtBot, collecting_threads: set[str]) -> None:
    widget = QWidget()
    widget.itself = widget  # type: ignore[attr-defined]  # a cycle, which only the garbage collector can delete
    there = weakref.ref(widget)
    del widget

    kept: list[list[object]] = []  # a collection is due for living objects only, not for those that came and went

    def create_objects() -> None:
        kept.extend([] for _ in range(100_000))

    thread = threading.Thread(target=create_objects, name="reader")
    thread.start()
    thread.join()
    assert there() is not None
    assert "reader" not in collecting_threads

    qtbot.waitUntil(lambda: there() is None, timeout=30_000)
    assert collecting_threads == {threading.main_thread().name}
