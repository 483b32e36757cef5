"""Joint solution of gravity at rests and rotation between them, weighted with the scatter of the recording.

The magnitude of gravity alone determines the accelerometer scale, the change of its direction alone the gyro scale.
D. Tedaldi, A. Pretto, E. Menegatti, *A robust and easy to implement method for IMU calibration without external
equipments*, ICRA 2014, fit the same two quantities sequentially and without covariance.
"""

from dataclasses import dataclass

import numpy as np

from calstation.estimation.common import Belief, Link, SolveContext, StageData, levelled
from calstation.estimation.effects import Sensitivity
from calstation.estimation.positions.response import inverse, position_sensitivity
from calstation.estimation.positions.rows import Position, PositionRows, Scatter, excess, integrate_rotation
from calstation.physics import (
    COUNT,
    RATE,
    BoolArray,
    FloatArray,
    compensate,
    compensation,
    group_indices,
    level_attitude,
    rotation_matrix,
)

MOST_ITERATIONS = 30
MOST_REWEIGHTINGS = 12
#: The iteration has converged when its step is below this, in sigmas.
CONVERGED = 1e-3
#: Largest change of an attitude in a Gauss-Newton step, rad.
LARGEST_STEP = 0.3


@dataclass(frozen=True)
class PositionFit:
    """The joint solution."""

    belief: Belief  #: Posterior of the 30 parameters, in which consider parameters are also updated.
    attitudes: FloatArray  #: C_bn of the rests, shape (n, 3, 3).
    chi2: float  #: Sum of the squared residuals in units of sigma.
    freedom: float  #: Degrees of freedom of the residuals.
    scatter: Scatter  #: Noise of the recording in excess of the profile's.
    force_residual: FloatArray  #: Force residuals of the rests, m/s², shape (n, 3).
    turn_residual: FloatArray  #: Rotation residuals of the motions, rad, shape (m, 3).
    converged: bool  #: Whether the last iteration made no significant change.
    sensitivity: Sensitivity | None  #: Response to effects outside the model; None without diagnostics.


@dataclass(frozen=True)
class _Converged:
    """Last Gauss-Newton iteration: whitened rows `H`, residuals `left` and the covariance of the columns."""

    point: FloatArray
    attitudes: FloatArray
    north: FloatArray
    belief: Belief
    H: FloatArray
    left: FloatArray
    covariance: FloatArray
    converged: bool

    def spare(self, H: FloatArray) -> float:
        """Return the degrees of freedom of the rows `H`: the trace of I − H P Hᵀ."""
        return len(H) - float(np.einsum("ij,jk,ik->", H, self.covariance, H))


def fit_positions(
    data: StageData,
    rests: list[Position],
    links: tuple[Link, ...],
    context: SolveContext,
    prior: Belief,
    estimated: BoolArray,
) -> PositionFit:
    """Compute the joint MAP estimate; repeat it with increased noise until the noise explains the residuals.

    Parameters that are not `estimated` are consider parameters.
    """
    scatter = Scatter()
    problem = first = PositionRows(data, rests, links, context, prior, scatter)
    point = _first_point(problem, estimated)
    north = np.zeros((len(problem.chains), 2))
    best = _iterate(problem, point, _first_attitudes(problem, point), north, estimated)
    for _ in range(MOST_REWEIGHTINGS):
        before, scatter = scatter, _scatter(problem, best)
        if scatter.near(before):
            break
        problem = PositionRows(data, rests, links, context, prior, scatter)
        best = _iterate(problem, best.point, best.attitudes, best.north, estimated)
    seen = slice(problem.observations)
    force, turn = _residuals(problem, best)
    return PositionFit(
        belief=best.belief,
        attitudes=best.attitudes,
        chi2=float(best.left[seen] @ best.left[seen]),
        freedom=best.spare(best.H[seen]),
        scatter=scatter,
        force_residual=force,
        turn_residual=turn,
        converged=best.converged,
        sensitivity=position_sensitivity(problem, first, best.point, best.attitudes, best.north, estimated)
        if context.diagnostics
        else None,
    )


def _first_point(problem: PositionRows, estimated: BoolArray) -> FloatArray:
    """Return the prior mean, with the gyro bias from the rests where it is more accurate."""
    prior, bias = problem.prior, group_indices("gyro_bias")
    point = prior.mean.copy()
    if not problem.data.has_gyros:
        return point
    measured = np.median([r.rate for r in problem.rests], axis=0)
    uncertain = estimated[bias] & (prior.sigma[bias] > RATE)
    point[bias] = np.where(uncertain, measured, point[bias])
    return point


def _first_attitudes(problem: PositionRows, point: FloatArray) -> FloatArray:
    """Return the attitudes of the first linearisation: levelled by gravity, with headings propagated by the gyros."""
    c, data = compensation(point), problem.data
    into = {link.second: link for link in problem.links}
    attitudes = np.empty((len(problem.rests), 3, 3))
    for k, rest in enumerate(problem.rests):
        _, force = compensate(c, rest.rate[None], rest.force[None])
        if k in into:
            link = into[k]
            B, _, _ = integrate_rotation(c.gyro_inverse, c.gyro_bias, data.dt, data.gyro, link.start, link.stop)
            attitudes[k] = levelled(attitudes[link.first] @ B, force[0])
        else:
            attitudes[k] = level_attitude(force[0])
    return attitudes


def _iterate(
    problem: PositionRows, point: FloatArray, attitudes: FloatArray, north: FloatArray, estimated: BoolArray
) -> _Converged:
    n, m, prior, root = len(problem.rests), len(problem.chains), problem.prior, problem.root
    converged = False
    for _ in range(MOST_ITERATIONS):
        H, r = problem.rows(point, attitudes, north)
        covariance = inverse(H.T @ H)
        x = covariance @ (H.T @ r)
        mean, spread = prior.mean + root @ x[:COUNT], root @ covariance[:COUNT, :COUNT] @ root.T
        target, sigma = np.where(estimated, mean, prior.mean), np.sqrt(np.diag(spread))
        turns = x[problem.phi : problem.phi + 3 * n].reshape(n, 3)
        share = min(1.0, LARGEST_STEP / float(np.abs(turns).max()))
        moved = float(np.max(np.abs(target - point) / np.where(sigma > 0.0, sigma, 1.0)))
        point = point + share * (target - point)
        found = x[problem.north : problem.drift].reshape(m, 2) * problem.north_rate
        north = north + share * (found - north)
        attitudes = np.array([rotation_matrix(share * t) @ C for t, C in zip(turns, attitudes, strict=True)])
        if moved < CONVERGED and share == 1.0:
            converged = True
            break
    belief = Belief(mean, 0.5 * (spread + spread.T))
    return _Converged(point, attitudes, north, belief, H, r - H @ x, covariance, converged)


def _scatter(problem: PositionRows, at: _Converged) -> Scatter:
    """Return the noise of rests and motions in excess of the profile's, from their weighted residuals.

    Only the force along gravity depends on the rest alone; the perpendicular force also contains errors of the motions.
    """
    n, rows, per_rest = len(problem.rests), problem.observations, problem.per_rest
    up = at.attitudes[:, 2, :]
    force = np.zeros((n, rows))
    for k in range(n):
        force[k, per_rest * k : per_rest * k + 3] = up[k]
    pick = np.eye(rows)
    gyros = 3 if per_rest == 6 else 0
    rate = pick[np.add.outer(per_rest * np.arange(n), np.arange(3, 3 + gyros)).ravel()]
    found = []
    for chosen, weighted, profile in (
        (force, problem.force_variance, problem.force_noise),
        (rate, np.repeat(problem.rate_variance, gyros), np.repeat(problem.rate_noise, gyros)),
        (pick[per_rest * n :], np.repeat(problem.turn_variance, 3), np.repeat(problem.turn_noise, 3)),
    ):
        H = chosen @ at.H[:rows]
        found.append(excess(chosen @ at.left[:rows] * np.sqrt(weighted), profile, at.spare(H)))
    return Scatter(*found)


def _residuals(problem: PositionRows, at: _Converged) -> tuple[FloatArray, FloatArray]:
    n, per_rest = len(problem.rests), problem.per_rest
    force = at.left[: per_rest * n].reshape(n, per_rest)[:, :3] * np.sqrt(problem.force_variance)[:, None]
    turn = at.left[per_rest * n : problem.observations].reshape(-1, 3) * np.sqrt(problem.turn_variance)[:, None]
    return force, turn
