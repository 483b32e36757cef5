"""Opens the devices of a station, or of its virtual bench, and closes them in the right order."""

import os
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass

from calstation.config.resolved import ResolvedConfiguration
from calstation.connection.bench_process import BenchHost
from calstation.connection.clock import BenchClock, RealClock
from calstation.connection.identify import LinkSettings, identify
from calstation.connection.port_lock import owned
from calstation.devices.imu.drivers import open_imu as imu_on
from calstation.devices.imu.streamed_imu import StreamedImu
from calstation.devices.links.opening import explained
from calstation.devices.links.serial_link import SerialLink
from calstation.devices.links.serial_ports import resolve
from calstation.devices.profiles.imu import ImuProfile
from calstation.devices.profiles.serial_settings import SerialSettings
from calstation.devices.profiles.table import TableProfile
from calstation.devices.table.drivers import ManualTable
from calstation.devices.table.drivers import open_table as table_on
from calstation.devices.table.register_table import RegisterTable
from calstation.devices.table.shared_table import SharedTable
from calstation.devices.table.text_table import TextTable
from calstation.errors import ConfigurationError, DeviceFaultError
from calstation.sequencer.context import Clock


@dataclass(frozen=True)
class Devices:
    """Open devices and the clock that they live by."""

    table: RegisterTable | TextTable | ManualTable
    imu: StreamedImu
    clock: Clock


@dataclass(frozen=True)
class Endpoints:
    """Where table and IMU are to be found, and the clock that they live by; rails turned by hand are nowhere: ""."""

    table: str
    imu: str
    clock: RealClock | BenchClock


@contextmanager
def connected(
    setup: ResolvedConfiguration, check_cancelled: Callable[[], None] = lambda: None
) -> Iterator[Devices]:
    """Open clock, table and IMU, which have said who they are; close them on the way out.

    Raises DeviceFaultError or ConfigurationError.

    hear : called while that takes its time, may raise
    """
    with ExitStack() as stack:
        at = stack.enter_context(endpoints(setup, check_cancelled))
        check_cancelled()
        if _shared(setup):
            imu = open_imu(setup, at.imu)
            stack.callback(imu.close)
            table: RegisterTable | TextTable | ManualTable = SharedTable(imu, table_profile(setup))
        elif setup.table.by_hand:
            imu = open_imu(setup, at.imu)
            stack.callback(imu.close)
            table = ManualTable(setup.table)
        else:
            table = open_table(setup, at.table)
            stack.callback(table.close)
            imu = open_imu(setup, at.imu)
            stack.callback(imu.close)
        if not setup.table.by_hand:
            # Before anything else: not even a stop may be written to what may be no table at all.
            identify(table, imu, wires(setup, at.table, at.imu), check_cancelled)
        imu.start()
        if isinstance(at.clock, BenchClock):
            at.clock.attach(lambda: imu.received)
        yield Devices(table, imu, at.clock)


@contextmanager
def endpoints(
    setup: ResolvedConfiguration, check_cancelled: Callable[[], None] = lambda: None
) -> Iterator[Endpoints]:
    """The ports of a station, owned as long as the context, or those of its virtual bench, which lives as long.

    hear : called while the bench comes up, may raise

    Raises DeviceFaultError where another program owns one, ConfigurationError.
    """
    config = setup.bench_config()
    if config is None:
        table, imu = setup.station.table.port, setup.station.imu.port
        assert imu is not None
        if not setup.table.by_hand:
            assert table is not None
            sentence = port_conflict(setup.table, table, imu)
            if sentence is not None:
                raise ConfigurationError(sentence)
        with owned(port for port in (table, imu) if port):
            yield Endpoints(table or "", imu, RealClock())
        return
    with BenchHost.start(config, check_cancelled) as bench:
        told = bench.endpoints
        host, _, port = told["clock"].rpartition(":")
        clock = BenchClock((host, int(port)), float(config.get("speed", 0.0)))
        over_tcp = told["table_transport"] == "tcp" and not _shared(setup)
        try:
            yield Endpoints(f"tcp://{told['table']}" if over_tcp else told["table"], told["imu"], clock)
        finally:
            clock.close()


def _shared(setup: ResolvedConfiguration) -> bool:
    """Whether the axes are commanded through the IMU's link."""
    return setup.table.protocol == "imu_link"


def port_conflict(profile: TableProfile, table: str, imu: str) -> str | None:
    """What is wrong with two ports beside each other, with the mend: one port has one owner, and two devices share it
    only where they are one system."""
    same, shared = _place(table, "table") == _place(imu, "IMU"), profile.protocol == "imu_link"
    if same and not shared:
        return (
            f"table.port and imu.port are both {imu}, but a port has one owner; give each device its own, or choose"
            " the table profile of a system that commands its axes through its data's link"
        )
    if shared and not same:
        return (
            f"table.port is {table} and imu.port {imu}, but the table profile '{profile.name}' is of axes behind"
            " the IMU's link; give both the same port"
        )
    return None


def _place(port: str, name: str) -> str:
    """What a port's name leads to, so that two names of the same are alike."""
    if "://" in port:
        return port.split("://", 1)[1].rstrip("/")
    try:
        return os.path.realpath(resolve(port, name))
    except DeviceFaultError:  # told when this port is opened, which may not be the one that is asked for
        return port


def open_table(setup: ResolvedConfiguration, port: str) -> RegisterTable | TextTable:
    """The table alone, on its port. Raises DeviceFaultError or ConfigurationError."""
    if _shared(setup):
        return SharedTable(open_imu(setup, port), table_profile(setup), owned=True)
    profile, serial = table_profile(setup), setup.station.table.serial
    with explained("table", port, profile.timeout_s):
        return table_on(port, profile, serial)


def open_imu(setup: ResolvedConfiguration, port: str) -> StreamedImu:
    """The IMU on its port, not streaming yet. Raises DeviceFaultError or ConfigurationError."""
    link = SerialLink(port, imu_settings(setup), "IMU")
    return imu_on(link, imu_profile(setup), setup.request.serial)


def wires(setup: ResolvedConfiguration, table: str, imu: str) -> LinkSettings:
    """How both devices are reached at these ports."""
    profile = table_profile(setup)
    serial = setup.station.table.serial or profile.serial
    return LinkSettings(table, profile, serial, imu, imu_profile(setup), imu_settings(setup))


def imu_settings(setup: ResolvedConfiguration) -> SerialSettings:
    """This place's serial settings, the profile's where it has none."""
    return setup.station.imu.serial or setup.imu.link


def table_profile(setup: ResolvedConfiguration) -> TableProfile:
    """The table's profile with this place's timeout and unit number."""
    table = setup.station.table
    return setup.table.at_place(table.timeout_s, table.unit)


def imu_profile(setup: ResolvedConfiguration) -> ImuProfile:
    """The IMU's profile with this place's timeout."""
    timeout = setup.station.imu.timeout_s
    if timeout is None:
        return setup.imu
    return setup.imu.with_timeout(timeout)
