"""The Station page: the current station, the links to its devices, its site, and all configuration files."""

from collections.abc import Callable
from datetime import date
from pathlib import Path

from PySide6.QtCore import QSize, Qt
from PySide6.QtGui import QShowEvent
from PySide6.QtWidgets import QListWidget, QListWidgetItem, QWidget

from calstation.config import DEFAULT_STATION, StationConfig, editing, library
from calstation.errors import ConfigurationError
from calstation.gui.settings.drafts import Draft, Drafts
from calstation.gui.settings.fields import problem_text_with_name
from calstation.gui.settings.imu_section import ImuSection
from calstation.gui.settings.laboratory_section import LaboratorySection, OperatorsSection
from calstation.gui.settings.link_section import LinkSection
from calstation.gui.settings.personal_section import PersonalSection
from calstation.gui.settings.profiles_section import NewFileBar, ProfilesSection
from calstation.gui.settings.site_section import SiteSection
from calstation.gui.settings.station_section import RecordsSection, StationSection
from calstation.gui.settings.table_section import TableSection
from calstation.gui.state import AppContext, Page, RunStrip
from calstation.gui.text import bind, on_language_change, say
from calstation.gui.widgets import (
    Choice,
    ChoiceBox,
    PageArea,
    box,
    button,
    column,
    enable,
    label,
    line_edit,
    row,
    scroll_area,
    show_text,
    stack,
    theme,
)
from calstation.messages import Text
from calstation.schema import KeyPath

_NAV_WIDTH = 26 * theme.GRID
_LINK_KEYS = ("port", "timeout_s", "serial")
#: Key paths in the station file that the first eight sections edit.
_SECTION_KEYS: tuple[tuple[KeyPath, ...], ...] = (
    (("name",), ("product",), ("table", "profile"), ("handover",), ("bench",)),
    (*(("table", key) for key in _LINK_KEYS), ("table", "unit")),
    (("chamber",),),
    (*(("imu", key) for key in _LINK_KEYS), ("slots",)),
    (("site",),),
    (("records",),),
    (("laboratory",), ("instruments",), ("report",)),
    (("sign_in",), ("label",)),
)

#: Catalogue codes of the names of the sections that follow the links.
_OTHER_TITLES = (
    *("settings.site", "settings.shared_records", "settings.laboratory_certificates", "settings.operators"),
    *("settings.table", "settings.profiles_and_products", "settings.this_computer"),
)


class StationPage(Page):
    """The page that shows one section from a list; edits are checked at once and saved on demand."""

    def __init__(self, app: AppContext) -> None:
        super().__init__(app, "station")
        self.drafts = Drafts(lambda: app.author, self)
        #: Names of the files that were saved last; "" after another edit.
        self._saved_names = ""
        #: Whether saving has locked the window, because the saved file changes who may sign in.
        self._locked_by_save = False
        self._new_bar = NewFileBar(self.drafts)
        self._new_bar.created.connect(lambda _, path: self._use(path))
        self.header = self._make_header()
        self.table_link = LinkSection(app, "table", self.drafts.station)
        self.chamber_link = LinkSection(app, "chamber", self.drafts.station)
        self.imus = ImuSection(app, self.drafts.station)
        self.profiles = ProfilesSection(app, self.drafts)
        self.personal = PersonalSection(app)
        self._sections = (
            StationSection(self.drafts.station),
            self.table_link,
            self.chamber_link,
            self.imus,
            SiteSection(self.drafts.station),
            RecordsSection(app, self.drafts.station),
            LaboratorySection(self.drafts.station),
            OperatorsSection(self.drafts.station),
            TableSection(self.drafts.table),
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
        app.product_changed.connect(self._reload)
        self._open()
        on_language_change(self, self._fill)
        on_language_change(self, self._lock)

    @property
    def manual(self) -> str:
        """The section of the manual about the current section."""
        sections: dict[type[QWidget], str] = {
            SiteSection: "how-to/connect.md#the-station-file",
            RecordsSection: "how-to/many-stations.md",
            LaboratorySection: "how-to/certificates.md#entries-in-the-station-file",
            OperatorsSection: "how-to/production-line.md#operators-sign-in",
            TableSection: "reference/profiles.md#table-profiles",
            ProfilesSection: "reference/profiles.md",
            PersonalSection: "how-to/production-line.md#sounds",
        }
        section = self._sections[self.nav.currentRow()]
        if section is self.chamber_link:
            return "how-to/connect.md#connect-a-chamber"
        return sections.get(type(section), "how-to/connect.md#in-six-steps")

    def _make_header(self) -> QWidget:
        self.station_box = ChoiceBox(self._stations, "station_combo")
        self.station_box.setMinimumWidth(36 * theme.GRID)
        self.station_box.typed.connect(self._choose)
        bind(self.station_box.setAccessibleName, "common.station")
        caption = label("common.station", buddy=self.station_box)
        self._new_button = button("new_station_button", "settings.new_from_copy", self._ask_new)
        self._save_button = button("save_station_button", "common.save", lambda: self.save(), kind="primary")
        self._discard_button = button("discard_station_button", "settings.discard", self.discard)
        self._unsaved_label = label(name="unsaved_label", wrap=True)
        self._unsaved_label.setAlignment(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
        buttons = self._discard_button, self._save_button
        return box(row(caption, self.station_box, self._new_button, (self._unsaved_label, 1), *buttons))

    def _make_reason(self) -> QWidget:
        """Create the input for the reason, visible while entries of `versions.JUDGING` have changed."""
        hint = "settings.reason_placeholder"
        self._reason_edit = line_edit("change_reason_edit", lambda _: self.refresh(), longest=200, hint=hint)
        why = label("settings.reason_for_change", buddy=self._reason_edit)
        reason_row = box(row(why, (self._reason_edit, 1)))
        reason_row.setVisible(False)
        return reason_row

    def _lay_out(self) -> None:
        self.nav = QListWidget()
        self.nav.setObjectName("station_sections")
        self.nav.setFixedWidth(_NAV_WIDTH)
        self.nav.setProperty("kind", "nav")
        self.nav.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self._stack = stack(*(s if s is self.profiles else scroll_area(s, wide=False) for s in self._sections))
        for _ in self._sections:
            QListWidgetItem(self.nav).setSizeHint(QSize(_NAV_WIDTH, theme.BUTTON))
        self.nav.setMinimumHeight(self.nav.count() * theme.BUTTON)
        self.nav.currentRowChanged.connect(self._show_section)
        self._problems = label(kind="error", name="station_problem_label", wrap=True)
        self._reason_row = self._make_reason()
        # the reason is below the form, so that the first edit does not move rows under the pointer
        right = column(self.notice, self._new_bar, self._problems, (self._stack, 1), self._reason_row)
        wide = 2 * theme.GRID
        content = box(row(self.nav, (right, 1), spacing=wide), margins=(wide, theme.GRID, wide, theme.GRID))
        status = row(RunStrip(self.app.run), margins=(wide, 0, wide, theme.GRID))
        column((PageArea(content), 1), status, on=self)
        self.nav.setCurrentRow(0)

    def showEvent(self, event: QShowEvent) -> None:
        """Read files without unsaved changes again, because they may have been changed outside the page."""
        super().showEvent(event)
        self._open()

    def may_leave(self, go: Callable[[], object]) -> bool:
        """Return whether the page may be left now; otherwise ask the user, and call `go` unless the user stays.

        During a run, the page may always be left, and unsaved changes are kept.
        """
        if not self.drafts.dirty or self.app.engine_link.running:
            return True
        cannot_save = bool(self.drafts.invalid) or not self.app.role.engineer or bool(self._missing_reason())

        def save() -> None:
            if self.save():
                go()

        def discard() -> None:
            self.discard()
            go()

        choices = [
            Choice("save_and_go_button", "settings.save_and_go", save, primary=True),
            Choice("discard_and_go_button", "settings.discard_and_go", discard),
            Choice("stay_button", "settings.stay_here", lambda: None, primary=cannot_save, safe=True),
        ]
        offered = choices[1:] if cannot_save else choices
        self.notice.ask("caution", "settings.unsaved_changes", self._unsaved_names, offered)
        return False

    def save(self, *, overdue: bool = False) -> bool:
        """Save all changes, show any error, and return whether the changes were saved.

        A station with an overdue instrument that refuses production is saved only with `overdue`, after a warning.
        """
        if self.drafts.invalid or self._why_not_save() or self._missing_reason():
            return False
        if not overdue and (instruments := self._overdue()):

            def save_overdue() -> None:
                self.save(overdue=True)

            choices = (
                Choice("stay_button", "settings.stay_here", lambda: None, primary=True, safe=True),
                Choice("save_overdue_button", "settings.save_overdue", save_overdue),
            )
            text = Text.of("settings.about_overdue", names=instruments)
            self.notice.ask("caution", "settings.overdue", text, choices)
            return False
        self.notice.dismiss()
        names, engineer = self._unsaved_names(), self.app.role.engineer
        try:
            self.drafts.save(self._reason_edit.text())
        except ConfigurationError as error:
            choices = (
                Choice("stay_button", "settings.stay_here", lambda: None, primary=True, safe=True),
                Choice("read_again_button", "settings.read_again", self._read_again),
            )
            self.notice.ask("bad", "settings.not_saved", error.as_text, choices if self.drafts.outdated else ())
            return False
        self._saved_names, self._locked_by_save = names, engineer and not self.app.role.engineer
        self._reason_edit.clear()
        self.refresh()
        return True

    def _read_again(self) -> None:
        """Discard the unsaved changes of the files that another program or window has changed."""
        self._discard(self.drafts.outdated)

    def discard(self) -> None:
        """Discard all unsaved changes."""
        self._discard(self.drafts.dirty)

    def _discard(self, drafts: list[Draft]) -> None:
        for draft in reversed(drafts):  # the station is last, because its table is opened with it
            draft.discard(find=not self.app.engine_link.running)
        self._use_found()

    def _reload(self) -> None:
        """Read all files without unsaved changes again; during a run, not those that have since replaced them."""
        self.drafts.reload(find=not self.app.engine_link.running)
        self._use_found()

    def _use_found(self) -> None:
        """Use the station and the product that another window has saved in place of the shipped ones."""
        app, station = self.app, self.drafts.station.path
        if app.engine_link.running:
            return
        if station is not None and app.station_path is not None and _replaces("stations", station, app.station_path):
            app.set_station(station)
        product = app.product_path
        if product is not None and product.stem in library.names("products"):
            found = library.find("products", product.stem)
            if _replaces("products", found, product):
                app.set_product(found)

    def _overdue(self) -> list[str]:
        """Return the names of the overdue instruments of a changed station because of which production is refused."""
        station = self.drafts.station
        if not station.dirty or not isinstance(station.model, StationConfig):
            return []
        required = (each for each in station.model.instruments if each.required)
        return [each.name for each in required if each.due is not None and each.due < date.today()]

    def refresh(self) -> None:
        """Show unsaved changes and problems, and update the buttons."""
        dirty, invalid = self.drafts.dirty, self.drafts.invalid
        status = ""
        if dirty:
            self._saved_names = ""
            status = say("settings.unsaved", names=self._unsaved_names())
        elif self._saved_names:
            locked = self._locked_by_save and not self.app.role.engineer
            status = say("settings.saved_and_locked" if locked else "settings.saved", names=self._saved_names)
        elif self._role_reason():
            status = say("settings.read_only")
        self._unsaved_label.setText(status)
        for each in (self._discard_button, self._save_button):
            each.setVisible(bool(dirty))
        reason = self._why_not_save()
        if invalid and not reason:
            first = problem_text_with_name(invalid[0].problems[0], invalid[0].kind)
            reason = say("settings.correct_in", file=invalid[0].name, problem=first)
        self._reason_row.setVisible(self.drafts.needs_reason)
        enable(self._save_button, reason or self._missing_reason())
        problems = self.drafts.station.problems
        without_field = [p for p in problems if not p.key_path or p.kind in ("toml", "file", "extra_forbidden")]
        show_text(self._problems, "\n".join(map(problem_text_with_name, without_field)))
        if not dirty and self.notice.asking:
            self.notice.dismiss()
        self._name_sections()

    def _lock(self) -> None:
        """Update the enabled inputs; tooltips explain why the others are disabled."""
        for section in self._sections:
            section.lock(self._role_reason())
        reason = self._why_not_save()
        for widget in (self.station_box, self._new_button):
            enable(widget, reason)
        if reason:
            self._new_bar.hide()
        self.refresh()

    def _role_reason(self) -> str:
        return "" if self.app.role.engineer else say("settings.engineers_only")

    def _why_not_save(self) -> str:
        """Return the reason why files cannot be changed now, or ""."""
        if self.app.engine_link.running:
            return say("settings.save_after_run")
        return self._role_reason()

    def _missing_reason(self) -> str:
        """Return a text if the reason for changed limits, checks, stages or confirmations is missing, or ""."""
        missing = self.drafts.needs_reason and not self._reason_edit.text().strip()
        return say("settings.give_reason") if missing else ""

    def _unsaved_names(self) -> str:
        return ", ".join(draft.name for draft in self.drafts.dirty)

    def _name_sections(self) -> None:
        """Show the names of the sections, with a dot after those with unsaved changes."""
        station, table = self.drafts.station, self.drafts.table
        edited = [any(station.differs(key_path) for key_path in key_paths) for key_paths in _SECTION_KEYS]
        edited += [table.dirty, any(draft not in (station, table) for draft in self.drafts.dirty), False]
        titles = (
            "common.station",
            "settings.link_to_table",
            "settings.link_to_chamber",
            self.imus.title,
            *_OTHER_TITLES,
        )
        for number, (title, dot) in enumerate(zip(titles, edited, strict=True)):
            self.nav.item(number).setText(f"{say(title)} ●" if dot else say(title))

    def _show_section(self, number: int) -> None:
        self._stack.setCurrentIndex(number)
        section = self._sections[number]
        if isinstance(section, LinkSection | ImuSection):
            section.search()

    def _open(self) -> None:
        """Show the current station and its table profile, and read all files without unsaved changes again."""
        path = self.app.station_path or library.find("stations", DEFAULT_STATION)
        station = self.drafts.station
        is_edited = station.dirty and station.path is not None and library.share_name("stations", station.path, path)
        if station.path != path and not is_edited:
            self.drafts.switch(station, path)
        self._reload()
        self._fill()
        self.refresh()

    def _follow_profile(self) -> None:
        """Open the table profile of the station, unless the current profile has unsaved changes."""
        name = self.drafts.station.value(("table", "profile"))
        if isinstance(name, str) and name in library.names("tables") and not self.drafts.table.dirty:
            self.drafts.switch(self.drafts.table, library.find("tables", name))

    def _fill(self) -> None:
        self.station_box.fill()
        current = self.drafts.station.path
        self.station_box.show_value(None if current is None else str(current.absolute()))

    def _stations(self) -> list[tuple[str, str]]:
        """Return the paths and names of the stations, including the current one, which may be in another folder."""
        paths = [entry.path.absolute() for entry in editing.list_files("stations")]
        if (current := self.drafts.station.path) is not None:
            paths.append(current.absolute())
        names = {path: path.stem for path in paths}
        return [
            (str(path), say("settings.virtual_station", name=name) if editing.is_bench(path) else name)
            for path, name in names.items()
        ]

    def _choose(self) -> None:
        """Switch to another station; ask the user first if there are unsaved changes."""
        path, current = Path(self.station_box.value()), self.drafts.station.path
        if current is not None and path == current.absolute():
            return
        if self.may_leave(lambda: self._use(path)):
            self._use(path)
        else:
            self._fill()

    def _ask_new(self) -> None:
        if self.may_leave(self._ask_new):
            self._new_bar.ask("stations", "example_hardware")

    def _use(self, path: Path) -> None:
        self.app.set_station(path)
        self.app.settings.setValue("station", path.stem)

    def _saved(self, kind: str) -> None:
        """Inform the other pages that a file has been saved."""
        station = self.drafts.station
        if kind == "stations" and station.path is not None and not station.dirty:
            self._use(station.path)
            return
        if kind == "products" and self.app.product_path is not None:
            self.app.product_path = library.find("products", self.app.product_path.stem)
        self.app.station_changed.emit()
        if kind in ("products", "imus"):
            self.app.product_changed.emit()


def _replaces(kind: str, path: Path, used: Path) -> bool:
    """Return whether the library has a file under the name of another one of its files, which is used."""
    return path != used and library.share_name(kind, path, used) and library.find(kind, used.stem) == path
