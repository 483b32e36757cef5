"""Refused production runs that engineers override, and certificates, operated by real clicks in the window."""

import time
from datetime import date
from functools import partial
from itertools import pairwise
from pathlib import Path

import pypdf
import pytest
import tomli_w
from PySide6.QtCore import QUrl
from PySide6.QtGui import QDesktopServices
from PySide6.QtWidgets import QLabel, QLineEdit, QPushButton, QTableView
from pytestqt.qtbot import QtBot

from calstation.config import ConfirmationRequired, access
from calstation.config.library import shipped_folder
from calstation.errors import ConfigurationError
from calstation.gui.state import PeoplePanel
from calstation.gui.text import language, say
from calstation.jobs import ProgressCallback
from calstation.messages import Text
from calstation.records import AuditEvent, Verdict, audit_path, read_audit
from calstation.results import load_result
from calstation.sequencer import Finalized, StateChanged
from tests.gui.conftest import RESULT, SERIAL, Operator
from tests.site_folder import ONE_STAGE, STATION

pytestmark = pytest.mark.timeout(240)
ENGINEERS = {"badge_pattern": r"B\d{4}", "engineers": ["B0001", "B0002"]}
PEOPLE = ("badge", "pin", "second_badge", "second_pin")
PINS = {"B0001": "111111", "B0002": "222222"}
OVERDUE = [{"name": "Rate table A", "kind": "table", "due": date(2021, 3, 2)}]


def fill(operator: Operator, panel: str, **texts: str) -> None:
    """Type into the visible fields of a panel."""
    for key, text in texts.items():
        edit = operator.widget(f"{panel}_{key}_edit", QLineEdit)
        assert edit.isVisible(), key
        edit.clear()
        operator.qtbot.keyClicks(edit, text)


def events_of(operator: Operator) -> list[AuditEvent]:
    return [*read_audit(audit_path(operator.site_folder.home)).entries]


def use(operator: Operator, product: dict[str, object], **station: object) -> None:
    operator.site_folder.write({**ONE_STAGE, **product}, station)
    operator.window.app.set_station(operator.site_folder.station)


def refused(operator: Operator) -> None:
    """Start a run that an engineer must permit."""
    operator.scan(SERIAL)
    operator.press("start_button")
    assert not operator.window.app.engine_link.running
    assert "the calibration of 'Rate table A' of station 'test bench' was due on 2021-03-02" in operator.says()
    operator.press("override_choice")


@pytest.mark.usefixtures("engineer_page")
@pytest.mark.long
def test_engineer_overrides_an_overdue_certificate(operator: Operator) -> None:
    use(operator, {}, instruments=OVERDUE)
    access.set_pin("", "000000")
    refused(operator)
    fill(operator, "override", reason="table is at the laboratory", badge="Li Na", pin="999999")
    operator.press("override_confirm_button")
    assert "PIN" in operator.says()
    assert not operator.window.app.engine_link.running, "a wrong PIN starts nothing"
    fill(operator, "override", pin="000000")
    operator.press("override_confirm_button")
    operator.until(lambda: operator.verdict)
    assert operator.verdict == "PASS", operator.says()
    operator.until_ended()
    (result,) = operator.site_folder.runs.glob("*.json")
    assert load_result(result).standard_override == "table is at the laboratory"
    note = (
        "Calibrated despite an overdue or failed check standard or an expired certificate: table is at the laboratory"
    )
    for page in ("operator_page", "engineer_page", "history_page"):
        operator.window.show_page(page)
        operator.until(lambda: note in operator.says())
    events = events_of(operator)
    (event,) = [each for each in events if each.event == "standard_overridden"]
    assert (event.by, event.confirmed_by) == ("Li Na", None)


@pytest.mark.long
def test_second_engineer_confirms_an_override_if_the_product_requires_two(operator: Operator) -> None:
    use(operator, {"confirmation": {"required_for": ["override"]}}, instruments=OVERDUE, sign_in=ENGINEERS)
    access.set_pin("", "000000")
    for badge, pin in PINS.items():
        access.set_pin("000000", pin, badge)
    edit = operator.widget("operator_edit", QLineEdit)
    operator.qtbot.keyClicks(edit, "B0003\r")
    refused(operator)
    people = {"badge": "B0001", "pin": "111111", "second_badge": "B0001", "second_pin": "111111"}
    fill(operator, "override", reason="table is at the laboratory", **people)
    operator.press("override_confirm_button")
    assert not operator.window.app.engine_link.running, "one engineer is not two"
    fill(operator, "override", pin="111111", second_badge="B0002", second_pin="222222")
    operator.press("override_confirm_button")
    operator.until(lambda: operator.verdict)
    assert operator.verdict == "PASS", operator.says()
    operator.until_ended()
    events = events_of(operator)
    (event,) = [each for each in events if each.event == "standard_overridden"]
    assert (event.by, event.confirmed_by) == ("B0001", "B0002")


def run_and_issue(operator: Operator) -> None:
    """Calibrate a unit and issue its certificate from the verdict."""
    operator.scan(SERIAL)
    operator.press("start_button")
    operator.until(lambda: operator.verdict)
    operator.until_ended()
    operator.press("certificate_button")
    operator.until(lambda: "The certificate was issued" in operator.says())


@pytest.mark.long
def test_certificate_is_issued_from_the_verdict_and_from_the_history(
    operator: Operator, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[Path] = []

    def open_url(url: QUrl) -> bool:
        opened.append(Path(QUrl.toLocalFile(url)))
        return True

    monkeypatch.setattr(QDesktopServices, "openUrl", open_url)
    use(operator, {})
    run_and_issue(operator)
    operator.press("certificate_open_button")
    (pdf,) = opened
    assert pdf.parent == operator.site_folder.runs.parent / "certificates"
    assert SERIAL in pypdf.PdfReader(pdf).pages[0].extract_text()
    before = pdf.read_bytes()
    operator.window.show_page("history_page")
    operator.until(lambda: operator.widget("history_certificate_button").isVisible())
    operator.press("history_certificate_button")
    operator.until(lambda: f"Certificate {pdf.stem} was issued on" in operator.says())
    assert opened == [pdf]
    operator.press("certificate_open_button")
    assert opened == [pdf, pdf], "the certificate that was issued"
    assert pdf.read_bytes() == before
    operator.window.app.set_language("zh_CN")
    operator.press("history_certificate_button")
    operator.until(lambda: "证书已重新打印" in operator.says())
    assert pdf.with_name(f"{pdf.stem}_zh.pdf").exists(), "the same certificate in the other language"
    operator.window.app.set_language("en")
    templates = operator.site_folder.home / "reports"
    templates.mkdir()
    shipped = (shipped_folder() / "reports" / "texts.toml").read_text(encoding="utf-8")
    (templates / "texts.toml").write_text(shipped.replace("Calibration certificate", "Works certificate"), "utf-8")
    operator.press("certificate_close_button")
    operator.press("history_certificate_button")
    operator.until(lambda: "have changed since" in operator.says())
    operator.press("certificate_revise_button")
    note = operator.widget("history_certificate_button_note_label", QLabel)
    assert note.text() == "Laboratory and customer come from the log of the run; a revision cannot correct them."
    fill(operator, "history_certificate_button", reason="new form", badge="Li Na")
    operator.press("history_certificate_button_confirm_button")
    operator.until(lambda: "The certificate was issued" in operator.says())
    revised = " ".join(pypdf.PdfReader(pdf.with_name(f"{pdf.stem}-R1.pdf")).pages[0].extract_text().split())
    assert "Works certificate" in revised
    assert "new form" in revised
    operator.press("certificate_close_button")
    operator.press("history_record_button")
    table = operator.widget("certificates_table", QTableView)
    operator.until(lambda: table.model().rowCount() == 2)
    states = [[table.model().index(row, column).data() for column in (0, 2)] for row in range(2)]
    assert states == [[pdf.stem, "replaced"], [f"{pdf.stem}-R1", "valid"]]
    operator.press("open_certificate_button")
    revision = pdf.with_name(f"{pdf.stem}-R1.pdf")
    assert opened[-1] == revision
    content = revision.read_bytes()
    revision.write_bytes(content + b"\n")
    operator.press("open_certificate_button")
    assert f"{revision.name} was changed after the certificate was issued" in operator.says()
    assert len(opened) == 3
    operator.press("certificate_close_button")
    operator.press("record_back_button")
    operator.press("history_record_button")
    operator.until(lambda: table.model().index(1, 2).data() == "file changed")
    operator.press("record_back_button")
    operator.press("history_certificate_button")
    operator.until(lambda: f"{revision.name} was changed after the certificate was issued" in operator.says())
    assert not operator.window.findChildren(QPushButton, "certificate_open_button"), "not offered"
    listed = operator.widget("history_events_table", QTableView).model()
    lines = [str(listed.index(row, listed.columnCount() - 1).data()) for row in range(listed.rowCount())]
    assert "Six positions ended: its plan is complete." in lines
    events = [each for each in events_of(operator) if each.event == "certificate"]
    assert [(each.by, each.values["pin"], each.why) for each in events][1:] == [("Li Na", None, "new form")]


@pytest.mark.long
@pytest.mark.parametrize("code", ["en", "zh_CN"])
def test_panel_for_two_engineers_fits_a_small_screen(operator: Operator, code: str) -> None:
    window = operator.window
    window.resize(1280, 720)
    window.app.set_language(code)
    row = {"value": 3e-5, "sigma": 1e-8, "unit": "rad/s", "stage": "rate"}
    result = {**RESULT, "stages": ["rate"], "passed": True, "parameters": {"gyro_bias_x": row}}
    link = window.app.engine_link
    link.event.emit(StateChanged("running", "idle"))
    link.event.emit(StateChanged("done", "running"))
    link.event.emit(Finalized(Verdict.PASSED, "SN-000042_x.h5", "SN-000042_x.json", result))
    operator.until(lambda: operator.verdict)
    details = operator.widget("details_button", QPushButton)
    assert details.isVisible()
    both = ConfirmationRequired(pin=True, badge=True, second=True)
    panel = operator.widget("certificate_button_panel", PeoplePanel)
    panel.ask(lambda: "Issue a certificate?", both, lambda *people: None, reason=False, received=True)
    edits = [operator.widget(f"certificate_button_{key}_edit", QLineEdit) for key in (*PEOPLE, "received")]
    inputs = [*edits, operator.widget("certificate_button_confirm_button", QPushButton)]

    def laid_out() -> bool:
        apart = all(upper.geometry().bottom() < lower.geometry().top() for upper, lower in pairwise(edits))
        return apart and all(each.visibleRegion().boundingRect() == each.rect() for each in inputs)

    operator.until(laid_out)
    assert not details.isVisible(), "both do not fit"
    operator.press("certificate_button_cancel_button")
    assert details.isVisible()


@pytest.mark.usefixtures("engineer_page")
@pytest.mark.long
def test_two_engineers_confirm_a_certificate(operator: Operator) -> None:
    report = {"folder": "reports", "language": "en"}
    (operator.site_folder.station.parent / "reports").mkdir(exist_ok=True)
    use(operator, {"confirmation": {"required_for": ["certificate"]}}, sign_in=ENGINEERS, report=report)
    access.set_pin("", "000000")
    for badge, pin in PINS.items():
        access.set_pin("000000", pin, badge)
    operator.qtbot.keyClicks(operator.widget("operator_edit", QLineEdit), "B0001\r")
    operator.scan(SERIAL)
    operator.press("start_button")
    operator.until(lambda: operator.verdict)
    operator.until_ended()
    for page in ("engineer_page", "operator_page"):
        operator.window.show_page(page)
        operator.until(lambda: "The certificate waits for two people" in operator.says())
    operator.press("certificate_button")
    operator.until(lambda: operator.widget("certificate_button_panel").isVisible())
    assert operator.widget("certificate_button_received_edit", QLineEdit).text() == ""
    fill(operator, "certificate_button", badge="B0001", pin="111111", second_badge="B0002", second_pin="222222")
    fill(operator, "certificate_button", received="2021-02-31")
    assert not operator.widget("certificate_button_confirm_button").isEnabled()
    fill(operator, "certificate_button", received="2021-02-28")
    operator.press("certificate_button_confirm_button")
    operator.until(lambda: "The certificate was issued" in operator.says())
    events = events_of(operator)
    (event,) = [each for each in events if each.event == "certificate"]
    assert (event.by, event.confirmed_by, event.values["pin"]) == ("B0001", "B0002", "personal")
    assert event.values["received"] == "2021-02-28"
    (pdf,) = (operator.site_folder.station.parent / "reports").glob("*.pdf")
    assert "Issued by B0001, B0002. Identity proved by personal PIN." in " ".join(
        " ".join(page.extract_text() for page in pypdf.PdfReader(pdf).pages).split()
    )


@pytest.mark.long
@pytest.mark.parametrize(("code", "words"), [("en", "Nobody has signed in. Scan your badge"), ("zh_CN", "尚未登录")])
def test_first_certificate_is_issued_by_whoever_has_signed_in(operator: Operator, code: str, words: str) -> None:
    """An engineer who unlocked the engineer role with a personal PIN is identified by it."""
    names = {"B0001": "Li Na", "B0002": "Wang Wei"}
    use(operator, {}, sign_in={**ENGINEERS, "names": names})
    access.set_pin("", "000000")
    access.set_pin("000000", PINS["B0001"], "B0001")
    window, badge = operator.window, operator.widget("operator_edit", QLineEdit)
    window.app.set_language(code)
    operator.qtbot.keyClicks(badge, "B0002\r")
    operator.scan(SERIAL)
    operator.press("start_button")
    operator.until(lambda: operator.verdict)
    operator.until_ended()
    operator.press("sign_out_button")
    operator.press("certificate_button")
    operator.until(lambda: words in operator.says())
    assert not [each for each in events_of(operator) if each.event == "certificate"]
    operator.press("role_button")
    fields = {"role_person_edit": "B0001", "pin_edit": PINS["B0001"]}
    for name, text in fields.items():
        operator.widget(name, QLineEdit).clear()
        operator.qtbot.keyClicks(operator.widget(name, QLineEdit), text)
    operator.press("unlock_button")
    assert window.app.role.engineer
    operator.press("certificate_button")
    operator.until(lambda: say("operator.certificate_issued") in operator.says())
    (event,) = [each for each in events_of(operator) if each.event == "certificate"]
    assert (event.by, event.values["pin"], event.values["authorised"]) == (
        "Li Na (B0001)",
        "personal",
        ["Li Na (B0001)"],
    )
    window.app.set_language("en")


def _positions(operator: Operator) -> list[int]:
    """Return the positions of the visible fields for a revision, which do not overlap and are in sight."""
    edits = [operator.widget(f"history_certificate_button_{key}_edit", QLineEdit) for key in ("reason", *PEOPLE)]
    edits = [each for each in edits if each.isVisible()]

    def laid_out() -> bool:
        apart = all(upper.geometry().bottom() < lower.geometry().top() for upper, lower in pairwise(edits))
        return apart and all(each.visibleRegion().boundingRect() == each.rect() for each in edits)

    operator.qtbot.wait(50)  # until changed texts are laid out
    operator.until(laid_out)
    return [each.mapTo(operator.window, each.rect().topLeft()).y() for each in edits]


@pytest.mark.long
@pytest.mark.parametrize("code", ["en", "zh_CN"])
def test_panel_for_a_revision_by_two_engineers_fits_a_small_screen(operator: Operator, code: str) -> None:
    use(operator, {})
    run_and_issue(operator)
    operator.window.app.set_language(code)
    operator.window.show_page("history_page")
    operator.until(lambda: operator.widget("history_certificate_button").isVisible())
    panel = operator.widget("history_certificate_button_panel", PeoplePanel)
    both = ConfirmationRequired(pin=True, badge=True, second=True)
    title = Text.of("operator.why_revised", number="SN-000042_20261129T155424197755")
    panel.ask(title, both, lambda *_: None, note="operator.revision_same", received=True)
    before = _positions(operator)
    assert len(before) == 5
    panel.retry(ConfigurationError("confirmation.not_engineer", badge="B0003"))
    assert "B0003" in operator.says()
    assert _positions(operator) == before
    operator.window.app.set_language("en")


@pytest.mark.parametrize(("code", "why"), [("en", "The reason contains the PIN"), ("zh_CN", "理由中含有 PIN 码")])
@pytest.mark.parametrize("typed", ["111111", "222222"])
def test_panel_refuses_a_reason_with_a_pin(qtbot: QtBot, code: str, why: str, typed: str) -> None:
    language.use(code)
    panel, confirmed = PeoplePanel("override"), []
    qtbot.addWidget(panel)
    panel.ask("", ConfirmationRequired(pin=True, badge=True, second=True), lambda *people: confirmed.append(people))
    fields = {"reason": f"shock {typed}", "badge": "B0001", "second_badge": "B0002"}
    for key, text in (*fields.items(), ("pin", "111111"), ("second_pin", "222222")):
        panel.findChild(QLineEdit, f"override_{key}_edit").setText(text)
    panel._confirm_button.click()
    assert why in panel.findChild(QLabel, "override_refusal_label").text()
    assert confirmed == []
    for key, text in (("reason", "shock test"), ("pin", "111111"), ("second_pin", "222222")):
        panel.findChild(QLineEdit, f"override_{key}_edit").setText(text)
    panel._confirm_button.click()
    assert [reason for reason, *_ in confirmed] == ["shock test"]
    language.use("en")


def issue_slowly(report: ProgressCallback) -> None:
    """Job: stand in for the issue of a certificate."""
    time.sleep(0.3)


@pytest.mark.long
@pytest.mark.parametrize(("code", "progress"), [("en", "Certificate, 0 %"), ("zh_CN", "证书，0 %")])
def test_panel_shows_the_progress_of_a_confirmed_certificate(operator: Operator, code: str, progress: str) -> None:
    operator.window.app.set_language(code)
    certificate = operator.window.operator_page._verdict.certificate_button
    panel, watch = certificate.panel, certificate.watch
    once = ConfirmationRequired(pin=False, badge=False, second=False)
    panel.ask("", once, lambda *_: watch.start(), reason=False)
    panel.findChild(QLineEdit, "certificate_button_badge_edit").setText("Li")
    panel.retry(ConfigurationError("confirmation.not_engineer", badge="B0003"))
    refusal = panel.findChild(QLabel, "certificate_button_refusal_label")
    assert "B0003" in refusal.text()
    watch._submit = partial(operator.window.app.job_queue.submit, issue_slowly)
    watch.done.disconnect()
    confirm = panel._confirm_button
    confirm.click()
    assert refusal.text() == "", "the earlier refusal is answered"
    assert (confirm.isEnabled(), confirm.text()) == (False, progress)
    operator.until(confirm.isEnabled)
    assert confirm.text() == say("window.confirm")
    operator.window.app.set_language("en")


@pytest.mark.long
def test_revision_is_issued_only_by_an_engineer_with_a_pin(operator: Operator) -> None:
    use(operator, {}, sign_in=ENGINEERS)
    access.set_pin("", "000000")
    access.set_pin("000000", PINS["B0001"], "B0001")
    operator.qtbot.keyClicks(operator.widget("operator_edit", QLineEdit), "B0003\r")
    run_and_issue(operator)
    operator.press("certificate_close_button")
    operator.window.show_page("history_page")
    operator.until(lambda: operator.widget("history_certificate_button").isVisible())
    operator.press("history_certificate_button")
    operator.until(lambda: "was issued on" in operator.says())
    operator.press("certificate_revise_button")
    note = operator.widget("history_certificate_button_note_label", QLabel)
    for new in ("issuer", "reason", "audit-trail line", "date of receipt entered here"):
        assert new in note.text()
    operator.window.app.set_language("zh_CN")
    for new in ("签发人", "理由", "审计记录", "此处填写的接收日期"):
        assert new in note.text()
    operator.window.app.set_language("en")
    fields = {"reason": "typing error", "badge": "Dr A. Li", "pin": "111111"}
    fill(operator, "history_certificate_button", **fields)
    for changed, answer in (
        ({}, "Badge Dr A. Li does not belong to an engineer of this station"),
        ({"badge": "B0001", "pin": "999999"}, "The PIN of B0001 is wrong"),
        ({"pin": "111111"}, "The certificate was issued"),
    ):
        fields |= changed
        fill(operator, "history_certificate_button", **changed)
        if "pin" not in changed:
            fill(operator, "history_certificate_button", pin=fields["pin"])
        fields_at = _positions(operator)
        operator.press("history_certificate_button_confirm_button")
        operator.until(lambda text=answer: text in operator.says())
        if "issued" not in answer:
            assert _positions(operator) == fields_at, "whoever types goes on in the same field"
        edits = {key: operator.widget(f"history_certificate_button_{key}_edit", QLineEdit) for key in fields}
        issued = answer == "The certificate was issued"
        assert edits["reason"].isVisible() != issued
        assert issued or {key: edit.text() for key, edit in edits.items()} == {**fields, "pin": ""}
    (pdf,) = (operator.site_folder.runs.parent / "certificates").glob("*-R1.pdf")
    operator.press("certificate_close_button")
    pdf.unlink()
    operator.press("history_certificate_button")
    operator.until(lambda: "The certificate was printed again" in operator.says())
    operator.press("certificate_close_button")
    events = [(each.by, each.values["pin"]) for each in events_of(operator) if each.event == "certificate"]
    assert events == [("B0003", None), ("B0001", "personal")]
    operator.press("history_record_button")
    table = operator.widget("certificates_table", QTableView)
    operator.until(lambda: table.model().rowCount() == 2)
    assert [table.model().index(row, 3).data() for row in range(2)] == ["B0003 (not authenticated)", "B0001"]


@pytest.mark.long
def test_certificate_of_a_simulated_run_is_asked_about_at_a_station_with_hardware(operator: Operator) -> None:
    use(operator, {})
    operator.scan(SERIAL)
    operator.press("start_button")
    operator.until(lambda: operator.verdict)
    operator.until_ended()
    devices = {"table": {"profile": "bench", "port": "tcp://127.0.0.1:9"}, "imu": {"port": "socket://127.0.0.1:9"}}
    operator.site_folder.station.write_text(tomli_w.dumps({**STATION, **devices}), encoding="utf-8")
    operator.window.app.set_station(operator.site_folder.station)
    operator.window.show_page("history_page")
    operator.until(lambda: operator.widget("history_certificate_button").isVisible())
    operator.press("history_certificate_button")
    operator.until(lambda: "This run is simulated: issue a certificate?" in operator.says())
    operator.window.app.set_language("zh_CN")
    assert "没有标定任何产品" in operator.says()
    operator.window.app.set_language("en")
    operator.press("certificate_close_button")
    assert not [each for each in events_of(operator) if each.event == "certificate"]
    operator.press("history_certificate_button")
    operator.until(lambda: "This run is simulated" in operator.says())
    operator.press("certificate_simulated_button")
    operator.until(lambda: "The certificate was issued" in operator.says())
    (event,) = [each for each in events_of(operator) if each.event == "certificate"]
    assert event.values["simulated"] is True


@pytest.mark.usefixtures("engineer_page")
@pytest.mark.long
def test_run_reports_a_missing_certificate_folder(operator: Operator) -> None:
    use(operator, {}, report={"folder": "unmounted"})
    operator.scan(SERIAL)
    operator.press("start_button")
    operator.until(lambda: operator.verdict)
    operator.until_ended()
    missing = operator.site_folder.station.parent / "unmounted"
    for page in ("engineer_page", "operator_page"):
        operator.window.show_page(page)
        operator.until(lambda: f"No certificate was created: {missing}, which [report]" in operator.says())


@pytest.mark.parametrize(
    ("code", "title", "why"),
    [
        ("en", "Date of receipt", "The date of receipt must be a date such as 2026-11-23."),
        ("zh_CN", "收样日期", "收样日期须为日期，例如 2026-11-23。"),
    ],
)
def test_panel_asks_for_the_date_of_receipt_of_a_certificate(qtbot: QtBot, code: str, title: str, why: str) -> None:
    language.use(code)
    panel, received = PeoplePanel("certificate"), []
    qtbot.addWidget(panel)
    once = ConfirmationRequired(pin=False, badge=False, second=False)
    panel.ask("", once, lambda *_: received.append(panel.received), by="Li", received=True)
    panel.findChild(QLineEdit, "certificate_reason_edit").setText("typing error")
    edit, confirm = panel.findChild(QLineEdit, "certificate_received_edit"), panel._confirm_button
    assert title in [each.text() for each in panel.findChildren(QLabel) if not each.isHidden()]
    said = panel.findChild(QLabel, "certificate_refusal_label")
    panel.resize(panel.sizeHint())
    panel.show()
    height = panel.sizeHint().height()
    shown = edit.contentsRect().width() - 2 * 2  # inside the margins of the text
    assert edit.fontMetrics().horizontalAdvance(edit.placeholderText()) < shown
    for wrong in ("31.12.2026", "2026-11-31"):
        edit.setText(wrong)
        assert not confirm.isEnabled()
        assert why in confirm.toolTip()
        assert said.text() == why
        assert panel.sizeHint().height() == height, "the fields stay where they are"
    for text in ("2026-12-31", ""):
        edit.setText(text)
        assert said.text() == ""
        confirm.click()
    assert received == [date(2026, 12, 31), None]
    panel.ask("", once, lambda *_: None, by="Li")
    assert edit.isHidden(), "only a certificate states it"
    language.use("en")
