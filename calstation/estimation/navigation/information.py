"""Information matrices of motions for parameters and effects, from the linearisation of the filter.

A segment begins and ends at rest. Its observations depend on the boundary states (φ, δv and the bias drift) at both
ends, on the 30 parameters, and on the sizes of effects outside the model; all states in between are eliminated.
Successive segments are joined by eliminating the boundary states between them, so a schedule is evaluated without
another pass over its samples. The resulting covariance equals that of the filter.

The size of a drift is the rate of change d of a parameter, and p is the parameter at the end of the motion. If the
motion continues for Δ, the parameter at the previous end is p − Δ d, so −Δ times the column of p is added to the column
of d.

With m boundary states and c columns of parameters and effects, the information at the end of a motion has shape (m + c,
m + c). The information of a segment, about m states at its start and m at its end, has shape (2 m + c, 2 m + c). All
values are in SI.
"""

from collections.abc import Sequence
from functools import reduce
from typing import NamedTuple

import numpy as np

from calstation.estimation.common import SolveContext, StageData, Start
from calstation.estimation.effects import mean_errors
from calstation.estimation.navigation.navigation_pass import ClosedLoopFilter
from calstation.estimation.navigation.response import motion_between_observations
from calstation.estimation.navigation.velocity_group import BIAS, OBSERVED
from calstation.physics import COUNT, INDEX, PARAMETER_START, PARAMETERS, STATES, Effect, FloatArray, IntArray

#: Variance of a parameter with a fixed value, in units of its default prior variance.
_FIXED_VARIANCE = 1e-12
_PARAMETERS = np.arange(PARAMETER_START, STATES)


class Segment(NamedTuple):
    """Information matrices of the start of a motion, with zeros for effects, and of the motion itself."""

    start: FloatArray
    motion: FloatArray
    states: int  #: m.


def segment_information(
    run: ClosedLoopFilter, data: StageData, start: Start, context: SolveContext, effects: Sequence[Effect]
) -> Segment:
    """Run a new filter over the samples from `start`; return the information matrices of the segment."""
    steps = run.steps(data, start, start.attitude, batch=1)
    next(steps)
    start_information = _start_information(run)
    groups = [_group(run) for _ in steps]
    motion = motion_between_observations(run.history, data, (start,), context, run.posterior.mean)
    errors = mean_errors(motion, effects, np.array([group.rows // 3 for group in groups]))
    parts = (_information(group, error) for group, error in zip(groups, errors, strict=True))
    m = len(start_information) - COUNT
    padded = np.zeros((len(start_information) + errors.shape[2],) * 2)
    padded[: len(start_information), : len(start_information)] = start_information
    return Segment(padded, reduce(lambda total, part: join_segments(total, part, m), parts), m)


class _Group(NamedTuple):
    """Equations of a group of observations."""

    jacobian: FloatArray  #: Jacobian of the equations of motion and of the observations, shape (m + rows, 2 m + 30).
    bias: FloatArray  #: Jacobian with respect to the biases alone, shape (m + rows, 6).
    noise: FloatArray  #: Covariance of the equations of motion and the observations.
    rows: int  #: Number of observations.


def _boundary(run: ClosedLoopFilter) -> IntArray:
    """Return the indices of the boundary states in the filter's state."""
    return np.asarray(np.r_[0:OBSERVED, STATES : len(run.state.x)])


def _start_information(run: ClosedLoopFilter) -> FloatArray:
    """Return the information matrix of the boundary states and the parameters at the start."""
    states = np.r_[_boundary(run), _PARAMETERS]
    covariance = run.state.P[np.ix_(states, states)]
    fixed = np.diag(covariance) == 0.0
    prior = np.array([*np.zeros(len(states) - COUNT), *(p.prior_sigma**2 for p in PARAMETERS)])
    covariance[fixed, fixed] = _FIXED_VARIANCE * prior[fixed]
    return np.asarray(np.linalg.inv(covariance))


def _group(run: ClosedLoopFilter) -> _Group:
    """Return the equations of the last group of observations."""
    states, group = _boundary(run), run.group
    m, rows = len(states), len(group.H)
    jacobian = np.zeros((m + rows, 2 * m + COUNT))
    jacobian[:m, :m] = -group.transition[np.ix_(states, states)]
    jacobian[:m, m : 2 * m] = np.eye(m)
    jacobian[:m, 2 * m :] = -group.transition[np.ix_(states, _PARAMETERS)]
    jacobian[m:, m : 2 * m] = -group.H[:, states]
    jacobian[m:, 2 * m :] = -group.H[:, _PARAMETERS]
    noise = np.block([[group.noise[np.ix_(states, states)], group.M[states]], [group.M[states].T, group.R]])
    bias = -np.vstack([group.transition[np.ix_(states, BIAS)], group.H[:, BIAS]])
    return _Group(jacobian, bias, noise, rows)


def _information(group: _Group, error: FloatArray) -> FloatArray:
    """Return the information matrix of a group; `error` contains the channel errors of effects, shape (6, effects)."""
    scale = 1.0 / np.sqrt(np.diag(group.noise))
    root = np.linalg.cholesky(group.noise * np.outer(scale, scale))
    white = np.linalg.solve(root, np.hstack([group.jacobian, group.bias @ error]) * scale[:, None])
    return np.asarray(white.T @ white)


class Drifts(NamedTuple):
    """Columns of effects that are drifts, and of the parameters that they change, counted from the last column."""

    columns: IntArray  #: Shape (d,), negative.
    parameters: IntArray  #: Shape (d,), negative.

    @classmethod
    def among(cls, effects: Sequence[Effect]) -> "Drifts":
        """Return the drifts among the effects of a segment."""
        changed = [INDEX.get(effect.parameter_of(k), -1) for effect in effects for k in range(len(effect.components))]
        at = np.flatnonzero(np.array(changed, dtype=np.int64) >= 0)
        return cls(at - len(changed), np.array(changed, dtype=np.int64)[at] - len(changed) - COUNT)

    def continued(self, information: FloatArray, seconds: FloatArray) -> FloatArray:
        """Return the information of n motions, shape (n, a, a), after each has continued for `seconds`, shape (n,)."""
        if not len(self.columns):
            return information
        continued = information.copy()
        continued[:, self.columns] -= seconds[:, None, None] * continued[:, self.parameters]
        continued[:, :, self.columns] -= seconds[:, None, None] * continued[:, :, self.parameters]
        return continued


NO_DRIFTS = Drifts.among(())


def join_segments(
    first: FloatArray, second: FloatArray, states: int, seconds: float = 0.0, drifts: Drifts = NO_DRIFTS
) -> FloatArray:
    """Return the information matrix of two successive segments.

    Parameters
    ----------
    first, second : information matrices of the segments
    states : number of boundary states, m
    seconds : duration of the second segment, s
    drifts : drifts among the effects
    """
    first = drifts.continued(first[None], np.array([seconds]))[0]
    m, columns = states, len(first) - 2 * states
    begin, middle, end, common = np.split(np.arange(3 * m + columns), [m, 2 * m, 3 * m])
    total = np.zeros((3 * m + columns,) * 2)
    for segment, at in ((first, (begin, middle, common)), (second, (middle, end, common))):
        total[np.ix_(np.concatenate(at), np.concatenate(at))] += segment
    remaining = np.concatenate([begin, end, common])
    cross = total[np.ix_(remaining, middle)]
    return np.asarray(
        total[np.ix_(remaining, remaining)] - cross @ np.linalg.solve(total[np.ix_(middle, middle)], cross.T)
    )


def advance_information(
    before: FloatArray, segments: FloatArray, seconds: FloatArray | float = 0.0, drifts: Drifts = NO_DRIFTS
) -> FloatArray:
    """Return the information matrices at the ends of n segments.

    Parameters
    ----------
    before : information at the starts of the segments, shape (n, m + c, m + c)
    segments : information matrices of the segments, shape (n, 2 m + c, 2 m + c)
    seconds : durations of the segments, s, shape (n,)
    drifts : drifts among the effects
    """
    before = drifts.continued(before, np.broadcast_to(seconds, len(before)))
    m = segments.shape[-1] - before.shape[-1]
    total = segments.copy()
    at = np.r_[0:m, 2 * m : segments.shape[-1]]
    total[:, at[:, None], at] += before
    cross = total[:, m:, :m]
    return np.asarray(total[:, m:, m:] - cross @ np.linalg.solve(total[:, :m, :m], cross.transpose(0, 2, 1)))


class Precision(NamedTuple):
    """Sigmas and errors that follow from the information of n motions."""

    sigma: FloatArray  #: Sigma of each parameter, estimated without the effects, shape (n, 30).
    #: Sigma of each effect's size, estimated with all parameters but without other effects, shape (n, k).
    size_sigma: FloatArray
    error: FloatArray  #: Error of each parameter per unit of size of an effect outside the model, shape (n, 30, k).


def precision(information: FloatArray, states: int) -> Precision:
    """Return the precision for n information matrices with m = `states` boundary states, shape (n, m + c, m + c)."""
    size = states + COUNT
    scale = 1.0 / np.sqrt(np.diagonal(information[:, :size, :size], axis1=1, axis2=2))
    covariance = np.linalg.inv(information[:, :size, :size] * scale[:, :, None] * scale[:, None, :])
    variances = np.diagonal(covariance, axis1=1, axis2=2)[:, -COUNT:]
    cross = information[:, :size, size:] * scale[:, :, None]
    alone = np.diagonal(information[:, size:, size:], axis1=1, axis2=2)
    error = covariance @ cross
    remaining = alone - np.einsum("nik,nik->nk", cross, error)
    return Precision(
        np.sqrt(variances) * scale[:, -COUNT:],
        1.0 / np.sqrt(np.maximum(remaining, 1e-12 * alone + 1e-300)),
        error[:, -COUNT:] * scale[:, -COUNT:, None],
    )
