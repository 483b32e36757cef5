"""Independent control of the table's two joints for controllers without a watchdog."""

from enum import IntFlag

import numpy as np

from calstation.bench.table.machine import Clocks, Fault, Power, TableMachine

#: Default rate and acceleration of a motion, rad/s and rad/s².
_RATE, _ACCELERATION = np.deg2rad(10.0), np.deg2rad(20.0)


class StateBit(IntFlag):
    """State bits of an axis."""

    ENABLED = 1
    HOMED = 2
    MOVING = 4
    SETTLED = 8
    FAULT = 16
    CLOSED = 32
    REMOTE = 64


def state_bits(machine: TableMachine, time: float) -> StateBit:
    """Return the state bits of a machine at device time `time`, s, without `REMOTE`."""
    state = StateBit.SETTLED if machine.settled(time) else StateBit.MOVING
    state |= StateBit.ENABLED if machine.power is Power.ENABLED else 0
    state |= StateBit.HOMED if machine.homed else 0
    state |= StateBit.FAULT if machine.fault is not Fault.NONE else 0
    return state | (StateBit.CLOSED if machine.interlock_closed else 0)


class Axes:
    """Joints 0 (outer) and 1 (inner), which are commanded in rad and read in degrees; `on` are their power states."""

    def __init__(self, machine: TableMachine, clocks: Clocks) -> None:
        machine.watchdog = 0.0
        self.machine, self.clocks = machine, clocks
        self.on = [False, False]
        self.rates = [_RATE, _RATE]
        self.accelerations = [_ACCELERATION, _ACCELERATION]
        self.targets = [0.0, 0.0]

    def power(self, joint: int, on: bool) -> None:
        """Switch an axis on or off; the machine is enabled when both axes are on."""
        self.on[joint] = on
        for word in (0x06, 0x07, 0x0F) if all(self.on) else (0x06,):
            self.machine.control(word, self.clocks.device(), self.clocks.host())

    def home(self) -> None:
        """Home both axes unless they are homed or moving. Raises a `Refusal`."""
        if not self.machine.homed and self.clocks.device() >= self.machine.drive.end:
            self.machine.home(self.clocks.device())

    def move(self, joint: int) -> None:
        """Start moving an axis to its target. Raises a `Refusal`."""
        rate, acceleration = self.rates[joint], self.accelerations[joint]
        self.machine.move_joint(self.clocks.device(), joint, self.targets[joint], rate, acceleration)

    def turn(self, joint: int, rate: float) -> None:
        """Turn an axis at a rate, rad/s, until it is stopped; a rate of 0 stops both axes. Raises a `Refusal`."""
        if rate == 0.0:
            self.stop()
        else:
            self.machine.turn_joint(self.clocks.device(), joint, rate, self.accelerations[joint])

    def stop(self) -> None:
        """Decelerate both axes to rest."""
        self.machine.stop(self.clocks.device())

    def reset(self) -> None:
        """Clear a latched fault; the axes stay off."""
        self.on = [False, False]
        for word in (0x00, 0x80, 0x00):
            self.machine.control(word, self.clocks.device(), self.clocks.host())

    def state(self) -> int:
        """Return the state bits of both axes; see `StateBit`."""
        return int(StateBit.REMOTE | state_bits(self.machine, self.clocks.device()))

    @property
    def fault(self) -> int:
        """Code of the latched fault; 0 without a fault."""
        return int(self.machine.fault)

    def position(self, joint: int) -> float:
        """Return the encoder angle, degrees."""
        return float(np.rad2deg(self.machine.positions(self.clocks.reading())[joint]))

    def speed(self, joint: int) -> float:
        """Return the rate, °/s."""
        return float(np.rad2deg(self.machine.drive.states(self.clocks.reading())[joint, 1]))
