"""Command protocols of IMUs, one module with a class `PROTOCOL` per protocol, under its name in profiles.

A module has the entries of the protocol's section and its checks; the driver is in `imu.drivers`.
`docs/how-to/extend.md` explains how to add one.
"""

from importlib import import_module
from pkgutil import iter_modules

from calstation.devices.profiles.imu_protocols.base import ImuProtocol
from calstation.devices.profiles.imu_protocols.framed import OPS, FramedProtocol
from calstation.devices.profiles.imu_protocols.modbus import ModbusProtocol, TextRegisters, WordCommand
from calstation.devices.profiles.imu_protocols.vectornav import VectorNavProtocol

#: Classes of all protocols by name.
PROTOCOLS: dict[str, type[ImuProtocol]] = {
    module.name: import_module(f"{__name__}.{module.name}").PROTOCOL
    for module in iter_modules(__path__)
    if module.name != "base"
}
