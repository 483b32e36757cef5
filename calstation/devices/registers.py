"""The register map of a profile: parameters in SI to register values and back."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from calstation.devices.imu_profile import RegisterEntry
from calstation.errors import DeviceFaultError


@dataclass(frozen=True)
class RegisterMap:
    """Entries of a profile, by rising address, none overlapping."""

    entries: tuple[RegisterEntry, ...]

    @property
    def parameters(self) -> tuple[str, ...]:
        """Contract names of all parameters that have a register."""
        return tuple(name for entry in self.entries for name in entry.parameters if name)

    def encode(self, values: Mapping[str, float]) -> dict[int, list[float]]:
        """Register values of every entry by its address, as float32 would hold them.

        Parameters
        ----------
        values : SI by contract name; must have every parameter of the map, others are left aside

        Raises
        ------
        DeviceFaultError
            for a value that does not fit its register.
        """
        encoded = {}
        for entry in self.entries:
            row = []
            for i, name in enumerate(entry.parameters):
                value = values[name] if name else 0.0
                low, high = entry.range
                # Compared as float32, so that a value at the edge still fits when read back.
                if name and not np.float32(low) <= np.float32(value) <= np.float32(high):
                    raise DeviceFaultError(
                        f"IMU: {name} = {value:.6g} does not fit register {entry.address + i}"
                        f" ({low:g} to {high:g}); nothing was written"
                    )
                row.append(float(np.float32(value / entry.scale)))
            encoded[entry.address] = row
        return encoded

    def decode(self, registers: Mapping[int, list[float]]) -> dict[str, float]:
        """Parameters in SI from register values by the entries' addresses."""
        return {
            name: registers[entry.address][i] * entry.scale
            for entry in self.entries
            for i, name in enumerate(entry.parameters)
            if name
        }

    def rounded(self, values: Mapping[str, float]) -> dict[str, float]:
        """The values that the registers will hold, SI; raises DeviceFaultError as `encode`."""
        return self.decode(self.encode(values))

    def address(self, name: str) -> int:
        """Register of a parameter."""
        for entry in self.entries:
            if name in entry.parameters:
                return entry.address + entry.parameters.index(name)
        raise KeyError(name)
