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
from functools import reduce
from typing import NamedTuple

import numpy as np

from calstation.estimation.common import SolveContext, StageData, Start
from calstation.estimation.effects import mean_errors
from calstation.estimation.navigation.navigation_pass import ClosedLoopFilter
from calstation.estimation.navigation.response import motion_between_observations
from calstation.estimation.navigation.velocity_group import BIAS, OBSERVED
from calstation.physics import COUNT, PARAMETER_START, PARAMETERS, STATES, Effect, FloatArray, IntArray

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
    steps = run.steps(data, start, start.attitude, together=1)
    next(steps)
    begin = _start_information(run)
    groups = [_group(run) for _ in steps]
    moved = motion_between_observations(run.history, data, (start,), context, run.posterior.mean)
    errors = mean_errors(moved, effects, np.array([group.rows // 3 for group in groups]))
    parts = (_information(group, error) for group, error in zip(groups, errors, strict=True))
    m = len(begin) - COUNT
    padded = np.zeros((len(begin) + errors.shape[2],) * 2)
    padded[: len(begin), : len(begin)] = begin
    return Segment(padded, reduce(lambda total, part: joined(total, part, m), parts), m)


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
    """Return the information about the boundary states and the parameters at the start."""
    both = np.r_[_boundary(run), _PARAMETERS]
    covariance = run.state.P[np.ix_(both, both)]
    known = np.diag(covariance) == 0.0  # parameters with fixed values
    prior = np.array([*np.zeros(len(both) - COUNT), *(p.prior_sigma**2 for p in PARAMETERS)])
    covariance[known, known] = _KNOWN * prior[known]
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
    """Return the information of a group; `error` are the channel errors due to effects, shape (6, effects)."""
    scale = 1.0 / np.sqrt(np.diag(group.noise))
    root = np.linalg.cholesky(group.noise * np.outer(scale, scale))
    white = np.linalg.solve(root, np.hstack([group.jacobian, group.bias @ error]) * scale[:, None])
    return np.asarray(white.T @ white)


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
    parameters = np.sqrt(variances) * scale[:, -COUNT:]
    if information.shape[-1] == known:
        return np.asarray(parameters)
    cross = information[:, :known, known:] * scale[:, :, None]
    alone = np.diagonal(information[:, known:, known:], axis1=1, axis2=2)
    remaining = alone - np.einsum("nik,nij,njk->nk", cross, covariance, cross, optimize=True)
    return np.hstack([parameters, 1.0 / np.sqrt(np.maximum(remaining, 1e-12 * alone + 1e-300))])
