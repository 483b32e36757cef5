"""The verdict: one word that fills the eye, its shape, the reason, what to do next, and the numbers that matter."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from PySide6.QtCore import QEvent, QRectF, Qt, Signal
from PySide6.QtGui import QColor, QPainter, QPaintEvent, QResizeEvent
from PySide6.QtWidgets import (
    QFrame,
    QGridLayout,
    QHBoxLayout,
    QLabel,
    QPushButton,
    QVBoxLayout,
    QWidget,
)

from calstation.config.station import load_station
from calstation.connection.link_test import LinkTestRequest
from calstation.gui.operator import advice
from calstation.gui.shell.context import AppContext
from calstation.gui.shell.reset_bar import ResetBar
from calstation.gui.text.messages import KINDS, duration_text, event_sentence, fault_text, term
from calstation.gui.widgets import theme
from calstation.gui.widgets.badge import StateIcon, draw_state, state_colour
from calstation.sequencer.events import Fault, Verdict

#: Least height of the block that holds the word, px.
_HEAD = 12 * theme.GRID

#: Most height of a row of figures, px; they move together where room is scarce.
_ROW = 4 * theme.GRID

#: Height of the shape beside the word, in that of the block; the word is a little smaller.
_SHAPE = 0.6


class _Head(QWidget):
    """The word and its shape on the state's colour."""

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
        self.dress()

    def dress(self) -> None:
        """Take the theme's colours."""
        self.word.setStyleSheet(f"color: {theme.colours().on_state};")
        self.update()

    def resizeEvent(self, event: QResizeEvent) -> None:
        """The word is as large as the room allows, and never smaller than a verdict."""
        super().resizeEvent(event)
        size = min(0.55 * self.height(), self.width() / 9.0)
        self.word.setFont(theme.font(max(theme.VERDICT, round(size)), bold=True))
        self.word.setContentsMargins(round(self.height()), 0, 0, 0)

    def paintEvent(self, event: QPaintEvent) -> None:
        """Fill and shape."""
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

    `details_wanted(path)` carries the result's file; `acknowledged()` unlatches a fault.
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
        self._fault: Fault | None = None
        self._remarks: tuple[tuple[str, Mapping[str, Any]], ...] = ()
        self._head = _Head()
        self.verdict_label = self._head.word
        self._place, self.reason_label, self.action_label = QLabel(), QLabel(), QLabel()
        self._facts, self._notes = QLabel(), QLabel()
        self.reset = ResetBar(app, self._order, "verdict_reset_button")
        for label in (self._place, self.reason_label, self.action_label, self._facts, self._notes):
            label.setWordWrap(True)
        self._place.setProperty("kind", "muted")
        self._facts.setProperty("kind", "muted")
        self.reason_label.setFont(theme.font(theme.SECTION))
        self.action_label.setFont(theme.font(theme.SECTION, bold=True))
        self.details_button, self.acknowledge_button, self._station_button = (
            QPushButton(),
            QPushButton(),
            QPushButton(),
        )
        self.details_button.setObjectName("details_button")
        self.acknowledge_button.setObjectName("acknowledge_button")
        self.acknowledge_button.setProperty("kind", "primary")
        self.details_button.clicked.connect(self._details)
        self.acknowledge_button.clicked.connect(self.acknowledged)
        self._station_button.clicked.connect(self.station_wanted)
        buttons = QHBoxLayout()
        for button in (self.acknowledge_button, self.details_button, self._station_button):
            buttons.addWidget(button)
        buttons.addStretch(1)
        words = QVBoxLayout()
        words.setSpacing(theme.GRID)
        labels = (self._place, self.reason_label, self.action_label, self.reset, self._facts, self._notes)
        for widget in labels:
            words.addWidget(widget)
        words.addStretch(1)
        words.addLayout(buttons)
        self._table = QWidget()
        self._figures = QGridLayout(self._table)
        self._figures.setContentsMargins(0, 0, 0, 0)
        self._figures.setHorizontalSpacing(2 * theme.GRID)
        self._figures.setVerticalSpacing(theme.GRID // 4)
        right = QVBoxLayout()
        right.addWidget(self._table, 1)
        right.addStretch()
        body = QHBoxLayout()
        body.setSpacing(3 * theme.GRID)
        body.addLayout(words, 1)
        body.addLayout(right)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(2 * theme.GRID, 2 * theme.GRID, 2 * theme.GRID, 2 * theme.GRID)
        layout.setSpacing(2 * theme.GRID)
        layout.addWidget(self._head, 2)
        layout.addLayout(body, 3)

    def show_end(
        self,
        state: str,
        verdict: Verdict | None,
        fault: Fault | None,
        remarks: Sequence[tuple[str, Mapping[str, Any]]],
    ) -> None:
        """Show how a run ended; `remarks` are messages that still matter."""
        if fault is not self._fault:
            self.reset.forget()
            self.reset.offer(fault is not None and fault_text(fault).resettable)
        self._state, self._verdict, self._fault, self._remarks = state, verdict, fault, tuple(remarks)
        self.retranslate()

    def next_action(self) -> str:
        """What to do now, in the language in force."""
        if self._fault is not None:
            return fault_text(self._fault).remedy
        result = self._verdict.result if self._verdict is not None else {}
        return advice.next_action(self._state, result)

    def retranslate(self) -> None:
        """Say everything again in the language in force."""
        self._head.show_state(self._state)
        fault = self._fault
        self._place.setVisible(fault is not None)
        self.acknowledge_button.setVisible(fault is not None)
        self.details_button.setVisible(self._verdict is not None)
        self._station_button.setVisible(False)
        self.acknowledge_button.setText(self.tr("Understood"))
        self.details_button.setText(self.tr("Details"))
        self._station_button.setText(self.tr("Open the station page"))
        if fault is not None:
            words = fault_text(fault)
            self._place.setText(self.tr("Where: {place}").format(place=words.place))
            self.reason_label.setText(words.reason)
            self._station_button.setVisible(words.source == "configuration")
        else:
            result = self._verdict.result if self._verdict is not None else {}
            self.reason_label.setText(advice.reason(self._state, result))
        self.action_label.setText(self.next_action())
        self.action_label.setVisible(bool(self.action_label.text()))
        self._notes.setText("\n".join(dict.fromkeys(event_sentence(*remark) for remark in self._remarks)))
        self._notes.setVisible(bool(self._remarks))
        self._say_facts()
        self._fill_figures()

    def changeEvent(self, event: QEvent) -> None:
        """Hear of a new language or theme."""
        if event.type() == QEvent.Type.LanguageChange:
            self.retranslate()
        elif event.type() == QEvent.Type.PaletteChange:
            self._head.dress()
        super().changeEvent(event)

    def _order(self) -> LinkTestRequest | None:
        """The table of the run that ended so. Raises ConfigurationError where its file cannot be read any more."""
        request = self._app.engine_link.request
        return None if request is None else LinkTestRequest(load_station(request.station)[1], request.product)

    def _say_facts(self) -> None:
        self._facts.setVisible(self._verdict is not None)
        if self._verdict is None:
            return
        result = self._verdict.result
        facts = [
            str(result["unit"]["serial"]),
            self.tr("attempt {count}").format(count=result["attempt"]),
            self.tr("{time} of table time").format(time=duration_text(result["duration_s"])),
        ]
        registers = result.get("registers")
        if registers and registers.get("verified"):
            facts.append(
                self.tr("registers written and read back, their effect not seen")
                if registers.get("proved_on") == "read_back"
                else self.tr("registers written and verified")
            )
        self._facts.setText("  ·  ".join(facts))

    def _fill_figures(self) -> None:
        while (item := self._figures.takeAt(0)) is not None:
            widget = item.widget()
            if widget is not None:
                widget.deleteLater()
        if self._verdict is None or self._fault is not None:
            return
        rows = advice.figures(self._verdict.result)
        if not rows:
            return
        headings = (
            "",
            self.tr("nearest to its limit"),
            self.tr("value"),
            self.tr("sigma"),
            self.tr("limit"),
            self.tr("unit"),
        )
        for column, heading in enumerate(headings):
            self._cell(0, column, heading, muted=True)
        for number, row in enumerate(rows, start=1):
            self._figures.addWidget(_mark(row), number, 0)
            meant = 3 if row.by_sigma else 2
            for column, text in enumerate((row.name, row.value, row.sigma, row.limit, row.unit), start=1):
                self._cell(number, column, text, bold=column == meant)
        self._table.setMaximumHeight(_ROW * (len(rows) + 1))

    def _cell(self, row: int, column: int, text: str, *, muted: bool = False, bold: bool = False) -> None:
        label = QLabel(text)
        if muted:
            label.setProperty("kind", "muted")
        else:
            label.setFont(theme.font(theme.SECTION, bold=bold))
        side = Qt.AlignmentFlag.AlignRight if column in (2, 3, 4) else Qt.AlignmentFlag.AlignLeft
        self._figures.addWidget(label, row, column, side | Qt.AlignmentFlag.AlignVCenter)

    def _details(self) -> None:
        if self._verdict is not None:
            self.details_wanted.emit(Path(self._verdict.result_file))


def _mark(row: advice.Figure) -> QWidget:
    icon = StateIcon(18)
    icon.set_kind("bad" if not row.passed else "caution" if row.near else "good")
    return icon
