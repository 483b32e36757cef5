"""Events of a run: immutable names and values, never sentences; the listener words them from the catalogue.

The same stream feeds progress bar, log, window and database. `to_json` and `from_json` carry an
event through a pipe or a log.
"""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from calstation.errors import CalstationError
from calstation.estimation import Solution
from calstation.messages import values_from_json, values_to_json
from calstation.physics import INDEX


@dataclass(frozen=True)
class Event:
    """Any of the events below."""


@dataclass(frozen=True)
class StateChanged(Event):
    """The run went from state `previous` to `state`."""

    state: str
    previous: str


@dataclass(frozen=True)
class StageStarted(Event):
    """Stage number `index` (from 0) of `count` begins; `duration` is that of its plan, s."""

    stage: str
    index: int
    count: int
    duration: float


@dataclass(frozen=True)
class StageProgress(Event):
    """Progress of a stage: `fraction` 0..1, `remaining` s, `sigma` the largest per group so far, SI."""

    stage: str
    fraction: float
    remaining: float
    sigma: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class StepStarted(Event):
    """A step begins: `kind` of step, `step` number on its samples, `label` id and values of the plan."""

    stage: str
    step: int
    kind: str
    label: tuple[str | float, ...] = ()


@dataclass(frozen=True)
class StageEnded(Event):
    """The motion of a stage is over because of `reason`: plan, rounds, duration, targets or operator."""

    stage: str
    reason: str
    rounds: int


@dataclass(frozen=True)
class TableMoved(Event):
    """Encoder angles, rad, and rates, rad/s."""

    outer: float
    inner: float
    outer_rate: float
    inner_rate: float
    moving: bool


@dataclass(frozen=True)
class SampleStats(Event):
    """Data flow so far, and the mean output of the latest tick: gyro x y z, accel x y z, SI."""

    received: int
    gaps: int
    crc_errors: int
    mean: tuple[float, ...]
    temperature: float | None


@dataclass(frozen=True)
class Trace(Event):
    """Live output since the last trace, a mean per tick: IMU `time`, s, and gyro x y z, accel x y z, SI, for each."""

    time: tuple[float, ...]
    output: tuple[float, ...]


@dataclass(frozen=True)
class PositionGuided(Event):
    """Progress of a position to which the operator carries the unit.

    `stage` is "" while the unit is turned to verify its new registers; `index` counts from 1; `state` is one of
    `estimation.guidance`. Rail angles asked for, rad, and those asked for before. `up` is the direction of gravity in
    b; `done` those of the positions done, concatenated. `suffices` : they determine all parameters of the stage.
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
class Message(Event):
    """A message for a person: the entry ``event.<id>`` of the catalogue with its values."""

    id: str
    values: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class StageSolved(Event):
    """A stage's answer: value and sigma per estimated parameter, SI, and its consistency as in the result."""

    stage: str
    parameters: Mapping[str, Mapping[str, float]]
    consistency: Mapping[str, Any]


@dataclass(frozen=True)
class Verdict(Event):
    """The run is over: `outcome` as in the result JSON, files as text, the result itself."""

    outcome: str
    log: str
    result_file: str
    result: Mapping[str, Any]


@dataclass(frozen=True)
class Settled(Event):
    """A register operation is over.

    `closing` of the transfer in the journal: done, kept, restored; stopped if an operator's stop ended it. `proof` says
    how the output was verified: turn, rest or read_back; "" if it was not. `unit` holds its registers; {} after a stop.
    """

    serial: str
    closing: str
    proof: str
    unit: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Fault(Event):
    """The run failed: class of the error (``internal`` for a mistake of the program), text and catalogue entry."""

    kind: str
    text: str
    exit_code: int
    code: str = ""
    values: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def of(cls, error: CalstationError) -> "Fault":
        """The fault of an error."""
        return cls(type(error).__name__, str(error), error.exit_code, error.code, error.values)


_KINDS: dict[str, Callable[..., Event]] = {kind.__name__: kind for kind in Event.__subclasses__()}

#: Events that only refresh a display: a slow listener may miss some, and no log keeps them.
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


def solution_events(solution: Solution) -> tuple[StageSolved | Message, ...]:
    """Events of a stage's solution: its values, then the solver's remarks."""
    sigma, consistency = solution.belief.sigma, solution.consistency
    parameters = {
        name: {"value": float(solution.belief.mean[INDEX[name]]), "sigma": float(sigma[INDEX[name]])}
        for name in solution.estimated
    }
    parameters |= {name: {"value": e.value, "sigma": e.sigma} for name, e in solution.found.items()}
    names = ("nis_mean", "nis_low", "nis_high", "passed", "warning")
    innovations = {name: getattr(consistency, name) for name in names}
    remarks = [Message(message_id, dict(values)) for message_id, values in solution.messages]
    return StageSolved(solution.stage, parameters, innovations), *remarks
