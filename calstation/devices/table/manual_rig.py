"""A manual rig as a table that nobody drives: rails that the operator turns, without motor, encoder or link.

It takes the place of a table wherever a run asks for one: it is always at rest as far as anything here could move it,
its angles are not known, and whoever asks it to move has chosen the wrong station.
"""

import math

import numpy as np

from calstation.devices.interfaces import TableIdentity, TableStatus
from calstation.devices.profiles.table import TableProfile
from calstation.errors import ConfigurationError


class ManualTable:
    """The rig of a profile with `protocol = "hand"`; meets `interfaces.Table`."""

    def __init__(self, profile: TableProfile) -> None:
        self._profile = profile
        nowhere = np.full(2, np.nan)
        self._status = TableStatus(
            angles=nowhere,
            rates=nowhere,
            enabled=True,
            homed=True,
            moving=False,
            settled=True,
            fault=None,
            interlock_closed=True,
            watchdog=math.inf,  # nothing can move by itself
            limits=profile.geometry().limits,
        )

    def identify(self) -> TableIdentity:
        """What the profile calls it; it cannot say it itself."""
        return TableIdentity(self._profile.model, "by hand")

    def status(self) -> TableStatus:
        """Angles not known, nothing moving."""
        return self._status

    def enable(self) -> None:
        """It has no axes to switch on."""

    def disable(self) -> None:
        """Nor to switch off."""

    def home(self) -> None:
        """Nor a reference to look for."""

    def move(self, outer: float, inner: float, rate: float, acceleration: float) -> None:
        """Raises ConfigurationError."""
        raise self._refusal()

    def rate(self, outer: float, inner: float, acceleration: float) -> None:
        """Raises ConfigurationError."""
        raise self._refusal()

    def stop(self) -> None:
        """It is at rest as far as it could be stopped."""

    def reset_fault(self) -> None:
        """It has none."""

    def heartbeat(self) -> None:
        """It has no watchdog."""

    def close(self) -> None:
        """It has no link."""

    def _refusal(self) -> ConfigurationError:
        return ConfigurationError(
            f"table: '{self._profile.name}' is turned by hand and cannot be driven; choose a station with a table, or"
            " stages that are carried by hand"
        )
