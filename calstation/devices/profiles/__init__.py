"""Data models of profile files, validated as a whole; `docs/reference/profiles.md` explains every entry.

A Modbus map is data: `[registers]` of a table (`data/tables`, model in `table_registers`) or `[[registers]]` of an IMU
(`data/imus`, `registers`). A new IMU protocol is a module in `imu_protocols`; the files are found by `config`.
"""

from calstation.devices.profiles.entries import SerialSettings, hex_bytes
from calstation.devices.profiles.frame import CHANNELS, STATUS_WORDS, CrcSection, FrameField, FrameSection, Span, span
from calstation.devices.profiles.imu import ImuProfile, StatusSection, check_baud, load_imu_profile
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
from calstation.devices.profiles.registers import RegisterEntry
from calstation.devices.profiles.table import ImuLinkSection, ModbusSection, TableProfile, load_table_profile
from calstation.devices.profiles.table_registers import JOINTS, ModbusRegister, StatusBit
from calstation.devices.profiles.text import CheckedLines, Flag, GimbalSection, TextSection
