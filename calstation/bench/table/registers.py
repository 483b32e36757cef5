"""The Modbus register map of the table, which defines the content of registers and the effects of writing them.

Registers have 16 bits and 0-based addresses; 32-bit values are signed, with the high word first. Positions are in 1e-5
deg, rates in 1e-4 deg/s, accelerations in 1e-4 deg/s².
"""

import struct
from abc import ABC, abstractmethod

import numpy as np

from calstation.bench.table.machine import Clocks, NoSuchRegister, OutOfRange, Refusal, TableMachine

MODEL_AT, SERIAL_AT, TEXT_WORDS = 0, 8, 8
CONTROL, STATUS, FAULT, INTERLOCK, WATCHDOG, HEARTBEAT, COMMAND = 16, 17, 18, 19, 20, 21, 22
#: First register of each joint, and the offsets of its values.
JOINTS = (30, 50)
POSITION, RATE, TARGET, TARGET_RATE, TARGET_ACCELERATION, LOW, HIGH = 0, 2, 4, 6, 8, 10, 12
JOINT_WORDS = 14

MOVE, STOP, HOME, TURN = 1, 2, 3, 4

#: Number of registers, including reserved ones.
SIZE = JOINTS[-1] + JOINT_WORDS

_ANGLE = np.deg2rad(1e-5)
_SPEED = np.deg2rad(1e-4)


def text_words(text: str) -> list[int]:
    """Return eight registers that contain the text in ASCII, padded with zeros."""
    data = text.encode("ascii", "replace")[: 2 * TEXT_WORDS].ljust(2 * TEXT_WORDS, b"\0")
    return [int.from_bytes(data[i : i + 2], "big") for i in range(0, len(data), 2)]


class RegisterBank(ABC):
    """Holding registers `words`, of which the ranges `writable`, as (first, count), can be written."""

    words: list[int]
    writable: tuple[tuple[int, int], ...]

    @abstractmethod
    def refresh(self) -> None:
        """Update the status, position and rate registers."""

    def read(self, address: int, count: int) -> list[int]:
        """Return the current content of registers. Raises NoSuchRegister."""
        if not 0 < count <= len(self.words) - address:
            raise NoSuchRegister
        self.refresh()
        return self.words[address : address + count]

    def write(self, address: int, values: list[int]) -> None:
        """Execute a write request. Raises `machine.Refusal`, without storing anything, if it is refused."""
        written = slice(address, address + len(values))
        if not {first + i for first, count in self.writable for i in range(count)}.issuperset(
            range(*written.indices(1 << 16))
        ):
            raise NoSuchRegister
        before = self.words[written]
        self.words[written] = values
        try:
            self._execute(range(address, address + len(values)))
        except Refusal:
            self.words[written] = before
            raise

    @abstractmethod
    def _execute(self, written: range) -> None:
        """Execute the commands in these registers. Raises `machine.Refusal`."""


class TableRegisters(RegisterBank):
    """Applies reads and writes of the register map to the machine."""

    writable = ((CONTROL, 1), (WATCHDOG, 3), *((j + TARGET, 6) for j in JOINTS))

    def __init__(self, machine: TableMachine, clocks: Clocks, model: str, serial: str) -> None:
        self._machine, self._clocks = machine, clocks
        self.words = [0] * SIZE
        self.words[MODEL_AT : MODEL_AT + 2 * TEXT_WORDS] = text_words(model) + text_words(serial)
        self.words[WATCHDOG] = round(machine.watchdog * 1000.0)
        for joint, first in enumerate(JOINTS):
            self._put(first + LOW, machine.limits.low[joint] / _ANGLE)
            self._put(first + HIGH, machine.limits.high[joint] / _ANGLE)
            self._put(first + TARGET_RATE, np.deg2rad(10.0) / _SPEED)
            self._put(first + TARGET_ACCELERATION, np.deg2rad(20.0) / _SPEED)

    def refresh(self) -> None:
        """Update the status, position and rate registers."""
        machine, time = self._machine, self._clocks.device()
        machine.watch(self._clocks.host(), time)
        self.words[STATUS] = machine.statusword(time)
        self.words[FAULT] = int(machine.fault)
        self.words[INTERLOCK] = int(machine.interlock_closed)
        taken = self._clocks.reading()
        positions, rates = machine.positions(taken), machine.drive.states(taken)[:, 1]
        for joint, first in enumerate(JOINTS):
            self._put(first + POSITION, positions[joint] / _ANGLE)
            self._put(first + RATE, rates[joint] / _SPEED)

    def _execute(self, written: range) -> None:
        machine, time, host_time = self._machine, self._clocks.device(), self._clocks.host()
        machine.watch(host_time, time)
        if CONTROL in written:
            machine.control(self.words[CONTROL], time, host_time)
        if WATCHDOG in written:
            machine.watchdog = self.words[WATCHDOG] / 1000.0
        if HEARTBEAT in written:
            machine.feed(host_time)
        if COMMAND in written:
            self._command(self.words[COMMAND], time)
        self.words[COMMAND] = 0

    def _command(self, command: int, time: float) -> None:
        if command in (MOVE, TURN):
            outer, inner = (
                (
                    self._get(first + TARGET) * _ANGLE,
                    self._get(first + TARGET_RATE) * _SPEED,
                    self._get(first + TARGET_ACCELERATION) * _SPEED,
                )
                for first in JOINTS
            )
            targets, rates, accelerations = zip(outer, inner, strict=True)
            if command == MOVE:
                self._machine.move(time, targets, rates, accelerations)
            else:
                self._machine.turn(time, rates, accelerations)
        elif command == STOP:
            self._machine.stop(time)
        elif command == HOME:
            self._machine.home(time)
        elif command != 0:
            raise OutOfRange

    def _put(self, address: int, value: float) -> None:
        whole = int(np.clip(round(value), -(2**31), 2**31 - 1))
        self.words[address : address + 2] = struct.unpack(">HH", struct.pack(">i", whole))

    def _get(self, address: int) -> int:
        value: int = struct.unpack(">i", struct.pack(">HH", *self.words[address : address + 2]))[0]
        return value
