"""One run at a glance: how it ended and why, by whom and with what, its numbers, what was outside its limits."""

from collections.abc import Sequence

from PySide6.QtCore import QEvent, Qt, Signal
from PySide6.QtWidgets import (
    QFrame,
    QGridLayout,
    QHBoxLayout,
    QLabel,
    QPushButton,
    QScrollArea,
    QVBoxLayout,
    QWidget,
)

from calstation.gui.history.run_table import local_time, stages_text
from calstation.gui.history.trend import Trend
from calstation.gui.operator import advice
from calstation.gui.text.messages import KINDS, duration_text, event_sentence, free_text, term
from calstation.gui.widgets import theme
from calstation.gui.widgets.badge import StateBadge
from calstation.gui.widgets.labels import ElidedLabel
from calstation.physics.units import aligned
from calstation.records.run_index import IndexedRun, RunRecord
from calstation.results.result import Result

_MOST_FAILED = 8


class RunDetails(QFrame):
    """Signals ask for what the buttons say; the page knows which run is meant."""

    result_wanted = Signal()
    log_wanted = Signal()
    folder_wanted = Signal()
    resume_wanted = Signal()
    close_wanted = Signal()

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setProperty("kind", "panel")
        self._run: RunRecord | None = None
        self._result: Result | None = None
        self._standing = (False, False, False)
        self._serial = QLabel()
        self._serial.setFont(theme.font(theme.SECTION, bold=True))
        self.badge = StateBadge(theme.SECTION)
        self.reason_label, self.failed_label = QLabel(), QLabel()
        self.reason_label.setObjectName("history_reason_label")
        self.failed_label.setObjectName("history_failed_label")
        for label in (self.reason_label, self.failed_label):
            label.setWordWrap(True)
        self._facts, self._figures = QGridLayout(), QGridLayout()
        for grid in (self._facts, self._figures):
            grid.setHorizontalSpacing(2 * theme.GRID)
            grid.setVerticalSpacing(theme.GRID // 2)
        self.trend = Trend()
        self.trend.setMinimumHeight(22 * theme.GRID)
        self._make_buttons()
        self._lay_out()
        self.retranslate()

    def show_run(
        self,
        run: RunRecord,
        result: Result | None,
        unit: Sequence[IndexedRun],
        standing: tuple[bool, bool, bool],
    ) -> None:
        """Show a run, its result where there is one, and the unit's solved runs, oldest first.

        standing : see `allow`
        """
        self._run, self._result, self._standing = run, result, standing
        limits = {}
        for check in result.checks if result is not None else ():
            if check.kind == "within" and isinstance(check.limit, tuple):
                limits[check.subject] = check.limit
        self.trend.show_runs(unit, run.log.stem, limits)
        self.retranslate()

    def allow(self, standing: tuple[bool, bool, bool]) -> None:
        """Take into account whether a run is going on, one is being closed, this one can be resumed."""
        if standing != self._standing:
            self._standing = standing
            self.retranslate()

    def retranslate(self) -> None:
        """Say everything again in the language in force."""
        run = self._run
        if run is None:
            return
        self._serial.setText(run.serial)
        self.badge.show_state(KINDS.get(run.outcome, "none"), term("badge", run.outcome))
        self.reason_label.setText(self._reason(run))
        failed = [] if self._result is None else self._result.failed_checks
        lines = []
        if self._result is not None:
            lines = [f"✕  {advice.failed_check_text(check, self._result)}" for check in failed[:_MOST_FAILED]]
        if len(failed) > _MOST_FAILED:
            lines.append(self.tr("and {0} more").format(len(failed) - _MOST_FAILED))
        self.failed_label.setText("\n".join(lines))
        self.failed_label.setVisible(bool(lines))
        self._fill_facts(run)
        self._fill_figures()
        self._say_buttons()

    def changeEvent(self, event: QEvent) -> None:
        """Hear of a new language."""
        if event.type() == QEvent.Type.LanguageChange:
            self.retranslate()
        super().changeEvent(event)

    def _make_buttons(self) -> None:
        self.result_button, self.log_button, self.folder_button = QPushButton(), QPushButton(), QPushButton()
        self.resume_button, self.close_button = QPushButton(), QPushButton()
        for button, name, signal in (
            (self.result_button, "history_result_button", self.result_wanted),
            (self.log_button, "history_log_button", self.log_wanted),
            (self.folder_button, "history_folder_button", self.folder_wanted),
            (self.resume_button, "history_resume_button", self.resume_wanted),
            (self.close_button, "history_close_button", self.close_wanted),
        ):
            button.setObjectName(name)
            button.clicked.connect(signal)

    def _lay_out(self) -> None:
        head = QHBoxLayout()
        head.addWidget(self._serial, 1)
        head.addWidget(self.badge)
        inner = QWidget()
        words = QVBoxLayout(inner)
        words.setContentsMargins(0, 0, theme.GRID, 0)
        words.setSpacing(2 * theme.GRID)
        words.addWidget(self.reason_label)
        words.addWidget(self.failed_label)
        words.addLayout(self._figures)
        words.addLayout(self._facts)
        words.addStretch(1)
        scroll = QScrollArea()
        scroll.setWidget(inner)
        scroll.setWidgetResizable(True)
        scroll.setFrameShape(QFrame.Shape.NoFrame)
        scroll.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        scroll.viewport().setAutoFillBackground(False)
        inner.setAutoFillBackground(False)
        unfinished, buttons = QHBoxLayout(), QHBoxLayout()
        for row, of_row in (
            (unfinished, (self.resume_button, self.close_button)),
            (buttons, (self.result_button, self.log_button, self.folder_button)),
        ):
            row.setSpacing(theme.GRID)
            for button in of_row:
                row.addWidget(button, 1)
        box = QVBoxLayout(self)
        box.setContentsMargins(2 * theme.GRID, 2 * theme.GRID, 2 * theme.GRID, 2 * theme.GRID)
        box.setSpacing(theme.GRID)
        box.addLayout(head)
        box.addWidget(scroll, 5)
        box.addWidget(self.trend, 3)
        box.addLayout(unfinished)
        box.addLayout(buttons)

    def _reason(self, run: RunRecord) -> str:
        if run.outcome == "fault" and run.error:
            words = free_text(run.error)
            return "\n".join(text for text in (words.reason, words.remedy) if text)
        if run.outcome in ("passed", "failed") and self._result is not None:
            if self._result.failed_checks:
                return self.tr("Outside its limits:")
            return advice.reason(self._result.outcome, self._result)
        said = {
            "stopped": self._stopped(run.error),
            "incomplete": self.tr("The run did not reach its end."),
        }.get(run.outcome, "")
        if self._standing[2]:
            said += "\n" + self.tr("It can be resumed behind its last finished stage, or closed.")
        elif run.closed:
            said += "\n" + self.tr("It was closed and is not to be resumed.")
        return said

    def _stopped(self, by: str | None) -> str:
        if by in (None, "", "operator"):
            return self.tr("The run was stopped by the operator.")
        return event_sentence("stopped_because", {"reason": by})

    def _fill_facts(self, run: RunRecord) -> None:
        _empty(self._facts)
        software = self._result.software.version if self._result is not None and self._result.software else ""
        facts = (
            (self.tr("Started"), local_time(run.started_utc)),
            (self.tr("Duration"), duration_text(run.duration)),
            (self.tr("Product"), run.product or ""),
            (self.tr("Attempt"), str(run.attempt)),
            (self.tr("Station"), run.station or ""),
            (self.tr("Operator"), run.operator or ""),
            (self.tr("Software"), software),
        )
        for k, (head, text) in enumerate(fact for fact in facts if fact[1]):
            row, column = divmod(k, 2)
            self._facts.addWidget(_muted(head), row, 2 * column)
            self._facts.addWidget(QLabel(text), row, 2 * column + 1)
        self._facts.setColumnStretch(1, 1)
        self._facts.setColumnStretch(3, 1)
        resumed = ElidedLabel()
        resumed.setText(run.resumed_from or "")
        resumed.setToolTip(run.resumed_from or "")
        stages = QLabel(stages_text(run))
        stages.setWordWrap(True)
        long = ((self.tr("Resumed from"), resumed), (self.tr("Stages"), stages))
        for row, (head, label) in enumerate(long, start=9):
            if label.text():
                self._facts.addWidget(_muted(head), row, 0, Qt.AlignmentFlag.AlignTop)
                self._facts.addWidget(label, row, 1, 1, 3)

    def _fill_figures(self) -> None:
        """The value of each group that is nearest to its limit."""
        _empty(self._figures)
        rows = [] if self._result is None else advice.figures(self._result)
        if not rows:
            return
        for column, text in enumerate(("", self.tr("value"), "±σ", self.tr("limit"), self.tr("unit"))):
            self._figures.addWidget(_muted(text, column in (1, 2, 3)), 0, column)
        values, sigmas = aligned([row.value for row in rows]), aligned([row.sigma for row in rows])
        for k, (row, value, sigma) in enumerate(zip(rows, values, sigmas, strict=True), start=1):
            cells = (row.name if row.passed else f"✕ {row.name}", value, sigma, row.limit, row.unit)
            for column, text in enumerate(cells):
                label = QLabel(text)
                if column in (1, 2, 3):
                    label.setAlignment(Qt.AlignmentFlag.AlignRight)
                self._figures.addWidget(label, k, column)
        self._figures.setColumnStretch(0, 1)

    def _say_buttons(self) -> None:
        run = self._run
        if run is None:
            return
        self.result_button.setText(self.tr("Result"))
        self.log_button.setText(self.tr("Log"))
        self.folder_button.setText(self.tr("Folder"))
        self.resume_button.setText(self.tr("Resume"))
        running, closing, resumable = self._standing
        incomplete = run.outcome == "incomplete"
        self.close_button.setText(self.tr("Close as incomplete") if incomplete else self.tr("Do not resume"))
        self.resume_button.setVisible(resumable)
        self.close_button.setVisible(resumable or (incomplete and not run.closed))
        solved = self._result is not None and bool(self._result.parameters)
        _enable(
            self.result_button,
            "" if solved else self.tr("No parameter was solved in this run"),
            self.tr("Show every parameter of this run"),
        )
        _enable(
            self.log_button,
            "" if run.log.exists() else self.tr("The log is no longer there"),
            self.tr("Draw the log and solve it again"),
        )
        self.folder_button.setToolTip(str(run.log.parent))
        busy = self.tr("A run is going on; wait for its end") if running else ""
        _enable(self.resume_button, busy, self.tr("Go on behind the last finished stage"))
        _enable(
            self.close_button,
            busy or (self.tr("It is being closed") if closing else ""),
            self.tr("The run keeps its outcome and can then no longer be resumed"),
        )


def _enable(button: QPushButton, why_not: str, tip: str) -> None:
    button.setEnabled(not why_not)
    button.setToolTip(why_not or tip)


def _muted(text: str, right: bool = False) -> QLabel:
    label = QLabel(text)
    label.setProperty("kind", "muted")
    if right:
        label.setAlignment(Qt.AlignmentFlag.AlignRight)
    return label


def _empty(grid: QGridLayout) -> None:
    while (item := grid.takeAt(0)) is not None:
        widget = item.widget()
        if widget is not None:
            widget.setParent(None)
            widget.deleteLater()
