"""The model of a station file, which describes a location with its table and units, or a virtual bench."""

import re
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from importlib import import_module
from itertools import count, islice
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Protocol

from pydantic import BaseModel, Field, JsonValue, field_validator, model_validator

from calstation import BENCH_MODULE
from calstation.config import library
from calstation.config.slots import MAX_UNITS, DeviceSection, SlotSection, is_manual_table, takes_single_unit
from calstation.config.station_sections import (
    ChamberLinkSection,
    HandoverSection,
    InstrumentSection,
    LabelSection,
    LaboratorySection,
    RecordsSection,
    ReportSection,
    SecondaryLinkSection,
    SignInSection,
    StationSite,
    TableLinkSection,
)
from calstation.devices.profiles import load_table_profile
from calstation.errors import CalstationError, ConfigurationError
from calstation.records import COUNTRIES
from calstation.schema import EntryError, StrictModel, load, near_miss

if TYPE_CHECKING:
    from calstation.config.run_configuration import RunConfiguration

DEFAULT_STATION = "virtual_bench"

#: Shipped virtual bench with a manual table.
MANUAL_STATION = "virtual_hand"

#: Serial number of the unit on the virtual bench, unless the bench's settings or a recording specify another one.
VIRTUAL_UNIT = "SN-000001"

#: host:port without a scheme.
_WITHOUT_SCHEME = re.compile(r"(?!usb:)[A-Za-z0-9][A-Za-z0-9.-]*:\d{1,5}")


def virtual_serials(
    bench: Mapping[str, object], slots: Collection[str], unsuitable: Callable[[str], bool]
) -> tuple[str, ...]:
    """Return the serial numbers of the next suitable units of a virtual bench, one for each slot.

    Parameters
    ----------
    bench : settings of the bench; a serial number in the settings of a bench without slots is always returned
    slots : names of the slots
    unsuitable : function that returns whether the unit with a serial number must be skipped
    """
    first = str(bench.get("serial", VIRTUAL_UNIT))
    if "serial" in bench and not slots:
        return (first,)
    stem, digits = first.rstrip("0123456789"), len(first) - len(first.rstrip("0123456789"))
    serials = (f"{stem}{number:0{digits}d}" for number in count(int(first[len(stem) :] or 0)))
    return tuple(islice((s for s in serials if not unsuitable(s)), max(1, len(slots))))


class StationConfig(StrictModel):
    """A station file, which describes the site, the table and the ports of the devices."""

    name: str
    site: StationSite
    table: TableLinkSection
    chamber: ChamberLinkSection | None = None  #: The chamber around table and units; None without one.
    imu: DeviceSection = DeviceSection()
    imu2: SecondaryLinkSection | None = None
    imu3: SecondaryLinkSection | None = None
    #: Schedule of the cross-calibration of these IMUs; its values override the product's.
    cross_calibration: dict[str, JsonValue] = Field(default_factory=dict)
    #: Name of the product with which the station starts; None for the first that it can calibrate.
    product: str | None = None
    #: Settings of the virtual bench that replaces the devices, see `calstation.config.load_bench`.
    bench: dict[str, JsonValue] | None = None
    #: Largest error of the computer's clock, ppm; None for an unsynchronised quartz.
    clock_error_ppm: float | None = Field(default=None, ge=0, le=10_000)
    #: Delivery of the results; None for a folder `handover` next to the runs folder.
    handover: HandoverSection | None = None
    sign_in: SignInSection | None = None  #: Sign-in of operators; None if the operator's name is optional.
    #: Local times, ``HH:MM``, at which the counter of the operator page is reset.
    shift_starts: list[Annotated[str, Field(pattern=r"^([01]\d|2[0-3]):[0-5]\d$")]] = Field(
        default=["00:00"], min_length=1
    )
    label: LabelSection | None = None
    laboratory: LaboratorySection | None = None
    instruments: list[InstrumentSection] = Field(default_factory=list)
    report: ReportSection | None = None
    slots: list[SlotSection] = Field(default_factory=list)
    records: RecordsSection = RecordsSection()

    # checked here and not in the sections, because the sections are also read from logs

    @field_validator("laboratory")
    @classmethod
    def _check_country(cls, laboratory: LaboratorySection | None) -> LaboratorySection | None:
        if laboratory is not None and laboratory.country is not None and laboratory.country not in COUNTRIES:
            raise EntryError("station.not_a_country", "country", country=laboratory.country)
        return laboratory

    @field_validator("instruments")
    @classmethod
    def _check_instruments(cls, instruments: list[InstrumentSection]) -> list[InstrumentSection]:
        for number, instrument in enumerate(instruments):
            if "kind" not in instrument.model_fields_set:
                raise EntryError("station.no_instrument_kind", number, "kind", name=instrument.name)
            calibrated, due = instrument.calibrated, instrument.due
            if calibrated is not None and due is not None and due < calibrated:
                raise EntryError("station.due_before_calibration", number, "due", due=due, calibrated=calibrated)
        return instruments

    def person(self, entered: str) -> str:
        """Return how records name a person, given by badge or name; see `SignInSection.person`."""
        return entered if self.sign_in is None else self.sign_in.person(entered)

    @property
    def slot_names(self) -> tuple[str, ...]:
        """Names of the slots, in order; () at a station with one unit."""
        if self.slots:
            return tuple(slot.name for slot in self.slots)
        units = int((self.bench or {}).get("units", 1))  # type: ignore[arg-type] # see `_check_units`
        return tuple(str(number) for number in range(1, units + 1)) if units > 1 else ()

    @property
    def virtual_serial(self) -> str:
        """Serial number of the unit on the virtual bench; empty on hardware."""
        return "" if self.bench is None else str(self.bench.get("serial", VIRTUAL_UNIT))

    @property
    def secondaries(self) -> dict[int, SecondaryLinkSection]:
        """The secondary IMUs by number."""
        sections = {2: self.imu2, 3: self.imu3}
        return {number: section for number, section in sections.items() if section is not None}

    @model_validator(mode="after")
    def _check_ports(self) -> "StationConfig":
        if self.imu3 is not None and self.imu2 is None:
            raise EntryError("log.imu_numbers", number=3, missing=2)
        _check_slots(self)
        slots = [(("slots", number), slot) for number, slot in enumerate(self.slots)]
        imus: list[tuple[tuple[str | int, ...], DeviceSection]] = [*slots] or [(("imu",), self.imu)]
        imus += [((f"imu{number}",), section) for number, section in self.secondaries.items()]
        others: list[tuple[tuple[str | int, ...], DeviceSection]] = [(("table",), self.table)]
        if self.chamber is not None:
            others.append((("chamber",), self.chamber))
        for keys, section in (*others, *imus):
            needs_port = section is not self.table or not is_manual_table(self.table.profile)
            port = section.port or ""
            if self.bench is None and needs_port and not port:
                raise EntryError("station.port_missing", *keys, "port")
            if self.bench is not None and port:
                raise EntryError("station.port_on_bench", *keys, "port")
            if _WITHOUT_SCHEME.fullmatch(port):
                by_tcp = section is self.table or section is self.chamber
                code = "station.table_scheme_missing" if by_tcp else "station.imu_scheme_missing"
                raise EntryError(code, *keys, "port", port=port)
            if section is not self.table and section is not self.chamber and port.startswith("tcp://"):
                address = port.removeprefix("tcp://")
                raise EntryError("station.imu_over_modbus", *keys, "port", port=port, address=address)
        return self


def _check_slots(station: StationConfig) -> None:
    """Check that the slots of a station agree with each other, its table and its bench. Raises EntryError."""
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
    with suppress(ConfigurationError):  # errors of the profile are reported for its file
        table = load_table_profile(library.find("tables", station.table.profile))
        if takes_single_unit(table):
            raise EntryError("station.slots_need_table", "table", "profile", profile=table.name)
        for number, slot in enumerate(station.slots):
            if table.outer_lever == "fixed" and any(slot.lever_m):
                raise EntryError("station.lever_fixed", "slots", number, "lever_m", profile=table.name)


def _check_units(station: StationConfig) -> None:
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
    for number, value in enumerate(values):
        if value is not None and value in values[:number]:
            raise EntryError("station.slot_twice", "slots", number, entry, value=value)


def at_slot(station: StationConfig, name: str | None) -> StationConfig:
    """Return the station with the unit of one slot, by default the first; a station without slots is unchanged.

    Raises EntryError if no slot has this name.
    """
    names = station.slot_names
    if name is not None and name not in names:
        raise EntryError("station.unknown_slot", "slots", slot=name, remedy=near_miss(name, names))
    if not names:
        return station
    number = 0 if name is None else names.index(name)
    slot = station.slots[number] if station.slots else SlotSection(name=names[number])
    return station.model_copy(update={"imu": slot})


def load_station(path: Path | None) -> tuple[Path, StationConfig]:
    """Load a station file, by default that of the virtual bench. Raises ConfigurationError."""
    path = path or library.find("stations", DEFAULT_STATION)
    return path, load(StationConfig, path)


def uses_manual_rig(station: Path | None) -> bool:
    """Return whether a station, by default the virtual bench, has a manual rig."""
    try:
        return is_manual_table(load_station(station)[1].table.profile)
    except CalstationError:
        return False


class BenchSettings(Protocol):
    """Interface of the bench that interprets the section `[bench]` of a station file."""

    @property
    def model(self) -> type[BaseModel]:
        """Model of the section, without the `STATION_ENTRIES`."""

    def check(self, setup: "RunConfiguration", where: str) -> None:
        """Check the settings of a station's bench; `where` names them. Raises ConfigurationError."""

    def seed(self, setup: "RunConfiguration") -> int:
        """Return the seed of the bench."""


def load_bench() -> Any:
    """Return the bench for all stations with a section `[bench]`.

    It implements `BenchSettings` and the protocols of the packages that open its devices and call its run hooks.
    """
    return import_module(BENCH_MODULE).BENCH
