"""Effects that change during a run: drifts and jumps of biases and scale factors; and errors of known effects."""

from collections.abc import Callable, Iterator, Mapping
from functools import partial

import numpy as np

from calstation.physics import AXES, EFFECTS, Effect, FloatArray, Motion, Term

#: Times within a stage at which a bias or scale factor may jump, as fractions of its duration.
JUMPS = tuple((k + 1) / 8.0 for k in range(7))
#: Time constant of a warm-up, s.
WARM_UP = 300.0


def effect_errors(sizes: Mapping[str, float], rate: FloatArray, force: FloatArray) -> FloatArray:
    """Return the error of the six channels, shape (n, 6), at constant rate and force, SI, shape (n, 3).

    `sizes` are the sizes of effects by parameter; other names are ignored.
    """
    motion, errors = Motion.steady(rate, force, np.zeros(len(rate))), np.zeros((len(rate), 6))
    for effect in EFFECTS:
        if not sizes.keys().isdisjoint(effect.names):
            errors += effect.errors(motion) @ [sizes.get(name, 0.0) for name in effect.names]
    return errors


def changing(duration: float) -> Iterator[Effect]:
    """Yield the drifts and jumps of every bias and scale factor within a stage of `duration` s, in start order.

    The size of a component is the change of its parameter at the end of the stage.
    """
    at_end = drifted(np.array([duration]))
    yield from _changes("drift", 2, lambda time: np.asarray(drifted(time) / at_end))
    for share in JUMPS:
        begin = share * duration
        yield from _changes("jump", 1, partial(_step, begin), begin)


def drifted(time: FloatArray) -> FloatArray:
    """Return the time functions of a drift: a ramp, s, and a warm-up that ends at 1, shape (n, 2)."""
    return np.stack([time, -np.expm1(-time / WARM_UP)], axis=1)


def _step(begin: float, time: FloatArray) -> FloatArray:
    return (time >= begin).astype(float)[:, None]


def _changes(
    cause: str, width: int, course: Callable[[FloatArray], FloatArray], begin: float = 0.0
) -> Iterator[Effect]:
    """Yield the same change of the biases and of the scale factors of gyros and accelerometers.

    `course` returns the `width` time functions of the change, each for every axis.
    """
    for sensor, (name, unit) in enumerate((("gyro", "rad/s"), ("accel", "m/s²"))):
        for kind in ("bias", "scale"):
            each = 0 if kind == "bias" else width  # a bias has the same errors on every axis
            yield Effect(
                cause,
                unit if kind == "bias" else "1",
                None,
                3 * width * ("",),
                partial(_regressors, course, None if kind == "bias" else sensor),
                tuple(Term(3 * sensor + i, width * i + k, each * i + k) for i in range(3) for k in range(width)),
                parameters=tuple(f"{name}_{kind}_{axis}" for axis in AXES for _ in range(width)),
                begin=begin,
            )


def _regressors(course: Callable[[FloatArray], FloatArray], sensor: int | None, motion: Motion) -> FloatArray:
    """Return the time functions of a change, times the input of each axis of a sensor for a scale factor."""
    change = course(motion.time)
    if sensor is None:
        return change
    sensed = (motion.rate, motion.force)[sensor]
    return np.asarray(sensed[:, :, None] * change[:, None, :]).reshape(len(change), -1)
