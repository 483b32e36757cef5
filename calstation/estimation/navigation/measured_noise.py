"""Estimate the noise of velocity and accelerometers from the innovations of a stage if it exceeds the profiles'."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from calstation.estimation.common import (
    Posterior,
    SolveContext,
    StageData,
    consider_update,
    filter_noise,
    nis_consistency,
)
from calstation.estimation.effects import EffectTests
from calstation.estimation.method import Progress
from calstation.estimation.navigation.navigation_pass import History
from calstation.estimation.navigation.relinearise import REST_RATE, NavigationResult, pass_about, solve_navigation
from calstation.physics import BoolArray, FloatArray

#: Ratio of the assumed velocity variance to that of the innovations above which the latter is used to test the model.
MAX_VARIANCE_RATIO = 1.25
#: Median of the χ² distribution with 3 degrees of freedom, and allowed relative scatter of medians for one value.
_MEDIAN, _SCATTER = 2.366, 0.95
MAX_ADJUSTMENTS = 4
#: Smallest fraction of the profile's variance used; below it, other noise dominates and rounding errors increase.
_MIN_RATIO = 0.01
#: Smallest number of observations at rest, or in motion, whose median is used.
_MIN_COUNT = 50
#: Duration of the sums of innovations from which the accelerometer noise is measured, in units of the time after which
#: it exceeds the velocity noise, and largest variance ratio of these sums that noise can cause.
_SUMMED, _LARGEST_SLOW = 2.0, 12.0
#: Median of the χ² distribution with 1 degree of freedom, allowed relative scatter for one value, and significant
#: excess in units of this scatter for the first and for further adjustments.
_MEDIAN_OF_ONE, _SCATTER_OF_ONE, _SIGMAS = 0.4549, 1.75, (5.0, 1.0)


def solve_with_measured_noise(
    data: StageData,
    context: SolveContext,
    prior: Posterior,
    estimated: BoolArray,
    effects: Callable[[NavigationResult, SolveContext], EffectTests],
    progress: Progress | None = None,
) -> tuple[NavigationResult, SolveContext]:
    """Solve a stage, and solve it again if its innovations indicate more noise than the profiles specify.

    Return the result and the context with the noise used; for a quieter table, see `pass_with_actual_noise`. Raises
    InsufficientDataError if no segment contains a rest, numpy.linalg.LinAlgError if the solution diverges.

    Parameters
    ----------
    data, context, prior : samples of the stage, noise of the profiles, estimate before the stage
    estimated : mask of the estimated parameters, shape (30,)
    effects : returns the tests for effects up to this stage; innovations that they explain do not count as noise
    progress : callback with the solved fraction
    """
    result, slow = solve_navigation(data, context, prior, estimated, progress), 1.0
    for _ in range(MAX_ADJUSTMENTS):
        if not np.isfinite(result.history.nis).all():
            raise np.linalg.LinAlgError("innovations that are not finite")
        ratio = _excess(result, data.dt, partial(effects, result, context))
        is_first = slow == 1.0
        slow, gain = (1.0, 0.0) if ratio > 1.0 else _slow_excess(result.history, context, _SIGMAS[not is_first])
        if is_first and slow > 1.0:
            tests, posterior = effects(result, context), consider_update(prior, result.posterior, estimated)
            if max(tests.evidence(posterior)[0].excess, tests.estimate().explained) > gain:
                slow = 1.0
        if ratio == slow == 1.0:
            break
        context = _with_force(_with_variance(context, ratio), slow)
        result = solve_navigation(data, context, prior, estimated, initial=result)
    return result, context


def _excess(result: NavigationResult, dt: float, effects: Callable[[], EffectTests]) -> float:
    """Return the ratio by which the variance of the velocity must be increased; 1 if the innovations agree with it.

    The variance is increased if the test of the innovations would fail. The ratio is the larger of the medians of rests
    and of motions, because a median is insensitive to an effect in a part of the stage, or the mean if it is larger but
    agrees with the medians.
    """
    nis = result.history.nis
    consistency = nis_consistency(float(np.sum(nis)), len(nis), 3)
    largest = consistency.nis_high / 3.0
    ratio, mean = _ratio(result.history, dt), consistency.nis_mean / 3.0
    if mean < ratio * (1.0 + 4.0 * _SCATTER / np.sqrt(len(nis))):
        ratio = max(ratio, mean)
    if ratio > largest:
        ratio *= max(0.0, 1.0 - effects().estimate().explained / float(np.sum(nis)))
    return ratio if ratio > largest else 1.0


def _slow_excess(history: History, context: SolveContext, sigmas: float) -> tuple[float, float]:
    """Return the ratio by which the noise density of the accelerometers must be increased, from slow innovations.

    The second value is the increase of twice the log-likelihood, comparable with the χ² of an effect.

    At rests shorter than the time after which it exceeds the velocity noise, the accelerometer noise is not measurable.
    Sums of innovations over twice this time have the variance 1 if the density is correct; otherwise their variance
    approaches the ratio. An excess of `sigmas` is significant; if the median disagrees with the mean, it is due to an
    effect in a part of the stage.
    """
    noise = filter_noise(context)
    width = round(_SUMMED * float(np.sqrt(noise.velocity / (noise.force * noise.interval))))
    count = len(history.innovation) // max(width, 1)
    if width < 2 or 3 * count < _MIN_COUNT:
        return 1.0, 0.0
    sums = history.innovation[: count * width].reshape(count, width, 3).sum(axis=1) ** 2 / width
    variance, median = float(np.mean(sums)), float(np.median(sums)) / _MEDIAN_OF_ONE
    scatter = _SCATTER_OF_ONE / float(np.sqrt(3 * count))
    is_noise = variance < min(median * (1.0 + _SIGMAS[0] * scatter), _LARGEST_SLOW)
    if not (is_noise and min(variance, median) > 1.0 + sigmas * scatter):
        return 1.0, 0.0
    return variance, 3 * count * (variance - 1.0 - float(np.log(variance)))


def pass_with_actual_noise(
    data: StageData,
    context: SolveContext,
    prior: Posterior,
    estimated: BoolArray,
    result: NavigationResult,
    slow_variance: float,
) -> NavigationResult:
    """Return a pass about a solution with the actual noise if the table is quieter than `context` specifies.

    This pass is used to test the model. The estimate uses the profile's noise, which also covers disturbances that
    occur only in some moves. The innovations give the variance of the mean velocity over an interval.

    Parameters
    ----------
    data, context, prior : samples of the stage, noise of the profiles, estimate before the stage
    estimated : mask of the estimated parameters, shape (30,)
    result : solution
    slow_variance : see `RestNoise.slow_variance`, (m/s)²; a lower bound of the variance
    """
    ratio = max(_ratio(result.history, data.dt), slow_variance / context.table.velocity_sigma**2)
    if ratio > 1.0 / MAX_VARIANCE_RATIO:
        return result
    quieter = pass_about(result, data, _with_variance(context, max(ratio, _MIN_RATIO)), prior, estimated)
    return quieter if np.isfinite(quieter.history.nis).all() else result


def _with_variance(context: SolveContext, ratio: float) -> SolveContext:
    """Return the context with the table's velocity variance multiplied by `ratio`."""
    sigma = context.table.velocity_sigma * float(np.sqrt(ratio))
    return replace(context, table=replace(context.table, velocity_sigma=sigma))


def _with_force(context: SolveContext, ratio: float) -> SolveContext:
    """Return the context with the noise density of the accelerometers multiplied by `ratio`."""
    if ratio == 1.0:
        return context
    density = float(np.sqrt(ratio * filter_noise(context).force))
    return replace(context, imu=replace(context.imu, accel_vrw=density))


def _ratio(history: History, dt: float) -> float:
    """Return the larger ratio, of rests and of motions, of the median squared innovation to its expected median."""
    trace = np.einsum("nij,nij->n", history.attitude[1:], history.attitude[:-1])
    angle: FloatArray = np.arccos(np.clip(0.5 * (trace - 1.0), -1.0, 1.0))
    still = angle < REST_RATE * dt * np.maximum(np.diff(history.index), 1)
    nis = history.nis[1:]
    parts = [part for part in (nis[still], nis[~still]) if len(part) >= _MIN_COUNT]
    return max((float(np.median(part)) / _MEDIAN for part in parts), default=1.0)
