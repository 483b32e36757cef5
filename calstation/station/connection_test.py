"""Tests the links of a station as typed, saved or not: opens, asks, listens; never writes, never moves anything."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from calstation.devices.imu_profile import load_imu_profile
from calstation.devices.link import SerialSettings
from calstation.devices.opening import host_and_port, why_not
from calstation.devices.ports import found_ports, resolve
from calstation.devices.table_profile import load_table_profile
from calstation.errors import CalstationError, ConfigurationError, DeviceFaultError
from calstation.station import imu_check, library, table_check
from calstation.station.config import StationConfig, load_product
from calstation.station.finding import Finding, Report, Value
from calstation.station.request import RunRequest
from calstation.station.setup import Setup
from calstation.station.wiring import (
    Endpoints,
    endpoints,
    imu_profile,
    imu_settings,
    open_imu,
    open_table,
    table_profile,
)
from calstation.station.worker import Tell

_VIRTUAL_UNIT = "SN-000001"


@dataclass(frozen=True)
class Order:
    """What to test: a station, and the product whose IMU is expected (None for the default one)."""

    station: StationConfig
    product: Path | None = None


def try_table(tell: Tell, order: Order) -> Report:
    """Work for the workshop: test the table's link. Raises CalstationError where a profile cannot be read."""
    setup = setup_of(order)
    found: list[Finding] = []
    if setup.table.by_hand:
        return Report("table", (Finding("by_hand", "ok", {"name": setup.table.name}),))
    with ports_of(tell, setup) as at:
        tell(0.3, note="opening")
        settings = setup.station.table.serial or setup.table.serial
        try:
            table = open_table(setup, at.table)
        except (DeviceFaultError, ConfigurationError) as exc:
            found.append(_not_opened(at.table, settings, table_profile(setup).timeout_s, exc))
            return Report("table", tuple(found))
        try:
            found.append(_opened(at.table))
            for finding in table_check.ask(table, table_profile(setup), settings, at.table, tell):
                found.append(finding)
        finally:
            table.close()
    return Report("table", tuple(found))


def try_imu(tell: Tell, order: Order) -> Report:
    """Work for the workshop: test the IMU's link. Raises CalstationError where a profile cannot be read."""
    setup = setup_of(order)
    found: list[Finding] = []
    with ports_of(tell, setup) as at:
        tell(0.2, note="opening")
        settings = imu_settings(setup)
        try:
            imu = open_imu(setup, at.imu)
        except (DeviceFaultError, ConfigurationError) as exc:
            found.append(_not_opened(at.imu, settings, imu_profile(setup).timeout_s, exc))
            return Report("imu", tuple(found))
        try:
            found.append(_opened(at.imu))
            for finding in imu_check.ask(imu, setup, at, settings, tell):
                found.append(finding)
        finally:
            imu.close()
        if any(finding.id == "no_frames" for finding in found) and "://" not in at.imu:
            found.extend(imu_check.heard_elsewhere(at.imu, settings, imu_profile(setup), tell))
    return Report("imu", tuple(found))


def setup_of(order: Order) -> Setup:
    """What opening the devices needs of a run's setup."""
    _, product = load_product(order.product)
    return Setup(
        request=RunRequest(_VIRTUAL_UNIT),
        station=order.station,
        product=product,
        table=load_table_profile(library.find("tables", order.station.table.profile)),
        imu=load_imu_profile(library.find("imus", product.imu)),
        stages=(),
        schedules={},
        texts={},
    )


@contextmanager
def ports_of(tell: Tell, setup: Setup) -> Iterator[Endpoints]:
    """The station's ports; its virtual bench takes some seconds to start."""
    tell(0.0, note="starting_bench" if setup.station.bench is not None else "opening")
    with endpoints(setup) as at:
        yield at


def _opened(port: str) -> Finding:
    address = host_and_port(port)
    if address is not None:
        return Finding("connected", "ok", {"host": address[0], "port": address[1]})
    return Finding("opened", "ok", {"port": port, "device": resolve(port, "port")})


def _not_opened(port: str, settings: SerialSettings, timeout: float, exc: CalstationError) -> Finding:
    reason, words = why_not(port, settings, timeout)
    listed = ", ".join(f.device for f in found_ports())
    values: dict[str, Value] = {"port": port, "words": words or str(exc), "found": listed, "seconds": timeout}
    address = host_and_port(port)
    if address is not None:
        values |= {"host": address[0], "number": address[1]}
    if reason == "no_adapter":
        values["found"] = ", ".join(f.usb for f in found_ports() if f.usb)
    if reason == "bad_settings":
        values |= {"baud": settings.baud, "parity": settings.parity, "stop_bits": settings.stop_bits}
    return Finding(reason, "wrong", values)
