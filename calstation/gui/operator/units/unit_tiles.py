"""The units of a run in progress: a tile for each with its state; a click selects the unit of the live plots."""

from functools import partial

from PySide6.QtWidgets import QWidget

from calstation.gui.operator.units.tile import Tile, arrange, pass_clicks
from calstation.gui.state import TRANSFER, RunStatus, UnitStatus
from calstation.gui.text import KINDS, fault_text, on_language_change, say, term
from calstation.gui.widgets import ElidedLabel, StateIcon, column, grid, label, row, theme


class _UnitTile(Tile):
    """A unit: its slot and serial number above its state."""

    def __init__(self, unit: UnitStatus) -> None:
        super().__init__(f"unit_{unit.slot}_tile")
        self.unit = unit
        self._icon, self._slot = StateIcon(16), label(kind="muted")
        self._serial, self._text = ElidedLabel(), ElidedLabel()
        self._serial.setFont(theme.font(bold=True))
        self._slot.setText(unit.slot)
        self._serial.setText(unit.serial)
        head = row(self._slot, (self._serial, 1), spacing=theme.GRID)
        state = row(self._icon, (self._text, 1), spacing=theme.GRID)
        margins = (theme.GRID, theme.GRID // 2, theme.GRID, theme.GRID // 2)
        column(None, head, state, None, on=self, spacing=0, margins=margins)
        pass_clicks(self._icon, self._slot, self._serial, self._text)

    def show_state(self, kind: str, text: str, *, chosen: bool) -> None:
        """Show the state of the unit."""
        self._icon.set_kind(kind)
        self._text.setText(text)
        self.show_chosen(chosen)
        self.setAccessibleName(", ".join((self.unit.slot, self.unit.serial, text)))
        self.setToolTip(self.accessibleName())


class UnitTiles(QWidget):
    """The tiles of all units in the order of their slots."""

    def __init__(self, run: RunStatus) -> None:
        super().__init__()
        self._run = run
        self._tiles: list[_UnitTile] = []
        self._grid = grid(self)
        run.changed.connect(self.refresh)
        on_language_change(self, self.refresh)

    def start(self) -> None:
        """Show the units of a new run."""
        self._tiles = [_UnitTile(unit) for unit in self._run.units if unit.slot]
        for tile in self._tiles:
            tile.clicked.connect(partial(self._run.choose, tile.unit))
        arrange(self._grid, self._tiles)
        self.refresh()

    def refresh(self) -> None:
        """Show the states of the units."""
        for tile in self._tiles:
            tile.show_state(*self._state(tile.unit), chosen=tile.unit is self._run.unit)

    def _state(self, unit: UnitStatus) -> tuple[str, str]:
        """Return the kind of a unit's state, and a few words that describe it."""
        run = self._run
        if unit.fault is not None:
            return "caution", f"{term('badge', 'fault')}: {fault_text(unit.fault).text}"
        if unit.verdict is not None:
            shown = run.display_state_of(unit)
            return KINDS.get(shown, "none"), term("badge", shown)
        if run.state == "stopping":
            return KINDS[run.state], term("badge", run.state)
        if unit.keeps_registers:
            return "bad", say("operator.outside_limits")
        bad = next((stage for stage in unit.stages if stage.state == "bad"), None)
        stage, share = unit.stage, run.sigma_ratio(unit)
        text = ""
        if bad is not None:
            text = f"{term('stage', bad.name)}: {term('stage_state', 'bad')}"
        elif stage is not None and stage.state == "solving":
            text = f"{term('stage', stage.name)}: {term('stage_state', 'solving')}"
        elif stage is not None and stage.name == TRANSFER:
            text = term("stage", stage.name)
        elif share is not None:
            text = say("operator.sigma_share", share=f"{share:.2g}" if share < 10.0 else f"{share:.0f}")
            if share <= 1.0:
                text = say("operator.sigma_reached", sigma=text)
        elif stage is not None:
            text = term("stage", stage.name)
        elif solved := [each for each in unit.stages if each.state == "good"]:
            text = f"{term('stage', solved[-1].name)}: {term('stage_state', 'good')}"
        return "bad" if bad is not None else "active", text or say("operator.unit_preparing")
