"""The verdict of a run: one large word with its shape, the reason, what to do next, and the values that matter."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from PySide6.QtCore import QEvent, QRectF, Qt, Signal
from PySide6.QtGui import QColor, QPainter, QPaintEvent, QResizeEvent
from PySide6.QtWidgets import (
    QFrame,
    QGridLayout,
    QHBoxLayout,
    QLabel,
    QWidget,
)

from calstation.config import load_station
from calstation.connection import LinkTestRequest
from calstation.gui.operator import advice
from calstation.gui.shell import AppContext, ResetBar, RunStatus
from calstation.gui.text import KINDS, duration_text, event_sentence, fault_text, on_language_change, term
from calstation.gui.widgets import StateIcon, button, column, draw_state, label, row, state_colour, theme
from calstation.results import Result
from calstation.sequencer import Fault, Verdict

#: Least height of the head, px.
_HEAD = 12 * theme.GRID

#: Most height of a row of figures, px.
_ROW = 4 * theme.GRID

#: Height of the shape in the head, as a fraction of the head.
_SHAPE = 0.6


class _Head(QWidget):
    """The word and its shape on the colour of the state."""

    def __init__(self) -> None:
        super().__init__()
        self._kind = "none"
        self.word = QLabel()
        self.word.setObjectName("verdict_label")
        self.word.setFont(theme.font(theme.VERDICT, bold=True))
        layout = QHBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.addWidget(self.word)
        self.setMinimumHeight(_HEAD)

    def show_state(self, state: str) -> None:
        """Show the word of a state."""
        self._kind = KINDS.get(state, "none")
        self.word.setText(term("badge", state) if state else "")
        self.set_colours()

    def set_colours(self) -> None:
        """Take the colours of the theme."""
        self.word.setStyleSheet(f"color: {theme.colours().on_state};")
        self.update()

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Make the word as large as there is room."""
        super().resizeEvent(event)
        size = min(0.55 * self.height(), self.width() / 9.0)
        self.word.setFont(theme.font(max(theme.VERDICT, round(size)), bold=True))
        self.word.setContentsMargins(round(self.height()), 0, 0, 0)

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw background and shape."""
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(state_colour(self._kind))
        painter.drawRoundedRect(QRectF(self.rect()), 4.0, 4.0)
        side = _SHAPE * self.height()
        margin = (self.height() - side) / 2.0
        box = QRectF(margin, margin, side, side)
        draw_state(painter, self._kind, box, QColor(theme.colours().on_state))


class VerdictPanel(QFrame):
    """Takes the place of the plots when a run has ended.

    `details_wanted(path)` : with the result file; `acknowledged()` : clears a fault; `station_wanted()` : open the
    station page.
    """

    details_wanted = Signal(object)
    acknowledged = Signal()
    station_wanted = Signal()

    def __init__(self, app: AppContext) -> None:
        super().__init__()
        self._app = app
        self.setProperty("kind", "panel")
        self._state = ""
        self._verdict: Verdict | None = None
        self._result: Result | None = None
        self._fault: Fault | None = None
        self._remarks: tuple[tuple[str, Mapping[str, Any]], ...] = ()
        self._head = _Head()
        self._source, self._facts = label(kind="muted", wrap=True), label(kind="muted", wrap=True)
        self.reason_label, self.action_label = label(wrap=True), label(wrap=True)
        self._notes = label(wrap=True)
        self.reset = ResetBar(app, self._order, "verdict_reset_button")
        self.details_button = button("details_button", lambda: self.tr("Details"), self._details)
        self.acknowledge_button = button(
            "acknowledge_button", lambda: self.tr("Understood"), self.acknowledged, kind="primary"
        )
        self._station_button = button(
            "verdict_station_button", lambda: self.tr("Open the station page"), self.station_wanted
        )
        self._figures_box = QWidget()
        self._figures = QGridLayout(self._figures_box)
        self._build()
        on_language_change(self, self._refresh)

    def _build(self) -> None:
        self.reason_label.setFont(theme.font(theme.SECTION))
        self.action_label.setFont(theme.font(theme.SECTION, bold=True))
        left = column(
            *(self._source, self.reason_label, self.action_label, self.reset, self._facts, self._notes),
            None,
            row(self.acknowledge_button, self.details_button, self._station_button, None),
        )
        self._figures.setContentsMargins(0, 0, 0, 0)
        self._figures.setHorizontalSpacing(2 * theme.GRID)
        self._figures.setVerticalSpacing(theme.GRID // 4)
        right = column((self._figures_box, 1), None)
        column(
            (self._head, 2),
            (row((left, 1), right, spacing=3 * theme.GRID), 3),
            on=self,
            spacing=2 * theme.GRID,
            margins=(2 * theme.GRID,) * 4,
        )

    def show_end(self, run: RunStatus) -> None:
        """Show how a run ended."""
        if run.fault is not self._fault:
            self.reset.forget()
            self.reset.offer(run.fault is not None and fault_text(run.fault).resettable)
        if run.verdict is not self._verdict:
            self._result = None if run.verdict is None else Result.from_json(run.verdict.result)
        self._state, self._verdict, self._fault = run.state, run.verdict, run.fault
        self._remarks = tuple(run.remarks)
        self._refresh()

    def next_action(self) -> str:
        """What to do now, in the current language."""
        if self._fault is not None:
            return fault_text(self._fault).remedy
        return advice.next_action(self._state, self._result)

    def changeEvent(self, event: QEvent) -> None:
        """Follow the theme."""
        if event.type() == QEvent.Type.PaletteChange:
            self._head.set_colours()
        super().changeEvent(event)

    def _refresh(self) -> None:
        fault = self._fault
        self._head.show_state(self._state)
        self._source.setVisible(False)
        self.acknowledge_button.setVisible(fault is not None)
        self.details_button.setVisible(self._verdict is not None)
        self._station_button.setVisible(False)
        if fault is not None:
            text = fault_text(fault)
            self._source.setText(self.tr("Where: {place}").format(place=text.where))
            self._source.setVisible(bool(text.where))
            self.reason_label.setText(text.reason)
            self._station_button.setVisible(text.source == "configuration")
        else:
            self.reason_label.setText(advice.reason(self._state, self._result))
        self.action_label.setText(self.next_action())
        self.action_label.setVisible(bool(self.action_label.text()))
        self._notes.setText("\n".join(dict.fromkeys(event_sentence(*remark) for remark in self._remarks)))
        self._notes.setVisible(bool(self._remarks))
        self._facts.setText("  ·  ".join(self._fact_texts()))
        self._facts.setVisible(self._result is not None)
        self._fill_figures()

    def _order(self) -> LinkTestRequest | None:
        """The table of the last run. Raises ConfigurationError if its file cannot be read any more."""
        request = self._app.engine_link.request
        return None if request is None else LinkTestRequest(load_station(request.station)[1], request.product)

    def _fact_texts(self) -> list[str]:
        result = self._result
        if result is None:
            return []
        facts = [
            result.serial,
            self.tr("attempt {count}").format(count=result.attempt),
            self.tr("{time} of table time").format(time=duration_text(result.duration_s)),
        ]
        if result.registers is not None and result.registers.verified:
            facts.append(
                self.tr("registers written and read back, effect not verified")
                if result.registers.proved_on == "read_back"
                else self.tr("registers written and verified")
            )
        return facts

    def _fill_figures(self) -> None:
        while (item := self._figures.takeAt(0)) is not None:
            widget = item.widget()
            if widget is not None:
                widget.deleteLater()
        figures = advice.figures(self._result) if self._result is not None and self._fault is None else []
        if not figures:
            return
        headings = (
            self.tr("nearest to its limit"),
            self.tr("value"),
            self.tr("sigma"),
            self.tr("limit"),
            self.tr("unit"),
        )
        for at, heading in enumerate(headings, start=1):
            self._cell(0, at, heading, muted=True)
        for number, figure in enumerate(figures, start=1):
            icon = StateIcon(18)
            icon.set_kind("bad" if not figure.passed else "caution" if figure.near else "good")
            self._figures.addWidget(icon, number, 0)
            decisive = 3 if figure.by_sigma else 2
            cells = (figure.name, figure.value, figure.sigma, figure.limit, figure.unit)
            for at, text in enumerate(cells, start=1):
                self._cell(number, at, text, bold=at == decisive)
        self._figures_box.setMaximumHeight(_ROW * (len(figures) + 1))

    def _cell(self, row_number: int, column_number: int, text: str, *, muted: bool = False, bold: bool = False) -> None:
        cell = label(kind="muted" if muted else "")
        cell.setText(text)
        if not muted:
            cell.setFont(theme.font(theme.SECTION, bold=bold))
        side = Qt.AlignmentFlag.AlignRight if column_number in (2, 3, 4) else Qt.AlignmentFlag.AlignLeft
        self._figures.addWidget(cell, row_number, column_number, side | Qt.AlignmentFlag.AlignVCenter)

    def _details(self) -> None:
        if self._verdict is not None:
            self.details_wanted.emit(Path(self._verdict.result_file))
