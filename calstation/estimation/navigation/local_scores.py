"""Score tests of errors that are present only during a part of a stage, from one more pass with the same gains.

An error of a channel during a span acts like an additional bias there. Its effect on the innovations follows from the
transitions and gains of the filter (P. de Jong, J. Penzer, *Diagnosing shocks in time series*, JASA 93(442), 1998).
"""

from collections.abc import Sequence

import numpy as np

from calstation.estimation.common import Belief, LocalScores, SolveContext, StageData
from calstation.estimation.navigation.filter import NavigationFilter
from calstation.estimation.navigation.relinearise import Linearisation
from calstation.estimation.navigation.velocity_group import BIAS
from calstation.physics import PARAMETER_START, STATES, FloatArray

#: Number of groups of observations that are added together.
_TOGETHER = 100


def local_scores(
    data: StageData,
    spans: Sequence[tuple[int, int]],
    *,
    context: SolveContext,
    prior: Belief,
    linearised: Linearisation,
) -> LocalScores:
    """Return the score tests for spans (start, stop) of a stage's samples, in their order."""
    run = NavigationFilter(context, prior, linearised.point)
    stops = np.array([stop for _, stop in spans])
    size, width = len(run.kf.x), 6 * len(spans)
    effect = np.zeros((size, width))  # error of the states due to the errors of the channels
    score, information = np.zeros(width), np.zeros((width, width))
    own_score, own_information = np.zeros((len(spans), 6)), np.zeros((len(spans), 6, 6))
    seen: list[FloatArray] = []  # effect on the innovations of the last groups, and these innovations

    def add() -> None:
        """Add the last groups to the sums."""
        if seen:
            rows = np.concatenate(seen)
            score[:] += rows[:, :-1].T @ rows[:, -1]
            information[:] += rows[:, :-1].T @ rows[:, :-1]
            seen.clear()

    def watch(_: NavigationFilter) -> None:
        """Propagate the errors through the last group of observations, or forget those of attitude and velocity."""
        ends = run.last_group
        if ends is None:
            effect[:PARAMETER_START] = 0.0
            return
        kf = run.kf
        span = min(int(np.searchsorted(stops, ends[len(ends) // 2])), len(spans) - 1)
        begun, now = 6 * (span + 1), slice(6 * span, 6 * span + 6)
        errors = kf.F @ effect[:, :begun]
        errors[:PARAMETER_START, now] += kf.F[:PARAMETER_START, BIAS]
        change = kf.H @ errors
        change[:, now] += kf.H[:, BIAS]
        effect[:, :begun] = errors - kf.K @ change
        white = np.zeros((len(change), width + 1))
        white[:, :begun] = change
        white[:, -1] = kf.y
        white = np.linalg.inv(np.linalg.cholesky(kf.S)) @ white
        own_score[span] += white[:, now].T @ white[:, -1]
        own_information[span] += white[:, now].T @ white[:, now]
        seen.append(white)
        if len(seen) == _TOGETHER:
            add()

    for start, attitude in zip(linearised.starts, linearised.attitudes, strict=True):
        run.run(data, start, attitude, smooth=linearised.smooth, watch=watch)
    add()
    return LocalScores(score, information, -effect[PARAMETER_START:STATES], own_score, own_information)
