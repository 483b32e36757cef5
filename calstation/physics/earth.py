"""Rotation rate and gravity of the WGS-84 earth at a site, in the local level (ENU) frame.

References
----------
NIMA TR8350.2, *World Geodetic System 1984*, 3rd ed., chapters 3 and 4 (the Somigliana formula 4-1 and
its extension in height 4-3).
"""

import numpy as np

from calstation.physics.arrays import FloatArray

#: Rotation rate of the earth, rad/s.
RATE = 7.292115e-5
#: Semi-major axis of the ellipsoid, m.
SEMI_MAJOR_AXIS = 6378137.0
#: Flattening of the ellipsoid.
FLATTENING = 1.0 / 298.257223563
#: Gravitational parameter GM, m³/s².
GRAVITATIONAL_PARAMETER = 3.986004418e14
#: Normal gravity at the equator, m/s².
EQUATOR_GRAVITY = 9.7803253359
#: Normal gravity at the poles, m/s².
POLE_GRAVITY = 9.8321849378


def normal_gravity(latitude: float, height: float) -> float:
    """Return the normal gravity, m/s², at geodetic latitude, rad, and height, m (TR8350.2, 4-1 and 4-3)."""
    a, f = SEMI_MAJOR_AXIS, FLATTENING
    b = a * (1.0 - f)
    sin2 = np.sin(latitude) ** 2
    k = b * POLE_GRAVITY / (a * EQUATOR_GRAVITY) - 1.0
    e2 = f * (2.0 - f)
    surface = EQUATOR_GRAVITY * (1.0 + k * sin2) / np.sqrt(1.0 - e2 * sin2)
    m = RATE**2 * a**2 * b / GRAVITATIONAL_PARAMETER
    return float(surface * (1.0 - 2.0 * (1.0 + f + m - 2.0 * f * sin2) * height / a + 3.0 * height**2 / a**2))


def rotation_rate(latitude: float) -> FloatArray:
    """Return the rotation rate of the earth in ENU at `latitude`, rad, in rad/s, shape (3,)."""
    return np.array([0.0, RATE * np.cos(latitude), RATE * np.sin(latitude)])
