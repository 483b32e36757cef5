"""Information that a motion gives about the parameters, from the filter's own linearisation.

A segment begins and ends at rest. Its observations depend on the boundary states (φ, δv and the drift of the biases) at
both ends and on the 30 parameters; all states between are eliminated. Segments that follow each other are joined by
eliminating the boundary states between them, so that a schedule is evaluated without another pass over its samples.
The covariance equals that of the filter.
"""

import numpy as np

from calstation.estimation.navigation.filter import NavigationFilter
from calstation.physics import COUNT, PARAMETER_START, STATES, FloatArray, IntArray

#: Number of navigation states at a boundary: φ and δv; nothing depends on δp.
_OBSERVED = 6
_PARAMETERS = np.arange(PARAMETER_START, STATES)


class InformationGatherer:
    """Collects the information of a pass of `NavigationFilter`, which calls it at the start and after every group.

    Information about m boundary states and the parameters has shape (m + 30, m + 30); that of a segment, about m states
    at its begin, m at its end and the parameters, (2 m + 30, 2 m + 30). Both are in SI.
    """

    def __init__(self) -> None:
        self.start: FloatArray | None = None  #: Information at the start.
        self.segment: FloatArray | None = None  #: Information of all groups together.

    def __call__(self, run: NavigationFilter) -> None:
        """Add what the filter has just processed."""
        kf, states = run.kf, _boundary(run)
        if self.start is None:
            both = np.r_[states, _PARAMETERS]
            self.start = np.linalg.inv(kf.P[np.ix_(both, both)])
            return
        m, rows = len(states), len(kf.H)
        jacobian = np.zeros((m + rows, 2 * m + COUNT))
        jacobian[:m, :m] = -kf.F[np.ix_(states, states)]
        jacobian[:m, m : 2 * m] = np.eye(m)
        jacobian[:m, 2 * m :] = -kf.F[np.ix_(states, _PARAMETERS)]
        jacobian[m:, m : 2 * m] = -kf.H[:, states]
        jacobian[m:, 2 * m :] = -kf.H[:, _PARAMETERS]
        noise = np.block([[kf.Q[np.ix_(states, states)], kf.M[states]], [kf.M[states].T, kf.R]])
        scale = 1.0 / np.sqrt(np.diag(noise))
        white = np.linalg.solve(np.linalg.cholesky(noise * np.outer(scale, scale)), jacobian * scale[:, None])
        group = white.T @ white
        self.segment = group if self.segment is None else joined(self.segment, group)


def _boundary(run: NavigationFilter) -> IntArray:
    """Return the indices of the boundary states in the filter's state."""
    return np.r_[0:_OBSERVED, STATES : len(run.kf.x)]


def joined(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the information of two segments, the second following the first."""
    m = (len(first) - COUNT) // 2
    begin, middle, end, parameters = np.split(np.arange(3 * m + COUNT), [m, 2 * m, 3 * m])
    total = np.zeros((3 * m + COUNT,) * 2)
    for segment, at in ((first, (begin, middle, parameters)), (second, (middle, end, parameters))):
        total[np.ix_(np.concatenate(at), np.concatenate(at))] += segment
    kept = np.concatenate([begin, end, parameters])
    cross = total[np.ix_(kept, middle)]
    return np.asarray(
        total[np.ix_(kept, kept)] - cross @ np.linalg.solve(total[np.ix_(middle, middle)], cross.T)
    )


def advanced(before: FloatArray, segments: FloatArray) -> FloatArray:
    """Return the information at the ends of segments, shape (n, m + 30, m + 30), from that at their begins.

    `before` has the same shape, and `segments` (n, 2 m + 30, 2 m + 30).
    """
    m = (segments.shape[-1] - COUNT) // 2
    total = segments.copy()
    at = np.r_[0:m, 2 * m : 2 * m + COUNT]
    total[:, at[:, None], at] += before
    cross = total[:, m:, :m]
    return np.asarray(total[:, m:, m:] - cross @ np.linalg.solve(total[:, :m, :m], cross.transpose(0, 2, 1)))


def parameter_sigmas(information: FloatArray) -> FloatArray:
    """Return the sigmas of the parameters, SI, shape (n, 30), from information of shape (n, m + 30, m + 30)."""
    scale = 1.0 / np.sqrt(np.diagonal(information, axis1=1, axis2=2))
    covariance = np.linalg.inv(information * scale[:, :, None] * scale[:, None, :])
    variances = np.diagonal(covariance, axis1=1, axis2=2)
    return np.asarray(np.sqrt(variances[:, -COUNT:]) * scale[:, -COUNT:])
