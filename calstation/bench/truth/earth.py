"""The bench's own earth: rotation and normal gravity on the WGS-84 ellipsoid.

NIMA TR8350.2 (2000), tables 3.1-3.4 and equations 4-1, 4-3.
"""

import numpy as np

from calstation.physics.arrays import FloatArray

#: Rotation rate of the earth, rad/s.
EARTH_RATE = 7.292115e-5
#: Semi-major axis, m.
SEMI_MAJOR = 6378137.0
#: Flattening.
FLATTENING = 1.0 / 298.257223563
#: Gravity at the equator, m/s².
EQUATOR_GRAVITY = 9.7803253359
#: Somigliana's constant.
SOMIGLIANA = 1.931852652458e-3
#: Centrifugal over gravitational acceleration at the equator, ω²a²b/GM.
CENTRIFUGAL_RATIO = 3.449786506841e-3


def normal_gravity(latitude: float, height: float) -> float:
    """Somigliana gravity carried to a height, m/s².

    Parameters
    ----------
    latitude : geodetic, rad
    height : above the ellipsoid, m
    """
    sine2 = np.sin(latitude) ** 2
    eccentricity2 = FLATTENING * (2.0 - FLATTENING)
    surface = EQUATOR_GRAVITY * (1.0 + SOMIGLIANA * sine2) / np.sqrt(1.0 - eccentricity2 * sine2)
    slope = 2.0 * (1.0 + FLATTENING + CENTRIFUGAL_RATIO - 2.0 * FLATTENING * sine2) / SEMI_MAJOR
    return float(surface * (1.0 - slope * height + 3.0 * (height / SEMI_MAJOR) ** 2))


def earth_rate_n(latitude: float) -> FloatArray:
    """Rotation of the earth in east, north, up, rad/s, shape (3,)."""
    return EARTH_RATE * np.array([0.0, np.cos(latitude), np.sin(latitude)])
