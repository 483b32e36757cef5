"""Two-axis table geometry for arbitrary axis directions: attitudes, and body-axis turns as joint moves."""

from dataclasses import dataclass

import numpy as np

from calstation.physics.arrays import FloatArray


@dataclass(frozen=True)
class JointLimits:
    """Travel, rate and acceleration limits of the joints, outer then inner; rad, rad/s, rad/s²."""

    low: tuple[float, float] = (-np.inf, -np.inf)
    high: tuple[float, float] = (np.inf, np.inf)
    rate: tuple[float, float] = (np.inf, np.inf)
    acceleration: tuple[float, float] = (np.inf, np.inf)


@dataclass(frozen=True)
class TableGeometry:
    """Axes in b at home (both joints 0), heading of +y at home, and limits."""

    outer_axis: tuple[float, float, float] = (1.0, 0.0, 0.0)
    inner_axis: tuple[float, float, float] = (0.0, 0.0, 1.0)
    limits: JointLimits = JointLimits()

    def body_to_home(self, outer: float, inner: float) -> FloatArray:
        """Rotation from b to b at home for joint angles in rad, shape (3, 3)."""
        raise NotImplementedError
