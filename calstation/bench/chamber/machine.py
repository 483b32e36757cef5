"""The controller of a chamber, which brings the temperature of its sensor to the set point."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from calstation.bench.truth import GRID, ChamberAir

#: Control error at which the controller demands full power, K, and its integration time, s.
_BAND, _INTEGRATION = 6.0, 400.0
#: Time constant of the chamber's sensor, s.
_SENSOR = 8.0


class ChamberSettings(BaseModel):
    """Settings of a chamber; `docs/reference/bench.md` explains every entry."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    room_c: float = 23.0
    rate_c_per_min: Annotated[float, Field(gt=0.0)] = 5.0


class ChamberMachine:
    """A chamber that is off at the start.

    `door_open` is the state of the door. `stuck`, `offset`, K, and `powerless` are faults of its sensor and of its
    heating and cooling.
    """

    def __init__(self, settings: ChamberSettings) -> None:
        self.truth = ChamberAir(settings.room_c, settings.rate_c_per_min / 60.0)
        self.set_point = settings.room_c
        self.running = self.door_open = self.powerless = self.stuck = False
        self.alarm = 0
        self.offset = 0.0
        self.door_closes = float("inf")
        self._now = 0.0
        self._sensor = self._shown = settings.room_c
        self._integral = 0.0

    @property
    def temperature(self) -> float:
        """Air temperature measured by the chamber's sensor, °C."""
        return self._shown

    def start(self) -> None:
        """Start controlling the temperature unless there is an alarm."""
        self.running = self.alarm == 0

    def stop(self) -> None:
        """Stop controlling the temperature."""
        self.running, self._integral = False, 0.0

    def trip(self, alarm: int) -> None:
        """Stop with an alarm."""
        self.stop()
        self.alarm = alarm

    def open_door(self, seconds: float) -> None:
        """Open the door for some time."""
        self.door_open, self.door_closes = True, self._now + seconds

    def advance(self, now: float) -> None:
        """Advance to `now`, s, in steps of `GRID`."""
        while self._now + GRID <= now:
            self._now += GRID
            self.door_open = self.door_open and self._now < self.door_closes
            self.truth.step(self._demand(), door_open=self.door_open)
            self._sensor += (self.truth.air - self._sensor) * GRID / _SENSOR
            if not self.stuck:
                self._shown = self._sensor + self.offset

    def _demand(self) -> float:
        """Return the demand, from full cooling (-1) to full heating (1)."""
        if not self.running or self.powerless:
            return 0.0
        error = self.set_point - self._shown
        demand = error / _BAND + self._integral
        if abs(demand) < 1.0:
            self._integral += error / _BAND * GRID / _INTEGRATION
        return min(max(demand, -1.0), 1.0)
