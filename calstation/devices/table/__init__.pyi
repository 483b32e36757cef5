from .drivers import ManualTable as ManualTable
from .drivers import open_table as open_table
from .gimbal_table import GimbalTable as GimbalTable
from .modbus_table import ModbusTable as ModbusTable
from .register_table import RegisterTable as RegisterTable
from .shared_table import SharedTable as SharedTable
from .text_table import TextTable as TextTable
