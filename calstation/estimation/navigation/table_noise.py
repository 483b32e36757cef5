"""Solution of a stage with the table vibration found from its innovations, if it exceeds the table's profile."""

from dataclasses import replace

import numpy as np

from calstation.estimation.common import Posterior, SolveContext, StageData
from calstation.estimation.method import Progress
from calstation.estimation.navigation.navigation_pass import History
from calstation.estimation.navigation.relinearise import NavigationResult, pass_about, solve_navigation
from calstation.physics import BoolArray, FloatArray

#: Ratio of the median normalised innovation squared to its expected median up to which the profile's noise is used.
_AGREES = 1.25
#: Median of the χ² distribution with 3 degrees of freedom.
_MEDIAN = 2.366
MAX_ADJUSTMENTS = 4
#: Smallest fraction of the profile's variance that is used: other noise remains, and rounding errors grow.
_MIN_RATIO = 0.01
#: A rotation between two observations slower than this, rad/s, is rest.
_AT_REST = np.deg2rad(0.1)
#: Smallest number of observations at rest, or in motion, for which the median is used.
_MIN_COUNT = 50


def solve_with_table_noise(
    stage: str,
    data: StageData,
    context: SolveContext,
    prior: Posterior,
    estimated: BoolArray,
    progress: Progress | None = None,
) -> tuple[NavigationResult, SolveContext]:
    """Solve a stage, and again with the velocity noise found from its innovations if that exceeds the profile's.

    Returns the result and the context with that noise. On a quieter table the profile's noise is kept, see `judged`.
    The median is insensitive to an effect in a part of the stage; the larger of the medians of rests and motions is
    used. Raises InsufficientDataError if no segment contains a rest.
    """
    result = solve_navigation(stage, data, context, prior, estimated, progress)
    for _ in range(MAX_ADJUSTMENTS):
        ratio = _ratio(result.history, data.dt)
        if ratio < _AGREES:
            break
        context = _with_variance(context, ratio)
        result = solve_navigation(stage, data, context, prior, estimated, near=result)
    return result, context


def judged(
    data: StageData, context: SolveContext, prior: Posterior, estimated: BoolArray, result: NavigationResult
) -> NavigationResult:
    """Return a pass about a solution with the actual noise, if the table is quieter than `context` specifies.

    It serves to test the model. The estimate keeps the profile's noise, which also covers disturbances that occur only
    in some moves.
    """
    ratio = _ratio(result.history, data.dt)
    if ratio > 1.0 / _AGREES:
        return result
    quieter = pass_about(data, _with_variance(context, max(ratio, _MIN_RATIO)), prior, estimated, result)
    return quieter if np.isfinite(quieter.history.nis).all() else result


def _with_variance(context: SolveContext, ratio: float) -> SolveContext:
    """Return the context with the table's velocity variance multiplied by `ratio`."""
    sigma = context.table.velocity_sigma * float(np.sqrt(ratio))
    return replace(context, table=replace(context.table, velocity_sigma=sigma))


def _ratio(history: History, dt: float) -> float:
    """Return the ratio of the innovations' variance to the predicted one."""
    turned = np.einsum("nij,nij->n", history.attitude[1:], history.attitude[:-1])
    angle: FloatArray = np.arccos(np.clip(0.5 * (turned - 1.0), -1.0, 1.0))
    still = angle < _AT_REST * dt * np.maximum(np.diff(history.index), 1)
    nis = history.nis[1:]
    parts = [part for part in (nis[still], nis[~still]) if len(part) >= _MIN_COUNT]
    return max((float(np.median(part)) / _MEDIAN for part in parts), default=1.0)
