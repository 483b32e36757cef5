"""A mark in a unit's memory that only a restart takes away: numbers that its flash does not hold.

A unit that has burnt its registers shows the same before its restart and behind it. So one that answers its reset and
goes on, or restarts later than it answers, would be read back from memory and taken for one whose flash is right.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from calstation.devices.codecs.conventions import SENSORS, matrix_slots
from calstation.devices.codecs.numbers import number
from calstation.devices.profiles.registers import RegisterEntry

#: Of a register's range: numbers that nobody writes, of which one always differs from what is there.
_PLACES = (0.381966, 0.618034)

_MATRIX = frozenset(slot for sensor in SENSORS for slot in matrix_slots(sensor))


@dataclass(frozen=True)
class RestartMarker:
    """An entry that was written without a commit, what it held before and what it shows as long as nothing restarts."""

    entry: RegisterEntry
    before: tuple[float, ...]
    shown: tuple[float, ...]


def markable(entries: Sequence[RegisterEntry]) -> RegisterEntry | None:
    """The entry to mark: one that holds no part of a matrix, which the unit might invert, where there is one."""
    return min(entries, key=lambda entry: not _free(entry), default=None)


def marked(entry: RegisterEntry, before: Sequence[float]) -> list[float]:
    """Numbers inside the entry's range that differ from what it holds; of a matrix only what stands behind it."""
    free = _free(entry) or [len(entry.names) - 1]
    kind = number(entry.type)
    numbers = list(before)
    for i in free:
        low, high = (edge / entry.scale for edge in entry.range)
        held = before[i] if before[i] == before[i] else low
        numbers[i] = kind.nearest(max((low + p * (high - low) for p in _PLACES), key=lambda v: abs(v - held)))
    return numbers


def _free(entry: RegisterEntry) -> list[int]:
    return [i for i, name in enumerate(entry.names) if name and name not in _MATRIX]
