"""The preview: what the chosen stages would do and reach, before anything moves."""

import numpy as np
from PySide6.QtCore import QEvent, Qt, Signal
from PySide6.QtWidgets import (
    QHBoxLayout,
    QLabel,
    QPushButton,
    QSplitter,
    QStackedWidget,
    QVBoxLayout,
    QWidget,
)

from calstation.errors import CalstationError
from calstation.gui.engineer import forecast_table
from calstation.gui.engineer.error_wording import one_line
from calstation.gui.engineer.motion_plot import MotionPlot
from calstation.gui.text.messages import duration_text, show, step_sentence, term
from calstation.gui.widgets import theme
from calstation.gui.widgets.badge import StateBadge
from calstation.gui.widgets.jobs import JobRow, JobWatch
from calstation.gui.widgets.labels import EmptyState
from calstation.gui.widgets.parameter_table import ParameterModel, ParameterTable
from calstation.results.preview import Preview, Violation

#: Height of a line of a table with all parameters, px.
_ROW = 26


class PreviewView(QWidget):
    """Motion, time, limits and expected sigmas; `wanted` when the user asks for a preview."""

    wanted = Signal()

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.forecast: Preview | None = None
        self._stale = False
        self._error: CalstationError | None = None
        self.watch = JobWatch(self)
        self._row = JobRow(self.watch)
        self._row.setVisible(False)
        self._empty = EmptyState()
        self.preview_button = QPushButton()
        self.preview_button.setObjectName("preview_button")
        self.preview_button.clicked.connect(self.wanted)
        self._badge = StateBadge()
        self._summary, self._broken = QLabel(), QLabel()
        self._summary.setObjectName("preview_summary")
        self._broken.setObjectName("preview_violations")
        self._broken.setWordWrap(True)
        self._broken.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        theme.set_kind(self._broken, "error")
        self.plot = MotionPlot()
        self.model = ParameterModel(())
        self.table = ParameterTable(self.model)
        self.table.setObjectName("preview_table")
        self._lay_out()
        self.watch.done.connect(self._done)
        self.watch.failed.connect(self._failed)
        self.watch.cancelled.connect(self._ended)
        self.retranslate()

    def _lay_out(self) -> None:
        head = QHBoxLayout()
        head.setSpacing(2 * theme.GRID)
        head.addWidget(self._badge)
        head.addWidget(self._summary, 1)
        head.addWidget(self._row, 1)
        head.addWidget(self.preview_button)
        split = QSplitter(Qt.Orientation.Vertical)
        split.setChildrenCollapsible(False)
        split.addWidget(self.plot)
        split.addWidget(self.table)
        split.setStretchFactor(0, 2)
        split.setStretchFactor(1, 3)
        split.setSizes([26 * theme.GRID, 36 * theme.GRID])
        self.plot.setMinimumHeight(22 * theme.GRID)
        self.table.verticalHeader().setDefaultSectionSize(_ROW)
        self._stack = QStackedWidget()
        self._stack.addWidget(self._empty)
        self._stack.addWidget(split)
        column = QVBoxLayout(self)
        column.setContentsMargins(0, theme.GRID, 0, 0)
        column.setSpacing(theme.GRID)
        column.addLayout(head)
        column.addWidget(self._broken)
        column.addWidget(self._stack, 1)

    def outdate(self) -> None:
        """What was chosen has changed since this preview."""
        self._stale = self.forecast is not None
        self._say()

    def begin(self) -> None:
        """A preview is being made."""
        self._error = None
        self._row.setVisible(True)
        self._say()

    def set_why_not(self, why: str) -> None:
        """Whether a preview can be asked for, and why not."""
        self.preview_button.setEnabled(not why)
        self.preview_button.setToolTip(why)

    def retranslate(self) -> None:
        """Say everything again in the language in force."""
        self.preview_button.setText(self.tr("Preview"))
        self._empty.say(
            self.tr("Nothing moves for a preview"),
            self.tr(
                "Choose what to calibrate on the left and press Preview: it shows both axes' angles against time, "
                "the total time, whether the table can do it, and the sigma to expect of every parameter."
            ),
        )
        self.model.refresh()
        self._say()

    def changeEvent(self, event: QEvent) -> None:
        """Hear of a new language."""
        if event.type() == QEvent.Type.LanguageChange:
            self.retranslate()
        super().changeEvent(event)

    def _done(self, forecast: Preview) -> None:
        self.forecast, self._stale = forecast, False
        self.plot.show_forecast(forecast)
        self.model.set_names(())
        self.model.set_columns(forecast_table.columns(forecast))
        self.model.set_names(forecast_table.names(forecast))
        self.table.setVisible(not forecast.violations)
        self._stack.setCurrentIndex(1)
        self._ended()

    def _failed(self, error: CalstationError) -> None:
        self._error = error
        self._ended()

    def _ended(self) -> None:
        self._row.setVisible(False)
        self._say()

    def _say(self) -> None:
        forecast = self.forecast
        busy = self.watch.busy
        self.preview_button.setVisible(not busy)
        self._summary.setVisible(not busy)
        self._badge.setVisible(not busy and forecast is not None and not self._error)
        lines: list[str] = [one_line(self._error)] if self._error else []
        if forecast is None:
            self._summary.setText("")
        else:
            moves = sum(stage.moves for stage in forecast.stages)
            said = self.tr("{0} in all, {1} moves").format(duration_text(forecast.duration), moves)
            if self._stale:
                said = self.tr("{0}; the choice has changed since, preview again").format(said)
            self._summary.setText(said)
            self._judge(forecast)
            if not self._stale:
                lines += [self._word(violation) for violation in forecast.violations]
                lines += [f"{term('stage', s.stage)}: {show(s.error)}" for s in forecast.stages if s.error]
                lines += [
                    self.tr("{0}: {1} rounds do not reach its targets; give it rounds or a duration.").format(
                        term("stage", s.stage), s.rounds
                    )
                    for s in forecast.stages
                    if s.reason == "" and not forecast.violations
                ]
        self._broken.setText("\n".join(lines))
        self._broken.setVisible(bool(lines) and not busy)

    def _judge(self, forecast: Preview) -> None:
        if self._stale:
            self._badge.show_state("waiting", self.tr("out of date"))
        elif forecast.violations:
            self._badge.show_state("bad", self.tr("beyond the table's limits"))
        else:
            missed = [
                name
                for name in forecast_table.names(forecast)
                if forecast_table.reached(forecast, name) is False
            ]
            if any(stage.sigma is None for stage in forecast.stages):
                self._badge.show_state("bad", self.tr("cannot be solved"))
            elif missed:
                self._badge.show_state(
                    "caution",
                    self.tr("within the table's limits, {0} sigma limits missed").format(len(missed)),
                )
            else:
                self._badge.show_state(
                    "good", self.tr("within the table's limits, every sigma limit reached")
                )

    def _word(self, broken: Violation) -> str:
        """A broken limit with its step and the mend."""
        stage = term("stage", broken.stage)
        if broken.kind == "plan":
            return f"{stage}: {show(broken.text)}"
        where = self.tr("{0}, move {1} ({2})").format(stage, broken.step, step_sentence("move", broken.label))
        if broken.more:
            where = self.tr("{0} and {1} more").format(where, broken.more)
        value, low, high = (float(v) for v in np.rad2deg([broken.value, broken.low, broken.high]))
        if broken.kind == "rate":
            said = self.tr("rate {0:g} °/s, the table does {1:g} °/s at most; lower the rate")
            return f"{where}: {said.format(value, round(high, 6))}"
        if broken.kind == "acceleration":
            said = self.tr(
                "acceleration {0:g} °/s², the table does {1:g} °/s² at most; lower the acceleration"
            )
            return f"{where}: {said.format(value, round(high, 6))}"
        joint = self.tr("outer axis") if broken.joint == "outer" else self.tr("inner axis")
        said = self.tr("{0} to {1:.1f}°, its travel is {2:.0f}° to {3:.0f}°; choose fewer turns or rounds")
        return f"{where}: {said.format(joint, value, low, high)}"
