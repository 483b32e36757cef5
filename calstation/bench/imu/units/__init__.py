"""Simulated units; each module has the name of its protocol in profiles and assigns the class of its unit to `UNIT`.

The package `bench.imu` contains the code common to all units; `docs/how-to/extend.md` explains how to add a unit.
"""

from importlib import import_module

from calstation.bench.config import IMU_PROTOCOLS
from calstation.bench.imu.unit import ImuUnit

#: Classes of all units by protocol.
UNITS: dict[str, type[ImuUnit]] = {name: import_module(f"{__name__}.{name}").UNIT for name in IMU_PROTOCOLS}
