"""A secondary IMU against its primary: static check at a rest, and calibration from synchronous motion.

At rest the magnitude of the specific force equals gravity and the rate is earth rate. A secondary is compensated first
with its stored error relative to the primary and then with the primary's own errors, because the stored error refers
to the raw output of the primary.
"""

from dataclasses import dataclass, replace

import numpy as np

from calstation.errors import InputError
from calstation.estimation.common import (
    Posterior,
    Secondary,
    SolveContext,
    StageData,
    StoredPair,
    find_stillness,
)
from calstation.estimation.pairs.faults import require_pairs, require_sense
from calstation.estimation.pairs.filtering import pair_data
from calstation.estimation.pairs.fit import (
    ACCEL_BIAS,
    ACCEL_MATRIX,
    GYRO_BIAS,
    GYRO_MATRIX,
    PairChoice,
    PairFit,
    fit_pair,
)
from calstation.estimation.pairs.schedule import PairSchedule
from calstation.physics import PAIR_PARAMETERS, Compensation, FloatArray, compensate, compensation

SENSORS = ("gyro", "accel")


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
        """Sensors of the primary that are out of tolerance and therefore cannot serve as reference."""
        return tuple(s for s in SENSORS if not self.primary[s].within)


def pair_vector(stored: StoredPair) -> FloatArray:
    """Return the stored values as a vector of all pair parameters, shape (28,); missing ones have neutral values."""
    return np.array([stored.values.get(p.name, p.neutral) for p in PAIR_PARAMETERS])


def _as_primary(pair: FloatArray, gyro2: FloatArray, accel2: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the raw rate and force that the primary would measure at the secondary's location, each shape (n, 3)."""
    C, A = pair[GYRO_MATRIX].reshape(3, 3), pair[ACCEL_MATRIX].reshape(3, 3)
    omega = np.linalg.solve(C, (gyro2 - pair[GYRO_BIAS]).T)
    force = np.linalg.solve(A, (accel2 - pair[ACCEL_BIAS]).T)
    return np.asarray(omega.T, dtype=np.float64), np.asarray(force.T, dtype=np.float64)


def compensate_secondary(
    pair: FloatArray, c: Compensation, gyro2: FloatArray, accel2: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return a secondary's rate, rad/s, and specific force, m/s², from raw mean rates, each of shape (n, 3).

    The secondary's stored errors `pair`, shape (28,), are removed first, then the primary's errors.
    """
    return compensate(c, *_as_primary(pair, gyro2, accel2))


def static_figures(omega: FloatArray, force: FloatArray, gravity: float) -> dict[str, float]:
    """Return deviations of gyro, rad/s, and accelerometer, m/s², at rest from means, shape (3,), and gravity, m/s²."""
    return {"gyro": float(np.linalg.norm(omega)), "accel": abs(float(np.linalg.norm(force)) - gravity)}


@dataclass(frozen=True)
class PairResult:
    """A fit and the values to be stored."""

    fit: PairFit
    stored: StoredPair
    static: dict[str, float | None]  #: Deviation at rest of each calibrated sensor, rad/s or m/s², None if unknown.


class PairCalibration:
    """Static checks and fits of secondary IMUs against one primary."""

    def __init__(self, context: SolveContext, prior: Posterior, schedule: PairSchedule) -> None:
        self._primary, self.schedule = context.imu, schedule
        self._c = compensation(prior.mean)
        self._gravity = context.site.local_gravity

    def last_rest(self, data: StageData) -> tuple[int, int] | None:
        """Return the last rest that is long enough for a check, or None."""
        rests = find_stillness(data, self._primary, self.schedule.static_s).rests
        return rests[-1] if rests else None

    def check(
        self, data: StageData, rest: tuple[int, int], index: int, secondary: Secondary, stored: StoredPair
    ) -> StaticCheck | None:
        """Check both IMUs at a rest; return None if the secondary (index `index` in the samples) has no data in it."""
        a, b = rest
        pair = pair_data(data, index, secondary.imu)
        gyro2, accel2 = _mean(pair.gyro2[a:b]), _mean(pair.accel2[a:b])
        if gyro2 is None or accel2 is None:
            return None
        primary = compensate(self._c, data.gyro[a:b].mean(axis=0)[None], data.accel[a:b].mean(axis=0)[None])
        other = compensate_secondary(pair_vector(stored), self._c, gyro2, accel2)
        first, second = (static_figures(w[0], f[0], self._gravity) for w, f in (primary, other))
        last = {"gyro": stored.gyro_static, "accel": stored.accel_static}
        return StaticCheck(
            {s: RestDeviation(first[s], self.schedule.threshold("primary", s).limit(None)) for s in SENSORS},
            {s: RestDeviation(second[s], self.schedule.threshold("secondary", s).limit(last[s])) for s in SENSORS},
        )

    def references(self, check: StaticCheck) -> tuple[str, ...]:
        """Return the sensors of the primary that can serve as reference after a check."""
        if self.schedule.primary_valid == "both_sensors" and check.primary_out_of_tolerance:
            return ()
        return tuple(s for s in SENSORS if check.primary[s].within)

    def to_calibrate(self, check: StaticCheck) -> tuple[str, ...]:
        """Return the sensors that are out of tolerance in the secondary and have a reference in the primary."""
        return tuple(s for s in self.references(check) if not check.secondary[s].within)

    def chosen(self, check: StaticCheck) -> PairChoice:
        """Choose the terms to fit after a check; a sensor without a reference in the primary is never fitted."""
        fitted = self.to_calibrate(check) if self.schedule.sensors == "triggering" else self.references(check)
        choice = self.schedule.choice
        return replace(
            choice, gyro=choice.gyro if "gyro" in fitted else None, accel=choice.accel if "accel" in fitted else None
        )

    def calibrate(
        self, data: StageData, index: int, secondary: Secondary, choice: PairChoice, stored: StoredPair
    ) -> PairResult:
        """Fit to all data; terms that are not chosen keep their stored values. Raises InputError."""
        pair = pair_data(data, index, secondary.imu)
        require_pairs(pair, secondary.number, choice)
        try:
            fit = fit_pair(pair, self._primary, secondary.imu, self._c, choice, pair_vector(stored))
        except np.linalg.LinAlgError as exc:
            raise InputError("solve.pair_undetermined", number=secondary.number) from exc
        require_sense(fit, secondary.number, choice)
        values = dict(zip((p.name for p in PAIR_PARAMETERS), fit.value.tolist(), strict=True))
        solved = StoredPair({n: v for n, v in values.items() if fit.fitted[_INDEX[n]] or n in stored.values})
        rest = self.last_rest(data)
        check = None if rest is None else self.check(data, rest, index, secondary, solved)
        last = {"gyro": stored.gyro_static, "accel": stored.accel_static}
        fitted = [s for s, model in (("gyro", choice.gyro), ("accel", choice.accel)) if model is not None]
        static = {s: None if check is None else check.secondary[s].value for s in fitted}
        for sensor, value in static.items():
            threshold = self.schedule.threshold("secondary", sensor)
            # the deviation after a poor calibration would loosen the next threshold; small ones must not accumulate
            if value is not None and value <= min(threshold.limit(last[sensor]), threshold.fixed):
                last[sensor] = value
        return PairResult(fit, replace(solved, gyro_static=last["gyro"], accel_static=last["accel"]), static)


_INDEX = {p.name: i for i, p in enumerate(PAIR_PARAMETERS)}


def _mean(values: FloatArray) -> FloatArray | None:
    """Return the mean of the rows without NaN, shape (1, 3), or None if there are no such rows."""
    finite = values[~np.isnan(values).any(axis=1)]
    return finite.mean(axis=0, keepdims=True) if len(finite) else None
