"""The 30 parameters of the error model: names, order, units and matrix elements.

    gyro   measured = (I + M_g) ω + b_g + noise                 M_g full 3×3
    accel  measured = (I + M_a) f + K2 ∘ f² + b_a + noise       M_a lower triangular

Values are relative to the nominal scale in the IMU's profile.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, TypeVar

import numpy as np

from calstation.physics.arrays import FloatArray

T = TypeVar("T")

AXES = "xyz"
#: Channels of an IMU, in the order of its samples.
CHANNELS = tuple(f"{sensor}_{axis}" for sensor in ("gyro", "accel") for axis in AXES)

#: A parameter or state is observable when its sigma is below this fraction of its prior sigma.
OBSERVABLE = 0.9


@dataclass(frozen=True)
class Parameter:
    """A scalar parameter of the error model."""

    name: str  #: Contract name, e.g. ``gyro_misalign_xy``.
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


#: All parameters, in the order used in state vectors, files and tables.
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
class FurtherParameter:
    """A scalar parameter that is not one of the 30."""

    name: str  #: Contract name without the number of the IMU, e.g. ``secondary_gyro_matrix_xy``.
    unit: str  #: SI unit as written in files.
    group: str  #: Name without the axes.
    neutral: float = 0.0  #: Value for a secondary that is identical to the primary.


#: Parameters of a secondary IMU relative to the primary, `secondary measured = C · primary + b`, in table order.
PAIR_PARAMETERS: tuple[FurtherParameter, ...] = (
    *(
        FurtherParameter(f"secondary_{sensor}_{what}", unit, f"secondary_{sensor}_{kind}", neutral)
        for sensor, bias_unit in (("gyro", "rad/s"), ("accel", "m/s²"))
        for kind, what, unit, neutral in (
            *(("bias", f"bias_{a}", bias_unit, 0.0) for a in AXES),
            *(("matrix", f"matrix_{r}{c}", "1", float(r == c)) for r in AXES for c in AXES),
        )
    ),
    *(FurtherParameter(f"secondary_lever_{a}", "m", "secondary_lever") for a in AXES),
    FurtherParameter("clock_offset", "s", "clock_offset"),
)


_PAIRS = tuple(f"{a}{b}" for a in AXES for b in AXES if a != b)

EffectName = Literal["g_sensitivity", "gyro_asymmetry", "accel_cubic", "accel_cross", "accel_off_axis", "time_skew"]

#: Parameters of effects that a unit's model may contain beyond the 30: SI unit, components and expected sigma.
EFFECTS: dict[EffectName, tuple[str, tuple[str, ...], float]] = {
    "g_sensitivity": ("rad·s/m", tuple(f"{a}{b}" for a in AXES for b in AXES), 1e-4),
    "gyro_asymmetry": ("1", tuple(AXES), 1e-2),
    "accel_cubic": ("s⁴/m²", tuple(AXES), 1e-5),
    "accel_cross": ("s²/m", _PAIRS, 1e-4),
    "accel_off_axis": ("m", tuple(AXES), 0.1),
    "time_skew": ("s", ("",), 0.02),
}

#: The parameters of all these effects, in the order used in tables.
EFFECT_PARAMETERS: tuple[FurtherParameter, ...] = tuple(
    FurtherParameter(f"{effect}_{component}".rstrip("_"), unit, effect)
    for effect, (unit, components, _) in EFFECTS.items()
    for component in components
)


def pair_name(name: str, number: int) -> str:
    """Return the name of a pair parameter for IMU `number`; the name contains the number from the third IMU on."""
    if number == 2:
        return name
    return name.replace("secondary_", f"secondary{number}_", 1) if "secondary" in name else f"{name}{number}"


def further_parameter(name: str) -> FurtherParameter | None:
    """Return the parameter outside the 30 with a name, which may contain an IMU number; None if the name is unknown."""
    return _FURTHER.get(name.translate(_NO_DIGITS))


def group_of(name: str) -> str:
    """Return the group of a parameter, one of the 30 or a further one; the name itself if it is unknown."""
    parameter = PARAMETERS[INDEX[name]] if name in INDEX else further_parameter(name)
    return name if parameter is None else parameter.group


def entry_of(entries: Mapping[str, T], name: str) -> T | None:
    """Return the entry for a parameter from entries by parameter or group name: its own, or else its group's."""
    return entries.get(name, entries.get(group_of(name)))


_NO_DIGITS = str.maketrans("", "", "0123456789")
_FURTHER = {p.name: p for p in (*PAIR_PARAMETERS, *EFFECT_PARAMETERS)}

COUNT = len(PARAMETERS)
NAMES: tuple[str, ...] = tuple(p.name for p in PARAMETERS)
INDEX: dict[str, int] = {name: i for i, name in enumerate(NAMES)}
GROUPS: tuple[str, ...] = tuple(dict.fromkeys(p.group for p in PARAMETERS))


def group_indices(group: str) -> list[int]:
    """Return the indices of a group in the parameter vector."""
    return [i for i, p in enumerate(PARAMETERS) if p.group == group]


def named(name: str) -> list[int]:
    """Return the indices of a parameter or of all parameters of a group; empty for an unknown name."""
    return [INDEX[name]] if name in INDEX else group_indices(name)


def reached(sigma: FloatArray, targets: Mapping[str, float]) -> bool:
    """Return whether every element of `sigma` (shape (30,), SI) with a target is at or below it."""
    return all(sigma[i] <= limit for name, limit in targets.items() for i in named(name))


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
