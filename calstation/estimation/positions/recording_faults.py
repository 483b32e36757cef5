"""Checks of a recording of positions: frozen channels, no rest, no motion, wrong units, wrong axes.

The magnitude of gravity verifies the unit of the accelerometers, and the change of its direction the rotation measured
by the gyros.
"""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calstation.errors import InputError, InsufficientDataError
from calstation.estimation.common import (
    REST_MARGIN,
    ImuModel,
    Link,
    Posterior,
    StageData,
    Stillness,
    find_stillness,
    true_intervals,
)
from calstation.estimation.positions.rows import integrate_rotation
from calstation.messages import Text
from calstation.physics import AXES, CHANNELS, BoolArray, FloatArray, compensate, compensation, group_indices

#: Shortest time for which a frozen channel repeats one value, s.
FREEZE_TIME = 1.0
#: Largest fraction of repeated samples of a noisy channel.
NOISY = 0.05
#: Smallest fraction of repeated samples of a coarse column, whose steps exceed its noise.
COARSE = 0.5
#: Window in which motions are detected, s.
MOTION_WINDOW = 0.5
#: Smallest length of a frozen interval, relative to the longest repetition expected by chance.
UNLIKELY = 5.0
#: Gyro that suppresses small rates: smallest fraction of the samples at rest with one value, and smallest number of its
#: other values.
MIN_AT_REST, MIN_VALUES = 0.98, 50
#: A coarse gyro is also constant at rest, but its noise is below this fraction of a step, and a value within this
#: number of steps of the value at rest also occurs.
MIN_NOISE, SUPPRESSED_STEPS = 0.5, 5.0
#: Fraction of its range by which a column changes during a motion.
MOTION_SHARE = 0.2
#: Probability that a coarse channel keeps one value in successive motions by chance, below which it is frozen.
CHANCE = 1e-3
#: Lowest and highest ratio of the force at rest to gravity; other ratios indicate a wrong unit.
PLAUSIBLE_RATIOS = (0.75, 1.33)
#: Smallest angle between the directions of up at different positions, rad.
OTHER_POSITION = np.deg2rad(10.0)
#: Confusions of units: actual unit of the values, unit as which they were read, and the factor that corrects them.
ACCEL_UNITS = (
    ("g", "m/s²", 9.80665),
    ("mg", "m/s²", 9.80665e-3),
    ("m/s²", "g", 1.0 / 9.80665),
    ("mm/s²", "m/s²", 1e-3),
)
GYRO_UNITS = (
    ("°/s", "rad/s", np.pi / 180.0),
    ("rad/s", "°/s", 180.0 / np.pi),
    ("mrad/s", "rad/s", 1e-3),
    ("m°/s", "rad/s", np.pi / 180e3),
)
#: Factors that are tried if no confusion of units explains the rotations, in steps of 3 %.
FACTORS = np.exp(np.linspace(np.log(0.1), np.log(10.0), 154))
#: Largest plausible factor between the rates and those computed from gravity during motions, and smallest squared
#: correlation at which a factor is accepted, because fast motions by hand add forces.
MAX_FACTOR, MIN_CORRELATION = 2.0, 0.8
#: Longest interval in which the change of gravity in b is compared with the rates, s.
_COURSE_WINDOW = 2.0
#: Largest fraction of motions that contradict gravity and are omitted.
MAX_CONTRADICTORY = 0.1
#: Upper bounds of the allowed error of an angle between two rests due to accelerometer biases, rad, and of a rotation
#: due to the gyro matrix, relative to its angle, for any prior.
_MAX_TILT, _MAX_MATRIX = 0.3, 0.15


@dataclass(frozen=True)
class _Turn:
    """A motion between two rests."""

    link: Link
    before: FloatArray  #: Measured direction of up in b before the motion, unit vector, shape (3,).
    after: FloatArray  #: As `before`, after the motion, shape (3,).
    bias: FloatArray  #: Raw rate at rest, rad/s, shape (3,).
    path: float  #: Integral of the magnitude of the rate, rad.

    @property
    def tilt(self) -> float:
        """Angle between up in b before and after the motion, rad."""
        return float(np.arccos(np.clip(self.before @ self.after, -1.0, 1.0)))


def valid_links(
    data: StageData, still: Stillness, imu: ImuModel, gravity: float, prior: Posterior, shortest: float
) -> tuple[Link, ...]:
    """Return the motions that agree with gravity.

    Raises InputError or InsufficientDataError if the recording cannot be used.

    Parameters
    ----------
    data : samples of the recording
    still : its rests and motions
    imu : model of the unit
    gravity : local gravity, m/s²
    prior : estimate before the stage
    shortest : shortest rest of the schedule, s
    """
    _require_small_rates(data, still, imu)
    require_changing(data, CHANNELS, np.column_stack([data.gyro, data.accel]))
    if not still.rests:
        raise _no_rest_error(data, imu, gravity, prior, still, shortest)
    turns, up = _turns(data, still, prior)
    _require_gravity(data, still, gravity, prior)
    if _distinct(up) < 2:
        if still.too_short > 1:
            raise _short_rests_error(still, shortest)
        raise InsufficientDataError("recording.one_position", rests=len(up))
    contradictory = _contradicting(data, turns, prior, gravity, compensation(prior.mean).gyro_inverse)
    if contradictory.sum() > MAX_CONTRADICTORY * len(turns) or _has_wrong_factor(data, turns, np.eye(3)):
        raise _contradiction_error(data, turns, prior, gravity)
    return tuple(turn.link for turn, is_contradictory in zip(turns, contradictory, strict=True) if not is_contradictory)


def _no_rest_error(
    data: StageData, imu: ImuModel, gravity: float, prior: Posterior, still: Stillness, shortest: float
) -> InputError:
    """Return the error for a recording without rests, whose cause may be a wrong unit of the rates."""
    for assumed, right, factor in GYRO_UNITS:
        scaled = replace(data, gyro=data.gyro * factor)
        turns, _ = _turns(scaled, find_stillness(scaled, imu, shortest), prior)
        if turns and _contradicting(scaled, turns, prior, gravity, np.eye(3)).sum() <= MAX_CONTRADICTORY * len(turns):
            slip = Text.of("recording.unit_slip", given=assumed, right=right)
            return InputError("recording.gyro_unit_no_rest", factor=factor, slip=slip)
    if still.too_short > 1:
        return _short_rests_error(still, shortest)
    return InsufficientDataError("recording.no_rest", shortest=shortest, seconds=len(data) * data.dt)


def _short_rests_error(still: Stillness, shortest: float) -> InsufficientDataError:
    """Return the error for a recording with too few rests of sufficient duration."""
    values = {"short": still.too_short, "rests": len(still.rests), "needed": shortest + 2.0 * REST_MARGIN}
    return InsufficientDataError("recording.rests_too_short", **values)


def _require_small_rates(data: StageData, still: Stillness, imu: ImuModel) -> None:
    """Raise InputError if gyros have one value in all rests, although their noise would change it."""
    if not data.has_gyros or not still.rests:
        return
    at_rest = np.concatenate([data.gyro[a:b] for a, b in still.rests])
    noise = max(
        imu.gyro_arw / np.sqrt(data.dt),
        *(float(np.median([data.gyro[a:b, i].std() for a, b in still.rests])) for i in range(3)),
    )
    channels = []
    for i, name in enumerate(CHANNELS[:3]):
        values, counts = np.unique(at_rest[:, i], return_counts=True)
        others = np.abs(np.unique(data.gyro[:, i]) - values[np.argmax(counts)])
        others = np.sort(others[others > 0.0])
        if counts.max() < MIN_AT_REST * counts.sum() or len(others) < MIN_VALUES:
            continue
        step = float(np.quantile(np.diff(np.unique(data.gyro[:, i])), 0.05))
        if noise > MIN_NOISE * step or others[0] > SUPPRESSED_STEPS * step:
            channels.append(name)
    if channels:
        raise InputError("recording.small_rates_suppressed", channels=channels)


def require_changing(data: StageData, names: Sequence[str], values: FloatArray) -> None:
    """Raise InputError if one of the columns, shape (n, k), is frozen."""
    for name, first, last in frozen_columns(names, values, data.dt):
        span = {"first": int(data.seq[first]), "last": int(data.seq[last])}
        raise InputError("recording.frozen", channel=name, seconds=(last - first) * data.dt, **span)


def frozen_columns(names: Sequence[str], values: FloatArray, dt: float) -> Iterator[tuple[str, int, int]]:
    """Yield name, first and last sample of each frozen column; `values` has the shape (n, k).

    If all columns repeat their values at the same time and also elsewhere, the noise is too small for this test. A
    coarse column, whose steps exceed its noise, is constant at rest; it is frozen if it also keeps its value in
    motions.

    Parameters
    ----------
    names : names of the k columns
    values : values of the columns, shape (n, k)
    dt : sample period, s
    """
    moves: list[tuple[int, int]] | None = None
    for channel, name in enumerate(names):
        same = np.diff(values[:, channel]) == 0.0
        if not same.any():
            continue
        first, last = max(true_intervals(same), key=lambda run: run[1] - run[0])
        length = last - first
        other_samples = max(len(values) - 1 - length, 0)
        repeated = (int(same.sum()) - length) / other_samples if other_samples else 0.0
        chance = np.log(len(values)) / -np.log(np.clip(repeated, 1e-3, 1.0 - 1e-6))
        if length * dt <= FREEZE_TIME or length <= UNLIKELY * chance:
            continue
        changing = np.delete(np.diff(values[first:last], axis=0) != 0.0, channel, axis=1).mean(axis=0)
        if repeated >= COARSE:
            moves = moves or _moves(values, dt)
            if not _keeps_value(values[:, channel], moves, first, last):
                continue
        if changing.max() > 0.5 or repeated < NOISY:
            yield name, first, last


def _moves(values: FloatArray, dt: float) -> list[tuple[int, int]]:
    """Return the intervals in which a column, shape (n, k), changes by a large part of its range."""
    width = max(round(MOTION_WINDOW / dt), 2)
    count = len(values) // width
    parts = values[: count * width].reshape(count, width, -1)
    change = np.ptp(parts, axis=1) > MOTION_SHARE * np.maximum(np.ptp(values, axis=0), np.finfo(np.float64).tiny)
    return [(a * width, min((b + 1) * width, len(values))) for a, b in true_intervals(change.any(axis=1))]


def _keeps_value(values: FloatArray, moves: list[tuple[int, int]], first: int, last: int) -> bool:
    """Return whether a column, shape (n,), keeps its value from `first` to `last` in more moves than by chance."""
    within = [first <= a and b <= last for a, b in moves]
    changed = [bool(np.ptp(values[a:b]) > 0.0) for (a, b), inside in zip(moves, within, strict=True) if not inside]
    unchanged = 1.0 - (sum(changed) + 1.0) / (len(changed) + 2.0)
    return bool(unchanged ** sum(within) < CHANCE)


def _require_gravity(data: StageData, still: Stillness, gravity: float, prior: Posterior) -> None:
    bias = prior.mean[group_indices("accel_bias")]
    force = float(np.median([np.linalg.norm(data.accel[a:b].mean(axis=0) - bias) for a, b in still.rests]))
    ratio = force / gravity
    if not PLAUSIBLE_RATIOS[0] < ratio < PLAUSIBLE_RATIOS[1]:
        slip = _unit_slip(ACCEL_UNITS, 1.0 / max(ratio, 1e-12))
        raise InputError("recording.accel_unit", force=force, gravity=gravity, ratio=ratio, slip=slip)


def _unit_slip(slips: tuple[tuple[str, str, float], ...], factor: float) -> Text | str:
    """Return the text about the confusion of units that `factor` corrects; "" if there is none."""
    for assumed, right, correction in slips:
        if abs(np.log(factor / correction)) < 0.2:
            return Text.of("recording.unit_slip", given=assumed, right=right)
    return ""


def _distinct(up: FloatArray) -> int:
    """Return the number of positions that differ in the direction of up in b."""
    directions: list[FloatArray] = []
    for direction in up:
        if all(direction @ other < np.cos(OTHER_POSITION) for other in directions):
            directions.append(direction)
    return len(directions)


def _turns(data: StageData, still: Stillness, prior: Posterior) -> tuple[list[_Turn], FloatArray]:
    """Return the motions between rests, and the measured direction of up in b at every rest, shape (n, 3)."""
    rates = np.array([data.gyro[a:b].mean(axis=0) for a, b in still.rests]).reshape(-1, 3)
    means = np.array([data.accel[a:b].mean(axis=0) for a, b in still.rests]).reshape(-1, 3)
    _, force = compensate(compensation(prior.mean), rates, means)
    up = force / np.linalg.norm(force, axis=1, keepdims=True)
    turns = []
    for link in still.links:
        bias = 0.5 * (rates[link.first] + rates[link.second])
        path = float(np.linalg.norm(data.gyro[link.start : link.stop] - bias, axis=1).sum()) * data.dt
        turns.append(_Turn(link, up[link.first], up[link.second], bias, path))
    return turns, up


def _contradicting(
    data: StageData, turns: list[_Turn], prior: Posterior, gravity: float, gyro_inverse: FloatArray
) -> BoolArray:
    """Return whether each motion contradicts gravity by more than the prior allows, shape (n,).

    A wrong factor of the rates that changes the rotations only by whole turns is not detected; see `_rate_factor`.
    """
    matrix = 3.0 * float(np.hypot(*(prior.sigma[group_indices(g)].max() for g in ("gyro_scale", "gyro_misalign"))))
    tilt = 3.0 * float(prior.sigma[group_indices("accel_bias")].max()) / gravity
    fixed, relative = np.deg2rad(3.0) + min(tilt, _MAX_TILT), min(matrix, _MAX_MATRIX)
    size = float(np.cbrt(abs(np.linalg.det(gyro_inverse))))
    allowed = np.array([fixed + relative * max(size * t.path, t.tilt) for t in turns])
    return np.asarray(_gravity_error(data, turns, gyro_inverse) > allowed)


def _contradiction_error(data: StageData, turns: list[_Turn], prior: Posterior, gravity: float) -> InputError:
    """Return the error for motions that contradict gravity, with its cause."""

    def explains(gyro_inverse: FloatArray) -> bool:
        return bool(_contradicting(data, turns, prior, gravity, gyro_inverse).sum() <= MAX_CONTRADICTORY * len(turns))

    error = _gravity_error(data, turns, np.eye(3))
    worst = turns[int(np.argmax(error))]
    span = {"first": int(data.seq[worst.link.start]), "last": int(data.seq[worst.link.stop - 1])}
    if float(np.median([t.path for t in turns])) < 0.2 * float(np.median([t.tilt for t in turns])):
        path, tilt = float(np.rad2deg(worst.path)), float(np.rad2deg(worst.tilt))
        return InputError("recording.gyros_see_no_motion", turned_deg=path, tilt_deg=tilt, **span)
    signs, orders = itertools.product((1.0, -1.0), repeat=3), itertools.permutations(range(3))
    permutations = [np.array(s)[:, None] * np.eye(3)[list(order)] for order, s in itertools.product(orders, signs)]
    axes = min(permutations, key=lambda P: float(_gravity_error(data, turns, P).sum()))
    if explains(axes) and not any(_has_wrong_factor(data, turns, P) for P in (np.eye(3), axes)):
        return InputError("recording.axes_differ", swaps=_swaps(axes))
    about, correlation = max((_rate_factor(data, turns, P) for P in permutations), key=lambda pair: pair[1])
    is_known = correlation > MIN_CORRELATION
    tried = [*(slip[2] for slip in GYRO_UNITS), *(about * FACTORS if is_known else FACTORS)]
    factors = [k for k in tried if not is_known or _is_plausible(k / about)]
    factor = min(factors, key=lambda k: float(_gravity_error(data, turns, k * np.eye(3)).sum()))
    if explains(factor * np.eye(3)):
        return InputError("recording.gyro_unit", factor=float(factor), slip=_unit_slip(GYRO_UNITS, factor))
    angle = float(np.rad2deg(error.max()))
    return InputError("recording.contradictory", motions=len(turns), angle_deg=angle, **span)


def _has_wrong_factor(data: StageData, turns: list[_Turn], gyro_inverse: FloatArray) -> bool:
    """Return whether the change of gravity in b during the motions requires another factor of the rates."""
    factor, correlation = _rate_factor(data, turns, gyro_inverse)
    return correlation > MIN_CORRELATION and not _is_plausible(factor)


def _is_plausible(factor: float) -> bool:
    """Return whether a factor is near enough to 1 for the integrals of the rates to decide."""
    return 1.0 / MAX_FACTOR < factor < MAX_FACTOR


def _rate_factor(data: StageData, turns: list[_Turn], gyro_inverse: FloatArray) -> tuple[float, float]:
    """Return the factor of the rates that the change of gravity in b requires, and the squared correlation of the two.

    In slow motion the measured force f, in b, changes by df/dt = f × ω. Its integral with a smooth weight w
    that vanishes at both ends is −∫ f dw/dt dt = ∫ w f × ω dt, which is linear in ω and therefore, unlike the rotation,
    not ambiguous by whole turns. The factor is the median over the motions that tilt the unit; 1 if there are none.
    """
    sums = []
    for t in turns:
        start, count = t.link.start, t.link.stop - t.link.start
        width = count // max(1, round(count * data.dt / _COURSE_WINDOW))
        if t.tilt < OTHER_POSITION or width < 2:
            continue
        used = slice(start, start + count // width * width)
        phase = np.pi * (np.arange(width) + 0.5) / width
        weight, slope = np.sin(phase) ** 2, np.pi / (width * data.dt) * np.sin(2.0 * phase)
        force, rate = data.accel[used], (data.gyro[used] - t.bias) @ gyro_inverse.T
        expected = np.einsum("w,nwi->ni", weight, np.cross(force, rate).reshape(-1, width, 3))
        measured = -np.einsum("w,nwi->ni", slope, force.reshape(-1, width, 3))
        sums.append([(expected * measured).sum(), (expected**2).sum(), (measured**2).sum()])
    if not sums:
        return 1.0, 0.0
    product, square, size = np.array(sums).T
    tiny = np.finfo(np.float64).tiny
    factor = float(np.median(product / np.maximum(square, tiny)))
    return factor, float(product.sum() * abs(product.sum()) / max(square.sum() * size.sum(), tiny))


def _gravity_error(data: StageData, turns: list[_Turn], gyro_inverse: FloatArray) -> FloatArray:
    """Return the angle between up after each motion and its prediction by the gyros, rad, shape (n,)."""
    error = np.empty(len(turns))
    for k, t in enumerate(turns):
        B, _, _ = integrate_rotation(gyro_inverse, t.bias, data.dt, data.gyro, t.link.start, t.link.stop)
        error[k] = np.arccos(np.clip((B.T @ t.before) @ t.after, -1.0, 1.0))
    return error


def _swaps(P: FloatArray) -> list[Text]:
    """Return, for each axis that a signed permutation changes, the column that contains its values."""
    parts = []
    for row, axis in enumerate(AXES):
        column = int(np.argmax(np.abs(P[row])))
        sign = "" if P[row, column] > 0.0 else "−"
        if sign or column != row:
            parts.append(Text.of("recording.axis_read_as", axis=axis, sign=sign, column=AXES[column]))
    return parts
