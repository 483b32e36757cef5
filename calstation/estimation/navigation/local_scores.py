"""Score tests of errors that exist only during a part of a stage, from the updates of the last pass.

A channel error during a span acts like an additional bias. Its effect on the innovations follows from the
transitions and gains of the filter (P. de Jong, J. Penzer, *Diagnosing shocks in time series*, JASA 93(442), 1998).
"""

from collections.abc import Sequence

import numpy as np

from calstation.estimation.common import LocalScores, StageData
from calstation.estimation.navigation.group_update import Updates
from calstation.estimation.navigation.velocity_group import BIAS
from calstation.physics import NAVIGATION, PARAMETER_STATES, STATES, FloatArray, IntArray

#: Number of groups of observations that are added together.
_TOGETHER = 100


def local_scores(
    data: StageData, spans: Sequence[tuple[int, int]], *, updates: Sequence[Updates], index: IntArray
) -> LocalScores:
    """Return the score tests for spans (start, stop) of a stage's samples, in the order given.

    `updates` are the updates of the last pass, and `index` is the number of samples before each of its observations.
    """
    stops = np.array([stop for _, stop in spans])
    size, width = updates[0].H.shape[2], 6 * len(spans)
    effect = np.zeros((size, width))  # error of the states due to the channel errors
    score, information = np.zeros(width), np.zeros((width, width))
    own_score, own_information = np.zeros((len(spans), 6)), np.zeros((len(spans), 6, 6))
    together: list[FloatArray] = []  # effect on the innovations of the last groups, and these innovations
    observed = 0
    for update in updates:
        if not update.transition.size:
            effect[NAVIGATION] = 0.0
            effect -= update.gain[0].T @ np.linalg.solve(update.root[0], update.H[0] @ effect)
            continue
        rows_of_groups = zip(update.transition, update.H, update.root, update.gain, update.innovation, strict=True)
        for transition, H, root, gain, innovation in rows_of_groups:
            count = len(innovation) // 3
            span = min(int(np.searchsorted(stops, index[observed + count // 2])), len(spans) - 1)
            observed += count
            begun, now = 6 * (span + 1), slice(6 * span, 6 * span + 6)
            moved = transition @ effect[:, :begun]
            moved[:, now] += transition[:, BIAS]
            effect[NAVIGATION, :begun] = moved
            effect[STATES:] *= update.decay[:, None]
            white = np.zeros((len(H), width + 1))
            white[:, :begun] = H @ effect[:, :begun]
            white[:, now] += H[:, BIAS]
            white = np.linalg.inv(root) @ white
            white[:, -1] = innovation
            effect[:, :begun] -= gain.T @ white[:, :begun]
            own_score[span] += white[:, now].T @ white[:, -1]
            own_information[span] += white[:, now].T @ white[:, now]
            together.append(white)
            if len(together) == _TOGETHER or observed == len(index):
                rows = np.concatenate(together)
                score += rows[:, :-1].T @ rows[:, -1]
                information += rows[:, :-1].T @ rows[:, :-1]
                together.clear()
    return LocalScores(score, information, -effect[PARAMETER_STATES], own_score, own_information)
