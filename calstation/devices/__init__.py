"""Profiles, links, codecs and drivers of tables, chambers and IMUs. No driver decides whether a motion is allowed.

A new IMU protocol consists of `profiles/imu_protocols/NAME.py` (section), `imu/drivers/NAME.py` (driver) and
`bench/imu/units/NAME.py` (simulated unit); `docs/how-to/extend.md` lists its other files. A Modbus map needs no code,
only `[registers]` in `data/tables/*.toml` or `[[registers]]` in `data/imus/*.toml`. The safe stop is `safe_stop` in
`sequencer/guard.py`, which calls `stop` and `disable` of the table's driver.
"""

from calstation.devices.interfaces import (
    LOCAL_CONTROL,
    UNKNOWN_FAULT,
    Chamber,
    ChamberStatus,
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
    latched_fault_error,
)
