"""`calstation validate` writes the record and returns the exit codes of the contract."""

import os
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from calstation.cli.commands import validate as command
from calstation.messages import Text
from calstation.validation import Line, Validation, report

GOOD = Line.compared("disk", "replacement", "runs: /runs", "0", "0", good=True)
BAD = Line.compared("rights", "pin", "", Text("validation.pin_set"), Text("validation.pin_unset"), good=False)
GAP = Line.unchecked("rights", "site", "/site", Text("validation.owner_writes"), Text("validation.no_modes"))


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("CALSTATION_HOME", str(tmp_path / "site"))
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def checks(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Replace the checks by lines."""

    def give(*lines: Line, second: int = 0, numpy: str = "2") -> None:
        versions = {"python": "3.11.7", "numpy": numpy}
        monkeypatch.setattr(report, "identity", lambda: versions)

        def made(progress: Any, check_stopped: Callable[[], None], runs: Path) -> Validation:
            progress(0.5, 12.0, "faults")
            begun = tuple(report.begin_record())
            started = f"2026-11-28T10:48:{second:02}+00:00"
            return Validation("pc", "Linux", "wang", "1.0", versions, started, 90.0, (*begun, *lines))

        monkeypatch.setattr(command, "validate_installation", made)

    return give


@pytest.mark.parametrize(("lines", "code"), [((GOOD,), 0), ((GOOD, BAD), 1), ((GOOD, GAP), 1)])
def test_exit_code_is_the_verdict(calstation, checks, home: Path, lines: tuple[Line, ...], code: int) -> None:
    checks(*lines)
    done = calstation("validate", "--out", home / "out")
    assert done.code == code
    assert {path.name for path in (home / "out").iterdir()} == {
        "validation_20261128T104800Z.json", "validation_20261128T104800Z.pdf", "validation_20261128T104800Z_zh.pdf",
    }  # fmt: skip
    assert "Partial reads in 100 replacements" in done.out
    assert "50% Faults rehearsed" in done.err


def test_an_earlier_record_shows_what_changed(calstation, checks, home: Path) -> None:
    checks(GOOD)
    calstation("validate", "--out", home / "out")
    earlier = home / "out" / "validation_20261128T104800Z.json"
    checks(GOOD, BAD, second=9)
    done = calstation("validate", "--out", home / "out", "--against", earlier, "--json", "-")
    assert [row["check"] for row in done.json["changes"]] == ["verdict", "pin"]
    assert done.code == 1
    earlier.write_text(earlier.read_text(encoding="utf-8").replace('"ok": 2', '"ok": 3'), encoding="utf-8")
    refused = calstation("validate", "--out", home / "out", "--against", earlier)
    assert (refused.code, "was changed after the station signed it" in refused.err) == (2, True)
    assert calstation("check", earlier).code == 2


def test_a_folder_that_cannot_be_written_is_refused_before_the_checks(calstation, home: Path) -> None:
    (home / "out").write_text("", encoding="utf-8")
    assert calstation("validate", "--out", home / "out").code == 2


def test_ctrl_c_writes_no_record(calstation, home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(progress: Any, check_stopped: Callable[[], None], runs: Path) -> Validation:
        os.kill(os.getpid(), signal.SIGINT)
        check_stopped()
        raise AssertionError

    monkeypatch.setattr(command, "validate_installation", interrupted)
    assert calstation("validate", "--out", home / "out").code == 4
    assert not list((home / "out").iterdir())


def test_an_update_is_reported_by_check_and_run(calstation, checks, home: Path) -> None:
    checks(GOOD)
    calstation("validate", "--out", home / "out")
    assert "validation_due" not in calstation("check", "--json", "-").json
    assert "no longer applies" not in calstation("run", "--serial", "?").err
    checks(GOOD, numpy="3")
    assert "no longer applies: numpy 2 → 3" in calstation("run", "--serial", "?").err
    done = calstation("check", "--json", "-")
    assert "numpy 2 → 3" in done.json["validation_due"]
    assert done.json["intact"]
