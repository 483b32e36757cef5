"""Servers and serial lines through which the station communicates with the bench."""

from calstation.bench.links.lines import Line, SocketLine, TerminalLine
from calstation.bench.links.modbus import ModbusServer, NoReply
