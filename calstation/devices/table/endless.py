"""When a table may be told to turn without end: only where it stops by itself once nobody tells it anything."""

import math

from calstation.devices.profiles.table import TableProfile
from calstation.errors import ConfigurationError


def check_endless(
    profile: TableProfile, watchdog: float, rates: tuple[float, float], acceleration: float
) -> None:
    """May the table turn at these rates until it is stopped?

    Parameters
    ----------
    watchdog : s, 0 where it is off, infinite where the table has none
    rates, acceleration : rad/s, rad/s²

    Raises
    ------
    ConfigurationError
        where a lost link would leave it turning, or it cannot turn so fast.
    """
    watched = 0.0 < watchdog < math.inf
    if not watched and profile.link_loss_stop_s is None:
        raise ConfigurationError(
            f"table: '{profile.name}' has no watchdog that is on, and its profile states no link_loss_stop_s: a lost"
            " link would leave it turning; use moves to angles, or state how it stops by itself"
        )
    limits = profile.geometry().limits
    for name, rate, most in zip(("outer", "inner"), rates, limits.rate, strict=True):
        if not abs(rate) <= most * (1.0 + 1e-9):
            raise ConfigurationError(
                f"table: rate {math.degrees(rate):g} °/s of the {name} axis is above the profile's"
                f" {math.degrees(most):g} °/s; lower it"
            )
    if not 0.0 < acceleration <= min(limits.acceleration) * (1.0 + 1e-9):
        raise ConfigurationError(
            f"table: acceleration {math.degrees(acceleration):g} °/s² is outside the profile's 0 to"
            f" {math.degrees(min(limits.acceleration)):g} °/s²; correct it"
        )
