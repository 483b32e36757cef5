"""Geometry of a two-axis table from gravity at the rests of a run: angle between the axes, and tilt of the base.

The direction of up in b at a rest with encoder angles q is u = Pᵀ R(m)ᵀ R(inner, qᵢ)ᵀ R(h, ε)ᵀ R(outer, qₒ)ᵀ t. P is
the orientation of the unit, the mounting m a rotation vector, h the unit vector along outer × inner, ε the deviation of
the angle between the axes from its nominal value, and t the upward direction in base axes, rotated by the tilt of the
base about x and y at home. Gravity determines neither the azimuth nor the zero of the inner encoder, which is part of
m; the tilt about the outer axis includes the zero of the outer encoder.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag, solve_triangular

from calstation.estimation.common import (
    Posterior,
    SolveContext,
    StageData,
    mean_angles,
    rest_force,
    row_maxima,
    true_intervals,
    window_mean,
)
from calstation.physics import (
    FloatArray,
    axis_rotation,
    axis_rotations,
    compensate,
    compensation,
    group_indices,
    rotation_matrix,
    rotation_rate,
)

#: Names of the quantities in a result, in the order of the fitted values, which are followed by the mounting.
TABLE_QUANTITIES = ("orthogonality", "tilt_x", "tilt_y")

#: Averaging window of the rest detection, and shortest rest, s.
_WINDOW = 0.25
_SHORTEST = 0.3
#: Time omitted at both ends of a rest, s: nearly half a window, during which the table may still rotate.
_MARGIN = 0.1
#: Largest rate of a window at rest in excess of noise and earth rate, rad/s.
_CREEP = np.deg2rad(0.03)
#: Tilt of an axis due to bearing wobble, rad: 1″, typical of a good rate table.
_WOBBLE = np.deg2rad(1.0 / 3600.0)
#: Number of fitted values: three of the table, three of the mounting.
_VALUES = 6
#: Standard deviation of each value before the fit, and largest standard deviation of a determined value, rad.
_PRIOR, _MAX_SIGMA = 0.1, 0.01
_ACCELEROMETERS = [
    i for group in ("accel_bias", "accel_scale", "accel_misalign", "accel_quadratic") for i in group_indices(group)
]


@dataclass(frozen=True)
class TableRests:
    """The k rests of a stage for which both encoders were read."""

    force: FloatArray  #: Raw specific force, averaged with `slope_weights`, m/s², shape (k, 3).
    angles: FloatArray  #: Mean angles of the outer and the inner encoder, rad, shape (k, 2).
    variance: FloatArray  #: Variance of each component of the mean force, (m/s²)², shape (k,).


@dataclass(frozen=True)
class TableQuantity:
    """A fitted quantity of the table and its standard deviation, rad."""

    value: float
    sigma: float


def table_rests(data: StageData, context: SolveContext, posterior: Posterior) -> TableRests:
    """Find the rests of a stage, including short ones, with the gyro biases in `posterior`."""
    imu, (bias, bias_sigma) = context.imu, posterior.gyro_bias
    width = max(round(_WINDOW / data.dt), 2)
    noise = imu.gyro_arw / np.sqrt(width * data.dt) + imu.quantisation[0] * imu.rate_factor / width
    earth = float(np.linalg.norm(rotation_rate(context.site.latitude)))
    slowest = _CREEP + earth + 5.0 * noise + 3.0 * bias_sigma
    margin = round(_MARGIN / data.dt)
    force, angles, variance = [], [], []
    for start, stop in data.segments:
        if stop - start < width:
            continue
        mean = window_mean(data.gyro[start:stop], bias, width)
        for first, last in true_intervals(row_maxima(mean) < slowest):
            a, b = start + first + margin, start + last + width - 1 - margin
            duration = (b - a) * data.dt
            encoder = mean_angles(data, a, b) if duration >= _SHORTEST else None
            if encoder is not None:
                mean, mean_variance = rest_force(data, context, a, b)
                force.append(mean)
                angles.append(encoder)
                variance.append(mean_variance)
    return TableRests(np.reshape(force, (-1, 3)), np.reshape(angles, (-1, 2)), np.array(variance))


def table_axes(rests: Sequence[TableRests], context: SolveContext, posterior: Posterior) -> dict[str, TableQuantity]:
    """Fit the table's geometry to the rests of all stages with the solved parameters `posterior`.

    The weights include the noise of encoders and rests, the bearing wobble, and the uncertainty of the accelerometer
    parameters, which is common to all rests. The sigmas are increased if the scatter of the residuals exceeds the
    weights (Birge ratio), and include the wobble again, because it is common to rests at equal angles. Return the
    members of `TABLE_QUANTITIES` that the rests determine.
    """
    from scipy.optimize import least_squares  # takes half a second to import

    force, angles, variance = (
        np.concatenate([getattr(r, name) for r in rests]) if rests else np.empty(0)
        for name in ("force", "angles", "variance")
    )
    count = len(force)
    if 2 * count <= _VALUES:
        return {}
    up = _directions(posterior.mean, force)
    frames = np.linalg.svd(up[:, None])[2][:, 1:]  # two unit vectors perpendicular to each direction and to each other
    start = np.zeros(_VALUES)

    def components(directions: FloatArray) -> FloatArray:
        return np.asarray(np.einsum("kij,kj->ki", frames, directions).ravel())

    def derivative(of: FloatArray, angle_step: float, joint: int) -> FloatArray:
        step = np.zeros(2)
        step[joint] = angle_step
        return components((_up(context, of, angles + step) - _up(context, of, angles - step)) / (2.0 * angle_step))

    encoder = context.table.encoder_sigma
    joint_derivatives = np.stack([derivative(start, 1e-5, joint).reshape(count, 2) for joint in (0, 1)], axis=2)
    rest = variance / np.linalg.norm(force, axis=1) ** 2 + _WOBBLE**2
    blocks = encoder**2 * joint_derivatives @ joint_derivatives.transpose(0, 2, 1) + rest[:, None, None] * np.eye(2)
    uncertain = [i for i in _ACCELEROMETERS if posterior.sigma[i] > 0.0]
    columns = []
    for i in uncertain:
        step = np.zeros(len(posterior.mean))
        step[i] = posterior.sigma[i]
        change = _directions(posterior.mean + step, force) - _directions(posterior.mean - step, force)
        columns.append(components(change) / (2.0 * posterior.sigma[i]))
    common = np.array(columns).T
    covariance = block_diag(*blocks) + common @ posterior.covariance[np.ix_(uncertain, uncertain)] @ common.T
    root = np.linalg.cholesky(covariance)

    def residuals(values: FloatArray) -> FloatArray:
        measured = solve_triangular(root, components(up - _up(context, values, angles)), lower=True)
        return np.concatenate([measured, values / _PRIOR])

    fit = least_squares(residuals, start)
    scatter = max(1.0, float(np.linalg.norm(fit.fun[: 2 * count]) / np.sqrt(2 * count - _VALUES)))
    jacobian = np.asarray(fit.jac)
    sigma = np.hypot(scatter * np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian))), _WOBBLE)
    return {
        name: TableQuantity(float(fit.x[i]), float(sigma[i]))
        for i, name in enumerate(TABLE_QUANTITIES)
        if sigma[i] < _MAX_SIGMA
    }


def _up(context: SolveContext, values: FloatArray, angles: FloatArray) -> FloatArray:
    """Return the directions of up in b, shape (k, 3), for the fitted values at encoder angles, rad, shape (k, 2)."""
    outer, inner = np.array(context.table.outer_axis), np.array(context.table.inner_axis)
    hinge = np.cross(outer, inner)
    between = axis_rotation(hinge / np.linalg.norm(hinge), values[0]).T
    up = np.array([-values[2], values[1], 1.0]) / np.sqrt(1.0 + values[1] ** 2 + values[2] ** 2)
    mount = (rotation_matrix(values[3:]) @ np.array(context.table.orientation)).T
    rotated = axis_rotations(outer, -angles[:, 0]) @ up @ between.T
    return np.asarray(np.einsum("kij,kj->ki", axis_rotations(inner, -angles[:, 1]), rotated) @ mount.T)


def _directions(parameters: FloatArray, force: FloatArray) -> FloatArray:
    """Return the unit vectors of raw forces, shape (k, 3), compensated with 30 parameters."""
    _, compensated = compensate(compensation(parameters), np.zeros_like(force), force)
    return np.asarray(compensated / np.linalg.norm(compensated, axis=1, keepdims=True))
