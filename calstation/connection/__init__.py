"""Opening and identification of devices, link tests, and port locks.

Protocols are in `devices`, and motion is in `sequencer`. A virtual bench supplies its ports through `StationBench`.
"""

from calstation.connection.capture import import_capture
from calstation.connection.compatibility import incompatibilities, station_conflicts
from calstation.connection.devices import Devices, Endpoints, RealClock, StationBench, open_devices
from calstation.connection.imu_session import (
    SECONDS,
    ImuSession,
    OtherUnit,
    apply_to_unit,
    capture_rest,
    open_imu_session,
    read_unit,
)
from calstation.connection.line_server import LineServer
from calstation.connection.link_test import (
    LinkTestRequest,
    SerialPortInfo,
    check_chamber_link,
    check_imu_link,
    check_table_link,
    discover_ports,
    link_test_configuration,
)
from calstation.connection.live_pair import LivePair, open_pair
from calstation.connection.pair_process import PairProcess, PairStatus
from calstation.connection.port_lock import PortLockError, PortOwner, find_station_owner, station_owner
from calstation.connection.table_reset import TableReset, TableState, read_table, reset_table
