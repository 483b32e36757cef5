"""The registers of a Watlow F4: temperatures in tenths of a degree; event output 1 switches the chamber on and off."""

import struct

from calstation.bench.chamber.machine import ChamberMachine
from calstation.bench.table import RegisterBank

AIR, ALARM, SET_POINT, DECIMALS, CELSIUS, END_PROFILE, EVENT = 100, 102, 300, 606, 901, 1217, 2000


class ChamberRegisters(RegisterBank):
    """Holding registers of the chamber."""

    writable = ((SET_POINT, 1), (END_PROFILE, 1), (EVENT, 1))

    def __init__(self, machine: ChamberMachine) -> None:
        self._machine = machine
        self.words = [0] * (EVENT + 1)
        self.words[DECIMALS] = self.words[CELSIUS] = 1

    def refresh(self) -> None:
        """Update the temperatures, the alarm and the event output."""
        machine = self._machine
        self.words[AIR], self.words[SET_POINT] = (_word(value) for value in (machine.temperature, machine.set_point))
        self.words[ALARM], self.words[EVENT] = machine.alarm, int(machine.running)

    def _execute(self, written: range) -> None:
        if SET_POINT in written:
            (tenths,) = struct.unpack(">h", struct.pack(">H", self.words[SET_POINT]))
            self._machine.set_point = tenths / 10.0
        if EVENT in written:
            (self._machine.start if self.words[EVENT] else self._machine.stop)()


def _word(value: float) -> int:
    return int(struct.unpack(">H", struct.pack(">h", round(10.0 * value)))[0])
