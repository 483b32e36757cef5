"""A chamber without a protocol, whose air approaches its set point at a limited rate and carries units with it."""

import math
import threading
from collections.abc import Callable
from dataclasses import dataclass, field

from calstation.devices import Chamber, ChamberStatus


@dataclass
class FakeChamber(Chamber):
    """A chamber whose air moves at `rate`, K/s, and whose units follow the air with the time constant `lag`, s.

    `commands` lists what it was told; `stuck` freezes its sensor and `dead` its heating and cooling. `error` is raised
    by every call, and `answers` delays all of them while it is not set.
    """

    now: Callable[[], float]
    air: float = 23.0
    unit: float = 23.0
    rate: float = 0.05
    lag: float = 300.0
    running: bool = False
    door_open: bool | None = False
    alarm: str | None = None
    stuck: bool = False
    dead: bool = False
    offset: float = 0.0
    error: Exception | None = None
    goal: float = 23.0
    commands: list[tuple[str, float]] = field(default_factory=list)
    answers: threading.Event = field(default_factory=threading.Event)

    def __post_init__(self) -> None:
        self.answers.set()
        self._at, self._shown = self.now(), self.air

    def advance(self) -> None:
        """Move air and unit to the present."""
        seconds, self._at = self.now() - self._at, self.now()
        if self.running and not self.dead:
            gap = self.goal - self.air
            self.air += math.copysign(min(abs(gap), self.rate * seconds), gap)
        self.unit += (self.air - self.unit) * (1.0 - math.exp(-seconds / self.lag))

    def identify(self) -> str:
        return "fake"

    def status(self) -> ChamberStatus:
        self._call()
        if not self.stuck:
            self._shown = self.air + self.offset
        return ChamberStatus(self._shown, self.goal, self.running, self.door_open, self.alarm)

    def set_point(self, temperature_c: float) -> None:
        self._call("set_point", temperature_c)
        self.goal = temperature_c

    def start(self) -> None:
        self._call("start")
        self.running = True

    def stop(self) -> None:
        self._call("stop")
        self.running = False

    def close(self) -> None:
        self.commands.append(("close", 0.0))

    def _call(self, command: str = "", value: float = 0.0) -> None:
        self.answers.wait(10.0)
        self.advance()
        if self.error is not None:
            raise self.error
        if command:
            self.commands.append((command, value))
