"""Iteration for gyro misalignment from the joints of a stabilised gimbal, updated after every turn.

The gimbal stabilises on corrected rates c = (I + K)⁻¹ (measured − b). Commanded to rotate about one body axis e only,
it rotates about N e, where N = (I + M)⁻¹ (I + K). In a turn by A the other joints drift by D = −J(A) (m − k), where m
and k are the columns of M and K for that axis without its own row. After every turn, with the joints back at zero,

    K_i = K_(i−1) + s α D_i,    s = −1 for a positive turn, +1 for a negative one

so that the error is multiplied by I − s α J. J is not a multiple of the identity, because a tilted body axis rotates
with the body. For the innermost and the outermost joint J(A) = [[sin A, ±(1 − cos A)], [∓(1 − cos A), sin A]] with the
eigenvalues 2 sin(A/2) e^(±iA/2). The iteration is stable for 0 < α < cot(A/2) and converges fastest at half of that,
where each turn reduces the error to sin(A/2) of its value. For A ≥ 180° it is unstable for every gain.
"""

from dataclasses import dataclass, field

import numpy as np

from calstation.physics import AXES, FloatArray, axis_rotation, rotation_matrix

_DERIVATIVE_STEP = 1e-5


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


def others(axis: int) -> list[int]:
    """Return the other two axes."""
    return [k for k in range(3) if k != axis]


def drift_matrix(order: str, axis: int, angle: float) -> FloatArray:
    """Return J, the drift of the other joints per rad of tilt of the axis in a turn by `angle`, rad, shape (2, 2)."""
    rest = others(axis)
    J = np.empty((2, 2))
    for column, lean in enumerate(rest):
        moved = []
        for step in (_DERIVATIVE_STEP, -_DERIVATIVE_STEP):
            direction = np.eye(3)[axis] + step * np.eye(3)[lean]
            moved.append(gimbal_joints(order, rotation_matrix(angle * direction))[rest])
        J[:, column] = (moved[0] - moved[1]) / (2.0 * _DERIVATIVE_STEP)
    return J


def sign_of(angle: float) -> float:
    """Return the sign s of a turn: −1 for a positive turn, +1 for a negative one."""
    return -1.0 if angle > 0.0 else 1.0


def largest_gain(order: str, axis: int, angle: float) -> float:
    """Return the gain below which turns by ± `angle` converge: the smallest 2 Re λ/|λ|² of J; 0 if they never do."""
    limits = []
    for way in (angle, -angle):
        for value in np.linalg.eigvals(-sign_of(way) * drift_matrix(order, axis, way)):
            limits.append(2.0 * value.real / abs(value) ** 2)
    return max(float(min(limits)), 0.0)


def contraction(order: str, axis: int, angle: float, gain: float) -> float:
    """Return the factor per turn by which a turn by `angle` and a turn back reduce an error."""
    both = np.eye(2)
    for way in (angle, -angle):
        both = (np.eye(2) + sign_of(way) * gain * drift_matrix(order, axis, way)) @ both
    return float(np.sqrt(np.abs(np.linalg.eigvals(both)).max()))


@dataclass(frozen=True)
class TurnCommand:
    """A turn about `axis` by `angle`, rad, stabilised with the correction K, shape (3, 3)."""

    axis: int
    angle: float
    correction: FloatArray


@dataclass
class AxisTurns:
    """Turns about one axis: angles, rad; drifts D of the other joints, rad, shape (2,); K after each, shape (2,)."""

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
    alternate: bool = True  #: Whether every second turn is in the opposite direction.
    correction: FloatArray = field(default_factory=lambda: np.zeros((3, 3)), init=False)  #: K, shape (3, 3).
    courses: list[AxisTurns] = field(default_factory=lambda: [AxisTurns(0)], init=False)  #: Axes so far.

    @property
    def done(self) -> bool:
        """Whether the last axis is complete."""
        return len(self.courses) == 3 and self._done(self.courses[-1])

    def next_turn(self) -> TurnCommand | None:
        """Return the next turn, which starts with the joints at zero; None at the end."""
        if self.done:
            return None
        if self._done(self.courses[-1]):
            self.courses.append(AxisTurns(self.courses[-1].axis + 1))
        course = self.courses[-1]
        back = self.alternate and len(course.drifts) % 2 == 1
        return TurnCommand(course.axis, -self.angle if back else self.angle, self.correction.copy())

    def add_drift(self, angle: float, drift: FloatArray) -> None:
        """Correct K by the drift of the other joints, rad, shape (2,), in a turn by `angle`, rad."""
        course = self.courses[-1]
        rows = others(course.axis)
        self.correction[rows, course.axis] += sign_of(angle) * self.gain * drift
        course.angles.append(angle)
        course.drifts.append(np.array(drift))
        course.corrections.append(self.correction[rows, course.axis].copy())

    def _done(self, course: AxisTurns) -> bool:
        if not course.drifts:
            return False
        return len(course.drifts) >= self.count or float(np.abs(course.drifts[-1]).max()) < self.threshold
