"""The station page: which station, how its devices are connected, where it stands, and all files behind it."""

from collections.abc import Callable
from pathlib import Path

from PySide6.QtCore import QSignalBlocker, QSize, Qt
from PySide6.QtGui import QShowEvent
from PySide6.QtWidgets import (
    QComboBox,
    QFrame,
    QHBoxLayout,
    QLabel,
    QListWidget,
    QListWidgetItem,
    QPushButton,
    QScrollArea,
    QStackedWidget,
    QVBoxLayout,
    QWidget,
)

from calstation.config import editing as settings
from calstation.config import library
from calstation.config.editing import Place
from calstation.config.station import DEFAULT_STATION
from calstation.errors import ConfigurationError
from calstation.gui.settings.drafts import Drafts
from calstation.gui.settings.fields import tab_through
from calstation.gui.settings.link_section import LinkSection
from calstation.gui.settings.new_file import NewFileBar
from calstation.gui.settings.personal_section import PersonalSection
from calstation.gui.settings.problem_wording import word_anywhere
from calstation.gui.settings.profiles_section import ProfilesSection
from calstation.gui.settings.site_section import SiteSection
from calstation.gui.settings.station_section import StationSection
from calstation.gui.settings.table_section import TableSection
from calstation.gui.shell.context import AppContext
from calstation.gui.shell.page import Page
from calstation.gui.widgets import theme
from calstation.gui.widgets.notice import Choice, NoticeBar

_NAV = 26 * theme.GRID
#: Place of the section that scrolls by itself.
_PROFILES = 5
_LINK = ("port", "timeout_s", "serial")
#: What the station's first sections show of it.
_PLACES: tuple[tuple[Place, ...], ...] = (
    (("name",), ("table", "profile"), ("handover",), ("bench",)),
    (*(("table", key) for key in _LINK), ("table", "unit")),
    tuple(("imu", key) for key in _LINK),
    (("site",),),
)


class StationPage(Page):
    """Sections on the left, the chosen one on the right; what is typed is checked at once and saved on demand."""

    def __init__(self, app: AppContext) -> None:
        super().__init__(app)
        self.setObjectName("station_page")
        self.drafts = Drafts(app.settings, self)
        self._stored = ""
        self.notice = NoticeBar()
        self.new_bar = NewFileBar(self.drafts)
        self.new_bar.made.connect(lambda _, path: self._use(path))
        self.header = self._header()
        self.station = StationSection(self.drafts)
        self.table_link = LinkSection(app, "table", self.drafts.station)
        self.imu_link = LinkSection(app, "imu", self.drafts.station)
        self.site = SiteSection(self.drafts.station)
        self.table = TableSection(self.drafts.table)
        self.profiles = ProfilesSection(app, self.drafts)
        self.personal = PersonalSection(app, self.drafts)
        self._sections = (
            self.station,
            self.table_link,
            self.imu_link,
            self.site,
            self.table,
            self.profiles,
            self.personal,
        )
        self._lay_out()
        self.drafts.changed.connect(self.refresh)
        self.drafts.saved.connect(self._saved)
        self.drafts.station.changed.connect(self._follow_profile)
        app.role.changed.connect(lambda _: self._lock())
        app.engine_link.running_changed.connect(lambda _: self._lock())
        app.station_changed.connect(self._open)
        self._open()
        self.retranslate()

    def title(self) -> str:
        """The page's name on its tab."""
        return self.tr("Station")

    def _header(self) -> QWidget:
        header = QWidget()
        self._station_label = QLabel()
        self.station_box = QComboBox()
        self.station_box.setObjectName("station_combo")
        self.station_box.setMinimumWidth(36 * theme.GRID)
        self.station_box.activated.connect(self._choose)
        self._station_label.setBuddy(self.station_box)
        self.new_button, self.save_button, self.discard_button = QPushButton(), QPushButton(), QPushButton()
        self.new_button.setObjectName("new_station_button")
        self.new_button.clicked.connect(self._ask_new)
        self.save_button.setObjectName("save_station_button")
        self.save_button.setProperty("kind", "primary")
        self.save_button.clicked.connect(self.save)
        self.discard_button.setObjectName("discard_station_button")
        self.discard_button.clicked.connect(self.drafts.discard)
        self.unsaved_label = QLabel()
        self.unsaved_label.setObjectName("unsaved_label")
        self.unsaved_label.setWordWrap(True)
        self.unsaved_label.setAlignment(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
        row = QHBoxLayout(header)
        row.setContentsMargins(0, 0, 0, 0)
        row.setSpacing(theme.GRID)
        row.addWidget(self._station_label)
        row.addWidget(self.station_box)
        row.addWidget(self.new_button)
        row.addWidget(self.unsaved_label, 1)
        row.addWidget(self.discard_button)
        row.addWidget(self.save_button)
        return header

    def _lay_out(self) -> None:
        self.nav = QListWidget()
        self.nav.setObjectName("station_sections")
        self.nav.setFixedWidth(_NAV)
        self.nav.setProperty("kind", "nav")
        self.nav.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self._stack = QStackedWidget()
        for index, section in enumerate(self._sections):
            item = QListWidgetItem(self.nav)
            item.setSizeHint(QSize(_NAV, theme.BUTTON))
            self._stack.addWidget(section if index == _PROFILES else _scrolled(section))
        self.nav.currentRowChanged.connect(self._turn)
        self._elsewhere = QLabel()
        self._elsewhere.setObjectName("station_problem_label")
        self._elsewhere.setWordWrap(True)
        self._elsewhere.setProperty("kind", "error")
        right = QVBoxLayout()
        right.setSpacing(theme.GRID)
        right.addWidget(self.notice)
        right.addWidget(self.new_bar)
        right.addWidget(self._elsewhere)
        right.addWidget(self._stack, 1)
        row = QHBoxLayout(self)
        row.setContentsMargins(2 * theme.GRID, theme.GRID, 2 * theme.GRID, 2 * theme.GRID)
        row.setSpacing(2 * theme.GRID)
        row.addWidget(self.nav)
        row.addLayout(right, 1)
        self.nav.setCurrentRow(0)
        tab_through(self.station_box, self.new_button, self.discard_button, self.save_button)

    def showEvent(self, event: QShowEvent) -> None:
        """Take up files that were changed by other means, unless something is typed here."""
        super().showEvent(event)
        if not self.drafts.dirty:
            self._open()

    def may_leave(self, go: Callable[[], object]) -> bool:
        """Whether the page may be left now; otherwise it asks, and goes on with `go` on its own.

        Nobody is kept here while a run is going on: what is typed waits.
        """
        if not self.drafts.dirty or self.app.engine_link.running:
            return True
        wrong = bool(self.drafts.wrong) or not self.app.role.engineer

        def save() -> None:
            if self.save():
                go()

        def discard() -> None:
            self.drafts.discard()
            go()

        choices = [
            Choice("save_and_go_button", lambda: self.tr("Save and go on"), save, primary=True),
            Choice("discard_and_go_button", lambda: self.tr("Discard and go on"), discard, primary=wrong),
            Choice("stay_button", lambda: self.tr("Stay here"), lambda: None),
        ]
        self.notice.ask(
            "caution", lambda: self.tr("Unsaved changes"), self._unsaved, choices[1:] if wrong else choices
        )
        return False

    def save(self) -> bool:
        """Store all that is typed; says why where it cannot be. Gives whether it was stored."""
        if self.drafts.wrong or self._held():
            return False
        self.notice.dismiss()
        names = self._unsaved()
        try:
            self.drafts.save()
        except ConfigurationError as error:
            said = str(error)
            self.notice.ask("bad", lambda: self.tr("Not saved"), lambda: said)
            return False
        self._stored = names
        self.refresh()
        return True

    def refresh(self) -> None:
        """Show what is typed, what is wrong with it, and what may be done about it."""
        role, held = self._role_reason(), self._held()
        dirty, wrong = self.drafts.dirty, self.drafts.wrong
        unsaved = self.tr("● Not saved: {0}").format(self._unsaved()) if dirty else ""
        if dirty:
            self._stored = ""
        stored = self.tr("✓ Saved: {0}").format(self._stored) if self._stored else ""
        locked = self.tr("Read only: an engineer unlocks it.") if role else ""
        self.unsaved_label.setText(unsaved or stored or locked)
        self.discard_button.setVisible(bool(dirty))
        self.save_button.setVisible(bool(dirty))
        reason = held
        if wrong and not held:
            first = wrong[0].problems[0]
            reason = self.tr("Correct first, in “{0}”: {1}").format(wrong[0].name, word_anywhere(first))
        self.save_button.setEnabled(not reason)
        self.save_button.setToolTip(reason)
        problems = self.drafts.station.problems
        unseen = [p for p in problems if not p.place or p.kind in ("toml", "file", "extra_forbidden")]
        self._elsewhere.setText("\n".join(word_anywhere(problem) for problem in unseen))
        self._elsewhere.setVisible(bool(unseen))
        if not dirty and self.notice.asking:
            self.notice.dismiss()
        self._mark_sections()

    def retranslate(self) -> None:
        """Say everything again in the language in force."""
        self._station_label.setText(self.tr("Station"))
        self.station_box.setAccessibleName(self.tr("Station"))
        self.new_button.setText(self.tr("New from copy"))
        self.save_button.setText(self.tr("Save"))
        self.discard_button.setText(self.tr("Discard"))
        self._fill()
        self._lock()

    def _lock(self) -> None:
        """Enable what the role may change; say why where not."""
        reason = self._role_reason()
        for section in self._sections:
            section.lock(reason)
        held = self._held()
        for widget in (self.station_box, self.new_button):
            widget.setEnabled(not held)
            widget.setToolTip(held)
        if held:
            self.new_bar.hide()
        self.refresh()

    def _names(self) -> tuple[str, ...]:
        return (
            self.tr("Station"),
            self.tr("Link to the table"),
            self.tr("Link to the IMU"),
            self.tr("Site"),
            self.tr("Table"),
            self.tr("Profiles and products"),
            self.tr("This computer"),
        )

    def _role_reason(self) -> str:
        if self.app.role.engineer:
            return ""
        return self.tr("Only an engineer may change this: press the padlock at the top right.")

    def _held(self) -> str:
        """Why nothing may be put in force now, "" where it may."""
        if self.app.engine_link.running:
            return self.tr("A run is going on; what is typed can be saved when it has ended.")
        return self._role_reason()

    def _unsaved(self) -> str:
        return ", ".join(draft.name for draft in self.drafts.dirty)

    def _mark_sections(self) -> None:
        """A dot behind the sections in which something is typed."""
        station, table = self.drafts.station, self.drafts.table
        typed = [any(station.differs(place) for place in places) for places in _PLACES]
        typed += [table.dirty, any(draft not in (station, table) for draft in self.drafts.dirty), False]
        for row, (name, dot) in enumerate(zip(self._names(), typed, strict=True)):
            self.nav.item(row).setText(f"{name} ●" if dot else name)

    def _turn(self, row: int) -> None:
        self._stack.setCurrentIndex(row)
        section = self._sections[row]
        if isinstance(section, LinkSection):
            section.search()

    def _open(self) -> None:
        """Take up the station in force and its table's profile."""
        path = self.app.station_path or library.find("stations", DEFAULT_STATION)
        if self.drafts.station.path != path or not self.drafts.station.dirty:
            self.drafts.station.open(path)
        self._fill()
        self.refresh()

    def _follow_profile(self) -> None:
        """The table's form shows the profile that the station names."""
        name = self.drafts.station.value(("table", "profile"))
        if not isinstance(name, str) or name not in library.names("tables"):
            return
        path = library.find("tables", name)
        if not self.drafts.table.dirty:  # what is typed for another profile is saved or discarded first
            self.drafts.table.open(path)

    def _fill(self) -> None:
        """Offer all stations; the one in force is chosen, also where it lies elsewhere."""
        with QSignalBlocker(self.station_box):
            self.station_box.clear()
            for entry in settings.entries("stations"):
                self.station_box.addItem(self._words(entry.path), _key(entry.path))
            path = self.drafts.station.path
            if path is None:
                self.station_box.setCurrentIndex(-1)
                return
            if self.station_box.findData(_key(path)) < 0:
                self.station_box.addItem(self._words(path), _key(path))
            self.station_box.setCurrentIndex(self.station_box.findData(_key(path)))

    def _words(self, path: Path) -> str:
        return self.tr("{0} (virtual bench)").format(path.stem) if settings.is_bench(path) else path.stem

    def _choose(self, index: int) -> None:
        """Another station: at once where nothing is typed, else after asking."""
        path, now = Path(self.station_box.itemData(index)), self.drafts.station.path
        if now is not None and _key(path) == _key(now):
            return
        if self.may_leave(lambda: self._use(path)):
            self._use(path)
        else:
            self._fill()

    def _ask_new(self) -> None:
        if self.may_leave(self._ask_new):
            self.new_bar.ask("stations", "example_hardware")

    def _use(self, path: Path) -> None:
        self.app.set_station(path)
        self.app.settings.setValue("station", path.stem)

    def _saved(self, kind: str) -> None:
        """Tell the others what has changed for them."""
        station = self.drafts.station
        if kind == "stations" and station.path is not None and not station.dirty:
            self._use(station.path)
            return
        if kind == "products" and self.app.product_path is not None:
            self.app.product_path = library.find("products", self.app.product_path.stem)
        self.app.station_changed.emit()
        if kind in ("products", "imus"):
            self.app.product_changed.emit()


def _scrolled(section: QWidget) -> QScrollArea:
    area = QScrollArea()
    area.setWidgetResizable(True)
    area.setFrameShape(QFrame.Shape.NoFrame)
    area.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
    area.setWidget(section)
    return area


def _key(path: Path) -> str:
    """A path as a box finds it again; one that is no text it does not."""
    return str(path.absolute())
