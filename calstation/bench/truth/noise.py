"""Random processes of the bench (bias instability and base vibration) with exact discretisation."""

import numpy as np

from calstation.physics import FloatArray, kernel

#: Correlation times of the bank of processes, s, with ratios of four.
INSTABILITY_TIMES: tuple[float, ...] = (2.0, 8.0, 32.0, 128.0, 512.0, 2048.0)
_SPACING = 4.0

#: Time, s, over which means of the base's velocity have the rms `velocity_sigma` and are uncorrelated.
VIBRATION_INTERVAL = 0.1
#: Decay rate and angular frequency of the vibration, 1/s.
VIBRATION_RATE = 40.0


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


class Vibration:
    """Velocity of the vibrating base along each axis of n, which is continuous over successive calls.

    The autocovariance is s² e^(−aτ) cos aτ. Its first moment ∫ τ r(τ) dτ is zero, so means over times T ≫ 1/a are
    uncorrelated and have the variance s²/(a T). `velocity_sigma` is the rms of such means over `VIBRATION_INTERVAL`,
    m/s; nothing is drawn if it is 0.
    """

    def __init__(self, velocity_sigma: float, interval: float, random: np.random.Generator) -> None:
        self.active = velocity_sigma > 0.0
        if not self.active:
            return
        rms = velocity_sigma * np.sqrt(VIBRATION_RATE * VIBRATION_INTERVAL)
        angle = VIBRATION_RATE * interval
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        self._transition: FloatArray = np.exp(-angle) * turn
        self._root: FloatArray = rms * np.sqrt(-np.expm1(-2.0 * angle)) * np.eye(2)
        self._state = rms * random.standard_normal((2, 3))

    def velocities(self, normals: FloatArray) -> FloatArray:
        """Return velocities at the borders of n samples, m/s, shape (n + 1, 3), from `normals` of shape (n, 6)."""
        return _shake(self._state, self._transition, self._root, normals)


@kernel
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
