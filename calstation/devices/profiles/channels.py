"""What the six channels of a stream can show, by the types in which they come."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from calstation.devices.codecs.numbers import number
from calstation.devices.profiles.frame import FrameSection
from calstation.physics.arrays import FloatArray

CHANNELS = ("gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z")


def _all(value: float) -> Callable[[], FloatArray]:
    return lambda: np.full(6, value)


@dataclass(frozen=True)
class Span:
    """Of each channel, in counts, shape (6,).

    step : smallest difference of two values: 0 of floats, infinite where nobody knows
    low, high : ends at which the output is saturated
    """

    step: FloatArray = field(default_factory=_all(1.0))
    low: FloatArray = field(default_factory=_all(-np.inf))
    high: FloatArray = field(default_factory=_all(np.inf))


def span(frame: FrameSection) -> Span:
    """What the channels of a profile's frame can show. A whole number at an end of its type is saturated."""
    steps, ends = [], []
    for name in CHANNELS:
        f = frame.field(name)
        assert f is not None
        kind = number(f.type)
        if kind.kind == "f":
            steps.append(np.inf if frame.format == "text" else 0.0)  # nobody knows how many digits a line has
            low, high = -np.inf, np.inf
        else:
            steps.append(abs(f.scale) * 2.0**-kind.fraction)
            low, high = sorted(end * f.scale + f.offset for end in kind.bounds)
        reach = np.inf if f.reach is None else f.reach
        ends.append((max(low, -reach), min(high, reach)))
    return Span(np.array(steps), *np.array(ends, np.float64).T)
