"""Command protocols of IMUs; each module has the name of its protocol in profiles and assigns a class to `PROTOCOL`.

The class contains the entries and rules of the protocol's section; the driver is in the module of the same name in
`imu.drivers`, which is the only one that imports the protocol's module.
`docs/how-to/extend.md` explains how to add a protocol.
"""

from importlib import import_module
from pkgutil import iter_modules

from calstation.devices.profiles.imu_protocols.base import ImuProtocol

#: Classes of all protocols by name.
PROTOCOLS: dict[str, type[ImuProtocol]] = {
    module.name: import_module(f"{__name__}.{module.name}").PROTOCOL
    for module in iter_modules(__path__)
    if module.name != "base"
}
