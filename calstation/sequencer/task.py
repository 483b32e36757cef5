"""What a run is to do, and how it ended."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from calstation.devices.profiles.frame import Span
from calstation.errors import CalstationError
from calstation.estimation.common.context import ImuModel
from calstation.estimation.method import Solution
from calstation.physics.motion import Step
from calstation.physics.table import TableGeometry
from calstation.sequencer.acquisition import StatusMasks
from calstation.sequencer.preflight import PreflightLimits
from calstation.sequencer.preview import SETTLE
from calstation.sequencer.states import State
from calstation.sequencer.stop_rule import StopRule


class Output(StrEnum):
    """What a unit shows of its output with its registers applied.

    ALWAYS : its stream is that output; ASKED : it is streamed on command in place of the raw one; NEVER : only the raw
    """

    ALWAYS = "always"
    ASKED = "asked"
    NEVER = "never"


@dataclass(frozen=True)
class StagePlan:
    """A stage to run: its name, a fresh iterator of its steps, when a repeated plan has done enough."""

    name: str
    steps: Callable[[], Iterator[Step]]
    rule: StopRule = field(default_factory=StopRule)


@dataclass(frozen=True)
class Task:
    """What a run is to do and within what.

    Attributes
    ----------
    stages : in order
    preflight : what is checked first
    geometry : table axes and limits
    imu : stream of the unit; masks : bits of its status word; span : what its channels can show; wrap : samples after
        which its counter begins again
    latency : of a table poll, s; settle : of the table after a move, s
    load_angle : joint angles at which a unit is changed, rad
    travel_rate, travel_acceleration : on the way there, rad/s and rad/s²
    """

    stages: tuple[StagePlan, ...]
    preflight: PreflightLimits
    geometry: TableGeometry
    imu: ImuModel
    masks: StatusMasks = field(default_factory=StatusMasks)
    span: Span = field(default_factory=Span)
    wrap: float = np.inf
    corrected: Output = Output.NEVER
    latency: float = 0.0
    settle: float = SETTLE
    load_angle: tuple[float, float] = (0.0, 0.0)
    travel_rate: float = np.deg2rad(20.0)
    travel_acceleration: float = np.deg2rad(20.0)

    @property
    def by_hand(self) -> bool:
        """Whether the unit is carried, and nothing drives it."""
        return self.preflight.by_hand


@dataclass(frozen=True)
class Finalized:
    """Whether the unit passed, and whether registers were written, which fresh data must then prove."""

    passed: bool
    written: bool


@dataclass(frozen=True)
class Ended:
    """How a run ended: final state, what was solved, and the error of a fault."""

    state: State
    solutions: tuple[Solution, ...]
    error: CalstationError | None = None
