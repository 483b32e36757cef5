"""Information that a motion gives about parameters and effects, from the filter's own linearisation.

A segment begins and ends at rest. Its observations depend on the boundary states (φ, δv and the drift of the biases) at
both ends, the 30 parameters, and the sizes of effects outside the model; all states between are eliminated. Segments
that follow each other are joined by eliminating the boundary states between them, so that a schedule is evaluated
without another pass over its samples. The covariance equals the filter's.

With m boundary states and c columns of parameters and effects, the information at the end of a motion has shape (m + c,
m + c). The information of a segment, about m states at its start and m at its end, has shape (2 m + c, 2 m + c). All
values are in SI.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from calstation.estimation.common import SolveContext, StageData, Start
from calstation.estimation.effects import mean_errors
from calstation.estimation.navigation.closed_loop import ClosedLoopFilter
from calstation.estimation.navigation.response import motion_between_observations
from calstation.estimation.navigation.velocity_group import BIAS
from calstation.physics import COUNT, DV, PARAMETER_START, PARAMETERS, STATES, Effect, FloatArray, IntArray

#: Number of navigation states at a boundary: φ and δv; no observation depends on δp.
_OBSERVED = DV.stop
#: Variance of a known parameter, in units of its usual prior variance.
_KNOWN = 1e-12
_PARAMETERS = np.arange(PARAMETER_START, STATES)


class Segment(NamedTuple):
    """Information at the start of a motion, and from the motion itself; the start gives none about effects."""

    start: FloatArray
    motion: FloatArray
    states: int  #: m.


def segment_information(
    run: ClosedLoopFilter, data: StageData, start: Start, context: SolveContext, effects: Sequence[Effect]
) -> Segment:
    """Pass a new filter over samples from `start`; return their information."""
    gatherer = _Gatherer()
    run.run(data, start, start.attitude, gatherer)
    counts = np.array([group.rows // 3 for group in gatherer.groups])
    moved = motion_between_observations(run.history, data, (start,), context, run.belief.mean)
    return gatherer.segment(mean_errors(moved, effects, counts))


class _Group(NamedTuple):
    """Data of `_Gatherer` for a group of observations."""

    jacobian: FloatArray  #: Jacobian of the equations of motion and of the observations, shape (m + rows, 2 m + 30).
    bias: FloatArray  #: Jacobian with respect to the biases alone, shape (m + rows, 6).
    noise: FloatArray  #: Covariance of the equations of motion and the observations.
    rows: int  #: Number of observations.


class _Gatherer:
    """Collects the equations of a pass of `ClosedLoopFilter`, which calls it at the start and after every group."""

    def __init__(self) -> None:
        self._start: FloatArray | None = None
        self.groups: list[_Group] = []

    def __call__(self, run: ClosedLoopFilter) -> None:
        states = _boundary(run)
        if self._start is None:
            both = np.r_[states, _PARAMETERS]
            covariance = run.state.P[np.ix_(both, both)]
            known = np.diag(covariance) == 0.0  # parameters with fixed values
            covariance[known, known] = (
                _KNOWN * np.array([0.0] * len(states) + [p.prior_sigma**2 for p in PARAMETERS])[known]
            )
            self._start = np.linalg.inv(covariance)
            return
        group = run.group
        m, rows = len(states), len(group.H)
        jacobian = np.zeros((m + rows, 2 * m + COUNT))
        jacobian[:m, :m] = -group.transition[np.ix_(states, states)]
        jacobian[:m, m : 2 * m] = np.eye(m)
        jacobian[:m, 2 * m :] = -group.transition[np.ix_(states, _PARAMETERS)]
        jacobian[m:, m : 2 * m] = -group.H[:, states]
        jacobian[m:, 2 * m :] = -group.H[:, _PARAMETERS]
        noise = np.block([[group.noise[np.ix_(states, states)], group.M[states]], [group.M[states].T, group.R]])
        bias = -np.vstack([group.transition[np.ix_(states, BIAS)], group.H[:, BIAS]])
        self.groups.append(_Group(jacobian, bias, noise, rows))

    def segment(self, errors: FloatArray) -> Segment:
        """Return the information; `errors` are the channel errors due to effects, shape (groups, 6, effects)."""
        assert self._start is not None
        m = len(self._start) - COUNT
        total: FloatArray | None = None
        for group, error in zip(self.groups, errors, strict=True):
            scale = 1.0 / np.sqrt(np.diag(group.noise))
            root = np.linalg.cholesky(group.noise * np.outer(scale, scale))
            jacobian = np.hstack([group.jacobian, group.bias @ error])
            white = np.linalg.solve(root, jacobian * scale[:, None])
            information = white.T @ white
            total = information if total is None else joined(total, information, m)
        assert total is not None
        start = np.zeros((m + COUNT + errors.shape[2],) * 2)
        start[: m + COUNT, : m + COUNT] = self._start
        return Segment(start, total, m)


def _boundary(run: ClosedLoopFilter) -> IntArray:
    """Return the indices of the boundary states in the filter's state."""
    return np.asarray(np.r_[0:_OBSERVED, STATES : len(run.state.x)])


def joined(first: FloatArray, second: FloatArray, states: int) -> FloatArray:
    """Return the information of two segments, the second following the first, with m boundary states."""
    m, columns = states, len(first) - 2 * states
    begin, middle, end, common = np.split(np.arange(3 * m + columns), [m, 2 * m, 3 * m])
    total = np.zeros((3 * m + columns,) * 2)
    for segment, at in ((first, (begin, middle, common)), (second, (middle, end, common))):
        total[np.ix_(np.concatenate(at), np.concatenate(at))] += segment
    kept = np.concatenate([begin, end, common])
    cross = total[np.ix_(kept, middle)]
    return np.asarray(total[np.ix_(kept, kept)] - cross @ np.linalg.solve(total[np.ix_(middle, middle)], cross.T))


def advanced(before: FloatArray, segments: FloatArray) -> FloatArray:
    """Return the information at the ends of n segments from the information at their starts, both of shape (n, ...)."""
    m = segments.shape[-1] - before.shape[-1]
    total = segments.copy()
    at = np.r_[0:m, 2 * m : segments.shape[-1]]
    total[:, at[:, None], at] += before
    cross = total[:, m:, :m]
    return np.asarray(total[:, m:, m:] - cross @ np.linalg.solve(total[:, :m, :m], cross.transpose(0, 2, 1)))


def sigmas(information: FloatArray, states: int) -> FloatArray:
    """Return the sigmas of the parameters and of each effect alone, shape (n, c), from information (n, m + c, m + c).

    The parameters are estimated without the effects, and each effect together with all parameters, but without other
    effects.
    """
    known = states + COUNT
    scale = 1.0 / np.sqrt(np.diagonal(information[:, :known, :known], axis1=1, axis2=2))
    covariance = np.linalg.inv(information[:, :known, :known] * scale[:, :, None] * scale[:, None, :])
    variances = np.diagonal(covariance, axis1=1, axis2=2)[:, -COUNT:]
    found = np.sqrt(variances) * scale[:, -COUNT:]
    if information.shape[-1] == known:
        return np.asarray(found)
    cross = information[:, :known, known:] * scale[:, :, None]
    own = np.diagonal(information[:, known:, known:], axis1=1, axis2=2)
    left = own - np.einsum("nik,nij,njk->nk", cross, covariance, cross, optimize=True)
    return np.hstack([found, 1.0 / np.sqrt(np.maximum(left, 1e-12 * own + 1e-300))])
