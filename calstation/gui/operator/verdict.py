"""The verdict on a unit: a large banner, the reason, the next action and the decisive values."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QFontMetricsF, QResizeEvent
from PySide6.QtWidgets import QFrame, QLabel, QWidget

from calstation.config import load_station
from calstation.connection import LinkTestRequest
from calstation.errors import InputError
from calstation.gui.operator import advice
from calstation.gui.operator.production import CertificateButton, LabelButton, UnprintedNotice, label_void
from calstation.gui.operator.questions import sign_in_text
from calstation.gui.operator.units import Banner
from calstation.gui.state import AppContext, ResetBar, prevented_by
from calstation.gui.text import duration_text, fault_text, language, rendered, say
from calstation.gui.widgets import (
    NoticeBar,
    PlainLabel,
    ShrinkingText,
    StateIcon,
    button,
    clear,
    column,
    grid,
    label,
    lay_out,
    plain_tip,
    row,
    show_text,
    theme,
)
from calstation.messages import Rendered, entry, event_text, joined, known
from calstation.results import Result, load_run_result
from calstation.sequencer import Fault, Finalized

#: Share of the panel's height for the texts below the banner, distance of lines as a multiple of the text size, number
#: of lines besides the figures, width of the figures in text sizes, and maximum size, px.
_TEXT_SHARE, _LINE, _OTHER_LINES, _CHARACTERS, _MAX_TEXT = 0.6, 1.35, 2.75, 31, theme.VERDICT
#: Height that growing texts leave to the banner, vertical margins of the texts, and distance between columns, px.
_BANNER, _DISTANCES, _BETWEEN = 17 * theme.GRID, 8 * theme.GRID, 7 * theme.GRID
#: Minimum height of the banner, which shrinks in favour of the texts below a question on a small screen, px.
_MIN_BANNER = 9 * theme.GRID


class FiguresTable(QWidget):
    """Table of the values nearest to or outside their limits, with the decisive number in bold.

    `size` is the font size, px; long names are wrapped if `wrap` is True.
    """

    def __init__(self, size: int = theme.BODY, *, wrap: bool = False) -> None:
        super().__init__()
        self._size, self._wrap = size, wrap
        self._grid = grid(self, across=2 * theme.GRID, down=theme.GRID // 4, stretch=1 if wrap else None)

    def show_result(self, result: Result | None) -> None:
        """Show the values of a result; None clears the table."""
        clear(self._grid)
        figures = [] if result is None else advice.figures(result)
        self.setVisible(bool(figures))  # so that an empty table takes no space
        if not figures:
            return
        guarded = any(figure.guarded for figure in figures)
        limit = say("common.acceptance_limit_column" if guarded else "common.limit_column")
        columns = say("operator.value"), say("operator.sigma"), limit, say("common.unit_column")
        numbers: tuple[list[QLabel], list[QLabel]] = ([], [])
        number, passing = 0, None
        for figure in figures:
            if figure.passed is not passing:
                title = say(f"operator.{'nearest_to' if figure.passed else 'outside'}_limit", limit=limit)
                for at, text in enumerate((title, *(columns if passing is None else ())), start=1):
                    self._add_cell(self._muted(text), number, at)
                number, passing = number + 1, figure.passed
            icon = StateIcon(self._size)
            icon.set_kind("bad" if not figure.passed else "caution" if figure.near else "good")
            hints = (figure.about, say("operator.near_tip", limit=limit) if figure.near else "")
            icon.setToolTip(plain_tip(tip := "\n".join(filter(None, hints))))
            self._grid.addWidget(icon, number, 0)
            decisive = 3 if figure.by_sigma else 2
            texts = figure.name, figure.value, figure.sigma, figure.limit, figure.unit
            for at, text in enumerate(texts, start=1):
                cell = PlainLabel(text)
                cell.setFont(theme.font(self._size, bold=at == decisive))
                cell.setToolTip(plain_tip(tip))
                cell.setWordWrap(self._wrap and at == 1)
                if at in (2, 3):
                    numbers[at - 2].append(cell)
                self._add_cell(cell, number, at)
            number += 1
        for cells in numbers:
            align_points(cells)
        if guarded:
            self._grid.addWidget(self._muted(say("common.acceptance_limit_about")), number, 1, 1, 5)

    def _muted(self, text: str) -> QLabel:
        """Create a heading or note."""
        heading = label(kind="muted")
        heading.setText(text)
        heading.setFont(theme.font(max(theme.BODY, self._size * theme.BODY // theme.SECTION)))
        return heading

    def set_size(self, size: int) -> None:
        """Set the font size of the next result, px."""
        self._size = size

    def _add_cell(self, cell: QLabel, row: int, column: int) -> None:
        side = Qt.AlignmentFlag.AlignRight if column in (2, 3, 4) else Qt.AlignmentFlag.AlignLeft
        cell.setAlignment(side | Qt.AlignmentFlag.AlignVCenter)
        self._grid.addWidget(cell, row, column)


def align_points(cells: Sequence[QLabel]) -> None:
    """Align the decimal points of right-aligned numbers, including bold ones, with margins."""
    widths = [QFontMetricsF(cell.font()).horizontalAdvance(_fraction(cell.text())) for cell in cells]
    for cell, width in zip(cells, widths, strict=True):
        cell.setContentsMargins(0, 0, round(max(widths) - width), 0)


def _fraction(number: str) -> str:
    return number[number.index(".") :] if "." in number else ""


class VerdictPanel(QFrame):
    """Shows the verdict on the displayed unit after a run.

    `notice` reports on labels and certificates, `unprinted` on labels that were not printed, and `then` is called after
    either has been closed. Signals:
    `acknowledged()` when the operator acknowledges a fault; `closed()` to return to the verdicts on all units.
    """

    acknowledged = Signal()
    closed = Signal()

    def __init__(
        self, app: AppContext, notice: NoticeBar, unprinted: UnprintedNotice, then: Callable[[], None]
    ) -> None:
        super().__init__()
        self._app = app
        self.setProperty("kind", "panel")
        self._run = app.run
        self._finalized: Finalized | None = None
        self._fault: Fault | None = None
        self._label_void = False  #: Whether the failed unit has a label of an earlier run that it passed.
        #: Number of figures, and size of the texts, px.
        self._figure_count = self._shown_size = 0
        self._banner, self._figures = Banner("verdict", _MIN_BANNER), FiguresTable(theme.SECTION)
        self._source, self._facts = label(kind="muted", wrap=True), label(kind="muted", wrap=True)
        self.reason_label, self.action_label, self._notes = label(wrap=True), label(wrap=True), label(wrap=True)
        self.reset = ResetBar(app, self._table_request, "verdict_reset_button")
        self.details_button = button("details_button", "operator.details", self._show_details)
        self.acknowledge_button = button("acknowledge_button", "operator.understood", self.acknowledged, kind="primary")
        self.label_button = LabelButton(app, "label_button", notice, then, unprinted=unprinted)
        self.certificate_button = CertificateButton(app, "certificate_button", notice, then)
        self.close_button = button("all_units_button", "operator.all_units", self.closed, kind="primary")
        open_station = partial(app.page_requested.emit, "station_page")
        self._station_button = button("verdict_station_button", "operator.open_station_page", open_station)
        buttons = row(
            *(self.close_button, self.acknowledge_button, self.label_button, self.certificate_button),
            *(self.details_button, self._station_button, None),
        )
        self._notes_area = ShrinkingText(self._notes)
        self._beside = column(self._facts, self._notes_area, buttons, None)
        self.reset.changed.connect(self._reset_changed)
        people, self._values = self.certificate_button.panel, QWidget()
        row(column(self._figures, None), (self._beside, 1), on=self._values, spacing=3 * theme.GRID)
        # a small screen does not have space for both
        people.open_changed.connect(lambda asking: self._values.setVisible(not asking))
        column(
            (self._banner, 1),
            *(self._source, self.reason_label, self.action_label, self.reset),
            self._values,
            people,
            on=self,
            spacing=theme.GRID,
            margins=(2 * theme.GRID,) * 4,
        )
        app.result_changed.connect(self._result_changed)
        app.role.changed.connect(self._refresh)
        theme.on_appearance_change(self, self._refresh)

    def show_end(self) -> None:
        """Show the outcome of the run."""
        unit, fault = self._run.unit, self._current_fault
        if fault is not self._fault:
            self._fault = fault
            self.reset.clear()
            self.reset.offer(fault is not None and known(fault.code) and entry(fault.code).resettable)
            self._emphasise_reset()
        if unit.finalized is not self._finalized:
            self._finalized = unit.finalized
            file = None if unit.finalized is None else Path(unit.finalized.result_file)
            self._label_void = label_void(self._app, unit)
            judged = unit.finalized is not None and unit.finalized.verdict.judged  # another run may follow otherwise
            for button in (self.label_button, self.certificate_button):
                button.offer(unit.result if judged else None, file)
        self._refresh()

    @property
    def unreset(self) -> Fault | None:
        """The fault of the run if the table has latched it and it has not been reset."""
        return self._run.fault if self.reset.offered and not self._run.by_hand else None

    def _emphasise_reset(self) -> None:
        """Emphasise the reset of the table while it is offered, because no run is possible before the reset."""
        reset = self.reset.offered
        theme.set_kind(self.reset.button, "primary" if reset else "")
        theme.set_kind(self.acknowledge_button, "" if reset else "primary")

    def focus_action(self) -> None:
        """Focus the button that acknowledges the fault, or no button while a reset of the table is offered."""
        (self if self.reset.offered else self.acknowledge_button).setFocus()

    def _reset_changed(self) -> None:
        self._emphasise_reset()
        if self.reset.result is not None and self.reset.result.clear:
            self.acknowledge_button.setFocus()
        self._refresh()

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Fit the texts to the panel."""
        super().resizeEvent(event)
        if self._text_size() != self._shown_size:
            self._refresh()

    def _text_size(self) -> int:
        """Return the size of the texts, px, as large as the number of figures permits; the banner takes the rest."""
        line = _LINE * (self._figure_count + _OTHER_LINES)
        by_share = (_TEXT_SHARE * self.height() - theme.BIG_BUTTON) / line
        fitting = (self.height() - _BANNER - _DISTANCES) / line
        by_width = (self.width() - self._beside.minimumSize().width() - _BETWEEN) / _CHARACTERS
        return max(theme.BODY, int(min(max(by_share, min(fitting, theme.SECTION)), by_width, _MAX_TEXT)))

    def _fit_texts(self) -> None:
        """Set the size of the texts below the banner."""
        self._shown_size = size = self._text_size()
        self.reason_label.setFont(theme.font(size))
        self.action_label.setFont(theme.font(size, bold=True))
        for text in (self._source, self._facts, self._notes):
            text.setFont(theme.font(max(theme.BODY, size * theme.BODY // theme.SECTION)))
        self._figures.set_size(size)

    def next_action(self) -> str:
        """Return the next action for the operator, in the current language."""
        fault, result = self._current_fault, self._run.unit.result
        if result is not None and result.released:
            return say("advice.released")
        if self._run.stop_incomplete:
            return say("advice.stop_incomplete")
        if fault is None and self._run.chamber.must_stay_closed:
            return say("operator.chamber_unconfirmed")  # no unit may be removed before
        if fault is None and self._app.badge_required:
            return sign_in_text(self._app)
        if fault is None and self._run.unit.unverified:
            return say("advice.decide_registers")
        if fault is None:
            return advice.next_action(self._display_state, result, engineer=self._app.role.engineer)
        if (other := prevented_by(self._run)) is not None:
            return rendered(other).remedy
        reset = self.reset.result is not None and self.reset.result.clear
        return say("advice.after_reset") if reset else self._fault_text(fault).remedy

    @property
    def _current_fault(self) -> Fault | None:
        """The fault of the run or of the unit."""
        return self._run.fault or self._run.unit.fault

    @property
    def _display_state(self) -> str:
        return self._run.display_state if self._run.fault is not None else self._run.display_state_of(self._run.unit)

    def _refresh(self) -> None:
        run, unit, fault, state = self._run, self._run.unit, self._current_fault, self._display_state
        text = None if fault is None else self._fault_text(fault)
        result = unit.result
        released = state == "failed" and result is not None and result.released
        name = f"{unit.slot} · {unit.serial}" if unit.slot else unit.serial
        if run.in_slots and run.fault is not None:
            name = say("operator.unit_count", count=len(run.units))
        self._banner.show_state("released" if released else state, name)
        self.acknowledge_button.setVisible(run.fault is not None)
        self.close_button.setVisible(run.in_slots and run.fault is None)
        self.details_button.setVisible(self._finalized is not None)
        misconfigured = fault is not None and known(fault.code) and entry(fault.code).source == "configuration"
        self._station_button.setVisible(misconfigured)
        reason = advice.reason(state, result, self._run) if text is None else text.text
        if run.fault is not None and run.table_stopped:
            reason = joined(reason, say("operator.message_table_stopped"), language.current())
        self.reason_label.setText(reason)
        remarks = dict.fromkeys(say(event_text(*remark)) for remark in unit.remarks)
        shown = result if text is None else None
        figures = [] if shown is None else advice.figures(shown)
        void = say("advice.old_label_void") if self._label_void and not released else ""
        notes = filter(None, (void, *advice.result_notes(result), *remarks))
        for widget, content in (
            (self._source, say("operator.where", source=text.source) if text and text.source else ""),
            (self.action_label, self.next_action()),
            (self._notes, "\n".join(notes)),
            (self._facts, "  ·  ".join(self._fact_texts())),
        ):
            show_text(widget, content)
        self._notes_area.setVisible(bool(self._notes.text()))
        self._figure_count = len(figures) + any(figure.guarded for figure in figures)  # with the note on the guard band
        self._fit_texts()
        self._figures.show_result(shown)
        self._figures.setVisible(bool(figures))  # an empty table would indent the texts beside it
        lay_out(self._figures, self._values, self)

    def _fault_text(self, fault: Fault) -> Rendered:
        return fault_text(fault, engineer=self._app.role.engineer)

    def _result_changed(self, path: Path) -> None:
        """Show that a unit of the run has been released, or that its run has been closed."""
        for unit in self._run.units:
            if unit.finalized is not None and path.absolute() == Path(unit.finalized.result_file).absolute():
                with suppress(InputError):
                    unit.result = load_run_result(path)
                self._run.changed.emit()

    def _table_request(self) -> LinkTestRequest | None:
        """Return the request for the table of the last run.

        Raises ConfigurationError if the station file cannot be read.
        """
        request = self._app.engine_link.request
        return None if request is None else LinkTestRequest(load_station(request.station)[1], request.product)

    def _fact_texts(self) -> list[str]:
        result = self._run.unit.result
        if result is None:
            return []
        facts = [
            say("operator.attempt", count=result.attempt),
            say(f"operator.{'rig' if self._run.by_hand else 'table'}_time", time=duration_text(result.duration_s)),
        ]
        if result.registers is not None and result.registers.verified:
            unverified = result.registers.proved_on == "read_back"
            facts.append(say("operator.registers_unverified" if unverified else "operator.registers_verified"))
        return facts

    def _show_details(self) -> None:
        if self._finalized is not None:
            self._app.open_run.emit(Path(self._finalized.result_file))
