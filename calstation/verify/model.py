"""Error model, earth and rotations, written from the public interface (frames and signs, error model) alone.

    gyro   measured = (I + M_g) ω + b_g                 M_g full 3×3
    accel  measured = (I + M_a) f + K2 ∘ f² + b_a       M_a lower triangular

`f` on axis i is sensed at `outer_lever + inner_lever_i e_i` from the centre of rotation.
"""

import numpy as np

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
#: Row and column of the misalignments.
_G_OFF = tuple((AXES.index(m[0]), AXES.index(m[1])) for m in _OFF)
_A_OFF = tuple((AXES.index(m[0]), AXES.index(m[1])) for m in ("yx", "zx", "zy"))
EARTH_RATE = 7.292115e-5
UP = np.array([0.0, 0.0, 1.0])


def gyro_matrix(p):
    """Return I + M_g."""
    M = np.diag(1.0 + p[AT["gyro_scale"]])
    for i, (row, column) in zip(AT["gyro_misalign"], _G_OFF, strict=True):
        M[row, column] = p[i]
    return M


def accel_matrix(p):
    """Return I + M_a."""
    M = np.diag(1.0 + p[AT["accel_scale"]])
    for i, (row, column) in zip(AT["accel_misalign"], _A_OFF, strict=True):
        M[row, column] = p[i]
    return M


def rate_of(p, gyro):
    """Return the angular rate, rad/s, from the measured one, shape (n, 3)."""
    return np.linalg.solve(gyro_matrix(p), (gyro - p[AT["gyro_bias"]]).T).T


def size_effect(p, omega):
    """Return the force sensed at the accelerometers minus that at the reference point, shape (n, 3)."""
    return p[AT["inner_lever"]] * (omega**2 - np.sum(omega**2, axis=1, keepdims=True))


def force_of(p, accel, omega):
    """Return the specific force at the reference point, m/s², from the measured one, shape (n, 3)."""
    inverse, linear = np.linalg.inv(accel_matrix(p)), accel - p[AT["accel_bias"]]
    force = linear @ inverse.T
    for _ in range(4):
        force = (linear - p[AT["accel_quadratic"]] * force**2) @ inverse.T
    return force - size_effect(p, omega)


def rate_derivative(p, omega):
    """Return the change of the computed rate per parameter, shape (n, 3, 30)."""
    change = np.zeros((len(omega), 3, COUNT))
    for axis in range(3):
        change[:, axis, AT["gyro_bias"][axis]] = 1.0
        change[:, axis, AT["gyro_scale"][axis]] = omega[:, axis]
    for i, (row, column) in zip(AT["gyro_misalign"], _G_OFF, strict=True):
        change[:, row, i] = omega[:, column]
    return -np.linalg.inv(gyro_matrix(p)) @ change


def force_derivative(p, force, omega):
    """Return the change of the computed force per parameter at a fixed rate, shape (n, 3, 30).

    The force is that at the reference point, although the accelerometers sense it at their own.
    """
    change = np.zeros((len(force), 3, COUNT))
    for axis in range(3):
        change[:, axis, AT["accel_bias"][axis]] = 1.0
        change[:, axis, AT["accel_scale"][axis]] = force[:, axis]
        change[:, axis, AT["accel_quadratic"][axis]] = force[:, axis] ** 2
    for i, (row, column) in zip(AT["accel_misalign"], _A_OFF, strict=True):
        change[:, row, i] = force[:, column]
    slope = accel_matrix(p) + 2.0 * p[AT["accel_quadratic"]][None, :, None] * force[:, :, None] * np.eye(3)
    change = -np.linalg.solve(slope, change)
    size = np.sum(omega**2, axis=1, keepdims=True) - omega**2
    for axis in range(3):
        change[:, axis, AT["inner_lever"][axis]] += size[:, axis]
    return change


def skew(v):
    """Return the matrices of the cross products with vectors, shape (..., 3, 3)."""
    v = np.asarray(v)
    zero = np.zeros(v.shape[:-1])
    x, y, z = v[..., 0], v[..., 1], v[..., 2]
    rows = [np.stack(row, axis=-1) for row in ((zero, -z, y), (z, zero, -x), (-y, x, zero))]
    return np.stack(rows, axis=-2)


def rotation(v):
    """Return the rotation matrices of rotation vectors, rad, shape (..., 3, 3)."""
    v = np.asarray(v, float)
    angle = np.linalg.norm(v, axis=-1)[..., None, None]
    S = skew(v)
    return np.eye(3) + np.sinc(angle / np.pi) * S + 0.5 * np.sinc(0.5 * angle / np.pi) ** 2 * (S @ S)


def vector(R):
    """Return the rotation vectors, rad, of rotation matrices by less than half a turn, shape (..., 3)."""
    twice = np.stack([R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]], axis=-1)
    sine, cosine = 0.5 * np.linalg.norm(twice, axis=-1), 0.5 * (np.trace(R, axis1=-2, axis2=-1) - 1.0)
    angle = np.arctan2(sine, cosine)
    return 0.5 * twice / np.sinc(angle / np.pi)[..., None]


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
