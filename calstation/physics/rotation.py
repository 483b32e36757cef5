"""Rotation algebra: cross-product matrices, rotation vectors and directions."""

import math

import numpy as np

from calstation.physics.arrays import FloatArray
from calstation.physics.kernels import kernel


def skew(v: FloatArray) -> FloatArray:
    """Return the cross-product matrix, `skew(v) @ u == cross(v, u)`, shape (3, 3)."""
    x, y, z = v
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def _rodrigues(x: float, y: float, z: float) -> FloatArray:
    """Return the rotation matrix of the rotation vector (x, y, z), rad, shape (3, 3) (Rodrigues' formula)."""
    angle2 = x * x + y * y + z * z
    if angle2 < 1e-12:
        a, b = 1.0 - angle2 / 6.0, 0.5 - angle2 / 24.0
    else:
        angle = math.sqrt(angle2)
        a, b = math.sin(angle) / angle, (1.0 - math.cos(angle)) / angle2
    C = np.empty((3, 3))
    C[0, 0] = 1.0 - b * (y * y + z * z)
    C[1, 1] = 1.0 - b * (x * x + z * z)
    C[2, 2] = 1.0 - b * (x * x + y * y)
    C[0, 1], C[1, 0] = b * x * y - a * z, b * x * y + a * z
    C[0, 2], C[2, 0] = b * x * z + a * y, b * x * z - a * y
    C[1, 2], C[2, 1] = b * y * z - a * x, b * y * z + a * x
    return C


_compiled_rodrigues = kernel(_rodrigues)


@kernel
def rotation_matrix(rotvec: FloatArray) -> FloatArray:
    """Return the rotation matrix of a rotation vector, rad, shape (3, 3)."""
    return np.asarray(_compiled_rodrigues(rotvec[0], rotvec[1], rotvec[2]))


@kernel
def rotate(rotvec: FloatArray, C: FloatArray) -> None:
    """Multiply C, shape (3, 3), in place from the left by the rotation matrix of a rotation vector, rad."""
    R = _compiled_rodrigues(rotvec[0], rotvec[1], rotvec[2])
    for j in range(3):
        x, y, z = C[0, j], C[1, j], C[2, j]
        for i in range(3):
            C[i, j] = R[i, 0] * x + R[i, 1] * y + R[i, 2] * z


def axis_rotation(axis: FloatArray | tuple[float, float, float], angle: float) -> FloatArray:
    """Return the right-handed rotation by `angle`, rad, about a unit `axis`, shape (3, 3)."""
    x, y, z = axis
    # not compiled, because loading the first compiled function delays the start of a program by most of a second
    return _rodrigues(float(x) * angle, float(y) * angle, float(z) * angle)


def axis_rotations(axis: FloatArray | tuple[float, float, float], angles: FloatArray) -> FloatArray:
    """Return the right-handed rotations by `angles`, rad, shape (n,), about a unit `axis`, shape (n, 3, 3)."""
    K = skew(np.asarray(axis, np.float64))
    angles = angles[:, None, None]
    return np.asarray(np.eye(3) + np.sin(angles) * K + (1.0 - np.cos(angles)) * (K @ K))


@kernel
def rotation_vector(C: FloatArray) -> FloatArray:
    """Return the rotation vector, rad, shape (3,), of a rotation matrix, for angles up to π."""
    v = np.array([C[2, 1] - C[1, 2], C[0, 2] - C[2, 0], C[1, 0] - C[0, 1]])
    sine = 0.5 * np.sqrt(v[0] ** 2 + v[1] ** 2 + v[2] ** 2)
    cosine = 0.5 * (C[0, 0] + C[1, 1] + C[2, 2] - 1.0)
    if sine < 1e-9:
        if cosine > 0.0:
            v *= 0.5
            return v
        k = 0
        for i in range(1, 3):
            if C[i, i] > C[k, k]:
                k = i
        axis = C[:, k].copy()
        axis[k] += 1.0
        axis *= np.pi / np.sqrt(axis[0] ** 2 + axis[1] ** 2 + axis[2] ** 2)
        return axis
    v *= np.arctan2(sine, cosine) / (2.0 * sine)
    return v


def angle_about(axis: FloatArray, start: FloatArray, end: FloatArray) -> float:
    """Return the angle, rad, about a unit `axis` that rotates `start` towards `end` (Paden-Kahan subproblem 1).

    Parameters
    ----------
    axis : unit vector, shape (3,)
    start, end : vectors before and after the rotation, shape (3,)
    """
    u = start - axis * (axis @ start)
    w = end - axis * (axis @ end)
    return float(np.arctan2(axis @ np.cross(u, w), u @ w))


def level_attitude(up_b: FloatArray) -> FloatArray:
    """Return an attitude C_bn, shape (3, 3), with `up_b` (of any length) upward and arbitrary heading."""
    up = up_b / np.linalg.norm(up_b)
    reference = np.zeros(3)
    reference[int(np.argmin(np.abs(up)))] = 1.0
    east = np.cross(reference, up)
    east /= np.linalg.norm(east)
    return np.vstack([east, np.cross(up, east), up])
