"""Whitened rows of the joint least-squares problem of rests and motions.

    rest       accel = (I + M_a) f + K2∘f² + b_a,  f = C_bnᵀ (0, 0, g);      gyro = (I + M_g) C_bnᵀ Ω + b_g
    motion     C_second = Exp(−Ω T) C_first B,  B the body rotation from the compensated gyros
    attitude   C_true = (I + [φ×]) C

Headings are arbitrary: each chain of rests has a separate level frame, in which the horizontal earth rate, two unknowns
of magnitude Ω cos φ, indicates north. The problem is then nearly linear and requires no gyrocompassing, for which
low-grade gyros are not accurate enough. The known magnitude is not used, because it adds hardly any information.

The columns are the parameters in units of the square root of their prior (30), φ of each rest (3 n), the horizontal
earth rate of each chain in units of Ω cos φ / √2 (2 m), and, if the profile specifies bias instability, the drift of
gyro and accelerometer biases at each rest in units of its sigma (6 n).
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from calstation.estimation.common import (
    BIAS_DRIFT_PER_INSTABILITY,
    BIAS_DRIFT_TIME,
    Link,
    Posterior,
    SolveContext,
    StageData,
    Stillness,
    chi_square_quantile,
    filter_noise,
    rest_force,
)
from calstation.physics import (
    COUNT,
    INDEX,
    PARAMETERS,
    Compensation,
    FloatArray,
    compensation,
    group_indices,
    group_matrix,
    group_vector,
    kernel,
    rotation_matrix,
    rotation_rate,
    rotation_vector,
    skew,
)

#: Time at the start of a rest whose rates are omitted, s, because a rig still rotates slightly while it settles.
CREEP = 0.5
#: Confidence level of the test whether residuals exceed the known noise.
CONFIDENCE = 0.9995
#: Weight of the row that fixes the first heading of a chain, 1/rad.
HEADING_WEIGHT = 1e3
_ACCEL = [p for p in PARAMETERS if p.group in ("accel_scale", "accel_misalign")]
_GYRO = [p for p in PARAMETERS if p.group in ("gyro_scale", "gyro_misalign")]
#: Indices of the gyro parameters: bias, scale and misalignment.
GYRO_COLUMNS = [*group_indices("gyro_bias"), *(INDEX[p.name] for p in _GYRO)]


@dataclass(frozen=True)
class Scatter:
    """Standard deviations of the noise in excess of the profile."""

    force: float = 0.0  #: Scatter of the mean specific force of a rest, m/s².
    rate: float = 0.0  #: Scatter of the gyro bias from rest to rest, rad/s.
    turn: float = 0.0  #: Scatter of the rotation angle of a motion, rad.

    def agrees_with(self, other: "Scatter") -> bool:
        """Return whether this scatter and `other` agree within 5 %."""
        pairs = ((self.force, other.force), (self.rate, other.rate), (self.turn, other.turn))
        return all(abs(a - b) <= 0.05 * max(a, b) for a, b in pairs)


@dataclass(frozen=True)
class Position:
    """A rest of a recording."""

    start: int  #: Index of the first sample.
    stop: int  #: Index after the last sample.
    time: float  #: IMU time at the middle of the rest, s.
    force: FloatArray  #: Mean raw specific force, m/s², shape (3,).
    force_variance: float  #: Variance from the profile, (m/s²)².
    rate: FloatArray  #: Mean raw rate, rad/s, shape (3,).
    rate_variance: float  #: Variance from the profile, (rad/s)².


def positions(data: StageData, still: Stillness, context: SolveContext) -> list[Position]:
    """Return the rests with their mean outputs."""
    noise = filter_noise(context)
    rests = []
    for a, b in still.rests:
        force, variance = rest_force(data, context, a, b)
        duration = (b - a) * data.dt
        begin = a + round(CREEP / data.dt) if duration > 4.0 * CREEP else a
        rests.append(
            Position(
                start=a,
                stop=b,
                time=float(0.5 * (data.time[a] + data.time[b - 1])),
                force=force,
                force_variance=variance - float(noise.bias_drift[3]) ** 2,
                rate=data.gyro[begin:b].mean(axis=0),
                rate_variance=noise.rate / ((b - begin) * data.dt),
            )
        )
    return rests


def excess(residual: FloatArray, variance: FloatArray, redundancy: float) -> float:
    """Return the additional standard deviation for which χ² equals the degrees of freedom `redundancy`.

    It is 0 if `variance`, the variance of each element of `residual`, shape (m,), explains the residuals, or if
    `redundancy` is below 1.
    """
    total = float(np.sum(residual**2 / variance))
    if redundancy < 1.0 or total <= chi_square_quantile(CONFIDENCE, redundancy):
        return 0.0
    upper = float(np.sum(residual**2)) / redundancy
    if float(np.sum(residual**2 / (variance + upper))) >= redundancy:  # `variance` is lost in rounding
        return float(np.sqrt(upper))
    from scipy.optimize import brentq  # takes half a second to import and is rarely needed

    variance_excess = brentq(lambda x: float(np.sum(residual**2 / (variance + x))) - redundancy, 0.0, upper)
    return float(np.sqrt(variance_excess))


class PositionPoint(NamedTuple):
    """Linearisation point of a recording with n rests in m chains."""

    parameters: FloatArray  #: SI, shape (30,).
    attitudes: FloatArray  #: C_bn of the rests, shape (n, 3, 3).
    north: FloatArray  #: Horizontal earth rate in each chain's level frame, rad/s, shape (m, 2).


class LinearSolution(NamedTuple):
    """Least-squares solution of the rows at a linearisation point."""

    H: FloatArray  #: Jacobian, shape (rows, columns).
    x: FloatArray  #: Solution, shape (columns,).
    residual: FloatArray  #: Remaining residuals, shape (rows,).
    root: FloatArray  #: Square root of the covariance of the columns, shape (columns, columns).

    @property
    def covariance(self) -> FloatArray:
        """Covariance of the columns, shape (columns, columns); unlike an inverse of Hᵀ H it is never indefinite."""
        return np.asarray(self.root @ self.root.T)

    def redundancy(self, H: FloatArray) -> float:
        """Return the degrees of freedom of the rows `H`: the trace of I − H P Hᵀ."""
        return len(H) - float(np.sum((H @ self.root) ** 2))


class PositionRows:
    """Rows of one recording: 6 rows per rest (3 without gyros), 3 per motion, and then the rows of the prior."""

    def __init__(
        self,
        data: StageData,
        rests: list[Position],
        links: tuple[Link, ...],
        context: SolveContext,
        prior: Posterior,
        scatter: Scatter,
    ) -> None:
        site, noise = context.site, filter_noise(context)
        self.data, self.rests, self.links, self.prior, self.initial_turn_senses = (
            data,
            rests,
            links,
            prior,
            context.initial_turn_senses,
        )
        self.gravity = site.local_gravity
        self.up_rate = float(rotation_rate(site.latitude)[2])
        self.north_rate = float(rotation_rate(site.latitude)[1]) / np.sqrt(2.0)
        # without coarse rounding: its error is independent between positions and is part of the noise of the rests
        self.bias_drift = np.repeat(BIAS_DRIFT_PER_INSTABILITY * context.imu.bias_instability, 3)
        self.has_drift = bool(np.any(self.bias_drift))
        self.root = square_root(prior.covariance)
        #: Rows of a rest: specific force, and rate if there are gyros.
        self.per_rest = 6 if data.has_gyros else 3
        n = len(rests)
        first_of = {link.second: link.first for link in links}
        self.chains = [k for k in range(n) if k not in first_of]
        self.chain = np.empty(n, np.int64)
        for k in range(n):
            self.chain[k] = self.chain[first_of[k]] if k in first_of else self.chains.index(k)
        self.phi, self.north = COUNT, COUNT + 3 * n
        self.drift = self.north + 2 * len(self.chains)
        self.columns = self.drift + (6 * n if self.has_drift else 0)
        self.observations = self.per_rest * n + 3 * len(links)
        durations = np.array([(link.stop - link.start) * data.dt for link in links])
        self.force_noise = np.array([r.force_variance for r in rests])
        self.rate_noise = np.array([r.rate_variance for r in rests])
        # the scatter of a bias between rests also acts as a constant error during each motion
        self.turn_noise = noise.rate * durations + (scatter.rate * durations) ** 2
        self.force_variance = self.force_noise + scatter.force**2
        self.rate_variance = self.rate_noise + scatter.rate**2
        self.turn_variance = self.turn_noise + scatter.turn**2
        at_rest = np.repeat([self.force_variance, self.rate_variance], 3, axis=0).T[:, : self.per_rest]
        #: Standard deviation of each observation, shape (observations,).
        self.sigma = np.sqrt(np.concatenate([at_rest.ravel(), np.repeat(self.turn_variance, 3)]))

    def solve(self, at: PositionPoint) -> LinearSolution:
        """Solve the rows linearised about a point."""
        H, residual = self._rows(at)
        scale = 1.0 / np.linalg.norm(H, axis=0)  # the columns have very different magnitudes
        root = scale[:, None] * np.linalg.inv(np.linalg.qr(H * scale, "r"))
        x = root @ (root.T @ (H.T @ residual))
        return LinearSolution(H, x, residual - H @ x, root)

    def _rows(self, at: PositionPoint) -> tuple[FloatArray, FloatArray]:
        """Return the Jacobian, shape (rows, columns), and residual, shape (rows,), linearised about a point."""
        point, attitudes, north = at
        c = compensation(point)
        earth = np.column_stack([north, np.full(len(north), self.up_rate)])[self.chain]
        parts = [self._rest(k, point, attitudes[k], earth[k]) for k in range(len(self.rests))]
        parts += [self._link(k, c, attitudes, earth) for k in range(len(self.links))]
        H, residual = np.vstack([p[0] for p in parts]), np.concatenate([p[1] for p in parts])
        # parameters and earth rates are absolute unknowns, not increments from the point
        residual += H[:, :COUNT] @ (point - self.prior.mean)
        residual += H[:, self.north : self.drift] @ north.ravel()
        H[:, :COUNT] = H[:, :COUNT] @ self.root
        H[:, self.north : self.drift] *= self.north_rate
        prior_rows = self._prior_rows()
        return np.vstack([H, prior_rows]), np.concatenate([residual, np.zeros(len(prior_rows))])

    def _rest(self, k: int, point: FloatArray, C: FloatArray, earth: FloatArray) -> tuple[FloatArray, FloatArray]:
        rest = self.rests[k]
        M_a = np.eye(3) + group_matrix(point, "accel_scale", "accel_misalign")
        M_g = np.eye(3) + group_matrix(point, "gyro_scale", "gyro_misalign")
        K2 = group_vector(point, "accel_quadratic")
        up = np.array([0.0, 0.0, self.gravity])
        force, rate = C.T @ up, C.T @ earth
        H = np.zeros((6, self.columns))
        H[0:3, group_indices("accel_bias")] = H[3:6, group_indices("gyro_bias")] = np.eye(3)
        for p in _ACCEL:
            H[p.row, INDEX[p.name]] = force[p.column]
        for p in _GYRO:
            H[3 + p.row, INDEX[p.name]] = rate[p.column]
        H[0:3, group_indices("accel_quadratic")] = np.diag(force**2)
        phi = slice(self.phi + 3 * k, self.phi + 3 * k + 3)
        H[0:3, phi] = (M_a + 2.0 * np.diag(K2 * force)) @ C.T @ skew(up)
        H[3:6, phi] = M_g @ C.T @ skew(earth)
        H[3:6, self._north_columns(k)] = (M_g @ C.T)[:, :2]
        if self.has_drift:
            drift = self.drift + 6 * k
            H[0:3, drift + 3 : drift + 6] = np.diag(self.bias_drift[3:])
            H[3:6, drift : drift + 3] = np.diag(self.bias_drift[:3])
        residual = np.concatenate(
            [
                rest.force - M_a @ force - K2 * force**2 - group_vector(point, "accel_bias"),
                rest.rate - M_g @ rate - group_vector(point, "gyro_bias"),
            ]
        )
        weight = 1.0 / np.sqrt(np.repeat([self.force_variance[k], self.rate_variance[k]], 3))
        rows = slice(self.per_rest)
        return (H * weight[:, None])[rows], (residual * weight)[rows]

    def _north_columns(self, rest: int) -> slice:
        start = self.north + 2 * int(self.chain[rest])
        return slice(start, start + 2)

    def _link(self, k: int, c: Compensation, attitudes: FloatArray, earth: FloatArray) -> tuple[FloatArray, FloatArray]:
        link, data = self.links[k], self.data
        duration = (link.stop - link.start) * data.dt
        B, time, rate = integrate_rotation(c.gyro_inverse, c.gyro_bias, data.dt, data.gyro, link.start, link.stop)
        E = rotation_matrix(-earth[link.first] * duration)
        start = E @ attitudes[link.first]
        H = np.zeros((3, self.columns))
        H[:, GYRO_COLUMNS] = gyro_derivative(start, c, time, rate)
        H[:, self.phi + 3 * link.first : self.phi + 3 * link.first + 3] = E
        H[:, self.phi + 3 * link.second : self.phi + 3 * link.second + 3] = -np.eye(3)
        H[:, self._north_columns(link.first)] = -duration * np.eye(3)[:, :2]
        if self.has_drift:
            half = 0.5 * H[:, group_indices("gyro_bias")] * self.bias_drift[:3]
            for rest in (link.first, link.second):
                H[:, self.drift + 6 * rest : self.drift + 6 * rest + 3] = half
        residual = rotation_vector(attitudes[link.second] @ (start @ B).T)
        weight = 1.0 / np.sqrt(self.turn_variance[k])
        return H * weight, residual * weight

    def _prior_rows(self) -> FloatArray:
        """Return the rows of the prior: parameters, earth rates, first headings, and bias drift between rests."""
        rows = [np.eye(COUNT, self.columns), np.eye(2 * len(self.chains), self.columns, self.north)]
        for k in self.chains:
            row = np.zeros((1, self.columns))
            row[0, self.phi + 3 * k + 2] = HEADING_WEIGHT
            rows.append(row)
        if self.has_drift:
            for k, rest in enumerate(self.rests):
                row = np.zeros((6, self.columns))
                correlation = 0.0 if k == 0 else np.exp(-(rest.time - self.rests[k - 1].time) / BIAS_DRIFT_TIME)
                scale = 1.0 / np.sqrt(1.0 - correlation**2)
                row[:, self.drift + 6 * k : self.drift + 6 * k + 6] = scale * np.eye(6)
                if k:
                    row[:, self.drift + 6 * (k - 1) : self.drift + 6 * k] = -scale * correlation * np.eye(6)
                rows.append(row)
        return np.vstack(rows)


def gyro_derivative(start: FloatArray, c: Compensation, time: FloatArray, rate: FloatArray) -> FloatArray:
    """Return the derivative of a rotation vector in the frame of `start` with respect to `GYRO_COLUMNS`, shape (3, 12).

    δφ = −∫ C (I + M_g)⁻¹ (δb + δM ω) dt, with C = `start` C_b(start)←b(t) and the integrals of `integrate_rotation`.

    Parameters
    ----------
    start : rotation from b at the start into the frame of the rotation vector, shape (3, 3)
    c : constants of the compensation
    time, rate : integrals of `integrate_rotation`, s, shape (3, 3), and rad, shape (3, 3, 3)
    """
    by_matrix = [-start @ rate[p.column] @ c.gyro_inverse[:, p.row] for p in _GYRO]
    return np.column_stack([-start @ time @ c.gyro_inverse, *by_matrix])


def square_root(P: FloatArray) -> FloatArray:
    """Return L with L Lᵀ = P, computed from the eigenvectors of the correlation so that P may be singular."""
    sigma = np.sqrt(np.diag(P))
    safe = np.where(sigma > 0.0, sigma, 1.0)
    values, vectors = np.linalg.eigh(P / np.outer(safe, safe))
    return np.asarray(sigma[:, None] * vectors * np.sqrt(np.maximum(values, 0.0)))


@kernel
def integrate_rotation(
    gyro_inverse: FloatArray, bias: FloatArray, dt: float, gyro: FloatArray, start: int, stop: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Integrate the rotation between two samples, and the terms of its derivative with respect to the gyro parameters.

    Parameters
    ----------
    gyro_inverse : inverse of I + M_g, shape (3, 3)
    bias : gyro biases, rad/s, shape (3,)
    dt : sample period, s
    gyro : raw mean rates, rad/s, shape (n, 3)
    start, stop : first sample, and the one after the last

    Returns
    -------
    B : C_b(start)←b(stop), shape (3, 3)
    time : ∫ C dt with C = C_b(start)←b(t), s, shape (3, 3)
    rate : ∫ C ω_c dt for each axis c, rad, shape (3, 3, 3)
    """
    B, time, rate = np.eye(3), np.zeros((3, 3)), np.zeros((3, 3, 3))
    omega, last, rotvec, next_attitude = np.empty(3), np.empty(3), np.empty(3), np.empty((3, 3))
    for k in range(max(start - 1, 0), stop):
        for i in range(3):
            last[i] = omega[i]
            omega[i] = 0.0
            for j in range(3):
                omega[i] += gyro_inverse[i, j] * (gyro[k, j] - bias[j])
        if k < start:
            continue
        if k == 0:
            last[:] = omega
        for i in range(3):  # coning from the last and the current increment, as in `physics.strapdown`
            j, m = (i + 1) % 3, (i + 2) % 3
            rotvec[i] = omega[i] * dt + (last[j] * omega[m] - last[m] * omega[j]) * dt * dt / 12.0
        turn = rotation_matrix(rotvec)
        for i in range(3):
            for j in range(3):
                next_attitude[i, j] = B[i, 0] * turn[0, j] + B[i, 1] * turn[1, j] + B[i, 2] * turn[2, j]
        for i in range(3):
            for j in range(3):
                middle = 0.5 * (B[i, j] + next_attitude[i, j]) * dt
                B[i, j] = next_attitude[i, j]
                time[i, j] += middle
                for c in range(3):
                    rate[c, i, j] += middle * omega[c]
    return B, time, rate
