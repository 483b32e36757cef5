"""Driver of a gimbal with text commands as defined in its profile."""

from dataclasses import replace

import numpy as np

from calstation.devices.interfaces import Gimbal, TableStatus
from calstation.devices.profiles import GimbalSection, SerialSettings, TableProfile
from calstation.devices.table.text_table import TextTable
from calstation.errors import ConfigurationError


class GimbalTable(TextTable, Gimbal):
    """Driver of a gimbal on a serial port or `tcp://host:port`; it is commanded in turns, not in moves to angles."""

    def __init__(self, port: str, profile: TableProfile, serial: SerialSettings | None = None) -> None:
        super().__init__(port, profile, serial)
        self._section = profile.section_of(GimbalSection)

    def status(self) -> TableStatus:
        """Poll the state; the angles of a two-axis table are NaN."""
        status = super().status()
        unknown = np.full(2, np.nan)
        return replace(status, angles=unknown, rates=unknown, joints=status.angles, joint_rates=status.rates)

    def home(self) -> None:
        """Return to zero; unlike homing of a table it may be repeated."""
        self._send("home")

    def lock(self) -> None:
        self._send("lock")

    def stabilise(self) -> None:
        self._send("stabilise")

    def turn(self, axis: int, angle: float, rate: float) -> None:
        """Start a turn; a lost reply is a fault and never causes a second turn."""
        self._still = 0
        values = {"angle": self._number(float(np.rad2deg(angle))), "rate": self._number(float(np.rad2deg(rate)))}
        for line in self._section.commands.turn:
            self._link.command(line.format(axis=self._section.axes[axis], **values), repeat=False)

    def move(self, outer: float, inner: float, rate: float, acceleration: float) -> None:
        raise ConfigurationError("table.gimbal_cannot_move", profile=self._profile.name)

    def rate(self, outer: float, inner: float, acceleration: float) -> None:
        raise ConfigurationError("table.gimbal_cannot_move", profile=self._profile.name)
