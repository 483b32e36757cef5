"""The Quality page: statistics of units, stations and the process over many runs."""

from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path

from PySide6.QtCore import Qt
from PySide6.QtGui import QShowEvent
from PySide6.QtWidgets import QSizePolicy, QWidget

from calstation.config import DEFAULT_PRODUCT, library, load_product
from calstation.database import fetch_result
from calstation.errors import CalstationError
from calstation.gui.quality.capability_view import CapabilityView
from calstation.gui.quality.control_view import ControlView
from calstation.gui.quality.standards_view import StandardsView
from calstation.gui.quality.study_view import StudyView
from calstation.gui.quality.yield_view import YieldView
from calstation.gui.state import AppContext, Page
from calstation.gui.text import Words, bind, offered_products, on_language_change, say, station_text
from calstation.gui.widgets import (
    EmptyState,
    JobRow,
    JobStack,
    ViewTabs,
    box,
    column,
    combo_box,
    fill_combo,
    label,
    row,
    show_text,
    stack,
    theme,
)
from calstation.messages import Text
from calstation.quality import MIN_VALUES, QualitySummary, StationQuality, Yields, station_quality, summarise_quality
from calstation.records import RunFilter
from calstation.results import History, refresh_history
from calstation.sequencer import Event, Finalized

#: Selectable numbers of past days; None for all.
_PERIODS: dict[int | None, Words] = {
    None: "quality.any_time",
    1: "quality.last_day",
    **{days: Text.of("common.last_days", days=days) for days in (7, 30, 90, 365)},
}


class QualityPage(Page):
    """The page with statistics of the runs in the runs folder."""

    def __init__(self, app: AppContext) -> None:
        super().__init__(app, "quality")
        self._summary: QualitySummary | None = None
        #: Views that do not yet show the summary.
        self._outdated: set[QWidget] = set()
        unread = "common.runs_not_read"
        self._refresher = self.job(refresh_history, self._show_refreshed, failure=unread)
        self._watch = self.job(summarise_quality, self._show, failure=unread)
        self._station_watch = self.job(station_quality, self._show_station, failure=unread)
        self._fetcher = self.job(fetch_result, app.open_run.emit, failure="common.result_not_opened")
        scales = {False: "common.numeric_value", True: "quality.deviation"}
        names = ("product", "unit", "station")
        self.product, self.unit, self.station = (combo_box(f"quality_{name}_combo", fit=True) for name in names)
        self.period = combo_box("quality_period_combo", _PERIODS, fit=True)
        self.scale = combo_box("quality_scale_combo", scales, fit=True)
        bind(self.scale.setToolTip, "quality.about_deviations")
        self.count_label = label(kind="muted", name="quality_count_label")
        self.count_label.setAlignment(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
        self.scope_label = label(kind="muted", name="quality_scope_label", wrap=True)
        self.control, self.capability, self.yields = ControlView(), CapabilityView(), YieldView()
        self.study = StudyView(self, self.product.currentData)
        self.standards = StandardsView()
        self._views: tuple[QWidget, ...] = (self.control, self.capability, self.yields, self.standards, self.study)
        self.tabs = ViewTabs(
            "quality_views",
            *("quality.control_charts", "quality.capability", "quality.yield"),
            *("quality.check_standards", "quality.repeatability"),
        )
        self.setFocusProxy(self.tabs)
        self._empty = EmptyState()
        self._stack = stack(self._empty, *self._views)
        self._lay_out()
        self.tabs.currentChanged.connect(lambda _: self._show_view())
        self.product.currentIndexChanged.connect(lambda _: self._product_chosen())
        for combo in (self.unit, self.station, self.period, self.scale):
            combo.currentIndexChanged.connect(lambda _: self.read())
        for view in (self.control, self.standards):
            view.run_requested.connect(self._open_run)
        app.engine_link.event.connect(self._handle_event)
        app.runs_folder_changed.connect(self._refresh_visible)
        for changed in (app.station_changed, app.product_changed):
            changed.connect(lambda: self._offer_products(app.product_path))
        self.busy_changed.connect(self._show_view)
        on_language_change(self, self._show_texts)

    @property
    def manual(self) -> str:
        """The section of the manual about the current view."""
        sections: dict[QWidget, str] = {
            self.control: "how-to/quality.md#control-charts",
            self.capability: "how-to/quality.md#capability",
            self.yields: "how-to/quality.md#yield",
            self.standards: "how-to/check-standards.md",
            self.study: "how-to/quality.md#gauge-study",
        }
        return sections[self._views[self.tabs.currentIndex()]]

    def read(self) -> None:
        """Read the selected runs from the index, and show them."""
        folder, product = self.app.runs_folder, self.product.currentData()
        if not folder.is_dir() or product is None:
            self._show(None)
            return
        days = self.period.currentData()
        since = None if days is None else datetime.now(UTC) - timedelta(days=days)
        unit, relative = self.unit.currentData() or None, self.scale.currentData()
        station = self.station.currentData() or ""
        self._watch.start(folder, product, unit, since=since, relative=relative, station=station)

    def _read_all(self) -> None:
        """Read the selected runs, and the station and an open study, which do not depend on the selection."""
        self.read()
        folder, product = self.app.runs_folder, self.product.currentData()
        if folder.is_dir() and product is not None:
            self._station_watch.start(folder, self.app.station_path, product)
        self.study.read()

    def showEvent(self, event: QShowEvent) -> None:
        """Offer the products, which may have changed, and read the runs."""
        super().showEvent(event)
        self._offer_products(self.product.currentData())

    def _lay_out(self) -> None:
        fields = []
        for combo, words in (
            (self.product, "common.product"),
            (self.unit, "quality.units"),
            (self.station, "common.station"),
            (self.period, "common.time"),
            (self.scale, "quality.shown_as"),
        ):
            fields.append(column(label(words, buddy=combo), combo, spacing=theme.GRID // 2))
            bind(combo.setAccessibleName, words)
        progress = JobStack(self.count_label, JobRow(self._watch, "quality_cancel_button"))
        wide = 2 * theme.GRID
        choices = box(row(*fields, None, spacing=wide))
        # a tall view must not compress the choices above it
        choices.setSizePolicy(QSizePolicy.Policy.Preferred, QSizePolicy.Policy.Fixed)
        column(
            self.notice,
            choices,
            row(self.tabs, None, (progress, 1)),
            self.scope_label,
            (self._stack, 1),
            on=self,
            margins=(wide, theme.GRID, wide, wide),
        )

    # ---- choices

    def _offer_products(self, product: Path | None) -> None:
        """Offer the products of the library and select one."""
        fill_combo(self.product, offered_products(), product or library.find("products", DEFAULT_PRODUCT))
        self._offer_units()
        self._refresh_visible()

    def _product_chosen(self) -> None:
        self._offer_units()
        if self.isVisible():
            self._read_all()

    def _offer_units(self) -> None:
        """Offer all units together and each check standard of the product."""
        try:
            product = load_product(self.product.currentData())[1]
            serials = [each.serial for each in product.check_standards]
        except CalstationError:
            serials = []
        standards = ((say("quality.check_standard", serial=serial), serial) for serial in serials)
        fill_combo(self.unit, [(say("quality.all_units"), ""), *standards])

    def _offer_stations(self, names: Sequence[str]) -> None:
        stations = ((station_text(name), name) for name in names)
        fill_combo(self.station, [(say("history.every_station"), ""), *stations])

    def _refresh_visible(self) -> None:
        """Show the indexed runs immediately, and show them again if the folder has changed."""
        if self.isVisible():
            self._read_all()
            if self.app.runs_folder.is_dir():
                self._refresher.start(self.app.runs_folder)

    def _show_refreshed(self, changed: int) -> None:
        if changed:
            self._read_all()

    def _handle_event(self, event: Event) -> None:
        if isinstance(event, Finalized):
            self._refresh_visible()

    # ---- display

    def _show(self, summary: QualitySummary | None) -> None:
        self._summary = summary
        if summary is not None:
            chosen = self.station.currentData()
            self._offer_stations(summary.stations)
            if self.station.currentData() != chosen:  # the folder has no runs of the chosen station
                self.read()
        self._outdated = set() if summary is None else {self.control, self.capability, self.yields, self.study}
        self._show_view()

    def _fill(self, view: QWidget, summary: QualitySummary) -> None:
        """Show the summary in a view; hidden views are updated when they are shown."""
        if view is self.control:
            charts = summary.parameters if summary.serial is None else summary.single_unit
            self.control.show_charts(charts, relative=self.scale.currentData())
        elif view is self.capability:
            self.capability.show_charts(summary.parameters)
        elif view is self.study:
            self.study.show_capability(summary.parameters)
        else:
            self.yields.show_data(summary.yields)

    def _show_station(self, station: StationQuality) -> None:
        self.standards.show_data(station)
        self._show_view()

    def _show_view(self) -> None:
        summary, view = self._summary, self._views[self.tabs.currentIndex()]
        self._show_scope(view)
        if summary is not None and view in self._outdated:
            self._outdated.remove(view)
            self._fill(view, summary)
        judged = summary is not None and summary.yields.overall is not None
        of_unit = view is self.control and summary is not None and summary.serial is not None
        count = 0 if summary is None else summary.unit_chartable if of_unit else summary.chartable
        visible, code = judged or view is self.study, "no_runs"
        if judged or count:
            code = "constant" if count >= MIN_VALUES else "few_runs_of_unit" if of_unit else "few_runs"
        if view is self.control:
            visible = not self.control.empty
        elif view is self.capability and summary is not None:
            visible = not self.capability.empty
            no_capability = "no_deviations" if self.scale.currentData() else "no_limits"
            code = no_capability if summary.parameters else code
        elif view is self.standards:
            visible, code = not self.standards.empty, "no_standards"
        if any(watch.busy for watch in (self._watch, self._station_watch, self._refresher)):
            self._empty.say("chart.reading")
        else:
            values = {"least": MIN_VALUES, "count": count}
            about = "longer" if code.startswith("few_runs") and self.period.currentData() is not None else "about"
            self._empty.say(Text.of(f"chart.{code}", **values), Text.of(f"chart.{code}_{about}", **values))
        self._stack.setCurrentWidget(view if visible else self._empty)
        counted = summary is not None and view is not self.standards
        self.count_label.setText(_count_text(summary.yields) if summary is not None and counted else "")

    def _show_scope(self, view: QWidget) -> None:
        """Enable only the choices that apply to a view, and say what the view shows if it ignores a choice."""
        self.unit.setEnabled(view is self.control)
        for choice in (self.station, self.period):
            choice.setEnabled(view is not self.standards)
        self.scale.setEnabled(view not in (self.standards, self.yields))
        text = ""
        if view is self.standards and self.standards.data is not None:
            text = say("quality.scope_station", station=station_text(self.standards.data.station))
        elif self.unit.currentData() and view is not self.control:
            text = say("quality.scope_runs" if view is self.yields else "quality.scope_units")
        elif view in (self.control, self.capability) and not self.unit.currentData():
            text = say("quality.scope_first" if view is self.control else "quality.scope_last")
        simulated = None if self._summary is None else self._summary.simulated.text
        if simulated is not None and view in (self.control, self.capability, self.yields):
            text = f"{say(simulated)} {text}".strip()
        show_text(self.scope_label, text)

    def _open_run(self, name: str) -> None:
        """Open the result of a run; the result of another station is read from the shared database."""
        file = self.app.runs_folder / f"{name}.json"
        if file.is_file():
            self.app.open_run.emit(file)
            return
        for run in History(self.app.runs_folder).runs(RunFilter(names=(name,))):
            if run.origin:
                self._fetcher.start(self.app.station_path, run)

    def _show_texts(self) -> None:
        self.scale.setItemData(1, say("quality.about_deviations"), Qt.ItemDataRole.ToolTipRole)
        self._offer_products(self.product.currentData() or self.app.product_path)
        self._offer_stations(() if self._summary is None else self._summary.stations)
        self._show_view()


def _count_text(yields: Yields) -> str:
    """Return the numbers of judged runs, of failed partial runs, and of runs without files."""
    count = 0 if yields.overall is None else yields.overall.count
    if not (count or yields.partial_failed):
        return ""
    code = "chart.judged_and_partial" if yields.partial_failed else "chart.judged_runs"
    missing = [say("chart.runs_missing", count=yields.missing)] if yields.missing else []
    return say("quality.semicolon").join([say(code, count=count, partial=yields.partial_failed), *missing])
