"""Least-squares fit of a secondary IMU to a primary IMU on the same body, from synchronous samples.

    gyro    secondary(t) = C_g ω(t + τ) + b_g
    accel   secondary(t) = C_a (f + M (α × r + ω × (ω × r)))(t + τ) + b_a

ω, f are the raw output of the primary. In the lever term, ω and α are compensated with the primary's own errors and M
is its accelerometer matrix, so the bracket is the output that the primary would have at the location of the secondary.
r points from the primary's reference point to the secondary's. The clock offset τ is added to the secondary's time to
obtain the primary's. Both streams pass through the same low-pass filter, so its effect on the motion cancels.

The normal matrix is corrected for the bias due to the primary's noise (W. A. Fuller, *Measurement Error Models*, 1987,
2.2). Outliers (saturation, a shock) have lower weights (P. J. Huber, *Robust Statistics*, 1981). The covariance is the
jackknife estimate over blocks of time (K.-Y. Liang and S. L. Zeger, Biometrika 73(1), 1986), which is valid for
residuals of any spectrum and magnitude within a block; bias drift over longer times is added from the profiles.
"""

import itertools
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal

import numpy as np

from calstation.estimation.common import BIAS_DRIFT_PER_INSTABILITY, BIAS_DRIFT_TIME, ImuModel, gauss_newton
from calstation.estimation.effects import EffectEvidence, plausible_changes
from calstation.estimation.pairs.effects import Block, jackknife, pair_effects
from calstation.estimation.pairs.filtering import PairData, Signals, coarse_offset, low_pass, signals
from calstation.physics import PAIR_PARAMETERS, BoolArray, Compensation, Effect, FloatArray, Motion, compensate

Model = Literal["bias", "scale", "full"]
#: Duration of a jackknife block, s; residuals of different blocks are independent.
BLOCK = 0.5
#: Largest number of blocks for the tests of effects, which use much memory per block.
MAX_BLOCKS = 200
#: Largest clock offset, s.
MAX_OFFSET = 1.0
#: Size of a residual, relative to the typical size, above which its weight decreases.
HUBER_THRESHOLD = 4.0
#: Smallest share of the information, in every direction, of half a recording that is solved separately.
MIN_SHARE = 0.05
MAX_ITERATIONS = 20
GYRO_BIAS, GYRO_MATRIX = slice(0, 3), slice(3, 12)
ACCEL_BIAS, ACCEL_MATRIX = slice(12, 15), slice(15, 24)
LEVER, OFFSET = slice(24, 27), 27
COUNT = len(PAIR_PARAMETERS)
_BIASES = np.array([p.group.endswith("bias") for p in PAIR_PARAMETERS])


@dataclass(frozen=True)
class PairChoice:
    """Choice of the terms to fit."""

    gyro: Model | None = "full"  #: Bias only, bias and scale factors, or bias and full matrix; None for no gyro term.
    accel: Model | None = "full"  #: As `gyro`, for the accelerometers.
    lever: bool = True  #: Whether the lever arm is fitted.
    offset: bool = True  #: Whether the clock offset is fitted.

    @property
    def fitted(self) -> BoolArray:
        """Mask of the fitted pair parameters, shape (28,)."""
        mask = np.zeros(COUNT, np.bool_)
        for model, bias, matrix in ((self.gyro, GYRO_BIAS, GYRO_MATRIX), (self.accel, ACCEL_BIAS, ACCEL_MATRIX)):
            if model is not None:
                mask[bias] = True
                mask[matrix] = {"bias": np.zeros(9), "scale": np.eye(3).ravel(), "full": np.ones(9)}[model] > 0
        mask[LEVER] = self.lever and self.accel is not None
        mask[OFFSET] = self.offset
        return mask

    def tests(self, effect: Effect) -> bool:
        """Return whether the fitted terms allow a test of an effect."""
        if effect.on_table:
            return False
        if effect.between_sensors:
            return self.offset and self.gyro == self.accel == "full"
        return (self.gyro if effect.terms[0].channel < 3 else self.accel) == "full"


@dataclass(frozen=True)
class PairFit:
    """Values and covariance of the pair parameters, in the order of `PAIR_PARAMETERS`."""

    value: FloatArray  #: Values, SI, shape (28,).
    covariance: FloatArray  #: Covariance, SI, shape (28, 28), 0 for parameters that are not fitted.
    fitted: BoolArray  #: Mask of the fitted parameters, shape (28,).
    rms: tuple[float, float]  #: Residuals of gyro (rad/s) and accelerometer (m/s²) in the pass band.
    expected: tuple[float, float]  #: Residuals expected from noise alone, units as for `rms`.
    blocks: int  #: Number of jackknife blocks.
    #: Mean squared difference between the solutions of odd and even blocks, in units of its variance; 1 if the
    #: covariance is consistent.
    halves: float
    converged: bool  #: Whether the last iteration made no significant change.
    change: FloatArray  #: Second half of the recording minus the first, SI, NaN if not compared, shape (28,).
    change_sigma: FloatArray  #: Standard deviation of `change`, including the bias drift, SI, shape (28,).
    #: Evidence in the residuals for effects outside the model, the likeliest first.
    effects: tuple[EffectEvidence, ...]


def fit_pair(
    data: PairData, primary: ImuModel, secondary: ImuModel, c: Compensation, choice: PairChoice, start: FloatArray
) -> PairFit:
    """Fit the chosen pair parameters.

    Raises numpy.linalg.LinAlgError if the motion does not determine the parameters.

    Parameters
    ----------
    data, primary, secondary : samples of both IMUs and their profiles
    c : compensation of the primary
    choice : parameters to fit
    start : initial values of the pair parameters, SI, shape (28,), kept where they are not fitted
    """
    value, fitted = start.copy(), choice.fitted
    if choice.offset:
        value[OFFSET] = coarse_offset(data, MAX_OFFSET)
    noise = np.array([_white(primary), _white(secondary)])

    def step(value: FloatArray) -> tuple[FloatArray, tuple[Signals, _System], float]:
        rows = signals(data, float(value[OFFSET]), c)
        system = _System(rows, value, noise, data, fitted)
        change = np.linalg.solve(system.normal, system.gradient.sum(axis=0))
        next_value, sigma = value.copy(), np.sqrt(np.diag(system.covariance()))
        next_value[fitted] += change
        return next_value, (rows, system), float(np.max(np.abs(change) / sigma))

    value, (rows, system), converged = gauss_newton(step, value, MAX_ITERATIONS)
    covariance = np.zeros((COUNT, COUNT))
    covariance[np.ix_(fitted, fitted)] = system.covariance()
    duration = max(float(data.time[-1] - data.time[0]), data.dt)
    drift = _bias_drift_variances(duration, primary, secondary)
    covariance[fitted, fitted] += drift[fitted]
    # variance of the difference between the means of both halves, which are correlated
    between = 4.0 * (_bias_drift_variances(0.5 * duration, primary, secondary) - drift)
    change, variance = system.change()
    sigma = np.sqrt(np.diag(covariance)[fitted])
    names = [p.name for p, chosen in zip(PAIR_PARAMETERS, fitted, strict=True) if chosen]
    U, _, V = np.linalg.svd(value[GYRO_MATRIX if choice.gyro == "full" else ACCEL_MATRIX].reshape(3, 3))
    axes = U @ V  # axes of the secondary in primary axes, one per row
    mean = system.mean_of_both(rows)
    blocks = system.blocks(mean, _motion(mean, value, c, data.time[rows.row], axes))
    # variance of the change of a bias over the recording due to instability
    share = 2.0 * BIAS_DRIFT_PER_INSTABILITY**2 * (1.0 - np.exp(-duration / BIAS_DRIFT_TIME))
    drift_variance = share * (primary.bias_instability**2 + secondary.bias_instability**2)
    drift_variances = dict(zip(("gyro_bias", "accel_bias"), drift_variance.tolist(), strict=True))
    changes = np.hypot(plausible_changes(primary, {}), plausible_changes(secondary, {}))
    effects = pair_effects(blocks, choice.tests, system.scale, axes, duration, drift_variances, changes, sigma, names)
    return PairFit(
        value,
        covariance,
        fitted,
        system.rms,
        system.expected,
        len(system.gradient),
        system.halves(),
        converged,
        change,
        np.sqrt(variance + between),
        tuple(effects),
    )


def _motion(rows: Signals, value: FloatArray, c: Compensation, time: FloatArray, axes: FloatArray) -> Motion:
    """Return the motion of the secondary along its own `axes`, shape (3, 3)."""
    rate, force = compensate(c, rows.gyro, rows.accel + rows.lever @ value[LEVER])
    turning, jerk = rows.gyro_slope @ c.gyro_inverse.T, rows.accel_slope @ c.accel_inverse.T
    return Motion(rate @ axes.T, force @ axes.T, turning @ axes.T, jerk @ axes.T, time - time[0])


class _System:
    """Normal equations of the k fitted parameters at a linearisation point, by block."""

    def __init__(self, rows: Signals, value: FloatArray, noise: FloatArray, data: PairData, fitted: BoolArray) -> None:
        self._fitted = fitted
        C, A = value[GYRO_MATRIX].reshape(3, 3), value[ACCEL_MATRIX].reshape(3, 3)
        base = rows.accel + rows.lever @ value[LEVER]
        residual = np.hstack(
            [rows.gyro2 - rows.gyro @ C.T - value[GYRO_BIAS], rows.accel2 - base @ A.T - value[ACCEL_BIAS]]
        )
        self.rms = (_size(residual[:, :3]), _size(residual[:, 3:]))
        band = float(np.sum(low_pass() ** 2))
        gyro, accel = np.sqrt(band * np.sum(noise**2, axis=0)).tolist()
        self.expected = (gyro, accel)
        scale = np.repeat([max(r, 1e-3 * e) for r, e in zip(self.rms, self.expected, strict=True)], 3)
        weights = np.hstack([_weights(residual[:, :3] / scale[:3]), _weights(residual[:, 3:] / scale[3:])])
        block = (data.time[rows.row] // BLOCK).astype(np.int64)
        edges = np.flatnonzero(np.diff(block, prepend=block[0] - 1)) if len(block) else np.empty(0, np.int64)
        self._parts = [slice(int(a), int(b)) for a, b in itertools.pairwise([*edges, len(block)])]
        k = int(fitted.sum())
        self.gradient, self._normals = np.zeros((len(edges), k)), np.zeros((len(edges), k, k))
        attenuation = self._attenuation(rows, value, noise, scale)
        self._value, self._noise = value, noise
        columns = partial(_columns, rows, base=base, C=C, A=A)
        self.scale, self._weights, self._residual = scale, weights, residual
        for b, part in enumerate(self._parts):
            X = columns(part)[:, :, fitted] / scale[None, :, None]
            w, e = weights[part], residual[part] / scale
            added, back = attenuation(w)
            self._normals[b] = np.einsum("nij,ni,nik->jk", X, w, X) - added
            self.gradient[b] = np.einsum("nij,ni,ni->j", X, w, e) + back
        self.normal = self._normals.sum(axis=0)

    def _attenuation(
        self, rows: Signals, value: FloatArray, noise: FloatArray, scale: FloatArray
    ) -> Callable[[FloatArray], tuple[FloatArray, FloatArray]]:
        """Return a function from a block's weights to the effect of primary noise on normal matrix and gradient."""
        gyro, accel = rows.white * noise[0, 0] ** 2, rows.white * noise[0, 1] ** 2
        turning = rows.slope * noise[0, 0] ** 2
        A = value[ACCEL_MATRIX].reshape(3, 3)
        fitted = self._fitted

        def of(weights: FloatArray) -> tuple[FloatArray, FloatArray]:
            added = np.zeros((COUNT, COUNT))
            for i in range(3):
                w = float(weights[:, i].sum()) / scale[i] ** 2
                w2 = float(weights[:, 3 + i].sum()) / scale[3 + i] ** 2
                for j in range(3 * i, 3 * i + 3):
                    added[GYRO_MATRIX, GYRO_MATRIX][j, j] = w * gyro
                    added[ACCEL_MATRIX, ACCEL_MATRIX][j, j] = w2 * accel
                added[LEVER, LEVER] += w2 * turning * (A[i] @ A[i] * np.eye(3) - np.outer(A[i], A[i]))
            return added[np.ix_(fitted, fitted)], (added @ value)[fitted]

        return of

    def mean_of_both(self, rows: Signals) -> Signals:
        """Return the signals with the mean rate and force of both IMUs, weighted by their noise, in primary axes.

        The noise of this mean is independent of that of the residuals, which are the difference of the IMUs.
        """
        shares = self._noise[0] ** 2 / np.sum(self._noise**2, axis=0)
        C, A = (self._value[matrix].reshape(3, 3) for matrix in (GYRO_MATRIX, ACCEL_MATRIX))
        gyro, accel = (
            share * np.linalg.solve(matrix, residual.T).T
            for share, matrix, residual in zip(shares, (C, A), np.hsplit(self._residual, 2), strict=True)
        )
        return replace(rows, gyro=rows.gyro + gyro, accel=rows.accel + accel)

    def blocks(self, rows: Signals, motion: Motion) -> list[Block]:
        """Return at most `MAX_BLOCKS` longer blocks; `rows` and `motion` contain the whole recording."""
        count, blocks = -(-len(self._parts) // MAX_BLOCKS), []
        C, A = (self._value[matrix].reshape(3, 3) for matrix in (GYRO_MATRIX, ACCEL_MATRIX))
        of_part = partial(_columns, rows, base=rows.accel + rows.lever @ self._value[LEVER], C=C, A=A)
        for b in range(0, len(self._parts), count):
            parts = self._parts[b : b + count]
            part = slice(parts[0].start, parts[-1].stop)
            columns = of_part(part)[:, :, self._fitted] / self.scale[:, None]
            block_motion = Motion(*(values[part] for values in vars(motion).values() if values is not None))
            blocks.append(Block(block_motion, columns, self._residual[part] / self.scale, self._weights[part]))
        return blocks

    def covariance(self) -> FloatArray:
        """Return the jackknife covariance over the blocks, shape (k, k)."""
        return jackknife(self._normals, self.gradient)

    def halves(self) -> float:
        """Return the normalised difference between the solutions of odd and even blocks, see `PairFit.halves`."""
        solutions, covariances = [], []
        for half in (slice(0, None, 2), slice(1, None, 2)):
            normals, gradient = self._normals[half], self.gradient[half]
            solutions.append(np.linalg.solve(normals.sum(axis=0), gradient.sum(axis=0)))
            covariances.append(jackknife(normals, gradient))
        difference = solutions[0] - solutions[1]
        return float(np.mean(difference**2 / np.diag(covariances[0] + covariances[1])))

    def change(self) -> tuple[FloatArray, FloatArray]:
        """Return the change from the first to the second half and its variance, NaN where not compared, shape (28,).

        If a half does not determine all parameters, only the biases are compared, and the other parameters keep their
        values from the whole recording.
        """
        middle = len(self.gradient) // 2
        halves = [(self._normals[part], self.gradient[part]) for part in (slice(0, middle), slice(middle, None))]
        all_columns = np.arange(len(self.normal))
        biases = np.flatnonzero(_BIASES[self._fitted])
        determined = all(_share(normals.sum(axis=0), self.normal) > MIN_SHARE for normals, _ in halves)
        columns = all_columns if determined else biases
        change, variance = np.full(COUNT, np.nan), np.full(COUNT, np.nan)
        indices = np.flatnonzero(self._fitted)[columns]
        if len(columns) and middle > 1:
            parts = [(normals[:, columns][:, :, columns], gradient[:, columns]) for normals, gradient in halves]
            first, second = (np.linalg.solve(n.sum(axis=0), g.sum(axis=0)) for n, g in parts)
            change[indices], variance[indices] = second - first, sum(np.diag(jackknife(n, g)) for n, g in parts)
        return change, variance


def _share(part: FloatArray, whole: FloatArray) -> float:
    """Return the smallest ratio, over all directions, of the information of a part to that of the whole recording."""
    root = np.linalg.cholesky(whole)
    white = np.linalg.solve(root, np.linalg.solve(root, part).T)
    return float(np.linalg.eigvalsh(0.5 * (white + white.T))[0])


def _columns(rows: Signals, part: slice, base: FloatArray, C: FloatArray, A: FloatArray) -> FloatArray:
    """Return the derivatives of the six outputs with respect to the 28 parameters, shape (n, 6, 28)."""
    X = np.zeros((part.stop - part.start, 6, COUNT))
    lever = rows.lever[part]
    for i in range(3):
        X[:, i, GYRO_BIAS][:, i] = 1.0
        X[:, i, GYRO_MATRIX][:, 3 * i : 3 * i + 3] = rows.gyro[part]
        X[:, i, OFFSET] = rows.gyro_slope[part] @ C[i]
        X[:, 3 + i, ACCEL_BIAS][:, i] = 1.0
        X[:, 3 + i, ACCEL_MATRIX][:, 3 * i : 3 * i + 3] = base[part]
        X[:, 3 + i, LEVER] = A[i] @ lever
        X[:, 3 + i, OFFSET] = rows.accel_slope[part] @ A[i]
    return X


def _size(residual: FloatArray) -> float:
    """Return the robust scale of residuals: 1.4826 times the median of their magnitudes."""
    return float(1.4826 * np.median(np.abs(residual - np.median(residual, axis=0)))) if len(residual) else 1.0


def _weights(residual: FloatArray) -> FloatArray:
    """Return Huber weights from the magnitude of the residual relative to its scale, for three axes, shape (n, 3)."""
    length = np.linalg.norm(residual, axis=1) / np.sqrt(3.0)
    return np.repeat(np.minimum(1.0, HUBER_THRESHOLD / np.maximum(length, 1e-12))[:, None], 3, axis=1)


def _white(imu: ImuModel) -> FloatArray:
    """Return the white noise of rate and force of a sample, including quantisation, rad/s and m/s², shape (2,)."""
    walk, step = np.array([imu.gyro_arw, imu.accel_vrw]), np.array(imu.quantisation) * imu.rate_factor
    return np.asarray(np.sqrt(walk**2 * imu.sample_rate + step**2 / 12.0))


def _bias_drift_variances(duration: float, primary: ImuModel, secondary: ImuModel) -> FloatArray:
    """Return the variance of the mean bias drift of both IMUs over a duration, s, for each parameter, shape (28,).

    The variance of the mean of a Gauss-Markov process over T is 2 σ² τ/T (1 − τ/T (1 − e^(−T/τ))).
    """
    T = duration / BIAS_DRIFT_TIME
    share = np.sqrt(2.0 / T * (1.0 - (1.0 - np.exp(-T)) / T)) * BIAS_DRIFT_PER_INSTABILITY
    variances, sensors = np.zeros(COUNT), (share * np.hypot(primary.bias_instability, secondary.bias_instability)) ** 2
    variances[GYRO_BIAS], variances[ACCEL_BIAS] = sensors
    return variances
