"""Two drives without a watchdog, one for each axis, which are Modbus units with CiA 402 objects.

Values of two registers have the low word first. Positions are in counts of 1e-5 deg, measured and commanded turning
rates are floats in deg/s, and the rates and accelerations of moves are in 1e-4 deg/s and 1e-4 deg/s². The inner drive
is mounted in reverse, so that its counts decrease when the axis turns in the positive direction.
"""

import struct

import numpy as np

from calstation.bench.table.axes import Axes
from calstation.bench.table.machine import Clocks, Fault, Power, TableMachine
from calstation.bench.table.registers import RegisterBank, text_words

#: Modbus unit numbers of the outer and the inner drive.
UNITS = (1, 2)
MODEL = "bench-drive"
SENSE = (1.0, -1.0)

MODEL_AT, SERIAL_AT, TEXT_WORDS = 0, 8, 8
CONTROL, STATUS, ERROR, MODE, STATUS2 = 20, 21, 22, 23, 24
POSITION, VELOCITY, TARGET, PROFILE_VELOCITY, PROFILE_ACCELERATION, TARGET_VELOCITY = 30, 32, 34, 36, 38, 40
LOW, HIGH = 42, 44
SIZE = HIGH + 2

PROFILE_POSITION, PROFILE_VELOCITY_MODE, HOMING = 1, 3, 6
#: Bits of the second status word.
CLOSED, HOMED = 1, 2

_ANGLE = np.deg2rad(1e-5)
_SPEED = np.deg2rad(1e-4)
_NEW_SETPOINT, _RESET = 0x10, 0x80


def drives(machine: TableMachine, clocks: Clocks, serial: str) -> "dict[int, Drive]":
    """Return both drives of a machine by Modbus unit number; each appends a letter to the serial number."""
    axes = Axes(machine, clocks)
    return {UNITS[joint]: Drive(joint, axes, f"{serial}{'AB'[joint]}") for joint in (0, 1)}


class Drive(RegisterBank):
    """Registers of one drive (0 outer, 1 inner)."""

    writable = ((CONTROL, 1), (MODE, 1), (TARGET, 8))

    def __init__(self, joint: int, axes: Axes, serial: str) -> None:
        self._joint, self._sense = joint, SENSE[joint]
        self._axes, self._machine = axes, axes.machine
        self._controlword = 0
        self.words = [0] * SIZE
        self.words[MODEL_AT : SERIAL_AT + TEXT_WORDS] = text_words(MODEL) + text_words(serial)
        self.words[MODE] = PROFILE_POSITION
        ends = sorted(self._sense * end for end in (axes.machine.limits.low[joint], axes.machine.limits.high[joint]))
        for register, end in zip((LOW, HIGH), ends, strict=True):
            self._put(register, struct.pack(">i", round(end / _ANGLE)))
        self._put(PROFILE_VELOCITY, struct.pack(">I", 100_000))
        self._put(PROFILE_ACCELERATION, struct.pack(">I", 200_000))

    def refresh(self) -> None:
        """Update the status, position and rate registers."""
        machine, axes, joint = self._machine, self._axes, self._joint
        self.words[STATUS] = self._statusword()
        self.words[ERROR] = axes.fault
        self.words[STATUS2] = CLOSED * machine.interlock_closed + HOMED * machine.homed
        counts = self._sense * np.deg2rad(axes.position(joint)) / _ANGLE
        self._put(POSITION, struct.pack(">i", round(counts)))
        self._put(VELOCITY, struct.pack(">f", self._sense * axes.speed(joint)))

    def _execute(self, written: range) -> None:
        if CONTROL in written:
            self._control(self.words[CONTROL])
        if MODE in written or TARGET_VELOCITY in written:
            self._turn()

    def _control(self, word: int) -> None:
        rising, self._controlword = word & ~self._controlword, word
        axes, joint = self._axes, self._joint
        if rising & _RESET:
            axes.reset()
        if self._machine.fault is not Fault.NONE:
            return
        on = word & 0x0F == 0x0F
        if on != axes.on[joint]:
            axes.power(joint, on)
        if on and rising & _NEW_SETPOINT:
            self._start()

    def _start(self) -> None:
        if self.words[MODE] == HOMING:
            self._axes.home()
        elif self.words[MODE] == PROFILE_POSITION:
            (target,) = struct.unpack(">i", self._get(TARGET))
            (speed,) = struct.unpack(">I", self._get(PROFILE_VELOCITY))
            self._axes.targets[self._joint] = self._sense * target * _ANGLE
            self._axes.rates[self._joint] = speed * _SPEED
            self._accelerate()
            self._axes.move(self._joint)

    def _turn(self) -> None:
        """Turn at the commanded rate if the drive is enabled and in velocity mode."""
        if self.words[MODE] != PROFILE_VELOCITY_MODE or self._machine.power is not Power.ENABLED:
            return
        (speed,) = struct.unpack(">f", self._get(TARGET_VELOCITY))
        self._accelerate()
        self._axes.turn(self._joint, self._sense * float(np.deg2rad(speed)))

    def _accelerate(self) -> None:
        (acceleration,) = struct.unpack(">I", self._get(PROFILE_ACCELERATION))
        self._axes.accelerations[self._joint] = acceleration * _SPEED

    def _statusword(self) -> int:
        """Return the machine's statusword with the power state of this drive (CiA 402-2, table 29)."""
        word = self._machine.statusword(self._axes.clocks.device())
        if self._machine.fault is Fault.NONE:
            word = word & ~0x6F | (Power.ENABLED if self._axes.on[self._joint] else Power.READY).value
        return word

    def _put(self, address: int, value: bytes) -> None:
        high, low = struct.unpack(">HH", value)
        self.words[address : address + 2] = [low, high]

    def _get(self, address: int) -> bytes:
        low, high = self.words[address : address + 2]
        return struct.pack(">HH", high, low)
