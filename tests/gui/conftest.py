"""Fixtures of the real window, offscreen, with a temporary site folder and runs folder."""

import os
import time

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from PySide6.QtCore import QCoreApplication, QEvent, QObject, Qt
from PySide6.QtWidgets import QApplication, QComboBox, QLabel, QLineEdit, QPushButton, QWidget
from pytestqt.qtbot import QtBot

from calstation.gui import create_window
from calstation.gui.shell.main_window import MainWindow
from calstation.gui.state import AppContext, RunStatus
from calstation.gui.text import language
from calstation.gui.widgets import theme
from calstation.jobs import JobQueue
from calstation.results import Result, warm_up
from tests.gui.shared_jobs import use_folder
from tests.site_folder import SiteFolder

SERIAL = "SN-000042"
#: Required keys of a result JSON.
RESULT: dict[str, Any] = {
    "schema": "calstation.result/1",
    "unit": {"serial": SERIAL},
    "stages": [],
    "outcome": "passed",
    "parameters": {},
    "log": {"file": "log.h5"},
}


def result_with(**changes: Any) -> Result:
    """Return a result with these keys in its JSON."""
    return Result.from_json({**RESULT, **changes})


@pytest.fixture(autouse=True)
def site_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[SiteFolder]:
    """An empty site folder for configuration, settings and runs; windows are deleted after their test."""
    made = SiteFolder(tmp_path, tmp_path / "home")
    (made.home / "window.ini").write_text("[General]\nlanguage=en\ntheme=light\nsounds=false\n", encoding="utf-8")
    monkeypatch.setenv("CALSTATION_HOME", str(made.home))
    monkeypatch.chdir(tmp_path)
    yield made
    QCoreApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete)


class SharedJobQueue(JobQueue):
    """A job queue whose process is shared by all tests, because starting one takes longer than most tests."""

    def close(self) -> None:
        """Cancel all jobs, but let a short one finish, and keep the process."""
        while self._waiting:
            self._waiting[-1].cancel()
        deadline = time.monotonic() + 1.0  # less than the start of another process takes
        while self._running is not None and time.monotonic() < deadline:
            self.poll()
            time.sleep(0.002)
        if self._running is not None and not self._running.cancel():
            super().close()

    def use_folders_of(self, site_folder: "SiteFolder") -> None:
        """Switch to the folders of a test."""
        self.poll()
        self.submit(use_folder, str(site_folder.folder), str(site_folder.home))


@pytest.fixture(scope="session")
def shared_queue() -> Iterator[list[SharedJobQueue]]:
    """The shared job queue, created at its first use."""
    made: list[SharedJobQueue] = []
    yield made
    for job_queue in made:
        JobQueue.close(job_queue)


@pytest.fixture
def job_queue(
    site_folder: SiteFolder, shared_queue: list[SharedJobQueue], monkeypatch: pytest.MonkeyPatch
) -> SharedJobQueue:
    """The job queue of this test's windows."""
    if not shared_queue or shared_queue[0]._closed:
        shared_queue[:] = [SharedJobQueue(warm_up)]
    shared_queue[0].use_folders_of(site_folder)
    monkeypatch.setattr("calstation.gui.state.context.JobQueue", lambda warm_up: shared_queue[0])
    return shared_queue[0]


@pytest.fixture
def app(site_folder: SiteFolder, job_queue: SharedJobQueue, qapp: QApplication) -> Iterator[AppContext]:
    """Shared state of a window with the test station, for a single page; English, light theme."""
    if not qapp.styleSheet():
        qapp.setStyle("Fusion")
    theme.apply("light")
    language.use("en")
    made = AppContext(site_folder.station)
    yield made
    made.close()
    made.deleteLater()
    language.use("en")


@pytest.fixture
def engineer_page(window: MainWindow) -> None:
    """The engineer page is created with the window, as in a station, not with a run or a change of the page."""
    window.create_engineer_page()


@pytest.fixture
def window(
    site_folder: SiteFolder,
    job_queue: SharedJobQueue,
    qtbot: QtBot,
    monkeypatch: pytest.MonkeyPatch,
    request: pytest.FixtureRequest,
) -> Iterator[MainWindow]:
    """The window with the test station, English, light theme, shown at 1366x768.

    Other pages are created when they are shown, because their creation in idle time takes longer than most tests, and
    the engineer page, which a window creates before a run, only in tests with `engineer_page`.
    """
    monkeypatch.setattr(MainWindow, "_after_first_paint", MainWindow._join_windows)
    if "engineer_page" not in request.fixturenames:
        monkeypatch.setattr(MainWindow, "create_engineer_page", lambda _: None)
    made = create_window(site_folder.station)
    assert isinstance(made, MainWindow)
    qtbot.addWidget(made)
    made.setWindowState(Qt.WindowState.WindowNoState)  # the screen of the offscreen platform is small
    made.resize(1366, 768)
    made.show()
    qtbot.waitExposed(made)
    yield made
    made.app.close()
    made.app.deleteLater()  # with the event filter of the role, which would slow down all later windows
    language.use("en")


class Operator:
    """Operate a window and read it through its widgets, as an operator does."""

    def __init__(self, window: MainWindow, qtbot: QtBot, site_folder: SiteFolder) -> None:
        self.window, self.qtbot, self.site_folder = window, qtbot, site_folder
        self.choose("short")

    def widget(self, name: str, kind: type[Any] = QWidget) -> Any:
        """Return the widget with an object name."""
        found = self.window.findChild(kind, name)
        assert found is not None, name
        return found

    def choose(self, product: str) -> None:
        """Choose a product in the list by the name of its file."""
        combo = self.widget("product_combo", QComboBox)
        combo.setCurrentIndex([Path(combo.itemData(i)).stem for i in range(combo.count())].index(product))
        combo.activated.emit(combo.currentIndex())

    def press(self, name: str) -> None:
        """Click a visible, enabled button."""
        button = self.widget(name, QPushButton)
        assert button.isVisible(), name
        assert button.isEnabled(), (name, button.toolTip())
        self.qtbot.mouseClick(button, Qt.MouseButton.LeftButton)

    def scan(self, serial: str) -> None:
        """Type the number and Enter into the serial field, as a scanner does."""
        edit = self.widget("serial_edit", QLineEdit)
        edit.setFocus()
        edit.selectAll()
        self.qtbot.keyClicks(edit, serial)
        self.qtbot.keyClick(edit, Qt.Key.Key_Return)

    def until(self, condition: Callable[[], object], seconds: float = 90.0) -> None:
        """Wait for a condition, less long than a test may last: that limit does not end the event loop of Qt."""
        self.qtbot.waitUntil(lambda: bool(condition()), timeout=round(1000 * seconds))

    def until_no_job(self) -> None:
        """Wait until no job is running or waiting, including unobserved jobs."""
        queue = self.window.app.job_queue

        def idle() -> bool:
            queue.poll()
            return not queue.busy

        self.until(idle)

    def until_state(self, state: str) -> None:
        """Wait for a state of the run."""
        self.until(lambda: self.run.state == state)

    def until_ended(self) -> None:
        """Wait until the engine process has ended."""
        self.until(lambda: not self.window.app.engine_link.running)

    def in_a_stage(self) -> bool:
        """Whether more than a tenth of a stage is complete."""
        return self.run.stage is not None and self.run.stage.fraction > 0.1

    @property
    def run(self) -> RunStatus:
        """Status of the run."""
        return self.window.app.run

    @property
    def verdict(self) -> str:
        """Text of the verdict, "" while none is visible."""
        label = self.widget("verdict_label", QLabel)
        return str(label.text()) if label.isVisible() else ""

    @property
    def message(self) -> str:
        """The message line at the bottom."""
        return str(self.widget("message_label", QLabel).text())

    def says(self) -> str:
        """Return the texts of all visible labels."""
        labels = [w for w in self.window.findChildren(QLabel) if w.isVisible()]
        return "\n".join(label.text() for label in labels)


class ShownWindows(QObject):
    """Records the widgets that are shown as windows of their own; the user would see them flash and lose the focus."""

    def __init__(self, application: QApplication) -> None:
        super().__init__()
        self._application = application
        self.names: list[str] = []

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() == QEvent.Type.Show and isinstance(watched, QWidget) and watched.isWindow():
            self.names.append(f"{type(watched).__name__} {watched.objectName()}")
        return False

    def __enter__(self) -> "ShownWindows":
        self._application.installEventFilter(self)
        return self

    def __exit__(self, *_: object) -> None:
        self._application.removeEventFilter(self)


@pytest.fixture
def shown_windows(window: MainWindow, qapp: QApplication) -> Iterator[ShownWindows]:
    """The windows that are shown after the main window."""
    with ShownWindows(qapp) as made:
        yield made


@pytest.fixture
def operator(window: MainWindow, qtbot: QtBot, site_folder: SiteFolder) -> Operator:
    """An operator at the window with the short product selected."""
    return Operator(window, qtbot, site_folder)
