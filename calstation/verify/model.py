"""Error model, earth and rotations, written from the public interface (frames and signs, error model) alone.

    gyro   measured = (I + M_g) ω + b_g                 M_g full 3×3
    accel  measured = (I + M_a) f + K2 ∘ f² + b_a       M_a lower triangular

`f` on axis i is sensed at `outer_lever + inner_lever_i e_i` from the centre of rotation.
"""

import numpy as np
from scipy.spatial.transform import Rotation

AXES = "xyz"
_OFF = ("xy", "xz", "yx", "yz", "zx", "zy")
#: Groups of parameters: names of their members, and the sigma, SI, if nothing is known.
GROUPS = {
    "gyro_bias": (AXES, 1e-2),
    "gyro_scale": (AXES, 0.05),
    "gyro_misalign": (_OFF, 0.05),
    "accel_bias": (AXES, 2.0),
    "accel_scale": (AXES, 0.1),
    "accel_misalign": (("yx", "zx", "zy"), 0.05),
    "accel_quadratic": (AXES, 2e-5),
    "inner_lever": (AXES, 0.1),
    "outer_lever": (AXES, 0.5),
}
NAMES = tuple(f"{group}_{member}" for group, (members, _) in GROUPS.items() for member in members)
GROUP = tuple(group for group, (members, _) in GROUPS.items() for _ in members)  # of every parameter
WIDE = np.array([GROUPS[group][1] for group in GROUP])
COUNT = len(NAMES)
AT = {group: [i for i in range(COUNT) if GROUP[i] == group] for group in GROUPS}
BIASES = AT["gyro_bias"] + AT["accel_bias"]
EARTH_RATE = 7.292115e-5
UP = np.array([0.0, 0.0, 1.0])


def matrix(p, sensor):
    """Return I + M of the gyros or the accelerometers."""
    M = np.diag(1.0 + p[AT[sensor + "_scale"]])
    for i in AT[sensor + "_misalign"]:
        row, column = NAMES[i][-2:]
        M[AXES.index(row), AXES.index(column)] = p[i]
    return M


def sensed(p, omega, force):
    """Return the outputs (I + M_g) ω + b_g and (I + M_a) f + K2 ∘ f² + b_a, shape (..., 3) each."""
    accel = force @ matrix(p, "accel").T + p[AT["accel_quadratic"]] * force**2 + p[AT["accel_bias"]]
    return omega @ matrix(p, "gyro").T + p[AT["gyro_bias"]], accel


def compensated(p, gyro, accel):
    """Return the angular rate, rad/s, and the specific force at the reference point, m/s², shape (..., 3) each.

    The force is the inverse of `sensed` by Newton's method, plus the size effect inner_lever_i (|ω|² − ω_i²).
    """
    omega = (gyro - p[AT["gyro_bias"]]) @ np.linalg.inv(matrix(p, "gyro")).T
    inverse, force = np.linalg.inv(matrix(p, "accel")).T, accel
    for _ in range(4):
        force = force - (sensed(p, omega, force)[1] - accel) @ inverse
    return omega, force + p[AT["inner_lever"]] * (np.sum(omega**2, axis=-1, keepdims=True) - omega**2)


def turned(C, v):
    """Return the products of matrices, shape (..., 3, 3), and vectors, shape (..., 3)."""
    return (C @ v[..., None])[..., 0]


def skew(v):
    """Return the matrices of the cross products with vectors, shape (..., 3, 3)."""
    return np.cross(np.eye(3), np.asarray(v)[..., None, :])


def rotation(v):
    """Return the rotation matrices of rotation vectors, rad, shape (..., 3, 3)."""
    return Rotation.from_rotvec(v.reshape(-1, 3)).as_matrix().reshape(*v.shape, 3)


def normal_gravity(latitude, height):
    """Return Somigliana's normal gravity of WGS-84, m/s²."""
    a, f, s = 6378137.0, 1.0 / 298.257223563, np.sin(latitude) ** 2
    equator, pole, b = 9.7803253359, 9.8321849378, a * (1.0 - f)
    surface = equator * (1.0 + (b * pole / (a * equator) - 1.0) * s) / np.sqrt(1.0 - f * (2.0 - f) * s)
    m = EARTH_RATE**2 * a**2 * b / 3.986004418e14
    return surface * (1.0 - 2.0 * (1.0 + f + m - 2.0 * f * s) * height / a + 3.0 * height**2 / a**2)
