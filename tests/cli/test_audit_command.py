"""`calstation audit` lists events at a site; `calstation check` detects a modified audit trail."""

import hashlib
import re
from pathlib import Path
from unittest.mock import Mock

import pytest
import tomli_w

from calstation.config import access, library, versions
from calstation.records import AUDIT_EVENTS, append_audit, audit_path
from calstation.results import History
from tests.dead_logs import write_dead_log
from tests.helpers import write_log_of
from tests.issued_records import issue_in_records, remove_trail
from tests.results.test_history import write
from tests.site_folder import BENCH, STATION

SHIPPED = (library.shipped_folder() / "products" / "nav_a.toml").read_text("utf-8")


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("CALSTATION_HOME", str(tmp_path))
    return tmp_path


def test_saved_files_and_changed_pins_are_listed(calstation, home: Path) -> None:
    versions.save("products", "nav_a", SHIPPED.replace("turns = 2", "turns = 3"), "wang")
    (home / "products" / "nav_a.toml").write_text(SHIPPED.replace("turns = 2", "turns = 4"), encoding="utf-8")
    versions.restore("products", "nav_a", 1, "li")
    access.set_pin("", "246813")
    access.set_pin("246813", "135792")
    events = calstation("audit", "--json", "-").json["events"]
    assert [(each["event"], each["values"].get("version")) for each in events] == [
        ("file_saved", 2), ("file_changed_outside", 3), ("file_saved", 4), ("pin_set", None), ("pin_changed", None),
    ]  # fmt: skip
    assert events[0]["by"] == "wang"
    assert "246813" not in audit_path(home).read_text("utf-8")


def test_events_are_filtered_by_engineer_type_and_date(calstation, home: Path) -> None:
    append_audit(home, "override", "wang", "scratch", confirmed_by="li", serial="SN-1")
    append_audit(home, "certificate", "zhao", number="C-1")
    assert "SN-1" in calstation("audit", "--by", "li").out
    assert "C-1" not in calstation("audit", "--by", "li").out
    assert len(calstation("audit", "--event", "certificate", "--json", "-").json["events"]) == 1
    assert not calstation("audit", "--since", "2100-01-01", "--json", "-").json["events"]
    assert calstation("audit", "--since", "soon").code == 2


@pytest.mark.parametrize(
    ("language", "listed"),
    [
        ("en", "serial number SN-1, verdict PASS, files N-1.pdf, stages: – → 2, 3"),
        ("zh_CN", "序列号 SN-1、结论 合格、文件 N-1.pdf、stages: – → 2、3"),
    ],
)
def test_values_are_listed_by_name_as_in_the_window(
    calstation, home: Path, monkeypatch: pytest.MonkeyPatch, language: str, listed: str
) -> None:
    files, changed = {"N-1.pdf": "ab" * 32}, {"stages": [None, [2, 3]]}
    append_audit(home, "certificate", "li", files=files, serial="SN-1", verdict="passed", changed=changed)
    for module in ("commands.audit", "text"):
        monkeypatch.setattr(f"calstation.cli.{module}.LANGUAGE", language)
    assert listed in calstation("audit").out


@pytest.mark.parametrize("recorded", [("B0001", "Li Na"), ("B0001", "Li Na", "Li Na (B0001)")])
def test_one_person_is_found_by_badge_and_name(calstation, home: Path, recorded: tuple[str, ...]) -> None:
    """Earlier versions recorded either of them; the station, or a later event, connects them."""
    names = {"B0001": "Li Na", "B0002": "Wang Wei"}
    if len(recorded) == 2:
        station = {**STATION, "bench": BENCH, "sign_in": {"badge_pattern": r"B\d{4}", "names": names}}
        (home / "stations").mkdir()
        (home / "stations" / "line.toml").write_text(tomli_w.dumps(station), encoding="utf-8")
        (home / "stations" / "damaged.toml").write_text("name =", encoding="utf-8")
    for by in (*recorded, "Wang Wei (B0002)"):
        append_audit(home, "file_saved", by)
    for person in ("Li Na", "Li Na (B0001)"):
        assert [each["by"] for each in calstation("audit", "--by", person, "--json", "-").json["events"]] == [*recorded]
    badge = [by for by in recorded if "B0001" in by]
    found = calstation("audit", "--by", "B0001", "--json", "-").json["events"]
    assert [each["by"] for each in found] == badge, "a name without the badge proves no badge"
    append_audit(home, "file_saved", "Li Na (B0003)")  # a namesake
    append_audit(home, "file_saved", "Li Na (B0001)")
    found = calstation("audit", "--by", "B0003", "--json", "-").json["events"]
    assert [each["by"] for each in found] == ["Li Na (B0003)"]


def test_error_for_an_unknown_event_lists_the_known_events(calstation, home: Path) -> None:
    done = calstation("audit", "--event", "foo")
    assert (done.code, done.out) == (2, "")
    assert f"--event 'foo' is unknown. Choose from {', '.join(AUDIT_EVENTS)}." in done.err
    assert calstation("audit", "--event", "override").code == 0, "a known one that did not happen"
    append_audit(home, "foo", "wang")
    assert len(calstation("audit", "--event", "foo", "--json", "-").json["events"]) == 1, "one of a later version"


def test_documentation_lists_all_events() -> None:
    guide = (Path(__file__).parents[2] / "docs" / "how-to" / "audit-trail.md").read_text("utf-8")
    rows = re.findall(r"^\| (`.*?`) \|", guide, re.MULTILINE)
    assert tuple(re.findall(r"`(\w+)`", " ".join(rows))) == AUDIT_EVENTS


def test_missing_audit_trail_is_not_intact(calstation, home: Path) -> None:
    for command in ("check", "audit"):
        done = calstation(command)
        assert (done.code, done.out) == (0, f"There is no audit trail yet: {audit_path(home)} does not exist.\n")
    missing = home / "backup" / "audit.jsonl"
    for command in (("check", missing), ("audit", "--file", missing)):
        done = calstation(*command)
        assert (done.code, done.out) == (2, "")
        assert done.err == f"calstation: Data: {missing}: No such file. Give the path of an existing audit trail.\n"


def test_check_reports_the_first_modified_line(calstation, home: Path) -> None:
    append_audit(home, "pin_set", "wang")
    append_audit(home, "pin_changed", "wang")
    done = calstation("check")
    assert (done.code, "intact: 2 lines" in done.out) == (0, True)
    path = audit_path(home)
    path.write_bytes(path.read_bytes().replace(b"pin_set", b"pin_get"))
    dated = path.rename(path.with_name("audit_2026-11.jsonl"))
    done = calstation("check", dated)
    assert (done.code, "at line 1" in done.out) == (2, True)
    dated.rename(path)
    assert calstation("check", "--json", "-").json["first_bad"] == 1
    assert calstation("audit").code == 2


def test_lines_of_a_changed_trail_are_marked(calstation, home: Path) -> None:
    for person in ("wang", "li", "zhao"):
        append_audit(home, "pin_changed", person)
    path = audit_path(home)
    content = path.read_bytes()
    path.write_bytes(content.replace(b'"li"', b'"xu"'))
    for command in (("audit",), ("check",)):
        assert calstation(*command).code == 2
    first, second, third, *_ = calstation("audit").out.splitlines()
    assert "(wang (not authenticated))" in first
    assert "not proved" not in first
    assert second.startswith("line 2, CHANGED: {")
    assert '"by": "xu"' in second
    assert third.startswith("line 3, not proved: ")
    path.write_bytes(b"\n".join(content.split(b"\n")[:1]) + b"\n")
    for command in (("audit",), ("check",)):
        assert calstation(*command).code == 2, "the end was cut off"


def test_check_compares_the_files_of_certificates(calstation, home: Path) -> None:
    runs, pdf = home / "runs", home / "certificates" / "N-1.pdf"
    pdf.parent.mkdir()
    pdf.write_bytes(b"issued")
    files = {pdf.name: hashlib.sha256(b"issued").hexdigest()}
    append_audit(home, "certificate", "li", certificate="N-1", files=files, reports={"folder": str(runs)})
    done = calstation("check")
    assert (done.code, "agree with the audit trail: 1." in done.out) == (0, True)
    pdf.write_bytes(b"changed")
    done = calstation("check")
    assert (done.code, f"{pdf} is not the file that was issued as certificate N-1" in done.out) == (2, True)
    assert not calstation("check", "--json", "-").json["intact"]
    pdf.unlink()
    done = calstation("check")
    assert (done.code, "not compared: 1 (N-1.pdf)." in done.out) == (2, True), "not everything was verified"
    assert calstation("audit").code == 2


def test_check_compares_certificates_in_the_folder_for_reports_of_a_station(calstation, home: Path) -> None:
    reports, stations = home / "reports_of_line", home / "stations"
    reports.mkdir()
    stations.mkdir()
    text = library.find("stations", "virtual_bench").read_text(encoding="utf-8")
    (stations / "line_1.toml").write_text(f'{text}\n[report]\nfolder = "{reports}"\n', encoding="utf-8")
    (reports / "N-1.pdf").write_bytes(b"changed")
    files = {"N-1.pdf": hashlib.sha256(b"issued").hexdigest()}
    append_audit(home, "certificate", "li", certificate="N-1", files=files, reports={"folder": str(home / "runs")})
    done = calstation("check")
    assert (done.code, f"{reports / 'N-1.pdf'} is not the file that was issued" in done.out) == (2, True)


def test_certificates_of_the_trail_that_the_record_of_reports_lacks_are_an_error(
    calstation, home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(home)
    runs = Path("runs")
    for revision in (0, 1):
        issue_in_records(home, runs.resolve(), "N-1", revision)
    record, agrees = runs / "reports.jsonl", "agrees with the audit trail"
    content = record.read_bytes()
    for arguments in ((), (runs,), (record,)):
        done = calstation("check", *arguments)
        assert (done.code, agrees in done.out) == (0, True)
    lacks = "certificates that the audit trail contains: 2 (N-1, N-1-R1)."
    record.unlink()
    for arguments in ((), (runs,), (record,)):
        done = calstation("check", *arguments)
        assert (done.code, agrees in done.out, lacks in done.out) == (2, False, True), done
    monkeypatch.chdir(home.parent)
    assert calstation("check").code == 2, "the trail names the folder"
    monkeypatch.chdir(home)
    record.write_bytes(content)
    remove_trail(home)
    done = calstation("check", runs)
    assert (done.code, agrees in done.out) == (2, False), "not everything was verified"
    assert "no audit trail of this site confirms any" in done.out
    (home / "other").mkdir()
    done = calstation("check", home / "other")
    assert "There is no record of issued reports in" in done.out
    assert agrees not in done.out


def test_runs_whose_files_are_missing_are_named_by_every_verification(
    calstation, home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Those that only the index of the runs knows, and those of certificates, also without the index."""
    monkeypatch.chdir(home)
    runs = home / "runs"
    runs.mkdir()
    certified, indexed = write_dead_log(runs, "SN-1"), write_dead_log(runs, "SN-2")
    issue_in_records(home, runs, certified.stem)
    History(runs).refresh()
    for arguments in ((), (runs,)):
        assert "are missing or unreadable" not in calstation("check", *arguments).out
    certified.unlink()
    indexed.unlink()
    named = f"unreadable: 2 ({certified.stem}, {indexed.stem})."
    for arguments in ((), (Path("runs"),)):
        done = calstation("check", *arguments)
        assert (done.code, named in done.out) == (2, True), done
    assert calstation("check", runs, "--json", "-").json["intact"], "nothing contradicts the record of reports"
    History(runs).refresh()
    assert f"unreadable: 2 ({certified.stem}, {indexed.stem})." in calstation("check", runs).out
    (runs / "history.sqlite").unlink()
    assert f"unreadable: 1 ({certified.stem})." in calstation("check", runs).out


@pytest.mark.parametrize("named", [True, False])
def test_check_reports_a_result_that_differs_from_its_log(
    calstation, home: Path, monkeypatch: pytest.MonkeyPatch, named: bool
) -> None:
    monkeypatch.chdir(home)
    runs = home / "runs"
    runs.mkdir()
    write_log_of(write(runs, "a", "SN-1", "failed", 1))
    command = ("check", runs) if named else ("check",)
    assert calstation(*command).code == 0
    changed = write(runs, "a", "SN-1", "passed", 1)
    monkeypatch.setattr("calstation.reports.verification.check_runs", Mock(side_effect=AssertionError("read twice")))
    done = calstation(*command)
    assert (done.code, "a.json was changed: it differs from the result in its log" in done.out) == (2, True)
    assert "Restore the file from a backup." in done.out
    changed.unlink()
    assert calstation(*command).code == 0


def test_check_reports_attempts_without_a_run(calstation, home: Path) -> None:
    runs = home / "runs"
    runs.mkdir()
    write(runs, "a", "SN-1", "failed", 1, attempt=3)
    done = calstation("check", runs)
    assert (done.code, "no run of unit SN-1 has attempt number 1–2" in done.out) == (0, True)
