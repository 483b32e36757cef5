"""Rests of a recording and the motions between them, found from the data alone.

Noise and rate at rest are taken from the quietest windows. If the force jumps between two quiet intervals without a
rotation, samples were cut out, and no motion connects the rests on either side.
"""

import itertools
from dataclasses import dataclass, replace

import numpy as np

from calstation.estimation.common.context import ImuModel
from calstation.estimation.common.stage import (
    REST_MARGIN,
    REST_WINDOW,
    SHORTEST_REST,
    StageData,
    find_rests,
    runs,
    window_mean,
)
from calstation.physics import FloatArray

#: Fraction of all windows, the quietest ones, whose noise defines the noise at rest.
QUIET_FRACTION = 0.1
#: Windows with noise up to this multiple of the quietest windows' noise also count as quiet.
QUIET_RATIO = 1.5
#: A window with more gyro noise than this, rad/s rms, is in motion.
MAX_GYRO_NOISE = np.deg2rad(1.0)
#: Duration that must be quiet on each side of a cut, s.
CUT_WINDOW = 0.15
#: Smallest jump of the force across a cut, m/s².
CUT_STEP = 2.0
#: Without gyros: noise of a rest relative to the quietest windows' noise, rms over the axes; ...
MAX_FORCE_NOISE = 2.0
#: ... change of mean force from one window to the next, in sigmas of its noise; ...
STEADY_FORCE = 6.0
#: ... and change of mean force that does not count as a motion, m/s².
CREEP_FORCE = 0.02
#: Standard deviation of the rate at rest about the mean rate of the quietest windows, rad/s.
RESTING_RATE_SIGMA = np.deg2rad(0.2)


@dataclass(frozen=True)
class Link:
    """An uninterrupted motion between two successive rests."""

    first: int  #: Index of the rest before the motion.
    second: int  #: Index of the rest after the motion.
    start: int  #: Index of the first sample of the motion.
    stop: int  #: Index after the last sample of the motion.


@dataclass(frozen=True)
class Stillness:
    """Rests of a recording and the motions between them."""

    rests: tuple[tuple[int, int], ...]  #: (start, stop) of each rest.
    links: tuple[Link, ...]  #: The motions between successive rests.
    gyro_noise: float  #: White noise at rest, rad/√s.
    accel_noise: float  #: White noise at rest, m/s/√s.
    rate: FloatArray  #: Mean raw rate at rest, rad/s, shape (3,).
    cuts: tuple[int, ...] = ()  #: Index of the first sample after each cut, which leaves no gap in the counter.


def find_stillness(data: StageData, imu: ImuModel, shortest: float = SHORTEST_REST) -> Stillness:
    """Find the rests of at least `shortest` s and the motions of all segments; the noise of `imu` is a lower bound.

    Without gyros, only rests are found, from the accelerometers, and no motions.
    """
    windows = _windows(data)
    if not data.has_gyros:
        return _force_stillness(data, imu, shortest, windows[:, 1])
    gyro_std, accel_std, rate = windows[:, 0], windows[:, 1], windows[:, 2:]
    limit = min(QUIET_RATIO * float(np.quantile(gyro_std, QUIET_FRACTION)), MAX_GYRO_NOISE) if len(windows) else 0.0
    quiet = gyro_std <= limit
    if not quiet.any():
        return Stillness((), (), imu.gyro_arw, imu.accel_vrw, np.zeros(3))
    noise = max(imu.gyro_arw, float(np.median(gyro_std[quiet])) * np.sqrt(data.dt))
    accel_noise = max(imu.accel_vrw, float(np.median(accel_std[quiet])) * np.sqrt(data.dt))
    resting = np.median(rate[quiet], axis=0)
    seen = replace(imu, gyro_arw=noise)
    rests: list[tuple[int, int]] = []
    links: list[Link] = []
    cuts = _find_cuts(data, noise, accel_noise, resting)
    for segment in _cut(data.segments, cuts):
        here = [
            (a, b)
            for a, b in find_rests(data, seen, (resting, RESTING_RATE_SIGMA), [segment])
            if (b - a) * data.dt >= shortest
        ]
        for k, ((_, end), (start, _)) in enumerate(itertools.pairwise(here), len(rests)):
            links.append(Link(k, k + 1, end, start))
        rests += here
    return Stillness(tuple(rests), tuple(links), noise, accel_noise, resting, cuts)


def _force_stillness(data: StageData, imu: ImuModel, shortest: float, accel_std: FloatArray) -> Stillness:
    """Return the rests with constant specific force, given the noise of the quietest windows, m/s², shape (k,).

    A window is at rest if it is as quiet as the quietest ones and its mean agrees with the windows before and after it.
    """
    quietest = float(np.quantile(accel_std, QUIET_FRACTION)) if len(accel_std) else 0.0
    lowest = float(np.hypot(imu.accel_vrw / np.sqrt(data.dt), imu.accel_lsb * imu.rate_factor / np.sqrt(12.0)))
    noise = max(quietest, lowest)
    width = max(round(REST_WINDOW / data.dt), 8)
    margin = round(REST_MARGIN / data.dt)
    rests: list[tuple[int, int]] = []
    for start, stop in data.segments:
        if stop - start < 2 * width:
            continue
        force = window_mean(data.accel[start:stop], np.zeros(3), width)
        square = window_mean((data.accel[start:stop] - force.mean(axis=0)) ** 2, np.zeros(3), width)
        power = (square - (force - force.mean(axis=0)) ** 2).mean(axis=1)
        still = power < (MAX_FORCE_NOISE * noise) ** 2
        moved = np.abs(force[width:] - force[:-width]).max(axis=1) > STEADY_FORCE * noise / np.sqrt(width) + CREEP_FORCE
        still[width:] &= ~moved
        still[:-width] &= ~moved
        for first, last in runs(still):
            a, b = start + first + margin, start + last + width - 1 - margin
            if (b - a) * data.dt >= shortest:
                rests.append((a, b))
    return Stillness(tuple(rests), (), imu.gyro_arw, noise * float(np.sqrt(data.dt)), np.full(3, np.nan))


def _find_cuts(data: StageData, gyro_noise: float, accel_noise: float, resting: FloatArray) -> tuple[int, ...]:
    """Return the samples at which the force jumps between two intervals of rest without a rotation."""
    width = max(round(CUT_WINDOW / data.dt), 4)
    slow = np.deg2rad(2.0) + 5.0 * gyro_noise / np.sqrt(width * data.dt)
    loud = 0.1 + 3.0 * accel_noise / np.sqrt(data.dt)
    cuts = []
    for start, stop in data.segments:
        if stop - start < 2 * width:
            continue
        rate = window_mean(data.gyro[start:stop], resting, width)
        force = window_mean(data.accel[start:stop], np.zeros(3), width)
        square = window_mean(data.accel[start:stop] ** 2, np.zeros(3), width)
        still = np.abs(rate).max(axis=1) < slow
        still &= np.sqrt(np.maximum(square - force**2, 0.0)).max(axis=1) < loud
        step = np.linalg.norm(force[width:] - force[:-width], axis=1)
        jump = still[width:] & still[:-width] & (step > CUT_STEP)
        for first, last in runs(jump):
            cuts.append(start + width + first + int(np.argmax(step[first:last])))
    return tuple(cuts)


def _cut(segments: tuple[tuple[int, int], ...], cuts: tuple[int, ...]) -> list[tuple[int, int]]:
    parts = []
    for start, stop in segments:
        edges = [start, *(c for c in cuts if start < c < stop), stop]
        parts += list(itertools.pairwise(edges))
    return parts


def _windows(data: StageData) -> FloatArray:
    """Return gyro and accelerometer noise (rms per axis, rad/s and m/s²) and mean rate of each window, shape (k, 5)."""
    width = max(round(REST_WINDOW / data.dt), 8)
    rows = []
    for start, stop in data.segments:
        count = (stop - start) // width
        if count:
            gyro = data.gyro[start : start + count * width].reshape(count, width, 3)
            accel = data.accel[start : start + count * width].reshape(count, width, 3)
            gyro_rms = np.sqrt(gyro.var(axis=1, ddof=1).mean(axis=1))
            accel_rms = np.sqrt(accel.var(axis=1, ddof=1).mean(axis=1))
            rows.append(np.column_stack([gyro_rms, accel_rms, gyro.mean(axis=1)]))
    return np.vstack(rows) if rows else np.empty((0, 5))
