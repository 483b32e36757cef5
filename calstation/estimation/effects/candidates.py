"""Effects outside the 30-parameter model that are tested: the sensor error of each one per unit of its size.

Sources: IEEE Std 952-2020 and 1293-2018 (error models of gyros and accelerometers); Cai, Yang, Song, Wang, *Measurement
Science and Technology* 27 (2016) 095005 (g-sensitivity and cross-coupling on a two-axis table).
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from calstation.physics import AXES, EFFECTS, EffectName, FloatArray

#: Times within a stage at which a bias or scale factor may jump, as fractions of its duration.
JUMPS = tuple((k + 1) / 8.0 for k in range(7))
#: Time constant of a warm-up, s.
WARM_UP = 300.0


@dataclass(frozen=True)
class Motion:
    """Motion of an IMU in n intervals, in body axes."""

    rate: FloatArray  #: Angular rate, rad/s, shape (n, 3).
    force: FloatArray  #: Specific force, m/s², shape (n, 3).
    angular_acceleration: FloatArray  #: rad/s², shape (n, 3)
    jerk: FloatArray  #: Rate of change of the specific force in body axes, m/s³, shape (n, 3).
    time: FloatArray  #: Time since the start of the stage, s, shape (n,).


class Place(NamedTuple):
    """Channel and component of one regressor of an effect."""

    channel: int  #: 0 to 5: gyro x y z, accel x y z.
    component: int  #: Component whose size multiplies the regressor.
    regressor: int


@dataclass(frozen=True)
class Candidate:
    """An effect with one unknown size per component."""

    cause: str  #: Code of the message catalogue's family ``cause``.
    unit: str  #: Unit of its sizes, SI.
    #: Expected standard deviation of a size; None for the parameter's sigma before calibration. Without it, a regressor
    #: that is little more than noise would get an absurd size.
    plausible: float | None
    components: tuple[str, ...]  #: Names of the components: axes or pairs of axes, or "".
    #: Function (motion) -> channel errors per unit of a size, shape (n, r).
    regressors: Callable[[Motion], FloatArray]
    places: tuple[Place, ...]  #: Channels that have these errors.
    #: Parameter that each component changes during the stage; empty for a constant effect.
    parameters: tuple[str, ...] = ()
    #: Change of these parameters from the start to the end of the stage per unit of each size, given its duration, s.
    change: Callable[[float], FloatArray] = lambda duration: np.zeros(0)
    begin: float = 0.0  #: Time in the stage before which its errors are zero, s.

    def errors(self, motion: Motion) -> FloatArray:
        """Return the error of the six channels per unit of each size, shape (n, 6, k)."""
        regressors = self.regressors(motion)
        errors = np.zeros((len(regressors), 6, len(self.components)))
        for place in self.places:
            errors[:, place.channel, place.component] = regressors[:, place.regressor]
        return errors

    def parameter_of(self, component: int) -> str:
        """Return the parameter that a component changes, "" for a constant effect."""
        return self.parameters[component] if self.parameters else ""


#: Channels and components of an effect with one regressor and one component for each gyro, or each accelerometer.
OF_GYROS, OF_ACCELEROMETERS = (tuple(Place(first + i, i, i) for i in range(3)) for first in (0, 3))


def _off_axis(m: Motion) -> FloatArray:
    """Return the errors of two accelerometers displaced along the axis of the third, each by half the distance.

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


#: Sensor, kind, unit and names of the parameters that may change.
_CHANGING = tuple(
    (sensor, what, unit, tuple(f"{name}_{what}_{axis}" for axis in AXES))
    for sensor, (name, bias_unit) in enumerate((("gyro", "rad/s"), ("accel", "m/s²")))
    for what, unit in (("bias", bias_unit), ("scale", "1"))
)
#: Axis of an accelerometer and another axis.
_PAIRS = tuple((i, j) for i in range(3) for j in range(3) if i != j)
_AXES = tuple(AXES)


def _optional(cause: EffectName, regressors: Callable[[Motion], FloatArray], places: tuple[Place, ...]) -> Candidate:
    """Return an effect that the model of a unit may contain."""
    unit, components, plausible = EFFECTS[cause]
    return Candidate(cause, unit, plausible, components, regressors, places)


#: Effects that are constant throughout the run.
CONSTANT: tuple[Candidate, ...] = (
    _optional("g_sensitivity", lambda m: m.force, tuple(Place(k // 3, k, k % 3) for k in range(9))),
    _optional("gyro_asymmetry", lambda m: np.abs(m.rate), OF_GYROS),
    Candidate("gyro_square", "s/rad", 1e-2, _AXES, lambda m: m.rate**2, OF_GYROS),
    Candidate("gyro_cubic", "s²/rad²", 1e-2, _AXES, lambda m: m.rate**3, OF_GYROS),
    _optional("accel_cubic", lambda m: m.force**3, OF_ACCELEROMETERS),
    _optional(
        "accel_cross",
        lambda m: m.force * np.roll(m.force, -1, axis=1),
        # regressor k is the product of axes k and k + 1
        tuple(Place(3 + i, k, i if j == (i + 1) % 3 else j) for k, (i, j) in enumerate(_PAIRS)),
    ),
    Candidate("accel_asymmetry", "1", 1e-2, _AXES, lambda m: np.abs(m.force), OF_ACCELEROMETERS),
    _optional("accel_off_axis", _off_axis, tuple(Place(3 + (k // 2 + k % 2 + 1) % 3, k // 2, k) for k in range(6))),
    _optional("time_skew", lambda m: -m.jerk, tuple(Place(3 + i, 0, i) for i in range(3))),
)


def effect_errors(sizes: Mapping[str, float], rate: FloatArray, force: FloatArray) -> FloatArray:
    """Return the error of the six channels, shape (n, 6), at constant rate and force, SI, shape (n, 3).

    `sizes` are the sizes of effects by parameter; other names are ignored.
    """
    still = np.zeros_like(rate)
    motion, errors = Motion(rate, force, still, still, np.zeros(len(rate))), np.zeros((len(rate), 6))
    for candidate in CONSTANT:
        names = [f"{candidate.cause}_{component}".rstrip("_") for component in candidate.components]
        if not sizes.keys().isdisjoint(names):
            errors += candidate.errors(motion) @ [sizes.get(name, 0.0) for name in names]
    return errors


def changing(duration: float) -> Iterator[Candidate]:
    """Yield the drifts and jumps of every bias and scale factor within a stage of `duration` s, in start order."""
    for sensor, what, unit, axes in _CHANGING:
        yield Candidate(
            "drift", unit, None, 6 * ("",), *_changing(sensor, what, 2, _drift, duration),
            tuple(np.repeat(axes, 2).tolist()), lambda end: np.tile(_drift(np.array([end]), end)[0], 3),
        )  # fmt: skip
    for share in JUMPS:
        for sensor, what, unit, axes in _CHANGING:
            yield Candidate(
                "jump", unit, None, 3 * ("",), *_changing(sensor, what, 1, _jump(share), duration), axes,
                lambda _: np.ones(3), share * duration,
            )  # fmt: skip


def drifted(time: FloatArray) -> FloatArray:
    """Return the time functions of a drift: a ramp, s, and a warm-up that ends at 1, shape (n, 2)."""
    return np.stack([time, -np.expm1(-time / WARM_UP)], axis=1)


def _drift(time: FloatArray, duration: float) -> FloatArray:
    """Return a ramp and a warm-up, each of size 1 at the end of the stage, shape (n, 2)."""
    return np.asarray(drifted(time) / drifted(np.array([duration])))


def _jump(share: float) -> Callable[[FloatArray, float], FloatArray]:
    return lambda time, duration: (time >= share * duration).astype(float)[:, None]


def _changing(
    sensor: int, what: str, width: int, shape: Callable[[FloatArray, float], FloatArray], duration: float
) -> tuple[Callable[[Motion], FloatArray], tuple[Place, ...]]:
    """Return the errors of channels whose biases or scale factors change over time, one axis after the other.

    `shape` returns the `width` time functions of the change.
    """

    def regressors(m: Motion) -> FloatArray:
        course = shape(m.time, duration)
        if what == "bias":
            return course
        input_ = (m.rate, m.force)[sensor]
        return np.asarray(input_[:, :, None] * course[:, None, :]).reshape(len(course), -1)

    each = width if what == "scale" else 0  # a bias has the same errors on every axis
    places = (Place(3 * sensor + axis, width * axis + k, each * axis + k) for axis in range(3) for k in range(width))
    return regressors, tuple(places)
