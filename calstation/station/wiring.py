"""Opens the devices of a station, or of its virtual bench, and closes them in the right order."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass

from calstation.devices.framed_imu import FramedImu
from calstation.devices.imu_profile import ImuProfile
from calstation.devices.link import SerialLink
from calstation.devices.modbus_table import ModbusTable
from calstation.devices.table_profile import TableProfile
from calstation.sequencer.ports import Clock
from calstation.station.bench_host import BenchHost
from calstation.station.clock import BenchClock, RealClock
from calstation.station.setup import Setup


@dataclass(frozen=True)
class Devices:
    """Open devices and the clock that they live by."""

    table: ModbusTable
    imu: FramedImu
    clock: Clock


@contextmanager
def connected(setup: Setup) -> Iterator[Devices]:
    """Open clock, table and IMU; close them on the way out. Raises DeviceFaultError or ConfigurationError."""
    with ExitStack() as stack:
        table_port, imu_port = setup.station.table.port, setup.station.imu.port
        clock: RealClock | BenchClock = RealClock()
        config = setup.bench_config()
        if config is not None:
            endpoints = stack.enter_context(BenchHost.start(config)).endpoints
            host, _, port = endpoints["clock"].rpartition(":")
            clock = BenchClock((host, int(port)), float(config.get("speed", 0.0)))
            stack.callback(clock.close)
            over_tcp = endpoints["table_transport"] == "tcp"
            table_port = f"tcp://{endpoints['table']}" if over_tcp else endpoints["table"]
            imu_port = endpoints["imu"]
        assert table_port is not None
        assert imu_port is not None
        table = ModbusTable(table_port, _table_profile(setup), setup.station.table.serial)
        stack.callback(table.close)
        profile = _imu_profile(setup)
        imu = FramedImu(SerialLink(imu_port, setup.station.imu.serial or profile.link, "IMU"), profile)
        stack.callback(imu.close)
        imu.start()
        if isinstance(clock, BenchClock):
            clock.attach(lambda: imu.received)
        yield Devices(table, imu, clock)


def _table_profile(setup: Setup) -> TableProfile:
    """The table's profile with this place's timeout."""
    timeout = setup.station.table.timeout_s
    if timeout is None:
        return setup.table
    modbus = setup.table.modbus.model_copy(update={"timeout_s": timeout})
    return setup.table.model_copy(update={"modbus": modbus})


def _imu_profile(setup: Setup) -> ImuProfile:
    """The IMU's profile with this place's timeout."""
    timeout = setup.station.imu.timeout_s
    if timeout is None:
        return setup.imu
    commands = setup.imu.commands.model_copy(update={"timeout_s": timeout})
    return setup.imu.model_copy(update={"commands": commands})
