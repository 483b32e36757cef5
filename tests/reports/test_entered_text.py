"""Control characters in entered text, as sent by some badge readers, do not reach certificates."""

from pathlib import Path

import pytest

from calstation.cli.app import run_app
from calstation.config import Person, RunRequest, plain_text
from calstation.reports import ReportRequest
from calstation.results import load_result, override_result
from tests.helpers import ignore_progress
from tests.results.test_override import failed, home
from tests.shared_runs import SharedRuns

__all__ = ["failed", "home"]

ENTERED = "\x02B0001\x1e\r"


def test_control_characters_are_removed_from_operator_and_reason() -> None:
    request = RunRequest("SN-1", operator=ENTERED, override_standard="the\x00 golden\nunit \ud800")
    assert (request.operator, request.override_standard) == ("B0001", "the  golden unit")
    assert RunRequest("SN-1").operator is None


def test_control_characters_are_removed_from_badges_and_release_reasons(failed: Path) -> None:
    people = Person(ENTERED, "111111"), Person("B0002\x03", "222222")
    made = override_result(ignore_progress, failed, "scratch\x0bonly", *people)
    assert (made.by, made.confirmed_by, made.why) == ("Li Na (B0001)", "B0002", "scratch only")
    assert load_result(failed).override == made
    assert ReportRequest(failed, failed, revise="spelling\x07").revise == "spelling"


def test_text_in_any_language_is_kept() -> None:
    text = "返修 – “Ärmel”, Ω₂ 🙂\u3000x"
    assert plain_text(text) == text


@pytest.mark.long
def test_control_characters_are_removed_from_a_revision_reason(tmp_path: Path, shared_runs: SharedRuns) -> None:
    result = Path(shared_runs.passed(tmp_path / "run", "six_position").result_file)
    assert run_app(["report", str(result), "-o", str(tmp_path / "a.pdf")]) == 0
    revision = ["-o", str(tmp_path / "b.pdf"), "--dcc", str(tmp_path / "b.xml")]
    assert run_app(["report", str(result), *revision, "--revise", "name\x0bof the\x1bcustomer"]) == 0
    assert "name of the customer" in (tmp_path / "b.xml").read_text("utf-8")
