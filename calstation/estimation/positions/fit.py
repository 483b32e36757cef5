"""Joint solution of gravity at rests and rotation between them, weighted with the scatter of the recording.

The magnitude of gravity alone determines the accelerometer scale, the change of its direction alone the gyro scale.
D. Tedaldi, A. Pretto, E. Menegatti, *A robust and easy to implement method for IMU calibration without external
equipments*, ICRA 2014, fit the same two quantities sequentially and without covariance.
"""

from dataclasses import dataclass
from functools import partial

import numpy as np

from calstation.estimation.common import Link, Posterior, SolveContext, StageData, gauss_newton, levelled
from calstation.estimation.effects import Sensitivity
from calstation.estimation.positions.response import position_sensitivity
from calstation.estimation.positions.rows import (
    LinearSolution,
    Position,
    PositionPoint,
    PositionRows,
    Scatter,
    excess,
    integrate_rotation,
)
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

MAX_ITERATIONS = 30
MAX_REWEIGHTINGS = 12
#: Largest change of an attitude in a Gauss-Newton step, rad.
LARGEST_STEP = 0.3


@dataclass(frozen=True)
class PositionFit:
    """The joint solution."""

    posterior: Posterior  #: Posterior of the 30 parameters, in which consider parameters are also updated.
    attitudes: FloatArray  #: C_bn of the rests, shape (n, 3, 3).
    chi2: float  #: Sum of the squared residuals in units of sigma.
    freedom: float  #: Degrees of freedom of the residuals.
    scatter: Scatter  #: Noise of the recording in excess of the profile's.
    force_residual: FloatArray  #: Force residuals of the rests, m/s², shape (n, 3).
    turn_residual: FloatArray  #: Rotation residuals of the motions, rad, shape (m, 3).
    converged: bool  #: Whether the last iteration made no significant change.
    sensitivity: Sensitivity | None  #: Response to effects outside the model; None without diagnostics.


def fit_positions(
    data: StageData,
    rests: list[Position],
    links: tuple[Link, ...],
    context: SolveContext,
    prior: Posterior,
    estimated: BoolArray,
) -> PositionFit:
    """Compute the joint MAP estimate; repeat it with increased noise until the noise explains the residuals.

    Parameters that are not `estimated` are consider parameters.
    """
    scatter = Scatter()
    problem = first = PositionRows(data, rests, links, context, prior, scatter)
    parameters = _first_point(problem, estimated)
    start = PositionPoint(parameters, _first_attitudes(problem, parameters), np.zeros((len(problem.chains), 2)))
    point, (posterior, best), converged = gauss_newton(partial(_step, problem, estimated), start, MAX_ITERATIONS)
    for _ in range(MAX_REWEIGHTINGS):
        before, scatter = scatter, _scatter(problem, best, point.attitudes)
        if scatter.near(before):
            break
        problem = PositionRows(data, rests, links, context, prior, scatter)
        point, (posterior, best), converged = gauss_newton(partial(_step, problem, estimated), point, MAX_ITERATIONS)
    seen, n, per_rest = slice(problem.observations), len(rests), problem.per_rest
    force, turn = best.left[: per_rest * n].reshape(n, per_rest)[:, :3], best.left[per_rest * n : problem.observations]
    return PositionFit(
        posterior=posterior,
        attitudes=point.attitudes,
        chi2=float(best.left[seen] @ best.left[seen]),
        freedom=best.spare(best.H[seen]),
        scatter=scatter,
        force_residual=force * np.sqrt(problem.force_variance)[:, None],
        turn_residual=turn.reshape(-1, 3) * np.sqrt(problem.turn_variance)[:, None],
        converged=converged,
        sensitivity=position_sensitivity(problem, first, point, estimated) if context.diagnostics else None,
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


def _step(
    problem: PositionRows, estimated: BoolArray, point: PositionPoint
) -> tuple[PositionPoint, tuple[Posterior, LinearSolution], float]:
    """Return the next linearisation point, the solution and the change in sigmas; infinite for a shortened step."""
    prior, root, solution = problem.prior, problem.root, problem.solve(point)
    x = solution.x
    mean, spread = prior.mean + root @ x[:COUNT], root @ solution.covariance[:COUNT, :COUNT] @ root.T
    target, sigma = np.where(estimated, mean, prior.mean), np.sqrt(np.diag(spread))
    turns = x[problem.phi : problem.north].reshape(-1, 3)
    share = min(1.0, LARGEST_STEP / float(np.abs(turns).max()))
    change = float(np.max(np.abs(target - point.parameters) / np.where(sigma > 0.0, sigma, 1.0)))
    north = x[problem.north : problem.drift].reshape(-1, 2) * problem.north_rate
    following = PositionPoint(
        point.parameters + share * (target - point.parameters),
        np.array([rotation_matrix(share * t) @ C for t, C in zip(turns, point.attitudes, strict=True)]),
        point.north + share * (north - point.north),
    )
    return following, (Posterior(mean, 0.5 * (spread + spread.T)), solution), change if share == 1.0 else np.inf


def _scatter(problem: PositionRows, at: LinearSolution, attitudes: FloatArray) -> Scatter:
    """Return the noise of rests and motions in excess of the profile's, from their weighted residuals.

    Only the force along gravity depends on the rest alone; the perpendicular force also contains errors of the motions.
    """
    n, rows, per_rest = len(problem.rests), problem.observations, problem.per_rest
    up = attitudes[:, 2, :]
    force = np.zeros((n, rows))
    for k in range(n):
        force[k, per_rest * k : per_rest * k + 3] = up[k]
    pick = np.eye(rows)
    gyros = 3 if per_rest == 6 else 0
    rate = pick[np.add.outer(per_rest * np.arange(n), np.arange(3, 3 + gyros)).ravel()]
    scatter = []
    for chosen, weighted, profile in (
        (force, problem.force_variance, problem.force_noise),
        (rate, np.repeat(problem.rate_variance, gyros), np.repeat(problem.rate_noise, gyros)),
        (pick[per_rest * n :], np.repeat(problem.turn_variance, 3), np.repeat(problem.turn_noise, 3)),
    ):
        H = chosen @ at.H[:rows]
        scatter.append(excess(chosen @ at.left[:rows] * np.sqrt(weighted), profile, at.spare(H)))
    return Scatter(*scatter)
