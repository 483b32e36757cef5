"""Table drivers for Modbus registers, text commands, an indexing unit, and a manual rig.

The drivers do not check motion limits; the sequencer checks them before every command.
"""

from calstation.devices.table.drivers import ManualTable, open_table
from calstation.devices.table.register_table import ModbusTable, RegisterTable, SharedTable
from calstation.devices.table.text_table import TextTable
