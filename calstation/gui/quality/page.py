"""The Quality page: what many runs say about units, stations and the process."""

from pathlib import Path

from PySide6.QtGui import QShowEvent
from PySide6.QtWidgets import QWidget

from calstation.config import load_product
from calstation.errors import CalstationError
from calstation.gui.history import Filters
from calstation.gui.quality.capability_view import CapabilityView
from calstation.gui.quality.control_view import LEAST_RUNS, ControlView
from calstation.gui.shell import AppContext, Page
from calstation.gui.text import on_language_change, say
from calstation.gui.widgets import (
    EmptyState,
    JobRow,
    JobStack,
    JobWatch,
    NoticeBar,
    ViewTabs,
    button,
    column,
    label,
    row,
    stack,
    theme,
)
from calstation.records import RunColumns
from calstation.results import History, load_columns
from calstation.sequencer import Event, Verdict


class QualityPage(Page):
    """Shows statistics of the runs in the runs folder that meet the filters."""

    def __init__(self, app: AppContext) -> None:
        super().__init__(app)
        self.setObjectName("quality_page")
        self._watch = JobWatch(self, self._show)
        self._runs: RunColumns | None = None
        self.notice = NoticeBar("quality_notice")
        self.count_label = label(kind="muted", name="quality_count_label")
        idle = QWidget()
        clear_button = button("quality_clear_button", lambda: self.tr("Show all runs"))
        row((self.count_label, 1), clear_button, on=idle)
        self.filters = Filters(JobStack(idle, JobRow(self._watch, "quality_cancel_button")), "quality")
        clear_button.clicked.connect(self.filters.clear)
        self.control, self.capability = ControlView(), CapabilityView()
        self._views = (self.control, self.capability)
        self.tabs = ViewTabs("quality_views")
        for _ in self._views:
            self.tabs.addTab("")
        self._empty = EmptyState()
        self._stack = stack(self._empty, *self._views)
        wide = 2 * theme.GRID
        column(
            self.notice, self.filters, self.tabs, (self._stack, 1), on=self, margins=(wide, theme.GRID, wide, wide)
        )
        self.tabs.currentChanged.connect(lambda _: self._show_view())
        self.filters.changed.connect(self.refresh)
        self.control.run_wanted.connect(self._open_run)
        self.notice.report_failures(self._watch, lambda: self.tr("The runs could not be read"), self.tabs.setFocus)
        app.engine_link.event.connect(self._follow)
        app.runs_folder_changed.connect(self._read_visible)
        on_language_change(self, self._show_texts)

    @property
    def busy(self) -> bool:
        """Whether the runs are being read."""
        return self._watch.busy

    def refresh(self) -> None:
        """Read the runs that meet the filters, and show them."""
        if self.app.runs_folder.is_dir():
            self._watch.watch(self.app.job_queue.submit(load_columns, self.app.runs_folder, self.filters.wanted))
        else:
            self._show(None)

    def showEvent(self, event: QShowEvent) -> None:
        """Read the runs."""
        super().showEvent(event)
        self._read_visible()

    def _read_visible(self) -> None:
        if self.isVisible():
            if self.app.runs_folder.is_dir():
                self.filters.show_choices(History(self.app.runs_folder).choices())
            self.refresh()

    def _follow(self, event: Event) -> None:
        if isinstance(event, Verdict) and self.isVisible():
            self.refresh()
