"""Simulated units, one module with a class `UNIT` per protocol, under its name in profiles.

What they have in common is in `bench.imu`; `docs/how-to/extend.md` explains how to add one.
"""

from importlib import import_module

from calstation.bench.config import IMU_PROTOCOLS
from calstation.bench.imu.unit import ImuUnit

#: Classes of all units by protocol.
UNITS: dict[str, type[ImuUnit]] = {name: import_module(f"{__name__}.{name}").UNIT for name in IMU_PROTOCOLS}
