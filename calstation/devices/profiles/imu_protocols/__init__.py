"""Command protocols of IMUs; each module has the name of its protocol in profiles and assigns a class to `PROTOCOL`.

The class contains the entries and rules of the protocol's section; the driver is in `imu.drivers`.
`docs/how-to/extend.md` explains how to add a protocol.
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
