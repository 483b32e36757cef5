"""Geometry of a two-axis table with arbitrary axes: attitudes, and joint moves that rotate about a body axis.

`C_bn = Rz(-azimuth) · R(outer_axis, outer) · R(inner_axis, inner) · orientation`. The joint angles that point a body
direction upward solve Paden-Kahan subproblem 2 (Murray, Li, Sastry, *A Mathematical Introduction to Robotic
Manipulation*, 1994, 3.3).
"""

from dataclasses import dataclass, field
from itertools import product

import numpy as np

from calstation.errors import ConfigurationError
from calstation.physics.arrays import FloatArray
from calstation.physics.parameters import AXES
from calstation.physics.rotation import angle_about, axis_rotation

UP = np.array([0.0, 0.0, 1.0])
OUTER, INNER = 0, 1
#: Names of the joints in messages, files and the message catalogue.
JOINTS = ("outer", "inner")

#: Standard deviation of the distance between the axes of a table whose profile does not state it, m.
AXIS_OFFSET_SIGMA = 5e-4

#: A rotation matrix by rows.
Orientation = tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]]
#: Orientation of a unit aligned with the platform axes, and its name.
DEFAULT_ORIENTATION = "+x+z"
ALIGNED: Orientation = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
#: Names of the 24 right-angled orientations of a unit: its body axes along x and z of the platform.
ORIENTATIONS = tuple(f"{x}{a}{z}{b}" for x, a, z, b in product("+-", "xyz", "+-", "xyz") if a != b)

#: Largest permitted angle between the achieved and the requested direction, rad.
_MAX_DEVIATION = np.deg2rad(5.0)


@dataclass(frozen=True)
class JointLimits:
    """Travel (rad), rate (rad/s) and acceleration (rad/s²) limits of the outer and the inner joint."""

    low: tuple[float, float] = (-np.inf, -np.inf)
    high: tuple[float, float] = (np.inf, np.inf)
    rate: tuple[float, float] = (np.inf, np.inf)
    acceleration: tuple[float, float] = (np.inf, np.inf)

    def within(self, joint: int, angle: float) -> bool:
        """Return whether `angle`, rad, is within the travel of the joint, with a tolerance of 1e-9 rad for rounding."""
        return self.low[joint] - 1e-9 <= angle <= self.high[joint] + 1e-9

    def limited(self, rate: float, acceleration: float) -> tuple[float, float]:
        """Return a rate, rad/s, and an acceleration, rad/s², reduced to the limits of both joints."""
        return min(rate, *self.rate), min(acceleration, *self.acceleration)


@dataclass(frozen=True)
class BodyTurn:
    """Joint motion that rotates about a body axis."""

    joint: int  #: Index of the joint: 0 outer, 1 inner.
    sign: int  #: Joint rotation per body rotation, ±1.
    inner: float | None  #: Inner angle required for the rotation, rad; None for any angle.


@dataclass(frozen=True)
class GimbalJoints:
    """Joints of a gimbal: order from base to body, travel (low, high) of x, y, z, rad, and largest rate, rad/s."""

    order: str
    travel: tuple[tuple[float, float], tuple[float, float], tuple[float, float]]
    rate: float

    def outside(self, joints: FloatArray) -> int | None:
        """Return the index of the first joint outside its travel at angles `joints`, rad, shape (3,), or None."""
        is_outside = [not low <= q <= high for q, (low, high) in zip(joints, self.travel, strict=True)]
        return is_outside.index(True) if any(is_outside) else None


@dataclass(frozen=True)
class TableGeometry:
    """Axes of a two-axis table, expressed in platform axes at home (both joints 0), and its limits.

    A unit with the default orientation is aligned with the platform axes.
    """

    outer_axis: tuple[float, float, float] = (1.0, 0.0, 0.0)
    inner_axis: tuple[float, float, float] = (0.0, 0.0, 1.0)
    limits: JointLimits = field(default_factory=JointLimits)
    gimbal: GimbalJoints | None = None  #: None for a table.
    orientation: Orientation = ALIGNED  #: Rotation from b to the platform's axes.

    def body_to_home(self, outer: float, inner: float) -> FloatArray:
        """Return the rotation from b at given joint angles, rad, to the platform's axes at home, shape (3, 3)."""
        rotation = axis_rotation(self.outer_axis, outer) @ axis_rotation(self.inner_axis, inner)
        return rotation if self.orientation == ALIGNED else rotation @ np.array(self.orientation)

    def body_to_level(self, outer: float, inner: float, azimuth: float) -> FloatArray:
        """Return `C_bn` (ENU), shape (3, 3), at joint angles and heading of platform +y at home, rad.

        Parameters
        ----------
        outer, inner : joint angles, rad
        azimuth : heading of platform +y at home, rad, clockwise from north
        """
        return axis_rotation((0.0, 0.0, 1.0), -azimuth) @ self.body_to_home(outer, inner)

    def nearest(self, joint: int, angle: float, near: float) -> float:
        """Return the angle nearest to `near` that equals `angle`, rad, plus full turns and is within the travel.

        Raises ConfigurationError if there is none.
        """
        turn = 2.0 * np.pi
        reachable = np.clip(near, self.limits.low[joint], self.limits.high[joint])
        best = angle + turn * np.round((reachable - angle) / turn)
        candidates = [best + k * turn for k in (0, 1, -1)]
        for candidate in sorted(candidates, key=lambda c: abs(c - near)):
            if self.limits.within(joint, candidate):
                return float(candidate)
        raise ConfigurationError(
            "plan.angle_out_of_travel",
            axis=JOINTS[joint],
            angle_deg=float(np.rad2deg(angle)),
            low_deg=float(np.rad2deg(self.limits.low[joint])),
            high_deg=float(np.rad2deg(self.limits.high[joint])),
        )

    def pose_up(self, direction: FloatArray, near: tuple[float, float]) -> tuple[float, float]:
        """Return the joint angles, rad, closest to `near`, that point a body direction upward.

        Raises ConfigurationError if the axes cannot achieve this within 5°.
        """
        return self._platform_up(self._on_platform(direction), near)

    def _platform_up(self, p: FloatArray, near: tuple[float, float]) -> tuple[float, float]:
        """Return the joint angles as `pose_up` does, for a unit vector in platform axes."""
        w1, w2 = np.array(self.outer_axis), np.array(self.inner_axis)
        solutions = []
        for c in _circle_intersections(w1, w2, p, UP):
            inner = near[INNER] if _parallel(p, w2) else angle_about(w2, p, c)
            on_circle = axis_rotation(self.inner_axis, inner) @ p
            outer = near[OUTER] if _parallel(on_circle, w1) else angle_about(w1, on_circle, UP)
            rotation = axis_rotation(self.outer_axis, outer) @ axis_rotation(self.inner_axis, inner)
            if np.arccos(np.clip((rotation @ p) @ UP, -1.0, 1.0)) < _MAX_DEVIATION:
                pose = (self.nearest(OUTER, outer, near[OUTER]), self.nearest(INNER, inner, near[INNER]))
                solutions.append(pose)
        if not solutions:
            raise ConfigurationError("plan.direction_not_upward", direction=np.round(p, 3).tolist())
        return min(solutions, key=lambda s: (abs(s[0] - near[0]) + abs(s[1] - near[1]), s))

    def body_turn(self, axis: FloatArray, near_inner: float) -> BodyTurn:
        """Return the joint motion that rotates about body direction `axis`, at the inner angle closest to `near_inner`.

        Angles are in rad. Raises ConfigurationError if neither joint axis can be aligned with the direction within 5°.
        """
        a = self._on_platform(axis)
        w1, w2 = np.array(self.outer_axis), np.array(self.inner_axis)
        if _parallel(a, w2):
            return BodyTurn(INNER, 1 if a @ w2 > 0.0 else -1, None)
        options = []
        for sign in (1, -1):
            inner = angle_about(w2, a, sign * w1)
            if axis_rotation(self.inner_axis, inner) @ a @ (sign * w1) > np.cos(_MAX_DEVIATION):
                options.append(BodyTurn(OUTER, sign, self.nearest(INNER, inner, near_inner)))
        if not options:
            raise ConfigurationError("plan.no_axis_along", direction=np.round(a, 3).tolist())
        return min(options, key=lambda o: (abs((o.inner or 0.0) - near_inner), -o.sign))

    def level_inner(self, near: tuple[float, float]) -> float:
        """Return the outer angle, rad, nearest `near`, that makes the inner axis horizontal.

        Gravity then makes rotations about the inner axis observable. Return the outer angle of `near` if there is no
        such angle.
        """
        w1, w2 = np.array(self.outer_axis), np.array(self.inner_axis)
        # height of R(w1, o) w2 = a + b cos o + c sin o
        a, b, c = w1[2] * (w1 @ w2), w2[2] - w1[2] * (w1 @ w2), np.cross(w1, w2)[2]
        size = float(np.hypot(b, c))
        if size < 1e-6 or abs(a) > size:
            return near[OUTER]
        middle, half = float(np.arctan2(c, b)), float(np.arccos(-a / size))
        options = [self.nearest(OUTER, middle + s * half, near[OUTER]) for s in (1.0, -1.0)]
        return min(options, key=lambda o: (abs(o - near[OUTER]), -o))

    def vertical_joint(self, near: tuple[float, float]) -> tuple[int, tuple[float, float]]:
        """Return the joint that rotates about the vertical, and the pose (outer, inner) for this rotation, rad."""
        if _parallel(np.array(self.outer_axis), UP):
            return OUTER, near
        return INNER, self._platform_up(np.array(self.inner_axis) / np.linalg.norm(self.inner_axis), near)

    def _on_platform(self, direction: FloatArray) -> FloatArray:
        """Return the unit vector along a body direction in platform axes."""
        unit = direction / np.linalg.norm(direction)
        return np.asarray(unit if self.orientation == ALIGNED else np.array(self.orientation) @ unit)


def orientation_matrix(name: str) -> Orientation:
    """Return the rotation from b to the platform's axes for one of `ORIENTATIONS`."""
    x, z = (np.eye(3)[AXES.index(axis[1])] * (1.0 if axis[0] == "+" else -1.0) for axis in (name[:2], name[2:]))
    rows = (x, np.cross(z, x), z)
    return tuple(tuple(float(part) + 0.0 for part in row) for row in rows)  # type: ignore[return-value]


def _parallel(a: FloatArray, b: FloatArray) -> bool:
    return bool(abs(a @ b) > np.cos(np.deg2rad(0.5)) * np.linalg.norm(a) * np.linalg.norm(b))


def _circle_intersections(w1: FloatArray, w2: FloatArray, p: FloatArray, q: FloatArray) -> list[FloatArray]:
    """Return the intersections, unit vectors, of the circles of p about w2 and q about w1, or their closest points."""
    d = float(w1 @ w2)
    alpha = (d * (w2 @ p) - w1 @ q) / (d * d - 1.0)
    beta = (d * (w1 @ q) - w2 @ p) / (d * d - 1.0)
    normal = np.cross(w1, w2)
    gamma2 = (1.0 - alpha**2 - beta**2 - 2.0 * alpha * beta * d) / (normal @ normal)
    gamma = np.sqrt(max(float(gamma2), 0.0))
    base = alpha * w1 + beta * w2
    return [base + gamma * normal, base - gamma * normal]
