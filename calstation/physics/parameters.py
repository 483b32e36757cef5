"""The 30 parameters of the error model (names, order, units and matrix elements), and the order of the 39 error states.

    gyro   measured = (I + M_g) ω + b_g + noise                 M_g full 3×3
    accel  measured = (I + M_a) f + K2 ∘ f² + b_a + noise       M_a lower triangular

Values are relative to the nominal scale in the IMU's profile. The states are φ, δv, δp and the errors of the
parameters, which start at `PARAMETER_START`; the slice of a parameter group refers to a vector of the 30 parameters.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from calstation.physics.arrays import FloatArray

AXES = "xyz"
#: Channels of an IMU, in the order of its samples.
CHANNELS = tuple(f"{sensor}_{axis}" for sensor in ("gyro", "accel") for axis in AXES)

#: Largest ratio of the sigma of an observable parameter or state to its prior sigma.
OBSERVABLE = 0.9


@dataclass(frozen=True)
class Parameter:
    """A scalar parameter of the error model."""

    name: str  #: Public name, e.g. ``gyro_misalign_xy``.
    unit: str  #: SI unit as written in files.
    group: str  #: Name without the axis, e.g. ``gyro_misalign``.
    sensor: str  #: ``gyro``, ``accel`` or ``lever``.
    row: int  #: Row in the matrix of the group; for vectors the axis index.
    column: int  #: Column in the matrix of the group; for vectors the axis index.
    prior_sigma: float  #: Standard deviation, in `unit`, if neither a profile nor a log specifies one.


def _vector(group: str, sensor: str, unit: str, prior_sigma: float) -> list[Parameter]:
    return [Parameter(f"{group}_{a}", unit, group, sensor, i, i, prior_sigma) for i, a in enumerate(AXES)]


def _matrix(group: str, sensor: str, pairs: str, prior_sigma: float) -> list[Parameter]:
    return [
        Parameter(f"{group}_{p}", "rad", group, sensor, AXES.index(p[0]), AXES.index(p[1]), prior_sigma)
        for p in pairs.split()
    ]


#: All parameters, in the order of state vectors, files and tables. The prior sigmas are large enough for consumer MEMS.
PARAMETERS: tuple[Parameter, ...] = tuple(
    _vector("gyro_bias", "gyro", "rad/s", 1e-2)
    + _vector("gyro_scale", "gyro", "1", 0.05)
    + _matrix("gyro_misalign", "gyro", "xy xz yx yz zx zy", 0.05)
    + _vector("accel_bias", "accel", "m/s²", 2.0)
    + _vector("accel_scale", "accel", "1", 0.1)
    + _matrix("accel_misalign", "accel", "yx zx zy", 0.05)
    + _vector("accel_quadratic", "accel", "s²/m", 2e-5)
    + _vector("inner_lever", "lever", "m", 0.1)
    + _vector("outer_lever", "lever", "m", 0.5)
)


COUNT = len(PARAMETERS)
NAMES: tuple[str, ...] = tuple(p.name for p in PARAMETERS)
INDEX: dict[str, int] = {name: i for i, name in enumerate(NAMES)}
GROUPS: tuple[str, ...] = tuple(dict.fromkeys(p.group for p in PARAMETERS))


def group_indices(group: str) -> list[int]:
    """Return the indices of a group in the parameter vector."""
    return [i for i, p in enumerate(PARAMETERS) if p.group == group]


def parameter_indices(name: str) -> list[int]:
    """Return the indices of a parameter or of all parameters of a group; empty for an unknown name."""
    return [INDEX[name]] if name in INDEX else group_indices(name)


def targets_reached(sigma: FloatArray, targets: Mapping[str, float]) -> bool:
    """Return whether no sigma exceeds its target; `sigma` has the shape (30,), SI."""
    return all(sigma[i] <= limit for name, limit in targets.items() for i in parameter_indices(name))


def group_matrix(values: FloatArray, *groups: str) -> FloatArray:
    """Return the parameters of `groups` as a matrix, shape (3, 3), with zeros elsewhere."""
    matrix = np.zeros((3, 3))
    for i, p in enumerate(PARAMETERS):
        if p.group in groups:
            matrix[p.row, p.column] = values[i]
    return matrix


def group_vector(values: FloatArray, group: str) -> FloatArray:
    """Return the parameters of a three-component group, shape (3,)."""
    return np.asarray(values)[group_indices(group)].astype(np.float64)


#: Attitude error φ, velocity error δv and position error δp.
PHI, DV, DP = slice(0, 3), slice(3, 6), slice(6, 9)
#: φ, δv and δp.
NAVIGATION = slice(0, DP.stop)
PARAMETER_START = DP.stop
STATES = PARAMETER_START + COUNT
#: States of the parameters.
PARAMETER_STATES = slice(PARAMETER_START, STATES)

(
    GYRO_BIAS,
    GYRO_SCALE,
    GYRO_MISALIGN,
    ACCEL_BIAS,
    ACCEL_SCALE,
    ACCEL_MISALIGN,
    ACCEL_QUADRATIC,
    INNER_LEVER,
    OUTER_LEVER,
) = (slice(group_indices(group)[0], group_indices(group)[-1] + 1) for group in GROUPS)
#: Parameters on which the angular rate depends.
GYROS = slice(GYRO_BIAS.start, GYRO_MISALIGN.stop)
#: Parameters on which the specific force depends: all but the outer lever arm.
SENSORS = slice(GYRO_BIAS.start, INNER_LEVER.stop)
