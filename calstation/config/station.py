"""Station and product files: one place and one unit type, checked before anything moves."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, JsonValue, field_validator, model_validator

from calstation.config import library
from calstation.devices.links.opening import SOCKETS, host_and_port
from calstation.devices.profiles.imu import load_imu_profile
from calstation.devices.profiles.serial_settings import SerialSettings
from calstation.devices.profiles.table import load_table_profile
from calstation.errors import CalstationError, ConfigurationError
from calstation.records.checks import ChecksSection
from calstation.records.limits import Limit, check_limit_names
from calstation.records.meta import SiteSection
from calstation.schema import StrictModel, load
from procedures import DEFAULT_STAGES, method

#: What to do with a unit outside its limits: mount it anew, try again as it is, give it up for now.
Advice = Literal["reseat", "repeat", "set_aside"]

DEFAULT_STATION = "virtual_bench"
DEFAULT_PRODUCT = "nav_a"

#: host:port without what it is reached by.
_BARE = re.compile(r"(?!usb:)[A-Za-z0-9][A-Za-z0-9.-]*:\d{1,5}")


class DeviceSection(StrictModel):
    """A device's link at this place: port, and the serial settings where they differ from the profile's.

    port : for a table ``tcp://host:port`` or the serial port of Modbus RTU, for an IMU its serial port; a serial
        port by its name, as ``usb:SERIALNUMBER`` of its adapter, or ``socket://host:port`` of a serial server
    timeout_s : host time for an answer, the profile's where absent
    """

    port: str | None = None
    serial: SerialSettings | None = None
    timeout_s: float | None = Field(default=None, gt=0, le=60)

    @field_validator("port")
    @classmethod
    def _address(cls, port: str | None) -> str | None:
        if port is not None and port.startswith(SOCKETS) and host_and_port(port) is None:
            raise ValueError(
                f"'{port}' is no address; write {port.split('://')[0]}://host:port, port 1 to 65535"
            )
        return port


class TableLinkSection(DeviceSection):
    """`[table]` of a station: which table stands here.

    unit : its Modbus unit number, the profile's where absent

    Rails turned by hand need no port, and one that stands here is not used.
    """

    profile: str
    unit: int | None = Field(default=None, ge=0, le=255)


class HandoverSection(StrictModel):
    """`[handover]` of a station: where the factory's own system collects results.

    folder : must exist; relative to the station file
    """

    folder: str = Field(min_length=1)


class StationSite(SiteSection):
    """`[site]` of a station: where it stands, and who has made sure of it.

    confirmed_on : computers at which a person has said so, each with the place, see `station.place.confirmation_key`
    """

    confirmed_on: list[str] = Field(default_factory=list)

    @property
    def place(self) -> SiteSection:
        """Where it stands."""
        return SiteSection.model_validate(self.model_dump(exclude={"confirmed_on"}))


class StationConfig(StrictModel):
    """A station file: this place, its table and its ports.

    bench : settings of the virtual bench in place of hardware (`calstation.bench.config.BenchConfig`)
    handover : without it results are handed over in a folder `handover` beside the folder of the runs
    """

    name: str
    site: StationSite
    table: TableLinkSection
    imu: DeviceSection = DeviceSection()
    bench: dict[str, JsonValue] | None = None
    handover: HandoverSection | None = None

    @model_validator(mode="after")
    def _ports(self) -> "StationConfig":
        for device, section in (("table", self.table), ("imu", self.imu)):
            linked = device == "imu" or not is_manual_table(self.table.profile)
            if self.bench is None and linked and not section.port:
                raise ValueError(
                    f"{device}.port is missing; add the port, or a [bench] for the virtual bench"
                )
            if self.bench is not None and section.port:
                raise ValueError(f"{device}.port and [bench] exclude each other; remove one")
            port = section.port or ""
            if _BARE.fullmatch(port):
                ways = f"tcp://{port}, or socket://{port} for a serial server"
                raise ValueError(
                    f"{device}.port = '{port}' does not say how it is reached; write"
                    f" {ways if device == 'table' else f'socket://{port} for a serial server'}"
                )
        imu = self.imu.port or ""
        if imu.startswith("tcp://"):
            rest = imu.removeprefix("tcp://")
            raise ValueError(
                f"imu.port = '{imu}' is an address for Modbus TCP; write socket://{rest} for a serial server"
            )
        return self


def is_manual_table(profile: str) -> bool:
    """Whether a table profile is of a rig that nobody drives; one that cannot be read is told by who needs it."""
    try:
        return load_table_profile(library.find("tables", profile)).by_hand
    except ConfigurationError:
        return False


class WarmUpSection(StrictModel):
    """`[warm_up]`: s at least, then until the temperature drifts by less than the slope."""

    time_s: float = Field(default=0.0, ge=0, le=86_400)
    slope_c_per_min: float | None = Field(default=None, gt=0)
    timeout_s: float = Field(default=3600.0, gt=0, le=86_400)


class LoadAngleSection(StrictModel):
    """`[load_angle]`: where the table stands while units are changed, degrees."""

    outer_deg: float = 0.0
    inner_deg: float = 0.0


class ProductConfig(StrictModel):
    """A product file: one unit type, how it is calibrated and what it must reach.

    imu : name of its profile; serial_pattern : regular expression for the whole serial number
    bench_grade : grade of a virtual unit of this type
    schedule : parameters of each stage's method; targets : sigmas at which a repeated stage may stop, SI
    end_on_failure : leave out the remaining stages once a limit is missed
    advice : what to do after the first, second, ... time in a row that a unit is outside its limits; the last
        stands for all further times
    attempts_allowed : times in a row that a unit may be outside its limits before it is not calibrated again
    """

    name: str
    imu: str
    bench_grade: Literal["nav", "tactical", "mems"] = "nav"
    serial_pattern: str
    stages: list[str] = Field(default_factory=lambda: list(DEFAULT_STAGES), min_length=1)
    schedule: dict[str, dict[str, JsonValue]] = Field(default_factory=dict)
    targets: dict[str, float] = Field(default_factory=dict)
    limits: dict[str, Limit] = Field(default_factory=dict)
    checks: ChecksSection | None = None
    load_angle: LoadAngleSection = LoadAngleSection()
    warm_up: WarmUpSection = WarmUpSection()
    end_on_failure: bool = False
    advice: list[Advice] = Field(default=["reseat", "repeat", "set_aside"], min_length=1)
    attempts_allowed: int | None = Field(default=None, ge=1)

    @field_validator("serial_pattern")
    @classmethod
    def _pattern(cls, pattern: str) -> str:
        try:
            re.compile(pattern)
        except re.error as exc:
            raise ValueError(f"'{pattern}' is no regular expression ({exc})") from None
        return pattern

    @field_validator("stages")
    @classmethod
    def _stages(cls, stages: list[str]) -> list[str]:
        if len(set(stages)) != len(stages):
            raise ValueError("names a stage twice; each stage is solved once")
        return stages

    @field_validator("limits")
    @classmethod
    def _limits(cls, limits: dict[str, Limit]) -> dict[str, Limit]:
        check_limit_names(limits)
        return limits


def load_station(path: Path | None) -> tuple[Path, StationConfig]:
    """A station file, the virtual bench by default. Raises ConfigurationError."""
    path = path or library.find("stations", DEFAULT_STATION)
    return path, load(StationConfig, path)


def load_product(path: Path | None) -> tuple[Path, ProductConfig]:
    """A product file, `DEFAULT_PRODUCT` by default; its stages must exist. Raises ConfigurationError."""
    path = path or library.find("products", DEFAULT_PRODUCT)
    product = load(ProductConfig, path)
    for stage in (*product.stages, *product.schedule):
        method(stage)
    return path, product


def schedule_values(product: ProductConfig, stage: str, instead: Mapping[str, Any]) -> dict[str, JsonValue]:
    """What a stage's schedule is made of: the product's values, the request's before those."""
    given: dict[str, JsonValue] = {**product.schedule.get(stage, {}), **instead}
    if "targets" in method(stage).schedule.model_fields and product.targets and "targets" not in given:
        given["targets"] = dict(product.targets)
    return given


#: The shipped station of the virtual bench with such a rig, and the shipped product that is calibrated on it.
STATION, PRODUCT = "virtual_hand", "mems_hand"


def uses_manual_rig(station: Path | None) -> bool:
    """Whether the rig of a station file (the default one where None) is moved by hand."""
    try:
        _, config = load_station(station)
    except CalstationError:
        return False
    return is_manual_table(config.table.profile)


def manual_product() -> Path | None:
    """The product that is calibrated by hand; None where a site has none."""
    return library.find("products", PRODUCT) if PRODUCT in library.names("products") else None


@dataclass(frozen=True)
class LinkDefaults:
    """Settings of a profile.

    Attributes
    ----------
    profile : its file's name
    serial : of its line
    timeout : host time for an answer, s, None for a device that is never asked
    unit : Modbus unit number, None where there is none
    by_hand : rails that hands turn: there is no link at all
    """

    profile: str
    serial: SerialSettings
    timeout: float | None
    unit: int | None
    by_hand: bool = False

    @property
    def line(self) -> str:
        """The serial settings as they are usually written, e.g. ``921600 8N1``."""
        return self.serial.line


def table_defaults(profile: str) -> LinkDefaults | None:
    """Of a table profile; None where there is no sound one of that name."""
    try:
        table = load_table_profile(library.find("tables", profile))
    except ConfigurationError:
        return None
    return LinkDefaults(profile, table.serial, table.timeout_s, table.unit, table.by_hand)


def imu_defaults(product: Path | None) -> LinkDefaults | None:
    """Of the IMU of a product, the default one where None; None where there is no sound one."""
    try:
        _, found = load_product(product)
        profile = load_imu_profile(library.find("imus", found.imu))
    except ConfigurationError:
        return None
    return LinkDefaults(found.imu, profile.link, profile.timeout_s, None)
