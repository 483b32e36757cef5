"""Latitude from the output of a unit at rest: the component of earth rate along the measured up direction.

No other check of a calibration detects a wrong latitude, because both gravity and earth rate are computed from it.
"""

import itertools
from dataclasses import dataclass

import numpy as np

from calstation.estimation.common.context import ImuModel, Posterior
from calstation.estimation.common.noise import bias_drift_sigmas
from calstation.estimation.common.samples import SampleBlock
from calstation.estimation.common.stage import FORCE_STEP, row_maxima, true_intervals
from calstation.physics import RATE, BoolArray, FloatArray, IntArray, compensate, compensation, group_indices, kernel

#: Deviation, in standard deviations, that indicates a different latitude; noise exceeds it in 2 of 10⁹ cases.
SIGMAS = 6.0
#: Tolerance for the deflection of the vertical and the rounding of the latitude, rad.
DEFLECTION = np.deg2rad(0.02)
#: Largest sigma of the vertical rate, in units of earth rate, that distinguishes latitudes 5° apart.
_SUFFICIENT = np.sin(np.deg2rad(5.0)) / SIGMAS
#: Averaging window, s.
_WINDOW = 1.0
#: Smallest number of windows in a rest, not counting the first and the last one, during which the table may move.
_MIN_WINDOWS = 3
_MOVING = 3.0 * RATE
_NEAR_POLE = 0.02
_COLUMNS = (*group_indices("gyro_scale"), *group_indices("gyro_misalign"))


@dataclass(frozen=True)
class LatitudeEstimate:
    """Latitude, rad, positive north, and its standard deviation, rad."""

    value: float
    sigma: float

    @property
    def tolerance(self) -> float:
        """Largest difference of a latitude from the estimate at which they are consistent, rad."""
        return float(SIGMAS * self.sigma + DEFLECTION)

    def contradicts(self, other: "LatitudeEstimate") -> bool:
        """Whether two estimates differ by more than their sigmas permit."""
        return abs(self.value - other.value) > SIGMAS * float(np.hypot(self.sigma, other.sigma))


def resolves_earth_rate(imu: ImuModel) -> bool:
    """Return whether six rests of 30 s with gyros of this noise distinguish latitudes 5° apart."""
    rest = np.hypot(bias_drift_sigmas(imu)[0], _noise(imu) / np.sqrt(30.0))
    return bool(rest / np.sqrt(6.0) < _SUFFICIENT * RATE)


class RestOutput:
    """Collects the mean output over each second, whatever the division of the samples into blocks."""

    def __init__(self, imu: ImuModel) -> None:
        self._imu = imu
        self._width = max(round(_WINDOW * imu.sample_rate), 1)
        #: Number of the current second and its number of samples; sum of these samples.
        self._second, self._sum = np.array([-1, 0]), np.zeros(6)
        self._seconds: list[IntArray] = []
        self._means: list[FloatArray] = []

    def feed(self, block: SampleBlock) -> None:
        """Add samples; a second with a missing or invalid sample is omitted."""
        seconds, means = _means(block.seq, block.counts, block.valid, self._width, self._second, self._sum)
        self._seconds.append(seconds)
        self._means.append(means)

    def latitude(self, posterior: Posterior) -> LatitudeEstimate | None:
        """Estimate the latitude from all rests so far; return None if `SIGMAS` of the vertical rate exceed those of 5°.

        The constant gyro biases are unknowns; rests with the unit upright and inverted separate them from earth rate.
        `posterior` contains the parameters solved so far; the sigmas of its gyro matrix enter the result's sigma.
        """
        if not self._means:
            return None
        imu, second = self._imu, np.concatenate(self._seconds)
        output = np.concatenate(self._means) * imu.rate_factor * np.repeat([imu.gyro_lsb, imu.accel_lsb], 3)
        omega, force = compensate(compensation(posterior.mean), output[:, :3], output[:, 3:])
        noise = _noise(imu)
        tolerance = 5.0 * noise + 3.0 * float(posterior.sigma[group_indices("gyro_bias")].max())
        still = row_maxima(omega) < _MOVING + tolerance
        rests = _rests(second, still, force)
        if len(rests) < 4:
            return None
        up = force / np.linalg.norm(force, axis=1, keepdims=True)
        along = (omega * up).sum(axis=1)
        scatter = sum(float(((along[a:b] - along[a:b].mean()) ** 2).sum()) for a, b in rests)
        white = max(noise**2, scatter / sum(b - a - 1 for a, b in rests))
        length = np.array([b - a for a, b in rests])
        variance = white / length + bias_drift_sigmas(imu)[0] ** 2
        rows = np.array([[*up[a:b].mean(axis=0), 1.0] for a, b in rests])
        rates = np.array([along[a:b].mean() for a, b in rests])
        information = rows.T @ (rows / variance[:, None])
        if np.linalg.cond(information) > 1e8:
            return None
        covariance = np.linalg.inv(information)
        rate = float((covariance @ rows.T @ (rates / variance))[3])
        matrix = RATE * float(posterior.sigma[list(_COLUMNS)].max())
        sigma = float(np.hypot(np.sqrt(covariance[3, 3]), matrix))
        if sigma > _SUFFICIENT * RATE:
            return None
        value = float(np.arcsin(np.clip(rate / RATE, -1.0, 1.0)))
        return LatitudeEstimate(value, sigma / RATE / max(float(np.cos(value)), _NEAR_POLE))


@kernel
def _means(
    seq: IntArray, counts: FloatArray, valid: BoolArray, width: int, second: IntArray, total: FloatArray
) -> tuple[IntArray, FloatArray]:
    """Return the numbers of the seconds, `width` samples each, that are completed in a block, and their mean counts.

    `second`, shape (2,), contains the number of the current second and its number of samples, `total`, shape (6,),
    their sum; both are updated in place.
    """
    capacity = len(seq) // width + 1
    seconds, means, count = np.empty(capacity, np.int64), np.empty((capacity, 6)), 0
    for k in range(len(seq)):
        if not valid[k]:
            continue
        if seq[k] // width != second[0]:
            second[0], second[1] = seq[k] // width, 0
            total[:] = 0.0
        second[1] += 1
        for i in range(6):
            total[i] += counts[k, i]
        if second[1] == width:
            seconds[count] = second[0]
            for i in range(6):
                means[count, i] = total[i] / width
            count += 1
    return seconds[:count], means[:count]


def _noise(imu: ImuModel) -> float:
    """Return the noise of a mean rate over one window, rad/s."""
    step = imu.quantisation[0]
    rounded = step / _WINDOW
    if imu.output == "rate":
        rounded = step / np.sqrt(12.0 * imu.sample_rate * _WINDOW)
    return float(np.hypot(imu.gyro_arw / np.sqrt(_WINDOW), rounded))


def _rests(second: IntArray, still: np.ndarray, force: FloatArray) -> list[tuple[int, int]]:
    """Return the windows (start, stop) of every rest, without its first and last window."""
    split = np.zeros(len(second), np.bool_)
    split[1:] = (np.diff(second) != 1) | (row_maxima(np.diff(force, axis=0)) > FORCE_STEP)
    rests = []
    for a, b in true_intervals(still):
        cuts = [a, *(a + 1 + np.flatnonzero(split[a + 1 : b])), b]
        rests += [(int(c) + 1, int(d) - 1) for c, d in itertools.pairwise(cuts)]
    return [(a, b) for a, b in rests if b - a >= _MIN_WINDOWS]
