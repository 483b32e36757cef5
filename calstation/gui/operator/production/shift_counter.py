"""Line with the counts of the shift: completed, passed and failed units, yield and mean time per unit."""

from datetime import datetime

from PySide6.QtCore import QTimer

from calstation.gui.state import AppContext
from calstation.gui.text import duration_text, on_language_change, say
from calstation.gui.widgets import PlainLabel, show_text
from calstation.messages import Text
from calstation.results import ShiftCount, count_shift, shift_start
from calstation.runs import RunSummary

#: Interval at which the start of a new shift is checked, ms.
_CHECK_MS = 60_000


class ShiftCounter(PlainLabel):
    """A line with the counts of the shift, which a background job computes; hidden while the station is unusable."""

    def __init__(self, app: AppContext) -> None:
        super().__init__()
        self.setObjectName("shift_label")
        self.setProperty("kind", "muted")
        self._app = app
        self._summary: RunSummary | None = None
        self._since: datetime | None = None
        self._count: ShiftCount | None = None  #: None until a job has counted the units.
        self._program: Text | None = None  #: Other program that used the station at the last change.
        self._watch = app.job(self, count_shift, self._counted)
        self._timer = QTimer(self, interval=_CHECK_MS)
        self._timer.timeout.connect(self._check_shift)
        app.run.changed.connect(self._run_changed)
        on_language_change(self, self._show_count)

    def set_next_run(self, run_summary: RunSummary | None) -> None:
        """Count the units of the station of the next run."""
        self._summary = run_summary
        if self._timer.isActive():
            self.count()

    def count(self) -> None:
        """Count the units now and whenever a shift starts."""
        self._timer.start()
        summary, folder = self._summary, self._app.runs_folder
        since = None if summary is None else shift_start(summary.shift_starts)
        if since != self._since:
            self._since, self._count = since, None
        if summary is not None and folder.is_dir():
            self._watch.start(folder, summary.station, since, measured=not summary.virtual)
        else:
            self._count = ShiftCount()
        self._show_count()

    def _run_changed(self) -> None:
        """Count the units again when the run of another program has ended."""
        before, self._program = self._program, self._app.run.program
        if before is not None and self._program is None and self._timer.isActive():
            self.count()

    def _check_shift(self) -> None:
        if self._summary is not None and shift_start(self._summary.shift_starts) != self._since:
            self.count()

    def _counted(self, count: ShiftCount) -> None:
        self._count = count
        self._show_count()

    def _show_count(self) -> None:
        count = self._count
        if self._since is None:
            show_text(self, "")
            return
        parts = [say("operator.since", time=f"{self._since:%H:%M}")]
        if count is not None:
            parts.append(say("operator.done", count=count.done))
        if count is not None and count.mean_duration is not None and count.passed_share is not None:
            rig = self._summary is not None and self._summary.by_hand
            per_unit = "operator.per_unit_rig" if rig else "operator.per_unit"
            parts += [
                say("operator.passed", count=count.passed),
                say("operator.failed", count=count.failed),
                say("operator.yield", percent=100 * count.passed_share),
                say(per_unit, time=duration_text(count.mean_duration)),
            ]
        if count is not None and count.partial_failed:
            parts.append(say("operator.partial_failed", count=count.partial_failed))
        show_text(self, "  ·  ".join(parts))
