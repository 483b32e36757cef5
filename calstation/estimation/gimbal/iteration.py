"""Iteration for gyro misalignment from the joints of a stabilised gimbal, updated after every turn.

The gimbal stabilises on corrected rates c = (I + K)⁻¹ (measured − b). If a rotation about a body axis e is commanded,
the unit rotates about N e, where N = (I + M)⁻¹ (I + K). In a turn by A from joints at zero, the other joints drift by
D = −J(A) (m − k), where m and k are the columns of M and K for that axis without the diagonal element. After every turn

    K_i = K_(i−1) + s α D_i,    s = −1 for a positive turn, +1 for a negative one

so that the error m − k is multiplied by I + s α J. J is not a multiple of the identity, because a tilted axis of
rotation turns with the body. For the innermost and the outermost joint J(A) = [[sin A, ±(1 − cos A)], [∓(1 − cos A),
sin A]] with the eigenvalues 2 sin(A/2) e^(±iA/2). The iteration is stable for 0 < α < cot(A/2) and converges fastest at
half this limit, where each turn reduces the error to sin(A/2) of its value. For A ≥ 180° it is unstable for every gain.

There is no return to zero between successive turns about one axis. If a turn starts from other joint angles, its drift
is the deviation from the ideal turn about the body axis, and J depends on these angles: an innermost joint at q rotates
J by q. Every drift is therefore converted to the drift of the same turn from zero, so that the same gains are stable.
"""

from dataclasses import dataclass, field

import numpy as np

from calstation.physics import AXES, FloatArray, axis_rotation, rotation_matrix

_DERIVATIVE_STEP = 1e-5
#: Time in addition to the rest for which the joints are locked to measure the gyro bias, s.
BIAS_TIME = 2.0
#: Largest joint angle of a series of turns, rad; at 90° of the middle joint, the outer and inner axes are parallel.
TRAVEL = np.deg2rad(80.0)


def gimbal_attitude(order: str, joints: FloatArray) -> FloatArray:
    """Return C_body^base, shape (3, 3), at joints x, y, z, rad, shape (3,); `order` begins at the base."""
    C = np.eye(3)
    for name in order:
        axis = AXES.index(name)
        C = C @ axis_rotation(np.eye(3)[axis], float(joints[axis]))
    return C


def gimbal_joints(order: str, C: FloatArray) -> FloatArray:
    """Return the joints x, y, z, rad, shape (3,), of an attitude (Tait-Bryan angles); the middle one is within ±90°."""
    a, b, c = (AXES.index(name) for name in order)
    sign = 1.0 if (b - a) % 3 == 1 else -1.0
    joints = np.empty(3)
    joints[b] = np.arcsin(np.clip(sign * C[a, c], -1.0, 1.0))
    joints[a] = np.arctan2(-sign * C[b, c], C[c, c])
    joints[c] = np.arctan2(-sign * C[a, b], C[a, a])
    return joints


def other_axes(axis: int) -> list[int]:
    """Return the indices of the other two axes."""
    return [k for k in range(3) if k != axis]


def joints_after_turn(
    order: str, start: FloatArray, axis: int, angle: float, tilt: FloatArray | None = None
) -> FloatArray:
    """Return the joints x, y, z, rad, shape (3,), after a turn from `start` by `angle` about a body axis.

    Parameters
    ----------
    order : order of the joints from the base to the unit, such as ``zxy``
    start : joints x, y, z before the turn, rad, shape (3,)
    axis : number of the body axis, 0 to 2
    angle : angle of the turn, rad
    tilt : deviation of the axis of rotation from the body axis, rad, shape (3,); zero if None
    """
    direction = np.eye(3)[axis] + (0.0 if tilt is None else tilt)
    return gimbal_joints(order, gimbal_attitude(order, start) @ rotation_matrix(angle * direction))


def drift_matrix(order: str, axis: int, angle: float, start: FloatArray | None = None) -> FloatArray:
    """Return J, the drift of the other joints per rad of axis tilt in a turn by `angle`, rad, shape (2, 2).

    `start` are the joints x, y, z at the start of the turn, rad, shape (3,); zero if None.
    """
    rows, start = other_axes(axis), np.zeros(3) if start is None else start
    J = np.empty((2, 2))
    for column, tilted in enumerate(rows):
        tilt = _DERIVATIVE_STEP * np.eye(3)[tilted]
        plus, minus = (joints_after_turn(order, start, axis, angle, sign * tilt)[rows] for sign in (1.0, -1.0))
        J[:, column] = (plus - minus) / (2.0 * _DERIVATIVE_STEP)
    return J


def correction_sign(angle: float) -> float:
    """Return the sign s of a turn: −1 for a positive turn, +1 for a negative one."""
    return -1.0 if angle > 0.0 else 1.0


def largest_gain(order: str, axis: int, angle: float) -> float:
    """Return the gain below which turns by ± `angle` converge: the smallest 2 Re λ/|λ|² of J; 0 if they never do."""
    limits = []
    for way in (angle, -angle):
        for value in np.linalg.eigvals(-correction_sign(way) * drift_matrix(order, axis, way)):
            limits.append(2.0 * value.real / abs(value) ** 2)
    return max(float(min(limits)), 0.0)


def contraction(order: str, axis: int, angle: float, gain: float) -> float:
    """Return the factor by which each turn, alternately by `angle` and back, multiplies an error on average.

    Parameters
    ----------
    order : order of the joints from the base to the unit, such as ``zxy``
    axis : number of the body axis, 0 to 2
    angle : angle of the turns, rad
    gain : gain with which the drift of each turn corrects K
    """
    both = np.eye(2)
    for way in (angle, -angle):
        both = (np.eye(2) + correction_sign(way) * gain * drift_matrix(order, axis, way)) @ both
    return float(np.sqrt(np.abs(np.linalg.eigvals(both)).max()))


@dataclass(frozen=True)
class TurnCommand:
    """A turn about `axis` by `angle`, rad, stabilised with the correction K, shape (3, 3).

    `home` specifies whether the gimbal returns to zero before the turn.
    """

    axis: int
    angle: float
    correction: FloatArray
    home: bool


@dataclass
class AxisTurns:
    """Turns about one axis: angles, rad, drifts D of the other joints, rad, and K after each turn, shape (2,) each."""

    axis: int
    angles: list[float] = field(default_factory=list)
    drifts: list[FloatArray] = field(default_factory=list)
    corrections: list[FloatArray] = field(default_factory=list)


@dataclass
class GimbalIteration:
    """State of the iteration: provides the next turn and updates the correction from each drift."""

    gain: float  #: Gain α, rad/rad.
    angle: float  #: Angle of every turn, rad.
    count: int  #: Largest number of turns per axis.
    threshold: float  #: |D| below which an axis is complete, rad.
    alternate: bool = True  #: Whether every second turn has the opposite direction.
    travel: float = TRAVEL  #: Largest joint angle, rad; the gimbal returns to zero before a turn beyond it.
    correction: FloatArray = field(default_factory=lambda: np.zeros((3, 3)), init=False)  #: K, shape (3, 3).
    courses: list[AxisTurns] = field(default_factory=list, init=False)  #: Turns of each axis so far, in order.
    position: float = field(default=0.0, init=False)  #: Angle of the joint of the current axis, rad.

    @property
    def done(self) -> bool:
        """Whether the last axis is complete."""
        return len(self.courses) == 3 and self.axis_done

    @property
    def axis_done(self) -> bool:
        """Whether the axis of the last turn is complete."""
        drifts = self.courses[-1].drifts if self.courses else []
        return bool(drifts) and (len(drifts) >= self.count or float(np.abs(drifts[-1]).max()) < self.threshold)

    def next_turn(self) -> TurnCommand | None:
        """Return the next turn; None if all axes are complete."""
        if self.done:
            return None
        axis, count = (self.courses[-1].axis, len(self.courses[-1].drifts)) if self.courses else (0, 0)
        new = self.axis_done
        if new:
            axis, count = axis + 1, 0
        angle = -self.angle if self.alternate and count % 2 == 1 else self.angle
        home = new or abs(self.position + angle) > self.travel
        return TurnCommand(axis, angle, self.correction.copy(), home)

    def at_zero(self) -> None:
        """Record a return of the gimbal to zero."""
        self.position = 0.0

    def add_drift(self, axis: int, angle: float, drift: FloatArray) -> None:
        """Correct K by the drift of the other joints, rad, shape (2,), in a turn about `axis` by `angle`, rad."""
        course = next((c for c in self.courses if c.axis == axis), AxisTurns(axis))
        self.courses = [*(c for c in self.courses if c is not course), course]
        rows = other_axes(axis)
        self.correction[rows, axis] += correction_sign(angle) * self.gain * drift
        self.position += angle
        course.angles.append(angle)
        course.drifts.append(np.array(drift))
        course.corrections.append(self.correction[rows, axis].copy())
