"""Detection of the rests of a recording and the motions between them.

The noise and rate at rest are those of the quietest windows. If the force jumps between two quiet intervals without a
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
    true_intervals,
    window_mean,
)
from calstation.physics import FloatArray

#: Fraction of all windows, the quietest ones, whose noise defines the noise at rest.
QUIET_FRACTION = 0.1
#: Largest noise of a quiet window, relative to the quietest windows.
QUIET_RATIO = 1.5
#: Largest gyro noise of a window at rest, rad/s rms.
MAX_GYRO_NOISE = np.deg2rad(1.0)
#: Duration of the quiet intervals on both sides of a cut, s.
CUT_WINDOW = 0.15
#: Smallest jump of the force across a cut, m/s².
CUT_STEP = 2.0
#: Largest noise of a rest without gyros, relative to the quietest windows, rms over the axes.
MAX_FORCE_NOISE = 2.0
#: Largest change of the mean force between windows at rest without gyros: this many sigmas of its noise ...
STEADY_FORCE = 6.0
#: ... plus this force, m/s².
CREEP_FORCE = 0.02
#: Smallest duration of an interval that counts as a rest that is too short, relative to the shortest rest.
NEARLY_LONG = 0.4
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
    cuts: tuple[int, ...] = ()  #: Index of the first sample after each cut; a cut is not visible in the counter.
    too_short: int = 0  #: Number of rests that are too short.


def find_stillness(data: StageData, imu: ImuModel, shortest: float = SHORTEST_REST) -> Stillness:
    """Find the rests of at least `shortest` s and the motions of all segments; the noise of `imu` is a lower bound.

    Without gyros, rests are found from the accelerometers, and motions are not found.
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
    measured_imu = replace(imu, gyro_arw=noise)
    rests: list[tuple[int, int]] = []
    links: list[Link] = []
    cuts = _find_cuts(data, noise, accel_noise, resting)
    too_short = 0
    for start, stop in data.segments:
        for part in itertools.pairwise([start, *(c for c in cuts if start < c < stop), stop]):
            candidates = find_rests(data, measured_imu, (resting, RESTING_RATE_SIGMA), [part])
            part_rests = [(a, b) for a, b in candidates if (b - a) * data.dt >= shortest]
            too_short += sum(NEARLY_LONG * shortest <= (b - a) * data.dt < shortest for a, b in candidates)
            for k, ((_, end), (begin, _)) in enumerate(itertools.pairwise(part_rests), len(rests)):
                links.append(Link(k, k + 1, end, begin))
            rests += part_rests
    return Stillness(tuple(rests), tuple(links), noise, accel_noise, resting, cuts, too_short)


def _force_stillness(data: StageData, imu: ImuModel, shortest: float, accel_std: FloatArray) -> Stillness:
    """Find the rests from the specific force; `accel_std` is the noise of each window, m/s², shape (k,).

    A window is at rest if it is as quiet as the quietest ones and its mean agrees with the windows before and after it.
    """
    quietest = float(np.quantile(accel_std, QUIET_FRACTION)) if len(accel_std) else 0.0
    lowest = float(np.hypot(imu.accel_vrw / np.sqrt(data.dt), imu.accel_lsb * imu.rate_factor / np.sqrt(12.0)))
    noise = max(quietest, lowest)
    width = max(round(REST_WINDOW / data.dt), 8)
    margin = round(REST_MARGIN / data.dt)
    rests: list[tuple[int, int]] = []
    too_short = 0
    for start, stop in data.segments:
        if stop - start < 2 * width:
            continue
        force = window_mean(data.accel[start:stop], np.zeros(3), width)
        square = window_mean((data.accel[start:stop] - force.mean(axis=0)) ** 2, np.zeros(3), width)
        power = (square - (force - force.mean(axis=0)) ** 2).mean(axis=1)
        still = power < (MAX_FORCE_NOISE * noise) ** 2
        # a window next to a motion differs from one within it, which is not still anyway
        changes = still[width:] & still[:-width]
        changes &= (
            np.abs(force[width:] - force[:-width]).max(axis=1) > STEADY_FORCE * noise / np.sqrt(width) + CREEP_FORCE
        )
        still[width:] &= ~changes
        still[:-width] &= ~changes
        for first, last in true_intervals(still):
            a, b = start + first + margin, start + last + width - 1 - margin
            if (b - a) * data.dt >= shortest:
                rests.append((a, b))
            else:
                too_short += (b - a) * data.dt >= NEARLY_LONG * shortest
    force_noise = noise * float(np.sqrt(data.dt))
    return Stillness(tuple(rests), (), imu.gyro_arw, force_noise, np.full(3, np.nan), too_short=too_short)


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
        for first, last in true_intervals(jump):
            cuts.append(start + width + first + int(np.argmax(step[first:last])))
    return tuple(cuts)


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
