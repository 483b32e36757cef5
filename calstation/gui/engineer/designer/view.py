"""The schedule designer, which runs a search in the background, and shows and saves its result."""

import tempfile
from collections.abc import Callable
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtWidgets import QWidget

from calstation.config import Confirmation, RunRequest, ScheduleOptions, Version
from calstation.errors import CalstationError
from calstation.gui.engineer.designer.form import GIVEN_TIME, DesignForm, SaveBar
from calstation.gui.state import AppContext
from calstation.gui.text import duration_text, on_language_change, product_text, say
from calstation.gui.widgets import (
    Choice,
    EmptyState,
    JobRow,
    NoticeBar,
    box,
    button,
    column,
    enable,
    label,
    row,
    show_text,
    stack,
    theme,
)
from calstation.messages import Text
from calstation.results import compute_preview

if TYPE_CHECKING:
    from calstation.designer import Design, TemperatureDesign
    from calstation.gui.engineer.designer.result import DesignResult
    from calstation.gui.engineer.designer.temperature_result import TemperatureDesignResult

# `calstation.designer` is imported where it is used, because it delays the first paint by 0.1 s.


class DesignView(QWidget):
    """Designs a schedule for the product on the station; `author` returns the engineer."""

    def __init__(self, app: AppContext, notice: NoticeBar, author: Callable[[], Confirmation]) -> None:
        super().__init__()
        self._app, self._notice, self._author = app, notice, author
        self._options: ScheduleOptions | None = None
        #: Options and station file of the current search.
        self._searched: tuple[ScheduleOptions, Path | None] | None = None
        #: Options, station file and values of the form for the current search, and for the latest design.
        self._searched_for: tuple[object, ...] = ()
        self._designed_for: tuple[object, ...] = ()
        #: The latest design with its options.
        self._result: tuple[Design | TemperatureDesign, ScheduleOptions] | None = None
        self._result_view: DesignResult | None = None
        self._temperature_view: TemperatureDesignResult | None = None
        self._why_not = self._why_not_save = ""
        self._goal = ""
        self._error: CalstationError | None = None
        self._folder: tempfile.TemporaryDirectory[str] | None = None
        #: File whose creation ends the search.
        self._stop_file = Path()
        self._stopping = False
        self.watch = app.job(self, None, self._designed, failed=self._search_failed, cancelled=self._refresh)
        self.path_job = app.job(self, compute_preview, lambda preview: self.result_view.show_path(preview))
        self._saving = app.job(self, None, self._saved, cancellable=False)
        self.form = DesignForm(self._begin)
        self._job = JobRow(self.watch, "cancel_design_button", self._progress_text, usual="engineer.design_usually")
        self._stop_button = button("stop_design_button", "engineer.stop_with_best", self._stop)
        self._progress = box(row((self._job, 1), self._stop_button))
        self._problem = label(kind="error", name="design_problem", wrap=True)
        self.save_bar = SaveBar(self._save)
        self._empty = EmptyState(text="engineer.design_about")
        self._stack = stack(self._empty)
        above = self.form, self._progress, self._problem, self.save_bar
        column(*above, (self._stack, 1), on=self, margins=(0, theme.GRID, 0, 0))
        self.form.changed.connect(self._refresh)
        self.watch.busy_changed.connect(self._busy_changed)
        self._saving.busy_changed.connect(self._refresh)
        notice.report_failures(self._saving, "engineer.product_not_saved", self.setFocus)
        notice.report_failures(self.path_job, "engineer.path_not_drawn", self.setFocus)
        on_language_change(self, self._refresh)

    @property
    def result_view(self) -> "DesignResult":
        """The view of the result, which is created on first use."""
        if self._result_view is None:
            from calstation.gui.engineer.designer.result import DesignResult

            self._result_view = DesignResult(self.path_job, self._ask_name)
            self._stack.addWidget(self._result_view)
            for before, after in pairwise((self.save_bar.last, *self._result_view.tab_order)):
                QWidget.setTabOrder(before, after)
        return self._result_view

    @property
    def temperature_view(self) -> "TemperatureDesignResult":
        """The view of the result over temperature, which is created on first use."""
        if self._temperature_view is None:
            from calstation.gui.engineer.designer.temperature_result import TemperatureDesignResult

            self._temperature_view = TemperatureDesignResult(self._ask_name)
            self._stack.addWidget(self._temperature_view)
            for before, after in pairwise((self.save_bar.last, *self._temperature_view.tab_order)):
                QWidget.setTabOrder(before, after)
        return self._temperature_view

    def offer(self, options: ScheduleOptions | None) -> None:
        """Set the options of the product and the station for the next search, or None if they are unusable."""
        self._options = options
        product = "" if options is None else product_text(options.name)
        self._empty.say(Text.of("engineer.design_empty", product=product), "engineer.design_about")
        if options is not None:
            self.form.offer(options)

    @property
    def _conditions(self) -> tuple[object, ...]:
        """The conditions of a design: the options of the product, the station and the values of the form."""
        return self._options, self._app.station_path, self.form.conditions

    def lock(self, reason: str, why_not_save: str) -> None:
        """Disable the search and saving for the given reasons; an empty reason enables the action."""
        options = self._options
        if not reason and options is not None and (options.by_hand or options.geometry.gimbal is not None):
            reason = say("engineer.design_needs_table")
        self._why_not, self._why_not_save = reason, why_not_save
        self._refresh()

    # ---- the search

    def _begin(self) -> None:
        from calstation import designer

        if self._options is None:
            return
        self._searched = self._options, self._app.station_path
        self._searched_for = self._conditions
        self._goal, self._stopping, self._error = self.form.goal, False, None
        self.path_job.cancel()
        self.save_bar.hide()
        self._folder = tempfile.TemporaryDirectory(prefix="calstation-")
        self._stop_file = Path(self._folder.name) / "stop"
        request = self.form.request(self._app.station_path, self._options.product, self._stop_file)
        if self._options.over_temperature:
            self.watch.start(designer.design_temperature, request, *self.form.unit)
        else:
            self.watch.start(designer.design_schedule, request)

    def _stop(self) -> None:
        self._stop_file.touch()
        self._stopping = True
        self._refresh()

    def _busy_changed(self) -> None:
        if not self.watch.busy and self._folder is not None:
            self._folder.cleanup()
            self._folder = None
        self._refresh()

    def _progress_text(self) -> str:
        job = self.watch.job
        note = "" if job is None else job.note
        if note in ("checking", "present"):
            return say("engineer.design_checking" if note == "checking" else "engineer.design_predicting")
        if self._stopping:
            return say("engineer.design_stopping")
        if note in ("", "inf"):
            return say("engineer.design_searching")
        if self._goal == GIVEN_TIME:
            return say("engineer.design_best_ratio", ratio=float(note))
        return say("engineer.design_best_duration", duration=duration_text(float(note)))

    def _designed(self, result: "Design | TemperatureDesign") -> None:
        """Show a design; if it is for one temperature, start the job that computes its path."""
        from calstation import designer

        if self._searched is None:
            return
        options, station = self._searched
        self._result, self._designed_for = (result, options), self._searched_for
        if isinstance(result, designer.TemperatureDesign):
            self.temperature_view.show_design(result, options)
            self._stack.setCurrentWidget(self.temperature_view)
            self._refresh()
            return
        self.result_view.show_design(result, options)
        self._stack.setCurrentWidget(self.result_view)
        schedule = {
            "moves": [list(move) for move in result.moves],
            "rate_dps": result.rate_dps,
            "acceleration_dps2": result.acceleration_dps2,
            "stop_at_limits": False,
        }
        stage, folder = designer.STAGE, self._app.runs_folder
        self.path_job.start(RunRequest("-", station, options.product, (stage,), folder, schedule={stage: schedule}))
        self._refresh()

    def _search_failed(self, error: CalstationError) -> None:
        self._error = error
        self._refresh()

    # ---- the result

    def _ask_name(self) -> None:
        if self._result is not None:
            self.save_bar.ask(self._result[1].product.stem)

    def _save(self, name: str) -> None:
        from calstation import designer

        if self._result is None:
            return
        result, options = self._result
        if isinstance(result, designer.TemperatureDesign):
            designed = partial(designer.temperature_product, design=result)
        else:
            designed = partial(designer.designed_product, design=result)
        self._saving.start(designer.save_product, options.product, name, designed, self._author())

    def _saved(self, saved: tuple[Path, Version]) -> None:
        path, version = saved
        words, select = Text.of("engineer.select", product=version.name), partial(self._app.set_product, path)
        choices = (
            Choice("keep_product_button", "engineer.keep_product", self.setFocus),
            Choice("select_product_button", words, select, primary=True),
        )
        title = Text.of("engineer.saved", product=version.name, number=version.number)
        self._notice.ask("good", title, "engineer.design_saved", choices)

    # ---- state

    def _refresh(self) -> None:
        busy = self.watch.busy
        self._progress.setVisible(busy)
        enable(self._stop_button, say("engineer.design_stopping") if self._stopping else "")
        over_temperature = self._searched is not None and self._searched[0].over_temperature
        self._stop_button.setVisible(not over_temperature)
        self.form.lock(say("engineer.design_running") if busy else self._why_not, visible=not busy)
        show_text(self._problem, "" if busy or self._error is None else say(self._error.as_text))
        current = self._result is None or self._conditions == self._designed_for
        outdated = "" if current else say("engineer.design_outdated")
        why_not_save = say("engineer.saving") if self._saving.busy else outdated or self._why_not_save
        self.save_bar.lock(why_not_save)
        for view in (self._result_view, self._temperature_view):
            if view is not None:
                view.lock(why_not_save, outdated)
