"""What makes a recording of positions worthless, named: frozen channels, no rest, no motion, wrong units, wrong axes.

A fit of such a recording answers too, with confidence; so each is looked for before, in the data themselves. Gravity
shows the accelerometers' unit at any rest; how its direction changes between two rests shows what the gyros should
have turned by, whichever way the unit was held.
"""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calstation.errors import InputError, InsufficientDataError
from calstation.estimation.common.context import Belief, ImuModel
from calstation.estimation.common.stage_data import StageData
from calstation.estimation.common.stillness import Link, Stillness, find_stillness
from calstation.estimation.positions.rows import integrate_rotation
from calstation.physics.arrays import BoolArray, FloatArray
from calstation.physics.imu_model import compensate, compensation
from calstation.physics.parameters import group_indices

CHANNELS = ("gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z")
#: A channel that repeats one value this long, s, and far longer than its noise makes likely, is frozen.
FREEZE_TIME = 1.0
#: A recording in which fewer samples repeat the one before has noise in every channel, whatever the unit does.
NOISY = 0.05
#: So many times the longest repetition that chance brings.
UNLIKELY = 5.0
#: Within this the length of a rest's force is a matter of bias and scale; beyond, of units.
PLAUSIBLE_GRAVITY = (0.75, 1.33)
#: Rests whose gravity differs less are one position.
OTHER_POSITION = np.deg2rad(10.0)
#: Factor that mends a slip of units, by its name.
ACCEL_UNITS = {
    "g instead of m/s²": 9.80665,
    "mg instead of m/s²": 9.80665e-3,
    "m/s² instead of g": 1.0 / 9.80665,
    "mm/s² instead of m/s²": 1e-3,
}
GYRO_UNITS = {
    "°/s instead of rad/s": np.pi / 180.0,
    "rad/s instead of °/s": 180.0 / np.pi,
    "mrad/s instead of rad/s": 1e-3,
    "m°/s instead of rad/s": np.pi / 180e3,
}
#: Factors tried where no slip of units explains the turns: neighbours are 3 % apart.
FACTORS = np.exp(np.linspace(np.log(0.1), np.log(10.0), 154))
#: Up to this share of motions may contradict gravity without a reason that holds for all; they are left out.
STRAY = 0.1


@dataclass(frozen=True)
class _Turn:
    """A motion between two rests.

    before, after : measured direction of gravity in b, unit vectors, shape (3,)
    bias : raw rate at rest, rad/s, shape (3,); path : length of the way turned, rad
    """

    link: Link
    before: FloatArray
    after: FloatArray
    bias: FloatArray
    path: float

    @property
    def tilt(self) -> float:
        """Angle by which gravity's direction changed, rad."""
        return float(np.arccos(np.clip(self.before @ self.after, -1.0, 1.0)))


def valid_links(
    data: StageData, still: Stillness, imu: ImuModel, gravity: float, prior: Belief, shortest: float
) -> tuple[Link, ...]:
    """The motions that agree with gravity, where a few do not.

    Raises InputError or InsufficientDataError naming what is wrong with the recording, if anything is.
    """
    for name, first, last in frozen_columns(CHANNELS, np.column_stack([data.gyro, data.accel]), data.dt):
        raise InputError(
            f"{name} is frozen: one value from sample {data.seq[first]} to {data.seq[last]} "
            f"({(last - first) * data.dt:.1f} s); check the unit and its cable and record again"
        )
    if not still.rests:
        _complain_of_no_rest(data, imu, gravity, prior, shortest)
    turns, up = _turns(data, still, prior)
    _require_gravity(data, still, gravity, prior)
    if _distinct(up) < 2:
        raise InsufficientDataError(
            f"no motion: all {len(up)} rests lie the same way up; turn the unit to other positions between rests"
        )
    stray = _stray(data, turns, prior, gravity, compensation(prior.mean).gyro_inverse)
    if stray.sum() > STRAY * len(turns):
        _explain(data, turns, prior, gravity)
    return tuple(turn.link for turn, strays in zip(turns, stray, strict=True) if not strays)


def _complain_of_no_rest(
    data: StageData, imu: ImuModel, gravity: float, prior: Belief, shortest: float
) -> None:
    """Nothing rests; or it does, but rates in the wrong unit make its noise look like motion."""
    for name, factor in GYRO_UNITS.items():
        scaled = replace(data, gyro=data.gyro * factor)
        still = find_stillness(scaled, imu, shortest)
        turns, _ = _turns(scaled, still, prior)
        if turns and _stray(scaled, turns, prior, gravity, np.eye(3)).sum() <= STRAY * len(turns):
            raise InputError(
                f"the gyros' units are wrong by a factor: their noise looks like motion, and rests appear where rates "
                f"are multiplied by {factor:.4g} ({name}); correct imu.gyro_lsb or imu.output"
            )
    raise InsufficientDataError(
        f"no rest of {shortest:g} s or more in {len(data) * data.dt:.1f} s of samples; "
        "lay the unit still at every position"
    )


def frozen_columns(names: Sequence[str], values: FloatArray, dt: float) -> Iterator[tuple[str, int, int]]:
    """Columns that repeat one value far longer than their noise makes likely: name, first and last sample.

    Where all columns repeat together and repeat elsewhere too, the recording has no noise to tell by.

    Parameters
    ----------
    values : shape (n, k), sampled every `dt` s
    """
    for channel, name in enumerate(names):
        same = np.concatenate([[False], np.diff(values[:, channel]) == 0.0, [False]])
        edges = np.flatnonzero(np.diff(same.astype(np.int8)))
        if not len(edges):
            continue
        first, last = max(zip(edges[::2], edges[1::2], strict=True), key=lambda e: e[1] - e[0])
        length = int(last - first)
        others = max(len(values) - 1 - length, 0)
        again = (int(same.sum()) - length) / others if others else 0.0
        chance = np.log(len(values)) / -np.log(np.clip(again, 1e-3, 1.0 - 1e-6))
        if length * dt <= FREEZE_TIME or length <= UNLIKELY * chance:
            continue
        others_change = np.delete(np.diff(values[first:last], axis=0) != 0.0, channel, axis=1).mean(axis=0)
        if others_change.max() > 0.5 or again < NOISY:
            yield name, int(first), int(last)


def _require_gravity(data: StageData, still: Stillness, gravity: float, prior: Belief) -> None:
    bias = prior.mean[group_indices("accel_bias")]
    length = float(np.median([np.linalg.norm(data.accel[a:b].mean(axis=0) - bias) for a, b in still.rests]))
    ratio = length / gravity
    if PLAUSIBLE_GRAVITY[0] < ratio < PLAUSIBLE_GRAVITY[1]:
        return
    slip = _nearest(ACCEL_UNITS, 1.0 / max(ratio, 1e-12))
    raise InputError(
        f"accelerometers at rest show {length:.4g} m/s² where gravity is {gravity:.4g}: units wrong by a factor of "
        f"{ratio:.4g}{slip}; correct imu.accel_lsb or imu.output"
    )


def _nearest(units: dict[str, float], factor: float) -> str:
    """The slip of units that `factor` mends, as a remark; empty where there is none."""
    for name, mend in units.items():
        if abs(np.log(factor / mend)) < 0.2:
            return f" ({name})"
    return ""


def _distinct(up: FloatArray) -> int:
    """How many positions differ in the direction of gravity."""
    kept: list[FloatArray] = []
    for direction in up:
        if all(direction @ other < np.cos(OTHER_POSITION) for other in kept):
            kept.append(direction)
    return len(kept)


def _turns(data: StageData, still: Stillness, prior: Belief) -> tuple[list[_Turn], FloatArray]:
    """The motions between rests, and the measured direction of gravity at every rest, shape (n, 3)."""
    rates = np.array([data.gyro[a:b].mean(axis=0) for a, b in still.rests]).reshape(-1, 3)
    means = np.array([data.accel[a:b].mean(axis=0) for a, b in still.rests]).reshape(-1, 3)
    _, force = compensate(compensation(prior.mean), rates, means)
    up = force / np.linalg.norm(force, axis=1, keepdims=True)
    found = []
    for link in still.links:
        bias = 0.5 * (rates[link.first] + rates[link.second])
        path = float(np.linalg.norm(data.gyro[link.start : link.stop] - bias, axis=1).sum()) * data.dt
        found.append(_Turn(link, up[link.first], up[link.second], bias, path))
    return found, up


def _stray(
    data: StageData, turns: list[_Turn], prior: Belief, gravity: float, gyro_inverse: FloatArray
) -> BoolArray:
    """Which motions carry gravity elsewhere than it is, beyond what the prior allows, shape (n,).

    gyro_inverse : through which the gyros are read, shape (3, 3)
    """
    matrix = 3.0 * float(
        np.hypot(*(prior.sigma[group_indices(g)].max() for g in ("gyro_scale", "gyro_misalign")))
    )
    lean = 3.0 * float(prior.sigma[group_indices("accel_bias")].max()) / gravity
    allowed = np.array([np.deg2rad(3.0) + lean + min(matrix, 0.15) * max(t.path, t.tilt) for t in turns])
    return np.asarray(_left(data, turns, gyro_inverse) > allowed)


def _explain(data: StageData, turns: list[_Turn], prior: Belief, gravity: float) -> None:
    """Raise InputError with the reason why motions contradict gravity."""

    def explains(gyro_inverse: FloatArray) -> bool:
        return bool(_stray(data, turns, prior, gravity, gyro_inverse).sum() <= STRAY * len(turns))

    left = _left(data, turns, np.eye(3))
    worst = turns[int(np.argmax(left))]
    where = f"samples {data.seq[worst.link.start]} to {data.seq[worst.link.stop - 1]}"
    if float(np.median([t.path for t in turns])) < 0.2 * float(np.median([t.tilt for t in turns])):
        raise InputError(
            f"the gyros do not see the motions: {np.rad2deg(worst.path):.1f}° where gravity turned by "
            f"{np.rad2deg(worst.tilt):.0f}° ({where}); check that they are alive and imu.gyro_lsb"
        )
    axes = min(_signed_permutations(), key=lambda P: float(_left(data, turns, P).sum()))
    if explains(axes):
        raise InputError(
            f"the gyro's axes are not the accelerometer's: motions agree with gravity where {_told(axes)}; "
            "correct the columns or their signs"
        )
    tried = [*GYRO_UNITS.values(), *FACTORS]
    factor = min(tried, key=lambda k: float(_left(data, turns, k * np.eye(3)).sum()))
    if explains(factor * np.eye(3)):
        raise InputError(
            f"the gyros' units are wrong by a factor: motions agree with gravity where rates are multiplied by "
            f"{factor:.4g}{_nearest(GYRO_UNITS, factor)}; correct imu.gyro_lsb or imu.output"
        )
    raise InputError(
        f"gyros and accelerometers contradict each other in too many of {len(turns)} motions, most by "
        f"{np.rad2deg(left.max()):.0f}° in {where}; check gaps, saturation and columns"
    )


def _left(data: StageData, turns: list[_Turn], gyro_inverse: FloatArray) -> FloatArray:
    """Angle between gravity after each motion and where the gyros, read through `gyro_inverse`, carry it, rad."""
    left = np.empty(len(turns))
    for k, t in enumerate(turns):
        B, _, _ = integrate_rotation(gyro_inverse, t.bias, data.dt, data.gyro, t.link.start, t.link.stop)
        left[k] = np.arccos(np.clip((B.T @ t.before) @ t.after, -1.0, 1.0))
    return left


def _signed_permutations() -> Iterator[FloatArray]:
    """All ways to exchange and turn round three axes, shape (3, 3) each, 48 in all."""
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            P = np.zeros((3, 3))
            P[range(3), order] = signs
            yield P


def _told(P: FloatArray) -> str:
    """A signed permutation in words: which column is read for each axis that differs."""
    parts = []
    for row, axis in enumerate("xyz"):
        column = int(np.argmax(np.abs(P[row])))
        sign = "" if P[row, column] > 0.0 else "−"
        if sign or column != row:
            parts.append(f"gyro_{axis} is {sign}gyro_{'xyz'[column]}")
    return " and ".join(parts)
