"""What a run at a station refuses whatever the product is, though each value of the file by itself may be saved."""

import tomllib
from collections.abc import Iterator

from calstation.config import library
from calstation.config.editing import Place, Problem
from calstation.config.site_check import normal_unlike, unlike
from calstation.config.station import StationConfig
from calstation.config.toml_lines import line_of
from calstation.connection.devices import ports_unlike
from calstation.devices.profiles.table import load_table_profile
from calstation.errors import ConfigurationError


def contradictions(text: str) -> list[Problem]:
    """Of a station file in which `settings.check` has found nothing wrong."""
    station = StationConfig.model_validate(tomllib.loads(text))
    return [
        Problem(place, "value_error", sentence, line_of(text, place))
        for place, sentence in (*_gravity(station), *_ports(station))
    ]


def _gravity(station: StationConfig) -> Iterator[tuple[Place, str]]:
    normal = normal_unlike(station.site)
    if normal is not None:
        yield ("site", "gravity_mps2"), unlike(station.site, normal)


def _ports(station: StationConfig) -> Iterator[tuple[Place, str]]:
    table, imu = station.table.port, station.imu.port
    try:
        profile = load_table_profile(library.find("tables", station.table.profile))
    except ConfigurationError:  # told by the profile's own file
        return
    if table is None or imu is None or profile.by_hand:
        return
    sentence = ports_unlike(profile, table, imu)
    if sentence is not None:
        yield ("imu", "port"), sentence
