"""Test of the links of a saved or edited station; nothing is written and nothing moves."""

from collections.abc import Iterator
from contextlib import AbstractContextManager, closing
from dataclasses import dataclass
from pathlib import Path

from calstation.config import VIRTUAL_UNIT, RunConfiguration, RunRequest, StationConfig, at_slot, library, unit_files
from calstation.connection.compatibility import incompatibilities
from calstation.connection.devices import (
    Endpoints,
    endpoints,
    imu_profile,
    imu_settings,
    link_settings,
    open_chamber,
    open_imu,
    open_table,
    table_profile,
)
from calstation.connection.identify import (
    LISTEN_TIME,
    OTHER_UNIT_EXCEPTIONS,
    DetectedUnit,
    find_unit_number,
    find_units,
    imu_on_table_port,
    listen,
    table_on_imu_port,
)
from calstation.connection.imu_test import ImuTest, diagnose_text, find_baud_rate
from calstation.connection.table_test import query_table
from calstation.devices import Chamber, OtherModelError
from calstation.devices.links import SerialPortInfo as SerialPortInfo
from calstation.devices.links import diagnose_port, host_and_port, list_serial_ports, open_link, port_device
from calstation.devices.profiles import (
    SerialSettings,
    load_chamber_profile,
    load_imu_profile,
    load_table_profile,
)
from calstation.errors import CalstationError, ConfigurationError, DeviceFaultError
from calstation.jobs import ProgressCallback
from calstation.messages import Finding, Report, Value

#: General findings that are replaced by a specific finding if lines of text are received.
_REPLACED_BY_LINE = {"no_frames", "no_samples", "no_stream", "one_way", "wrong_checks"}
#: Findings on the table's port that may indicate that the IMU is connected to it.
_SUGGEST_IMU = {"garbled", "garbled_text", "unlike_text", "unlike_answer", "silent_rtu", "silent_text", "crc"}


@dataclass(frozen=True)
class LinkTestRequest:
    """The station to test, and the expected IMU."""

    station: StationConfig
    product: Path | None = None  #: Product of the IMU; None for the default product.
    slot: str | None = None  #: Slot of the IMU; None for the only or first slot.


def check_table_link(progress: ProgressCallback, request: LinkTestRequest) -> Report:
    """Test the link to the table. Raises CalstationError if a profile cannot be read."""
    setup = link_test_configuration(request)
    if setup.table.by_hand:
        return Report("table", (Finding("by_hand", "ok", {"name": setup.table.name}),))
    with open_endpoints(progress, setup) as ports:
        progress(0.3, note="opening")
        settings = setup.station.table.serial or setup.table.serial
        profile = table_profile(setup)
        try:
            table = open_table(setup, ports.table)
        except (DeviceFaultError, ConfigurationError) as exc:
            return Report("table", (_not_opened_finding(ports.table, settings, profile.timeout_s, exc),))
        with closing(table):
            findings = [_opened_finding(ports.table), *query_table(table, profile, settings, ports.table, progress)]
        findings.extend(_search_table_port(setup, ports, findings, progress))
    return Report("table", tuple(findings))


def check_imu_link(progress: ProgressCallback, request: LinkTestRequest) -> Report:
    """Test the link to the IMU. Raises CalstationError if a profile cannot be read."""
    setup = link_test_configuration(request)
    with open_endpoints(progress, setup) as ports:
        progress(0.2, note="opening")
        settings = imu_settings(setup)
        try:
            imu = open_imu(setup, ports.imu)
        except (DeviceFaultError, ConfigurationError) as exc:
            return Report("imu", (_not_opened_finding(ports.imu, settings, imu_profile(setup).timeout_s, exc),))
        with closing(imu):
            findings = [_opened_finding(ports.imu), *ImuTest(imu, setup, ports, settings, progress).findings()]
        if any(finding.id in ("gravity", "wrong_gravity") for finding in findings):
            findings.extend(incompatibilities(setup))
        findings = _with_line_finding(setup, ports, findings)
        findings.extend(_search_imu_port(setup, ports, findings, progress))
    return Report("imu", tuple(findings))


def check_chamber_link(progress: ProgressCallback, request: LinkTestRequest) -> Report:
    """Test the link to the chamber, which is only queried. Raises CalstationError, for example without a chamber."""
    setup = link_test_configuration(request)
    with open_endpoints(progress, setup) as ports:
        progress(0.3, note="opening")
        try:
            chamber = open_chamber(setup, ports.chamber)
        except DeviceFaultError as exc:
            return Report("chamber", (Finding("chamber_silent", "error", {"words": exc.as_text}),))
        with closing(chamber):
            progress(0.6, note="asking")
            return Report("chamber", (_opened_finding(ports.chamber), *_chamber_findings(chamber)))


def _chamber_findings(chamber: Chamber) -> Iterator[Finding]:
    try:
        model, status = chamber.identify(), chamber.status()
    except OtherModelError as exc:
        yield Finding("wrong_model", "error", {"found": exc.found, "expected": exc.expected})
        return
    except DeviceFaultError as exc:
        yield Finding("chamber_silent", "error", {"words": exc.as_text})
        return
    yield Finding("chamber_identified", "ok", {"model": model})
    values: dict[str, Value] = {"air": status.air_c, "set_point": status.set_point_c}
    yield Finding("chamber_temperature", "info", values, "" if status.running else "chamber_temperature_off")
    if status.alarm is not None:
        yield Finding("chamber_alarm", "error", {"alarm": status.alarm})
    if status.door_open is None:
        yield Finding("chamber_without_door", "info")
    elif status.door_open:
        yield Finding("chamber_door_open", "warning")


def discover_ports(progress: ProgressCallback) -> tuple[SerialPortInfo, ...]:
    """Return the serial ports of this computer, USB adapters first."""
    ports = list_serial_ports()
    progress(1.0)
    return ports


def link_test_configuration(request: LinkTestRequest) -> RunConfiguration:
    """Return a run configuration with the data needed to open the devices. Raises CalstationError."""
    station = at_slot(request.station, request.slot)
    _, product, imu = unit_files(station, request.product)
    chamber = station.chamber
    return RunConfiguration(
        request=RunRequest(VIRTUAL_UNIT, slot=request.slot),
        station=station,
        product=product,
        table=load_table_profile(library.find("tables", station.table.profile)),
        imu=load_imu_profile(imu),
        chamber=None if chamber is None else load_chamber_profile(library.find("chambers", chamber.profile)),
        schedules={},
    )


def open_endpoints(progress: ProgressCallback, setup: RunConfiguration) -> AbstractContextManager[Endpoints]:
    """Report the progress, and return a context that yields the ports of the station."""
    progress(0.0, note="starting_bench" if setup.station.bench is not None else "opening")
    return endpoints((setup,))


def _search_table_port(
    setup: RunConfiguration, ports: Endpoints, findings: list[Finding], progress: ProgressCallback
) -> Iterator[Finding]:
    """Yield a finding if another device replies at the port of the table."""
    link, ids = link_settings(setup, ports), {finding.id for finding in findings}
    if ids & _SUGGEST_IMU:
        progress(0.6, note="listening_around")
        if link.two_lines and imu_on_table_port(link):
            yield Finding("imus_line", "info", {"profile": link.imu.name})
            return

    def on_progress(share: float) -> None:
        progress(0.6 + 0.4 * share, note="trying_units")

    refused = next((finding.values["code"] for finding in findings if finding.id == "exception"), None)
    if ids & {"silent_rtu", "silent_tcp"} or refused in OTHER_UNIT_EXCEPTIONS:
        other = find_unit_number(link, on_progress)
        if other is not None:
            values = {"found": other[0], "model": other[1], "unit": link.table.unit or 0}
            yield Finding("unit_heard", "info", values)
            return
    if ids & {"silent_rtu", "silent_tcp", "exception", "wrong_model"}:
        units = [unit for unit in find_units(link, on_progress) if unit.profile or "wrong_model" not in ids]
        if units:
            yield _units_finding(units)


def _units_finding(units: list[DetectedUnit]) -> Finding:
    for unit in units:
        if unit.profile:
            values = {"found": unit.unit, "model": unit.model, "profile": unit.profile}
            return Finding("profile_heard", "info", values)
    named = [f"{unit.unit} (“{unit.model}”)" if unit.model else str(unit.unit) for unit in units]
    return Finding("units_heard", "info", {"units": ", ".join(named)})


def _search_imu_port(
    setup: RunConfiguration, ports: Endpoints, findings: list[Finding], progress: ProgressCallback
) -> Iterator[Finding]:
    """Yield a finding if the table replies at the port of the IMU, or if the IMU streams at another baud rate."""
    link, ids = link_settings(setup, ports), {finding.id for finding in findings}
    if ids & {"silent", "no_frames"} and link.two_lines and not setup.table.by_hand:
        progress(0.4, note="listening_around")
        if table_on_imu_port(link):
            yield Finding("tables_line", "info")
            return
    if "no_frames" in ids and "://" not in ports.imu:
        yield from find_baud_rate(ports.imu, link.imu_serial, link.imu, progress)


def _with_line_finding(setup: RunConfiguration, ports: Endpoints, findings: list[Finding]) -> list[Finding]:
    """Replace a general finding by a specific finding on a received line of a text protocol."""
    index = next((i for i, finding in enumerate(findings) if finding.id in _REPLACED_BY_LINE), None)
    if index is None or setup.imu.frame.format != "text":
        return findings
    try:
        with closing(open_link(ports.imu, imu_settings(setup))) as link:
            wrong = diagnose_text(setup.imu.frame, listen(link, LISTEN_TIME))
    except CalstationError:
        return findings
    return findings if wrong is None else [*findings[:index], wrong, *findings[index + 1 :]]


def _opened_finding(port: str) -> Finding:
    address = host_and_port(port)
    if address is not None:
        return Finding("connected", "ok", {"host": address[0], "port": address[1]})
    device = port_device(port, "imu")
    return Finding("opened", "ok", {"port": port, "device": device}, "" if device == port else "opened_as")


def _not_opened_finding(port: str, settings: SerialSettings, timeout: float, error: CalstationError) -> Finding:
    reason, words = diagnose_port(port, settings, timeout)
    ports = list_serial_ports()
    names = [p.usb for p in ports if p.usb] if reason == "no_adapter" else [p.device for p in ports]
    values: dict[str, Value] = {"port": port, "words": words or error.as_text, "seconds": timeout}
    values["found"] = ", ".join(names)
    address = host_and_port(port)
    if address is not None:
        values |= {"host": address[0], "number": address[1]}
    if reason == "bad_settings":
        values |= {"baud": settings.baud, "parity": settings.parity, "stop_bits": settings.stop_bits}
    no_ports = reason in ("no_port", "no_adapter") and not names
    return Finding(reason, "error", values, f"{reason}_at_all" if no_ports else "")
