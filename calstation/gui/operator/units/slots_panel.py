"""Panel with a tile for each slot of the table, which shows the scanned unit of the next run."""

from collections.abc import Mapping

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QFrame, QSizePolicy

from calstation.gui.operator.units.tiles import COLUMNS, Tile, arrange, pass_clicks
from calstation.gui.state import Slot, Slots
from calstation.gui.text import KINDS, language, on_language_change, product_text, rendered, say, term
from calstation.gui.widgets import (
    PANEL,
    ElidedLabel,
    PlainLabel,
    StateIcon,
    button,
    column,
    grid,
    label,
    row,
    show_text,
    theme,
)
from calstation.messages import Text, joined

#: Font size in tall tiles, px.
_TALL_SIZE = 28


class _SlotTile(Tile):
    """Tile with the name of a slot above the serial number of its unit, and a button that clears or skips the slot.

    If it is `tall`, its texts are larger, and the button is below them.
    """

    def __init__(self, slot: Slot, slots: Slots, prefix: str, *, tall: bool) -> None:
        super().__init__(f"{prefix}slot_{slot.name}_tile")
        self.slot, self._slots = slot, slots
        self._icon, self._name = StateIcon(18), ElidedLabel("muted")
        # serial numbers differ at their end
        self._last_icon, self._last = StateIcon(16), ElidedLabel("muted", Qt.TextElideMode.ElideMiddle)
        self._serial, self._note = ElidedLabel(), ElidedLabel("muted")
        self._note.setWordWrap(True)
        self._serial.setFont(theme.font(_TALL_SIZE if tall else theme.SECTION, bold=True))
        self.action = button(f"{prefix}slot_{slot.name}_button", pressed=self._act)
        # after a click on the button, the keys of a scan must not press it
        self.action.setFocusPolicy(Qt.FocusPolicy.TabFocus)
        policy = self.action.sizePolicy()
        policy.setRetainSizeWhenHidden(True)  # the names in all tiles stay at the same height
        self.action.setSizePolicy(policy)
        # as wide as its text, so that it stands in the corner, away from the name and the symbol of the slot
        self._last.setSizePolicy(QSizePolicy.Policy.Maximum, QSizePolicy.Policy.Preferred)
        head = row(self._icon, (self._name, 1), self._last, self._last_icon, spacing=theme.GRID)
        texts = column(None, self._serial, self._note, None, spacing=0)
        beside, below = (texts, 1), row(self.action, None)
        unit = column(texts, below, spacing=theme.GRID) if tall else row(beside, self.action, spacing=theme.GRID)
        margins = (theme.GRID, theme.GRID // 4, theme.GRID, theme.GRID // 4)
        column(None, head, unit, None, on=self, spacing=0, margins=margins)
        pass_clicks(self._icon, self._name, self._last_icon, self._last, self._serial, self._note)
        self._name.setText(slot.name)
        self._name.setMinimumWidth(3 * theme.GRID)
        self._name.setFont(theme.font(_TALL_SIZE if tall else theme.SECTION))
        if tall:
            self._note.setFont(theme.font(theme.SECTION))
        self.clicked.connect(lambda: slots.choose(slot))

    def refresh(self, product: str) -> None:
        """Show the state of the slot and the name of its own product, if it has one."""
        slot, is_next = self.slot, self._slots.marked is self.slot
        self.show_selected(is_next)
        self._icon.set_kind("good" if slot.serial else "active" if is_next else "none")
        if slot.serial:
            note = say("operator.suggested" if slot.suggested else slot.earlier.note)
        elif slot.skipped:
            note = say("operator.stays_empty")
        elif slot.left_out and not is_next:
            note = say("operator.left_out")
        else:
            note = say("operator.next_scan" if is_next else "operator.empty")
        note = "  ·  ".join(filter(None, (product_text(product) if product else "", note)))
        show_text(self._serial, slot.serial)
        self._note.setText(note)
        self.action.setVisible(bool(slot.serial) or is_next or slot.skipped)
        action = "operator.use" if slot.skipped else "operator.skip"
        self.action.setText(say("operator.clear" if slot.serial else action))
        last = ""
        if slot.last is not None:
            serial, state = slot.last
            last = say("operator.last_unit", serial=serial, state=term("badge", state))
            self._last.setText(say("operator.previous_unit", serial=serial))  # the symbol shows its verdict
            self._last_icon.set_kind(KINDS.get(state, "none"))
        self._last_icon.setVisible(bool(last))
        self._last.setVisible(bool(last))
        self.describe(slot.name, slot.serial, note, last)

    def _act(self) -> None:
        if self.slot.serial:
            self._slots.clear(self.slot)
        else:
            self._slots.set_skipped(self.slot, skipped=not self.slot.skipped)


class SlotsPanel(QFrame):
    """Tiles of all slots below instructions, which emit `clicked` when a tile or its button is clicked.

    `prefix` is the beginning of the object names.
    """

    clicked = Signal()

    def __init__(self, slots: Slots, prefix: str = "") -> None:
        super().__init__()
        self.setProperty("kind", "panel")
        self._slots, self._prefix = slots, prefix
        self._situation = "driven"
        self._products: Mapping[str, str] = {}
        self._tiles: list[_SlotTile] = []
        self._title, self._text = label(kind="section"), label(kind="muted", wrap=True)
        self._count = PlainLabel()
        self._count.setObjectName(f"{prefix}slots_count_label")
        self._grid = grid()
        column(row((self._title, 1), self._count), self._text, (self._grid, 1), on=self, margins=PANEL)
        slots.changed.connect(self._refresh)
        on_language_change(self, self._refresh)

    def set_next_run(self, *, virtual: bool, products: Mapping[str, str]) -> None:
        """Show the instructions for a virtual bench or for hardware, and the names of the slots' own products."""
        self._situation, self._products = "virtual" if virtual else "driven", products
        self._refresh()

    def _refresh(self) -> None:
        if [tile.slot for tile in self._tiles] != list(self._slots):
            tall = len(self._slots.serials) <= COLUMNS
            self._tiles = [_SlotTile(slot, self._slots, self._prefix, tall=tall) for slot in self._slots]
            for tile in self._tiles:
                tile.clicked.connect(self.clicked)
                tile.action.clicked.connect(self.clicked)
            arrange(self._grid, self._tiles)
        kept = self._situation != "virtual" or any(slot.suggested for slot in self._slots)
        words = rendered(Text(f"loading.slots_{self._situation}{'' if kept else '_empty'}"))
        self._title.setText(words.text)
        shown = say("operator.last_units_shown") if any(slot.last for slot in self._slots) else ""
        self._text.setText(joined(words.remedy, shown, language.current()))
        used, count = len(self._slots.units), len(self._slots.serials)
        self._count.setText(say("operator.slots_used", count=used, slots=count))
        for tile in self._tiles:
            tile.refresh(self._products.get(tile.slot.name, ""))
