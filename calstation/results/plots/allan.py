"""Allan deviation of the output of an IMU at rest, and noise parameters from it (IEEE Std 952-2020, annex C)."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calstation.errors import InsufficientDataError
from calstation.estimation.common import (
    SHORTEST_REST,
    SampleBlock,
    StageData,
    find_stillness,
    stage_data,
    true_intervals,
)
from calstation.jobs import ProgressCallback
from calstation.physics import CHANNELS, FloatArray
from calstation.records import LogMeta, context_from_meta, open_log

#: Number of averaging times per decade, and shortest duration, s.
_PER_DECADE, SHORTEST = 12, 10.0
#: Longest averaging time as a fraction of the duration; longer times have too few differences.
_MAX_FRACTION = 0.2
#: Probability of the confidence band.
_CONFIDENCE = 0.95
#: Largest difference of a slope attributed to white noise from −1/2, and smallest number of such successive slopes.
_WHITE_SLOPE, _MIN_WHITE = 0.1, 4
#: Number of standard deviations by which the Allan deviation may be below the random walk, and smallest number of
#: independent differences for this comparison.
_SCATTER, _MIN_INDEPENDENT = 4.0, 20.0
#: Allan deviation of a bias instability B at its flat minimum, in units of B.
FLOOR = 0.664
#: Averaging window, s; largest deviations of a mean output from the median at rest, rad/s and m/s²; largest range of
#: the encoder angles at rest, rad.
_WINDOW, _MOVING_RATE, _MOVING_FORCE, _MOVING_ANGLE = 1.0, np.deg2rad(0.2), 0.05, np.deg2rad(0.2)


@dataclass(frozen=True)
class AllanCurve:
    """Overlapping Allan deviation of a channel, rad/s or m/s², and the noise parameters."""

    tau: FloatArray  #: Averaging times, s, shape (k,).
    deviation: FloatArray  #: Shape (k,).
    low: FloatArray  #: Lower end of the 95 % confidence interval, shape (k,).
    high: FloatArray  #: Upper end of the 95 % confidence interval, shape (k,).
    #: Random walk from the slope −1/2, rad/√s or m/s/√s; None if the curve has no such slope.
    random_walk: float | None
    instability: float | None  #: Bias instability from the flat minimum, rad/s or m/s²; None without such a minimum.
    #: Upper end of the confidence interval of the bias instability at the lowest point.
    largest_instability: float


@dataclass(frozen=True)
class AllanDeviation:
    """Allan deviations of a range of a log."""

    serial: str
    first_seq: int
    last_seq: int
    seconds: float
    curves: Mapping[str, AllanCurve]  #: Curves by channel; without gyros only the accelerometers.
    noise: Mapping[str, float]  #: `[noise]` of the IMU profile in the log, SI.
    #: Rounding steps of angle (rad) and velocity (m/s) increments; 0 for rates, whose rounding is white noise.
    quantisation: tuple[float, float]
    profile: str | None  #: Name of the IMU profile; None if the log does not specify it.


def longest_rest(report: ProgressCallback, path: Path) -> tuple[int, int]:
    """Job: return the first and last sequence number of the longest rest of a log.

    Raises InputError if the log cannot be read, or InsufficientDataError if the unit never rests.
    """
    log = open_log(path)
    data = _read(report, list(log.blocks()), log.meta)
    rests = find_stillness(data, context_from_meta(log.meta).imu).rests
    if not rests:
        error = InsufficientDataError("solution.never_at_rest", shortest=SHORTEST_REST, seconds=len(data) * data.dt)
        raise InsufficientDataError("solution.in_log", file=path, what=error.as_text)
    start, stop = max(rests, key=lambda rest: rest[1] - rest[0])
    return int(data.seq[start]), int(data.seq[stop - 1])


def allan_deviation(report: ProgressCallback, path: Path, first_seq: int, last_seq: int) -> AllanDeviation:
    """Job: compute the Allan deviations of a static range of a log from its longest part without a gap.

    Raises InputError if the log cannot be read, or InsufficientDataError if the table moves or the range is too short.
    """
    log = open_log(path)
    imu = context_from_meta(log.meta).imu
    data = _read(report, list(log.blocks(first_seq, last_seq)), log.meta)
    start, stop = max(data.segments, key=lambda segment: segment[1] - segment[0], default=(0, 0))
    seconds = (stop - start) * data.dt
    values = {"file": path, "first": first_seq, "last": last_seq}
    if seconds < SHORTEST:
        raise InsufficientDataError("solution.allan_short", seconds=seconds, shortest=SHORTEST, **values)
    if _moves(data):
        raise InsufficientDataError("solution.allan_moves", **values)
    output = np.hstack([data.gyro, data.accel])[start:stop]
    measured_channels = [k for k in range(len(CHANNELS)) if np.isfinite(output[:, k]).all()]
    curves = {}
    for number, k in enumerate(measured_channels):
        curves[CHANNELS[k]] = allan_curve(output[:, k], imu.sample_rate)
        report(0.3 + 0.7 * (number + 1) / len(measured_channels))
    section, run = log.meta.imu, log.meta.run
    names = ("gyro_arw", "accel_vrw", "gyro_bias_instability", "accel_bias_instability")
    increments = imu.output == "increment"
    return AllanDeviation(
        serial=imu.serial,
        first_seq=int(data.seq[start]),
        last_seq=int(data.seq[stop - 1]),
        seconds=seconds,
        curves=curves,
        noise={name: getattr(section, name) for name in names},
        quantisation=imu.quantisation if increments else (0.0, 0.0),
        profile=run.files["imu"].name if run is not None and run.files and "imu" in run.files else None,
    )


def allan_curve(values: FloatArray, rate: float) -> AllanCurve:
    """Return the Allan deviation of rates or specific forces, shape (n,), sampled `rate` times per second."""
    import allantools  # importing takes a second, and only these jobs need it

    longest = int(_MAX_FRACTION * len(values))
    count = round(_PER_DECADE * np.log10(longest)) + 1
    factors = np.unique(np.rint(np.geomspace(1, longest, count))).astype(np.int64)
    tau, deviation, _, _ = allantools.oadev(values - values.mean(), rate=rate, data_type="freq", taus=factors / rate)
    factors = np.rint(tau * rate).astype(np.int64)
    slope = _slopes(np.log(tau), np.log(deviation))
    freedom = np.array(
        [
            allantools.edf_greenhall(_power(s), 2, int(m), len(values) + 1, overlapping=True)
            for s, m in zip(slope, factors, strict=True)
        ]
    )
    bounds = np.array(
        [allantools.confidence_interval(d, f, ci=_CONFIDENCE) for d, f in zip(deviation, freedom, strict=True)]
    )
    low, high = bounds.T
    walk = _random_walk(tau, deviation, slope, freedom)
    lowest = int(np.argmin(deviation))
    white = 0.0 if walk is None else walk / np.sqrt(tau[lowest])
    flat = low[lowest] > white and 0 < lowest < len(tau) - 1
    instability = float(deviation[lowest] / FLOOR) if flat else None
    return AllanCurve(tau, deviation, low, high, walk, instability, float(high[lowest] / FLOOR))


def _slopes(x: FloatArray, y: FloatArray) -> FloatArray:
    """Return the slope at every point over half a decade of averaging times."""
    k, reach = np.arange(len(x)), _PER_DECADE // 4
    first, last = np.maximum(k - reach, 0), np.minimum(k + reach, len(x) - 1)
    return np.asarray((y[last] - y[first]) / (x[last] - x[first]))


def _power(slope: float) -> int:
    """Return the exponent of the power-law spectrum for a slope of the Allan deviation (NIST SP 1065, table 3)."""
    return 2 if slope < -0.875 else round(float(np.clip(-2.0 * slope - 1.0, -2.0, 1.0)))


def _random_walk(tau: FloatArray, deviation: FloatArray, slope: FloatArray, freedom: FloatArray) -> float | None:
    """Return the value at 1 s of a line of slope −1/2 fitted to the longest part of the curve with this slope.

    At no averaging time is the deviation smaller than that of the random walk alone. Vibration of the table also causes
    a part with this slope, but the deviation is smaller at longer times.
    """
    parts = [part for part in true_intervals(np.abs(slope + 0.5) < _WHITE_SLOPE) if part[1] - part[0] >= _MIN_WHITE]
    at_1_s = deviation * np.sqrt(tau)
    # at longer times, scatter of the slope may exaggerate the degrees of freedom
    independent = np.minimum(freedom, tau[-1] / _MAX_FRACTION / tau)
    reliable = independent >= _MIN_INDEPENDENT
    smallest = (at_1_s * (1.0 + _SCATTER / np.sqrt(2.0 * independent)))[reliable].min(initial=np.inf)
    for part in sorted((slice(*part) for part in parts), key=lambda part: part.start - part.stop):
        walk = float(np.exp(np.average(np.log(at_1_s[part]), weights=freedom[part])))
        if walk < smallest:
            return walk
    return None


def _read(report: ProgressCallback, blocks: list[SampleBlock], meta: LogMeta) -> StageData:
    report(0.1)
    data = stage_data(blocks, context_from_meta(meta).imu)
    report(0.3)
    return data


def _moves(data: StageData) -> bool:
    """Return whether the table moves, according to the output of the unit or the encoder angles."""
    width = round(_WINDOW / data.dt)
    count = len(data) // width
    gyro, accel = (v[: count * width].reshape(count, width, 3).mean(axis=1) for v in (data.gyro, data.accel))
    for mean, limit in ((gyro, _MOVING_RATE), (accel, _MOVING_FORCE)):
        if np.any(np.abs(mean - np.median(mean, axis=0)) > limit):
            return True
    angles = data.angles[~np.isnan(data.angles).any(axis=1)]
    return bool(len(angles)) and bool((np.ptp(angles, axis=0) > _MOVING_ANGLE).any())
