from .lines import Line as Line
from .lines import SocketLine as SocketLine
from .lines import TerminalLine as TerminalLine
from .table_modbus import UNIT as UNIT
from .table_modbus import TableLink as TableLink
