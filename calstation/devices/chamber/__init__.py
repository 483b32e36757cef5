"""Chamber drivers for text commands and Modbus registers, which their profiles define.

The drivers do not check temperatures; the sequencer's `ChamberControl` checks them before every set point.
"""

from calstation.devices.chamber.drivers import ModbusChamber, TextChamber, open_chamber
