"""Whether a station's rig is moved by hand, so that a run there guides who carries the unit."""

from pathlib import Path

from calstation.config import library
from calstation.config.station import load_station, rails_by_hand
from calstation.errors import CalstationError

#: The shipped station of the virtual bench with such a rig, and the shipped product that is calibrated on it.
STATION, PRODUCT = "virtual_hand", "mems_hand"


def hand_rig(station: Path | None) -> bool:
    """Whether the rig of a station file (the default one where None) is moved by hand."""
    try:
        _, config = load_station(station)
    except CalstationError:
        return False
    return rails_by_hand(config.table.profile)


def guided_product() -> Path | None:
    """The product that is calibrated by hand; None where a site has none."""
    return library.find("products", PRODUCT) if PRODUCT in library.names("products") else None
