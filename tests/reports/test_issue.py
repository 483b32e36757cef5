"""Certificates are numbered, dated and recorded; none is overwritten or issued twice with different content."""

import json
import shutil
import subprocess
import threading
import tomllib
from dataclasses import replace
from datetime import UTC, date, datetime, timedelta
from pathlib import Path
from typing import Any

import pypdf
import pytest
import tomli_w

from calstation.cli.app import run_app
from calstation.config import Person, access, load_configuration, site_folder
from calstation.config.library import shipped_folder
from calstation.devices.imu import TransferOutcome, TransferStep
from calstation.errors import InputError
from calstation.messages import Language, event_text, sentence
from calstation.records import audit_path, open_log, read_audit, read_reports, report_file
from calstation.registers import journal
from calstation.reports import certificate_number, issue, issue_state, issued_certificates
from calstation.reports.pdf import typeset
from calstation.results import Result, override_result
from calstation.runs import closing
from calstation.runs.closing import report_command, start_reports
from calstation.sequencer import Event, Message
from tests.helpers import ignore_progress, raises_code
from tests.reports.certificates import Made, make, with_laboratory
from tests.shared_runs import SharedRuns
from tests.site_folder import SiteFolder


@pytest.fixture
def gimbal(shared_runs: SharedRuns, tmp_path: Path) -> Made:
    """A run with a short analysis whose result refers to the log in this folder."""
    made = make(shared_runs, tmp_path / "site", "gimbal")
    result = json.loads(made.result_file.read_text(encoding="utf-8"))
    result["log"]["file"] = str(made.result_file.with_suffix(".h5"))
    made.result_file.write_text(json.dumps(result), encoding="utf-8")
    return made


def report(*arguments: object) -> int:
    return run_app(["report", *map(str, arguments)])


def changes_of(result_file: Path) -> tuple[str, ...]:
    """Return what has changed since the last certificate of a result."""
    return issue_state(ignore_progress, result_file, None, "en").changes


def copied(result_file: Path, folder: Path) -> Path:
    """Return a copy of a result and its log in another folder."""
    folder.mkdir()
    log = shutil.copy(result_file.with_suffix(".h5"), folder)
    result = json.loads(result_file.read_text(encoding="utf-8"))
    result["log"]["file"] = str(log)
    copy = folder / result_file.name
    copy.write_text(json.dumps(result), encoding="utf-8")
    return copy


def first_page(path: Path) -> str:
    return " ".join(pypdf.PdfReader(path).pages[0].extract_text().split())


@pytest.mark.long
@pytest.mark.parametrize(
    ("language", "text"), [("en", "calstation check does not find"), ("zh_CN", "calstation check 找不到")]
)
def test_certificate_where_a_verification_does_not_look_is_noted(
    gimbal: Made,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    language: str,
    text: str,
) -> None:
    monkeypatch.setattr("calstation.cli.text.LANGUAGE", language)
    runs, outside = gimbal.result_file.parent, tmp_path / f"{language}.pdf"
    assert report(gimbal.result_file, "-o", runs / f"{language}.pdf") == 0
    assert "".join(text.split()) not in "".join(capsys.readouterr().err.split())
    assert report(gimbal.result_file, "-o", outside) == 0
    noted = "".join(capsys.readouterr().err.split())
    assert "".join(text.split()) in noted
    assert outside.name in noted


@pytest.mark.long
def test_result_and_log_give_the_same_certificate_only_once(gimbal: Made, capsys: pytest.CaptureFixture[str]) -> None:
    first, second = gimbal.folder / "first.pdf", gimbal.folder / "second.pdf"
    assert report(gimbal.result_file, "-o", first) == 0
    number = gimbal.result_file.stem
    assert f"certificate {number} of {gimbal.certificate.issued}, PASS" in " ".join(capsys.readouterr().err.split())
    assert report(gimbal.result_file.with_suffix(".h5"), "-o", second) == 0
    assert first.read_bytes() == second.read_bytes()
    assert report(gimbal.result_file, "-o", first) == 0  # the same bytes may be written again
    (record,) = read_reports(gimbal.result_file.parent)
    assert (record.number, record.revision, record.reason) == (number, 0, None)
    assert report(gimbal.result_file, "-o", first, "--language", "zh") == 2
    assert "never overwritten" in capsys.readouterr().err
    assert first.read_bytes() == second.read_bytes()
    assert report(gimbal.result_file, "-o", gimbal.folder / "zh.pdf", "--language", "zh") == 0
    assert len(read_reports(gimbal.result_file.parent)) == 1


@pytest.mark.long
def test_another_date_requires_a_revision_that_states_the_replaced_certificate(
    gimbal: Made, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out = gimbal.folder / "first.pdf"
    assert report(gimbal.result_file, "-o", out, "--revise", "too early") == 2
    assert "has not been issued yet" in capsys.readouterr().err
    assert report(gimbal.result_file, "-o", out) == 0
    revised, again = gimbal.folder / "revised.pdf", gimbal.folder / "again.pdf"
    monkeypatch.setattr(issue, "_today", lambda: date(2030, 1, 3))
    assert report(gimbal.result_file, "-o", revised, "--issued", "2030-01-02") == 2
    assert '--revise "REASON"' in capsys.readouterr().err
    assert report(gimbal.result_file, "-o", revised, "--issued", "2030-01-02", "--revise", "Wrong customer") == 0
    number, issued = gimbal.result_file.stem, gimbal.certificate.issued
    text = first_page(revised)
    assert f"{number}-R1" in text
    assert f"Replaces certificate {number} ({issued}). Reason: Wrong customer" in text
    assert "2030-01-02" in text
    assert report(gimbal.result_file, "-o", again) == 0
    assert again.read_bytes() == revised.read_bytes()
    assert report(gimbal.result_file, "-o", gimbal.folder / "r2.pdf", "--revise", "Once more") == 0
    last = read_reports(gimbal.result_file.parent)[-1]
    assert (last.revision, last.issued) == (2, "2030-01-03")


@pytest.mark.long
def test_superseded_certificate_is_not_printed_again(
    gimbal: Made, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    first = ("--issued", gimbal.certificate.issued.isoformat())
    assert report(gimbal.result_file, "-o", gimbal.folder / "first.pdf", *first) == 0
    assert report(gimbal.result_file, "-o", gimbal.folder / "r1.pdf", "--revise", "Wrong customer") == 0
    monkeypatch.setattr(issue, "_today", lambda: date(2031, 1, 1))
    assert report(gimbal.result_file, "-o", gimbal.folder / "r2.pdf", "--revise", "Wrong address") == 0
    assert report(gimbal.result_file, "-o", gimbal.folder / "copy.pdf", *first) == 2
    said = " ".join(capsys.readouterr().err.split())
    number = gimbal.result_file.stem
    assert f"{number} is not printed again: {number}-R2 of 2031-01-01 replaces it (Wrong address)" in said
    assert not (gimbal.folder / "copy.pdf").exists()


def test_certificate_date_in_the_future_is_refused(gimbal: Made, capsys: pytest.CaptureFixture[str]) -> None:
    assert report(gimbal.result_file, "-o", gimbal.folder / "x.pdf", "--issued", "2099-12-31") == 2
    assert "cannot be issued on 2099-12-31: today is" in " ".join(capsys.readouterr().err.split())


@pytest.mark.long
@pytest.mark.parametrize("lost", ["another folder", "the last line"])
def test_certificate_missing_in_the_folder_is_known_from_the_audit_trail(
    gimbal: Made, lost: str, home: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A copied log, or one whose record was lost, keeps its certificate."""
    first, again = gimbal.folder / "first.pdf", gimbal.folder / "again.pdf"
    assert report(gimbal.result_file, "-o", first) == 0
    result_file = gimbal.result_file
    if lost == "another folder":
        result_file = copied(gimbal.result_file, gimbal.folder / "copy")
    else:
        report_file(result_file.parent).path.unlink()
    assert report(result_file, "-o", again) == 0
    assert again.read_bytes() == first.read_bytes()
    assert report(result_file, "-o", gimbal.folder / "other.pdf", "--received", "2020-01-02") == 2
    assert "was issued on" in " ".join(capsys.readouterr().err.split())
    (event,) = [each for each in read_audit(audit_path(home)).entries if each.event == "certificate"]
    values = event.values
    assert (values["number"], values["revision"], values["issued"]) == (
        result_file.stem, 0, gimbal.certificate.issued.isoformat(),
    )  # fmt: skip
    assert len(str(values["content_sha256"])) == 64


@pytest.mark.long
def test_copies_of_a_log_with_different_certificates_require_a_revision(
    gimbal: Made, home: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """One was issued at another site, on another date of receipt."""
    assert report(gimbal.result_file, "-o", gimbal.folder / "here.pdf") == 0
    copy = copied(gimbal.result_file, gimbal.folder / "copy")
    monkeypatch.setenv("CALSTATION_HOME", str(tmp_path / "other site"))
    assert report(copy, "-o", gimbal.folder / "there.pdf", "--received", "2020-01-02") == 0
    monkeypatch.setenv("CALSTATION_HOME", str(home))
    assert report(copy, "-o", gimbal.folder / "again.pdf") == 2
    assert '--revise "REASON"' in capsys.readouterr().err
    assert report(copy, "-o", gimbal.folder / "r1.pdf", "--revise", "Issued twice") == 0
    assert "-R1" in first_page(gimbal.folder / "r1.pdf")


@pytest.mark.long
@pytest.mark.parametrize("reason", ["Wrong customer", "Wrong address"])
def test_one_of_two_simultaneous_revisions_is_refused(
    gimbal: Made, reason: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The second revision starts and ends while the first one is being typeset."""
    assert report(gimbal.result_file, "-o", gimbal.folder / "first.pdf") == 0
    slow, fast = gimbal.folder / "slow.pdf", gimbal.folder / "fast.pdf"

    def interrupted(*arguments: Any) -> bytes:
        monkeypatch.setattr(issue, "typeset", typeset)
        assert report(gimbal.result_file, "-o", fast, "--revise", "Wrong customer") == 0
        return typeset(*arguments)

    monkeypatch.setattr(issue, "typeset", interrupted)
    assert report(gimbal.result_file, "-o", slow, "--revise", reason) == 2
    assert "was issued by another program" in " ".join(capsys.readouterr().err.split())
    assert fast.exists()
    assert not slow.exists()
    assert [each.revision for each in read_reports(gimbal.result_file.parent)] == [0, 1]
    assert report(gimbal.result_file, "-o", slow, "--revise", reason) == 0
    assert f"{gimbal.result_file.stem}-R2" in first_page(slow)


@pytest.mark.long
def test_simultaneous_identical_first_issues_are_recorded_once(gimbal: Made, monkeypatch: pytest.MonkeyPatch) -> None:
    slow, fast = gimbal.folder / "slow.pdf", gimbal.folder / "fast.pdf"

    def interrupted(*arguments: Any) -> bytes:
        monkeypatch.setattr(issue, "typeset", typeset)
        assert report(gimbal.result_file, "-o", fast) == 0
        return typeset(*arguments)

    monkeypatch.setattr(issue, "typeset", interrupted)
    assert report(gimbal.result_file, "-o", slow) == 0
    assert slow.read_bytes() == fast.read_bytes()
    assert len(read_reports(gimbal.result_file.parent)) == 1


@pytest.mark.long
def test_nothing_is_issued_without_its_audit_event(
    gimbal: Made, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out, home = gimbal.folder / "first.pdf", gimbal.folder / "home"
    monkeypatch.setenv("CALSTATION_HOME", str(home))
    audit_path(home).mkdir(parents=True)  # unwritable
    assert report(gimbal.result_file, "-o", out) == 2
    assert "audit" in capsys.readouterr().err
    assert not out.exists()
    assert not read_reports(gimbal.result_file.parent)


def test_certificate_date_before_its_run_is_refused(gimbal: Made, capsys: pytest.CaptureFixture[str]) -> None:
    assert report(gimbal.result_file, "-o", gimbal.folder / "first.pdf", "--issued", "2001-01-01") == 2
    assert "cannot be issued on 2001-01-01" in " ".join(capsys.readouterr().err.split())


class Later(datetime):
    """A clock some years later."""

    @classmethod
    def now(cls, tz: Any = None) -> "Later":
        return cls(2031, 5, 6, 7, 8, 9, tzinfo=UTC)


@pytest.mark.long
def test_release_after_the_certificate_requires_a_later_revision(
    shared_runs: SharedRuns, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    made = make(shared_runs, tmp_path / "site", "failed")
    result_file = copied(made.result_file, made.folder / "copy")
    assert report(result_file, "-o", made.folder / "first.pdf") == 0
    monkeypatch.setattr("calstation.records.evidence.audit.datetime", Later)
    access.set_pin("", "000000")
    assert changes_of(result_file) == ()
    override_result(ignore_progress, result_file, "shock test", Person("wang", "000000"), None)
    assert changes_of(result_file) == ("released",)
    (certificate,) = issued_certificates(ignore_progress, result_file.with_suffix(".h5"), None, "en")
    assert certificate.released_since
    out = made.folder / "r1.pdf"
    assert report(result_file, "-o", out) == 2
    assert "with another result, date of issue" in " ".join(capsys.readouterr().err.split())
    assert report(result_file, "-o", out, "--revise", "released", "--issued", "2030-01-01") == 2
    assert "2031-05-06" in capsys.readouterr().err
    assert report(result_file, "-o", out, "--revise", "  ") == 2
    assert "The revision has no reason" in capsys.readouterr().err
    assert report(result_file, "-o", out, "--revise", " released ") == 0
    (_, last) = read_reports(result_file.parent)
    assert (last.issued, last.reason) == ("2031-05-06", "released")
    assert changes_of(result_file) == ()
    certificates = issued_certificates(ignore_progress, result_file.with_suffix(".h5"), None, "en")
    assert [each.released_since for each in certificates] == [True, False]
    pages = [" ".join(page.extract_text().split()) for page in pypdf.PdfReader(out).pages]
    released = "released although it failed, by wang on 2031-05-06: shock test"
    assert released in pages[0], "at the verdict"
    assert sum(page.count(released) for page in pages) == 2, "and in the remarks"
    assert "–: no version recorded" in " ".join(pages)
    assert report(result_file.with_suffix(".h5"), "-o", made.folder / "log.pdf") == 2
    assert "is not printed again" in " ".join(capsys.readouterr().err.split())


@pytest.mark.long
def test_changed_templates_or_program_version_require_a_revision(
    gimbal: Made, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert report(gimbal.result_file, "-o", gimbal.folder / "first.pdf") == 0
    folder, other = gimbal.folder / "templates", gimbal.folder / "other.pdf"
    folder.mkdir()
    (folder / "note.txt").write_text("of no use to the document", encoding="utf-8")
    assert report(gimbal.result_file, "-o", gimbal.folder / "first.pdf", "--templates", folder) == 0
    texts = (shipped_folder() / "reports" / "texts.toml").read_text(encoding="utf-8")
    (folder / "texts.toml").write_text(texts.replace("Calibration certificate", "Works certificate"), encoding="utf-8")
    assert report(gimbal.result_file, "-o", other, "--templates", folder) == 2
    assert '--revise "REASON"' in capsys.readouterr().err
    assert changes_of(gimbal.result_file) == ()
    shutil.copytree(folder, site_folder() / "reports")
    assert changes_of(gimbal.result_file) == ("content",)
    shutil.rmtree(site_folder() / "reports")
    monkeypatch.setattr(issue, "__version__", "99.0")
    assert changes_of(gimbal.result_file) == ("program",)
    assert report(gimbal.result_file, "-o", other) == 2
    assert '--revise "REASON"' in capsys.readouterr().err
    assert not other.exists()


@pytest.mark.long
def test_a_recording_is_solved_and_certified(gimbal: Made, capsys: pytest.CaptureFixture[str]) -> None:
    csv, out = gimbal.folder / "recording.csv", gimbal.folder / "recording.pdf"
    assert run_app(["export", str(gimbal.result_file.with_suffix(".h5")), "-o", str(csv)]) == 0
    assert report(csv, "-o", out) == 0
    text = " ".join(" ".join(page.extract_text() for page in pypdf.PdfReader(out).pages).split())
    assert "solved again offline" in text
    assert "Certificate recording" in text
    toml = csv.with_suffix(".toml")
    meta = tomllib.loads(toml.read_text(encoding="utf-8"))
    del meta["run"]
    toml.write_text(tomli_w.dumps(meta), encoding="utf-8")
    other = gimbal.folder / "elsewhere"
    other.mkdir()
    for path in (csv, toml):
        shutil.move(path, other)
    assert report(other / "recording.csv", "-o", gimbal.folder / "undated.pdf") == 2
    assert "--issued YYYY-MM-DD" in capsys.readouterr().err
    assert report(other / "recording.csv", "-o", gimbal.folder / "dated.pdf", "--issued", "2026-01-02") == 0
    digest = open_log(other / "recording.csv").facts().sha256
    assert read_reports(other)[0].number == f"recording-{digest[:8]}"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--issued", "tomorrow"), "is not a date"),
        (("--language", "de"), "Choose from en, zh"),
        (("-o", "/nowhere/x.pdf"), "cannot be written"),
    ],
    ids=["date", "language", "folder"],
)
def test_wrong_usage_is_reported(
    arguments: tuple[str, ...], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = () if "-o" in arguments else ("-o", tmp_path / "x.pdf")
    assert report(tmp_path / "x.json", *out, *arguments) == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize(
    "command",
    [
        ("export", "x.h5", "-o", "out/"),
        ("apply", "x.json", "x.h5", "-o", "out/"),
        ("import", "x.csv", "-o", "out/"),
        ("fleet", "export", "1", "-o", "out/"),
        ("report", "x.json", "-o", "x.pdf", "--dcc", "out/"),
        ("report", "x.json", "-o", "missing/out/"),
    ],
    ids=" ".join,
)
def test_slash_at_the_end_means_a_folder(
    command: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run_app(list(command)) == 2
    said = "cannot be written" if "missing/out/" in command else "out/ is a folder; this command writes a file"
    assert said in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "command",
    [
        ("report", "x.json", "-o", "certificates"),
        ("report", "x.json", "-o", "x.pdf", "--dcc", "certificates"),
        ("apply", "x.json", "x.h5", "-o", "certificates"),
        ("design", "-o", "certificates"),
        ("watch", "x.h5", "-o", "certificates"),
        ("fleet", "export", "--database", "sqlite:///x.sqlite", "--version", "1", "-o", "certificates"),
    ],
    ids=" ".join,
)
def test_name_without_suffix_is_neither_a_new_file_nor_a_new_folder(
    command: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run_app(list(command)) == 2
    said = " ".join(capsys.readouterr().err.split())
    assert "certificates is neither a folder nor the name of a file with a suffix. Give a file" in said
    assert list(tmp_path.iterdir()) == []


def test_name_of_an_existing_folder_needs_no_slash(gimbal: Made) -> None:
    folder = gimbal.folder / "existing"
    folder.mkdir()
    assert report(gimbal.result_file, "-o", folder) == 0
    assert [pdf.name for pdf in folder.iterdir()] == [f"{gimbal.result_file.stem}.pdf"]


def test_slash_at_the_end_creates_the_folder_of_the_certificate(gimbal: Made) -> None:
    folder = gimbal.folder / "certificates"
    assert report(gimbal.result_file, "-o", f"{folder}/") == 0
    assert [pdf.name for pdf in folder.iterdir()] == [f"{gimbal.result_file.stem}.pdf"]


@pytest.mark.parametrize(
    ("language", "words"), [("en", "Move or rename this file, then issue"), ("zh_CN", "请移走或重命名此文件")]
)
def test_file_in_place_of_the_folder_has_its_own_remedy(
    gimbal: Made, language: Language, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    request = issue_state(ignore_progress, gimbal.result_file, None, "en").request
    request.out.write_text("a certificate", encoding="utf-8")
    with raises_code(InputError, "report.not_a_folder") as raised:
        issue.issue_certificate(ignore_progress, request)
    assert words in sentence(raised.value.as_text, language)
    assert report(gimbal.result_file, "-o", f"{request.out}/") == 2
    assert "is a file, but must be the folder" in " ".join(capsys.readouterr().err.split())
    with raises_code(InputError, "report.no_folder"):
        issue.issue_certificate(ignore_progress, replace(request, out=gimbal.folder / "unmounted"))


def test_result_requires_its_own_log(gimbal: Made, capsys: pytest.CaptureFixture[str]) -> None:
    log, out = gimbal.result_file.with_suffix(".h5"), gimbal.folder / "x.pdf"
    result = json.loads(gimbal.result_file.read_text(encoding="utf-8"))
    changed = {**result, "log": {**result["log"], "sha256": "0" * 64}}
    gimbal.result_file.write_text(json.dumps(changed), encoding="utf-8")
    assert report(gimbal.result_file, "-o", out) == 2
    assert "its digest differs" in capsys.readouterr().err
    log.unlink()
    assert report(gimbal.result_file, "-o", out) == 2
    assert "is missing" in capsys.readouterr().err


def test_damaged_record_is_reported(gimbal: Made, capsys: pytest.CaptureFixture[str]) -> None:
    assert report(gimbal.result_file, "-o", gimbal.folder / "x.pdf") == 0
    path = report_file(gimbal.result_file.parent).path
    path.write_text(path.read_text(encoding="utf-8").replace('"revision": 0', '"revision": 7') + "\n", encoding="utf-8")
    assert report(gimbal.result_file, "-o", gimbal.folder / "x.pdf") == 2
    assert "record of issued reports is damaged" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("file", "number"),
    [("/runs/SN-1_2.h5", "SN-1_2"), (r"C:\runs\SN-1_2.h5", "SN-1_2"), ("x.1.csv.gz", "x.1"), ("x.csv", "x")],
)
def test_certificate_number_is_the_name_of_the_log(file: str, number: str) -> None:
    result = Result.from_json(
        {
            "schema": "calstation.result/1",
            "unit": {"serial": "x"},
            "stages": [],
            "parameters": {},
            "outcome": "passed",
            "log": {"file": file, "sha256": "0123456789abcdef"},
            "started_utc": "2026-11-23T06:30:00+00:00",
        }
    )
    assert certificate_number(result) == number
    assert certificate_number(result.model_copy(update={"started_utc": None})) == f"{number}-01234567"


@pytest.mark.long
def test_date_of_receipt_is_kept_with_the_certificate(
    gimbal: Made, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def issue(name: str, *options: str) -> int:
        dcc = ("--dcc", str(tmp_path / f"{name}.xml"))
        return run_app(["report", str(gimbal.result_file), "-o", str(tmp_path / f"{name}.pdf"), *dcc, *options])

    begun = gimbal.certificate.days[0]
    late, before = begun + timedelta(days=1), begun - timedelta(days=3)
    assert issue("late", "--received", late.isoformat()) == 2
    assert f"cannot have been received on {late}" in capsys.readouterr().err
    assert issue("first", "--received", before.isoformat()) == 0
    assert issue("again") == 0
    assert (tmp_path / "again.pdf").read_bytes() == (tmp_path / "first.pdf").read_bytes()
    xml = (tmp_path / "first.xml").read_text("utf-8")
    assert f"<dcc:receiptDate>{before}</dcc:receiptDate>" in xml
    assert f"Received {before}" in " ".join(pypdf.PdfReader(tmp_path / "first.pdf").pages[0].extract_text().split())
    assert issue("other", "--received", begun.isoformat()) == 2
    said = " ".join(capsys.readouterr().err.split())
    assert "with another result, date of issue, date of receipt, template or version" in said
    assert "--revise" in said
    assert issue("kept", "--revise", "spelling") == 0
    assert issue("revised", "--revise", "date of receipt", "--received", begun.isoformat()) == 0
    reports = read_reports(gimbal.result_file.parent)
    assert [each.received for each in reports] == [before.isoformat(), before.isoformat(), begun.isoformat()]


@pytest.mark.parametrize(
    ("missing", "report"),
    [
        ("reports", {"folder": "reports"}),
        ("mine", {"folder": ".", "template": "mine"}),
        ("lab.p12", {"folder": ".", "signing": {"certificate": "lab.p12"}}),
    ],
)
def test_missing_report_is_explained_in_the_events(
    site_folder: SiteFolder, missing: str, report: dict[str, Any]
) -> None:
    events: list[Event] = []
    with_laboratory(site_folder, report=report)
    assert report_command(load_configuration(site_folder.request()), Path("SN_1.json"), events.append) == []
    path = str(site_folder.folder / missing)
    assert events == [Message("certificate_not_made", {"path": path})]
    assert f"No certificate was created: {path}, which" in sentence(event_text("certificate_not_made", {"path": path}))
    (site_folder.folder / missing).touch() if "." in missing else (site_folder.folder / missing).mkdir()
    assert report_command(load_configuration(site_folder.request()), Path("SN_1.json"), events.append)
    assert len(events) == 1


def test_unresponsive_network_share_delays_no_verdict(site_folder: SiteFolder, monkeypatch: pytest.MonkeyPatch) -> None:
    goes_on = threading.Event()
    monkeypatch.setattr(closing, "missing_report_paths", lambda *_: [goes_on.wait()])
    monkeypatch.setattr(closing, "_SEARCH_TIMEOUT", 0.0)
    with_laboratory(site_folder, report={"folder": "reports"})
    events: list[Event] = []
    assert report_command(load_configuration(site_folder.request()), Path("SN_1.json"), events.append)
    goes_on.set()
    assert events == []


def test_station_settings_request_reports_of_verdicts(
    site_folder: SiteFolder, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    started: list[Any] = []
    events: list[Event] = []
    monkeypatch.setattr(subprocess, "Popen", lambda command, **options: started.append(command))
    start_reports([report_command(load_configuration(site_folder.request()), Path("SN_1.json"), events.append)])
    assert not started
    for name in ("reports", "mine"):
        (site_folder.folder / name).mkdir()
    with_laboratory(site_folder, report={"folder": "reports", "language": "zh", "template": "mine"})
    start_reports([report_command(load_configuration(site_folder.request()), Path("SN_1.json"), events.append)])
    closing._started.clear()
    site_folder.write({"confirmation": {"required_for": ["certificate"]}})
    with_laboratory(site_folder, report={"folder": "reports"})
    start_reports([report_command(load_configuration(site_folder.request()), Path("SN_1.json"), events.append)])
    assert "a second person must confirm its certificate" in caplog.text
    assert events == [Message("certificate_waits")]
    ((_, _, _, *command),) = started
    folder = site_folder.folder
    assert command == [
        *("report", str(Path("SN_1.json").absolute()), "-o", str(folder / "reports")),
        *("--language", "zh", "--by", "", "--templates", str(folder / "mine")),
    ]


@pytest.mark.long
def test_new_certificate_states_that_the_registers_were_written_again(gimbal: Made) -> None:
    """A certificate that was issued before is printed again unchanged."""
    first, again, revised = (gimbal.folder / f"{name}.pdf" for name in ("first", "again", "r1"))
    assert report(gimbal.result_file, "-o", first) == 0
    runs, serial = gimbal.result_file.parent, gimbal.certificate.result.serial
    later = journal.begin(runs, serial, {}, {"gyro_bias_x": 1.0}, journal.Purpose("wang", "hand", "older.h5"))
    later.note(TransferStep.COMMITTING)
    later.close(TransferOutcome.DONE)
    assert report(gimbal.result_file, "-o", again) == 0
    assert again.read_bytes() == first.read_bytes()
    assert report(gimbal.result_file, "-o", revised, "--revise", "Unit was written again") == 0
    time = later.utc[:16].replace("T", " ")
    stated = f"The registers were written again on {time} UTC, after the calibration"
    texts = [" ".join(page.extract_text() for page in pypdf.PdfReader(path).pages) for path in (first, revised)]
    assert [stated in " ".join(text.split()) for text in texts] == [False, True]
