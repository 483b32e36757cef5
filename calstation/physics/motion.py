"""The few kinds of step a plan is made of: data, interpreted by preview, sequencer and simulation alike."""

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
    """A place where a repeated plan may end: `rounds` are complete, the stop rule is asked."""

    rounds: int


@dataclass(frozen=True)
class Carry:
    """Have the operator bring both rails of a manual rig to about these angles, and let go until it has rested.

    Attributes
    ----------
    outer, inner : rail angles asked for, rad, cumulative
    rest : how long it is to rest there, s
    way : what bringing it there is likely to take, s
    index, count : which position it is, from 1, and of how many
    """

    outer: float
    inner: float
    rest: float
    way: float
    index: int
    count: int


@dataclass(frozen=True)
class Finish:
    """Drive to the load angle and switch the axes off."""


Step: TypeAlias = Prepare | Move | Dwell | RoundEnd | Carry | Finish
