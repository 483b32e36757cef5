"""The kinds of step of a plan; preview, sequencer and simulation interpret them."""

from dataclasses import dataclass
from typing import TypeAlias


@dataclass(frozen=True)
class Prepare:
    """Power, wait for ready, home if not homed, warm up."""


@dataclass(frozen=True)
class Move:
    """Drive both joints to absolute cumulative angles; a whole turn is a move of 2π."""

    outer: float  #: Target joint angle, rad, cumulative (never modulo 2π).
    inner: float  #: As `outer`.
    rate: float  #: Largest joint rate, rad/s.
    acceleration: float  #: Joint acceleration, rad/s².
    label: tuple[str | float, ...] = ()  #: Message id and values for the listener, e.g. ("turn_about", "y", 90).


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
    """Have the operator turn both rails of a manual rig to about these angles and leave it at rest."""

    outer: float  #: Target rail angle, rad, cumulative.
    inner: float  #: As `outer`.
    rest: float  #: Rest required there, s.
    travel_time: float  #: Expected time to get there, s.
    index: int  #: Number of this position, from 1.
    count: int  #: Number of all positions.


@dataclass(frozen=True)
class Finish:
    """Move to the load position and switch the axes off."""


Step: TypeAlias = Prepare | Move | Dwell | RoundEnd | Carry | Finish
