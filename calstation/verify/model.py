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
WIDE = np.array([sigma for members, sigma in GROUPS.values() for _ in members])
COUNT = len(NAMES)
AT = {group: [i for i, name in enumerate(NAMES) if name.startswith(group + "_")] for group in GROUPS}
EARTH_RATE = 7.292115e-5
UP = np.array([0.0, 0.0, 1.0])


def matrix(p, sensor):
    """Return I + M of the gyros or the accelerometers."""
    M = np.diag(1.0 + p[AT[sensor + "_scale"]])
    for i in AT[sensor + "_misalign"]:
        row, column = NAMES[i][-2:]
        M[AXES.index(row), AXES.index(column)] = p[i]
    return M


def size_effect(p, omega):
    """Return the force sensed at the accelerometers minus that at the reference point, shape (n, 3)."""
    return p[AT["inner_lever"]] * (omega**2 - np.sum(omega**2, axis=1, keepdims=True))


def sensed(p, omega, force):
    """Return the output of gyros and accelerometers, shape (n, 6), without the size effect."""
    gyro = omega @ matrix(p, "gyro").T + p[AT["gyro_bias"]]
    accel = force @ matrix(p, "accel").T + p[AT["accel_quadratic"]] * force**2 + p[AT["accel_bias"]]
    return np.hstack([gyro, accel])


def rate_of(p, gyro):
    """Return the angular rate, rad/s, from the measured one, shape (n, 3)."""
    return np.linalg.solve(matrix(p, "gyro"), (gyro - p[AT["gyro_bias"]]).T).T


def force_of(p, accel, omega):
    """Return the specific force at the reference point, m/s², from the measured one, shape (n, 3)."""
    inverse, linear = np.linalg.inv(matrix(p, "accel")), accel - p[AT["accel_bias"]]
    force = linear @ inverse.T
    for _ in range(4):
        force = (linear - p[AT["accel_quadratic"]] * force**2) @ inverse.T
    return force - size_effect(p, omega)


def derivatives(p, omega, force):
    """Return the changes of the computed rate and force per parameter, shape (n, 3, 30) each.

    The parameters act on the force at the reference point, although the accelerometers sense it at their own.
    """
    change, output = np.zeros((len(omega), 6, COUNT)), sensed(p, omega, force)
    for i in range(AT["inner_lever"][0]):  # the output is linear in its parameters
        change[:, :, i] = sensed(p + np.eye(COUNT)[i], omega, force) - output
    slope = matrix(p, "accel") + 2.0 * p[AT["accel_quadratic"]][None, :, None] * force[:, :, None] * np.eye(3)
    by_rate, by_force = -np.linalg.inv(matrix(p, "gyro")) @ change[:, :3], -np.linalg.solve(slope, change[:, 3:])
    for axis, i in enumerate(AT["inner_lever"]):
        by_force[:, axis, i] += np.sum(omega**2, axis=1) - omega[:, axis] ** 2
    return by_rate, by_force


def skew(v):
    """Return the matrices of the cross products with vectors, shape (..., 3, 3)."""
    return np.cross(np.eye(3), np.asarray(v)[..., None, :])


def rotation(v):
    """Return the rotation matrices of rotation vectors, rad, shape (..., 3, 3)."""
    return Rotation.from_rotvec(v).as_matrix()


def earth_rate(latitude):
    """Return the rotation rate of the earth in east, north, up, rad/s."""
    return EARTH_RATE * np.array([0.0, np.cos(latitude), np.sin(latitude)])


def normal_gravity(latitude, height):
    """Return Somigliana's normal gravity of WGS-84, m/s²."""
    a, f, s = 6378137.0, 1.0 / 298.257223563, np.sin(latitude) ** 2
    equator, pole, b = 9.7803253359, 9.8321849378, 6378137.0 * (1.0 - 1.0 / 298.257223563)
    surface = equator * (1.0 + (b * pole / (a * equator) - 1.0) * s) / np.sqrt(1.0 - f * (2.0 - f) * s)
    m = EARTH_RATE**2 * a**2 * b / 3.986004418e14
    return surface * (1.0 - 2.0 * (1.0 + f + m - 2.0 * f * s) * height / a + 3.0 * height**2 / a**2)
