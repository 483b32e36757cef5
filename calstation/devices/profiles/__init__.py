"""Data models of profile files; `docs/reference/profiles.md` explains every entry.

The models of Modbus maps are in `table_registers` for `[registers]` of a table (`data/tables`), and in `registers` for
`[[registers]]` of an IMU (`data/imus`). A new IMU protocol needs a module in `imu_protocols`, with its section, and a
driver in `imu/drivers`; `docs/how-to/extend.md` lists all files.
"""

from calstation.devices.profiles.chamber import (
    ChamberModbusSection,
    ChamberProfile,
    ChamberTextSection,
    load_chamber_profile,
)
from calstation.devices.profiles.entries import SerialSettings, hex_bytes
from calstation.devices.profiles.frame import (
    CHANNELS,
    STATUS_WORDS,
    ChannelRange,
    CrcSection,
    FrameField,
    FrameSection,
    channel_range,
)
from calstation.devices.profiles.imu import ImuProfile, StatusSection, check_baud, load_imu_profile
from calstation.devices.profiles.imu_protocols import PROTOCOLS, ImuProtocol
from calstation.devices.profiles.registers import RegisterEntry
from calstation.devices.profiles.table import ImuLinkSection, ModbusSection, TableProfile, load_table_profile
from calstation.devices.profiles.table_registers import JOINTS, ModbusRegister, StatusBit
from calstation.devices.profiles.text import CheckedLines, Flag, GimbalSection, LineSection, TextSection
