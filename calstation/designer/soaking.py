"""Temperatures and duration of a stage `temperature`, for a chamber that heats and cools at constant rate.

The temperature of the unit approaches that of the air plus the self-heating exponentially, with one time constant.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from math import exp, log

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.signal import lfilter

from calstation.errors import InputError
from calstation.physics import Dwell, FloatArray, Move, Ramp, Soak, Step
from calstation.records import Log
from calstation.sequencer import step_time

#: Assumed delay of the air after a change of the set point, s.
_LAG = 60.0
#: Interval of the temperatures from which the properties of a unit are measured, s, and bounds of its time constant, s.
_INTERVAL, _TIME_CONSTANTS = 2.0, (5.0, 20_000.0)
#: Smallest change of the air temperature from which these properties can be measured, K.
_LEAST_CHANGE = 10.0


@dataclass(frozen=True)
class Thermal:
    """Properties of a chamber with a unit in it."""

    rate: float  #: Largest rate of the air, K/s.
    ambient: float  #: Temperature of air and unit at the start, °C.
    time_constant: float  #: Time constant of the unit, s.
    self_heating: float  #: Steady-state difference of the unit from the air, K.


@dataclass(frozen=True)
class Course:
    """Mean temperature of the unit, °C, and its rate, K/s, in every cycle of moves; durations, s."""

    cycles: tuple[tuple[float, float], ...]
    duration: float
    longest_soak: float


def course_of(steps: Iterable[Step], cycle: int, thermal: Thermal, settle: float) -> Course:
    """Return the temperatures during the steps of a stage, whose soaks end once the unit is steady.

    Parameters
    ----------
    steps : steps of the plan
    cycle : number of moves of a cycle
    thermal : chamber and unit
    settle : settling time of the table after a move, s
    """
    air, joints, moves = _Air(thermal), (0.0, 0.0), 0
    begin, cycles, longest = (0.0, air.unit), list[tuple[float, float]](), 0.0
    for step in steps:
        if isinstance(step, Soak):
            longest = max(longest, air.soak(step))
            begin, moves = (air.time, air.unit), 0
        elif isinstance(step, Ramp):
            air.target, air.rate = step.temperature, step.rate / 60.0
        elif isinstance(step, Move):
            air.advance(step_time(step, joints, settle))
            joints = step.outer, step.inner
        elif isinstance(step, Dwell):
            air.advance(step.duration)
            moves += 1
            if moves % cycle == 0:
                rate = (air.unit - begin[1]) / (air.time - begin[0])
                cycles.append((0.5 * (begin[1] + air.unit), rate))
                begin = air.time, air.unit
    return Course(tuple(cycles), air.time, longest)


class _Air:
    """The air of a chamber, whose temperature approaches a target, °C, at a rate, K/s, and the unit in it."""

    def __init__(self, thermal: Thermal) -> None:
        self._thermal = thermal
        self.time, self._air, self.unit = 0.0, thermal.ambient, thermal.ambient
        self.target, self.rate = thermal.ambient, thermal.rate

    def advance(self, seconds: float) -> None:
        """Advance the time by `seconds`."""
        way = self.target - self._air
        moving = min(abs(way) / self.rate, seconds)
        self._step(moving, self.rate if way > 0.0 else -self.rate)
        self._step(seconds - moving, 0.0)

    def _step(self, seconds: float, slope: float) -> None:
        """Advance the time by `seconds`, during which the air changes by `slope`, K/s."""
        tau, decay = self._thermal.time_constant, exp(-seconds / self._thermal.time_constant)
        lag = self._lag * decay - slope * tau * (1.0 - decay)
        self._air += slope * seconds
        self.unit = self._air + self._thermal.self_heating + lag
        self.time += seconds

    @property
    def _lag(self) -> float:
        """Difference of the unit from its steady-state temperature in the present air, K."""
        return self.unit - self._air - self._thermal.self_heating

    def soak(self, step: Soak) -> float:
        """Change to a temperature at the largest rate and wait until the unit is steady; return the duration, s."""
        begin = self.time
        self.advance(_LAG)
        self.target, self.rate = step.temperature, self._thermal.rate
        self.advance(abs(self.target - self._air) / self.rate)
        tau = self._thermal.time_constant
        excess = 60.0 * abs(self._lag) * _slope_over(step.hold, tau) / step.slope
        self.advance(step.hold + tau * log(max(excess, 1.0)))
        return self.time - begin


def _slope_over(period: float, time_constant: float) -> float:
    """Return the magnitude of the least-squares slope, 1/s, over a period, s, of a decay that starts at 1."""
    h = period / time_constant
    moment = (1.0 - exp(-h) * (1.0 + h)) / h**2 - (1.0 - exp(-h)) / (2.0 * h)
    return -12.0 * moment / period


def measured_thermal(recording: Log) -> tuple[float, float]:
    """Return time constant, s, and self-heating, K, of a unit from a log with the temperature of the chamber's air.

    Raises InputError if the log does not contain the air temperature, or if it changes too little.
    """
    columns: list[FloatArray] = []
    for block in recording.blocks():
        air = block.chamber[:, 0] if block.chamber.shape[1] else np.full(len(block), np.nan)
        known = np.isfinite(air) & np.isfinite(block.temperature)
        columns.append(np.stack([block.time, air, block.temperature])[:, known])
    time, air, unit = np.hstack(columns)
    change = float(np.ptp(air)) if len(air) else 0.0
    if change < _LEAST_CHANGE:
        raise InputError("design.no_chamber_air", file=recording.path, change=change, least=_LEAST_CHANGE)
    grid = np.arange(time[0], time[-1], _INTERVAL)
    air, unit = np.interp(grid, time, air), np.interp(grid, time, unit)

    def fitted(tau: float) -> tuple[float, float]:
        """Return the self-heating and the sum of squares of the residuals; the unit may start at any temperature."""
        decay = exp(-_INTERVAL / tau)
        share = (1.0 - decay) * tau / _INTERVAL  # air is linear between two temperatures
        lagging = lfilter([1.0 - share, share - decay], [1.0, -decay], air - air[0])
        basis = np.stack([np.ones(len(grid)), np.exp(-(grid - grid[0]) / tau)], axis=1)
        coefficients, *_ = np.linalg.lstsq(basis, unit - air[0] - lagging, rcond=None)
        return float(coefficients[0]), float(np.sum((unit - air[0] - lagging - basis @ coefficients) ** 2))

    low, high = (log(each) for each in _TIME_CONSTANTS)
    tau = exp(float(minimize_scalar(lambda x: fitted(exp(x))[1], bounds=(low, high), method="bounded").x))
    return tau, fitted(tau)[0]
