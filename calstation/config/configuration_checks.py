"""Checks that product, unit, table, chamber and site of a run are compatible."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

from calstation.config.product import in_file, register_conflicts, unknown_targets
from calstation.config.site_check import check_confirmation, check_gravity_sigma, check_site
from calstation.devices.links import CAN, SOCKETS, UDP
from calstation.devices.profiles import check_baud
from calstation.errors import ConfigurationError
from calstation.physics import NAMES, group_indices
from calstation.records import context_from_meta
from calstation.schema import EntryError
from procedures import method

if TYPE_CHECKING:
    from calstation.config.run_configuration import RunConfiguration


class ManualRigError(ConfigurationError):
    """Raised if the station cannot execute runs, or lacks the driven table, manual rig or gimbal that a stage needs."""


def check_station(setup: "RunConfiguration") -> None:
    """Check that the table and the site of the station are suitable for the product.

    Raises ConfigurationError, in particular ManualRigError if the table is not suitable or the IMUs are on one body.
    """
    if setup.station.secondaries:
        raise ManualRigError("product.pair_station", station=setup.station.name)
    check_manual_rig(setup)
    check_gimbal(setup)
    check_chamber(setup)
    meta, site = setup.log_meta(), setup.station.site
    with in_file(setup.sources["station"].path):
        check_site(meta)
        check_gravity_sigma(meta, setup.sigma_limits(context_from_meta(meta)))
        if setup.station.bench is None:
            check_confirmation(site, meta)


def check_manual_rig(setup: "RunConfiguration") -> None:
    """Check that every stage suits the station's table, manual rig or gimbal. Raises ManualRigError."""
    names = {"product": setup.product.name, "table": setup.table.name, "station": setup.station.name}
    for stage, schedule in setup.schedules.items():
        on_gimbal = method(stage).on_gimbal
        if on_gimbal and setup.table.gimbal is None:
            raise ManualRigError("plan.needs_gimbal")
        if not on_gimbal and setup.table.gimbal is not None:
            raise ManualRigError("product.needs_table", stage=stage, table=setup.table.name)
        manual = getattr(schedule, "manual", None)
        if setup.table.by_hand and manual is None:
            raise ManualRigError("product.needs_driven_table", stage=stage, **names)
        if setup.table.by_hand and not manual:
            raise ManualRigError("product.needs_manual_motion", stage=stage, **names)
        if manual and not setup.table.by_hand:
            raise ManualRigError("product.needs_manual_table", stage=stage, **names)


def check_gimbal(setup: "RunConfiguration") -> None:
    """Check that the registers of a unit on a gimbal can contain the correction. Raises ConfigurationError."""
    if setup.table.gimbal is None:
        return
    misalignments = {NAMES[i] for i in group_indices("gyro_misalign")}
    if setup.after_registers or not misalignments <= set(setup.register_map.parameters):
        raise ConfigurationError("product.gimbal_needs_registers", imu=setup.imu.name)


def check_chamber(setup: "RunConfiguration") -> None:
    """Check that a stage over temperature is the only one, and that there is a chamber for its temperatures.

    The chamber must also reach ambient, to which it returns. Raises ConfigurationError.
    """
    if "temperature" not in setup.schedules:
        return
    if len(setup.schedules) > 1:
        raise ConfigurationError("temperature.not_alone")
    if setup.product.temperature is None:
        raise ConfigurationError("temperature.no_section")
    section = setup.station.chamber
    if section is None or setup.chamber is None:
        raise ConfigurationError("temperature.no_chamber")
    points = getattr(setup.schedules["temperature"], "points_c", [])
    for device, (low, high) in {"chamber": setup.chamber.range_c, **temperature_ranges(setup)}.items():
        for value in (section.ambient_c, *points):
            if not low <= value <= high:
                values = {"temperature": value, "low": low, "high": high}
                raise ConfigurationError("chamber.target_outside", device=device, **values)


def temperature_ranges(setup: "RunConfiguration") -> dict[str, tuple[float, float]]:
    """Return the ranges of table and unit in a chamber, °C. Raises ConfigurationError if a profile has none."""
    ranges = {}
    for device, profile in (("table", setup.table), ("unit", setup.imu)):
        if profile.range_c is None:
            raise ConfigurationError("chamber.no_range", device=device, profile=profile.name)
        ranges[device] = profile.range_c
    return ranges


def product_errors(setup: "RunConfiguration") -> Iterator[EntryError]:
    """Yield the entries of the product that do not suit the unit."""
    yield from register_conflicts(setup.product, setup.imu)
    if "temperature" in setup.stages and setup.imu.states:
        yield EntryError("temperature.states", "temperature", states=setup.imu.states)
    yield from unknown_targets(setup.product.targets, "targets")
    for stage, schedule in setup.schedules.items():
        yield from unknown_targets(getattr(schedule, "targets", {}), "schedule", stage, "targets")


def check_baud_rates(setup: "RunConfiguration") -> None:
    """Check that the baud rate in the station file suffices for the unit's stream; for a socket it is unknown."""
    serial, port = setup.station.imu.serial, setup.station.imu.port or ""
    if serial is None or "baud" not in serial.model_fields_set or port.startswith((*SOCKETS, UDP, CAN)):
        return
    try:
        for frame in setup.imu.frames.values():
            check_baud(serial, frame, setup.imu.stream.sample_rate_hz)
    except EntryError as exc:  # the error contains the entry of the profile
        raise EntryError(exc.code, "imu", "serial", "baud", **exc.values) from None
