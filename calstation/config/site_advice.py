"""What a site's numbers mean, and which of them are hardly meant: normal gravity, and advice with its size."""

import math

from calstation.config.site_check import ANOMALY
from calstation.messages.finding import Finding, Value
from calstation.physics.earth import normal_gravity

#: Above this latitude, degrees, the earth's horizontal rate is too small to find an azimuth from.
_NEAR_POLE = 80.0

Number = float | int | None


def normal(latitude_deg: Number, height_m: Number) -> float | None:
    """Normal gravity of the place, m/s²; None where it is no place."""
    if not isinstance(latitude_deg, float | int) or not isinstance(height_m, float | int):
        return None
    if not (abs(latitude_deg) <= 90.0 and abs(height_m) <= 1e5):
        return None
    return normal_gravity(math.radians(latitude_deg), float(height_m))


def advice(
    latitude_deg: Number, longitude_deg: Number, height_m: Number, azimuth_deg: Number, gravity_mps2: Number
) -> tuple[Finding, ...]:
    """What is hardly meant, with what it would do; numbers that are no numbers are left to the file's check.

    ``gravity_off``: `ppm` that all three accelerometer scale factors would carry one to one, `normal` in m/s².
    ``null_island``: latitude and longitude are both zero. ``azimuth_hopeless``: to be found too near a pole.
    """
    found: list[Finding] = []
    expected = normal(latitude_deg, height_m)
    if expected is not None and isinstance(gravity_mps2, float | int):
        off = gravity_mps2 / expected - 1.0
        if abs(off) > ANOMALY:
            values: dict[str, Value] = {"ppm": off * 1e6, "percent": off * 1e2, "normal": expected}
            found.append(Finding("gravity_off", "look", values))
    if latitude_deg == 0 and longitude_deg == 0:
        found.append(Finding("null_island", "look"))
    if (
        azimuth_deg is None
        and isinstance(latitude_deg, float | int)
        and 90.0 >= abs(latitude_deg) > _NEAR_POLE
    ):
        found.append(Finding("azimuth_hopeless", "look", {"latitude": float(latitude_deg)}))
    return tuple(found)
