"""Tests the links of a station as typed, saved or not: opens, asks, listens; never writes, never moves anything."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from calstation.config import library
from calstation.config.request import RunRequest
from calstation.config.resolved import ResolvedConfiguration
from calstation.config.station import StationConfig, load_product
from calstation.connection import imu_test as imu_check
from calstation.connection import table_test as table_check
from calstation.connection.compatibility import incompatibilities
from calstation.connection.devices import (
    Endpoints,
    endpoints,
    imu_profile,
    imu_settings,
    open_imu,
    open_table,
    table_profile,
    wires,
)
from calstation.connection.identify import (
    LISTEN,
    OTHER_NUMBER,
    FoundUnit,
    find_unit_number,
    find_units,
    imu_on_table_port,
    listen,
    table_on_imu_port,
)
from calstation.connection.imu_test import diagnose_text
from calstation.devices.links.opening import host_and_port, why_not
from calstation.devices.links.serial_link import SerialLink
from calstation.devices.links.serial_ports import FoundPort as FoundPort
from calstation.devices.links.serial_ports import found_ports, resolve
from calstation.devices.profiles.imu import load_imu_profile
from calstation.devices.profiles.serial_settings import SerialSettings
from calstation.devices.profiles.table import load_table_profile
from calstation.errors import CalstationError, ConfigurationError, DeviceFaultError
from calstation.jobs.queue import ProgressCallback
from calstation.messages.finding import Finding, Report, Value

_VIRTUAL_UNIT = "SN-000001"
#: Findings that a line of text explains better.
_ABOUT_LINES = ("no_frames", "no_samples", "no_stream", "one_way", "wrong_checks")


@dataclass(frozen=True)
class LinkTestRequest:
    """What to test: a station, and the product whose IMU is expected (None for the default one)."""

    station: StationConfig
    product: Path | None = None


def check_table_link(tell: ProgressCallback, order: LinkTestRequest) -> Report:
    """Work for the workshop: test the table's link. Raises CalstationError where a profile cannot be read."""
    setup = link_test_configuration(order)
    found: list[Finding] = []
    if setup.table.by_hand:
        return Report("table", (Finding("by_hand", "ok", {"name": setup.table.name}),))
    with open_endpoints(tell, setup) as at:
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
        found.extend(_who_else_than_the_table(setup, at, found, tell))
    return Report("table", tuple(found))


def check_imu_link(tell: ProgressCallback, order: LinkTestRequest) -> Report:
    """Work for the workshop: test the IMU's link. Raises CalstationError where a profile cannot be read."""
    setup = link_test_configuration(order)
    found: list[Finding] = []
    with open_endpoints(tell, setup) as at:
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
        if any(finding.id in ("gravity", "wrong_gravity") for finding in found):
            found.extend(incompatibilities(setup))
        found = _by_a_line(setup, at, found)
        found.extend(_who_else_than_the_imu(setup, at, found, tell))
    return Report("imu", tuple(found))


def link_test_configuration(order: LinkTestRequest) -> ResolvedConfiguration:
    """What opening the devices needs of a run's setup."""
    _, product = load_product(order.product)
    return ResolvedConfiguration(
        request=RunRequest(_VIRTUAL_UNIT),
        station=order.station,
        product=product,
        table=load_table_profile(library.find("tables", order.station.table.profile)),
        imu=load_imu_profile(library.find("imus", product.imu)),
        schedules={},
    )


@contextmanager
def open_endpoints(tell: ProgressCallback, setup: ResolvedConfiguration) -> Iterator[Endpoints]:
    """The station's ports; its virtual bench takes some seconds to start."""
    tell(0.0, note="starting_bench" if setup.station.bench is not None else "opening")
    with endpoints(setup) as at:
        yield at


def _who_else_than_the_table(
    setup: ResolvedConfiguration, at: Endpoints, found: list[Finding], tell: ProgressCallback
) -> Iterator[Finding]:
    """Who answers in the table's place, where that can be found out."""
    around, ids = wires(setup, at.table, at.imu), {finding.id for finding in found}
    if ids & {"garbled", "garbled_text", "unlike_text", "unlike_answer", "silent_rtu", "silent_text", "crc"}:
        tell(0.6, note="listening_around")
        if around.two_lines and imu_on_table_port(around):
            yield Finding("imus_line", "told", {"profile": around.imu.name})
            return
    refused = next((finding.values["code"] for finding in found if finding.id == "exception"), None)
    if ids & {"silent_rtu", "silent_tcp"} or refused in OTHER_NUMBER:
        other = find_unit_number(around, lambda share: tell(0.6 + 0.4 * share, note="trying_units"))
        if other is not None:
            values: dict[str, Value] = {"found": other[0], "model": other[1], "unit": around.table.unit or 0}
            yield Finding("unit_heard", "told", values)
            return
    if ids & {"silent_rtu", "silent_tcp", "exception", "wrong_model"}:
        heard = find_units(around, lambda share: tell(0.6 + 0.4 * share, note="trying_units"))
        yield from _units([one for one in heard if one.profile or "wrong_model" not in ids])


def _units(heard: list[FoundUnit]) -> Iterator[Finding]:
    """The device whose profile is another one, or whoever answers."""
    for one in heard:
        if one.profile:
            values: dict[str, Value] = {"found": one.unit, "model": one.model, "profile": one.profile}
            yield Finding("profile_heard", "told", values)
            return
    if heard:
        named = [f"{one.unit} (“{one.model}”)" if one.model else str(one.unit) for one in heard]
        yield Finding("units_heard", "told", {"units": ", ".join(named)})


def _who_else_than_the_imu(
    setup: ResolvedConfiguration, at: Endpoints, found: list[Finding], tell: ProgressCallback
) -> Iterator[Finding]:
    """Who answers in the IMU's place, or at which baud it does, where that can be found out."""
    around, ids = wires(setup, at.table, at.imu), {finding.id for finding in found}
    if ids & {"silent", "no_frames"} and around.two_lines and not setup.table.by_hand:
        tell(0.4, note="listening_around")
        if table_on_imu_port(around):
            yield Finding("tables_line", "told")
            return
    if "no_frames" in ids and "://" not in at.imu:
        yield from imu_check.find_baud_rate(at.imu, around.imu_serial, around.imu, tell)


def _by_a_line(setup: ResolvedConfiguration, at: Endpoints, found: list[Finding]) -> list[Finding]:
    """Of a unit that sends text, what is wrong is told by one of its lines instead."""
    told = next((i for i, f in enumerate(found) if f.id in _ABOUT_LINES), None)
    if told is None or setup.imu.frame.format != "text":
        return found
    try:
        link = SerialLink(at.imu, imu_settings(setup), "IMU")
    except CalstationError:
        return found
    try:
        wrong = diagnose_text(setup.imu.frame, listen(link, LISTEN))
    except CalstationError:
        return found
    finally:
        link.close()
    return found if wrong is None else [*found[:told], wrong, *found[told + 1 :]]


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


def discover_ports(tell: Callable[..., None]) -> tuple[FoundPort, ...]:
    """Work for the workshop: the serial ports of this computer, USB adapters first."""
    ports = found_ports()
    tell(1.0)
    return ports
