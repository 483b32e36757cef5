"""The slots of a station with several units, and the serial numbers scanned into them for the next run."""

from collections.abc import Iterator
from dataclasses import dataclass

from PySide6.QtCore import QObject, Signal

from calstation.messages import Text


@dataclass(eq=False)
class Slot:
    """A mounting position of a unit on the table."""

    name: str
    serial: str = ""  #: Serial number of its unit; "" if there is none.
    suggested: bool = False  #: Whether the virtual bench suggested the serial number.
    skipped: bool = False  #: Whether scans skip it.
    attempts: int = 0  #: Number of earlier runs of the unit.

    @property
    def open(self) -> bool:
        """Whether a scan may fill it."""
        return not self.serial and not self.skipped


class Slots(QObject):
    """The slots in order; emits `changed`. A station with a single unit has none."""

    changed = Signal()

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._slots: list[Slot] = []
        self._chosen: Slot | None = None

    def __iter__(self) -> Iterator[Slot]:
        return iter(self._slots)

    def __bool__(self) -> bool:
        return bool(self._slots)

    @property
    def serials(self) -> tuple[str, ...]:
        """Serial numbers by slot, "" for an empty one."""
        return tuple(slot.serial for slot in self._slots)

    @property
    def units(self) -> tuple[str, ...]:
        """Serial numbers of all units."""
        return tuple(filter(None, self.serials))

    @property
    def marked(self) -> Slot | None:
        """The selected slot, or the first open one; None if there is neither."""
        return self._chosen or next((slot for slot in self._slots if slot.open), None)

    @property
    def next(self) -> Slot | None:
        """The slot for the next scan: the marked one, or the first with a suggestion, which the scan replaces."""
        return self.marked or next((slot for slot in self._slots if slot.suggested), None)

    @property
    def full(self) -> bool:
        """Whether no slot is open."""
        return not any(slot.open for slot in self._slots)

    def plan(self, names: tuple[str, ...]) -> None:
        """Use the slots of a station; slots with the current names keep their units."""
        if names != tuple(slot.name for slot in self._slots):
            self._slots = [Slot(name) for name in names]
            self._chosen = None
            self.changed.emit()

    def refusal(self, serial: str) -> Text | None:
        """Return why no slot takes a scanned unit, or None."""
        slot = next((slot for slot in self._slots if slot.serial == serial and not slot.suggested), None)
        if slot is not None:
            return Text.of("question.serial_twice", serial=serial, slot=slot.name)
        return Text.of("question.no_slot_left", serial=serial) if self.next is None else None

    def suggest(self, slot: Slot, serial: str) -> None:
        """Fill an open slot with the serial number of a simulated unit; "" for none."""
        slot.serial, slot.suggested = serial, bool(serial)
        self.changed.emit()

    def fill(self, slot: Slot, serial: str, attempts: int) -> None:
        """Put a unit into a slot; a suggestion of the same serial number elsewhere is removed."""
        for other in self._slots:
            if other.serial == serial:
                other.serial, other.suggested = "", False
        slot.serial, slot.attempts, slot.suggested, slot.skipped = serial, attempts, False, False
        self._chosen = None
        self.changed.emit()

    def choose(self, slot: Slot) -> None:
        """Select the slot for the next scan."""
        self._chosen = slot
        self.changed.emit()

    def clear(self, slot: Slot) -> None:
        """Remove the unit from a slot; the next scan fills the first open one."""
        slot.serial, slot.suggested = "", False
        self._chosen = None
        self.changed.emit()

    def set_skipped(self, slot: Slot, *, skipped: bool) -> None:
        """Set whether scans skip an empty slot."""
        slot.skipped = skipped
        self._chosen = None
        self.changed.emit()

    def remove_units(self, *, only_suggested: bool = False) -> None:
        """Remove all units, or only suggested ones; slots left empty remain so."""
        for slot in self._slots:
            if slot.suggested or not only_suggested:
                slot.serial, slot.suggested = "", False
        self._chosen = None
        self.changed.emit()
