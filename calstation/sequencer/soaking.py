"""Soaks and ramps of the chamber; a soak ends when the temperature of every unit is steady."""

import logging
import math
from collections import deque
from collections.abc import Mapping, Sequence

import numpy as np

from calstation.errors import DeviceFaultError
from calstation.physics import Ramp, Soak
from calstation.sequencer.chamber import ChamberControl, SoakProgress
from calstation.sequencer.control_loop import ControlLoop
from calstation.sequencer.events import Message, StepStarted
from calstation.sequencer.units import StepInvalid, Unit

#: Smallest number of temperatures from which their slope is computed.
_MIN_COUNT = 10

#: Largest number of temperatures in a track; each is the mean of several readings.
_MAX_COUNT = 200

#: Smallest difference between the temperature at which registers are verified and the last one of a stage, K, and
#: difference of a candidate that is not a set point of the stage, at which higher-order terms matter, K.
_MIN_DIFFERENCE, _INTERMEDIATE_DIFFERENCE = 10.0, 20.0

logger = logging.getLogger(__name__)


def verification_temperature(visited: Sequence[float], ambient: float) -> float:
    """Return the temperature nearest to ambient at which registers are verified, °C.

    It differs from the last temperature, and is a set point, between set points, or ambient.

    Parameters
    ----------
    visited : set points of a stage, °C, in order
    ambient : temperature to which the chamber returns, °C
    """
    last = visited[-1]
    between = (last + d for d in (-_INTERMEDIATE_DIFFERENCE, _INTERMEDIATE_DIFFERENCE))
    candidates = (ambient, *visited, *(t for t in between if min(visited) < t < max(visited)))
    others = [t for t in candidates if abs(t - last) >= _MIN_DIFFERENCE]
    return min(others, key=lambda t: abs(t - ambient), default=ambient)


class TemperatureTrack:
    """Temperatures of a unit, °C, over the last `period` s of station time."""

    def __init__(self, unit: Unit, period: float) -> None:
        self._unit, self._period = unit, period
        self._begin = -math.inf
        self._means: deque[tuple[float, float]] = deque()
        self._sums = (0, 0.0, 0.0)

    def add(self, now: float) -> None:
        """Add the temperature at station time `now`, s; after lost samples, the track begins again."""
        flow, temperature = self._unit.flow, self._unit.temperature
        if flow.missing or not math.isfinite(self._begin):
            self.clear(now)
        if temperature is None or not flow.count:
            return
        count, time, value = self._sums
        self._sums = count + 1, time + now, value + temperature
        last = self._means[-1][0] if self._means else self._begin
        if now - last >= self._period / _MAX_COUNT:
            count, time, value = self._sums
            self._means.append((time / count, value / count))
            self._sums = 0, 0.0, 0.0
        while self._means and now - self._means[0][0] > self._period:
            self._means.popleft()

    def clear(self, now: float) -> None:
        """Begin again at station time `now`, s."""
        self._begin, self._sums = now, (0, 0.0, 0.0)
        self._means.clear()

    def remaining(self, now: float) -> float:
        """Return the time until the track covers its whole period, s, at station time `now`, s."""
        return max(self._period - (now - self._begin), 0.0)

    def is_steady(self, limit: float, now: float) -> bool:
        """Return whether the slope over the whole period is at most `limit`, K/min, at station time `now`, s."""
        return not self.remaining(now) and abs(self.slope) <= limit

    @property
    def latest(self) -> float:
        """Latest temperature, °C; NaN before the first one."""
        return self._means[-1][1] if self._means else math.nan

    @property
    def slope(self) -> float:
        """Least-squares slope of the temperature, K/min; infinite for fewer than 10 values."""
        if len(self._means) < _MIN_COUNT:
            return math.inf
        times, values = np.array(self._means).T
        return float(np.polyfit((times - times[0]) / 60.0, values, 1)[0])


class SoakLoop:
    """Executes the steps of a stage that change the temperature.

    `remaining` is the estimated remaining time of the current soak, s, or None.
    """

    def __init__(self, control_loop: ControlLoop) -> None:
        self._control_loop = control_loop
        self._context = control_loop.context
        self._units = control_loop.units
        self.remaining: float | None = None

    @property
    def _chamber(self) -> ChamberControl:
        chamber = self._control_loop.chamber
        if chamber is None:
            raise RuntimeError("a soak without a chamber")
        return chamber

    def ramp(self, step: Ramp) -> None:
        """Begin a ramp of the chamber. Raises ConfigurationError or DeviceFaultError."""
        self._begin_step("ramp", step.temperature, step.rate)
        with self._units.attributing_errors_to_table():
            self._chamber.ramp(step.temperature, step.rate / 60.0)

    def soak(self, step: Soak) -> None:
        """Go to a temperature, and wait until all units are steady or the operator ends the stage.

        The steady period contains no lost samples. A unit that is not steady in time, or whose temperature disagrees
        with that of the chamber, leaves the batch. Raises DeviceFaultError for the last one, StepInvalid if a unit is
        silent, and the interruptions of `ControlLoop.update`.
        """
        clock, loop = self._context.clock, self._control_loop
        if step.index:
            self._begin_step("soak", step.temperature, float(step.index), float(step.count))
        else:
            self._begin_step("soak_to_verify", step.temperature)
        self._units.each(_require_sensor)
        begin = clock.now()
        with self._units.attributing_errors_to_table():
            self._chamber.hold(step.temperature)
        tracks = {unit: TemperatureTrack(unit, step.hold) for unit in self._units}
        loop.watchful = False
        self._chamber.soak = lambda: self._progress(step, tracks)
        try:
            while True:
                if self._context.control.ending_stage:
                    return
                loop.tick()
                now = clock.now()
                if silent := {unit: "no_data" for unit in self._units if unit.silent}:
                    raise StepInvalid(silent)
                for unit in self._units:
                    if self._chamber.arrived:
                        tracks[unit].add(now)
                    else:
                        tracks[unit].clear(now)
                pending = [unit for unit in self._units if not tracks[unit].is_steady(step.slope, now)]
                if not pending:
                    break
                if now - begin > step.timeout:
                    self._end_unsteady(step, {unit: tracks[unit] for unit in pending})
                    break
                self.remaining = min(self._time_left(step, tracks, now), step.timeout - (now - begin))
            self._units.each(self._check_agreement)
        finally:
            self.remaining = self._chamber.soak = None
            loop.watchful = True
        minutes = (clock.now() - begin) / 60.0
        logger.info("soak at %.1f °C ended after %.1f min", step.temperature, minutes)
        self._context.emit(Message("soaked", {"temperature": step.temperature, "minutes": minutes}))

    def _progress(self, step: Soak, tracks: Mapping[Unit, TemperatureTrack]) -> SoakProgress:
        rates = {unit.slot.name: tracks[unit].slope for unit in self._units}
        return SoakProgress(step.slope, rates, self.remaining)

    def _end_unsteady(self, step: Soak, pending: Mapping[Unit, TemperatureTrack]) -> None:
        """Let the units that are not steady in time leave. Raises DeviceFaultError for the chamber or the last unit."""
        minutes = step.timeout / 60.0
        if not self._chamber.arrived:
            values = {"temperature": step.temperature, "air": self._chamber.status.air_c, "minutes": minutes}
            raise DeviceFaultError("temperature.not_reached", **values)
        for unit, track in pending.items():
            values = {"temperature": step.temperature, "slope": track.slope, "limit": step.slope, "minutes": minutes}
            self._units.leave(unit, DeviceFaultError("temperature.not_steady", **values))

    def _check_agreement(self, unit: Unit) -> None:
        """Check that the sensor of a unit agrees with that of the chamber. Raises DeviceFaultError."""
        if unit.temperature is not None:
            self._chamber.check_agreement(unit.temperature)

    def _time_left(self, step: Soak, tracks: Mapping[Unit, TemperatureTrack], now: float) -> float:
        """Estimate the remaining time of a soak, s: the rate of a unit decreases exponentially until it is steady."""
        if not self._chamber.arrived:
            return self._chamber.remaining + step.hold
        remaining = 0.0
        for track in tracks.values():
            gap, slope = abs(step.temperature - track.latest), abs(track.slope)
            if step.slope < slope < math.inf:
                remaining = max(remaining, 60.0 * gap / slope * math.log(slope / step.slope))
            remaining = max(remaining, track.remaining(now))
        return remaining

    def _begin_step(self, kind: str, *values: float) -> None:
        tags = self._control_loop.tags
        self._context.emit(StepStarted(tags.stage, tags.step, kind, (kind, *values)))


def _require_sensor(unit: Unit) -> None:
    if unit.temperature is None and not unit.silent:
        raise DeviceFaultError("temperature.no_sensor")
