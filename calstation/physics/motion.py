"""The kinds of step of a plan; preview, sequencer and simulation interpret them."""

from dataclasses import dataclass
from typing import TypeAlias


@dataclass(frozen=True)
class Prepare:
    """Power, wait for ready, home if not homed, warm up."""


@dataclass(frozen=True)
class Move:
    """Drive both joints to absolute cumulative angles; a whole turn is a move of 2π.

    Attributes
    ----------
    outer, inner : target joint angles, rad, cumulative (never modulo 2π)
    rate : largest joint rate, rad/s
    acceleration : joint acceleration, rad/s²
    label : message id and values for the listener, e.g. ("turn_about", "y", 90)
    """

    outer: float
    inner: float
    rate: float
    acceleration: float
    label: tuple[str | float, ...] = ()


@dataclass(frozen=True)
class Dwell:
    """Rest for `duration` seconds of IMU time after the table has settled."""

    duration: float


@dataclass(frozen=True)
class RoundEnd:
    """A point where a repeated plan may end: `rounds` rounds are complete and the stop rule applies."""

    rounds: int


@dataclass(frozen=True)
class Carry:
    """Have the operator turn both rails of a manual rig to about these angles and leave it at rest.

    Attributes
    ----------
    outer, inner : target rail angles, rad, cumulative
    rest : rest required there, s
    travel_time : expected time to get there, s
    index, count : number of this position, from 1, and of all positions
    """

    outer: float
    inner: float
    rest: float
    travel_time: float
    index: int
    count: int


@dataclass(frozen=True)
class Finish:
    """Move to the load position and switch the axes off."""


Step: TypeAlias = Prepare | Move | Dwell | RoundEnd | Carry | Finish
