"""Table drivers: Modbus registers, text commands, an indexing unit, and a manual rig.

The drivers execute commands; motion limits are checked before a command is given.
"""

from calstation.devices.table.drivers import ManualTable, open_table
from calstation.devices.table.gimbal_table import GimbalTable
from calstation.devices.table.modbus_table import ModbusTable
from calstation.devices.table.register_table import RegisterTable
from calstation.devices.table.shared_table import SharedTable
from calstation.devices.table.text_table import TextTable
