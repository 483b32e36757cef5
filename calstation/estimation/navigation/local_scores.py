"""Score tests of errors that are present only during a part of a stage, from the updates of the last pass.

An error of a channel during a span acts like an additional bias there. Its effect on the innovations follows from the
transitions and gains of the filter (P. de Jong, J. Penzer, *Diagnosing shocks in time series*, JASA 93(442), 1998).
"""

from collections.abc import Sequence

import numpy as np

from calstation.estimation.common import LocalScores, StageData
from calstation.estimation.navigation.filter import Update
from calstation.estimation.navigation.velocity_group import BIAS
from calstation.physics import PARAMETER_START, STATES, FloatArray, IntArray

#: Number of groups of observations that are added together.
_TOGETHER = 100


def local_scores(
    data: StageData, spans: Sequence[tuple[int, int]], *, updates: Sequence[Update], index: IntArray
) -> LocalScores:
    """Return the score tests for spans (start, stop) of a stage's samples, in their order.

    `updates` are those of the last pass, and `index` the number of samples before each of its observations.
    """
    stops = np.array([stop for _, stop in spans])
    size, width = updates[0].H.shape[1], 6 * len(spans)
    effect = np.zeros((size, width))  # error of the states due to the errors of the channels
    score, information = np.zeros(width), np.zeros((width, width))
    own_score, own_information = np.zeros((len(spans), 6)), np.zeros((len(spans), 6, 6))
    together: list[FloatArray] = []  # effect on the innovations of the last groups, and these innovations
    observed = 0
    for update in updates:
        count = len(update.innovation) // 3
        if not count:
            effect[:PARAMETER_START] = 0.0
            effect -= update.gain.T @ np.linalg.solve(update.root, update.H @ effect)
            continue
        span = min(int(np.searchsorted(stops, index[observed + count // 2])), len(spans) - 1)
        observed += count
        begun, now = 6 * (span + 1), slice(6 * span, 6 * span + 6)
        moved = update.transition @ effect[:, :begun]
        moved[:, now] += update.transition[:, BIAS]
        effect[:PARAMETER_START, :begun] = moved
        effect[STATES:] *= update.decay[:, None]
        white = np.zeros((len(update.H), width + 1))
        white[:, :begun] = update.H @ effect[:, :begun]
        white[:, now] += update.H[:, BIAS]
        white = np.linalg.inv(update.root) @ white
        white[:, -1] = update.innovation
        effect[:, :begun] -= update.gain.T @ white[:, :begun]
        own_score[span] += white[:, now].T @ white[:, -1]
        own_information[span] += white[:, now].T @ white[:, now]
        together.append(white)
        if len(together) == _TOGETHER or observed == len(index):
            rows = np.concatenate(together)
            score += rows[:, :-1].T @ rows[:, -1]
            information += rows[:, :-1].T @ rows[:, :-1]
            together.clear()
    return LocalScores(score, information, -effect[PARAMETER_START:STATES], own_score, own_information)
