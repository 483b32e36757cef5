"""Solutions of the samples at several temperatures."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from calstation.estimation.common import Posterior
from calstation.estimation.effects import ModelledEffects
from calstation.estimation.temperature.course import ELEMENT_OF
from calstation.physics import COUNT, FloatArray

Way = Literal["up", "down", "soak"]
#: Smallest information of an observation of parameters, and of an observation of effects alone, relative to the prior.
_INFORMATIVE, _NEGLIGIBLE = 1.0, 1e-6
#: Largest difference of temperatures that count as equal, K.
_SAME = 1.0


@dataclass(frozen=True)
class TemperaturePoint:
    """Solution of the samples at one temperature."""

    temperature: float  #: Mean temperature of the sensor, °C.
    rate: float  #: Mean rate of change, K/s.
    time: float  #: Mean time since the start of the stage, s.
    way: Way  #: Direction from the preceding temperature; "soak" for the first point.
    first_seq: int
    last_seq: int
    prior: Posterior
    posterior: Posterior
    is_held_out: bool = False
    extent: tuple[float, float] | None = None  #: Lowest and highest temperature, °C; None if it did not change.
    #: Mean temperatures of gyros and accelerometers, °C, and their rates, K/s, shape (2, 2); None if they equal the
    #: sensor's.
    elements: FloatArray | None = None
    effects: ModelledEffects | None = None  #: Effects in the model, which `posterior` does not include.
    table_noise: float = 1.0  #: Noise of the table, assumed or measured, relative to its profile.

    @property
    def conditions(self) -> tuple[FloatArray, FloatArray]:
        """Temperature, °C, and rate of change, K/s, of the element of each parameter, shape (30,) each."""
        if self.elements is None:
            return np.full(COUNT, self.temperature), np.full(COUNT, self.rate)
        return self.elements[0, ELEMENT_OF], self.elements[1, ELEMENT_OF]

    def with_effects(self, size: FloatArray, covariance: FloatArray) -> "TemperaturePoint":
        """Return the point with effects of estimated sizes in prior sigmas, (k,), and with their covariance, (k, k)."""
        if self.effects is None:
            return self
        mean, error = self.posterior.mean, self.effects.error
        solved = Posterior(mean + error @ size, self.posterior.covariance + error @ covariance @ error.T)
        return replace(self, posterior=solved)

    def observations(self, scale: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return decorrelated observations of unit variance, and their Jacobians for parameters and effects.

        They have the shapes (n,), (n, 30) and (n, k). `scale` are the sigmas of the prior, 0 for a fixed parameter. The
        observations exclude the prior; the last rows depend on the effects alone.
        """
        free = scale > 0.0
        s = scale[free]
        before, after = (np.linalg.inv(p.covariance[np.ix_(free, free)] / np.outer(s, s)) for p in self._both)
        means = [p.mean[free] / s for p in self._both]
        values, vectors = np.linalg.eigh(after - before)
        kept = values > _INFORMATIVE
        roots = np.sqrt(values[kept])
        observed = vectors[:, kept].T @ (after @ means[1] - before @ means[0]) / roots
        jacobian = np.zeros((len(roots), COUNT))
        jacobian[:, free] = roots[:, None] * vectors[:, kept].T / s
        if self.effects is None:
            return observed, jacobian, np.zeros((len(observed), 0))
        error = self.effects.error[free] / s[:, None]
        by_effects = vectors[:, kept].T @ after @ error / roots[:, None]
        score = self.effects.score - error.T @ after @ means[1] + by_effects.T @ observed
        sizes, directions = np.linalg.eigh(
            self.effects.information + error.T @ after @ error - by_effects.T @ by_effects
        )
        alone = sizes > _NEGLIGIBLE
        root = np.sqrt(sizes[alone])
        return (
            np.append(observed, directions[:, alone].T @ score / root),
            np.vstack([jacobian, np.zeros((len(root), COUNT))]),
            np.vstack([-by_effects, root[:, None] * directions[:, alone].T]),
        )

    @property
    def _both(self) -> tuple[Posterior, Posterior]:
        return self.prior, self.posterior


def different_temperatures(points: Sequence[TemperaturePoint]) -> int:
    """Return the number of different temperatures of the points that are not held out."""
    count, last = 0, -np.inf
    for temperature in sorted(p.temperature for p in points if not p.is_held_out):
        if temperature - last > _SAME:
            count, last = count + 1, temperature
    return count


def nearest_temperature(points: Sequence[TemperaturePoint], temperature: float) -> float:
    """Return the temperature of a point nearest to another temperature, °C."""
    found = np.array([p.temperature for p in points])
    return float(found[np.abs(found - temperature).argmin()])


def held_out_points(points: Sequence[TemperaturePoint], temperatures: Sequence[float]) -> list[TemperaturePoint]:
    """Return the points; mark all at the measured temperature nearest to each held-out temperature."""
    chosen = [nearest_temperature(points, t) for t in temperatures]
    return [replace(p, is_held_out=any(abs(p.temperature - t) <= _SAME for t in chosen)) for p in points]


def with_ways(points: Sequence[TemperaturePoint]) -> list[TemperaturePoint]:
    """Return the points with their directions from the preceding temperature."""
    rows = list(points[:1])
    for before, point in itertools.pairwise(points):
        rows.append(replace(point, way="up" if point.temperature > before.temperature else "down"))
    return rows
