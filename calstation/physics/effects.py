"""Effects outside the 30-parameter model, each defined by an entry of `EFFECTS` alone.

A new effect needs an entry, message texts, documentation and an independent implementation in the bench, which tests
check for all `EFFECTS`; see "An effect of the error model" in docs/how-to/extend.md.

Sources: IEEE Std 952-2020 and 1293-2018 (error models of gyros and accelerometers); Cai, Yang, Song, Wang, *Measurement
Science and Technology* 27 (2016) 095005 (g-sensitivity and cross-coupling on a two-axis table).
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from calstation.physics.arrays import FloatArray
from calstation.physics.parameters import AXES

#: Smallest rate of a rotation, rad/s, and smallest angle of a turn, rad.
_TURNING, _TURNED = np.deg2rad(1.0), np.deg2rad(1.0)


@dataclass(frozen=True)
class OuterTurn:
    """Rotation about the outer axis of a two-axis table over n intervals; vectors in the local-level (ENU) frame."""

    axis: FloatArray  #: Unit vector of the outer axis, shape (n, 3).
    before: FloatArray  #: Unit vector of the inner axis at the start of each interval, shape (n, 3).
    after: FloatArray  #: Unit vector of the inner axis at the end of each interval, shape (n, 3).
    duration: FloatArray  #: Duration of each interval, s, shape (n,).


@dataclass(frozen=True)
class Motion:
    """Motion of an IMU over n intervals, in body axes."""

    rate: FloatArray  #: Angular rate, rad/s, shape (n, 3).
    force: FloatArray  #: Specific force, m/s², shape (n, 3).
    angular_acceleration: FloatArray  #: rad/s², shape (n, 3)
    jerk: FloatArray  #: Rate of change of the specific force in body axes, m/s³, shape (n, 3).
    time: FloatArray  #: Time since the start of the stage, s, shape (n,).
    outer: OuterTurn | None = None  #: None without a two-axis table, or if its axes are unknown.
    #: Sense of the last turn about each axis before the first interval, +1, −1, or 0 without one, shape (3,).
    initial_turn_senses: FloatArray | None = None
    #: Means of ω × dω/dt over the intervals, rad²/s³, shape (n, 3); None to use `rate` × `angular_acceleration`.
    coning: FloatArray | None = None
    #: Matrix from the rate to the rates about the gyros' axes, shape (3, 3); None for axes equal to b.
    axes: FloatArray | None = None

    @classmethod
    def steady(
        cls, rate: FloatArray, force: FloatArray, time: FloatArray, initial_turn_senses: FloatArray | None = None
    ) -> "Motion":
        """Return a motion with constant rate and force in every interval.

        Parameters
        ----------
        rate, force, time, initial_turn_senses : as the attributes, shape (n, 3), (n, 3), (n,) and (3,)
        """
        still = np.zeros_like(rate)
        return cls(rate, force, still, still, time, initial_turn_senses=initial_turn_senses)

    @property
    def coning_rate(self) -> FloatArray:
        """ω × dω/dt, rad²/s³, shape (n, 3)."""
        return np.cross(self.rate, self.angular_acceleration) if self.coning is None else self.coning

    @property
    def last_turns(self) -> FloatArray:
        """Sense of the last completed turn about each gyro's axis: +1, −1, or 0 before the first, shape (n, 3).

        A turn lasts from rest to rest. The rates are those at `time`.
        """
        sensed = self.rate if self.axes is None else self.rate @ self.axes.T
        moving, sense = np.abs(sensed).max(axis=1) > _TURNING, np.zeros_like(sensed)
        sense[:] = 0.0 if self.initial_turn_senses is None else self.initial_turn_senses
        edges = np.flatnonzero(np.diff(moving.astype(np.int64), prepend=0, append=0))
        for begin, end in edges.reshape(-1, 2).tolist():
            angle = np.trapezoid(sensed[begin:end], self.time[begin:end], axis=0)
            sense[end:] = np.where(np.abs(angle) > _TURNED, np.sign(angle), sense[begin])
        return sense


class Term(NamedTuple):
    """An error of a channel due to an effect: a component's size times a regressor."""

    channel: int  #: 0 to 5: gyro x y z, accel x y z.
    component: int
    regressor: int


@dataclass(frozen=True)
class Effect:
    """An effect with one unknown size per component."""

    cause: str  #: Name; code of the families ``cause`` and ``group`` of the message catalogue.
    unit: str  #: Unit of its sizes, SI.
    #: Prior standard deviation of a size; None for the parameter's sigma before calibration. Without a prior, a
    #: regressor that is little more than noise would lead to an absurd size.
    plausible: float | None
    components: tuple[str, ...]  #: Names of the components: axes or pairs of axes, or "".
    #: Function (motion) -> channel errors per unit of a size, shape (n, r).
    regressors: Callable[[Motion], FloatArray]
    terms: tuple[Term, ...]  #: Errors of the channels.
    #: Function (turn) -> mean velocity of the IMU over the intervals, in ENU, that the model lacks, per unit of a size,
    #: shape (n, 3, k), for an effect of the table; None for an effect of the sensors.
    velocity: Callable[[OuterTurn], FloatArray] | None = None
    is_state: bool = False  #: Whether a unit's model may contain it; otherwise it is only tested.
    between_sensors: bool = False  #: Whether it depends on both gyros and accelerometers.
    rarity: float = 0.0  #: χ² by which its evidence must exceed that of a common effect that resembles it.
    on_table: bool = False  #: Whether it is tested only if the motion of a table is known.
    #: Parameter that each component changes during the stage, by 1 per unit of its size; empty for a constant effect.
    parameters: tuple[str, ...] = ()
    begin: float = 0.0  #: Time in the stage before which its errors are zero, s.

    @property
    def names(self) -> tuple[str, ...]:
        """Public names of the sizes, one per component."""
        return tuple(f"{self.cause}_{component}".rstrip("_") for component in self.components)

    def errors(self, motion: Motion) -> FloatArray:
        """Return the error of the six channels per unit of each size, shape (n, 6, k)."""
        regressors = self.regressors(motion)
        errors = np.zeros((len(regressors), 6, len(self.components)))
        for term in self.terms:
            errors[:, term.channel, term.component] = regressors[:, term.regressor]
        return errors

    def parameter_of(self, component: int) -> str:
        """Return the parameter that a component changes; "" for a constant effect."""
        return self.parameters[component] if self.parameters else ""


#: Terms of an effect with one regressor and one component per gyro, or per accelerometer.
OF_GYROS, OF_ACCELEROMETERS = (tuple(Term(first + i, i, i) for i in range(3)) for first in (0, 3))
#: Axis of an accelerometer and another axis.
_PAIRS = tuple((i, j) for i in range(3) for j in range(3) if i != j)
_AXES = tuple(AXES)
#: Rarity of terms of fifth order, which hardly occur without terms of third order.
_FIFTH_ORDER = 6.0
#: Rarity of delays of single channels, of which a delay of all accelerometers is a special case.
_SPECIAL_CASE = 15.0


def _off_axis(m: Motion) -> FloatArray:
    """Return the errors of two accelerometers displaced along the axis of the third, by plus and minus half a distance.

    The force at a displacement d is ω̇×d + ω×(ω×d), of which an accelerometer senses the component along its axis. The
    part common to both displacements is a lever arm.
    """
    errors = np.zeros((len(m.rate), 6))
    for axis in range(3):
        unit = np.eye(3)[axis]
        force = np.cross(m.angular_acceleration, unit) + np.cross(m.rate, np.cross(m.rate, unit))
        errors[:, 2 * axis] = 0.5 * force[:, (axis + 1) % 3]
        errors[:, 2 * axis + 1] = -0.5 * force[:, (axis + 2) % 3]
    return errors


def _flex(m: Motion) -> FloatArray:
    """Return the products ω_i f_j and their opposites, shape (n, 18)."""
    products = m.rate[:, :, None] * m.force[:, None, :]
    return np.concatenate([products, -products], axis=1).reshape(len(products), -1)


def _channel_delay(m: Motion) -> FloatArray:
    """Return the errors of delayed channels, shape (n, 21): six for each gyro, and one for each accelerometer.

    A gyro error dψ/dt in b, with ψ = 0 at rest, is equivalent to the gyro error −ω×ψ and the specific force error ψ×f,
    which contain no derivative of the rate. The delay τ of gyro i is ψ = −τ ω_i e_i.
    """
    gyros = [
        m.rate[:, [i]] * np.hstack([np.cross(m.rate, unit), np.cross(m.force, unit)])
        for i, unit in enumerate(np.eye(3))
    ]
    return np.hstack([*gyros, -m.jerk])


def _low_pass(m: Motion) -> FloatArray:
    """Return the channel errors of a low-pass per unit of c, half the variance of its impulse response, shape (n, 6).

    Apart from the mean delay, which is common to all channels and has no effect, the gyro error is c d²ω/dt². It is
    replaced as in `_channel_delay` with ψ = c dω/dt. The force is constant in ENU, so the terms in dω/dt of its error
    c d²f/dt² + ψ×f cancel.
    """
    return np.hstack([-m.coning_rate, np.cross(m.rate, np.cross(m.rate, m.force))])


def _moving(m: Motion) -> FloatArray:
    """Return 1 during a rotation and 0 at rest, shape (n, 1)."""
    return np.asarray(np.abs(m.rate).max(axis=1, keepdims=True) > _TURNING, np.float64)


def _axis_offset(turn: OuterTurn) -> FloatArray:
    """Return the mean velocity of the inner axis due to its offset d from the outer axis u, per unit of two sizes.

    The sizes are the components of d along u × inner axis and along the inner axis. The latter is part of the outer
    lever arm, unless the lever arm is fixed. Both directions rotate with the outer joint at its rate q̇, so their change
    divided by the duration of the interval is the mean of q̇ u × d.
    """

    def directions(inner: FloatArray) -> FloatArray:
        hinge = np.cross(turn.axis, inner)
        return np.stack([hinge / np.linalg.norm(hinge, axis=1)[:, None], inner], axis=2)

    return (directions(turn.after) - directions(turn.before)) / turn.duration[:, None, None]


#: Parameter groups that may change during a run.
CHANGING_GROUPS = ("gyro_bias", "gyro_scale", "accel_bias", "accel_scale")
#: Effects that are constant throughout a run.
EFFECTS: tuple[Effect, ...] = (
    Effect(
        "g_sensitivity", "rad·s/m", 1e-4, tuple(f"{a}{b}" for a in AXES for b in AXES),
        lambda m: m.force, tuple(Term(k // 3, k, k % 3) for k in range(9)), is_state=True,
    ),
    Effect("gyro_asymmetry", "1", 1e-2, _AXES, lambda m: np.abs(m.rate), OF_GYROS, is_state=True),
    Effect("gyro_square", "s/rad", 1e-2, _AXES, lambda m: m.rate**2, OF_GYROS, is_state=True),
    Effect("gyro_cubic", "s²/rad²", 1e-2, _AXES, lambda m: m.rate**3, OF_GYROS, is_state=True),
    Effect("accel_cubic", "s⁴/m²", 1e-5, _AXES, lambda m: m.force**3, OF_ACCELEROMETERS, is_state=True),
    Effect(
        "accel_cross", "s²/m", 1e-4, tuple(f"{AXES[i]}{AXES[j]}" for i, j in _PAIRS),
        lambda m: m.force * np.roll(m.force, -1, axis=1),
        # regressor k is the product of axes k and k + 1
        tuple(Term(3 + i, k, i if j == (i + 1) % 3 else j) for k, (i, j) in enumerate(_PAIRS)),
        is_state=True,
    ),
    Effect("accel_asymmetry", "1", 1e-2, _AXES, lambda m: np.abs(m.force), OF_ACCELEROMETERS, is_state=True),
    Effect(
        "accel_off_axis", "m", 0.1, _AXES, _off_axis,
        tuple(Term(3 + (k // 2 + k % 2 + 1) % 3, k // 2, k) for k in range(6)), is_state=True,
    ),
    Effect(
        "time_skew", "s", 0.02, ("",), lambda m: -m.jerk, tuple(Term(3 + i, 0, i) for i in range(3)),
        is_state=True, between_sensors=True,
    ),
    Effect(
        # relative to accelerometer x, because a common delay has no effect
        "channel_delay", "s", 0.02, ("gyro_x", "gyro_y", "gyro_z", "accel_y", "accel_z"), _channel_delay,
        tuple(Term(s + j, i, 6 * i + s + j) for i in range(3) for s in (0, 3) for j in range(3) if j != i)
        + tuple(Term(3 + i, 2 + i, 18 + i) for i in (1, 2)),
        between_sensors=True, on_table=True, rarity=_SPECIAL_CASE,
    ),
    Effect(
        "low_pass", "s²", 1e-3, ("",), _low_pass, tuple(Term(i, 0, i) for i in range(6)),
        between_sensors=True, on_table=True,
    ),
    Effect(
        "coning", "s²", 1e-3, ("",), lambda m: m.coning_rate,
        tuple(Term(i, 0, i) for i in range(3)), on_table=True,
    ),
    Effect(
        "gyro_flex", "rad·s²/m", 1e-4, tuple(f"{a}{b}" for a in AXES for b in AXES), _flex,
        # a rotation by K f adds ω × K f: component kj of K, times f_j, acts on the two gyros other than k
        tuple(
            Term(gyro, 3 * k + j, 9 * (other == (gyro + 2) % 3) + 3 * other + j)
            for k in range(3) for j in range(3)
            for gyro, other in (((k + 1) % 3, (k + 2) % 3), ((k + 2) % 3, (k + 1) % 3))
        ),
        between_sensors=True,
    ),
    Effect(
        "gyro_g_square", "rad·s³/m²", 1e-5, tuple(f"{a}{b}" for a in AXES for b in AXES),
        lambda m: m.force**2, tuple(Term(k // 3, k, k % 3) for k in range(9)),
    ),
    Effect("gyro_fifth", "s⁴/rad⁴", 1e-2, _AXES, lambda m: m.rate**5, OF_GYROS, rarity=_FIFTH_ORDER),
    Effect("accel_fifth", "s⁸/m⁴", 1e-7, _AXES, lambda m: m.force**5, OF_ACCELEROMETERS, rarity=_FIFTH_ORDER),
    Effect(
        "accel_rate_square", "m", 0.1, tuple(f"{a}{b}" for a in AXES for b in AXES),
        lambda m: m.rate**2, tuple(Term(3 + k // 3, k, k % 3) for k in range(9)), between_sensors=True,
    ),
    Effect("gyro_moving_bias", "rad/s", 1e-2, _AXES, _moving, tuple(Term(i, i, 0) for i in range(3)), on_table=True),
    Effect("accel_moving_bias", "m/s²", 0.1, _AXES, _moving, tuple(Term(3 + i, i, 0) for i in range(3)), on_table=True),
    Effect("gyro_hysteresis", "rad/s", 1e-2, _AXES, lambda m: m.last_turns, OF_GYROS, on_table=True),
    Effect("gyro_scale_hysteresis", "1", 1e-2, _AXES, lambda m: m.rate * m.last_turns, OF_GYROS, on_table=True),
    Effect(
        "axis_offset", "m", 1e-2, ("hinge", "inner"), lambda m: np.empty((len(m.rate), 0)), (),
        velocity=_axis_offset, is_state=True, on_table=True,
    ),
)  # fmt: skip
