"""Serial, UDP, CAN, Modbus and text links, which have a time limit for every exchange with the device."""

from calstation.devices.links.dialogue import Dialogue, Refusal, Transaction
from calstation.devices.links.message_links import CAN, UDP, Link, can_port, open_link, udp_address
from calstation.devices.links.modbus_link import (
    ACKNOWLEDGED,
    BUSY_EXCEPTIONS,
    ModbusLink,
    ModbusRefusalError,
    NoAnswerError,
)
from calstation.devices.links.modbus_rtu import RtuReply, RtuRequest
from calstation.devices.links.serial_link import (
    SOCKETS,
    Device,
    PortLostError,
    SerialLink,
    SerialPortInfo,
    diagnose_port,
    host_and_port,
    list_serial_ports,
    port_device,
    with_connection_reason,
)
from calstation.devices.links.text_link import TextLink, TextRefusalError, UnexpectedReplyError, text_number
