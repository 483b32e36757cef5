"""Help in the window: F1, the manual with its links and search, facts about the program, and its place in a package."""

import json
import re
import shutil
from pathlib import Path

import pytest
from PySide6.QtCore import QPoint, Qt, QUrl
from PySide6.QtGui import QDesktopServices
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QLineEdit, QListWidget, QPushButton, QTextBrowser, QWidget

import calstation
from calstation.config import library
from calstation.errors import DeviceFaultError
from calstation.gui.help import manual
from calstation.gui.help.page import HelpPage
from calstation.gui.shell.main_window import MainWindow
from calstation.records import append_audit
from calstation.sequencer import Fault
from calstation.validation import Validation
from calstation.validation.lines import Line
from calstation.validation.report import signed_json
from tests.gui.conftest import Operator, SiteFolder
from tests.gui.test_operator_events import end_run, simulated_run

__all__ = ["simulated_run"]  # fixture

pytestmark = pytest.mark.usefixtures("job_queue")
#: What F1 shows on each page as it is first opened: the chapter and the heading at the top.
PLACES = {
    "operator_page": ("how-to/operate.md", "Calibrate a unit"),
    "engineer_page": ("explanation/estimation.md", "Partial runs"),
    "offline_page": ("how-to/resolve-a-log.md", "Solve a stored log again"),
    "history_page": ("how-to/history.md", "Filter"),
    "quality_page": ("how-to/quality.md", "Control charts"),
    "station_page": ("how-to/connect.md", "In six steps"),
}
DOCS = sorted(file for file in library.manual_folder().rglob("*.md") if file.parent.name != "changes")


def press_f1(window: MainWindow) -> HelpPage:
    """Press F1 at the focus of the window, and return the Help page."""
    window.activateWindow()
    QTest.keyClick(window.focusWidget() or window, Qt.Key.Key_F1)
    page = window.findChild(HelpPage)
    assert page is not None
    assert page.isVisible()
    return page


def first_line(browser: QTextBrowser) -> str:
    """Return the text of the line at the top of the view."""
    return browser.cursorForPosition(QPoint(40, 12)).block().text()


@pytest.mark.long
def test_f1_opens_the_manual_at_the_place_that_fits_the_page(window: MainWindow) -> None:
    for name, (chapter, heading) in PLACES.items():
        window.show_page(name)
        page = press_f1(window)
        assert page.target == chapter
        scrolled = page.browser.verticalScrollBar()
        assert first_line(page.browser) == heading or scrolled.value() == scrolled.maximum(), name
        press_f1(window)
        assert page.target == chapter  # F1 on the Help page leaves it as it is


@pytest.mark.long
def test_links_lead_to_other_chapters_and_back_and_search_finds_sections(window: MainWindow) -> None:
    page = press_f1(window)
    page.open("how-to/history.md")
    link = QUrl.fromLocalFile(str(library.manual_folder() / "how-to" / "many-stations.md"))
    page.browser.anchorClicked.emit(link)
    assert page.target == "how-to/many-stations.md"
    back = window.findChild(QPushButton, "manual_back_button")
    QTest.mouseClick(back, Qt.MouseButton.LeftButton)
    assert page.target == "how-to/history.md"
    edit, found = window.findChild(QLineEdit, "manual_search_edit"), window.findChild(QListWidget, "manual_list")
    QTest.keyClicks(edit, "gauge study")
    texts = [found.item(row).text() for row in range(found.count())]
    assert texts[1] == "Gauge study  ·  Watch quality over time"
    QTest.mouseClick(found.viewport(), Qt.MouseButton.LeftButton, pos=found.visualItemRect(found.item(1)).center())
    assert page.target == "how-to/quality.md"
    assert page.browser.extraSelections()
    edit.clear()
    QTest.keyClick(edit, Qt.Key.Key_Backspace)
    QTest.keyClicks(edit, "no such words anywhere")
    assert found.count() == 1


@pytest.mark.long
def test_about_shows_version_licences_and_the_folder_of_logs(
    window: MainWindow, site_folder: SiteFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("CALSTATION_LOG_FOLDER", raising=False)
    opened: list[QUrl] = []
    monkeypatch.setattr(QDesktopServices, "openUrl", lambda url: opened.append(url))
    page = press_f1(window)
    QTest.mouseClick(window.findChild(QPushButton, "about_button"), Qt.MouseButton.LeftButton)
    for code, logs in (("zh_CN", "程序日志"), ("en", "Application logs")):
        window.app.set_language(code)
        text = page.browser.toPlainText()
        assert calstation.__version__ in text
        assert logs in text
        assert str(site_folder.home / "logs") in text
    page.browser.open(QUrl.fromLocalFile(str(site_folder.home / "logs")))
    assert opened == [QUrl.fromLocalFile(str(site_folder.home / "logs"))]
    for name, words in (("calstation", "MIT License"), ("font", "SIL OPEN FONT LICENSE"), ("numpy", "NumPy")):
        page.browser.open(QUrl(f"help:licence/{name}"))
        assert words.lower() in page.browser.toPlainText().lower(), name


def click_link(browser: QTextBrowser, text: str) -> None:
    """Click a link by its text."""
    cursor = browser.document().find(text)
    assert not cursor.isNull(), text
    browser.setTextCursor(cursor)
    browser.ensureCursorVisible()
    cursor.setPosition(cursor.selectionStart() + 1)
    QTest.mouseClick(browser.viewport(), Qt.MouseButton.LeftButton, pos=browser.cursorRect(cursor).center())


@pytest.mark.long
@pytest.mark.parametrize(
    ("code", "verdict", "none", "missing", "altered"),
    [
        ("en", "Incomplete", "No record in the folder", "is missing", "validation_20261127T100000Z.json was changed"),
        ("zh_CN", "不完整", "没有记录", "缺少", "validation_20261127T100000Z.json 在站点签名后被改动"),
    ],
)
def test_about_lists_validations_and_opens_their_documents(
    window: MainWindow,
    site_folder: SiteFolder,
    monkeypatch: pytest.MonkeyPatch,
    code: str,
    verdict: str,
    none: str,
    missing: str,
    altered: str,
) -> None:
    opened: list[QUrl] = []
    monkeypatch.setattr(QDesktopServices, "openUrl", lambda url: opened.append(url))
    window.app.set_language(code)
    page = press_f1(window)
    about = window.findChild(QPushButton, "about_button")
    QTest.mouseClick(about, Qt.MouseButton.LeftButton)
    assert none in page.browser.toPlainText()
    append_audit(site_folder.home, "validation_begun", "")
    folder = site_folder.runs.parent / "validation"
    folder.mkdir()
    line = Line("rights", "recorded", "", "", "", "not_checked")
    for day in (26, 27, 28):
        validation = Validation("pc", "Linux", "li", "1", {}, f"2026-11-{day}T10:00:00+00:00", 1.0, (line,))
        data, _ = signed_json(validation)
        if day == 27:
            data["verdict"] = "passed"
        (folder / f"{validation.name}.json").write_text(json.dumps(data), "utf-8")
    pdf = folder / "validation_20261128T100000Z.pdf"
    pdf.write_bytes(b"%PDF")
    page.open("index.md")
    QTest.mouseClick(about, Qt.MouseButton.LeftButton)
    text = page.browser.toPlainText()
    assert none not in text
    assert text.count(verdict) == 2
    assert altered in text
    assert missing in text
    click_link(page.browser, "PDF")
    assert opened == [QUrl.fromLocalFile(str(pdf))]
    window.app.set_language("en")


@pytest.mark.long
def test_every_place_and_every_link_of_the_manual_exists(window: MainWindow) -> None:
    anchors = {file.resolve(): {manual.anchor(each.heading) for each in sections(file)} for file in DOCS}
    links = [(library.manual_folder() / "x.md", page.manual) for page in opened_pages(window) if page.manual]
    assert len(links) == len(PLACES)
    for file in DOCS:
        links += [(file, link) for link in re.findall(r"\]\(([^)\s]+)\)", file.read_text(encoding="utf-8"))]
    missing = []
    for file, link in links:
        path, _, anchor = link.partition("#")
        target = (file.parent / path).resolve() if path else file.resolve()
        if not link.startswith("http") and (not target.exists() or (anchor and anchor not in anchors[target])):
            missing.append((file.name, link))
    assert missing == []


@pytest.mark.long
def test_chinese_window_shows_chinese_chapters_and_says_where_there_is_none(window: MainWindow) -> None:
    page = press_f1(window)
    window.app.set_language("zh_CN")
    page.open("explanation/verdict.md#the-verdict")
    assert page.target == "explanation/verdict.md"
    scrolled = page.browser.verticalScrollBar()
    assert first_line(page.browser) == "结论" or scrolled.value() == scrolled.maximum()
    assert "只用于 passed" in page.browser.toPlainText()
    page.browser.open(page.browser.source().resolved(QUrl("../how-to/certificates.md#the-values")))
    assert page.target == "how-to/certificates.md"
    assert page.browser.toPlainText().startswith("本章只有英文版。")
    edit, found = window.findChild(QLineEdit, "manual_search_edit"), window.findChild(QListWidget, "manual_list")
    texts = [found.item(row).text() for row in range(found.count())]
    assert "第一次标定" in texts
    assert [text for text in texts if text.endswith("（英文）")], "chapters that are not translated say so"
    assert all(text.isascii() is False for text in texts if text != "calstation"), "English titles are marked"
    assert len(texts) == len(set(texts)), "no chapter is listed in both languages"
    edit.insert("装夹位")  # as an input method does
    texts = [found.item(row).text() for row in range(found.count())]
    item = found.item(texts.index("描述装夹位  ·  同时标定多台产品"))
    QTest.mouseClick(found.viewport(), Qt.MouseButton.LeftButton, pos=found.visualItemRect(item).center())
    assert page.target == "how-to/several-units.md"
    assert first_line(page.browser) == "描述装夹位"
    window.app.set_language("en")
    assert "Describe the slots" in page.browser.toPlainText()
    assert "本章" not in page.browser.toPlainText()


def sections(file: Path) -> tuple[manual.Section, ...]:
    return manual.sections(file.relative_to(library.manual_folder()).as_posix())


def opened_pages(window: MainWindow) -> list[QWidget]:
    return [tab.page for tab in window._tabs.values()]


def test_an_installed_program_has_the_manual(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    project = (library.manual_folder().parent / "pyproject.toml").read_text(encoding="utf-8")
    assert 'docs = "calstation/docs"' in project  # what the wheel contains besides the packages
    assert 'LICENSE = "calstation/LICENSE"' in project
    installed = tmp_path / "site-packages" / "calstation"
    shutil.copytree(library.manual_folder(), installed / "docs")
    monkeypatch.setattr(library, "__file__", str(installed / "config" / "library.py"))
    assert library.manual_folder() == installed / "docs"


@pytest.mark.long
@pytest.mark.usefixtures("engineer_page")
@pytest.mark.parametrize("code", ["en", "zh_CN"])
def test_f1_during_and_after_a_run_opens_what_the_operator_needs(simulated_run: Operator, code: str) -> None:
    window, link = simulated_run.window, simulated_run.window.app.engine_link
    window.app.set_language(code)
    assert window.operator_page.manual == "how-to/operate.md#stop-at-once"
    end_run(simulated_run, "failed")
    page = press_f1(window)
    assert page.target == "how-to/operate.md"
    assert ("不得出厂" if code == "zh_CN" else "Do not ship it") in page.browser.toPlainText()
    link.event.emit(Fault.of(DeviceFaultError("program.internal", detail="x")))
    assert window.operator_page.manual == "how-to/operate.md#after-a-fault"
