"""Small rotation algebra: cross-product matrices, rotation vectors, directions."""

import numpy as np

from calstation.physics.arrays import FloatArray


def skew(v: FloatArray) -> FloatArray:
    """Cross-product matrix, `skew(v) @ u == cross(v, u)`, shape (3, 3)."""
    x, y, z = v
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def rotation_matrix(rotvec: FloatArray) -> FloatArray:
    """Rotation by a rotation vector (rad), shape (3, 3); Rodrigues' formula."""
    angle = float(np.linalg.norm(rotvec))
    K = skew(rotvec)
    if angle < 1e-8:
        return np.eye(3) + K + 0.5 * K @ K
    return np.eye(3) + np.sin(angle) / angle * K + (1.0 - np.cos(angle)) / angle**2 * (K @ K)


def axis_rotation(axis: FloatArray | tuple[float, float, float], angle: float) -> FloatArray:
    """Right-handed rotation by `angle` (rad) about a unit `axis`, shape (3, 3)."""
    return rotation_matrix(np.asarray(axis, dtype=np.float64) * angle)


def rotation_vector(C: FloatArray) -> FloatArray:
    """Rotation vector (rad) of a rotation matrix, shape (3,), for angles below π."""
    v = np.array([C[2, 1] - C[1, 2], C[0, 2] - C[2, 0], C[1, 0] - C[0, 1]])
    sine, cosine = 0.5 * float(np.linalg.norm(v)), 0.5 * (float(np.trace(C)) - 1.0)
    if sine < 1e-9:
        if cosine > 0.0:
            return 0.5 * v
        column = int(np.argmax(np.diag(C)))
        axis = (C + np.eye(3))[:, column]
        return np.asarray(np.pi * axis / np.linalg.norm(axis))
    return np.asarray(v * (np.arctan2(sine, cosine) / (2.0 * sine)))


def angle_about(axis: FloatArray, start: FloatArray, end: FloatArray) -> float:
    """Angle (rad) about unit `axis` that turns `start` towards `end` (Paden-Kahan subproblem 1)."""
    u = start - axis * (axis @ start)
    w = end - axis * (axis @ end)
    return float(np.arctan2(axis @ np.cross(u, w), u @ w))


def level_attitude(up_b: FloatArray) -> FloatArray:
    """Some attitude `C_bn` whose up axis is `up_b` (any length), heading arbitrary, shape (3, 3)."""
    up = up_b / np.linalg.norm(up_b)
    reference = np.zeros(3)
    reference[int(np.argmin(np.abs(up)))] = 1.0
    east = np.cross(reference, up)
    east /= np.linalg.norm(east)
    return np.vstack([east, np.cross(up, east), up])
