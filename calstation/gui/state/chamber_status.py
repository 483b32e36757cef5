"""The state of the chamber of a run over temperature, which is derived from the events of the engine."""

import math
from dataclasses import dataclass, field
from typing import Literal

from calstation.sequencer import ChamberChanged, Event, Fault, Message, StateChanged

#: Maximum number of points of a track; when it is exceeded, every second point is removed.
_MAX_POINTS = 2000

#: Whether the operator may open the chamber after the run; "" during the run.
Access = Literal["", "closed", "open", "unknown"]

#: Access after a message of the engine.
_MESSAGES: dict[str, Access] = {
    "chamber_to_ambient": "closed",
    "chamber_returning": "closed",
    "chamber_may_be_opened": "open",
    "chamber_unknown": "unknown",
}


@dataclass
class Track:
    """Temperatures of the air, the set point and, by slot, the units, °C, over station time, s."""

    times: list[float] = field(default_factory=list)
    air: list[float] = field(default_factory=list)
    set_point: list[float] = field(default_factory=list)
    units: dict[str, list[float]] = field(default_factory=dict)  #: NaN before the first temperature of a unit.

    def add(self, event: ChamberChanged) -> None:
        """Add the temperatures of an event."""
        for slot in event.units:
            self.units.setdefault(slot, [math.nan] * len(self.times))
        self.times.append(event.time)
        self.air.append(event.air_c)
        self.set_point.append(event.set_point_c)
        for slot, values in self.units.items():
            values.append(event.units.get(slot, math.nan))
        if len(self.times) > _MAX_POINTS:
            for each in (self.times, self.air, self.set_point, *self.units.values()):
                del each[1:-1:2]


class ChamberStatus:
    """The state of the chamber of a run.

    `latest` is the last event with its temperatures, or None without a chamber. `access` is "" during the run, and from
    its end states whether the chamber may be opened.
    """

    def __init__(self) -> None:
        self.latest: ChamberChanged | None = None
        self.access: Access = ""
        #: True until it is known whether an earlier run left the chamber at an unknown temperature.
        self.unchecked = False
        self.track = Track()

    @property
    def must_stay_closed(self) -> bool:
        """Whether the chamber must not be opened, after a run or until it is known how the last run left it."""
        return self.unchecked or self.access in ("closed", "unknown")

    @property
    def farthest(self) -> tuple[str | None, float, float] | None:
        """Slot, temperature and distance, °C, of the unit or air farthest outside the range for opening the chamber.

        The slot is None for the air. The distance is negative below the range. None if all temperatures are within it.
        """
        if self.latest is None:
            return None
        low, high = self.latest.open_c
        values: list[tuple[str | None, float]] = [*self.latest.units.items(), (None, self.latest.air_c)]
        outside = [(slot, value, value - min(max(value, low), high)) for slot, value in values]
        worst = max(outside, key=lambda entry: abs(entry[2]))
        return worst if worst[2] else None

    def handle_event(self, event: Event) -> None:
        """Process an event."""
        match event:
            case ChamberChanged():
                self.latest = event
                self.track.add(event)
            case Message() if event.id in _MESSAGES:
                self.access = _MESSAGES[event.id]
            case StateChanged(state="stopping" | "fault") | Fault(slot=""):
                if self.latest is not None and self.access == "":
                    self.access = "closed"

    def resume(self) -> None:
        """Continue after a fault of an engine that responds again."""
        if self.access == "closed":
            self.access = ""

    def end(self) -> None:
        """Process the end of the engine, after which the chamber's state is unknown unless it may be opened."""
        if self.access == "closed" or (self.access == "" and self.latest is not None):
            self.access = "unknown"

    def set_left(self, left: bool | None) -> None:
        """Set whether an earlier run left the chamber at an unknown temperature; None if this is not known yet."""
        self.unchecked = left is None
        if left:
            self.access = "unknown"

    def acknowledge(self) -> None:
        """Remove the notice that the chamber may be opened or that its state is unknown."""
        if self.access in ("open", "unknown"):
            self.access = ""
            self.latest = None
