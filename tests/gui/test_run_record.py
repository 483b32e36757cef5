"""The event log of a run, live and in the history, and the certificates listed with their run."""

import hashlib
from dataclasses import replace
from datetime import timedelta
from pathlib import Path

import pytest
from PySide6.QtCore import Qt, QUrl
from PySide6.QtGui import QDesktopServices
from PySide6.QtWidgets import QLabel, QTableView
from pytestqt.qtbot import QtBot

from calstation.config import SignInSection, load_station
from calstation.gui.history import HistoryPage
from calstation.gui.history.record_view import _state
from calstation.gui.text import event_line, language, say
from calstation.gui.widgets import state_icon
from calstation.messages import Text, local_time
from calstation.records import IssuedReport, Verdict, append_audit
from calstation.reports import IssuedCertificate, IssuedPdf
from calstation.reports.issued_pdf import _issuers
from calstation.sequencer import (
    Fault,
    Finalized,
    Message,
    StageEnded,
    StageSolved,
    StageStarted,
    StateChanged,
    StepStarted,
)
from tests.gui.conftest import RESULT, Operator
from tests.gui.test_history_page import (
    WAIT,
    button,
    folder,
    listed_runs,
    page,
    runs,
    select_row,
    visible_texts,
    write_run,
)
from tests.gui.test_operator_events import simulated_run
from tests.issued_records import issue_in_records
from tests.site_folder import SiteFolder

__all__ = ["folder", "page", "runs", "simulated_run"]  # fixtures

EVENTS = [
    StateChanged("preparing", "idle"),
    StageStarted("excitation", 0, 1, 240.0, repeated=True),
    StepStarted("excitation", 3, "dwell"),
    StateChanged("paused", "pausing"),
    StateChanged("running", "paused"),
    Message("step_repeated", {"reason": "gap", "attempt": 2}),
    StageEnded("excitation", "targets", 3),
    StageSolved("excitation", {}, {"passed": False}),
]
LINES = {
    "en": [
        "Preparing the table and the unit.",
        "Excitation begins; planned: 4:00.",
        "Paused.",
        "Resumed.",
        "Step repeated (samples lost), attempt 2.",
        "Excitation ended after 3 rounds: every sigma has reached its target.",
        "Excitation solved; its residuals are inconsistent.",
    ],
    "zh_CN": ["正在准备转台和产品。", "已暂停。", "继续标定。", "各标准差均达到目标"],
}


def sentences(table: QTableView) -> list[str]:
    """Return the sentences of a table of events."""
    last = table.model().columnCount() - 1
    return [str(table.model().index(row, last).data()) for row in range(table.model().rowCount())]


def test_events_of_the_run_are_listed_as_they_happen(simulated_run: Operator) -> None:
    operator = simulated_run
    table = operator.widget("events_table", QTableView)
    assert not table.isVisible()
    operator.press("events_button")
    assert table.isVisible()
    for event in EVENTS:
        operator.window.app.engine_link.event.emit(event)
    operator.until(lambda: sentences(table) == LINES["en"])
    assert table.model().index(4, 1).data(Qt.ItemDataRole.UserRole) == "caution"
    operator.window.app.set_language("zh_CN")
    for text in LINES["zh_CN"]:
        assert text in "\n".join(sentences(table))
    operator.window.app.set_language("en")
    operator.press("events_button")
    assert not table.isVisible()
    end = Finalized(Verdict.PASSED, "log.h5", "result.json", RESULT)
    operator.window.app.engine_link.event.emit(end)
    operator.press("events_button")
    assert sentences(table)[-1] == "Verdict: PASS."


def test_silence_of_an_engine_that_responds_again_is_no_error_in_the_list(simulated_run: Operator) -> None:
    operator = simulated_run
    table = operator.widget("events_table", QTableView)
    operator.press("events_button")
    emit = operator.window.app.engine_link.event.emit
    emit(Message("preparing_solver"))
    emit(Fault("DeviceFaultError", "", 3, "run.engine_silent", {"then": Text("run.then_again")}))
    operator.until(lambda: len(sentences(table)) == 2)
    waiting, silent = sentences(table)
    assert "first start on this computer, it is compiled, which takes about two minutes" in waiting
    assert "does not respond" in silent
    assert table.model().index(1, 1).data(Qt.ItemDataRole.UserRole) == "bad"
    emit(StateChanged("running", "preparing"))
    operator.until(lambda: "it responds again" in sentences(table)[1])
    assert table.model().index(1, 1).data(Qt.ItemDataRole.UserRole) == "caution"
    operator.window.app.set_language("zh_CN")
    assert ["首次启动时要先编译，约需两分钟" in sentences(table)[0], "现已恢复响应" in sentences(table)[1]] == [
        True,
        True,
    ]


@pytest.mark.parametrize("reason", ["plan", "rounds", "duration", "targets", "operator"])
def test_each_rule_that_ends_a_stage_has_its_own_sentence(reason: str) -> None:
    others = {event_line(StageEnded("rate", each, 2))[1] for each in ("plan", "rounds", "duration") if each != reason}
    assert event_line(StageEnded("rate", reason, 2))[1].startswith("Rate ended")
    assert event_line(StageEnded("rate", reason, 2))[1] not in others


def press_record(page: HistoryPage, qtbot: QtBot) -> None:
    """Click the button for the record of a run after the details have been laid out."""
    record = button(page, "history_record_button")
    qtbot.waitUntil(lambda: record.width() > 0, timeout=WAIT)
    qtbot.mouseClick(record, Qt.MouseButton.LeftButton)


@pytest.mark.usefixtures("runs")
def test_history_lists_the_events_of_a_log(page: HistoryPage, qtbot: QtBot) -> None:
    rows = listed_runs(page, qtbot)
    select_row(page, [serial for serial, _ in rows].index("SN-000003"), qtbot)
    press_record(page, qtbot)
    table = page.findChild(QTableView, "history_events_table")
    qtbot.waitUntil(lambda: not page.record.busy, timeout=WAIT)
    assert sentences(table) == ["Rate solved; its residuals are consistent."], visible_texts(page)
    clock, since = (str(table.model().index(0, column).data()) for column in (0, 1))
    started = page.table.run.started_utc
    assert (clock, since) == (local_time(started, zone=True)[11:19], "0:00")
    assert str(table.model().index(0, 0).data(Qt.ItemDataRole.ToolTipRole)) == local_time(started, zone=True)
    qtbot.mouseClick(button(page, "record_back_button"), Qt.MouseButton.LeftButton)
    assert page.table.isVisible()


@pytest.mark.usefixtures("app")
def test_certificates_are_listed_with_their_run_and_opened(
    page: HistoryPage, runs: dict[str, Path], qtbot: QtBot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[QUrl] = []
    succeeds = True
    monkeypatch.setattr(QDesktopServices, "openUrl", lambda url: bool(opened.append(url) or succeeds))
    listed_runs(page, qtbot)
    press_record(page, qtbot)
    first, second = (
        IssuedReport("N-1", revision, "2026-11-20", reason, "0" * 64, "0.1")
        for revision, reason in ((0, None), (1, "address of the customer"))
    )
    pdf = tmp_path / "N-1-R1.pdf"
    issued = IssuedPdf(pdf, frozenset({hashlib.sha256(b"issued").hexdigest()}))
    people = ("Li Na",)
    certificates = IssuedCertificate(first, None, people=people), IssuedCertificate(second, issued, True, people)
    page.record._show_certificates([*certificates])
    table, note = page.findChild(QTableView, "certificates_table"), page.findChild(QLabel, "certificates_note")
    assert not note.isVisible()
    assert page.record._run is not None
    page.record._run = replace(page.record._run, altered=True)
    page.record._show_texts()
    assert note.isVisible()
    assert str(table.model().index(1, 2).data()) == "issued, result changed since"
    page.record._run = replace(page.record._run, altered=False)
    page.record._show_texts()
    table.selectRow(1)
    model = table.model()
    cells = [[str(model.index(row, column).data()) for column in range(4)] for row in range(2)]
    assert cells == [["N-1", "2026-11-20", "replaced", "Li Na"], ["N-1-R1", "2026-11-20", "valid", "Li Na"]]
    elided = table.textElideMode(), table.wordWrap()
    assert elided == (Qt.TextElideMode.ElideMiddle, False), "a narrow column shows the revision"
    reason = page.findChild(QLabel, "certificate_reason_label")
    assert reason.text() == "N-1-R1, reason for the revision: address of the customer"
    open_button = button(page, "open_certificate_button")
    qtbot.mouseClick(open_button, Qt.MouseButton.LeftButton)
    assert opened == [QUrl.fromLocalFile(str(pdf))]
    succeeds = False
    qtbot.mouseClick(open_button, Qt.MouseButton.LeftButton)
    assert page.record.notice.isVisible()
    assert str(pdf) in page.record.notice.text_label.text()
    pdf.write_bytes(b"changed")
    qtbot.mouseClick(open_button, Qt.MouseButton.LeftButton)
    assert len(opened) == 2, "a changed file is not opened"
    assert "is not the file whose SHA-256 is in the audit trail" in page.record.notice.text_label.text()
    qtbot.mouseClick(table.viewport(), Qt.MouseButton.LeftButton, pos=table.visualRect(model.index(0, 0)).center())
    assert not open_button.isEnabled()
    assert not reason.isVisible()
    assert "prints the valid one again" in open_button.toolTip()


@pytest.mark.parametrize("code", ["en", "zh_CN"])
def test_certificates_of_a_run_whose_log_was_deleted_are_listed(
    page: HistoryPage, folder: Path, site_folder: SiteFolder, qtbot: QtBot, code: str
) -> None:
    """Nothing is claimed before the records have been read, nor that none was issued if the records lack it."""
    number = write_run(folder, "SN-000001", "passed", timedelta(hours=2)).stem
    other = write_run(folder, "SN-000002", "passed", timedelta(hours=3)).stem
    issue_in_records(site_folder.home, folder, number)
    append_audit(site_folder.home, "certificate", "", number=other, revision=0)  # of a version without its entries
    language.use(code)
    listed_runs(page, qtbot)
    index, role = page.table.model().index(0, 0), Qt.ItemDataRole
    passed = say("badge.passed")
    hint = {"en": f"{passed}, log missing", "zh_CN": f"{passed}，数据记录缺失"}[code]
    assert (index.data(), page.details.badge.text()) == (hint, hint)
    assert index.data(role.DecorationRole).cacheKey() == state_icon("caution").cacheKey()
    assert not button(page, "history_certificate_button").isEnabled()
    press_record(page, qtbot)
    none, events = (page.findChild(QLabel, f"no_{name}_label") for name in ("certificates", "events"))
    assert not none.isVisible(), "the records have not been read yet"
    restore = {"en": "Restore it from a backup", "zh_CN": "请从备份恢复"}[code]
    assert restore in events.text()
    table = page.findChild(QTableView, "certificates_table")
    qtbot.waitUntil(lambda: not page.record.busy and table.model().rowCount() == 1, timeout=WAIT)
    assert table.model().index(0, 0).data() == number
    assert not none.isVisible()
    certificate = button(page, "record_certificate_button")
    assert not certificate.isEnabled()
    assert {"en": "The log of this run is missing", "zh_CN": "数据记录缺失"}[code] in certificate.toolTip()
    qtbot.mouseClick(button(page, "record_back_button"), Qt.MouseButton.LeftButton)
    select_row(page, 1, qtbot)
    press_record(page, qtbot)
    unknown = {"en": "it is not known whether certificates were issued", "zh_CN": "无法确定是否签发过证书"}[code]
    qtbot.waitUntil(lambda: unknown in none.text(), timeout=WAIT)
    assert page.record._run is not None
    page.record._run = replace(page.record._run, origin="other", station="line 2")
    page.record._show_texts()
    assert {"en": "line 2 issues the certificates", "zh_CN": "由工位 line 2 签发"}[code] in none.text()
    assert {"en": "open the log first", "zh_CN": "请先打开数据记录"}[code] in events.text()
    language.use("en")


def test_issuers_are_those_of_the_audit_trail(site_folder: SiteFolder) -> None:
    append_audit(site_folder.home, "certificate", "E-7", certificate="N-1", content_sha256="ab", confirmed_by="Wu Fei")
    unproven = ("Qin Q (E-7) (not authenticated)", "Wu Fei (not authenticated)")
    sign_in = SignInSection(badge_pattern=r"E-\d", names={"E-7": "Qin Q"})
    station = load_station(site_folder.station)[1].model_copy(update={"sign_in": sign_in})
    assert _issuers(station, "en") == {("N-1", "ab"): unproven}


@pytest.mark.parametrize(
    ("intact", "exists", "last", "altered", "released", "state"),
    [
        (True, True, True, False, False, ("good", "history.certificate_valid")),
        (None, False, True, False, False, ("caution", "history.certificate_without_file")),
        (None, True, True, False, False, ("caution", "history.certificate_unverified")),
        (False, True, True, False, False, ("bad", "history.certificate_changed")),
        (False, True, False, False, False, ("bad", "history.certificate_replaced_changed")),
        (True, True, True, True, False, ("caution", "history.certificate_result_changed")),
        (None, False, True, True, False, ("caution", "history.certificate_result_changed")),
        (False, True, True, True, False, ("bad", "history.certificate_changed")),
        (True, True, False, False, False, ("none", "history.certificate_replaced")),
        (True, True, False, False, True, ("none", "history.certificate_replaced")),
        (True, True, True, False, True, ("caution", "history.certificate_released")),
        (True, True, True, True, True, ("caution", "history.certificate_result_changed")),
    ],
)
def test_state_of_a_certificate_is_that_of_its_file(
    intact: bool | None, exists: bool, last: bool, altered: bool, released: bool, state: tuple[str, str], tmp_path: Path
) -> None:
    report = IssuedReport("N-1", 0, "2026-11-20", None, "0" * 64, "0.1")
    pdf = IssuedPdf(tmp_path / "N-1.pdf", frozenset()) if exists else None
    certificate = IssuedCertificate(report, pdf, intact, released_since=released)
    assert _state(certificate, last=last, altered=altered) == state
