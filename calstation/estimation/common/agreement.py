"""Agreement of a stage with those before it: the change of the joint posterior against its covariance.

The change of an optimal estimate by new data has the covariance P_before − P_after and is independent of P_after, as
long as the model is right (J. A. Hausman, *Specification tests in econometrics*, Econometrica 46(6), 1978).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import gammaincc

from calstation.estimation.common.context import Belief
from calstation.physics import NAMES, PARAMETERS

#: A direction in which the variance decreases by a smaller fraction than this is not resolved.
_RESOLVED = 1e-4


@dataclass(frozen=True)
class Agreement:
    """The parameter group about which a stage agrees least with those before it."""

    group: str
    probability: float  #: Probability of a change at least as large as this one.
    moves: dict[str, float]  #: Change of each parameter of the group, in standard deviations of that change.


def stage_agreement(before: Belief, after: Belief, names: Sequence[str]) -> Agreement | None:
    """Return the least probable change of a parameter group; None if no group has been determined better.

    `names` are the parameters that the stage and an earlier one have estimated.
    """
    found = []
    for group in dict.fromkeys(PARAMETERS[NAMES.index(name)].group for name in names):
        i = [k for k, p in enumerate(PARAMETERS) if p.group == group and p.name in names]
        scale = before.sigma[i]
        change = (after.mean[i] - before.mean[i]) / scale
        variance = (before.covariance - after.covariance)[np.ix_(i, i)] / np.outer(scale, scale)
        size, direction = np.linalg.eigh(0.5 * (variance + variance.T))
        resolved = size > _RESOLVED
        if not resolved.any():
            continue
        total = float(np.sum((direction[:, resolved].T @ change) ** 2 / size[resolved]))
        probability = float(gammaincc(0.5 * resolved.sum(), 0.5 * total))
        own = np.maximum(np.diag(variance), _RESOLVED)
        moves = {NAMES[k]: float(m) for k, m in zip(i, change / np.sqrt(own), strict=True)}
        found.append(Agreement(group, probability, moves))
    return min(found, key=lambda a: a.probability, default=None)
