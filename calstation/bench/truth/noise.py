"""Random processes of the bench, bias instability and base vibration, with exact discretisation."""

import numpy as np
from scipy.linalg import expm

from calstation.bench.truth.kinematics import compiled
from calstation.physics import FloatArray

#: Correlation times of the bank of processes, s, with ratios of four.
INSTABILITY_TIMES: tuple[float, ...] = (2.0, 8.0, 32.0, 128.0, 512.0, 2048.0)
_SPACING = 4.0

#: Interval at which samples of the base's velocity are uncorrelated, s.
VIBRATION_INTERVAL = 0.1
VIBRATION_DAMPING = 0.2


def instability_variance(instability: FloatArray | float) -> FloatArray:
    """Return the stationary variance of each process of the bank for a bias instability B.

    Processes of equal variance s² whose correlation times have the ratio ρ add up to the two-sided density s²/(2 f ln
    ρ); flicker noise of instability B has B²/(2π f) (IEEE Std 952-1997, C.4), hence s² = B² ln ρ / π and an Allan
    deviation floor of sqrt(2 ln 2 / π) B = 0.664 B.
    """
    return np.asarray(np.square(instability) * (np.log(_SPACING) / np.pi), dtype=np.float64)


def draw_instability(instability: FloatArray, random: np.random.Generator) -> FloatArray:
    """Draw the bank's stationary state, shape (k, m), for B of shape (k,)."""
    sigma = np.sqrt(instability_variance(instability))[:, None]
    return sigma * random.standard_normal((len(instability), len(INSTABILITY_TIMES)))


def instability_steps(instability: FloatArray, interval: float) -> tuple[FloatArray, FloatArray]:
    """Return decay per sample, shape (m,), and driving sigma, shape (k, m), of the bank for B of shape (k,)."""
    decay = np.exp(-interval / np.array(INSTABILITY_TIMES))
    sigma = np.sqrt(instability_variance(instability))[:, None] * np.sqrt(1.0 - decay**2)
    return decay, sigma


def vibration_frequency() -> float:
    """Return the undamped frequency, rad/s, that puts the fourth zero of the velocity autocorrelation at 0.1 s.

    A resonance x'' + 2ζω x' + ω² x = w driven by white noise has the velocity autocorrelation
    e^(−ζωτ)(cos ω_d τ − ζω/ω_d sin ω_d τ) (Crandall & Mark 1963).
    """
    phase = np.arctan2(np.sqrt(1.0 - VIBRATION_DAMPING**2), VIBRATION_DAMPING) + 4.0 * np.pi
    return float(phase / VIBRATION_INTERVAL / np.sqrt(1.0 - VIBRATION_DAMPING**2))


class Vibration:
    """Velocity of the vibrating base along each axis of n, which continues from call to call.

    `velocity_sigma` is the rms velocity, m/s; nothing is drawn if it is 0.
    """

    def __init__(self, velocity_sigma: float, interval: float, random: np.random.Generator) -> None:
        self.active = velocity_sigma > 0.0
        if not self.active:
            return
        # Exact discretisation of (displacement, velocity) over one sample, m and m/s.
        frequency = vibration_frequency()
        rates = np.array([[0.0, 1.0], [-(frequency**2), -2.0 * VIBRATION_DAMPING * frequency]])
        self._transition: FloatArray = expm(rates * interval)
        stationary = velocity_sigma * np.array([1.0 / frequency, 1.0])
        covariance = np.diag(stationary**2)
        driven = covariance - self._transition @ covariance @ self._transition.T
        self._root: FloatArray = np.linalg.cholesky(driven / np.outer(stationary, stationary)) * stationary[:, None]
        self._state = stationary[:, None] * random.standard_normal((2, 3))

    def velocities(self, normals: FloatArray) -> FloatArray:
        """Return velocities at the borders of n samples, m/s, shape (n + 1, 3), from `normals` of shape (n, 6)."""
        return _shake(self._state, self._transition, self._root, normals)


@compiled
def _shake(state: FloatArray, transition: FloatArray, root: FloatArray, normals: FloatArray) -> FloatArray:
    """Return velocities of the base, m/s, shape (n + 1, 3); updates `state`, shape (2, 3)."""
    velocity = np.empty((normals.shape[0] + 1, 3))
    velocity[0] = state[1]
    for n in range(normals.shape[0]):
        for i in range(3):
            x, v = state[0, i], state[1, i]
            first, second = normals[n, 2 * i], normals[n, 2 * i + 1]
            state[0, i] = transition[0, 0] * x + transition[0, 1] * v + root[0, 0] * first
            state[1, i] = transition[1, 0] * x + transition[1, 1] * v + root[1, 0] * first + root[1, 1] * second
            velocity[n + 1, i] = state[1, i]
    return velocity
