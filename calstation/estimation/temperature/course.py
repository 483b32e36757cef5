"""Temperatures of gyros and accelerometers, which lag behind that of the unit's sensor."""

from dataclasses import dataclass

import numpy as np

from calstation.estimation.common import SampleBlock
from calstation.physics import PARAMETERS, FloatArray, IntArray

#: Averaging time of the sensor, s; the temperature is interpolated linearly between the averages.
_INTERVAL = 10.0
#: Elements with separate temperatures, and the index of the element on whose temperature each parameter depends.
ELEMENTS = ("gyro", "accel")
ELEMENT_OF: IntArray = np.array([0 if p.sensor == "gyro" else 1 for p in PARAMETERS])


@dataclass(frozen=True)
class ElementTemperatures:
    """Temperatures of gyros and accelerometers, °C, and their rates, K/s, shape (k, 2), at times, s, shape (k,)."""

    times: FloatArray
    values: FloatArray
    rates: FloatArray

    def at(self, times: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return temperatures, °C, and rates, K/s, at other times, s, shape (n,); shape (n, 2) each."""
        found = [[np.interp(times, self.times, column) for column in rows.T] for rows in (self.values, self.rates)]
        return np.stack(found[0], axis=1), np.stack(found[1], axis=1)


def element_temperatures(block: SampleBlock, lags: FloatArray) -> ElementTemperatures:
    """Return the temperatures of the elements, computed from averages of the unit's sensor.

    An element with a positive lag follows the sensor as a first-order low-pass with this time constant. An element with
    a negative lag precedes the sensor: its temperature is extrapolated by the rate of change.

    Parameters
    ----------
    block : samples of the stage, of which at least one has a temperature
    lags : lags of gyros and accelerometers behind the sensor, s, shape (2,)
    """
    known = block.valid & ~np.isnan(block.temperature)
    time, temperature = block.time[known], block.temperature[known]
    starts = np.flatnonzero(np.diff(np.floor((time - time[0]) / _INTERVAL), prepend=-1.0))
    counts = np.diff(starts, append=len(time))
    times, sensed = np.add.reduceat(time, starts) / counts, np.add.reduceat(temperature, starts) / counts
    values = np.stack([_lagging(times, sensed, lag) for lag in lags.tolist()], axis=1)
    rates = np.gradient(values, times, axis=0) if len(times) > 1 else np.zeros_like(values)
    return ElementTemperatures(times, values, rates)


def _lagging(times: FloatArray, sensed: FloatArray, lag: float) -> FloatArray:
    """Return temperatures that lag behind `sensed` by `lag`, s, at `times`, s; °C, shape (k,)."""
    if lag <= 0.0:
        return sensed - lag * np.gradient(sensed, times) if lag and len(times) > 1 else sensed
    lagging, steps = sensed.copy(), np.diff(times)
    behind = lag * np.diff(sensed) / steps  # steady-state difference during a ramp
    decays = np.exp(-steps / lag)
    for k, (way, decay) in enumerate(zip(behind.tolist(), decays.tolist(), strict=True)):
        lagging[k + 1] = sensed[k + 1] - way + (lagging[k] - sensed[k] + way) * decay
    return lagging
