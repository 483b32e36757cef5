"""Simulation of a stage over temperature without any protocol: a unit on a table in a chamber with its controller."""

from collections.abc import Iterator

import numpy as np

from calstation.bench import BenchConfig
from calstation.bench.chamber import ChamberMachine
from calstation.bench.truth import GRID, BenchTruth, Samples, Simulator, UnitThermal
from calstation.physics import FloatArray, IntArray, Ramp, Soak, Step

#: Simulation interval during a soak, s, and largest difference of the air from the set point once reached, K.
_INTERVAL, _TOLERANCE = 1.0, 1.0
#: Resolution of the unit's sensor, K, and number of grid cells per computation of the parameters during a soak.
_RESOLUTION, _SPARSE = 0.01, 8


class ChamberSimulator(Simulator):
    """Simulates a stage `temperature`; `thermal` contains the true temperatures and parameters of the unit.

    Without `counts`, it computes the true parameters over time instead of the output of the unit.
    """

    def __init__(self, truth: BenchTruth, config: BenchConfig, seed: int, *, counts: bool = True) -> None:
        thermal = config.unit_thermal()
        if thermal is None or config.chamber is None:
            raise ValueError("a bench without a chamber")
        self.thermal: UnitThermal = thermal
        self._chamber = ChamberMachine(config.chamber)
        self._chamber.start()
        self._target, self._rate = self._chamber.set_point, 0.0
        self._counts, self._base, self._is_soaking = counts, truth.imu.parameters, False
        self._sensed: list[float] = []  #: Temperatures of the unit's sensor, one per `GRID`.
        self.parameters_of_cells: list[FloatArray] = []  #: True parameters, one per `GRID`, without `counts`.
        super().__init__(truth, seed, thermal=thermal, air=self._air)

    @property
    def set_point(self) -> float:
        """Present set point of the chamber, °C."""
        return self._chamber.set_point

    def _air(self) -> float:
        """Advance the chamber by one cell of the grid and return the temperature of its air, °C."""
        chamber, change = self._chamber, self._rate * GRID
        chamber.set_point += float(np.clip(self._target - chamber.set_point, -change, change))
        chamber.advance(len(self._sensed) * GRID)
        if not self._counts:
            is_due = not (self._is_soaking and len(self._sensed) % _SPARSE)
            latest = self.thermal.parameters(self._base) if is_due else self.parameters_of_cells[-1]
            self.parameters_of_cells.append(latest)
        self._sensed.append(round(self.thermal.temperatures[0] / _RESOLUTION) * _RESOLUTION)
        return chamber.truth.air

    def _produce(self, duration: float) -> Samples:
        if self._counts:
            return super()._produce(duration)
        count = int(np.ceil(duration / self._stream.interval - 1e-9))
        self._stream.skip(count, *self._drive.profiles)
        return np.zeros((count, 6)), np.full((count, 2), np.nan), np.full(count, self._step, np.int64)

    def _further(self, step: Step) -> Iterator[Samples]:
        if isinstance(step, Ramp):
            self._target, self._rate = step.temperature, step.rate / 60.0
        elif isinstance(step, Soak):
            self._target = self._chamber.set_point = step.temperature
            begin, arrived = self.time, np.inf
            self._is_soaking = True
            while self.time - begin < step.timeout:
                yield self._produce(_INTERVAL)
                if abs(self._chamber.temperature - self._target) > _TOLERANCE:
                    arrived = np.inf
                else:
                    arrived = min(arrived, self.time)
                if self.time - arrived >= step.hold and abs(self._slope(step.hold)) <= step.slope:
                    break
            self._is_soaking = False

    def _slope(self, period: float) -> float:
        """Return the mean rate of the unit's sensor over the last period, K/min."""
        recent = np.array(self._sensed[-round(period / GRID) :])
        return float(np.polyfit(np.arange(len(recent)) * GRID / 60.0, recent, 1)[0])

    def _temperatures(self, seq: IntArray) -> FloatArray:
        per_cell = max(1, round(GRID / self._stream.interval))
        return np.array(self._sensed)[seq // per_cell]
