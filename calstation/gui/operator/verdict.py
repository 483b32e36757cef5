"""The verdict of a run: a large banner, the reason, the next action, and the decisive values."""

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from PySide6.QtCore import QRectF, Qt, Signal
from PySide6.QtGui import QColor, QFontMetricsF, QPaintEvent, QResizeEvent
from PySide6.QtWidgets import QBoxLayout, QFrame, QLabel, QWidget

from calstation.config import load_station
from calstation.connection import LinkTestRequest
from calstation.errors import InputError
from calstation.gui.operator import advice
from calstation.gui.operator.production import CertificateButton, LabelButton
from calstation.gui.shell import AppContext, ResetBar
from calstation.gui.text import KINDS, duration_text, event_sentence, fault_text, say, term
from calstation.gui.widgets import (
    NoticeBar,
    StateIcon,
    button,
    clear,
    column,
    draw_state,
    grid,
    label,
    row,
    show_text,
    state_colour,
    theme,
)
from calstation.physics import aligned
from calstation.results import Result, load_result
from calstation.sequencer import Fault, Verdict

#: Margin at the right end of the banner, px, and smallest gap between its texts, in units of their size.
_BANNER_MARGIN, _GAP = 3 * theme.GRID, 0.4


def _width(text: str) -> float:
    """Return the width of a bold text, in units of its size."""
    return QFontMetricsF(theme.font(theme.VERDICT, bold=True)).horizontalAdvance(text) / theme.VERDICT


class _Banner(QWidget):
    """Banner with the verdict, its shape, and the unit, on a background in the colour of the state."""

    def __init__(self) -> None:
        super().__init__()
        self._kind = "none"
        self.word, self.serial = label(name="verdict_label"), label(name="verdict_serial_label")
        self._texts = QBoxLayout(QBoxLayout.Direction.LeftToRight, self)
        self._texts.setSpacing(0)
        for stretch, shown in ((1, self.word), (0, self.serial)):
            self._texts.addWidget(shown, stretch)
        for shown in (self.word, self.serial):
            shown.setMinimumWidth(1)  # the text is fitted to the banner, not the banner to the text
        self.setMinimumHeight(17 * theme.GRID)

    def show_state(self, state: str, serial: str) -> None:
        """Show the text of a state and the unit that it applies to, in the colours of the theme."""
        self._kind = KINDS.get(state, "none")
        for shown, text in ((self.word, term("badge", state)), (self.serial, serial)):
            shown.setText(text)
            shown.setStyleSheet(f"color: {theme.colours().on_state};")
        self._fit()
        self.update()

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Fit the texts to the banner."""
        super().resizeEvent(event)
        self._fit()

    def _fit(self) -> None:
        """Show both texts in one size, the unit below the verdict if they do not fit on one line in that size."""
        room = self.width() - self.height() - _BANNER_MARGIN
        word, serial = (_width(shown.text()) for shown in (self.word, self.serial))
        size = min(0.55 * self.height(), room / (word + serial + _GAP))
        below = size < theme.VERDICT
        if below:
            size = min(0.42 * self.height(), room / word)
        self._texts.setDirection(QBoxLayout.Direction.TopToBottom if below else QBoxLayout.Direction.LeftToRight)
        self._texts.setContentsMargins(self.height(), 0, _BANNER_MARGIN, 0)
        self.word.setFont(theme.font(int(size), bold=True))
        self.serial.setFont(theme.font(int(min(size, room / max(serial, 1.0))), bold=True))

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw the background and the shape."""
        painter = theme.painter(self)
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(state_colour(self._kind))
        painter.drawRoundedRect(QRectF(self.rect()), 4.0, 4.0)
        side = 0.6 * self.height()
        margin = (self.height() - side) / 2.0
        draw_state(painter, self._kind, QRectF(margin, margin, side, side), QColor(theme.colours().on_state))


class FiguresTable(QWidget):
    """Table with one row per parameter group and per check of the product, with the decisive number in bold.

    With `wrap`, long names take several lines, for a narrow place.
    """

    def __init__(self, size: int = theme.BODY, *, wrap: bool = False) -> None:
        super().__init__()
        self._size, self._wrap = size, wrap
        self._grid = grid(self, across=2 * theme.GRID, down=theme.GRID // 4, stretch=1 if wrap else None)

    def show_result(self, result: Result | None) -> None:
        """Show the figures of a result; None clears the table."""
        clear(self._grid)
        figures = [] if result is None else advice.figures(result)
        if not figures:
            return
        columns = self.tr("value"), self.tr("sigma"), self.tr("limit"), self.tr("unit")
        values, sigmas = aligned([figure.value for figure in figures]), aligned([figure.sigma for figure in figures])
        number, passing = 0, None
        for figure, value, sigma in zip(figures, values, sigmas, strict=True):
            if figure.passed is not passing:
                title = self.tr("nearest to its limit") if figure.passed else self.tr("outside its limit")
                for at, text in enumerate((title, *(columns if passing is None else ())), start=1):
                    heading = label(kind="muted")
                    heading.setText(text)
                    self._place(heading, number, at)
                number, passing = number + 1, figure.passed
            icon = StateIcon(self._size)
            icon.set_kind("bad" if not figure.passed else "caution" if figure.near else "good")
            self._grid.addWidget(icon, number, 0)
            deciding = 3 if figure.by_sigma else 2
            for at, text in enumerate((figure.name, value, sigma, figure.limit, figure.unit), start=1):
                cell = QLabel(text)
                cell.setFont(theme.font(self._size, bold=at == deciding))
                cell.setWordWrap(self._wrap and at == 1)
                self._place(cell, number, at)
            number += 1

    def _place(self, cell: QLabel, row: int, column: int) -> None:
        side = Qt.AlignmentFlag.AlignRight if column in (2, 3, 4) else Qt.AlignmentFlag.AlignLeft
        cell.setAlignment(side | Qt.AlignmentFlag.AlignVCenter)
        self._grid.addWidget(cell, row, column)


class VerdictPanel(QFrame):
    """Replaces the plots when a run has ended; `acknowledged()` : the operator has acknowledged the fault.

    `notice` shows whether a label was printed, and `then` is called afterwards.
    """

    acknowledged = Signal()

    def __init__(self, app: AppContext, notice: NoticeBar, then: Callable[[], None]) -> None:
        super().__init__()
        self._app = app
        self.setProperty("kind", "panel")
        self._run = app.run
        self._verdict: Verdict | None = None
        self._result: Result | None = None
        self._fault: Fault | None = None
        self._banner, self._figures = _Banner(), FiguresTable(theme.SECTION)
        self._source, self._facts = label(kind="muted", wrap=True), label(kind="muted", wrap=True)
        self.reason_label, self.action_label, self._notes = label(wrap=True), label(wrap=True), label(wrap=True)
        self.reason_label.setFont(theme.font(theme.SECTION))
        self.action_label.setFont(theme.font(theme.SECTION, bold=True))
        self.reset = ResetBar(app, self._table, "verdict_reset_button")
        self.details_button = button("details_button", lambda: self.tr("Details"), self._show_details)
        self.acknowledge_button = button(
            "acknowledge_button", lambda: self.tr("Understood"), self.acknowledged, kind="primary"
        )
        self.label_button = LabelButton(app, "label_button", notice, then)
        self.certificate_button = CertificateButton(app, "certificate_button", notice, then)
        self._station_button = button(
            "verdict_station_button",
            lambda: self.tr("Open the station page"),
            lambda: app.page_wanted.emit("station_page"),
        )
        beside = column(
            *(self._facts, self._notes),
            None,
            row(
                self.acknowledge_button,
                self.label_button,
                self.certificate_button,
                self.details_button,
                self._station_button,
                None,
            ),
        )
        people, values = self.certificate_button.panel, QWidget()
        row(column(self._figures, None), (beside, 1), on=values, spacing=3 * theme.GRID)
        people.asking.connect(lambda asking: values.setVisible(not asking))  # both do not fit on a small screen
        column(
            (self._banner, 2),
            *(self._source, self.reason_label, self.action_label, self.reset),
            (values, 3),
            (column(people, None), 3),
            on=self,
            spacing=theme.GRID,
            margins=(2 * theme.GRID,) * 4,
        )
        app.released.connect(self._released)
        theme.on_appearance_change(self, self._refresh)

    def show_end(self) -> None:
        """Show how the run ended."""
        run = self._run
        if run.fault is not self._fault:
            self._fault = run.fault
            self.reset.forget()
            self.reset.offer(run.fault is not None and fault_text(run.fault).resettable)
        if run.verdict is not self._verdict:
            self._verdict = run.verdict
            self._result = None if run.verdict is None else Result.from_json(run.verdict.result)
            file = None if run.verdict is None else Path(run.verdict.result_file)
            for each in (self.label_button, self.certificate_button):
                each.offer(self._result, file)
        self._refresh()

    def next_action(self) -> str:
        """Return the next action for the operator, in the current language."""
        fault = self._run.fault
        if self._result is not None and self._result.released:
            return say("advice.released")
        return advice.next_action(self._run.shown, self._result) if fault is None else fault_text(fault).remedy

    def _refresh(self) -> None:
        text = None if self._run.fault is None else fault_text(self._run.fault)
        released = self._run.shown == "failed" and self._result is not None and self._result.released
        self._banner.show_state("released" if released else self._run.shown, self._run.serial)
        self.acknowledge_button.setVisible(text is not None)
        self.details_button.setVisible(self._verdict is not None)
        self._station_button.setVisible(text is not None and text.source == "configuration")
        reason = advice.reason(self._run.shown, self._result, self._stopped_entry()) if text is None else text.reason
        self.reason_label.setText(reason)
        notes = dict.fromkeys(event_sentence(*remark) for remark in self._run.remarks)
        for shown, content in (
            (self._source, self.tr("Where: {place}").format(place=text.where) if text and text.where else ""),
            (self.action_label, self.next_action()),
            (self._notes, "\n".join([*advice.override_notes(self._result), *notes])),
            (self._facts, "  ·  ".join(self._fact_texts())),
        ):
            show_text(shown, content)
        self._figures.show_result(self._result if text is None else None)

    def _released(self, path: Path) -> None:
        """Show that the unit was released, if this is its run."""
        if self._verdict is not None and path.absolute() == Path(self._verdict.result_file).absolute():
            with suppress(InputError):
                self._result = load_result(path)
            self._refresh()

    def _table(self) -> LinkTestRequest | None:
        """Return the request for the table of the last run. Raises ConfigurationError if its file cannot be read."""
        request = self._app.engine_link.request
        return None if request is None else LinkTestRequest(load_station(request.station)[1], request.product)

    def _stopped_entry(self) -> str:
        """Return the entry of the catalogue that states what a stopped run has left behind."""
        if not self._run.commanded:
            return "stopped_connecting"
        return "stopped_manual" if self._run.by_hand else "stopped"

    def _fact_texts(self) -> list[str]:
        result = self._result
        if result is None:
            return []
        facts = [
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

    def _show_details(self) -> None:
        if self._verdict is not None:
            self._app.open_run.emit(Path(self._verdict.result_file))
