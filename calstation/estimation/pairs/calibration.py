"""Cross-calibration of a secondary IMU: static check at rest, calibration from synchronous motion, live correction.

At rest the magnitude of the specific force equals gravity, and the rate equals earth rate. A secondary is compensated
first with its stored errors relative to the primary and then with the primary's errors, because the stored errors refer
to the raw output of the primary. Recordings without paired samples or motion, with frozen channels, or in wrong units
or axes are rejected.
"""

from dataclasses import dataclass, replace

import numpy as np

from calstation.errors import InputError, InsufficientDataError
from calstation.estimation.common import (
    Posterior,
    Secondary,
    SolveContext,
    StageData,
    StoredCrossCalibration,
    find_stillness,
)
from calstation.estimation.pairs.filtering import PairData, lever_matrix, pair_data
from calstation.estimation.pairs.fit import (
    ACCEL_BIAS,
    ACCEL_MATRIX,
    GYRO_BIAS,
    GYRO_MATRIX,
    LEVER,
    OFFSET,
    PairChoice,
    PairFit,
    fit_pair,
)
from calstation.estimation.pairs.schedule import PairSchedule
from calstation.estimation.positions import frozen_columns
from calstation.physics import (
    AXES,
    PAIR_PARAMETERS,
    Compensation,
    FloatArray,
    compensate,
    compensation,
    rotation_vector,
)

SENSORS = ("gyro", "accel")
#: Time over which a parabola is fitted to the rates for the angular acceleration of the lever-arm term, s.
SLOPE_TIME = 0.02
_INDEX = {p.name: i for i, p in enumerate(PAIR_PARAMETERS)}
#: Shortest total time with samples of both IMUs, s.
MIN_PAIRED_TIME = 5.0
#: Smallest rms rate about the axis of least rotation from which a matrix is determined, rad/s.
MIN_RATE = np.deg2rad(3.0)
#: Smallest rms change of the specific force along the axis of least change from which a matrix is determined, m/s².
MIN_FORCE = 0.5
#: Largest plausible singular value of a matrix; a larger one indicates a wrong unit.
MAX_SINGULAR_VALUE = 1.5
#: Largest angle between the axes of gyro and accelerometer of one IMU, rad.
MAX_SENSOR_ANGLE = np.deg2rad(10.0)


@dataclass(frozen=True)
class RestDeviation:
    """Deviation of a sensor at rest and its threshold, rad/s or m/s²."""

    value: float
    limit: float

    @property
    def within(self) -> bool:
        """Whether the deviation is within the threshold."""
        return self.value <= self.limit


@dataclass(frozen=True)
class StaticCheck:
    """Deviations of primary and secondary at one rest, by sensor: ``gyro`` and ``accel``."""

    primary: dict[str, RestDeviation]
    secondary: dict[str, RestDeviation]

    @property
    def primary_out_of_tolerance(self) -> tuple[str, ...]:
        """Sensors of the primary that are out of tolerance and are therefore not used as reference."""
        return tuple(s for s in SENSORS if not self.primary[s].within)


def pair_vector(stored: StoredCrossCalibration) -> FloatArray:
    """Return the stored values as a vector of all pair parameters, shape (28,); missing ones have neutral values."""
    return np.array([stored.values.get(p.name, p.neutral) for p in PAIR_PARAMETERS])


def compensate_secondary(
    pair: FloatArray, c: Compensation, gyro2: FloatArray, accel2: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return a secondary's rate, rad/s, and specific force, m/s², from raw mean rates, each of shape (n, 3).

    The secondary's stored errors `pair`, shape (28,), are removed first, then the primary's errors.

    Parameters
    ----------
    pair : stored errors of the secondary, SI, shape (28,)
    c : compensation constants of the primary
    gyro2, accel2 : raw mean rates, rad/s, and raw mean specific forces, m/s², shape (n, 3)
    """
    C, A = pair[GYRO_MATRIX].reshape(3, 3), pair[ACCEL_MATRIX].reshape(3, 3)
    gyro = np.linalg.solve(C, (gyro2 - pair[GYRO_BIAS]).T)
    accel = np.linalg.solve(A, (accel2 - pair[ACCEL_BIAS]).T)
    return compensate(c, np.asarray(gyro.T, np.float64), np.asarray(accel.T, np.float64))


@dataclass(frozen=True)
class PairResult:
    """A fit and the values to be stored."""

    fit: PairFit
    stored: StoredCrossCalibration
    static: dict[str, float | None]  #: Deviation at rest of each calibrated sensor, rad/s or m/s², None if unknown.


class PairCalibration:
    """Static checks and fits of secondary IMUs against one primary."""

    def __init__(self, context: SolveContext, prior: Posterior, schedule: PairSchedule) -> None:
        self._primary, self.schedule = context.imu, schedule
        self._c = compensation(prior.mean)
        self._gravity = context.site.local_gravity

    def last_rest(self, data: StageData) -> tuple[int, int] | None:
        """Return the last rest (start, stop) that is long enough for a check, or None."""
        rests = find_stillness(data, self._primary, self.schedule.static_s).rests
        return rests[-1] if rests else None

    def check(
        self, data: StageData, rest: tuple[int, int], index: int, secondary: Secondary, stored: StoredCrossCalibration
    ) -> StaticCheck | None:
        """Check both IMUs at a rest; return None if the secondary, at `index` in the samples, has no data in it."""
        a, b = rest
        pair = pair_data(data, index, secondary.imu)
        gyro2, accel2 = _mean(pair.gyro2[a:b]), _mean(pair.accel2[a:b])
        if gyro2 is None or accel2 is None:
            return None
        primary = compensate(self._c, data.gyro[a:b].mean(axis=0)[None], data.accel[a:b].mean(axis=0)[None])
        other = compensate_secondary(pair_vector(stored), self._c, gyro2, accel2)
        first, second = (
            {"gyro": float(np.linalg.norm(w)), "accel": abs(float(np.linalg.norm(f)) - self._gravity)}
            for w, f in (primary, other)
        )
        last, limit = stored.static, self.schedule.threshold
        return StaticCheck(
            {s: RestDeviation(first[s], limit("primary", s).limit(None)) for s in SENSORS},
            {s: RestDeviation(second[s], limit("secondary", s).limit(last[s])) for s in SENSORS},
        )

    def references(self, check: StaticCheck) -> tuple[str, ...]:
        """Return the sensors of the primary that can be used as reference after a check."""
        if self.schedule.primary_valid == "both_sensors" and check.primary_out_of_tolerance:
            return ()
        return tuple(s for s in SENSORS if check.primary[s].within)

    def to_calibrate(self, check: StaticCheck) -> tuple[str, ...]:
        """Return the sensors of the secondary that are out of tolerance and have a reference in the primary."""
        return tuple(s for s in self.references(check) if not check.secondary[s].within)

    def choose_terms(self, check: StaticCheck) -> PairChoice:
        """Return the terms to fit after a check; a sensor without a reference in the primary is not fitted."""
        fitted = self.to_calibrate(check) if self.schedule.sensors == "triggering" else self.references(check)
        choice = self.schedule.choice
        return replace(
            choice, gyro=choice.gyro if "gyro" in fitted else None, accel=choice.accel if "accel" in fitted else None
        )

    def calibrate(
        self, data: StageData, index: int, secondary: Secondary, choice: PairChoice, stored: StoredCrossCalibration
    ) -> PairResult:
        """Fit the chosen terms to all data; the other terms keep their stored values. Raises InputError."""
        pair = pair_data(data, index, secondary.imu)
        require_pairs(pair, secondary.number, choice)
        try:
            fit = fit_pair(pair, self._primary, secondary.imu, self._c, choice, pair_vector(stored))
        except np.linalg.LinAlgError as exc:
            raise InputError("solve.pair_undetermined", number=secondary.number) from exc
        require_plausible(fit, secondary.number, choice)
        values = dict(zip((p.name for p in PAIR_PARAMETERS), fit.value.tolist(), strict=True))
        solved = StoredCrossCalibration(
            {n: v for n, v in values.items() if fit.fitted[_INDEX[n]] or n in stored.values}
        )
        rest = self.last_rest(data)
        check = None if rest is None else self.check(data, rest, index, secondary, solved)
        last = stored.static
        fitted = [s for s, model in (("gyro", choice.gyro), ("accel", choice.accel)) if model is not None]
        static = {s: None if check is None else check.secondary[s].value for s in fitted}
        for sensor, value in static.items():
            threshold = self.schedule.threshold("secondary", sensor)
            # a large deviation would increase the next threshold, and small increases would accumulate
            if value is not None and value <= min(threshold.limit(last[sensor]), threshold.fixed):
                last[sensor] = value
        return PairResult(fit, replace(solved, gyro_static=last["gyro"], accel_static=last["accel"]), static)


def _mean(values: FloatArray) -> FloatArray | None:
    """Return the mean of the rows without NaN, shape (1, 3), or None if there are no such rows."""
    finite = values[~np.isnan(values).any(axis=1)]
    return finite.mean(axis=0, keepdims=True) if len(finite) else None


class SecondaryCorrection:
    """Corrects the output of a secondary with its stored calibration and then with the primary's errors."""

    def __init__(self, secondary: Secondary, primary: Compensation) -> None:
        self._size, self._dt, self._primary = secondary.imu.count_size, 1.0 / secondary.imu.sample_rate, primary
        self._width = max(2, round(SLOPE_TIME / self._dt))
        ago = np.arange(-self._width, 1) * self._dt
        self._slope = np.linalg.pinv(np.vander(ago, 3, increasing=True))[1]  # slope of the parabola at its end
        self._before = np.empty((0, 3))  # the last rates, at most `_width`
        self.use(secondary.stored)

    def use(self, stored: StoredCrossCalibration) -> None:
        """Use another calibration for the following samples."""
        self.stored, self._pair = stored, pair_vector(stored)

    @property
    def clock_offset(self) -> float:
        """Time to add to a sample's time to obtain the time of the motion it measures, s."""
        return float(self._pair[OFFSET])

    def correct(self, counts: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return rate, rad/s, and specific force, m/s², of the next samples at the primary, NaN where missing.

        `counts` are raw, shape (n, 6). Without a fitted lever arm, the force refers to the secondary's location. The
        angular acceleration is computed from the rates of the last `SLOPE_TIME`, so that no sample is delayed; it is 0
        next to missing samples.
        """
        raw = counts * self._size
        omega, force = compensate_secondary(self._pair, self._primary, raw[:, :3], raw[:, 3:])
        lever = self._pair[LEVER]
        if lever.any() and len(omega):
            last_rates = self._before if len(self._before) else omega[:1]
            last_rates = np.vstack([np.repeat(last_rates[:1], self._width - len(last_rates), axis=0), last_rates])
            rates = np.vstack([last_rates, omega])
            alpha = np.nan_to_num(
                np.lib.stride_tricks.sliding_window_view(rates, self._width + 1, axis=0) @ self._slope
            )
            force = force - lever_matrix(omega, alpha, self._dt) @ lever
            self._before = rates[-self._width :]
        return omega, force


def require_pairs(data: PairData, number: int, choice: PairChoice) -> None:
    """Check that the samples determine the chosen terms. Raises InputError or InsufficientDataError."""
    paired = sum(stop - start for start, stop in data.segments) * data.dt
    if paired < MIN_PAIRED_TIME:
        raise InsufficientDataError("recording.too_few_pairs", number=number, seconds=paired, least=MIN_PAIRED_TIME)
    rows = np.concatenate([np.arange(start, stop) for start, stop in data.segments])
    columns: dict[str, FloatArray] = {
        "gyro": data.gyro[rows],
        "accel": data.accel[rows],
        f"gyro{number}": data.gyro2[rows],
        f"accel{number}": data.accel2[rows],
    }
    names = [f"{sensor}_{axis}" for sensor in columns for axis in AXES]
    for name, first, last in frozen_columns(names, np.hstack(list(columns.values())), data.dt):
        raise InputError(
            "recording.frozen_at_time",
            channel=name,
            seconds=(last - first) * data.dt,
            start=float(data.time[rows[first]]),
        )
    for sensor in ("gyro", "accel"):
        if np.array_equal(columns[sensor], columns[f"{sensor}{number}"]):
            raise InputError("recording.pair_identical", number=number, sensor=sensor)
    if choice.gyro in ("scale", "full") or choice.offset:
        _require_spread(data.gyro[rows], MIN_RATE, choice.gyro == "full", tilting=False)
    if choice.accel in ("scale", "full"):
        _require_spread(data.accel[rows], MIN_FORCE, choice.accel == "full", tilting=True)


def _require_spread(values: FloatArray, minimum: float, every_axis: bool, tilting: bool) -> None:
    spread, axes = np.linalg.eigh(np.cov(values.T))
    size = np.sqrt(np.maximum(spread, 0.0))
    if size[-1] < minimum:
        raise InsufficientDataError("recording.no_tilting" if tilting else "recording.no_turning")
    if every_axis and size[0] < minimum:
        axis = AXES[int(np.argmax(np.abs(axes[:, 0])))]
        raise InsufficientDataError(
            "recording.little_tilting" if tilting else "recording.little_turning",
            axis=axis,
            share=float(size[0] / size[-1]),
        )


def require_plausible(fit: PairFit, number: int, choice: PairChoice) -> None:
    """Check that the matrices are plausible as sensor errors and not due to swapped columns. Raises InputError."""
    rotations = []
    for sensor, model, columns in (("gyro", choice.gyro, GYRO_MATRIX), ("accel", choice.accel, ACCEL_MATRIX)):
        if model not in ("scale", "full"):
            continue
        C = fit.value[columns].reshape(3, 3)
        U, lengths, V = np.linalg.svd(C)
        if not 1.0 / MAX_SINGULAR_VALUE < lengths[-1] <= lengths[0] < MAX_SINGULAR_VALUE:
            ratio = float(np.exp(np.mean(np.log(lengths))))
            raise InputError("recording.pair_unit", number=number, sensor=sensor, ratio=ratio)
        if np.linalg.det(C) < 0.0:
            raise InputError("recording.pair_mirrored", number=number, sensor=sensor)
        rotations.append(U @ V)
    if len(rotations) == 2:
        angle_between = float(np.linalg.norm(rotation_vector(rotations[0] @ rotations[1].T)))
        if angle_between > MAX_SENSOR_ANGLE:
            angle = float(np.rad2deg(angle_between))
            raise InputError("recording.pair_sensors_apart", number=number, angle_deg=angle)
