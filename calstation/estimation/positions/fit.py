"""Joint solution of gravity at rests and rotation between them, weighted with the scatter of the recording.

The magnitude of gravity alone determines the accelerometer scale, and the change of its direction the gyro scale. D.
Tedaldi, A. Pretto, E. Menegatti, *A robust and easy to implement method for IMU calibration without external
equipments*, ICRA 2014, fit the same two quantities sequentially and without covariance. The sensitivity of the solution
to prior errors and to effects outside the model is computed from the same rows.
"""

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from calstation.estimation.common import Link, Posterior, SolveContext, StageData, align_vertical, gauss_newton
from calstation.estimation.effects import Sensitivity, StageEffects
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
    EFFECTS,
    RATE,
    BoolArray,
    Compensation,
    FloatArray,
    IntArray,
    Motion,
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
#: Smallest number of degrees of freedom from which the scatter of rests or motions is measured.
MIN_REDUNDANCY = 3.0
#: Smallest number of degrees of freedom after fitting drifts.
MIN_FREEDOM = 10
#: Number of parts into which a motion is divided; the error of a gyro is constant within each part.
_PARTS = 40


@dataclass(frozen=True)
class PositionFit:
    """The joint solution."""

    posterior: Posterior  #: Posterior of the 30 parameters, including updates of the consider parameters.
    attitudes: FloatArray  #: C_bn of the rests, shape (n, 3, 3).
    chi2: float  #: Sum of the squared residuals in units of sigma.
    freedom: float  #: Degrees of freedom of the residuals.
    scatter: Scatter  #: Noise of the recording in excess of the profile.
    assumed: tuple[
        str, ...
    ]  #: Kinds of scatter, ``force`` and ``turn``, that were assumed, because the recording does not measure them.
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
    assumed: Scatter,
) -> PositionFit:
    """Compute the joint MAP estimate, and repeat it with more noise until the noise explains the residuals.

    Parameters that are not `estimated` are consider parameters. Scatter that the recording cannot measure for lack of
    redundancy has at least its `assumed` value.

    Parameters
    ----------
    data : samples of the recording
    rests : rests with their mean outputs
    links : motions between rests
    context : IMU, table and site
    prior : estimate before the stage
    estimated : whether each parameter is estimated, shape (30,)
    assumed : scatter to use if the recording cannot measure it
    """
    scatter = Scatter()
    problem = profile_rows = PositionRows(data, rests, links, context, prior, scatter)
    parameters = _first_point(problem, estimated)
    start = PositionPoint(parameters, _first_attitudes(problem, parameters), np.zeros((len(problem.chains), 2)))
    point, (posterior, best), converged = gauss_newton(partial(_step, problem, estimated), start, MAX_ITERATIONS)
    kinds = _not_redundant(problem, best, point.attitudes)
    for _ in range(MAX_REWEIGHTINGS):
        before, scatter = scatter, _scatter(problem, best, point.attitudes)
        scatter = replace(scatter, **{kind: max(getattr(scatter, kind), getattr(assumed, kind)) for kind in kinds})
        if scatter.agrees_with(before):
            break
        problem = PositionRows(data, rests, links, context, prior, scatter)
        point, (posterior, best), converged = gauss_newton(partial(_step, problem, estimated), point, MAX_ITERATIONS)
    observed, n, per_rest = slice(problem.observations), len(rests), problem.per_rest
    force = best.residual[: per_rest * n].reshape(n, per_rest)[:, :3]
    turn = best.residual[per_rest * n : problem.observations]
    return PositionFit(
        posterior=posterior,
        attitudes=point.attitudes,
        chi2=float(best.residual[observed] @ best.residual[observed]),
        freedom=best.redundancy(best.H[observed]),
        scatter=scatter,
        assumed=tuple(kind for kind in kinds if getattr(assumed, kind) > 0.0),
        force_residual=force * np.sqrt(problem.force_variance)[:, None],
        turn_residual=turn.reshape(-1, 3) * np.sqrt(problem.turn_variance)[:, None],
        converged=converged,
        sensitivity=position_sensitivity(problem, profile_rows, point, estimated) if context.diagnostics else None,
    )


def _first_point(problem: PositionRows, estimated: BoolArray) -> FloatArray:
    """Return the prior mean, with the gyro bias from the rests if it is more accurate."""
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
    links_by_end = {link.second: link for link in problem.links}
    attitudes = np.empty((len(problem.rests), 3, 3))
    for k, rest in enumerate(problem.rests):
        _, force = compensate(c, rest.rate[None], rest.force[None])
        if k in links_by_end:
            link = links_by_end[k]
            B, _, _ = integrate_rotation(c.gyro_inverse, c.gyro_bias, data.dt, data.gyro, link.start, link.stop)
            attitudes[k] = align_vertical(attitudes[link.first] @ B, force[0])
        else:
            attitudes[k] = level_attitude(force[0])
    return attitudes


def _step(
    problem: PositionRows, estimated: BoolArray, point: PositionPoint
) -> tuple[PositionPoint, tuple[Posterior, LinearSolution], float]:
    """Return the next linearisation point, the solution, and the change in sigmas; infinite for a limited step."""
    prior, root, solution = problem.prior, problem.root, problem.solve(point)
    x = solution.x
    deviations = root @ solution.root[:COUNT]
    mean, spread = prior.mean + root @ x[:COUNT], deviations @ deviations.T
    target, sigma = np.where(estimated, mean, prior.mean), np.sqrt(np.diag(spread))
    turns = x[problem.phi : problem.north].reshape(-1, 3)
    share = min(1.0, LARGEST_STEP / float(np.abs(turns).max()))
    change = float(np.max(np.abs(target - point.parameters) / np.where(sigma > 0.0, sigma, 1.0)))
    north = x[problem.north : problem.drift].reshape(-1, 2) * problem.north_rate
    next_point = PositionPoint(
        point.parameters + share * (target - point.parameters),
        np.array([rotation_matrix(share * t) @ C for t, C in zip(turns, point.attitudes, strict=True)]),
        point.north + share * (north - point.north),
    )
    return next_point, (Posterior(mean, 0.5 * (spread + spread.T)), solution), change if share == 1.0 else np.inf


def _scatter(problem: PositionRows, at: LinearSolution, attitudes: FloatArray) -> Scatter:
    """Return the noise of rests and motions in excess of the profile, from their weighted residuals."""
    gyros = 3 if problem.per_rest == 6 else 0
    variances = {
        "force": (problem.force_variance, problem.force_noise),
        "rate": (np.repeat(problem.rate_variance, gyros), np.repeat(problem.rate_noise, gyros)),
        "turn": (np.repeat(problem.turn_variance, 3), np.repeat(problem.turn_noise, 3)),
    }
    residual = at.residual[: problem.observations]
    scatter = {}
    for kind, selection in _selections(problem, attitudes).items():
        weighted, noise = variances[kind]
        redundancy = at.redundancy(selection @ at.H[: problem.observations])
        scatter[kind] = excess(selection @ residual * np.sqrt(weighted), noise, redundancy)
    return Scatter(**scatter)


def _not_redundant(problem: PositionRows, at: LinearSolution, attitudes: FloatArray) -> tuple[str, ...]:
    """Return the kinds of scatter, ``force`` and ``turn``, that the recording does not measure."""
    rows = {kind: s @ at.H[: problem.observations] for kind, s in _selections(problem, attitudes).items()}
    return tuple(kind for kind in ("force", "turn") if len(rows[kind]) and at.redundancy(rows[kind]) < MIN_REDUNDANCY)


def _selections(problem: PositionRows, attitudes: FloatArray) -> dict[str, FloatArray]:
    """Return the combinations of rows, shape (k, observations), that measure each kind of scatter.

    Only the force along gravity is used, because the perpendicular force also depends on the errors of the motions.
    """
    n, rows, per_rest = len(problem.rests), problem.observations, problem.per_rest
    up = attitudes[:, 2, :]
    force = np.zeros((n, rows))
    for k in range(n):
        force[k, per_rest * k : per_rest * k + 3] = up[k]
    identity = np.eye(rows)
    gyros = 3 if per_rest == 6 else 0
    rate = identity[np.add.outer(per_rest * np.arange(n), np.arange(3, 3 + gyros)).ravel()]
    return {"force": force, "rate": rate, "turn": identity[per_rest * n :]}


def position_sensitivity(
    fitted: PositionRows, profile: PositionRows, at: PositionPoint, estimated: BoolArray
) -> Sensitivity:
    """Return the sensitivity of a solution about a linearisation point.

    An effect may cause the scatter used for the estimate. The tests therefore use rows with the noise of the profile,
    and divide χ² by the variance that remains after fitting all constant effects and drifts, or only the constant
    effects if too few degrees of freedom would remain.

    Parameters
    ----------
    fitted, profile : rows with the scatter of the estimate, and with the noise of the profile
    at : linearisation point
    estimated : mask of the estimated parameters, shape (30,)
    """
    time, observed = profile.data.time, slice(profile.observations)
    effects = StageEffects(float(time[0]), float(time[-1] - time[0]), profile.data.has_angles)
    contributions = _contributions(profile, at, effects)
    with_profile, with_scatter = profile.solve(at), fitted.solve(at)
    H, residual, covariance = with_profile.H[observed], with_profile.residual[observed], with_profile.covariance
    jacobian = np.linalg.lstsq(profile.root.T, H[:, :COUNT].T, rcond=None)[0].T
    response = np.hstack([jacobian, contributions / profile.sigma[:, None]])
    weighted = response - H @ (covariance @ (H.T @ response))
    score, information = response.T @ residual, response.T @ weighted
    total, freedom = float(residual @ residual), len(H) - float(np.sum((H @ covariance) * H))
    owners = np.array([c.cause for c in effects.candidates for _ in c.components])
    constant = COUNT + np.arange(sum(len(c.components) for c in EFFECTS))
    drifts = np.concatenate([constant, COUNT + np.flatnonzero(owners == "drift")])
    fit = drifts if freedom - _rank(information, drifts) >= MIN_FREEDOM else constant
    explained = float(score[fit] @ np.linalg.pinv(information[np.ix_(fit, fit)], hermitian=True) @ score[fit])
    redundancy = freedom - _rank(information, fit)
    variance = max(1.0, (total - explained) / redundancy if redundancy >= 1.0 else total / freedom)
    gain = fitted.root @ with_scatter.covariance[:COUNT] @ with_scatter.H[observed].T
    remaining = np.eye(COUNT, response.shape[1]) - gain @ ((profile.sigma / fitted.sigma)[:, None] * response)
    ratio = float(with_scatter.residual[observed] @ with_scatter.residual[observed]) * variance / total
    return effects.sensitivity(score / variance, information / variance, remaining, estimated, ratio)


def _rank(information: FloatArray, at: IntArray) -> int:
    return int(np.linalg.matrix_rank(information[np.ix_(at, at)], hermitian=True))


def _contributions(rows: PositionRows, at: PositionPoint, effects: StageEffects) -> FloatArray:
    """Return the contribution of each effect component to the observations, SI, shape (observations, components)."""
    c, errors = compensation(at.parameters), _errors(rows, at, effects)
    rests = np.array([errors[r.start] for r in rows.rests])
    columns = np.concatenate([rests[:, 3:], rests[:, :3]], axis=1)[:, : rows.per_rest]
    turns = [_rotation_error(rows, k, c, at, errors) for k in range(len(rows.links))]
    return np.concatenate([columns.reshape(-1, columns.shape[2]), *turns])


def _parts(link: Link) -> list[tuple[int, int]]:
    """Return the parts (start, stop) of a motion, in each of which the error of a gyro is constant."""
    return list(itertools.pairwise(np.unique(np.linspace(link.start, link.stop, _PARTS + 1).astype(int)).tolist()))


def _rotation_error(
    rows: PositionRows, k: int, c: Compensation, at: PositionPoint, errors: Mapping[int, FloatArray]
) -> FloatArray:
    """Return the error of the rotation of motion `k` due to each component, rad, shape (3, components)."""
    link, data = rows.links[k], rows.data
    earth = np.append(at.north[rows.chain[link.first]], rows.up_rate)
    B = rotation_matrix(-earth * (link.stop - link.start) * data.dt) @ at.attitudes[link.first]
    total = np.zeros_like(errors[link.start][:3])
    for start, stop in _parts(link):
        part, time, _ = integrate_rotation(c.gyro_inverse, c.gyro_bias, data.dt, data.gyro, start, stop)
        total -= B @ time @ c.gyro_inverse @ errors[start][:3]
        B = B @ part
    return total


def _errors(rows: PositionRows, at: PositionPoint, effects: StageEffects) -> dict[int, FloatArray]:
    """Return the mean errors of the six channels in each rest and part of a motion, shape (6, components), by start.

    They are computed for the whole recording, because they may depend on earlier motions. A rest is one interval.
    """
    data, resting = rows.data, {r.start: r for r in rows.rests}
    edges = {0, len(data), *(k for r in rows.rests for k in (r.start, r.stop))}
    edges.update(k for link in rows.links for part in _parts(link) for k in part)
    pieces = list(itertools.pairwise(sorted(edges)))
    gyro, accel, time = (
        np.concatenate([x[a:b] if a not in resting else [getattr(resting[a], name)] for a, b in pieces])
        for x, name in ((data.gyro, "rate"), (data.accel, "force"), (data.time, "time"))
    )
    rate, force = compensate(compensation(at.parameters), np.nan_to_num(gyro), accel)  # NaN without gyros
    counts = np.array([1 if a in resting else b - a for a, b in pieces])
    motion = Motion.steady(rate, force, time - data.time[0], np.array(rows.initial_turn_senses))
    return dict(zip([a for a, _ in pieces], effects.errors(motion, counts), strict=True))
