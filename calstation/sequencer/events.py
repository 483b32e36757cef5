"""Events of a run: immutable identifiers and values, not text; the listener formats them with the catalogue.

The same stream feeds the progress bar, the log, the window and the database. `to_json` and `from_json` convert an event
for a pipe or a log.
"""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from calstation.errors import CalstationError
from calstation.estimation import Solution
from calstation.messages import values_from_json, values_to_json
from calstation.physics import INDEX
from calstation.records import Verdict


@dataclass(frozen=True)
class Event:
    """Base class of all events; `slot` is the slot of the unit concerned, "" for the whole run or its only unit."""

    slot: str = field(default="", kw_only=True)


@dataclass(frozen=True)
class StateChanged(Event):
    """The state of the run changed from `previous` to `state`."""

    state: str
    previous: str


@dataclass(frozen=True)
class StageStarted(Event):
    """Stage number `index` (from 0) of `count` begins; `duration` is its planned duration, s.

    A `repeated` stage can be ended early by `Command.END_STAGE`.
    """

    stage: str
    index: int
    count: int
    duration: float
    repeated: bool = False


@dataclass(frozen=True)
class StageProgress(Event):
    """Progress of a stage: `fraction` 0..1, `remaining` time in s, `sigma` the current maximum per group, SI."""

    stage: str
    fraction: float
    remaining: float
    sigma: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class StageRanked(Event):
    """Observability of a stage up to `step`: rank of the observability matrix, and strength by state (`Ranking`)."""

    stage: str
    step: int
    rank: int
    strength: Mapping[str, float]


@dataclass(frozen=True)
class StepStarted(Event):
    """A step begins: its `kind`, its number `step` on the samples, and its `label` (id and values) from the plan."""

    stage: str
    step: int
    kind: str
    label: tuple[str | float, ...] = ()


@dataclass(frozen=True)
class StageEnded(Event):
    """The motion of a stage has ended; `reason` is plan, rounds, duration, targets or operator."""

    stage: str
    reason: str
    rounds: int


@dataclass(frozen=True)
class TableMoved(Event):
    """Encoder angles, rad, and rates, rad/s, of the table."""

    outer: float
    inner: float
    outer_rate: float
    inner_rate: float
    moving: bool


@dataclass(frozen=True)
class JointsMoved(Event):
    """Angles, rad, and rates, rad/s, of a gimbal's joints x, y, z."""

    joints: tuple[float, ...]
    rates: tuple[float, ...]
    moving: bool


@dataclass(frozen=True)
class GimbalTurned(Event):
    """Turn number `index` (from 1) about body axis `axis` by `angle`, rad, is complete.

    `drift` of the other joints and the `threshold` are in rad, `gain` is α; `complete` is True if the axis is complete.
    """

    axis: int
    index: int
    angle: float
    drift: tuple[float, ...]
    threshold: float
    gain: float
    complete: bool


@dataclass(frozen=True)
class Trace(Event):
    """Live output since the last trace: for each tick the IMU `time`, s, and the mean gyro x y z, accel x y z, SI."""

    time: tuple[float, ...]
    output: tuple[float, ...]


@dataclass(frozen=True)
class PositionGuided(Event):
    """Progress at a position to which the operator turns the unit.

    `stage` is "" while the unit is turned to verify its new registers; `index` counts from 1; `state` is the state of a
    `Guidance`; `rest` and `wanted` are the rest so far and the required one, s. `outer` and `inner` are the requested
    rail angles, rad, `*_before` the previous ones. `up` is the unit vector opposite to gravity in the body frame, shape
    (3,); `done` contains the vectors of the completed positions, concatenated. `suffices` is True if they determine all
    parameters of the stage.
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
    """A message to the user: the entry ``event.<id>`` of the catalogue with its values."""

    id: str
    values: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class StageSolved(Event):
    """The solution of a stage: value and sigma per estimated parameter, SI, and its consistency as in the result."""

    stage: str
    parameters: Mapping[str, Mapping[str, float]]
    consistency: Mapping[str, Any]


@dataclass(frozen=True)
class Finalized(Event):
    """The run of a unit has ended: its verdict, the paths of its files as text, and the result itself."""

    verdict: Verdict
    log: str
    result_file: str
    result: Mapping[str, Any]


@dataclass(frozen=True)
class Settled(Event):
    """A register operation has ended.

    `closing` is the end state of the transfer in the journal: done, kept or restored; stopped if the operator stopped
    it. `proof` is the method of verification: turn, rest or read_back; "" if there was none. `unit` contains its
    registers; {} after a stop.
    """

    serial: str
    closing: str
    proof: str
    unit: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Fault(Event):
    """The run failed: class of the error (``internal`` for a programming error), text and catalogue entry."""

    kind: str
    text: str
    exit_code: int
    code: str = ""
    values: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def of(cls, error: CalstationError) -> "Fault":
        """Return the fault event for an error."""
        return cls(type(error).__name__, str(error), error.exit_code, error.code, error.values)


_KINDS: dict[str, Callable[..., Event]] = {kind.__name__: kind for kind in Event.__subclasses__()}

#: Events that only refresh a display: a slow listener may miss some, and they are not logged.
LOSSY = (StageProgress, StageRanked, TableMoved, JointsMoved, Trace, PositionGuided)


def to_json(event: Event) -> dict[str, Any]:
    """Return the event as a JSON-ready dictionary with its kind under ``event``."""
    data = asdict(event)
    if not event.slot:
        del data["slot"]
    if isinstance(event, Message | Fault):
        data["values"] = values_to_json(event.values)
    return {"event": type(event).__name__, **data}


def from_json(data: Mapping[str, Any]) -> Event:
    """Return the event converted by `to_json`. Raises KeyError for an unknown kind."""
    values = dict(data)
    kind = _KINDS[values.pop("event")]
    for name in ("label", "time", "output", "up", "done", "joints", "rates", "drift"):
        if name in values:
            values[name] = tuple(values[name])
    if "values" in values:
        values["values"] = values_from_json(values["values"])
    if "verdict" in values:
        values["verdict"] = Verdict(values["verdict"])
    return kind(**values)


def solution_events(solution: Solution) -> tuple[StageSolved | Message, ...]:
    """Return the events of a stage's solution: its values, then the solver's messages."""
    sigma, consistency = solution.posterior.sigma, solution.consistency
    parameters = {
        name: {"value": float(solution.posterior.mean[INDEX[name]]), "sigma": float(sigma[INDEX[name]])}
        for name in solution.estimated
    }
    parameters |= {name: {"value": e.value, "sigma": e.sigma} for name, e in solution.estimates.items()}
    names = ("nis_mean", "nis_low", "nis_high", "warning")
    innovations = {"passed": consistency.verdict, **{name: getattr(consistency, name) for name in names}}
    remarks = [Message(message_id, dict(values)) for message_id, values in solution.messages]
    return StageSolved(solution.stage, parameters, innovations), *remarks
