"""The station itself: its name, its table, the virtual bench's settings, and where its results are handed over."""

from pathlib import Path

from PySide6.QtCore import QEvent, Qt
from PySide6.QtWidgets import (
    QFileDialog,
    QFormLayout,
    QFrame,
    QHBoxLayout,
    QLabel,
    QPushButton,
    QVBoxLayout,
    QWidget,
)

from calstation.config import library, version_store
from calstation.config.station import rails_by_hand
from calstation.gui.settings.drafts import Drafts
from calstation.gui.settings.fields import Field, Form, Row, at_top, tab_through
from calstation.gui.settings.inputs import ChoiceBox, NumberEdit, WordEdit
from calstation.gui.widgets import theme
from calstation.gui.widgets.badge import StateBadge


class StationSection(QWidget):
    """What the station file says of itself, and what the file is."""

    def __init__(self, drafts: Drafts) -> None:
        super().__init__()
        self._drafts, self._draft = drafts, drafts.station
        self._heading = QLabel()
        self._heading.setProperty("kind", "section")
        self._browse = QPushButton()
        self._browse.setObjectName("handover_browse_button")
        self._browse.clicked.connect(self._choose_folder)
        self._bench_fields = [
            Field(
                self._draft,
                ("bench", "seed"),
                NumberEdit(),
                lambda: self.tr("Seed of the unit and table"),
                default=1,
                hint=lambda: self.tr("Another seed is another unit with other errors."),
            ),
            Field(
                self._draft,
                ("bench", "speed"),
                NumberEdit(),
                lambda: self.tr("Speed"),
                unit="×",
                default=0,
                hint=lambda: self.tr("Multiple of real time; 0 is as fast as this computer can."),
            ),
        ]
        self._form = Form(
            Field(self._draft, ("name",), WordEdit(), lambda: self.tr("Name, as in every result")),
            Field(
                self._draft,
                ("table", "profile"),
                ChoiceBox(lambda: [(name, name) for name in library.names("tables")]),
                lambda: self.tr("Table profile"),
                hint=lambda: self.tr("Its limits stand under “Table”."),
            ),
            Field(
                self._draft,
                ("handover", "folder"),
                WordEdit(),
                lambda: self.tr("Hand-over folder"),
                hint=lambda: self.tr(
                    "Where the factory's own system collects results; empty: beside the runs."
                ),
            ),
            Row(self._browse, str),
            *self._bench_fields,
        )
        name, profile, folder, *bench = (field.editor for field in self._form.fields)
        tab_through(name, profile, folder, self._browse, *bench)
        left = QVBoxLayout()
        left.setSpacing(theme.GRID)
        left.addWidget(self._heading)
        left.addWidget(self._form, 1)
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 0, 0, 0)
        row.setSpacing(3 * theme.GRID)
        row.addLayout(left)
        row.addWidget(at_top(self._about()), 1)
        self._draft.changed.connect(self.refresh)
        self.retranslate()

    def _about(self) -> QWidget:
        panel = QFrame()
        panel.setProperty("kind", "panel")
        self.badge = StateBadge(theme.SECTION)
        self.badge.setObjectName("station_kind_badge")
        self._kind, self._file = QLabel(), QLabel()
        self._file.setProperty("kind", "muted")
        self._glance = QFormLayout()
        self._glance.setHorizontalSpacing(2 * theme.GRID)
        self._glance.setVerticalSpacing(theme.GRID)
        self._glance_labels = [(QLabel(), QLabel()) for _ in range(4)]
        for label, value in self._glance_labels:
            label.setProperty("kind", "muted")
            self._glance.addRow(label, value)
        for label in (self._kind, self._file, *(value for _, value in self._glance_labels)):
            label.setWordWrap(True)
            label.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        column = QVBoxLayout(panel)
        column.setContentsMargins(2 * theme.GRID, 2 * theme.GRID, 2 * theme.GRID, 2 * theme.GRID)
        column.setSpacing(2 * theme.GRID)
        column.addWidget(self.badge)
        column.addWidget(self._kind)
        column.addLayout(self._glance)
        column.addWidget(self._file)
        column.addStretch(1)
        return panel

    def lock(self, reason: str) -> None:
        """Forbid changes, with the reason as tooltip; "" allows them."""
        self._form.lock(reason)
        self._browse.setEnabled(not reason)
        self._browse.setToolTip(reason)

    def refresh(self) -> None:
        """Show what the draft says."""
        bench = self._draft.value(("bench",)) is not None
        for field in self._bench_fields:
            field.setVisible(bench)
        if bench:
            self.badge.show_state("none", self.tr("Virtual bench"))
            self._kind.setText(
                self.tr(
                    "Table and unit are software behind the same protocols as hardware: a whole calibration runs "
                    "without either. Nothing moves.\n\nFor hardware, press “New from copy” above and copy "
                    "“example_hardware”."
                )
            )
        else:
            self.badge.show_state("none", self.tr("Hardware"))
            self._kind.setText(
                self.tr("Nothing moves by itself: the operator is guided. Test the IMU before the first run.")
                if self._by_hand
                else self.tr("A run moves the table. Test both links before the first one.")
            )
        for (label, value), (name, text) in zip(self._glance_labels, self._at_a_glance(), strict=True):
            label.setText(name)
            value.setText(text)
        self._file.setText(self._about_file())

    def retranslate(self) -> None:
        """Say everything again in the language in force."""
        self._heading.setText(self.tr("Station"))
        self._browse.setText(self.tr("Choose a folder"))
        self.refresh()

    def changeEvent(self, event: QEvent) -> None:
        """Hear of a new language."""
        if event.type() == QEvent.Type.LanguageChange:
            self.retranslate()
        super().changeEvent(event)

    @property
    def _by_hand(self) -> bool:
        """Whether the table is a rig that hands turn."""
        return rails_by_hand(str(self._draft.value(("table", "profile")) or ""))

    def _at_a_glance(self) -> list[tuple[str, str]]:
        """What the other sections say, in a line each."""

        def get(*place: str) -> str:
            value = self._draft.value(place)
            return "–" if value is None else f"{value:g}" if isinstance(value, float | int) else str(value)

        bench = self._draft.value(("bench",)) is not None
        own = self.tr("opened by the bench")
        table = self.tr("turned by hand") if self._by_hand else own if bench else get("table", "port")
        azimuth = self._draft.value(("site", "azimuth_deg"))
        gravity = self._draft.value(("site", "gravity_mps2"))
        return [
            (self.tr("Table"), f"{get('table', 'profile')}, {table}"),
            (self.tr("IMU"), own if bench else get("imu", "port")),
            (
                self.tr("Place"),
                f"{get('site', 'latitude_deg')}°, {get('site', 'longitude_deg')}°, {get('site', 'height_m')} m; "
                + (
                    self.tr("azimuth from the data")
                    if azimuth is None
                    else self.tr("azimuth {0}°").format(get("site", "azimuth_deg"))
                ),
            ),
            (self.tr("Gravity"), self.tr("normal") if gravity is None else f"{gravity} m/s²"),
        ]

    def _about_file(self) -> str:
        """Where the file lies, whether it is the site's own, and which version."""
        draft = self._draft
        if draft.path is None:
            return ""
        if draft.path.is_relative_to(library.shipped_folder()):
            origin = self.tr("It came with the program; saving a change makes a copy for this site.")
        else:
            number = version_store.number_of(draft.kind, draft.name, draft.saved)
            origin = (
                self.tr("Version {0} of this site's own file.").format(number)
                if number is not None
                else self.tr("This site's own file, not saved from here yet.")
            )
        digest = self.tr("SHA-256 {0}, as in every result").format(version_store.sha256(draft.saved)[:12])
        return f"{draft.path}\n{origin}\n{digest}"

    def _choose_folder(self) -> None:
        present = str(self._draft.value(("handover", "folder")) or "")
        folder = QFileDialog.getExistingDirectory(self, self.tr("Hand-over folder"), present)
        if folder:
            self._draft.set({("handover", "folder"): str(Path(folder))})
