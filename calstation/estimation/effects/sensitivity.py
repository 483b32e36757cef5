"""Sensitivity of a stage's innovations and estimates to prior errors and to effects outside the model.

An unmodelled effect of size θ adds J θ to the innovations and causes the error D θ of the estimate (truth minus
estimate). Both follow from the gains of the estimator, even if it is not optimal.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from calstation.estimation.common import BatchGain, StageData, group_means, means
from calstation.physics import (
    AXES,
    COUNT,
    EFFECTS,
    BoolArray,
    Effect,
    FloatArray,
    IntArray,
    Motion,
    Term,
    group_indices,
)

#: Times of the tested jumps within a stage, as fractions of its duration.
JUMPS = tuple((k + 1) / 8.0 for k in range(7))
#: Time constant of a warm-up, s.
WARM_UP = 300.0
#: Interval over which the rate is averaged to find turns, s.
TURN_INTERVAL = 0.1


@dataclass(frozen=True)
class StageEffects:
    """The effects for which a stage is tested; its solver creates the `Sensitivity` from them."""

    begin: float  #: Time at which the stage begins, s.
    duration: float  #: s
    on_table: bool = True  #: Whether a table moved the unit; effects with `Effect.on_table` are tested only then.

    @cached_property
    def parameter_changes(self) -> tuple[Effect, ...]:
        """Effects that change a parameter during the stage, see `parameter_changes`."""
        return tuple(parameter_changes(self.duration))

    @property
    def candidates(self) -> tuple[Effect, ...]:
        """All tested effects: `EFFECTS`, then `parameter_changes`."""
        return (*EFFECTS, *self.parameter_changes)

    def errors(self, motion: Motion, counts: IntArray) -> FloatArray:
        """Return the errors of the six channels, averaged over k groups of `counts` intervals, shape (k, 6, c).

        Errors of effects that are not tested in the stage are 0.
        """
        errors = mean_errors(motion, self.candidates, counts)
        if not self.on_table:
            errors[:, :, [effect.on_table for effect in self.candidates for _ in effect.components]] = 0.0
        return errors

    def sensitivity(
        self,
        score: FloatArray,
        information: FloatArray,
        remaining: FloatArray,
        estimated: BoolArray,
        noise_ratio: float = 1.0,
    ) -> "Sensitivity":
        """Return the sensitivity of a stage.

        Parameters
        ----------
        score, information, noise_ratio : as in `Sensitivity`
        remaining : error of each parameter if all were estimated, shape (30, c)
        estimated : True for the parameters that the stage estimates, shape (30,)
        """
        error = np.where(estimated[:, None], remaining, np.eye(COUNT, len(score)))
        return Sensitivity(score, information, error, self, noise_ratio)

    def batch_sensitivity(self, gain: BatchGain, contributions: FloatArray, estimated: BoolArray) -> "Sensitivity":
        """Return the sensitivity of an estimate from m observations in one batch.

        Parameters
        ----------
        gain : gain of the 30 parameters
        contributions : contribution of each component of `candidates` to the observations, shape (m, components)
        estimated : True for the parameters that the gain corrects, shape (30,)
        """
        jacobian, K, covariance, innovation = gain
        response = np.hstack([jacobian, contributions])
        weighted = np.linalg.solve(covariance, response)
        remaining = np.eye(COUNT, response.shape[1]) - K @ response
        return self.sensitivity(weighted.T @ innovation, response.T @ weighted, remaining, estimated)


@dataclass(frozen=True)
class Sensitivity:
    """Score and information of c columns, and the estimation errors that they cause.

    The columns are an error of each parameter's prior mean (30), and the components of the tested effects.
    """

    score: FloatArray  #: Jᵀ S⁻¹ ν, shape (c,).
    information: FloatArray  #: Jᵀ S⁻¹ J, shape (c, c).
    error: FloatArray  #: D, the error of each parameter, truth minus estimate, shape (30, c).
    effects: StageEffects
    #: Ratio of χ² with the noise of the estimate to χ² with the noise of `score` and `information`.
    noise_ratio: float = 1.0


def mean_errors(motion: Motion, effects: Sequence[Effect], counts: IntArray) -> FloatArray:
    """Return the errors of the six channels, averaged over k groups of `counts` intervals, shape (k, 6, components).

    Parameters
    ----------
    motion : motion in n intervals
    effects : effects, whose components are concatenated
    counts : number of intervals of each group, which sum to n, shape (k,)
    """
    regressors, terms = mean_regressors(motion, effects, counts)
    errors = np.zeros((len(counts), 6, sum(len(effect.components) for effect in effects)))
    channel, component, regressor = terms.T
    errors[:, channel, component] = regressors[:, regressor]
    return errors


def mean_regressors(motion: Motion, effects: Sequence[Effect], counts: IntArray) -> tuple[FloatArray, IntArray]:
    """Return the regressors averaged over k groups of `counts` intervals, shape (k, r), and their terms, shape (t, 3).

    The components and regressors of the terms are counted over all effects.

    Parameters
    ----------
    motion : motion in n intervals
    effects : effects, whose regressors are concatenated
    counts : number of intervals of each group, which sum to n, shape (k,)
    """
    columns = [np.empty((len(counts), 0))]
    terms: list[tuple[int, int, int]] = []
    component = regressor = 0
    for effect in effects:
        columns.append(means(effect.regressors(motion), counts))
        terms += [(t.channel, component + t.component, regressor + t.regressor) for t in effect.terms]
        component, regressor = component + len(effect.components), regressor + columns[-1].shape[1]
    return np.hstack(columns), np.array(terms, dtype=np.int64).reshape(-1, 3)


def velocity_errors(motion: Motion, effects: Sequence[Effect]) -> tuple[FloatArray, IntArray]:
    """Return the velocities due to effects of the table per unit of size, shape (n, 3, k), and their components, (k,).

    The velocities, m/s, are means over the intervals. The components are counted over all effects.
    """
    parts, columns, component = [np.empty((len(motion.rate), 3, 0))], list[int](), 0
    for effect in effects:
        count = len(effect.components)
        if effect.velocity is not None and motion.outer is not None:
            parts.append(effect.velocity(motion.outer))
            columns += range(component, component + count)
        component += count
    return np.concatenate(parts, axis=2), np.array(columns, dtype=np.int64)


def effect_errors(sizes: Mapping[str, float], rate: FloatArray, force: FloatArray) -> FloatArray:
    """Return the error of the six channels, SI, shape (n, 6), at constant rate and force.

    Parameters
    ----------
    sizes : sizes of effects by parameter, SI; other names are ignored
    rate, force : rate, rad/s, and specific force, m/s², of n intervals, shape (n, 3) each
    """
    motion, errors = Motion.steady(rate, force, np.zeros(len(rate))), np.zeros((len(rate), 6))
    for effect in EFFECTS:
        if not sizes.keys().isdisjoint(effect.names):
            errors += effect.errors(motion) @ [sizes.get(name, 0.0) for name in effect.names]
    return errors


def last_turns(
    data: StageData, parameters: FloatArray, before: tuple[float, float, float], stop: int | None = None
) -> tuple[float, float, float]:
    """Return the sense of the last turn about each axis at the end of a stage, +1, −1, or 0 without one.

    Parameters
    ----------
    data : samples of the stage
    parameters : parameters of the unit, SI, shape (30,)
    before : senses at the start of the stage
    stop : number of samples to use; None for all
    """
    stride = max(round(TURN_INTERVAL / data.dt), 1)
    rate = group_means(data.gyro[:stop], stride) - parameters[group_indices("gyro_bias")]
    time = group_means(data.time[:stop, None], stride)[:, 0]
    if not len(rate):
        return before
    x, y, z = Motion.steady(rate, np.zeros_like(rate), time, np.array(before)).last_turns[-1].tolist()
    return x, y, z


def parameter_changes(duration: float) -> Iterator[Effect]:
    """Yield the drifts and jumps of every bias and scale factor within a stage of `duration` s, in chronological order.

    The size of a component is the change of its parameter at the end of the stage.
    """
    at_end = drift_functions(np.array([duration]))
    yield from _changes("drift", 2, lambda time: np.asarray(drift_functions(time) / at_end))
    for share in JUMPS:
        begin = share * duration
        yield from _changes("jump", 1, partial(_step, begin), begin)


def drift_functions(time: FloatArray) -> FloatArray:
    """Return the time functions of a drift: a ramp, s, and a warm-up that approaches 1, shape (n, 2)."""
    return np.stack([time, -np.expm1(-time / WARM_UP)], axis=1)


def drifts_before_end() -> Iterator[Effect]:
    """Yield the drifts of every bias and scale factor at a constant rate until the end of a motion.

    The size of a component is the change of its parameter per second; at the end, the parameter has its nominal value.
    """
    return _changes("drift", 1, lambda time: np.asarray(time - time[-1])[:, None])


def _step(begin: float, time: FloatArray) -> FloatArray:
    return (time >= begin).astype(float)[:, None]


def _changes(
    cause: str, width: int, course: Callable[[FloatArray], FloatArray], begin: float = 0.0
) -> Iterator[Effect]:
    """Yield one kind of change for the biases and scale factors of gyros and accelerometers.

    `course` returns the `width` time functions of the change, which apply to every axis.
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
