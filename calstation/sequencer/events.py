"""What happens, told as immutable events: a name and values, never sentences; the listener words them.

The same stream feeds progress bar, journal, window and database. `to_json` and `from_json` carry an
event through a pipe or a log.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, TypeAlias

from calstation.errors import CalstationError
from calstation.messages.rendering import values_from_json, values_to_json


@dataclass(frozen=True)
class StateChanged:
    """The sequencer went from state `previous` to `state`."""

    state: str
    previous: str


@dataclass(frozen=True)
class StageStarted:
    """Stage number `index` (from 0) of `count` begins; `duration` is what its plan takes, s."""

    stage: str
    index: int
    count: int
    duration: float


@dataclass(frozen=True)
class StageProgress:
    """How far a stage is: `fraction` 0..1, `remaining` s, `sigma` the largest per group so far, SI."""

    stage: str
    fraction: float
    remaining: float
    sigma: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class StepStarted:
    """A step begins: `kind` of step, `step` its samples' number, `label` id and values of the plan."""

    stage: str
    step: int
    kind: str
    label: tuple[str | float, ...] = ()


@dataclass(frozen=True)
class StageEnded:
    """The motion of a stage is over because of `reason`: plan, rounds, duration, targets or operator."""

    stage: str
    reason: str
    rounds: int


@dataclass(frozen=True)
class TableMoved:
    """Encoder angles, rad, and rates, rad/s."""

    outer: float
    inner: float
    outer_rate: float
    inner_rate: float
    moving: bool


@dataclass(frozen=True)
class SampleStats:
    """Data flow so far, and the latest interval's mean output: gyro x y z, accel x y z, SI."""

    received: int
    gaps: int
    crc_errors: int
    mean: tuple[float, ...]
    temperature: float | None


@dataclass(frozen=True)
class Trace:
    """Live output since the last trace, a mean per tick: IMU `time`, s, and gyro x y z, accel x y z, SI, for each."""

    time: tuple[float, ...]
    output: tuple[float, ...]


@dataclass(frozen=True)
class PositionGuided:
    """Where a position stands to which the operator carries the unit.

    Attributes
    ----------
    stage : "" where the unit is turned to check its new registers
    index, count : which position, from 1, of how many
    state : waiting, moving, still, enough or repeat, as `estimation.guidance` has them
    rest, wanted : how long it has rested, and how long it is to rest, s
    outer, inner : rail angles asked for, rad, and those asked for before
    up : measured direction of gravity in b, three numbers; done : those of the positions done, one behind the other
    suffices : whether the positions done tell all that can be told
    """

    stage: str
    index: int
    count: int
    state: str
    rest: float
    wanted: float
    outer: float
    inner: float
    outer_before: float
    inner_before: float
    up: tuple[float, ...]
    done: tuple[float, ...]
    suffices: bool


@dataclass(frozen=True)
class Message:
    """Something a person should read, by its `id` and `values`."""

    id: str
    values: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class StageSolved:
    """A stage's answer: value and sigma per estimated parameter, SI, and its consistency as in the result."""

    stage: str
    parameters: Mapping[str, Mapping[str, float]]
    consistency: Mapping[str, Any]


@dataclass(frozen=True)
class Verdict:
    """The run is over: `outcome` as in the result JSON, files as text, the result itself."""

    outcome: str
    log: str
    result_file: str
    result: Mapping[str, Any]


@dataclass(frozen=True)
class Settled:
    """An errand at a unit's registers is over.

    Attributes
    ----------
    closing : of the transfer in the journal: done, kept, restored; stopped where an operator's stop ended it
    proof : "turn" or "rest", by what the output was found right; "" where it was not looked at
    unit : what it holds, as `station.hand_registers` has it; {} after a stop
    """

    serial: str
    closing: str
    proof: str
    unit: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Fault:
    """The run failed.

    Attributes
    ----------
    kind : class of the error; ``internal`` for a mistake of the program
    text : the error in English
    exit_code : of the command line
    code, values : the error's catalogue entry and what stands in its braces
    """

    kind: str
    text: str
    exit_code: int
    code: str = ""
    values: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def of(cls, error: CalstationError) -> "Fault":
        """The fault of an error."""
        return cls(type(error).__name__, str(error), error.exit_code, error.code, error.values)


Event: TypeAlias = (
    StateChanged
    | StageStarted
    | StageProgress
    | StepStarted
    | StageEnded
    | TableMoved
    | SampleStats
    | Trace
    | PositionGuided
    | Message
    | StageSolved
    | Verdict
    | Settled
    | Fault
)

_KINDS: dict[str, type[Event]] = {
    kind.__name__: kind
    for kind in (
        StateChanged,
        StageStarted,
        StageProgress,
        StepStarted,
        StageEnded,
        TableMoved,
        SampleStats,
        Trace,
        PositionGuided,
        Message,
        StageSolved,
        Verdict,
        Settled,
        Fault,
    )
}

#: Events that only refresh a display: a slow listener may miss some, and the raw log keeps none.
LOSSY = (StageProgress, TableMoved, SampleStats, Trace, PositionGuided)


def to_json(event: Event) -> dict[str, Any]:
    """The event as a JSON-ready dictionary with its kind under ``event``."""
    data = asdict(event)
    if isinstance(event, Message | Fault):
        data["values"] = values_to_json(event.values)
    return {"event": type(event).__name__, **data}


def from_json(data: Mapping[str, Any]) -> Event:
    """The event that `to_json` wrote. Raises KeyError for an unknown kind."""
    values = dict(data)
    kind = _KINDS[values.pop("event")]
    for name in ("label", "mean", "time", "output", "up", "done"):
        if name in values:
            values[name] = tuple(values[name])
    if "values" in values:
        values["values"] = values_from_json(values["values"])
    return kind(**values)
