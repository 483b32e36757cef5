"""Checks of a station's site, whose latitude is compared with that measured by the gyros at rest."""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from calstation.errors import ConfigurationError
from calstation.estimation import Diagnosis, Solution
from calstation.estimation.common import LatitudeEstimate, resolves_earth_rate
from calstation.judgement.check import Check
from calstation.physics import DEGREE_PER_HOUR, RATE
from calstation.records import LogMeta, context_from_meta
from procedures import method


def unconfirmed_site(meta: LogMeta, solutions: Iterable[Solution]) -> dict[str, float] | None:
    """Return the site of a recording by another program if a run there would require its confirmation, otherwise None.

    A run requests this confirmation before it records.
    """
    context = context_from_meta(meta)
    scale = any("accel_scale_x" in solution.estimated for solution in solutions)
    if meta.run is not None or not scale or resolves_earth_rate(context.imu):
        return None
    site = context.site
    location = {"latitude": meta.site.latitude_deg, "longitude": meta.site.longitude_deg, "height": meta.site.height_m}
    return {**location, "gravity": site.local_gravity, "sigma_ppm": site.relative_gravity_sigma * 1e6}


def check_latitude(meta: LogMeta, solutions: Sequence[Solution]) -> list[Check]:
    """Compare the latitude measured in all rests so far with the file; return [] if it was not measured.

    A wrong latitude is the same in every stage; if the stages disagree, a gyro bias has changed.
    """
    measured = _measured_latitude(solutions)
    if measured is None:
        return []
    latitude = context_from_meta(meta).site.latitude
    limit = (latitude - measured.tolerance, latitude + measured.tolerance)
    check = Check.compare("latitude", measured.value, limit, "rad")
    if check.passed:
        return [check]
    values = {
        "measured": float(np.rad2deg(measured.value)),
        "latitude": meta.site.latitude_deg,
        "rate": RATE * float(np.sin(measured.value) - np.sin(latitude)) / DEGREE_PER_HOUR,
        "rate_sigma": RATE * float(np.cos(measured.value)) * measured.sigma / DEGREE_PER_HOUR,
    }
    wrong = Diagnosis("latitude_unlike", measured.value - latitude, measured.sigma, "rad", values=values)
    return [replace(check, diagnosis=_changed_bias(solutions, measured) or wrong)]


def _changed_bias(solutions: Sequence[Solution], latest: LatitudeEstimate) -> Diagnosis | None:
    """Return a changed gyro bias as the cause if an earlier stage measured a different latitude."""
    for solution in solutions[:-1]:
        earlier = solution.latitude
        if earlier is not None and latest.contradicts(earlier):
            change, sigma = latest.value - earlier.value, float(np.hypot(latest.sigma, earlier.sigma))
            values = {
                "earlier": float(np.rad2deg(earlier.value)),
                "during": solution.stage,
                "later": float(np.rad2deg(latest.value)),
                "stage": solutions[-1].stage,
            }
            return Diagnosis("gyro_bias_wanders", change, sigma, "rad", values=values)
    return None


def require_latitude(meta: LogMeta, solutions: Sequence[Solution]) -> None:
    """Raise ConfigurationError if the latitude measured by the gyros contradicts the file's latitude."""
    for check in check_latitude(meta, solutions):
        diagnosis = check.diagnosis
        if diagnosis is not None and diagnosis.cause == "latitude_unlike":
            values = {name: diagnosis.values[name] for name in ("latitude", "measured", "rate")}
            raise ConfigurationError("site.latitude_contradicts", sigma=float(np.rad2deg(diagnosis.sigma)), **values)


def unconfirmed_latitude(meta: LogMeta, solutions: Sequence[Solution]) -> dict[str, str | float] | None:
    """Return the first inconsistent stage and its assumed latitude if no stage has rests that confirm the latitude.

    The unit may nevertheless be good: rests in one attitude, as in `rate`, do not separate earth rate from a bias.
    Return None if a stage measured the latitude or has rests with the unit upright and inverted, if the gyros cannot
    resolve earth rate, or if every stage is consistent.
    """
    inconsistent = [s.stage for s in solutions if not (s.consistency.passed or method(s.stage).needs_no_table)]
    if not inconsistent or any(s.latitude is not None or _is_inverted(s) for s in solutions):
        return None
    if not resolves_earth_rate(context_from_meta(meta).imu):
        return None
    return {"stage": inconsistent[0], "latitude": meta.site.latitude_deg}


def latitude_agrees(checks: Iterable[Check]) -> bool:
    """Return whether no latitude check failed; a run can be resumed only at the same location."""
    return all(check.passed for check in checks if check.kind == "latitude")


def _is_inverted(solution: Solution) -> bool:
    """Return whether a stage has rests with the unit upright and inverted, because it estimates biases and scales."""
    return all(f"accel_{kind}_{axis}" in solution.estimated for kind in ("bias", "scale") for axis in "xyz")


def _measured_latitude(solutions: Sequence[Solution]) -> LatitudeEstimate | None:
    return solutions[-1].latitude if solutions else None
