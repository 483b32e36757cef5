"""Tables and IMUs: profiles, links, codecs and drivers. No driver decides whether a motion is allowed.

A new IMU protocol: `profiles/imu_protocols/NAME.py` (section) and `imu/drivers/NAME.py` (driver).
A Modbus map: `[registers]` in `data/tables/*.toml` and `[[registers]]` in `data/imus/*.toml`; no code.
From STOP to axes off: `safe_stop` in `sequencer/guard.py` calls `stop` and `disable` of the table's driver in `table`.
"""

from calstation.devices.interfaces import (
    LOCAL_CONTROL,
    UNKNOWN_FAULT,
    Gimbal,
    Imu,
    ImuIdentity,
    LinkStats,
    NoFramesError,
    OtherModelError,
    SampleBatch,
    Table,
    TableIdentity,
    TableStatus,
)
