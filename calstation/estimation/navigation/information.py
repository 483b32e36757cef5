"""Information that the motion of a segment gives about the parameters, from the filter's own linearisation.

A segment begins and ends at rest. Its observations depend on the boundary states (φ, δv, and the drift of the biases)
at both ends and on the 30 parameters; what lies between is eliminated. Segments that follow each other are joined by
eliminating the states at their common end, so that a schedule is evaluated without passing over its samples again.
The result equals the covariance of the filter.
"""

from dataclasses import dataclass

import numpy as np

from calstation.estimation.navigation.filter import NavigationFilter
from calstation.physics import COUNT, PARAMETER_START, STATES, FloatArray

#: Number of navigation states at a boundary: φ and δv; nothing depends on δp.
_OBSERVED = 6


@dataclass(frozen=True)
class Segment:
    """Information about the states at the begin of a segment (m), at its end (m) and the parameters (30)."""

    matrix: FloatArray  #: SI, shape (2 m + 30, 2 m + 30).
    duration: float  #: s


class Gatherer:
    """Collects the information of the groups of a pass; an object is given to `NavigationFilter.run` as `watch`."""

    def __init__(self) -> None:
        self.start: FloatArray | None = None  #: Information about the states at the start and the parameters.
        self.matrix: FloatArray | None = None  #: That of all groups together, as in `Segment`.

    def __call__(self, run: NavigationFilter) -> None:
        """Add the group that `run` has processed last; the first call is that at the start."""
        kept, size = boundary(run), len(run.kf.x)
        m = len(kept)
        parameters = np.arange(PARAMETER_START, STATES)
        if self.start is None:
            both = np.r_[kept, parameters]
            self.start = np.linalg.inv(run.kf.P[np.ix_(both, both)])
            return
        kf = run.kf
        rows = len(kf.H)
        jacobian = np.zeros((m + rows, 2 * m + COUNT))
        jacobian[:m, :m] = -kf.F[np.ix_(kept, kept)]
        jacobian[:m, m : 2 * m] = np.eye(m)
        jacobian[:m, 2 * m :] = -kf.F[np.ix_(kept, parameters)]
        jacobian[m:, m : 2 * m] = -kf.H[:, kept]
        jacobian[m:, 2 * m :] = -kf.H[:, parameters]
        noise = np.block([[kf.Q[np.ix_(kept, kept)], kf.M[kept]], [kf.M[kept].T, kf.R]])
        assert size >= STATES
        scale = 1.0 / np.sqrt(np.diag(noise))
        whitened = np.linalg.solve(np.linalg.cholesky(noise * np.outer(scale, scale)), jacobian * scale[:, None])
        group = whitened.T @ whitened
        self.matrix = group if self.matrix is None else joined(self.matrix, group)


def boundary(run: NavigationFilter) -> FloatArray:
    """Return the indices of the states at a boundary."""
    return np.r_[0:_OBSERVED, STATES : len(run.kf.x)]


def joined(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the information of two segments that follow each other, as in `Segment`; both may be stacks."""
    m = (first.shape[-1] - COUNT) // 2
    a, b, c, p = slice(0, m), slice(m, 2 * m), slice(2 * m, 3 * m), slice(3 * m, 3 * m + COUNT)
    total = np.zeros((3 * m + COUNT,) * 2)
    one, two = np.r_[a, b, p], np.r_[b, c, p]
    total[np.ix_(one, one)] += first
    total[np.ix_(two, two)] += second
    left = np.r_[a, c, p]
    cross = total[np.ix_(left, np.r_[b])]
    return total[np.ix_(left, left)] - cross @ np.linalg.solve(total[b, b], cross.T)


def advanced(state: FloatArray, segment: FloatArray) -> FloatArray:
    """Return the information about states and parameters at the end of a segment from that at its begin (m + 30)."""
    m = (segment.shape[-1] - COUNT) // 2
    k = m + COUNT
    total = np.zeros((m + k, m + k))
    total += segment
    at = np.r_[0:m, 2 * m : 2 * m + COUNT]
    total[np.ix_(at, at)] += state
    cross = total[m:, :m]
    return total[m:, m:] - cross @ np.linalg.solve(total[:m, :m], cross.T)


def sigmas(state: FloatArray) -> FloatArray:
    """Return the standard deviations of the parameters, SI, shape (30,)."""
    scale = 1.0 / np.sqrt(np.diag(state))
    inverse = np.linalg.inv(state * np.outer(scale, scale))
    return np.sqrt(np.diag(inverse)[-COUNT:]) * scale[-COUNT:]
