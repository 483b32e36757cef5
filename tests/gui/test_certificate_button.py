"""The button that issues the certificate of the selected run."""

import time
from pathlib import Path

import pytest
from PySide6.QtCore import Qt
from pytestqt.qtbot import QtBot

from calstation.config import ConfirmationRequired
from calstation.gui.operator import CertificateButton
from calstation.gui.operator.production import document_buttons
from calstation.gui.state import AppContext
from calstation.gui.text import language
from calstation.gui.widgets import NoticeBar
from calstation.jobs import ProgressCallback
from calstation.messages import Language
from calstation.reports import IssueState, ReportRequest
from calstation.results import SCHEMA, Result

pytestmark = pytest.mark.timeout(60)


def state_of(report: ProgressCallback, file: Path, station: Path | None, language: Language) -> IssueState:
    """Job: stand in for the settings of a certificate."""
    required = ConfirmationRequired(pin=False, badge=False, second=False)
    return IssueState(ReportRequest(file, file.parent, language), required)


def issue(report: ProgressCallback, request: ReportRequest) -> Path:
    """Job: stand in for the issue of a certificate, which ends when the file ``go`` exists."""
    while not (request.out / "go").exists():
        report(0.5)
        time.sleep(0.02)
    return request.out / "a.pdf"


@pytest.mark.parametrize(
    ("code", "during", "title"), [("en", "Certificate, 50 %", "Certificate"), ("zh_CN", "证书，50 %", "证书")]
)
def test_progress_of_a_certificate_is_shown_only_at_its_run(
    app: AppContext, qtbot: QtBot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: str, during: str, title: str
) -> None:
    monkeypatch.setattr(document_buttons, "issue_state", state_of)
    monkeypatch.setattr(document_buttons, "issue_certificate", issue)
    language.use(code)
    rows = {"gyro_bias_x": {"value": 1.0, "sigma": 1.0}}
    run = {"schema": SCHEMA, "unit": {"serial": "SN-1"}, "stages": [], "outcome": "passed", "parameters": rows}
    result = Result.from_json({**run, "log": {"file": "a.h5"}})
    notice = NoticeBar()
    button = CertificateButton(app, "certificate", notice, lambda: None)
    for widget in (notice, button):
        qtbot.addWidget(widget)
    button.offer(result, tmp_path / "a.json")
    qtbot.mouseClick(button, Qt.MouseButton.LeftButton)
    qtbot.waitUntil(lambda: button.text() == during, timeout=30_000)
    button.offer(result, tmp_path / "b.json")
    assert button.text().startswith(title)
    assert "50" not in button.text()
    assert not button.isEnabled(), "one certificate is made at a time"
    button.offer(result, tmp_path / "a.json")
    assert button.text() == during
    (tmp_path / "go").touch()
    qtbot.waitUntil(button.isEnabled, timeout=30_000)
    language.use("en")
