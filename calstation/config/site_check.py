"""Checks of a station's site before a run, because latitude and gravity determine the accelerometer scale factors.

If the gyros resolve earth rate, the rests of the run reveal a wrong latitude (see `calstation.judgement.site`).
Otherwise gravity must be surveyed and agree with the latitude. A station file copied from another station is
consistent in itself; therefore each file lists the computers on which its site was confirmed.
"""

import platform
import uuid
from collections.abc import Mapping

import numpy as np

from calstation.config.station_sections import StationSite
from calstation.estimation.common import NORMAL_GRAVITY_SIGMA, resolves_earth_rate
from calstation.messages import Finding, Value
from calstation.physics import normal_gravity
from calstation.records import LogMeta, SiteSection, context_from_meta
from calstation.schema import EntryError
from procedures import method

#: Maximum relative difference between gravity and normal gravity, 300 mGal. Larger free-air anomalies occur only on
#: summits and islands.
MAX_GRAVITY_ANOMALY = 3e-4

#: Difference from normal gravity below which a surveyed value was probably computed, m/s².
_COMPUTED_GRAVITY = 1e-5

#: Latitude above which the horizontal component of earth rate is too small to find an azimuth, degrees.
_NEAR_POLE = 80.0

Number = float | int | None


def this_computer() -> str:
    """Return the network name of this computer, or the address of its network adapter."""
    return platform.node() or f"{uuid.getnode():012x}"


def confirmation_key(site: StationSite) -> str:
    """Return the entry of `site.confirmed_on` that confirms these values on this computer."""
    gravity = "normal" if site.gravity_mps2 is None else site.gravity_mps2
    return f"{this_computer()}: {site.latitude_deg} {site.longitude_deg} {site.height_m} {gravity}"


def is_confirmed(site: StationSite, *, needed: bool) -> bool:
    """Return whether the site is confirmed on this computer.

    A site without any confirmation counts as confirmed unless a confirmation is `needed`.
    """
    return confirmation_key(site) in site.confirmed_on or not (site.confirmed_on or needed)


def check_confirmation(site: StationSite, meta: LogMeta) -> None:
    """Check that the site of a hardware station is confirmed on this computer. Raises EntryError."""
    if is_confirmed(site, needed=needs_surveyed_gravity(meta)):
        return
    values = {"latitude": site.latitude_deg, "longitude": site.longitude_deg, "height": site.height_m}
    entry, key = ("site", "confirmed_on"), confirmation_key(site)
    if site.confirmed_on:
        raise EntryError("site.confirmed_elsewhere", *entry, confirmed="; ".join(site.confirmed_on), key=key, **values)
    raise EntryError("site.not_confirmed", *entry, key=key, **values)


def check_site(meta: LogMeta) -> None:
    """Check that latitude and gravity agree, and that errors of both can be detected. Raises EntryError."""
    error = gravity_contradiction(meta.site)
    if error is not None:
        raise error
    if meta.site.gravity_mps2 is None and needs_surveyed_gravity(meta):
        raise EntryError("site.gravity_missing", "site", "gravity_mps2")


def check_gravity_sigma(meta: LogMeta, limits: Mapping[str, float]) -> None:
    """Check that the sigma of gravity permits the sigma limits of the parameters. Raises EntryError."""
    for name, limit in limits.items():
        excess = excess_gravity_sigma(meta, name, limit)
        if excess is not None:
            entry = "gravity_mps2" if meta.site.gravity_mps2 is None else "gravity_sigma_mps2"
            raise EntryError("site.gravity_uncertain", "site", entry, parameter=name, **excess)


def excess_gravity_sigma(meta: LogMeta, parameter: str, limit: float) -> dict[str, float] | None:
    """Return the sigma of gravity and the sigma limit of a parameter, ppm, if the former alone exceeds the latter.

    Otherwise the result is None. The relative gravity error is also an error of the accelerometer scale factors,
    regardless of the duration of the run.

    Parameters
    ----------
    meta : configuration of the log
    parameter : name of an accelerometer parameter
    limit : sigma limit of the parameter, SI
    """
    if not parameter.startswith("accel_scale"):
        return None
    sigma = context_from_meta(meta).site.relative_gravity_sigma
    return None if sigma < limit else {"sigma_ppm": sigma * 1e6, "limit_ppm": limit * 1e6}


def needs_surveyed_gravity(meta: LogMeta) -> bool:
    """Return whether the run estimates accelerometer scale factors and the gyros cannot resolve earth rate."""
    context = context_from_meta(meta)
    stages = meta.run.stages if meta.run is not None else []
    scale = any("accel_scale_x" in method(stage).estimates(context) for stage in stages)
    return scale and not resolves_earth_rate(context.imu)


def gravity_contradiction(site: SiteSection) -> EntryError | None:
    """Return the error for a surveyed gravity that is impossible at its latitude and height, or None."""
    normal = normal_gravity(float(np.deg2rad(site.latitude_deg)), site.height_m)
    if site.gravity_mps2 is None or abs(site.gravity_mps2 / normal - 1.0) <= MAX_GRAVITY_ANOMALY:
        return None
    values = {"gravity": site.gravity_mps2, "latitude": site.latitude_deg, "height": site.height_m, "normal": normal}
    return EntryError("site.gravity_contradicts", "site", "gravity_mps2", **values)


def normal_gravity_at(latitude_deg: Number, height_m: Number) -> float | None:
    """Return normal gravity at a location, m/s², or None if the location is impossible."""
    if not isinstance(latitude_deg, float | int) or not isinstance(height_m, float | int):
        return None
    if not (abs(latitude_deg) <= 90.0 and abs(height_m) <= 1e5):
        return None
    return normal_gravity(float(np.deg2rad(latitude_deg)), float(height_m))


def site_advice(
    latitude_deg: Number,
    longitude_deg: Number,
    height_m: Number,
    azimuth_deg: Number,
    gravity_mps2: Number,
    gravity_sigma_mps2: Number = None,
) -> tuple[Finding, ...]:
    """Return warnings for values of a station file that are probably mistakes; non-numeric values are ignored.

    ``gravity_off`` contains the resulting error of the accelerometer scale factors, ppm, and normal gravity, m/s²;
    ``gravity_normal`` means a surveyed value that equals normal gravity, and ``gravity_sigma_small`` a sigma of the
    computed normal gravity, ppm, below that of `NORMAL_GRAVITY_SIGMA`.
    ``null_island`` means zero latitude and longitude, and ``azimuth_hopeless`` an unknown azimuth near a pole.

    Parameters
    ----------
    latitude_deg, longitude_deg, azimuth_deg : latitude, longitude and azimuth, degrees
    height_m : height, m
    gravity_mps2, gravity_sigma_mps2 : surveyed gravity and its sigma, m/s²; without the former, the sigma is that of
        normal gravity
    """
    warnings: list[Finding] = []
    expected = normal_gravity_at(latitude_deg, height_m)
    if expected is not None and isinstance(gravity_mps2, float | int):
        off = gravity_mps2 / expected - 1.0
        if abs(off) > MAX_GRAVITY_ANOMALY:
            values: dict[str, Value] = {"ppm": off * 1e6, "percent": off * 1e2, "normal": expected}
            warnings.append(Finding("gravity_off", "warning", values))
        elif abs(gravity_mps2 - expected) < _COMPUTED_GRAVITY:
            warnings.append(Finding("gravity_normal", "warning"))
    sigma = gravity_sigma_mps2 if isinstance(gravity_sigma_mps2, float | int) else 0.0
    if expected is not None and gravity_mps2 is None and 0.0 < sigma < NORMAL_GRAVITY_SIGMA:
        ppm = {"sigma_ppm": sigma / expected * 1e6, "normal_ppm": NORMAL_GRAVITY_SIGMA / expected * 1e6}
        warnings.append(Finding("gravity_sigma_small", "warning", ppm))
    if latitude_deg == 0 and longitude_deg == 0:
        warnings.append(Finding("null_island", "warning"))
    if azimuth_deg is None and isinstance(latitude_deg, float | int) and 90.0 >= abs(latitude_deg) > _NEAR_POLE:
        warnings.append(Finding("azimuth_hopeless", "warning", {"latitude": float(latitude_deg)}))
    return tuple(warnings)
