from .clock import ClockLink as ClockLink
from .lines import SocketLine as SocketLine
from .lines import TableLine as TableLine
from .lines import TerminalLine as TerminalLine
from .table_modbus import UNIT as UNIT
from .table_modbus import TableLink as TableLink
