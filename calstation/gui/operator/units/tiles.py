"""Tiles for units, with the same arrangement before, during and after a run, and the tiles of a run in progress."""

from collections.abc import Mapping, Sequence
from functools import partial

from PySide6.QtCore import Qt
from PySide6.QtGui import QPaintEvent, QShowEvent
from PySide6.QtWidgets import (
    QAbstractButton,
    QFrame,
    QGridLayout,
    QSizePolicy,
    QStyle,
    QStyleOption,
    QStylePainter,
    QWidget,
)

from calstation.gui.state import TRANSFER, AppContext, Slots, UnitStatus
from calstation.gui.text import KINDS, bind, fault_text, on_language_change, product_text, say, term
from calstation.gui.widgets import ElidedLabel, StateIcon, clear, column, grid, label, plain_tip, row, theme
from calstation.messages import Text
from calstation.runs import RunSummary

#: Maximum number of tiles in a row.
COLUMNS = 4


class Tile(QAbstractButton):
    """A button that contains widgets and fills its cell in the grid."""

    def __init__(self, name: str) -> None:
        super().__init__()
        self.setObjectName(name)
        self.setProperty("kind", "tile")
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Expanding)

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw the background and border of the style sheet."""
        option = QStyleOption()
        option.initFrom(self)
        QStylePainter(self).drawPrimitive(QStyle.PrimitiveElement.PE_Widget, option)

    def show_selected(self, selected: bool) -> None:
        """Show whether the tile belongs to the next scan or to the displayed unit."""
        kind = "tile_chosen" if selected else "tile"
        if self.property("kind") != kind:
            theme.set_kind(self, kind)

    def describe(self, *texts: str) -> None:
        """Set the accessible name and the tooltip from texts; empty texts are omitted."""
        self.setAccessibleName(", ".join(filter(None, texts)))
        self.setToolTip(plain_tip(self.accessibleName()))


def pass_clicks(*widgets: QWidget) -> None:
    """Pass clicks on widgets to the tile that contains them."""
    for widget in widgets:
        widget.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)


def arrange(layout: QGridLayout, tiles: Sequence[QWidget]) -> None:
    """Replace the tiles in a grid with `tiles` in order."""
    clear(layout)
    for index in range(COLUMNS):
        layout.setColumnStretch(index, index < len(tiles))
    for index, tile in enumerate(tiles):
        layout.addWidget(tile, index // COLUMNS, index % COLUMNS)


def _last_tip(serial: str, state: str) -> str:
    return plain_tip(say("operator.last_unit", serial=serial, state=term("badge", state)))


class _EmptyTile(QFrame):
    """Tile of a slot without a unit in the run, with the serial number and the final state of its last unit."""

    def __init__(self, slot: str, last: tuple[str, str] | None) -> None:
        super().__init__()
        self.setObjectName(f"empty_{slot}_tile")
        self.setProperty("kind", "panel")
        name, text = label(kind="muted"), ElidedLabel("muted")
        name.setText(slot)
        bind(text, "operator.left_out")
        margins = (theme.GRID, theme.GRID // 2, theme.GRID, theme.GRID // 2)
        rows = [row(name, (text, 1), spacing=theme.GRID)]
        if last is not None:
            serial, state = last
            icon, unit = StateIcon(16), ElidedLabel(mode=Qt.TextElideMode.ElideMiddle)
            icon.set_kind(KINDS.get(state, "none"))
            unit.setText(serial)
            rows = [row(name, (unit, 1), spacing=theme.GRID), row(icon, (text, 1), spacing=theme.GRID)]
            bind(self.setToolTip, partial(_last_tip, serial, state))
        column(None, *rows, None, on=self, spacing=0, margins=margins)


def arrange_in_slots(layout: QGridLayout, tiles: Mapping[str, QWidget], names: Sequence[str], slots: Slots) -> None:
    """Replace the tiles in a grid with those of units by slot, each in the same cell as before the run.

    `names` are the slots of the run, and `slots` contain the last units of the slots without a tile.
    """
    last = slots.last_units
    arrange(layout, [tiles.get(name) or _EmptyTile(name, last.get(name)) for name in names])


class _UnitTile(Tile):
    """Tile with the slot and serial number of a unit above its state."""

    def __init__(self, unit: UnitStatus, prefix: str) -> None:
        super().__init__(f"{prefix}unit_{unit.slot}_tile")
        self.unit = unit
        self._icon, self._slot = StateIcon(16), label(kind="muted")
        self._serial, self._text = ElidedLabel(), ElidedLabel()
        self._serial.setFont(theme.font(bold=True))
        self._serial.setText(unit.serial)
        head = row(self._slot, (self._serial, 1), spacing=theme.GRID)
        state = row(self._icon, (self._text, 1), spacing=theme.GRID)
        margins = (theme.GRID, theme.GRID // 2, theme.GRID, theme.GRID // 2)
        column(None, head, state, None, on=self, spacing=0, margins=margins)
        pass_clicks(self._icon, self._slot, self._serial, self._text)

    def show_state(self, kind: str, text: str, *, selected: bool) -> None:
        """Show the state of the unit."""
        self._icon.set_kind(kind)
        self._text.setText(text)
        self.show_selected(selected)
        self._slot.setText(slot_text(self.unit))
        self.describe(slot_text(self.unit), self.unit.serial, text)


def slot_text(unit: UnitStatus) -> str:
    """Return the slot of a unit with the slot's own product, if it has one."""
    return f"{unit.slot} · {product_text(unit.product)}" if unit.product else unit.slot


class UnitTiles(QWidget):
    """Tiles with the states of the units of a run in progress; a click selects the unit that is displayed in detail.

    `prefix` is the beginning of the object names.
    """

    def __init__(self, app: AppContext, prefix: str) -> None:
        super().__init__()
        self._run, self._slots, self._prefix = app.run, app.slots, prefix
        self._tiles: list[_UnitTile] = []
        self._outdated = False
        self._grid = grid(self)
        app.run.changed.connect(self.refresh)
        on_language_change(self, self.refresh)

    def start(self) -> None:
        """Show the units of a new run now or, if the tiles are hidden, when they are next shown."""
        self._outdated = True
        self.refresh()

    def _create(self) -> None:
        self._outdated = False
        self._tiles = [_UnitTile(unit, self._prefix) for unit in self._run.units if unit.slot]
        for tile in self._tiles:
            tile.clicked.connect(partial(self._run.select_unit, tile.unit))
        arrange_in_slots(self._grid, {tile.unit.slot: tile for tile in self._tiles}, self._run.slots, self._slots)

    def showEvent(self, event: QShowEvent) -> None:
        """Show the states of the units after the tiles were hidden."""
        super().showEvent(event)
        self.refresh()

    def refresh(self) -> None:
        """Show the states of the units, unless the tiles are hidden."""
        if not self.isVisible():
            return
        if self._outdated:
            self._create()
        for tile in self._tiles:
            tile.show_state(*self._state(tile.unit), selected=tile.unit is self._run.unit)

    def _state(self, unit: UnitStatus) -> tuple[str, str]:
        """Return the badge shape and a short text of the state of a unit."""
        run = self._run
        if unit.fault is not None:
            return "caution", _named(term("badge", "fault"), fault_text(unit.fault, engineer=False).text)
        if unit.verdict is not None:
            state = run.display_state_of(unit)
            return KINDS.get(state, "none"), term("badge", state)
        if run.state == "stopping":
            return KINDS[run.state], term("badge", run.state)
        if unit.keeps_registers:
            return "bad", say("operator.registers_kept")
        bad = next((stage for stage in unit.stages if stage.state == "bad"), None)
        stage, ratio = unit.stage, _sigma_ratio(unit, run.run_summary)
        text = ""
        if bad is not None:
            text = _named(term("stage", bad.name), term("stage_state", "bad"))
        elif stage is not None and stage.state == "solving":
            text = _named(term("stage", stage.name), term("stage_state", "solving"))
        elif stage is not None and stage.name == TRANSFER:
            text = term("stage", stage.name)
        elif ratio is not None:
            text = _sigma_text(*ratio, run.run_summary)
        elif stage is not None:
            text = term("stage", stage.name)
        elif solved := [stage for stage in unit.stages if stage.state == "good"]:
            text = _named(term("stage", solved[-1].name), term("stage_state", "good"))
        kind = KINDS["paused"] if run.state == "paused" else "active"
        if unit.failing and bad is None:
            return "bad", say("operator.will_fail")
        return "bad" if bad is not None else kind, text or say("operator.unit_preparing")


def _sigma_ratio(unit: UnitStatus, summary: RunSummary | None) -> tuple[float, str] | None:
    """Return the largest ratio of a sigma to its target or limit, and its group; None while unknown."""
    targets = {} if summary is None else summary.targets
    return max(((value / targets[g], g) for g, value in unit.sigma.items() if g in targets), default=None)


def _sigma_text(ratio: float, group: str, summary: RunSummary | None) -> str:
    """Return the largest ratio of a sigma to the target of a stage or to the product's limit."""
    own = summary is not None and group in summary.own_targets
    code = "operator.sigma_reached" if ratio <= 1.0 else "operator.sigma_share"
    share = f"{ratio:.2g}" if ratio < 10.0 else f"{ratio:.0f}"
    return say(code, share=share, goal=Text("operator.target" if own else "operator.limit"))


def _named(name: str, text: str) -> str:
    return say("common.named", name=name, text=text)
