"""The slots of a station for several units, and the serial numbers of the units in the slots."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

from PySide6.QtCore import QObject, Signal

from calstation.messages import Text
from calstation.results import History

#: Final states of units that leave the table; the others may be calibrated again in their slots.
LEAVING = ("passed", "partial", "released")


@dataclass(frozen=True)
class EarlierRuns:
    """The earlier runs of a unit."""

    count: int = 0
    passed: bool = False  #: Whether the unit passed one of them.
    failed: bool = False  #: Whether the last of them that passed or failed the unit failed it.
    interrupted: bool = False  #: Whether the last of them may be resumed, which would be no further attempt.

    @classmethod
    def of(cls, history: History, serial: str) -> "EarlierRuns":
        """Return the earlier runs of a unit."""
        passed, failed = history.passed_before(serial) is not None, history.failed_last(serial)
        latest = next(iter(history.of(serial)), None)
        interrupted = latest is not None and latest.resumable and not (latest.closed or latest.verdict.judged)
        return cls(history.attempts(serial), passed, failed, interrupted)

    @property
    def note(self) -> Text:
        """The note shown when the unit has been accepted."""
        if self.interrupted:
            return Text("operator.interrupted_before")
        code = "operator.attempt_passed" if self.passed else "operator.attempt" if self.count else "operator.accepted"
        return Text.of("operator.attempt_failed" if self.failed else code, count=self.count + 1)


@dataclass(eq=False)
class Slot:
    """A mounting position of a unit on the table."""

    name: str
    serial: str = ""  #: Serial number of the unit; "" if the slot is empty.
    suggested: bool = False  #: Whether the virtual bench has suggested the serial number.
    skipped: bool = False  #: Whether scans skip the slot.
    left_out: bool = False  #: Whether the unit of the last run is still in the slot but not in the next run.
    earlier: EarlierRuns = EarlierRuns()
    #: Serial number and final state of the last unit in this slot, until it has been removed; None for none.
    last: tuple[str, str] | None = None

    @property
    def open(self) -> bool:
        """Whether the next scan may fill the slot."""
        return not (self.serial or self.skipped or self.left_out)


class Slots(QObject):
    """The slots of the next run in order, which are empty at a station for a single unit; emits `changed`."""

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
        """Serial numbers in the order of the slots, "" for an empty slot."""
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
        """The slot for the next scan: `marked`, or the first with a suggested or left-out unit, which is replaced."""
        return self.marked or next((slot for slot in self._slots if slot.suggested or slot.left_out), None)

    def last(self, serial: str) -> str:
        """Return the name of the slot in which a unit was last, or ""."""
        return next((name for name, last in self.last_units.items() if last[0] == serial), "")

    def fillable(self, name: str) -> Slot | None:
        """Return the named slot if a scan can fill it and no slot is selected, otherwise None."""
        fillable = [slot for slot in self._slots if slot.open or slot.suggested or slot.left_out]
        return None if self._chosen is not None else next((slot for slot in fillable if slot.name == name), None)

    @property
    def last_units(self) -> dict[str, tuple[str, str]]:
        """Serial numbers and final states of the last units by slot."""
        return {slot.name: slot.last for slot in self._slots if slot.last is not None}

    @property
    def full(self) -> bool:
        """Whether no slot is open."""
        return not any(slot.open for slot in self._slots)

    def set_names(self, names: tuple[str, ...]) -> None:
        """Set the names of the slots, and remove the units if the names differ from the current ones."""
        if names != tuple(slot.name for slot in self._slots):
            self._slots = [Slot(name) for name in names]
            self._chosen = None
            self.changed.emit()

    def refusal(self, serial: str) -> Text | None:
        """Return why a scanned unit cannot be assigned to a slot, or None."""
        slot = next((slot for slot in self._slots if slot.serial == serial and not slot.suggested), None)
        if slot is not None:
            return Text.of("question.serial_twice", serial=serial, slot=slot.name)
        if self.next is not None:
            return None
        code = "question.slots_skipped" if any(slot.skipped for slot in self._slots) else "question.no_slot_left"
        return Text.of(code, serial=serial)

    def suggest(self, next_serial: Callable[[], str]) -> None:
        """Suggest serial numbers of simulated units, "" for none, for the open slots in order."""
        for slot in self._slots:
            if slot.open:
                slot.serial = next_serial()
                slot.suggested = bool(slot.serial)
        self.changed.emit()

    def fill(self, slot: Slot, serial: str, history: History) -> None:
        """Assign a unit with its earlier runs to a slot, and remove a suggestion of its serial number."""
        for other in self._slots:
            if other.serial == serial:
                other.serial, other.suggested = "", False
            if other is not slot and other.last is not None and other.last[0] == serial:
                other.last, other.left_out = None, False
        slot.serial, slot.earlier = serial, EarlierRuns.of(history, serial)
        slot.suggested = slot.skipped = slot.left_out = False
        self._chosen = None
        self.changed.emit()

    def leave_out_others(self) -> None:
        """Mark the slots that still contain a unit of the last run but have no unit for the next run as left out."""
        for slot in self._slots:
            slot.left_out = slot.last is not None and not slot.serial
        self.changed.emit()

    def choose(self, slot: Slot) -> None:
        """Select the slot for the next scan."""
        self._chosen = slot
        self.changed.emit()

    def clear(self, slot: Slot) -> None:
        """Remove the unit from a slot, and unselect the slot."""
        slot.serial, slot.suggested = "", False
        self._chosen = None
        self.changed.emit()

    def set_skipped(self, slot: Slot, *, skipped: bool) -> None:
        """Set whether scans skip an empty slot; a skipped slot no longer contains its last unit."""
        slot.skipped, slot.left_out = skipped, False
        if skipped:
            slot.last = None
        self._chosen = None
        self.changed.emit()

    def note_last(self, units: Mapping[str, tuple[str, str]]) -> None:
        """Note the serial numbers and the final states of the units of a run by slot."""
        for slot in self._slots:
            slot.last = units.get(slot.name, slot.last)
        self.changed.emit()

    def forget_unloaded(self) -> None:
        """Forget the last units of the slots that stay empty in a run, if they have left the table."""
        for slot in self._slots:
            if slot.last is not None and slot.last[1] in LEAVING and not (slot.serial or slot.left_out):
                slot.last = None
        self.changed.emit()

    def forget_last(self) -> None:
        """Forget the last units of all slots, also those that are left out."""
        for slot in self._slots:
            slot.last, slot.left_out = None, False
        self.changed.emit()

    def remove_units(self, *, only_suggested: bool = False) -> None:
        """Remove all units and stop skipping or leaving out slots, or remove only suggested units."""
        for slot in self._slots:
            if slot.suggested or not only_suggested:
                slot.serial, slot.suggested = "", False
            slot.left_out, slot.skipped = slot.left_out and only_suggested, slot.skipped and only_suggested
        self._chosen = None
        self.changed.emit()
