"""True attitude and rotation of the unit on the table, from the true joint angles.

    C_b^n = R_base · Rz(−azimuth) · W_o · R(outer axis, q_o) · R_orth · W_i · R(inner axis, q_i) · R_mount · A

The rows of A are the axes of the unit along x, y and z of the platform. W is the wobble of a bearing, a tilt of
constant size ε whose direction turns with the joint: W = R(a, kq + ψ) · R(u, ε) · R(a, −kq − ψ), with u normal to the
axis a. The attitude is therefore a chain of constant rotations P_j and of turns about constant axes by angles linear in
the joint angles, and each link transforms rate and acceleration exactly. With R = R(a, θ),

    ω' = Rᵀω + a θ',    ω'' = Rᵀω'' − θ' a × (Rᵀω) + a θ''        (rigid-body kinematics, rotating axes)

starting from the earth rate in n, so that the chain ends with ω_ib in b. If the axes do not intersect, the displacement
d of the inner axis, which is constant in the outer body, adds ω''×d + ω'×(ω'×d) to the force after the outer turn.
"""

from dataclasses import dataclass, field

import numpy as np

from calstation.bench.truth.base_motion import TableMotion
from calstation.physics import FloatArray, kernel

#: Rotation rate of the earth, rad/s.
EARTH_RATE = 7.292115e-5
#: Semi-major axis of the ellipsoid, m.
SEMI_MAJOR = 6378137.0
FLATTENING = 1.0 / 298.257223563
#: Gravity at the equator, m/s².
EQUATOR_GRAVITY = 9.7803253359
SOMIGLIANA = 1.931852652458e-3
#: Ratio of centrifugal to gravitational acceleration at the equator, ω²a²b/GM.
CENTRIFUGAL_RATIO = 3.449786506841e-3


def normal_gravity(latitude: float, height: float) -> float:
    """Return Somigliana's normal gravity, m/s², at a geodetic latitude, rad, and height above the ellipsoid, m."""
    sine2 = np.sin(latitude) ** 2
    eccentricity2 = FLATTENING * (2.0 - FLATTENING)
    surface = EQUATOR_GRAVITY * (1.0 + SOMIGLIANA * sine2) / np.sqrt(1.0 - eccentricity2 * sine2)
    slope = 2.0 * (1.0 + FLATTENING + CENTRIFUGAL_RATIO - 2.0 * FLATTENING * sine2) / SEMI_MAJOR
    return float(surface * (1.0 - slope * height + 3.0 * (height / SEMI_MAJOR) ** 2))


def earth_rate_n(latitude: float) -> FloatArray:
    """Return the rotation rate of the earth in east, north, up, rad/s, shape (3,)."""
    return EARTH_RATE * np.array([0.0, np.cos(latitude), np.sin(latitude)])


#: Turns of the tilt direction per turn of the joint; 0 and 1 would be constant tilts of stator and rotor.
WOBBLE_HARMONIC = 2.0


def rotation(vector: FloatArray) -> FloatArray:
    """Return the matrix of the rotation by |vector| rad about `vector` (Rodrigues), shape (3, 3)."""
    angle = float(np.linalg.norm(vector))
    if angle == 0.0:
        return np.eye(3)
    x, y, z = np.asarray(vector) / angle
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * (cross @ cross))


def unit_axes(orientation: str) -> FloatArray:
    """Return the unit's axes along x, y and z of the platform as rows, shape (3, 3), for a name such as "+x+z".

    The name gives the axes along x and z. Raises ValueError if they are not two different axes.
    """
    signs, letters = orientation[::2], orientation[1::2]
    if len(orientation) != 4 or not set(signs) <= set("+-") or len(set(letters) & set("xyz")) != 2:
        raise ValueError(f"{orientation!r} is not an orientation such as +x+z")
    axes = np.zeros((3, 3))
    for row, sign, letter in zip((0, 2), signs, letters, strict=True):
        axes[row, "xyz".index(letter)] = 1.0 if sign == "+" else -1.0
    axes[1] = np.cross(axes[2], axes[0])
    return axes


@dataclass(frozen=True)
class TableTruth:
    """True geometry and site of the table; angles in rad, rotation vectors of shape (3,).

    `base_tilt` rotates the base in n, and `mount` the unit on the inner platform relative to its right-angled
    `orientation`, see `unit_axes`. `non_orthogonality` rotates the inner axis about (outer × inner). `wobble` tilts the
    outer and inner bearings towards `wobble_phase` at angle 0. `axis_offset`, m, is the position of the inner bearing
    on the outer body, along (outer × inner) and along the inner axis. `velocity_sigma` is the rms velocity of the
    centre along each axis of n, m/s. If `gravity` is None, normal gravity is used.
    """

    latitude: float
    height: float
    azimuth: float = 0.0
    base_tilt: tuple[float, float, float] = (0.0, 0.0, 0.0)
    outer_axis: tuple[float, float, float] = (1.0, 0.0, 0.0)
    inner_axis: tuple[float, float, float] = (0.0, 0.0, 1.0)
    non_orthogonality: float = 0.0
    wobble: tuple[float, float] = (0.0, 0.0)
    wobble_phase: tuple[float, float] = (0.0, 0.0)
    axis_offset: tuple[float, float] = (0.0, 0.0)
    mount: tuple[float, float, float] = (0.0, 0.0, 0.0)
    orientation: str = "+x+z"
    velocity_sigma: float = 0.0
    motion: TableMotion = field(default_factory=TableMotion)
    gravity: float | None = None

    @property
    def up_force_n(self) -> FloatArray:
        """Specific force of a body at rest, in n, m/s², shape (3,)."""
        gravity = normal_gravity(self.latitude, self.height) if self.gravity is None else self.gravity
        return np.array([0.0, 0.0, gravity])

    @property
    def earth_rate_n(self) -> FloatArray:
        """Rotation of the earth in n, rad/s, shape (3,)."""
        return earth_rate_n(self.latitude)

    def chain(self) -> FloatArray:
        """Return the chain for the compiled functions, shape (5, 18).

        A row contains P_j transposed (9 numbers), the axis (3), the factors of q_o and q_i in θ, the phase of θ, and
        the displacement after the turn, m (3); the last row is the mount.
        """
        outer, inner = _unit(self.outer_axis), _unit(self.inner_axis)
        hinge = _unit(np.cross(outer, inner))
        base = rotation(np.asarray(self.base_tilt)) @ rotation(np.array([0.0, 0.0, -self.azimuth]))
        orthogonal = rotation(self.non_orthogonality * hinge)
        k = WOBBLE_HARMONIC
        links = [
            (base, outer, k, 0.0, self.wobble_phase[0]),
            (rotation(self.wobble[0] * hinge), outer, 1.0 - k, 0.0, -self.wobble_phase[0]),
            (orthogonal, inner, 0.0, k, self.wobble_phase[1]),
            (rotation(self.wobble[1] * hinge), inner, 0.0, 1.0 - k, -self.wobble_phase[1]),
            (rotation(np.asarray(self.mount)) @ unit_axes(self.orientation), np.zeros(3), 0.0, 0.0, 0.0),
        ]
        rows = np.array([[*p.T.ravel(), *axis, a, b, phase, 0.0, 0.0, 0.0] for p, axis, a, b, phase in links])
        rows[1, 15:] = self.axis_offset[0] * hinge + self.axis_offset[1] * inner
        return rows


def _unit(vector: FloatArray | tuple[float, float, float]) -> FloatArray:
    array = np.asarray(vector, dtype=np.float64)
    return array / np.linalg.norm(array)


@kernel
def _rotate_back(axis: FloatArray, sine: float, cosine: float, vector: FloatArray) -> None:
    """Replace `vector` by R(axis, θ)ᵀ vector."""
    ax, ay, az = axis[0], axis[1], axis[2]
    x, y, z = vector[0], vector[1], vector[2]
    along = (ax * x + ay * y + az * z) * (1.0 - cosine)
    vector[0] = x * cosine - (ay * z - az * y) * sine + ax * along
    vector[1] = y * cosine - (az * x - ax * z) * sine + ay * along
    vector[2] = z * cosine - (ax * y - ay * x) * sine + az * along


@kernel
def _apply_constant(link: FloatArray, vector: FloatArray) -> None:
    """Replace `vector` by Pᵀ vector, with Pᵀ in the first nine numbers of a link."""
    x, y, z = vector[0], vector[1], vector[2]
    vector[0] = link[0] * x + link[1] * y + link[2] * z
    vector[1] = link[3] * x + link[4] * y + link[5] * z
    vector[2] = link[6] * x + link[7] * y + link[8] * z


@kernel
def to_body(chain: FloatArray, outer: float, inner: float, vector_n: FloatArray) -> FloatArray:
    """Transform a vector from n to b, shape (3,).

    Parameters
    ----------
    chain : links from the base to the unit, see `TableTruth.chain`, shape (k, 18)
    outer, inner : angles of the joints, rad
    vector_n : vector in n, shape (3,)
    """
    vector = vector_n.copy()
    for j in range(chain.shape[0]):
        link = chain[j]
        _apply_constant(link, vector)
        angle = link[12] * outer + link[13] * inner + link[14]
        _rotate_back(link[9:12], np.sin(angle), np.cos(angle), vector)
    return vector


@kernel
def body_motion(chain: FloatArray, outer: FloatArray, inner: FloatArray, vectors: FloatArray) -> None:
    """Transform a force, ω and its derivative from n to b, in place.

    Parameters
    ----------
    chain : links from the base to the unit, see `TableTruth.chain`, shape (k, 18)
    outer, inner : angle, rad, rate, rad/s, and acceleration, rad/s², of each joint, shape (3,)
    vectors : specific force, m/s², which the displacements in the chain change, ω, rad/s, and its derivative, rad/s²,
        shape (3, 3)
    """
    for j in range(chain.shape[0]):
        link = chain[j]
        angle = link[12] * outer[0] + link[13] * inner[0] + link[14]
        rate = link[12] * outer[1] + link[13] * inner[1]
        acceleration = link[12] * outer[2] + link[13] * inner[2]
        sine, cosine = np.sin(angle), np.cos(angle)
        for i in range(3):
            _apply_constant(link, vectors[i])
            _rotate_back(link[9:12], sine, cosine, vectors[i])
        ax, ay, az = link[9], link[10], link[11]
        x, y, z = vectors[1, 0], vectors[1, 1], vectors[1, 2]
        vectors[2, 0] += acceleration * ax - rate * (ay * z - az * y)
        vectors[2, 1] += acceleration * ay - rate * (az * x - ax * z)
        vectors[2, 2] += acceleration * az - rate * (ax * y - ay * x)
        vectors[1, 0] += rate * ax
        vectors[1, 1] += rate * ay
        vectors[1, 2] += rate * az
        dx, dy, dz = link[15], link[16], link[17]
        if dx != 0.0 or dy != 0.0 or dz != 0.0:
            x, y, z = vectors[1, 0], vectors[1, 1], vectors[1, 2]
            along, square = x * dx + y * dy + z * dz, x * x + y * y + z * z
            vectors[0, 0] += vectors[2, 1] * dz - vectors[2, 2] * dy + x * along - square * dx
            vectors[0, 1] += vectors[2, 2] * dx - vectors[2, 0] * dz + y * along - square * dy
            vectors[0, 2] += vectors[2, 0] * dy - vectors[2, 1] * dx + z * along - square * dz
