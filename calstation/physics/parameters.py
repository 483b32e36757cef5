"""The error model's 30 parameters: names, order, units and matrix elements.

    gyro   measured = (I + M_g) ω + b_g + noise                 M_g full 3×3
    accel  measured = (I + M_a) f + K2 ∘ f² + b_a + noise       M_a lower triangular

Values are relative to the nominal scale of the IMU's profile.
"""

from dataclasses import dataclass

import numpy as np

from calstation.physics.arrays import FloatArray

AXES = "xyz"


@dataclass(frozen=True)
class Parameter:
    """One scalar of the error model."""

    name: str  #: Contract name, e.g. ``gyro_misalign_xy``.
    unit: str  #: SI unit as written in files.
    group: str  #: Name without its axis, e.g. ``gyro_misalign``.
    sensor: str  #: ``gyro``, ``accel`` or ``lever``.
    row: int  #: Of the group's matrix; for vectors the axis index.
    column: int  #: Of the group's matrix; for vectors the axis index.
    prior_sigma: float  #: Standard deviation, in `unit`, when neither a profile nor a log states one.


def _vector(group: str, sensor: str, unit: str, prior_sigma: float) -> list[Parameter]:
    return [Parameter(f"{group}_{a}", unit, group, sensor, i, i, prior_sigma) for i, a in enumerate(AXES)]


def _matrix(group: str, sensor: str, pairs: str, prior_sigma: float) -> list[Parameter]:
    return [
        Parameter(f"{group}_{p}", "rad", group, sensor, AXES.index(p[0]), AXES.index(p[1]), prior_sigma)
        for p in pairs.split()
    ]


#: All parameters in the order of every state vector, file and table.
PARAMETERS: tuple[Parameter, ...] = tuple(
    _vector("gyro_bias", "gyro", "rad/s", 1e-2)
    + _vector("gyro_scale", "gyro", "1", 2e-2)
    + _matrix("gyro_misalign", "gyro", "xy xz yx yz zx zy", 1e-2)
    + _vector("accel_bias", "accel", "m/s²", 0.2)
    + _vector("accel_scale", "accel", "1", 2e-2)
    + _matrix("accel_misalign", "accel", "yx zx zy", 1e-2)
    + _vector("accel_quadratic", "accel", "s²/m", 2e-5)
    + _vector("inner_lever", "lever", "m", 0.1)
    + _vector("outer_lever", "lever", "m", 0.5)
)


@dataclass(frozen=True)
class PairParameter:
    """One scalar of a secondary IMU relative to the primary one, `secondary measured = C · primary + b`."""

    name: str  #: Contract name without the number of the IMU, e.g. ``secondary_gyro_matrix_xy``.
    unit: str  #: SI unit as written in files.
    group: str  #: Name without its axes.
    neutral: float = 0.0  #: Value of a secondary identical to the primary.


#: Parameters of cross-calibration in the order of every table.
PAIR_PARAMETERS: tuple[PairParameter, ...] = (
    *(
        PairParameter(f"secondary_{sensor}_{what}", unit, f"secondary_{sensor}_{kind}", neutral)
        for sensor, bias_unit in (("gyro", "rad/s"), ("accel", "m/s²"))
        for kind, what, unit, neutral in (
            *(("bias", f"bias_{a}", bias_unit, 0.0) for a in AXES),
            *(("matrix", f"matrix_{r}{c}", "1", float(r == c)) for r in AXES for c in AXES),
        )
    ),
    *(PairParameter(f"secondary_lever_{a}", "m", "secondary_lever") for a in AXES),
    PairParameter("clock_offset", "s", "clock_offset"),
)


def pair_name(name: str, number: int) -> str:
    """A pair parameter's name for the IMU `number`; only the third and further IMUs have their number in it."""
    if number == 2:
        return name
    return name.replace("secondary_", f"secondary{number}_", 1) if "secondary" in name else f"{name}{number}"


def pair_parameter(name: str) -> PairParameter | None:
    """The pair parameter of a name with or without IMU number; None if the name is unknown."""
    return _PAIR.get(name.translate(_NO_DIGITS))


_NO_DIGITS = str.maketrans("", "", "0123456789")
_PAIR = {p.name: p for p in PAIR_PARAMETERS}

COUNT = len(PARAMETERS)
NAMES: tuple[str, ...] = tuple(p.name for p in PARAMETERS)
INDEX: dict[str, int] = {name: i for i, name in enumerate(NAMES)}
GROUPS: tuple[str, ...] = tuple(dict.fromkeys(p.group for p in PARAMETERS))


def group_indices(group: str) -> list[int]:
    """Indices of a group's parameters in the parameter vector."""
    return [i for i, p in enumerate(PARAMETERS) if p.group == group]


def group_matrix(values: FloatArray, *groups: str) -> FloatArray:
    """Parameters of `groups` as a matrix, shape (3, 3), zero elsewhere."""
    matrix = np.zeros((3, 3))
    for i, p in enumerate(PARAMETERS):
        if p.group in groups:
            matrix[p.row, p.column] = values[i]
    return matrix


def group_vector(values: FloatArray, group: str) -> FloatArray:
    """Parameters of a three-component group, shape (3,)."""
    return np.asarray(values)[group_indices(group)].astype(np.float64)
