"""The record of a validation: verdict, signature, differences, documents in two languages, and when it is due."""

import io
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from pypdf import PdfReader

from calstation.errors import InputError
from calstation.messages import Text
from calstation.records import audit_path
from calstation.reports import verify_certificate
from calstation.validation import (
    Line,
    Validation,
    compare,
    differences,
    read_validation,
    report,
    save_validation,
    validation_due,
    write_documents,
)
from calstation.validation.lines import guarded, verdict_of

GOOD = Line.compared("disk", "replacement", "runs: /runs", "0", "0", good=True)
BAD = Line.compared(
    "installation", "package", "numpy", Text.of("validation.version", required="~=2.4"), "3.0", good=False
)
GAP = Line.unchecked("rights", "site", "/site", Text("validation.owner_writes"), Text("validation.no_modes"))
OUTSIDE = Line.unchecked("scope", "people", "", "", Text("validation.outside_people"), required=False)
TIMED = Line.measurement("time", "command", "", Text.of("validation.at_most_s", seconds="10"), "1.0 s", good=True)
VERSIONS = {"python": "3.11.7", "calstation": "1.0", "numpy": "2.4.6"}


@pytest.fixture(autouse=True)
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "site"
    monkeypatch.setenv("CALSTATION_HOME", str(folder))
    return folder


def validation(*lines: Line, recorded: bool = True) -> Validation:
    begun = list(report.begin_record()) if recorded else []
    return Validation("pc", "Linux", "wang", "1.0", VERSIONS, "2026-11-28T10:48:09+00:00", 90.0, (*begun, *lines))


def saved(made: Validation, folder: Path) -> Path:
    files, _ = write_documents(made)
    save_validation(made, files, folder)
    return folder / f"{made.name}.json"


def test_verdict_needs_every_required_check() -> None:
    assert verdict_of([GOOD, OUTSIDE]) == "passed"
    assert verdict_of([GOOD, GAP]) == "incomplete"
    assert verdict_of([GOOD, GAP, BAD]) == "failed"


def test_an_error_within_a_check_is_a_failed_line() -> None:
    def full() -> Any:
        yield GOOD
        raise OSError(28, "No space left")

    lines = list(guarded("disk", "writing", "runs", full))
    assert [line.state for line in lines] == ["ok", "failed"]
    assert lines[1].reason == Text("os.disk_full")


def test_a_check_that_a_damaged_package_ends_is_a_failed_line() -> None:
    def damaged() -> Any:
        yield GOOD
        raise AttributeError("module 'numpy' has no attribute 'array'")

    lines = list(guarded("calculation", "solution", "gimbal", damaged))
    assert [line.state for line in lines] == ["ok", "failed"]
    assert "no attribute 'array'" in str(lines[1].reason)


def test_the_record_is_signed_and_in_the_audit_trail(tmp_path: Path) -> None:
    path = saved(validation(GOOD, OUTSIDE), tmp_path / "out")
    data = read_validation(path)
    assert (data["verdict"], data["counts"]) == ("passed", {"ok": 2, "failed": 0, "not_checked": 1})
    for name in (path.name, path.with_suffix(".pdf").name, f"{path.stem}_zh.pdf"):
        assert verify_certificate(path.parent / name).intact
    path.with_suffix(".pdf").write_bytes(path.with_suffix(".pdf").read_bytes() + b" ")
    assert not verify_certificate(path.with_suffix(".pdf")).intact


@pytest.mark.parametrize(
    "change",
    [
        lambda data: data.update(verdict="passed"),
        lambda data: data["lines"].pop(),
        lambda data: data["lines"][-1].update(state="ok"),
        lambda data: data.update(signature="0" * 128),
        lambda data: data.update(signature=None),
        lambda data: data.update(key="ab"),
    ],
)
def test_an_altered_record_is_refused(tmp_path: Path, change: Callable[[dict[str, Any]], None]) -> None:
    path = saved(validation(GOOD, BAD), tmp_path / "out")
    data = json.loads(path.read_bytes())
    change(data)
    path.write_text(json.dumps(data), encoding="utf-8")
    with pytest.raises(InputError) as error:
        read_validation(path)
    assert error.value.code == "validation.altered"
    assert not verify_certificate(path).intact


def test_another_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text("[1]", encoding="utf-8")
    with pytest.raises(InputError) as error:
        read_validation(tmp_path / "a.json")
    assert error.value.code == "validation.not_a_validation"


def test_differences_show_versions_results_and_verdict_but_not_measured_times(tmp_path: Path) -> None:
    good = replace(BAD, found="2.4.6", state="ok")
    earlier = saved(validation(good, TIMED, GAP), tmp_path / "out")
    now = compare(replace(validation(BAD, replace(TIMED, found="2.0 s"), OUTSIDE), software="1.1"), earlier)
    rows = {(row["check"], row["subject"]): row for row in now.changes}
    assert set(rows) == {
        ("software", ""), ("verdict", ""), ("package", "numpy"), ("site", "/site"), ("people", ""),
    }  # fmt: skip
    assert (rows["package", "numpy"]["before"]["found"], rows["package", "numpy"]["after"]["found"]) == ("2.4.6", "3.0")
    assert (rows["site", "/site"]["after"], rows["people", ""]["before"]) == (None, None)
    slow = replace(TIMED, found="20 s", state="failed")
    before, after = ({**validation(line).to_json(), "key": ""} for line in (TIMED, slow))
    assert [row["check"] for row in differences(before, after)] == ["verdict", "command"]


def test_a_record_of_another_station_is_named_by_its_key(
    site: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    earlier = saved(validation(GOOD), tmp_path / "out")
    monkeypatch.setenv("CALSTATION_HOME", str(tmp_path / "other"))
    assert [row["check"] for row in compare(validation(GOOD), earlier).changes] == ["key"]


def test_the_documents_state_every_line_in_both_languages(tmp_path: Path) -> None:
    earlier = saved(validation(GOOD), tmp_path / "out")
    made = compare(validation(GOOD, BAD, GAP, OUTSIDE, TIMED), earlier)
    files, unsigned = write_documents(made)
    assert unsigned is None
    pages = {name: PdfReader(io.BytesIO(content)) for name, content in files.items() if name.endswith(".pdf")}
    english, chinese = ("".join(page.extract_text() for page in pdf.pages) for pdf in pages.values())
    for text in ("Validation of the calibration software", "Failed", "Not checked, although required", "numpy", "3.0"):
        assert text in english
    assert "通过" in chinese.partition("相对以下记录的变化")[2].partition("numpy")[0]  # the former verdict
    for text in ("校准软件确认", "未通过", "应检查而未检查", "numpy", "未检查"):
        assert text in chinese
    (attached,) = pages[f"{made.name}.pdf"].attachments.values()
    assert json.loads(attached[0])["signature"] == json.loads(files[f"{made.name}.json"])["signature"]


def test_a_site_that_cannot_be_written_gives_an_unsigned_record_that_failed(site: Path, tmp_path: Path) -> None:
    site.write_text("not a folder", encoding="utf-8")
    lines = list(guarded("rights", "recorded", "", report.begin_record))
    assert [line.state for line in lines] == ["failed"]
    made = validation(*lines, recorded=False)
    files, unsigned = write_documents(made)
    assert (made.verdict, json.loads(files[f"{made.name}.json"])["signature"]) == ("failed", None)
    assert unsigned is not None
    save_validation(made, files, tmp_path / "out")


def test_a_changed_audit_trail_is_not_signed_over(site: Path) -> None:
    made = validation(GOOD)
    audit_path(site).write_bytes(audit_path(site).read_bytes().replace(b"validation_begun", b"validation_began"))
    files, unsigned = write_documents(made)
    assert unsigned is not None
    assert json.loads(files[f"{made.name}.json"])["signature"] is None


def test_an_update_makes_a_validation_due(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(report, "identity", lambda: VERSIONS)
    assert validation_due() is None
    saved(validation(GOOD), tmp_path / "out")
    assert validation_due() is None
    monkeypatch.setattr(report, "identity", lambda: {**VERSIONS, "numpy": "2.4.7"})
    due = validation_due()
    assert due is not None
    assert "numpy 2.4.6 → 2.4.7" in str(due)
    monkeypatch.setattr(report, "identity", lambda: VERSIONS)
    saved(replace(validation(GOOD, BAD), started_utc="2026-11-28T10:49:00+00:00"), tmp_path / "out")
    due = validation_due()
    assert due is not None
    assert due.code == "validation.not_passed"
