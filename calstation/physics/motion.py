"""Types of the steps of a plan, which the preview, the sequencer and the simulation execute."""

from dataclasses import dataclass
from typing import TypeAlias


@dataclass(frozen=True)
class Move:
    """Move both joints to absolute cumulative angles; a full revolution is a move of 2π."""

    outer: float  #: Target angle of the outer joint, rad, cumulative (never modulo 2π).
    inner: float  #: Target angle of the inner joint, rad, cumulative.
    rate: float  #: Largest joint rate, rad/s.
    acceleration: float  #: Joint acceleration, rad/s².
    label: tuple[str | float, ...] = ()  #: Message id and values for progress events, e.g. ("turn_about", "y", 90).


@dataclass(frozen=True)
class Dwell:
    """Rest for `duration` seconds of IMU time after the table has settled."""

    duration: float


@dataclass(frozen=True)
class RoundEnd:
    """End of a round of a repeated plan: `rounds` rounds are complete and the stop rule is evaluated."""

    rounds: int


@dataclass(frozen=True)
class ManualMove:
    """Ask the operator to turn the axes of a manual rig to approximately these angles and leave it at rest."""

    outer: float  #: Target angle of the outer axis, rad, cumulative.
    inner: float  #: Target angle of the inner axis, rad, cumulative.
    rest: float  #: Required rest at the position, s.
    travel_time: float  #: Expected time to reach the position, s.
    index: int  #: Number of this position, from 1.
    count: int  #: Total number of positions.


@dataclass(frozen=True)
class GimbalZero:
    """Return all joints of a gimbal to zero, and lock them for at least `rest` s to measure the gyro bias."""

    rest: float  #: s
    index: int  #: Number of complete axes, 0 at the start.


@dataclass(frozen=True)
class GimbalTurn:
    """Turn about a body axis, unless the axis is complete: rest, turn, rest, then correct the matrix K."""

    axis: int  #: Index of the body axis.
    index: int  #: Number of this turn about the axis, from 1.
    count: int  #: Largest number of turns per axis.
    angle: float  #: Angle of every turn, rad.
    rate: float  #: Rate of every turn, rad/s.
    rest: float  #: Stabilised rest before and after the turn, s.
    gain: float  #: Gain α of the correction, rad/rad.
    threshold: float  #: Drift below which the axis is complete, rad.
    alternate: bool  #: Whether every second turn is in the opposite direction.


@dataclass(frozen=True)
class Soak:
    """Hold the temperature of the chamber, with the table at rest, until the temperature of every unit is steady."""

    temperature: float  #: Temperature of the chamber, °C.
    slope: float  #: Rate of change below which a unit is steady, K/min.
    hold: float  #: Time for which every unit must be steady, s.
    timeout: float  #: Longest duration of the soak, s.
    index: int  #: Number of this soak, from 1; 0 before a verification of registers.
    count: int  #: Total number of soaks.


@dataclass(frozen=True)
class Ramp:
    """Start a ramp of the chamber to a temperature, °C, at a rate, K/min, which continues during the next steps."""

    temperature: float
    rate: float


Step: TypeAlias = Move | Dwell | RoundEnd | ManualMove | GimbalZero | GimbalTurn | Soak | Ramp


def move_time(start: tuple[float, float], move: Move) -> float:
    """Return the duration, s, of a move with trapezoidal or triangular rate from joint angles `start`, rad."""
    rate, acceleration = move.rate, move.acceleration
    distance = max(abs(move.outer - start[0]), abs(move.inner - start[1]))
    if distance * acceleration < rate * rate:
        return float(2.0 * (distance / acceleration) ** 0.5)
    return distance / rate + rate / acceleration
