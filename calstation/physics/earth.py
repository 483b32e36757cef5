"""The rotating WGS-84 earth at a site: rotation rate and gravity in the local level (ENU) frame.

References
----------
NIMA TR8350.2, *World Geodetic System 1984*, 3rd ed., chapters 3 and 4 (Somigliana's closed form 4-1 and
its continuation in height 4-3).
"""

import numpy as np

from calstation.physics.arrays import FloatArray

#: Rotation rate of the earth in rad/s.
RATE = 7.292115e-5
#: Semi-major axis in m.
SEMI_MAJOR_AXIS = 6378137.0
#: Flattening of the ellipsoid.
FLATTENING = 1.0 / 298.257223563
#: GM in m³/s².
GRAVITATIONAL_PARAMETER = 3.986004418e14
#: Normal gravity at the equator in m/s².
EQUATOR_GRAVITY = 9.7803253359
#: Normal gravity at the poles in m/s².
POLE_GRAVITY = 9.8321849378


def normal_gravity(latitude: float, height: float) -> float:
    """Normal gravity in m/s² at geodetic latitude (rad) and height (m); TR8350.2, 4-1 and 4-3."""
    a, f = SEMI_MAJOR_AXIS, FLATTENING
    b = a * (1.0 - f)
    sin2 = np.sin(latitude) ** 2
    k = b * POLE_GRAVITY / (a * EQUATOR_GRAVITY) - 1.0
    e2 = f * (2.0 - f)
    surface = EQUATOR_GRAVITY * (1.0 + k * sin2) / np.sqrt(1.0 - e2 * sin2)
    m = RATE**2 * a**2 * b / GRAVITATIONAL_PARAMETER
    return float(surface * (1.0 - 2.0 * (1.0 + f + m - 2.0 * f * sin2) * height / a + 3.0 * height**2 / a**2))


def rotation_rate(latitude: float) -> FloatArray:
    """Rotation rate of the earth in ENU at `latitude` (rad), rad/s, shape (3,)."""
    return np.array([0.0, RATE * np.cos(latitude), RATE * np.sin(latitude)])
