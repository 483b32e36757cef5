"""Whether a station's rig is moved by hand, so that a run there guides who carries the unit."""

import tomllib
from pathlib import Path

from calstation.errors import CalstationError
from calstation.station import library
from calstation.station.config import load_station

RIG_PROTOCOL = "hand"
"""Protocol of a table profile that stands for rails without motor or encoder."""
STATION, PRODUCT = "virtual_hand", "mems_hand"
"""The shipped station of the virtual bench with such a rig, and the shipped product that is calibrated on it."""


def hand_rig(station: Path | None) -> bool:
    """Whether the rig of a station file (the default one where None) is moved by hand."""
    try:
        _, config = load_station(station)
        text = library.find("tables", config.table.profile).read_text(encoding="utf-8")
        return tomllib.loads(text).get("protocol") == RIG_PROTOCOL
    except (CalstationError, OSError, ValueError):
        return False


def guided_product() -> Path | None:
    """The product that is calibrated by hand; None where a site has none."""
    return library.find("products", PRODUCT) if PRODUCT in library.names("products") else None
