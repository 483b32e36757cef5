"""The window after a power failure in a run over temperature: nobody knows how cold the chamber is."""

import pytest
from PySide6.QtWidgets import QPushButton

from calstation.errors import InputError
from calstation.gui.operator.advice import next_action
from calstation.results import History, Result
from calstation.runs import close_incomplete_job, find_chamber_left, finish_incomplete
from calstation.sequencer import Event, Message, PointCompleted, StepStarted
from tests.dead_logs import write_dead_log
from tests.gui.conftest import RESULT, Operator
from tests.helpers import ignore_progress

CHAMBER = {"chamber": {"profile": "virtual_chamber"}}
SOAK = StepStarted("temperature", 1, "soak", ("soak", -40.0, 1.0, 7.0))
OPEN = Message("chamber_may_be_opened", {"air_c": 23.0, "unit_c": 22.0})
UNKNOWN = Message("chamber_unknown", {"ambient_c": 23.0})


def die(operator: Operator, *events: Event, solved: int = 1) -> None:
    """Store the log of a run that was killed at a station with a chamber."""
    operator.site_folder.write(station=CHAMBER)
    write_dead_log(operator.window.app.runs_folder, solved=solved, events=events, station="test bench")
    finish_incomplete(operator.window.app.runs_folder)


@pytest.mark.parametrize(
    ("language", "badge", "reading", "title", "why", "offer"),
    [
        (
            "en",
            "KEEP CHAMBER CLOSED",
            "The program is reading the runs",
            "Keep the chamber closed: its temperature is not known",
            "Look at the chamber, then press “I looked at the chamber”.",
            "SN-000003 was interrupted in stage 2",
        ),
        (
            "zh_CN",
            "请勿打开温箱",
            "正在读取标定记录",
            "请勿打开温箱：其温度未知",
            "请先查看温箱，再按“已查看温箱”。",
            "SN-000003 在第 2 阶段",
        ),
    ],
)
def test_chamber_of_a_run_that_died_must_be_looked_at_before_anything_else(
    operator: Operator, language: str, badge: str, reading: str, title: str, why: str, offer: str
) -> None:
    app, page = operator.window.app, operator.window.operator_page
    die(operator, SOAK)
    app.set_language(language)
    start = operator.widget("start_button", QPushButton)
    operator.scan("SN-000042")
    assert start.isEnabled()
    page._starting.interrupted.recover()
    assert not start.isEnabled(), "the runs have not been read yet"
    assert app.run.why_not_start == "operator.chamber_unchecked"
    assert reading in operator.message
    assert badge in operator.says().split("\n")
    assert not page._loading.isVisible(), "its steps open the chamber"
    operator.until(lambda: title in operator.says())
    assert not start.isEnabled()
    assert start.toolTip() == why
    assert offer not in operator.says(), "nothing is resumed before"
    operator.press("operator_page_chamber_notice_close")
    operator.until(lambda: offer in operator.says())
    assert title not in operator.says()
    operator.press("later_choice")
    assert start.isEnabled()
    page._starting.interrupted.recover()
    operator.until(lambda: offer in operator.says())
    assert title not in operator.says(), "it has been looked at after this run"


def test_chamber_must_be_looked_at_if_the_runs_cannot_be_read(
    operator: Operator, monkeypatch: pytest.MonkeyPatch
) -> None:
    die(operator)
    interrupted = operator.window.operator_page._starting.interrupted
    monkeypatch.setattr(interrupted._chamber, "start", lambda *_: None)
    interrupted.recover()
    assert operator.window.app.run.why_not_start == "operator.chamber_unchecked"
    interrupted._chamber_not_found(InputError("result.unreadable", file="x", reason="x"))
    operator.until(lambda: "its temperature is not known" in operator.says())
    assert not operator.widget("start_button", QPushButton).isEnabled()
    operator.press("operator_page_chamber_notice_close")
    assert operator.window.app.run.why_not_start == ""


@pytest.mark.long
def test_chamber_is_named_although_nothing_can_be_resumed(operator: Operator) -> None:
    die(operator, SOAK, solved=0)
    operator.window.operator_page._starting.interrupted.recover()
    operator.until(lambda: "its temperature is not known" in operator.says())
    operator.press("operator_page_chamber_notice_close")
    operator.until_no_job()
    operator.until(lambda: "interrupted" not in operator.says())


def test_engineer_starts_nothing_before_the_chamber_was_looked_at(operator: Operator) -> None:
    run = operator.window.app.run
    operator.window.show_page("engineer_page")
    start = operator.widget("engineer_start_button", QPushButton)
    run.set_chamber_left(None)
    assert "reading the runs" in start.toolTip()
    run.set_chamber_left(True)
    assert "Look at the chamber" in start.toolTip()
    run.acknowledge_chamber()
    assert "chamber" not in start.toolTip()


@pytest.mark.parametrize(
    ("events", "left"),
    [((), False), ((SOAK,), True), ((SOAK, OPEN), False), ((SOAK, UNKNOWN), True)],
)
def test_log_says_whether_the_chamber_was_left(operator: Operator, events: tuple[Event, ...], *, left: bool) -> None:
    die(operator, *events)
    found = find_chamber_left(ignore_progress, operator.window.app.runs_folder, operator.site_folder.station)
    assert bool(found) is left


@pytest.mark.parametrize("what", ["closed", "without log", "without files"])
def test_chamber_was_left_also_by_a_run_that_was_closed_or_whose_log_is_missing(operator: Operator, what: str) -> None:
    runs = operator.window.app.runs_folder
    die(operator, SOAK)
    (log,) = runs.glob("*.h5")
    History(runs).refresh()
    if what == "closed":
        close_incomplete_job(ignore_progress, (log,), "li")
    else:
        log.unlink()
    if what == "without files":
        log.with_suffix(".json").unlink()
    assert find_chamber_left(ignore_progress, runs, operator.site_folder.station)


@pytest.mark.parametrize(
    ("language", "resume", "stages", "temperatures"),
    [
        ("en", "Resume at temperature 3", "The completed stages are kept", "The completed temperatures are kept"),
        ("zh_CN", "从第 3 个温度点继续", "已完成的阶段保留", "已完成的温度点保留"),
    ],
)
def test_temperatures_are_named_where_no_stage_was_completed(
    operator: Operator, language: str, resume: str, stages: str, temperatures: str
) -> None:
    operator.window.app.set_language(language)
    die(operator, *(PointCompleted("rate", index, -40.0, 5 * index) for index in (1, 2)), solved=0)
    operator.window.operator_page._starting.interrupted.recover()
    operator.until(lambda: operator.window.operator_page.notice.asking)
    assert operator.widget("resume_choice", QPushButton).text() == resume
    for finished, kept in (([], temperatures), (["rate"], stages)):
        content = {**RESULT, "outcome": "stopped", "advice": "resume", "stages": [], "finished_stages": finished}
        assert next_action("stopped", Result.from_json(content)).startswith(kept)
