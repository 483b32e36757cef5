"""General settings of a station, and settings of its shared records."""

from PySide6.QtWidgets import QFormLayout, QWidget

from calstation.config import is_manual_table, library, versions
from calstation.gui.settings.drafts import Draft
from calstation.gui.settings.fields import EDITOR, Field, Section, folder_row, panel
from calstation.gui.state import AppContext, ExchangeLabel
from calstation.gui.text import on_language_change, rendered, say, with_minus
from calstation.gui.widgets import ChoiceBox, NumberEdit, StateBadge, TextEdit, column, label, row, show_text, theme
from calstation.messages import local_time

_FOLDER = ("handover", "folder")
#: Width of the input for a URL, px.
_URL_WIDTH = EDITOR + 14 * theme.GRID


class StationSection(Section):
    """The section for the general settings of a station, with a summary of the station file."""

    def __init__(self, draft: Draft) -> None:
        super().__init__(draft)
        profiles = ChoiceBox(lambda: [(name, name) for name in library.names("tables")])
        products = ChoiceBox(
            lambda: [(None, say("settings.first_compatible")), *((name, name) for name in library.names("products"))]
        )
        units = NumberEdit()
        units.setPlaceholderText("1")
        self._bench_fields = [
            *(Field(draft, ("bench", key), default=default) for key, default in (("seed", 1), ("speed", 0))),
            Field(draft, ("bench", "units"), units),
        ]
        left = column(
            label("common.station", "section"),
            Field(draft, ("name",)),
            Field(draft, ("table", "profile"), profiles),
            Field(draft, ("product",), products),
            Field(draft, _FOLDER),
            folder_row("handover_browse_button", draft, _FOLDER),
            Field(draft, ("clock_error_ppm",)),
            *self._bench_fields,
            None,
        )
        row(left, (self._make_summary(), 1), on=self, spacing=3 * theme.GRID)
        self.connect_draft()

    def _make_summary(self) -> QWidget:
        self.badge = StateBadge(theme.SECTION, "station_kind_badge")
        self._kind = label(wrap=True, selectable=True)
        self._file = label(kind="muted", wrap=True, selectable=True)
        self._summary = [(label(kind="muted"), label(wrap=True, selectable=True)) for _ in range(4)]
        lines = QFormLayout()
        lines.setHorizontalSpacing(2 * theme.GRID)
        lines.setVerticalSpacing(theme.GRID)
        for name, value in self._summary:
            lines.addRow(name, value)
        return panel(self.badge, self._kind, lines, self._file, spacing=2 * theme.GRID)

    def refresh(self) -> None:
        """Show the values of the draft."""
        draft = self._draft
        bench = draft.value(("bench",)) is not None
        by_hand = is_manual_table(str(draft.value(("table", "profile")) or ""))
        for field in self._bench_fields:
            field.setVisible(bench)
        counted = draft.value(("slots",)) and draft.value(("bench", "units")) is None
        self._bench_fields[-1].setVisible(bench and not counted)
        self.badge.show_state("none", say("common.virtual_bench" if bench else "settings.hardware"))
        self._kind.setText(say(f"setting.station_{'bench' if bench else 'by_hand' if by_hand else 'hardware'}"))
        for (name, value), texts in zip(self._summary, self._summary_texts(bench, by_hand), strict=True):
            name.setText(say(texts[0]))
            value.setText(texts[1])
        self._file.setText(_about_file(draft))

    def _summary_texts(self, bench: bool, by_hand: bool) -> list[tuple[str, str]]:
        """Return the caption code and a one-line summary for each of the other sections."""

        def get(*key_path: str | int) -> str:
            value = self._draft.value(key_path)
            return "–" if value is None else with_minus(f"{value:g}") if isinstance(value, float | int) else str(value)

        slots = [get("slots", number, "name") for number in range(len(self._draft.value(("slots",)) or ()))]
        by_bench = say("settings.opened_by_bench")
        table = say("settings.turned_by_hand") if by_hand else by_bench if bench else get("table", "port")
        position = f"{get('site', 'latitude_deg')}°, {get('site', 'longitude_deg')}°, {get('site', 'height_m')} m"
        azimuth, gravity = get("site", "azimuth_deg"), get("site", "gravity_mps2")
        azimuth = say("settings.azimuth_from_data") if azimuth == "–" else say("settings.azimuth", degrees=azimuth)
        imu = by_bench if bench else get("imu", "port")
        return [
            ("settings.table", f"{get('table', 'profile')}, {table}"),
            ("form.tab_slots", ", ".join(slots)) if slots else ("settings.imu", imu),
            ("settings.site", f"{position}; {azimuth}"),
            ("setting.gravity", say("settings.normal") if gravity == "–" else f"{gravity} m/s²"),
        ]


def _about_file(draft: Draft) -> str:
    """Return the path, origin and version of a file."""
    if draft.path is None:
        return ""
    number = versions.version_number(draft.kind, draft.name, draft.saved)
    if draft.path.is_relative_to(library.shipped_folder()):
        origin = say("settings.shipped_file")
    elif number is not None:
        origin = say("settings.own_version", number=number)
    else:
        origin = say("settings.own_file")
    return f"{draft.path}\n{origin}\n{say('settings.digest', digest=versions.sha256(draft.saved)[:12])}"


class RecordsSection(Section):
    """The section for the table `[records]` of a station file, with the state of the exchange with the database."""

    def __init__(self, app: AppContext, draft: Draft) -> None:
        super().__init__(draft)
        self._app = app
        self._status = label(name="exchange_status_label", wrap=True)
        left = column(
            label("settings.shared_records", "section"),
            Field(draft, ("records", "database"), TextEdit(), width=_URL_WIDTH),
            Field(draft, ("records", "archive"), TextEdit(), width=_URL_WIDTH),
            folder_row("archive_browse_button", draft, ("records", "archive")),
            None,
        )
        waiting = ExchangeLabel(app)
        waiting.setWordWrap(True)
        about = label("setting.about_password", "muted", wrap=True, selectable=True)
        right = panel(about, self._status, waiting, spacing=2 * theme.GRID)
        row(left, (right, 1), on=self, spacing=3 * theme.GRID)
        app.exchange_changed.connect(self.refresh)
        on_language_change(self, self.refresh)

    def refresh(self) -> None:
        """Show the time of the last exchange with the database, and the errors of the exchange and the archive."""
        state = self._app.exchange_state
        lines = []
        if state is not None:
            contact = state.contact_utc
            when = "" if contact is None else local_time(contact.isoformat())
            lines.append(say("settings.last_exchange", time=when) if when else say("settings.not_exchanged"))
            for error in (state.error, state.refusal, state.archive_error):
                if error is not None:
                    lines += [rendered(error).text, rendered(error).remedy]
        show_text(self._status, "\n".join(lines))
