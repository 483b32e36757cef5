"""Initial attitude of a segment: a prior from the encoders and the site, and a linearisation point from the data."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calstation.estimation.common.context import Posterior, Site, SolveContext
from calstation.estimation.common.model_test import Diagnosis, ModelTest
from calstation.estimation.common.stage import SHORTEST_REST, StageData, find_rests, mean_angles
from calstation.physics import (
    RATE,
    UP,
    FloatArray,
    axis_rotation,
    compensate,
    compensation,
    level_attitude,
    rotation_matrix,
    rotation_vector,
)

#: Standard deviation of an unknown azimuth, rad.
FREE_AZIMUTH_SIGMA = np.pi / np.sqrt(3.0)
#: Prior sigma of a tilt found from the accelerometers alone, rad: wide, so that the data dominate.
FREE_TILT_SIGMA = 0.2
#: Largest sigma of a gyrocompassed azimuth used as linearisation point, rad; above it, several headings are compared.
AMBIGUOUS_AZIMUTH_SIGMA = 0.35
#: Longest part of a rest that is used for alignment, s.
LONGEST_REST = 20.0
#: Largest difference of a start attitude from its prior, in prior sigmas.
MAX_START_ERROR = 5.0


@dataclass(frozen=True)
class Start:
    """Start of a segment and its initial attitude."""

    begin: int  #: Index of the first sample, which is at rest.
    end: int  #: Index after the last sample.
    prior: FloatArray  #: Prior attitude C_bn, shape (3, 3).
    prior_sigma: FloatArray  #: Sigma of the attitude error φ of the prior, in ENU, rad, shape (3,).
    attitude: FloatArray  #: Attitude C_bn to linearise about, shape (3, 3).
    azimuth_sigma: float | None  #: Sigma of the gyrocompassed heading, rad; None if the azimuth is known.


def starts(data: StageData, context: SolveContext, posterior: Posterior) -> list[Start]:
    """Return the initial attitude of every segment with a rest of at least `SHORTEST_REST`; omit the other segments.

    The rate at an observation is the mean of the samples before and after it. One sample is therefore omitted on either
    side of a gap, so that a rotation beyond the gap does not affect the rate at rest.
    """
    aligned = []
    for first, last in data.segments:
        segment = (first + (first > 0), last - (last < len(data)))
        for a, b in find_rests(data, context.imu, posterior.gyro_bias, [segment]):
            if (b - a) * data.dt >= SHORTEST_REST:
                aligned.append(_align(data, a, min(b, a + int(LONGEST_REST / data.dt)), segment[1], context, posterior))
                break
    return aligned


def _align(data: StageData, a: int, b: int, end: int, context: SolveContext, posterior: Posterior) -> Start:
    omega, force = compensate(compensation(posterior.mean), data.gyro[a:b], data.accel[a:b])
    rate_b, up_b = omega.mean(axis=0), force.mean(axis=0)
    table, site = context.table, context.site
    angles = mean_angles(data, a, b)
    tilt = table.tilt_sigma
    if angles is None:
        attitude, sigma = gyrocompass(rate_b, up_b, site.latitude, posterior)
        return Start(a, end, attitude, np.array([FREE_TILT_SIGMA] * 2 + [FREE_AZIMUTH_SIGMA]), attitude, sigma)
    geometry = table.geometry
    if site.azimuth is None:
        _, sigma = gyrocompass(rate_b, up_b, site.latitude, posterior)
        home = geometry.body_to_home(*angles)
        prior = axis_rotation((0.0, 0.0, 1.0), _heading_offset(home @ rate_b)) @ home
        prior_sigma = np.array([tilt, tilt, FREE_AZIMUTH_SIGMA])
        return Start(a, end, prior, prior_sigma, align_vertical(prior, up_b), sigma)
    prior = geometry.body_to_level(angles[0], angles[1], site.azimuth)
    azimuth = np.sqrt(table.azimuth_sigma**2 + table.mount_sigma**2 + table.encoder_sigma**2)
    return Start(a, end, prior, np.array([tilt, tilt, azimuth]), align_vertical(prior, up_b), None)


def start_tests(starts: Sequence[Start], attitudes: Sequence[FloatArray], site: Site) -> list[ModelTest]:
    """Compare the solved start attitudes with their priors; return the test of the largest error, if there are starts.

    Parameters
    ----------
    starts : starts of the segments
    attitudes : solved attitude C_bn at each start, shape (3, 3)
    site : site with its latitude and heading
    """
    errors = [(rotation_vector(C @ s.prior.T) / s.prior_sigma, s) for s, C in zip(starts, attitudes, strict=True)]
    if not errors:
        return []
    error, start = max(errors, key=lambda each: float(np.max(np.abs(each[0]))))
    axis = int(np.argmax(np.abs(error)))
    sigma, size = float(start.prior_sigma[axis]), float((error * start.prior_sigma)[axis])
    values = {"measured": float(np.rad2deg(abs(size))), "prior": float(np.rad2deg(sigma))}
    if axis == 2 and site.azimuth is not None:
        degrees = {"measured": site.azimuth - size, "expected": site.azimuth}
        values |= {name: float(np.rad2deg(angle)) % 360.0 for name, angle in degrees.items()}
    diagnosis = Diagnosis("heading_unlike" if axis == 2 else "mount_unlike", size, sigma, "rad", values=values)
    return [ModelTest("start_attitude", float(abs(error[axis])), MAX_START_ERROR, "1", diagnosis)]


def align_vertical(attitude: FloatArray, up_b: FloatArray) -> FloatArray:
    """Rotate `attitude` by the smallest angle that makes the measured up direction vertical; return shape (3, 3)."""
    up_n = attitude @ up_b / np.linalg.norm(up_b)
    axis = np.cross(up_n, UP)
    sine = float(np.linalg.norm(axis))
    if sine < 1e-12:
        return attitude
    return np.asarray(rotation_matrix(axis / sine * np.arctan2(sine, up_n @ UP)) @ attitude)


def _heading_offset(rate_level: FloatArray) -> float:
    """Return the rotation about up, rad, that aligns the horizontal part of a levelled earth rate with north."""
    return float(np.arctan2(rate_level[0], rate_level[1]))


def gyrocompass(
    rate_b: FloatArray, up_b: FloatArray, latitude: float, posterior: Posterior
) -> tuple[FloatArray, float]:
    """Return C_bn, levelled by the mean specific force and aligned to north by the mean rate, and the azimuth sigma.

    The azimuth's sigma, rad, is the sigma of the gyro bias divided by Ω cos φ with the latitude φ (IEEE Std 1780).

    Parameters
    ----------
    rate_b, up_b : mean rate, rad/s, and mean specific force, m/s², shape (3,) each
    latitude : geodetic latitude, rad
    posterior : estimate with the gyro bias and its sigma
    """
    level = level_attitude(up_b)
    attitude = axis_rotation((0.0, 0.0, 1.0), _heading_offset(level @ rate_b)) @ level
    return attitude, posterior.gyro_bias[1] / max(RATE * float(np.cos(latitude)), 1e-12)
