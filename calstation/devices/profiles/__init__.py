"""Data models of profile files: frames, registers, limits and accuracy, validated as a whole.

The files are found and edited by `config`.
"""

from calstation.devices.profiles.entries import SerialSettings, hex_bytes
from calstation.devices.profiles.frame import CHANNELS, STATUS_WORDS, CrcSection, FrameField, FrameSection, Span, span
from calstation.devices.profiles.imu import ImuProfile, check_baud, load_imu_profile
from calstation.devices.profiles.imu_protocols import (
    OPS,
    PROTOCOLS,
    FramedProtocol,
    ImuProtocol,
    ModbusProtocol,
    TextRegisters,
    VectorNavProtocol,
    WordCommand,
)
from calstation.devices.profiles.imu_sections import StatusSection
from calstation.devices.profiles.registers import RegisterEntry
from calstation.devices.profiles.table import ImuLinkSection, ModbusSection, TableProfile, load_table_profile
from calstation.devices.profiles.table_registers import JOINTS, ModbusRegister, StatusBit
from calstation.devices.profiles.text import CheckedLines, Flag, GimbalSection, TextSection
