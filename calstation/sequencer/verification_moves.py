"""Motion path for verifying a unit: turns that excite every gyro and rests that excite every accelerometer."""

from dataclasses import dataclass

import numpy as np

from calstation.errors import ConfigurationError
from calstation.physics import INNER, JOINTS, OUTER, UP, FloatArray, JointLimits, Move, TableGeometry

#: Maximum rate, rad/s, and acceleration, rad/s²; the turns take a minute if the table and the unit's range allow it.
RATE, ACCELERATION = np.deg2rad(110.0), np.deg2rad(120.0)

_FULL_TURN = 2.0 * np.pi
#: Candidate turn angles, rad; the first that travel allows is used. Full turns come first, because the encoder error
#: cancels in them.
_AMOUNTS = tuple(np.deg2rad(v) for a in (360.0, 180.0, 90.0, 30.0) for v in (a, -a))

#: Candidate moves of the inner joint before the outer one turns again about another body axis, rad.
_QUARTERS = tuple(np.deg2rad(v) for a in (90.0, 30.0) for v in (a, -a))

_LEG_STEP = np.deg2rad(90.0)
#: Minimum angle between a new gravity direction in the body frame and all previous ones for a rest there, rad.
_NEW_UP = np.deg2rad(20.0)


@dataclass(frozen=True)
class Leg:
    """A move of one joint; `turn` is the number of its turn, or None; if `rest`, the unit rests at its end."""

    move: Move
    turn: int | None
    rest: bool


@dataclass(frozen=True)
class Turn:
    """A turn of one joint by `amount`, rad; earth rate along its axis is the same as at rest number `still`."""

    joint: int
    amount: float
    still: int

    @property
    def whole(self) -> bool:
        """Whether the turn is a full revolution."""
        return abs(abs(self.amount) - _FULL_TURN) < 1e-9


@dataclass(frozen=True)
class VerificationPath:
    """A path from joint angles `start` (rad), where the first rest is, back to `start`."""

    start: tuple[float, float]
    legs: tuple[Leg, ...]
    turns: tuple[Turn, ...]


def verification_path(
    start: tuple[float, float], geometry: TableGeometry, own: JointLimits, fastest: float = np.inf
) -> VerificationPath:
    """Return a path: the outer joint turns, turns back at another inner angle, then the inner joint turns.

    The path starts at joint angles `start`, rad, is no faster than `fastest`, rad/s, and stays within the limits of the
    profile and the table's `own` limits. Raises ConfigurationError if a joint cannot turn.
    """
    path = _PathBuilder(start, geometry, own, fastest)
    there = path.amount(OUTER)
    quarter = path.first(INNER, _QUARTERS)
    path.turn(OUTER, there)
    path.go(INNER, quarter)
    path.turn(OUTER, -there)
    # In the opposite direction, a full turn ends three quarters of a turn from the start instead of five.
    path.turn(INNER, -np.sign(quarter) * abs(path.amount(INNER, -np.sign(quarter))))
    path.go(INNER, start[INNER] - path.pose[INNER])
    return VerificationPath(start, tuple(path.legs), tuple(path.turns))


class _PathBuilder:
    """Builds a path leg by leg."""

    def __init__(self, start: tuple[float, float], geometry: TableGeometry, own: JointLimits, fastest: float) -> None:
        self.pose = list(start)
        self.legs: list[Leg] = []
        self.turns: list[Turn] = []
        self._geometry, self._own = geometry, own
        self._speeds = geometry.limits.limited(min(RATE, fastest), ACCELERATION)
        self._rested = [(start, self._up(start))]

    def amount(self, joint: int, sign: float = 0.0) -> float:
        """Return how far a joint can turn from here, rad; only in the direction of `sign` unless it is 0."""
        return self.first(joint, tuple(a for a in _AMOUNTS if sign * a >= 0.0))

    def first(self, joint: int, amounts: tuple[float, ...]) -> float:
        """Return the first of `amounts` that travel allows from here. Raises ConfigurationError."""
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
        """Turn a joint, with a rest wherever gravity has a new direction in the body frame."""
        number, left, step = len(self.turns), amount, float(np.sign(amount) * _LEG_STEP)
        stops = range(1, round(abs(amount) / _LEG_STEP) + 1)
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
        """Return the number of the first rest with the other joint's current angle, modulo full turns, or None."""
        other = 1 - joint
        for number, (pose, _) in enumerate(self._rested):
            apart = (pose[other] - self.pose[other]) / _FULL_TURN
            if abs(apart - round(apart)) < 1e-6:
                return number
        return None

    def _add(self, joint: int, amount: float, turn: int | None, rest: bool) -> None:
        self.pose[joint] += amount
        move = Move(self.pose[OUTER], self.pose[INNER], *self._speeds, ("verify",))
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
        """Whether gravity has a new axis in the body frame, or is opposite to that of the first rest."""
        up = self._up(pose)
        first, *others = (known for _, known in self._rested)
        return bool(up @ first < np.cos(_NEW_UP)) and all(abs(up @ known) < np.cos(_NEW_UP) for known in others)
