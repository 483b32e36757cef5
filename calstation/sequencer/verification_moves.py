"""The path on which a unit is verified: turns that excite every gyro, rests that excite every accelerometer."""

from dataclasses import dataclass

import numpy as np

from calstation.errors import ConfigurationError
from calstation.physics import INNER, OUTER, UP, FloatArray, JointLimits, Move, TableGeometry
from calstation.sequencer.guard import JOINTS

#: At most, rad/s and rad/s²: the turns take a minute where the table and the unit's span allow it.
RATE, ACCELERATION = np.deg2rad(110.0), np.deg2rad(120.0)

_WHOLE = 2.0 * np.pi
#: Amounts of a turn, the first that travel allows is taken; full turns first, in which an encoder's error cancels.
_AMOUNTS = tuple(np.deg2rad(v) for a in (360.0, 180.0, 90.0, 30.0) for v in (a, -a))

#: By how much the inner joint moves before the outer one turns again, about another axis of the body.
_QUARTERS = tuple(np.deg2rad(v) for a in (90.0, 30.0) for v in (a, -a))

_STOP = np.deg2rad(90.0)
#: A direction of gravity in the body this far from every other is worth a rest.
_NEW = np.deg2rad(20.0)


@dataclass(frozen=True)
class Leg:
    """A move of one joint, part of turn number `turn` or None; `rest` : the unit rests at its end."""

    move: Move
    turn: int | None
    rest: bool


@dataclass(frozen=True)
class Turn:
    """A turn of one joint by `amount`, rad; at rest number `still` earth rate has the same component along its axis."""

    joint: int
    amount: float
    still: int

    @property
    def whole(self) -> bool:
        """Whether it is a full revolution."""
        return abs(abs(self.amount) - _WHOLE) < 1e-9


@dataclass(frozen=True)
class VerificationPath:
    """Poses from `start` (rad), where the first rest is, and back to it."""

    start: tuple[float, float]
    legs: tuple[Leg, ...]
    turns: tuple[Turn, ...]


def verification_path(
    start: tuple[float, float], geometry: TableGeometry, own: JointLimits, fastest: float = np.inf
) -> VerificationPath:
    """The outer joint turns, turns again with the inner one elsewhere, then the inner one turns: all within travel.

    From joint angles `start`, rad, no faster than `fastest`, rad/s, within the limits of the profile and the table's
    `own`. Raises ConfigurationError if a joint cannot turn.
    """
    path = _PathBuilder(start, geometry, own, fastest)
    there = path.amount(OUTER)
    quarter = path.first(INNER, _QUARTERS)
    path.turn(OUTER, there)
    path.go(INNER, quarter)
    path.turn(OUTER, -there)
    # In the opposite direction: a full turn then ends three quarters from the start instead of five.
    path.turn(INNER, -np.sign(quarter) * abs(path.amount(INNER, -np.sign(quarter))))
    path.go(INNER, start[INNER] - path.pose[INNER])
    return VerificationPath(start, tuple(path.legs), tuple(path.turns))


class _PathBuilder:
    """A path under construction."""

    def __init__(self, start: tuple[float, float], geometry: TableGeometry, own: JointLimits, fastest: float) -> None:
        self.pose = list(start)
        self.legs: list[Leg] = []
        self.turns: list[Turn] = []
        self._geometry, self._own = geometry, own
        limits = geometry.limits
        self._rate, self._acceleration = (min(RATE, fastest, *limits.rate), min(ACCELERATION, *limits.acceleration))
        self._rested = [(start, self._up(start))]

    def amount(self, joint: int, sign: float = 0.0) -> float:
        """How far a joint can turn from here, rad; only to the side of `sign` unless it is 0."""
        return self.first(joint, tuple(a for a in _AMOUNTS if sign * a >= 0.0))

    def first(self, joint: int, amounts: tuple[float, ...]) -> float:
        """The first of `amounts` that travel allows from here. Raises ConfigurationError."""
        limits, here = self._geometry.limits, self.pose[joint]
        for amount in amounts:
            if limits.within(joint, here + amount) and self._own.within(joint, here + amount):
                return float(amount)
        angle_deg = float(np.rad2deg(_AMOUNTS[-2]))
        raise ConfigurationError("motion.no_turn", axis=JOINTS[joint], angle_deg=angle_deg)

    def go(self, joint: int, amount: float) -> None:
        """Move a joint without measuring a turn."""
        if abs(amount) > 1e-12:
            self._add(joint, amount, None, self._is_new(self._after(joint, amount)))

    def turn(self, joint: int, amount: float) -> None:
        """Turn a joint, with a rest wherever gravity has a new direction in the body."""
        number, left, step = len(self.turns), amount, float(np.sign(amount) * _STOP)
        stops = range(1, round(abs(amount) / _STOP) + 1)
        if self._still(joint) is None and not any(self._is_new(self._after(joint, k * step)) for k in stops):
            self.legs[-1] = Leg(self.legs[-1].move, self.legs[-1].turn, True)
            self._rest()
        while abs(left) > 1e-12:
            leg = step
            while abs(leg) < abs(left) - 1e-12 and not self._is_new(self._after(joint, leg)):
                leg += step
            leg = leg if abs(leg) < abs(left) else left
            self._add(joint, leg, number, self._is_new(self._after(joint, leg)))
            left -= leg
        still = self._still(joint)
        if still is None:
            raise RuntimeError("a turn without a rest to compare with")
        self.turns.append(Turn(joint, float(amount), still))

    def _still(self, joint: int) -> int | None:
        """The rest at which the other joint stood as it does now, apart from full turns."""
        other = 1 - joint
        for number, (pose, _) in enumerate(self._rested):
            apart = (pose[other] - self.pose[other]) / _WHOLE
            if abs(apart - round(apart)) < 1e-6:
                return number
        return None

    def _add(self, joint: int, amount: float, turn: int | None, rest: bool) -> None:
        self.pose[joint] += amount
        move = Move(self.pose[OUTER], self.pose[INNER], self._rate, self._acceleration, ("verify",))
        self.legs.append(Leg(move, turn, rest))
        if rest:
            self._rest()

    def _rest(self) -> None:
        pose = (self.pose[OUTER], self.pose[INNER])
        self._rested.append((pose, self._up(pose)))

    def _after(self, joint: int, amount: float) -> tuple[float, float]:
        pose = list(self.pose)
        pose[joint] += amount
        return pose[OUTER], pose[INNER]

    def _up(self, pose: tuple[float, float]) -> FloatArray:
        return np.asarray(self._geometry.body_to_home(*pose).T @ UP)

    def _is_new(self, pose: tuple[float, float]) -> bool:
        """Whether gravity has a new axis in the body compared with all rests, or is opposite to the first."""
        up = self._up(pose)
        first, *others = (known for _, known in self._rested)
        return bool(up @ first < np.cos(_NEW)) and all(abs(up @ known) < np.cos(_NEW) for known in others)
