"""The station itself: name, table profile, settings of the virtual bench, and the hand-over folder."""

from pathlib import Path

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QFileDialog, QFormLayout, QWidget

from calstation.config import is_manual_table, library, versions
from calstation.gui.settings.drafts import Drafts
from calstation.gui.settings.fields import Field, Form, Row, panel, set_tab_order
from calstation.gui.settings.inputs import ChoiceBox, NumberEdit, WordEdit
from calstation.gui.text import on_language_change
from calstation.gui.widgets import StateBadge, button, column, enable, label, row, theme


class StationSection(QWidget):
    """The station's own values, and a summary of its file."""

    def __init__(self, drafts: Drafts) -> None:
        super().__init__()
        self._draft = draft = drafts.station
        name = Field(draft, ("name",), WordEdit(), lambda: self.tr("Name, as in every result"))
        profile = Field(
            draft,
            ("table", "profile"),
            ChoiceBox(lambda: [(name, name) for name in library.names("tables")]),
            lambda: self.tr("Table profile"),
            hint=lambda: self.tr("Its limits are on the page “Table”."),
        )
        folder = Field(
            draft,
            ("handover", "folder"),
            WordEdit(),
            lambda: self.tr("Hand-over folder"),
            hint=lambda: self.tr("The factory's system collects results here; empty: a folder beside the runs."),
        )
        seed = Field(
            draft,
            ("bench", "seed"),
            NumberEdit(),
            lambda: self.tr("Seed of the unit and table"),
            default=1,
            hint=lambda: self.tr("Another seed gives a unit with other errors."),
        )
        speed = Field(
            draft,
            ("bench", "speed"),
            NumberEdit(),
            lambda: self.tr("Speed"),
            unit="×",
            default=0,
            hint=lambda: self.tr("Multiple of real time; 0 is as fast as this computer can."),
        )
        self._bench_fields = (seed, speed)
        self._browse = button("handover_browse_button", lambda: self.tr("Choose a folder"), self._choose_folder)
        self._form = Form(name, profile, folder, Row(self._browse), seed, speed)
        set_tab_order((name.editor, profile.editor, folder.editor, self._browse, seed.editor, speed.editor))
        left = column(label(lambda: self.tr("Station"), "section"), (self._form, 1))
        row(left, (self._about(), 1), on=self, spacing=3 * theme.GRID)
        draft.changed.connect(self.refresh)
        on_language_change(self, self.refresh)

    def _about(self) -> QWidget:
        self.badge = StateBadge(theme.SECTION)
        self.badge.setObjectName("station_kind_badge")
        self._kind, self._file = label(wrap=True), label(kind="muted", wrap=True)
        self._summary = [(label(kind="muted"), label(wrap=True)) for _ in range(4)]
        lines = QFormLayout()
        lines.setHorizontalSpacing(2 * theme.GRID)
        lines.setVerticalSpacing(theme.GRID)
        for name, value in self._summary:
            lines.addRow(name, value)
        for each in (self._kind, self._file, *(value for _, value in self._summary)):
            each.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        return panel(self.badge, self._kind, lines, self._file, spacing=2 * theme.GRID)

    def lock(self, reason: str) -> None:
        """Disable changes with the reason as tooltip; "" enables them."""
        self._form.lock(reason)
        enable(self._browse, reason)

    def refresh(self) -> None:
        """Show the draft."""
        bench = self._draft.value(("bench",)) is not None
        for field in self._bench_fields:
            field.setVisible(bench)
        self.badge.show_state("none", self.tr("Virtual bench") if bench else self.tr("Hardware"))
        self._kind.setText(self._about_kind(bench))
        for (label_, value), (name, text) in zip(self._summary, self._summary_texts(bench), strict=True):
            label_.setText(name)
            value.setText(text)
        self._file.setText(self._about_file())

    def _about_kind(self, bench: bool) -> str:
        if bench:
            return self.tr(
                "Table and unit are software that speaks the protocols of the hardware: a whole calibration runs "
                "without either. Nothing moves.\n\nFor hardware, press “New from copy” above and copy "
                "“example_hardware”."
            )
        if self._by_hand:
            return self.tr("Nothing moves by itself: the operator is guided. Test the IMU before the first run.")
        return self.tr("A run moves the table. Test both links before the first one.")

    @property
    def _by_hand(self) -> bool:
        """Whether the table is a rig turned by hand."""
        return is_manual_table(str(self._draft.value(("table", "profile")) or ""))

    def _summary_texts(self, bench: bool) -> list[tuple[str, str]]:
        """The other sections, in a line each."""

        def get(*place: str) -> str:
            value = self._draft.value(place)
            return "–" if value is None else f"{value:g}" if isinstance(value, float | int) else str(value)

        own = self.tr("opened by the bench")
        table = self.tr("turned by hand") if self._by_hand else own if bench else get("table", "port")
        position = f"{get('site', 'latitude_deg')}°, {get('site', 'longitude_deg')}°, {get('site', 'height_m')} m"
        if self._draft.value(("site", "azimuth_deg")) is None:
            azimuth = self.tr("azimuth from the data")
        else:
            azimuth = self.tr("azimuth {0}°").format(get("site", "azimuth_deg"))
        gravity = self._draft.value(("site", "gravity_mps2"))
        return [
            (self.tr("Table"), f"{get('table', 'profile')}, {table}"),
            (self.tr("IMU"), own if bench else get("imu", "port")),
            (self.tr("Site"), f"{position}; {azimuth}"),
            (self.tr("Gravity"), self.tr("normal") if gravity is None else f"{gravity} m/s²"),
        ]

    def _about_file(self) -> str:
        """Path, origin and version of the file."""
        draft = self._draft
        if draft.path is None:
            return ""
        if draft.path.is_relative_to(library.shipped_folder()):
            origin = self.tr("It came with the program; saving a change makes a copy for this site.")
        else:
            number = versions.version_number(draft.kind, draft.name, draft.saved)
            origin = (
                self.tr("Version {0} of this site's own file.").format(number)
                if number is not None
                else self.tr("This site's own file, not saved from here yet.")
            )
        digest = self.tr("SHA-256 {0}, as in every result").format(versions.sha256(draft.saved)[:12])
        return f"{draft.path}\n{origin}\n{digest}"

    def _choose_folder(self) -> None:
        place = ("handover", "folder")
        present = str(self._draft.value(place) or "")
        folder = QFileDialog.getExistingDirectory(self, self.tr("Hand-over folder"), present)
        if folder:
            self._draft.set({place: str(Path(folder))})
