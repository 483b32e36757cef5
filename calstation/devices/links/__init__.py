"""Serial, Modbus and text links with a time limit for every exchange.

A link does not interpret the data that it transfers.
"""

from calstation.devices.links.dialogue import Dialogue, Question, Refusal
from calstation.devices.links.modbus_link import ACKNOWLEDGED, NOT_YET, ModbusLink, ModbusRefusalError, NoAnswerError
from calstation.devices.links.modbus_rtu import RtuReply, RtuRequest
from calstation.devices.links.serial_link import SOCKETS, PortLostError, SerialLink, explained, host_and_port, why_not
from calstation.devices.links.serial_ports import FoundPort, found_ports, resolve
from calstation.devices.links.text_link import TextLink, TextRefusalError, UnlikeAnswerError
