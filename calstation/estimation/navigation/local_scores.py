"""Score tests of errors that are present only during a part of a stage, from one more pass with the same gains.

An error of a channel during a span acts like an additional bias there. Its effect on the innovations follows from the
transitions and gains of the filter (P. de Jong, J. Penzer, *Diagnosing shocks in time series*, JASA 93(442), 1998).
"""

from collections.abc import Sequence

import numpy as np
from scipy.linalg import solve_triangular

from calstation.estimation.common import Belief, LocalScores, SolveContext, StageData
from calstation.estimation.navigation.filter import NavigationFilter
from calstation.estimation.navigation.relinearise import Linearisation
from calstation.estimation.navigation.velocity_group import BIAS
from calstation.physics import PARAMETER_START, STATES


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

    def watch(_: NavigationFilter) -> None:
        """Propagate the errors through the last group of observations, or forget those of attitude and velocity."""
        ends = run.last_group
        if ends is None:
            effect[:PARAMETER_START] = 0.0
            return
        kf = run.kf
        span = min(int(np.searchsorted(stops, int(np.median(ends)))), len(spans) - 1)
        begun, now = 6 * (span + 1), slice(6 * span, 6 * span + 6)
        errors = kf.F @ effect[:, :begun]
        errors[:PARAMETER_START, now] += kf.F[:PARAMETER_START, BIAS]
        seen = kf.H @ errors
        seen[:, now] += kf.H[:, BIAS]
        root = np.linalg.cholesky(kf.S)
        white = solve_triangular(root, np.column_stack([seen, kf.y]), lower=True)
        score[:begun] += white[:, :-1].T @ white[:, -1]
        information[:begun, :begun] += white[:, :-1].T @ white[:, :-1]
        effect[:, :begun] = errors - kf.K @ seen

    for start, attitude in zip(linearised.starts, linearised.attitudes, strict=True):
        run.run(data, start, attitude, smooth=linearised.smooth, watch=watch)
    return LocalScores(score, information, -effect[PARAMETER_START:STATES])
