"""A view starts background jobs, delivers their results, and reports their failures in its notice bar."""

import time
from typing import Any

import pytest
from pytestqt.qtbot import QtBot

from calstation.errors import CalstationError
from calstation.gui.state import AppContext, JobView
from calstation.gui.text import language
from calstation.gui.widgets import JobRow
from calstation.jobs import ProgressCallback

WAIT = 60_000


def add(report: ProgressCallback, first: int, second: int = 0) -> int:
    """Return a sum."""
    return first + second


def fail(report: ProgressCallback) -> None:
    """Fail with a code of the catalogue."""
    raise CalstationError("program.internal", detail="no sum")


def wait(report: ProgressCallback, seconds: float) -> str:
    """Return after this time, s."""
    time.sleep(seconds)
    return "waited"


@pytest.fixture
def view(app: AppContext, qtbot: QtBot) -> JobView:
    """A view with a notice bar."""
    job_view = JobView(app, "sum")
    qtbot.addWidget(job_view)
    qtbot.addWidget(job_view.notice)
    return job_view


def test_result_is_delivered_and_the_view_is_busy_until_then(view: JobView, qtbot: QtBot) -> None:
    results: list[Any] = []
    states: list[bool] = []
    job = view.job(add, results.append)
    view.busy_changed.connect(lambda: states.append(view.busy))
    job.start(2, second=3)
    qtbot.waitUntil(lambda: results == [5], timeout=WAIT)
    assert states == [True, False]
    general = view.job(None, results.append)
    general.start(add, 4)
    qtbot.waitUntil(lambda: results == [5, 4], timeout=WAIT)


def test_remaining_time_of_a_job_is_not_cut_in_a_narrow_row(view: JobView, qtbot: QtBot) -> None:
    row = JobRow(view.job(add), words="engineer.solving")
    qtbot.addWidget(row)
    row.show()
    for code in ("en", "zh_CN"):
        language.use(code)
        row.watch.progress.emit(0.999, 36_000.0)
        row.resize(100, 44)
        qtbot.wait(20)
        for text in (row.remaining_label, row._text_label):
            assert text.width() >= text.fontMetrics().horizontalAdvance(text.text()), text.text()
    language.use("en")


def test_failure_is_reported_under_its_title(view: JobView, qtbot: QtBot) -> None:
    errors: list[CalstationError] = []
    view.job(fail, failure="common.runs_not_read", failed=errors.append).start()
    qtbot.waitUntil(lambda: not view.busy, timeout=WAIT)
    assert view.notice.title_label.text() == "The runs could not be read"
    assert "no sum" in view.notice.text_label.text()
    assert [error.code for error in errors] == ["program.internal"]


def test_newer_job_replaces_one_that_waits(view: JobView, qtbot: QtBot) -> None:
    results: list[Any] = []
    view.job(wait).start(0.3)  # keeps the worker busy
    job = view.job(add, results.append)
    job.start(1)
    first = job.job
    job.start(2)
    assert first is not None
    assert first.state == "cancelled"
    qtbot.waitUntil(lambda: not view.busy, timeout=WAIT)
    assert results == [2]


def test_job_that_uses_a_device_is_not_dropped(view: JobView, qtbot: QtBot) -> None:
    view.job(wait).start(0.3)
    job = view.job(add, cancellable=False)
    job.start(1)
    first = job.job
    job.start(2)
    assert first is not None
    qtbot.waitUntil(lambda: not view.busy, timeout=WAIT)
    assert first.state == "done"
