"""Opening and closing of the devices of a station, or of its virtual bench."""

import os
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

from calstation.config import BenchSettings, PairConfiguration, RunConfiguration, load_bench
from calstation.connection.identify import LinkSettings, identify
from calstation.connection.port_lock import lock_ports
from calstation.devices import Chamber
from calstation.devices.chamber import ModbusChamber, TextChamber
from calstation.devices.chamber import open_chamber as open_chamber_driver
from calstation.devices.imu import StreamedImu
from calstation.devices.imu import open_imu as open_imu_driver
from calstation.devices.links import Device, open_link, port_device, with_connection_reason
from calstation.devices.profiles import ImuProfile, SerialSettings, TableProfile
from calstation.devices.table import ManualTable, RegisterTable, SharedTable, TextTable
from calstation.devices.table import open_table as open_table_driver
from calstation.errors import ConfigurationError, DeviceFaultError
from calstation.messages import Text
from calstation.sequencer import Clock


class RealClock:
    """A clock whose station time is the monotonic time of the host, s."""

    #: Interval at which the devices are polled, s.
    tick = 0.05
    speed = 1.0

    def now(self) -> float:
        """Return the time, s."""
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        """Wait for `seconds`."""
        time.sleep(seconds)

    idle = sleep

    def attach(self, received: Callable[[], Mapping[int, int]]) -> None:
        """Do nothing, because samples arrive in real time."""


@dataclass(frozen=True)
class Devices:
    """Open devices and the clock of their data.

    `imus` contains the units of the run in order, or None for a unit that does not reply; `failed` contains its fault
    by its index in `imus`.
    """

    table: RegisterTable | TextTable | ManualTable
    imus: tuple[StreamedImu | None, ...]
    clock: Clock
    failed: Mapping[int, DeviceFaultError] = field(default_factory=dict)
    chamber: Chamber | None = None  #: The identified chamber of a run over temperature; None for other runs.

    @property
    def imu(self) -> StreamedImu:
        """The only unit, or the first unit that replies."""
        return next(imu for imu in self.imus if imu is not None)


@dataclass(frozen=True)
class Endpoints:
    """Ports of the table ("" for a manual rig), the IMUs and the chamber, and the clock of their data."""

    table: str
    imus: tuple[str, ...]
    clock: Clock
    chamber: str = ""

    @property
    def imu(self) -> str:
        """Port of the only or the first unit."""
        return self.imus[0]


class StationBench(BenchSettings, Protocol):
    """The virtual bench of a station; see `load_bench`."""

    def open(
        self, units: tuple[RunConfiguration, ...] | PairConfiguration, check_cancelled: Callable[[], None]
    ) -> AbstractContextManager[Endpoints]:
        """Return a context in which the bench runs and that yields its ports; see `endpoints`."""

    def with_recorded_unit(self, recording: Path, setup: RunConfiguration) -> RunConfiguration:
        """Return the configuration of a bench whose fixture contains the unit of a recording. Raises InputError."""


@contextmanager
def open_devices(
    setups: tuple[RunConfiguration, ...], check_cancelled: Callable[[], None] = lambda: None
) -> Iterator[Devices]:
    """Open and identify the table and the IMUs, and close them on exit; `check_cancelled` may raise.

    If there are several units, those that do not reply are omitted. Raises ConfigurationError, or DeviceFaultError if a
    port cannot be used, or if the table or the only unit is not the expected device.
    """
    setup = setups[0]
    with ExitStack() as stack:
        ports = stack.enter_context(endpoints(setups, check_cancelled))
        check_cancelled()
        chamber = _open_chamber(setup, ports, stack)
        table: RegisterTable | TextTable | ManualTable | None = None
        if not _is_shared(setup) and not setup.table.by_hand:
            table = open_table(setup, ports.table)
            stack.callback(table.close)
        imus: dict[int, StreamedImu] = {}
        failed: dict[int, DeviceFaultError] = {}
        if table is not None and len(setups) > 1:
            identify(table, None, link_settings(setup, ports), check_cancelled)
            imus, failed = _open_units(setups, ports.imus, stack, check_cancelled)
        else:
            imus[0] = imu = open_imu(setup, ports.imu)
            stack.callback(imu.close)
            if table is None:
                table = ManualTable(setup.table) if setup.table.by_hand else SharedTable(imu, table_profile(setup))
            if not isinstance(table, ManualTable):
                # The table is identified first, because not even a stop may be sent to another device.
                identify(table, imu, link_settings(setup, ports), check_cancelled)
            imu.start()
        ports.clock.attach(lambda: {index: imu.received for index, imu in imus.items()})
        yield Devices(table, tuple(imus.get(index) for index in range(len(setups))), ports.clock, failed, chamber)


def _open_chamber(setup: RunConfiguration, ports: Endpoints, stack: ExitStack) -> Chamber | None:
    """Open and identify the chamber of a run over temperature; None for other runs. Raises DeviceFaultError."""
    if setup.chamber is None or "temperature" not in setup.stages:
        return None
    chamber = open_chamber(setup, ports.chamber)
    stack.callback(chamber.close)
    chamber.identify()
    return chamber


def _open_units(
    setups: tuple[RunConfiguration, ...],
    imu_ports: tuple[str, ...],
    stack: ExitStack,
    check_cancelled: Callable[[], None],
) -> tuple[dict[int, StreamedImu], dict[int, DeviceFaultError]]:
    """Open, identify and start the units of a batch; return them and the faults of the others, by index."""
    imus: dict[int, StreamedImu] = {}
    failed: dict[int, DeviceFaultError] = {}
    for index, (setup, port) in enumerate(zip(setups, imu_ports, strict=True)):
        check_cancelled()
        with ExitStack() as opened:
            try:
                imu = open_imu(setup, port)
                opened.callback(imu.close)
                imu.identify()
                imu.start()
            except DeviceFaultError as fault:
                failed[index] = fault
                continue
            imus[index] = imu
            stack.enter_context(opened.pop_all())
    return imus, failed


def endpoints(
    units: tuple[RunConfiguration, ...] | PairConfiguration, check_cancelled: Callable[[], None] = lambda: None
) -> AbstractContextManager[Endpoints]:
    """Return a context that yields the ports of the units on one table, or of the IMUs on one body.

    Hardware ports are locked while the context is open. `check_cancelled` is called while a bench starts, and may
    raise. Raises DeviceFaultError if another program uses a port or a bench does not start, or ConfigurationError if
    there is a `port_conflict`.
    """
    if isinstance(units, PairConfiguration):
        setups, table = units.units, None
    else:
        setups, table = units, units[0].station.table.port
    if setups[0].station.bench is not None:
        bench: StationBench = load_bench()
        return bench.open(units, check_cancelled)
    return _locked_ports(setups, table)


@contextmanager
def _locked_ports(setups: tuple[RunConfiguration, ...], table: str | None) -> Iterator[Endpoints]:
    profile, imus = setups[0].table, tuple(unit.station.imu.port or "" for unit in setups)
    for imu in imus if table is not None and not profile.by_hand else ():
        conflict = port_conflict(profile, table or "", imu)
        if conflict is not None:
            raise ConfigurationError(conflict.code, **conflict.values)
    if len({_device_of(port, "imu") for port in imus}) < len(imus):
        raise ConfigurationError("connection.same_imu_port", ports=list(imus))
    chamber = "" if setups[0].station.chamber is None else setups[0].station.chamber.port or ""
    if chamber and _device_of(chamber, "chamber") in {_device_of(port, "imu") for port in (table or "", *imus)}:
        raise ConfigurationError("connection.same_chamber_port", port=chamber)
    with lock_ports(port for port in (table, chamber, *imus) if port):
        yield Endpoints(table or "", imus, RealClock(), chamber)


def _is_shared(setup: RunConfiguration) -> bool:
    """Return whether the axes are commanded over the link of the IMU."""
    return setup.table.protocol == "imu_link"


def port_conflict(profile: TableProfile, table: str, imu: str) -> Text | None:
    """Return a message if table and IMU share a port, or use different ports, contrary to the profile; else None.

    Parameters
    ----------
    profile : table profile, which determines whether the axes use the link of the IMU
    table, imu : ports
    """
    same, shared = _device_of(table, "table") == _device_of(imu, "imu"), profile.protocol == "imu_link"
    if same and not shared:
        return Text.of("connection.same_port", port=imu)
    if shared and not same:
        return Text.of("connection.different_ports", table=table, imu=imu, profile=profile.name)
    return None


def _device_of(port: str, name: Device) -> str:
    """Return an identifier of the device at a port, which is the same for all names of the device."""
    if "://" in port:
        return port.split("://", 1)[1].rstrip("/")
    try:
        return os.path.realpath(port_device(port, name))
    except DeviceFaultError:  # the error is reported when this port is opened
        return port


def open_table(setup: RunConfiguration, port: str) -> RegisterTable | TextTable:
    """Open the table on its port. Raises DeviceFaultError or ConfigurationError."""
    if _is_shared(setup):
        return SharedTable(open_imu(setup, port), table_profile(setup), owned=True)
    profile, serial = table_profile(setup), setup.station.table.serial
    with with_connection_reason("table", port, profile.timeout_s):
        return open_table_driver(port, profile, serial)


def open_chamber(setup: RunConfiguration, port: str) -> TextChamber | ModbusChamber:
    """Open the chamber of the station on its port. Raises DeviceFaultError or ConfigurationError."""
    section = setup.station.chamber
    if section is None or setup.chamber is None:
        raise ConfigurationError("connection.no_chamber", station=setup.station.name)
    profile = setup.chamber.at_station(section.timeout_s)
    with with_connection_reason("chamber", port, profile.section.timeout_s):
        return open_chamber_driver(port, profile, section.serial)


def open_imu(setup: RunConfiguration, port: str) -> StreamedImu:
    """Open the IMU on its port without starting its stream. Raises DeviceFaultError or ConfigurationError."""
    link = open_link(port, imu_settings(setup))
    return open_imu_driver(link, imu_profile(setup), setup.request.serial)


def link_settings(setup: RunConfiguration, ports: Endpoints) -> LinkSettings:
    """Return the link settings of both devices at their ports."""
    profile = table_profile(setup)
    serial = setup.station.table.serial or profile.serial
    return LinkSettings(ports.table, profile, serial, ports.imu, imu_profile(setup), imu_settings(setup))


def imu_settings(setup: RunConfiguration) -> SerialSettings:
    """Return the serial settings of the IMU's port."""
    return setup.station.imu.serial or setup.imu.link


def table_profile(setup: RunConfiguration) -> TableProfile:
    """Return the table's profile with the station's timeout and unit number."""
    table = setup.station.table
    return setup.table.at_station(table.timeout_s, table.unit)


def imu_profile(setup: RunConfiguration) -> ImuProfile:
    """Return the IMU's profile with the station's timeout."""
    timeout = setup.station.imu.timeout_s
    return setup.imu if timeout is None else setup.imu.with_commands(timeout_s=timeout)
