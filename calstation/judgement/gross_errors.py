"""Gross errors of a configuration: exchanged or reversed axes and angles, wrong units, output kind or sample rate.

The encoders of the table give the direction of up at every rest, and the axis and angle of each rotation of the unit.
If accelerometers and gyros contradict them, configurations with other signs, axes or factors are tried; the one with
the fewest errors that explains the rests and motions is reported. Other errors are left to the tests of the data.
"""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from calstation.estimation import Diagnosis, ModelTest
from calstation.estimation.common import Posterior, SolveContext
from calstation.judgement.table_motion import SMALLEST_TURN, TableMotion, turn_axis
from calstation.messages import Text
from calstation.physics import (
    AXES,
    GYRO_BIAS,
    JOINTS,
    ORIENTATIONS,
    FloatArray,
    orientation_matrix,
    rotation_rate,
    rotation_vector,
)

#: Largest deviation of a force or a rotation relative to its expected value; larger than any error of a unit.
_AGREES = 0.35
#: Largest fraction of rests or motions that a correct configuration may leave unexplained.
_UNEXPLAINED = 0.05
#: Largest ratio of a scale to 1, and of a factor to a known factor.
_SCALE, _KNOWN = 1.25, 1.1
#: Confusions of units: actual unit, configured unit, and the factor by which the output is multiplied.
_GYRO_UNITS = (
    ("°/s", "rad/s", 180.0 / np.pi),
    ("rad/s", "°/s", np.pi / 180.0),
    ("°/h", "°/s", 3600.0),
    ("°/s", "°/h", 1.0 / 3600.0),
    ("mrad/s", "rad/s", 1e3),
    ("rad/s", "mrad/s", 1e-3),
)
_ACCEL_UNITS = (
    ("g", "m/s²", 1.0 / 9.80665),
    ("m/s²", "g", 9.80665),
    ("mg", "m/s²", 1e3 / 9.80665),
    ("m/s²", "mg", 9.80665e-3),
    ("mm/s²", "m/s²", 1e3),
    ("m/s²", "mm/s²", 1e-3),
)
#: Largest number of equally simple explanations in a message.
_MAX_ALTERNATIVES = 3
#: Largest deviation of the heading, rad plus a number of sigmas, and largest sigma for which it is tested, rad.
_HEADING_TOLERANCE, _HEADING_SIGMAS, _MAX_HEADING_SIGMA = np.deg2rad(5.0), 6.0, 0.1
#: Largest condition number of the normalised equations of heading and biases.
_MAX_CONDITION = 1e6
#: Ranges of wrapping fields, counts.
_WRAPS = (2.0**16, 2.0**24, 2.0**32)


@dataclass(frozen=True)
class _Angles:
    """A possible error of the table's angles."""

    exchanged: bool = False  #: Whether outer and inner angle are exchanged.
    signs: tuple[float, float] = (1.0, 1.0)  #: Signs of the columns of the outer and of the inner angle.
    factor: float = 1.0  #: Factor that corrects the angles.

    @property
    def errors(self) -> int:
        """Number of wrong entries."""
        return self.exchanged + self.signs.count(-1.0) + (self.factor != 1.0)

    def corrected(self, angles: FloatArray) -> FloatArray:
        """Return the corrected outer and inner angles of recorded angles, shape (k, 2)."""
        signed = angles * self.signs * self.factor
        return np.asarray(signed[:, ::-1] if self.exchanged else signed)

    def texts(self) -> list[Text]:
        """Return descriptions of the errors."""
        texts = [Text.of("setup.angles_exchanged")] if self.exchanged else []
        texts += [
            Text.of("setup.angle_reversed", column=f"{joint}_deg")
            for joint, sign in zip(JOINTS, self.signs, strict=True)
            if sign < 0.0
        ]
        if self.factor != 1.0:
            given, right = ("rad", "°") if self.factor > 1.0 else ("°", "rad")
            texts.append(Text.of("setup.angles_scaled", given=given, right=right))
        return texts


_ANGLES = (
    *(_Angles(exchanged, (a, b)) for exchanged in (False, True) for a in (1.0, -1.0) for b in (1.0, -1.0)),
    _Angles(factor=180.0 / np.pi),
    _Angles(factor=np.pi / 180.0),
)


@dataclass(frozen=True)
class _Fit:
    """A signed permutation of a sensor's axes, and a factor, with which it agrees with the table."""

    axes: FloatArray  #: Signed permutation from true to measured axes, shape (3, 3).
    factor: float  #: Ratio of the measured to the true magnitude.

    @property
    def errors(self) -> int:
        """Number of axes that are reversed, plus one for each pair that is exchanged."""
        order = np.argmax(np.abs(self.axes), axis=1)
        reversed_axes = int(np.count_nonzero(self.axes[range(3), order] < 0.0))
        return (
            reversed_axes + int(np.count_nonzero(order != np.arange(3))) // 2 + (int(np.trace(np.abs(self.axes))) == 0)
        )


def _signed_permutations() -> tuple[FloatArray, ...]:
    orders, signs = itertools.permutations(range(3)), list(itertools.product((1.0, -1.0), repeat=3))
    return tuple(np.array(s)[:, None] * np.eye(3)[list(order)] for order in orders for s in signs)


_PERMUTATIONS = sorted(_signed_permutations(), key=lambda P: _Fit(P, 1.0).errors)


def gross_error(motion: TableMotion | None, context: SolveContext, clock_offsets: Sequence[float]) -> Diagnosis | None:
    """Return the gross error of the configuration that explains the motion in a stage; None if there is none.

    Parameters
    ----------
    motion : motion of the table and the sensors; None if it is unknown
    context : IMU, table and site
    clock_offsets : relative differences of the sample rate from its nominal value, from independent clocks
    """
    if motion is None:
        return None
    offset = _wrapped_channel(motion, context)
    if offset is not None:
        return offset
    candidates = list(_candidates(motion, context))
    fewest = min((candidate.errors for candidate in candidates), default=0)
    best = [candidate for candidate in candidates if candidate.errors == fewest]
    if fewest == 0:
        factor = _wrong_factor(best[0], context, clock_offsets) if best else None
        return factor or (Diagnosis("angles_modulo") if _turned_modulo(motion, context) else None)
    texts = [_joined("setup.together", _axis_texts(candidate, context)) for candidate in best[:_MAX_ALTERNATIVES]]
    return Diagnosis("angles_or_axes", values={"what": _joined("setup.either", texts).to_json()})


def _joined(code: str, texts: list[Text]) -> Text:
    """Join texts in pairs with the text `code`."""
    return texts[0] if len(texts) == 1 else Text.of(code, first=texts[0], second=_joined(code, texts[1:]))


@dataclass(frozen=True)
class _Candidate:
    """A configuration that explains a stage: errors of the angles, and fits of both sensors, None without data."""

    angles: _Angles
    gyro: _Fit | None
    accel: _Fit | None

    @property
    def mounted(self) -> bool:
        """Whether both sensors have the same wrong axes, because the unit is mounted in another orientation."""
        if self.gyro is None or self.accel is None or not self.gyro.errors:
            return False
        return np.array_equal(self.gyro.axes, self.accel.axes) and float(np.linalg.det(self.gyro.axes)) > 0.0

    @property
    def errors(self) -> int:
        """Number of wrong entries."""
        axes = 1 if self.mounted else sum(fit.errors for fit in (self.gyro, self.accel) if fit is not None)
        return self.angles.errors + axes


def _candidates(motion: TableMotion, context: SolveContext) -> Iterator[_Candidate]:
    """Yield the configurations that explain a stage; end with the actual configuration if it does."""
    for angles in _ANGLES:
        up, turns, rotations = _expected(angles, motion, context)
        gyros = _fits(rotations, turns)
        accels = _fits(motion.force, context.site.local_gravity * up)
        is_scaled = any(g is not None and _is_near(g.factor, 1.0) for g in gyros)
        if gyros and accels and (angles.factor == 1.0 or is_scaled):
            candidates = [_Candidate(angles, gyros[0], accels[0])]
            candidates += [
                _Candidate(angles, g, a) for g in gyros for a in accels if g and a and np.array_equal(g.axes, a.axes)
            ]
            best = min(candidates, key=lambda candidate: candidate.errors)
            yield best
            if best.errors == 0:
                return


def _expected(angles: _Angles, motion: TableMotion, context: SolveContext) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the up directions in b at the rests, shape (k, 3), and rotations of the unit, rad, shape (u, 3).

    The rotations are computed from the corrected angles, for single joints between two rests and for parts of other
    motions. The third array contains the rotations measured by the gyros.
    """
    geometry, joints = context.table.geometry, angles.corrected(motion.angles)
    up = np.array([geometry.body_to_home(*pair)[2] for pair in joints])
    turns, measured = [], []
    for (k, _), moved, rotation in zip(motion.links, motion.joints, motion.rotation, strict=True):
        change = joints[k + 1] - joints[k]
        joint = int(np.argmax(np.abs(change)))
        if moved is not None and abs(change[joint]) >= SMALLEST_TURN:
            turns.append(change[joint] * turn_axis(joints[k], joint, context))
            measured.append(rotation)
    for pair, rotation in zip(motion.part_angles, motion.part_rotation, strict=True):
        before, after = (geometry.body_to_home(*joints) for joints in angles.corrected(pair))
        turns.append(rotation_vector(before.T @ after))
        measured.append(rotation)
    return up, np.array(turns).reshape(-1, 3), np.array(measured).reshape(-1, 3)


def _fits(measured: FloatArray, expected: FloatArray) -> list[_Fit | None]:
    """Return the fits for which `measured` agrees with `expected`, shape (n, 3), those with fewest errors first.

    Without data, the list contains only None.
    """
    has_direction = expected.any(axis=1)
    measured, expected = measured[has_direction], expected[has_direction]
    if not len(measured):
        return [None]
    size = np.linalg.norm(expected, axis=1)
    factor = float(np.median(np.linalg.norm(measured, axis=1) / size))
    if not factor > 0.0:
        return []
    scaled, direction = measured / (factor * size[:, None]), expected / size[:, None]
    deviation = [np.linalg.norm(scaled - direction @ axes.T, axis=1) for axes in _PERMUTATIONS]
    explains = [float(np.mean(each > _AGREES)) <= _UNEXPLAINED for each in deviation]
    return [_Fit(axes, factor) for axes, is_explained in zip(_PERMUTATIONS, explains, strict=True) if is_explained]


def _axis_texts(candidate: _Candidate, context: SolveContext) -> list[Text]:
    """Return descriptions of the errors of angles and axes."""
    texts = candidate.angles.texts()
    if candidate.mounted and candidate.gyro is not None:
        return [*texts, Text.of("setup.mounted", orientation=_orientation(candidate.gyro.axes, context))]
    for sensor, fit in (("gyro_", candidate.gyro), ("accel_", candidate.accel)):
        if fit is not None and fit.errors:
            texts.append(Text.of("setup.axes", swaps=_swaps(sensor, fit.axes)))
    return texts


def _orientation(axes: FloatArray, context: SolveContext) -> str:
    """Return the orientation of a unit whose axes differ from the configured axes by a rotation."""
    mounted = np.array(context.table.orientation) @ axes.T
    return next(name for name in ORIENTATIONS if np.array_equal(np.array(orientation_matrix(name)), mounted))


def _swaps(sensor: str, axes: FloatArray) -> list[Text]:
    """Return, for each axis that a signed permutation changes, the channel that contains its values."""
    parts = []
    for column, axis in enumerate(AXES):
        row = int(np.argmax(np.abs(axes[:, column])))
        sign = "" if axes[row, column] > 0.0 else "−"
        if sign or row != column:
            parts.append(Text.of("setup.axis", name=f"{sensor}{axis}", sign=sign, column=f"{sensor}{AXES[row]}"))
    return parts


def _turned_modulo(motion: TableMotion, context: SolveContext) -> bool:
    """Return whether all differences between gyros and encoders in motions are whole turns, and there is one."""
    if np.ptp(motion.angles, axis=0).max() > 2.0 * np.pi + SMALLEST_TURN:
        return False
    differ = 0
    for (k, _), rotation in zip(motion.links, motion.rotation, strict=True):
        size = float(np.linalg.norm(rotation))
        change = motion.angles[k + 1] - motion.angles[k]
        joint = int(np.argmax(np.abs(change)))
        if not size >= np.pi or abs(change[1 - joint]) > SMALLEST_TURN:  # the rotation is unknown without gyros
            continue
        axis = turn_axis(motion.angles[k], joint, context)
        is_still = abs(change[joint]) < SMALLEST_TURN  # the axis of a whole turn is not recorded
        along = size if is_still else float(rotation @ axis)
        turns = (along - float(change[joint])) / (2.0 * np.pi)
        if not abs(turns) >= 0.5:
            continue
        across = 0.0 if is_still else float(np.linalg.norm(rotation - along * axis)) / size
        if abs(turns - np.rint(turns)) > 0.1 or across > 0.2:
            return False
        differ += 1
    return differ > 0


def _wrong_factor(candidate: _Candidate, context: SolveContext, clock_offsets: Sequence[float]) -> Diagnosis | None:
    """Return the error that explains the factors of gyros and accelerometers; None if both are near 1."""
    imu, increment = context.imu, context.imu.output == "increment"
    fits = candidate.gyro, candidate.accel
    known = [fit.factor for fit in fits if fit is not None]
    gyro_factor, accel_factor = (1.0 if fit is None else fit.factor for fit in fits)
    if all(1.0 / _SCALE < factor < _SCALE for factor in known):
        return None
    by_rate = imu.sample_rate if increment else 1.0 / imu.sample_rate
    factors: dict[str, float | str] = {"gyro": gyro_factor, "accel": accel_factor}
    if all(_is_near(factor, by_rate) for factor in known):
        output = "rate" if increment else "increment"
        return Diagnosis("output_kind", by_rate, values={**factors, "output": output})
    # a wrong sample rate changes the forces of increments, and the angles of rates
    ratio, other = (1.0 / accel_factor, gyro_factor) if increment else (gyro_factor, accel_factor)
    agree = [_is_near(1.0 + offset, ratio) for offset in clock_offsets] or [_is_near(max(ratio, 1.0 / ratio), 2.0)]
    if 1.0 / _SCALE < other < _SCALE and any(agree):
        values = {**factors, "rate": imu.sample_rate * ratio, "configured": imu.sample_rate}
        values |= (
            {"lsb": "accel_lsb", "correction": ratio} if increment else {"lsb": "gyro_lsb", "correction": 1.0 / ratio}
        )
        return Diagnosis("sample_rate_wrong", ratio, values=values)
    if not 1.0 / _SCALE < gyro_factor < _SCALE:
        return Diagnosis("gyro_unit", gyro_factor, values=_unit_values(gyro_factor, imu.gyro_lsb, _GYRO_UNITS))
    return Diagnosis("accel_unit", accel_factor, values=_unit_values(accel_factor, imu.accel_lsb, _ACCEL_UNITS))


def _unit_values(factor: float, lsb: float, units: tuple[tuple[str, str, float], ...]) -> dict[str, Any]:
    """Return the values of the message about a wrong unit."""
    slips = [Text.of("setup.unit_slip", given=given, right=right) for given, right, f in units if _is_near(factor, f)]
    return {"factor": factor, "lsb": lsb / factor, "why": slips[0].to_json() if slips else ""}


def _is_near(factor: float, known: float) -> bool:
    return bool(abs(np.log(factor / known)) < np.log(_KNOWN))


def _wrapped_channel(motion: TableMotion, context: SolveContext) -> Diagnosis | None:
    """Return the diagnosis of a channel whose mean at rest is wrong by the range of its field, or None."""
    gravity, size = context.site.local_gravity, context.imu.count_size
    up, _, _ = _expected(_Angles(), motion, context)
    means = np.hstack([motion.rate, motion.force - gravity * up])
    for channel, values in enumerate(means.T):
        middle = float(np.median(values))
        for wrap in _WRAPS:
            level = wrap * size[channel]
            others = np.hstack([motion.rate, motion.force])[:, channel]
            beyond = level > (np.deg2rad(5.0) if channel < 3 else 0.3 * gravity)
            if beyond and abs(abs(middle) / level - 1.0) < 0.02 and np.ptp(others) < 0.5 * level:
                name = ("gyro_" if channel < 3 else "accel_") + AXES[channel % 3]
                return Diagnosis("count_offset", values={"channel": name, "counts": np.sign(middle) * wrap})
    return None


def heading_test(motion: TableMotion | None, context: SolveContext, prior: Posterior) -> list[ModelTest]:
    """Test the heading of platform +y at home against the gyros; [] if they do not measure it in the stage."""
    configured = context.site.azimuth
    measured = None if configured is None or motion is None else _measured_heading(motion, context, prior)
    if configured is None or measured is None:
        return []
    azimuth, sigma = measured
    deviation = abs(_wrapped(azimuth - configured))
    mirrored = abs(_wrapped(azimuth + configured)) < 0.5 * _HEADING_TOLERANCE + 3.0 * sigma
    degrees = {"measured": azimuth % (2.0 * np.pi), "measured_sigma": sigma, "configured": configured}
    values = {name: float(np.rad2deg(value)) for name, value in degrees.items()}
    sense = Text.of("setup.other_sense").to_json() if mirrored else ""
    diagnosis = Diagnosis("heading_wrong", deviation, sigma, "rad", values={**values, "sense": sense})
    return [ModelTest("heading", deviation, _HEADING_TOLERANCE + _HEADING_SIGMAS * sigma, "rad", diagnosis)]


def _measured_heading(motion: TableMotion, context: SolveContext, prior: Posterior) -> tuple[float, float] | None:
    """Return the heading of platform +y at home and its sigma, rad, measured by the gyros at the rests of the table.

    The result is None if the rests do not separate the heading from the gyro biases. The rate at a rest is the earth
    rate in b plus the bias; the horizontal earth rate and the biases are unknowns, with the prior of the biases.
    """
    if np.isnan(motion.rate).all():
        return None
    imu, earth = context.imu, rotation_rate(context.site.latitude)
    homes = [context.table.geometry.body_to_home(*pair) for pair in motion.angles]
    bias, sigma = prior.mean[GYRO_BIAS], np.maximum(prior.sigma[GYRO_BIAS], 1e-12)
    rows, values = [np.hstack([np.zeros((3, 2)), np.diag(1.0 / sigma)])], [np.zeros(3)]
    dt = 1.0 / imu.sample_rate
    duration = np.array([(b - a) * dt for a, b in motion.rests])
    rounding = imu.quantisation[0] * imu.rate_factor / np.sqrt(12.0)
    noise = np.sqrt(imu.gyro_arw**2 / duration + imu.gyro_bias_instability**2 + (rounding * dt / duration) ** 2)
    for home, rate, spread in zip(homes, motion.rate, noise, strict=True):
        rows.append(np.hstack([home.T[:, :2], np.eye(3)]) / spread)
        values.append((rate - bias - home.T[:, 2] * earth[2]) / spread)
    H, observed = np.vstack(rows), np.concatenate(values)
    information = H.T @ H
    scale = 1.0 / np.sqrt(np.diag(information))
    if np.linalg.cond(information * np.outer(scale, scale)) > _MAX_CONDITION:
        return None
    covariance = np.linalg.inv(information)
    estimate = covariance @ H.T @ observed
    residual = (observed - H @ estimate)[3:]
    free = max(len(residual) - 5, 1)
    spread = np.sqrt(max(1.0, float(residual @ residual) / free) * covariance[:2, :2].diagonal().max())
    horizontal = float(earth[1])
    size = float(np.hypot(estimate[0], estimate[1]))
    if spread > _MAX_HEADING_SIGMA * horizontal or abs(size - horizontal) > 5.0 * spread + 0.1 * horizontal:
        return None
    return float(np.arctan2(-estimate[0], estimate[1])), float(spread) / horizontal


def _wrapped(angle: float) -> float:
    """Return the equivalent angle between −π and π."""
    return float((angle + np.pi) % (2.0 * np.pi) - np.pi)
