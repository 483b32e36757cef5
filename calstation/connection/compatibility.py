"""Compatibility of a product with the rig, the gravity, the site and the ports of a station.

All reasons why a run would be refused before its start are reported together.
"""

from collections.abc import Iterator
from dataclasses import replace

from calstation.config import (
    ManualRigError,
    RunConfiguration,
    StationConfig,
    check_manual_rig,
    confirmation_key,
    gravity_contradiction,
    is_confirmed,
    library,
    line_of,
    load_station,
    needs_surveyed_gravity,
    schedule_values,
    site_advice,
    this_computer,
)
from calstation.connection.devices import port_conflict
from calstation.devices.profiles import load_table_profile
from calstation.errors import ConfigurationError
from calstation.messages import Finding
from calstation.parsing import parse_toml
from calstation.schema import KeyPath, Problem, validate
from procedures import method

#: Finding for each error code of a station that lacks the rig that the product needs.
_RIG_FINDINGS = {
    "product.needs_manual_table": "needs_hands",
    "plan.needs_gimbal": "needs_gimbal",
    "product.needs_table": "needs_drive_not_gimbal",
}


def incompatibilities(setup: RunConfiguration) -> Iterator[Finding]:
    """Yield the reasons why a stage of the product cannot run. Raises ConfigurationError if a schedule is invalid."""
    product, site = setup.product, setup.station.site
    schedules = {
        stage: validate(method(stage).schedule, schedule_values(product, stage, {}), f"schedule.{stage}")
        for stage in product.stages
    }
    setup = replace(setup, schedules=schedules)
    try:
        check_manual_rig(setup)
    except ManualRigError as error:
        rig = {"rig": setup.table.name, "product": product.name}
        yield Finding(_RIG_FINDINGS.get(error.code, "needs_drive"), "warning", rig)
    needs_survey = needs_surveyed_gravity(setup.log_meta())
    contradiction = gravity_contradiction(site)
    if contradiction is not None:
        yield Finding("gravity_unlike", "warning", contradiction.values)
    if site.gravity_mps2 is None and needs_survey:
        yield Finding("gravity_missing", "warning")
    if setup.station.bench is not None:  # its simulated gravity is exactly that of its station
        return
    location = site.latitude_deg, site.longitude_deg, site.height_m, site.azimuth_deg
    advice = site_advice(*location, site.gravity_mps2, site.gravity_sigma_mps2)
    yield from (finding for finding in advice if finding.id in ("gravity_normal", "gravity_sigma_small"))
    if not is_confirmed(site, needed=needs_survey):
        yield Finding("place_not_confirmed", "warning", {"computer": this_computer(), "entry": confirmation_key(site)})
    shipped = library.shipped_folder() / "stations" / "example_hardware.toml"  # this file is the template for new files
    example = load_station(shipped)[1].site
    values = {"latitude": site.latitude_deg, "longitude": site.longitude_deg, "height": site.height_m}
    if values == {"latitude": example.latitude_deg, "longitude": example.longitude_deg, "height": example.height_m}:
        yield Finding("example_site", "info", values)


def station_conflicts(text: str) -> list[Problem]:
    """Return the problems of a valid station file that would cause runs to be refused."""
    data = parse_toml(text)
    station = StationConfig.model_validate(data)
    problems = [] if (error := gravity_contradiction(station.site)) is None else [Problem.of(error)]
    problems += _port_problems(station)
    return [replace(problem, line=line_of(text, problem.key_path), data=data) for problem in problems]


def _port_problems(station: StationConfig) -> Iterator[Problem]:
    links: dict[KeyPath, str | None] = {("slots", number): slot.port for number, slot in enumerate(station.slots)}
    links = links or {("imu",): station.imu.port}
    table = station.table.port
    try:
        profile = load_table_profile(library.find("tables", station.table.profile))
    except ConfigurationError:  # errors of the profile are reported for its file
        return
    for entry, imu in links.items():
        if table is None or imu is None or profile.by_hand:
            continue
        conflict = port_conflict(profile, table, imu)
        if conflict is not None:
            yield Problem((*entry, "port"), "value_error", conflict)
