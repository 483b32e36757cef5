"""Temperatures of a chamber's air and wall and of a unit in it, and the unit's parameters as functions of them.

Each thermal mass approaches its neighbours exponentially. The parameters depend on the temperature of the gyros or the
accelerometers, which differs from that of the temperature sensor. The functions are not polynomials.
"""

from collections.abc import Mapping
from math import exp
from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from calstation.physics import COUNT, PARAMETERS, FloatArray

#: Time between two states of the temperatures, s; parameters are constant in between.
GRID = 0.5

#: Temperature at which the parameters have the values of the unit without a chamber, °C.
REFERENCE = 25.0

#: Time constants of the air and of the wall for heat exchanged between them, of the wall for heat exchanged with the
#: room, and of the air for heat exchanged with the room through an open door, s.
_AIR, _WALL, _LEAK, _DOOR = 300.0, 900.0, 5400.0, 60.0

#: Power of heating and cooling relative to the power needed for the largest rate, and its time constant, s.
_POWER, _EXCHANGER = 2.0, 20.0

#: Time constants with which temperature sensor, gyros and accelerometers follow the case, s.
_TIME_CONSTANTS = np.array([20.0, 45.0, 35.0])
#: Time constant of the gradient after a change of the attitude, s.
_GRADIENT = 30.0

#: Size of the dependence on temperature by group, in sigmas of the grade.
_SHARES = {
    "gyro_bias": 1.0,
    "accel_bias": 1.0,
    "gyro_scale": 1.0,
    "accel_scale": 1.0,
    "gyro_misalign": 0.3,
    "accel_misalign": 0.3,
    "accel_quadratic": 0.2,
}
#: Bias at 1 K/min and half the width of the bias hysteresis, relative to the size of the dependence.
_RATE_SHARE, _HYSTERESIS_SHARE = 0.02, 0.005
#: Difference from the reference at which the clock of the unit is slower by `clock_ppm`, K; the clock is a quartz
#: oscillator whose frequency decreases with the square of the difference.
_CLOCK_SPAN = 60.0
#: Half the temperature change that reverses the hysteresis, K.
_PLAY = 8.0

NonNegative = Annotated[float, Field(ge=0.0)]
Positive = Annotated[float, Field(gt=0.0)]


class ThermalSettings(BaseModel):
    """Settings of a unit in a chamber; `docs/reference/bench.md` explains every entry."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    case_time_s: Positive = 240.0
    self_heating_c: NonNegative = 4.0
    gradient_c: NonNegative = 0.1
    dependence: NonNegative = 1.0
    rate_term: NonNegative = 1.0
    hysteresis: NonNegative = 1.0
    clock_ppm: float = 20.0


class ChamberAir:
    """Air and wall of a chamber in a room at `room`, °C.

    While the door is closed, the air temperature changes by at most `max_rate`, K/s.
    """

    def __init__(self, room: float, max_rate: float) -> None:
        self.room, self._max_rate = room, max_rate
        self.air = self.wall = room
        self._power = 0.0

    def step(self, demand: float, *, door_open: bool) -> None:
        """Advance by `GRID` with a demand from full cooling (-1) to full heating (1)."""
        self._power += (demand - self._power) * (1.0 - exp(-GRID / _EXCHANGER))
        rate = _POWER * self._max_rate * self._power + (self.wall - self.air) / _AIR
        rate = min(max(rate, -self._max_rate), self._max_rate)
        if door_open:
            rate += (self.room - self.air) / _DOOR
        self.wall += GRID * ((self.air - self.wall) / _WALL + (self.room - self.wall) / _LEAK)
        self.air += GRID * rate


class UnitThermal:
    """Temperatures and parameters of one unit.

    `clock_delay` is the delay of the unit's clock, s. The temperature sensor has the faults `stuck`, its constant
    output, °C, or None, `offset`, K, and `jumps_until`, the device time, s, until which its output is invalid.

    Parameters
    ----------
    settings : settings of the unit
    sigma : sigma of the parameters by group, SI, which determines the size of the dependence on temperature
    room : temperature at the start, °C
    random : generator of the unit's functions
    """

    def __init__(
        self, settings: ThermalSettings, sigma: Mapping[str, float], room: float, random: np.random.Generator
    ) -> None:
        self._settings = settings
        self._case = room
        self._temperatures = np.full(3, room)
        self._rates = np.zeros(3)
        self._gradient = 0.0
        self._play = self._temperatures.copy()
        direction = random.standard_normal(3)
        self._gradient_axis = direction / np.linalg.norm(direction)
        sizes = [sigma[p.group] * _SHARES.get(p.group, 0.0) for p in PARAMETERS]
        self._size = settings.dependence * np.array(sizes)
        draw = random.uniform
        self._weights = np.clip(random.standard_normal((3, COUNT)), -2.0, 2.0) * [[1.0], [0.6], [0.4]]
        self._centres, self._widths = draw(-10.0, 60.0, (2, COUNT)), draw(120.0, 200.0, (3, COUNT))
        self._slopes, self._loops = draw(-1.0, 1.0, (2, COUNT))
        self._index = np.array([1 if p.sensor == "gyro" else 2 for p in PARAMETERS])
        self._is_bias = np.array([p.group.endswith("_bias") for p in PARAMETERS])
        self.clock_delay = 0.0
        self.stuck: float | None = None
        self.offset = 0.0
        self.jumps_until = -np.inf

    @property
    def temperatures(self) -> tuple[float, float, float]:
        """Temperatures of the temperature sensor, the gyros and the accelerometers, °C."""
        sensor, gyro, accel = self._temperatures.tolist()
        return sensor, gyro, accel

    def step(self, air: float, up: FloatArray) -> None:
        """Advance by `GRID` in air of a temperature, °C, with the direction of up in the body frame, shape (3,)."""
        settings, slope = self._settings, float(up @ self._gradient_axis)
        # the air flows more freely past a warm face that is on top
        time = settings.case_time_s * (1.0 - 0.05 * slope)
        self._case += (air + settings.self_heating_c - self._case) * (1.0 - exp(-GRID / time))
        self._gradient += (settings.gradient_c * slope - self._gradient) * (1.0 - exp(-GRID / _GRADIENT))
        before = self._temperatures.copy()
        targets = self._case + np.array([0.0, self._gradient, -0.5 * self._gradient])
        self._temperatures += (targets - self._temperatures) * -np.expm1(-GRID / _TIME_CONSTANTS)
        self._rates = (self._temperatures - before) / GRID
        self.clock_delay += GRID * 1e-6 * settings.clock_ppm * ((self._case - REFERENCE) / _CLOCK_SPAN) ** 2
        self._play = np.clip(self._play, self._temperatures - _PLAY, self._temperatures + _PLAY)

    def sensor_output(self, time: float) -> float:
        """Return the output of the temperature sensor at device time `time`, s, in °C."""
        if self.stuck is not None:
            return self.stuck
        return float(self._temperatures[0]) + self.offset if time >= self.jumps_until else -128.0

    def parameters(self, base: FloatArray) -> FloatArray:
        """Return the current parameters, SI, shape (30,), of a unit with parameters `base` at 25 °C."""
        temperature, rate = self._temperatures[self._index], self._rates[self._index]
        loop = (temperature - self._play[self._index]) / _PLAY
        moving = self._settings.rate_term * _RATE_SHARE * 60.0 * self._slopes * rate
        return np.asarray(self.steady(base, temperature, loop) + self._size * self._is_bias * moving)

    def steady(self, base: FloatArray, temperature: FloatArray | float, loop: FloatArray | float = 0.0) -> FloatArray:
        """Return the parameters of a unit that rests at a temperature, °C, SI, shape (30,).

        Parameters
        ----------
        base : parameters at 25 °C, SI, shape (30,)
        temperature : temperature of all sensors, or of the sensor of each parameter, °C, shape (30,)
        loop : state of the hysteresis, or that of each parameter, shape (30,): -1 after cooling, 1 after heating
        """
        shape = self._shape(np.broadcast_to(temperature, COUNT)) - self._shape(np.full(COUNT, REFERENCE))
        remaining = self._settings.hysteresis * _HYSTERESIS_SHARE * self._loops * self._is_bias * loop
        return np.asarray(base + self._size * (shape + remaining))

    def _shape(self, temperature: FloatArray) -> FloatArray:
        saturating = np.tanh((temperature - self._centres[0]) / self._widths[0])
        bump = np.exp(-(((temperature - self._centres[1]) / self._widths[1]) ** 2))
        growing = np.expm1((temperature - REFERENCE) / self._widths[2])
        return np.asarray((self._weights * [saturating, bump, growing]).sum(axis=0))
