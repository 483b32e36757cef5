"""Parameters beyond the 30: of a secondary IMU relative to its primary, and of effects in the model of a unit."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias, TypeVar

from calstation.physics.effects import EFFECTS
from calstation.physics.parameters import AXES, INDEX, PARAMETERS

T = TypeVar("T")


@dataclass(frozen=True)
class FurtherParameter:
    """A scalar parameter that is not one of the 30."""

    name: str  #: Public name without the number of the IMU, e.g. ``secondary_gyro_matrix_xy``.
    unit: str  #: SI unit as written in files.
    group: str  #: Name without the axes.
    neutral: float = 0.0  #: Value for a secondary IMU identical to the primary, or without the effect.


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


#: Effects that the model of a unit may contain as additional states, and their parameters in the order used in tables.
EFFECT_STATES: tuple[str, ...] = tuple(effect.cause for effect in EFFECTS if effect.is_state)
EFFECT_PARAMETERS: tuple[FurtherParameter, ...] = tuple(
    FurtherParameter(name, effect.unit, effect.cause) for effect in EFFECTS if effect.is_state for name in effect.names
)
if TYPE_CHECKING:
    EffectName: TypeAlias = str
else:
    #: One of `EFFECT_STATES`.
    EffectName = Literal[EFFECT_STATES]

#: Group of every parameter by name: the 30, those of a second IMU, and those of effects.
GROUP_BY_NAME: dict[str, str] = {
    **{p.name: p.group for p in PARAMETERS},
    **{p.name: p.group for p in (*PAIR_PARAMETERS, *EFFECT_PARAMETERS)},
}

_NO_DIGITS = str.maketrans("", "", "0123456789")
_FURTHER = {p.name: p for p in (*PAIR_PARAMETERS, *EFFECT_PARAMETERS)}


def pair_name(name: str, number: int) -> str:
    """Return the name of a pair parameter of IMU `number`; from the third IMU on, the name contains the number."""
    if number == 2:
        return name
    return name.replace("secondary_", f"secondary{number}_", 1) if "secondary" in name else f"{name}{number}"


def further_parameter(name: str) -> FurtherParameter | None:
    """Return the further parameter with a name, which may contain an IMU number; None if the name is unknown."""
    return _FURTHER.get(name.translate(_NO_DIGITS))


def group_of(name: str) -> str:
    """Return the group of a parameter, one of the 30 or a further one; the name itself if it is unknown."""
    parameter = PARAMETERS[INDEX[name]] if name in INDEX else further_parameter(name)
    return name if parameter is None else parameter.group


def entry_of(entries: Mapping[str, T], name: str) -> T | None:
    """Return the entry of a parameter, or of its group, from entries by name; None if there is neither."""
    return entries.get(name, entries.get(group_of(name)))
