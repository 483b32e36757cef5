"""Simulated units: the module of a protocol has the protocol's name in profiles and a class `UNIT`.

The package `bench.imu` contains their common parts; `docs/how-to/extend.md` explains how to add a unit.
"""

from importlib import import_module

from calstation.bench.config import IMU_PROTOCOLS
from calstation.bench.imu.unit import ImuUnit

#: Classes of all units by protocol.
UNITS: dict[str, type[ImuUnit]] = {name: import_module(f"{__name__}.{name}").UNIT for name in IMU_PROTOCOLS}
