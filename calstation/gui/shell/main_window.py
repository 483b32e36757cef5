"""The main window with a top bar, the pages, and STOP at the same position on every page."""

import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from importlib import import_module
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, cast

from PySide6.QtCore import QByteArray, QEvent, QObject, QPoint, QSignalBlocker, QSize, Qt, QTimer, Signal
from PySide6.QtGui import QCloseEvent, QKeyEvent, QKeySequence, QShortcut, QShowEvent
from PySide6.QtWidgets import QLabel, QMainWindow, QStackedWidget, QTabWidget, QWidget

from calstation.config import load_station
from calstation.errors import CalstationError
from calstation.gui.operator import OperatorPage
from calstation.gui.shell.stop_guard import StopGuard
from calstation.gui.state import AppContext, ChamberNotice, Page, RolePanel, RunStrip, TableNotice, run_title
from calstation.gui.text import bind, language, on_language_change, say, station_text
from calstation.gui.widgets import PANEL, PageArea, button, column, label, padlock_icon, row, theme, theme_icon

if TYPE_CHECKING:
    from calstation.gui.help import HelpPage
    from calstation.gui.logs import OfflinePage

#: Height of the strip with STOP at the top of every page, px.
_STRIP_HEIGHT = theme.BIG_BUTTON + 2 * theme.GRID
_ICON = QSize(24, 24)

#: Default and minimum size of the window, and maximum size of its frame, logical px.
_DEFAULT, _MINIMUM, _FRAME = QSize(1366, 768), QSize(900, 400), QSize(16, 48)


def _lazy_page(package: str, page: str) -> Callable[[AppContext], Page]:
    """Return a constructor that imports the package of a page only when called, which saves 0.2 s at start-up."""
    return lambda app: cast("Page", getattr(import_module(f"calstation.gui.{package}"), page)(app))


#: Constructors of the pages, in the order of their tabs.
_PAGES: dict[str, Callable[[AppContext], Page]] = {
    "operator_page": OperatorPage,
    "engineer_page": _lazy_page("engineer", "EngineerPage"),
    "offline_page": _lazy_page("logs", "OfflinePage"),
    "history_page": _lazy_page("history", "HistoryPage"),
    "quality_page": _lazy_page("quality", "QualityPage"),
    "station_page": _lazy_page("settings", "StationPage"),
    "help_page": _lazy_page("help", "HelpPage"),
}
#: Time after the window is shown at which the engineer page is created, ms; until then, the window is painted.
_CREATION_DELAY_MS = 50
#: Time after the first paint at which the other pages are prepared, ms, one in each turn of the event loop, so that a
#: page that is first shown during a run does not block the window.
_PREPARATION_DELAY_MS = 1000

#: Maximum time between two characters of a scan outside the field for scans, s, and minimum length of such a scan.
_MAX_SCAN_PAUSE, _MIN_SCAN_LENGTH = 0.3, 4


class _Tab(QWidget):
    """A tab that creates its page, which is below the strip, when the page is first used."""

    def __init__(self, app: AppContext, create: Callable[[AppContext], Page]) -> None:
        super().__init__()
        self._app, self._create = app, create
        self._page: Page | None = None
        self._drawn = False
        self.header = QWidget()

    @property
    def prepared(self) -> bool:
        """Whether the page has been prepared or is visible."""
        return self._drawn or self.isVisible()

    @property
    def page(self) -> Page:
        return self._page or self.create_page()

    def create_page(self) -> Page:
        self._page = page = self._create(self._app)
        notice = row(margins=(2 * theme.GRID, 0, 2 * theme.GRID, 0))
        table = TableNotice(self._app, f"{self.objectName()}_", self)
        column(table, notice, (PageArea(page), 1), on=self, margins=(0, _STRIP_HEIGHT, 0, 0))
        if page.header is not None:  # other pages show the chamber in the strip
            chamber = ChamberNotice(self._app.run, f"{self.objectName()}_")
            notice.addWidget(chamber)
            chamber.show_state()
        column((page.header or RunStrip(self._app.run), 1), on=self.header)
        return page

    def may_leave(self, go: Callable[[], object]) -> bool:
        """Return whether the page may be left; see `Page.may_leave`."""
        return self._page is None or self._page.may_leave(go)

    def prepare(self, size: QSize) -> None:
        """Create the page and its views, and draw the page off screen, so that it is later shown without delay."""
        self.page.prepare()
        self.resize(size)
        self.grab()
        self._drawn = True

    def setVisible(self, visible: bool) -> None:
        """Create the page before it is first shown."""
        if visible and self._page is None:
            self.create_page()
        super().setVisible(visible)


class MainWindow(QMainWindow):
    """The main window with its pages, STOP, and controls for language, theme and role.

    The signal `prepared` is emitted when all pages have been created.
    """

    prepared = Signal()

    def __init__(self, app: AppContext) -> None:
        super().__init__()
        self.app = app
        self._closing = False
        #: Index of the current page.
        self._current = 0
        self.setFont(theme.font())
        self.page_tabs = QTabWidget(self)
        self.page_tabs.setObjectName("page_tabs")
        self.page_tabs.tabBar().setDrawBase(False)
        self.page_tabs.tabBar().setExpanding(False)
        self.setCentralWidget(self.page_tabs)
        name = QLabel("calstation")
        name.setFont(theme.font(theme.SECTION, bold=True))
        name.setFixedHeight(theme.TOP_BAR)
        name.setContentsMargins(2 * theme.GRID, 0, 2 * theme.GRID, 0)
        self.page_tabs.setCornerWidget(name, Qt.Corner.TopLeftCorner)
        self.page_tabs.setCornerWidget(self._corner(), Qt.Corner.TopRightCorner)
        self._strip, self._headers = QWidget(self.page_tabs), QStackedWidget()
        self.stop_button = button("stop_button", "window.stop", app.run.stop, tip="window.stop_tip")
        self.stop_button.setFocusPolicy(Qt.FocusPolicy.NoFocus)  # Esc stops a run; the keys of a scan must not
        self.stop_button.setFixedSize(18 * theme.GRID, theme.BIG_BUTTON)
        row((self._headers, 1), self.stop_button, on=self._strip, spacing=2 * theme.GRID, margins=PANEL)
        self._tabs = {name: _Tab(app, make) for name, make in _PAGES.items()}
        for key, tab in self._tabs.items():
            tab.setObjectName(key)
            tab.installEventFilter(self)
            bind(partial(self.page_tabs.setTabText, self.page_tabs.addTab(tab, "")), f"window.tab_{key}")
            self._headers.addWidget(tab.header)
        bind(partial(self.page_tabs.setTabToolTip, self.page_tabs.count() - 1), "window.help_tip")
        self._role_panel = RolePanel(app, self)
        self._order_tabs()
        self._connect()
        for show in (self._show_language, self._show_role, self._show_station, self._show_title):
            on_language_change(self, show)
        self.setMinimumSize(_MINIMUM)
        self.resize(_DEFAULT)
        geometry = app.settings.value("geometry")
        if isinstance(geometry, QByteArray):
            self.restoreGeometry(geometry)
        #: Time of the last character of a scan outside the field for scans, s, and the characters so far.
        self._scan = 0.0, ""
        self._fit_screen()

    def _fit_screen(self) -> None:
        """Maximise the window if it is larger than its screen."""
        room = self.screen().availableGeometry().size() - _FRAME
        if self.size() != self.size().boundedTo(room):
            self.resize(self.size().boundedTo(room))
            self.setWindowState(self.windowState() | Qt.WindowState.WindowMaximized)

    def _connect(self) -> None:
        app = self.app
        QShortcut(QKeySequence(Qt.Key.Key_Escape), self, self._escape)
        StopGuard(app.run, self.stop_button)
        QShortcut(QKeySequence(Qt.Key.Key_F1), self, self.show_help)
        self.operator_page.header.guard(self.language_combo)
        self.page_tabs.currentChanged.connect(self._page_changed)
        app.station_changed.connect(self._show_station)
        app.station_changed.connect(self._join_windows)
        app.run.changed.connect(self._show_title)
        app.role.changed.connect(self._show_role)
        app.role.pin_requested.connect(self._move_role_panel)
        self._role_panel.closed.connect(self._focus_page)
        theme.themes.changed.connect(self._set_icons)
        app.engine_link.running_changed.connect(self._running_changed)
        app.page_requested.connect(self.show_page)
        app.watch_requested.connect(self._show_monitoring)
        app.open_run.connect(lambda _: self.show_page("engineer_page"))
        app.resume_run.connect(lambda _: self.show_page("operator_page"))
        app.open_log.connect(self._open_log)

    def showEvent(self, event: QShowEvent) -> None:
        """Create the engineer page after the first paint."""
        super().showEvent(event)
        QTimer.singleShot(_CREATION_DELAY_MS, self, self._after_first_paint)

    def create_engineer_page(self) -> None:
        """Create the engineer page now, because it monitors runs from the start; `_prepare_next` creates the others."""
        _ = self._tabs["engineer_page"].page

    def _after_first_paint(self) -> None:
        self.create_engineer_page()
        self._join_windows()
        QTimer.singleShot(_PREPARATION_DELAY_MS, self, self._prepare_next)

    def _prepare_next(self) -> None:
        """Prepare the next page, but not during a run; after the last page, emit `prepared`."""
        if self.app.engine_link.running:  # the window must handle STOP and reply to the engine at once
            QTimer.singleShot(_PREPARATION_DELAY_MS, self, self._prepare_next)
            return
        tab = next((tab for tab in self._tabs.values() if not tab.prepared), None)
        if tab is None:
            self.prepared.emit()
            return
        tab.prepare(self.page_tabs.currentWidget().size())
        QTimer.singleShot(0, self, self._prepare_next)

    def _join_windows(self) -> None:
        """Join the windows of the station, and watch its ports, once this window is visible."""
        if self.isVisible():
            self.app.windows.join(self.app.station_path)
            self.app.port_watch.watch(self.app.station_path)

    @property
    def operator_page(self) -> OperatorPage:
        """The operator page."""
        return cast("OperatorPage", self._tabs["operator_page"].page)

    @property
    def offline_page(self) -> "OfflinePage":
        """The offline page."""
        return cast("OfflinePage", self._tabs["offline_page"].page)

    def show_page(self, name: str) -> None:
        """Show the page with an object name."""
        self.page_tabs.setCurrentWidget(self._tabs[name])

    def show_help(self) -> None:
        """Open the manual at the section about the current page, unless this page must not be left."""
        target = list(self._tabs.values())[self._current].page.manual
        self.show_page("help_page")
        if target and self.page_tabs.currentWidget() is self._tabs["help_page"]:
            cast("HelpPage", self._tabs["help_page"].page).open(target)

    def _open_log(self, log: Path) -> None:
        self.show_page("offline_page")
        self.offline_page.open(log)

    def _show_monitoring(self) -> None:
        self.show_page("offline_page")
        self.offline_page.show_monitoring()

    def _may_leave(self, go: Callable[[], object]) -> bool:
        """Return whether the current page may be left; see `Page.may_leave`."""
        return list(self._tabs.values())[self._current].may_leave(go)

    def _show_language(self) -> None:
        with QSignalBlocker(self.language_combo):
            self.language_combo.setCurrentIndex(max(0, self.language_combo.findData(language.current())))

    def _show_title(self) -> None:
        """Show the units and the state of a run in the window title, which the task bar also shows."""
        shown = self.app.run.serials or self.app.run.occupied is not None
        self.setWindowTitle(f"{run_title(self.app.run)}  –  calstation" if shown else "calstation")

    def _show_role(self) -> None:
        engineer = self.app.role.engineer
        self._role_button.setText(say("window.engineer" if engineer else "common.operator"))
        self._role_button.setToolTip(say("window.lock_tip" if engineer else "window.unlock_tip"))
        self._set_icons()

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Move the strip with the current page."""
        if event.type() in (QEvent.Type.Resize, QEvent.Type.Move, QEvent.Type.Show):
            self._move_strip()
        return super().eventFilter(watched, event)

    def changeEvent(self, event: QEvent) -> None:
        """Read wrong files again when the user returns from another program, in which they may have been corrected."""
        super().changeEvent(event)
        if event.type() == QEvent.Type.ActivationChange and self.isActiveWindow():
            self.operator_page.update_files()

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Treat a key that no widget has accepted as a part of a scan."""
        if self._role_panel.isVisible() or not (self.operator_page.header.handle_key(event) or self._collect(event)):
            super().keyPressEvent(event)

    def _collect(self, event: QKeyEvent) -> bool:
        """Collect the characters of a scan on another page or during a run; enter the scan on the operator page."""
        now, text = time.monotonic(), event.text()
        scan = self._scan[1] if now - self._scan[0] < _MAX_SCAN_PAUSE else ""
        if text.isprintable() and text:
            self._scan = now, scan + text
            return True
        if event.key() not in (Qt.Key.Key_Return, Qt.Key.Key_Enter) or len(scan) < _MIN_SCAN_LENGTH:
            return False
        self._scan = now, ""
        self.show_page("operator_page")
        if self.operator_page.isVisible():
            self.operator_page.header.enter_scan(scan)
        return True

    def closeEvent(self, event: QCloseEvent) -> None:
        """Ask for confirmation during a run; otherwise close the window and its processes."""
        if self.app.engine_link.running and not self._closing:
            event.ignore()
            self.show_page("operator_page")
            self.operator_page.ask_close(self.stop_and_close, self._close_now)
            return
        if not self._closing and not self._may_leave(self.close):
            event.ignore()
            return
        self.app.settings.setValue("geometry", self.saveGeometry())
        self.app.close()
        super().closeEvent(event)

    def stop_and_close(self) -> None:
        """Stop a run in progress, and close the window after it has ended."""
        self._closing = True
        self.app.run.stop()
        self._running_changed(self.app.engine_link.running)

    def _close_now(self) -> None:
        self.app.engine_link.stop_listening()
        self._closing = True
        if self.isVisible():
            self.close()

    def _running_changed(self, running: bool) -> None:
        self.create_engineer_page()
        if running or not self._closing:
            return
        run = self.app.run
        if run.chamber.must_stay_closed or run.stop_incomplete:  # only the window shows these dangers
            self._closing = False
        else:
            self.close()

    def _corner(self) -> QWidget:
        corner = QWidget()
        corner.setFixedHeight(theme.TOP_BAR)
        self._station = label(kind="pill", name="station_label")
        self.language_combo = language.language_combo()
        self.language_combo.setProperty("kind", "tall")
        self.language_combo.currentIndexChanged.connect(self._choose_language)
        self._theme_button = button("theme_button", pressed=self._other_theme, tip="window.theme_tip")
        self._theme_button.setFixedWidth(theme.BUTTON)
        bind(self._theme_button.setAccessibleName, "window.theme_tip")
        self._role_button = button("role_button", pressed=self._role_pressed)
        self._theme_button.setIconSize(_ICON)
        self._role_button.setIconSize(_ICON)
        widgets = (self._station, self.language_combo, self._theme_button, self._role_button)
        items = ((widget, 0, Qt.AlignmentFlag.AlignVCenter) for widget in widgets)
        row(*items, on=corner, margins=(0, 0, 2 * theme.GRID, 0)).addStrut(theme.TOP_BAR)
        return corner

    def _order_tabs(self) -> None:
        """Set the Tab order to the reading order: top bar, header, STOP, page."""
        header = self.operator_page.header
        top = (self.page_tabs.tabBar(), self.language_combo, self._theme_button, self._role_button)
        fields = (header.operator_edit, header.serial_edit, header.product_combo)
        buttons = (header.start_button, header.pause_button, self.stop_button)
        for before, after in pairwise((*top, *fields, *buttons)):
            QWidget.setTabOrder(before, after)

    def _page_changed(self, index: int) -> None:
        if index != self._current and not self._may_leave(partial(self.page_tabs.setCurrentIndex, index)):
            self.page_tabs.setCurrentIndex(self._current)
            return
        self.create_engineer_page()
        self._current = index
        self._headers.setCurrentIndex(index)
        self._move_strip()

    def _move_strip(self) -> None:
        page = self.page_tabs.currentWidget()
        if page is not None:
            top = page.mapTo(self.page_tabs, QPoint(0, 0))
            self._strip.setGeometry(top.x(), top.y(), page.width(), _STRIP_HEIGHT)
            self._strip.raise_()

    def _escape(self) -> None:
        """Stop the run, even if the engine does not respond; without a run, close the role panel if it is open.

        A run in another window or program is stopped in both cases.
        """
        run = self.app.run
        if not self._role_panel.isVisible() or run.in_progress or self.app.engine_link.running:
            run.stop()
            return
        self._role_panel.hide()
        if run.occupied is not None:
            run.stop()

    def _move_role_panel(self) -> None:
        """Move the role panel below START and STOP or, in a low window, left of STOP, which must never be covered."""
        panel, strip = self._role_panel.size(), self._strip.mapTo(self, self._strip.rect().bottomRight())
        if strip.y() + panel.height() <= self.height():
            self._role_panel.move(strip.x() - panel.width(), strip.y())
        else:
            stop = self.stop_button.mapTo(self, QPoint(0, 0))
            self._role_panel.move(stop.x() - panel.width() - theme.GRID, self.height() - panel.height())

    def _focus_page(self) -> None:
        """Move the focus from the top bar to the current page, so that the page receives scans and keys."""
        page = list(self._tabs.values())[self._current].page
        self.operator_page.await_scan() if page is self.operator_page else page.setFocus()

    def _role_pressed(self) -> None:
        if self.app.role.engineer:
            self.app.role.lock()
        elif self._role_panel.isVisible():
            self._role_panel.hide()
        else:
            self.app.role.ask()

    def _choose_language(self) -> None:
        self.app.set_language(str(self.language_combo.currentData()))
        self.operator_page.await_scan()

    def _other_theme(self) -> None:
        self.app.set_theme("light" if theme.current() == "dark" else "dark")
        self.operator_page.await_scan()

    def _set_icons(self) -> None:
        self._theme_button.setIcon(theme_icon())
        self._role_button.setIcon(padlock_icon(closed=not self.app.role.engineer))

    def _show_station(self) -> None:
        virtual, name = False, say("window.no_station")
        with suppress(CalstationError):  # the operator page and the station page show the error
            _, station = load_station(self.app.station_path)
            virtual, name = station.bench is not None, station_text(station.name)
        self._station.setText(say("window.virtual_station", name=name) if virtual else name)
        self._station.setToolTip(say("window.virtual_tip") if virtual else "")
