"""The main window: top bar, pages, and STOP in one place on all of them."""

import importlib
import traceback

from PySide6.QtCore import QEvent, Qt
from PySide6.QtGui import QCloseEvent, QKeySequence, QResizeEvent, QShortcut
from PySide6.QtWidgets import (
    QHBoxLayout,
    QLabel,
    QMainWindow,
    QPushButton,
    QStackedWidget,
    QTabWidget,
    QWidget,
)

from calstation.gui import language, theme
from calstation.gui.context import AppContext
from calstation.gui.page import Page
from calstation.station.config import load_station

_PAGES = (
    ("operator", "OperatorPage"),
    ("engineer", "EngineerPage"),
    ("offline", "OfflinePage"),
    ("history", "HistoryPage"),
    ("station_page", "StationPage"),
)
_STRIP = theme.BIG_BUTTON + 2 * theme.GRID
"""Height of the strip with STOP above every page, px."""


class _Broken(Page):
    def title(self) -> str:
        return "?"


class MainWindow(QMainWindow):
    """All pages, the language, the theme, the role and STOP."""

    def __init__(self, app: AppContext) -> None:
        super().__init__()
        self.app = app
        self.setFont(theme.font())
        self.page_tabs = QTabWidget(self)
        self.page_tabs.setObjectName("page_tabs")
        self.page_tabs.setDocumentMode(True)
        self.setCentralWidget(self.page_tabs)
        self._name = QLabel("calstation")
        self._name.setFont(theme.font(theme.SECTION, bold=True))
        self._name.setContentsMargins(2 * theme.GRID, 0, 2 * theme.GRID, 0)
        self.page_tabs.setCornerWidget(self._name, Qt.Corner.TopLeftCorner)
        self.page_tabs.setCornerWidget(self._corner(), Qt.Corner.TopRightCorner)
        self._strip = QWidget(self.page_tabs)
        self._headers = QStackedWidget()
        self.stop_button = QPushButton()
        self.stop_button.setObjectName("stop_button")
        self.stop_button.setFixedSize(16 * theme.GRID, theme.BIG_BUTTON)
        self.stop_button.clicked.connect(self.stop)
        row = QHBoxLayout(self._strip)
        row.setContentsMargins(2 * theme.GRID, theme.GRID, 2 * theme.GRID, theme.GRID)
        row.addWidget(self._headers, 1)
        row.addWidget(self.stop_button)
        self.pages: list[Page] = []
        for folder, name in _PAGES:
            try:
                self._add(getattr(importlib.import_module(f"calstation.gui.{folder}.page"), name)(app))
            except Exception:  # noqa: BLE001
                traceback.print_exc()
                self._add(_Broken(app))
        self.page_tabs.currentChanged.connect(self._turn)
        QShortcut(QKeySequence(Qt.Key.Key_Escape), self, self.stop)
        self.app.station_changed.connect(self._show_station)
        self.app.role.changed.connect(self.retranslate)
        self.retranslate()
        self.resize(1366, 768)

    def stop(self) -> None:
        """Stop the run safely; harmless where none is going on."""
        self.app.run.stop()

    def retranslate(self) -> None:
        """Say everything again in the language in force."""
        self.setWindowTitle("calstation")
        self.stop_button.setText(self.tr("STOP"))
        self._theme_button.setText(self.tr("Light / dark"))
        self._lock_button.setText(self.tr("Engineer") if self.app.role.engineer else self.tr("Operator"))
        for index, page in enumerate(self.pages):
            self.page_tabs.setTabText(index, page.title())
        self._show_station()

    def changeEvent(self, event: QEvent) -> None:
        """Hear of a new language."""
        if event.type() == QEvent.Type.LanguageChange:
            self.retranslate()
        super().changeEvent(event)

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Keep the strip across the window, below the tabs."""
        super().resizeEvent(event)
        self._place_strip()

    def closeEvent(self, event: QCloseEvent) -> None:
        """End what runs beside the window."""
        self.app.close()
        super().closeEvent(event)

    def _corner(self) -> QWidget:
        corner = QWidget()
        row = QHBoxLayout(corner)
        row.setContentsMargins(0, 0, 2 * theme.GRID, 0)
        self._station = QLabel()
        self.language_combo = language.language_combo()
        self.language_combo.activated.connect(self._choose_language)
        self._theme_button = QPushButton()
        self._theme_button.clicked.connect(self._other_theme)
        self._lock_button = QPushButton()
        self._lock_button.setObjectName("role_button")
        for widget in (self._station, self.language_combo, self._theme_button, self._lock_button):
            row.addWidget(widget)
        return corner

    def _add(self, page: Page) -> None:
        page.setContentsMargins(0, _STRIP, 0, 0)
        self.pages.append(page)
        self.page_tabs.addTab(page, page.title())
        self._headers.addWidget(page.header or QLabel())

    def _turn(self, index: int) -> None:
        self._headers.setCurrentIndex(index)
        self._strip.raise_()

    def _place_strip(self) -> None:
        top = self.page_tabs.tabBar().geometry().bottom() + 1
        corner = self.page_tabs.cornerWidget(Qt.Corner.TopRightCorner)
        top = max(top, corner.geometry().bottom() + 1)
        self._strip.setGeometry(0, top, self.page_tabs.width(), _STRIP)
        self._strip.raise_()

    def _choose_language(self) -> None:
        language.use(str(self.language_combo.currentData()))
        self.app.settings.setValue("language", self.language_combo.currentData())

    def _other_theme(self) -> None:
        self.app.set_theme("light" if theme.current() == "dark" else "dark")

    def _show_station(self) -> None:
        _, station = load_station(self.app.station_path)
        self._station.setText(self.tr("virtual bench") if station.bench is not None else station.name)
