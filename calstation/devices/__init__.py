"""Tables and IMUs: profiles, links, codecs and drivers.

No driver decides whether a motion is allowed; the sequencer does.
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
