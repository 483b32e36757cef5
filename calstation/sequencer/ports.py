"""What the sequencer is given besides the devices: a clock, a journal and a consumer of samples."""

from collections.abc import Callable, Mapping
from concurrent.futures import Future
from typing import Any, Protocol

from calstation.estimation.common.samples import SampleBlock
from calstation.estimation.method import Solution
from calstation.physics.arrays import FloatArray
from calstation.sequencer.events import Event


class Clock(Protocol):
    """Station time, s: real, or the virtual bench's."""

    @property
    def tick(self) -> float:
        """How often the devices are looked at, s."""

    def now(self) -> float:
        """Station time, s."""

    def sleep(self, seconds: float) -> None:
        """Let `seconds` of station time pass."""

    def idle(self, seconds: float) -> None:
        """Let `seconds` of host time pass while the station computes."""


class Journal(Protocol):
    """The raw log, as the sequencer writes it."""

    def append(self, block: SampleBlock) -> None:
        """Keep samples."""

    def event(self, event: Mapping[str, Any]) -> None:
        """Keep an event."""

    def service(self) -> None:
        """Write out what is due; called at every tick."""

    def begin_sync(self) -> Future[None]:
        """Begin to write out everything, to the disk; once that is done, `service` raises what it refused."""


class Solving(Protocol):
    """The chain of stage solvers."""

    def warm(self) -> None:
        """Make ready to solve: may take seconds on a new computer, where kernels are compiled first."""

    def start(self, stage: str) -> None:
        """Begin a stage with the last one's posterior as its prior."""

    def feed(self, block: SampleBlock) -> None:
        """Take samples of the stage."""

    def sigma(self) -> FloatArray:
        """Standard deviations of the 30 parameters so far, shape (30,), SI."""

    def finish(self) -> Solution:
        """Solve the stage."""


Emit = Callable[[Event], None]
