"""The configuration of a station whose IMUs on one body are monitored live."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

from pydantic import JsonValue

from calstation.config import library
from calstation.config.product import ProductConfig, in_file, schedule_values
from calstation.config.request import RunRequest
from calstation.config.run_configuration import RunConfiguration, load_configuration
from calstation.devices.profiles import load_imu_profile
from calstation.errors import ConfigurationError
from calstation.records import LogMeta
from calstation.schema import EntryError, validate
from procedures import method

STAGE = "cross_calibration"


@dataclass(frozen=True)
class PairConfiguration:
    """A primary IMU and its secondaries, each configured like the only unit of a station, and their schedule."""

    primary: RunConfiguration
    secondaries: tuple[RunConfiguration, ...]
    schedule: dict[str, JsonValue]

    @property
    def units(self) -> tuple[RunConfiguration, ...]:
        """The primary and the secondaries."""
        return (self.primary, *self.secondaries)

    def log_meta(self, serials: list[str], registers: Mapping[str, float]) -> LogMeta:
        """Return the configuration of a log of these units, with their serial numbers and the primary's registers.

        Registers that are not applied to the primary's stream become its prior.
        """
        primary = replace(self.primary, request=replace(self.primary.request, serial=serials[0]))
        data = primary.log_meta(registers=registers).model_dump()
        data["schedule"] = {STAGE: self.schedule}
        for number, (unit, serial) in enumerate(zip(self.secondaries, serials[1:], strict=True), 2):
            unit_meta = replace(unit, request=replace(unit.request, serial=serial)).log_meta()
            data[f"imu{number}"] = unit_meta.imu.model_dump()
        return validate(LogMeta, data, "configuration of the watch")


def require_one_temperature(product: ProductConfig) -> None:
    """Raise ConfigurationError if a product is calibrated over temperature, which units on one body cannot be."""
    if "temperature" in product.stages:
        raise ConfigurationError("temperature.not_watched", product=product.name)


def load_pair_configuration(request: RunRequest) -> PairConfiguration:
    """Read and check the files of a request for a station with secondaries. Raises ConfigurationError."""
    primary = load_configuration(request)
    require_one_temperature(primary.product)
    station, path = primary.station, primary.sources["station"].path
    with in_file(path):
        if not station.secondaries:
            raise EntryError("station.one_imu", "imu2")
        values = schedule_values(primary.product, STAGE, station.cross_calibration)
        schedule = validate(method(STAGE).schedule, values, f"{path}: {STAGE}")
        units = []
        for number, section in station.secondaries.items():
            name = section.profile or primary.product.imu
            imu = load_imu_profile(library.find("imus", name))
            rate, primary_rate = imu.stream.sample_rate_hz, primary.imu.stream.sample_rate_hz
            if rate != primary_rate:
                raise EntryError("station.imu_rates", f"imu{number}", "profile", rate=rate, primary=primary_rate)
            serial = section.serial_number or ("" if station.bench is None else f"{request.serial}-{number}")
            units.append(
                replace(
                    primary,
                    request=replace(request, serial=serial),
                    imu=imu,
                    station=station.model_copy(update={"imu": section}),
                )
            )
    return PairConfiguration(primary, tuple(units), schedule.model_dump(mode="json"))
