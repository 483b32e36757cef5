"""A rehearsal that ends otherwise than it must is found; the runs themselves are rehearsed on the virtual bench."""

import os
from dataclasses import replace
from pathlib import Path

import pytest

from calstation.errors import StoppedError
from calstation.messages import Language
from calstation.records import KEY_VARIABLE, audit_path
from calstation.simulation import PlannedRun, RunEvaluation
from calstation.validation import rehearsals
from calstation.validation.document import line_texts
from calstation.validation.rehearsals import CASES, NO_FAULT, Case, Ending, ending_lines, rehearsal_lines

STOP = next(case for case in CASES if case.kind == "operator_stop")
RUN = RunEvaluation(PlannedRun(0, 1, False, ()), "stopped", None, (), (), (), False, 1, 0, 0.0, 0.0, 1.0)
STOPPED = Ending(STOP, RUN, None, None, 0.5)


def failed(ending: Ending) -> set[str]:
    return {line.check for line in ending_lines(ending) if line.state == "failed"}


def test_every_wrong_ending_is_found() -> None:
    assert not failed(STOPPED)
    assert failed(replace(STOPPED, evaluation=replace(RUN, outcome="passed"))) == {"ending"}
    assert failed(replace(STOPPED, evaluation=replace(RUN, outcome="hung"))) == {"ending"}
    assert failed(replace(STOPPED, evaluation=replace(RUN, unsafe=True))) == {"table"}
    assert failed(replace(STOPPED, evaluation=replace(RUN, record_defects=("no log",)))) == {"records"}
    assert failed(replace(STOPPED, stop_s=3.0)) == {"stop"}
    assert failed(replace(STOPPED, stop_s=None)) == {"stop"}
    assert failed(replace(STOPPED, case=Case("interlock", "fault", "table.latched_interlock"))) == {"ending"}


def test_failure_in_real_time_names_the_load_of_the_computer() -> None:
    late = replace(STOPPED, evaluation=replace(RUN, outcome="fault", unsafe=True), stop_s=None)
    lines = {line.check: line for line in ending_lines(late)}
    assert {check for check, line in lines.items() if line.reason is not None} == {"ending", "stop"}
    assert lines["stop"].reason is not None
    texts: tuple[tuple[Language, str], ...] = (("en", "close other programs"), ("zh_CN", "请关闭其他程序"))
    for code, words in texts:
        assert words in line_texts(lines["stop"].to_json(), code)["found"]
    assert not [line for line in ending_lines(STOPPED) if line.reason is not None]
    interlock = replace(STOPPED, case=Case("interlock", "fault", "table.latched_interlock"))
    assert not [line for line in ending_lines(interlock) if line.reason is not None]


def test_only_the_run_without_a_fault_may_pass() -> None:
    assert [case.kind for case in CASES if case.outcome == "passed"] == [NO_FAULT]


@pytest.mark.long
def test_rehearsals_leave_the_site_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CALSTATION_HOME", str(tmp_path / "site"))
    monkeypatch.setenv(KEY_VARIABLE, str(tmp_path / "key"))
    chosen = [case for case in CASES if case.kind in (NO_FAULT, "operator_stop", "interlock")]
    monkeypatch.setattr(rehearsals, "CASES", chosen)
    lines = list(rehearsal_lines(lambda: None))
    assert not [line for line in lines if line.state != "ok"]
    assert {line.check for line in lines} == {"ending", "table", "records", "stop", "online", "registers"}
    assert (os.environ["CALSTATION_HOME"], os.environ[KEY_VARIABLE]) == (str(tmp_path / "site"), str(tmp_path / "key"))
    assert not audit_path(tmp_path / "site").exists()


@pytest.mark.long
def test_rehearsals_stop(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rehearsals, "CASES", CASES[:1])
    calls: list[int] = []

    def check_stopped() -> None:
        calls.append(1)
        if len(calls) > 10:
            raise StoppedError("cli.aborted")

    with pytest.raises(StoppedError):
        list(rehearsal_lines(check_stopped))
