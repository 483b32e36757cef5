"""The clock of a station with hardware."""

import time
from collections.abc import Callable, Mapping

#: Interval at which the devices are polled, s.
TICK = 0.05


class RealClock:
    """Clock whose station time is the host's monotonic time, s."""

    tick = TICK
    speed = 1.0

    def now(self) -> float:
        """Return the time, s."""
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        """Wait for `seconds`."""
        time.sleep(seconds)

    idle = sleep

    def attach(self, received: Callable[[], Mapping[int, int]]) -> None:
        """Do nothing: samples arrive in real time."""
