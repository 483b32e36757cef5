"""Panel with the verdicts on several units, in tiles that show the verdict, the reason and the next action."""

from collections.abc import Callable
from functools import partial
from math import ceil
from pathlib import Path

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QFrame

from calstation.gui.operator import advice
from calstation.gui.operator.production import CertificatesButton, LabelButton, UnprintedNotice, label_void
from calstation.gui.operator.units.banner import Banner
from calstation.gui.operator.units.tiles import COLUMNS, Tile, arrange_in_slots, pass_clicks, slot_text
from calstation.gui.state import LEAVING, AppContext, RunStatus, UnitStatus, run_badge
from calstation.gui.text import fault_text, say, term
from calstation.gui.widgets import (
    PANEL,
    ElidedLabel,
    NoticeBar,
    StateBadge,
    button,
    column,
    enable,
    grid,
    label,
    plain_tip,
    row,
    theme,
)
from calstation.records import Verdict
from calstation.results import Result

#: Minimum height of a banner, maximum heights in one row and in several rows, and font size of the summary, px.
_MIN_BANNER, _MAX_ONE_ROW, _MAX_SEVERAL_ROWS, _SUMMARY = 4 * theme.GRID, 13 * theme.GRID, 10 * theme.GRID, 28
#: Maximum number of rows in which the tiles have space for whole sentences.
_MAX_SENTENCE_ROWS = 2


class _VerdictTile(Tile):
    """Tile with the verdict on a unit; the texts are abbreviated if there are too many `rows`."""

    def __init__(self, unit: UnitStatus, rows: int) -> None:
        name = f"unit_{unit.slot}_verdict"
        super().__init__(name)
        self.unit = unit
        self.roomy = rows <= _MAX_SENTENCE_ROWS
        self._banner, self._serial = Banner(name, _MIN_BANNER), ElidedLabel()
        self._banner.setMaximumHeight(_MAX_ONE_ROW if rows == 1 else _MAX_SEVERAL_ROWS)
        self._serial.setText(unit.serial)
        self.reason, self._action = (label(wrap=True) if self.roomy else ElidedLabel() for _ in range(2))
        size = theme.SECTION if rows == 1 else theme.BODY
        self.reason.setFont(theme.font(size))
        self._action.setFont(theme.font(size, bold=True))
        self._serial.setFont(theme.font(size, bold=True))
        margins = (theme.GRID, theme.GRID // 2, theme.GRID, theme.GRID // 2)
        if self.roomy:
            texts = column(self._serial, self.reason, self._action, margins=margins)
        else:
            head = row((self._serial, 2), (self._action, 3), spacing=theme.GRID)
            texts = column(head, self.reason, spacing=0, margins=margins)
        column((self._banner, 4), texts, None, on=self, spacing=0, margins=(2, 2, 2, 2))
        pass_clicks(self._banner, self._serial, self.reason, self._action)

    def show_verdict(self, run: RunStatus, *, label_void: bool, engineer: bool) -> None:
        """Show the final state of the unit, the reason, the next action, and whether its old label is void.

        For an `engineer`, the remedy of a fault is that for engineers.
        """
        unit = self.unit
        state = run.final_state_of(unit)
        outcome = "failed" if state == "released" else state
        brief = advice.brief_reason(outcome, unit.result), advice.brief_action(outcome, unit.result)
        whole = advice.reason(outcome, unit.result, run), advice.next_action(outcome, unit.result, in_batch=True)
        if state == "released":
            brief, whole = (brief[0], say("advice.released")), (whole[0], say("advice.released"))
        if unit.unverified:
            brief, whole = (
                (brief[0], term("advice_brief", "decide_registers")),
                (whole[0], say("advice.decide_registers")),
            )
        if unit.fault is not None:
            fault = fault_text(unit.fault, engineer=engineer)
            brief = whole = (fault.text, fault.remedy)
        elif label_void and state == "failed":
            note = term("advice_brief", "remove_label")
            brief, whole = (brief[0], f"{note}  ·  {brief[1]}"), (whole[0], f"{note}  ·  {whole[1]}")
        self._banner.show_state(state, slot_text(unit))
        for widget, text in zip((self.reason, self._action), whole if self.roomy else brief, strict=True):
            widget.setText(text)
        self.setToolTip(plain_tip("\n".join(whole)))
        self.setAccessibleName(", ".join((slot_text(unit), unit.serial, self._banner.word.text(), *whole)))


class VerdictGrid(QFrame):
    """Tiles with the verdicts on all units of a run, below a summary and buttons that apply to several units.

    `notice` reports on labels and certificates, `unprinted` on labels that were not printed, and `then` is called after
    either has been closed. Signals: `opened()` after a click on a tile; `again(units)` to calibrate the failed units
    again, except those to be set aside.
    """

    opened = Signal()
    again = Signal(object)

    def __init__(
        self, app: AppContext, notice: NoticeBar, unprinted: UnprintedNotice, then: Callable[[], None]
    ) -> None:
        super().__init__()
        self.setProperty("kind", "panel")
        self._app, self._run, self._slots = app, app.run, app.slots
        self._tiles: list[_VerdictTile] = []
        self._prepared: dict[str, _VerdictTile] = {}
        self._offered: list[Path] = []  #: Result files to which the buttons for labels and certificates apply.
        self._shown: list[tuple[object, ...]] = []  #: State of each unit as the tiles show it.
        self._summary = StateBadge(_SUMMARY, "units_summary")
        self._again = button("again_button", pressed=lambda: self.again.emit(self._repeatable), kind="primary")
        self._labels = LabelButton(app, "labels_button", notice, then, unprinted=unprinted, all_units=True)
        self._certificates = CertificatesButton(app, "certificates_button", notice, then)
        self._grid = grid()
        head = row(self._summary, None, self._again, self._labels, self._certificates)
        column(head, self._certificates.panel, (self._grid, 1), on=self, margins=PANEL)
        app.role.changed.connect(self._refresh)
        theme.on_appearance_change(self, self._refresh)

    def show_end(self) -> None:
        """Show the outcome of the run for each unit."""
        if [tile.unit for tile in self._tiles] != list(self._run.units):
            self._tiles = [self._tile(unit) for unit in self._run.units]
            self._prepared = {}
            arrange_in_slots(self._grid, {tile.unit.slot: tile for tile in self._tiles}, self._run.slots, self._slots)
        files = [path for _, path in self._passed]
        if files != self._offered:
            self._offered = files
            self._labels.offer_all(self._passed)
            self._certificates.offer_all(self._passed)
        run = self._run
        shown: list[tuple[object, ...]] = [
            (unit, run.display_state_of(unit), unit.result, unit.fault) for unit in run.units
        ]
        if shown != self._shown:
            self._shown = shown
            self._refresh()

    def refuse_again(self, why_not: str) -> None:
        """Disable the button that repeats failed units with the reason as its tooltip; "" enables it."""
        enable(self._again, why_not)

    def prepare(self) -> None:
        """Create the tiles of units that have a verdict during the run, so that fewer are created at its end."""
        self._prepared = {
            unit.slot: self._tile(unit) for unit in self._run.units if unit.slot and unit.verdict is not None
        }

    def _tile(self, unit: UnitStatus) -> _VerdictTile:
        """Return the prepared tile of a unit, or else a new one."""
        tile = self._prepared.get(unit.slot)
        if tile is not None and tile.unit is unit:
            return tile
        tile = _VerdictTile(unit, ceil(len(self._run.slots) / COLUMNS))
        tile.clicked.connect(partial(self._open, unit))
        return tile

    def focus_unit(self) -> None:
        """Focus the tile of the unit that is displayed in detail."""
        for tile in self._tiles:
            if tile.unit is self._run.unit:
                tile.setFocus()

    def next_action(self) -> str:
        """Return the operator's next action."""
        if self._run.stop_incomplete:
            return say("advice.stop_incomplete")
        if self._run.chamber.must_stay_closed:
            return say("operator.chamber_unconfirmed")
        if any(unit.unverified for unit in self._run.units):
            return say("advice.decide_registers_units")
        unfinished = [unit for unit in self._run.units if unit.unfinished]  # also after a fault of the table
        kept = [unit for unit in unfinished if unit.result is None or unit.result.closed_utc is None]
        kept += self._failed_resumable
        if kept and self._run.resumable:
            return say("advice.resume_unit", serial=kept[0].serial) if len(kept) == 1 else say("advice.resume_units")
        if unfinished and len(unfinished) == len(self._run.units):
            return say("advice.same_units")
        if not (unfinished or self._failed):
            mounted = self._mounted
            return say("advice.units_mounted", serials=mounted) if mounted else say("advice.next_units")
        leaves = any(self._run.final_state_of(unit) in LEAVING for unit in self._run.units)
        return say("advice.mixed_units" if leaves else "advice.failed_units")

    @property
    def _mounted(self) -> list[str]:
        """The units of earlier runs that are still in other slots and have not passed."""
        used = {unit.slot for unit in self._run.units}
        last = self._slots.last_units
        return [serial for slot, (serial, state) in last.items() if slot not in used and state not in LEAVING]

    @property
    def _failed(self) -> list[UnitStatus]:
        return [unit for unit in self._run.units if unit.failed]

    @property
    def _repeatable(self) -> list[UnitStatus]:
        """Failed units that the operator may calibrate again, without those that the question offers to resume."""
        resumed = self._failed_resumable
        return [unit for unit in self._failed if advice.repeats(unit.result) and unit not in resumed]

    @property
    def _failed_resumable(self) -> list[UnitStatus]:
        """Units with their own fault that can be resumed, if the run also stopped for other units."""
        units = self._run.units
        return [unit for unit in self._failed if unit.resumable] if any(unit.unfinished for unit in units) else []

    @property
    def _passed(self) -> list[tuple[Result, Path]]:
        """Results of the units that passed, with their files."""
        return [
            (unit.result, Path(unit.finalized.result_file))
            for unit in self._run.units
            if unit.verdict is Verdict.PASSED and unit.result is not None and unit.finalized is not None
        ]

    def _open(self, unit: UnitStatus) -> None:
        self._run.select_unit(unit)
        self.opened.emit()

    def _refresh(self) -> None:
        if self._tiles:
            self._summary.show_state(*run_badge(self._run))
            repeatable = self._repeatable
            verdicts = {unit.verdict for unit in repeatable}
            both = len(verdicts) > 1
            again = "operator.again_faults" if Verdict.FAULT in verdicts else "operator.again"
            if len(repeatable) == 1:  # the tiles of the others may look the same
                self._again.setText(say("operator.again_one", serial=repeatable[0].serial))
            else:
                self._again.setText(say("operator.again_both" if both else again, count=len(repeatable)))
            self._again.setVisible(bool(repeatable))
            for tile in self._tiles:
                void = label_void(self._app, tile.unit)
                tile.show_verdict(self._run, label_void=void, engineer=self._app.role.engineer)
            brief = [tile.reason for tile in self._tiles if not tile.roomy]
            height = max((reason.sizeHint().height() for reason in brief), default=0)
            for reason in brief:  # all banners must have the same height
                reason.setMinimumHeight(height)
