"""Opens and identifies devices, tests links and locks ports; the devices of a virtual bench are opened by the bench.

Protocols are implemented in `devices`, motion in `sequencer`.
"""

from calstation.connection.capture import import_capture
from calstation.connection.compatibility import incompatibilities, station_conflicts
from calstation.connection.devices import Devices, Endpoints, RealClock, StationBench, connected
from calstation.connection.imu_session import ImuSession, capture_rest, open_imu_session
from calstation.connection.line_server import LineServer
from calstation.connection.link_test import (
    FoundPort,
    LinkTestRequest,
    check_imu_link,
    check_table_link,
    discover_ports,
    link_test_configuration,
)
from calstation.connection.live_imu import SECONDS, OtherUnit, apply_to_unit, read_unit
from calstation.connection.live_pair import LivePair, open_pair
from calstation.connection.pair_process import PairProcess, PairStatus
from calstation.connection.table_reset import TableReset, TableState, read_table, reset_table
