"""The main window: pages, languages, themes, role, keyboard order."""

import json
import re
import subprocess
import sys
import time
from pathlib import Path
from typing import cast

import pytest
from helpers import ignore_progress
from PySide6.QtCore import QPoint, QRect, Qt
from PySide6.QtWidgets import QApplication, QComboBox, QLabel, QLineEdit, QPushButton, QTabWidget, QWidget
from pytestqt.qtbot import QtBot

from calstation.config import access
from calstation.gui.engineer import EngineerPage
from calstation.gui.operator.header import RunHeader
from calstation.gui.shell import create_window
from calstation.gui.shell.main_window import _PAGES, MainWindow
from calstation.gui.state import RolePanel
from calstation.gui.text import language
from calstation.gui.widgets import theme
from calstation.records import open_log
from calstation.runs import find_resumable
from tests.gui.conftest import SiteFolder

pytestmark = pytest.mark.usefixtures("job_queue")
#: Object names of the pages.
PAGES = list(_PAGES)


def opened(site_folder: SiteFolder, qtbot: QtBot) -> MainWindow:
    """A window opened with the settings of the site folder."""
    window = create_window(site_folder.station)
    assert isinstance(window, MainWindow)
    qtbot.addWidget(window)
    window.show()
    qtbot.waitExposed(window)
    return window


def test_pages_are_those_of_the_contract_in_this_order(window: MainWindow) -> None:
    contract = (Path(__file__).parents[2] / "docs" / "contract.md").read_text(encoding="utf-8")
    (pages,) = re.findall(r"`page_tabs` \(pages\s([^)]*)\)", contract)
    tabs = window.findChild(QTabWidget, "page_tabs")
    assert [tabs.widget(i).objectName() for i in range(tabs.count())] == re.findall(r"`(\w+)`", pages)


@pytest.mark.long
def test_stop_has_the_same_position_on_every_page(window: MainWindow, qtbot: QtBot) -> None:
    tabs = window.findChild(QTabWidget, "page_tabs")
    stop = window.findChild(QPushButton, "stop_button")
    before = stop.mapTo(window, stop.rect().topLeft())
    for page in PAGES:
        tabs.setCurrentWidget(window.findChild(QWidget, page))
        qtbot.wait(1)
        assert stop.isVisible(), page
        assert stop.isEnabled(), page
        assert stop.mapTo(window, stop.rect().topLeft()) == before, page
        assert window.childAt(stop.mapTo(window, stop.rect().center())) is stop, page


def test_english_is_listed_first(window: MainWindow) -> None:
    combo = window.findChild(QComboBox, "language_combo")
    assert combo.itemText(0) == "English"


@pytest.mark.long
def test_language_and_theme_are_restored(site_folder: SiteFolder, qtbot: QtBot) -> None:
    first = opened(site_folder, qtbot)
    first.language_combo.setCurrentIndex(1)
    first.app.set_theme("dark")
    first.close()
    second = opened(site_folder, qtbot)
    assert second.language_combo.currentText() == "中文"
    assert second.page_tabs.tabText(0) == "操作员"
    assert theme.current() == "dark"
    second.app.set_theme("light")
    second.app.set_language("en")
    second.close()


def test_first_pin_is_set_and_a_wrong_pin_refused(window: MainWindow, qtbot: QtBot) -> None:
    role, lock = window.app.role, window.findChild(QPushButton, "role_button")
    pin, again = window.findChild(QLineEdit, "pin_edit"), window.findChild(QLineEdit, "pin_again_edit")

    def press(button: QPushButton) -> None:
        qtbot.mouseClick(button, Qt.MouseButton.LeftButton)

    press(lock)
    assert again.isVisible()
    shortest = access.MIN_PIN_LENGTH
    for code, words in (("en", f"at least {shortest} characters"), ("zh_CN", f"至少 {shortest} 个字符")):
        language.use(code)
        assert any(words in label.text() for label in window.findChildren(QLabel) if label.isVisible())
    language.use("en")
    qtbot.keyClicks(window.findChild(QLineEdit, "role_person_edit"), "wang")
    qtbot.keyClicks(pin, "246813")
    qtbot.keyClicks(again, "246819")
    unlock = window.findChild(QPushButton, "unlock_button")
    press(unlock)
    assert not role.engineer
    again.clear()
    qtbot.keyClicks(again, "246813")
    qtbot.keyClick(again, Qt.Key.Key_Return)
    assert not role.engineer  # scanners send Enter, too
    press(unlock)
    assert role.engineer
    assert not pin.isVisible()
    press(lock)
    assert not role.engineer

    press(lock)
    assert not again.isVisible()
    qtbot.keyClicks(window.findChild(QLineEdit, "role_person_edit"), "wang")  # the lock has signed out
    qtbot.keyClicks(pin, "111111")
    qtbot.keyClick(pin, Qt.Key.Key_Return)
    assert not role.engineer
    assert "The PIN is wrong." in [label.text() for label in window.findChildren(QLabel) if label.isVisible()]
    for digit in "246813":
        (key,) = [b for b in window.findChildren(QPushButton) if b.text() == digit and b.isVisible()]
        if digit == "2":
            pin.clear()
        press(key)
    press(window.findChild(QPushButton, "unlock_button"))
    assert role.engineer


def test_pin_panel_covers_no_button_of_a_run_and_esc_closes_it_after_the_run(window: MainWindow, qtbot: QtBot) -> None:
    panel, run = window.findChild(RolePanel), window.app.run
    for size in ((1366, 768), (1280, 640), (900, 400)):
        window.resize(*size)
        QApplication.processEvents()
        qtbot.mouseClick(window.findChild(QPushButton, "role_button"), Qt.MouseButton.LeftButton)
        assert panel.isVisible()
        for name in ("start_button", "stop_button") if size[1] > 700 else ("stop_button",):
            each = window.findChild(QPushButton, name)
            assert not panel.geometry().intersects(QRect(each.mapTo(window, QPoint(0, 0)), each.size())), (size, name)
        assert window.rect().right() >= panel.geometry().right()
        qtbot.keyClick(panel.findChild(QLineEdit, "role_person_edit"), Qt.Key.Key_Escape)
        assert not panel.isVisible()
    qtbot.mouseClick(window.findChild(QPushButton, "role_button"), Qt.MouseButton.LeftButton)
    run.state = "running"
    qtbot.keyClick(window, Qt.Key.Key_Escape)
    assert (run.state, panel.isVisible()) == ("stopping", True)
    run.state = "idle"
    qtbot.keyClick(window, Qt.Key.Key_Escape)
    assert not panel.isVisible()


@pytest.mark.parametrize("where", ["silent engine", "other window"])
def test_esc_stops_a_run_that_may_be_in_progress_although_the_role_panel_is_open(
    window: MainWindow, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch, where: str
) -> None:
    run = window.app.run
    if where == "silent engine":
        run.state = "fault"
        monkeypatch.setattr(type(window.app.engine_link), "running", property(lambda _: True))
    else:
        run.set_elsewhere((("SN-1",), "running"))
    qtbot.mouseClick(window.findChild(QPushButton, "role_button"), Qt.MouseButton.LeftButton)
    assert window.findChild(RolePanel).isVisible()
    with qtbot.waitSignal(run.stop_pressed, timeout=1000):
        qtbot.keyClick(window, Qt.Key.Key_Escape)


def test_damaged_pin_file_is_explained(window: MainWindow, qtbot: QtBot, site_folder: SiteFolder) -> None:
    (site_folder.home / "engineer.json").write_text("{", encoding="utf-8")
    qtbot.mouseClick(window.findChild(QPushButton, "role_button"), Qt.MouseButton.LeftButton)
    pin = window.findChild(QLineEdit, "pin_edit")
    qtbot.keyClicks(window.findChild(QLineEdit, "role_person_edit"), "wang")
    qtbot.keyClicks(pin, "246813")
    qtbot.keyClick(pin, Qt.Key.Key_Return)
    assert not window.app.role.engineer
    (shown,) = [label.text() for label in window.findChildren(QLabel) if "engineer.json" in label.text()]
    assert shown.endswith("Remove it to set a new PIN.")


def test_buttons_are_wide_enough_for_their_texts_in_both_languages(window: MainWindow, qtbot: QtBot) -> None:
    for code in ("zh_CN", "en"):
        window.app.set_language(code)
        qtbot.wait(1)
        for button in window.findChildren(QPushButton):
            if button.isVisible() and button.text():
                spare = button.width() - button.fontMetrics().horizontalAdvance(button.text())
                assert spare >= 0, button.text()


@pytest.mark.long
def test_another_program_finds_the_widgets_that_the_contract_names(window: MainWindow) -> None:
    """`window` is made by `calstation.gui.create_window`; the inner names of a page exist once it has been shown."""
    names = ["serial_edit", "start_button", "operator_edit", "product_combo", "stop_button", "pause_button"]
    names += ["verdict_label", "stage_list", "run_progress", "message_label", "page_tabs", "language_combo"]
    names += ["stage_check_rate", "log_edit", "first_seq_spin", "last_seq_spin", "solve_button"]
    for page in ("operator", "engineer", "offline", "history", "quality", "station"):
        names.append(f"{page}_page")
        window.show_page(f"{page}_page")
    assert [name for name in names if window.findChild(QWidget, name) is None] == []


@pytest.mark.skipif(sys.platform == "win32", reason="SIGKILL exists only on POSIX systems")
@pytest.mark.exhaustive
def test_killed_window_stops_the_table_and_leaves_a_complete_resumable_log(site_folder: SiteFolder) -> None:
    site_folder.write({"stages": ["six_position", "rate"]})
    script = site_folder.folder / "at_the_window.py"
    script.write_text(
        "from calstation.gui import create_window\n"
        "from calstation.config import library\n"
        "from PySide6.QtWidgets import QApplication\n"
        "from PySide6.QtCore import QTimer\n"
        "if __name__ == '__main__':\n"
        "    from pathlib import Path\n"
        f"    window = create_window(Path({str(site_folder.station)!r}))\n"
        "    window.app.set_product(library.find('products', 'short'))\n"
        "    window.show()\n"
        "    QTimer.singleShot(0, window.operator_page.header.start_button.click)\n"
        "    run = window.app.run\n"
        "    def report():\n"
        "        if len(run.stages) > 1 and run.stages[1].fraction > 0.1:\n"
        "            print('in the second stage', flush=True)\n"
        "    run.changed.connect(report)\n"
        "    QApplication.exec()\n",
        encoding="utf-8",
    )
    listener = subprocess.Popen([sys.executable, str(script)], stdout=subprocess.PIPE, text=True)
    assert listener.stdout is not None
    assert listener.stdout.readline().strip() == "in the second stage"
    listener.kill()
    listener.wait()
    listener.stdout.close()
    deadline = time.monotonic() + 60.0
    while not (results := [p for p in site_folder.runs.glob("SN-*.json") if p.stat().st_size]):
        assert time.monotonic() < deadline
        time.sleep(0.1)
    (log,) = site_folder.runs.glob("SN-*.h5")
    while open_log(log).outcome is None:
        assert time.monotonic() < deadline
        time.sleep(0.1)
    assert open_log(log).outcome == "stopped"
    result = json.loads(results[0].read_text(encoding="utf-8"))
    assert (result["outcome"], result["stop_reason"]) == ("stopped", "listener_lost")
    (offered,) = find_resumable(ignore_progress, site_folder.runs)
    assert offered.finished == ("six_position",)


def test_tab_order_follows_reading_order(window: MainWindow, qtbot: QtBot) -> None:
    window.findChild(QLineEdit, "operator_edit").setFocus()
    seen = []
    for _ in range(4):
        seen.append(window.focusWidget().objectName())
        qtbot.keyClick(window.focusWidget(), Qt.Key.Key_Tab)
    assert seen == ["operator_edit", "serial_edit", "product_combo", "start_button"]


@pytest.mark.long
def test_window_starts_without_importing_the_solvers() -> None:
    """Compiled kernels, scipy.stats and the shared database would delay the first paint by more than a second."""
    script = (
        "import sys; from calstation.gui.shell import create_window; from PySide6.QtWidgets import QApplication\n"
        "window = create_window(); window.show(); QApplication.processEvents()\n"
        "window.create_engineer_page()\n"
        "late = {'scipy.stats', 'filterpy', 'psycopg', 'alembic', 'keyring', 'fsspec', 'distributed', 'pyarrow'}\n"
        "print([n for n in sys.modules if n in late or n.startswith('calstation.designer.')])\n"
        "from calstation.physics.rotation import rotation_matrix; print(rotation_matrix.signatures)\n"
        "window.app.close()\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["[]", "[]"]


@pytest.mark.long
@pytest.mark.parametrize("code", ["en", "zh_CN"])
def test_header_fields_are_as_high_as_the_start_button(window: MainWindow, qtbot: QtBot, code: str) -> None:
    window.app.set_language(code)
    header = RunHeader(window.app.run)
    qtbot.addWidget(header)
    header.show()
    assert header.minimumSizeHint().height() == header.start_button.height() == theme.BIG_BUTTON


@pytest.mark.long
def test_pages_are_not_prepared_during_a_run(window: MainWindow, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(type(window.app.engine_link), "running", True)
    prepared = [tab.prepared for tab in window._tabs.values()]
    window._prepare_next()
    assert [tab.prepared for tab in window._tabs.values()] == prepared
    monkeypatch.undo()
    window._prepare_next()
    assert sum(tab.prepared for tab in window._tabs.values()) == sum(prepared) + 1


@pytest.mark.long
def test_preparation_creates_the_views_that_a_run_fills(window: MainWindow, qtbot: QtBot) -> None:
    window.show()
    with qtbot.waitSignal(window.prepared, timeout=60_000):
        window._prepare_next()
    analysis = cast(EngineerPage, window._tabs["engineer_page"].page).analysis
    assert None not in (view._view for view in (analysis.result, analysis.observability, analysis.cycle))


@pytest.mark.long
def test_no_widget_has_a_graphics_effect(window: MainWindow) -> None:
    """Every paint of such a widget lays out all hidden pages, which takes longer than the event loop may block."""
    window.create_engineer_page()
    assert not [each for each in window.findChildren(QWidget) if each.graphicsEffect() is not None]


def test_picture_of_a_table_at_unknown_angles_is_pale(window: MainWindow) -> None:
    picture = window.operator_page._live.table.picture

    def contrast() -> int:
        """Return the largest difference from the background."""
        image = picture.grab().toImage()
        levels = [image.pixelColor(x, y).value() for x in range(image.width()) for y in range(image.height())]
        return max(levels) - min(levels)

    picture.resize(60, 60)
    known = []
    for angles_known in (True, False):
        picture.set_angles(0.0, 0.0, known=angles_known)
        known.append(contrast())
    assert known[0] > 100
    assert known[1] < 0.6 * known[0]


def test_texts_of_the_first_show_keep_their_sizes(window: MainWindow) -> None:
    window.show()
    page = window.operator_page
    later = page._verdict  # sets the sizes of its texts when it is shown
    labels = [each for each in page.findChildren(QLabel) if not later.isAncestorOf(each)]
    before = [(each.text(), each.font().pixelSize()) for each in labels]
    for code in ("zh_CN", "en"):
        window.app.set_language(code)
    after = [(each.text(), each.font().pixelSize()) for each in labels]
    assert [each for each in zip(before, after, strict=True) if each[0] != each[1]] == []


@pytest.mark.long
def test_focus_returns_to_the_page_after_the_role_panel(window: MainWindow, qtbot: QtBot) -> None:
    """A scan after the sign-in must reach the field for it, not the button in the top bar."""
    window.show()
    window.activateWindow()
    role = window.findChild(QPushButton, "role_button")
    for name in ("operator_page", "history_page"):
        window.show_page(name)
        page = window._tabs[name].page
        expected = window.operator_page.header.serial_edit if name == "operator_page" else page.focusProxy()
        for leave in (Qt.Key.Key_Escape, None):
            role.setFocus()
            qtbot.mouseClick(role, Qt.MouseButton.LeftButton)
            panel = window.findChild(RolePanel)
            assert panel.isVisible()
            if leave is not None:
                qtbot.keyClick(window, leave)
            else:
                panel._accept("")
            assert not panel.isVisible()
            assert window.focusWidget() is expected


@pytest.mark.long
@pytest.mark.parametrize("code", ["en", "zh_CN"])
def test_pages_of_a_new_window_need_no_vertical_scroll_bar_at_1280_x_720(window: MainWindow, code: str) -> None:
    window.app.set_language(code)
    window.resize(1280, 720)
    window.show()
    for name in PAGES:
        window.show_page(name)
        QApplication.processEvents()
        tab = window._tabs[name]
        assert tab.page.minimumSizeHint().height() <= tab.height() - (theme.BIG_BUTTON + 2 * theme.GRID), name
