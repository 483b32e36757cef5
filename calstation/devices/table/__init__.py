"""Table drivers: Modbus registers, text commands, an indexing unit, and a manual rig.

The drivers execute commands; motion limits are checked before a command is given.
"""

from calstation.devices.table.drivers import ManualTable, open_table
from calstation.devices.table.register_table import ModbusTable, RegisterTable, SharedTable
from calstation.devices.table.text_table import TextTable
