"""Errors, events and terms from the catalogue are shown in the language of the window."""

from collections.abc import Iterator

import pytest
from PySide6.QtWidgets import QApplication

from calstation.errors import DeviceFaultError
from calstation.gui.text import duration_text, fault_text, language, say, step_sentence, term
from calstation.sequencer import Fault


@pytest.fixture(autouse=True)
def english(qapp: QApplication) -> Iterator[None]:
    yield
    language.use("en")


def test_error_shows_source_reason_and_remedy_in_both_languages() -> None:
    fault = Fault.of(DeviceFaultError("program.internal", detail="KeyError: 3"))
    text = fault_text(fault)
    assert text.source == "Program"
    assert text.text == "Internal error: KeyError: 3."
    assert text.remedy.startswith("Start the run again.")
    language.use("zh_CN")
    text = fault_text(fault)
    assert text.source == "程序"
    assert text.text == "程序内部错误：KeyError: 3。"


def test_fault_without_a_code_is_shown_unchanged() -> None:
    assert fault_text(Fault("internal", "free text", 3)).text == "free text"


def test_steps_events_and_terms_follow_the_language() -> None:
    rest = ("dwell", ("turn_about", "x", 90.0))
    assert step_sentence(*rest) == "Turning about x by 90°  ·  Resting"
    assert term("stage", "six_position") == "Six positions"
    language.use("zh_CN")
    assert step_sentence(*rest) == "绕 x 轴转动 90°  ·  静止采集"
    assert term("stage", "six_position") == "六位置"
    assert say("event.step_repeated", reason="gap", attempt=2) == "这一步已重做（丢数），第 2 次。"


def test_duration_shows_hours_only_if_needed() -> None:
    assert [duration_text(seconds) for seconds in (0.4, 75.0, 3675.0)] == ["0:00", "1:15", "1:01:15"]
