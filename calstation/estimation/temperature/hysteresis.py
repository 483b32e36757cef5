"""Hysteresis over temperature as a random process: its shape is known, and its size is estimated from the residuals.

A hysteresis is a sum of loops of several widths with random sizes (Prandtl and Ishlinskii; see Brokate and Sprekels,
Hysteresis and Phase Transitions, Springer, 1996). A loop follows the temperature with play: after a reversal it passes
from one side to the other while the temperature changes by twice its half width. It is independent of time, but depends
on the temperatures before the first point, which are unknown.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calstation.estimation.temperature.course import ELEMENT_OF, ELEMENTS
from calstation.estimation.temperature.equations import Equations, Unknowns
from calstation.estimation.temperature.points import TemperaturePoint
from calstation.physics import COUNT, GROUPS, FloatArray, group_indices

#: Half widths of the loops, K, and their states before the first temperature, from one side (-1) to the other (1).
_WIDTHS, _STATES = (2.0, 4.0, 8.0, 16.0), (-1.0, 0.0, 1.0)
#: Number of temperatures per point at which the loops are computed, and smallest relative singular value kept.
_STEPS, _NEGLIGIBLE = 9, 1e-3
#: Sizes whose likelihoods are compared, relative to the size that changes the residuals by as much as their noise.
_SIZES = np.geomspace(0.01, 1000.0, 120)
#: Groups whose sigmas always include the hysteresis that the data do not exclude.
_EXPECTED = ("gyro_bias", "accel_bias")
#: Twice the log-likelihood ratio above which another group has a hysteresis; 5 % of the groups without hysteresis
#: exceed it, because a variance of 0 is estimated as 0 in half of the cases (Self and Liang, Journal of the American
#: Statistical Association 82, 1987, 605-610).
_SIGNIFICANT = 2.7


@dataclass(frozen=True)
class _Parts:
    """Independent parts of the hysteresis of the parameters of a group."""

    columns: FloatArray  #: Change of the observations by each part, parameter by parameter, shape (n, parameters * j).
    after_rise: FloatArray  #: Share of each part in the hysteresis of a parameter after a rise, shape (j,).


def fit_with_hysteresis(
    equations: Equations, before: Unknowns, points: Sequence[TemperaturePoint], *, is_planned: bool = False
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the unknowns of a fit, their covariance, and the rms of the hysteresis in use.

    They have the shapes (u,), (u, u) and (30,); the rms is in SI units. The covariance includes the uncertainty due to
    the hysteresis during the calibration, but not the hysteresis in use. The variance of a group is its posterior mean
    with a scale-free prior: the share of noise in the residuals is uniformly distributed (Daniels, Canadian Journal of
    Statistics 27(3), 1999).

    Parameters
    ----------
    equations : observations of the points that are not held out
    before : unknowns before the fit
    points : all points, in order of time
    is_planned : whether nothing has been measured yet; the residuals are then those of a unit without hysteresis
    """
    courses = _loops(points)[[k for k, point in enumerate(points) if not point.is_held_out]]
    parts = {group: _parts(equations, group, courses) for group in GROUPS if not group.endswith("_lever")}
    columns = {group: each.columns for group, each in parts.items()}
    sizes = _sizes(equations, before, columns, is_planned=is_planned)
    jacobian, unknowns = [equations.jacobian], before
    for group, size in sizes.items():
        jacobian.append(parts[group].columns)
        count = jacobian[-1].shape[1]
        unknowns = unknowns.with_further(np.zeros(count), np.full(count, size))
    mean, covariance = unknowns.updated(np.hstack(jacobian), equations.observed)
    rms, first = np.zeros(COUNT), len(before.sigma)
    for group, size in sizes.items():
        index, after_rise = group_indices(group), parts[group].after_rise
        of_rise = np.kron(np.eye(len(index)), after_rise)
        stop = first + of_rise.shape[1]
        means, variances = of_rise @ mean[first:stop], of_rise @ covariance[first:stop, first:stop] @ of_rise.T
        unseen = size**2 * max(1.0 - float(after_rise @ after_rise), 0.0)
        rms[index] = np.sqrt(np.mean((0.0 if is_planned else means**2) + np.diag(variances)) + unseen)
        first = stop
    count = len(before.sigma)
    return mean[:count], covariance[:count, :count], rms


def _sizes(
    equations: Equations, before: Unknowns, columns: Mapping[str, FloatArray], *, is_planned: bool
) -> dict[str, float]:
    """Return the rms of the parts of the groups that have a hysteresis, SI; see `fit_with_hysteresis`.

    Parameters
    ----------
    equations : observations
    before : unknowns before the fit
    columns : observations of the parts by group, shape (n, k) each
    is_planned : whether nothing has been measured yet
    """
    basis, sizes = _basis(equations.jacobian[:, before.sigma > 0.0]), dict[str, float]()
    remaining = {group: _without(basis, matrix) for group, matrix in columns.items() if matrix.any()}
    residual = _without(basis, equations.observed)
    while remaining:
        largest = {group: _likelihoods(*_squares(matrix, residual)).max() for group, matrix in remaining.items()}
        group = max(largest, key=lambda name: largest[name])
        if is_planned or largest[group] <= _SIGNIFICANT:
            remaining = {name: matrix for name, matrix in remaining.items() if name in _EXPECTED}
            if not remaining:
                break
            group = next(iter(remaining))
        u, values, _ = np.linalg.svd(remaining.pop(group), full_matrices=False)
        variance = _variance(values, np.ones(len(values)) if is_planned else (u.T @ residual) ** 2)
        sizes[group] = float(np.sqrt(variance))
        change = u * (1.0 / np.sqrt(1.0 + variance * values**2) - 1.0)
        residual = residual + change @ (u.T @ residual)
        remaining = {name: matrix + change @ (u.T @ matrix) for name, matrix in remaining.items()}
    return sizes


def _loops(points: Sequence[TemperaturePoint]) -> FloatArray:
    """Return the mean of each independent loop at every point for gyros and accelerometers, shape (points, 2, loops).

    The sum of the loops has unit variance.
    """
    widths, states = (grid.ravel() for grid in np.meshgrid(_WIDTHS, _STATES))
    elements = [int(np.flatnonzero(element == ELEMENT_OF)[0]) for element in range(len(ELEMENTS))]
    means = np.zeros((len(points), len(ELEMENTS), len(widths)))
    middles = points[0].conditions[0][elements, None] - widths * states
    for k, point in enumerate(points):
        low, high = point.extent or (point.temperature, point.temperature)
        course = np.linspace(low, high, _STEPS)[:: 1 if point.rate >= 0.0 else -1] - point.temperature
        for temperature in point.conditions[0][elements, None] + course[:, None, None]:
            middles = np.clip(middles, temperature - widths, temperature + widths)
            means[k] += (temperature - middles) / widths / _STEPS
    return np.asarray(means / np.sqrt(len(widths)))


def _parts(equations: Equations, group: str, courses: FloatArray) -> _Parts:
    """Return independent parts of the hysteresis of a group from the loops at the fitted points; see `_loops`."""
    index = group_indices(group)
    u, values, v = np.linalg.svd(courses[:, ELEMENT_OF[index[0]]], full_matrices=False)
    kept = values > _NEGLIGIBLE * values.max(initial=0.0)
    parts = (u * values)[:, kept]
    columns = np.stack([equations.column(i, part) for i in index for part in parts.T], axis=1)
    return _Parts(columns, v[kept].sum(axis=1) / np.sqrt(v.shape[1]))


def _basis(jacobian: FloatArray) -> FloatArray:
    """Return an orthonormal basis of the column space of a Jacobian, shape (n, k)."""
    norms = np.linalg.norm(jacobian, axis=0)
    u, values, _ = np.linalg.svd(jacobian[:, norms > 0.0] / norms[norms > 0.0], full_matrices=False)
    return np.asarray(u[:, values > 1e-10 * values.max(initial=0.0)])


def _without(basis: FloatArray, rows: FloatArray) -> FloatArray:
    """Return the part of rows, shape (n, ...), orthogonal to the columns of a basis, shape (n, k)."""
    return np.asarray(rows - basis @ (basis.T @ rows))


def _squares(columns: FloatArray, residual: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the singular values of columns, shape (k,), and the squares of the residual along them, shape (k,)."""
    u, values, _ = np.linalg.svd(columns, full_matrices=False)
    return values, (u.T @ residual) ** 2


def _likelihoods(values: FloatArray, squares: FloatArray) -> FloatArray:
    """Return twice the logarithm of the likelihood of every size relative to size 0, shape (sizes,); see `_squares`."""
    ratios = np.outer(_SIZES, values / values[0]) ** 2
    return np.asarray(np.sum(squares * ratios / (1.0 + ratios) - np.log1p(ratios), axis=1))


def _variance(values: FloatArray, squares: FloatArray) -> float:
    """Return the posterior mean of the variance of a hysteresis, SI; see `_squares`."""
    likelihoods, shares = _likelihoods(values, squares), _SIZES**2
    weights = shares / (1.0 + shares) ** 2 * np.exp(0.5 * (likelihoods - likelihoods.max()))
    return float(weights @ shares / weights.sum() / values[0] ** 2)
