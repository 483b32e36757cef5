"""The audit trail in the window: filter, verification and export."""

import csv
import hashlib
import json
import re
from dataclasses import asdict
from datetime import timedelta
from pathlib import Path

import pytest
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QComboBox, QLabel, QLineEdit, QTableView
from pytestqt.qtbot import QtBot

from calstation.config import access, export_trail, library, versions
from calstation.gui.history import HistoryPage
from calstation.gui.text import language
from calstation.records import IssuedReport, append_audit, audit_path, report_file, verify_trail
from tests.gui.conftest import SiteFolder
from tests.gui.test_history_page import WAIT, button, folder, page, write_run
from tests.issued_records import cut_last_line, issue_in_records, remove_trail

__all__ = ["folder", "page"]  # fixtures


@pytest.fixture
def trail(site_folder: SiteFolder) -> Path:
    """The audit trail of the site with three events."""
    home = site_folder.home
    append_audit(home, "file_saved", "Li Na", kind="products", name="nav_a", sha256="0" * 64)
    append_audit(home, "override", "Li Na", "customer agrees", confirmed_by="Zhang Min", serial="SN-000001", pin="site")
    append_audit(home, "pin_set", "")
    return audit_path(home)


def open_trail(page: HistoryPage, qtbot: QtBot) -> QTableView:
    """Open the view from the list of runs, and return its table when it has been read."""
    page.show()
    qtbot.waitUntil(lambda: not page.busy, timeout=WAIT)
    qtbot.mouseClick(button(page, "history_audit_button"), Qt.MouseButton.LeftButton)
    qtbot.waitUntil(lambda: page.audit._trail is not None and not page.audit.busy, timeout=WAIT)
    return page.audit.findChild(QTableView, "audit_table")


def events(table: QTableView) -> list[str]:
    """Return the event of each row."""
    return [str(table.model().index(row, 1).data()) for row in range(table.model().rowCount())]


def test_events_are_listed_and_filtered(page: HistoryPage, trail: Path, qtbot: QtBot) -> None:
    table = open_trail(page, qtbot)
    assert events(table) == ["PIN set", "Failed unit released", "File saved"]
    row = [table.model().index(1, column).data() for column in range(2, 6)]
    assert row == [
        "Li Na (not authenticated)",
        "Zhang Min",
        "customer agrees",
        "serial number SN-000001, entered site PIN",
    ]
    person = page.audit.findChild(QComboBox, "audit_person_combo")
    person.setFocus()
    qtbot.keyClicks(person, "Zhang")
    assert events(table) == ["Failed unit released"]
    person.setCurrentIndex(0)
    search = page.audit.findChild(QLineEdit, "audit_search_edit")
    qtbot.keyClicks(search, "nav_a")
    assert events(table) == ["File saved"]
    assert page.audit.findChild(QLabel, "audit_count_label").text() == "1 of 3 events"
    search.clear()
    kinds = page.audit.findChild(QComboBox, "audit_event_combo")
    kinds.setCurrentIndex(kinds.findData("pin_set"))
    assert events(table) == ["PIN set"]
    language.use("zh_CN")
    assert events(table) == ["设置 PIN 码"]
    qtbot.mouseClick(button(page, "audit_back_button"), Qt.MouseButton.LeftButton)
    assert not table.isVisible()


def test_one_person_with_badge_and_name_is_one_entry_of_the_filter(
    page: HistoryPage, site_folder: SiteFolder, qtbot: QtBot
) -> None:
    for by in ("B0001", "Li Na", "Li Na (B0001)", "Wang Wei (B0002)"):
        append_audit(site_folder.home, "file_saved", by, kind="products", name="nav_a")
    table = open_trail(page, qtbot)
    person = page.audit.findChild(QComboBox, "audit_person_combo")
    assert [person.itemData(index) for index in range(1, person.count())] == ["Li Na (B0001)", "Wang Wei (B0002)"]
    person.setFocus()
    qtbot.keyClicks(person, "Li")
    assert len(events(table)) == 3


@pytest.mark.parametrize(
    ("code", "person", "hint"),
    [
        ("en", "Dr A. Li (not authenticated)", "No personal PIN proved who acted"),
        ("zh_CN", "Dr A. Li（身份未验证）", "未经个人 PIN 码验证身份"),
    ],
)
def test_name_without_a_pin_is_marked(
    page: HistoryPage, site_folder: SiteFolder, qtbot: QtBot, code: str, person: str, hint: str
) -> None:
    append_audit(site_folder.home, "certificate", "Dr A. Li", "typing error", certificate="N-1", pin=None)
    append_audit(site_folder.home, "certificate", "B0001", certificate="N-2", pin="personal")
    language.use(code)
    model = open_trail(page, qtbot).model()
    assert [model.index(row, 2).data() for row in range(2)] == ["B0001", person]
    hints = [model.index(row, 5).data(Qt.ItemDataRole.ToolTipRole) for row in range(2)]
    assert [hint in each for each in hints] == [False, True]
    language.use("en")


@pytest.mark.parametrize(
    ("code", "shown"),
    [
        ("en", ["kind station file, name bench", "Latitude (site.latitude_deg): 40.0 → 41.5", "imu2: – → a, b"]),
        ("zh_CN", ["类别 工位文件", "名称 bench", "纬度（site.latitude_deg）: 40.0 → 41.5", "imu2: – → a、b"]),
    ],
)
def test_details_say_which_entry_of_a_file_changed_in_the_language_of_the_window(
    page: HistoryPage, site_folder: SiteFolder, qtbot: QtBot, code: str, shown: list[str]
) -> None:
    changed = {"site.latitude_deg": [40.0, 41.5], "imu2": [None, ["a", "b"]], "slots.1.product": ["nav_a", "nav_b"]}
    append_audit(site_folder.home, "file_saved", "Li Na", kind="stations", name="bench", changed=changed)
    language.use(code)
    index = open_trail(page, qtbot).model().index(0, 5)
    for part in shown:
        assert part in index.data(), index.data()
        assert part.split(", ")[0] in index.data(Qt.ItemDataRole.ToolTipRole)
    assert "slots.1.product: nav_a" in index.data(Qt.ItemDataRole.ToolTipRole), "not the product at the start"
    language.use("en")


@pytest.mark.parametrize(
    ("code", "certificate", "validation"),
    [
        (
            "en",
            "serial number SN-1, certificate N-1, verdict PASS, files N-1.pdf, number N-1",
            "validation V-1, verdict INCOMPLETE, files V-1.json",
        ),
        ("zh_CN", "序列号 SN-1、证书 N-1、结论 合格、文件 N-1.pdf、编号 N-1", "确认 V-1、结论 未完成、文件 V-1.json"),
    ],
)
def test_details_begin_with_the_unit_and_contain_no_raw_data(
    page: HistoryPage, site_folder: SiteFolder, qtbot: QtBot, code: str, certificate: str, validation: str
) -> None:
    reports = {"folder": "/runs", "lines": 2, "digest": "ab"}
    values = {"reports": reports, "files": {"N-1.pdf": "cd"}, "log_sha256": "ef", "number": "N-1", "verdict": "passed"}
    append_audit(site_folder.home, "certificate", "Li Na", **values, certificate="N-1", serial="SN-1")
    identity = {f"package {number}": "1.0" for number in range(70)}
    about = {"identity": identity, "files": {"V-1.json": "cd"}}
    append_audit(site_folder.home, "validation", "", **about, verdict="incomplete", validation="V-1")
    language.use(code)
    model = open_trail(page, qtbot).model()
    assert [model.index(row, 5).data() for row in range(2)] == [validation, certificate]
    hints = [model.index(row, 5).data(Qt.ItemDataRole.ToolTipRole) for row in range(2)]
    assert not any("{" in hint for hint in hints)
    assert "package 6" not in hints[0]
    assert "N-1.pdf cd" in hints[1]
    language.use("en")


def test_a_changed_line_is_found_by_verification(page: HistoryPage, trail: Path, qtbot: QtBot) -> None:
    open_trail(page, qtbot)
    state = page.audit.findChild(QLabel, "audit_state_label")
    assert "is intact: 3 lines" in state.text()
    trail.write_text(trail.read_text("utf-8").replace("customer agrees", "nobody knows"), "utf-8")
    qtbot.mouseClick(button(page, "audit_verify_button"), Qt.MouseButton.LeftButton)
    faults = page.audit.findChild(QLabel, "audit_faults_label")
    qtbot.waitUntil(lambda: "was changed at line 2" in faults.text(), timeout=WAIT)
    assert faults.property("kind") == "error"
    assert re.search(r"Verified at [-\d]{10} [:\d]{8} UTC", state.text())
    assert ": 1 fault." in state.text()


@pytest.mark.parametrize(
    ("code", "agreeing", "missing", "changed", "warning"),
    [
        (
            "en",
            "agree with the audit trail: 1.",
            "not found, and so not compared: 1 (N-3.pdf).",
            "issued as certificate N-2",
            ": 0 faults, 1 warning.",
        ),
        (
            "zh_CN",
            "与审计记录一致的证书文件：1 个。",
            "未找到、因此未比对的证书文件：1 个（N-3.pdf）。",
            "证书 N-2 签发的文件",
            "0 处问题，1 处警告。",
        ),
    ],
)
def test_files_of_certificates_are_compared_with_the_trail(
    page: HistoryPage,
    site_folder: SiteFolder,
    qtbot: QtBot,
    code: str,
    agreeing: str,
    missing: str,
    changed: str,
    warning: str,
) -> None:
    runs = page.app.runs_folder.absolute()
    folder = runs.parent / "certificates"
    folder.mkdir(exist_ok=True)
    for number in ("N-1", "N-2", "N-3"):
        content = number.encode()
        files = {f"{number}.pdf": hashlib.sha256(content).hexdigest()}
        issue_in_records(site_folder.home, runs, number, files=files)
        if number != "N-3":
            (folder / f"{number}.pdf").write_bytes(content)
    language.use(code)
    open_trail(page, qtbot)
    state = page.audit.findChild(QLabel, "audit_state_label")
    cautions = page.audit.findChild(QLabel, "audit_cautions_label")
    assert missing in cautions.text()
    assert page.audit._icon._kind == "caution", "no tick, because one file was not compared"
    assert missing not in state.text()
    assert warning in state.text()
    with (folder / "N-2.pdf").open("ab") as file:
        file.write(b" ")
    qtbot.mouseClick(button(page, "audit_verify_button"), Qt.MouseButton.LeftButton)
    faults = page.audit.findChild(QLabel, "audit_faults_label")
    qtbot.waitUntil(lambda: changed in faults.text(), timeout=WAIT)
    assert str(folder / "N-2.pdf") in faults.text()
    assert page.audit._icon._kind == "bad"
    assert agreeing in state.text(), "not in red"
    assert state.property("kind") != "error"
    language.use("en")


@pytest.mark.parametrize(
    ("code", "sentence"),
    [("en", "which N-1-R1 has replaced: it was changed. Restore it"), ("zh_CN", "该证书已被 N-1-R1 替换")],
)
def test_changed_file_of_a_replaced_certificate_is_not_to_be_printed_again(
    page: HistoryPage, site_folder: SiteFolder, qtbot: QtBot, code: str, sentence: str
) -> None:
    runs = page.app.runs_folder.absolute()
    folder = runs.parent / "certificates"
    folder.mkdir(exist_ok=True)
    for revision, name in enumerate(("N-1", "N-1-R1")):
        (folder / f"{name}.pdf").write_bytes(b"" if name == "N-1" else b"issued")
        files = {f"{name}.pdf": hashlib.sha256(b"issued").hexdigest()}
        issue_in_records(site_folder.home, runs, "N-1", revision, files)
    language.use(code)
    open_trail(page, qtbot)
    qtbot.mouseClick(button(page, "audit_verify_button"), Qt.MouseButton.LeftButton)
    faults = page.audit.findChild(QLabel, "audit_faults_label")
    qtbot.waitUntil(lambda: sentence in faults.text().replace("\n", " "), timeout=WAIT)
    assert "rint the certificate again" not in faults.text()
    language.use("en")


def test_notice_about_a_run_does_not_stay_above_the_audit_trail(
    page: HistoryPage, site_folder: SiteFolder, qtbot: QtBot
) -> None:
    page.show()
    page.notice.inform("bad", "operator.no_certificate", "", page.setFocus)
    assert page.notice.isVisible()
    open_trail(page, qtbot)
    assert not page.notice.isVisible()


@pytest.mark.parametrize(
    ("code", "changed", "later", "wrong"),
    [
        ("en", "was changed at line 1", "not proved by the chain: 2.", "no signed line"),
        ("zh_CN", "第 1 行被改动", "未经链验证的行：2 行。", "没有签名行"),
    ],
)
def test_lines_after_a_changed_first_line_are_listed_as_unverified(
    page: HistoryPage, trail: Path, qtbot: QtBot, code: str, changed: str, later: str, wrong: str
) -> None:
    trail.write_text(trail.read_text("utf-8").replace("Li Na", "Li Nu", 1), "utf-8")
    language.use(code)
    table = open_trail(page, qtbot)
    faults = page.audit.findChild(QLabel, "audit_faults_label").text()
    assert changed in faults
    assert wrong not in faults
    assert later in page.audit.findChild(QLabel, "audit_state_label").text()
    line = "第 1 行：被改动" if code == "zh_CN" else "Line 1: changed"
    assert len(events(table)) == 3
    assert events(table)[-1] == line
    kinds = [table.model().index(row, 1).data(Qt.ItemDataRole.UserRole) for row in range(3)]
    assert kinds == ["caution", "caution", "bad"]
    hints = [table.model().index(row, 1).data(Qt.ItemDataRole.ToolTipRole) for row in range(3)]
    assert all(("未经验证" if code == "zh_CN" else "is not proved") in each for each in hints[:2])
    assert "Li Nu" in table.model().index(2, 5).data()
    assert page.audit.findChild(QLabel, "audit_count_label").text().startswith("3 ")
    assert button(page, "audit_export_button").isEnabled()
    language.use("en")


@pytest.mark.parametrize(
    ("code", "missing", "unknown"),
    [("en", "is missing, although", "The files do not show which"), ("zh_CN", "缺失", "仅凭现有文件无法判断")],
)
def test_site_without_a_trail_is_damaged_only_if_a_file_was_written_after_an_event_of_it(
    page: HistoryPage, site_folder: SiteFolder, qtbot: QtBot, code: str, missing: str, unknown: str
) -> None:
    """Programs before the audit trail wrote PINs and versions, but no reasons and no PINs of badges."""
    home = site_folder.home
    access.set_pin("", "246810")
    access.set_pin("246810", "135790", "B-7")
    versions.save("products", "nav_a", library.find("products", "nav_a").read_text("utf-8"), "Li Na")
    for name in ("audit.jsonl", "station.key", "station.head"):
        (home / name).unlink()
    entries = sorted((home / "versions" / "products" / "nav_a").glob("*.json"))
    language.use(code)
    open_trail(page, qtbot)
    faults, cautions = (page.audit.findChild(QLabel, f"audit_{name}_label") for name in ("faults", "cautions"))

    def verify(label: QLabel, words: str, witness: str, icon: str) -> None:
        qtbot.mouseClick(button(page, "audit_verify_button"), Qt.MouseButton.LeftButton)
        qtbot.waitUntil(lambda: words in label.text() and witness in label.text(), timeout=WAIT)
        assert page.audit._icon._kind == icon

    verify(faults, missing, "engineers", "bad")
    (home / "engineers").rename(home / "former")
    verify(faults, missing, entries[0].name, "bad")
    for entry in entries:
        values = json.loads(entry.read_text("utf-8"))
        del values["reason"]
        entry.write_text(json.dumps(values), "utf-8")
    verify(cautions, unknown, "engineer.json", "caution")
    assert not faults.isVisible()
    (home / "engineer.json").unlink()
    verify(cautions, unknown, "versions", "caution")
    language.use("en")


@pytest.mark.parametrize(
    ("code", "unrecorded", "forged"),
    [
        ("en", "contains: 2 (N-8.xml, N-9.pdf).", "contains no file like"),
        ("zh_CN", "2 个（N-8.xml, N-9.pdf）", "没有与"),
    ],
)
def test_certificates_that_no_record_contains_are_named(
    page: HistoryPage, site_folder: SiteFolder, qtbot: QtBot, code: str, unrecorded: str, forged: str
) -> None:
    runs = page.app.runs_folder.absolute()
    folder = runs.parent / "certificates"
    folder.mkdir(exist_ok=True)
    runs.mkdir(exist_ok=True)
    for name in ("N-8.xml", "N-9.pdf", "notes.txt", "N-7_zh.pdf"):
        (folder / name).write_bytes(b"calstation")
    report_file(runs).append(asdict(IssuedReport("N-7", 0, "2026-11-02", None, "0" * 64, "0.1")))
    language.use(code)
    open_trail(page, qtbot)
    faults, cautions = (page.audit.findChild(QLabel, f"audit_{name}_label") for name in ("faults", "cautions"))
    assert unrecorded in cautions.text().replace("、", ", ")
    assert "N-7" not in cautions.text(), "the record of issued reports contains it"
    assert "reports.jsonl" in cautions.text(), "which no audit trail confirms"
    assert page.audit._icon._kind == "caution"
    assert not faults.text()
    append_audit(site_folder.home, "pin_set", "")
    digests = {"N-9.pdf": hashlib.sha256(b"calstation").hexdigest()}
    issue_in_records(site_folder.home, runs, "N-9", files=digests)
    head = verify_trail(site_folder.home).head
    assert head is not None
    (folder / "N-6.pdf").write_bytes(str(head).encode())
    qtbot.mouseClick(button(page, "audit_verify_button"), Qt.MouseButton.LeftButton)
    qtbot.waitUntil(lambda: forged in faults.text(), timeout=WAIT)
    assert "N-6.pdf" in faults.text()
    assert not cautions.text(), "N-8.xml has the bytes of a recorded file"
    language.use("en")


@pytest.mark.parametrize(
    ("code", "lacking", "agrees", "alone"),
    [
        (
            "en",
            "certificates that the audit trail contains: {}",
            "agrees with the audit trail",
            "no audit trail of this",
        ),
        ("zh_CN", "缺少审计记录所载的证书：{}", "且与审计记录一致", "没有可证实其中任何一行的审计记录"),
    ],
)
def test_record_of_reports_agrees_only_if_it_has_the_certificates_of_the_trail(
    page: HistoryPage, site_folder: SiteFolder, qtbot: QtBot, code: str, lacking: str, agrees: str, alone: str
) -> None:
    home, runs = site_folder.home, page.app.runs_folder
    issue_in_records(home, runs, "N-1")
    issue_in_records(home, runs, "N-1", 1)
    language.use(code)
    open_trail(page, qtbot)
    labels = [page.audit.findChild(QLabel, f"audit_{name}_label") for name in ("faults", "cautions", "state")]
    faults, cautions, state = labels

    def verify(label: QLabel, words: str, icon: str) -> None:
        qtbot.mouseClick(button(page, "audit_verify_button"), Qt.MouseButton.LeftButton)
        qtbot.waitUntil(lambda: words in label.text(), timeout=WAIT)
        assert page.audit._icon._kind == icon
        assert (agrees in state.text()) == (icon == "good")

    verify(state, agrees, "good")
    record = report_file(runs).path
    content = record.read_bytes()
    cut_last_line(record)
    one = {"en": "1 (N-1-R1)", "zh_CN": "1 份（N-1-R1）"}[code]
    verify(faults, lacking.format(one), "bad")
    record.unlink()
    two = {"en": "2 (N-1, N-1-R1)", "zh_CN": "2 份（N-1、N-1-R1）"}[code]
    verify(faults, lacking.format(two), "bad")
    record.write_bytes(content)
    page.app.runs_folder = runs.parent / "next"
    verify(state, agrees, "good")
    record.unlink()
    verify(faults, str(record), "bad")
    record.write_bytes(content)
    page.app.runs_folder = runs
    trail = audit_path(home).read_bytes()
    cut_last_line(audit_path(home))
    named = {"en": "contains certificate N-1-R1, signed", "zh_CN": "签名的证书 N-1-R1，"}[code]
    verify(faults, named, "bad")
    audit_path(home).write_bytes(trail)
    remove_trail(home)
    verify(cautions, alone, "caution")
    unknown = {"en": "Whether they are of this site cannot be verified", "zh_CN": "无法确认这些行是否属于本站点"}[code]
    assert unknown in cautions.text()
    language.use("en")


@pytest.mark.parametrize(
    ("code", "words"),
    [("en", "are missing or unreadable: 1 ({name})."), ("zh_CN", "缺失或无法读取的标定：1 次（{name}）。")],
)
def test_runs_whose_logs_are_missing_are_a_warning(
    page: HistoryPage, site_folder: SiteFolder, qtbot: QtBot, code: str, words: str
) -> None:
    name = write_run(page.app.runs_folder, "SN-000001", "passed", timedelta(hours=1)).stem
    append_audit(site_folder.home, "pin_set", "")
    language.use(code)
    open_trail(page, qtbot)
    cautions = page.audit.findChild(QLabel, "audit_cautions_label")
    assert words.format(name=name) in cautions.text()
    assert page.audit._icon._kind == "caution"
    language.use("en")


@pytest.mark.parametrize(
    ("code", "words"),
    [
        ("en", "after their last version in the audit trail: 1 (products/nav_a.toml)."),
        ("zh_CN", "于程序之外被改动或删除的文件：1 个（products/nav_a.toml）。"),
    ],
)
def test_product_that_was_changed_outside_is_a_warning(
    page: HistoryPage, site_folder: SiteFolder, qtbot: QtBot, code: str, words: str
) -> None:
    text = library.find("products", "nav_a").read_text("utf-8")
    versions.save("products", "nav_a", text.replace("turns = 2", "turns = 3"), "wang")
    language.use(code)
    open_trail(page, qtbot)
    cautions = page.audit.findChild(QLabel, "audit_cautions_label")
    assert words not in cautions.text()
    (site_folder.home / "products" / "nav_a.toml").write_text(text, "utf-8")
    qtbot.mouseClick(button(page, "audit_verify_button"), Qt.MouseButton.LeftButton)
    qtbot.waitUntil(lambda: words in cautions.text(), timeout=WAIT)
    assert page.audit._icon._kind == "caution"
    language.use("en")


@pytest.mark.parametrize("suffix", ["csv", "json"])
def test_listed_events_are_exported(
    page: HistoryPage, trail: Path, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, suffix: str
) -> None:
    target = tmp_path / f"trail.{suffix}"
    monkeypatch.setattr(
        "calstation.gui.state.page.ask_file", lambda parent, title, proposed, kinds, write: write(target)
    )
    open_trail(page, qtbot)
    qtbot.keyClicks(page.audit.findChild(QLineEdit, "audit_search_edit"), "customer")
    qtbot.mouseClick(button(page, "audit_export_button"), Qt.MouseButton.LeftButton)
    qtbot.waitUntil(lambda: target.exists() and not page.audit.busy, timeout=WAIT)
    text = target.read_text("utf-8-sig")
    rows = list(csv.DictReader(text.splitlines())) if suffix == "csv" else json.loads(text)
    assert [(row["event"], row["by"], row["why"]) for row in rows] == [("override", "Li Na", "customer agrees")]


def test_export_of_a_changed_trail_states_which_lines_are_not_proved(
    page: HistoryPage, trail: Path, qtbot: QtBot, tmp_path: Path
) -> None:
    trail.write_text(trail.read_text("utf-8").replace("customer agrees", "nobody knows"), "utf-8")
    open_trail(page, qtbot)
    for suffix in ("csv", "json"):
        target = export_trail(lambda *_, **__: None, page.audit._shown, tmp_path / f"trail.{suffix}")
        text = target.read_text("utf-8-sig")
        rows = list(csv.DictReader(text.splitlines())) if suffix == "csv" else json.loads(text)
        assert [(str(row["line"]), row["state"]) for row in rows] == [
            *(("3", "unproved"), ("2", "changed"), ("1", "proved")),
        ]
        assert "nobody knows" in rows[1]["text"]


def test_without_a_trail_the_view_says_so(page: HistoryPage, qtbot: QtBot) -> None:
    table = open_trail(page, qtbot)
    assert events(table) == []
    assert "There is no audit trail yet" in page.audit.findChild(QLabel, "audit_state_label").text()
    assert page.audit._icon._kind == "none"
    assert not button(page, "audit_export_button").isEnabled()
