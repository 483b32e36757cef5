"""The table's two joints, one by one, for controllers without a watchdog."""

from enum import IntFlag

import numpy as np

from calstation.bench.table.machine import Clocks, Fault, Power, TableMachine

#: Default rate and acceleration of a motion, rad/s and rad/s².
_RATE, _ACCELERATION = np.deg2rad(10.0), np.deg2rad(20.0)


class StateBit(IntFlag):
    """Bits of an axis's state."""

    ENABLED = 1
    HOMED = 2
    MOVING = 4
    SETTLED = 8
    FAULT = 16
    CLOSED = 32
    REMOTE = 64


class Axes:
    """The joints of a machine; commands in rad, readings in degrees."""

    def __init__(self, machine: TableMachine, clocks: Clocks) -> None:
        machine.watchdog = 0.0
        self._machine, self._clocks = machine, clocks
        self._wanted = [False, False]
        self.rates = [_RATE, _RATE]
        self.accelerations = [_ACCELERATION, _ACCELERATION]
        self.targets = [0.0, 0.0]

    def know_zero(self) -> None:
        """Treat the encoders as absolute."""
        self._machine.know_zero()

    def power(self, joint: int, on: bool) -> None:
        """Switch an axis; the machine is enabled once both are on."""
        self._wanted[joint] = on
        for word in (0x06, 0x07, 0x0F) if all(self._wanted) else (0x06,):
            self._control(word)

    def wanted(self, joint: int) -> bool:
        """Whether an axis was switched on."""
        return self._wanted[joint]

    def home(self) -> None:
        """Home both axes unless they are homed or moving."""
        if not self._machine.homed and self._clocks.device() >= self._machine.drive.end:
            self._machine.home(self._clocks.device())

    def move(self, joint: int) -> None:
        """Start an axis towards its target."""
        rate, acceleration = self.rates[joint], self.accelerations[joint]
        self._machine.move_joint(self._clocks.device(), joint, self.targets[joint], rate, acceleration)

    def turn(self, joint: int, rate: float) -> None:
        """Turn an axis at a rate, rad/s, until it is stopped; a rate of 0 stops it."""
        if rate == 0.0:
            self.stop()
        else:
            self._machine.turn_joint(self._clocks.device(), joint, rate, self.accelerations[joint])

    def stop(self) -> None:
        """Both axes decelerate to rest."""
        self._machine.stop(self._clocks.device())

    def reset(self) -> None:
        """Clear a latched fault; the axes stay off."""
        self._wanted = [False, False]
        for word in (0x00, 0x80, 0x00):
            self._control(word)

    def state(self, joint: int) -> int:
        """Bits of an axis, see `StateBit`."""
        machine = self._machine
        state = StateBit.REMOTE
        state |= StateBit.SETTLED if machine.settled(self._clocks.device()) else StateBit.MOVING
        if machine.power is Power.ENABLED:
            state |= StateBit.ENABLED
        if machine.homed:
            state |= StateBit.HOMED
        if machine.fault is not Fault.NONE:
            state |= StateBit.FAULT
        if machine.interlock_closed:
            state |= StateBit.CLOSED
        return int(state)

    @property
    def fault(self) -> int:
        """Code of the latched fault; 0 without a fault."""
        return int(self._machine.fault)

    def position(self, joint: int) -> float:
        """Encoder angle, degrees."""
        return float(np.rad2deg(self._machine.positions(self._clocks.reading())[joint]))

    def speed(self, joint: int) -> float:
        """Rate, °/s."""
        return float(np.rad2deg(self._machine.drive.states(self._clocks.reading())[joint, 1]))

    def travel(self, joint: int) -> tuple[float, float]:
        """Ends of the travel, degrees."""
        limits = self._machine.limits
        return float(np.rad2deg(limits.low[joint])), float(np.rad2deg(limits.high[joint]))

    def fastest(self) -> tuple[float, float]:
        """Largest rate and acceleration, °/s and °/s²."""
        limits = self._machine.limits
        return float(np.rad2deg(limits.rate)), float(np.rad2deg(limits.acceleration))

    def _control(self, word: int) -> None:
        self._machine.control(word, self._clocks.device(), self._clocks.host())
