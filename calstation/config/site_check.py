"""Is the station where its file says? Latitude and gravity are believed, and accelerometer scale factors carry both.

Where gyros feel the earth turn, the rests of a run tell the latitude; a run that contradicts the file ends before
anything is written. Where they do not, nothing in a unit tells it: then gravity must be surveyed, and it must
agree with the latitude, so that a slip in either shows before anything moves. A whole station file that was taken to
another place agrees with itself: it names the computers at which a person has is_confirmed for it.
"""

import math
import platform
import uuid
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from calstation.config.station import StationSite
from calstation.errors import ConfigurationError
from calstation.estimation.common.latitude import LatitudeEstimate, resolves_earth_rate
from calstation.estimation.method import Solution
from calstation.messages.finding import Finding, Value
from calstation.physics.earth import normal_gravity
from calstation.records.limits import Check
from calstation.records.meta import LogMeta, SiteSection, context_from_meta
from procedures import method

#: Largest part by which gravity is another than normal gravity where people calibrate: 300 mGal. Free-air anomalies
#: beyond that are found on summits and islands only.
ANOMALY = 3e-4


#: Name of the check of the latitude seen.
LATITUDE = "latitude"


def this_computer() -> str:
    """Its name in the network, the address of its network adapter where it has none."""
    return platform.node() or f"{uuid.getnode():012x}"


def confirmation_key(site: StationSite) -> str:
    """What stands in `site.confirmed_on` where a person at this computer has made sure of these values."""
    gravity = "normal" if site.gravity_mps2 is None else site.gravity_mps2
    return f"{this_computer()}: {site.latitude_deg} {site.longitude_deg} {site.height_m} {gravity}"


def check_site(meta: LogMeta, station_path: Path) -> None:
    """Raises ConfigurationError where latitude and gravity contradict each other, or nothing could contradict them."""
    site = meta.site
    if site.gravity_mps2 is not None:
        _check_gravity(site, station_path)
        return
    if needs_surveyed_gravity(meta):
        raise ConfigurationError(
            f"{station_path}: site.gravity_mps2 is missing, and gyros of this grade do not feel the earth turn: a wrong"
            " latitude would show nowhere; add the gravity surveyed at the place, from a gravity net or a gravimeter"
        )


def is_confirmed(site: StationSite, *, needed: bool) -> bool:
    """Whether a person may be taken to have said at this computer that the station stands there.

    needed : nothing else tells it
    """
    return confirmation_key(site) in site.confirmed_on or not (site.confirmed_on or needed)


def check_confirmation(site: StationSite, meta: LogMeta, station_path: Path) -> None:
    """Raises ConfigurationError where hardware's place was is_confirmed for elsewhere, or must be and was not."""
    if is_confirmed(site, needed=needs_surveyed_gravity(meta)):
        return
    told = f"names {'; '.join(site.confirmed_on)}" if site.confirmed_on else "is missing"
    raise ConfigurationError(
        f"{station_path}: site.confirmed_on {told}, not '{confirmation_key(site)}': nobody has said at this computer"
        f" that the station stands at latitude {site.latitude_deg:g}°, longitude {site.longitude_deg:g}°, height"
        f" {site.height_m:g} m; make sure of them and of gravity, then confirm the place on the station page or add"
        f" '{confirmation_key(site)}' to site.confirmed_on"
    )


def needs_surveyed_gravity(meta: LogMeta) -> bool:
    """Whether scale factors are found that carry gravity, by a unit whose gyros do not tell the latitude."""
    context = context_from_meta(meta)
    stages = meta.run.stages if meta.run is not None else []
    scaled = any("accel_scale_x" in method(stage).estimates(context) for stage in stages)
    return scaled and not resolves_earth_rate(context.imu)


def _check_gravity(site: SiteSection, station_path: Path) -> None:
    normal = contradicted_normal_gravity(site)
    if normal is not None:
        raise ConfigurationError(f"{station_path}: {unlike(site, normal)}")


def contradicted_normal_gravity(site: SiteSection) -> float | None:
    """Normal gravity of the place, m/s², where the surveyed one cannot belong to it; None where it can, or is none."""
    normal = normal_gravity(float(np.deg2rad(site.latitude_deg)), site.height_m)
    if site.gravity_mps2 is None or abs(site.gravity_mps2 / normal - 1.0) <= ANOMALY:
        return None
    return normal


def unlike(site: SiteSection, normal: float) -> str:
    """The sentence for a gravity that is none of its latitude and height."""
    return (
        f"site.gravity_mps2 = {site.gravity_mps2:g} does not belong to latitude {site.latitude_deg:g}° and"
        f" height {site.height_m:g} m, where normal gravity is {normal:.5f}; correct gravity, latitude or height"
    )


def check_latitude(meta: LogMeta, solutions: tuple[Solution, ...]) -> list[Check]:
    """Whether the latest rests agree with the file's latitude; nothing where gyros do not tell."""
    seen = _seen(solutions)
    if seen is None:
        return []
    latitude = context_from_meta(meta).site.latitude
    limit = (latitude - seen.tolerance, latitude + seen.tolerance)
    return [Check.compare("latitude", seen.value, limit, "rad")]


def check_seen_latitude(meta: LogMeta, solutions: tuple[Solution, ...]) -> None:
    """Raises ConfigurationError where the gyros see another latitude than the file's."""
    seen = _seen(solutions)
    if seen is None or all(check.passed for check in check_latitude(meta, solutions)):
        return
    latitude, sigma = np.rad2deg(seen.value), np.rad2deg(seen.sigma)
    raise ConfigurationError(
        f"site.latitude_deg = {meta.site.latitude_deg:g} in the station file, but the unit's gyros see the earth turn"
        f" as at {latitude:.2f}° (sigma {sigma:.2f}°); correct latitude and gravity of the place, or look at the"
        " gyros where another unit agrees with the file"
    )


def latitude_untold(meta: LogMeta, solutions: tuple[Solution, ...]) -> dict[str, str | float] | None:
    """A stage that does not fit together and the latitude that it believed, where no rest has told the latitude.

    The unit may be sound then: rests of one way up, as those of `rate`, do not part the earth's rate from a bias. None
    where the latitude was told, where gyros do not feel it, and where everything fits.
    """
    inconsistent = next(
        (
            solution.stage
            for solution in solutions
            if not (solution.consistency.passed or method(solution.stage).needs_no_table)
        ),
        None,
    )
    if (
        inconsistent is None
        or _seen(solutions) is not None
        or not resolves_earth_rate(context_from_meta(meta).imu)
    ):
        return None
    return {"stage": inconsistent, "latitude": meta.site.latitude_deg}


def there(checks: Iterable[Check]) -> bool:
    """Whether no check found the station elsewhere: what a run measured there is of no use to another."""
    return all(check.passed for check in checks if check.kind == "latitude")


def _seen(solutions: tuple[Solution, ...]) -> LatitudeEstimate | None:
    return solutions[-1].latitude if solutions else None


#: Above this latitude, degrees, the earth's horizontal rate is too small to find an azimuth from.
_NEAR_POLE = 80.0

Number = float | int | None


def normal_gravity_at(latitude_deg: Number, height_m: Number) -> float | None:
    """Normal gravity of the place, m/s²; None where it is no place."""
    if not isinstance(latitude_deg, float | int) or not isinstance(height_m, float | int):
        return None
    if not (abs(latitude_deg) <= 90.0 and abs(height_m) <= 1e5):
        return None
    return normal_gravity(math.radians(latitude_deg), float(height_m))


def site_advice(
    latitude_deg: Number, longitude_deg: Number, height_m: Number, azimuth_deg: Number, gravity_mps2: Number
) -> tuple[Finding, ...]:
    """What is hardly meant, with what it would do; numbers that are no numbers are left to the file's check.

    ``gravity_off``: `ppm` that all three accelerometer scale factors would carry one to one, `normal` in m/s².
    ``null_island``: latitude and longitude are both zero. ``azimuth_hopeless``: to be found too near a pole.
    """
    found: list[Finding] = []
    expected = normal_gravity_at(latitude_deg, height_m)
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
