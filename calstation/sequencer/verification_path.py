"""The path of the table for the verification of units, and the data captured along it.

The turns excite every gyro, and the rests every accelerometer.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from calstation.errors import ConfigurationError
from calstation.physics import INNER, JOINTS, OUTER, UP, FloatArray, JointLimits, Move, TableGeometry

#: Maximum rate, rad/s, and acceleration, rad/s².
RATE, ACCELERATION = np.deg2rad(110.0), np.deg2rad(180.0)
#: Maximum fraction of the rate and acceleration limits of the table.
_SPEED_FRACTION = 0.9

_FULL_TURN, _HALF_TURN, _QUARTER_TURN = 2.0 * np.pi, np.pi, 0.5 * np.pi
#: Candidates for the angle of a turn, rad, of which the first one within the travel is used.
_TURN_ANGLES = tuple(np.deg2rad(v) for a in (180.0, 90.0, 30.0) for v in (a, -a))
#: Candidates for a turn without a reference; full turns come first, because the encoder error cancels in them.
_FULL_TURN_ANGLES = (_FULL_TURN, -_FULL_TURN, *_TURN_ANGLES)

#: Candidates for the move of the inner joint, rad, after which the outer joint turns about another body axis.
_INNER_ANGLES = tuple(np.deg2rad(v) for a in (90.0, 30.0) for v in (a, -a))

_LEG_STEP = np.deg2rad(90.0)
#: Minimum angle between gravity in the body frame and its direction at all previous rests for a further rest, rad.
_MIN_NEW_ANGLE = np.deg2rad(20.0)


@dataclass(frozen=True)
class Leg:
    """A move of the path, which may be part of the turn with number `turn` and may be followed by a `rest`.

    If `opposite` is set, the direction of gravity is opposite to that at another rest; a reference omits this rest.
    """

    move: Move
    turn: int | None
    rest: bool
    opposite: bool = False


@dataclass(frozen=True)
class Turn:
    """A turn of a joint by `amount`, rad, along whose axis earth rate has the same value as at rest number `rest`."""

    joint: int
    amount: float
    rest: int

    @property
    def is_full(self) -> bool:
        """Whether the turn is a full revolution."""
        return abs(abs(self.amount) - _FULL_TURN) < 1e-9


@dataclass(frozen=True)
class VerificationPath:
    """A path from joint angles `start` (rad), where the first rest is, back to `start`."""

    start: tuple[float, float]
    legs: tuple[Leg, ...]
    turns: tuple[Turn, ...]

    @property
    def reference(self) -> tuple[Leg, ...]:
        """The legs along which the reference is captured, with the label "reference"."""
        return tuple(replace(leg, move=replace(leg.move, label=("reference",))) for leg in self.legs)

    @property
    def measured(self) -> tuple[Leg, ...]:
        """The legs, except a final leg that only returns to the start."""
        last = self.legs[-1]
        returns = last.turn is None and not last.rest and not last.opposite
        return self.legs[:-1] if returns else self.legs


def verification_path(
    start: tuple[float, float],
    geometry: TableGeometry,
    table_limits: JointLimits,
    max_rate: float = np.inf,
    *,
    compared: bool = True,
) -> VerificationPath:
    """Return a path on which the outer joint turns, turns back at another inner angle, and the inner joint turns.

    Raises ConfigurationError if a joint cannot turn.

    Parameters
    ----------
    start : joint angles at the start, rad
    geometry : geometry of the table with the limits of its profile
    table_limits : travel as set in the table
    max_rate : largest rate, rad/s
    compared : whether the turns are compared with a reference along the same path, so that half turns suffice
    """
    path = _PathBuilder(start, geometry, table_limits, max_rate, _TURN_ANGLES if compared else _FULL_TURN_ANGLES)
    amount_out = path.amount(OUTER)
    quarter = path.first(INNER, _INNER_ANGLES)
    path.turn(OUTER, amount_out)
    path.go(path.extra_quarter(amount_out), quarter)
    path.turn(OUTER, -amount_out)
    # a turn in the opposite direction ends closer to the start
    path.turn(INNER, -np.sign(quarter) * abs(path.amount(INNER, -np.sign(quarter))))
    path.go(start[OUTER] - path.pose[OUTER], start[INNER] - path.pose[INNER])
    return VerificationPath(start, tuple(path.legs), tuple(path.turns))


class _PathBuilder:
    """Builds a path leg by leg."""

    def __init__(
        self,
        start: tuple[float, float],
        geometry: TableGeometry,
        table_limits: JointLimits,
        max_rate: float,
        amounts: tuple[float, ...],
    ) -> None:
        self.pose = list(start)
        self.legs: list[Leg] = []
        self.turns: list[Turn] = []
        self._geometry, self._table_limits, self._amounts = geometry, table_limits, amounts
        rate, acceleration = (_SPEED_FRACTION * v for v in geometry.limits.limited(np.inf, np.inf))
        self._speeds = min(RATE, rate, max_rate), min(ACCELERATION, acceleration)
        self._rest_poses = [(start, self._up(start))]
        self._has_opposite = False

    def amount(self, joint: int, sign: float = 0.0) -> float:
        """Return an angle by which a joint can turn from its current pose, rad, with `sign` unless `sign` is 0."""
        return self.first(joint, tuple(a for a in self._amounts if sign * a >= 0.0))

    def first(self, joint: int, amounts: tuple[float, ...]) -> float:
        """Return the first of `amounts` that the travel allows from the current pose. Raises ConfigurationError."""
        for amount in amounts:
            if self._reaches(joint, amount):
                return float(amount)
        angle_deg = float(np.rad2deg(_TURN_ANGLES[-2]))
        raise ConfigurationError("motion.no_turn", axis=JOINTS[joint], angle_deg=angle_deg)

    def extra_quarter(self, angle: float) -> float:
        """Return the angle of a quarter turn of the outer joint after a turn by `angle`, rad; 0 if there is none.

        After at least half a turn and this quarter, the turn back begins with gravity perpendicular to the inner axis,
        so that it needs no intermediate stop.
        """
        quarter = float(np.sign(angle) * _QUARTER_TURN)
        return quarter if abs(angle) > _HALF_TURN - 1e-9 and self._reaches(OUTER, quarter) else 0.0

    def go(self, outer: float, inner: float) -> None:
        """Move both joints without measuring a turn."""
        if max(abs(outer), abs(inner)) > 1e-12:
            self._add((outer, inner), None)

    def turn(self, joint: int, amount: float) -> None:
        """Turn a joint, and stop wherever gravity has a new direction in the body frame."""
        number, remaining, step = len(self.turns), amount, float(np.sign(amount) * _LEG_STEP)
        direction = np.array([joint == OUTER, joint == INNER], dtype=float)
        stops = range(1, round(abs(amount) / _LEG_STEP) + 1)
        if self._matching_rest(joint) is None and not any(
            self._is_new(self._after(k * step * direction)) for k in stops
        ):
            self.legs[-1] = Leg(self.legs[-1].move, self.legs[-1].turn, True)
            self._rest()
        while abs(remaining) > 1e-12:
            leg = step
            while abs(leg) < abs(remaining) - 1e-12 and not self._needs_rest(self._after(leg * direction)):
                leg += step
            leg = leg if abs(leg) < abs(remaining) else remaining
            self._add(leg * direction, number)
            remaining -= leg
        rest = self._matching_rest(joint)
        if rest is None:
            raise RuntimeError("a turn without a rest to compare with")
        self.turns.append(Turn(joint, float(amount), rest))

    def _matching_rest(self, joint: int) -> int | None:
        """Return the number of the first rest at the current angle of the other joint, modulo full turns, or None."""
        other = 1 - joint
        for number, (pose, _) in enumerate(self._rest_poses):
            difference = (pose[other] - self.pose[other]) / _FULL_TURN
            if abs(difference - round(difference)) < 1e-6:
                return number
        return None

    def _reaches(self, joint: int, amount: float) -> bool:
        to = self.pose[joint] + amount
        return self._geometry.limits.within(joint, to) and self._table_limits.within(joint, to)

    def _add(self, amounts: FloatArray | tuple[float, float], turn: int | None) -> None:
        pose = self._after(amounts)
        rest, opposite = self._is_new(pose), self._is_opposite(pose)
        self.pose = list(pose)
        self.legs.append(Leg(Move(*pose, *self._speeds, ("verify",)), turn, rest, opposite))
        self._has_opposite |= opposite
        if rest:
            self._rest()

    def _rest(self) -> None:
        pose = (self.pose[OUTER], self.pose[INNER])
        self._rest_poses.append((pose, self._up(pose)))

    def _after(self, amounts: FloatArray | tuple[float, float]) -> tuple[float, float]:
        return self.pose[OUTER] + float(amounts[OUTER]), self.pose[INNER] + float(amounts[INNER])

    def _up(self, pose: tuple[float, float]) -> FloatArray:
        return np.asarray(self._geometry.body_to_home(*pose).T @ UP)

    def _needs_rest(self, pose: tuple[float, float]) -> bool:
        return self._is_new(pose) or self._is_opposite(pose)

    def _is_new(self, pose: tuple[float, float]) -> bool:
        """Return whether the line of gravity in the body frame differs from those at all previous rests."""
        return bool(np.abs(self._cosines(pose)).max() < np.cos(_MIN_NEW_ANGLE))

    def _is_opposite(self, pose: tuple[float, float]) -> bool:
        """Return whether gravity is, for the first time, opposite to its direction at a rest."""
        return not self._has_opposite and bool(self._cosines(pose).min() <= -np.cos(_MIN_NEW_ANGLE))

    def _cosines(self, pose: tuple[float, float]) -> FloatArray:
        return np.array([up for _, up in self._rest_poses]) @ self._up(pose)


def overturned_angle(geometry: TableGeometry, outer: float) -> float:
    """Return the outer angle, rad, at which a unit is turned over from `outer` by half a turn or as far as possible."""
    for turn in (_HALF_TURN, -_HALF_TURN, _QUARTER_TURN, -_QUARTER_TURN):
        if geometry.limits.within(OUTER, outer + turn):
            return outer + turn
    return geometry.limits.low[OUTER]


@dataclass(frozen=True)
class JointDrift:
    """Drift of the other joints, rad, shape (2,), in a turn about the body axis `axis` that takes `seconds` s.

    `matrix` is J, the drift in rad per rad of misalignment, shape (2, 2). The drift at rest was measured over `rest` s.
    """

    axis: int
    matrix: FloatArray
    drift: FloatArray
    seconds: float
    rest: float


@dataclass(frozen=True)
class TurnData:
    """A measured turn, its duration, s, and the integral of the output over its legs, rad and m/s, shape (6,)."""

    turn: Turn
    integral: FloatArray
    seconds: float

    @property
    def angle(self) -> FloatArray:
        """Integral of the gyro output, rad, shape (3,)."""
        return self.integral[:3]


@dataclass(frozen=True)
class VerificationData:
    """Output of a unit, captured for verification.

    `rests` contains the means at rest over `seconds` s, gyro in rad/s and accel in m/s², each of shape (6,). `turns`
    are measured on a table, where the last rest is opposite to another one, except in a reference. `carried` contains
    the samples between two rests on a manual rig, shape (n, 6), at intervals of `period` s. On a gimbal there are only
    `drifts`. `reference` contains the same data before the transfer or without the registers applied, or is None.
    `temperature` is measured by the unit at the end of the capture, °C, or None.
    """

    rests: tuple[FloatArray, ...]
    seconds: float
    turns: tuple[TurnData, ...] = ()
    carried: FloatArray = field(default_factory=lambda: np.empty((0, 6)))
    period: float = 0.0
    corrected: bool = False
    reference: "VerificationData | None" = None
    drifts: tuple[JointDrift, ...] = ()
    temperature: float | None = None
