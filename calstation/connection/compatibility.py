"""What keeps a product from being calibrated at a station whose links are right: its rig, its gravity, its place.

The same that `preparation.check_station` refuses before a run, all of it at once.
"""

import tomllib
from collections.abc import Iterator
from dataclasses import replace

from calstation.config import library
from calstation.config.editing import KeyPath, Problem, line_of
from calstation.config.resolved import ManualRigError, ResolvedConfiguration, check_manual_rig
from calstation.config.site_check import (
    confirmation_key,
    contradicted_normal_gravity,
    is_confirmed,
    needs_surveyed_gravity,
    this_computer,
    unlike,
)
from calstation.config.station import StationConfig, load_station, schedule_values
from calstation.connection.devices import port_conflict
from calstation.devices.profiles.table import load_table_profile
from calstation.errors import ConfigurationError
from calstation.messages.finding import Finding, Value
from calstation.schema import validate
from procedures import method

#: Station that new ones are copied from.
EXAMPLE = "example_hardware"


def incompatibilities(setup: ResolvedConfiguration) -> Iterator[Finding]:
    """Findings for all stages of the setup's product. Raises ConfigurationError where a schedule is wrong."""
    product, site = setup.product, setup.station.site
    schedules = {
        stage: validate(method(stage).schedule, schedule_values(product, stage, {}), f"schedule.{stage}")
        for stage in product.stages
    }
    setup = replace(setup, schedules=schedules)
    try:
        check_manual_rig(setup)
    except ManualRigError as error:
        values: dict[str, Value] = {"rig": setup.table.name, "product": product.name}
        yield Finding("needs_drive" if error.by_hand else "needs_hands", "look", values)
    blind = needs_surveyed_gravity(setup.log_meta())
    normal = contradicted_normal_gravity(site)
    if site.gravity_mps2 is not None and normal is not None:
        values = {"gravity": site.gravity_mps2, "normal": normal}
        values |= {"latitude": site.latitude_deg, "height": site.height_m}
        yield Finding("gravity_unlike", "look", values)
    if site.gravity_mps2 is None and blind:
        yield Finding("gravity_missing", "look")
    if setup.station.bench is not None:
        return
    if not is_confirmed(site, needed=blind):
        yield Finding(
            "place_not_confirmed", "look", {"computer": this_computer(), "entry": confirmation_key(site)}
        )
    example = load_station(library.find("stations", EXAMPLE))[1].site
    if (site.latitude_deg, site.longitude_deg, site.height_m) == (
        example.latitude_deg,
        example.longitude_deg,
        example.height_m,
    ):
        values = {"latitude": site.latitude_deg, "longitude": site.longitude_deg, "height": site.height_m}
        yield Finding("example_site", "told", values)


def station_conflicts(text: str) -> list[Problem]:
    """Of a station file in which `settings.check` has found nothing wrong."""
    station = StationConfig.model_validate(tomllib.loads(text))
    return [
        Problem(place, "value_error", sentence, line_of(text, place))
        for place, sentence in (*_gravity(station), *_ports(station))
    ]


def _gravity(station: StationConfig) -> Iterator[tuple[KeyPath, str]]:
    normal = contradicted_normal_gravity(station.site)
    if normal is not None:
        yield ("site", "gravity_mps2"), unlike(station.site, normal)


def _ports(station: StationConfig) -> Iterator[tuple[KeyPath, str]]:
    table, imu = station.table.port, station.imu.port
    try:
        profile = load_table_profile(library.find("tables", station.table.profile))
    except ConfigurationError:  # told by the profile's own file
        return
    if table is None or imu is None or profile.by_hand:
        return
    sentence = port_conflict(profile, table, imu)
    if sentence is not None:
        yield ("imu", "port"), sentence
