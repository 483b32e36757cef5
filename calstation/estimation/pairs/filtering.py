"""Synchronous, low-pass filtered samples of two IMUs; the primary is shifted by any fraction of a sample."""

from dataclasses import dataclass
from functools import cache

import numpy as np

from calstation.estimation.common import ImuModel, StageData, sensor_rates, true_intervals
from calstation.physics import BoolArray, Compensation, FloatArray, IntArray


@dataclass(frozen=True)
class PairData:
    """Samples of two IMUs on one body."""

    dt: float  #: Sample period, s.
    time: FloatArray  #: Time on the primary's clock, s, shape (n,).
    gyro: FloatArray  #: Raw mean rate of the primary, rad/s, shape (n, 3).
    accel: FloatArray  #: Raw mean specific force of the primary, m/s², shape (n, 3).
    gyro2: FloatArray  #: Raw mean rate of the secondary, rad/s, shape (n, 3).
    accel2: FloatArray  #: Raw mean specific force of the secondary, m/s², shape (n, 3).
    segments: tuple[tuple[int, int], ...]  #: (start, stop) of each interval with no missing sample of either IMU.

    def __len__(self) -> int:
        return len(self.time)


def pair_data(data: StageData, index: int, imu: ImuModel) -> PairData:
    """Return the samples of the primary and of the secondary at index `index`, whose model is `imu`."""
    counts = data.others[:, index]
    present: BoolArray = np.asarray(~np.isnan(counts).any(axis=1))
    segments: list[tuple[int, int]] = []
    for start, stop in data.segments:
        segments += [(start + a, start + b) for a, b in true_intervals(present[start:stop])]
    gyro, accel = sensor_rates(counts, imu, segments)
    return PairData(
        dt=data.dt,
        time=data.time,
        gyro=data.gyro,
        accel=data.accel,
        gyro2=gyro,
        accel2=accel,
        segments=tuple(segments),
    )


#: Number of samples on each side for an interpolation.
INTERPOLATION_HALF_WIDTH = 10
#: Number of samples on each side for the low-pass filter.
HALF_WIDTH = 16
#: Cut-off of the low-pass filter relative to the sample rate: above the motion, below most of the noise.
PASS_BAND = 0.2


@cache
def low_pass() -> FloatArray:
    """Return the kernel of the low-pass filter, shape (2 HALF_WIDTH + 1,)."""
    from scipy.signal import firwin  # slow to import and rarely needed

    return np.asarray(firwin(2 * HALF_WIDTH + 1, 2.0 * PASS_BAND))


@dataclass(frozen=True)
class Signals:
    """Low-pass filtered samples used in a fit, n rows."""

    row: IntArray  #: Indices of the rows in the data, shape (n,).
    gyro: FloatArray  #: Primary at t + τ, rad/s, shape (n, 3).
    accel: FloatArray  #: Primary at t + τ, m/s², shape (n, 3).
    gyro_slope: FloatArray  #: Time derivative of `gyro`, rad/s², shape (n, 3).
    accel_slope: FloatArray  #: Time derivative of `accel`, m/s³, shape (n, 3).
    lever: FloatArray  #: Matrix G of the lever-arm contribution G r to the primary's output, 1/s², shape (n, 3, 3).
    gyro2: FloatArray  #: Secondary at t, rad/s, shape (n, 3).
    accel2: FloatArray  #: Secondary at t, m/s², shape (n, 3).
    white: float  #: Ratio of the variance of a filtered value to the variance of white noise.
    slope: float  #: Ratio of the variance of a derivative to the variance of white noise, 1/s².


def signals(data: PairData, offset: float, c: Compensation) -> Signals:
    """Filter all sufficiently long segments, shift the primary by `offset`, s, and compute the lever term with `c`."""
    shift = round(offset / data.dt)
    interpolator, differentiator = _kernels(offset / data.dt - shift)
    differentiator, matrix = differentiator / data.dt, np.linalg.inv(c.accel_inverse)
    margin = INTERPOLATION_HALF_WIDTH + HALF_WIDTH + abs(shift)
    parts: list[list[FloatArray]] = [[] for _ in range(7)]
    rows = []
    for start, stop in data.segments:
        if stop - start <= 2 * margin + 1:
            continue
        primary = np.hstack([data.gyro[start:stop], data.accel[start:stop]])
        interpolated = np.roll(_filtered(primary, interpolator), -shift, axis=0)
        derivative = np.roll(_filtered(primary, differentiator), -shift, axis=0)
        omega, alpha = (interpolated[:, :3] - c.gyro_bias) @ c.gyro_inverse.T, derivative[:, :3] @ c.gyro_inverse.T
        G = matrix @ lever_matrix(omega, alpha, data.dt)
        columns = (
            interpolated[:, :3],
            interpolated[:, 3:],
            derivative[:, :3],
            derivative[:, 3:],
            G.reshape(-1, 9),
            data.gyro2[start:stop],
            data.accel2[start:stop],
        )
        inside = slice(margin, stop - start - margin)
        for part, column in zip(parts, columns, strict=True):
            part.append(_filtered(column, low_pass())[inside])
        rows.append(np.arange(start + margin, stop - margin))
    gyro, accel, gyro_slope, accel_slope, lever, gyro2, accel2 = (
        np.concatenate(part) if part else np.empty((0, 3)) for part in parts
    )
    return Signals(
        row=np.concatenate(rows) if rows else np.empty(0, np.int64),
        gyro=gyro,
        accel=accel,
        gyro_slope=gyro_slope,
        accel_slope=accel_slope,
        lever=lever.reshape(-1, 3, 3),
        gyro2=gyro2,
        accel2=accel2,
        white=float(np.sum(np.convolve(interpolator, low_pass()) ** 2)),
        slope=float(np.sum(np.convolve(differentiator, low_pass()) ** 2)),
    )


def _filtered(columns: FloatArray, kernel: FloatArray) -> FloatArray:
    """Correlate every column with a centred kernel of odd length."""
    from scipy.signal import fftconvolve

    return np.asarray(fftconvolve(columns, kernel[::-1, None], mode="same", axes=0))


def _kernels(part: float) -> tuple[FloatArray, FloatArray]:
    """Return kernels that interpolate a band-limited signal and its derivative (per sample) `part` samples later.

    Lagrange polynomials of order 20 (T. I. Laakso et al., *Splitting the unit delay*, IEEE Signal Processing Magazine
    13(1), 1996) are exact for slow motion and all-pass in the band, so that the noise does not depend on the offset.
    """
    step = 1e-4
    nodes = np.arange(-INTERPOLATION_HALF_WIDTH, INTERPOLATION_HALF_WIDTH + 1)
    interpolator, after, before = lagrange_weights(nodes, np.array([part, part + step, part - step]))
    return interpolator, (after - before) / (2.0 * step)


def lagrange_weights(nodes: IntArray, at: FloatArray) -> FloatArray:
    """Return the weights of n values at `nodes` for the Lagrange interpolation at m positions, shape (m, n)."""
    others = nodes[:, None] != nodes[None, :]
    distance = np.where(others, nodes[:, None] - nodes[None, :], 1)
    return np.asarray(np.prod(np.where(others, (at[:, None, None] - nodes[None, :]) / distance, 1.0), axis=2))


def lever_matrix(omega: FloatArray, alpha: FloatArray, dt: float) -> FloatArray:
    """Return the mean of [α×] + [ω×]² over a sample, 1/s², shape (n, 3, 3).

    For a rate that changes linearly, the mean of a product is the product of the means plus α α' dt²/12.

    Parameters
    ----------
    omega, alpha : mean rate ω, rad/s, and angular acceleration α, rad/s², of n samples, shape (n, 3) each
    dt : sample period, s
    """
    square = omega[:, :, None] * omega[:, None, :] + alpha[:, :, None] * alpha[:, None, :] * (dt * dt / 12.0)
    G = square - np.trace(square, axis1=1, axis2=2)[:, None, None] * np.eye(3)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        G[:, i, j] -= alpha[:, k]
        G[:, i, k] += alpha[:, j]
    return np.asarray(G)


def coarse_offset(data: PairData, max_offset: float) -> float:
    """Return the offset within ± `max_offset` s, in whole samples, at which the rate magnitudes agree best, s."""
    length, length2 = (np.linalg.norm(np.where(np.isnan(g), 0.0, g), axis=1) for g in (data.gyro, data.gyro2))
    weight = np.zeros(len(data))
    for start, stop in data.segments:
        weight[start:stop] = 1.0
    if not weight.any():
        return 0.0
    from scipy.signal import fftconvolve

    a, b = ((x - np.average(x, weights=weight)) * weight for x in (length, length2))
    max_lag = min(round(max_offset / data.dt), len(data) - 1)
    correlation = fftconvolve(a, b[::-1])
    middle = len(b) - 1
    window = correlation[middle - max_lag : middle + max_lag + 1]
    return float(int(np.argmax(window)) - max_lag) * data.dt
