"""The slots of a station: mounting positions of units on one table, each with its own link."""

import re
from collections.abc import Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from pydantic import Field, field_validator

from calstation.config import library
from calstation.devices.links import SOCKETS, host_and_port
from calstation.devices.profiles import SerialSettings, TableProfile, load_table_profile
from calstation.errors import ConfigurationError
from calstation.schema import EntryError, StrictModel, near_miss

if TYPE_CHECKING:
    from calstation.config.station import StationConfig

#: Largest number of units on one table.
MAX_UNITS = 16

#: Largest component of a lever arm, m.
_LARGEST_LEVER = 5.0

#: Orientation of a unit aligned with the platform axes.
PLATFORM_AXES = "+x+z"

#: Entries of `[bench]` in a station file that are not settings of the bench itself.
STATION_ENTRIES = ("faults", "units")

#: Settings of the virtual bench in a station file that apply to its first unit only.
_OF_THE_FIRST = ("serial", "orders")


class DeviceSection(StrictModel):
    """A device's link at this station: its port, and serial settings that differ from the profile's."""

    #: ``tcp://host:port`` (tables), ``socket://host:port`` for a serial server, the name of a serial port, or
    #: ``usb:SERIALNUMBER`` for its adapter.
    port: str | None = None
    serial: SerialSettings | None = None
    timeout_s: float | None = Field(default=None, gt=0, le=60)  #: Host time for a reply; default from the profile.

    @field_validator("port")
    @classmethod
    def _address(cls, port: str | None) -> str | None:
        if port is not None and port.startswith(SOCKETS) and host_and_port(port) is None:
            raise EntryError("station.not_an_address", port=port, scheme=port.split("://")[0])
        return port


class SlotSection(DeviceSection):
    """`[[slots]]` of a station: a mounting position on the table, with the link of its unit."""

    name: str
    imu: str | None = None  #: Name of the IMU profile; default: the product's.
    product: str | None = None  #: Name of the product; default: the run's.
    #: Body axes along x and z of the platform at home, for example ``-y+z``.
    orientation: str = PLATFORM_AXES
    #: Nominal lever arm in the body frame.
    lever_m: list[float] = Field(default=[0.0, 0.0, 0.0], min_length=3, max_length=3)

    @field_validator("name")
    @classmethod
    def _short(cls, name: str) -> str:
        if re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,15}", name) is None:
            raise EntryError("station.slot_name", name=name)
        return name

    @field_validator("lever_m")
    @classmethod
    def _on_the_table(cls, lever: list[float]) -> list[float]:
        for component, value in enumerate(lever):
            if abs(value) > _LARGEST_LEVER:
                raise EntryError("station.lever_too_long", component, value=value, most=_LARGEST_LEVER)
        return lever

    @field_validator("orientation")
    @classmethod
    def _two_axes(cls, orientation: str) -> str:
        if re.fullmatch(r"[+-][xyz][+-][xyz]", orientation) is None:
            raise EntryError("station.not_an_orientation", orientation=orientation)
        if orientation[1] == orientation[3]:
            raise EntryError("station.one_axis_twice", orientation=orientation)
        return orientation


def check_slots(station: "StationConfig") -> None:
    """Check the slots of a station against each other, its table and its virtual bench. Raises EntryError."""
    _check_units(station)
    if not station.slot_names:
        return
    for section in ("imu", "imu2", "imu3"):
        if section in station.model_fields_set:
            raise EntryError("station.slots_and_imu", section)
    _check_unique("name", [slot.name for slot in station.slots])
    _check_unique("port", [slot.port for slot in station.slots])
    by_name: dict[str, str] = {}
    for number, slot in enumerate(station.slots):
        other = by_name.setdefault(slot.name.lower(), slot.name)
        if other != slot.name:
            raise EntryError("station.slot_case", "slots", number, "name", name=slot.name, other=other)
    with suppress(ConfigurationError):  # reported with the profile itself
        table = load_table_profile(library.find("tables", station.table.profile))
        if _takes_one(table):
            raise EntryError("station.slots_need_table", "table", "profile", profile=table.name)
        for number, slot in enumerate(station.slots):
            if table.outer_lever == "fixed" and any(slot.lever_m):
                raise EntryError("station.lever_fixed", "slots", number, "lever_m", profile=table.name)


def takes_one_unit(profile: str) -> bool:
    """Return whether a table of this profile takes a single unit; False if the profile cannot be read."""
    with suppress(ConfigurationError):
        return _takes_one(load_table_profile(library.find("tables", profile)))
    return False


def _takes_one(table: TableProfile) -> bool:
    return table.by_hand or table.gimbal is not None or table.protocol == "imu_link"


def _check_units(station: "StationConfig") -> None:
    if len(station.slots) > MAX_UNITS:
        raise EntryError("station.too_many_slots", "slots", count=len(station.slots), most=MAX_UNITS)
    units = (station.bench or {}).get("units")
    if units is None:
        return
    if type(units) is not int or not 1 <= units <= MAX_UNITS:
        raise EntryError("station.units_out_of_range", "bench", "units", most=MAX_UNITS)
    if station.slots and units != len(station.slots):
        raise EntryError("station.units_unlike_slots", "bench", "units", units=units, slots=len(station.slots))


def _check_unique(entry: str, values: Sequence[str | None]) -> None:
    for number, found in enumerate(values):
        if found is not None and found in values[:number]:
            raise EntryError("station.slot_twice", "slots", number, entry, value=found)


def at_slot(station: "StationConfig", name: str | None) -> "StationConfig":
    """Return a station with the unit of one slot as its only unit, by default the first slot, if it has slots.

    Raises EntryError for an unknown name.
    """
    names = station.slot_names
    if name is not None and name not in names:
        raise EntryError("station.unknown_slot", "slots", slot=name, remedy=near_miss(name, names))
    if not names:
        return station
    number = 0 if name is None else names.index(name)
    slot = station.slots[number] if station.slots else SlotSection(name=names[number])
    return station.model_copy(update={"imu": slot, "bench": _bench_of(station.bench, number)})


def _bench_of(bench: dict[str, Any] | None, number: int) -> dict[str, Any] | None:
    """Return the bench settings of the unit in slot `number`, from 0: the table's settings, and its own."""
    if bench is None:
        return None
    own = [{}, *bench.get("secondaries", ())][number:][:1]
    left_out = ("secondaries", *(_OF_THE_FIRST if number else ()))
    return {**{name: value for name, value in bench.items() if name not in left_out}, **(own[0] if own else {})}
